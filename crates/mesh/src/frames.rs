use glam::{DMat3, DVec3};
use pulp::{Arch, Simd, WithSimd};
use serde::{Deserialize, Serialize};

use crate::threads::{CHUNK, among_threads, for_each_chunk};
use crate::{LANES, RotationBatch, Topology, best_scale};

/// What a frame may do to the ring round its vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameFit {
    /// Turn it.
    #[default]
    Rotation,
    /// Turn it and scale it uniformly: for edits that change sizes.
    Similarity,
}

/// For each vertex the matrix `M_j` that best takes its one-ring from the rest pose to another pose.
///
/// Depends on positions alone, so any solver's result has frames.
#[derive(Debug, Clone, Default)]
pub struct Frames {
    /// One matrix per vertex: a proper rotation, times a scale under [`FrameFit::Similarity`].
    pub matrices: Vec<DMat3>,
    /// Rest and pose of each vertex, padded to the width of a register.
    points: Vec<[Row; 2]>,
    /// Inverse rest length of each edge, 0 for an edge without length.
    weights: Vec<f64>,
}

/// A point and a 0.
type Row = [f64; 4];

impl Frames {
    /// Recomputes all frames in place, in parallel; allocates only on the first call.
    ///
    /// The fit minimises `sum_k |M (y_k - y_j) - (y'_k - y'_j)|^2 / |y_k - y_j|` over the ring. Weighting by inverse
    /// length keeps one long edge of an uneven control mesh from deciding alone. A ring that has not changed gives the
    /// identity exactly.
    ///
    /// # Panics
    /// If the slices are not one position per vertex of `topology`.
    pub fn fit(&mut self, topology: &Topology, rest: &[DVec3], pose: &[DVec3], fit: FrameFit) {
        assert_eq!(rest.len(), topology.vertex_count());
        assert_eq!(pose.len(), topology.vertex_count());
        self.matrices.resize(rest.len(), DMat3::IDENTITY);
        let padded = |p: &DVec3| [p.x, p.y, p.z, 0.0];
        self.points.clear();
        self.points.extend(rest.iter().zip(pose).map(|(rest, pose)| [padded(rest), padded(pose)]));
        self.weights.resize(topology.edges().len(), 0.0);
        let Self { matrices, points, weights } = self;
        among_threads(rest.len(), || {
            for_each_chunk(weights, |chunk, weights| {
                let edges = &topology.edges()[chunk * CHUNK..][..weights.len()];
                Arch::new().dispatch(WeighEdges { edges, points, weights });
            });
            for_each_chunk(matrices, |chunk, frames| {
                Arch::new().dispatch(FitRings { topology, points, weights, fit, first: chunk * CHUNK, frames });
            });
        });
    }
}

#[inline(always)]
fn subtract(a: Row, b: Row) -> Row {
    std::array::from_fn(|c| a[c] - b[c])
}

/// The weights of some edges: in a pass of their own, as roots and quotients are slow one at a time.
struct WeighEdges<'a> {
    edges: &'a [[u32; 2]],
    points: &'a [[Row; 2]],
    weights: &'a mut [f64],
}

impl WithSimd for WeighEdges<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { edges, points, weights } = self;
        for (&[a, b], weight) in edges.iter().zip(&mut *weights) {
            let [x, y, z, _] = subtract(points[a as usize][0], points[b as usize][0]);
            *weight = x * x + y * y + z * z;
        }
        for weight in weights {
            *weight = if *weight > 0.0 { 1.0 / weight.sqrt() } else { 0.0 };
        }
    }
}

/// Fits the frames of the vertices from `first` on.
struct FitRings<'a> {
    topology: &'a Topology,
    points: &'a [[Row; 2]],
    weights: &'a [f64],
    fit: FrameFit,
    first: usize,
    frames: &'a mut [DMat3],
}

impl WithSimd for FitRings<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { topology, points, weights, fit, first, frames } = self;
        let mut batch = RotationBatch::default();
        let (mut waiting, mut squares, mut count) = ([0; LANES], [0.0; LANES], 0);
        for at in 0..frames.len() {
            let ring = Ring::new(topology, points, weights, first + at);
            if ring.changed {
                let [x, y, z] = ring.columns;
                batch.set(count, &[[x[0], x[1], x[2]], [y[0], y[1], y[2]], [z[0], z[1], z[2]]]);
                (waiting[count], squares[count]) = (at, ring.square);
                count += 1;
            } else {
                frames[at] = DMat3::IDENTITY;
            }
            if count == LANES || (at + 1 == frames.len() && count > 0) {
                let covariances = (fit == FrameFit::Similarity).then_some(batch);
                batch.fit(count);
                for (lane, &at) in waiting[..count].iter().enumerate() {
                    let rotation = DMat3::from_cols_array_2d(&batch.get(lane));
                    frames[at] = rotation;
                    if let Some(covariances) = &covariances {
                        let covariance = DMat3::from_cols_array_2d(&covariances.get(lane));
                        frames[at] *= best_scale(rotation, covariance, squares[lane]);
                    }
                }
                count = 0;
            }
        }
    }
}

/// What the ring of a vertex says about its frame.
struct Ring {
    /// Columns of the covariance, padded to the width of a register.
    columns: [Row; 3],
    /// Summed weighted square length at rest.
    square: f64,
    changed: bool,
}

impl Ring {
    #[inline(always)]
    fn new(topology: &Topology, points: &[[Row; 2]], weights: &[f64], j: usize) -> Self {
        let mut ring = Self { columns: [[0.0; 4]; 3], square: 0.0, changed: false };
        let [rest, pose] = points[j];
        for (&k, &edge) in topology.neighbours(j).iter().zip(topology.neighbour_edges(j)) {
            let [rest_end, pose_end] = points[k as usize];
            let (from, to) = (subtract(rest_end, rest), subtract(pose_end, pose));
            ring.changed |= from != to;
            let weight = weights[edge as usize];
            let weighted: Row = std::array::from_fn(|c| from[c] * weight);
            for (column, weighted) in ring.columns.iter_mut().zip(weighted) {
                for (sum, to) in column.iter_mut().zip(to) {
                    *sum += to * weighted;
                }
            }
            ring.square += weighted[0] * from[0] + weighted[1] * from[1] + weighted[2] * from[2];
        }
        ring
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::{Similarity, TriMesh, shapes};

    fn fitted(mesh: &TriMesh, pose: &[DVec3], fit: FrameFit) -> Vec<DMat3> {
        let mut frames = Frames::default();
        frames.fit(mesh.topology(), &mesh.positions, pose, fit);
        frames.matrices
    }

    fn shapes() -> Vec<TriMesh> {
        let plane = shapes::bumpy_plane(9, 7, 1.0, 1.0, 0.0, 1).expect("valid size");
        let bar = shapes::bar(5, 2, 2, DVec3::new(3.0, 1.0, 1.0)).expect("valid size");
        vec![shapes::icosphere(2), plane, bar, shapes::cactus(600).expect("in range")]
    }

    fn distance(a: DMat3, b: DMat3) -> f64 {
        (0..3).map(|c| (a.col(c) - b.col(c)).length()).fold(0.0, f64::max)
    }

    #[test]
    fn frames_at_rest_are_the_identity_to_the_bit() {
        for mesh in shapes() {
            for fit in [FrameFit::Rotation, FrameFit::Similarity] {
                assert!(fitted(&mesh, &mesh.positions, fit).iter().all(|m| *m == DMat3::IDENTITY));
            }
        }
    }

    /// Flat rings too: the turn of a plane is fixed by two directions. Any angle, half turns included.
    #[test]
    fn rigid_motions_and_similarities_are_reproduced() {
        for mesh in shapes() {
            for (angle, scale) in [(0.3, 1.0), (2.9, 1.0), (std::f64::consts::PI, 1.0), (1.2, 0.01), (2.0, 40.0)] {
                let rotation = DQuat::from_axis_angle(DVec3::new(1.0, -2.0, 0.7).normalize(), angle);
                let map = Similarity { rotation, scale, translation: DVec3::new(0.3, 5.0, -1.0) };
                let pose: Vec<DVec3> = mesh.positions.iter().map(|p| map.apply(*p)).collect();
                for matrix in fitted(&mesh, &pose, FrameFit::Rotation) {
                    assert!(distance(matrix, DMat3::from_quat(rotation)) < 1e-10, "angle {angle}, scale {scale}");
                }
                for matrix in fitted(&mesh, &pose, FrameFit::Similarity) {
                    assert!(distance(matrix, map.linear()) < 1e-10 * scale.max(1.0), "angle {angle}, scale {scale}");
                }
            }
        }
    }

    /// Frames are proper rotations whatever happens to the ring, also when it collapses or turns inside out.
    #[test]
    fn frames_of_any_pose_are_proper_rotations() {
        let mesh = shapes::icosphere(2);
        let flat: Vec<DVec3> = mesh.positions.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
        let mirrored: Vec<DVec3> = mesh.positions.iter().map(|p| -*p).collect();
        let point = vec![DVec3::ONE; mesh.vertex_count()];
        for pose in [flat, mirrored, point] {
            for m in fitted(&mesh, &pose, FrameFit::Rotation) {
                assert!(distance(m * m.transpose(), DMat3::IDENTITY) < 1e-12);
                assert!((m.determinant() - 1.0).abs() < 1e-12);
            }
        }
    }

    /// A vertex without neighbours has the identity, and frames are the same bits for any number of threads.
    #[test]
    fn lone_vertices_and_threads() {
        let mut positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
        let mesh = TriMesh::new(positions.clone(), vec![[0, 1, 2]]).expect("one face");
        positions[1] *= 2.0;
        positions[3] *= 2.0;
        assert_eq!(fitted(&mesh, &positions, FrameFit::Similarity)[3], DMat3::IDENTITY);

        let mesh = shapes::icosphere(4);
        let pose: Vec<DVec3> =
            mesh.positions.iter().map(|p| *p + 0.3 * DVec3::new(p.y.sin(), p.z, p.x * p.y)).collect();
        let bits = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
            let matrices = pool.install(|| fitted(&mesh, &pose, FrameFit::Similarity));
            matrices.iter().flat_map(|m| m.to_cols_array().map(f64::to_bits)).collect::<Vec<_>>()
        };
        assert!(bits(1) == bits(2) && bits(2) == bits(4));
    }
}
