//! Tables and plots of a sweep.
//!
//! Errors are fractions in JSON and CSV, where programs read them, and percent in Markdown and plots, where people do.
//! Times are milliseconds everywhere.

mod columns;
mod comparison;
mod plot;
mod row;
mod series;
mod table;
#[cfg(test)]
mod tests;

use pliant_mesh::TriMesh;
use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use comparison::{Comparison, ImplicitRow};
pub use row::{NO_CAGE, SweepRow};
pub use table::Detail;

/// The result of a sweep.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SweepReport {
    /// Version of Pliant that made it.
    pub version: String,
    /// The shape that was deformed.
    pub model: ModelInfo,
    /// Name of the scene.
    pub scene: String,
    /// What holds for the whole sweep and a reader must know, as whole sentences.
    #[serde(default)]
    pub notes: Vec<String>,
    /// One row per cage size and setting, in the order they were run.
    pub rows: Vec<SweepRow>,
}

/// What a report says about its model.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ModelInfo {
    /// File name or generator, as `creature:100000`.
    pub name: String,
    /// Number of vertices after cleaning.
    pub vertices: usize,
    /// Number of triangles.
    pub faces: usize,
    /// Length of the bounding box's diagonal in units of the model, by which distances are divided.
    #[serde(with = "row::null_is_nan")]
    pub diagonal: f64,
    /// Whether the surface has no boundary.
    pub closed: bool,
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
    /// An empty report by this version of the library.
    pub fn new(model: ModelInfo, scene: impl Into<String>) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            model,
            scene: scene.into(),
            notes: Vec::new(),
            rows: Vec::new(),
        }
    }

    /// Indented JSON, `{"version", "model", "scene", "notes", "rows": [...]}`, ending with a line break.
    ///
    /// A figure that is not finite becomes `null`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("every key is a string and no value can fail") + "\n"
    }

    /// Reads [`SweepReport::to_json`]'s text; finite figures come back to the last bit, `null` as NaN.
    ///
    /// Unknown fields are skipped, so that a later version's report can be read. `file` names the text's origin in errors.
    ///
    /// # Errors
    /// Names file, line and column of what is not JSON, missing or of the wrong kind.
    pub fn read_json(json: &str, file: &str) -> Result<Self, ReportError> {
        serde_json::from_str(json).map_err(|error| {
            let text = error.to_string();
            let (line, column) = (error.line(), error.column());
            let message = text.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&text).to_owned();
            ReportError { file: file.to_owned(), line, column, message }
        })
    }
}
