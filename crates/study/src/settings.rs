//! What a row is asked to be: how large its cage, how often it iterates, how its handles travel.

use std::fmt;
use std::str::FromStr;

use pliant_cage::{BindOptions, CageSize, Propagation};
use pliant_deform::Method;
use serde::{Deserialize, Serialize};

use crate::StudyError;
use crate::report::{NO_CAGE, SweepRow};

/// The cage of a row, or none: the shape is then deformed directly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweepSize {
    /// A cage of this size.
    Cage(CageSize),
    /// No cage.
    None,
    /// No cage, and in the shape's place a decimated mesh of this size: what a user without cages would do to save time.
    Decimated(CageSize),
    /// As [`Self::Decimated`], of the size that takes as long to solve as a cage of this size with propagation does
    /// ([`equal_time_vertices`]): the third picture of Figure 2 of Hybrid Mesh Editing (Borosan et al. 2010).
    EqualTime(CageSize),
}

/// Time of an iteration for a vertex of the mesh it works on, over that of a weight in propagation: 50 ns against 0.51 ns, measured on
/// creatures of 25,000 to 1,000,000 vertices with cages of 1 to 10 %.
const ITERATION_OVER_WEIGHT: f64 = 98.0;

/// What starting from coarser cages costs where the goals are far, in iterations on the cage.
const LEVELS_ITERATIONS: f64 = 8.0;

/// Weights a row that propagation is reckoned with: those of the default binding.
const WEIGHTS: f64 = 16.0;

/// Vertices of a decimated mesh on which `iterations` take as long as they do on a cage of `cage` vertices together with propagation to
/// a shape of `shape` vertices, and with the start from coarser cages if there is one. Reckoned from counts, not from the clock, so that
/// it is the same everywhere; never above `shape`.
pub fn equal_time_vertices(shape: usize, cage: usize, iterations: u32, from_levels: bool) -> usize {
    let iterations = f64::from(iterations.max(1));
    let start = if from_levels { LEVELS_ITERATIONS } else { 0.0 };
    let propagation = shape as f64 * WEIGHTS / ITERATION_OVER_WEIGHT;
    (((cage as f64 * (iterations + start) + propagation) / iterations).round() as usize).min(shape)
}

impl fmt::Display for SweepSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cage(size) => f.write_str(&size_text(*size)),
            Self::None => f.write_str(NO_CAGE),
            Self::Decimated(size) => write!(f, "{DECIMATED}{}", size_text(*size)),
            Self::EqualTime(size) => write!(f, "{EQUAL_TIME}{}", size_text(*size)),
        }
    }
}

/// What the texts of decimated meshes begin with.
pub(crate) const DECIMATED: &str = "decimated:";
pub(crate) const EQUAL_TIME: &str = "equal-time:";

fn size_text(size: CageSize) -> String {
    match size {
        CageSize::Vertices(n) => n.to_string(),
        // Rounded to 1e-9 so that 0.07 does not read 7.000000000000001 %.
        CageSize::Fraction(share) => format!("{}%", (share * 1e11).round() / 1e9),
        CageSize::Error(e) => format!("error:{e}"),
    }
}

/// Less is nothing of any mesh, and cannot be written in the digits of a size.
const LEAST_SHARE: f64 = 1e-9;

/// A closed surface has no fewer.
const LEAST_VERTICES: usize = 4;

/// Reads `2000` (vertices), `5%` (of the shape's vertices) or `error:0.002` (of the diagonal).
fn cage_size(text: &str) -> Option<CageSize> {
    let number = |digits: &str| digits.parse::<f64>().ok().filter(|x| x.is_finite());
    if let Some(percent) = text.strip_suffix('%') {
        let share = number(percent.trim_end())? / 100.0;
        (LEAST_SHARE..=1.0).contains(&share).then_some(CageSize::Fraction(share))
    } else if let Some(error) = text.strip_prefix("error:") {
        number(error).filter(|error| *error >= 0.0).map(CageSize::Error)
    } else {
        text.parse().ok().filter(|n| *n >= LEAST_VERTICES).map(CageSize::Vertices)
    }
}

/// Reads `2000` (vertices), `5%` (of the shape's vertices), `error:0.002` (of the diagonal), `decimated:` or `equal-time:` before any of
/// these, or `none`.
impl FromStr for SweepSize {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        let read = if text == NO_CAGE {
            Some(Self::None)
        } else if let Some(size) = text.strip_prefix(DECIMATED) {
            cage_size(size).map(Self::Decimated)
        } else if let Some(size) = text.strip_prefix(EQUAL_TIME) {
            cage_size(size).map(Self::EqualTime)
        } else {
            cage_size(text).map(Self::Cage)
        };
        read.ok_or_else(|| StudyError::BadSize { found: text.to_owned() })
    }
}

/// Sizes of a range are at most this many times as large as the one before, if their number is not given.
const RANGE_STEP: f64 = 2.0;

/// More sizes than anyone would wait for.
const MOST_SIZES: usize = 1000;

impl SweepSize {
    /// Reads a size, or a range of them in equal ratios with both ends: `1%..50%`, `100..5000:6` (six of them). Without a number each is at
    /// most twice the one before.
    ///
    /// # Errors
    /// [`StudyError::BadSize`], [`StudyError::BadRange`].
    pub fn parse_range(text: &str) -> Result<Vec<Self>, StudyError> {
        let Some((from, rest)) = text.split_once("..") else { return Ok(vec![text.parse()?]) };
        let bad = || StudyError::BadRange { found: text.to_owned(), most: MOST_SIZES };
        let (to, number) = match rest.split_once(':') {
            Some((to, number)) => (to, Some(number.parse::<usize>().map_err(|_| bad())?)),
            None => (rest, None),
        };
        let (from, to) = (cage_size(from).ok_or_else(bad)?, cage_size(to).ok_or_else(bad)?);
        let (low, high, make): (f64, f64, fn(f64) -> CageSize) = match (from, to) {
            (CageSize::Vertices(low), CageSize::Vertices(high)) => {
                (low as f64, high as f64, |x| CageSize::Vertices(x.round() as usize))
            }
            // Three digits say enough of a size nobody typed.
            (CageSize::Fraction(low), CageSize::Fraction(high)) => (low, high, |x| {
                let unit = 10_f64.powf(x.log10().floor() - 2.0);
                CageSize::Fraction((x / unit).round() * unit)
            }),
            _ => return Err(bad()),
        };
        if !(low > 0.0 && high > low) {
            return Err(bad());
        }
        let ratio = high / low;
        let number = number.unwrap_or_else(|| (ratio.ln() / RANGE_STEP.ln() - 1e-9).ceil() as usize + 1);
        if !(2..=MOST_SIZES).contains(&number) {
            return Err(bad());
        }
        let inner = (1..number - 1).map(|k| make(low * ratio.powf(k as f64 / (number - 1) as f64)));
        let mut sizes: Vec<CageSize> = [from].into_iter().chain(inner).chain([to]).collect();
        // Rounding can make neighbours equal.
        sizes.dedup();
        Ok(sizes.into_iter().map(Self::Cage).collect())
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

/// What a row is asked to be, on some shape and scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// The cage.
    pub size: SweepSize,
    /// What deforms it.
    pub method: Method,
    /// How the handles travel.
    pub schedule: Schedule,
    /// How the cage's motion is carried to the shape; without a cage it matters to nothing.
    pub propagation: Propagation,
    /// How the shape is bound to the cage; without one it matters to nothing.
    pub bind: BindOptions,
}

impl Setting {
    /// Whether the shape, or a decimated mesh in its place, is deformed without a cage.
    pub fn is_direct(&self) -> bool {
        !matches!(self.size, SweepSize::Cage(_))
    }

    /// A row of what is asked, without figures.
    pub(crate) fn row(&self, model: &str, vertices: usize, scene: &str) -> SweepRow {
        let or_none = |text: String| if self.is_direct() { NO_CAGE.to_owned() } else { text };
        SweepRow {
            model: model.to_owned(),
            vertices,
            scene: scene.to_owned(),
            cage_asked: self.size.to_string(),
            // Iterations are the schedule's, which rows tell apart.
            method: self.method.with_default_iterations().to_string(),
            propagation: or_none(self.propagation.to_string()),
            prune: or_none(self.bind.to_string()),
            steps: self.schedule.steps,
            start: match self.size {
                // How large its mesh is depends on what the cage would start from.
                SweepSize::EqualTime(_) => self.schedule.start.to_string(),
                _ => or_none(self.schedule.start.to_string()),
            },
            iterations: self.schedule.count(&self.method).map(|n| n as usize),
            linear: !self.method.iterates(),
            ..SweepRow::default()
        }
    }
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
