//! What the page's script is told besides the rows: which of them form lines, which figures there are, and what is beside what.

use serde::Serialize;

use super::super::SweepReport;
use super::super::columns::{Cell, Column, Kind, Shown};
use super::super::plot::{COLOURS, DASHES, DIRECT_DASHES, pick};
use super::super::series::{AllSeries, Series};
use super::{gallery, table};

#[derive(Serialize)]
pub(super) struct View {
    cases: Vec<Case>,
    figures: Vec<Figure>,
    /// What each row was asked to be.
    names: Vec<String>,
    /// The one figure that is no field of a row.
    edit_ms: Vec<Option<f64>>,
    /// For each row, which one has the picture without a cage to lay beside its own.
    beside: Vec<Option<usize>>,
}

/// A model and a scene.
#[derive(Serialize)]
pub(super) struct Case {
    label: String,
    common: Vec<String>,
    lines: Vec<Line>,
    /// Rows without figures, which are in no line.
    failed: usize,
}

/// A line of the plots.
#[derive(Serialize)]
struct Line {
    label: String,
    /// Without a cage: level, whatever the cage size.
    direct: bool,
    /// Of the line and its markers; none is the page's ink.
    colour: Option<&'static str>,
    symbol: &'static str,
    dash: String,
    rows: Vec<usize>,
}

/// A figure that can be plotted: `factor` times what stands in the row under `key`, or in its times.
#[derive(Serialize)]
struct Figure {
    key: &'static str,
    heading: &'static str,
    factor: f64,
}

/// As Plotly calls the markers of the pictures in SVG.
const SYMBOLS: [&str; 6] = ["circle", "square", "triangle-up", "diamond", "triangle-down", "hexagon"];

/// The models and scenes of a report, in the order of their first rows.
pub(super) fn cases(report: &SweepReport) -> Vec<Case> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut rows: Vec<Vec<usize>> = Vec::new();
    let mut known = std::collections::HashMap::new();
    for (k, row) in report.rows.iter().enumerate() {
        let name = (row.model.as_str(), row.scene.as_str());
        let at = *known.entry(name).or_insert(names.len());
        if at == names.len() {
            names.push(name);
            rows.push(Vec::new());
        }
        rows[at].push(k);
    }
    let case = |((model, scene), rows): ((&str, &str), Vec<usize>)| {
        let all = AllSeries::of(rows.iter().map(|&k| (k, &report.rows[k])));
        let method = |series: &Series| &report.rows[series.points[0].row].method;
        let one_method = all.direct.iter().all(|series| method(series) == method(&all.direct[0]));
        // Lines without a cage have the ink of the page; those of several methods the colours that these have on cages.
        let colour_of = |direct: &Series| {
            let same = all.sized.iter().find(|series| !one_method && method(series) == method(direct));
            same.map(|series| pick(&COLOURS, series.rule))
        };
        let sized = all.sized.iter().map(|series| Line::of(series, false, Some(pick(&COLOURS, series.rule))));
        let direct = all.direct.iter().map(|series| Line::of(series, true, colour_of(series)));
        Case {
            label: format!("{model}, scene {scene}"),
            failed: rows.iter().filter(|&&k| report.rows[k].failure.is_some()).count(),
            lines: sized.chain(direct).collect(),
            // Model and scene are said already.
            common: all.common.into_iter().skip(2).collect(),
        }
    };
    names.into_iter().zip(rows).map(case).collect()
}

impl Line {
    fn of(series: &Series, direct: bool, colour: Option<&'static str>) -> Self {
        let dash = pick(if direct { &DIRECT_DASHES } else { &DASHES }, series.schedule);
        // Plotly wants units, and a name for none.
        let dash = if dash.is_empty() { "solid".to_owned() } else { format!("{}px", dash.replace(' ', "px,")) };
        Self {
            label: series.label.clone(),
            direct,
            colour,
            // Another one when colours begin again.
            symbol: if direct { "star" } else { pick(&SYMBOLS, series.rule + series.rule / COLOURS.len()) },
            dash,
            rows: series.points.iter().map(|point| point.row).collect(),
        }
    }
}

impl View {
    pub(super) fn of(report: &SweepReport, cases: Vec<Case>) -> Self {
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        Self {
            cases,
            figures: figures(report),
            names: report.rows.iter().map(|row| row.key().to_string()).collect(),
            edit_ms: report.rows.iter().map(|row| finite(row.edit_ms())).collect(),
            beside: gallery::beside(report),
        }
    }
}

/// What came out and what it took, where any row has it.
fn figures(report: &SweepReport) -> Vec<Figure> {
    let came_out = |shown: Shown| matches!(shown, Shown::Main(_) | Shown::Full);
    // Published figures are drawn beside those they are compared with.
    let own = table::columns().filter(|column| !column.key.starts_with("published"));
    // The first is what the report is about.
    let chosen = own.filter(|column| came_out(column.shown) || column.key == "rms_relative");
    let present = |column: &&Column| {
        report.rows.iter().any(|row| !matches!((column.cell)(row), Cell::Missing | Cell::Text(_) | Cell::Flag(_)))
    };
    let figure = |column: &'static Column| Figure {
        key: column.key,
        heading: column.heading,
        factor: match column.kind {
            Kind::Share | Kind::Length => 1e2,
            Kind::Bytes => 1e-6,
            _ => 1.0,
        },
    };
    chosen.filter(present).map(figure).collect()
}
