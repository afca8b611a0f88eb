use pliant_mesh::{Similarity, VertexSet, shapes};

use super::*;
use crate::Handle;

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
            edit.read(&arap.shape.frame, &goals, &mesh.positions).expect("valid");
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
    assert!(taken_back > 0 && kept > 5 * taken_back, "{taken_back} taken back, {kept} kept");
}
