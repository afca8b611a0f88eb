//! What rotation-invariant coordinates must keep: similarities, the representation itself, fixed vertices, goals, bits.

mod common;

use std::f64::consts::{FRAC_PI_2, FRAC_PI_6, PI};

use common::{along_x, bar, distance, pyramid, sheet, torus};
use glam::{DMat3, DVec3};
use pliant_deform::rotation_invariant::{MAX_COUPLING, Reconstruction, RotationInvariant, Tangent};
use pliant_deform::{
    DeformError, Deformer, EdgeWeightKind, Goals, Handle, Method, Region, Role, RotationInvariantOptions,
};
use pliant_mesh::{Similarity, TriMesh, VertexSet, shapes};

fn all_shapes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("pyramid", pyramid()),
        ("sheet", sheet(16, 8)),
        ("torus", torus(24, 10)),
        ("bar", bar(4)),
        ("creature", shapes::creature(2000).expect("in range")),
    ]
}

/// Each option in both settings, not all with all; the default and the paper's among them.
fn variants() -> Vec<RotationInvariantOptions> {
    let (cotangent, uniform) = (EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform);
    let (laplacian, edges) = (Reconstruction::Laplacian, Reconstruction::Edges);
    [
        (cotangent, laplacian, Tangent::Edge, true, 0),
        (uniform, laplacian, Tangent::Normal, false, 0),
        (cotangent, laplacian, Tangent::Normal, true, 2),
        (uniform, edges, Tangent::Edge, true, 0),
        (cotangent, edges, Tangent::Edge, false, 2),
    ]
    .map(|(weights, reconstruction, tangent, orthonormal, coupling)| RotationInvariantOptions {
        weights,
        reconstruction,
        tangent,
        orthonormal,
        coupling,
    })
    .into()
}

fn ends(mesh: &TriMesh, hold: impl Fn(VertexSet) -> Handle) -> Region {
    let handles = [0.0..=0.12, 0.88..=1.0].map(|range| hold(along_x(mesh, range)));
    region(mesh, &handles)
}

/// Everything free but the handles.
fn region(mesh: &TriMesh, handles: &[Handle]) -> Region {
    Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), handles).expect("valid")
}

fn solve(options: &RotationInvariantOptions, mesh: &TriMesh, region: &Region, goals: &Goals) -> Vec<DVec3> {
    let mut pose = mesh.positions.clone();
    prepare(options, mesh, region).solve(goals, &mut pose).expect("solvable");
    pose
}

fn prepare(options: &RotationInvariantOptions, mesh: &TriMesh, region: &Region) -> RotationInvariant {
    RotationInvariant::prepare(options, mesh, region).expect("valid")
}

fn moved(mesh: &TriMesh, by: &Similarity) -> Vec<DVec3> {
    mesh.positions.iter().map(|p| by.apply(*p)).collect()
}

fn some_similarity(angle: f64, scale: f64) -> Similarity {
    let mut map = Similarity::about(DVec3::new(1.0, -2.0, 0.5), DVec3::new(1.0, 2.0, -1.0), angle, scale);
    map.translation += DVec3::new(5.0, 1.0, -3.0);
    map
}

fn point(v: u32) -> VertexSet {
    VertexSet::from_iter([v])
}

/// The second end turned and lifted.
fn bend(mesh: &TriMesh, angle: f64) -> Goals {
    let pivot = mesh.bounds().from_box(DVec3::new(0.95, 0.5, 0.5));
    let mut turn = Similarity::about(pivot, DVec3::new(0.3, 1.0, 0.5), angle, 1.0);
    turn.translation += DVec3::new(-0.1, 0.05, 0.2) * angle;
    Goals::new(vec![Similarity::IDENTITY, turn])
}

/// The theorem behind the coordinates: they and one frame and one position determine the shape, wherever and however big it is. Closed,
/// open, with limbs; at every vertex the same, so one in the middle of the numbers.
#[test]
fn one_frame_and_one_position_are_enough() {
    for (name, mesh) in all_shapes() {
        let one = (mesh.vertex_count() / 2) as u32;
        for handle in [Handle::hard(point(one)), Handle::soft(point(one), 1.0)] {
            let region = region(&mesh, &[handle]);
            for options in variants() {
                for (angle, scale) in [(0.0, 1.0), (2.5, 1.0), (PI, 2.0), (-1.0, 0.5)] {
                    let map = some_similarity(angle, scale);
                    let pose = solve(&options, &mesh, &region, &Goals::new(vec![map]));
                    let off = distance(&pose, &moved(&mesh, &map)) / (scale * mesh.bounds().diagonal());
                    // Rounding, times the condition of a Laplacian held at one vertex: about the square of the number of
                    // vertices along the shape.
                    assert!(off < 1e-9, "{name}, {options}, angle {angle}, scale {scale}: {off:e}");
                }
            }
        }
    }
}

#[test]
fn a_common_similarity_of_all_handles_is_reproduced() {
    for (name, mesh) in all_shapes() {
        for hold in [Handle::hard as fn(VertexSet) -> Handle, |set| Handle::soft(set, 0.3)] {
            let region = ends(&mesh, hold);
            for options in variants() {
                let mut deformer = prepare(&options, &mesh, &region);
                for (angle, scale) in [(0.1, 1.0), (3.0, 1.0), (PI, 1.0), (1.5, 2.0), (-2.9, 0.5)] {
                    let map = some_similarity(angle, scale);
                    let mut pose = mesh.positions.clone();
                    deformer.solve(&Goals::new(vec![map; 2]), &mut pose).expect("solvable");
                    let off = distance(&pose, &moved(&mesh, &map)) / (scale * mesh.bounds().diagonal());
                    assert!(off < 1e-10, "{name}, {options}, angle {angle}, scale {scale}: {off:e}");
                }
            }
        }
    }
}

#[test]
fn goals_at_rest_keep_rest() {
    for (name, mesh) in all_shapes() {
        for region in [ends(&mesh, Handle::hard), ends(&mesh, |set| Handle::soft(set, 2.0)), band(&mesh).0] {
            for options in variants() {
                let pose = solve(&options, &mesh, &region, &region.identity_goals());
                let off = distance(&pose, &mesh.positions) / mesh.bounds().diagonal();
                assert!(off < 1e-12, "{name}, {options}: {off:e}");
            }
        }
    }
}

/// A part in the middle with one handle in it, and the goals that turn and swell it; the rest of the shape is fixed.
fn band(mesh: &TriMesh) -> (Region, Goals) {
    let handle = Handle::hard(along_x(mesh, 0.55..=0.7));
    let handles = if handle.vertices.is_empty() { vec![] } else { vec![handle] };
    let region = Region::new(mesh.vertex_count(), &along_x(mesh, 0.2..=0.9), &handles).expect("valid");
    let turn = Similarity::about(mesh.bounds().centre(), DVec3::Y, 0.4, 1.2);
    let goals = Goals::new(vec![turn; region.handles().len()]);
    (region, goals)
}

#[test]
fn fixed_vertices_keep_their_bits_and_hard_handles_land_exactly() {
    for (name, mesh) in all_shapes() {
        let (region, goals) = band(&mesh);
        for options in variants() {
            let pose = solve(&options, &mesh, &region, &goals);
            let mut bent = 0.0f64;
            for (v, role) in region.roles().iter().enumerate() {
                match role {
                    Role::Fixed => assert_eq!(pose[v], mesh.positions[v], "{name}"),
                    Role::Handle(h) => assert_eq!(pose[v], goals.transforms[*h as usize].apply(mesh.positions[v])),
                    Role::Free => bent = bent.max(pose[v].distance(mesh.positions[v])),
                }
            }
            assert!(goals.transforms.is_empty() || bent > 1e-3, "{name}, {options}: {bent}");
        }
    }
}

/// The fixed part stands turned and grown, as an earlier edit of the whole left it: its frames are read from the pose, so a
/// region whose handle follows comes along exactly, and one without a handle too.
#[test]
fn frames_of_the_fixed_part_are_read_from_the_pose() {
    for (name, mesh) in all_shapes() {
        let (with_handle, _) = band(&mesh);
        let without = Region::new(mesh.vertex_count(), &along_x(&mesh, 0.3..=0.7), &[]);
        // A pyramid has no vertex there, or nothing else.
        for region in [Ok(with_handle), without].into_iter().flatten() {
            for options in variants() {
                let map = some_similarity(2.0, 1.7);
                let mut pose = moved(&mesh, &map);
                // What the region's own vertices did before does not matter.
                for (v, p) in pose.iter_mut().enumerate() {
                    if region.roles()[v] != Role::Fixed {
                        *p += DVec3::new((v as f64).sin(), (1.3 * v as f64).cos(), 0.3);
                    }
                }
                let goals = Goals::new(vec![map; region.handles().len()]);
                prepare(&options, &mesh, &region).solve(&goals, &mut pose).expect("solvable");
                let off = distance(&pose, &moved(&mesh, &map)) / mesh.bounds().diagonal();
                assert!(off < 1e-10, "{name}, {options}: {off:e}");
            }
        }
    }
}

/// Fixed vertices without a fixed face between them act as anchors.
#[test]
fn lone_fixed_vertices_are_anchors() {
    let mesh = shapes::plane_grid(10, 6, 2.0, 1.2).expect("valid");
    let n = mesh.vertex_count() as u32;
    let corners = [0, 10, n - 11, n - 1];
    let lone = |v: u32| corners.contains(&v);
    let tip = Handle::hard(point(n / 2));
    let fixed = Region::new(n as usize, &VertexSet::where_true(n as usize, |v| !lone(v)), std::slice::from_ref(&tip));
    let anchored = region(&mesh, &[tip, Handle::hard(VertexSet::from_iter(corners))]);
    let lift = Similarity::about(mesh.bounds().centre(), DVec3::X, 0.5, 1.0);
    let options = RotationInvariantOptions::default();
    let one = solve(&options, &mesh, &fixed.expect("valid"), &Goals::new(vec![lift]));
    let other = solve(&options, &mesh, &anchored, &Goals::new(vec![lift, Similarity::IDENTITY]));
    assert!(distance(&one, &other) < 1e-12);
}

/// Frames differ, coordinates follow.
#[test]
fn both_tangents_give_the_same_solution() {
    for (name, mesh) in all_shapes() {
        let region = ends(&mesh, Handle::hard);
        for options in variants() {
            let tangent = if options.tangent == Tangent::Edge { Tangent::Normal } else { Tangent::Edge };
            let other = RotationInvariantOptions { tangent, ..options.clone() };
            let goals = bend(&mesh, 1.3);
            let (a, b) = (solve(&options, &mesh, &region, &goals), solve(&other, &mesh, &region, &goals));
            let off = distance(&a, &b) / mesh.bounds().diagonal();
            assert!(off < 1e-10, "{name}, {options}: {off:e}");
        }
    }
}

/// Scene and goals turned, moved and scaled: the result is turned, moved and scaled. Of the representation itself only the
/// frame equations' right-hand side knows where the shape stands.
#[test]
fn results_follow_the_scene() {
    for (name, mesh) in all_shapes() {
        for options in variants() {
            let plain = solve(&options, &mesh, &ends(&mesh, Handle::hard), &bend(&mesh, 1.0));
            for (angle, scale) in [(0.0, 1e-3), (0.0, 1e3), (1.1, 1.0), (-2.3, 20.0)] {
                let map = some_similarity(angle, scale);
                let scene = mesh.with_positions(moved(&mesh, &map)).expect("finite");
                let inverse = map.rotation.conjugate();
                // map after goal after the inverse of map.
                let goals = bend(&mesh, 1.0).transforms.into_iter().map(|goal| {
                    let rotation = map.rotation * goal.rotation * inverse;
                    let anchor = DVec3::new(0.1, 0.2, 0.3);
                    let translation = map.apply(goal.apply(anchor)) - rotation * map.apply(anchor);
                    Similarity { rotation, scale: 1.0, translation }
                });
                let region = ends(&mesh, Handle::hard);
                let result = solve(&options, &scene, &region, &Goals::new(goals.collect()));
                let expected: Vec<DVec3> = plain.iter().map(|p| map.apply(*p)).collect();
                let off = distance(&result, &expected) / scene.bounds().diagonal();
                assert!(off < 1e-9, "{name}, {options}, {angle}, {scale}: {off:e}");
            }
        }
    }
}

/// A cylinder of rings: turning its top about its axis turns the ring at height t by t times the angle, to the left for more than half
/// a turn, as matrices do not count turns.
#[test]
fn twists_are_spread_and_wrap_at_half_a_turn() {
    let mesh = shapes::cylinder(0.3, 3.0, 16, 30, 2).expect("valid");
    let up = |range: std::ops::RangeInclusive<f64>| {
        let bounds = mesh.bounds();
        let axis = bounds.size().max_position();
        VertexSet::where_true(mesh.vertex_count(), |v| range.contains(&bounds.to_box(mesh.positions[v as usize])[axis]))
    };
    let axis = [DVec3::X, DVec3::Y, DVec3::Z][mesh.bounds().size().max_position()];
    let region = region(&mesh, &[Handle::hard(up(0.0..=0.1)), Handle::hard(up(0.9..=1.0))]);
    let middle: Vec<u32> = up(0.48..=0.52).iter().collect();
    let wall = |v: &u32| mesh.positions[*v as usize].reject_from_normalized(axis).length() > 0.2;
    let middle: Vec<usize> = middle.iter().filter(|v| wall(v)).map(|v| *v as usize).collect();
    assert_eq!(middle.len(), 16);
    for (angle, half) in [(1.0, 0.5), (-2.0, -1.0), (2.0 * PI - 1.0, -0.5)] {
        let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::ZERO, axis, angle, 1.0)]);
        let pose = solve(&RotationInvariantOptions::default(), &mesh, &region, &goals);
        let expected = Similarity::about(DVec3::ZERO, axis, half, 1.0);
        for &v in &middle {
            // By symmetry, but for the way the squares are cut.
            let flat = |p: DVec3| p.reject_from_normalized(axis);
            let off = flat(pose[v]).angle_between(flat(expected.apply(mesh.positions[v])));
            assert!(off < 0.03, "angle {angle}, vertex {v}: {off}");
        }
    }
    let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::ZERO, axis, PI, 1.0)]);
    assert!(solve(&RotationInvariantOptions::default(), &mesh, &region, &goals).iter().all(|p| p.is_finite()));
}

/// Yuan, Fig. 5-8: a cuboid held at 4 points of one end, 4 soft points of the other turned by 30 and by 90 degrees, moved by 0.3 and
/// scaled by 2 and a half; and the same on a bumpy sphere. The goals are met as far as soft ones can be, and the size of each edge stays
/// near to what it was or should be.
#[test]
fn the_papers_edits_with_four_hard_and_four_soft_points() {
    let mut bumpy = shapes::icosphere(3);
    for p in &mut bumpy.positions {
        *p *= 1.0 + 0.05 * (9.0 * p.x).sin() * (8.0 * p.y).cos() * (7.0 * p.z).sin();
    }
    let cuboid = bar(6);
    for (name, mesh) in [("sphere", bumpy), ("cuboid", cuboid)] {
        let bounds = mesh.bounds();
        let nearest = |x: f64, y: f64, z: f64| {
            let corner = bounds.from_box(DVec3::new(x, y, z));
            let near = |v: &u32| mesh.positions[*v as usize].distance(corner);
            (0..mesh.vertex_count() as u32).min_by(|a, b| near(a).total_cmp(&near(b))).expect("there are vertices")
        };
        let four = |x: f64| {
            VertexSet::from_iter([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)].map(|(y, z)| nearest(x, y, z)))
        };
        let soft = four(1.0);
        let region = region(&mesh, &[Handle::hard(four(0.0)), Handle::soft(soft.clone(), 10.0)]);
        let centre = bounds.from_box(DVec3::new(1.0, 0.5, 0.5));
        let turn = |axis, angle| Similarity::about(centre, axis, angle, 1.0);
        let mut edits: Vec<Similarity> = [FRAC_PI_6, -FRAC_PI_6]
            .into_iter()
            .flat_map(|angle| [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| turn(axis, angle)))
            .chain([turn(DVec3::X, FRAC_PI_2), turn(DVec3::X, -FRAC_PI_2)])
            .collect();
        edits.extend(
            [DVec3::X, DVec3::Y, DVec3::Z]
                .into_iter()
                .flat_map(|axis| [0.3, -0.3].map(|by| Similarity::translation(by * axis * bounds.size().y))),
        );
        edits.extend([2.0, 0.5].map(|scale| Similarity::about(centre, DVec3::X, 0.0, scale)));
        for goal in edits {
            let goals = Goals::new(vec![Similarity::IDENTITY, goal]);
            let pose = solve(&RotationInvariantOptions::default(), &mesh, &region, &goals);
            for v in soft.iter() {
                let v = v as usize;
                let off = pose[v].distance(goal.apply(mesh.positions[v])) / bounds.diagonal();
                assert!(off < 0.08, "{name}, {goal:?}: {off}");
            }
            // Between the sizes at both ends, with what a bend needs.
            let (small, big) = (goal.scale.min(1.0), goal.scale.max(1.0));
            for &[a, b] in mesh.topology().edges() {
                let (a, b) = (a as usize, b as usize);
                let ratio = pose[a].distance(pose[b]) / mesh.positions[a].distance(mesh.positions[b]);
                assert!(ratio > 0.3 * small && ratio < 2.2 * big, "{name}, {goal:?}: {ratio}");
            }
        }
    }
}

/// Eq. 20 with a scale: one end keeps its size, the other gets twice or half of it; where the scale's logarithm is half way,
/// cross-sections are of the mean factor.
#[test]
fn scales_are_spread_by_factors() {
    let mesh = shapes::cylinder(0.3, 3.0, 16, 30, 2).expect("valid");
    let bounds = mesh.bounds();
    let along = bounds.size().max_position();
    let axis = [DVec3::X, DVec3::Y, DVec3::Z][along];
    let at = |v: u32| bounds.to_box(mesh.positions[v as usize])[along];
    let set = |low: f64, high: f64| VertexSet::where_true(mesh.vertex_count(), |v| (low..=high).contains(&at(v)));
    for scale in [2.0, 0.5] {
        // The far end goes where a rod whose size grows by equal factors ends: the integral of scale^t.
        let top = set(0.9, 1.0);
        let foot = bounds.from_box(DVec3::splat(0.5)) + axis * bounds.size()[along] * 0.4;
        let mut goal = Similarity::about(foot, axis, 0.0, scale);
        let length = 0.8 * bounds.size()[along];
        goal.translation += axis * length * ((scale - 1.0) / scale.ln() - 1.0);
        let region = region(&mesh, &[Handle::hard(set(0.0, 0.1)), Handle::hard(top)]);
        let goals = Goals::new(vec![Similarity::IDENTITY, goal]);
        let pose = solve(&RotationInvariantOptions::default(), &mesh, &region, &goals);
        for v in set(0.48, 0.52).iter() {
            let v = v as usize;
            let radius = |p: DVec3| p.reject_from_normalized(axis).length();
            let ratio = radius(pose[v]) / radius(mesh.positions[v]) / scale.sqrt();
            assert!((ratio - 1.0).abs() < 0.05, "scale {scale}, vertex {v}: {ratio}");
        }
    }
}

/// One end twisted by 2 radians: as solved for, frames half way are shorter by `cos 1 = 0.54`, and with them the details; made orthonormal
/// they are not.
#[test]
fn orthonormal_frames_keep_the_thickness() {
    let mesh = shapes::cylinder(0.3, 4.0, 16, 40, 2).expect("valid");
    let bounds = mesh.bounds();
    let along = bounds.size().max_position();
    let axis = [DVec3::X, DVec3::Y, DVec3::Z][along];
    let at = |v: u32| bounds.to_box(mesh.positions[v as usize])[along];
    let set = |low: f64, high: f64| VertexSet::where_true(mesh.vertex_count(), |v| (low..=high).contains(&at(v)));
    let region = region(&mesh, &[Handle::hard(set(0.0, 0.1)), Handle::hard(set(0.9, 1.0))]);
    let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::ZERO, axis, 2.0, 1.0)]);
    let radius = |orthonormal: bool| {
        let options = RotationInvariantOptions { orthonormal, ..RotationInvariantOptions::default() };
        let pose = solve(&options, &mesh, &region, &goals);
        let middle = set(0.49, 0.51);
        middle.iter().map(|v| pose[v as usize].reject_from_normalized(axis).length()).sum::<f64>() / middle.len() as f64
    };
    // A twisted wall is curved along the axis too, by the square of its slope, here `(0.3 * 2 / 3.2)^2 = 0.035`; the
    // coordinates say nothing of that, so that the wall moves in by some of it.
    assert!((radius(true) / 0.3 - 1.0).abs() < 0.08, "{}", radius(true));
    assert!(radius(false) / 0.3 < 0.7, "{}", radius(false));
}

/// A lift without a turn asks for turned frames in between; coupling finds them, and the surface is stretched less.
#[test]
fn coupling_turns_frames_to_where_positions_went() {
    let mesh = shapes::bar(30, 4, 4, DVec3::new(6.0, 0.8, 0.8)).expect("valid");
    let region = ends(&mesh, Handle::hard);
    let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::new(-1.0, 3.0, 0.0))]);
    let strain = |coupling: u32| {
        let options = RotationInvariantOptions { coupling, ..RotationInvariantOptions::default() };
        let pose = solve(&options, &mesh, &region, &goals);
        let squares = mesh.topology().edges().iter().map(|&[a, b]| {
            let (a, b) = (a as usize, b as usize);
            (pose[a].distance(pose[b]) / mesh.positions[a].distance(mesh.positions[b]) - 1.0).powi(2)
        });
        (squares.sum::<f64>() / mesh.topology().edges().len() as f64).sqrt()
    };
    let strains: Vec<f64> = [0, 2, 10, 50].map(strain).into();
    // The two alternate; they share no energy that would have to fall with each step.
    assert!(strains[1..].iter().all(|coupled| *coupled < 0.8 * strains[0]), "{strains:?}");
    assert!((strains[3] / strains[2] - 1.0).abs() < 1e-3, "not settled: {strains:?}");
}

/// The order in which regions come does not matter, nor does the pose.
#[test]
fn set_region_is_as_fresh() {
    for (name, mesh) in all_shapes() {
        let regions = [ends(&mesh, Handle::hard), ends(&mesh, |set| Handle::soft(set, 0.5)), band(&mesh).0];
        let options = RotationInvariantOptions { coupling: 1, ..RotationInvariantOptions::default() };
        let mut deformer = prepare(&options, &mesh, &regions[2]);
        for region in &regions {
            assert_eq!(deformer.set_region(region), Ok(prepare(&options, &mesh, region).prepared()));
            let goals = Goals::new((0..region.handles().len()).map(|k| some_similarity(0.2 * k as f64, 1.0)).collect());
            let mut pose: Vec<DVec3> = mesh.positions.clone();
            for (v, p) in pose.iter_mut().enumerate() {
                if region.roles()[v] != Role::Fixed {
                    *p *= 3.0;
                }
            }
            deformer.solve(&goals, &mut pose).expect("solvable");
            assert!(pose == solve(&options, &mesh, region, &goals), "{name}");
        }
        let other = Region::new(3, &VertexSet::all(3), &[Handle::hard(point(0))]).expect("valid");
        assert!(deformer.set_region(&other).is_err());
        let mut pose = mesh.positions.clone();
        deformer.solve(&regions[2].identity_goals(), &mut pose).expect("still the last region");
    }
}

/// Bars so thin that angles are a hundredth of a degree and less, and coinciding points.
#[test]
fn needles_come_out_finite() {
    for thin in [1e-2, 1e-4, 1e-7, 1e-10, 0.0] {
        let mut mesh = sheet(16, 8);
        for (v, p) in mesh.positions.iter_mut().enumerate() {
            // Every third column closes up on the one before.
            if v % 17 % 3 == 1 {
                p.x -= (2.0 / 16.0) * (1.0 - thin);
            }
        }
        let flat = mesh.with_positions(mesh.positions.iter().map(|p| *p * DVec3::new(1.0, thin, 1.0)).collect());
        for mesh in [mesh, flat.expect("finite")] {
            let region = ends(&mesh, Handle::hard);
            for options in variants() {
                for goals in [region.identity_goals(), bend(&mesh, 2.0)] {
                    let pose = solve(&options, &mesh, &region, &goals);
                    let farthest = pose.iter().map(|p| p.length()).fold(0.0, f64::max);
                    assert!(farthest < 100.0, "{thin}, {options}: {farthest}");
                }
            }
        }
    }
}

#[test]
fn faults_are_refused_and_leave_the_pose() {
    let mesh = torus(24, 10);
    let n = mesh.vertex_count();
    // Two components, one of them without a constraint.
    let twice: Vec<DVec3> = mesh.positions.iter().copied().chain(mesh.positions.iter().map(|p| *p + 9.0)).collect();
    let triangles = mesh.triangles().iter().copied();
    let second = triangles.clone().map(|t| t.map(|v| v + n as u32));
    let two = TriMesh::new(twice, triangles.chain(second).collect()).expect("valid");
    let region = Region::new(2 * n, &VertexSet::all(2 * n), &[Handle::hard(point(0))]).expect("valid");
    let error = RotationInvariant::prepare(&RotationInvariantOptions::default(), &two, &region).err();
    assert_eq!(error, Some(DeformError::Unconstrained { vertex: n as u32, count: n }));
    let options = RotationInvariantOptions { coupling: MAX_COUPLING + 1, ..RotationInvariantOptions::default() };
    assert!(matches!(
        Method::RotationInvariant(options).prepare(&mesh, &ends(&mesh, Handle::hard)),
        Err(DeformError::BadOption { .. })
    ));
    let mut deformer = prepare(&RotationInvariantOptions::default(), &mesh, &ends(&mesh, Handle::hard));
    let mut pose = mesh.positions.clone();
    let far = Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::splat(1e200))]);
    assert!(deformer.solve(&far, &mut pose).is_err());
    assert!(deformer.solve(&Goals::identity(1), &mut pose).is_err());
    // As far and as big as can be computed with is solved or refused, but never written in parts.
    for goal in [Similarity::translation(DVec3::splat(1e99)), Similarity::about(DVec3::ZERO, DVec3::X, 1.0, 1e90)] {
        let before = pose.clone();
        match deformer.solve(&Goals::new(vec![Similarity::IDENTITY, goal]), &mut pose) {
            Ok(_) => assert!(pose.iter().all(|p| p.is_finite())),
            Err(_) => assert_eq!(pose, before),
        }
    }
}

/// All handles, one handle vertex and no unknown at all.
#[test]
fn nothing_to_solve_for_is_solved() {
    let mesh = pyramid();
    let region = region(&mesh, &[Handle::hard(VertexSet::all(5))]);
    let map = some_similarity(1.0, 2.0);
    let pose = solve(&RotationInvariantOptions::default(), &mesh, &region, &Goals::new(vec![map]));
    assert_eq!(pose, moved(&mesh, &map));
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let mesh = shapes::creature(3000).expect("in range");
    let options = RotationInvariantOptions { coupling: 1, ..RotationInvariantOptions::default() };
    let poses = [1, 2, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solve(&options, &mesh, &ends(&mesh, Handle::hard), &bend(&mesh, 1.0)))
    });
    assert!(poses[0] == poses[1] && poses[0] == poses[2]);
}

/// The representation in full, `T_ij` and local coordinates, solved as printed with dense matrices.
mod dense {
    use super::*;
    use pliant_deform::rotation_invariant::DiscreteFrames;

    /// Least squares by normal equations and elimination with pivots, for three right-hand sides.
    fn least_squares(a: &[Vec<f64>], b: &[DVec3]) -> Vec<DVec3> {
        let n = a[0].len();
        let mut m = vec![vec![0.0; n]; n];
        let mut x = vec![DVec3::ZERO; n];
        for (row, b) in a.iter().zip(b) {
            for i in (0..n).filter(|i| row[*i] != 0.0) {
                x[i] += row[i] * *b;
                for j in 0..n {
                    m[i][j] += row[i] * row[j];
                }
            }
        }
        for k in 0..n {
            let pivot = (k..n).max_by(|i, j| m[*i][k].abs().total_cmp(&m[*j][k].abs())).expect("rows are left");
            m.swap(k, pivot);
            x.swap(k, pivot);
            for i in k + 1..n {
                let factor = m[i][k] / m[k][k];
                if factor != 0.0 {
                    let (upper, lower) = m.split_at_mut(i);
                    for (low, up) in lower[0][k..].iter_mut().zip(&upper[k][k..]) {
                        *low -= factor * up;
                    }
                    x[i] = x[i] - factor * x[k];
                }
            }
        }
        for k in (0..n).rev() {
            let sum: DVec3 = (k + 1..n).map(|j| m[k][j] * x[j]).sum();
            x[k] = (x[k] - sum) / m[k][k];
        }
        x
    }

    /// Moves the columns that are known to the right-hand side, solves, and puts all together.
    fn with_known(a: &[Vec<f64>], b: &[DVec3], known: &[Option<DVec3>]) -> Vec<DVec3> {
        let free: Vec<usize> = (0..known.len()).filter(|i| known[*i].is_none()).collect();
        let rest = |(row, b): (&Vec<f64>, &DVec3)| {
            *b - row.iter().zip(known).filter_map(|(a, x)| x.map(|x| *a * x)).sum::<DVec3>()
        };
        let b: Vec<DVec3> = a.iter().zip(b).map(rest).collect();
        let a: Vec<Vec<f64>> = a.iter().map(|row| free.iter().map(|j| row[*j]).collect()).collect();
        let mut x: Vec<DVec3> = known.iter().map(|x| x.unwrap_or_default()).collect();
        for (i, found) in free.iter().zip(least_squares(&a, &b)) {
            x[*i] = found;
        }
        x
    }

    /// Uniform weights and frames as solved for, with a hard and a soft handle, so that every line can be read beside the paper.
    #[test]
    fn sparse_equals_dense_as_printed() {
        for mesh in [pyramid(), sheet(5, 3), bar(1)] {
            // Of unit size, so that weights and rows are those of the frame of the solver.
            let bounds = mesh.bounds();
            let mesh = mesh
                .with_positions(mesh.positions.iter().map(|p| (*p - bounds.centre()) / bounds.diagonal()).collect());
            let mesh = mesh.expect("finite");
            let (n, weight) = (mesh.vertex_count(), 0.7);
            let (hard, soft) = (along_x(&mesh, 0.0..=0.05), along_x(&mesh, 0.95..=1.0));
            let region = region(&mesh, &[Handle::hard(hard.clone()), Handle::soft(soft.clone(), weight)]);
            let goals = [some_similarity(0.4, 1.2), some_similarity(-1.0, 0.8)];
            for tangent in [Tangent::Edge, Tangent::Normal] {
                let options = RotationInvariantOptions { tangent, ..RotationInvariantOptions::faithful() };
                let sparse = solve(&options, &mesh, &region, &Goals::new(goals.to_vec()));

                let frames = DiscreteFrames::of(&mesh, tangent);
                let turned = |v: usize, goal: &Similarity| goal.linear() * frames.columns(v);
                let row_of = |v: usize, k: usize| 3 * v + k;
                let free: Vec<usize> = (0..n).filter(|v| !hard.contains(*v as u32)).collect();
                let mean =
                    |degree: &dyn Fn(usize) -> f64| free.iter().map(|v| degree(*v)).sum::<f64>() / free.len() as f64;
                // Eq. 15: unknowns are the rows of F, each a vector of space.
                let (mut a, mut b) = (Vec::new(), Vec::new());
                for &[i, j] in mesh.topology().edges() {
                    let transfer = frames.transfer(i as usize, j as usize);
                    for k in 0..3 {
                        let mut row = vec![0.0; 3 * n];
                        row[row_of(j as usize, k)] = 1.0;
                        for l in 0..3 {
                            row[row_of(i as usize, l)] = -transfer.row(k)[l];
                        }
                        a.push(row);
                        b.push(DVec3::ZERO);
                    }
                }
                let alpha = weight * mean(&|v| mesh.topology().neighbours(v).len() as f64);
                let mut known = vec![None; 3 * n];
                for v in 0..n {
                    for k in 0..3 {
                        if hard.contains(v as u32) {
                            known[row_of(v, k)] = Some(turned(v, &goals[0]).col(k));
                        } else if soft.contains(v as u32) {
                            let mut row = vec![0.0; 3 * n];
                            row[row_of(v, k)] = alpha.sqrt();
                            a.push(row);
                            b.push(alpha.sqrt() * turned(v, &goals[1]).col(k));
                        }
                    }
                }
                let f = with_known(&a, &b, &known);

                // Eq. 14, 18 and 19.
                let (mut a, mut b) = (Vec::new(), Vec::new());
                let mut diagonal = vec![0.0; n];
                for i in 0..n {
                    let ring = mesh.topology().neighbours(i);
                    let mut row = vec![0.0; n];
                    row[i] = 1.0;
                    for &j in ring {
                        row[j as usize] = -1.0 / ring.len() as f64;
                    }
                    let delta: DVec3 = row.iter().zip(&mesh.positions).map(|(a, p)| *a * *p).sum();
                    let local: DMat3 = frames.columns(i);
                    let delta = (0..3).map(|k| delta.dot(local.col(k)) * f[row_of(i, k)]).sum::<DVec3>();
                    for (sum, a) in diagonal.iter_mut().zip(&row) {
                        *sum += a * a;
                    }
                    // Rows without an unknown say nothing of the solution.
                    a.push(row);
                    b.push(delta);
                }
                for (i, row) in a.iter().enumerate() {
                    if free.iter().all(|v| row[*v] == 0.0) {
                        assert!(hard.contains(i as u32));
                    }
                }
                let stiffness = weight * mean(&|v| diagonal[v]);
                let mut known = vec![None; n];
                for v in 0..n {
                    if hard.contains(v as u32) {
                        known[v] = Some(goals[0].apply(mesh.positions[v]));
                    } else if soft.contains(v as u32) {
                        let mut row = vec![0.0; n];
                        row[v] = stiffness.sqrt();
                        a.push(row);
                        b.push(stiffness.sqrt() * goals[1].apply(mesh.positions[v]));
                    }
                }
                let x = with_known(&a, &b, &known);
                assert!(distance(&x, &sparse) < 1e-10, "{:e}", distance(&x, &sparse));
            }
        }
    }
}
