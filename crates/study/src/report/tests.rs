use std::collections::HashSet;

use pliant_mesh::metrics::EdgeErrors;

use super::columns::COLUMNS;
use super::*;
use crate::paper::paper_sizes;

/// A sweep as the paper preset makes it: every cage size with both propagations, both prunes and both schedules.
///
/// Figures follow simple laws of the cage size: tests ask how they are written, not what they are.
pub(super) fn sweep(vertices: usize) -> SweepReport {
    let model = ModelInfo {
        name: "shape.obj".to_owned(),
        vertices,
        faces: 2 * vertices,
        diagonal: 1.7,
        closed: true,
        notes: Vec::new(),
    };
    let mut report = SweepReport::new(vec![model]);
    for (cage, published) in paper_sizes(vertices).sizes {
        for (steps, iterations) in [(20, Some(2)), (1, None)] {
            for (propagation, worse) in [("positions", 2.5), ("frames", 1.0)] {
                for (prune, factor) in [("magnitude:0.03", 1.1), ("local:24", 0.9)] {
                    if cage.is_none() && (propagation, prune) != ("positions", "local:24") {
                        continue;
                    }
                    let size = cage.unwrap_or(vertices) as f64;
                    let slack = if iterations.is_some() { 1.3 } else { 1.0 };
                    let rms = if cage.is_none() { 0.019 * slack } else { 1.1 * worse * factor * slack / size.sqrt() };
                    let errors = EdgeErrors {
                        rms_relative: rms,
                        relative_rms: 0.83 * rms,
                        median: 0.4 * rms,
                        p95: 2.0 * rms,
                        p99: 3.0 * rms,
                        max: 21.0 * rms,
                        degenerate: 0,
                    };
                    let row = SweepRow {
                        model: "shape.obj".to_owned(),
                        vertices,
                        scene: "armadillo-2".to_owned(),
                        cage_asked: cage.map_or_else(|| NO_CAGE.to_owned(), |size| size.to_string()),
                        cage_vertices: cage.unwrap_or(vertices),
                        method: "arap:cotangent".to_owned(),
                        propagation: if cage.is_none() { NO_CAGE } else { propagation }.to_owned(),
                        prune: if cage.is_none() { NO_CAGE } else { prune }.to_owned(),
                        steps,
                        iterations,
                        rest_error_max: 1e-15 * size,
                        kept_mean: 1.0 / 3.0,
                        kept_max: 260,
                        times: RowTimes {
                            drag_ms: Spread::of(&[size * if iterations.is_some() { 1e-3 } else { 1e-2 }]),
                            propagate_ms: Spread::of(&[0.7 * worse]),
                            ..RowTimes::default()
                        },
                        published: published.map(|row| row.rms),
                        published_ms: published.map(|row| row.ms),
                        ..SweepRow::default()
                    };
                    report.rows.push(row.with_edge_errors(&errors));
                }
            }
        }
    }
    report
}

/// A name that means something to every format it is written in.
pub(super) const HOSTILE: &str = "a,\"b\"\r\nc|d <&> $x^2$ é \u{1}";

pub(super) fn hostile() -> SweepReport {
    let mut report = sweep(43_243);
    report.models[0].name = HOSTILE.to_owned();
    report.notes.push(HOSTILE.to_owned());
    report.rows[0].model = HOSTILE.to_owned();
    report.rows[1].warnings = vec![HOSTILE.to_owned(), "second".to_owned()];
    report
}

/// Cells of each line of the first table in a Markdown text.
fn markdown_table(text: &str) -> Vec<Vec<String>> {
    let cells = |line: &str| {
        let mut cells = vec![String::new()];
        let mut letters = line.chars();
        while let Some(letter) = letters.next() {
            match letter {
                '\\' => cells.last_mut().expect("never empty").extend(letters.next()),
                '|' => cells.push(String::new()),
                _ => cells.last_mut().expect("never empty").push(letter),
            }
        }
        // What stands before the first bar and after the last.
        assert!(cells.len() > 2 && cells[0].is_empty() && cells[cells.len() - 1].is_empty(), "{line}");
        cells[1..cells.len() - 1].iter().map(|cell| cell.trim().to_owned()).collect()
    };
    text.lines().skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|')).map(cells).collect()
}

#[test]
fn json_gives_back_the_same_report_to_the_last_bit() {
    for report in [sweep(43_243), sweep(100_000), hostile(), SweepReport::new(Vec::new())] {
        assert_eq!(SweepReport::read_json(&report.to_json(), "report.json").expect("own JSON"), report);
    }
    // Neighbouring numbers stay apart.
    let mut report = sweep(43_243);
    let mut x = 0.1_f64;
    for row in &mut report.rows {
        (x, row.rms_relative, row.times.bind_ms) = (x.next_up(), x, Spread::of(&[1e5 * x.sqrt()]));
    }
    let again = SweepReport::read_json(&report.to_json(), "report.json").expect("own JSON");
    for (a, b) in report.rows.iter().zip(&again.rows) {
        assert_eq!(a.rms_relative.to_bits(), b.rms_relative.to_bits());
        let bind = |row: &SweepRow| row.times.bind_ms.map(|time| time.median.to_bits());
        assert_eq!(bind(a), bind(b));
    }
}

#[test]
fn json_has_the_fields_that_scripts_rely_on() {
    let value: serde_json::Value = serde_json::from_str(&sweep(43_243).to_json()).expect("JSON");
    let rows = value["rows"].as_array().expect("a list of rows");
    for field in [
        "model",
        "vertices",
        "cage_vertices",
        "method",
        "propagation",
        "prune",
        "steps",
        "iterations",
        "rms_relative",
        "relative_rms",
        "rest_rms_relative",
        "rest_error_max",
        "kept_mean",
        "kept_max",
        "times",
        "failure",
    ] {
        assert!(rows.iter().all(|row| row.get(field).is_some()), "{field}");
    }
    assert_eq!(rows[0]["iterations"], 2);
    assert!(rows[4]["iterations"].is_null(), "converged");
    assert_eq!(value["version"], env!("CARGO_PKG_VERSION"));
}

#[test]
fn figures_that_are_not_finite_are_null_and_come_back_as_nan() {
    let mut report = sweep(43_243);
    report.rows[2].rms_relative = f64::INFINITY;
    report.rows[2].edge_max = f64::NAN;
    let again = SweepReport::read_json(&report.to_json(), "report.json").expect("own JSON");
    assert!(again.rows[2].rms_relative.is_nan() && again.rows[2].edge_max.is_nan());
    assert_eq!(again.rows[1], report.rows[1]);
}

#[test]
fn what_is_no_report_is_refused_with_its_place() {
    for (text, says) in [
        ("{\n}", "r.json:2:1: missing field `schema`"),
        ("[", "r.json:1:1: EOF while parsing a list"),
        (&sweep(43_243).to_json().replacen("\"steps\": 20", "\"steps\": -1", 1), "invalid value: integer `-1`"),
    ] {
        let error = SweepReport::read_json(text, "r.json").expect_err("no report").to_string();
        assert!(error.contains(says) && error.starts_with("r.json:"), "{error}");
    }
    for (schema, says) in [
        (
            "pliant-sweep/3",
            "r.json:2:28: the schema is `pliant-sweep/3`, not `pliant-sweep/2`: a later version of Pliant made it",
        ),
        ("pliant-sweep/1", "an earlier version of Pliant made it"),
        ("", "it is no report of a sweep"),
        ("pliant-sweep/x\\n", "it is no report of a sweep"),
    ] {
        // What else has changed does not matter.
        let other = sweep(43_243).to_json().replacen(SCHEMA, schema, 1).replacen("\"steps\": 20", "\"steps\": {}", 1);
        let error = SweepReport::read_json(&other, "r.json").expect_err("another schema").to_string();
        assert!(error.contains(says), "{error}");
    }
    // A later version's extra fields are skipped.
    let later = sweep(43_243).to_json().replacen("\"steps\"", "\"colour\": \"red\", \"steps\"", 1);
    assert_eq!(SweepReport::read_json(&later, "r.json").expect("more fields"), sweep(43_243));
}

#[test]
fn csv_is_what_another_reader_reads() {
    let report = hostile();
    let csv = report.to_csv();
    let mut reader = csv::ReaderBuilder::new().from_reader(csv.as_bytes());
    let header: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    let records: Vec<csv::StringRecord> = reader.records().map(|record| record.expect("a record")).collect();
    assert_eq!(records.len(), report.rows.len());
    let at = |row: usize, key: &str| &records[row][header.iter().position(|name| name == key).expect("a column")];
    assert_eq!(at(0, "model"), HOSTILE);
    assert_eq!(at(1, "warnings"), format!("{HOSTILE}; second"));
    for (k, row) in report.rows.iter().enumerate() {
        assert_eq!(at(k, "rms_relative").parse::<f64>().expect("a number").to_bits(), row.rms_relative.to_bits());
        assert_eq!(at(k, "published"), row.published.map_or_else(String::new, |x| format!("{x:?}")));
        assert_eq!(at(k, "iterations"), if row.iterations.is_some() { "2" } else { "converged" });
    }
    // Quoted where RFC 4180 asks for it and nowhere else.
    assert!(csv.contains("\r\n,\"a,\"\"b\"\"\r\nc|d <&> $x^2$ é \u{1}\",43243,armadillo-2,"));
    assert_eq!(csv.matches('"').count(), 12);
    assert!(sweep(43_243).to_csv().split("\r\n").skip(1).all(|line| !line.contains(['"', '\n'])));
}

#[test]
fn csv_and_json_name_the_same_fields() {
    let value: serde_json::Value = serde_json::from_str(&sweep(43_243).to_json()).expect("JSON");
    let row = value["rows"][0].as_object().expect("a row");
    let mut json: HashSet<String> = row.keys().filter(|key| *key != "times").cloned().collect();
    // A repeated time is three columns, the median under its own name.
    for key in row["times"].as_object().expect("times").keys() {
        json.insert(key.clone());
        if key.ends_with("_ms") && key != "drag_p95_ms" {
            json.extend(["min", "max"].map(|end| format!("{key}_{end}")));
        }
    }
    // A failure is a kind and a reason.
    json.insert("failure_kind".to_owned());
    let csv: HashSet<String> = COLUMNS.iter().map(|column| column.key.to_owned()).collect();
    assert_eq!(json, csv);
    assert_eq!(csv.len(), COLUMNS.len(), "no name twice");
}

#[test]
fn every_line_of_a_markdown_table_has_the_same_cells_and_width() {
    for report in [sweep(43_243), sweep(100_000), hostile()] {
        for detail in [Detail::Main, Detail::Full] {
            let text = report.to_markdown(detail);
            let table = markdown_table(&text);
            assert_eq!(table.len(), 2 + report.rows.len());
            assert!(table.iter().all(|line| line.len() == table[0].len()));
            let mut lines = text.lines().filter(|line| line.starts_with('|')).map(|line| line.chars().count());
            let first = lines.next().expect("a table");
            assert!(lines.all(|width| width == first), "aligned");
        }
    }
}

#[test]
fn markdown_says_constant_columns_once_and_shows_percent() {
    let report = sweep(43_243);
    let text = report.to_markdown(Detail::Main);
    let above = text.lines().next().expect("a line");
    for said in ["model: shape.obj", "vertices: 43243", "scene: armadillo-2", "method: arap:cotangent", "kept max: 260"]
    {
        assert!(above.split("; ").any(|part| part == said), "{said} in {above}");
    }
    let table = markdown_table(&text);
    let column = |heading: &str| table[0].iter().position(|cell| cell == heading);
    for (heading, shown) in [("model", false), ("kept mean", false), ("steps", true), ("published (%)", true)] {
        assert_eq!(column(heading).is_some(), shown, "{heading}");
    }
    for (line, row) in table[2..].iter().zip(&report.rows) {
        let percent: f64 = line[column("RMS relative (%)").expect("shown")].parse().expect("a number");
        assert!((percent - 100.0 * row.rms_relative).abs() <= 0.005 + 1e-12);
    }
    // Scaled sizes have no published figures, so no column for them.
    assert!(!sweep(100_000).to_markdown(Detail::Full).contains("published"));
}

#[test]
fn a_single_row_keeps_its_figures_in_the_table() {
    let mut report = sweep(43_243);
    report.rows.truncate(1);
    let table = markdown_table(&report.to_markdown(Detail::Main));
    assert!(table[0].iter().any(|heading| heading == "drag (ms)") && table[0].iter().all(|heading| heading != "prune"));
    report.rows.clear();
    assert_eq!(report.to_markdown(Detail::Main), "No rows.\n");
    assert_eq!(report.to_csv().lines().count(), 1);
}

#[test]
fn warnings_and_notes_stand_below_the_table() {
    let text = hostile().to_markdown(Detail::Main);
    let below: Vec<&str> = text.lines().filter(|line| line.starts_with("- ")).collect();
    assert_eq!(below.len(), 3);
    assert!(
        below[0].starts_with("- Row 2: a,\"b\"  c\\|d")
            && below[1] == "- Row 2: second"
            && below[2].starts_with("- a,")
    );
}

#[test]
fn numbers_are_rounded_for_people_without_turning_into_zero() {
    use super::columns::Cell;
    for (cell, shown) in [
        (Cell::Share(0.0741), "7.41"),
        (Cell::Share(1.72), "172.00"),
        (Cell::Share(0.0), "0"),
        (Cell::Share(4.9e-5), "5e-3"),
        (Cell::Share(5.1e-5), "0.01"),
        (Cell::Share(2.3e-14), "2e-12"),
        (Cell::Share(f64::NAN), "-"),
        (Cell::Share(1e12), "1e14"),
        (Cell::Time(1669.4), "1669"),
        (Cell::Time(99.96), "100"),
        (Cell::Time(12.34), "12.3"),
        (Cell::Time(9.996), "10.0"),
        (Cell::Time(0.5), "0.50"),
        (Cell::Missing, ""),
    ] {
        assert_eq!(cell.rounded(), shown);
    }
}

#[test]
fn schedules_read_as_sentences() {
    let schedule = |steps, iterations| SweepRow { steps, iterations, ..SweepRow::default() }.schedule();
    assert_eq!(schedule(20, Some(2)), "20 steps of 2 iterations");
    assert_eq!(schedule(1, Some(1)), "1 iteration");
    assert_eq!(schedule(1, None), "converged");
    assert_eq!(schedule(4, None), "4 steps, converged");
    let linear = |steps| SweepRow { steps, linear: true, ..SweepRow::default() }.schedule();
    assert_eq!((linear(1), linear(4)), ("linear".to_owned(), "4 steps, linear".to_owned()));
}

/// A method without iterations shows a dash where one that converged says so; a refusal shows dashes for all that came out, and why.
#[test]
fn what_a_row_has_not_is_a_dash() {
    let row = |method: &str, linear| SweepRow { method: method.to_owned(), linear, ..SweepRow::default() };
    let mut report = SweepReport::new(vec![ModelInfo::default()]);
    let failure = Failure { kind: FailureKind::Input, reason: "no, because".to_owned() };
    report.rows = vec![row("arap", false), row("implicit", true), row("dual", false).failed(failure)];
    let table = markdown_table(&report.to_markdown(Detail::Full));
    let column = |name: &str| {
        let at = table[0].iter().position(|heading| heading == name).unwrap_or_else(|| panic!("{name}"));
        table[2..].iter().map(|line| line[at].clone()).collect::<Vec<_>>()
    };
    assert_eq!(column("iterations"), ["converged", "-", "converged"]);
    assert_eq!(column("RMS relative (%)"), ["0", "0", "-"]);
    assert!(report.to_markdown(Detail::Main).contains("Row 3: no figures: no, because"));
    let read = SweepReport::read_json(&report.to_json(), "r.json").expect("JSON");
    assert!(read.rows[2].rms_relative.is_nan() && read.rows[1].linear && read.rows[1].iterations.is_none());
}

#[test]
fn edges_without_length_are_warned_of() {
    let errors = EdgeErrors { max: 0.5, degenerate: 3, ..EdgeErrors::default() };
    let row = SweepRow::default().with_edge_errors(&errors);
    assert_eq!(row.edge_max, 0.5);
    assert_eq!(row.warnings, ["3 edges have length 0 at rest, so no relative error, and are left out"]);
}

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
fn the_same_report_gives_the_same_text() {
    let (one, other) = (sweep(43_243), sweep(43_243));
    let svg = one.to_svg();
    assert!(svg == other.to_svg());
    // Whatever is clipped is clipped by something that is defined.
    assert_eq!(svg.matches("<clipPath id=\"panel-").count(), svg.matches("clip-path=\"url(#panel-").count());
    assert_eq!(one.to_markdown(Detail::Full), other.to_markdown(Detail::Full));
}
