//! The pictures of rows, beside those of the same edit without a cage.

use super::super::{SweepReport, SweepRow};
use super::table;
use crate::pipeline::count;

/// All pictures, in groups.
pub(super) struct Gallery<'r> {
    pub(super) groups: Vec<Group<'r>>,
}

/// Rows of one model, scene, method and schedule.
pub(super) struct Group<'r> {
    pub(super) title: String,
    /// Without a cage.
    pub(super) reference: Option<Reference<'r>>,
    pub(super) cards: Vec<Card<'r>>,
}

/// What a group is compared with.
pub(super) enum Reference<'r> {
    /// A row of the group.
    Own(Card<'r>),
    /// One of another group: it differs in what `says`, and stands in the page there.
    Other { number: usize, says: String, numbers: String },
}

/// A picture and its numbers.
pub(super) struct Card<'r> {
    /// The row's number, from 1.
    pub(super) number: usize,
    /// PNG in base64.
    pub(super) picture: &'r str,
    pub(super) title: String,
    pub(super) numbers: String,
}

/// What rows of a group share.
type GroupKey<'r> = (&'r str, &'r str, &'r str, usize, Option<usize>, bool);

fn key(row: &SweepRow) -> GroupKey<'_> {
    (&row.model, &row.scene, &row.method, row.steps, row.iterations, row.linear)
}

/// For each row that has a cage or a decimated mesh: which row has the picture to lay beside its own, one without a cage of the same model
/// and scene, and of the same method and schedule if there is one, else of the same method, else of any.
pub(super) fn beside(report: &SweepReport) -> Vec<Option<usize>> {
    let mut nearest = std::collections::HashMap::new();
    for (k, row) in report.rows.iter().enumerate() {
        if row.is_direct() && report.picture(row).is_some() {
            for level in levels(row) {
                nearest.entry(level).or_insert(k);
            }
        }
    }
    let of = |row: &SweepRow| levels(row).iter().find_map(|level| nearest.get(level).copied());
    report.rows.iter().map(|row| if row.is_direct() { None } else { of(row) }).collect()
}

/// What a picture beside another should share with it, less and less.
fn levels(row: &SweepRow) -> [(&str, &str, Option<&str>, Option<String>); 3] {
    let (model, scene, method) = (row.model.as_str(), row.scene.as_str(), row.method.as_str());
    [(model, scene, Some(method), Some(row.schedule())), (model, scene, Some(method), None), (model, scene, None, None)]
}

impl<'r> Gallery<'r> {
    pub(super) fn of(report: &'r SweepReport) -> Self {
        let beside = beside(report);
        let mut groups: Vec<Group<'r>> = Vec::new();
        let mut known = std::collections::HashMap::new();
        for (k, row) in report.rows.iter().enumerate() {
            let Some(picture) = report.picture(row) else { continue };
            let card = Card { number: k + 1, picture, title: title(row), numbers: numbers(row) };
            let at = *known.entry(key(row)).or_insert(groups.len());
            if at == groups.len() {
                let title = [&row.model, &format!("scene {}", row.scene), &row.method, &row.schedule()]
                    .map(String::as_str)
                    .join(", ");
                groups.push(Group { title, reference: None, cards: Vec::new() });
            }
            let group = &mut groups[at];
            if row.is_direct() && !matches!(group.reference, Some(Reference::Own(_))) {
                group.reference = Some(Reference::Own(card));
                continue;
            }
            // One of the same group takes its place when its turn comes.
            let other = beside[k].filter(|&other| key(&report.rows[other]) != key(row));
            if let (Some(other), None) = (other, &group.reference) {
                let there = &report.rows[other];
                let (says, numbers) = (difference(there, row), numbers(there));
                group.reference = Some(Reference::Other { number: other + 1, says, numbers });
            }
            group.cards.push(card);
        }
        Self { groups }
    }
}

/// What one row was made with and another was not.
fn difference(of: &SweepRow, from: &SweepRow) -> String {
    if of.method == from.method { of.schedule() } else { format!("{}, {}", of.method, of.schedule()) }
}

/// What the row is, short.
fn title(row: &SweepRow) -> String {
    let vertices = count(row.cage_vertices);
    match (row.is_direct(), row.is_decimated()) {
        (true, _) => "no cage".to_owned(),
        (_, true) => format!("{} ({vertices} vertices)", row.cage_asked.replace(':', " ")),
        _ => format!("cage {} ({vertices} vertices), {}, {}", row.cage_asked, row.propagation, row.prune),
    }
}

/// Its main figures.
fn numbers(row: &SweepRow) -> String {
    let errors = [("RMS", row.rms_relative), ("p95", row.edge_p95), ("max", row.edge_max)];
    let known = errors.into_iter().filter(|(_, error)| error.is_finite());
    let mut said: Vec<String> = known.map(|(name, error)| format!("{name} {} %", table::percent(error))).collect();
    if row.edit_ms().is_finite() {
        said.push(format!("edit {} ms", (table::EDIT.cell)(row).rounded()));
    }
    said.join(", ")
}
