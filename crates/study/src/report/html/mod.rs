//! The report as one HTML file: plots to explore, a table to sort and filter, and pictures side by side.
//!
//! What can be read without scripts (facts, table, failures, remarks, pictures) is made here, from `report.html`. Scripts (`report.js`) add
//! plots, sorting, filtering and a closer look at a row; they read the report's rows from JSON in the page, and pictures from where they
//! stand in it, so that everything is there once.

mod gallery;
mod table;
#[cfg(test)]
mod tests;
pub(in crate::report) mod text;
mod view;

use askama::Template;
use pliant_io::picture::colour_map;
use plotly::Plot;

use super::{PICTURE_WORST, RowKey, SweepReport, SweepRow};
use crate::pipeline::count;
use gallery::{Gallery, Reference};
use table::Table;

/// What the page is filled from.
#[derive(Template)]
#[template(path = "report.html")]
struct Page<'r> {
    report: &'r SweepReport,
    title: String,
    facts: Vec<String>,
    table: Table,
    failures: Vec<Failed<'r>>,
    remarks: Vec<Remark>,
    gallery: Gallery<'r>,
    several_cases: bool,
    /// Colours of the scale of the pictures, as CSS.
    scale: String,
    /// Percent at the scale's end.
    worst: f64,
    rows_json: String,
    view_json: String,
    css: &'static str,
    script: &'static str,
    plotly: &'static str,
}

/// A row without figures.
struct Failed<'r> {
    number: usize,
    key: RowKey<'r>,
    kind: &'static str,
    reason: &'r str,
}

/// Something a reader must know.
struct Remark {
    /// The rows, the model or nothing.
    of: String,
    text: String,
}

impl SweepReport {
    /// One HTML file that needs nothing else: no network, no other file, no server.
    ///
    /// It has plots of any figure against cage size and against the time of an edit, one line per setting, with rows without a cage as level
    /// lines and published figures as crosses; a table of all rows, to sort and to filter, with units; what failed, was refused or must be
    /// known; and the pictures beside those of the same edit without a cage. The latter three can be read without scripts, and printed.
    ///
    /// Nothing but the report goes into it, and no text in the report is read as HTML. The plots are drawn by Plotly.js, which takes 4.7 MB
    /// of the file; the rest is some 3 kB a row and its picture.
    pub fn to_html(&self) -> String {
        let cases = view::cases(self);
        let page = Page {
            report: self,
            title: self.short_subject(),
            facts: self.facts(),
            table: Table::of(self),
            failures: self.failed(),
            remarks: self.grouped_remarks(),
            gallery: Gallery::of(self),
            several_cases: cases.len() > 1,
            scale: scale(),
            worst: 100.0 * PICTURE_WORST,
            rows_json: text::json(&self.without_pictures()),
            view_json: text::json(&view::View::of(self, cases)),
            css: include_str!("report.css"),
            script: include_str!("report.js"),
            plotly: plotly_source(),
        };
        page.render().expect("a template without filters that fail writes to memory")
    }

    /// What goes into the page as JSON: pictures stand in it already.
    fn without_pictures(&self) -> Self {
        Self {
            schema: self.schema.clone(),
            version: self.version.clone(),
            machine: self.machine.clone(),
            models: self.models.clone(),
            notes: self.notes.clone(),
            refused: self.refused.clone(),
            rows: self.rows.clone(),
            knees: self.knees.clone(),
            pictures: Default::default(),
        }
    }

    /// [`Self::subject`], or only how many models there are of many.
    fn short_subject(&self) -> String {
        const NAMED: usize = 3;
        match self.models.len() {
            0 if self.rows.is_empty() => "Sweep".to_owned(),
            ..=NAMED => self.subject(),
            many => format!("Sweep of {many} models"),
        }
    }

    /// How much there is, and where it comes from.
    fn facts(&self) -> Vec<String> {
        let failed = self.failures().count();
        let mut facts = vec![plural(self.rows.len(), "row")];
        if failed > 0 {
            facts.push(format!("{} without figures", count(failed)));
        }
        if !self.refused.is_empty() {
            facts.push(format!("{} refused", plural(self.refused.len(), "model")));
        }
        facts.push(format!("Pliant {}", self.version));
        if let Some(machine) = &self.machine {
            let threads = plural(machine.threads, "thread");
            facts.push(machine.cpu.as_ref().map_or(threads.clone(), |cpu| format!("{cpu}, {threads}")));
            facts.extend(machine.calibration.map(|loop_of| {
                format!("calibration loop {:.1} ms, undisturbed {:.1} ms", loop_of.taken_ms, loop_of.quiet_ms)
            }));
        }
        facts
    }

    fn failed(&self) -> Vec<Failed<'_>> {
        let rows = self.rows.iter().enumerate();
        let failed = rows.filter_map(|(k, row)| {
            let failure = row.failure.as_ref()?;
            Some(Failed { number: k + 1, key: row.key(), kind: failure.kind.name(), reason: &failure.reason })
        });
        failed.collect()
    }

    /// Notes, what models were repaired of, and warnings, equal ones once.
    fn grouped_remarks(&self) -> Vec<Remark> {
        let mut remarks: Vec<Remark> =
            self.notes.iter().map(|note| Remark { of: String::new(), text: note.clone() }).collect();
        let of_models = self.models.iter().flat_map(|model| model.notes.iter().map(move |note| (&model.name, note)));
        remarks.extend(of_models.map(|(model, note)| Remark { of: model.clone(), text: note.clone() }));
        let mut warnings: Vec<(&str, Vec<usize>)> = Vec::new();
        let mut known = std::collections::HashMap::new();
        for (k, row) in self.rows.iter().enumerate() {
            let unreadable = !row.id.is_empty() && self.pictures.contains_key(&row.id) && self.picture(row).is_none();
            let own = row.warnings.iter().map(String::as_str);
            for warning in own.chain(unreadable.then_some("the picture is no PNG in base64 and is left out")) {
                let at = *known.entry(warning).or_insert(warnings.len());
                if at == warnings.len() {
                    warnings.push((warning, Vec::new()));
                }
                warnings[at].1.push(k + 1);
            }
        }
        remarks.extend(
            warnings.into_iter().map(|(warning, rows)| Remark { of: in_words(&rows), text: warning.to_owned() }),
        );
        remarks
    }

    /// A row's picture, if it has one that is a PNG.
    fn picture(&self, row: &SweepRow) -> Option<&str> {
        // What the eight bytes that every PNG begins with are in base64, but for the bits of the ninth.
        const BEGINS_WITH: &str = "iVBORw0KGg";
        let picture = (!row.id.is_empty()).then(|| self.pictures.get(&row.id)).flatten()?;
        let letter = |c: u8| c.is_ascii_alphanumeric() || matches!(c, b'+' | b'/' | b'=');
        (picture.starts_with(BEGINS_WITH) && picture.bytes().all(letter)).then_some(picture.as_str())
    }
}

/// `row 3`, `rows 3, 4 and 5`; after so many only how many more.
fn in_words(rows: &[usize]) -> String {
    const NAMED: usize = 12;
    let text = |rows: &[usize]| rows.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
    match rows {
        [row] => format!("row {row}"),
        [.., last] if rows.len() <= NAMED => format!("rows {} and {last}", text(&rows[..rows.len() - 1])),
        _ => format!("rows {} and {} more", text(&rows[..NAMED]), rows.len() - NAMED),
    }
}

fn plural(n: usize, thing: &str) -> String {
    format!("{} {thing}{}", count(n), if n == 1 { "" } else { "s" })
}

/// The colours of pictures from 0 to the worst, for a gradient of CSS.
fn scale() -> String {
    const STOPS: u32 = 16;
    let stop = |k| {
        let [r, g, b] = colour_map(f64::from(k) / f64::from(STOPS));
        format!("rgb({r} {g} {b})")
    };
    (0..=STOPS).map(stop).collect::<Vec<_>>().join(",")
}

/// The source of Plotly.js, which the crate plotly carries: the first of the scripts that it would put into a page of its own.
fn plotly_source() -> &'static str {
    static SOURCE: std::sync::LazyLock<String> = std::sync::LazyLock::new(|| {
        let scripts = Plot::offline_js_sources();
        let begin = scripts.find('>').map_or(0, |at| at + 1);
        let end = scripts[begin..].find("</script>").map_or(scripts.len(), |at| begin + at);
        scripts[begin..end].to_owned()
    });
    &SOURCE
}
