//! Laplacian coordinates as rows of numbers.

use glam::DVec3;
use pliant_mesh::{TriMesh, mixed_voronoi_areas};

use crate::EdgeWeightKind;
use crate::operators::edge_weights;

/// Smallest area of a vertex, as a share of the mean square of its edges: a fan of slivers has next to none, and would get a row that
/// drowns all others.
const SMALLEST_AREA: f64 = 1e-3;

/// The rows `r_i D(v)_i` of all vertices of a mesh (section 2.1), scaled so that they have no unit.
///
/// The sign is that of +L, centre minus neighbours, where the paper has neighbours minus centre; both sides of each of its equations
/// change with it.
///
/// The paper adds up squares of coordinates (1 over length for cotangent weights, a length for uniform ones) and of gradients (no unit)
/// with equal weights (Eq. 7), which is equivariant to the scale of the mesh only if the coordinates are made unitless. Cotangent rows are
/// multiplied by the root of the vertex's area, so that `E_L` is the integral of `|D(v~) - M D(v)|^2` over the surface, and uniform rows
/// divided by it. On an even mesh both are the paper's sums but for one factor.
pub(super) struct LaplacianRows {
    /// Of row `i`: `offsets[i]..offsets[i + 1]` of the lists below.
    offsets: Vec<usize>,
    /// The vertex itself first.
    columns: Vec<u32>,
    values: Vec<f64>,
    /// Edge weights that had to be changed.
    pub(super) clamped: usize,
}

impl LaplacianRows {
    pub(super) fn new(mesh: &TriMesh, kind: EdgeWeightKind) -> Self {
        let topology = mesh.topology();
        let weights = edge_weights(mesh, kind);
        let areas = mixed_voronoi_areas(mesh);
        let mut laplacian =
            Self { offsets: vec![0], columns: Vec::new(), values: Vec::new(), clamped: weights.clamped };
        for (i, &area) in areas.iter().enumerate() {
            let neighbours = topology.neighbours(i);
            let at = mesh.positions[i];
            let squares: f64 = neighbours.iter().map(|&j| mesh.positions[j as usize].distance_squared(at)).sum();
            let count = neighbours.len().max(1) as f64;
            let root = area.max(SMALLEST_AREA * squares / count).max(f64::MIN_POSITIVE).sqrt();
            // Half cotangents: the paper's weights are twice these, over the area.
            let scale = match kind {
                EdgeWeightKind::Cotangent => 2.0 / root,
                EdgeWeightKind::Uniform => 1.0 / (count * root),
            };
            let diagonal = laplacian.columns.len();
            laplacian.columns.push(i as u32);
            laplacian.values.push(0.0);
            for (&j, &edge) in neighbours.iter().zip(topology.neighbour_edges(i)) {
                let weight = scale * weights.values[edge as usize];
                laplacian.columns.push(j);
                laplacian.values.push(-weight);
                laplacian.values[diagonal] += weight;
            }
            laplacian.offsets.push(laplacian.columns.len());
        }
        laplacian
    }

    /// Column and value of each entry of a row, the diagonal first.
    pub(super) fn row(&self, i: usize) -> impl Iterator<Item = (u32, f64)> + Clone {
        let range = self.offsets[i]..self.offsets[i + 1];
        self.columns[range.clone()].iter().copied().zip(self.values[range].iter().copied())
    }

    /// A row times points: by differences to the vertex, which keeps digits that sums would lose.
    pub(super) fn apply(&self, i: usize, points: &[DVec3]) -> DVec3 {
        self.row(i).skip(1).map(|(j, value)| value * (points[j as usize] - points[i])).sum()
    }
}

#[cfg(test)]
mod tests {
    use pliant_mesh::shapes;

    use super::*;

    /// On a sphere of radius 1 the mean curvature normal of Meyer et al. (Eq. 8) is `2 v`; the paper's coordinates lack its half, so
    /// they are `4 v`. Rows vanish on constants and have no unit.
    #[test]
    fn rows_are_laplacian_coordinates() {
        let sphere = shapes::icosphere(4);
        let areas = mixed_voronoi_areas(&sphere);
        let rows = LaplacianRows::new(&sphere, EdgeWeightKind::Cotangent);
        for (v, p) in sphere.positions.iter().enumerate() {
            let curvature = rows.apply(v, &sphere.positions) / areas[v].sqrt();
            assert!(curvature.distance(4.0 * *p) < 0.04, "{v}: {curvature}");
        }
        for kind in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
            let rows = LaplacianRows::new(&sphere, kind);
            let scaled = sphere.with_positions(sphere.positions.iter().map(|p| *p * 1e-3).collect()).expect("finite");
            let small = LaplacianRows::new(&scaled, kind);
            for v in 0..sphere.vertex_count() {
                let sum: f64 = rows.row(v).map(|(_, value)| value).sum();
                let size = rows.row(v).next().map_or(0.0, |(_, value)| value);
                assert!(sum.abs() < 1e-13 * size, "{kind:?}: {sum}");
                let (one, other) = (rows.apply(v, &sphere.positions), small.apply(v, &scaled.positions));
                assert!(one.distance(other) < 1e-11, "{kind:?}: {one} {other}");
            }
        }
    }
}
