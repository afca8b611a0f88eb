//! Families of shapes with their cages.

use glam::DVec3;
use pliant_cage::{CageSize, Simplified, simplify};
use pliant_mesh::{Silent, TriMesh, shapes};

/// A shape and its cage of a tenth of the vertices.
pub(crate) struct Pair {
    pub(crate) name: &'static str,
    pub(crate) shape: TriMesh,
    pub(crate) cage: Simplified,
}

/// Closed, open, several components, concave with thin sheets, needle triangles, limbs that touch, tiny and huge.
pub(crate) fn pairs() -> Vec<Pair> {
    let scaled = |mesh: &TriMesh, scale: DVec3| moved(mesh, |p| p * scale);
    let sphere = shapes::icosphere(3);
    let torus = shapes::torus(1.0, 0.3, 40, 20).expect("valid");
    let plate = shapes::bar(24, 24, 1, DVec3::new(2.0, 2.0, 0.02)).expect("valid");
    let folded = moved(&plate, |p| DVec3::new(p.x, p.y, p.z + 0.4 * (3.0 * p.x).sin()));
    [
        ("sphere", sphere.clone()),
        (
            "wavy sheet",
            moved(&shapes::plane_grid(24, 24, 2.0, 2.0).expect("valid"), |p| p + DVec3::Z * 0.2 * (3.0 * p.x).sin()),
        ),
        ("two spheres", two(&sphere, DVec3::X * 2.01)),
        ("folded plate", folded),
        ("needles", scaled(&torus, DVec3::new(1.0, 1.0, 60.0))),
        ("horseshoe", horseshoe()),
        ("creature", shapes::creature(2000).expect("valid")),
        ("tiny torus", scaled(&torus, DVec3::splat(1e-6))),
        ("huge torus", scaled(&torus, DVec3::splat(1e6))),
    ]
    .into_iter()
    .map(|(name, shape)| {
        let cage = simplify(&shape, &CageSize::Fraction(0.1).into(), &Silent).expect("valid");
        Pair { name, shape, cage }
    })
    .collect()
}

/// The mesh with every vertex moved.
pub(crate) fn moved(mesh: &TriMesh, to: impl Fn(DVec3) -> DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| to(*p)).collect()).expect("finite")
}

/// The mesh twice, the second time elsewhere.
pub(crate) fn two(mesh: &TriMesh, offset: DVec3) -> TriMesh {
    let n = mesh.vertex_count() as u32;
    let mut positions = mesh.positions.clone();
    positions.extend(mesh.positions.iter().map(|p| *p + offset));
    let mut triangles = mesh.triangles().to_vec();
    triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + n)));
    TriMesh::new(positions, triangles).expect("valid")
}

/// A bar of length 8, bent to a ring that all but closes: its ends are a hundredth apart. Ends at `x = +-0.005`, `y < 0`.
pub(crate) fn horseshoe() -> TriMesh {
    let bar = shapes::bar(80, 6, 6, DVec3::new(8.0, 0.6, 0.6)).expect("valid");
    let radius = 8.01 / std::f64::consts::TAU;
    moved(&bar, |p| {
        let angle = p.x / radius;
        DVec3::new((radius + p.y) * angle.sin(), (radius + p.y) * angle.cos(), p.z)
    })
}
