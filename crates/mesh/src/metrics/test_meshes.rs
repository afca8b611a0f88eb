//! Meshes that tests of several figures are made on.

use glam::DVec3;

use crate::TriMesh;

/// Unit squares in the plane z = 0, `columns` along x and `rows` along y, each cut along its diagonal from the lower left.
pub(super) fn grid(columns: u32, rows: u32) -> TriMesh {
    let wide = columns + 1;
    let vertices = 0..wide * (rows + 1);
    let positions = vertices.map(|i| DVec3::new(f64::from(i % wide), f64::from(i / wide), 0.0)).collect();
    let square = |i: u32| [[i, i + 1, i + wide + 1], [i, i + wide + 1, i + wide]];
    let corners = (0..wide * rows).filter(|i| i % wide < columns);
    TriMesh::new(positions, corners.flat_map(square).collect()).expect("a grid")
}
