//! Methods side by side: what a comparison and a sweep say of each.

use pliant::glam::DVec3;
use pliant::{
    ComparePlan, DEFAULT_METHODS, FailureKind, Iterations, Method, Scene, Schedule, Silent, StartFrom, SweepPlan,
    SweepSize, TriMesh, compare, shapes, sweep,
};

fn method(text: &str) -> Method {
    text.parse().expect("a method")
}

fn cylinder() -> TriMesh {
    shapes::cylinder(0.4, 3.0, 16, 30, 3).expect("valid")
}

fn schedule(iterations: Iterations) -> Schedule {
    Schedule { steps: 2, iterations, start: StartFrom::default() }
}

/// The ends of the cylinder, both moved alike by a rigid motion.
fn rigid_scene() -> Scene {
    let motion =
        r#""motion": {"rotate": {"axis": [1, 2, 3], "degrees": 50}, "about": [0, 0, 0], "translate": [1, 2, 0]}"#;
    let json = format!(
        r#"{{"name": "rigid", "handles": [
            {{"name": "low", "region": {{"box": {{"max": [null, 0.1, null]}}}}, {motion}}},
            {{"name": "high", "region": {{"box": {{"min": [null, 0.9, null]}}}}, {motion}}}]}}"#
    );
    Scene::parse(json.as_bytes(), "rigid.json").expect("a scene")
}

#[test]
fn default_methods_are_written_as_they_are_read() {
    let plan = ComparePlan::default();
    let names: Vec<String> = plan.methods.iter().map(ToString::to_string).collect();
    assert_eq!(names, DEFAULT_METHODS);
}

/// Of a rigid motion common to all handles every method that keeps details turned makes that motion: no volume lost, no face turned over, no
/// edge changed, and the same as converged as-rigid-as-possible deformation. On a cage too, as frames carry rigid motions.
#[test]
fn rigid_motions_leave_every_measure_at_zero() {
    let shape = cylinder();
    let methods =
        ["arap", "laplacian:propagated", "laplacian:similarity", "implicit", "dual", "rotation-invariant"].map(method);
    for size in ["none", "40%"] {
        let plan = ComparePlan {
            size: size.parse().expect("a size"),
            methods: methods.to_vec(),
            schedule: schedule(Iterations::Converged),
        };
        let compared = compare("cylinder", &shape, &rigid_scene(), &plan, &Silent).expect("valid");
        for row in &compared.report.rows {
            let volume = row.volume_change.expect("closed");
            let distance = row.distance_to_converged.expect("asked for");
            // Iterations end at a relative fall of the energy by 1e-5, some 1e-4 from the end; bindings are in single precision.
            assert!(volume.abs() < 1e-3 && distance < 1e-3 && row.rms_relative < 1e-3, "{row:?}");
            assert_eq!(row.flipped_faces, Some(0), "{}", row.method);
        }
    }
}

/// A refusal has a row with its reason and no figures, and no pose; the others have theirs. Linear methods show no iterations, and only
/// implicit ones have a line in the table of their paper.
#[test]
fn a_method_that_refuses_does_not_stop_the_others() {
    let shape = cylinder();
    let scene = Scene::auto(&shape.bounds());
    // Gradients alone need a fixed vertex, and the scene has all vertices in its region.
    let names = ["arap", "implicit:gradients", "implicit", "dual", "laplacian"];
    let plan = ComparePlan {
        size: SweepSize::None,
        methods: names.map(method).to_vec(),
        schedule: schedule(Iterations::Count(3)),
    };
    let compared = compare("cylinder", &shape, &scene, &plan, &Silent).expect("valid");
    let rows = &compared.report.rows;
    assert_eq!(rows.iter().map(|row| row.method.as_str()).collect::<Vec<_>>(), names);
    let iterations: Vec<Option<usize>> = rows.iter().map(|row| row.iterations).collect();
    assert_eq!(iterations, [Some(3), None, None, Some(3), None]);
    for (row, pose) in rows.iter().zip(&compared.poses) {
        let refused = row.method == "implicit:gradients";
        assert_eq!(
            (pose.is_none(), row.rms_relative.is_nan(), row.flipped_faces.is_none()),
            (refused, refused, refused)
        );
        let kind = row.failure.as_ref().map(|failure| failure.kind);
        assert_eq!(kind, refused.then_some(FailureKind::Input), "{:?}", row.failure);
    }
    let [line] = &compared.implicit[..] else { panic!("one line") };
    let held = compared.report.models[0].vertices - line.free_vertices;
    assert!(line.method == "implicit" && held > 0 && line.factor_first_ms > 0.0 && line.svd_ms > 0.0, "{line:?}");
}

/// Number of iterations and convergence make two rows of a method that iterates and one of another; the distance to the converged pose
/// is next to nothing for that pose itself, and only there if asked for.
#[test]
fn sweeps_run_linear_methods_once_and_know_the_converged_pose() {
    let shape = cylinder();
    let scene = Scene::auto(&shape.bounds());
    let mut plan = SweepPlan {
        sizes: vec![SweepSize::None],
        methods: ["arap", "implicit", "dual"].map(method).to_vec(),
        iterations: vec![Iterations::Count(1), Iterations::Converged],
        steps: 10,
        reference: true,
        ..SweepPlan::default()
    };
    let report = sweep("cylinder", &shape, &scene, &plan, &Silent).expect("valid");
    let names: Vec<(&str, Option<usize>)> = report.rows.iter().map(|r| (r.method.as_str(), r.iterations)).collect();
    assert_eq!(names, [("arap", Some(1)), ("arap", None), ("implicit", None), ("dual", Some(1)), ("dual", None)]);
    let distance = |k: usize| report.rows[k].distance_to_converged.expect("asked for");
    // The converged drag takes the same ten steps, and ends where an iteration gains 1e-5 of the energy: a thousandth of the diagonal
    // or less from the minimum.
    assert!(distance(1) < 1e-3, "{}", distance(1));
    assert!(distance(0) > 3.0 * distance(1) && distance(2) > 3.0 * distance(1), "{} {}", distance(0), distance(2));
    plan.reference = false;
    let report = sweep("cylinder", &shape, &scene, &plan, &Silent).expect("valid");
    assert!(report.rows.iter().all(|row| row.distance_to_converged.is_none() && row.volume_change.is_some()));
}

/// What each way to know turns does with a bar twisted by 270 degrees: those that are told the turn go all the way, so that a cross section in
/// the middle turns by 135 degrees; one that reads matrices takes the shorter way round, by 90 degrees back, and turns it by -45.
#[test]
fn turns_beyond_pi_are_followed_where_they_are_propagated() {
    let shape = shapes::by_name("bar", 2000).expect("a bar");
    let scene = Scene::builtin("bar-twist-270").expect("built in");
    let names = ["arap:propagated", "laplacian:propagated", "implicit", "rotation-invariant"];
    let plan = ComparePlan { methods: names.map(method).to_vec(), ..ComparePlan::default() };
    let compared = compare("bar", &shape, &scene, &plan, &Silent).expect("valid");
    let (centre, size) = (shape.bounds().centre(), shape.bounds().size());
    let in_middle = |p: &DVec3| (p.x - centre.x).abs() < 0.03 * size.x;
    for (name, pose) in names.iter().zip(&compared.poses) {
        let pose = pose.as_ref().expect("solved");
        // The mean turn about the bar's axis, from sums of cross and dot products.
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (before, after) in shape.positions.iter().zip(pose).filter(|(before, _)| in_middle(before)) {
            let [a, b] = [before, after].map(|p| (p - centre).with_x(0.0));
            (sine, cosine) = (sine + a.cross(b).x, cosine + a.dot(b));
        }
        let degrees = sine.atan2(cosine).to_degrees();
        let expected = if name.contains("propagated") { 135.0 } else { -45.0 };
        // The bar is symmetric about its middle; its triangles are nearly so.
        assert!((degrees - expected).abs() < 10.0, "{name}: {degrees}");
    }
}
