//! What moved, in words.

use std::fmt::Write as _;

use super::{Change, ChangeKind, GateReport, Verdict};
use crate::report::in_markdown;

impl ChangeKind {
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Failed => "FAILED",
            Self::Missing => "MISSING",
            Self::OtherModel => "OTHER MODEL",
            Self::Worse => "WORSE",
            Self::Better => "better",
            Self::Recovered => "recovered",
            Self::Different => "different",
            Self::Added => "new",
        }
    }
}

impl Change {
    /// What moved and by how much, without the row: `rms_relative 4.59 % -> 9.10 % (+98 %, up to 4.59 % allowed)`.
    pub fn said(&self) -> String {
        let (Some(figure), Some(unit)) = (&self.figure, self.unit) else {
            return match (&self.failure, self.kind) {
                (Some(failure), _) => failure.reason.clone(),
                (None, ChangeKind::Missing) => "the row is not there any more".to_owned(),
                (None, ChangeKind::Recovered) => "the row had no figures and has some".to_owned(),
                (None, _) => "the row was not there before".to_owned(),
            };
        };
        let (old, new) = (self.old.unwrap_or(f64::NAN), self.new.unwrap_or(f64::NAN));
        let [was, is] = unit.shown([old, new]);
        let mut text = format!("{figure} {was} -> {is}");
        let factor = self.factor();
        let by = match factor {
            _ if !factor.is_finite() => None,
            2.0.. => Some(format!("{factor:.1} times as much")),
            _ => Some(percent(factor - 1.0)),
        };
        let allowed = self.allowed.filter(|_| self.kind == ChangeKind::Worse && self.new.is_some());
        let allowed = allowed.map(|allowed| format!("up to {} allowed", unit.shown([allowed, new])[0]));
        let more: Vec<String> = [by, allowed].into_iter().flatten().collect();
        if !more.is_empty() {
            let _ = write!(text, " ({})", more.join(", "));
        }
        text
    }
}

/// A relative change with as many digits as it has.
fn percent(share: f64) -> String {
    let percent = 1e2 * share;
    if percent.abs() < 0.05 { format!("{percent:+.1e} %") } else { format!("{percent:+.1} %") }
}

/// More lines than anyone reads; JSON has all.
const MOST_LINES: usize = 40;

impl GateReport {
    /// What it comes to, in one line.
    pub fn summary(&self) -> String {
        let count = |kind: ChangeKind| self.changes.iter().filter(|change| change.kind == kind).count();
        let kinds = [
            (ChangeKind::Failed, "rows failed"),
            (ChangeKind::Missing, "rows missing"),
            (ChangeKind::OtherModel, "rows of another model"),
            (ChangeKind::Worse, "worse"),
            (ChangeKind::Better, "better"),
            (ChangeKind::Recovered, "rows recovered"),
            (ChangeKind::Different, "different"),
            (ChangeKind::Added, "rows new"),
        ];
        let counts = kinds.map(|(kind, words)| (count(kind), words)).into_iter().filter(|(n, _)| *n > 0);
        let moved: Vec<String> = counts.map(|(n, words)| format!("{n} {words}")).collect();
        let moved = if moved.is_empty() { "nothing moved".to_owned() } else { moved.join(", ") };
        let verdict = match self.verdict {
            Verdict::Pass => "PASS",
            Verdict::Regression => "REGRESSION",
            Verdict::Numeric => "JOBS FAILED",
            Verdict::Internal => "INTERNAL ERROR",
        };
        format!("{verdict}: {} rows, {} figures compared: {moved}", self.rows.len(), self.figures)
    }

    /// Lines for a terminal: what moved, the worst first, then notes and what it comes to.
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        for change in self.changes.iter().take(MOST_LINES) {
            let _ = writeln!(out, "{:<11} {}\n{:11} in {}", change.kind.word(), change.said(), "", change.row);
        }
        if let Some(more @ 1..) = self.changes.len().checked_sub(MOST_LINES) {
            let _ = writeln!(out, "and {more} more");
        }
        for note in &self.notes {
            let _ = writeln!(out, "note: {note}");
        }
        out + &self.summary() + "\n"
    }

    /// Markdown that fits a step summary or a comment on a change.
    pub fn to_markdown(&self) -> String {
        let mut out = format!("**{}**\n", self.summary());
        if !self.changes.is_empty() {
            out.push_str("\n| | what moved | row |\n|---|---|---|\n");
        }
        for change in self.changes.iter().take(MOST_LINES) {
            let (said, row) = (in_markdown(&change.said()), in_markdown(&change.row));
            let _ = writeln!(out, "| {} | {said} | {row} |", change.kind.word());
        }
        if let Some(more @ 1..) = self.changes.len().checked_sub(MOST_LINES) {
            let _ = writeln!(out, "\nand {more} more");
        }
        for note in &self.notes {
            let _ = write!(out, "\n- {}", in_markdown(note));
        }
        if !self.notes.is_empty() {
            out.push('\n');
        }
        out
    }
}
