//! Error over that without a cage, against the cage's share of the shape: the axes of Figure 3 of Hybrid Mesh Editing.

use kuva::backend::svg::SvgBackend;
use kuva::plot::legend::LegendPosition;
use kuva::plot::{LinePlot, LineStyle, MarkerShape, ScatterPlot};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot;
use kuva::render::render::render_multiple;

use super::plot::{COLOURS, MARKERS, name_clips, pick, plain};
use super::series::{Labels, SeriesKey, Way};
use super::{SweepReport, SweepRow};
use crate::PAPER_SCENE;
use crate::paper::TABLE_1;

/// Sizes in pixels.
const WIDTH: f64 = 1080.0;
const HEIGHT: f64 = 460.0;

/// The axis of ratios is logarithmic where the largest is this many times the smallest.
const WIDE: f64 = 6.0;

/// Colours of the paper's two models: the larger black, the smaller grey.
const PUBLISHED: [(usize, &str); 2] = [(43_244, "#000000"), (21_622, "#999999")];

/// A line: what it is called, and percent of the shape's vertices with the ratio of errors, by size.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Relative {
    pub(super) label: String,
    pub(super) points: Vec<(f64, f64)>,
}

impl SweepReport {
    /// RMS relative edge error as a multiple of that without a cage, against the cage's vertices in percent of the shape's, as SVG: Figure 3 of
    /// Hybrid Mesh Editing (Borosan et al. 2010) for one's own rows. A line per setting; with rows of the paper's scene also what
    /// its Table 1 says of its two models, the larger in black, the smaller in grey.
    ///
    /// A setting without a row without a cage of the same model, scene, method and schedule has no line.
    pub fn to_relative_svg(&self) -> String {
        let mut plots: Vec<Plot> = Vec::new();
        let ours = self.relative_errors();
        for (k, line) in ours.iter().enumerate() {
            let (colour, marker) = (pick(&COLOURS, k), pick(&MARKERS, k / COLOURS.len()).0);
            plots.extend(drawn(&line.points, colour, &LineStyle::Solid, marker, &line.label));
        }
        if self.rows.iter().any(|row| row.scene == PAPER_SCENE) {
            for (line, (_, colour)) in published().iter().zip(PUBLISHED) {
                let dashes = LineStyle::Custom("1 4".to_owned());
                plots.extend(drawn(&line.points, colour, &dashes, MarkerShape::Cross, &line.label));
            }
        }
        let layout = match plots.is_empty() {
            true => Layout::new((0.0, 100.0), (0.0, 1.0)),
            false => Layout::auto_from_plots(&plots),
        };
        let layout = layout
            .with_width(WIDTH)
            .with_height(HEIGHT)
            .with_title(plain(&self.subject()))
            .with_x_label("cage vertices (% of the shape's)")
            .with_y_label("RMS error over that without a cage")
            .with_x_axis_min(0.0)
            .with_legend_position(LegendPosition::OutsideRightTop);
        let ratios = || ours.iter().flat_map(|line| &line.points).map(|point| point.1);
        let (least, most) = (ratios().fold(f64::INFINITY, f64::min), ratios().fold(0.0, f64::max));
        // One way that is far worse would flatten all others.
        let far_apart = least > 0.0 && most > WIDE * least;
        let layout = if far_apart { layout.with_log_y() } else { layout.with_y_axis_min(0.0) };
        let mut scene = render_multiple(plots, layout);
        name_clips(&mut scene);
        SvgBackend::new().with_pretty(true).render_scene(&scene)
    }

    /// The lines of the rows with a cage, in the order of the rows.
    pub(super) fn relative_errors(&self) -> Vec<Relative> {
        let labels = Labels::of(self.rows.iter());
        let mut lines: Vec<(SeriesKey<'_>, Relative)> = Vec::new();
        for row in &self.rows {
            let key = SeriesKey::of(row);
            let direct = self.rows.iter().find(|other| key.is_without_cage(&SeriesKey::of(other)));
            let Some(point) = direct.and_then(|direct| point(row, direct)).filter(|_| key.way() == Way::Cage) else {
                continue;
            };
            match lines.iter_mut().find(|(other, _)| *other == key) {
                Some((_, line)) => line.points.push(point),
                None => lines.push((key, Relative { label: plain(&labels.label(row)), points: vec![point] })),
            }
        }
        let mut lines: Vec<Relative> = lines.into_iter().map(|(_, line)| line).collect();
        lines.iter_mut().for_each(|line| line.points.sort_by(|a, b| a.0.total_cmp(&b.0)));
        lines
    }
}

fn point(row: &SweepRow, direct: &SweepRow) -> Option<(f64, f64)> {
    let share = 100.0 * row.cage_vertices as f64 / row.vertices as f64;
    let ratio = row.rms_relative / direct.rms_relative;
    (share.is_finite() && ratio.is_finite()).then_some((share, ratio))
}

/// The lines of the paper's models, in the order of [`PUBLISHED`].
fn published() -> Vec<Relative> {
    let of = |(vertices, _): (usize, _)| {
        let rows = || TABLE_1.iter().filter(move |row| row.vertices == vertices);
        let direct = rows().find(|row| row.cage.is_none()).map_or(f64::NAN, |row| row.rms);
        let point = |cage: usize, rms: f64| (100.0 * cage as f64 / vertices as f64, rms / direct);
        Relative {
            label: format!("published, {vertices} vertices"),
            points: rows().filter_map(|row| Some(point(row.cage?, row.rms))).collect(),
        }
    };
    PUBLISHED.into_iter().map(of).collect()
}

/// A line and its markers.
fn drawn(points: &[(f64, f64)], colour: &str, style: &LineStyle, marker: MarkerShape, label: &str) -> [Plot; 2] {
    let line = LinePlot::new().with_data(points.to_vec()).with_color(colour).with_stroke_width(2.0);
    let marks = ScatterPlot::new().with_data(points.to_vec()).with_color(colour).with_marker(marker).with_size(4.5);
    [line.with_line_style(style.clone()).with_legend(label).into(), marks.into()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(cage: usize, rms: f64) -> SweepRow {
        let direct = cage == 0;
        SweepRow {
            cage_asked: if direct { "none".to_owned() } else { cage.to_string() },
            cage_vertices: if direct { 1000 } else { cage },
            vertices: 1000,
            rms_relative: rms,
            ..SweepRow::default()
        }
    }

    /// Ratios and shares are those of the rows, by size; a row without figures has no point.
    #[test]
    fn points_are_ratios_against_shares() {
        let mut report = SweepReport::new(Vec::new());
        report.rows = vec![row(200, 0.03), row(50, 0.05), row(100, f64::NAN), row(0, 0.02)];
        let [line] = &report.relative_errors()[..] else { panic!("one line") };
        assert_eq!(line.points, [(5.0, 0.05 / 0.02), (20.0, 0.03 / 0.02)]);
        // Nothing to compare with, nothing to draw.
        report.rows.pop();
        assert!(report.relative_errors().is_empty());
        assert!(roxmltree::Document::parse(&report.to_relative_svg()).is_ok());
    }

    #[test]
    fn the_papers_lines_stand_beside_rows_of_its_scene_alone() {
        let mut report = SweepReport::new(Vec::new());
        report.rows = vec![row(200, 0.03), row(0, 0.02)];
        assert!(!report.to_relative_svg().contains("published"));
        report.rows.iter_mut().for_each(|row| row.scene = PAPER_SCENE.to_owned());
        let svg = report.to_relative_svg();
        assert!(svg.contains("published, 43244 vertices") && svg.contains("published, 21622 vertices"));
        let [large, small] = &published()[..] else { panic!("two models") };
        assert_eq!((large.points.len(), small.points.len()), (3, 4));
        // 3.87 % over 1.72 % at 5000 of 43,244 vertices.
        assert!((large.points[2].0 - 11.562).abs() < 1e-3 && (large.points[2].1 - 2.25).abs() < 1e-12);
    }
}
