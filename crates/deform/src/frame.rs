//! The frame that everything is computed in, and the checks at its door.

use glam::DVec3;
use pliant_mesh::{MeshError, TriMesh};

use crate::DeformError;
use crate::error::HandleFault;

/// Farthest goal, in diagonals of the rest shape: squares of it and their products must not overflow.
const FARTHEST: f64 = 1e100;

/// A frame centred on the rest shape, in which its diagonal is between 1/2 and 1.
///
/// The scale is a power of two, so going there and back rounds only once.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    centre: DVec3,
    scale: f64,
    /// Of the scale; exact too.
    inverse: f64,
}

impl Frame {
    pub(crate) fn of(mesh: &TriMesh) -> Self {
        let (centre, scale) = mesh.bounds().normal_frame();
        // Keeps the exponent and drops the digits.
        let power = f64::from_bits(scale.clamp(f64::MIN_POSITIVE, 1e300).to_bits() & 0xFFF0_0000_0000_0000);
        Self { centre, scale: power, inverse: 1.0 / power }
    }

    pub(crate) fn enter(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    pub(crate) fn leave(&self, inner: DVec3) -> DVec3 {
        inner * self.inverse + self.centre
    }

    /// World units of an energy, per unit in the frame.
    pub(crate) fn energy_unit(&self) -> f64 {
        self.inverse * self.inverse
    }

    /// A handle vertex's goal in the frame, if it can be computed with.
    pub(crate) fn enter_goal(&self, goal: DVec3, handle: u32, vertex: u32) -> Result<DVec3, DeformError> {
        let inner = self.enter(goal);
        if is_near(inner) {
            Ok(inner)
        } else {
            Err(DeformError::handle(handle as usize, HandleFault::TooFar { vertex }))
        }
    }

    /// The sum in the frame that has the given sum in the world, of points with weights that sum to `weight`; if it can be
    /// computed with.
    pub(crate) fn enter_sum(&self, world: DVec3, weight: f64) -> Option<DVec3> {
        let inner = (world - weight * self.centre) * self.scale;
        is_near(inner).then_some(inner)
    }

    /// World units of a length, per unit in the frame.
    pub(crate) fn length_unit(&self) -> f64 {
        self.inverse
    }
}

/// Written so that NaN and infinity are too far.
fn is_near(inner: DVec3) -> bool {
    inner.abs().max_element() <= FARTHEST
}

/// Whether there are as many as there should be.
pub(crate) fn check_count(what: &'static str, expected: usize, found: usize) -> Result<(), DeformError> {
    if expected == found { Ok(()) } else { Err(DeformError::WrongCount { what, expected, found }) }
}

/// Whether a pose fits a mesh of `vertices` vertices and is finite.
pub(crate) fn check_pose(vertices: usize, positions: &[DVec3]) -> Result<(), DeformError> {
    check_count("positions", vertices, positions.len())?;
    match positions.iter().position(|p| !p.is_finite()) {
        Some(vertex) => Err(MeshError::NotFinite { vertex }.into()),
        None => Ok(()),
    }
}
