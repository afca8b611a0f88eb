//! How small a cage may be: the smallest within an error, and where a curve of error against size bends.

#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use pliant_cage::CageSize;
use serde::{Deserialize, Serialize};

use super::columns::Cell;
use super::series::{Labels, SeriesKey, Way};
use super::table::{in_markdown, write_padded};
use super::{FailureKind, SweepReport, SweepRow};
use crate::{StudyError, SweepSize};

/// What is looked for among the cage sizes of a series. Written and read as `error:5%`, `no-cage:10%`, `bend`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum KneeTarget {
    /// The smallest cage whose RMS relative edge error is at most this: 0.05 is 5 %.
    Error(f64),
    /// The smallest cage whose RMS relative edge error is at most this share above that without a cage: 0.1 is 10 %. Compared is the row
    /// without a cage of the same model, scene, method and schedule.
    NoCage(f64),
    /// Where error falls no more as it did: the knee of error against the logarithm of the cage's vertices.
    ///
    /// Found by Kneedle (Satopaa, Albrecht, Irwin and Raghavan, Finding a "Kneedle" in a Haystack, ICDCS workshops 2011, section III) with its
    /// default sensitivity of 1, but for its first step: the few sizes of a sweep are not smoothed. Of several knees it is the
    /// sharpest. A straight line has none, nor has a curve that bends too little for how densely it is sampled: the sharpest distance from the
    /// straight line must exceed the mean step of the sizes, 1/(n - 1) for n of them.
    Bend,
}

/// What was found for a series.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Knee {
    /// The shape.
    pub model: String,
    /// Name of the scene.
    pub scene: String,
    /// What the series is called beside the others of its report.
    pub series: String,
    /// What was looked for.
    pub target: KneeTarget,
    /// The size; `null` where there is none.
    pub found: Option<KneeSize>,
    /// Why there is none, in a sentence; else empty.
    pub reason: String,
    /// The smallest size that meets the target if a larger one does not meet it again; `null` where errors stay within the target.
    pub first_within: Option<KneeSize>,
    /// The error that [`KneeTarget::NoCage`] compares with, a fraction; `null` for other targets and where there is none.
    pub no_cage_error: Option<f64>,
}

/// A cage size of a series with its error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct KneeSize {
    /// The size as asked for.
    pub cage_asked: String,
    /// Vertices of the cage.
    pub cage_vertices: usize,
    /// RMS relative edge error, a fraction.
    pub rms_relative: f64,
}

impl SweepReport {
    /// For each series of cages, rows that differ in cage size alone, the size that a target asks for, in the order of the rows.
    ///
    /// A size meets an error only if every larger one of the series does too: whoever takes a cage of at least that size is within the
    /// error, and one lucky size among worse ones does not count. It is told of in [`Knee::first_within`]. Of a size that was made
    /// several times the worst counts. A row whose computation failed ([`FailureKind::Numeric`]) or whose error is not finite meets no
    /// error; one that was refused ([`FailureKind::Input`], such as a cage too small for the scene) says nothing and is left
    /// out, as is a failed one of which not even the size is known. Decimated
    /// meshes are no cages and form no series here.
    pub fn find_knees(&self, target: KneeTarget) -> Vec<Knee> {
        let labels = Labels::of(self.rows.iter());
        let mut series: Vec<(SeriesKey<'_>, Vec<&SweepRow>)> = Vec::new();
        for row in &self.rows {
            let key = SeriesKey::of(row);
            if key.way() != Way::Cage {
                continue;
            }
            match series.iter_mut().find(|(other, _)| *other == key) {
                Some((_, rows)) => rows.push(row),
                None => series.push((key, vec![row])),
            }
        }
        series.iter().map(|(key, rows)| self.knee(target, key, rows, &labels)).collect()
    }

    fn knee(&self, target: KneeTarget, key: &SeriesKey<'_>, rows: &[&SweepRow], labels: &Labels) -> Knee {
        let sizes = sizes(rows);
        let mut knee = Knee {
            model: rows[0].model.clone(),
            scene: rows[0].scene.clone(),
            series: labels.label(rows[0]),
            target,
            found: None,
            reason: String::new(),
            first_within: None,
            no_cage_error: None,
        };
        let limit = match target {
            KneeTarget::Error(limit) => limit,
            KneeTarget::NoCage(excess) => {
                let same = self.rows.iter().filter(|row| key.is_without_cage(&SeriesKey::of(row)));
                knee.no_cage_error = same.map(|row| row.rms_relative).find(|error| error.is_finite());
                let Some(error) = knee.no_cage_error else {
                    "no row without a cage has the same method and schedule and an error".clone_into(&mut knee.reason);
                    return knee;
                };
                error * (1.0 + excess)
            }
            KneeTarget::Bend => {
                match bend(&sizes) {
                    Ok(at) => knee.found = Some(sizes[at].clone()),
                    Err(reason) => reason.clone_into(&mut knee.reason),
                }
                return knee;
            }
        };
        let within = |size: &&KneeSize| size.rms_relative.is_finite() && size.rms_relative <= limit;
        let kept = sizes.iter().rev().take_while(within).count();
        knee.found = (kept > 0).then(|| sizes[sizes.len() - kept].clone());
        let first = sizes.iter().find(within).cloned();
        knee.first_within = first.filter(|first| Some(first) != knee.found.as_ref());
        if knee.found.is_none() {
            knee.reason = match (sizes.last(), &knee.first_within) {
                (None, _) => "no cage was made".to_owned(),
                (Some(_), Some(_)) => "the largest cage does not meet it, though a smaller one does".to_owned(),
                (Some(_), None) => format!("no cage meets {} %", Cell::Share(limit).rounded()),
            };
        }
        knee
    }
}

/// The rows of a series by increasing size, each size once with its worst error; infinite where there is none.
fn sizes(rows: &[&SweepRow]) -> Vec<KneeSize> {
    let mut sizes: Vec<KneeSize> = Vec::new();
    for row in rows {
        let cage_vertices = match &row.failure {
            None => row.cage_vertices,
            Some(failure) if failure.kind == FailureKind::Numeric => match asked_vertices(row) {
                Some(vertices) => vertices,
                None => continue,
            },
            Some(_) => continue,
        };
        let rms_relative = if row.rms_relative.is_finite() { row.rms_relative } else { f64::INFINITY };
        let size = KneeSize { cage_asked: row.cage_asked.clone(), cage_vertices, rms_relative };
        match sizes.iter_mut().find(|other| other.cage_vertices == cage_vertices) {
            Some(other) if other.rms_relative < rms_relative => *other = size,
            Some(_) => {}
            None => sizes.push(size),
        }
    }
    sizes.sort_by_key(|size| size.cage_vertices);
    sizes
}

/// Vertices of a cage that may not have been made, as far as they can be told.
fn asked_vertices(row: &SweepRow) -> Option<usize> {
    if row.cage_vertices > 0 {
        return Some(row.cage_vertices);
    }
    match row.cage_asked.parse() {
        Ok(SweepSize::Cage(CageSize::Vertices(vertices))) => Some(vertices),
        Ok(SweepSize::Cage(CageSize::Fraction(share))) => Some((share * row.vertices as f64).round() as usize),
        _ => None,
    }
}

/// Sensitivity: how many mean steps of the sizes the difference curve must fall before a knee counts.
const SENSITIVITY: f64 = 1.0;

/// Position of the sharpest knee among sizes, or why there is none. Sizes without a finite error are passed over.
fn bend(sizes: &[KneeSize]) -> Result<usize, &'static str> {
    let known: Vec<usize> = (0..sizes.len()).filter(|&k| sizes[k].rms_relative.is_finite()).collect();
    let &[first, .., last] = &known[..] else { return Err("fewer than three sizes have an error") };
    if known.len() < 3 {
        return Err("fewer than three sizes have an error");
    }
    let error = |k: usize| sizes[k].rms_relative;
    if error(last) >= error(first) {
        return Err("the error does not fall with size");
    }
    let size = |k: usize| (sizes[k].cage_vertices.max(1) as f64).ln();
    let least = known.iter().map(|&k| error(k)).fold(f64::INFINITY, f64::min);
    let most = known.iter().map(|&k| error(k)).fold(0.0, f64::max);
    // Both axes from 0 to 1, the falling curve turned over: its distance above the straight line (the paper's difference curve).
    let difference = |&k: &usize| {
        let x = (size(k) - size(first)) / (size(last) - size(first));
        (most - error(k)) / (most - least) - x
    };
    let curve: Vec<f64> = known.iter().map(difference).collect();
    let step = 1.0 / (known.len() - 1) as f64;
    let mut knees: Vec<usize> = Vec::new();
    for k in 1..curve.len() - 1 {
        let is_peak = curve[k] > curve[k - 1] && curve[k] >= curve[k + 1];
        // Down to where the curve rises again.
        let falling = (k..curve.len() - 1).take_while(|&j| curve[j + 1] <= curve[j]).last();
        let bottom = falling.map_or(curve[k], |j| curve[j + 1]);
        if is_peak && bottom < curve[k] - SENSITIVITY * step {
            knees.push(k);
        }
    }
    let sharpest = knees.into_iter().rev().max_by(|&a, &b| curve[a].total_cmp(&curve[b]));
    sharpest.map(|k| known[k]).ok_or("the curve does not bend enough for its number of sizes")
}

impl Knee {
    /// A Markdown table of what was found, a line per series.
    pub fn table(knees: &[Self]) -> String {
        let compares = knees.iter().any(|knee| knee.no_cage_error.is_some());
        let mut header = vec!["series", "cage asked", "cage vertices", "RMS relative (%)"];
        header.extend(compares.then_some("no cage (%)"));
        header.push("note");
        let mut lines = vec![header.iter().map(|heading| (*heading).to_owned()).collect::<Vec<_>>()];
        for knee in knees {
            let dash = || "-".to_owned();
            let mut line = vec![in_markdown(&knee.series)];
            line.extend(match &knee.found {
                Some(size) => {
                    [in_markdown(&size.cage_asked), size.cage_vertices.to_string(), percent(size.rms_relative)]
                }
                None => [dash(), dash(), dash()],
            });
            line.extend(compares.then(|| knee.no_cage_error.map_or_else(dash, percent)));
            line.push(in_markdown(&knee.note()));
            lines.push(line);
        }
        let numeric: Vec<bool> = (0..header.len()).map(|k| k >= 2 && k + 1 < header.len()).collect();
        let mut out = String::new();
        write_padded(&mut out, &lines, &numeric);
        out
    }

    /// Why there is none, or what is odd about it.
    pub(super) fn note(&self) -> String {
        match &self.first_within {
            _ if self.found.is_none() => self.reason.clone(),
            Some(first) => format!("a cage of {} vertices meets it too, but not every larger one", first.cage_vertices),
            None => String::new(),
        }
    }
}

/// A sentence: `frames, local:16: 5% (1000 vertices), RMS relative 1.20 %`.
impl fmt::Display for Knee {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.series)?;
        match &self.found {
            Some(KneeSize { cage_asked, cage_vertices, rms_relative }) => {
                write!(f, "{cage_asked} ({cage_vertices} vertices), RMS relative {} %", percent(*rms_relative))?;
            }
            None => f.write_str("none")?,
        }
        let note = self.note();
        if note.is_empty() { Ok(()) } else { write!(f, "; {note}") }
    }
}

fn percent(fraction: f64) -> String {
    Cell::Share(fraction).rounded()
}

const ERROR: &str = "error:";
const NO_CAGE_ERROR: &str = "no-cage:";
const BEND: &str = "bend";

impl fmt::Display for KneeTarget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Rounded to 1e-9 so that 0.07 does not read 7.000000000000001 %.
        let percent = |x: f64| (x * 1e11).round() / 1e9;
        match self {
            Self::Error(limit) => write!(f, "{ERROR}{}%", percent(*limit)),
            Self::NoCage(excess) => write!(f, "{NO_CAGE_ERROR}{}%", percent(*excess)),
            Self::Bend => f.write_str(BEND),
        }
    }
}

/// Reads `error:5%`, `no-cage:10%` or `bend`; a fraction may stand in place of percent.
impl FromStr for KneeTarget {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        let fraction = |text: &str| {
            let number = |digits: &str| digits.parse::<f64>().ok();
            let read = match text.strip_suffix('%') {
                Some(percent) => number(percent.trim_end()).map(|x| x / 100.0),
                None => number(text),
            };
            read.filter(|x| x.is_finite() && *x >= 0.0)
        };
        let read = if text == BEND {
            Some(Self::Bend)
        } else if let Some(limit) = text.strip_prefix(ERROR) {
            fraction(limit).map(Self::Error)
        } else if let Some(excess) = text.strip_prefix(NO_CAGE_ERROR) {
            fraction(excess).map(Self::NoCage)
        } else {
            None
        };
        read.ok_or_else(|| StudyError::BadKnee { found: text.to_owned() })
    }
}
