//! What depends on the rest shape and the options alone.

use glam::DVec3;
use pliant_mesh::{Topology, TriMesh};

use super::{ArapEnergy, ArapOptions};
use crate::DeformError;
use crate::operators::{FaceWeights, edge_sums, edge_weights};

/// A rest shape with weights.
pub(super) struct Shape {
    /// In world units.
    pub(super) rest: TriMesh,
    pub(super) frame: Frame,
    /// Rest positions in the frame.
    pub(super) inner: Vec<DVec3>,
    /// Weight of each edge in the Laplacian.
    pub(super) edges: Vec<f64>,
    /// Weights within faces, if cells have rims.
    pub(super) faces: Option<FaceWeights>,
    /// Weights that had to be changed.
    pub(super) clamped: usize,
}

impl Shape {
    pub(super) fn new(options: &ArapOptions, rest: &TriMesh) -> Result<Self, DeformError> {
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
                (edge_sums(inner.topology(), &weights.values), Some(weights), clamped)
            }
        };
        Ok(Self { rest: rest.clone(), frame, inner: inner.positions, edges, faces, clamped })
    }

    pub(super) fn topology(&self) -> &Topology {
        self.rest.topology()
    }

    /// In how many cells each share of an edge's weight is counted: both ends, or the three corners of a face.
    pub(super) fn multiplicity(&self) -> f64 {
        if self.faces.is_none() { 2.0 } else { 3.0 }
    }
}

/// A centred frame of unit size. The scale is a power of two, so going there and back rounds only once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    centre: DVec3,
    scale: f64,
    /// Of the scale; exact too.
    inverse: f64,
}

impl Frame {
    fn of(mesh: &TriMesh) -> Self {
        let (centre, scale) = mesh.bounds().normal_frame();
        // Keeps the exponent and drops the digits.
        let power = f64::from_bits(scale.clamp(f64::MIN_POSITIVE, 1e300).to_bits() & 0xFFF0_0000_0000_0000);
        Self { centre, scale: power, inverse: 1.0 / power }
    }

    pub(super) fn enter(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    pub(super) fn leave(&self, inner: DVec3) -> DVec3 {
        inner * self.inverse + self.centre
    }

    /// World units of an energy, per unit in the frame.
    pub(super) fn energy_unit(&self) -> f64 {
        self.inverse * self.inverse
    }
}
