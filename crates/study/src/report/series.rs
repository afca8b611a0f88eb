//! Which rows form a line of the plot, and what the line is called.

use super::SweepRow;
use crate::settings::EQUAL_TIME;

/// What was deformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    /// A cage, which carries the shape.
    Cage,
    /// A decimated mesh in the shape's place, of a size that was asked for.
    Decimated,
    /// The same, of the size that takes as long as a cage.
    EqualTime,
    /// The shape itself.
    Direct,
}

impl Way {
    fn of(row: &SweepRow) -> Self {
        match row {
            _ if row.is_direct() => Self::Direct,
            _ if row.cage_asked.starts_with(EQUAL_TIME) => Self::EqualTime,
            _ if row.is_decimated() => Self::Decimated,
            _ => Self::Cage,
        }
    }
}

/// How a row was made, whatever its size and subject: rows that differ in it have another colour or marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Rule<'r> {
    way: Way,
    method: &'r str,
    propagation: &'r str,
    prune: &'r str,
    start: &'r str,
}

/// What rows that differ only in size have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SeriesKey<'r> {
    model: &'r str,
    scene: &'r str,
    rule: Rule<'r>,
    steps: usize,
    iterations: Option<usize>,
    linear: bool,
}

impl<'r> SeriesKey<'r> {
    pub(super) fn of(row: &'r SweepRow) -> Self {
        let way = Way::of(row);
        let SweepRow { model, scene, method, propagation, prune, start, .. } = row;
        let rule = Rule { way, method, propagation, prune, start };
        Self { model, scene, rule, steps: row.steps, iterations: row.iterations, linear: row.linear }
    }

    pub(super) fn way(&self) -> Way {
        self.rule.way
    }

    /// Whether the other deforms the shape itself as this one deforms a cage of it: the same subject, method and schedule.
    pub(super) fn is_without_cage(&self, other: &Self) -> bool {
        let rule = Rule { way: Way::Direct, method: self.rule.method, ..other.rule };
        *other == Self { rule, ..*self }
    }
}

/// What is worth saying of a series beside others: what they differ in. The rest is said once.
pub(super) struct Labels {
    varying: [bool; 4],
    start_varies: bool,
    /// What all rows have in common.
    pub(super) common: Vec<String>,
}

/// Parts of a setting that stand in a label where they vary: the first three before the rule, the last behind it.
const PARTS: [fn(&SweepRow) -> String; 4] =
    [|row| row.model.clone(), |row| format!("scene {}", row.scene), |row| row.method.clone(), SweepRow::schedule];

impl Labels {
    pub(super) fn of<'r>(rows: impl Iterator<Item = &'r SweepRow>) -> Self {
        let rows: Vec<&SweepRow> = rows.collect();
        let varying = PARTS.map(|part| rows.iter().any(|row| part(row) != part(rows[0])));
        let of_cages = || rows.iter().filter(|row| Way::of(row) == Way::Cage).map(|row| &row.start);
        let start_varies = of_cages().any(|start| Some(start) != of_cages().next());
        let said_once = PARTS.iter().zip(varying).filter(|(_, varies)| !varies);
        let common = said_once.filter_map(|(part, _)| Some(part(rows.first()?))).collect();
        Self { varying, start_varies, common }
    }

    pub(super) fn label(&self, row: &SweepRow) -> String {
        let rule = match Way::of(row) {
            Way::Direct => "no cage".to_owned(),
            Way::Decimated => "decimated".to_owned(),
            Way::EqualTime => "decimated, equal time".to_owned(),
            Way::Cage if self.start_varies => format!("{}, {}, from {}", row.propagation, row.prune, row.start),
            Way::Cage => format!("{}, {}", row.propagation, row.prune),
        };
        let mut said = vec![rule];
        for (k, part) in PARTS.iter().enumerate().filter(|(k, _)| self.varying[*k]) {
            let at = if k + 1 < PARTS.len() { said.len() - 1 } else { said.len() };
            said.insert(at, part(row));
        }
        said.join(", ")
    }
}

/// A point of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// Which of the report's rows it is of, from 0.
    pub(super) row: usize,
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
    /// Which of the models and scenes it is of.
    pub(super) case: usize,
    /// Which of the ways to make, bind and propagate it is.
    pub(super) rule: usize,
    /// Which of the schedules it has; without a cage, of the methods and schedules.
    pub(super) schedule: usize,
    pub(super) points: Vec<Point>,
}

/// The rows of a report as lines. Rows without figures are in none.
#[derive(Debug, PartialEq)]
pub(super) struct AllSeries {
    /// One per setting with a cage or a decimated mesh, in the order of the rows.
    pub(super) sized: Vec<Series>,
    /// One per setting without a cage, whose points all stand for the whole line.
    pub(super) direct: Vec<Series>,
    /// Whether some are of decimated meshes.
    pub(super) decimated: bool,
    /// How many models and scenes there are.
    pub(super) cases: usize,
    /// The published rows that belong to these.
    pub(super) published: Vec<Point>,
    /// The published rows without a cage.
    pub(super) published_direct: Vec<Point>,
    /// What all rows have in common.
    pub(super) common: Vec<String>,
}

impl AllSeries {
    /// Of some of a report's rows, each with its position there.
    pub(super) fn of<'r>(rows: impl Iterator<Item = (usize, &'r SweepRow)> + Clone) -> Self {
        let labels = Labels::of(rows.clone().map(|(_, row)| row));
        let (mut sized, mut direct) = (Vec::new(), Vec::new());
        let (mut published, mut published_direct) = (Vec::new(), Vec::new());
        let (mut cases, mut rules, mut schedules, mut direct_schedules) = (vec![], vec![], vec![], vec![]);
        let mut decimated = false;
        for (number, row) in rows.filter(|(_, row)| row.failure.is_none()) {
            let key = SeriesKey::of(row);
            let cage_vertices = row.cage_vertices.max(1) as f64;
            let point = Point { row: number, cage_vertices, error: row.rms_relative, ms: row.edit_ms() };
            decimated |= row.is_decimated();
            let case = number_of(&mut cases, (key.model, key.scene));
            let times = (key.steps, key.iterations, key.linear);
            // Those without a cage are numbered among themselves: they need no colour of a rule.
            let (lines, published, rule, schedule) = if key.way() == Way::Direct {
                let schedule = number_of(&mut direct_schedules, (key.rule.method, times));
                (&mut direct, &mut published_direct, 0, schedule)
            } else {
                let (rule, schedule) = (number_of(&mut rules, key.rule), number_of(&mut schedules, times));
                (&mut sized, &mut published, rule, schedule)
            };
            let same = |line: &&mut Series| (line.case, line.rule, line.schedule) == (case, rule, schedule);
            match lines.iter_mut().find(same) {
                Some(line) => line.points.push(point),
                None => lines.push(Series { label: labels.label(row), case, rule, schedule, points: vec![point] }),
            }
            if let (Some(error), Some(ms)) = (row.published, row.published_ms) {
                let same = |p: &Point| (p.cage_vertices, p.error, p.ms) == (cage_vertices, error, ms);
                if !published.iter().any(same) {
                    published.push(Point { error, ms, ..point });
                }
            }
        }
        sized.iter_mut().for_each(|line| line.points.sort_by(|a, b| a.cage_vertices.total_cmp(&b.cage_vertices)));
        let cases = cases.len();
        Self { sized, direct, decimated, cases, published, published_direct, common: labels.common }
    }
}

/// Position of an item among those seen so far, put last if new.
fn number_of<T: PartialEq>(seen: &mut Vec<T>, item: T) -> usize {
    seen.iter().position(|other| *other == item).unwrap_or_else(|| {
        seen.push(item);
        seen.len() - 1
    })
}
