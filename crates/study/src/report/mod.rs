//! Tables and plots of a sweep.
//!
//! Errors are fractions in JSON and CSV, where programs read them, and percent in Markdown and plots, where people do.
//! Times are milliseconds everywhere.

mod columns;
mod comparison;
mod figure3;
mod formats;
mod html;
mod knee;
mod plot;
mod row;
#[cfg(test)]
mod schema;
mod series;
mod table;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use pliant_mesh::TriMesh;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

use crate::pipeline::median;

pub use comparison::{Comparison, ImplicitRow};
pub(crate) use formats::on_one_line;
pub use formats::{FormatError, ReportFormat, SUMMARY_BYTES};
pub use knee::{Knee, KneeSize, KneeTarget};
pub use row::{Failure, FailureKind, NO_CAGE, RowKey, RowTimes, Spread, SweepRow};
pub use table::Detail;
pub(crate) use table::in_markdown;

/// What [`SweepReport::schema`] says of this form. The number grows when a field changes its meaning or goes; new fields leave it.
pub const SCHEMA: &str = "pliant-sweep/2";

/// The result of a sweep.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SweepReport {
    /// [`SCHEMA`].
    pub schema: String,
    /// Version of Pliant that made it.
    pub version: String,
    /// Where it was made, which times depend on and nothing else; `null` for rows that were merged from several machines.
    #[serde(default)]
    pub machine: Option<Machine>,
    /// The shapes that were deformed, in the order of the plan.
    pub models: Vec<ModelInfo>,
    /// What holds for the whole sweep and a reader must know, as whole sentences.
    #[serde(default)]
    pub notes: Vec<String>,
    /// What was asked for and could not even be begun.
    #[serde(default)]
    pub refused: Vec<Refusal>,
    /// One row per model, scene, cage size and setting, in the order of the plan.
    pub rows: Vec<SweepRow>,
    /// The smallest cages that will do, if they were looked for ([`Self::find_knees`]).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub knees: Vec<Knee>,
    /// Pictures of the edited shapes by the rows' ids: PNG in base64, coloured by the mean relative length error of the edges at each
    /// vertex from 0 (violet) to [`PICTURE_WORST`] (yellow).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub pictures: BTreeMap<String, String>,
}

/// The mean edge error at a vertex that has the last colour in pictures.
pub const PICTURE_WORST: f64 = 0.3;

/// A machine, as far as times depend on it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Machine {
    /// What the processor calls itself; `null` where the system does not tell.
    pub cpu: Option<String>,
    /// Threads that worked.
    pub threads: usize,
    /// How fast it was, beside the rows; `null` if that was not measured.
    #[serde(default)]
    pub calibration: Option<Calibration>,
}

/// What a fixed loop takes ([`calibrate`](crate::calibrate())), in milliseconds. Times of two machines, or of one that is busy with other things at times, are
/// compared as multiples of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Calibration {
    /// What it takes undisturbed: each kind of its parts as short as it ever was. They are of fractions of a millisecond, which other
    /// programs rarely break off: on one thread this is the same to a few per cent on a quiet machine and on one with four times as much to
    /// do as it has cores.
    #[serde(with = "row::null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub quiet_ms: f64,
    /// What it took as a whole; the middle one of several runs.
    #[serde(with = "row::null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub taken_ms: f64,
}

impl Calibration {
    /// Of one run or more, on one machine; none of none.
    pub fn of(runs: &[Self]) -> Option<Self> {
        let quiet_ms = runs.iter().map(|run| run.quiet_ms).min_by(f64::total_cmp)?;
        Some(Self { quiet_ms, taken_ms: median(&runs.iter().map(|run| run.taken_ms).collect::<Vec<_>>()) })
    }

    /// How many times as long as undisturbed it took: 1 on a machine that does nothing else.
    pub fn load(&self) -> f64 {
        self.taken_ms / self.quiet_ms
    }
}

/// A model of a plan that no row could be planned for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Refusal {
    /// The model, as the plan names it.
    pub model: String,
    /// Why, in a sentence.
    pub reason: String,
}

/// What a report says about its model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ModelInfo {
    /// File name or generator, as `creature:100000`.
    pub name: String,
    /// Number of vertices after cleaning.
    pub vertices: usize,
    /// Number of triangles.
    pub faces: usize,
    /// Length of the bounding box's diagonal in units of the model, by which distances are divided.
    #[serde(with = "row::null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub diagonal: f64,
    /// Whether the surface has no boundary.
    pub closed: bool,
    /// What was repaired when it was read, as whole sentences.
    #[serde(default)]
    pub notes: Vec<String>,
}

impl ModelInfo {
    /// What there is to say of a shape called `name`.
    pub fn of(name: &str, shape: &TriMesh) -> Self {
        Self {
            name: name.to_owned(),
            vertices: shape.vertex_count(),
            faces: shape.face_count(),
            diagonal: shape.bounds().diagonal(),
            closed: shape.topology().is_closed(),
            notes: Vec::new(),
        }
    }
}

/// Text that is not a report.
#[derive(Debug, Error)]
#[error("{file}:{line}:{column}: {message}")]
pub struct ReportError {
    /// The file, or what else the text was taken from.
    pub file: String,
    /// Line, numbered from 1.
    pub line: usize,
    /// Column in bytes, numbered from 1.
    pub column: usize,
    /// What is wrong there.
    pub message: String,
}

impl SweepReport {
    /// An empty report by this version of the library, of some models.
    pub fn new(models: Vec<ModelInfo>) -> Self {
        Self { schema: SCHEMA.to_owned(), version: env!("CARGO_PKG_VERSION").to_owned(), models, ..Self::default() }
    }

    /// Models and scenes of the rows, in words: `bunny.obj, scene auto`.
    pub fn subject(&self) -> String {
        let mut models: Vec<&str> = self.models.iter().map(|model| model.name.as_str()).collect();
        let mut scenes: Vec<&str> = self.rows.iter().map(|row| row.scene.as_str()).collect();
        models.dedup();
        scenes.sort_unstable();
        scenes.dedup();
        match &scenes[..] {
            [] => models.join(", "),
            [scene] => format!("{}, scene {scene}", models.join(", ")),
            scenes => format!("{}, scenes {}", models.join(", "), scenes.join(", ")),
        }
    }

    /// Rows that have no figures.
    pub fn failures(&self) -> impl Iterator<Item = (&SweepRow, &Failure)> {
        self.rows.iter().filter_map(|row| Some((row, row.failure.as_ref()?)))
    }

    /// Indented JSON ending with a line break; `data/schema/sweep.schema.json` describes it.
    ///
    /// A figure that is not finite becomes `null`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("every key is a string and no value can fail") + "\n"
    }

    /// Reads [`SweepReport::to_json`]'s text; finite figures come back to the last bit, `null` as NaN.
    ///
    /// Unknown fields are skipped, so that the report of a later version that only adds some can be read. `file` names the text's origin in
    /// errors.
    ///
    /// # Errors
    /// Names file, line and column of what is not JSON, missing or of the wrong kind, and says so of a report whose [`Self::schema`] is
    /// another than [`SCHEMA`].
    pub fn read_json(json: &str, file: &str) -> Result<Self, ReportError> {
        let read = || {
            // Before all else: in another schema anything may be of another kind.
            serde_json::from_str::<Header>(json)?;
            serde_json::from_str(json)
        };
        read().map_err(|error| {
            let text = error.to_string();
            let (line, column) = (error.line(), error.column());
            let message = text.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&text).to_owned();
            ReportError { file: file.to_owned(), line, column, message }
        })
    }
}

/// What tells whether the rest can be read.
#[derive(Deserialize)]
struct Header {
    #[serde(rename = "schema", deserialize_with = "known_schema")]
    _schema: (),
}

fn known_schema<'de, D: Deserializer<'de>>(from: D) -> Result<(), D::Error> {
    let found = String::deserialize(from)?;
    if found == SCHEMA {
        return Ok(());
    }
    let number = |schema: &str| schema.strip_prefix("pliant-sweep/")?.parse::<u32>().ok();
    let when = match (number(&found), number(SCHEMA)) {
        (Some(found), Some(known)) if found > known => "a later version of Pliant made it",
        (Some(_), Some(_)) => "an earlier version of Pliant made it; run the sweep again",
        _ => "it is no report of a sweep",
    };
    Err(D::Error::custom(format!("the schema is `{found}`, not `{SCHEMA}`: {when}")))
}
