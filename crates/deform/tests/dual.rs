//! Deformation by the dual Laplacian: what it reproduces, where it ends, and what it refuses.

mod common;

use std::f64::consts::PI;

use common::{along_x, bar, sheet, torus};
use glam::DVec3;
use pliant_deform::dual::DualLaplacian;
use pliant_deform::{
    DeformError, Deformer, DualHeights, DualLaplacianOptions, Goals, Handle, LinearSolver, Method, Region,
};
use pliant_mesh::{Similarity, TriMesh, VertexSet, shapes};

fn options() -> DualLaplacianOptions {
    DualLaplacianOptions::default()
}

/// A tetrahedron and an octahedron: two stencils of the first share all their faces, and the second has three colours.
fn small() -> Vec<TriMesh> {
    let octahedron = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let eighths = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let tetrahedron = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    vec![
        TriMesh::new(tetrahedron, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("valid"),
        TriMesh::new(octahedron.to_vec(), eighths.to_vec()).expect("valid"),
    ]
}

/// Strips, fins of three faces at an edge, lone triangles, and a bar squeezed to needles a thousand times longer than wide.
fn awkward() -> Vec<TriMesh> {
    let strip: Vec<DVec3> =
        (0..12).map(|i| DVec3::new(f64::from(i / 2), f64::from(i % 2), 0.1 * f64::from(i * i % 5))).collect();
    let faces = (0..10).map(|i| if i % 2 == 0 { [i, i + 1, i + 2] } else { [i + 1, i, i + 2] });
    let strip = TriMesh::new(strip, faces.collect()).expect("valid");
    let mut fin_positions = sheet(8, 4).positions;
    let mut fin_faces = sheet(8, 4).triangles().to_vec();
    let [a, b] = sheet(8, 4).topology().edges()[40];
    fin_positions.push(fin_positions[a as usize] + DVec3::new(0.02, 0.03, 0.4));
    fin_faces.push([a, b, fin_positions.len() as u32 - 1]);
    let fin = TriMesh::new(fin_positions, fin_faces).expect("valid");
    let lone = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::new(0.4, 1.0, 0.0)], vec![[0, 1, 2]]).expect("valid");
    let bar = bar(3);
    let squeezed = bar.positions.iter().map(|p| DVec3::new(p.x, 1e-3 * p.y, p.z)).collect();
    vec![strip, fin, lone, bar.with_positions(squeezed).expect("finite")]
}

fn ends(mesh: &TriMesh, low: impl Fn(VertexSet) -> Handle, high: impl Fn(VertexSet) -> Handle) -> Region {
    let n = mesh.vertex_count();
    Region::new(n, &VertexSet::all(n), &[low(along_x(mesh, 0.0..=0.15)), high(along_x(mesh, 0.85..=1.0))])
        .expect("valid")
}

fn solve(options: &DualLaplacianOptions, mesh: &TriMesh, region: &Region, goals: &Goals) -> Vec<DVec3> {
    let mut pose = mesh.positions.clone();
    let mut deformer = DualLaplacian::prepare(options, mesh, region).expect("valid");
    deformer.solve(goals, &mut pose).expect("solvable");
    pose
}

fn off(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
}

fn moved(mesh: &TriMesh, motion: Similarity) -> Vec<DVec3> {
    mesh.positions.iter().map(|p| motion.apply(*p)).collect()
}

/// Closed, open, tiny and awkward meshes; hard, soft and mixed handles; any angle. The first solve meets it.
#[test]
fn rest_and_common_rigid_motions_are_reproduced() {
    let mut meshes = vec![torus(24, 10), bar(4), sheet(16, 9), shapes::cactus(800).expect("in range")];
    meshes.extend(small());
    meshes.extend(awkward());
    for (k, mesh) in meshes.iter().enumerate() {
        let soft = |weight| move |vertices| Handle::soft(vertices, weight);
        let mut regions = vec![
            ends(mesh, Handle::hard, Handle::hard),
            ends(mesh, soft(1.0), soft(1.0)),
            ends(mesh, soft(1e-3), Handle::hard),
        ];
        // Two vertices alone leave a turn about their line open.
        regions.retain(|region| region.handles().iter().map(|handle| handle.vertices.len()).sum::<usize>() > 2);
        assert_eq!(regions.is_empty(), mesh.vertex_count() == 6 || mesh.vertex_count() == 3);
        for (region, heights) in regions.iter().zip([DualHeights::Kept, DualHeights::Recomputed, DualHeights::Kept]) {
            let options = DualLaplacianOptions { heights, ..options() };
            for angle in [0.0, 1.0, PI, 4.0] {
                let motion = Similarity {
                    translation: if angle == 0.0 { DVec3::ZERO } else { DVec3::new(3.0, -1.0, 0.5) },
                    ..Similarity::about(DVec3::ZERO, DVec3::new(1.0, 0.5, -0.7), angle, 1.0)
                };
                let pose = solve(&options, mesh, region, &Goals::new(vec![motion; 2]));
                let error = off(&pose, &moved(mesh, motion)) / mesh.bounds().diagonal();
                // Rounding of the best rotation, times the condition number of A.
                assert!(error < 1e-9, "mesh {k}, {heights:?}, angle {angle}: {error:e}");
            }
        }
    }
}

/// A band of an open sheet, with the rest fixed: it returns to rest from a pose in which only the band was spoilt, and does not see what
/// is more than three rings away.
#[test]
fn a_region_sees_three_rings_round_it() {
    let mesh = sheet(40, 12);
    let n = mesh.vertex_count();
    let band = along_x(&mesh, 0.4..=0.6);
    let handle = Handle::hard(along_x(&mesh, 0.49..=0.51));
    let region = Region::new(n, &band, &[handle]).expect("valid");
    let mut deformer = DualLaplacian::prepare(&options(), &mesh, &region).expect("valid");
    let mut pose = mesh.positions.clone();
    let lift = Goals::new(vec![Similarity {
        translation: DVec3::new(0.0, 0.05, 0.2),
        ..Similarity::about(DVec3::ZERO, DVec3::Z, 0.1, 1.0)
    }]);
    deformer.solve(&lift, &mut pose).expect("solvable");
    assert!(off(&pose, &mesh.positions) > 0.05);
    assert!((0..n).all(|v| band.contains(v as u32) || pose[v] == mesh.positions[v]));
    let bent = pose.clone();
    let tight = DualLaplacianOptions { tolerance: Some(1e-12), iterations: 2000, ..options() };
    let mut exact = DualLaplacian::prepare(&tight, &mesh, &region).expect("valid");
    assert!(exact.solve(&region.identity_goals(), &mut pose).expect("solvable").converged);
    // The remaining way is the tolerance over 1 less the contraction.
    assert!(off(&pose, &mesh.positions) < 1e-9, "{:e}", off(&pose, &mesh.positions));

    // The same with everything crumpled that is four or more columns away.
    let near = along_x(&mesh, 0.4 - 3.4 / 40.0..=0.6 + 3.4 / 40.0);
    let crumpled = |positions: &[DVec3]| -> Vec<DVec3> {
        let crumple = |v: usize| if near.contains(v as u32) { 0.0 } else { 0.01 * (v as f64).sin() };
        positions.iter().enumerate().map(|(v, p)| *p + DVec3::Z * crumple(v)).collect()
    };
    let other = mesh.with_positions(crumpled(&mesh.positions)).expect("finite");
    let mut pose = other.positions.clone();
    let mut deformer = DualLaplacian::prepare(&options(), &other, &region).expect("valid");
    deformer.solve(&lift, &mut pose).expect("solvable");
    // Frames differ by the bounds, so not bit for bit.
    assert!(band.iter().all(|v| pose[v as usize].distance(bent[v as usize]) < 1e-11));
}

/// Iterations end, and where they end the next solve stays.
#[test]
fn iterations_end_at_a_fixed_point() {
    for mesh in [bar(4), sheet(20, 10), shapes::cactus(800).expect("in range")] {
        let region = ends(&mesh, Handle::hard, Handle::hard);
        let turn = Similarity::about(mesh.bounds().centre(), DVec3::new(0.3, 0.2, 1.0), 0.8, 1.0);
        let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
        let tight = DualLaplacianOptions { tolerance: Some(1e-11), iterations: 3000, ..options() };
        let mut deformer = DualLaplacian::prepare(&tight, &mesh, &region).expect("valid");
        let mut pose = mesh.positions.clone();
        let first = deformer.solve(&goals, &mut pose).expect("solvable");
        assert!(first.converged && first.iterations > 10, "{first:?}");
        let end = pose.clone();
        let again = deformer.solve(&goals, &mut pose).expect("solvable");
        assert!(again.iterations <= 2, "{again:?}");
        assert!(off(&pose, &end) < 1e-10 * mesh.bounds().diagonal());
        // The default tolerance ends earlier, and as near as the slowest contraction seen (0.95) lets it.
        let mut pose = mesh.positions.clone();
        let mut deformer =
            DualLaplacian::prepare(&DualLaplacianOptions { iterations: 500, ..options() }, &mesh, &region)
                .expect("valid");
        let early = deformer.solve(&goals, &mut pose).expect("solvable");
        assert!(early.converged && early.iterations < first.iterations / 2, "{early:?} {first:?}");
        assert!(off(&pose, &end) < 30.0 * 1e-4 * mesh.bounds().diagonal(), "{:e}", off(&pose, &end));
    }
}

/// Kept heights are nearer to those at rest than recomputed ones, which follow wherever the surface goes.
#[test]
fn kept_heights_are_kept() {
    for mesh in [shapes::cylinder(0.4, 3.0, 20, 40, 4).expect("valid size"), shapes::cactus(1500).expect("in range")] {
        let n = mesh.vertex_count();
        let axis = mesh.bounds().size().max_position();
        let along = |v: u32| mesh.bounds().to_box(mesh.positions[v as usize])[axis];
        let ends = [VertexSet::where_true(n, |v| along(v) < 0.1), VertexSet::where_true(n, |v| along(v) > 0.9)]
            .map(Handle::hard);
        let region = Region::new(n, &VertexSet::all(n), &ends).expect("valid");
        let turn = Similarity::about(mesh.bounds().centre(), DVec3::X, 0.8, 1.0);
        let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
        let topology = mesh.topology();
        // How far each face's barycentre is above the plane of its neighbours'.
        let heights = |pose: &[DVec3]| -> Vec<f64> {
            let centre = |f: usize| topology.triangles()[f].map(|v| pose[v as usize]).iter().sum::<DVec3>() / 3.0;
            let height = |f: usize| {
                let [a, b, c] = topology.face_edges(f).map(|e| {
                    let faces = topology.edge_faces(e as usize);
                    centre(if faces[0] as usize == f { faces[1] } else { faces[0] } as usize)
                });
                (centre(f) - a).dot((b - a).cross(c - a).normalize_or_zero())
            };
            (0..mesh.face_count()).map(height).collect()
        };
        let rest = heights(&mesh.positions);
        let changes = [DualHeights::Kept, DualHeights::Recomputed].map(|kind| {
            let options = DualLaplacianOptions { heights: kind, iterations: 100, tolerance: None, ..options() };
            let now = heights(&solve(&options, &mesh, &region, &goals));
            let square = |h: &[f64]| h.iter().map(|h| h * h).sum::<f64>();
            let change: Vec<f64> = now.iter().zip(&rest).map(|(h, rest)| h - rest).collect();
            (square(&change) / square(&rest)).sqrt()
        });
        assert!(changes[0] < 0.05 && changes[0] < 0.7 * changes[1], "{changes:?}");
    }
}

#[test]
fn all_solvers_agree() {
    for mesh in [torus(24, 10), sheet(16, 9)] {
        for soft in [false, true] {
            let hold = |vertices| if soft { Handle::soft(vertices, 1.0) } else { Handle::hard(vertices) };
            let region = ends(&mesh, Handle::hard, hold);
            let turn = Similarity::about(DVec3::ZERO, DVec3::new(0.2, 1.0, 0.1), 0.6, 1.0);
            let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
            let mut results = Vec::new();
            for solver in [LinearSolver::Cholesky, LinearSolver::Pcg, LinearSolver::Pbcg] {
                let options = DualLaplacianOptions { solver, iterations: 8, tolerance: None, ..options() };
                let mut pose = mesh.positions.clone();
                let mut deformer = DualLaplacian::prepare(&options, &mesh, &region).expect("valid");
                let report = deformer.solve(&goals, &mut pose).expect("solvable");
                results.push((pose, report.solver_iterations));
                assert_eq!(report.iterations, 8);
                assert_eq!(deformer.prepared().factor_len > 0, solver == LinearSolver::Cholesky);
            }
            assert_eq!(results[0].1, None);
            // Nine solves; after the first each starts from the one before.
            for (pose, count) in &results[1..] {
                assert!(count.is_some_and(|count| count > 90), "{count:?}");
                // A residual of 1e-10, times the square root of the condition of the normal equations, below 1e5.
                assert!(off(pose, &results[0].0) < 1e-6, "{:e}", off(pose, &results[0].0));
            }
        }
    }
}

/// Three colours leave an octahedron with one held vertex undetermined, if nothing but barycentres is kept.
#[test]
fn only_the_truly_undetermined_is_refused() {
    let octahedron = small().remove(1);
    let region = Region::new(6, &VertexSet::from_iter(1..6), &[]).expect("valid");
    let bare = DualLaplacianOptions { primal_weight: 0.0, ..options() };
    let refused = DualLaplacian::prepare(&bare, &octahedron, &region).err().expect("singular");
    assert!(matches!(refused, DeformError::Singular { vertex: 1..6 }), "{refused}");
    for mesh in small().iter().chain(&awkward()) {
        let n = mesh.vertex_count();
        let region = Region::new(n, &VertexSet::where_true(n, |v| v > 0), &[]).expect("valid");
        let pose = solve(&options(), mesh, &region, &region.identity_goals());
        assert!(off(&pose, &mesh.positions) < 1e-8 * mesh.bounds().diagonal(), "{:e}", off(&pose, &mesh.positions));
    }
    // Two pieces, one of them held nowhere.
    let both = TriMesh::new([bar(1).positions, bar(1).positions].concat(), {
        let shift = bar(1).vertex_count() as u32;
        bar(1).triangles().iter().copied().chain(bar(1).triangles().iter().map(|t| t.map(|v| v + shift))).collect()
    })
    .expect("valid");
    let all = VertexSet::all(both.vertex_count());
    let region = Region::new(both.vertex_count(), &all, &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
    let refused = DualLaplacian::prepare(&options(), &both, &region).err().expect("a piece hangs free");
    let count = bar(1).vertex_count();
    assert_eq!(refused, DeformError::Unconstrained { vertex: count as u32, count });
}

#[test]
fn options_are_checked_and_have_a_text_form() {
    let mesh = bar(1);
    let region = ends(&mesh, Handle::hard, Handle::hard);
    for bad in [
        DualLaplacianOptions { tolerance: Some(-1.0), ..options() },
        DualLaplacianOptions { tolerance: Some(f64::NAN), ..options() },
        DualLaplacianOptions { primal_weight: f64::INFINITY, ..options() },
        DualLaplacianOptions { primal_weight: -0.1, ..options() },
        DualLaplacianOptions { iterations: u32::MAX, ..options() },
    ] {
        let refused = DualLaplacian::prepare(&bad, &mesh, &region).err().expect("bad option");
        assert!(matches!(refused, DeformError::BadOption { .. }), "{refused}");
    }
    let all = DualLaplacianOptions {
        heights: DualHeights::Recomputed,
        solver: LinearSolver::Pbcg,
        iterations: 7,
        tolerance: Some(2.5e-5),
        primal_weight: 0.125,
    };
    for (options, text) in [
        (options(), "dual"),
        (DualLaplacianOptions::faithful(), "dual:pbcg+primal-weight=0e0"),
        (DualLaplacianOptions { tolerance: None, solver: LinearSolver::Pcg, ..options() }, "dual:pcg+no-tolerance"),
        (all, "dual:recomputed-heights+pbcg+iterations=7+tolerance=2.5e-5+primal-weight=1.25e-1"),
    ] {
        let method = Method::DualLaplacian(options);
        assert_eq!(method.to_string(), text);
        assert_eq!(text.parse::<Method>(), Ok(method.clone()));
        let json = serde_json::to_string(&method).expect("serialisable");
        assert_eq!(serde_json::from_str::<Method>(&json).expect("readable"), method);
    }
    let error = "dual:spokes".parse::<Method>().expect_err("not an option of this method").to_string();
    assert!(error.contains("'spokes'") && error.contains("recomputed-heights"), "{error}");
}

/// A goal as far as can be computed with, handles on one point, and faces without area: an error or finite positions.
#[test]
fn nothing_comes_out_that_is_not_finite() {
    let mesh = bar(2);
    let flat = mesh
        .with_positions(mesh.positions.iter().map(|p| DVec3::new(p.x.round(), 0.0, p.z)).collect())
        .expect("finite");
    let point = mesh.with_positions(vec![DVec3::ONE; mesh.vertex_count()]).expect("finite");
    for shape in [&mesh, &flat, &point] {
        let region = ends(&mesh, Handle::hard, Handle::hard);
        let mut deformer = DualLaplacian::prepare(&options(), shape, &region).expect("the vertices' rows hold it");
        for goal in [
            Similarity::IDENTITY,
            Similarity::translation(DVec3::splat(1e90)),
            Similarity::translation(DVec3::NEG_X * 4.0),
            Similarity::about(DVec3::ZERO, DVec3::Y, PI, 1e-9),
        ] {
            let mut pose = shape.positions.clone();
            match deformer.solve(&Goals::new(vec![Similarity::IDENTITY, goal]), &mut pose) {
                Ok(_) => assert!(pose.iter().all(|p| p.is_finite())),
                Err(error) => assert!(pose == shape.positions, "{error}"),
            }
        }
    }
}
