//! The JSON of services that draw figures over time and raise an alarm: github-action-benchmark and Bencher.
//!
//! Both know a series by its name alone, so names are those of [`SweepRow::key`], which a change of Pliant's version leaves as they are.
//! Rows without figures, and figures that a row has not, are in neither: there is no value to give them.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{on_one_line, row_names};
use crate::report::{Spread, SweepReport, SweepRow};

/// A figure that is better the smaller it is.
struct Measure {
    /// Its name where a name is lower-case words and hyphens; ends with the unit.
    slug: &'static str,
    /// Its name for people.
    title: &'static str,
    unit: &'static str,
    /// Whether a chart of its own is worth drawing for every row.
    charted: bool,
    value: fn(&SweepRow) -> Option<Value>,
}

/// A figure with what it lay between, where it was measured repeatedly.
struct Value {
    middle: f64,
    range: Option<(f64, f64)>,
}

const MEASURES: [Measure; 16] = {
    const fn measure(
        slug: &'static str,
        title: &'static str,
        unit: &'static str,
        charted: bool,
        value: fn(&SweepRow) -> Option<Value>,
    ) -> Measure {
        Measure { slug, title, unit, charted, value }
    }

    [
        measure("rms-relative-percent", "RMS relative edge error", "%", true, |r| percent(Some(r.rms_relative))),
        measure("relative-rms-percent", "relative RMS edge error", "%", false, |r| percent(Some(r.relative_rms))),
        measure("edge-p95-percent", "edge error, p95", "%", false, |r| percent(Some(r.edge_p95))),
        measure("edge-max-percent", "largest edge error", "%", true, |r| percent(Some(r.edge_max))),
        measure("handle-error-max-percent", "handles off by, of the diagonal", "%", false, |r| {
            percent(Some(r.handle_error_max))
        }),
        measure("distance-to-converged-percent", "RMS distance to converged, of the diagonal", "%", true, |r| {
            percent(r.distance_to_converged)
        }),
        measure("refined-rms-relative-percent", "refined RMS relative edge error", "%", true, |r| {
            percent(r.refined_rms_relative)
        }),
        measure("flipped-faces", "flipped faces", "faces", false, |r| count(r.flipped_faces)),
        measure("intersecting-face-pairs", "intersecting face pairs", "pairs", false, |r| count(r.intersecting_faces)),
        measure("simplify-ms", "simplify", "ms", false, |r| time(r.times.simplify_ms)),
        measure("bind-ms", "bind", "ms", true, |r| time(r.times.bind_ms)),
        measure("prepare-ms", "prepare", "ms", true, |r| time(r.times.prepare_ms)),
        measure("drag-ms", "drag", "ms", true, |r| time(r.times.drag_ms)),
        measure("propagate-ms", "propagate", "ms", true, |r| time(r.times.propagate_ms)),
        measure("refine-ms", "refine", "ms", true, |r| time(r.times.refine_ms)),
        measure("peak-memory-bytes", "peak memory", "bytes", false, |r| {
            single(r.times.peak_memory_bytes.map(|bytes| bytes as f64))
        }),
    ]
};

fn single(middle: Option<f64>) -> Option<Value> {
    middle.filter(|x| x.is_finite()).map(|middle| Value { middle, range: None })
}

fn percent(fraction: Option<f64>) -> Option<Value> {
    single(fraction.map(|x| 100.0 * x))
}

fn count(figure: Option<usize>) -> Option<Value> {
    single(figure.map(|n| n as f64))
}

fn time(spread: Option<Spread>) -> Option<Value> {
    let Spread { median, min, max } = spread?;
    let range = (min.is_finite() && max.is_finite()).then_some((min, max));
    single(Some(median)).map(|value| Value { range, ..value })
}

/// An entry of github-action-benchmark; its documentation calls all but the last two required.
#[derive(Serialize)]
struct Entry {
    name: String,
    unit: &'static str,
    value: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<String>,
    extra: String,
}

/// A metric of Bencher.
#[derive(Serialize)]
struct Metric {
    value: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    lower_value: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    upper_value: Option<f64>,
}

/// The longest name of a benchmark that Bencher takes, in bytes.
const BENCHER_NAME: usize = 1024;

impl SweepReport {
    /// JSON for the tool `customSmallerIsBetter` of the GitHub Action github-action-benchmark: an array with an entry for each row and
    /// figure, errors in percent, times in milliseconds with half of what they spread over as `range`.
    ///
    /// The action draws a chart for each entry, so only the figures that most readers follow are in it: RMS relative and largest edge error,
    /// distance to converged, refined error, and the times of all stages but simplification. It refuses an empty array.
    pub fn to_github_benchmark(&self) -> String {
        let mut entries = Vec::new();
        for (row, name) in self.named_rows(usize::MAX) {
            for measure in MEASURES.iter().filter(|measure| measure.charted) {
                let Some(Value { middle, range }) = (measure.value)(row) else { continue };
                entries.push(Entry {
                    name: format!("{name}: {}", measure.title),
                    unit: measure.unit,
                    value: middle,
                    range: range.map(|(low, high)| format!("± {}", 0.5 * (high - low))),
                    extra: self.extra(row),
                });
            }
        }
        pretty(&entries)
    }

    /// Bencher Metric Format: an object of benchmarks, each row one, with a metric for each figure that it has: `rms-relative-percent`,
    /// `drag-ms`, ... Times have their shortest and longest as lower and upper value.
    pub fn to_bencher(&self) -> String {
        let mut benchmarks = BTreeMap::new();
        for (row, name) in self.named_rows(BENCHER_NAME) {
            let metric = |measure: &Measure| {
                let Value { middle: value, range } = (measure.value)(row)?;
                let (lower_value, upper_value) = range.unzip();
                Some((measure.slug, Metric { value, lower_value, upper_value }))
            };
            let metrics: BTreeMap<&str, Metric> = MEASURES.iter().filter_map(metric).collect();
            if !metrics.is_empty() {
                benchmarks.insert(name, metrics);
            }
        }
        pretty(&benchmarks)
    }

    /// The rows that have figures.
    fn named_rows(&self, longest: usize) -> impl Iterator<Item = (&SweepRow, String)> {
        let rows = || self.rows.iter().filter(|row| row.failure.is_none());
        rows().zip(row_names(rows(), longest, |row| row.key().to_string()))
    }

    /// What a reader of a chart may want to know of the row besides, a line each.
    fn extra(&self, row: &SweepRow) -> String {
        let mut lines = vec![
            format!("vertices: {}", row.vertices),
            format!("cage vertices: {}", row.cage_vertices),
            format!("repeats: {}", row.times.repeats),
            format!("version: {}", on_one_line(&self.version)),
        ];
        if let Some(machine) = &self.machine {
            let cpu = machine.cpu.as_deref().unwrap_or("unknown processor");
            lines.push(format!("machine: {}, threads: {}", on_one_line(cpu), machine.threads));
        }
        lines.join("\n")
    }
}

fn pretty(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("every key is a string and no value can fail") + "\n"
}
