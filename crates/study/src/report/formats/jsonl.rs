//! JSON Lines, one row each, for tools that read rows as they come.

use serde::Serialize;

use crate::report::{Machine, SweepReport, SweepRow};

/// A row with what it takes to understand it alone.
#[derive(Serialize)]
struct Line<'r> {
    schema: &'r str,
    version: &'r str,
    machine: Option<&'r Machine>,
    #[serde(flatten)]
    row: &'r SweepRow,
}

impl SweepReport {
    /// JSON Lines: an object per row, each with the report's `schema`, `version` and `machine` before the row's own fields, which are as in
    /// [`SweepReport::to_json`]. No rows are no text. What is no row, as models that were refused, notes and pictures, is not in it.
    pub fn to_jsonl(&self) -> String {
        let mut out = String::new();
        for row in &self.rows {
            let line = Line { schema: &self.schema, version: &self.version, machine: self.machine.as_ref(), row };
            out += &serde_json::to_string(&line).expect("every key is a string and no value can fail");
            out.push('\n');
        }
        out
    }
}
