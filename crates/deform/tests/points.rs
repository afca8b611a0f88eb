//! Points between vertices as handles.

mod common;

use common::dense::Dense;
use common::{acute_ball, along_x, bar, distance, sheet, torus, variants};
use glam::DVec3;
use pliant_deform::arap::{Acceleration, Arap, ArapEnergy, ArapOptions, Start};
use pliant_deform::{
    Constraint, DeformError, Deformer, DualLaplacianOptions, Goals, Handle, HandleFault, ImplicitOptions,
    LaplacianOptions, Method, PointRows, Region, RotationInvariantOptions, SolveReport,
};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

type Entries = Vec<(u32, f64)>;

/// A number in [0, 1) that looks random.
fn noise(k: usize) -> f64 {
    let x = (k as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((x ^ (x >> 32)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A point within each of the given faces, by barycentric coordinates.
fn within(mesh: &TriMesh, faces: impl IntoIterator<Item = usize>) -> Vec<Entries> {
    let row = |face: usize| {
        let [a, b] = [noise(2 * face), noise(2 * face + 1)].map(|x| 0.1 + 0.35 * x);
        mesh.triangles()[face].into_iter().zip([a, b, 1.0 - a - b]).collect()
    };
    faces.into_iter().map(row).collect()
}

/// As a binding has them: a vertex, its ring and the ring of one of its neighbours, with weights of both signs.
fn spread(mesh: &TriMesh, vertices: impl IntoIterator<Item = usize>) -> Vec<Entries> {
    let row = |v: usize| {
        let ring = mesh.topology().neighbours(v);
        let around = ring.iter().chain(mesh.topology().neighbours(ring[v % ring.len()] as usize)).copied();
        let mut row: Entries = around.enumerate().map(|(k, w)| (w, noise(v * 31 + k) - 0.1)).collect();
        row.push((v as u32, 2.0));
        let sum: f64 = row.iter().map(|(_, c)| c).sum();
        row.iter_mut().for_each(|(_, c)| *c /= sum);
        row
    };
    vertices.into_iter().map(row).collect()
}

fn rows(all: &[Entries]) -> PointRows {
    all.iter().cloned().collect()
}

fn at(row: &[(u32, f64)], pose: &[DVec3]) -> DVec3 {
    row.iter().map(|&(v, c)| c * pose[v as usize]).sum()
}

fn everywhere(mesh: &TriMesh, handles: &[Handle]) -> Region {
    Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), handles).expect("valid")
}

fn solve(options: &ArapOptions, mesh: &TriMesh, region: &Region, goals: &Goals) -> (Vec<DVec3>, SolveReport) {
    let mut pose = mesh.positions.clone();
    let mut arap = Arap::prepare(options, mesh, region).expect("valid");
    let report = arap.solve(goals, &mut pose).expect("solvable");
    (pose, report)
}

fn missed(rows: &[Entries], targets: &[DVec3], pose: &[DVec3]) -> f64 {
    rows.iter().zip(targets).map(|(row, target)| at(row, pose).distance(*target)).fold(0.0, f64::max)
}

fn tip_turn(mesh: &TriMesh) -> Similarity {
    let mut turn =
        Similarity::about(mesh.bounds().from_box(DVec3::new(0.9, 0.5, 0.5)), DVec3::new(0.2, 1.0, 0.4), 0.6, 1.0);
    turn.translation += DVec3::new(-0.2, 0.1, 0.3);
    turn
}

/// Against the system with multipliers, whose matrix is not even definite, and the soft one, both dense: hard and soft points, with hard
/// and soft vertices, some of them in the rows.
#[test]
fn agrees_with_the_dense_reference() {
    let mesh = acute_ball();
    let low = along_x(&mesh, 0.0..=0.15);
    let high: Vec<usize> = along_x(&mesh, 0.8..=1.0).iter().map(|v| v as usize).collect();
    let points = spread(&mesh, high.iter().copied().step_by(2));
    for second in [Constraint::Hard, Constraint::Soft(0.7), Constraint::Soft(300.0)] {
        for (vertices, options) in [Constraint::Hard, Constraint::Soft(0.5)]
            .into_iter()
            .flat_map(|first| variants().into_iter().map(move |options| (first, options)))
        {
            let first = Handle { constraint: vertices, ..Handle::hard(low.clone()) };
            // The first handle has a point of vertices next to it too.
            let mixed = Handle { rows: rows(&spread(&mesh, [low.as_slice()[0] as usize])), ..first.clone() };
            for first in [first, mixed] {
                let region = everywhere(&mesh, &[first.clone(), Handle::of_points(rows(&points), second)]);
                let dense = Dense::new(&mesh, &region, &options);
                let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
                let (mut pose, mut reference) = (mesh.positions.clone(), mesh.positions.clone());
                let turned = Goals::new(vec![Similarity::IDENTITY, tip_turn(&mesh)]);
                let mut targets: Vec<DVec3> = first.rows.iter().map(|row| at(row, &mesh.positions)).collect();
                targets.extend(points.iter().map(|row| at(row, &mesh.positions) + DVec3::new(0.3, 0.1, -0.4)));
                let pulled = Goals::with_points(turned.transforms.clone(), targets);
                for goals in [&turned, &region.identity_goals(), &pulled] {
                    arap.solve(goals, &mut pose).expect("solvable");
                    dense.solve(&options, goals, &mut reference);
                    let off = distance(&pose, &reference);
                    assert!(off < 1e-9, "{options:?}, {vertices:?}, {second:?}: off by {off:e}");
                }
            }
        }
    }
}

/// A row of one vertex is that vertex in a handle.
#[test]
fn a_unit_row_is_a_vertex() {
    for mesh in [sheet(12, 6), torus(20, 10)] {
        let anchor = Handle::hard(along_x(&mesh, 0.0..=0.1));
        let tips: Vec<u32> = along_x(&mesh, 0.85..=1.0).iter().step_by(5).collect();
        let unit: Vec<Entries> = tips.iter().map(|&v| vec![(v, 1.0)]).collect();
        for constraint in [Constraint::Hard, Constraint::Soft(0.3), Constraint::Soft(50.0)] {
            let vertices = Handle { constraint, ..Handle::hard(VertexSet::from_iter(tips.iter().copied())) };
            let points = Handle::of_points(rows(&unit), constraint);
            for (smoothness, start) in [(0.0, Start::Pose), (0.01, Start::Pose), (0.0, Start::Propagated)] {
                let options = ArapOptions { iterations: 5, smoothness, start, ..ArapOptions::default() };
                let goals = Goals::new(vec![Similarity::IDENTITY, tip_turn(&mesh)]);
                let by_vertex =
                    solve(&options, &mesh, &everywhere(&mesh, &[anchor.clone(), vertices.clone()]), &goals).0;
                let by_row = solve(&options, &mesh, &everywhere(&mesh, &[anchor.clone(), points.clone()]), &goals).0;
                let off = distance(&by_vertex, &by_row);
                // Lone vertices of a handle are next to free ones, so both have the same cells.
                assert!(off < 1e-10, "{options:?}, {constraint:?}: off by {off:e}");
            }
        }
    }
}

/// With points alone: from rest to rest, and along with any rigid motion, at any scale and place.
#[test]
fn rest_and_rigid_motions_are_exact() {
    for (scale, offset) in [(1.0, 0.0), (1e-9, 0.0), (1e9, 1e10), (1.0, 1e4)] {
        let mesh = bar(3);
        let moved = mesh.positions.iter().map(|p| scale * *p + DVec3::splat(offset)).collect();
        let mesh = mesh.with_positions(moved).expect("finite");
        let diagonal = mesh.bounds().diagonal();
        let rounding = 1e-12 * diagonal + 1e-15 * offset;
        let points = spread(&mesh, (0..mesh.vertex_count()).step_by(7));
        for constraint in [Constraint::Hard, Constraint::Soft(2.0)] {
            let region = everywhere(&mesh, &[Handle::of_points(rows(&points), constraint)]);
            let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &region.identity_goals());
            assert!(distance(&pose, &mesh.positions) < rounding);
            assert_eq!(report.unmet.is_some(), constraint == Constraint::Hard);
            let centre = mesh.bounds().from_box(DVec3::new(0.2, 1.0, 0.0));
            let motion = Similarity::about(centre, DVec3::new(1.0, 2.0, -1.0), 2.8, 1.0);
            let expected: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
            let targets: Vec<DVec3> = points.iter().map(|row| at(row, &expected)).collect();
            for goals in [Goals::new(vec![motion]), Goals::with_points(vec![Similarity::IDENTITY], targets)] {
                let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &goals);
                let off = distance(&pose, &expected);
                assert!(off < 20.0 * rounding, "{scale} {offset} {constraint:?}: {off:e}");
                assert!(report.unmet.is_none_or(|unmet| unmet < 20.0 * rounding));
            }
        }
    }
}

/// One point holds a component: it is moved along, and what it leaves open does not break anything.
#[test]
fn one_point_holds_a_component() {
    let mesh = torus(16, 8);
    let points = within(&mesh, [40]);
    let options = ArapOptions { iterations: 50, ..ArapOptions::default() };
    for constraint in [Constraint::Hard, Constraint::Soft(1e-3), Constraint::Soft(1e9)] {
        let region = everywhere(&mesh, &[Handle::of_points(rows(&points), constraint)]);
        let shift = DVec3::new(0.5, -2.0, 1.0);
        let goals = Goals::with_points(vec![Similarity::IDENTITY], vec![at(&points[0], &mesh.positions) + shift]);
        let (pose, _) = solve(&options, &mesh, &region, &goals);
        let expected: Vec<DVec3> = mesh.positions.iter().map(|p| *p + shift).collect();
        assert!(distance(&pose, &expected) < 1e-9, "{constraint:?}: {:e}", distance(&pose, &expected));
    }
}

/// Two bodies held by a point between them, and vertices without faces: what the point leaves open stays, and nothing fails.
#[test]
fn points_between_components_leave_no_hole() {
    let one = torus(12, 6);
    let n = one.vertex_count() as u32;
    let shift = DVec3::Z * 3.0;
    let mut positions: Vec<DVec3> =
        one.positions.iter().copied().chain(one.positions.iter().map(|p| *p + shift)).collect();
    positions.extend([DVec3::X * 5.0, DVec3::Y * 5.0]);
    let triangles = one.triangles().iter().copied().chain(one.triangles().iter().map(|t| t.map(|v| v + n))).collect();
    let mesh = TriMesh::new(positions, triangles).expect("valid");
    let between: Vec<Entries> = vec![vec![(3, 0.5), (n + 5, 0.25), (2 * n, 0.15), (2 * n + 1, 0.1)]];
    for constraint in [Constraint::Hard, Constraint::Soft(1.0)] {
        let region = everywhere(&mesh, &[Handle::of_points(rows(&between), constraint)]);
        assert_eq!(region.without_unconstrained(mesh.topology()).1, 0);
        let goals = Goals::with_points(vec![Similarity::IDENTITY], vec![at(&between[0], &mesh.positions) + DVec3::Y]);
        let options = ArapOptions { iterations: 100, ..ArapOptions::default() };
        let (pose, report) = solve(&options, &mesh, &region, &goals);
        assert!(pose.iter().all(|p| p.is_finite()) && distance(&pose, &mesh.positions) < 10.0);
        assert!(missed(&between, &goals.points, &pose) < 1e-8 && report.unmet.is_none_or(|unmet| unmet < 1e-10));
    }
    // Enough points for each: both come where they should.
    let each: Vec<Entries> = within(&mesh, [3, 30, 60, 144 + 5, 144 + 45, 144 + 100]);
    let mut all = each.clone();
    all.extend([vec![(2 * n, 0.5), (0, 0.5)], vec![(2 * n + 1, 0.5), (2 * n, 0.5)]]);
    let region = everywhere(&mesh, &[Handle::of_points(rows(&all), Constraint::Hard)]);
    let motion = Similarity::about(DVec3::ONE, DVec3::X, 1.0, 1.0);
    let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &Goals::new(vec![motion]));
    let expected: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
    assert!(distance(&pose, &expected) < 1e-10 && report.unmet < Some(1e-11));
}

/// As many points as vertices, with supports that overlap, taken along a bend: met to rounding. And three times as many.
#[test]
fn thousands_of_points() {
    let mesh = torus(100, 50);
    let n = mesh.vertex_count();
    let bend = |p: DVec3| {
        let turn = Similarity::about(DVec3::ZERO, DVec3::Y, 0.3 * p.x, 1.0);
        turn.apply(p)
    };
    for (points, many) in [(spread(&mesh, 0..n), true), (within(&mesh, (0..2 * n).step_by(2)), false)] {
        let region = everywhere(&mesh, &[Handle::of_points(rows(&points), Constraint::Hard)]);
        let targets: Vec<DVec3> = points.iter().map(|row| bend(at(row, &mesh.positions))).collect();
        let goals = Goals::with_points(vec![Similarity::IDENTITY], targets);
        let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &goals);
        let missed = missed(&points, &goals.points, &pose);
        let unmet = report.unmet.expect("hard");
        assert!((missed - unmet).abs() < 1e-12, "{missed} {unmet}");
        assert!(unmet < 1e-9 * mesh.bounds().diagonal(), "{many}: {unmet:e}");
    }
}

/// A point twice, a point that is the mean of two others, and three in every triangle: dependent, but what they ask for can be.
#[test]
fn dependent_points_are_met() {
    let mesh = sheet(12, 6);
    let anchor = Handle::hard(along_x(&mesh, 0.0..=0.1));
    let pair = within(&mesh, [100, 118]);
    let mean: Entries = pair.concat().iter().map(|&(v, c)| (v, 0.5 * c)).collect();
    let few = vec![pair[0].clone(), pair[0].clone(), pair[1].clone(), mean];
    let offsets = [DVec3::Z * 0.3, DVec3::Z * 0.3, DVec3::X * 0.2, DVec3::new(0.1, 0.0, 0.15)];
    let region = everywhere(&mesh, &[anchor.clone(), Handle::of_points(rows(&few), Constraint::Hard)]);
    let targets = few.iter().zip(offsets).map(|(row, off)| at(row, &mesh.positions) + off).collect();
    let goals = Goals::with_points(region.identity_goals().transforms, targets);
    let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &goals);
    assert!(missed(&few, &goals.points, &pose) < 1e-11 && report.unmet < Some(1e-11));

    let mut many = Vec::new();
    for k in 0..4 {
        let beyond = |t: &&[u32; 3]| t.iter().all(|&v| mesh.bounds().to_box(mesh.positions[v as usize]).x > 0.3);
        for t in mesh.triangles().iter().filter(beyond) {
            let [a, b] = [noise(k), noise(k + 9)].map(|x| 0.45 * x);
            many.push(t.iter().copied().zip([a, b, 1.0 - a - b]).collect());
        }
    }
    let region = everywhere(&mesh, &[anchor, Handle::of_points(rows(&many), Constraint::Hard)]);
    let motion = tip_turn(&mesh);
    let (_, report) = solve(&ArapOptions::default(), &mesh, &region, &Goals::new(vec![Similarity::IDENTITY, motion]));
    assert!(report.unmet < Some(1e-10), "{:?}", report.unmet);
}

/// What contradicts itself is met in the middle, and the rest as if nothing were wrong.
#[test]
fn contradictions_meet_in_the_middle() {
    let mesh = torus(20, 10);
    let anchor = Handle::hard(along_x(&mesh, 0.0..=0.1));
    let [point, other] = [within(&mesh, [8]), within(&mesh, [219])].map(|rows| rows[0].clone());
    let all = vec![point.clone(), point.clone(), other.clone()];
    let region = everywhere(&mesh, &[anchor.clone(), Handle::of_points(rows(&all), Constraint::Hard)]);
    let [a, b] = [&point, &other].map(|row| at(row, &mesh.positions));
    let goals = |targets| Goals::with_points(vec![Similarity::IDENTITY; 2], targets);
    let torn = goals(vec![a + DVec3::X, a + DVec3::Y, b]);
    let (pose, report) = solve(&ArapOptions::default(), &mesh, &region, &torn);
    let half = DVec3::new(0.5, 0.5, 0.0);
    assert!(at(&point, &pose).distance(a + half) < 1e-10 && at(&other, &pose).distance(b) < 1e-10);
    assert!((report.unmet.expect("hard") - 0.5_f64.sqrt()).abs() < 1e-10);
    // The same as one row to the middle.
    let alone = everywhere(&mesh, &[anchor, Handle::of_points(rows(&[point, other]), Constraint::Hard)]);
    let (single, _) = solve(&ArapOptions::default(), &mesh, &alone, &goals(vec![a + half, b]));
    // But for the initial motion, which counts the point twice; so compare where iterations end.
    let options = ArapOptions { iterations: 4000, ..ArapOptions::default() };
    let converged = [(&region, torn), (&alone, goals(vec![a + half, b]))]
        .map(|(region, goals)| solve(&options, &mesh, region, &goals).0);
    assert!(distance(&converged[0], &converged[1]) < 1e-6, "{:e}", distance(&converged[0], &converged[1]));
    assert!(single.iter().all(|p| p.is_finite()));
    // Random wishes, more than there are vertices: least squares, so no wish's gradient is left.
    let many = within(&mesh, 0..mesh.face_count());
    let region = everywhere(&mesh, &[Handle::of_points(rows(&many), Constraint::Hard)]);
    let wishes = (0..many.len())
        .map(|k| at(&many[k], &mesh.positions) + 0.1 * DVec3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2)));
    let (pose, report) = solve(
        &ArapOptions::default(),
        &mesh,
        &region,
        &Goals::with_points(vec![Similarity::IDENTITY], wishes.collect()),
    );
    assert!(pose.iter().zip(&mesh.positions).all(|(p, q)| p.distance(*q) < 1.0));
    assert!(report.unmet.is_some_and(|unmet| (1e-3..0.3).contains(&unmet)), "{report:?}");
}

/// Fixed vertices keep their bits, also those in rows; the same bits for any number of threads, and on a second run.
#[test]
fn fixed_bits_and_determinism() {
    let mesh = torus(90, 40);
    let roi = along_x(&mesh, 0.3..=1.0);
    let points =
        spread(&mesh, along_x(&mesh, 0.3..=0.32).iter().chain(along_x(&mesh, 0.9..=1.0).iter()).map(|v| v as usize));
    let inside = |row: &Entries| row.iter().any(|(v, _)| roi.contains(*v));
    let points: Vec<Entries> = points.into_iter().filter(inside).collect();
    for (constraint, window) in [(Constraint::Hard, None), (Constraint::Soft(3.0), None), (Constraint::Hard, Some(5))] {
        let handle = Handle::of_points(rows(&points), constraint);
        let region = Region::new(mesh.vertex_count(), &roi, &[handle]).expect("valid");
        let targets = points.iter().map(|row| at(row, &mesh.positions) + DVec3::Z * 0.1 * (at(row, &mesh.positions).x));
        let goals = Goals::with_points(vec![Similarity::IDENTITY], targets.collect());
        let acceleration = window.map_or(Acceleration::None, |window| Acceleration::Anderson { window });
        let options = ArapOptions { iterations: 6, acceleration, ..ArapOptions::default() };
        let poses: Vec<Vec<DVec3>> = [1, 2, 5]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| solve(&options, &mesh, &region, &goals).0)
            })
            .into();
        assert!(poses.iter().all(|pose| *pose == poses[0]));
        assert!(distance(&poses[0], &mesh.positions) > 0.05);
        for v in (0..mesh.vertex_count()).filter(|&v| !roi.contains(v as u32)) {
            assert_eq!(poses[0][v], mesh.positions[v]);
        }
    }
}

/// The energy falls from iteration to iteration: hard, soft, accelerated, smoothed.
#[test]
fn the_energy_never_rises() {
    for mesh in [bar(4), sheet(16, 8)] {
        let anchor = Handle::soft(along_x(&mesh, 0.0..=0.1), 5.0);
        let points = spread(&mesh, along_x(&mesh, 0.85..=1.0).iter().map(|v| v as usize).step_by(3));
        for constraint in [Constraint::Hard, Constraint::Soft(0.5)] {
            let region = everywhere(&mesh, &[anchor.clone(), Handle::of_points(rows(&points), constraint)]);
            let goals = Goals::new(vec![Similarity::IDENTITY, tip_turn(&mesh)]);
            for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
                for (smoothness, window) in [(0.0, None), (0.0, Some(5)), (0.01, None), (0.01, Some(3))] {
                    let acceleration = window.map_or(Acceleration::None, |window| Acceleration::Anderson { window });
                    let basis = ArapOptions { energy, smoothness, acceleration, ..ArapOptions::default() };
                    let mut last = f64::INFINITY;
                    for iterations in [1, 2, 3, 5, 8, 13, 30, 80] {
                        let options = ArapOptions { iterations, tolerance: Some(0.0), ..basis.clone() };
                        let (_, report) = solve(&options, &mesh, &region, &goals);
                        let now = report.energy_after.expect("asked for");
                        assert!(now <= last * (1.0 + 1e-9), "{options:?}, {constraint:?}: {last} -> {now}");
                        last = now;
                    }
                }
            }
        }
    }
}

/// Rows come, go, move and change between hard and soft; solutions are those of a fresh deformer.
#[test]
fn other_rows_in_a_prepared_edit() {
    let mesh = torus(24, 12);
    let anchor = Handle::hard(along_x(&mesh, 0.0..=0.1));
    let tip = along_x(&mesh, 0.9..=1.0);
    let [near, far] = [7, 3].map(|step| spread(&mesh, tip.iter().map(|v| v as usize).step_by(step)));
    let mut shifted = near.clone();
    for row in &mut shifted {
        let count = row.len() as f64;
        row.iter_mut().for_each(|(_, c)| *c = 1.0 / count);
    }
    let stages: Vec<Vec<Handle>> = vec![
        vec![anchor.clone(), Handle::of_points(rows(&near), Constraint::Hard)],
        vec![anchor.clone(), Handle::of_points(rows(&near), Constraint::Soft(4.0))],
        vec![anchor.clone(), Handle::of_points(rows(&shifted), Constraint::Hard)],
        vec![anchor.clone(), Handle { rows: rows(&far), ..Handle::hard(VertexSet::from_iter([tip.as_slice()[0]])) }],
        vec![anchor.clone(), Handle::hard(tip.clone())],
        vec![anchor.clone(), Handle::of_points(rows(&near), Constraint::Hard)],
    ];
    let goals = Goals::new(vec![Similarity::IDENTITY, tip_turn(&mesh)]);
    let options =
        ArapOptions { acceleration: Acceleration::Anderson { window: 3 }, iterations: 4, ..ArapOptions::default() };
    let mut arap = Arap::prepare(&options, &mesh, &everywhere(&mesh, &stages[4])).expect("valid");
    for handles in &stages {
        let region = everywhere(&mesh, handles);
        arap.set_region(&region).expect("valid");
        let mut pose = mesh.positions.clone();
        let report = arap.solve(&goals, &mut pose).expect("solvable");
        let (fresh, fresh_report) = solve(&options, &mesh, &region, &goals);
        assert_eq!((report, pose), (fresh_report, fresh));
    }
}

#[test]
fn bad_points_are_named() {
    let mesh = sheet(4, 2);
    let (n, all) = (mesh.vertex_count(), VertexSet::all(mesh.vertex_count()));
    let fine: Entries = vec![(0, 0.5), (1, 0.5)];
    let fault = |roi: &VertexSet, bad: Entries| {
        let handle = Handle::of_points(rows(&[fine.clone(), bad]), Constraint::Hard);
        match Region::new(n, roi, &[handle]) {
            Err(DeformError::Handle { handle: 0, fault }) => fault,
            other => panic!("{other:?}"),
        }
    };
    let outside = HandleFault::RowVertexOutOfRange { row: 1, vertex: 99, vertices: n };
    assert_eq!(fault(&all, vec![(1, 0.5), (99, 0.5)]), outside);
    for weight in [f64::NAN, f64::INFINITY] {
        assert_eq!(fault(&all, vec![(0, weight), (1, 0.5)]), HandleFault::RowNotFinite { row: 1 });
    }
    assert_eq!(fault(&all, vec![]), HandleFault::RowSum { row: 1, sum: 0.0 });
    assert_eq!(fault(&all, vec![(2, 1.001)]), HandleFault::RowSum { row: 1, sum: 1.001 });
    assert!(matches!(fault(&all, vec![(0, 1e300), (1, -1e300), (2, 1.0)]), HandleFault::RowSum { row: 1, .. }));
    let left = VertexSet::from_iter([0, 1, 2]);
    assert_eq!(fault(&left, vec![(7, 0.5), (8, 0.5)]), HandleFault::RowOutsideRegion { row: 1 });
    let nothing = Handle::of_points(PointRows::new(), Constraint::Hard);
    let empty = DeformError::Handle { handle: 0, fault: HandleFault::Empty };
    assert_eq!(Region::new(n, &all, &[nothing]), Err(empty));
    let weightless = Handle::of_points(rows(std::slice::from_ref(&fine)), Constraint::Soft(0.0));
    assert!(Region::new(n, &all, &[weightless]).is_err());

    let region = everywhere(&mesh, &[Handle::of_points(rows(&[fine]), Constraint::Hard)]);
    let mut arap = Arap::prepare(&ArapOptions::default(), &mesh, &region).expect("valid");
    let mut pose = mesh.positions.clone();
    let mut refused = |points: Vec<DVec3>| {
        let error =
            arap.solve(&Goals::with_points(vec![Similarity::IDENTITY], points), &mut pose).expect_err("refused");
        assert_eq!(pose, mesh.positions);
        error
    };
    let count = DeformError::WrongCount { what: "points", expected: 1, found: 2 };
    assert_eq!(refused(vec![DVec3::ZERO; 2]), count);
    for bad in [DVec3::NAN, DVec3::X * f64::INFINITY, DVec3::splat(1e300)] {
        let target = DeformError::Handle { handle: 0, fault: HandleFault::Target { row: 0 } };
        assert_eq!(refused(vec![bad]), target);
    }
    for method in [
        Method::Laplacian(LaplacianOptions::default()),
        Method::Implicit(ImplicitOptions::default()),
        Method::DualLaplacian(DualLaplacianOptions::default()),
        Method::RotationInvariant(RotationInvariantOptions::default()),
    ] {
        let error = method.prepare(&mesh, &region).err();
        assert_eq!(error, Some(DeformError::PointsNotTaken { handle: 0 }), "{method}");
    }
}
