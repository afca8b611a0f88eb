//! Mean value coordinates before pruning: partition of unity, linear precision, and the cases at the cage itself.

use glam::DVec3;
use pliant_cage::MeanValue;
use pliant_mesh::{TriMesh, shapes};

/// Closed cages: round, with a hole, with coplanar faces, with needles, tiny and far from the origin.
fn cages() -> Vec<(&'static str, TriMesh)> {
    let moved = |mesh: TriMesh, scale: f64, offset: DVec3| {
        let positions = mesh.positions.iter().map(|p| scale * *p + offset).collect();
        mesh.with_positions(positions).expect("finite")
    };
    let bar = || shapes::bar(6, 2, 2, DVec3::new(3.0, 1.0, 0.5)).expect("valid");
    vec![
        ("sphere", shapes::icosphere(2)),
        ("torus", shapes::torus(1.0, 0.3, 17, 9).expect("valid")),
        ("bar", bar()),
        ("needles", shapes::cylinder(0.02, 3.0, 40, 2, 2).expect("valid")),
        ("tiny", moved(bar(), 1e-9, DVec3::ZERO)),
        ("far", moved(bar(), 1.0, DVec3::new(1e3, -2e3, 5e2))),
    ]
}

/// Numbers that look random and are the same on every run.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// (sum of the row minus 1, distance of what the row makes of the cage from the point, in diagonals).
fn errors(coordinates: &MeanValue, cage: &TriMesh, point: DVec3) -> (f64, f64) {
    let mut row = vec![0.0; cage.vertex_count()];
    assert!(coordinates.coordinates(point, &mut row), "no coordinates at {point}");
    let made: DVec3 = cage.positions.iter().zip(&row).map(|(y, c)| (*y - point) * *c).sum();
    ((row.iter().sum::<f64>() - 1.0).abs(), made.length() / cage.bounds().diagonal())
}

#[test]
fn precise_inside_and_outside() {
    for (name, cage) in cages() {
        let coordinates = MeanValue::new(&cage);
        let bounds = cage.bounds();
        let mut random = noise(1);
        for _ in 0..300 {
            // In a box three times as wide as the cage.
            let at = DVec3::new(random(), random(), random()) * 3.0 - 1.0;
            let (sum, precision) = errors(&coordinates, &cage, bounds.from_box(at));
            assert!(sum < 1e-12 && precision < 1e-9, "{name} at {at}: {sum:e}, {precision:e}");
        }
    }
}

/// Every distance from 1e-15 to 1e-1 of the diagonal on both sides of face middles, edge middles and vertices.
#[test]
fn precise_close_to_faces_edges_and_vertices() {
    for (name, cage) in cages() {
        let coordinates = MeanValue::new(&cage);
        let diagonal = cage.bounds().diagonal();
        let mut random = noise(2);
        for face in (0..cage.face_count()).step_by(7) {
            let [a, b, c] = cage.corners(face);
            let spots = [(a + b + c) / 3.0, 0.5 * (a + b), 0.3 * b + 0.7 * c, a, 0.5 * a + 0.49 * b + 0.01 * c];
            for spot in spots {
                for exponent in 1..=15 {
                    let away = DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
                    let point = spot + away * (diagonal * 0.1_f64.powi(exponent));
                    let (sum, precision) = errors(&coordinates, &cage, point);
                    assert!(
                        sum < 1e-12 && precision < 1e-9,
                        "{name}, face {face}, 1e-{exponent}: {sum:e}, {precision:e}"
                    );
                }
            }
        }
    }
}

#[test]
fn on_the_cage_they_are_barycentric() {
    for (name, cage) in cages() {
        let coordinates = MeanValue::new(&cage);
        let mut row = vec![0.0; cage.vertex_count()];
        for v in (0..cage.vertex_count()).step_by(5) {
            assert!(coordinates.coordinates(cage.positions[v], &mut row));
            assert!((0..row.len()).all(|j| row[j] == f64::from(u8::from(j == v))), "{name}: vertex {v} is not its own");
        }
        for face in (0..cage.face_count()).step_by(5) {
            let corners = cage.corners(face);
            for weights in [[0.2, 0.3, 0.5], [0.5, 0.5, 0.0], [0.98, 0.01, 0.01]] {
                let point: DVec3 = corners.iter().zip(weights).map(|(p, w)| *p * w).sum();
                assert!(coordinates.coordinates(point, &mut row));
                for (v, w) in cage.triangles()[face].into_iter().zip(weights) {
                    // A point is on the face up to its own rounding, 1e-13 of a needle's side at worst.
                    assert!((row[v as usize] - w).abs() < 1e-6, "{name}, face {face}: {} for {w}", row[v as usize]);
                }
                assert!((row.iter().map(|c| c.abs()).sum::<f64>() - 1.0).abs() < 1e-6, "{name}, face {face}");
            }
        }
    }
}

/// The limit from outside is the value on the face: no jump anywhere on the way in.
#[test]
fn they_are_continuous_up_to_the_face() {
    let cage = shapes::icosphere(1);
    let coordinates = MeanValue::new(&cage);
    let (mut on, mut near) = (vec![0.0; cage.vertex_count()], vec![0.0; cage.vertex_count()]);
    let [a, b, c] = cage.corners(3);
    let normal = (b - a).cross(c - a).normalize();
    for spot in [0.2 * a + 0.3 * b + 0.5 * c, 0.5 * (a + b), a] {
        assert!(coordinates.coordinates(spot, &mut on));
        for exponent in 3..=15 {
            for side in [1.0, -1.0] {
                let height = 0.1_f64.powi(exponent);
                assert!(coordinates.coordinates(spot + normal * (side * height), &mut near));
                let jump = on.iter().zip(&near).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
                // Their slope is bounded but for a logarithm; rounding of the height limits what is seen.
                assert!(jump < 50.0 * height + 1e-11, "height {:e}: jump {jump:e}", side * height);
            }
        }
    }
}

/// On a tetrahedron only the barycentric coordinates have linear precision.
#[test]
fn on_a_tetrahedron_they_are_barycentric_coordinates() {
    let corners = [DVec3::ZERO, DVec3::new(1.0, 0.1, 0.0), DVec3::new(0.2, 1.3, 0.1), DVec3::new(0.3, 0.2, 0.9)];
    let cage = TriMesh::new(corners.to_vec(), vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("tetrahedron");
    let coordinates = MeanValue::new(&cage);
    let volume = |p: [DVec3; 4]| (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]);
    let mut random = noise(3);
    let mut row = [0.0; 4];
    for _ in 0..500 {
        let point = DVec3::new(random(), random(), random()) * 3.0 - 1.0;
        assert!(coordinates.coordinates(point, &mut row));
        for (k, c) in row.iter().enumerate() {
            let mut replaced = corners;
            replaced[k] = point;
            let expected = volume(replaced) / volume(corners);
            assert!((c - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{c} for {expected} at {point}");
        }
    }
}

/// Turning the cage inside out changes no coordinate: both signs cancel.
#[test]
fn orientation_does_not_matter() {
    let cage = shapes::torus(1.0, 0.3, 12, 8).expect("valid");
    let flipped: Vec<[u32; 3]> = cage.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    let inside_out = TriMesh::new(cage.positions.clone(), flipped).expect("valid");
    let (mut row, mut other) = (vec![0.0; cage.vertex_count()], vec![0.0; cage.vertex_count()]);
    for point in [DVec3::new(1.0, 0.1, 0.0), DVec3::ZERO, DVec3::new(3.0, 1.0, 2.0)] {
        assert!(MeanValue::new(&cage).coordinates(point, &mut row));
        assert!(MeanValue::new(&inside_out).coordinates(point, &mut other));
        assert!(row.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
