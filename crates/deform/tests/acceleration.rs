//! Anderson acceleration finds the same shapes in fewer iterations.

mod common;

use common::{along_x, bar, distance, pyramid, sheet, torus, variants};
use glam::DVec3;
use pliant_deform::arap::{Acceleration, Arap, ArapOptions};
use pliant_deform::{DeformError, Deformer, Goals, Handle, Region, SolveReport};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

const ANDERSON: Acceleration = Acceleration::Anderson { window: 5 };

fn solve(mesh: &TriMesh, options: &ArapOptions, soft: bool, angle: f64) -> (Vec<DVec3>, SolveReport) {
    let n = mesh.vertex_count();
    let tip = along_x(mesh, 0.88..=1.0);
    let tip = if soft { Handle::soft(tip, 1.0) } else { Handle::hard(tip) };
    let region = Region::new(n, &VertexSet::all(n), &[Handle::hard(along_x(mesh, 0.0..=0.12)), tip]).expect("valid");
    let pivot = mesh.bounds().from_box(DVec3::new(0.95, 0.5, 0.5));
    let mut turn = Similarity::about(pivot, DVec3::new(0.3, 1.0, 0.5), angle, 1.0);
    turn.translation += DVec3::new(-0.1, 0.05, 0.2) * angle * mesh.bounds().diagonal() / 4.0;
    let mut pose = mesh.positions.clone();
    let mut arap = Arap::prepare(options, mesh, &region).expect("valid");
    let report = arap.solve(&Goals::new(vec![Similarity::IDENTITY, turn]), &mut pose).expect("solvable");
    (pose, report)
}

fn shapes() -> Vec<(&'static str, TriMesh)> {
    let small = torus(24, 10);
    let small = small.with_positions(small.positions.iter().map(|p| *p * 1e-6).collect()).expect("finite");
    vec![("sheet", sheet(16, 8)), ("torus", torus(24, 10)), ("small torus", small), ("bar", bar(4))]
}

#[test]
fn the_same_minimum_in_fewer_iterations() {
    for (name, mesh) in shapes() {
        for options in variants() {
            for soft in [false, true] {
                let options = ArapOptions { iterations: 20_000, tolerance: Some(1e-11), ..options.clone() };
                let faster = ArapOptions { acceleration: ANDERSON, ..options.clone() };
                let (plain, plain_report) = solve(&mesh, &options, soft, 0.8);
                let (fast, report) = solve(&mesh, &faster, soft, 0.8);
                assert!(report.converged && plain_report.converged);
                let (steps, plain_steps) = (report.iterations, plain_report.iterations);
                assert!(2 * steps < plain_steps, "{name}, {options:?}: {steps} and {plain_steps} iterations");
                let energies = [report, plain_report].map(|r| r.energy_after.expect("a tolerance is set"));
                // What the slower one has still to gain: some of its last gain over and over.
                assert!(energies[0] <= energies[1] * (1.0 + 1e-9), "{name}, {options:?}: {energies:?}");
                let off = distance(&plain, &fast) / mesh.bounds().diagonal();
                assert!(off < 1e-3, "{name}, {options:?}, soft {soft}: {off:e}");
            }
        }
    }
}

/// Nothing is known before the second iteration, and nothing is accelerated in the last.
#[test]
fn two_iterations_are_the_plain_ones() {
    for (name, mesh) in shapes() {
        for options in variants() {
            for iterations in 0..=2 {
                let options = ArapOptions { iterations, ..options.clone() };
                let (plain, _) = solve(&mesh, &options, false, 1.5);
                let (fast, report) =
                    solve(&mesh, &ArapOptions { acceleration: ANDERSON, ..options.clone() }, false, 1.5);
                assert_eq!(report.iterations, iterations);
                assert!(plain == fast, "{name}, {options:?}");
            }
        }
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let mesh = torus(90, 40);
    let options = ArapOptions { iterations: 12, acceleration: ANDERSON, ..ArapOptions::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| solve(&mesh, &options, true, 1.0))
    };
    assert!(run(1) == run(2) && run(1) == run(4));
}

/// No unknowns, one unknown, and more steps back than there are dimensions.
#[test]
fn windows_are_checked_and_small_systems_solved() {
    let mesh = pyramid();
    for window in [1, 5, 20] {
        let acceleration = Acceleration::Anderson { window };
        let options = ArapOptions { iterations: 60, acceleration, ..ArapOptions::default() };
        let (pose, report) = solve(&mesh, &options, false, 1.0);
        assert!(pose.iter().all(|p| p.is_finite()) && report.iterations == 60);
        let plain = ArapOptions { iterations: 2000, ..ArapOptions::default() };
        assert!(distance(&pose, &solve(&mesh, &plain, false, 1.0).0) < 1e-6);
    }
    let region = Region::new(5, &VertexSet::all(5), &[Handle::hard(VertexSet::all(5))]).expect("valid");
    for window in [0, 21] {
        let options = ArapOptions { acceleration: Acceleration::Anderson { window }, ..ArapOptions::default() };
        let refused = Arap::prepare(&options, &mesh, &region).err();
        assert!(matches!(refused, Some(DeformError::BadOption { option: "window", .. })), "{refused:?}");
    }
    let options = ArapOptions { iterations: 9, acceleration: ANDERSON, ..ArapOptions::default() };
    let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
    let mut pose = mesh.positions.clone();
    arap.solve(&Goals::new(vec![Similarity::translation(DVec3::X)]), &mut pose).expect("nothing to solve");
    let text = serde_json::to_string(&options).expect("plain data");
    assert_eq!(serde_json::from_str::<ArapOptions>(&text).expect("own text"), options);
}
