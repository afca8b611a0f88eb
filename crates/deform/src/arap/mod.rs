//! As-rigid-as-possible surface modeling.
//!
//! - Sorkine, Alexa. *As-Rigid-As-Possible Surface Modeling.* SGP 2007. The energy, the two steps and the initial
//!   guess.
//! - Borosan, Howard, Zhang, Nealen. *Hybrid Mesh Editing.* Eurographics 2010, section 2.1: the same with weights 1
//!   and two iterations. Its Eq. 2 prints the covariance as `sum w e e^T`; it must be `sum w e' e^T`, and the rotation
//!   proper.
//! - Chao, Pinkall, Sanan, Schröder. *A Simple Geometric Model for Elastic Deformation.* SIGGRAPH 2010: spokes and
//!   rims.
//! - Levi, Gotsman. *Smooth Rotation Enhanced As-Rigid-As-Possible Mesh Animation.* IEEE TVCG 21(2), 2015: cells that also want
//!   the rotations of their neighbours.
//!
//! Points between vertices are held by conditions on the global step, hard ones by the method of multipliers: one or two more solves with
//! the same factor each, in which the vertices of a point are coupled.
//!
//! An iteration is a *local* step (the best rotation of each cell, positions held) and a *global* step (positions,
//! rotations held: a linear system whose matrix never changes). Both minimise the same energy, so it never rises.

mod anderson;
mod carried;
pub(crate) mod cells;
mod deformer;
mod edit;
mod moves;
pub(crate) mod roles;
mod rows;
pub(crate) mod shape;
mod smooth;
pub(crate) mod steps;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use crate::operators::EdgeWeightKind;
use crate::{DeformError, text};
pub use deformer::Arap;

/// Most iterations that may be asked for.
pub const MAX_ITERATIONS: u32 = 1_000_000;

/// Farthest that [`Acceleration::Anderson`] may look back.
pub const MAX_WINDOW: u32 = 20;

/// Which edges the cell of a vertex has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArapEnergy {
    /// The edges at the vertex (Sorkine and Alexa 2007).
    Spokes,
    /// All edges of the faces round the vertex (Chao et al. 2010): bends more smoothly, at nearly the same cost, with milder worst cases
    /// on cages (`data/quality.md`).
    #[default]
    SpokesAndRims,
}

/// How iterations learn from the ones before them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Acceleration {
    /// Not at all.
    #[default]
    None,
    /// Anderson acceleration, safeguarded (Peng et al. 2018): the iteration is repeated where the energy would rise, so it never does.
    ///
    /// Pays where many iterations are done: from the third on, and never in the last. Costs one pass over the edges an iteration more.
    Anderson {
        /// How many steps back it looks, 1 to [`MAX_WINDOW`]; 5 is a good choice.
        window: u32,
    },
}

/// Where iterations start from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// The rotations of the incoming pose, after it has been moved along with the constraints: what was dragged so far goes on.
    #[default]
    Pose,
    /// The turns of the handles, carried over the region by harmonic fields (Zayer et al. 2005, *Harmonic Guidance for Surface
    /// Deformation*), whatever the incoming pose of the vertices solved for. Follows turns of any angle
    /// ([`Goals::with_turns`](crate::Goals::with_turns)) in one solve, but a handle that is only moved turns nothing. What is
    /// fixed counts as one more handle, turned as its vertices next to the region are. Costs one global step more.
    Propagated,
}

/// Options of as-rigid-as-possible deformation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArapOptions {
    /// Default: cotangent.
    pub weights: EdgeWeightKind,
    /// Default: spokes and rims.
    pub energy: ArapEnergy,
    /// What differences between the rotations of neighbouring cells count, `alpha` of Levi and Gotsman (2015): a pure number, 0 or more. Bends
    /// are spread over more of the surface the higher it is; 0.01 is a good choice. The energy falls more slowly, as rotations spread by a
    /// ring or a few an iteration. Default: 0, not at all.
    pub smoothness: f64,
    /// Iterations after the initial guess, at most [`MAX_ITERATIONS`]; with a tolerance, the most that are done.
    /// Default: 2. With 0 the result is the guess.
    pub iterations: u32,
    /// If given, iterations stop as soon as one has lowered the energy by no more than this share of it; a number of 0
    /// or more. 1e-4 is hard to tell from convergence by eye. Costs one local step and one pass over the edges more.
    /// Default: none.
    pub tolerance: Option<f64>,
    /// Default: none.
    pub acceleration: Acceleration,
    /// Default: the incoming pose.
    pub start: Start,
}

impl Default for ArapOptions {
    fn default() -> Self {
        Self {
            weights: EdgeWeightKind::default(),
            energy: ArapEnergy::default(),
            smoothness: 0.0,
            iterations: 2,
            tolerance: None,
            acceleration: Acceleration::None,
            start: Start::Pose,
        }
    }
}

impl ArapOptions {
    /// As in *Hybrid Mesh Editing*: weights 1, spokes, two iterations.
    pub fn faithful() -> Self {
        Self { weights: EdgeWeightKind::Uniform, energy: ArapEnergy::Spokes, ..Self::default() }
    }

    /// Iterates until the energy falls by less than 1e-6 of itself, at most 1000 times.
    pub fn converged() -> Self {
        Self { iterations: 1000, tolerance: Some(1e-6), ..Self::default() }
    }

    fn check(&self) -> Result<(), DeformError> {
        if self.iterations > MAX_ITERATIONS {
            let (expected, found) = ("at most 1000000", self.iterations.to_string());
            return Err(DeformError::BadOption { option: "iterations", expected, found });
        }
        if let Acceleration::Anderson { window } = self.acceleration
            && !(1..=MAX_WINDOW).contains(&window)
        {
            let (expected, found) = ("1 to 20", window.to_string());
            return Err(DeformError::BadOption { option: "window", expected, found });
        }
        let numbers = [("tolerance", self.tolerance.unwrap_or(0.0)), ("smoothness", self.smoothness)];
        match numbers.into_iter().find(|(_, x)| !(*x >= 0.0 && x.is_finite())) {
            Some((option, x)) => {
                Err(DeformError::BadOption { option, expected: "a number of 0 or more", found: x.to_string() })
            }
            None => Ok(()),
        }
    }
}

/// The tokens that differ from the default, joined by `+`: `uniform+spokes-and-rims+iterations=5`.
impl fmt::Display for ArapOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { weights, energy, smoothness, iterations, tolerance, acceleration, start } = self;
        text::join(
            f,
            [
                text::word(*weights == EdgeWeightKind::Uniform, "uniform"),
                text::word(*energy == ArapEnergy::Spokes, "spokes"),
                (*smoothness != 0.0).then(|| format!("smooth={smoothness}")),
                (*iterations != Self::default().iterations).then(|| format!("iterations={iterations}")),
                tolerance.map(|tolerance| format!("tolerance={tolerance:e}")),
                match acceleration {
                    Acceleration::None => None,
                    Acceleration::Anderson { window } => Some(format!("anderson={window}")),
                },
                text::word(*start == Start::Propagated, "propagated"),
            ],
        )
    }
}

/// Reads what `Display` writes; the defaults may be named too. Numbers are checked when the method is prepared.
impl FromStr for ArapOptions {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let mut options = Self::default();
        for token in text::tokens(text) {
            match token {
                "cotangent" => options.weights = EdgeWeightKind::Cotangent,
                "uniform" => options.weights = EdgeWeightKind::Uniform,
                "spokes" => options.energy = ArapEnergy::Spokes,
                "spokes-and-rims" => options.energy = ArapEnergy::SpokesAndRims,
                "pose" => options.start = Start::Pose,
                "propagated" => options.start = Start::Propagated,
                _ => {
                    if let Some(iterations) = text::number(token, "iterations") {
                        options.iterations = iterations;
                    } else if let Some(smoothness) = text::number(token, "smooth") {
                        options.smoothness = smoothness;
                    } else if let Some(tolerance) = text::number(token, "tolerance") {
                        options.tolerance = Some(tolerance);
                    } else if let Some(window) = text::number(token, "anderson") {
                        options.acceleration = Acceleration::Anderson { window };
                    } else {
                        return Err(text::unknown(token, TOKENS));
                    }
                }
            }
        }
        Ok(options)
    }
}

/// What the text form may have.
const TOKENS: &str =
    "cotangent, uniform, spokes, spokes-and-rims, smooth=X, iterations=N, tolerance=X, anderson=N, pose or propagated";
