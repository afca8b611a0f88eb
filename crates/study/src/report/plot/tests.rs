use super::*;
use crate::report::tests::{hostile, sweep};
use crate::report::{Failure, FailureKind, ModelInfo, NO_CAGE, RowTimes, Spread, SweepRow};

/// All texts of an SVG, which must be well-formed and free of numbers that are none.
fn svg_texts(svg: &str) -> Vec<String> {
    assert!(!svg.contains("NaN") && !svg.contains("inf\""), "a coordinate is no number");
    let document = roxmltree::Document::parse(svg).expect("well-formed");
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    texts.map(|node| node.text().unwrap_or_default().to_owned()).collect()
}

/// The points of the lines in an SVG that have a colour and dashes, in order.
fn svg_lines(svg: &str, colour: &str, dash: Option<&str>) -> Vec<Vec<(f64, f64)>> {
    let document = roxmltree::Document::parse(svg).expect("well-formed");
    let paths = document.descendants().filter(|node| node.has_tag_name("path"));
    let ours = paths.filter(|n| n.attribute("stroke") == Some(colour) && n.attribute("stroke-dasharray") == dash);
    ours.filter(|node| node.attribute("fill") == Some("none"))
        .map(|node| {
            let numbers = node.attribute("d").unwrap_or_default().split([' ', 'M', 'L']);
            let numbers: Vec<f64> = numbers.filter_map(|word| word.parse().ok()).collect();
            numbers.chunks(2).map(|pair| (pair[0], pair[1])).collect()
        })
        .collect()
}

#[test]
fn the_legend_names_every_series_and_the_published_figures() {
    let texts = svg_texts(&sweep(43_243).to_svg());
    for propagation in ["positions", "frames"] {
        for prune in ["magnitude:0.03", "local:24"] {
            for schedule in ["20 steps of 2 iterations", "converged"] {
                assert!(texts.contains(&format!("{propagation}, {prune}, {schedule}")));
            }
        }
    }
    for label in ["no cage, 20 steps of 2 iterations", "no cage, converged", "published", "published, no cage"] {
        assert!(texts.iter().any(|text| text == label), "{label}");
    }
    assert!(texts.iter().any(|text| text == "shape.obj, 43,243 vertices"));
    assert!(!svg_texts(&sweep(100_000).to_svg()).iter().any(|text| text.contains("published")));
}

/// The line of one series runs through the points that its rows define: x is affine in the logarithm of the cage size, and
/// y is affine in the error with 0 on the lower axis.
#[test]
fn lines_are_drawn_to_scale() {
    let report = sweep(43_243);
    let svg = report.to_svg();
    let rows: Vec<&SweepRow> = report
        .rows
        .iter()
        .filter(|r| r.propagation == "positions" && r.prune == "magnitude:0.03" && r.iterations.is_some())
        .collect();
    let lines = svg_lines(&svg, "#0072b2", None);
    let [errors, times] = &lines[..] else { panic!("a line in each panel") };
    let slope = |points: &[(f64, f64)], x: &dyn Fn(usize) -> f64, y: &dyn Fn(&(f64, f64)) -> f64, k: usize| {
        (y(&points[k]) - y(&points[0])) / (x(k) - x(0))
    };
    let size = |k: usize| (rows[k].cage_vertices as f64).ln();
    let (error, time) = (|k: usize| rows[k].rms_relative, |k: usize| rows[k].edit_ms().ln());
    assert_eq!((rows.len(), errors.len(), times.len()), (3, 3, 3));
    // Coordinates have two decimals, over spans of at least 40 pixels.
    for (points, x, y) in [
        (errors, &size as &dyn Fn(usize) -> f64, (|p: &(f64, f64)| p.0) as fn(&(f64, f64)) -> f64),
        (errors, &error, |p| p.1),
        (times, &size, |p| p.0),
        (times, &time, |p| p.1),
    ] {
        let (near, far) = (slope(points, x, &y, 1), slope(points, x, &y, 2));
        assert!((near - far).abs() < 1e-3 * far.abs(), "{near} {far}");
    }
    // The lower axis is the end of the upright one, at error 0.
    let zero = errors[0].1 - slope(errors, &error, &|p: &(f64, f64)| p.1, 2) * rows[0].rms_relative;
    assert!(svg.contains(&format!("y2=\"{:.0}\" stroke=\"#000000\"", zero)), "{zero}");
}

#[test]
fn rows_without_a_cage_are_level_lines_at_their_error() {
    let svg = sweep(43_243).to_svg();
    for dash in ["6 4", "2 3"] {
        let lines = svg_lines(&svg, "#333333", Some(dash));
        assert_eq!(lines.len(), 2, "one in each panel");
        assert!(lines.iter().all(|line| line.len() == 2 && line[0].1 == line[1].1 && line[0].0 < line[1].0));
    }
}

#[test]
fn an_svg_is_well_formed_whatever_it_is_given() {
    let texts = svg_texts(&hostile().to_svg());
    assert!(texts.iter().any(|text| text == "a,\"b\"  c|d <&> $x^2$ é  , 43,243 vertices"), "{texts:?}");
    // Nothing at all, a single row, nothing but zeros, nothing that can be drawn.
    svg_texts(&SweepReport::default().to_svg());
    for figure in [0.0, 0.05, f64::NAN, f64::INFINITY, 1e300, -1.0] {
        let times = RowTimes { drag_ms: Spread::of(&[figure]), ..RowTimes::default() };
        let row = SweepRow { rms_relative: figure, times, ..SweepRow::default() };
        let direct = SweepRow { cage_asked: NO_CAGE.to_owned(), ..row.clone() };
        let report = SweepReport { rows: vec![row, direct], ..SweepReport::default() };
        let texts = svg_texts(&report.to_svg());
        let says = texts.iter().any(|text| text.ends_with("4 figures cannot be drawn"));
        assert_eq!(says, !(0.0..1.0).contains(&figure), "{figure}: {texts:?}");
    }
}

#[test]
fn a_blow_up_does_not_flatten_the_rest() {
    let mut report = sweep(43_243);
    report.rows.iter_mut().filter(|row| row.propagation == "positions").for_each(|row| row.rms_relative *= 40.0);
    let svg = report.to_svg();
    // On a logarithmic axis equal ratios are equal lengths: the series above keeps the height it has when plotted alone.
    let height = |colour: &str| {
        let line = &svg_lines(&svg, colour, None)[0];
        line[2].1 - line[0].1
    };
    assert!((height("#0072b2") - height("#009e73")).abs() < 0.05);
    assert!(height("#009e73") > 20.0);
}

#[test]
fn the_same_report_gives_the_same_picture() {
    let (one, other) = (sweep(43_243), sweep(43_243));
    let svg = one.to_svg();
    assert!(svg == other.to_svg());
    // Whatever is clipped is clipped by something that is defined.
    assert_eq!(svg.matches("<clipPath id=\"panel-").count(), svg.matches("clip-path=\"url(#panel-").count());
}

/// The decimated meshes of a sweep, by what was asked and how many vertices they got.
fn decimated(report: &SweepReport, sizes: &[(&str, usize)]) -> Vec<SweepRow> {
    let none = || NO_CAGE.to_owned();
    let row = |&(asked, cage_vertices): &(&str, usize)| SweepRow {
        cage_asked: asked.to_owned(),
        cage_vertices,
        propagation: none(),
        prune: none(),
        start: none(),
        rms_relative: 0.4,
        published: None,
        published_ms: None,
        ..report.rows[0].clone()
    };
    sizes.iter().map(row).collect()
}

#[test]
fn decimated_meshes_are_lines_of_their_own() {
    let mut report = sweep(100_000);
    let before = svg_texts(&report.to_svg());
    assert!(before.iter().any(|text| text == "cage vertices") && !before.iter().any(|text| text.contains("decimated")));
    report
        .rows
        .extend(decimated(&report, &[("decimated:3000", 3000), ("equal-time:1%", 4000), ("decimated:9000", 9000)]));
    let svg = report.to_svg();
    let texts = svg_texts(&svg);
    for label in ["decimated, 20 steps of 2 iterations", "decimated, equal time, 20 steps of 2 iterations"] {
        assert_eq!(texts.iter().filter(|text| *text == label).count(), 1, "{label}");
    }
    assert_eq!(texts.iter().filter(|text| *text == "vertices of the cage or decimated mesh").count(), 2);
    // The fifth colour is that of the fifth rule: two sizes make a line in each panel, which is level only for equal errors.
    let lines = svg_lines(&svg, COLOURS[4], None);
    assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [2, 2]);
    assert!(lines.iter().all(|line| line[0].0 < line[1].0));
    // No more level lines than without them.
    assert_eq!(svg_lines(&svg, DIRECT, Some("6 4")).len(), 2);
}

#[test]
fn rows_without_figures_are_counted_and_not_drawn() {
    let mut report = sweep(100_000);
    let legend = svg_texts(&report.to_svg());
    for (k, said) in [(0, "1 row has no figures"), (1, "2 rows have no figures")] {
        let failure = Failure { kind: FailureKind::Numeric, reason: "because".to_owned() };
        report
            .rows
            .push(SweepRow { method: "other".to_owned(), cage_vertices: 0, ..report.rows[k].clone() }.failed(failure));
        let texts = svg_texts(&report.to_svg());
        assert!(texts.iter().any(|text| text.ends_with(said)), "{texts:?}");
        assert!(!texts.iter().any(|text| text.contains("cannot be drawn")));
        // No line, no axis for it: a size of 0 would have changed the ticks.
        assert_eq!(texts.len(), legend.len());
    }
}

/// With several models the colour is the model's, of lines with a cage and of those without.
#[test]
fn models_and_scenes_are_told_apart_by_colour() {
    let mut report = sweep(100_000);
    report.rows.retain(|row| row.iterations.is_some() && row.prune != "magnitude:0.03");
    let rows = report.rows.clone();
    for name in ["second.obj", "third.obj"] {
        report.models.push(ModelInfo { name: name.to_owned(), ..report.models[0].clone() });
        report.rows.extend(rows.iter().map(|row| SweepRow { model: name.to_owned(), ..row.clone() }));
    }
    let svg = report.to_svg();
    let texts = svg_texts(&svg);
    for label in ["second.obj, positions, local:24", "third.obj, no cage"] {
        assert_eq!(texts.iter().filter(|text| *text == label).count(), 1, "{label}: {texts:?}");
    }
    assert!(texts.iter().any(|text| text == "3 models"));
    for colour in &COLOURS[..3] {
        // Two propagations and a line without a cage, in each panel.
        assert_eq!(svg_lines(&svg, colour, None).len(), 4);
        assert_eq!(svg_lines(&svg, colour, Some("6 4")).len(), 2);
    }
    assert!(svg_lines(&svg, DIRECT, Some("6 4")).is_empty() && svg_lines(&svg, COLOURS[3], None).is_empty());
}
