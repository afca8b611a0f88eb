//! CSV for programs and Markdown for people.

use std::fmt::Write as _;

use super::columns::{COLUMNS, Cell, Column, Shown};
use super::{Knee, NO_CAGE, SweepReport, SweepRow};

/// How much a Markdown table shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Detail {
    /// What most readers compare, in about a dozen columns: the settings that differ, cage size, error, time of a drag, and as much of
    /// the rest as there is room for (the default).
    #[default]
    Main,
    /// Every column.
    Full,
}

/// Columns of a table of [`Detail::Main`], unless the settings alone take more.
const MAIN_COLUMNS: usize = 12;

/// Figures it has in any case, beside cage size and error.
const LEAST_FIGURES: usize = 2;

impl SweepReport {
    /// Comma-separated values (RFC 4180): a header of the fields' names, then one record per row; lines end with CR LF.
    ///
    /// Errors are fractions, numbers have full precision. Missing values are empty, `iterations` is `converged` where
    /// JSON has `null` of a method that iterates, and warnings are joined by `; `.
    pub fn to_csv(&self) -> String {
        csv(self.rows.iter())
    }

    /// A Markdown table with units in its header, errors in percent.
    ///
    /// Above it stands what all rows have in common, each such column said once; a column without any value is left out.
    /// Below it stand the smallest cages that were looked for, the warnings, by row (numbered from 1), and the notes. Columns are padded, so that it reads as plain text too.
    pub fn to_markdown(&self, detail: Detail) -> String {
        let mut out = String::new();
        if self.rows.is_empty() {
            out.push_str("No rows.\n");
        } else {
            let table = Table::new(&self.rows, detail);
            if !table.common.is_empty() {
                let _ = writeln!(out, "{}\n", table.common.join("; "));
            }
            write_padded(&mut out, &table.lines, &table.numeric);
        }
        if !self.knees.is_empty() {
            let _ = write!(out, "\n{}", Knee::table(&self.knees));
        }
        let remarks = self.remarks();
        if !remarks.is_empty() {
            out.push('\n');
            remarks.iter().for_each(|remark| out.push_str(&format!("- {remark}\n")));
        }
        out
    }

    /// What stands below a table, in Markdown: warnings by row, refused models, notes on models, notes on the sweep.
    pub(super) fn remarks(&self) -> Vec<String> {
        let warnings = self.rows.iter().enumerate().flat_map(|(k, row)| {
            let failure = row.failure.as_ref().map(|failure| format!("no figures: {}", failure.reason));
            let all = failure.into_iter().chain(row.warnings.iter().cloned());
            all.map(move |warning| format!("Row {}: {}", k + 1, in_markdown(&warning)))
        });
        let refused = self.refused.iter().map(|r| in_markdown(&format!("{} was refused: {}", r.model, r.reason)));
        let of_models = self
            .models
            .iter()
            .flat_map(|model| model.notes.iter().map(|note| in_markdown(&format!("{}: {note}", model.name))));
        let notes = self.notes.iter().map(|note| in_markdown(note));
        warnings.chain(refused).chain(of_models).chain(notes).collect()
    }
}

/// Rows as text, sorted into what they have in common and what they differ in.
pub(super) struct Table {
    /// `heading: value`, once for all rows.
    pub(super) common: Vec<String>,
    /// The header, then a line per row.
    pub(super) lines: Vec<Vec<String>>,
    /// Whether a column is aligned to the right.
    pub(super) numeric: Vec<bool>,
}

impl Table {
    /// Of one row or more.
    pub(super) fn new(rows: &[SweepRow], detail: Detail) -> Self {
        let (common, columns) = split_columns(rows, detail);
        let mut lines: Vec<Vec<String>> = vec![columns.iter().map(|column| column.heading.to_owned()).collect()];
        for row in rows {
            lines.push(columns.iter().map(|column| shown_cell(column, row)).collect());
        }
        let numeric = columns.iter().map(|column| column.kind.is_number()).collect();
        Self { common, lines, numeric }
    }
}

/// What all rows have in common, and the columns in which they differ.
fn split_columns(rows: &[SweepRow], detail: Detail) -> (Vec<String>, Vec<&'static Column>) {
    let (mut common, mut differing) = (Vec::new(), Vec::new());
    for column in &COLUMNS {
        let shown = match column.shown {
            Shown::Always | Shown::Setting | Shown::Main(_) => true,
            Shown::Full => detail == Detail::Full,
            Shown::Never => false,
        };
        // What a row has not for want of a cage or of figures makes no difference: that is seen elsewhere.
        let says = |row: &SweepRow| match (column.cell)(row) {
            Cell::Text(text) if column.shown == Shown::Setting && text == NO_CAGE && column.key != "cage_asked" => None,
            Cell::Missing if column.shown == Shown::Setting && row.failure.is_some() => None,
            cell => Some(cell.rounded()),
        };
        if !shown || rows.iter().all(|row| (column.cell)(row).exact().is_empty()) {
            continue;
        }
        let can_be_said_once = match column.shown {
            Shown::Always => false,
            Shown::Setting => true,
            _ => rows.len() > 1,
        };
        let mut said = rows.iter().filter_map(says);
        let first = said.next().unwrap_or_else(|| NO_CAGE.to_owned());
        if can_be_said_once && said.all(|other| other == first) {
            common.push(format!("{}: {}", column.heading, in_markdown(&first)));
        } else {
            differing.push(column);
        }
    }
    if detail == Detail::Main {
        narrow(&mut differing);
    }
    (common, differing)
}

/// Settings first, then cage size and error, then the figures by rank until the table is wide enough.
fn narrow(columns: &mut Vec<&'static Column>) {
    let place = |column: &Column| match column.shown {
        Shown::Setting => (0, 0),
        Shown::Main(rank) => (2, rank),
        _ => (1, 0),
    };
    columns.sort_by_key(|column| place(column));
    let needed = columns.iter().filter(|column| !matches!(column.shown, Shown::Main(_))).count();
    columns.truncate(MAIN_COLUMNS.max(needed + LEAST_FIGURES));
}

/// Records of rows under one header; see [`SweepReport::to_csv`].
pub(super) fn csv<'a>(rows: impl Iterator<Item = &'a SweepRow>) -> String {
    let mut csv = String::new();
    let mut record = |fields: &mut dyn Iterator<Item = String>| {
        for (k, field) in fields.enumerate() {
            csv.push_str(if k > 0 { "," } else { "" });
            csv.push_str(&quoted(field));
        }
        csv.push_str("\r\n");
    };
    record(&mut COLUMNS.iter().map(|column| column.key.to_owned()));
    for row in rows {
        record(&mut COLUMNS.iter().map(|column| (column.cell)(row).exact()));
    }
    csv
}

/// Writes a Markdown table, its first line the header; a column of text starts at the left, one of numbers ends at the right.
pub(super) fn write_padded(out: &mut String, lines: &[Vec<String>], numeric: &[bool]) {
    let width = |k: usize| lines.iter().map(|line| line[k].chars().count()).max().unwrap_or(0).max(3);
    let widths: Vec<usize> = (0..numeric.len()).map(width).collect();
    for (number, line) in lines.iter().enumerate() {
        for ((cell, &width), &right) in line.iter().zip(&widths).zip(numeric) {
            let _ = if right { write!(out, "| {cell:>width$} ") } else { write!(out, "| {cell:<width$} ") };
        }
        out.push_str("|\n");
        if number == 0 {
            for (&width, &right) in widths.iter().zip(numeric) {
                let _ = write!(out, "|{}{}", "-".repeat(width + 1), if right { ":" } else { "-" });
            }
            out.push_str("|\n");
        }
    }
}

fn shown_cell(column: &Column, row: &SweepRow) -> String {
    match (column.cell)(row) {
        Cell::Missing => "-".to_owned(),
        cell => in_markdown(&cell.rounded()),
    }
}

/// A field of CSV, in quotes where it must be.
fn quoted(field: String) -> String {
    if field.contains([',', '"', '\r', '\n']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field }
}

/// Text that stands as it is in a line or cell of Markdown: nothing in it ends either, marks up or opens an element.
pub(crate) fn in_markdown(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '\\' | '|' | '<' | '&' | '*' | '`' | '$' => out.extend(['\\', letter]),
            _ if letter.is_control() => out.push(' '),
            _ => out.push(letter),
        }
    }
    out
}
