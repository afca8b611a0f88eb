//! What every method promises, on every shape, on the shape itself and through a cage.

use pliant::glam::DVec3;
use pliant::{
    Binding, CageSize, Constraint, DeformError, FrameFit, Goals, Handle, HandleFault, Method, Propagation, Propagator,
    Prune, Region, Role, Silent, Similarity, TriMesh, VertexSet, creature, shapes, simplify,
};

/// The largest family of motions that a method reproduces where they are common to all handles.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
enum Exact {
    Translations,
    RigidMotions,
    Similarities,
}

/// Every method, in its variants, with what its docs promise.
const METHODS: [(&str, Exact); 25] = [
    ("arap", Exact::RigidMotions),
    ("arap:spokes", Exact::RigidMotions),
    ("arap:uniform", Exact::RigidMotions),
    ("arap:uniform+spokes", Exact::RigidMotions),
    ("arap:propagated", Exact::RigidMotions),
    ("arap:smooth=0.01", Exact::RigidMotions),
    ("arap:spokes+smooth=0.01+anderson=5+iterations=6", Exact::RigidMotions),
    ("dual", Exact::RigidMotions),
    ("dual:recomputed-heights", Exact::RigidMotions),
    ("laplacian", Exact::Translations),
    ("laplacian:uniform", Exact::Translations),
    ("laplacian:two-step", Exact::RigidMotions),
    ("laplacian:uniform+two-step", Exact::RigidMotions),
    ("laplacian:similarity", Exact::Similarities),
    ("laplacian:propagated", Exact::Similarities),
    ("laplacian:uniform+propagated", Exact::Similarities),
    ("rotation-invariant", Exact::Similarities),
    ("rotation-invariant:uniform+tangent-from-normal+raw", Exact::Similarities),
    ("rotation-invariant:edges+coupling=2", Exact::Similarities),
    ("implicit", Exact::Similarities),
    ("implicit:uniform", Exact::Similarities),
    ("implicit:rings=1", Exact::Similarities),
    ("implicit:positions", Exact::Similarities),
    ("implicit:keep-features", Exact::RigidMotions),
    ("implicit:preview", Exact::Similarities),
];

fn methods() -> impl Iterator<Item = (Method, Exact)> {
    METHODS.into_iter().map(|(text, exact)| (text.parse().expect("a method"), exact))
}

fn shapes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("bar", shapes::bar(24, 4, 4, DVec3::new(4.0, 0.7, 0.7)).expect("valid")),
        ("cylinder", shapes::cylinder(0.4, 3.0, 20, 40, 4).expect("valid")),
        ("bumpy plane", shapes::bumpy_plane(30, 20, 3.0, 2.0, 0.1, 3).expect("valid")),
        ("creature", creature(2000).expect("valid")),
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

    /// The mesh that the method sees.
    fn mesh<'a>(&'a self, shape: &'a TriMesh) -> &'a TriMesh {
        match self {
            Self::Shape => shape,
            Self::Cage(cage, _) => cage,
        }
    }

    fn edit(&self, method: &Method, shape: &TriMesh, goals: &Goals) -> Vec<DVec3> {
        match self {
            Self::Shape => solve(method, shape, goals),
            Self::Cage(cage, binding) => {
                let mut pose = shape.positions.clone();
                let mut propagator = Propagator::new(Propagation::Frames).with_fit(FrameFit::Similarity);
                propagator.apply(binding, &solve(method, cage, goals), &mut pose);
                pose
            }
        }
    }
}

/// Every method on every shape, directly and through its cage.
fn everywhere(check: impl Fn(&str, &Method, Exact, &TriMesh, &Stage)) {
    for (name, shape) in shapes() {
        for (place, stage) in [("direct", Stage::Shape), ("cage", Stage::cage(&shape))] {
            for (method, exact) in methods() {
                check(&format!("{name}, {method}, {place}"), &method, exact, &shape, &stage);
            }
        }
    }
}

/// The vertices whose place along the longest axis of the bounding box, from 0 to 1, is in `range`.
fn along(mesh: &TriMesh, range: std::ops::RangeInclusive<f64>) -> VertexSet {
    let bounds = mesh.bounds();
    let axis = bounds.size().max_position();
    let at = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
    VertexSet::where_true(mesh.vertex_count(), |v| range.contains(&at(v)))
}

/// The two ends along the longest axis as handles; everything else is free.
fn ends(mesh: &TriMesh) -> Region {
    let n = mesh.vertex_count();
    let handles = [0.0..=0.15, 0.85..=1.0].map(|range| Handle::hard(along(mesh, range)));
    Region::new(n, &VertexSet::all(n), &handles).expect("both ends have vertices")
}

/// The upper part, with a hard handle at its end and a soft one in its middle; the lower part is fixed.
fn upper_part(mesh: &TriMesh) -> Region {
    let handles = [Handle::hard(along(mesh, 0.85..=1.0)), Handle::soft(along(mesh, 0.55..=0.65), 0.5)];
    Region::new(mesh.vertex_count(), &along(mesh, 0.4..=1.0), &handles).expect("both have vertices")
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
    everywhere(|name, method, _, shape, stage| {
        let pose = stage.edit(method, shape, &Goals::identity(2));
        let error = largest(&pose, &shape.positions) / shape.bounds().diagonal();
        assert!(error < 1e-9, "{name}: {error:e}");
    });
}

/// What a method does not promise is far from what it gives, so that the promises above are the largest there are.
#[test]
fn a_common_motion_of_all_handles_is_reproduced_as_promised() {
    let lift = DVec3::new(3.0, -1.0, 0.5);
    let about = |angle, scale| {
        let turned = Similarity::about(DVec3::new(0.2, 1.0, -2.0), DVec3::new(1.0, 0.5, -0.7), angle, scale);
        Similarity { translation: turned.translation + lift, ..turned }
    };
    everywhere(|name, method, exact, shape, stage| {
        for (family, motion) in [
            (Exact::Translations, about(0.0, 1.0)),
            (Exact::RigidMotions, about(2.3, 1.0)),
            (Exact::Similarities, about(-1.1, 1.7)),
        ] {
            let pose = stage.edit(method, shape, &Goals::new(vec![motion; 2]));
            let expected: Vec<DVec3> = shape.positions.iter().map(|p| motion.apply(*p)).collect();
            let error = largest(&pose, &expected) / shape.bounds().diagonal();
            // The rounding of rotations and of the factor is left, times the condition number of the matrix.
            if exact >= family {
                assert!(error < 1e-9, "{name}, {family:?}: {error:e}");
            } else {
                assert!(error > 1e-3, "{name} reproduces {family:?} too: {error:e}");
            }
        }
    });
}

/// By a power of two, so that no rounding differs: the cage is the same and the result the same to its last bits.
#[test]
fn scaling_the_scene_scales_the_result() {
    everywhere(|name, method, _, shape, stage| {
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

/// By scales that round, and moved away: the rest shape is then another one by rounding, which the condition number of the
/// normal equations magnifies.
#[test]
fn any_scale_and_offset_of_the_scene_is_followed() {
    everywhere(|name, method, _, shape, stage| {
        let mesh = stage.mesh(shape);
        // Taken once: vertices on the rim of an end may round to either side.
        let region = ends(mesh);
        let solve = |mesh: &TriMesh| {
            let mut pose = mesh.positions.clone();
            method.prepare(mesh, &region).expect("valid").solve(&bend(mesh), &mut pose).expect("valid");
            pose
        };
        let plain = solve(mesh);
        for scale in [1e3, 1e-3] {
            let offset = scale * DVec3::new(5.0, -7.0, 3.0);
            let moved = |points: &[DVec3]| -> Vec<DVec3> { points.iter().map(|p| *p * scale + offset).collect() };
            let other = mesh.with_positions(moved(&mesh.positions)).expect("finite");
            let error = largest(&solve(&other), &moved(&plain)) / other.bounds().diagonal();
            assert!(error < 1e-11, "{name}, scale {scale}: {error:e}");
        }
    });
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    everywhere(|name, method, _, shape, stage| {
        let poses: Vec<Vec<DVec3>> = [1, 2, 4]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| stage.edit(method, shape, &bend(shape)))
            })
            .into();
        assert!(poses[0] == poses[1] && poses[0] == poses[2], "{name}");
    });
}

/// Vertices outside the region of interest keep their bits, wherever the pose has them, and those of hard handles are where
/// their goal takes their rest position, to the bit.
#[test]
fn fixed_vertices_do_not_move_and_hard_handles_land_exactly() {
    everywhere(|name, method, _, shape, stage| {
        let mesh = stage.mesh(shape);
        let region = upper_part(mesh);
        let turn = bend(mesh).transforms[1];
        let mut start = mesh.positions.clone();
        for (v, p) in start.iter_mut().enumerate() {
            *p += 0.01 * DVec3::new((3.0 * v as f64).sin(), 0.0, (5.0 * v as f64).cos());
        }
        let mut pose = start.clone();
        let mut deformer = method.prepare(mesh, &region).expect("valid");
        deformer.solve(&Goals::new(vec![turn; 2]), &mut pose).expect("valid");
        for (v, role) in region.roles().iter().enumerate() {
            match *role {
                Role::Fixed => assert_eq!(pose[v], start[v], "{name}, vertex {v}"),
                Role::Handle(h) if region.handles()[h as usize].constraint == Constraint::Hard => {
                    assert_eq!(pose[v], turn.apply(mesh.positions[v]), "{name}, vertex {v}");
                }
                Role::Free | Role::Handle(_) => assert!(pose[v].is_finite()),
            }
        }
        assert!(largest(&pose, &start) > 0.01 * mesh.bounds().diagonal(), "{name}: nothing moved");
    });
}

/// A deformer given another region solves for it as a new one would.
#[test]
fn another_region_is_as_good_as_a_fresh_deformer() {
    for (name, mesh) in shapes() {
        let regions = [upper_part(&mesh), ends(&mesh)];
        for (method, _) in methods() {
            let mut kept = method.prepare(&mesh, &regions[1]).expect("valid");
            for region in &regions {
                let goals = Goals::new(vec![Similarity::IDENTITY, bend(&mesh).transforms[1]]);
                let mut fresh = method.prepare(&mesh, region).expect("valid");
                assert_eq!(kept.set_region(region), Ok(fresh.prepared()), "{name}, {method}");
                let poses = [&mut kept, &mut fresh].map(|deformer| {
                    let mut pose = mesh.positions.clone();
                    deformer.solve(&goals, &mut pose).expect("valid");
                    pose
                });
                assert!(poses[0] == poses[1], "{name}, {method}");
            }
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

/// Two spheres and a vertex without faces, and handles on the first sphere alone.
#[test]
fn a_part_that_nothing_holds_is_refused_by_name() {
    let sphere = shapes::icosphere(2);
    let n = sphere.vertex_count();
    let mut positions = sphere.positions.clone();
    positions.extend(sphere.positions.iter().map(|p| *p + 5.0 * DVec3::Z));
    positions.push(DVec3::splat(9.0));
    let mut triangles = sphere.triangles().to_vec();
    triangles.extend(sphere.triangles().iter().map(|t| t.map(|v| v + n as u32)));
    let mesh = TriMesh::new(positions, triangles).expect("valid");
    let handle = Handle::hard(along(&sphere, 0.0..=0.2));
    let all = VertexSet::all(mesh.vertex_count());
    let region = Region::new(mesh.vertex_count(), &all, &[handle]).expect("something is held");
    let refused = DeformError::Unconstrained { vertex: n as u32, count: n + 1 };
    let (held, left_out) = region.without_unconstrained(mesh.topology());
    assert_eq!(left_out, n + 1);
    for (method, _) in methods() {
        assert_eq!(method.prepare(&mesh, &region).err(), Some(refused.clone()), "{method}");
        let mut deformer = method.prepare(&mesh, &held).expect("valid");
        assert_eq!(deformer.set_region(&region), Err(refused.clone()), "{method}");
        let mut pose = mesh.positions.clone();
        let lift = Similarity::translation(DVec3::X);
        deformer.solve(&Goals::new(vec![lift]), &mut pose).expect("still prepared for the region it had");
        assert!(pose[..n].iter().zip(&sphere.positions).all(|(p, q)| p.distance(*q + DVec3::X) < 1e-9), "{method}");
        assert_eq!(pose[n..], mesh.positions[n..], "{method}");
    }
}

#[test]
fn a_goal_or_pose_that_cannot_be_used_leaves_the_pose_alone() {
    let (_, mesh) = shapes().swap_remove(2);
    for (method, _) in methods() {
        let mut deformer = method.prepare(&mesh, &ends(&mesh)).expect("valid");
        let goals = |last| Goals::new(vec![Similarity::IDENTITY, last]);
        for bad in [f64::NAN, f64::INFINITY, 1e308] {
            let mut pose = mesh.positions.clone();
            let error = deformer.solve(&goals(Similarity::translation(DVec3::splat(bad))), &mut pose);
            let refused = match error {
                Err(DeformError::Handle { handle: 1, fault }) => fault,
                other => panic!("{method}: {other:?}"),
            };
            assert!(matches!(refused, HandleFault::Goal { .. } | HandleFault::TooFar { .. }), "{method}");
            assert_eq!(pose, mesh.positions);
        }
        let turn = bend(&mesh).transforms[1];
        let wrong = Goals::with_turns(vec![Similarity::IDENTITY, turn], vec![DVec3::ZERO, DVec3::X]);
        assert!(deformer.solve(&wrong, &mut mesh.positions.clone()).is_err(), "{method}");
        let mut pose = mesh.positions.clone();
        pose[7].y = f64::NAN;
        assert!(deformer.solve(&goals(turn), &mut pose).is_err(), "{method}");
        assert!(deformer.solve(&goals(turn), &mut mesh.positions.clone()).is_ok(), "{method}");
    }
}
