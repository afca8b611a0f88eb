//! The gate: what of a sweep moved against an earlier one, and whether that is for the worse.
//!
//! [`compare_reports`] takes two reports apart figure by figure, each with its tolerance. Errors are deterministic and their tolerances are tight;
//! times are taken as multiples of a loop that was run beside them ([`crate::calibrate`]), so that neither another machine nor a busy one
//! fails. [`Rerun`] makes the rows of a baseline again, and those that seem slow once more before it says so.

mod compare;
mod error;
mod figures;
mod junit;
mod rerun;
#[cfg(test)]
mod tests;
mod tolerances;
mod write;

use std::path::Path;

use pliant_files::read_regular;
use serde::{Deserialize, Serialize};

pub use compare::compare_reports;
pub use error::GateError;
pub use figures::Unit;
pub use rerun::{Checked, Places, Rerun, RerunOptions};
pub use tolerances::{Tolerance, Tolerances};

use crate::report::{Failure, FailureKind, RowTimes, SCHEMA, SweepReport};

/// What moved between two reports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GateReport {
    /// `pliant-gate/1`.
    pub schema: String,
    /// What all of it comes to.
    pub verdict: Verdict,
    /// Every row of the baseline, in words.
    pub rows: Vec<String>,
    /// Figures that were compared.
    pub figures: usize,
    /// What moved by more than its tolerance: what is worse first, and of that the worst.
    pub changes: Vec<Change>,
    /// What a reader must know, as whole sentences.
    pub notes: Vec<String>,
}

/// What [`GateReport::schema`] says of this form.
const GATE_SCHEMA: &str = "pliant-gate/1";

/// What a comparison comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing is worse.
    Pass,
    /// Something is worse.
    Regression,
    /// A row that had figures has none, as its computation failed.
    Numeric,
    /// A row that had figures has none, as Pliant itself failed.
    Internal,
}

/// Something that moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// In which way.
    pub kind: ChangeKind,
    /// The row, in words.
    pub row: String,
    /// The figure's name in reports; `null` where the whole row is meant.
    pub figure: Option<String>,
    /// What its values are counted in.
    pub unit: Option<Unit>,
    /// What it was; `null` where there was nothing.
    pub old: Option<f64>,
    /// What it is; `null` where there is nothing. Times are converted to the machine of the baseline.
    pub new: Option<f64>,
    /// The most that it may be.
    pub allowed: Option<f64>,
    /// Why the row has no figures.
    pub failure: Option<Failure>,
    /// The row's number in the baseline.
    #[serde(skip)]
    at: Option<usize>,
}

/// Ways to move, the worst first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ChangeKind {
    /// The row had figures and has none.
    Failed,
    /// The row is not there any more.
    Missing,
    /// The row's model has another number of vertices: figures of different things are not compared.
    OtherModel,
    /// The figure is worse, or not there any more.
    Worse,
    /// The figure is better.
    Better,
    /// The row had no figures and has some.
    Recovered,
    /// The figure is another, neither better nor worse, or was not there before.
    Different,
    /// The row was not there before.
    Added,
}

impl ChangeKind {
    /// Whether it fails the gate.
    pub fn is_regression(self) -> bool {
        self <= Self::Worse
    }
}

impl Change {
    /// The new value as a multiple of the old one, signs aside; infinite where one is gone or was 0.
    pub fn factor(&self) -> f64 {
        match (self.old, self.new) {
            (Some(old), Some(new)) if old != 0.0 => (new / old).abs(),
            _ => f64::INFINITY,
        }
    }
}

impl GateReport {
    /// What fails the gate, the worst first.
    pub fn regressions(&self) -> impl Iterator<Item = &Change> {
        self.changes.iter().filter(|change| change.kind.is_regression())
    }

    /// Indented JSON, ending with a line break.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("every key is a string and no value can fail") + "\n"
    }
}

/// What a failure comes to.
fn verdict_of(failure: &Failure) -> Verdict {
    match failure.kind {
        FailureKind::Input => Verdict::Regression,
        FailureKind::Numeric => Verdict::Numeric,
        FailureKind::Internal => Verdict::Internal,
    }
}

/// No report needs more, pictures included.
const MAX_REPORT_BYTES: u64 = 1 << 30;

/// Reads a report of a sweep, to compare it.
///
/// # Errors
/// The file cannot be read, or is not a report of this form; names file, line and column where that helps.
pub fn read_report(path: &Path) -> Result<SweepReport, GateError> {
    let file = path.display().to_string();
    let bad = |message: String| GateError::File { file: file.clone(), message };
    let text =
        String::from_utf8(read_regular(path, MAX_REPORT_BYTES)?).map_err(|_| bad("not UTF-8 text".to_owned()))?;
    let report = SweepReport::read_json(text.strip_prefix('\u{feff}').unwrap_or(&text), &file)?;
    if report.schema != SCHEMA {
        return Err(bad(format!("is of the form {:?}, where {SCHEMA:?} is needed", report.schema)));
    }
    Ok(report)
}

impl SweepReport {
    /// The report as a baseline to be kept under version control: no pictures, no ids (which are new in every version), times of three
    /// digits; without `times` none of these, and no machine.
    #[must_use]
    pub fn into_baseline(mut self, times: bool) -> Self {
        self.pictures.clear();
        if !times {
            self.machine = None;
        }
        for row in &mut self.rows {
            row.id.clear();
            row.times = if times {
                rounded(&row.times)
            } else {
                RowTimes { repeats: row.times.repeats, ..RowTimes::default() }
            };
        }
        self
    }
}

fn rounded(times: &RowTimes) -> RowTimes {
    let mut times = times.clone();
    let spreads = [
        &mut times.simplify_ms,
        &mut times.bind_ms,
        &mut times.prepare_ms,
        &mut times.drag_ms,
        &mut times.propagate_ms,
        &mut times.refine_ms,
    ];
    for spread in spreads.into_iter().flatten() {
        for ms in [&mut spread.median, &mut spread.min, &mut spread.max] {
            *ms = three_digits(*ms);
        }
    }
    times.drag_p95_ms = times.drag_p95_ms.map(three_digits);
    // To 0.1 MB.
    times.peak_memory_bytes = times.peak_memory_bytes.map(|bytes| (bytes + 50_000) / 100_000 * 100_000);
    times
}

fn three_digits(x: f64) -> f64 {
    // Through text, so that what is written is as short as it can be.
    format!("{x:.2e}").parse().unwrap_or(x)
}
