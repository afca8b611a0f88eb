use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use glam::DVec3;
use pliant_mesh::TriMesh;
use serde::{Deserialize, Serialize};

use crate::arap::{Arap, ArapOptions};
use crate::dual::{DualLaplacian, DualLaplacianOptions};
use crate::implicit::{Implicit, ImplicitOptions, ImplicitReport};
use crate::laplacian::{Laplacian, LaplacianOptions};
use crate::rotation_invariant::{RotationInvariant, RotationInvariantOptions};
use crate::{DeformError, Goals, Region};

/// A deformation method with its options: what a command line parses, a session saves and a table prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Method {
    /// As-rigid-as-possible surface modeling: iterates, keeps lengths best.
    Arap(ArapOptions),
    /// Laplacian surface editing: one or two linear solves.
    Laplacian(LaplacianOptions),
    /// Linear rotation-invariant coordinates: two linear solves, frames from the goals' turns and then positions.
    RotationInvariant(RotationInvariantOptions),
    /// The Laplacian of the dual mesh: iterates, keeps details and turns them along. Exact for a common rigid motion.
    DualLaplacian(DualLaplacianOptions),
    /// Implicit Laplacian editing: two linear solves, follows rotations below pi and scales.
    Implicit(ImplicitOptions),
}

impl Default for Method {
    fn default() -> Self {
        Self::Arap(ArapOptions::default())
    }
}

impl Method {
    /// Assembles and factors what depends on the rest shape and on who is free, but not on where the handles go.
    ///
    /// # Errors
    /// [`DeformError::BadOption`], [`DeformError::WrongCount`] if the region was made for another mesh,
    /// [`DeformError::Mesh`] for a rest shape that is not finite, [`DeformError::Unconstrained`], [`DeformError::Singular`],
    /// [`DeformError::TooLarge`], and [`DeformError::PointsNotTaken`] for handles with rows by another method than
    /// [`Self::Arap`].
    pub fn prepare(&self, rest: &TriMesh, region: &Region) -> Result<Box<dyn Deformer>, DeformError> {
        match self {
            Self::Arap(options) => Ok(Box::new(Arap::prepare(options, rest, region)?)),
            Self::Laplacian(options) => Ok(Box::new(Laplacian::prepare(options, rest, region)?)),
            Self::RotationInvariant(options) => Ok(Box::new(RotationInvariant::prepare(options, rest, region)?)),
            Self::DualLaplacian(options) => Ok(Box::new(DualLaplacian::prepare(options, rest, region)?)),
            Self::Implicit(options) => Ok(Box::new(Implicit::prepare(options, rest, region)?)),
        }
    }
}

impl Method {
    /// Whether a solve iterates; the others solve linear systems, so that no number of iterations changes their result.
    pub fn iterates(&self) -> bool {
        matches!(self, Self::Arap(_) | Self::DualLaplacian(_))
    }

    /// The same method with the default number of iterations and tolerance, which the text form leaves out: its name in a table that has
    /// columns for these.
    #[must_use]
    pub fn with_default_iterations(&self) -> Self {
        match self {
            Self::Arap(options) => {
                let ArapOptions { iterations, tolerance, .. } = ArapOptions::default();
                Self::Arap(ArapOptions { iterations, tolerance, ..options.clone() })
            }
            Self::DualLaplacian(options) => {
                let DualLaplacianOptions { iterations, tolerance, .. } = DualLaplacianOptions::default();
                Self::DualLaplacian(DualLaplacianOptions { iterations, tolerance, ..options.clone() })
            }
            Self::Laplacian(_) | Self::RotationInvariant(_) | Self::Implicit(_) => self.clone(),
        }
    }

    /// The same method with exactly this many iterations a solve; one that does not iterate stays as it is.
    #[must_use]
    pub fn with_iterations(&self, iterations: u32) -> Self {
        match self {
            Self::Arap(options) => Self::Arap(ArapOptions { iterations, tolerance: None, ..options.clone() }),
            Self::Laplacian(_) | Self::RotationInvariant(_) | Self::Implicit(_) => self.clone(),
            Self::DualLaplacian(options) => {
                Self::DualLaplacian(DualLaplacianOptions { iterations, tolerance: None, ..options.clone() })
            }
        }
    }

    /// The same method, iterating until its energy falls by no more than the share `tolerance` of itself, at most `most` times; one
    /// that does not iterate stays as it is.
    #[must_use]
    pub fn until_converged(&self, tolerance: f64, most: u32) -> Self {
        match self {
            Self::Arap(options) => {
                Self::Arap(ArapOptions { iterations: most, tolerance: Some(tolerance), ..options.clone() })
            }
            Self::Laplacian(_) | Self::RotationInvariant(_) | Self::Implicit(_) => self.clone(),
            Self::DualLaplacian(options) => Self::DualLaplacian(DualLaplacianOptions {
                iterations: most,
                tolerance: Some(tolerance),
                ..options.clone()
            }),
        }
    }
}

/// `name`, or `name:token+token` with the options that differ from the default: `arap:uniform`.
impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, options) = match self {
            Self::Arap(options) => ("arap", options.to_string()),
            Self::Laplacian(options) => ("laplacian", options.to_string()),
            Self::RotationInvariant(options) => ("rotation-invariant", options.to_string()),
            Self::DualLaplacian(options) => ("dual", options.to_string()),
            Self::Implicit(options) => ("implicit", options.to_string()),
        };
        f.write_str(name)?;
        if options.is_empty() { Ok(()) } else { write!(f, ":{options}") }
    }
}

/// Reads what `Display` writes.
impl FromStr for Method {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let (name, options) = text.split_once(':').unwrap_or((text, ""));
        match name {
            "arap" => Ok(Self::Arap(options.parse()?)),
            "laplacian" => Ok(Self::Laplacian(options.parse()?)),
            "rotation-invariant" => Ok(Self::RotationInvariant(options.parse()?)),
            "dual" => Ok(Self::DualLaplacian(options.parse()?)),
            "implicit" => Ok(Self::Implicit(options.parse()?)),
            _ => Err(DeformError::BadOption { option: "the method", expected: NAMES, found: format!("'{name}'") }),
        }
    }
}

/// The names of the methods.
const NAMES: &str = "arap, laplacian, implicit, dual or rotation-invariant";

/// A prepared edit: solved again and again while its handles are dragged.
pub trait Deformer: Send {
    /// Moves `positions` so that the handles meet `goals`.
    ///
    /// `positions` is the only state: on entry the pose to start from (the rest pose or that of the last call, one
    /// position per vertex), on exit the solution. Fixed vertices keep their bits; the vertices of hard handles are
    /// exactly where their goal takes their rest position. On an error `positions` is unchanged. Nothing is allocated.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`] or [`DeformError::Handle`] for goals that do not fit or are no similarities,
    /// [`DeformError::Mesh`] for a pose that does not fit or is not finite, [`DeformError::ResultNotFinite`].
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError>;

    /// As [`Self::solve`], but only as far as is worth showing while a handle is on its way, where a method knows such a stage:
    /// [`Method::Implicit`] does its first system. When the handle stops, `solve` gives the result.
    ///
    /// # Errors
    /// As [`Self::solve`].
    fn solve_preview(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.solve(goals, positions)
    }

    /// Makes ready for another region of the same rest shape: handles added, removed, grown, or moved between hard and soft.
    ///
    /// Solutions are then those of a deformer freshly prepared for `region`. As-rigid-as-possible deformation computes only numbers again
    /// where the region of interest has the same vertices as before; otherwise everything that depends on the region is. Poses are not
    /// touched, so the next solve may start from the last one. On an error the deformer stays as it was and solves for the region it had.
    ///
    /// # Errors
    /// As [`Method::prepare`].
    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError>;

    /// What was found out while preparing.
    fn prepared(&self) -> PrepareReport {
        PrepareReport::default()
    }

    /// How long the steps of the last solve took; zero where that is not measured.
    ///
    /// Not part of [`SolveReport`], which is the same on every run.
    fn step_times(&self) -> StepTimes {
        StepTimes::default()
    }

    /// Counts and times that only [`Method::Implicit`] has, with the times of the last solve; `None` from the others.
    fn implicit_report(&self) -> Option<ImplicitReport> {
        None
    }
}

/// Time that a solve spent in the steps it alternates, each summed over its iterations and its initial guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepTimes {
    /// In local steps: a rotation for each cell.
    pub local: Duration,
    /// In global steps: right-hand sides and solutions of the linear system.
    pub global: Duration,
}

/// What was prepared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PrepareReport {
    /// Vertices solved for: free ones and those of soft handles.
    pub unknowns: usize,
    /// Edge weights that had to be changed to keep the equations well-behaved.
    pub clamped_weights: usize,
    /// Numbers stored for solving.
    pub factor_len: usize,
}

/// What a solve did.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SolveReport {
    /// Iterations done; 0 by a method that does not iterate.
    pub iterations: u32,
    /// Whether the method's tolerance was met: `false` where none is set, `true` for a method that does not iterate.
    pub converged: bool,
    /// The method's energy before the first iteration, in its own units; only where the stop rule needs it.
    pub energy_before: Option<f64>,
    /// The method's energy of the result; only where the stop rule needs it.
    pub energy_after: Option<f64>,
    /// Iterations of the linear solver, of all solves together; only where that iterates.
    pub solver_iterations: Option<u32>,
    /// Largest distance from a hard handle's point to its target, in world units; only where there are such points.
    ///
    /// Rounding where all can be met. Where not, what the least-squares solution leaves, with each row counted by the inverse of
    /// `sum_j c_j^2 / d_j`, `d` being the diagonal of the method's matrix. Rows that differ from a mean of others by less than about a
    /// thousandth of their weights count as that mean: their difference is not forced.
    #[serde(default)]
    pub unmet: Option<f64>,
}
