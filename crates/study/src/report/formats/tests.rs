use std::collections::HashSet;

use serde_json::Value;

use super::*;
use crate::report::columns::{COLUMNS, Cell};
use crate::report::tests::{HOSTILE, hostile, sweep};
use crate::report::{Failure, FailureKind, Machine, ModelInfo, Refusal, RowTimes, SCHEMA, Spread};

/// A report that has all that is hard to write: hostile names, figures that are missing or not finite, failures of both kinds, two rows
/// of one name, a model without rows.
fn hard() -> SweepReport {
    let mut report = hostile();
    report.version = HOSTILE.to_owned();
    report.machine = Some(Machine { cpu: Some(HOSTILE.to_owned()), threads: 2, calibration: None });
    report.refused.push(Refusal { model: "]]></testsuite>".to_owned(), reason: HOSTILE.to_owned() });
    report.rows[2].rms_relative = f64::INFINITY;
    report.rows[3].edge_max = f64::NAN;
    report.rows[4].times = RowTimes::default();
    report.rows[5].times.drag_ms = Spread::of(&[f64::NAN]);
    report.rows[6].times.peak_memory_bytes = Some(u64::MAX);
    report.rows[7].times.bind_ms = Spread::of(&[1.0, 2.0, 4.0]);
    report.rows[8] = report.rows[7].clone();
    for (k, kind) in [(9, FailureKind::Numeric), (10, FailureKind::Input)] {
        (report.rows[k].cage_vertices, report.rows[k].kept_max) = (0, 0);
        let failure = Failure { kind, reason: HOSTILE.to_owned() };
        report.rows[k] = report.rows[k].clone().failed(failure);
    }
    report
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("JSON")
}

#[test]
fn forms_are_known_by_name_and_never_write_to_the_same_file() {
    let mut ends = HashSet::new();
    for format in ReportFormat::ALL {
        assert_eq!(format.to_string().parse::<ReportFormat>().expect("its own name"), format);
        assert!(ends.insert(format.extension()), "{format}");
        let written = hard().to_bytes(format);
        if format.is_built() {
            assert!(!written.expect("written").is_empty());
        } else {
            let error = written.expect_err("not built").to_string();
            assert_eq!(error, "this build of Pliant does not write parquet: build it with `--features parquet`");
        }
    }
    let error = "xlsx".parse::<ReportFormat>().expect_err("no form").to_string();
    assert!(error.starts_with("`xlsx` is no form of a report: use json, csv, jsonl, md, summary, svg,"), "{error}");
    for text in ["", "JSON", "json "] {
        assert!(text.parse::<ReportFormat>().is_err());
    }
}

#[test]
fn the_same_report_gives_the_same_bytes() {
    for format in ReportFormat::ALL.into_iter().filter(|format| format.is_built()) {
        assert!(hard().to_bytes(format).expect("written") == hard().to_bytes(format).expect("written"), "{format}");
    }
}

#[test]
fn names_are_unique_short_and_on_one_line() {
    let named = |name: &str| SweepRow { model: name.to_owned(), ..SweepRow::default() };
    let long = "\u{e9}".repeat(40);
    let rows = ["a\nb", "a\tb", " a b ", "a b (2)", "", "", &long, &long, &format!("{long}x")].map(named);
    for longest in [12, 13, 60, usize::MAX] {
        let names = row_names(rows.iter(), longest, |row| row.model.clone());
        assert_eq!(names.iter().collect::<HashSet<_>>().len(), rows.len(), "{names:?}");
        assert!(names.iter().all(|name| name.len() <= longest && !name.contains(char::is_control)), "{names:?}");
        assert_eq!(names[..2], ["a b", "a b (2)"]);
    }
    // Thousands of one name take no time that grows with their square.
    let same = vec![named("same"); 20_000];
    assert_eq!(row_names(same.iter(), 64, |row| row.model.clone())[19_999], "same (20000)");
}

/// Each line is an object of its own, with what the report says of itself and the same row that the report has.
#[test]
fn a_json_line_is_a_row_that_stands_alone() {
    let report = hard();
    let text = report.to_jsonl();
    let whole = json(&report.to_json());
    let lines: Vec<Value> = text.lines().map(json).collect();
    assert_eq!(lines.len(), report.rows.len());
    assert!(text.ends_with('\n') && !text.contains('\r'));
    for (line, row) in lines.iter().zip(whole["rows"].as_array().expect("rows")) {
        let mut line = line.as_object().expect("an object").clone();
        assert_eq!(line.remove("schema"), Some(SCHEMA.into()));
        assert_eq!(line.remove("version"), Some(HOSTILE.into()));
        assert_eq!(line.remove("machine"), Some(whole["machine"].clone()));
        assert_eq!(&Value::Object(line.clone()), row);
        serde_json::from_value::<SweepRow>(Value::Object(line)).expect("a row");
    }
    assert_eq!(SweepReport::new(Vec::new()).to_jsonl(), "");
}

#[test]
fn csv_leaves_out_what_is_no_figure() {
    let csv = hard().to_csv();
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let header = reader.headers().expect("a header").clone();
    let records: Vec<csv::StringRecord> =
        reader.records().map(|record| record.expect("as long as the header")).collect();
    let at = |row: usize, key: &str| &records[row][header.iter().position(|name| name == key).expect("a column")];
    for (row, key) in [(2, "rms_relative"), (3, "edge_max"), (4, "drag_ms"), (5, "drag_ms"), (9, "rms_relative")] {
        assert_eq!(at(row, key), "", "{row} {key}");
    }
    for key in ["cage_vertices", "kept_mean", "kept_max", "negative_share", "unsafe_rows"] {
        assert_eq!(at(9, key), "", "{key}");
    }
    assert_eq!((at(9, "failure_kind"), at(10, "failure_kind"), at(9, "failure")), ("numeric", "input", HOSTILE));
    assert_eq!(at(6, "peak_memory_bytes"), u64::MAX.to_string());
}

/// The rules of the action's documentation: an array of objects with `name`, `unit` and `value`, and texts as `range` and `extra`. Its
/// own reader takes the number of a range from behind a plus-minus sign.
#[test]
fn github_benchmark_has_an_entry_for_each_figure_that_is_there() {
    let report = hard();
    let entries = json(&report.to_github_benchmark());
    let entries = entries.as_array().expect("an array");
    let mut names = HashSet::new();
    for entry in entries {
        let fields: Vec<&str> = entry.as_object().expect("an object").keys().map(String::as_str).collect();
        assert!(fields.iter().all(|field| ["name", "unit", "value", "range", "extra"].contains(field)), "{fields:?}");
        assert!(entry["value"].is_f64() && entry["unit"].is_string() && entry["extra"].is_string());
        let name = entry["name"].as_str().expect("a text");
        assert!(names.insert(name) && !name.contains(char::is_control), "{name}");
    }
    // 26 rows, of which two failed; two of the others lack an error each, one both times, one that of the drag.
    let rows = report.rows.len() - 2;
    let count = |end: &str| names.iter().filter(|name| name.ends_with(end)).count();
    assert_eq!(count(": RMS relative edge error"), rows - 1);
    assert_eq!(count(": largest edge error"), rows - 1);
    assert_eq!(count(": drag"), rows - 2);
    assert_eq!(count(": bind"), 2);
    let find = |end: &str| entries.iter().find(|entry| entry["name"].as_str().is_some_and(|name| name.ends_with(end)));
    let bind = find(": bind").expect("an entry");
    assert_eq!((&bind["unit"], &bind["value"], &bind["range"]), (&"ms".into(), &2.0.into(), &"± 1.5".into()));
    let error = find(": RMS relative edge error").expect("an entry");
    assert_eq!(
        (error["unit"].as_str(), error["value"].as_f64()),
        (Some("%"), Some(100.0 * report.rows[0].rms_relative))
    );
    assert_eq!(json(&SweepReport::default().to_github_benchmark()), Value::Array(Vec::new()));
}

/// The rules of Bencher Metric Format: numbers under the names of measures under those of benchmarks, and what its validation allows in
/// either name.
#[test]
fn bencher_has_a_metric_for_each_figure_that_is_there() {
    let mut report = hard();
    report.rows[11].model = "\u{e9}".repeat(600);
    let benchmarks = json(&report.to_bencher());
    let benchmarks = benchmarks.as_object().expect("an object");
    assert_eq!(benchmarks.len(), report.rows.len() - 2);
    let slug = |text: &str| {
        text.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-') && text.len() <= 64
    };
    for (name, measures) in benchmarks {
        assert!(!name.is_empty() && name.len() <= 1024 && name.trim() == name, "{name}");
        for (measure, metric) in measures.as_object().expect("an object") {
            let metric = metric.as_object().expect("an object");
            assert!(slug(measure) && metric.values().all(Value::is_f64) && metric.contains_key("value"));
            assert!(metric.keys().all(|key| ["value", "lower_value", "upper_value"].contains(&key.as_str())));
        }
    }
    let first = &benchmarks["a,\"b\"  c|d <&> $x^2$ é  , scene armadillo-2, cage 1500, arap:cotangent, positions, magnitude:0.03, 20 x 2"];
    assert_eq!(first["rms-relative-percent"]["value"], 100.0 * report.rows[0].rms_relative);
    assert!(first.get("bind-ms").is_none() && first.get("distance-to-converged-percent").is_none());
    let bound = benchmarks.values().find(|measures| measures.get("bind-ms").is_some()).expect("a binding");
    assert_eq!(bound["bind-ms"], serde_json::json!({ "value": 2.0, "lower_value": 1.0, "upper_value": 4.0 }));
}

/// What both schemas allow in an element.
struct Rule {
    element: &'static str,
    /// In the order that Surefire's demands.
    children: &'static [&'static str],
    attributes: &'static [&'static str],
    /// Of these.
    required: &'static [&'static str],
}

const fn rule(
    element: &'static str,
    children: &'static [&'static str],
    attributes: &'static [&'static str],
    required: &'static [&'static str],
) -> Rule {
    Rule { element, children, attributes, required }
}

const COUNTS: &[&str] = &["name", "tests", "errors", "skipped", "failures"];

const RULES: [Rule; 9] = [
    rule("testsuites", &["testsuite"], &["name", "time", "tests", "failures", "errors"], &[]),
    rule("testsuite", &["properties", "testcase"], &["name", "time", "tests", "errors", "skipped", "failures"], COUNTS),
    rule("properties", &["property"], &[], &[]),
    rule("property", &[], &["name", "value"], &["name", "value"]),
    rule(
        "testcase",
        &["failure", "error", "system-out", "system-err"],
        &["name", "classname", "time"],
        &["name", "time"],
    ),
    rule("failure", &[], &["message", "type"], &["type"]),
    rule("error", &[], &["message", "type"], &["type"]),
    rule("system-out", &[], &[], &[]),
    rule("system-err", &[], &[], &[]),
];

#[test]
fn junit_is_as_the_schemas_of_jenkins_and_surefire_want_it() {
    for report in [hard(), sweep(43_243), SweepReport::default()] {
        let text = report.to_junit();
        let document = roxmltree::Document::parse(&text).expect("well-formed");
        assert_eq!(document.root_element().tag_name().name(), "testsuites");
        for node in document.root_element().descendants().filter(roxmltree::Node::is_element) {
            let name = node.tag_name().name();
            let rule = RULES.iter().find(|rule| rule.element == name).unwrap_or_else(|| panic!("{name}"));
            let places: Vec<usize> = node
                .children()
                .filter(roxmltree::Node::is_element)
                .map(|child| {
                    rule.children.iter().position(|name| *name == child.tag_name().name()).expect("allowed here")
                })
                .collect();
            assert!(places.is_sorted(), "{name}");
            assert!(node.attributes().all(|attribute| rule.attributes.contains(&attribute.name())), "{name}");
            assert!(rule.required.iter().all(|attribute| node.has_attribute(*attribute)), "{name}");
            // Digits, a point and three digits: no exponent, no sign, no word.
            if let Some((whole, decimals)) = node.attribute("time").map(|time| time.split_once('.').expect("decimals"))
            {
                assert!(
                    !whole.is_empty()
                        && decimals.len() == 3
                        && (whole.to_owned() + decimals).bytes().all(|b| b.is_ascii_digit())
                );
            }
        }
    }
}

#[test]
fn junit_counts_what_it_holds_and_says_why() {
    let report = hard();
    let text = report.to_junit();
    let document = roxmltree::Document::parse(&text).expect("well-formed");
    let root = document.root_element();
    let number = |node: roxmltree::Node<'_, '_>, name: &str| node.attribute(name).and_then(|n| n.parse::<usize>().ok());
    let within =
        |node: roxmltree::Node<'_, '_>, name: &str| node.descendants().filter(|n| n.has_tag_name(name)).count();
    let suites = || root.children().filter(|node| node.has_tag_name("testsuite"));
    for node in [root].into_iter().chain(suites()) {
        for (attribute, element) in [("tests", "testcase"), ("failures", "failure"), ("errors", "error")] {
            assert_eq!(number(node, attribute), Some(within(node, element)), "{attribute}");
        }
        let names: Vec<_> = node.children().filter_map(|case| case.attribute("name")).collect();
        assert_eq!(names.iter().collect::<HashSet<_>>().len(), names.len());
    }
    // One failed, one was refused, and so was one model.
    assert_eq!(
        (within(root, "testcase"), within(root, "failure"), within(root, "error")),
        (report.rows.len() + 1, 1, 2)
    );
    let names: Vec<_> = suites().filter_map(|suite| suite.attribute("name")).collect();
    let clean = "a,\"b\"  c|d <&> $x^2$ é";
    assert_eq!(names, [&format!("{clean}  , scene armadillo-2"), "shape.obj, scene armadillo-2", "]]></testsuite>"]);
    for (element, kind) in [("failure", "numeric"), ("error", "input")] {
        let node = root.descendants().find(|node| node.has_tag_name(element)).expect("one");
        assert_eq!(
            (node.attribute("type"), node.attribute("message"), node.text()),
            (Some(kind), Some(clean), Some(clean))
        );
    }
    let second =
        suites().nth(1).and_then(|suite| suite.children().find(|node| node.has_tag_name("testcase"))).expect("a case");
    assert_eq!(second.attribute("classname"), Some("shape_obj.armadillo-2"));
    let output = |name: &str| second.children().find(|node| node.has_tag_name(name)).and_then(|node| node.text());
    assert_eq!(output("system-err"), Some(format!("{clean}\nsecond\n").as_str()));
    let figures = output("system-out").expect("figures");
    let rms = figures.lines().find_map(|line| line.strip_prefix("rms_relative=")).expect("there");
    assert_eq!(rms.parse::<f64>().expect("a number").to_bits(), report.rows[1].rms_relative.to_bits());
    // 20 steps of 1.5 ms and 1.75 ms to propagate.
    assert_eq!((report.rows[1].steps, second.attribute("time")), (20, Some("0.032")));
}

/// A summary keeps its limit whatever it is of, ends with whole tables, and says how much it leaves out.
#[test]
fn a_summary_fits_and_says_what_is_missing() {
    let few = hard().to_summary(SUMMARY_BYTES);
    for said in [
        "26 rows, 2 without figures, 1 model refused.",
        "Smallest cages within 10 %",
        "<summary>Every figure</summary>",
    ] {
        assert!(few.contains(said), "{said}");
    }
    assert!(!few.contains("left out"));
    let mut many = hard();
    for k in 0..6_000 {
        many.rows.push(SweepRow { warnings: vec![HOSTILE.repeat(100)], cage_vertices: k, ..many.rows[0].clone() });
    }
    many.rows[20].model = "m".repeat(5000);
    for (report, limit) in [(&many, SUMMARY_BYTES), (&many, 100_000), (&many, 4000), (&hard(), 4000), (&hard(), 8000)] {
        let text = report.to_summary(limit);
        assert!(text.len() <= limit, "{} {limit}", text.len());
        assert_eq!(text.matches("<details>").count(), text.matches("</details>").count());
        // Every table is whole lines of equally many cells, under a header.
        let bars = |line: &str| line.replace("\\|", "").matches('|').count();
        let lines: Vec<&str> = text.lines().collect();
        for pair in lines.windows(2).filter(|pair| pair.iter().all(|line| line.starts_with('|'))) {
            assert_eq!(bars(pair[0]), bars(pair[1]), "{pair:?}");
        }
        // What a table has and what the sentence below says it lacks are all rows.
        let rows = report.rows.len();
        let (mut tables, mut cut) = (0, 0);
        for at in (0..lines.len()).filter(|&at| lines[at].contains("| RMS relative") && !lines[at].contains("| series"))
        {
            let shown = lines[at + 2..].iter().take_while(|line| line.starts_with('|')).count();
            let below = lines.get(at + 2 + shown + 1).and_then(|line| line.split_once(" of ")?.0.parse::<usize>().ok());
            assert_eq!(shown + below.unwrap_or(0), rows);
            (tables, cut) = (tables + 1, cut + usize::from(below.is_some()));
        }
        assert!(tables == 0 || cut > 0, "{tables} {cut}");
        assert!(text.contains(&format!(" of {rows} rows are left out")));
    }
    // Nothing opens an element but the summary's own.
    assert_eq!(few.replace("\\<", "").matches('<').count(), 4);
    assert_eq!(SweepReport::new(vec![ModelInfo::default()]).to_summary(4000), "## Sweep of \n\n0 rows.\n");
}

#[test]
fn every_cell_is_of_its_columns_kind() {
    use crate::report::columns::Kind;
    for column in &COLUMNS {
        for row in &hard().rows {
            let fits = match (column.cell)(row) {
                Cell::Missing => true,
                Cell::Text(text) => column.kind == Kind::Text || (column.key == "iterations" && text == "converged"),
                Cell::Flag(_) => column.kind == Kind::Flag,
                Cell::Count(_) => column.kind == Kind::Count,
                Cell::Share(_) => matches!(column.kind, Kind::Share | Kind::Length),
                Cell::Number(_) => column.kind == Kind::Number,
                Cell::Time(_) => column.kind == Kind::Time,
                Cell::Bytes(_) => column.kind == Kind::Bytes,
            };
            assert!(fits, "{}", column.key);
        }
    }
}

/// The values by the crate's readers of records, which share no code with the writer of columns; units by its reader of schemas.
#[cfg(feature = "parquet")]
#[test]
fn parquet_is_what_another_reader_reads() {
    use ::parquet::arrow::parquet_to_arrow_schema;
    use ::parquet::file::reader::{FileReader, SerializedFileReader};
    use ::parquet::record::Field;
    use std::io::Write;

    let report = hard();
    let mut file = tempfile::tempfile().expect("a file");
    file.write_all(&report.to_bytes(ReportFormat::Parquet).expect("made")).expect("written");
    let reader = SerializedFileReader::new(file).expect("a Parquet file");
    let about = reader.metadata().file_metadata();
    let value = |key: &str| about.key_value_metadata()?.iter().find(|pair| pair.key == key)?.value.clone();
    assert_eq!((value("schema").as_deref(), value("version").as_deref()), (Some(SCHEMA), Some(HOSTILE)));
    assert_eq!(value("machine").map(|text| json(&text)), Some(json(&report.to_json())["machine"].clone()));
    let schema = parquet_to_arrow_schema(about.schema_descr(), about.key_value_metadata()).expect("a schema");
    let unit = |key: &str| schema.field_with_name(key).expect("a column").metadata().get("unit").map(String::as_str);
    for (key, expected) in [
        ("model", None),
        ("rms_relative", Some("fraction")),
        ("rest_error_max", Some("fraction of diagonal")),
        ("drag_ms", Some("ms")),
        ("peak_memory_bytes", Some("bytes")),
        ("cage_vertices", Some("1")),
    ] {
        assert_eq!(unit(key), expected, "{key}");
    }
    let rows: Vec<_> = reader.get_row_iter(None).expect("rows").map(|row| row.expect("a row")).collect();
    assert_eq!(rows.len(), report.rows.len());
    for (read, row) in rows.iter().zip(&report.rows) {
        let fields: Vec<(&String, &Field)> = read.get_column_iter().collect();
        assert_eq!(fields.len(), COLUMNS.len());
        for ((name, field), column) in fields.into_iter().zip(&COLUMNS) {
            assert_eq!(name, column.key);
            let figure = |x: f64| if x.is_finite() { Field::Double(x) } else { Field::Null };
            let expected = match (column.cell)(row) {
                Cell::Text(_) if column.key == "iterations" => Field::Null,
                Cell::Missing => Field::Null,
                Cell::Text(text) => Field::Str(text),
                Cell::Flag(flag) => Field::Bool(flag),
                Cell::Count(count) => Field::ULong(count as u64),
                Cell::Bytes(bytes) => Field::ULong(bytes),
                Cell::Share(x) | Cell::Number(x) | Cell::Time(x) => figure(x),
            };
            assert_eq!(*field, expected, "{name}");
        }
    }
    // No rows are a file with all columns.
    let mut file = tempfile::tempfile().expect("a file");
    file.write_all(&SweepReport::default().to_parquet().expect("made")).expect("written");
    let empty = SerializedFileReader::new(file).expect("a Parquet file");
    assert_eq!(empty.metadata().file_metadata().num_rows(), 0);
    assert_eq!(empty.metadata().file_metadata().schema_descr().num_columns(), COLUMNS.len());
}
