//! What every method promises, on every shape, on the shape itself and through a cage.

use pliant::glam::DVec3;
use pliant::{
    ArapEnergy, ArapOptions, Binding, CageSize, DeformError, DualLaplacianOptions, EdgeWeightKind, Goals, Handle,
    Method, Propagation, Prune, Region, Silent, Similarity, TriMesh, VertexSet, creature, shapes, simplify,
};

fn methods() -> Vec<Method> {
    let mut methods = Vec::new();
    for weights in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
        for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
            methods.push(Method::Arap(ArapOptions { weights, energy, ..ArapOptions::default() }));
        }
    }
    methods.push(Method::DualLaplacian(DualLaplacianOptions::default()));
    methods
}

fn shapes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("bar", shapes::bar(24, 4, 4, DVec3::new(4.0, 0.7, 0.7)).expect("valid")),
        ("cylinder", shapes::cylinder(0.4, 3.0, 20, 40, 4).expect("valid")),
        ("bumpy plane", shapes::bumpy_plane(30, 20, 3.0, 2.0, 0.1, 3).expect("valid")),
        ("creature", creature(3000).expect("valid")),
    ]
}

/// Where a method runs: on the shape itself, or on a cage of a tenth with the result carried to the shape.
enum Stage {
    Shape,
    Cage(TriMesh, Box<Binding>),
}

impl Stage {
    fn cage(shape: &TriMesh) -> Self {
        let cage = simplify(shape, &CageSize::Fraction(0.1).into(), &Silent).expect("valid").mesh;
        let binding = Binding::new(shape, &cage, &Prune::default().into(), &Silent).expect("valid");
        Self::Cage(cage, Box::new(binding))
    }

    fn edit(&self, method: &Method, shape: &TriMesh, goals: &Goals) -> Vec<DVec3> {
        match self {
            Self::Shape => solve(method, shape, goals),
            Self::Cage(cage, binding) => binding.apply(&solve(method, cage, goals), Propagation::Frames),
        }
    }
}

/// Every method on every shape, directly and through its cage.
fn everywhere(check: impl Fn(&str, &Method, &TriMesh, &Stage)) {
    for (name, shape) in shapes() {
        for (place, stage) in [("direct", Stage::Shape), ("cage", Stage::cage(&shape))] {
            for method in methods() {
                check(&format!("{name}, {method}, {place}"), &method, &shape, &stage);
            }
        }
    }
}

/// The two ends along the longest axis as handles; everything else is free.
fn ends(mesh: &TriMesh) -> Region {
    let bounds = mesh.bounds();
    let axis = bounds.size().max_position();
    let along = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
    let n = mesh.vertex_count();
    let low = Handle::hard(VertexSet::where_true(n, |v| along(v) <= 0.15));
    let high = Handle::hard(VertexSet::where_true(n, |v| along(v) >= 0.85));
    Region::new(n, &VertexSet::all(n), &[low, high]).expect("both ends have vertices")
}

fn solve(method: &Method, mesh: &TriMesh, goals: &Goals) -> Vec<DVec3> {
    let mut pose = mesh.positions.clone();
    let mut deformer = method.prepare(mesh, &ends(mesh)).expect("valid");
    deformer.solve(goals, &mut pose).expect("valid");
    pose
}

/// One end held, the other turned by some 34 degrees.
fn bend(shape: &TriMesh) -> Goals {
    let turn = Similarity::about(shape.bounds().centre(), DVec3::new(0.3, 0.2, 1.0), 0.6, 1.0);
    Goals::new(vec![Similarity::IDENTITY, turn])
}

fn largest(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
}

#[test]
fn goals_at_rest_leave_the_shape_at_rest() {
    everywhere(|name, method, shape, stage| {
        let pose = stage.edit(method, shape, &Goals::identity(2));
        let error = largest(&pose, &shape.positions) / shape.bounds().diagonal();
        assert!(error < 1e-12, "{name}: {error:e}");
    });
}

#[test]
fn a_common_rigid_motion_of_all_handles_is_reproduced() {
    let motion = Similarity {
        translation: DVec3::new(3.0, -1.0, 0.5),
        ..Similarity::about(DVec3::new(0.2, 1.0, -2.0), DVec3::new(1.0, 0.5, -0.7), 2.3, 1.0)
    };
    everywhere(|name, method, shape, stage| {
        let pose = stage.edit(method, shape, &Goals::new(vec![motion; 2]));
        let expected: Vec<DVec3> = shape.positions.iter().map(|p| motion.apply(*p)).collect();
        // The first guess is the motion itself; what is left is rounding of rotations and factor.
        let error = largest(&pose, &expected) / shape.bounds().diagonal();
        assert!(error < 1e-9, "{name}: {error:e}");
    });
}

/// By a power of two, so that no rounding differs: the cage is the same and the result the same to its last bits.
#[test]
fn scaling_the_scene_scales_the_result() {
    everywhere(|name, method, shape, stage| {
        let plain = stage.edit(method, shape, &bend(shape));
        for scale in [1024.0, 1.0 / 1024.0] {
            let scaled = |points: &[DVec3]| -> Vec<DVec3> { points.iter().map(|p| *p * scale).collect() };
            let other = shape.with_positions(scaled(&shape.positions)).expect("finite");
            let other_stage = if matches!(stage, Stage::Shape) { Stage::Shape } else { Stage::cage(&other) };
            let pose = other_stage.edit(method, &other, &bend(&other));
            let error = largest(&pose, &scaled(&plain)) / other.bounds().diagonal();
            assert!(error < 1e-12, "{name}, scale {scale}: {error:e}");
        }
    });
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    everywhere(|name, method, shape, stage| {
        let poses: Vec<Vec<DVec3>> = [1, 2, 4]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| stage.edit(method, shape, &bend(shape)))
            })
            .into();
        assert!(poses[0] == poses[1] && poses[0] == poses[2], "{name}");
    });
}

/// Vertices outside the region of interest keep their bits.
#[test]
fn fixed_vertices_do_not_move() {
    for (name, shape) in shapes() {
        let bounds = shape.bounds();
        let axis = bounds.size().max_position();
        let along = |v: u32| bounds.to_box(shape.positions[v as usize])[axis];
        let n = shape.vertex_count();
        let roi = VertexSet::where_true(n, |v| along(v) > 0.4);
        let handle = Handle::hard(VertexSet::where_true(n, |v| along(v) >= 0.85));
        let region = Region::new(n, &roi, &[handle]).expect("valid");
        for method in methods() {
            let mut pose = shape.positions.clone();
            let mut deformer = method.prepare(&shape, &region).expect("valid");
            deformer.solve(&Goals::new(bend(&shape).transforms[1..].to_vec()), &mut pose).expect("valid");
            assert!((0..n).all(|v| roi.contains(v as u32) || pose[v] == shape.positions[v]), "{name}, {method}");
            assert!(largest(&pose, &shape.positions) > 0.01 * bounds.diagonal(), "{name}, {method}: nothing moved");
        }
    }
}

#[test]
fn with_nothing_held_the_error_says_so() {
    let n = shapes::icosphere(1).vertex_count();
    let refused = Region::new(n, &VertexSet::all(n), &[]).expect_err("nothing is held");
    assert_eq!(refused, DeformError::NoConstraint);
    assert!(refused.to_string().contains("nothing is held"), "{refused}");
}
