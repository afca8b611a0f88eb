//! The rows of the Laplacian that unknowns take part in, and those of soft handles.

use glam::DVec3;
use pliant_linalg::{LinalgError, SparseRows};
use pliant_mesh::{TriMesh, mixed_voronoi_areas};

use crate::operators::{EdgeWeightKind, edge_weights};
use crate::patch::{Held, Patch};

/// Smallest area of a vertex, as a share of the mean: below it is a needle, whose row would drown all others.
const SMALLEST_AREA: f64 = 1e-6;

/// Laplacian coordinates of vertices: `sqrt(a_i) / m_i sum_j w_ij (v_i - v_j)`, the square root being part of each row.
pub(super) struct Rows {
    /// Vertex of the patch that each row belongs to, increasing.
    pub(super) centres: Vec<u32>,
    /// Row `k` has `weights[offsets[k]..offsets[k + 1]]`, one per neighbour of its centre, in their order.
    offsets: Vec<u32>,
    weights: Vec<f64>,
    /// Edge weights and areas that had to be changed.
    pub(super) clamped: usize,
}

/// The weights `w_ij` of all edges and, per vertex, `sqrt(a_i) / m_i`; and how many had to be changed.
fn weights_and_factors(mesh: &TriMesh, kind: EdgeWeightKind) -> (Vec<f64>, Vec<f64>, usize) {
    let edges = edge_weights(mesh, kind);
    let mut clamped = edges.clamped;
    let factors = match kind {
        // a = 1, m the number of neighbours.
        EdgeWeightKind::Uniform => {
            let degree = |v: usize| mesh.topology().neighbours(v).len().max(1);
            (0..mesh.vertex_count()).map(|v| 1.0 / degree(v) as f64).collect()
        }
        // a = m, the area.
        EdgeWeightKind::Cotangent => {
            let areas = mixed_voronoi_areas(mesh);
            let smallest = SMALLEST_AREA * areas.iter().sum::<f64>() / areas.len().max(1) as f64;
            clamped += areas.iter().filter(|area| **area < smallest).count();
            // With no area at all any will do.
            areas.iter().map(|area| area.max(smallest)).map(|a| if a > 0.0 { 1.0 / a.sqrt() } else { 1.0 }).collect()
        }
    };
    (edges.values, factors, clamped)
}

impl Rows {
    /// The rows of the unknowns of a patch and of their neighbours; the patch has two rings.
    pub(super) fn new(patch: &Patch, kind: EdgeWeightKind) -> Self {
        let topology = patch.mesh.topology();
        let (edges, factors, clamped) = weights_and_factors(&patch.mesh, kind);
        let is_unknown = |v: u32| patch.held[v as usize].is_unknown();
        let centres: Vec<u32> = (0..patch.held.len() as u32)
            .filter(|&v| is_unknown(v) || topology.neighbours(v as usize).iter().any(|&w| is_unknown(w)))
            .collect();
        let (mut offsets, mut weights) = (vec![0], Vec::new());
        for &v in &centres {
            let ring = topology.neighbour_edges(v as usize);
            weights.extend(ring.iter().map(|&e| factors[v as usize] * edges[e as usize]));
            offsets.push(weights.len() as u32);
        }
        Self { centres, offsets, weights, clamped }
    }

    /// The weights of a row, one per neighbour of its centre.
    pub(super) fn weights(&self, row: usize) -> &[f64] {
        &self.weights[self.offsets[row] as usize..self.offsets[row + 1] as usize]
    }

    /// The Laplacian coordinates of a pose, one per row.
    pub(super) fn coordinates(&self, mesh: &TriMesh, pose: &[DVec3]) -> Vec<DVec3> {
        let of_row = |(row, &v): (usize, &u32)| {
            let ring = mesh.topology().neighbours(v as usize).iter().zip(self.weights(row));
            ring.map(|(&j, &w)| w * (pose[v as usize] - pose[j as usize])).sum()
        };
        self.centres.iter().enumerate().map(of_row).collect()
    }

    /// The matrix with a column per vertex of the patch: the rows of the Laplacian, and one per vertex of a soft handle.
    pub(super) fn matrix(&self, patch: &Patch) -> Result<SparseRows, LinalgError> {
        let mut matrix = SparseRows::new(patch.held.len());
        let mut diagonal = vec![0.0; patch.held.len()];
        for (row, &v) in self.centres.iter().enumerate() {
            let weights = self.weights(row);
            let total: f64 = weights.iter().sum();
            let ring = patch.mesh.topology().neighbours(v as usize).iter().zip(weights);
            diagonal[v as usize] += total * total;
            ring.clone().for_each(|(&j, w)| diagonal[j as usize] += w * w);
            matrix.push_row(std::iter::once((v, total)).chain(ring.map(|(&j, &w)| (j, -w))))?;
        }
        for (v, root) in springs(patch, &diagonal) {
            matrix.push_row([(v, root)])?;
        }
        Ok(matrix)
    }
}

/// Vertices of soft handles, increasing, with the square root of the stiffness: weight times the mean diagonal entry of the unknowns.
pub(super) fn springs<'a>(patch: &'a Patch, diagonal: &[f64]) -> impl Iterator<Item = (u32, f64)> + 'a {
    let of_unknowns = patch.held.iter().zip(diagonal).filter(|(held, _)| held.is_unknown());
    let (sum, count) = of_unknowns.fold((0.0, 0), |(sum, count), (_, d)| (sum + d, count + 1));
    // Lone vertices have no rows; any scale will do.
    let mean = if sum > 0.0 { sum / f64::from(count) } else { 1.0 };
    (0..).zip(&patch.held).filter_map(move |(v, held)| match *held {
        Held::Spring { weight, .. } => Some((v, (weight * mean).sqrt())),
        Held::Unknown | Held::Led { .. } | Held::Fixed => None,
    })
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use pliant_mesh::{VertexSet, shapes};

    use super::*;
    use crate::{Handle, Region};

    fn patches() -> Vec<Patch> {
        let all = |mesh: &TriMesh| {
            let n = mesh.vertex_count();
            let handle = Handle::hard(VertexSet::from_iter([0]));
            let region = Region::new(n, &VertexSet::all(n), &[handle]).expect("valid");
            Patch::new(mesh, &region, 2).expect("valid")
        };
        let bar = shapes::bar(6, 2, 2, DVec3::new(3.0, 1.0, 1.0)).expect("valid size");
        let plane = shapes::bumpy_plane(9, 7, 1.0, 1.0, 0.2, 1).expect("valid size");
        [shapes::icosphere(2), bar, plane].iter().map(all).collect()
    }

    const KINDS: [EdgeWeightKind; 2] = [EdgeWeightKind::Uniform, EdgeWeightKind::Cotangent];

    /// Yuan's Eq. 8-10: coordinates commute with every linear map, rotations among them, and do not see translations.
    #[test]
    fn coordinates_commute_with_linear_maps_and_ignore_translations() {
        for patch in patches() {
            for kind in KINDS {
                let rows = Rows::new(&patch, kind);
                let rest = rows.coordinates(&patch.mesh, &patch.mesh.positions);
                let size = rest.iter().map(|d| d.length()).fold(0.0, f64::max);
                for map in [
                    DMat3::from_axis_angle(DVec3::new(2.0, -1.0, 2.0) / 3.0, 2.1),
                    DMat3::from_cols(DVec3::new(1.0, 0.3, -2.0), DVec3::new(0.0, 0.7, 0.1), DVec3::new(0.4, 0.0, 1.5)),
                ] {
                    let moved: Vec<DVec3> =
                        patch.mesh.positions.iter().map(|p| map * *p + DVec3::new(3.0, -2.0, 1.0)).collect();
                    for (found, rest) in rows.coordinates(&patch.mesh, &moved).iter().zip(&rest) {
                        // Differences of numbers of about 5, times weights.
                        assert!(found.distance(map * *rest) < 1e-12 * size.max(1.0), "{found} {rest}");
                    }
                }
            }
        }
    }

    /// Uniform coordinates are the way from the mean of the neighbours; those with cotangents, divided by the square root of the area,
    /// are twice the mean curvature along the outward normal: `2 / r` on a sphere.
    #[test]
    fn coordinates_have_the_sign_and_size_of_their_definition() {
        for patch in patches() {
            let rows = Rows::new(&patch, EdgeWeightKind::Uniform);
            let coordinates = rows.coordinates(&patch.mesh, &patch.mesh.positions);
            assert_eq!(coordinates.len(), patch.mesh.vertex_count());
            for (&v, delta) in rows.centres.iter().zip(&coordinates) {
                let ring = patch.mesh.topology().neighbours(v as usize);
                let mean = ring.iter().map(|&j| patch.mesh.positions[j as usize]).sum::<DVec3>() / ring.len() as f64;
                assert!(delta.distance(patch.mesh.positions[v as usize] - mean) < 1e-15);
            }
        }
        let sphere = &patches()[0];
        let rows = Rows::new(sphere, EdgeWeightKind::Cotangent);
        let areas = mixed_voronoi_areas(&sphere.mesh);
        let radius = sphere.mesh.positions[0].length();
        for (v, delta) in rows.coordinates(&sphere.mesh, &sphere.mesh.positions).iter().enumerate() {
            let curvature = *delta / areas[v].sqrt();
            let expected = 2.0 / (radius * radius) * sphere.mesh.positions[v];
            assert!(curvature.distance(expected) < 0.02 * expected.length(), "{curvature} {expected}");
        }
    }

    /// With cotangents the rows make `L^T M^-1 L`: a sum over all rows of products of two of them, here densely.
    #[test]
    fn the_matrix_is_the_square_of_the_rows() {
        for patch in patches() {
            for kind in KINDS {
                let rows = Rows::new(&patch, kind);
                let matrix = rows.matrix(&patch).expect("small");
                assert_eq!(matrix.row_count(), rows.centres.len());
                let pose: Vec<DVec3> =
                    patch.mesh.positions.iter().map(|p| DVec3::new(p.y.sin(), p.x * p.z, 1.0)).collect();
                let x: Vec<[f64; 3]> = pose.iter().map(DVec3::to_array).collect();
                let mut out = vec![[0.0; 3]; matrix.row_count()];
                matrix.multiply(&x, &mut out).expect("fits");
                for (out, delta) in out.iter().zip(rows.coordinates(&patch.mesh, &pose)) {
                    assert!(delta.distance(DVec3::from(*out)) < 1e-12 * (1.0 + delta.length()));
                }
            }
        }
    }
}
