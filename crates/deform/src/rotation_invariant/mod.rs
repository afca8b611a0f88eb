//! Linear rotation-invariant coordinates.
//!
//! - Lipman, Sorkine, Levin, Cohen-Or. *Linear Rotation-invariant Coordinates for Meshes.* SIGGRAPH 2005.
//! - Yuan. *Realization of Linear Rotation-invariant Coordinates for Meshes.* Oregon State University, 2021: section and equation
//!   numbers are those of this paper.
//! - Meyer, Desbrun, Schröder, Barr. *Discrete Differential-Geometry Operators for Triangulated 2-Manifolds.* 2003.
//!
//! The shape is written down by what does not change when it is turned: how the frame of a vertex lies in that of its neighbour, and the
//! Laplacian coordinates of a vertex in its frame. From these and a few frames and positions that are given it is rebuilt
//! by two linear systems, one after the other: first all frames, then all positions. Both matrices depend on the rest shape and on
//! who is held alone, and are factored once.
//!
//! **What frames are held to.** A handle's frames are turned by its goal, whatever the goal's translation (Eq. 20); those of
//! fixed vertices next to free ones are read from the incoming pose. A handle that moves without turning thus bends nothing: the
//! shape is sheared towards it with its details upright. Goals that move and turn together
//! ([`Similarity::screw`](pliant_mesh::Similarity::screw), [`trackball`](pliant_mesh::Similarity::trackball)) are what the method
//! is made for; [`RotationInvariantOptions::coupling`] helps with others.
//!
//! **Turns wrap at half a turn.** The frame equations are linear in the matrices, and a matrix does not tell 200 degrees from -160:
//! between two handles frames take the short way, and beyond half a turn the other way round. Half a turn itself leaves the way open; the
//! result is finite. The turns of [`Goals`](crate::Goals) are not looked at.
//!
//! **Scale.** Means of rotations are shorter than rotations, so how long the vectors of a frame come out says nothing of the size. The
//! scale of a goal is carried by a system of its own, with the matrix of the frames: its logarithm is spread as they are, the frames are
//! made orthonormal again, and coordinates are multiplied by the scale. A common similarity of everything that is held is exact. Without
//! [`orthonormal`](RotationInvariantOptions::orthonormal) the scale is in the frames' vectors, as printed.

mod deformer;
mod frames;
mod laplacian;
mod orientation;
mod positions;
mod rim;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{DeformError, EdgeWeightKind, text};
pub use deformer::RotationInvariant;
pub use frames::{DiscreteFrames, Tangent};

/// Most coupling steps that may be asked for.
pub const MAX_COUPLING: u32 = 1000;

/// How positions follow from frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reconstruction {
    /// By the Laplacian coordinates in the frames (Yuan, Eq. 18-19): least squares over the Laplacian, an equation of fourth order. Smooth
    /// where handles begin.
    #[default]
    Laplacian,
    /// By the edges in the frames of both ends (Lipman et al. 2005): an equation of second order, with the matrix of the frames, so that
    /// there is only one factor. Prepared and solved for several times as fast, and stretches less; bends more sharply where handles
    /// begin. The tangent is not looked at, as frames of the rest shape cancel.
    Edges,
}

/// Options of deformation by rotation-invariant coordinates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RotationInvariantOptions {
    /// Weights of the Laplacian coordinates and of the edges in the frame equations. Default: cotangent, over Voronoi areas.
    pub weights: EdgeWeightKind,
    /// Default: by Laplacian coordinates.
    pub reconstruction: Reconstruction,
    /// First vector of the frames. The result is the same to rounding. Default: an edge.
    pub tangent: Tangent,
    /// Whether solved frames are made orthonormal again, as Lipman et al. do; without, as Yuan does, details shrink where
    /// neighbouring handles turn differently. Default: true.
    pub orthonormal: bool,
    /// How often frames are taken from the positions just solved for, and positions solved for again, at most
    /// [`MAX_COUPLING`]. Default: 0. Two or three do where [`Reconstruction::Edges`] is chosen; with Laplacian coordinates they help less, and
    /// many may do harm.
    ///
    /// The remedy that Yuan mentions (Eq. 21-22, after Sorkine et al. 2004) for positions that ask for other frames than the handles do:
    /// `T_i` is fitted to where the ring of a vertex has gone, and its Laplacian coordinate follows. Instead of writing `T_i` as a linear
    /// function of the unknown positions, which would make one system of thrice the size that has to be factored for every goal, the two
    /// are solved for in turn, with the factor there is. `T_i` is the best rotation, times the scale that the frames have.
    pub coupling: u32,
}

impl Default for RotationInvariantOptions {
    fn default() -> Self {
        Self {
            weights: EdgeWeightKind::default(),
            reconstruction: Reconstruction::default(),
            tangent: Tangent::default(),
            orthonormal: true,
            coupling: 0,
        }
    }
}

impl RotationInvariantOptions {
    /// As in Yuan's paper: uniform weights, tangents from the normal, frames as they are solved for.
    pub fn faithful() -> Self {
        Self { weights: EdgeWeightKind::Uniform, tangent: Tangent::Normal, orthonormal: false, ..Self::default() }
    }

    fn check(&self) -> Result<(), DeformError> {
        if self.coupling > MAX_COUPLING {
            let (expected, found) = ("at most 1000", self.coupling.to_string());
            return Err(DeformError::BadOption { option: "coupling", expected, found });
        }
        Ok(())
    }
}

/// The tokens that differ from the default, joined by `+`: `uniform+raw+coupling=3`.
impl fmt::Display for RotationInvariantOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { weights, reconstruction, tangent, orthonormal, coupling } = self;
        text::join(
            f,
            [
                text::word(*weights == EdgeWeightKind::Uniform, "uniform"),
                text::word(*reconstruction == Reconstruction::Edges, "edges"),
                text::word(*tangent == Tangent::Normal, "tangent-from-normal"),
                text::word(!orthonormal, "raw"),
                (*coupling != 0).then(|| format!("coupling={coupling}")),
            ],
        )
    }
}

/// Reads what `Display` writes; the defaults may be named too. Numbers are checked when the method is prepared.
impl FromStr for RotationInvariantOptions {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let mut options = Self::default();
        for token in text::tokens(text) {
            match token {
                "cotangent" => options.weights = EdgeWeightKind::Cotangent,
                "uniform" => options.weights = EdgeWeightKind::Uniform,
                "laplacian" => options.reconstruction = Reconstruction::Laplacian,
                "edges" => options.reconstruction = Reconstruction::Edges,
                "tangent-from-edge" => options.tangent = Tangent::Edge,
                "tangent-from-normal" => options.tangent = Tangent::Normal,
                "orthonormal" => options.orthonormal = true,
                "raw" => options.orthonormal = false,
                _ => match text::number(token, "coupling") {
                    Some(steps) => options.coupling = steps,
                    None => return Err(text::unknown(token, TOKENS)),
                },
            }
        }
        Ok(options)
    }
}

/// What the text form may have.
const TOKENS: &str =
    "cotangent, uniform, laplacian, edges, tangent-from-edge, tangent-from-normal, orthonormal, raw or coupling=N";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_as_they_are_printed() {
        let faithful = RotationInvariantOptions::faithful();
        assert_eq!(faithful.to_string(), "uniform+tangent-from-normal+raw");
        let coupled = RotationInvariantOptions {
            coupling: 3,
            reconstruction: Reconstruction::Edges,
            ..RotationInvariantOptions::default()
        };
        for options in [RotationInvariantOptions::default(), faithful, coupled] {
            assert_eq!(options.to_string().parse(), Ok(options.clone()));
            let json = serde_json::to_string(&options).expect("serialises");
            assert_eq!(serde_json::from_str::<RotationInvariantOptions>(&json).expect("reads"), options);
        }
        for bad in ["rough", "raw+", "coupling=-1", "coupling", "uniform raw"] {
            let error = bad.parse::<RotationInvariantOptions>().expect_err("unknown").to_string();
            assert!(error.contains("tangent-from-normal"), "{bad}: {error}");
        }
    }
}
