//! From a shape to the numbers of a matrix: weights of edges, of edges within faces, and the Laplacian they make.

#[cfg(test)]
use pliant_linalg::Triplet;
#[cfg(test)]
use pliant_mesh::Topology;
use pliant_mesh::{EdgeWeights, TriMesh};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Largest ratio of two cotangent weights of a mesh.
///
/// A needle's cotangents reach 1e16; beside them the other edges of its vertices would vanish in rounding. An edge a
/// million times stiffer than usual is rigid already.
const MAX_SPREAD: f64 = 1e9;

/// How edges are weighted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EdgeWeightKind {
    /// Cotangents of the opposite angles, kept positive: the result depends little on how the surface is triangulated.
    #[default]
    Cotangent,
    /// 1 for every edge (Borosan et al. 2010, section 3). On cages, whose triangles the simplifier keeps even, a little better than
    /// cotangents; on shapes as they come up to twice as bad (`data/quality.md`).
    Uniform,
}

/// One positive weight per edge.
pub(crate) fn edge_weights(mesh: &TriMesh, kind: EdgeWeightKind) -> EdgeWeights {
    match kind {
        EdgeWeightKind::Uniform => EdgeWeights::uniform(mesh.topology()),
        EdgeWeightKind::Cotangent => {
            let mut weights = EdgeWeights::cotangent(mesh);
            let cap = cap(&weights.values);
            for w in &mut weights.values {
                if *w > cap {
                    *w = cap;
                    weights.clamped += 1;
                }
            }
            weights
        }
    }
}

fn cap(weights: &[f64]) -> f64 {
    MAX_SPREAD * weights.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Weights of the three edges of each face.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FaceWeights {
    /// Entry `k` of a face belongs to the edge opposite to its corner `k`. May be negative, but neither the energy of
    /// a face nor the sum over the faces of an edge is.
    pub(crate) values: Vec<[f64; 3]>,
    /// How many edges' weights were raised, and faces' lowered.
    pub(crate) clamped: usize,
}

impl FaceWeights {
    /// 1 for each edge of each face, or half the cotangent of the opposite angle.
    ///
    /// The cotangents of one face make a positive semidefinite form, whatever their signs, so they need no clamping;
    /// they are only scaled down together in a needle. Where an edge's sum over its faces is below the weight of
    /// [`edge_weights`] (that is, where that one was clamped), its faces share the difference.
    pub(crate) fn new(mesh: &TriMesh, kind: EdgeWeightKind) -> Self {
        if kind == EdgeWeightKind::Uniform {
            return Self { values: vec![[1.0; 3]; mesh.face_count()], clamped: 0 };
        }
        let topology = mesh.topology();
        let floor = EdgeWeights::cotangent(mesh);
        let cap = cap(&floor.values);
        let of_face = |face: usize| {
            let halves = half_cotangents(mesh.corners(face));
            let largest = halves.into_iter().fold(0.0f64, |m, h| m.max(h.abs()));
            if largest > cap { (halves.map(|h| h * (cap / largest)), 1) } else { (halves, 0) }
        };
        let (mut values, lowered): (Vec<[f64; 3]>, Vec<u8>) =
            (0..mesh.face_count()).into_par_iter().map(of_face).unzip();
        let clamped = floor.clamped + lowered.iter().map(|&one| usize::from(one)).sum::<usize>();
        let sums = topology.edge_sums(&values);
        values.par_iter_mut().enumerate().for_each(|(face, weights)| {
            for (w, edge) in weights.iter_mut().zip(topology.face_edges(face)) {
                let edge = edge as usize;
                let missing = floor.values[edge].min(cap) - sums[edge];
                if missing > 0.0 {
                    *w += missing / topology.edge_faces(edge).len() as f64;
                }
            }
        });
        Self { values, clamped }
    }
}

/// Half the cotangent at each corner; 0 in a face without area.
fn half_cotangents(p: [glam::DVec3; 3]) -> [f64; 3] {
    let halves = std::array::from_fn(|k| {
        let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        0.5 * u.dot(v) / u.cross(v).length()
    });
    if halves.iter().all(|h| h.is_finite()) { halves } else { [0.0; 3] }
}

/// The positive semidefinite Laplacian `+L`, `(L x)_i = sum_j w_ij (x_i - x_j)`: three entries per edge.
#[cfg(test)]
pub(crate) fn laplacian(topology: &Topology, weights: &[f64]) -> Vec<Triplet> {
    let entries =
        |(&[a, b], &w): (&[u32; 2], &f64)| [Triplet::new(a, a, w), Triplet::new(b, b, w), Triplet::new(a, b, -w)];
    topology.edges().iter().zip(weights).flat_map(entries).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    /// Two triangles over the unit square, the second folded up, and a corner drawn out.
    fn fold(stretch: f64) -> TriMesh {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1.0, 0.0), DVec3::new(stretch, 1.0, 0.5)];
        TriMesh::new(positions, vec![[0, 1, 2], [1, 3, 2]]).expect("valid")
    }

    #[test]
    fn faces_share_what_edges_have() {
        for stretch in [0.5, 1.0, 3.0] {
            let mesh = fold(stretch);
            let edge = edge_weights(&mesh, EdgeWeightKind::Cotangent);
            let face = FaceWeights::new(&mesh, EdgeWeightKind::Cotangent);
            assert_eq!(edge.clamped, face.clamped);
            for (sum, w) in mesh.topology().edge_sums(&face.values).iter().zip(&edge.values) {
                assert!((sum - w).abs() < 1e-12 * w.abs(), "{sum} instead of {w}");
            }
        }
    }

    /// The three cotangents of a triangle: their pairwise products sum to 1, so the halves' to a quarter.
    #[test]
    fn cotangents_of_a_triangle_are_positive_semidefinite() {
        for p in
            [[DVec3::ZERO, DVec3::X, DVec3::new(0.3, 0.1, 0.2)], [DVec3::ZERO, DVec3::X, DVec3::new(-4.0, 0.1, 0.2)]]
        {
            let [a, b, c] = half_cotangents(p);
            assert!((a * b + b * c + c * a - 0.25).abs() < 1e-9);
            assert!(a + b + c > 0.0);
        }
        assert_eq!(half_cotangents([DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]), [0.0; 3]);
    }

    #[test]
    fn needles_do_not_outweigh_the_rest() {
        for height in [1e-4, 1e-9, 1e-14, 0.0] {
            let mut mesh = fold(1.0);
            mesh.positions[3] = DVec3::new(0.5, 0.5, height);
            let edge = edge_weights(&mesh, EdgeWeightKind::Cotangent).values;
            let face = FaceWeights::new(&mesh, EdgeWeightKind::Cotangent);
            for weights in [edge, mesh.topology().edge_sums(&face.values)] {
                let largest = weights.iter().copied().fold(0.0, f64::max);
                let smallest = weights.iter().copied().fold(f64::INFINITY, f64::min);
                assert!(smallest > 0.0 && largest <= 3.0 * MAX_SPREAD * smallest, "{height}: {weights:?}");
            }
        }
    }

    #[test]
    fn rows_of_the_laplacian_sum_to_zero() {
        let mesh = fold(2.0);
        let weights = edge_weights(&mesh, EdgeWeightKind::Cotangent);
        let mut rows = [0.0; 4];
        for t in laplacian(mesh.topology(), &weights.values) {
            rows[t.row as usize] += t.value;
            if t.row != t.col {
                rows[t.col as usize] += t.value;
            }
        }
        assert!(rows.iter().all(|r| r.abs() < 1e-14), "{rows:?}");
    }
}
