//! No step raises the energy, accelerated or smoothed.

use pliant_mesh::{Similarity, VertexSet, shapes};

use super::*;
use crate::Handle;
use crate::arap::{Acceleration, ArapEnergy};

/// Every pose that is stepped from has no more energy than the one before.
#[test]
fn no_accelerated_step_raises_the_energy() {
    let bar = shapes::bar(24, 4, 4, DVec3::new(6.0, 1.0, 1.0)).expect("valid size");
    let cactus = shapes::cactus(900).expect("in range");
    let (mut taken_back, mut kept) = (0, 0);
    for mesh in [bar, cactus, shapes::bumpy_plane(20, 12, 2.0, 1.0, 0.1, 3).expect("valid size")] {
        let (n, bounds) = (mesh.vertex_count(), mesh.bounds());
        let axis = bounds.size().max_position();
        let along = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
        let low = Handle::hard(VertexSet::where_true(n, |v| along(v) <= 0.1));
        let high = Handle::hard(VertexSet::where_true(n, |v| along(v) >= 0.9));
        let region = Region::new(n, &VertexSet::all(n), &[low, high]).expect("both ends have vertices");
        for (window, angle) in [(1, 1.0), (5, 1.0), (5, 3.0), (20, 2.0)] {
            let options = ArapOptions { acceleration: Acceleration::Anderson { window }, ..ArapOptions::default() };
            let turn = Similarity::about(bounds.centre(), DVec3::new(0.3, 1.0, 0.5), angle, 1.0);
            let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
            let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
            let (edit, m) = (&mut arap.edit, arap.shape.multiplicity());
            edit.read(&arap.shape, &goals, &mesh.positions).expect("valid");
            edit.guess().expect("solvable");
            let mut last = f64::INFINITY;
            for _ in 0..150 {
                edit.fit_rotations();
                let raw = edit.current_energy(m);
                let now = edit.safe_energy(last, m);
                // Differences at convergence are rounding.
                if raw > last * (1.0 + 1e-9) {
                    taken_back += 1;
                } else if raw < last * (1.0 - 1e-9) {
                    kept += 1;
                }
                assert!(now <= last * (1.0 + 1e-12), "window {window}, angle {angle}: {last} -> {now}");
                last = now;
                edit.global_step().expect("solvable");
                edit.accelerate();
            }
        }
    }
    assert!(taken_back > 0 && kept > 3 * taken_back, "{taken_back} taken back, {kept} kept");
}

/// Local and global steps in turn, with coupled rotations: on both kinds of cells, with and without acceleration, for few and many
/// threads.
#[test]
fn no_step_with_smooth_rotations_raises_the_energy() {
    let bar = shapes::bar(24, 4, 4, DVec3::new(6.0, 1.0, 1.0)).expect("valid size");
    for mesh in [bar, shapes::cactus(2500).expect("in range")] {
        let (n, bounds) = (mesh.vertex_count(), mesh.bounds());
        let axis = bounds.size().max_position();
        let along = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
        let low = Handle::hard(VertexSet::where_true(n, |v| along(v) <= 0.1));
        let high = Handle::soft(VertexSet::where_true(n, |v| along(v) >= 0.9), 10.0);
        let region = Region::new(n, &VertexSet::all(n), &[low, high]).expect("both ends have vertices");
        let turn = Similarity::about(bounds.centre(), DVec3::new(0.3, 1.0, 0.5), 1.5, 1.0);
        let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
        for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
            for (smoothness, window) in [(1e-4, None), (0.01, None), (0.1, None), (0.01, Some(5)), (0.1, Some(20))] {
                let acceleration = window.map_or(Acceleration::None, |window| Acceleration::Anderson { window });
                let options = ArapOptions { energy, smoothness, acceleration, ..ArapOptions::default() };
                let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
                let (edit, m) = (&mut arap.edit, arap.shape.multiplicity());
                edit.prepare_energy(&arap.shape);
                edit.read(&arap.shape, &goals, &mesh.positions).expect("valid");
                edit.guess().expect("solvable");
                let (mut last, mut first) = (f64::INFINITY, None);
                for _ in 0..60 {
                    // Each half of an iteration by itself, where nothing is mixed.
                    let before = edit.current_energy(m);
                    edit.fit_rotations();
                    assert!(edit.current_energy(m) <= before * (1.0 + 1e-12), "a sweep raised the energy");
                    let now = edit.safe_energy(last, m);
                    assert!(now <= last * (1.0 + 1e-12), "{options:?}: {last} -> {now}");
                    last = now;
                    first.get_or_insert(now);
                    edit.global_step().expect("solvable");
                    assert!(edit.current_energy(m) <= now * (1.0 + 1e-12), "a global step raised the energy");
                    edit.accelerate();
                }
                assert!(first.is_some_and(|first| last < 0.99 * first), "{options:?}: {first:?} {last}");
            }
        }
    }
}

/// No two cells of one colour are neighbours, and each fitted cell has one colour.
#[test]
fn neighbours_have_different_colours() {
    let mesh = shapes::cactus(900).expect("in range");
    let n = mesh.vertex_count();
    let handle = Handle::hard(VertexSet::from_iter([5, 6]));
    let region = Region::new(n, &VertexSet::where_true(n, |v| v < n as u32 / 2), &[handle]).expect("valid");
    let region = region.without_unconstrained(mesh.topology()).0;
    let options = ArapOptions { smoothness: 0.01, ..ArapOptions::default() };
    let arap = Arap::prepare(&options, &mesh, &region).expect("valid");
    let smoother = arap.edit.smoother.as_ref().expect("smoothed");
    let mut all: Vec<u32> = smoother.colours().concat();
    all.sort_unstable();
    assert_eq!(all, arap.edit.roles.fitted.as_slice());
    // A greedy colouring has no more colours than the largest valence and one.
    assert!(smoother.colours().len() < 16);
    for slots in smoother.colours() {
        for &slot in slots {
            assert!(arap.edit.cells.neighbours(slot as usize).iter().all(|other| !slots.contains(other)));
        }
    }
}
