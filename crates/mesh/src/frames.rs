use glam::{DMat3, DVec3};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{LANES, RotationBatch, Topology, best_scale};

/// Vertices a thread fits in one go, some 10 us: fewer are not worth its start.
const CHUNK: usize = 512;

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
}

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
        self.matrices.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, frames)| {
            Arch::new().dispatch(FitRings { topology, rest, pose, fit, first: chunk * CHUNK, frames });
        });
    }
}

/// Fits the frames of the vertices from `first` on.
struct FitRings<'a> {
    topology: &'a Topology,
    rest: &'a [DVec3],
    pose: &'a [DVec3],
    fit: FrameFit,
    first: usize,
    frames: &'a mut [DMat3],
}

impl WithSimd for FitRings<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { topology, rest, pose, fit, first, frames } = self;
        let (mut batch, mut waiting) = (RotationBatch::default(), [(0, Ring::default()); LANES]);
        let mut count = 0;
        for at in 0..frames.len() {
            let ring = Ring::new(topology, rest, pose, first + at);
            if ring.changed {
                batch.set(count, &ring.covariance());
                waiting[count] = (at, ring);
                count += 1;
            } else {
                frames[at] = DMat3::IDENTITY;
            }
            if count == LANES || (at + 1 == frames.len() && count > 0) {
                batch.fit(count);
                for (lane, (at, ring)) in waiting[..count].iter().enumerate() {
                    let rotation = DMat3::from_cols_array_2d(&batch.get(lane));
                    frames[*at] = match fit {
                        FrameFit::Rotation => rotation,
                        FrameFit::Similarity => {
                            let covariance = DMat3::from_cols_array_2d(&ring.covariance());
                            rotation * best_scale(rotation, covariance, ring.square)
                        }
                    };
                }
                count = 0;
            }
        }
    }
}

/// What the ring of a vertex says about its frame.
#[derive(Clone, Copy, Default)]
struct Ring {
    /// Columns of the covariance, padded to the width of a register.
    columns: [[f64; 4]; 3],
    /// Summed weighted square length at rest.
    square: f64,
    changed: bool,
}

impl Ring {
    #[inline(always)]
    fn new(topology: &Topology, rest: &[DVec3], pose: &[DVec3], j: usize) -> Self {
        let mut ring = Self::default();
        let (rest_centre, pose_centre) = (rest[j], pose[j]);
        for &k in topology.neighbours(j) {
            let from = rest[k as usize] - rest_centre;
            let to = pose[k as usize] - pose_centre;
            ring.changed |= from != to;
            let length = from.length();
            // A weight of 0 where the length is.
            let weight = if length > 0.0 { 1.0 / length } else { 0.0 };
            let to = [to.x, to.y, to.z, 0.0];
            for (column, from) in ring.columns.iter_mut().zip(from.to_array()) {
                for (sum, to) in column.iter_mut().zip(to) {
                    *sum += to * (from * weight);
                }
            }
            ring.square += length;
        }
        ring
    }

    #[inline(always)]
    fn covariance(&self) -> [[f64; 3]; 3] {
        self.columns.map(|[x, y, z, _]| [x, y, z])
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
