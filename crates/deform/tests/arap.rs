//! What an edit must keep: energy, rigid motions, fixed vertices, goals, scale, bits.

mod common;

use std::f64::consts::PI;

use common::{along_x, bar, distance, pyramid, sheet, torus, variants};
use glam::{DQuat, DVec3};
use pliant_deform::arap::{Arap, ArapOptions};
use pliant_deform::{ArapEnergy, Constraint, DeformError, Deformer, Goals, Handle, HandleFault, Region, Role};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

fn shapes() -> Vec<(&'static str, TriMesh)> {
    vec![("pyramid", pyramid()), ("sheet", sheet(16, 8)), ("torus", torus(24, 10)), ("bar", bar(4))]
}

/// Everything free but the two ends along x.
fn two_ends(mesh: &TriMesh) -> Region {
    let ends = [0.0..=0.12, 0.88..=1.0].map(|range| Handle::hard(along_x(mesh, range)));
    Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &ends).expect("valid")
}

fn tip(mesh: &TriMesh) -> DVec3 {
    mesh.bounds().from_box(DVec3::new(0.95, 0.5, 0.5))
}

/// The first end stays; the second is turned by `angle` about a skew axis and lifted.
fn bend(mesh: &TriMesh, angle: f64) -> Goals {
    let mut turn = Similarity::about(tip(mesh), DVec3::new(0.3, 1.0, 0.5), angle, 1.0);
    turn.translation += DVec3::new(-0.1, 0.05, 0.2) * angle;
    Goals::new(vec![Similarity::IDENTITY, turn])
}

fn with_iterations(options: &ArapOptions, iterations: u32) -> ArapOptions {
    ArapOptions { iterations, ..options.clone() }
}

fn prepare(options: &ArapOptions, mesh: &TriMesh, region: &Region) -> Arap {
    Arap::prepare(options, mesh, region).expect("valid")
}

#[test]
fn the_energy_never_rises() {
    for (name, mesh) in shapes() {
        let region = two_ends(&mesh);
        for options in variants() {
            let mut warm = mesh.positions.clone();
            prepare(&options, &mesh, &region).solve(&bend(&mesh, 1.0), &mut warm).expect("solvable");
            for (from, start) in [("rest", &mesh.positions), ("a bent pose", &warm)] {
                let goals = bend(&mesh, 2.0);
                let mut last = f64::INFINITY;
                for iterations in 0..25 {
                    let mut arap = prepare(&with_iterations(&options, iterations), &mesh, &region);
                    let mut pose = start.clone();
                    let report = arap.solve(&goals, &mut pose).expect("solvable");
                    assert_eq!(report.iterations, iterations);
                    let now = arap.energy(&goals, &pose).expect("valid");
                    assert!(now <= last * (1.0 + 1e-12), "{name} from {from}, {options:?}: {last} -> {now}");
                    last = now;
                }
            }
        }
    }
}

#[test]
fn goals_at_rest_keep_rest() {
    for (name, mesh) in shapes() {
        for region in [two_ends(&mesh), anchored_band(&mesh)] {
            for options in variants() {
                let mut pose = mesh.positions.clone();
                prepare(&options, &mesh, &region).solve(&region.identity_goals(), &mut pose).expect("solvable");
                let off = distance(&pose, &mesh.positions) / mesh.bounds().diagonal();
                assert!(off <= 1e-12, "{name}, {options:?}: {off:e}");
            }
        }
    }
}

/// A region in the middle with one handle in it; the rest of the shape is fixed.
fn anchored_band(mesh: &TriMesh) -> Region {
    let handle = Handle::hard(along_x(mesh, 0.6..=0.7));
    let n = mesh.vertex_count();
    let band = along_x(mesh, 0.2..=0.9);
    // Few vertices: nothing in the handle's range.
    let handles = if handle.vertices.is_empty() { vec![] } else { vec![handle] };
    Region::new(n, &band, &handles).expect("valid")
}

#[test]
fn fixed_vertices_keep_their_bits_and_hard_handles_land_exactly() {
    for (name, mesh) in shapes() {
        let region = anchored_band(&mesh);
        let turn = Similarity::about(mesh.bounds().centre(), DVec3::Y, 0.4, 1.2);
        let goals = Goals::new(vec![turn; region.handles().len()]);
        for options in variants() {
            let mut pose = mesh.positions.clone();
            prepare(&options, &mesh, &region).solve(&goals, &mut pose).expect("solvable");
            for (v, role) in region.roles().iter().enumerate() {
                match role {
                    Role::Fixed => assert_eq!(pose[v], mesh.positions[v], "{name}"),
                    Role::Handle(_) => assert_eq!(pose[v], turn.apply(mesh.positions[v]), "{name}"),
                    Role::Free => assert!(pose[v].is_finite()),
                }
            }
        }
    }
}

/// One rigid motion of all handles moves the whole shape, whatever the angle, in one solve without iterations.
#[test]
fn a_common_rigid_motion_is_reproduced() {
    for (name, mesh) in shapes() {
        let region = two_ends(&mesh);
        let diagonal = mesh.bounds().diagonal();
        for options in variants() {
            let mut arap = prepare(&with_iterations(&options, 0), &mesh, &region);
            let mut pose = mesh.positions.clone();
            for angle in [0.1, 1.5, 3.0, -2.9, PI] {
                let mut motion = Similarity::about(DVec3::new(1.0, -2.0, 0.5), DVec3::new(1.0, 2.0, -1.0), angle, 1.0);
                motion.translation += DVec3::new(5.0, 1.0, -3.0);
                arap.solve(&Goals::new(vec![motion; 2]), &mut pose).expect("solvable");
                let expected: Vec<DVec3> = mesh.positions.iter().map(|&p| motion.apply(p)).collect();
                let off = distance(&pose, &expected) / diagonal;
                assert!(off < 1e-11, "{name}, {options:?}, {angle}: {off:e}");
            }
        }
    }
}

/// Solving in a turned and shifted scene gives the turned and shifted solution: from any pose, with any goals.
#[test]
fn turning_the_scene_turns_the_solution() {
    let scene = Similarity::about(DVec3::new(0.4, 1.0, -2.0), DVec3::new(-1.0, 0.3, 0.8), 2.2, 1.0);
    let inverse = scene.rotation.inverse();
    for (name, mesh) in shapes() {
        let region = two_ends(&mesh);
        let turned = TriMesh::new(mesh.positions.iter().map(|&p| scene.apply(p)).collect(), mesh.triangles().to_vec())
            .expect("valid");
        for options in variants() {
            let (mut a, mut b) = (prepare(&options, &mesh, &region), prepare(&options, &turned, &region));
            let (mut pose, mut turned_pose) = (mesh.positions.clone(), turned.positions.clone());
            for angle in [0.7, 1.6, -0.4] {
                let goals = bend(&mesh, angle);
                let turned_goals = goals.transforms.iter().map(|g| {
                    let rotation = (scene.rotation * g.rotation * inverse).normalize();
                    // scene(g(inverse scene(x))) at the origin of the turned scene.
                    let origin = inverse * -scene.translation;
                    Similarity { rotation, scale: 1.0, translation: scene.apply(g.apply(origin)) }
                });
                b.solve(&Goals::new(turned_goals.collect()), &mut turned_pose).expect("solvable");
                a.solve(&goals, &mut pose).expect("solvable");
                let expected: Vec<DVec3> = pose.iter().map(|&p| scene.apply(p)).collect();
                let off = distance(&turned_pose, &expected) / mesh.bounds().diagonal();
                assert!(off < 1e-10, "{name}, {options:?}: {off:e}");
            }
        }
    }
}

#[test]
fn scale_and_offset_of_the_scene_do_not_matter() {
    for (name, mesh) in shapes() {
        let region = two_ends(&mesh);
        let diagonal = mesh.bounds().diagonal();
        for options in variants() {
            let mut pose = mesh.positions.clone();
            let goals = bend(&mesh, 1.2);
            prepare(&options, &mesh, &region).solve(&goals, &mut pose).expect("solvable");
            for (scale, offset) in [(1e-12, 0.0), (1e12, 0.0), (3.0, 0.0), (1.0, 1e5), (1e-6, 1e-2), (1e6, -1e10)] {
                let offset = DVec3::new(1.0, -0.7, 0.4) * offset;
                let place = |p: DVec3| scale * p + offset;
                let moved = TriMesh::new(mesh.positions.iter().map(|&p| place(p)).collect(), mesh.triangles().to_vec());
                let moved = moved.expect("valid");
                let goals = goals.transforms.iter().map(|g| {
                    let translation = scale * g.translation + offset - g.rotation * offset;
                    Similarity { translation, ..*g }
                });
                let mut there = moved.positions.clone();
                let mut arap = prepare(&options, &moved, &region);
                arap.solve(&Goals::new(goals.collect()), &mut there).expect("solvable");
                let expected: Vec<DVec3> = pose.iter().map(|&p| place(p)).collect();
                let off = distance(&there, &expected) / (scale * diagonal);
                assert!(off < 1e-9, "{name}, {options:?}, scale {scale:e}, {offset}: {off:e}");
            }
        }
    }
}

/// Half turns are where rotations are torn between two ways round; the result is finite and the shape is not crushed.
#[test]
fn half_turns_stay_finite() {
    for (name, mesh) in shapes() {
        let region = two_ends(&mesh);
        for options in variants() {
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                for angle in [PI, -PI, PI - 1e-9, PI + 1e-9, 2.0 * PI, 4.0 * PI] {
                    let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(tip(&mesh), axis, angle, 1.0)]);
                    let mut pose = mesh.positions.clone();
                    let mut arap = prepare(&with_iterations(&options, 10), &mesh, &region);
                    arap.solve(&goals, &mut pose).expect("solvable");
                    assert!(pose.iter().all(|p| p.is_finite()), "{name}, {axis}, {angle}");
                    if angle >= 2.0 * PI {
                        // Full turns are no turn.
                        let off = distance(&pose, &mesh.positions);
                        assert!(off < 1e-9, "{name}, {angle}: {off:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn bits_do_not_depend_on_run_or_threads() {
    let mesh = torus(90, 40);
    let region = two_ends(&mesh);
    for options in variants() {
        let options = ArapOptions { iterations: 6, tolerance: Some(1e-9), ..options };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut arap = prepare(&options, &mesh, &region);
                let mut pose = mesh.positions.clone();
                let reports = [0.5, 1.0, 0.2].map(|a| arap.solve(&bend(&mesh, a), &mut pose).expect("solvable"));
                (pose, reports)
            })
        };
        let first = run(1);
        for threads in [1, 2, 4] {
            assert!(run(threads) == first, "{threads} threads, {options:?}");
        }
    }
}

#[test]
fn soft_handles_lie_between_free_and_hard() {
    for (name, mesh) in shapes() {
        let n = mesh.vertex_count();
        // The anchor holds more than a line, about which the shape could swing without effort.
        let (first, second) = (along_x(&mesh, 0.0..=0.45), along_x(&mesh, 0.88..=1.0));
        for options in variants() {
            let options = ArapOptions { iterations: 5000, tolerance: Some(1e-12), ..options };
            let solve = |handles: &[Handle]| {
                let region = Region::new(n, &VertexSet::all(n), handles).expect("valid");
                let mut goals = bend(&mesh, 0.5);
                goals.transforms.truncate(handles.len());
                let mut pose = mesh.positions.clone();
                prepare(&options, &mesh, &region).solve(&goals, &mut pose).expect("solvable");
                pose
            };
            let anchor = Handle::hard(first.clone());
            let hard = solve(&[anchor.clone(), Handle::hard(second.clone())]);
            let soft = |weight: f64| solve(&[anchor.clone(), Handle::soft(second.clone(), weight)]);
            let diagonal = mesh.bounds().diagonal();
            // The force of the shape on a handle is of the order of its size, so the gap is of the order of 1 / weight.
            assert!(distance(&soft(1e8), &hard) < 1e-5 * diagonal, "{name}, {options:?}");
            let ignored = distance(&soft(1e-9), &mesh.positions) / diagonal;
            assert!(ignored < 1e-4, "{name}, {options:?}: {ignored:e}");
            let goals = bend(&mesh, 0.5);
            let gap = |pose: &[DVec3]| {
                second
                    .iter()
                    .map(|v| {
                        (goals.transforms[1].apply(mesh.positions[v as usize]) - pose[v as usize]).length_squared()
                    })
                    .sum::<f64>()
            };
            assert!(gap(&soft(1e30)).sqrt() < 1e-10 * diagonal, "{name}, {options:?}");
            // A stiffer spring is never longer at the minimum.
            let gaps = [1e-6, 1e-2, 1.0, 1e2].map(|w| gap(&soft(w)));
            assert!(gaps.windows(2).all(|g| g[1] < g[0]), "{name}, {options:?}: {gaps:?}");
        }
    }
}

/// A soft handle alone defines an edit: where its goal is rigid, the shape follows entirely.
#[test]
fn a_soft_handle_may_be_the_only_constraint() {
    for (name, mesh) in shapes() {
        let n = mesh.vertex_count();
        for weight in [1e-300, 1e-6, 1.0, 1e300] {
            let handle = Handle::soft(along_x(&mesh, 0.0..=0.3), weight);
            let region = Region::new(n, &VertexSet::all(n), &[handle]).expect("valid");
            let motion = Similarity::about(DVec3::ONE, DVec3::Z, 1.0, 1.0);
            let mut pose = mesh.positions.clone();
            let mut arap = prepare(&ArapOptions::default(), &mesh, &region);
            arap.solve(&Goals::new(vec![motion]), &mut pose).expect("solvable");
            let expected: Vec<DVec3> = mesh.positions.iter().map(|&p| motion.apply(p)).collect();
            let off = distance(&pose, &expected);
            // The matrix's condition number grows as the weight falls.
            assert!(off < 1e-6, "{name}, weight {weight:e}: {off:e}");
        }
    }
}

#[test]
fn what_nothing_holds_is_refused_and_stays_in_the_pose_when_left_out() {
    // Two sheets, the second without any constraint, and a vertex without faces.
    let one = sheet(6, 3);
    let n = one.vertex_count();
    let mut positions = one.positions.clone();
    positions.extend(one.positions.iter().map(|p| *p + DVec3::new(0.0, 3.0, 0.0)));
    positions.push(DVec3::new(9.0, 9.0, 9.0));
    let mut triangles = one.triangles().to_vec();
    triangles.extend(one.triangles().iter().map(|t| t.map(|v| v + n as u32)));
    let mesh = TriMesh::new(positions, triangles).expect("valid");
    let ends = [0.0..=0.12, 0.88..=1.0].map(|range| Handle::hard(along_x(&one, range)));
    let all = VertexSet::all(mesh.vertex_count());
    let region = Region::new(mesh.vertex_count(), &all, &ends).expect("valid");
    let alone = Region::new(n, &VertexSet::all(n), &ends).expect("valid");
    let (held, left_out) = region.without_unconstrained(mesh.topology());
    assert_eq!(left_out, n + 1);
    for options in variants() {
        let mut pose = mesh.positions.clone();
        pose[n..].iter_mut().for_each(|p| p.z += 0.25);
        let start = pose.clone();
        let refused = DeformError::Unconstrained { vertex: n as u32, count: n + 1 };
        assert_eq!(Arap::prepare(&options, &mesh, &region).err(), Some(refused.clone()));
        let mut arap = prepare(&options, &mesh, &held);
        assert_eq!(arap.set_region(&region), Err(refused));
        arap.solve(&bend(&one, 0.8), &mut pose).expect("solvable");
        assert_eq!(pose[n..], start[n..]);
        let mut expected = one.positions.clone();
        prepare(&options, &one, &alone).solve(&bend(&one, 0.8), &mut expected).expect("solvable");
        assert!(distance(&pose[..n], &expected) < 1e-10);
    }
}

#[test]
fn a_region_without_free_vertices_goes_to_its_goals() {
    let mesh = pyramid();
    let handle = Handle::hard(VertexSet::all(5));
    let region = Region::new(5, &VertexSet::all(5), &[handle]).expect("valid");
    let grow = Similarity::about(DVec3::ONE, DVec3::X, 0.3, 2.0);
    for options in variants() {
        let mut pose = mesh.positions.clone();
        let options = ArapOptions { tolerance: Some(1e-3), ..options };
        let report = prepare(&options, &mesh, &region).solve(&Goals::new(vec![grow]), &mut pose).expect("solvable");
        assert!(report.converged);
        assert_eq!(pose, mesh.positions.iter().map(|&p| grow.apply(p)).collect::<Vec<_>>());
    }
}

#[test]
fn one_handle_vertex_pulls_its_shape_along() {
    for (name, mesh) in shapes() {
        let n = mesh.vertex_count();
        let region = Region::new(n, &VertexSet::all(n), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
        let shift = DVec3::new(1.0, -3.0, 0.5);
        let mut pose = mesh.positions.clone();
        let mut arap = prepare(&ArapOptions::default(), &mesh, &region);
        arap.solve(&Goals::new(vec![Similarity::translation(shift)]), &mut pose).expect("solvable");
        let expected: Vec<DVec3> = mesh.positions.iter().map(|p| *p + shift).collect();
        assert!(distance(&pose, &expected) < 1e-11, "{name}");
    }
}

/// Flat, collinear, needle-shaped and doubled triangles: finite, and still exact where nothing moves.
#[test]
fn degenerate_shapes_are_solved() {
    let flat: Vec<DVec3> = sheet(8, 4).positions.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
    let line: Vec<DVec3> = flat.iter().map(|p| DVec3::new(p.x + 0.1 * p.y, 0.0, 0.0)).collect();
    let thin: Vec<DVec3> = flat.iter().map(|p| DVec3::new(p.x, 1e-7 * p.y, 0.0)).collect();
    let mut welded = flat.clone();
    welded[20] = welded[21];
    for (name, positions) in [("flat", flat), ("line", line), ("thin", thin), ("welded", welded)] {
        let mesh = TriMesh::new(positions, sheet(8, 4).triangles().to_vec()).expect("valid");
        let region = two_ends(&mesh);
        for options in variants() {
            let mut arap = prepare(&with_iterations(&options, 10), &mesh, &region);
            let mut pose = mesh.positions.clone();
            arap.solve(&region.identity_goals(), &mut pose).expect("solvable");
            let off = distance(&pose, &mesh.positions);
            assert!(off < 1e-12 * mesh.bounds().diagonal(), "{name}, {options:?}: {off:e}");
            arap.solve(&bend(&mesh, 1.0), &mut pose).expect("solvable");
            assert!(pose.iter().all(|p| p.is_finite() && p.length() < 10.0), "{name}, {options:?}");
        }
    }
}

#[test]
fn the_tolerance_stops_and_is_reported() {
    let mesh = torus(24, 10);
    let region = two_ends(&mesh);
    for options in variants() {
        let goals = bend(&mesh, 1.0);
        let at = |iterations, tolerance| {
            let mut arap = prepare(&ArapOptions { iterations, tolerance, ..options.clone() }, &mesh, &region);
            let mut pose = mesh.positions.clone();
            let report = arap.solve(&goals, &mut pose).expect("solvable");
            let energy = arap.energy(&goals, &pose).expect("valid");
            (report, energy, pose)
        };
        let (loose, loose_energy, pose) = at(10_000, Some(1e-2));
        assert!(loose.converged && loose.iterations > 1);
        // The reported energies are those of the guess and of the result.
        let same = |a: Option<f64>, b: f64| (a.expect("a tolerance is set") - b).abs() <= 1e-9 * b;
        assert!(same(loose.energy_after, loose_energy) && same(loose.energy_before, at(0, None).1));
        let (tight, tight_energy, _) = at(10_000, Some(1e-6));
        assert!(tight.converged && tight.iterations > loose.iterations && tight_energy < loose_energy);
        // The same number of iterations without a tolerance gives the same bits.
        let (counted, _, counted_pose) = at(loose.iterations, None);
        assert!(!counted.converged && counted.energy_after.is_none());
        assert!(counted_pose == pose);
        let (capped, ..) = at(3, Some(0.0));
        assert!(!capped.converged && capped.iterations == 3);
        // At rest there is nothing to do.
        let mut arap = prepare(&ArapOptions { tolerance: Some(1e-6), ..options.clone() }, &mesh, &region);
        let report = arap.solve(&region.identity_goals(), &mut mesh.positions.clone()).expect("solvable");
        assert!(report.converged && report.iterations == 0, "{report:?}");
    }
}

#[test]
fn errors_leave_the_pose_alone() {
    let mesh = bar(2);
    let region = two_ends(&mesh);
    let mut arap = prepare(&ArapOptions::default(), &mesh, &region);
    let start = mesh.positions.clone();
    let far = |t: f64| Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::new(0.0, t, 0.0))]);
    for t in [f64::NAN, f64::INFINITY, 1e308, -1e200] {
        let mut pose = start.clone();
        let error = arap.solve(&far(t), &mut pose).expect_err("out of reach");
        assert!(matches!(error, DeformError::Handle { handle: 1, .. }), "{t}: {error}");
        assert_eq!(pose, start);
    }
    assert!(matches!(
        arap.solve(&far(1e150), &mut start.clone()),
        Err(DeformError::Handle { handle: 1, fault: HandleFault::TooFar { .. } })
    ));
    assert!(arap.solve(&far(1e90), &mut start.clone()).is_ok());
    let upside = Similarity { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), ..Similarity::IDENTITY };
    assert!(arap.solve(&Goals::new(vec![upside; 2]), &mut start.clone()).is_err());
    let mut short = start[1..].to_vec();
    let error = arap.solve(&region.identity_goals(), &mut short).expect_err("too few");
    assert_eq!(error, DeformError::WrongCount { what: "positions", expected: start.len(), found: start.len() - 1 });
    let mut broken = start.clone();
    broken[3].y = f64::NAN;
    let error = arap.solve(&region.identity_goals(), &mut broken).expect_err("not finite");
    assert!(error.to_string().contains("vertex 3"), "{error}");
    // And works on.
    let mut pose = start.clone();
    arap.solve(&region.identity_goals(), &mut pose).expect("solvable");
    assert!(distance(&pose, &start) < 1e-12);
}

/// What is dragged of one piece leaves another where it rests, however far either is from converged.
#[test]
fn pieces_that_are_not_joined_do_not_lead_each_other() {
    let one = pliant_mesh::shapes::icosphere(2);
    let n = one.vertex_count() as u32;
    let positions = one.positions.iter().copied().chain(one.positions.iter().map(|p| *p + 3.0 * DVec3::X)).collect();
    let triangles = one.triangles().iter().copied().chain(one.triangles().iter().map(|t| t.map(|v| v + n))).collect();
    let shape = TriMesh::new(positions, triangles).expect("valid");
    let cap = |first: u32| (0..n).filter(|&v| one.positions[v as usize].y < -0.6).map(|v| v + first).collect();
    let all = VertexSet::all(2 * n as usize);
    for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
        for constraint in [Constraint::Hard, Constraint::Soft(2.0)] {
            let handles = [0, n].map(|first| Handle { constraint, ..Handle::hard(cap(first)) });
            let region = Region::new(2 * n as usize, &all, &handles).expect("valid");
            let options = ArapOptions { energy, iterations: 1, ..ArapOptions::default() };
            let mut solver = Arap::prepare(&options, &shape, &region).expect("held");
            let mut pose = shape.positions.clone();
            let turn = Similarity { translation: DVec3::Z, ..Similarity::about(DVec3::ZERO, DVec3::X, 0.5, 1.0) };
            solver.solve(&Goals::new(vec![Similarity::IDENTITY, turn]), &mut pose).expect("solvable");
            let off = |v: u32, to: DVec3| pose[v as usize].distance(to);
            for v in 0..n {
                assert!(off(v, shape.positions[v as usize]) < 1e-12, "{energy:?}");
                // The other one as a whole, as all that holds it does.
                assert!(off(v + n, turn.apply(shape.positions[(v + n) as usize])) < 1e-12, "{energy:?}");
            }
        }
    }
}
