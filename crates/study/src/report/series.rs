//! Which rows form a line of the plot, and what the line is called.

use super::{SweepReport, SweepRow};

/// A point of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// At least 1, as a logarithmic axis needs.
    pub(super) cage_vertices: f64,
    /// RMS relative edge error, a fraction.
    pub(super) error: f64,
    pub(super) ms: f64,
}

/// Rows that differ only in cage size, by increasing size.
#[derive(Debug, PartialEq)]
pub(super) struct Series {
    pub(super) label: String,
    /// Which of the ways to make, bind and propagate it is: series that differ only in schedule share it.
    pub(super) rule: usize,
    /// Which of the schedules it is.
    pub(super) schedule: usize,
    pub(super) points: Vec<Point>,
}

/// The rows of a report as lines.
#[derive(Debug, PartialEq)]
pub(super) struct AllSeries {
    /// One per setting, in the order of the rows.
    pub(super) cages: Vec<Series>,
    /// One per setting without a cage, whose points all stand for the whole line.
    pub(super) direct: Vec<Series>,
    /// The published rows that belong to these.
    pub(super) published: Vec<Point>,
    /// The published rows without a cage.
    pub(super) published_direct: Vec<Point>,
    /// What all rows have in common.
    pub(super) common: Vec<String>,
}

impl AllSeries {
    pub(super) fn of(report: &SweepReport) -> Self {
        let rows = &report.rows;
        let varies = |part: fn(&SweepRow) -> String| rows.iter().any(|row| part(row) != part(&rows[0]));
        // Parts of a setting that are worth saying in every label; the others are said once.
        let parts: [fn(&SweepRow) -> String; 4] = [
            |row| row.model.clone(),
            |row| format!("scene {}", row.scene),
            |row| row.method.clone(),
            SweepRow::schedule,
        ];
        let [before @ .., last] = parts.map(|part| varies(part).then_some(part));
        let label = |row: &SweepRow| {
            let rule =
                if row.is_direct() { "no cage".to_owned() } else { format!("{}, {}", row.propagation, row.prune) };
            let said = before.iter().flatten().map(|part| part(row)).chain([rule]);
            said.chain(last.map(|part| part(row))).collect::<Vec<_>>().join(", ")
        };
        let common =
            parts.iter().filter(|part| !rows.is_empty() && !varies(**part)).map(|part| part(&rows[0])).collect();

        let mut all = Self { cages: vec![], direct: vec![], published: vec![], published_direct: vec![], common };
        let (mut rules, mut schedules) = (Vec::new(), Vec::new());
        for row in rows {
            let rule = [&row.model, &row.scene, &row.method, &row.propagation, &row.prune].map(String::as_str);
            // Rules without a cage are numbered among themselves: they need no colour.
            let rule = number_of(&mut rules, (row.is_direct(), rule));
            let schedule = number_of(&mut schedules, row.schedule());
            let point =
                Point { cage_vertices: row.cage_vertices.max(1) as f64, error: row.rms_relative, ms: row.edit_ms() };
            let (lines, published) = match row.is_direct() {
                true => (&mut all.direct, &mut all.published_direct),
                false => (&mut all.cages, &mut all.published),
            };
            match lines.iter_mut().find(|line| (line.rule, line.schedule) == (rule, schedule)) {
                Some(line) => line.points.push(point),
                None => lines.push(Series { label: label(row), rule, schedule, points: vec![point] }),
            }
            if let (Some(error), Some(ms)) = (row.published, row.published_ms) {
                let point = Point { error, ms, ..point };
                if !published.contains(&point) {
                    published.push(point);
                }
            }
        }
        all.cages.iter_mut().for_each(|line| line.points.sort_by(|a, b| a.cage_vertices.total_cmp(&b.cage_vertices)));
        all.renumber_rules();
        all
    }

    /// Numbers the rules of cages from 0 in order of appearance, so that they take the first colours.
    fn renumber_rules(&mut self) {
        let mut rules = Vec::new();
        self.cages.iter_mut().for_each(|line| line.rule = number_of(&mut rules, line.rule));
    }
}

/// Position of an item among those seen so far, put last if new.
fn number_of<T: PartialEq>(seen: &mut Vec<T>, item: T) -> usize {
    seen.iter().position(|other| *other == item).unwrap_or_else(|| {
        seen.push(item);
        seen.len() - 1
    })
}
