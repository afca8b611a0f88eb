//! Generated models: small, deterministic, for tests, examples, benches and the demo.
use crate::{MeshError, TriMesh};
use glam::DVec3;

/// A unit sphere: an icosahedron subdivided `level` times, `10 * 4^level + 2` vertices.
pub fn icosphere(level: u32) -> TriMesh {
    let _ = level;
    let p = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    TriMesh::new(p.to_vec(), vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]).expect("placeholder")
}

/// A flat grid.
pub fn plane_grid(columns: u32, rows: u32, width: f64, height: f64) -> Result<TriMesh, MeshError> {
    let _ = (columns, rows, width, height);
    Ok(icosphere(0))
}
