//! What a row is asked to be: how large its cage, how often it iterates, how its handles travel.

use std::fmt;
use std::str::FromStr;

use pliant_cage::CageSize;
use pliant_deform::Method;
use serde::{Deserialize, Serialize};

use crate::StudyError;
use crate::report::NO_CAGE;

/// The cage of a row, or none: the shape is then deformed directly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweepSize {
    /// A cage of this size.
    Cage(CageSize),
    /// No cage.
    None,
}

impl fmt::Display for SweepSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cage(CageSize::Vertices(n)) => write!(f, "{n}"),
            // Rounded to 1e-9 so that 0.07 does not read 7.000000000000001 %.
            Self::Cage(CageSize::Fraction(share)) => write!(f, "{}%", (share * 1e11).round() / 1e9),
            Self::Cage(CageSize::Error(e)) => write!(f, "error:{e}"),
            Self::None => f.write_str(NO_CAGE),
        }
    }
}

/// Reads `2000` (vertices), `5%` (of the shape's vertices), `error:0.002` (of the diagonal) or `none`.
impl FromStr for SweepSize {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        let bad = || StudyError::BadSize { found: text.to_owned() };
        let number = |digits: &str| digits.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(bad);
        if text == NO_CAGE {
            Ok(Self::None)
        } else if let Some(percent) = text.strip_suffix('%') {
            let share = number(percent.trim_end())? / 100.0;
            if share > 0.0 && share <= 1.0 { Ok(Self::Cage(CageSize::Fraction(share))) } else { Err(bad()) }
        } else if let Some(error) = text.strip_prefix("error:") {
            let error = number(error)?;
            if error >= 0.0 { Ok(Self::Cage(CageSize::Error(error))) } else { Err(bad()) }
        } else {
            text.parse().map(|n| Self::Cage(CageSize::Vertices(n))).map_err(|_| bad())
        }
    }
}

/// How often the solver iterates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Iterations {
    /// This many in every step.
    Count(u32),
    /// Two in every step but the last, which goes on until the energy falls by less than [`CONVERGED`] of itself in an iteration.
    Converged,
}

/// Relative fall of the energy in an iteration that counts as converged.
pub const CONVERGED: f64 = 1e-5;

/// Iterations after which a solve that should converge is ended all the same.
pub(crate) const MOST_ITERATIONS: u32 = 2000;

impl fmt::Display for Iterations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(n) => write!(f, "{n}"),
            Self::Converged => f.write_str("converged"),
        }
    }
}

/// Reads a number or `converged`.
impl FromStr for Iterations {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        match text {
            "converged" => Ok(Self::Converged),
            _ => match text.parse() {
                Ok(n) if n <= MOST_ITERATIONS => Ok(Self::Count(n)),
                _ => Err(StudyError::BadIterations { found: text.to_owned(), most: MOST_ITERATIONS }),
            },
        }
    }
}

/// How the handles travel to their goals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schedule {
    /// Equal steps from rest to the goals, at least 1; each starts at the pose of the one before.
    pub steps: usize,
    /// Iterations in each.
    pub iterations: Iterations,
    /// What each starts from.
    pub start: StartFrom,
}

/// What a solve on a cage starts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartFrom {
    /// The answer of coarser cages where the goals are far ([`Levels`](pliant_session::Levels)), else the pose as it is. Without a cage always the pose.
    #[default]
    Levels,
    /// The pose as it is, as Borosan et al. 2010 do.
    Pose,
}

impl fmt::Display for StartFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Levels => "levels",
            Self::Pose => "pose",
        })
    }
}

impl FromStr for StartFrom {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        match text {
            "levels" => Ok(Self::Levels),
            "pose" => Ok(Self::Pose),
            _ => Err(StudyError::BadStart { found: text.to_owned() }),
        }
    }
}

impl Schedule {
    /// Iterations in each step; none of a method that does not iterate, or where it goes on until it converges.
    pub(crate) fn count(self, method: &Method) -> Option<u32> {
        match self.iterations {
            Iterations::Count(n) if method.iterates() => Some(n),
            _ => None,
        }
    }

    /// Iterations in words.
    pub(crate) fn text(self, method: &Method) -> String {
        match self.iterations {
            _ if !method.iterates() => "solved at once".to_owned(),
            Iterations::Count(1) => "1 iteration each".to_owned(),
            Iterations::Count(n) => format!("{n} iterations each"),
            Iterations::Converged => "until converged".to_owned(),
        }
    }
}
