//! What unit tests look at: families of shapes with their cages, and points round them.

use glam::DVec3;
use pliant_mesh::{Silent, TriMesh, shapes};

use crate::{CageSize, simplify};

fn moved(mesh: &TriMesh, by: impl Fn(DVec3) -> DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| by(*p)).collect()).expect("finite")
}

/// Two meshes as one, the second after the first.
fn joined(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let shift = a.vertex_count() as u32;
    let positions = a.positions.iter().chain(&b.positions).copied().collect();
    let faces = a.triangles().iter().copied().chain(b.triangles().iter().map(|t| t.map(|v| v + shift))).collect();
    TriMesh::new(positions, faces).expect("valid")
}

/// Shapes with cages: round, with a hole, limbs, open, in two parts, a thin plate folded over itself, needles, coplanar faces,
/// tiny and huge.
pub(crate) fn families() -> Vec<(&'static str, TriMesh, TriMesh)> {
    let creature = shapes::creature(4000).expect("valid");
    let torus = shapes::torus(1.0, 0.3, 60, 30).expect("valid");
    let sphere = shapes::icosphere(4);
    let sheet = shapes::bumpy_plane(60, 60, 2.0, 2.0, 0.1, 7).expect("valid");
    let plate = shapes::bar(60, 30, 1, DVec3::new(2.0, 1.0, 0.01)).expect("valid");
    let folded = moved(&plate, |p| {
        // Rolled up by one and a half turns.
        let (angle, radius) = (4.7 * p.x, 0.2 + 0.02 * p.x + p.z);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), p.y)
    });
    let apart = joined(&sphere, &moved(&sphere, |p| 0.7 * p + DVec3::new(2.0, 0.1, 0.0)));
    let needles = moved(&torus, |p| p * DVec3::new(1.0, 30.0, 1.0));
    vec![
        ("tiny creature", moved(&creature, |p| 1e-6 * p), 0.15),
        ("creature", creature, 0.15),
        ("huge torus", moved(&torus, |p| 1e6 * p), 0.3),
        ("sphere", sphere, 0.2),
        ("open sheet", sheet, 0.2),
        ("two spheres", apart, 0.1),
        ("folded plate", folded, 0.2),
        ("needles", needles, 0.3),
    ]
    .into_iter()
    .map(|(name, shape, share)| {
        let cage = simplify(&shape, &CageSize::Fraction(share).into(), &Silent).expect("valid").mesh;
        (name, shape, cage)
    })
    .collect()
}

/// Points of a shape, and on, close to, and far from its cage.
pub(crate) fn points(shape: &TriMesh, cage: &TriMesh) -> Vec<DVec3> {
    let mut points: Vec<DVec3> = shape.positions.iter().step_by(shape.vertex_count() / 60).copied().collect();
    points.extend(cage.positions.iter().step_by(cage.vertex_count() / 6));
    for (k, f) in (0..cage.face_count()).step_by(cage.face_count() / 12).enumerate() {
        let [a, b, c] = cage.corners(f);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let diagonal = cage.bounds().diagonal();
        let spot = [(a + b + c) / 3.0, 0.5 * (a + b), 0.02 * a + 0.98 * c][k % 3];
        points.extend([0.0, 1e-12, 1e-8, -1e-5, 1e-3, -0.02, 0.1].map(|h| spot + normal * (h * diagonal)));
    }
    let bounds = cage.bounds();
    points.extend([0.5, 1.6, -3.0, 8.0].map(|t| bounds.from_box(DVec3::new(t, 0.4 * t, 0.5))));
    points
}
