//! Implicit Laplacian editing: what the paper proves, on meshes of every kind.

mod common;

use allocation_counter::measure;
use common::{along_x, bar, distance, pyramid, sheet, torus};
use glam::{DMat3, DVec3};
use pliant_deform::implicit::{FeatureSize, Implicit, ImplicitConstraints, ImplicitOptions, ImplicitStage};
use pliant_deform::{DeformError, Deformer, EdgeWeightKind, Goals, Handle, Region, Role};
use pliant_mesh::{Similarity, TriMesh, VertexSet, outer, shapes};

const CONSTRAINTS: [ImplicitConstraints; 3] =
    [ImplicitConstraints::Both, ImplicitConstraints::Positions, ImplicitConstraints::Gradients];

fn stretched(mesh: &TriMesh, by: DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| *p * by).collect()).expect("finite")
}

fn plane() -> TriMesh {
    shapes::plane_grid(12, 9, 3.0, 2.0).expect("valid size")
}

/// Closed, open, with flat sides, flat, a strip of which every vertex is on the boundary, and with triangles 60 and 300 times as long as wide.
fn meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("pyramid", pyramid()),
        ("wavy sheet", sheet(16, 8)),
        ("torus", torus(24, 10)),
        ("bar", bar(4)),
        ("plane", plane()),
        ("strip", shapes::plane_grid(9, 1, 4.0, 0.5).expect("valid size")),
        ("needles", stretched(&bar(3), DVec3::new(60.0, 1.0, 1.0))),
        ("flat needles", stretched(&shapes::plane_grid(9, 9, 1.0, 1.0).expect("valid"), DVec3::new(300.0, 1.0, 1.0))),
    ]
}

fn variants() -> Vec<ImplicitOptions> {
    let mut all = Vec::new();
    for weights in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
        for rings in [1, 2, 3] {
            all.push(ImplicitOptions { weights, rings, ..ImplicitOptions::default() });
        }
    }
    all
}

/// A quarter more than a right angle about a skew axis, larger, and somewhere else.
fn similarity(mesh: &TriMesh) -> Similarity {
    let mut map = Similarity::about(mesh.bounds().centre(), DVec3::new(1.0, 2.0, -1.0), 2.5, 1.7);
    map.translation += mesh.bounds().diagonal() * DVec3::new(0.3, -1.0, 0.5);
    map
}

fn apply(map: Similarity, points: &[DVec3]) -> Vec<DVec3> {
    points.iter().map(|p| map.apply(*p)).collect()
}

/// Everything in the region, with these handles.
fn whole(mesh: &TriMesh, handles: &[Handle]) -> Region {
    Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), handles).expect("valid")
}

fn ends(mesh: &TriMesh) -> [VertexSet; 2] {
    [0.0..=0.12, 0.88..=1.0].map(|range| along_x(mesh, range))
}

fn hard_ends(mesh: &TriMesh) -> Region {
    whole(mesh, &ends(mesh).map(Handle::hard))
}

/// The middle is the region; the ends are fixed.
fn held_by_ends(mesh: &TriMesh, handles: &[Handle]) -> Region {
    Region::new(mesh.vertex_count(), &along_x(mesh, 0.15..=0.85), handles).expect("valid")
}

fn prepare(options: &ImplicitOptions, mesh: &TriMesh, region: &Region) -> Implicit {
    Implicit::prepare(options, mesh, region).unwrap_or_else(|error| panic!("{options}: {error}"))
}

fn solved(options: &ImplicitOptions, mesh: &TriMesh, region: &Region, goals: &Goals) -> Vec<DVec3> {
    let mut pose = mesh.positions.clone();
    prepare(options, mesh, region).solve(goals, &mut pose).expect("solvable");
    pose
}

/// One end stays, the other is turned about a skew axis.
fn bend(mesh: &TriMesh, angle: f64) -> Goals {
    let tip = mesh.bounds().from_box(DVec3::new(0.7, 0.5, 0.5));
    Goals::new(vec![Similarity::IDENTITY, Similarity::about(tip, DVec3::new(0.3, 1.0, 0.5), angle, 1.0)])
}

/// The proof of section 3.2: one position and one gradient determine everything, exactly.
#[test]
fn one_position_and_one_gradient_determine_the_surface() {
    for (name, mesh) in meshes() {
        let map = similarity(&mesh);
        let (image, goals) = (apply(map, &mesh.positions), Goals::new(vec![map]));
        for options in variants() {
            for vertex in [0, mesh.vertex_count() as u32 / 2] {
                let one = VertexSet::from_iter([vertex]);
                for handle in [Handle::hard(one.clone()), Handle::soft(one, 1.0)] {
                    let mut implicit = prepare(&options, &mesh, &whole(&mesh, &[handle]));
                    let (mut first, mut pose) = (mesh.positions.clone(), mesh.positions.clone());
                    implicit.solve_preview(&goals, &mut first).expect("solvable");
                    implicit.solve(&goals, &mut pose).expect("solvable");
                    let off = distance(&first, &image).max(distance(&pose, &image)) / mesh.bounds().diagonal();
                    // A single vertex holds weakly: 1e-11 on even meshes, and triangles 300 times as long as wide cost
                    // their ratio.
                    assert!(off < 1e-8, "{name}, {options}, vertex {vertex}: {off:e}");
                }
            }
        }
    }
}

/// Section 5.1, Fig. 2: a similarity of all that holds the surface becomes one of the whole surface. Gradients need something fixed, which an
/// earlier edit has taken along.
#[test]
fn a_common_similarity_is_reproduced() {
    for (name, mesh) in meshes() {
        let map = similarity(&mesh);
        let image = apply(map, &mesh.positions);
        for options in variants() {
            for constraints in CONSTRAINTS {
                let options = ImplicitOptions { constraints, ..options.clone() };
                let middle = along_x(&mesh, 0.4..=0.6);
                let mut regions = Vec::new();
                if constraints != ImplicitConstraints::Gradients {
                    regions.push(hard_ends(&mesh));
                    regions.push(whole(&mesh, &ends(&mesh).map(|end| Handle::soft(end, 0.3))));
                }
                if name != "pyramid" {
                    regions.push(held_by_ends(&mesh, &[]));
                    regions.push(held_by_ends(&mesh, &[Handle::hard(middle.clone())]));
                    regions.push(held_by_ends(&mesh, &[Handle::soft(middle, 0.3)]));
                }
                for region in regions {
                    let goals = Goals::new(vec![map; region.handles().len()]);
                    let mut pose = mesh.positions.clone();
                    for (v, role) in region.roles().iter().enumerate() {
                        if *role == Role::Fixed {
                            pose[v] = image[v];
                        }
                    }
                    // What is fixed says nothing of features, so the choice is named.
                    let options = ImplicitOptions { features: FeatureSize::Scale, ..options.clone() };
                    prepare(&options, &mesh, &region).solve(&goals, &mut pose).expect("solvable");
                    let off = distance(&pose, &image) / mesh.bounds().diagonal();
                    // Triangles 60 or 300 times as long as wide cost digits; even ones leave 1e-13.
                    assert!(off < 1e-8, "{name}, {options}: {off:e}");
                }
            }
        }
    }
}

#[test]
fn goals_at_rest_keep_rest() {
    for (name, mesh) in meshes() {
        for options in variants() {
            for constraints in CONSTRAINTS {
                let options = ImplicitOptions { constraints, ..options.clone() };
                let gradients = constraints == ImplicitConstraints::Gradients;
                if gradients && name == "pyramid" {
                    continue;
                }
                let region = if gradients {
                    held_by_ends(&mesh, &[Handle::hard(along_x(&mesh, 0.4..=0.6))])
                } else {
                    hard_ends(&mesh)
                };
                let mut implicit = prepare(&options, &mesh, &region);
                for stage in [ImplicitStage::Preview, ImplicitStage::Full] {
                    let mut pose = mesh.positions.clone();
                    match stage {
                        ImplicitStage::Preview => implicit.solve_preview(&region.identity_goals(), &mut pose),
                        ImplicitStage::Full => implicit.solve(&region.identity_goals(), &mut pose),
                    }
                    .expect("solvable");
                    let off = distance(&pose, &mesh.positions) / mesh.bounds().diagonal();
                    assert!(off < 1e-10, "{name}, {options}, {stage:?}: {off:e}");
                }
            }
        }
    }
}

/// Eq. 4 as it is printed.
fn gradient(mesh: &TriMesh, pose: &[DVec3], v: usize) -> DMat3 {
    let ring = mesh.topology().neighbours(v);
    let mean = |p: &[DVec3]| ring.iter().map(|&j| p[j as usize]).sum::<DVec3>() / ring.len() as f64;
    let (centre, image) = (mean(&mesh.positions), mean(pose));
    let (mut a, mut b) = (DMat3::ZERO, DMat3::ZERO);
    for k in std::iter::once(v).chain(ring.iter().map(|&j| j as usize)) {
        a += outer(pose[k] - image, mesh.positions[k] - centre);
        b += outer(mesh.positions[k] - centre, mesh.positions[k] - centre);
    }
    a * b.inverse()
}

fn size(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|x| x.abs()).fold(0.0, f64::max)
}

/// `M_c = W` at every vertex of a hard handle (Eq. 7), to the square of what the weight of its rows leaves; nearly at those of a soft handle,
/// the more so the higher its weight; and not at all if positions alone count.
#[test]
fn gradients_of_handles_are_their_goals() {
    let mesh = torus(48, 20);
    let goals = bend(&mesh, 1.2);
    let worst = |options: &ImplicitOptions, region: &Region| {
        let mut pose = mesh.positions.clone();
        prepare(options, &mesh, region).solve_preview(&goals, &mut pose).expect("solvable");
        let off = ends(&mesh).into_iter().zip(&goals.transforms).flat_map(|(end, goal)| {
            let at = |v: u32| size(gradient(&mesh, &pose, v as usize) - goal.linear());
            end.iter().map(at).collect::<Vec<f64>>()
        });
        off.fold(0.0, f64::max)
    };
    let both = ImplicitOptions::default();
    let hard = worst(&both, &hard_ends(&mesh));
    assert!(hard < 1e-6, "{hard:e}");
    let soft =
        [1e4, 1.0, 1e-2].map(|weight| worst(&both, &whole(&mesh, &ends(&mesh).map(|end| Handle::soft(end, weight)))));
    assert!(hard < soft[0] && soft[0] < 1e-2 && soft[0] < soft[1] && soft[1] < soft[2], "{soft:?}");
    let positions = ImplicitOptions { constraints: ImplicitConstraints::Positions, ..both };
    let free = worst(&positions, &hard_ends(&mesh));
    assert!(free > 0.1, "{free:e}");
}

/// A handle of one vertex has one position, whatever it turns: with positions alone the turn does not matter.
#[test]
fn positions_alone_do_not_see_orientations() {
    let mesh = torus(48, 20);
    let n = mesh.vertex_count();
    let spread = |k: usize| VertexSet::from_iter([(k * n / 12) as u32]);
    let region = whole(&mesh, &(0..12).map(|k| Handle::hard(spread(k))).collect::<Vec<Handle>>());
    let place = |k: usize| mesh.positions[k * n / 12] + DVec3::new(0.0, 0.1, -0.2) * (k as f64).sin();
    let goals = |angle: f64| {
        let goal = |k: usize| {
            let from = mesh.positions[k * n / 12];
            let turn = Similarity::about(from, DVec3::new(1.0, k as f64, -1.0), angle, 1.0);
            Similarity { translation: turn.translation + place(k) - from, ..turn }
        };
        Goals::new((0..12).map(goal).collect())
    };
    for constraints in [ImplicitConstraints::Positions, ImplicitConstraints::Both] {
        let options = ImplicitOptions { constraints, ..ImplicitOptions::default() };
        let [plain, turned] = [0.0, 0.5].map(|angle| solved(&options, &mesh, &region, &goals(angle)));
        let off = distance(&plain, &turned) / mesh.bounds().diagonal();
        assert_eq!(off < 1e-3, constraints == ImplicitConstraints::Positions, "{constraints:?}: {off:e}");
    }
}

/// Gradients alone turn a handle and let it go where the surface takes it.
#[test]
fn gradients_alone_turn_handles_that_float() {
    let mesh = bar(4);
    let options = ImplicitOptions { constraints: ImplicitConstraints::Gradients, ..ImplicitOptions::default() };
    let tip = along_x(&mesh, 0.85..=1.0);
    let region =
        Region::new(mesh.vertex_count(), &along_x(&mesh, 0.1..=1.0), &[Handle::hard(tip.clone())]).expect("valid");
    let turn = |far: f64| {
        let turn = Similarity::about(DVec3::ZERO, DVec3::Z, 0.8, 1.0);
        Goals::new(vec![Similarity { translation: DVec3::splat(far), ..turn }])
    };
    let [near, far] = [0.0, 50.0].map(|far| solved(&options, &mesh, &region, &turn(far)));
    assert!(near == far, "where the goal takes the handle does not matter");
    let preview = ImplicitOptions { stage: ImplicitStage::Preview, ..options.clone() };
    let preview = solved(&preview, &mesh, &region, &turn(0.0));
    let linear = turn(0.0).transforms[0].linear();
    let first = tip.as_slice()[0] as usize;
    for v in tip.iter().map(|v| v as usize) {
        let arm = linear * (mesh.positions[v] - mesh.positions[first]);
        assert!(preview[v].distance(preview[first] + arm) < 1e-6);
        // The second system has Laplacian coordinates to keep, not gradients: the handle is a little bent, a bar one unit wide.
        let off = near[v].distance(near[first] + arm);
        assert!(off < 0.15, "{v}: {off}");
    }
    // The bar has bent along: its tip, turned by 0.8, is where a bar bent in an arc has it, off the axis but not stretched.
    let tip_at = |pose: &[DVec3]| tip.iter().map(|v| pose[v as usize]).sum::<DVec3>() / tip.len() as f64;
    let (from, to) = (tip_at(&mesh.positions), tip_at(&near));
    assert!(to.y - from.y > 0.8 && (to - from).z.abs() < 0.05, "{from} {to}");
    let region = whole(&mesh, &[Handle::hard(tip)]);
    let error = Implicit::prepare(&options, &mesh, &region).err().expect("nothing says where");
    assert_eq!(error, DeformError::Unconstrained { vertex: 0, count: mesh.vertex_count() });
}

#[test]
fn fixed_vertices_keep_their_bits_and_hard_handles_land_exactly() {
    for (name, mesh) in meshes() {
        let handle = along_x(&mesh, 0.4..=0.6);
        let region = if name == "pyramid" { hard_ends(&mesh) } else { held_by_ends(&mesh, &[Handle::hard(handle)]) };
        let goals = Goals::new(vec![similarity(&mesh); region.handles().len()]);
        for options in variants() {
            let pose = solved(&options, &mesh, &region, &goals);
            for (v, role) in region.roles().iter().enumerate() {
                match role {
                    Role::Fixed => assert_eq!(pose[v], mesh.positions[v], "{name}"),
                    Role::Handle(h) => assert_eq!(pose[v], goals.transforms[*h as usize].apply(mesh.positions[v])),
                    Role::Free => assert!(pose[v].is_finite()),
                }
            }
        }
    }
}

/// The result is a function of the goals and of what is fixed; a preview in between changes nothing.
#[test]
fn where_the_unknowns_come_from_does_not_matter() {
    let mesh = bar(4);
    let region = hard_ends(&mesh);
    let mut implicit = prepare(&ImplicitOptions::default(), &mesh, &region);
    let mut from_rest = mesh.positions.clone();
    implicit.solve(&bend(&mesh, 1.0), &mut from_rest).expect("solvable");
    let mut from_afar = mesh.positions.clone();
    implicit.solve(&bend(&mesh, -0.7), &mut from_afar).expect("solvable");
    implicit.solve_preview(&bend(&mesh, 1.5), &mut from_afar).expect("solvable");
    let preview = from_afar.clone();
    implicit.solve(&bend(&mesh, 1.0), &mut from_afar).expect("solvable");
    assert!(from_rest == from_afar);
    let options = ImplicitOptions { stage: ImplicitStage::Preview, ..ImplicitOptions::default() };
    assert!(solved(&options, &mesh, &region, &bend(&mesh, 1.5)) == preview);
}

#[test]
fn results_follow_scale_and_offset() {
    for (name, mesh) in meshes() {
        let region = hard_ends(&mesh);
        for options in variants() {
            let plain = solved(&options, &mesh, &region, &bend(&mesh, 0.9));
            for (scale, offset) in [(1e-3, DVec3::ZERO), (1e3, DVec3::new(2e3, -1e3, 5e2)), (3.0, DVec3::ONE)] {
                let map = Similarity { scale, translation: offset, ..Similarity::IDENTITY };
                let other = mesh.with_positions(apply(map, &mesh.positions)).expect("finite");
                let pose = solved(&options, &other, &region, &bend(&other, 0.9));
                let off = distance(&pose, &apply(map, &plain)) / other.bounds().diagonal();
                assert!(off < 1e-8, "{name}, {options}, {scale}: {off:e}");
            }
        }
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let mesh = torus(90, 40);
    let region = hard_ends(&mesh);
    let poses = [1, 2, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solved(&ImplicitOptions::default(), &mesh, &region, &bend(&mesh, 1.0)))
    });
    assert!(poses[0] == poses[1] && poses[0] == poses[2]);
}

#[test]
fn a_drag_allocates_nothing() {
    let mesh = torus(40, 20);
    for soft in [false, true] {
        let handles = ends(&mesh).map(|end| if soft { Handle::soft(end, 2.0) } else { Handle::hard(end) });
        let mut implicit = prepare(&ImplicitOptions::default(), &mesh, &whole(&mesh, &handles));
        let mut pose = mesh.positions.clone();
        let all: Vec<Goals> = (0..5).map(|k| bend(&mesh, 0.1 * f64::from(k))).collect();
        implicit.solve(&all[0], &mut pose).expect("solvable");
        let info = measure(|| {
            for goals in &all {
                implicit.solve_preview(goals, &mut pose).expect("solvable");
                implicit.solve(goals, &mut pose).expect("solvable");
            }
        });
        assert_eq!(info.count_total, 0, "soft {soft}");
    }
}

#[test]
fn another_region_is_as_good_as_a_fresh_deformer() {
    let mesh = sheet(16, 8);
    let options = ImplicitOptions::default();
    let regions = [
        hard_ends(&mesh),
        held_by_ends(&mesh, &[Handle::soft(along_x(&mesh, 0.4..=0.5), 3.0)]),
        whole(&mesh, &[Handle::hard(along_x(&mesh, 0.0..=0.2))]),
    ];
    let mut kept = prepare(&options, &mesh, &regions[0]);
    for region in &regions {
        let report = kept.set_region(region).expect("valid");
        let mut fresh = prepare(&options, &mesh, region);
        assert_eq!(report, fresh.prepared());
        let goals = Goals::new(vec![similarity(&mesh); region.handles().len()]);
        let mut poses = [mesh.positions.clone(), mesh.positions.clone()];
        kept.solve(&goals, &mut poses[0]).expect("solvable");
        fresh.solve(&goals, &mut poses[1]).expect("solvable");
        assert!(poses[0] == poses[1]);
    }
    let n = mesh.vertex_count();
    let foreign =
        Region::new(n + 1, &VertexSet::all(n + 1), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
    let error = kept.set_region(&foreign).expect_err("another mesh");
    assert_eq!(error, DeformError::WrongCount { what: "vertices of the region", expected: n, found: n + 1 });
    let mut pose = mesh.positions.clone();
    kept.solve(&Goals::new(vec![similarity(&mesh)]), &mut pose).expect("still the last region");
}

#[test]
fn bad_options_and_huge_fans_are_refused() {
    let mesh = bar(2);
    for rings in [0, 9, u32::MAX] {
        let options = ImplicitOptions { rings, ..ImplicitOptions::default() };
        let error = Implicit::prepare(&options, &mesh, &hard_ends(&mesh)).err().expect("out of range");
        assert!(matches!(error, DeformError::BadOption { option: "rings", .. }), "{error}");
    }
    // All vertices of a fan are neighbours of neighbours.
    let around = 10_000;
    let rim = (0..around).map(|k| f64::from(k) / f64::from(around) * std::f64::consts::TAU);
    let positions = std::iter::once(DVec3::Z).chain(rim.map(|a| DVec3::new(a.cos(), a.sin(), 0.0))).collect();
    let triangles = (0..around).map(|k| [0, 1 + k, 1 + (k + 1) % around]).collect();
    let fan = TriMesh::new(positions, triangles).expect("valid");
    let region = whole(&fan, &[Handle::hard(VertexSet::from_iter([1, 2, 3]))]);
    let error = Implicit::prepare(&ImplicitOptions::default(), &fan, &region).err().expect("too many pairs");
    assert!(matches!(error, DeformError::TooLarge(_)), "{error}");
}

/// Every vertex in a hard handle; and with gradients alone every vertex of the region.
#[test]
fn handles_may_leave_nothing_free() {
    let mesh = sheet(8, 4);
    let all = whole(&mesh, &[Handle::hard(VertexSet::all(mesh.vertex_count()))]);
    let map = similarity(&mesh);
    let pose = solved(&ImplicitOptions::default(), &mesh, &all, &Goals::new(vec![map]));
    assert!(pose == apply(map, &mesh.positions));
    let middle = along_x(&mesh, 0.15..=0.85);
    let region = held_by_ends(&mesh, &[Handle::hard(middle)]);
    let options = ImplicitOptions { constraints: ImplicitConstraints::Gradients, ..ImplicitOptions::default() };
    let pose = solved(&options, &mesh, &region, &region.identity_goals());
    assert!(distance(&pose, &mesh.positions) < 1e-10);
}

#[test]
fn the_report_counts_what_the_paper_lists() {
    let bar = bar(4);
    let mut implicit = prepare(&ImplicitOptions::default(), &bar, &hard_ends(&bar));
    let mut pose = bar.positions.clone();
    implicit.solve(&bend(&bar, 0.5), &mut pose).expect("solvable");
    let report = implicit.report();
    let handles: usize = ends(&bar).iter().map(VertexSet::len).sum();
    assert_eq!(report.free_vertices, bar.vertex_count() - handles);
    // A quarter of the paper's bar; every vertex but those of the edges is in a plane.
    let share = report.degenerate_vertices as f64 / report.free_vertices as f64;
    assert!((0.1..0.5).contains(&share), "{share}");
    assert!(!report.solve_second.is_zero() && !report.svd.is_zero() && !report.factor_first.is_zero());
    implicit.solve_preview(&bend(&bar, 0.5), &mut pose).expect("solvable");
    assert!(implicit.report().solve_second.is_zero() && implicit.report().svd.is_zero());
    let torus = torus(30, 12);
    let report = prepare(&ImplicitOptions::default(), &torus, &hard_ends(&torus)).report();
    assert_eq!(report.degenerate_vertices, 0);
}
