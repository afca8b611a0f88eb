//! Laplacian surface editing.
//!
//! - Sorkine, Cohen-Or, Lipman, Alexa, Rössl, Seidel. *Laplacian Surface Editing.* SGP 2004.
//! - Lipman, Sorkine, Cohen-Or, Levin, Rössl, Seidel. *Differential Coordinates for Interactive Mesh Editing.* SMI 2004.
//! - Zayer, Rössl, Karni, Seidel. *Harmonic Guidance for Surface Deformation.* Eurographics 2005.
//! - Yuan. *Mesh editing by linear rotation-invariant coordinates* (2021), section 3.2, Eq. 2-10: the basic form.
//! - Meyer, Desbrun, Schröder, Barr. *Discrete Differential-Geometry Operators for Triangulated 2-Manifolds.* 2003: areas.
//!
//! The Laplacian coordinates of a vertex say where it is relative to its neighbours,
//! `delta_i = (1 / m_i) sum_j w_ij (v_i - v_j)` (centre minus neighbours; Sorkine et al. have this sign, Fu et al. 2006 the other), with
//! `w = 1` and `m_i` the number of neighbours, or cotangent weights and the mixed Voronoi area. An edit looks for positions with given
//! coordinates, in the least-squares sense, subject to the handles:
//! `min sum_i a_i |L(v'_i) - T_i delta_i|^2 + sum_k s |v'_k - u_k|^2`, the second sum over the vertices of soft handles, those
//! of hard ones being eliminated (Yuan, Eq. 5 and 7, with both as rows). The first sum runs over every vertex that is an unknown or next
//! to one, so that the surface joins smoothly where it is held: the matrix is the block of the bi-Laplacian of the unknowns.
//!
//! Yuan's `a_i = 1` is kept for uniform weights. For cotangent weights `a_i` is the vertex's area: the matrix is then
//! `L^T M^-1 L`, which approximates the integral of the squared Laplacian, where `(M^-1 L)^T (M^-1 L)` would weigh a vertex by the inverse
//! square of its area and depend on how the surface is triangulated.
//!
//! Coordinates do not change when the shape is moved, but turn when it is turned; [`Details`] says what `T_i` is.

mod coupled;
mod deformer;
mod harmonic;
mod rows;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use crate::operators::EdgeWeightKind;
use crate::{DeformError, text};
pub use deformer::Laplacian;

/// What becomes of the Laplacian coordinates, that is of the details of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Details {
    /// They stay as they are, `T_i = 1`. Exact for a common translation of all that is held; turned handles shear the details, and by half a
    /// turn the region between them collapses.
    #[default]
    Plain,
    /// A first solution with `T_i` the rigid motion that fits the constraints tells how each vertex turns, by the best rotation of its
    /// edges, and a second one has its coordinates turned by that (Lipman et al. 2004, who take the rotation of a normal and a projected
    /// edge, and start from unturned coordinates). Exact for a common rigid motion.
    TwoStep,
    /// `T_i` is itself an unknown, `s_i + h_i x`, which fits the edges of the vertex best and is linear in the new positions (Sorkine et
    /// al. 2004): one system couples all three coordinates. For large turns this is no rotation; the shape is therefore
    /// moved by the similarity that fits the constraints before, which they do not do. Exact for a common similarity. Costs about nine
    /// times the memory and ten times the time.
    Similarity,
    /// `T_i` are the turns and scales of the handles, carried over the region by harmonic fields (Zayer et al. 2005): rotation
    /// vectors and logarithms of scales are interpolated, so that turns of any angle are followed
    /// ([`Goals::with_turns`](crate::Goals::with_turns)). What is fixed counts as one more handle, with the similarity that takes it from
    /// rest to where the pose has it, by its shortest turn. Coordinates are those of the bi-Laplacian system above, where Zayer et al. turn
    /// gradients and solve a Poisson system. Handles have to turn: a handle that is only moved turns nothing. Exact for a common
    /// similarity. A twist by `k` radians per unit of length narrows a tube of radius `r` to the part `1 / (1 + k^2 r^2)`, as with
    /// gradients.
    Propagated,
}

/// Options of Laplacian surface editing.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LaplacianOptions {
    /// Default: cotangent, with areas.
    pub weights: EdgeWeightKind,
    /// Default: plain.
    pub details: Details,
}

/// The tokens that differ from the default, joined by `+`: `uniform+two-step`.
impl fmt::Display for LaplacianOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let details = match self.details {
            Details::Plain => None,
            Details::TwoStep => Some("two-step"),
            Details::Similarity => Some("similarity"),
            Details::Propagated => Some("propagated"),
        };
        let weights = text::word(self.weights == EdgeWeightKind::Uniform, "uniform");
        text::join(f, [weights, details.map(str::to_owned)])
    }
}

/// Reads what `Display` writes; the defaults may be named too.
impl FromStr for LaplacianOptions {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let mut options = Self::default();
        for token in text::tokens(text) {
            match token {
                "cotangent" => options.weights = EdgeWeightKind::Cotangent,
                "uniform" => options.weights = EdgeWeightKind::Uniform,
                "plain" => options.details = Details::Plain,
                "two-step" => options.details = Details::TwoStep,
                "similarity" => options.details = Details::Similarity,
                "propagated" => options.details = Details::Propagated,
                _ => {
                    let expected = "cotangent, uniform, plain, two-step, similarity or propagated";
                    return Err(text::unknown(token, expected));
                }
            }
        }
        Ok(options)
    }
}
