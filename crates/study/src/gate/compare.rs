//! Two reports, figure by figure.

use std::collections::{HashMap, VecDeque};

use super::figures::{FIGURES, Figure, Group, Unit};
use super::{Change, ChangeKind, GATE_SCHEMA, GateReport, Tolerances, Verdict, verdict_of};
use crate::Calibration;
use crate::report::{Machine, RowKey, SweepReport, SweepRow};

/// Compares the rows of a report with those of a baseline that were asked to be the same ([`SweepRow::key`]).
///
/// A figure is worse if it is above what its tolerance allows, or not there any more; better if the old one would be too much by the same
/// measure. Signs count for nothing: a volume that shrinks is as bad as one that grows. A row that is missing is a regression, a new one is not.
/// If all that is new about one row is its prune rule, its figures are compared with those of the row that is missing, too.
pub fn compare_reports(baseline: &SweepReport, now: &SweepReport, tolerances: &Tolerances) -> GateReport {
    let mut notes = Vec::new();
    let clock = Clock::of(baseline, now, tolerances, &mut notes);
    let mut comparison = Comparison { tolerances, clock, changes: Vec::new(), figures: 0 };
    let mut rows_now: HashMap<RowKey<'_>, VecDeque<&SweepRow>> = HashMap::new();
    for row in &now.rows {
        rows_now.entry(row.key()).or_default().push_back(row);
    }
    let (mut still_failing, mut gone) = (0, Vec::new());
    for (at, old) in baseline.rows.iter().enumerate() {
        // Rows of one key, which two models of one name may have, are told apart by their order.
        let Some(new) = rows_now.get_mut(&old.key()).and_then(VecDeque::pop_front) else {
            comparison.whole(ChangeKind::Missing, old, Some(at));
            gone.push(at);
            continue;
        };
        still_failing += usize::from(old.failure.is_some() && new.failure.is_some());
        comparison.row(at, old, new);
    }
    for at in gone {
        // Bound by another rule is no longer the row that was asked for, but tells what that did to it.
        let old = &baseline.rows[at];
        let mut alike = now.rows.iter().filter(|row| row.key().but_for_prune() == old.key().but_for_prune());
        if let (Some(new), None) = (alike.next(), alike.next())
            && let Some(new) = rows_now.get_mut(&new.key()).and_then(VecDeque::pop_front)
        {
            let before = comparison.changes.len();
            comparison.row(at, old, new);
            let now = format!(" (now {})", new.prune);
            comparison.changes[before..].iter_mut().for_each(|change| change.row += &now);
        }
    }
    for row in &now.rows {
        // Those that are left, in their order.
        if let Some(left) = rows_now.get_mut(&row.key())
            && left.front().is_some_and(|front| std::ptr::eq(*front, row))
        {
            left.pop_front();
            comparison.whole(ChangeKind::Added, row, None);
        }
    }
    notes.extend(now.refused.iter().map(|refused| format!("{} was refused: {}", refused.model, refused.reason)));
    if still_failing > 0 {
        notes.push(format!("{still_failing} rows have no figures, as in the baseline."));
    }
    let Comparison { mut changes, figures, .. } = comparison;
    changes.sort_by(|a, b| a.kind.cmp(&b.kind).then_with(|| worst_first(a, b)));
    let verdicts = changes.iter().filter(|change| change.kind.is_regression());
    let verdict = verdicts.map(|change| change.failure.as_ref().map_or(Verdict::Regression, verdict_of)).max();
    if verdict.is_none() && changes.iter().any(is_to_keep) {
        notes.push(
            "Something is better than the baseline says: write a new one, so that it stays so (--update).".to_owned(),
        );
    }
    GateReport {
        schema: GATE_SCHEMA.to_owned(),
        verdict: verdict.unwrap_or(Verdict::Pass),
        rows: baseline.rows.iter().map(|row| row.key().to_string()).collect(),
        figures,
        changes,
        notes,
    }
}

/// Whether something is better, and not just by chance.
fn is_to_keep(change: &Change) -> bool {
    let disturbed = change.unit.is_some_and(Unit::can_be_disturbed);
    change.kind == ChangeKind::Recovered || change.kind == ChangeKind::Better && !disturbed
}

/// Of one kind: what became so many times as much first; of what is better, what became least.
fn worst_first(a: &Change, b: &Change) -> std::cmp::Ordering {
    let order = b.factor().total_cmp(&a.factor());
    if a.kind == ChangeKind::Better { order.reverse() } else { order }
}

struct Comparison<'a> {
    tolerances: &'a Tolerances,
    clock: Option<Clock>,
    changes: Vec<Change>,
    figures: usize,
}

impl Comparison<'_> {
    /// Something that is to be said of a whole row.
    fn whole(&mut self, kind: ChangeKind, row: &SweepRow, at: Option<usize>) {
        let (figure, unit, old, new, allowed) = (None, None, None, None, None);
        let row = row.key().to_string();
        self.changes.push(Change { kind, row, figure, unit, old, new, allowed, failure: None, at });
    }

    fn row(&mut self, at: usize, old: &SweepRow, new: &SweepRow) {
        let change = match (&old.failure, &new.failure) {
            (Some(_), Some(_)) => return,
            (Some(_), None) => return self.whole(ChangeKind::Recovered, old, Some(at)),
            (None, Some(failure)) => {
                self.whole(ChangeKind::Failed, old, Some(at));
                self.changes.last_mut().map(|change| change.failure = Some(failure.clone()))
            }
            (None, None) if old.vertices != new.vertices => {
                self.whole(ChangeKind::OtherModel, old, Some(at));
                self.changes.last_mut().map(|change| {
                    change.figure = Some("vertices".to_owned());
                    change.unit = Some(Unit::Count);
                    (change.old, change.new) = (Some(old.vertices as f64), Some(new.vertices as f64));
                })
            }
            (None, None) => None,
        };
        if change.is_none() {
            FIGURES.iter().for_each(|figure| self.figure(at, figure, old, new));
        }
    }

    fn figure(&mut self, at: usize, figure: &Figure, old: &SweepRow, new: &SweepRow) {
        let tolerance = self.tolerances.of(figure.name, figure.group);
        let value = |row| (figure.of)(row).filter(|value| value.is_finite());
        let (was, mut is) = (value(old), value(new));
        let allowed = was.map(|was| tolerance.most(was.abs()));
        if tolerance.is_off() {
            return;
        }
        let mut kind = match (was, is, allowed) {
            // A system that does not tell memory, or a report without times.
            (None, ..) | (_, None, _) if matches!(figure.group, Group::Time | Group::Memory) => return,
            (None, None, _) => return,
            (None, Some(_), _) => ChangeKind::Different,
            (Some(was), Some(now), Some(allowed)) => {
                // The least and the most that it can be said to be.
                let (mut low, mut high) = (now.abs(), now.abs());
                if figure.group == Group::Time {
                    let Some(clock) = &self.clock else { return };
                    (low, high) = clock.at_baseline(was, now);
                }
                self.figures += 1;
                if low > allowed {
                    is = is.map(|is| low.copysign(is));
                    ChangeKind::Worse
                } else if was.abs() > tolerance.most(high) {
                    is = is.map(|is| high.copysign(is));
                    ChangeKind::Better
                } else {
                    return;
                }
            }
            _ => ChangeKind::Worse,
        };
        if figure.group == Group::Neutral {
            kind = ChangeKind::Different;
        }
        self.changes.push(Change {
            kind,
            row: old.key().to_string(),
            figure: Some(figure.name.to_owned()),
            unit: Some(figure.unit),
            old: was,
            new: is,
            allowed,
            failure: None,
            at: Some(at),
        });
    }
}

/// Converts times of one machine to those of another.
struct Clock {
    /// Milliseconds now for one then where nothing disturbs, for what is short, and for what is long.
    quiet: f64,
    short: f64,
    long: f64,
}

/// Work shorter than this, in milliseconds, often runs undisturbed on a busy machine, as systems give programs slices of a few
/// milliseconds; the shortest of some runs is then as on a quiet one.
const SHORT_MS: f64 = 2.0;

/// From here on the machine is busy, and the report says so.
const BUSY: f64 = 1.5;

impl Clock {
    /// None where times cannot be compared, which is said in a note.
    fn of(baseline: &SweepReport, now: &SweepReport, tolerances: &Tolerances, notes: &mut Vec<String>) -> Option<Self> {
        // A first baseline has no rows, and no times to miss.
        if !tolerances.compare_times() || baseline.rows.is_empty() {
            return None;
        }
        let (then, now) = (baseline.machine.as_ref(), now.machine.as_ref());
        let (Some(then), Some(now)) = (then, now) else {
            notes.push("Times are not compared: a report does not say on what machine it was made.".to_owned());
            return None;
        };
        let usable =
            |c: &Calibration| c.quiet_ms.is_finite() && c.quiet_ms > 0.0 && c.taken_ms.is_finite() && c.taken_ms > 0.0;
        let (Some(a), Some(b)) = (then.calibration.filter(usable), now.calibration.filter(usable)) else {
            notes.push("Times are not compared: a report was made without calibration.".to_owned());
            return None;
        };
        if then.threads != now.threads {
            let (then, now) = (then.threads, now.threads);
            notes.push(format!("Times are not compared: the baseline is of {then} threads, this is of {now}."));
            return None;
        }
        // What is longer is disturbed as much as the loop is; so is what is short where several threads wait for each other. Where that is
        // unfair it is lenient.
        let (quiet, long) = (b.quiet_ms / a.quiet_ms, b.taken_ms.max(b.quiet_ms) / a.quiet_ms);
        let clock = Self { quiet, short: if now.threads == 1 { quiet } else { long }, long };
        if then.cpu != now.cpu || (quiet - 1.0).abs() > 0.1 {
            let name = |machine: &Machine| machine.cpu.clone().unwrap_or_else(|| "an unnamed processor".to_owned());
            notes.push(format!(
                "Times are converted: the loop that they are compared by takes {:.1} ms here ({}) and {:.1} ms at the baseline ({}).",
                b.quiet_ms,
                name(now),
                a.quiet_ms,
                name(then)
            ));
        }
        if b.load() > BUSY {
            let which = if now.threads == 1 { format!("stages over {SHORT_MS} ms") } else { "all stages".to_owned() };
            notes.push(format!(
                "The machine is busy: the loop took {:.1} times as long as undisturbed, which {which} may do too.",
                b.load()
            ));
        }
        Some(clock)
    }

    /// A time of now as it would be at the baseline, where it was `then`: if it was disturbed as much as may be, and not at all.
    fn at_baseline(&self, then: f64, now: f64) -> (f64, f64) {
        (now / if then < SHORT_MS { self.short } else { self.long }, now / self.quiet)
    }
}
