//! What can be chosen.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::{DeformError, EdgeWeightKind, text};

/// Most rings of neighbours whose gradients may be kept alike.
pub const MAX_RINGS: u32 = 8;

/// Which of a handle's data constrain the first system (Eq. 7).
///
/// Vertices outside the region of interest always hold their places, and with [`Both`](Self::Both) and
/// [`Gradients`](Self::Gradients) also the similarity that their fixed neighbours have undergone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImplicitConstraints {
    /// Positions and deformation gradients: the gradient of a handle's vertex is the linear part of its goal.
    #[default]
    Both,
    /// Positions alone: what a handle's goal turns and scales besides moving its vertices is not looked at, except where positions
    /// leave gradients open (a handle of one vertex, vertices in a plane).
    Positions,
    /// Gradients alone: a handle's vertices are turned and scaled by its goal but free to be anywhere, hard ones too. Something else must
    /// say where: every part of the region has to touch fixed vertices.
    Gradients,
}

/// What becomes of the size of details where the surface is stretched or compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FeatureSize {
    /// As the paper recommends: kept while all goals are rigid, scaled as soon as the scale of one is off 1 by more than 1e-9.
    #[default]
    Auto,
    /// Kept (Eq. 9).
    Keep,
    /// Scaled by the root mean square of the gradient's singular values (Eq. 10). A similarity common to all handles is then
    /// reproduced; where gradients shrink between handles turned far against each other, details do too.
    Scale,
}

/// How far a solve goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImplicitStage {
    /// Both systems.
    #[default]
    Full,
    /// The first system alone (Eq. 7), with its shear: what the paper shows while a handle is dragged (section 6).
    Preview,
}

/// Options of implicit Laplacian editing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImplicitOptions {
    /// Weights of the Laplacian coordinates. Default: cotangent, over Voronoi areas, as the paper recommends: with uniform ones vertices drift
    /// along the surface (Fig. 4). Those are 1 over the number of neighbours.
    pub weights: EdgeWeightKind,
    /// How many rings of neighbours a vertex's gradient is compared with (Eq. 6), 1 to [`MAX_RINGS`]. Default: 2, the paper's.
    ///
    /// More rings suppress deformation in detail, if by little: from 1 to 5, length errors of bars bent and twisted by a right angle fell by
    /// less than a tenth. They cost: `k` rings have some `3 k (k + 1)` vertices, and a row of the matrix some `3 (k + 2) (k + 3)` entries.
    pub rings: u32,
    /// Default: both.
    pub constraints: ImplicitConstraints,
    /// Default: auto.
    pub features: FeatureSize,
    /// What `solve` does; both factors are prepared in either case. Default: full.
    pub stage: ImplicitStage,
}

impl Default for ImplicitOptions {
    fn default() -> Self {
        Self {
            weights: EdgeWeightKind::default(),
            rings: 2,
            constraints: ImplicitConstraints::default(),
            features: FeatureSize::default(),
            stage: ImplicitStage::default(),
        }
    }
}

impl ImplicitOptions {
    pub(super) fn check(&self) -> Result<(), DeformError> {
        if (1..=MAX_RINGS).contains(&self.rings) {
            return Ok(());
        }
        Err(DeformError::BadOption { option: "rings", expected: "1 to 8", found: self.rings.to_string() })
    }
}

/// The tokens that differ from the default, joined by `+`: `uniform+rings=1+scale-features`.
impl fmt::Display for ImplicitOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { weights, rings, constraints, features, stage } = self;
        text::join(
            f,
            [
                text::word(*weights == EdgeWeightKind::Uniform, "uniform"),
                (*rings != Self::default().rings).then(|| format!("rings={rings}")),
                text::word(*constraints == ImplicitConstraints::Positions, "positions"),
                text::word(*constraints == ImplicitConstraints::Gradients, "gradients"),
                text::word(*features == FeatureSize::Keep, "keep-features"),
                text::word(*features == FeatureSize::Scale, "scale-features"),
                text::word(*stage == ImplicitStage::Preview, "preview"),
            ],
        )
    }
}

/// Reads what `Display` writes; the defaults may be named too. Numbers are checked when the method is prepared.
impl FromStr for ImplicitOptions {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let mut options = Self::default();
        for token in text::tokens(text) {
            match token {
                "cotangent" => options.weights = EdgeWeightKind::Cotangent,
                "uniform" => options.weights = EdgeWeightKind::Uniform,
                "both" => options.constraints = ImplicitConstraints::Both,
                "positions" => options.constraints = ImplicitConstraints::Positions,
                "gradients" => options.constraints = ImplicitConstraints::Gradients,
                "auto-features" => options.features = FeatureSize::Auto,
                "keep-features" => options.features = FeatureSize::Keep,
                "scale-features" => options.features = FeatureSize::Scale,
                "full" => options.stage = ImplicitStage::Full,
                "preview" => options.stage = ImplicitStage::Preview,
                _ => match text::number(token, "rings") {
                    Some(rings) => options.rings = rings,
                    None => return Err(text::unknown(token, TOKENS)),
                },
            }
        }
        Ok(options)
    }
}

/// What the text form may have.
const TOKENS: &str = "cotangent, uniform, rings=N, both, positions, gradients, auto-features, keep-features, scale-features, full or preview";
