//! The whole way: shape, cage, binding, drag, propagation, and what the sweep says of it.

use pliant::glam::DVec3;
use pliant::{
    ArapOptions, BindOptions, Iterations, Method, Propagation, Prune, Scene, Schedule, Silent, StartFrom, Study,
    SweepPlan, SweepReport, SweepRow, SweepSize, TriMesh, creature, shapes, sweep,
};

fn plan(sizes: &[&str]) -> SweepPlan {
    SweepPlan { sizes: sizes.iter().map(|s| s.parse().expect("a size")).collect(), ..SweepPlan::default() }
}

fn run(shape: &TriMesh, scene: &Scene, plan: &SweepPlan) -> SweepReport {
    sweep("shape", shape, scene, plan, &Silent).expect("valid")
}

fn creature_scene() -> Scene {
    Scene::builtin("creature").expect("built in")
}

/// With a cage of all vertices the hybrid way is the direct one, bit for bit.
#[test]
fn a_cage_of_all_vertices_is_no_cage() {
    let shape = creature(2500).expect("valid");
    let study = Study::new("creature", &shape, &creature_scene()).expect("fits");
    for iterations in [Iterations::Count(2), Iterations::Converged] {
        for steps in [1, 3] {
            let poses: Vec<Vec<DVec3>> = ["100%", "9999999", "none"]
                .map(|size| {
                    let caged = study.cage(size.parse().expect("a size"), &Silent).expect("valid");
                    let bound = study.bind(&caged, Prune::default(), &Silent).expect("valid");
                    let schedule = Schedule { steps, iterations, start: StartFrom::Levels };
                    let dragged = study.drag(&caged, &Method::default(), schedule, &Silent).expect("valid");
                    study.carry(&caged, &bound, &dragged, Propagation::Frames, &Silent).0
                })
                .into();
            assert!(poses[0] == poses[2] && poses[1] == poses[2], "{iterations}, {steps} steps");
        }
    }
}

/// Through a 5 % cage the error is at most the direct solve's and a little, no edge is torn, and rest is exact.
#[test]
fn the_creature_keeps_its_relief_through_a_cage() {
    let shape = creature(20_000).expect("valid");
    let report = run(&shape, &creature_scene(), &plan(&["1%", "5%", "none"]));
    let [one, five, direct] = &report.rows[..] else { panic!("three rows") };
    assert!(direct.is_direct() && direct.cage_vertices == shape.vertex_count());
    for row in [one, five] {
        assert_eq!((row.rest_rms_relative, row.rest_error_max), (0.0, 0.0));
        assert!(row.rms_relative < 1.5 * direct.rms_relative, "{} for {}", row.rms_relative, direct.rms_relative);
        assert!(row.max_free_stretch < 2.0, "{}", row.max_free_stretch);
        assert!(row.warnings.is_empty(), "{:?}", row.warnings);
    }
}

/// The paper's way at rest is off by what pruning takes; frames are not. And the paper's error at goal is mostly that.
#[test]
fn most_of_the_error_of_positions_is_there_at_rest() {
    let shape = creature(20_000).expect("valid");
    let mut plan = plan(&["5%"]);
    // As the paper drags: by small steps, so that the solver's own error is small.
    plan.steps = 20;
    plan.propagations = vec![Propagation::Positions, Propagation::Frames];
    plan.bindings = vec![Prune::PAPER.into()];
    plan.methods = vec![Method::Arap(ArapOptions::faithful())];
    let report = run(&shape, &creature_scene(), &plan);
    let [positions, frames] = &report.rows[..] else { panic!("two rows") };
    assert!(positions.rest_rms_relative > 0.02 && frames.rest_rms_relative == 0.0);
    assert!(
        frames.rms_relative < 0.6 * positions.rms_relative,
        "{} and {}",
        frames.rms_relative,
        positions.rms_relative
    );
}

/// A scene that moves all its handles alike moves the shape alike, scale included.
#[test]
fn a_common_motion_of_the_scene_is_a_motion_of_the_shape() {
    let shape = shapes::cylinder(0.4, 3.0, 32, 60, 5).expect("valid");
    let motion =
        r#"{ "rotate": { "axis": [1, 2, 3], "degrees": 140 }, "about": [0.5, 0.5, 0.5], "translate": [0.3, 0, 1] }"#;
    let scene = |motion: &str| {
        let json = format!(
            r#"{{ "name": "rigid", "handles": [
                {{ "name": "low", "region": {{ "box": {{ "max": [1, 0.2, 1] }} }}, "motion": {motion} }},
                {{ "name": "high", "region": {{ "box": {{ "min": [0, 0.8, 0] }} }}, "motion": {motion} }} ] }}"#
        );
        Scene::parse(json.as_bytes(), "test").expect("valid")
    };
    let row = run(&shape, &scene(motion), &plan(&["5%"])).rows[0].clone();
    assert!(row.edge_max < 1e-6, "{}", row.edge_max);
}

/// Frames take on the scale of handles that grow.
#[test]
fn growing_handles_grow_what_follows_them() {
    let shape = shapes::icosphere(4);
    let json = r#"{ "name": "grow", "handles": [ { "name": "all but a belt",
        "region": { "any": [ { "box": { "max": [1, 0.45, 1] } }, { "box": { "min": [0, 0.55, 0] } } ] },
        "motion": { "about": [0.5, 0.5, 0.5], "scale": 1.5 } } ] }"#;
    let scene = Scene::parse(json.as_bytes(), "test").expect("valid");
    let row = run(&shape, &scene, &plan(&["20%"])).rows[0].clone();
    // Nearly every edge is half as long again.
    assert!((row.edge_median - 0.5).abs() < 0.01 && row.rms_relative > 0.45 && row.edge_p99 < 0.6, "{row:?}");
}

#[test]
fn a_drag_in_steps_ends_at_the_same_goal() {
    let shape = creature(3000).expect("valid");
    let study = Study::new("creature", &shape, &creature_scene()).expect("fits");
    let caged = study.cage("20%".parse().expect("a size"), &Silent).expect("valid");
    let pose = |steps| {
        let schedule = Schedule { steps, iterations: Iterations::Converged, start: StartFrom::Levels };
        study.drag(&caged, &Method::default(), schedule, &Silent).expect("valid").pose
    };
    let (once, often) = (pose(1), pose(10));
    let apart = once.iter().zip(&often).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max) / shape.bounds().diagonal();
    // Both converge to one minimum, each to within the tolerance.
    assert!(apart < 0.02, "{apart}");
}

#[test]
fn handles_too_small_for_the_cage_take_its_nearest_vertex() {
    let shape = shapes::icosphere(4);
    let json = r#"{ "name": "pin", "handles": [
        { "name": "pin", "region": { "sphere": { "centre": [0.5, 1, 0.5], "radius": 0.01 } }, "motion": { "translate": [0, 0.1, 0] } },
        { "name": "rest", "region": { "box": { "max": [1, 0.5, 1] } } } ] }"#;
    let scene = Scene::parse(json.as_bytes(), "test").expect("valid");
    let row = run(&shape, &scene, &plan(&["1%"])).rows[0].clone();
    let warned = row.warnings.iter().any(|w| w.contains("'pin'"));
    assert!(warned || row.cage_vertices > 100, "{:?}", row.warnings);
    assert!(row.rms_relative > 0.0);
}

/// The report as JSON holds what other programs rely on.
#[test]
fn sweep_json_has_the_promised_fields() {
    let shape = creature(2000).expect("valid");
    let mut plan = plan(&["10%", "none"]);
    plan.iterations.push(Iterations::Converged);
    let report = run(&shape, &creature_scene(), &plan);
    let json: serde_json::Value = serde_json::from_str(&report.to_json()).expect("JSON");
    let rows = json["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 4);
    for (row, converged) in rows.iter().zip([false, true, false, true]) {
        for text in ["model", "method", "propagation", "prune"] {
            assert!(row[text].is_string(), "{text}");
        }
        let numbers = "vertices cage_vertices steps rms_relative relative_rms rest_rms_relative rest_error_max kept_mean kept_max";
        for number in numbers.split(' ') {
            assert!(row[number].is_number(), "{number}: {}", row[number]);
        }
        let direct = row["cage_asked"] == "none";
        for (stage, caged_only) in [
            ("simplify_ms", true),
            ("bind_ms", true),
            ("prepare_ms", false),
            ("drag_ms", false),
            ("propagate_ms", true),
        ] {
            let time = &row["times"][stage];
            assert_eq!(time["median"].is_number(), !(caged_only && direct), "{stage}: {time}");
        }
        assert_eq!(row["iterations"].is_null(), converged);
    }
    let again = SweepReport::read_json(&report.to_json(), "test").expect("reads what it wrote");
    assert_eq!(again.rows.len(), 4);
    assert_eq!(again.rows[0].rms_relative, report.rows[0].rms_relative);
}

/// One row per combination, in the order of the plan.
#[test]
fn sweeps_make_every_combination_once() {
    let shape = shapes::cylinder(0.4, 3.0, 16, 30, 3).expect("valid");
    let plan = SweepPlan {
        propagations: vec![Propagation::Positions, Propagation::Frames],
        bindings: vec![Prune::PAPER.into(), BindOptions::default(), Prune::Smooth { neighbours: 8 }.into()],
        iterations: vec![Iterations::Count(0), Iterations::Count(2)],
        ..plan(&["10%", "20%", "none"])
    };
    let scene = Scene::auto(&shape.bounds());
    let report = run(&shape, &scene, &plan);
    let key = |r: &SweepRow| (r.cage_asked.clone(), r.iterations, r.propagation.clone(), r.prune.clone());
    let mut keys: Vec<_> = report.rows.iter().map(key).collect();
    assert_eq!(keys.len(), 2 * 2 * 2 * 3 + 2);
    keys.dedup();
    keys.sort();
    keys.dedup();
    assert_eq!(keys.len(), report.rows.len());
}

#[test]
fn sizes_and_iterations_read_as_they_are_written() {
    for size in ["2000", "5%", "0.5%", "100%", "error:0.002", "none", "4", "decimated:3000", "equal-time:5%"] {
        assert_eq!(size.parse::<SweepSize>().expect(size).to_string(), size);
    }
    for wrong in [
        "",
        "-1",
        "0",
        "3",
        "1e-320%",
        "0%",
        "101%",
        "nan%",
        "5 percent",
        "error:-1",
        "error:",
        "1.5",
        "decimated:none",
        "equal-time:",
    ] {
        assert!(wrong.parse::<SweepSize>().expect_err(wrong).to_string().contains("cage size"), "{wrong}");
    }
    for iterations in ["0", "2", "converged"] {
        assert_eq!(iterations.parse::<Iterations>().expect(iterations).to_string(), iterations);
    }
    assert!("-1".parse::<Iterations>().is_err() && "999999999".parse::<Iterations>().is_err());
}

/// A scene that turns the end of a bar twice: a method that is told of the turns twists the bar twice, in one step or in several.
#[test]
fn full_turns_of_a_scene_reach_the_method() {
    let bar = shapes::bar(60, 2, 2, DVec3::new(9.0, 0.4, 0.4)).expect("valid size");
    let scene = r#"{ "name": "twist", "handles": [
        { "name": "held", "region": { "box": { "max": [0.06, null, null] } } },
        { "name": "turned", "region": { "box": { "min": [0.94, null, null] } },
          "motion": { "rotate": { "axis": [2, 0, 0], "degrees": 720 } } } ] }"#;
    let scene = Scene::parse(scene.as_bytes(), "a test").expect("valid");
    let study = Study::new("bar", &bar, &scene).expect("fits");
    let caged = study.cage("none".parse().expect("a size"), &Silent).expect("valid");
    for (method, turns) in [("arap:propagated", 2.0), ("laplacian:propagated", 2.0), ("laplacian", 0.0)] {
        let method: Method = method.parse().expect("a method");
        for steps in [1, 7] {
            let schedule = Schedule { steps, iterations: Iterations::Count(2), start: StartFrom::Levels };
            let pose = study.drag(&caged, &method, schedule, &Silent).expect("valid").pose;
            // The corner y, z > 0 of each section, followed along the bar.
            let mut corners: Vec<(f64, DVec3)> = bar
                .positions
                .iter()
                .zip(&pose)
                .filter(|(p, _)| p.y > 0.15 && p.z > 0.15)
                .map(|(p, q)| (p.x, *q))
                .collect();
            corners.sort_by(|a, b| a.0.total_cmp(&b.0));
            let angle = |pair: &[(f64, DVec3)]| {
                let (a, b) = (pair[0].1, pair[1].1);
                (a.y * b.z - a.z * b.y).atan2(a.y * b.y + a.z * b.z)
            };
            let found = corners.windows(2).map(angle).sum::<f64>() / std::f64::consts::TAU;
            assert!(corners.len() == 61 && (found - turns).abs() < 1e-6, "{method}, {steps} steps: {found} turns");
        }
    }
}
