//! As-rigid-as-possible deformation started from the turns of the handles.

mod common;

use std::f64::consts::PI;

use common::{along_x, bar, distance, pyramid, sheet, torus, twist, variants};
use glam::DVec3;
use pliant_deform::arap::{Acceleration, Arap, ArapEnergy, ArapOptions, Start};
use pliant_deform::{Deformer, Goals, Handle, Region};
use pliant_mesh::{Similarity, TriMesh, VertexSet, shapes};

fn propagated() -> impl Iterator<Item = ArapOptions> {
    variants().into_iter().map(|options| ArapOptions { start: Start::Propagated, ..options })
}

fn two_ends(mesh: &TriMesh) -> Region {
    let ends = [0.0..=0.12, 0.88..=1.0].map(|range| Handle::hard(along_x(mesh, range)));
    Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &ends).expect("valid")
}

fn solve(options: &ArapOptions, mesh: &TriMesh, region: &Region, goals: &Goals, pose: &mut [DVec3]) {
    Arap::prepare(options, mesh, region).expect("valid").solve(goals, pose).expect("solvable");
}

/// The second end of a bar along x is turned by `degrees` about its axis.
fn twisted(mesh: &TriMesh, degrees: f64) -> Goals {
    let angle = degrees.to_radians();
    let turn = Similarity::about(mesh.bounds().centre(), DVec3::X, angle, 1.0);
    Goals::with_turns(vec![Similarity::IDENTITY, turn], vec![DVec3::ZERO, DVec3::X * angle])
}

/// In one jump from rest, and again from the result; told of no turns, the bar does not know of full ones.
#[test]
fn a_turn_by_720_degrees_twists_the_bar_by_720_degrees() {
    let mesh = shapes::bar(80, 2, 2, DVec3::new(10.0, 0.4, 0.4)).expect("valid size");
    let region = two_ends(&mesh);
    for degrees in [90.0, 270.0, 720.0, -720.0] {
        let goals = twisted(&mesh, degrees);
        for options in propagated() {
            for iterations in [0, 2, 20] {
                let options = ArapOptions { iterations, ..options.clone() };
                let mut pose = mesh.positions.clone();
                for _ in 0..2 {
                    solve(&options, &mesh, &region, &goals, &mut pose);
                    let found = twist(&mesh, &pose).to_degrees();
                    assert!((found - degrees).abs() < 1e-6, "{options}: {found} instead of {degrees}");
                }
            }
            let from_pose = ArapOptions { start: Start::Pose, ..options };
            let mut pose = mesh.positions.clone();
            solve(&from_pose, &mesh, &region, &goals, &mut pose);
            let untold = twist(&mesh, &pose).to_degrees();
            assert!(degrees == 90.0 || (untold - degrees).abs() > 180.0, "{untold}");
        }
    }
}

/// Every full turn is there: the energy grows as that of a twisted bar does, and iterations only lower it.
#[test]
fn the_energy_of_a_twist_grows_with_its_square() {
    let mesh = shapes::bar(80, 2, 2, DVec3::new(10.0, 0.4, 0.4)).expect("valid size");
    let region = two_ends(&mesh);
    let energy = |options: &ArapOptions, goals: &Goals| {
        let mut arap = Arap::prepare(options, &mesh, &region).expect("valid");
        let mut pose = mesh.positions.clone();
        arap.solve(goals, &mut pose).expect("solvable");
        arap.energy(goals, &pose).expect("valid")
    };
    for options in propagated() {
        let at =
            |degrees: f64, iterations| energy(&ArapOptions { iterations, ..options.clone() }, &twisted(&mesh, degrees));
        // Of a linear bar 16 times; this one is drawn out besides.
        let (small, large) = (at(180.0, 200), at(720.0, 200));
        assert!(large > 8.0 * small && large < 20.0 * small, "{options}: {small} {large}");
        let energies = [0, 1, 2, 5, 20].map(|iterations| at(720.0, iterations));
        assert!(energies.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-12)), "{options}: {energies:?}");
    }
}

#[test]
fn a_common_rigid_motion_is_reproduced_from_any_pose() {
    for (name, mesh) in [("pyramid", pyramid()), ("sheet", sheet(16, 8)), ("torus", torus(24, 10)), ("bar", bar(4))] {
        let region = two_ends(&mesh);
        for options in propagated() {
            let options = ArapOptions { iterations: 0, ..options };
            let mut pose = mesh.positions.clone();
            for angle in [0.0, 0.5, PI, 5.0, 30.0] {
                let axis = DVec3::new(1.0, 2.0, -2.0) / 3.0;
                let mut motion = Similarity::about(DVec3::new(1.0, -2.0, 0.5), axis, angle, 1.0);
                motion.translation += DVec3::new(0.3, -1.0, 2.0);
                let goals = Goals::with_turns(vec![motion; 2], vec![axis * angle; 2]);
                solve(&options, &mesh, &region, &goals, &mut pose);
                let expected: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
                let off = distance(&pose, &expected) / mesh.bounds().diagonal();
                assert!(off < 1e-11, "{name}, {options}, angle {angle}: {off:e}");
            }
        }
    }
}

/// A fixed part that stands turned from an earlier edit, a hard and a soft handle, and another region for the same deformer.
#[test]
fn what_is_fixed_counts_as_it_stands() {
    let motion = Similarity::about(DVec3::ONE, DVec3::new(1.0, 2.0, -1.0), 1.3, 1.0);
    for (name, mesh) in [("sheet", sheet(16, 8)), ("torus", torus(24, 10)), ("bar", bar(4))] {
        let n = mesh.vertex_count();
        let handles = [Handle::hard(along_x(&mesh, 0.6..=0.7)), Handle::soft(along_x(&mesh, 0.4..=0.45), 2.0)];
        let roi = along_x(&mesh, 0.2..=0.9);
        let expected: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
        for options in propagated() {
            let options = ArapOptions { iterations: 0, ..options };
            let mut arap = Arap::prepare(&options, &mesh, &two_ends(&mesh)).expect("valid");
            for count in [2, 1, 0, 2] {
                let region = Region::new(n, &roi, &handles[..count]).expect("valid");
                arap.set_region(&region).expect("valid");
                let mut pose = expected.clone();
                for v in roi.iter() {
                    pose[v as usize] = mesh.positions[v as usize];
                }
                arap.solve(&Goals::new(vec![motion; count]), &mut pose).expect("solvable");
                let off = distance(&pose, &expected) / mesh.bounds().diagonal();
                assert!(off < 1e-10, "{name}, {options}, {count} handles: {off:e}");
            }
        }
    }
}

#[test]
fn acceleration_works_from_there_too() {
    let mesh = torus(24, 10);
    let region = two_ends(&mesh);
    let goals = twisted(&mesh, 120.0);
    let options = ArapOptions { start: Start::Propagated, energy: ArapEnergy::SpokesAndRims, ..ArapOptions::default() };
    let run = |acceleration| {
        let options = ArapOptions { iterations: 2000, tolerance: Some(1e-9), acceleration, ..options.clone() };
        let mut pose = mesh.positions.clone();
        let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
        let report = arap.solve(&goals, &mut pose).expect("solvable");
        assert!(report.converged);
        (report.iterations, report.energy_after.expect("a tolerance is set"))
    };
    let (plain, fast) = (run(Acceleration::None), run(Acceleration::Anderson { window: 5 }));
    assert!(fast.0 < plain.0 && fast.1 < plain.1 * (1.0 + 1e-4), "{plain:?} {fast:?}");
}
