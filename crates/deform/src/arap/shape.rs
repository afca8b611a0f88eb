//! What depends on the rest shape and the options alone.

use glam::DVec3;
use pliant_mesh::{Topology, TriMesh, face_area_vector};

use super::{ArapEnergy, ArapOptions};
use crate::DeformError;
use crate::frame::Frame;
use crate::operators::{FaceWeights, edge_weights};

/// A rest shape with weights.
pub(crate) struct Shape {
    /// In world units.
    pub(crate) rest: TriMesh,
    pub(crate) frame: Frame,
    /// Rest positions in the frame.
    pub(crate) inner: Vec<DVec3>,
    /// Weight of each edge in the Laplacian.
    pub(crate) edges: Vec<f64>,
    /// Weights within faces, if cells have rims.
    pub(crate) faces: Option<FaceWeights>,
    /// Weights that had to be changed.
    pub(crate) clamped: usize,
    /// `2 alpha A` of smooth rotations, in the frame; 0 if rotations are not smoothed.
    pub(crate) smoothing: f64,
}

impl Shape {
    pub(crate) fn new(options: &ArapOptions, rest: &TriMesh) -> Result<Self, DeformError> {
        let frame = Frame::of(rest);
        let inner = rest.with_positions(rest.positions.iter().map(|&p| frame.enter(p)).collect())?;
        let (edges, faces, clamped) = match options.energy {
            ArapEnergy::Spokes => {
                let weights = edge_weights(&inner, options.weights);
                (weights.values, None, weights.clamped)
            }
            ArapEnergy::SpokesAndRims => {
                let weights = FaceWeights::new(&inner, options.weights);
                let clamped = weights.clamped;
                (inner.topology().edge_sums(&weights.values), Some(weights), clamped)
            }
        };
        let area = |face: usize| face_area_vector(inner.corners(face)).length();
        let smoothing = match options.smoothness {
            0.0 => 0.0,
            alpha => 2.0 * alpha * (0..inner.face_count()).map(area).sum::<f64>(),
        };
        Ok(Self { rest: rest.clone(), frame, inner: inner.positions, edges, faces, clamped, smoothing })
    }

    pub(crate) fn topology(&self) -> &Topology {
        self.rest.topology()
    }

    /// In how many cells each share of an edge's weight is counted: both ends, or the three corners of a face.
    pub(crate) fn multiplicity(&self) -> f64 {
        if self.faces.is_none() { 2.0 } else { 3.0 }
    }
}
