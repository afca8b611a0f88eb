//! Refinement of a pose towards the converged full-resolution ARAP, in short steps.
//!
//! The preview of an edit solved on a cage and carried to the shape is near the minimum of the shape's own energy, but stiffer or
//! softer where the cage is. [`Refiner`] takes it there. A step is
//!
//! 1. the residual of the global step at the best rotations, which is the negative gradient of the energy (Sorkine and Alexa 2007, Eq. 7);
//! 2. the inverse of its matrix applied to it, by a factor or nearly by a multigrid cycle: alone, this is the plain global step;
//! 3. what the last steps taught about the energy's curvature (L-BFGS; Liu, Bouaziz, Kavan 2017, *Quasi-Newton Methods for Real-Time
//!    Simulation of Hyperelastic Materials*), which the matrix is only a bound of;
//! 4. the local step, which tells the energy. A step that would raise it is not taken.
//!
//! From the preview on a cage of 5 %, 1.05 times the converged energy and error took 3 to 6 % of the time of a converged direct solve, preparation of both included,
//! and 6 to 29 % of that of one with Anderson acceleration, on shapes of 10,000 to 1,000,000 vertices (`cargo bench --bench refine`).
//! Steps in the subspace of the cage saved a few full steps at most, while setting up `W^T L W` took as long as several: they did not pay.

mod inverse;
mod local;
mod memory;
mod refiner;
mod subspace;

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::{ArapEnergy, EdgeWeightKind};
pub use refiner::Refiner;

/// How the equations of a global step are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlobalSolver {
    /// Exactly, by a factor: fewer steps, but more time and memory to prepare the larger the region is.
    Factor,
    /// Nearly, by one multigrid cycle: prepared in linear time, on a chain of levels, for regions of a million vertices too.
    #[default]
    Multigrid,
}

/// Options of [`Refiner::prepare`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefineOptions {
    /// Default: cotangent.
    pub weights: EdgeWeightKind,
    /// Default: spokes and rims.
    pub energy: ArapEnergy,
    /// Default: multigrid.
    pub solver: GlobalSolver,
}

/// Where a step may go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StepKind {
    /// Along the motions of a cage.
    Subspace,
    /// Anywhere.
    Full,
}

/// What a step of a refinement came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineStep {
    /// Where it could go.
    pub kind: StepKind,
    /// Steps since the refinement began, this one included.
    pub iteration: u32,
    /// Energy after the step, in world units; see [`Arap::energy`](crate::arap::Arap::energy). Never above that before it.
    pub energy: f64,
    /// By what share of itself the step lowered the energy, 0 or more.
    pub relative_change: f64,
    /// Whether no step of this kind lowers the energy but for rounding: the pose was left as it was.
    pub settled: bool,
    /// How long the step took.
    pub elapsed: Duration,
}
