use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::rotation::outer;
use crate::{Topology, best_rotation, best_scale};

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
        self.matrices.par_iter_mut().enumerate().with_min_len(256).for_each(|(j, frame)| {
            *frame = ring_frame(topology, rest, pose, fit, j);
        });
    }
}

fn ring_frame(topology: &Topology, rest: &[DVec3], pose: &[DVec3], fit: FrameFit, j: usize) -> DMat3 {
    let (mut covariance, mut square) = (DMat3::ZERO, 0.0);
    let mut changed = false;
    for &k in topology.neighbours(j) {
        let from = rest[k as usize] - rest[j];
        let to = pose[k as usize] - pose[j];
        changed |= from != to;
        let length = from.length();
        if length > 0.0 {
            covariance += outer(to / length, from);
            square += length;
        }
    }
    if !changed {
        return DMat3::IDENTITY;
    }
    let rotation = best_rotation(covariance);
    match fit {
        FrameFit::Rotation => rotation,
        FrameFit::Similarity => rotation * best_scale(rotation, covariance, square),
    }
}
