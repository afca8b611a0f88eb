//! Markdown for the page of a CI job, which has room for so much and no more.

use std::fmt::Write as _;

use crate::report::knee::{Knee, KneeTarget};
use crate::report::table::{Table, in_markdown};
use crate::report::{Detail, SweepReport};

/// Bytes of a summary that leave room for other text in the 1 MiB that GitHub takes from a step (`GITHUB_STEP_SUMMARY`); it shows nothing
/// of a longer one.
pub const SUMMARY_BYTES: usize = 1_000_000;

/// Rows without figures, or remarks, that are listed one by one.
const LISTED: usize = 20;

/// The longest remark that is quoted whole, in letters.
const LONGEST: usize = 300;

impl SweepReport {
    /// Markdown of at most `limit` bytes (from 4,000; [`SUMMARY_BYTES`] for GitHub): a heading, how many rows there are and what has no
    /// figures and why, the smallest cages within 10 % of no cage, the table of [`Detail::Main`], and folded away that of [`Detail::Full`].
    ///
    /// Tables end after the last row that there is room for, each with a sentence saying how many are left out and where they are.
    pub fn to_summary(&self, limit: usize) -> String {
        let mut out = format!("## Sweep of {}\n\n", shortened(&in_markdown(&self.subject())));
        out += &self.counts();
        list(&mut out, &self.without_figures(), limit / 8);
        // What stands below the tables is made first, so that it has room.
        let mut below = String::new();
        list(&mut below, &self.to_be_known(), limit / 8);
        let mut room = limit.saturating_sub(out.len() + below.len());
        let knees = self.knee_section();
        if knees.len() <= room / 4 {
            room -= knees.len();
            out += &knees;
        }
        if self.rows.is_empty() {
            return out + &below;
        }
        // Half of the room for what most readers want; what that leaves is the other table's.
        let mut main = String::new();
        write_table(&mut main, &Table::new(&self.rows, Detail::Main), room / 2);
        room = room.saturating_sub(main.len());
        out += &main;
        let (open, close) = ("\n<details>\n<summary>Every figure</summary>\n\n", "\n</details>\n");
        let mut full = String::new();
        write_table(&mut full, &Table::new(&self.rows, Detail::Full), room.saturating_sub(open.len() + close.len()));
        if open.len() + full.len() + close.len() <= room {
            out += open;
            out += &full;
            out += close;
        }
        out + &below
    }

    fn counts(&self) -> String {
        let failed = self.failures().count();
        let mut said = vec![counted(self.rows.len(), "row")];
        if failed > 0 {
            said.push(format!("{failed} without figures"));
        }
        if !self.refused.is_empty() {
            said.push(format!("{} refused", counted(self.refused.len(), "model")));
        }
        format!("{}.\n", said.join(", "))
    }

    /// A line for each row without figures and for each refused model.
    fn without_figures(&self) -> Vec<String> {
        let rows = self.failures().map(|(row, failure)| format!("{}: {}", row.key(), failure.reason));
        let models = self.refused.iter().map(|refusal| format!("{}: {}", refusal.model, refusal.reason));
        rows.chain(models).collect()
    }

    fn knee_section(&self) -> String {
        let found: Vec<Knee> =
            self.find_knees(KneeTarget::NoCage(0.1)).into_iter().filter(|knee| knee.found.is_some()).collect();
        if found.is_empty() {
            return String::new();
        }
        format!("\nSmallest cages within 10 % of the error without a cage:\n\n{}", Knee::table(&found))
    }

    /// Notes and warnings; why rows have no figures stands above.
    fn to_be_known(&self) -> Vec<String> {
        let of_models = self.models.iter().flat_map(|m| m.notes.iter().map(|note| format!("{}: {note}", m.name)));
        let warnings = self.rows.iter().flat_map(|row| row.warnings.iter().map(|w| format!("{}: {w}", row.key())));
        self.notes.iter().cloned().chain(of_models).chain(warnings).collect()
    }
}

/// As many items of a list as fit into `room` bytes, and how many more there are.
fn list(out: &mut String, items: &[String], room: usize) {
    let more = |items: usize| format!("- and {items} more, which the JSON report has\n");
    let reserved = more(items.len()).len();
    let mut text = String::new();
    for (k, item) in items.iter().enumerate() {
        let line = format!("- {}\n", in_markdown(&shortened(item)));
        let rest = if k + 1 == items.len() { 0 } else { reserved };
        if k == LISTED || text.len() + line.len() + rest > room {
            text += &more(items.len() - k);
            break;
        }
        text += &line;
    }
    if !text.is_empty() {
        out.push('\n');
        *out += &text;
    }
}

/// As many rows as fit into `room` bytes, with what they have in common above and what is missing below.
fn write_table(out: &mut String, table: &Table, room: usize) {
    let common = table.common.join("; ");
    let [header, rows @ ..] = &table.lines[..] else { return };
    let mut text = if common.is_empty() { "\n".to_owned() } else { format!("\n{common}\n\n") };
    write_line(&mut text, header);
    let marks: Vec<String> = table.numeric.iter().map(|right| if *right { "--:" } else { "---" }.to_owned()).collect();
    write_line(&mut text, &marks);
    let all = rows.len();
    // Room for the sentence that tells what is left out, whatever the number.
    let reserved = left_out(all, all).len();
    let mut shown = 0;
    for row in rows {
        let before = text.len();
        write_line(&mut text, row);
        shown += 1;
        let last = shown == all;
        if text.len() + if last { 0 } else { reserved } > room {
            text.truncate(before);
            shown -= 1;
            break;
        }
    }
    match shown {
        _ if shown == all => *out += &text,
        // Not even a header: the sentence alone.
        0 => *out += &left_out(all, all),
        _ => *out += &(text + &left_out(all - shown, all)),
    }
}

fn left_out(rows: usize, all: usize) -> String {
    format!(
        "\n{rows} of {} are left out here, for which there is no room: the JSON, CSV and other reports of the same sweep have all of \
         them.\n",
        counted(all, "row")
    )
}

/// A line of a table. Cells have no padding, which would take most of the room.
fn write_line(out: &mut String, cells: &[String]) {
    cells.iter().for_each(|cell| {
        let _ = write!(out, "| {cell} ");
    });
    out.push_str("|\n");
}

fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

fn shortened(text: &str) -> String {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}\u{2026}", &text[..end]),
        None => text.to_owned(),
    }
}
