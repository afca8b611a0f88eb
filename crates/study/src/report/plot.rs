//! The sweep as a picture: error and time against cage size.

#[cfg(test)]
mod tests;

use std::sync::Arc;

use kuva::backend::svg::SvgBackend;
use kuva::plot::{LinePlot, LineStyle, MarkerShape, ScatterPlot};
use kuva::render::color::Color;
use kuva::render::figure::Figure;
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::render::{PathData, Primitive, Scene, TextAnchor};

use super::SweepReport;
use super::series::{AllSeries, Point, Series};

/// Okabe and Ito's colours that can be told apart with any colour vision, without the yellow that is faint on white.
pub(super) const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"];

/// Also told apart by shape. As polygons: corners, and the angle of the first in degrees (clockwise from +x).
pub(super) const MARKERS: [(MarkerShape, u32, f64); 6] = [
    (MarkerShape::Circle, 0, 0.0),
    (MarkerShape::Square, 4, 45.0),
    (MarkerShape::Triangle, 3, -90.0),
    (MarkerShape::Diamond, 4, 0.0),
    (MarkerShape::TriangleDown, 3, 90.0),
    (MarkerShape::Hexagon, 6, 0.0),
];

/// Dashes of the lines, by schedule.
pub(super) const DASHES: [&str; 4] = ["", "9 3", "3 3", "9 3 2 3"];

/// Dashes of the lines without a cage, by schedule: none is solid.
pub(super) const DIRECT_DASHES: [&str; 4] = ["6 4", "2 3", "8 3 2 3", "12 6"];

const DIRECT: &str = "#333333";
const PUBLISHED: &str = "#000000";
const PUBLISHED_DASH: &str = "1 4";

/// Sizes in pixels.
const WIDTH: f64 = 1080.0;
const PANEL_HEIGHT: f64 = 400.0;
const MARGIN: f64 = 16.0;
const TITLE_HEIGHT: f64 = 62.0;
const LEGEND_LINE: f64 = 22.0;
const SAMPLE: f64 = 40.0;

/// Letters of 13 pixels that fit on a line.
const LONGEST: usize = 125;

/// A logarithmic axis is better than one from 0 once the largest value is this many times the smallest.
const WIDE_RANGE: f64 = 20.0;

/// Percent or milliseconds outside these limits say only that something went wrong: an axis that reaches them would hide
/// all the rest.
const DRAWABLE: std::ops::Range<f64> = 1e-9..1e9;

/// An entry of the legend.
struct Entry {
    label: String,
    colour: &'static str,
    /// Dashes of its line, if it has one.
    dash: Option<&'static str>,
    marker: Option<MarkerShape>,
}

impl SweepReport {
    /// Two panels as SVG: RMS relative edge error, and time of one edit (solve and propagation), against cage vertices.
    ///
    /// One line per setting: colour and marker say how the cage is bound and propagated, dashes how long the solver runs. With several
    /// models or scenes the colour says which, and the marker alone the rest. Decimated meshes are lines of their own, against their own
    /// vertices. Rows without a cage are horizontal dashed lines, published figures crosses; rows without figures are only counted. The axis of cage sizes is logarithmic,
    /// the others are when their values are far apart. A figure that is not finite, absurdly large (from
    /// 1e9), or 0 on a logarithmic axis is not drawn, and the subtitle says how many are missing.
    pub fn to_svg(&self) -> String {
        let all = AllSeries::of(self.rows.iter().enumerate());
        let errors = Panel::new(&all, "RMS relative edge error (%)", |p| 100.0 * p.error);
        let times = Panel::new(&all, "time of one edit (ms)", |p| p.ms);
        let missing = errors.missing + times.missing;
        let (plots, layouts) = [errors, times].into_iter().map(|panel| (panel.plots, panel.layout)).unzip();
        let mut panels = Figure::new(1, 2)
            .with_structure(vec![vec![0], vec![1]])
            .with_plots(plots)
            .with_layouts(layouts)
            .with_spacing(MARGIN)
            .with_padding(0.0)
            .with_figure_size(WIDTH - 2.0 * MARGIN, PANEL_HEIGHT)
            .render();
        name_clips(&mut panels);

        let entries = legend(&all);
        let columns = columns_for(&entries);
        let lines = entries.len().div_ceil(columns);
        let legend_top = TITLE_HEIGHT + PANEL_HEIGHT + MARGIN;
        let mut scene = Scene::new(WIDTH, legend_top + lines as f64 * LEGEND_LINE + MARGIN);
        scene.font_family = panels.font_family.clone();
        scene.text_color = panels.text_color.clone();
        scene.defs = panels.defs;
        self.draw_title(&mut scene, &all, missing);
        let shift = Some(format!("translate({MARGIN},{TITLE_HEIGHT})"));
        scene.add(Primitive::GroupStart { transform: shift, title: None, extra_attrs: None });
        panels.elements.into_iter().for_each(|element| scene.add(element));
        scene.add(Primitive::GroupEnd);
        let width = (WIDTH - 4.0 * MARGIN) / columns as f64;
        for (k, entry) in entries.iter().enumerate() {
            // Column by column, so that settings of one kind stand below each other.
            let (column, line) = (k / lines, k % lines);
            let y = legend_top + (line as f64 + 0.5) * LEGEND_LINE;
            draw_entry(&mut scene, entry, 2.0 * MARGIN + column as f64 * width, y);
        }
        SvgBackend::new().with_pretty(true).render_scene(&scene)
    }

    fn draw_title(&self, scene: &mut Scene, all: &AllSeries, missing: usize) {
        let title = match &self.models[..] {
            [model] => format!("{}, {} vertices", shortened(&model.name, 60), grouped(model.vertices as f64)),
            models => format!("{} models", models.len()),
        };
        scene.add(text(&title, MARGIN, 28.0, 18, TextAnchor::Start, true));
        // A single model stands in the title already.
        let in_title = |part: &str| matches!(&self.models[..], [model] if part == model.name);
        let mut said: Vec<String> = all.common.iter().filter(|part| !in_title(part)).cloned().collect();
        match self.failures().count() {
            0 => {}
            1 => said.push("1 row has no figures".to_owned()),
            failed => said.push(format!("{failed} rows have no figures")),
        }
        if missing > 0 {
            said.push(format!("{missing} figures cannot be drawn"));
        }
        scene.add(text(&shortened(&said.join("; "), LONGEST), MARGIN, 50.0, 13, TextAnchor::Start, false));
    }
}

/// One of the two plots.
struct Panel {
    plots: Vec<Plot>,
    layout: Layout,
    /// Figures that could not be drawn.
    missing: usize,
}

impl Panel {
    fn new(all: &AllSeries, label: &str, value: fn(&Point) -> f64) -> Self {
        let groups = || all.sized.iter().chain(&all.direct).map(|series| &series.points);
        let every = || groups().chain([&all.published, &all.published_direct]).flatten();
        let inside = || every().map(value).filter(|y| DRAWABLE.contains(y));
        let (smallest, largest) = (inside().fold(f64::INFINITY, f64::min), inside().fold(0.0, f64::max));
        // Judged by the positive values, so that one exact 0 does not flatten all others.
        let log_y = largest > WIDE_RANGE * smallest;
        let drawable = |y: f64| DRAWABLE.contains(&y) || (!log_y && (0.0..DRAWABLE.start).contains(&y));
        let missing = every().filter(|point| !drawable(value(point))).count();

        let (left, right) = cage_range(all);
        let mut plots = Vec::new();
        let mut line = |points: Vec<(f64, f64)>, colour: &str, width: f64, dash: &str| {
            let style = if dash.is_empty() { LineStyle::Solid } else { LineStyle::Custom(dash.to_owned()) };
            let plot = LinePlot::new().with_data(points).with_color(colour).with_stroke_width(width);
            plots.push(plot.with_line_style(style).into());
        };
        let across = |y: f64| vec![(left, y), (right, y)];
        let published_direct: Vec<f64> = all.published_direct.iter().map(value).filter(|&y| drawable(y)).collect();
        published_direct.iter().for_each(|&y| line(across(y), PUBLISHED, 1.5, PUBLISHED_DASH));
        for series in &all.direct {
            for point in series.points.iter().filter(|point| drawable(value(point))) {
                line(across(value(point)), direct_colour(all, series), 1.5, pick(&DIRECT_DASHES, series.schedule));
            }
        }
        let seen = |points: &[Point]| -> Vec<(f64, f64)> {
            points.iter().map(|p| (p.cage_vertices, value(p))).filter(|(_, y)| drawable(*y)).collect()
        };
        for series in &all.sized {
            line(seen(&series.points), colour(all, series), 2.0, pick(&DASHES, series.schedule));
        }
        for series in &all.sized {
            let (marker, ..) = pick(&MARKERS, series.rule);
            plots.push(markers(seen(&series.points), colour(all, series), marker, 4.5));
        }
        // A cross on the line, a little inside the right edge, tells it from the lines measured here.
        let beside = right * (left / right).powf(0.04);
        let crosses = seen(&all.published).into_iter().chain(published_direct.iter().map(|&y| (beside, y)));
        plots.push(markers(crosses.collect(), PUBLISHED, MarkerShape::Cross, 6.0));

        let (bottom, top) = match (log_y, largest > 0.0) {
            (true, _) => (smallest / 1.3, largest * 1.3),
            (false, true) => (0.0, 1.08 * largest),
            // Nothing to draw, or nothing but zeros.
            (false, false) => (0.0, 1.0),
        };
        let mut layout = Layout::new((left, right), (bottom, top))
            .with_log_x()
            .with_x_axis_min(left)
            .with_x_axis_max(right)
            .with_y_axis_min(bottom)
            .with_y_axis_max(top)
            .with_x_label(if all.decimated { "vertices of the cage or decimated mesh" } else { "cage vertices" })
            .with_y_label(label)
            .with_x_tick_format(TickFormat::Custom(Arc::new(grouped)))
            .with_label_size(14)
            .with_tick_size(12);
        layout.show_legend = false;
        if log_y {
            layout = layout.with_log_y().with_y_tick_format(TickFormat::Custom(Arc::new(grouped)));
        }
        Self { plots, layout, missing }
    }
}

/// The colour of a line by its rule, or by its model and scene where there are several.
fn colour(all: &AllSeries, series: &Series) -> &'static str {
    pick(&COLOURS, if all.cases > 1 { series.case } else { series.rule })
}

fn direct_colour(all: &AllSeries, series: &Series) -> &'static str {
    if all.cases > 1 { pick(&COLOURS, series.case) } else { DIRECT }
}

/// Numbers the clipping rectangles from 0: kuva goes on counting from one picture to the next, but the same report is to
/// give the same text every time.
pub(super) fn name_clips(scene: &mut Scene) {
    let clips = scene.elements.iter_mut().filter_map(|element| match element {
        Primitive::ClipStart { id, .. } => Some(id),
        _ => None,
    });
    for (k, id) in clips.enumerate() {
        let name = format!("panel-{k}");
        let (old, new) = (format!("id=\"{id}\""), format!("id=\"{name}\""));
        scene.defs.iter_mut().for_each(|definition| *definition = definition.replace(&old, &new));
        *id = name;
    }
}

/// The axis of cage sizes: all of them, with so much room beside the outermost that several of the ticks 1, 2, 5, 10...
/// are on it, however few sizes there are.
fn cage_range(all: &AllSeries) -> (f64, f64) {
    let sizes = || all.sized.iter().flat_map(|series| &series.points).map(|point| point.cage_vertices);
    let (least, most) = (sizes().fold(f64::INFINITY, f64::min).max(1.0), sizes().fold(1.0, f64::max));
    if least.is_finite() { (least / 1.6, most * 1.6) } else { (100.0, 10_000.0) }
}

fn markers(points: Vec<(f64, f64)>, colour: &str, marker: MarkerShape, size: f64) -> Plot {
    ScatterPlot::new().with_data(points).with_color(colour).with_marker(marker).with_size(size).into()
}

fn legend(all: &AllSeries) -> Vec<Entry> {
    let mut entries: Vec<Entry> = all
        .sized
        .iter()
        .map(|series| Entry {
            label: series.label.clone(),
            colour: colour(all, series),
            dash: Some(pick(&DASHES, series.schedule)),
            marker: Some(pick(&MARKERS, series.rule).0),
        })
        .collect();
    entries.extend(all.direct.iter().map(|series| Entry {
        label: series.label.clone(),
        colour: direct_colour(all, series),
        dash: Some(pick(&DIRECT_DASHES, series.schedule)),
        marker: None,
    }));
    if !all.published.is_empty() {
        let (label, marker) = ("published".to_owned(), Some(MarkerShape::Cross));
        entries.push(Entry { label, colour: PUBLISHED, dash: None, marker });
    }
    if !all.published_direct.is_empty() {
        let label = "published, no cage".to_owned();
        entries.push(Entry { label, colour: PUBLISHED, dash: Some(PUBLISHED_DASH), marker: Some(MarkerShape::Cross) });
    }
    entries
}

/// How many columns of entries fit side by side; an average letter of the legend's 13 pixels is below 7.5 wide.
fn columns_for(entries: &[Entry]) -> usize {
    let longest = entries.iter().map(|entry| entry.label.chars().count()).max().unwrap_or(0);
    let width = SAMPLE + 10.0 + 7.5 * longest as f64 + MARGIN;
    (((WIDTH - 4.0 * MARGIN) / width) as usize).clamp(1, 4)
}

fn draw_entry(scene: &mut Scene, entry: &Entry, x: f64, y: f64) {
    if let Some(dash) = entry.dash {
        scene.add(stroke((x, y), (x + SAMPLE, y), entry.colour, 2.0, dash));
    }
    let centre = (x + 0.5 * SAMPLE, y);
    match entry.marker {
        Some(MarkerShape::Cross) => {
            let (cx, cy) = centre;
            for (dx, dy) in [(4.5, 4.5), (4.5, -4.5)] {
                scene.add(stroke((cx - dx, cy - dy), (cx + dx, cy + dy), entry.colour, 1.8, ""));
            }
        }
        Some(marker) => scene.add(filled(marker, centre, 5.0, entry.colour)),
        None => {}
    }
    scene.add(text(&shortened(&entry.label, LONGEST), x + SAMPLE + 10.0, y + 4.5, 13, TextAnchor::Start, false));
}

/// A marker as a primitive: a circle, or the polygon that [`MARKERS`] gives.
fn filled(marker: MarkerShape, (cx, cy): (f64, f64), radius: f64, colour: &str) -> Primitive {
    let fill = Color::from(colour);
    let sides = MARKERS.iter().find(|(shape, sides, _)| *shape == marker && *sides > 0);
    let Some(&(_, sides, first)) = sides else {
        let (fill_opacity, stroke, stroke_width) = (None, None, None);
        return Primitive::Circle { cx, cy, r: radius, fill, fill_opacity, stroke, stroke_width };
    };
    let corner = |k: u32| {
        let angle = (first + 360.0 * f64::from(k) / f64::from(sides)).to_radians();
        format!("{:.2} {:.2}", cx + 1.2 * radius * angle.cos(), cy + 1.2 * radius * angle.sin())
    };
    let outline = format!("M{} Z", (0..sides).map(corner).collect::<Vec<_>>().join(" L"));
    Primitive::Path(Box::new(PathData {
        d: outline,
        fill: Some(fill.clone()),
        stroke: fill,
        stroke_width: 0.0,
        opacity: None,
        stroke_dasharray: None,
    }))
}

fn stroke(from: (f64, f64), to: (f64, f64), colour: &str, stroke_width: f64, dash: &str) -> Primitive {
    let stroke_dasharray = (!dash.is_empty()).then(|| dash.to_owned());
    let ((x1, y1), (x2, y2)) = (from, to);
    Primitive::Line { x1, y1, x2, y2, stroke: Color::from(colour), stroke_width, stroke_dasharray }
}

fn text(content: &str, x: f64, y: f64, size: u32, anchor: TextAnchor, bold: bool) -> Primitive {
    Primitive::Text { x, y, content: plain(content), size, anchor, rotate: None, bold, color: None }
}

/// At most `limit` letters of a text: a label that does not fit is cut where the picture ends, but visibly.
fn shortened(text: &str, limit: usize) -> String {
    match text.char_indices().nth(limit) {
        Some(_) => text.chars().take(limit - 1).chain(['\u{2026}']).collect(),
        None => text.to_owned(),
    }
}

/// Text that kuva draws as it stands: no formula between dollar signs, and no character that XML cannot hold.
pub(super) fn plain(text: &str) -> String {
    let allowed = |c: char| !c.is_control() && c != '\u{fffe}' && c != '\u{ffff}';
    text.chars().map(|c| if allowed(c) { c } else { ' ' }).collect::<String>().replace('$', "\\$")
}

/// A number with commas between groups of three digits: `12,500`; plain below 1.
fn grouped(x: f64) -> String {
    if x < 1.0 {
        return format!("{x}");
    }
    let digits = format!("{x:.0}");
    let mut out = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// An entry of a short table, round and round.
pub(super) fn pick<T: Copy>(table: &[T], k: usize) -> T {
    table[k % table.len()]
}
