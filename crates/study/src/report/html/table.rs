//! The table of all rows.

use super::super::columns::{COLUMNS, Cell, Column, Kind, Shown};
use super::super::{SweepReport, SweepRow};

/// A column of the page only: no field of a row.
pub(super) const EDIT: Column = Column {
    key: "edit_ms",
    heading: "edit (ms)",
    kind: Kind::Time,
    shown: Shown::Main(0),
    cell: |row| Some(row.edit_ms()).filter(|ms| ms.is_finite()).map_or(Cell::Missing, Cell::Time),
};

/// Every column that people read, times begun by that of an edit.
pub(super) fn columns() -> impl Iterator<Item = &'static Column> {
    let first_time = COLUMNS.iter().position(|column| column.key == "simplify_ms").unwrap_or(COLUMNS.len());
    let (before, times) = COLUMNS.split_at(first_time);
    before.iter().chain([&EDIT]).chain(times).filter(|column| column.shown != Shown::Never)
}

/// Rows and columns as text.
pub(super) struct Table {
    /// What all rows have in common, as `heading: value`.
    pub(super) common: Vec<String>,
    pub(super) headings: Vec<Heading>,
    pub(super) rows: Vec<Line>,
    /// Selects the columns that are shown only on demand, as CSS.
    pub(super) more: String,
    /// Selects those that are aligned to the right.
    pub(super) right: String,
}

pub(super) struct Heading {
    pub(super) key: &'static str,
    pub(super) text: &'static str,
}

pub(super) struct Line {
    /// From 1.
    pub(super) number: usize,
    pub(super) failed: bool,
    pub(super) has_picture: bool,
    pub(super) cells: Vec<String>,
}

impl Table {
    pub(super) fn of(report: &SweepReport) -> Self {
        let rows = &report.rows;
        let (mut common, mut more, mut right) = (Vec::new(), Vec::new(), Vec::new());
        let (mut headings, mut columns): (Vec<Heading>, Vec<Vec<Cell>>) = (Vec::new(), Vec::new());
        for column in self::columns() {
            let cells: Vec<Cell> = rows.iter().map(column.cell).collect();
            if cells.iter().all(|cell| matches!(cell, Cell::Missing)) {
                continue;
            }
            headings.push(Heading { key: column.key, text: column.heading });
            // The number of the row stands before the first.
            let position = format!(":nth-child({})", headings.len() + 1);
            if column.kind.is_number() {
                right.push(position.clone());
            }
            let first = cells[0].rounded();
            let constant = column.shown != Shown::Always && cells.iter().all(|cell| cell.rounded() == first);
            if constant && rows.len() > 1 && matches!(column.shown, Shown::Setting | Shown::Main(_)) {
                common.push(format!("{}: {first}", column.heading));
            }
            if column.shown == Shown::Full || (constant && rows.len() > 1) {
                more.push(position);
            }
            columns.push(cells);
        }
        let line = |(k, row): (usize, &SweepRow)| Line {
            number: k + 1,
            failed: row.failure.is_some(),
            has_picture: report.picture(row).is_some(),
            cells: columns.iter().map(|cells| shown(&cells[k])).collect(),
        };
        let rows = rows.iter().enumerate().map(line).collect();
        Self { common, headings, rows, more: selector(&more), right: selector(&right) }
    }
}

fn shown(cell: &Cell) -> String {
    if matches!(cell, Cell::Missing) { "-".to_owned() } else { cell.rounded() }
}

/// Any of some positions; one that is nowhere if there are none.
fn selector(positions: &[String]) -> String {
    if positions.is_empty() { ":nth-child(0)".to_owned() } else { format!(":is({})", positions.join(",")) }
}

/// A fraction in percent, without the sign.
pub(super) fn percent(fraction: f64) -> String {
    Cell::Share(fraction).rounded()
}

/// A number with as many digits as matter.
pub(super) fn plain(number: f64) -> String {
    Cell::Number(number).rounded()
}
