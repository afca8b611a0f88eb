//! ARAP against an independent dense implementation, and its energy against finite differences.

mod common;

use common::dense::Dense;
use common::{acute_ball, bar, distance, pyramid, sheet, torus, variants};
use glam::DVec3;
use pliant_deform::arap::{Arap, ArapOptions};
use pliant_deform::{Constraint, Deformer, Goals, Handle, PointRows, Region, Role};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

fn five_iterations() -> impl Iterator<Item = ArapOptions> {
    variants().into_iter().map(|options| ArapOptions { iterations: 5, ..options })
}

fn handles(mesh: &TriMesh, second: Constraint) -> Vec<Handle> {
    let ends = [0.0..=0.1, 0.85..=1.0].map(|range| common::along_x(mesh, range));
    let [first, last] = ends;
    vec![Handle::hard(first), Handle { vertices: last, rows: PointRows::new(), constraint: second }]
}

fn bend(mesh: &TriMesh) -> Goals {
    let tip = mesh.bounds().from_box(DVec3::new(0.9, 0.5, 0.5));
    let mut turn = Similarity::about(tip, DVec3::new(0.2, 1.0, 0.4), 0.6, 1.1);
    turn.translation += DVec3::new(-0.2, 0.1, 0.3);
    Goals::new(vec![Similarity::IDENTITY, turn])
}

#[test]
fn agrees_with_the_dense_reference() {
    let mesh = acute_ball();
    let n = mesh.vertex_count();
    for second in [Constraint::Hard, Constraint::Soft(0.7)] {
        for options in five_iterations() {
            let region = Region::new(n, &VertexSet::all(n), &handles(&mesh, second)).expect("valid");
            let dense = Dense::new(&mesh, &region, &options);
            let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
            assert_eq!(arap.prepared().clamped_weights, 0);
            let (mut pose, mut reference) = (mesh.positions.clone(), mesh.positions.clone());
            // From rest, and from the last pose.
            for goals in [bend(&mesh), region.identity_goals(), bend(&mesh)] {
                arap.solve(&goals, &mut pose).expect("solvable");
                dense.solve(&options, &goals, &mut reference);
                let off = distance(&pose, &reference);
                assert!(off < 1e-9, "{options:?}, {second:?}: off by {off:e}");
            }
        }
    }
}

#[test]
fn agrees_with_the_dense_reference_in_a_region() {
    let mesh = acute_ball();
    let n = mesh.vertex_count();
    let roi = common::along_x(&mesh, 0.3..=1.0);
    for options in five_iterations() {
        let tip = Handle::hard(common::along_x(&mesh, 0.9..=1.0));
        let region = Region::new(n, &roi, &[tip]).expect("valid");
        let goals = Goals::new(vec![Similarity::about(DVec3::X, DVec3::Z, 0.5, 1.0)]);
        let (mut pose, mut reference) = (mesh.positions.clone(), mesh.positions.clone());
        Arap::prepare(&options, &mesh, &region).expect("valid").solve(&goals, &mut pose).expect("solvable");
        Dense::new(&mesh, &region, &options).solve(&options, &goals, &mut reference);
        let off = distance(&pose, &reference);
        assert!(off < 1e-9, "{options:?}: off by {off:e}");
    }
}

/// Global and local step lower one and the same energy: where they come to rest, its numerical derivative vanishes.
#[test]
fn the_gradient_vanishes_at_convergence() {
    for (name, mesh) in [("pyramid", pyramid()), ("sheet", sheet(8, 4)), ("torus", torus(12, 6)), ("bar", bar(2))] {
        for options in five_iterations() {
            for second in [Constraint::Hard, Constraint::Soft(0.3)] {
                let options = ArapOptions { iterations: 20_000, tolerance: Some(1e-16), ..options.clone() };
                let n = mesh.vertex_count();
                let region = Region::new(n, &VertexSet::all(n), &handles(&mesh, second)).expect("valid");
                let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
                // A small bend, so that the minimum is not nearly flat.
                let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::X, DVec3::Y, 0.2, 1.0)]);
                let mut pose = mesh.positions.clone();
                arap.solve(&goals, &mut pose).expect("solvable");
                let step = 1e-5;
                let energy_scale = arap.energy(&goals, &mesh.positions.iter().map(|p| 2.0 * *p).collect::<Vec<_>>());
                let energy_scale = energy_scale.expect("valid");
                for v in (0..n).filter(|&v| region.roles()[v] == Role::Free).step_by(7) {
                    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                        let mut at = |t: f64| {
                            let mut moved = pose.clone();
                            moved[v] += t * axis;
                            arap.energy(&goals, &moved).expect("valid")
                        };
                        let slope = (at(step) - at(-step)) / (2.0 * step);
                        // Iterations stop when the energy is flat to 16 digits, so the gradient to about 8.
                        assert!(slope.abs() < 1e-6 * energy_scale, "{name}, {options:?}: {slope:e} at {v}");
                    }
                }
            }
        }
    }
}
