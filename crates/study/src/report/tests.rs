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

/// A dozen columns, those that name a row first, then size, error and times of a drag; more only where the settings alone need them.
#[test]
fn a_table_of_main_columns_is_narrow() {
    let headings = |report: &SweepReport| markdown_table(&report.to_markdown(Detail::Main)).remove(0);
    let mut report = sweep(43_243);
    for (k, row) in report.rows.iter_mut().enumerate() {
        // Every figure there, and different in every row.
        let x = 0.01 * (k + 1) as f64;
        let time = Spread::of(&[100.0 * x]);
        (row.handle_error_max, row.rest_rms_relative, row.kept_mean, row.kept_max) = (x, x, x, k);
        (row.volume_change, row.distance_to_converged, row.flipped_faces) = (Some(x), Some(x), Some(k));
        (row.times.simplify_ms, row.times.bind_ms, row.times.prepare_ms) = (time, time, time);
    }
    let narrow = headings(&report);
    assert_eq!(
        narrow,
        [
            "steps",
            "iterations",
            "propagation",
            "prune",
            "cage asked",
            "cage vertices",
            "RMS relative (%)",
            "drag (ms)",
            "propagate (ms)",
            "published (%)",
            "published (ms)",
            "p95 (%)"
        ]
    );
    let wide = markdown_table(&report.to_markdown(Detail::Full)).remove(0);
    assert!(narrow.iter().all(|heading| wide.contains(heading)) && wide.len() > 25);
    // Several models and scenes, decimated meshes and failures beside them.
    let failure = Failure { kind: FailureKind::Numeric, reason: "because".to_owned() };
    let row = report.rows[0].clone();
    report.rows.push(SweepRow { model: "other.obj".to_owned(), vertices: 7, ..row.clone() });
    report.rows.push(SweepRow { scene: "other".to_owned(), method: "dual".to_owned(), linear: true, ..row.clone() });
    report.rows.push(SweepRow { start: "levels".to_owned(), cage_vertices: 0, ..row.clone() }.failed(failure));
    report.rows.push(SweepRow { cage_asked: "decimated:3000".to_owned(), refine_steps: Some(3), ..row });
    let all = headings(&report);
    assert_eq!(all[..5], ["model", "vertices", "scene", "method", "steps"]);
    assert_eq!(all[all.len() - 4..], ["cage vertices", "RMS relative (%)", "drag (ms)", "propagate (ms)"]);
    assert!(report.to_markdown(Detail::Main).contains("no figures: because"));
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

#[test]
fn a_key_names_what_was_asked() {
    let row = sweep(43_243).rows[0].clone();
    let setting = |row: &SweepRow| row.key().setting();
    assert_eq!(setting(&row), "cage 1500, arap:cotangent, positions, magnitude:0.03, 20 x 2");
    assert_eq!(row.key().to_string(), format!("shape.obj, scene armadillo-2, {}", setting(&row)));
    let none = || NO_CAGE.to_owned();
    let direct = |cage_asked: &str, iterations| {
        let cage_asked = cage_asked.to_owned();
        SweepRow { cage_asked, iterations, propagation: none(), prune: none(), start: none(), ..row.clone() }
    };
    assert_eq!(setting(&direct(NO_CAGE, None)), "no cage, arap:cotangent, 20 x all");
    assert_eq!(setting(&direct("decimated:2%", Some(2))), "decimated:2%, arap:cotangent, 20 x 2");
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

#[test]
fn the_same_report_gives_the_same_text() {
    let (one, other) = (sweep(43_243), sweep(43_243));
    assert_eq!(one.to_markdown(Detail::Full), other.to_markdown(Detail::Full));
}
