//! Smooth rotations (Levi and Gotsman 2015): what they keep, what they change, and their energy.

mod common;

use common::{along_x, bar, distance, sheet, torus, variants};
use glam::{DMat3, DVec3};
use pliant_deform::arap::{Acceleration, Arap, ArapOptions};
use pliant_deform::{Deformer, Goals, Handle, Region};
use pliant_mesh::{Similarity, TriMesh, VertexSet, best_rotation, face_area_vector, outer};

/// Every kind of weights and cells, smoothed.
fn smoothed(smoothness: f64) -> impl Iterator<Item = ArapOptions> {
    variants().into_iter().map(move |options| ArapOptions { smoothness, ..options })
}

fn ends(mesh: &TriMesh) -> Region {
    let n = mesh.vertex_count();
    let handles = [along_x(mesh, 0.0..=0.1), along_x(mesh, 0.9..=1.0)].map(Handle::hard);
    Region::new(n, &VertexSet::all(n), &handles).expect("valid")
}

fn bend(mesh: &TriMesh) -> Goals {
    Goals::new(vec![
        Similarity::IDENTITY,
        Similarity::about(mesh.bounds().centre(), DVec3::new(0.1, 1.0, 0.3), 1.2, 1.0),
    ])
}

fn solve(options: &ArapOptions, mesh: &TriMesh, goals: &Goals) -> Vec<DVec3> {
    let mut pose = mesh.positions.clone();
    Arap::prepare(options, mesh, &ends(mesh)).expect("valid").solve(goals, &mut pose).expect("solvable");
    pose
}

/// `sum_i sum_j |R_i - R_j|^2` over the vertices that count, with the best rotation of the spokes of each, all of weight 1.
fn variation(mesh: &TriMesh, pose: &[DVec3], counts: impl Fn(u32) -> bool) -> f64 {
    let topology = mesh.topology();
    let rotation = |i: usize| {
        let edges = topology.neighbours(i).iter().map(|&j| j as usize);
        best_rotation(
            edges.fold(DMat3::ZERO, |s, j| s + outer(pose[j] - pose[i], mesh.positions[j] - mesh.positions[i])),
        )
    };
    let rotations: Vec<DMat3> = (0..mesh.vertex_count()).map(rotation).collect();
    let square = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>();
    let edges = topology.edges().iter().filter(|e| e.iter().all(|&v| counts(v)));
    edges.map(|e| 2.0 * square(rotations[e[0] as usize] - rotations[e[1] as usize])).sum()
}

fn area(mesh: &TriMesh) -> f64 {
    (0..mesh.face_count()).map(|f| face_area_vector(mesh.corners(f)).length()).sum()
}

#[test]
fn rest_and_common_rigid_motions_are_reproduced() {
    for mesh in [bar(3), sheet(14, 7)] {
        for options in smoothed(0.01).chain(smoothed(10.0)) {
            for angle in [0.0, 1.0, 3.1] {
                let motion = Similarity::about(DVec3::new(1.0, 2.0, -1.0), DVec3::new(1.0, 0.5, -0.7), angle, 1.0);
                let pose = solve(&options, &mesh, &Goals::new(vec![motion; 2]));
                let expected: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
                assert!(distance(&pose, &expected) < 1e-11, "{options:?}, {angle}: {:e}", distance(&pose, &expected));
            }
        }
    }
}

/// In a region that is a part of the mesh, cells at its rim have neighbours without a rotation.
#[test]
fn a_part_of_the_mesh_is_enough() {
    let mesh = sheet(30, 8);
    let n = mesh.vertex_count();
    let (roi, tip) = (along_x(&mesh, 0.5..=1.0), along_x(&mesh, 0.9..=1.0));
    let region = Region::new(n, &roi, &[Handle::hard(tip)]).expect("valid");
    for options in smoothed(0.01) {
        let options = ArapOptions { iterations: 2000, tolerance: Some(0.0), ..options };
        let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
        let mut pose = mesh.positions.clone();
        let lift = Goals::new(vec![Similarity::about(mesh.bounds().centre(), DVec3::new(0.1, 1.0, 0.3), 0.5, 1.0)]);
        arap.solve(&lift, &mut pose).expect("solvable");
        assert!((0..n).all(|v| roi.contains(v as u32) || pose[v] == mesh.positions[v]));
        assert!(distance(&pose, &mesh.positions) > 0.1 && arap.energy(&lift, &pose).expect("valid") > 0.0);
        // And back: what is left is what the tolerance leaves.
        arap.solve(&region.identity_goals(), &mut pose).expect("solvable");
        assert!(distance(&pose, &mesh.positions) < 1e-6, "{:e}", distance(&pose, &mesh.positions));
    }
}

/// `alpha` is a pure number: the same pose at any scale, and an energy that grows as an area.
#[test]
fn the_scale_of_the_scene_does_not_matter() {
    for mesh in [bar(3), sheet(14, 7)] {
        for options in smoothed(0.02) {
            let pose = solve(&options, &mesh, &bend(&mesh));
            let energy = |mesh: &TriMesh, pose: &[DVec3], goals: &Goals| {
                Arap::prepare(&options, mesh, &ends(mesh)).expect("valid").energy(goals, pose).expect("valid")
            };
            let plain = energy(&mesh, &pose, &bend(&mesh));
            for scale in [1024.0, 1.0 / 1024.0] {
                let scaled = |points: &[DVec3]| -> Vec<DVec3> { points.iter().map(|p| *p * scale).collect() };
                let other = mesh.with_positions(scaled(&mesh.positions)).expect("finite");
                let other_pose = solve(&options, &other, &bend(&other));
                assert!(distance(&other_pose, &scaled(&pose)) < 1e-12 * scale * mesh.bounds().diagonal());
                // Cotangents are numbers, and weights of 1 too: energies are areas.
                let ratio = energy(&other, &other_pose, &bend(&other)) / plain;
                assert!((ratio / (scale * scale) - 1.0).abs() < 1e-9, "{ratio}");
            }
        }
    }
}

/// The rotations being best, the energy grows with `alpha` at first as if they stood still: by `A sum_i sum_j w |R_i - R_j|^2`.
#[test]
fn the_energy_is_that_of_the_paper() {
    for mesh in [bar(3), sheet(14, 7)] {
        let (region, goals) = (ends(&mesh), bend(&mesh));
        // Uniform weights, spokes.
        let options = variants().remove(0);
        let pose = solve(&options, &mesh, &goals);
        let energy = |smoothness| {
            let options = ArapOptions { smoothness, ..options.clone() };
            Arap::prepare(&options, &mesh, &region).expect("valid").energy(&goals, &pose).expect("valid")
        };
        // Cells of free vertices and of their neighbours.
        let counted = |v: u32| {
            let free = |v: u32| region.handles().iter().all(|handle| !handle.vertices.contains(v));
            free(v) || mesh.topology().neighbours(v as usize).iter().any(|&j| free(j))
        };
        let slope = area(&mesh) * variation(&mesh, &pose, counted);
        let (zero, alpha) = (energy(0.0), 1e-7);
        let measured = (energy(alpha) - zero) / alpha;
        // The next term is of the order of alpha, times a stiffness of some thousand.
        assert!((measured / slope - 1.0).abs() < 1e-3, "{measured} instead of {slope}");
        // Then less than that, as rotations give way, but never less than before.
        let energies = [1e-4, 1e-3, 1e-2, 1e-1].map(|alpha| (alpha, energy(alpha)));
        assert!(
            energies.iter().all(|(alpha, energy)| *energy < zero + alpha * slope && *energy > zero),
            "{energies:?}"
        );
        assert!(energies.windows(2).all(|pair| pair[0].1 < pair[1].1), "{energies:?}");
    }
}

/// Bends are spread: neighbouring rotations differ less, the more so the higher `alpha`; and nearly nothing changes with a tiny one.
#[test]
fn rotations_get_smoother() {
    for mesh in [bar(3), sheet(20, 10)] {
        for options in variants() {
            let converged = |smoothness| {
                let options = ArapOptions { smoothness, iterations: 3000, tolerance: Some(1e-8), ..options.clone() };
                solve(&options, &mesh, &bend(&mesh))
            };
            let plain = converged(0.0);
            let variations = [0.0, 1e-3, 1e-2].map(|smoothness| variation(&mesh, &converged(smoothness), |_| true));
            assert!(variations[1] < variations[0] && variations[2] < variations[1], "{options:?}: {variations:?}");
            let off = distance(&converged(1e-9), &plain) / mesh.bounds().diagonal();
            assert!(off < 1e-3, "{options:?}: {off:e}");
        }
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads_and_from_any_history() {
    let mesh = torus(90, 40);
    for acceleration in [Acceleration::None, Acceleration::Anderson { window: 5 }] {
        let options = ArapOptions { smoothness: 0.01, iterations: 6, acceleration, ..ArapOptions::default() };
        let poses = [1, 2, 4].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| solve(&options, &mesh, &bend(&mesh)))
        });
        assert!(poses[0] == poses[1] && poses[0] == poses[2]);
        // Rotations of an earlier solve, or for another region, leave no trace.
        let n = mesh.vertex_count();
        let other = Region::new(n, &VertexSet::all(n), &[Handle::soft(along_x(&mesh, 0.4..=0.6), 1.0)]).expect("valid");
        let mut arap = Arap::prepare(&options, &mesh, &other).expect("valid");
        let away = Goals::new(vec![Similarity::about(DVec3::ZERO, DVec3::Y, 2.0, 1.0)]);
        arap.solve(&away, &mut mesh.positions.clone()).expect("solvable");
        arap.set_region(&ends(&mesh)).expect("valid");
        let mut pose = mesh.positions.clone();
        arap.solve(&bend(&mesh), &mut pose).expect("solvable");
        assert!(pose == poses[0]);
    }
}
