//! Laplacian coordinates as rows of numbers.

use glam::DVec3;
use pliant_mesh::{TriMesh, mixed_voronoi_areas};

use crate::EdgeWeightKind;
use crate::operators::edge_weights;

/// Largest ratio of two cotangent weights. A pair of vertices that an edge so much stiffer than others ties together leaves the
/// square of its inverse as a pivot of the normal equations, and below 1e-12 there would be none.
const MAX_SPREAD: f64 = 1e5;

/// Smallest area of a vertex, as a share of the mean square of its edges: a fan of slivers has next to none, and would get a row that
/// drowns all others.
const SMALLEST_AREA: f64 = 1e-3;

/// The rows `r_i L(x)_i` of a mesh, `L(x)_i = sum_j w_ij (x_i - x_j) / c_i`: +L, centre minus neighbours, as in Yuan, Eq. 2-3.
///
/// Uniform: `w = 1`, `c` the number of neighbours, `r = 1`. Cotangent: half cotangents, `c` the Voronoi area and `r` its root, so that
/// squares of rows add up to an integral over the surface; the paper's plain sum would weight by how finely a part is triangulated.
pub(super) struct Laplacian {
    /// Positive, one per edge.
    pub(super) weights: Vec<f64>,
    /// `r_i / c_i`.
    scales: Vec<f64>,
    /// Edge weights that had to be changed.
    pub(super) clamped: usize,
}

impl Laplacian {
    pub(super) fn new(mesh: &TriMesh, kind: EdgeWeightKind) -> Self {
        let topology = mesh.topology();
        let mut weights = edge_weights(mesh, kind);
        let most = MAX_SPREAD * weights.values.iter().copied().fold(f64::INFINITY, f64::min);
        for w in weights.values.iter_mut().filter(|w| **w > most) {
            *w = most;
            weights.clamped += 1;
        }
        let ring = |i: usize| topology.neighbours(i).iter().map(|&j| mesh.positions[j as usize]);
        let count = |i: usize| topology.neighbours(i).len().max(1) as f64;
        let scales = match kind {
            EdgeWeightKind::Uniform => (0..mesh.vertex_count()).map(|i| 1.0 / count(i)).collect(),
            EdgeWeightKind::Cotangent => {
                let areas = mixed_voronoi_areas(mesh).into_iter().enumerate();
                areas
                    .map(|(i, area)| {
                        let squares: f64 = ring(i).map(|p| p.distance_squared(mesh.positions[i])).sum();
                        area.max(SMALLEST_AREA * squares / count(i)).max(f64::MIN_POSITIVE).sqrt().recip()
                    })
                    .collect()
            }
        };
        Self { weights: weights.values, scales, clamped: weights.clamped }
    }

    /// Columns and values of row `i`, the diagonal first; only that where there is no neighbour.
    pub(super) fn row<'a>(&'a self, mesh: &'a TriMesh, i: usize) -> impl Iterator<Item = (u32, f64)> + Clone + 'a {
        let others = self.others(mesh, i);
        let diagonal: f64 = others.clone().map(|(_, value)| value).sum();
        std::iter::once((i as u32, -diagonal)).chain(others)
    }

    /// Row `i` times the mesh's positions: by differences to the vertex, which keep digits that sums would lose.
    pub(super) fn apply(&self, mesh: &TriMesh, i: usize) -> DVec3 {
        let at = mesh.positions[i];
        self.others(mesh, i).map(|(j, value)| value * (mesh.positions[j as usize] - at)).sum()
    }

    /// Entries off the diagonal, negative.
    fn others<'a>(&'a self, mesh: &'a TriMesh, i: usize) -> impl Iterator<Item = (u32, f64)> + Clone + 'a {
        let topology = mesh.topology();
        let edges = topology.neighbours(i).iter().zip(topology.neighbour_edges(i));
        edges.map(move |(&j, &edge)| (j, -self.scales[i] * self.weights[edge as usize]))
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use pliant_mesh::shapes;

    use super::*;

    /// Yuan, Eq. 8-10: translation invariant, and linear maps go through (so rotations do).
    #[test]
    fn coordinates_commute_with_linear_maps_and_ignore_translations() {
        let map = DMat3::from_cols_array(&[0.9, -0.4, 0.2, 0.3, 1.2, -0.5, 0.1, 0.6, 0.7]);
        for mesh in [shapes::icosphere(2), shapes::plane_grid(5, 4, 2.0, 1.0).expect("valid")] {
            for kind in [EdgeWeightKind::Uniform, EdgeWeightKind::Cotangent] {
                let rows = Laplacian::new(&mesh, kind);
                let moved = mesh.positions.iter().map(|p| map * *p + DVec3::new(3.0, -1.0, 2.0)).collect();
                let moved = mesh.with_positions(moved).expect("finite");
                for i in 0..mesh.vertex_count() {
                    let expected = map * rows.apply(&mesh, i);
                    assert!(rows.apply(&moved, i).distance(expected) < 1e-12, "{kind:?}, vertex {i}");
                    let by_row: DVec3 = rows.row(&mesh, i).map(|(j, value)| value * mesh.positions[j as usize]).sum();
                    assert!(by_row.distance(rows.apply(&mesh, i)) < 1e-12);
                }
            }
        }
    }

    /// The mean of the neighbours; and twice the mean curvature vector, `2 x` on a unit sphere.
    #[test]
    fn coordinates_are_those_of_the_paper() {
        let sphere = shapes::icosphere(4);
        let uniform = Laplacian::new(&sphere, EdgeWeightKind::Uniform);
        let cotangent = Laplacian::new(&sphere, EdgeWeightKind::Cotangent);
        let areas = mixed_voronoi_areas(&sphere);
        for (i, &p) in sphere.positions.iter().enumerate() {
            let ring = sphere.topology().neighbours(i);
            let mean = ring.iter().map(|&j| sphere.positions[j as usize]).sum::<DVec3>() / ring.len() as f64;
            assert!(uniform.apply(&sphere, i).distance(p - mean) < 1e-14);
            assert!((cotangent.apply(&sphere, i) / areas[i].sqrt()).distance(2.0 * p) < 0.02);
        }
    }
}
