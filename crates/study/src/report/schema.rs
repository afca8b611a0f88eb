//! `data/schema`: what the JSON form looks like, drawn from the types and their documentation.

use std::fmt::Write as _;

use serde_json::{Map, Value, json};

use super::columns::COLUMNS;
use super::tests::{hostile, sweep};
use super::*;

/// What the fields' documentation becomes: no links, which only rustdoc follows.
fn without_links(text: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some(start) = rest.find("[`") {
        let Some(end) = rest[start..].find("`]") else { break };
        out += &rest[..start];
        out += &rest[start + 1..start + end + 1];
        rest = &rest[start + end + 2..];
        if let Some(target) = rest.strip_prefix('(') {
            rest = target.split_once(')').map_or("", |(_, after)| after);
        }
    }
    let text = (out + rest).replace("`Self::", "`").replace("\n\n", " ").replace('\n', " ");
    text.replace("`NO_CAGE`", &format!("`{NO_CAGE}`")).replace("`PICTURE_WORST`", &PICTURE_WORST.to_string())
}

/// The schema of [`SweepReport::to_json`]'s text.
fn schema() -> Value {
    fn adjust(value: &mut Value) {
        match value {
            Value::Object(object) => {
                // A figure that is not finite is null, whichever it is.
                if object.get("type") == Some(&json!("number")) {
                    object.insert("type".to_owned(), json!(["number", "null"]));
                }
                if let Some(Value::String(text)) = object.get_mut("description") {
                    *text = without_links(text);
                }
                object.values_mut().for_each(adjust);
            }
            Value::Array(values) => values.iter_mut().for_each(adjust),
            _ => {}
        }
    }
    let mut schema = schemars::schema_for!(SweepReport).to_value();
    adjust(&mut schema);
    schema["properties"]["schema"] = json!({ "const": SCHEMA, "description": "The name of this form." });
    schema
}

/// The unit of a field that has one.
fn unit(field: &str) -> &'static str {
    let of_column = COLUMNS.iter().find(|column| column.key == field).and_then(|column| column.kind.unit());
    match field {
        "median" | "min" | "max" | "quiet_ms" | "taken_ms" => "ms",
        "diagonal" => "unit of the model",
        _ => of_column.filter(|unit| *unit != "1").unwrap_or(""),
    }
}

/// The fields in words, a table for each object.
fn readme(schema: &Value) -> String {
    let mut out = format!(
        "# Reports of sweeps\n\n\
         `sweep.schema.json` is the JSON Schema (2020-12) of what `pliant sweep` writes as JSON, `{SCHEMA}`: the one form that all others \
         are made from, and the one that is read back. The number behind the slash grows when a field changes its meaning or goes; \
         new fields leave it, and a reader skips those it does not know. Both files here are drawn from the types in \
         `crates/study/src/report` by `UPDATE_SCHEMA=1 cargo test -p pliant-study schema`.\n\n\
         Any figure may be `null`: it is not finite, or there is none. In CSV and Parquet a time has three columns: `drag_ms` is the \
         median, `drag_ms_min` and `drag_ms_max` are the ends of its spread. JSON Lines are rows (`$defs/SweepRow`), each with \
         the report's `schema`, `version` and `machine`.\n"
    );
    table(&mut out, "SweepReport", schema);
    for (name, definition) in schema["$defs"].as_object().into_iter().flatten() {
        table(&mut out, name, definition);
    }
    out
}

fn table(out: &mut String, name: &str, definition: &Value) {
    let text = |value: &Value| value["description"].as_str().unwrap_or_default().replace('|', "\\|");
    let _ = write!(out, "\n## {name}\n\n{}\n\n", text(definition));
    if let Some(fields) = definition["properties"].as_object() {
        *out += "| field | unit | what it is |\n| --- | --- | --- |\n";
        // Fields of rows as the columns of tables stand, which is easier to read than the alphabet.
        let mut fields: Vec<_> = fields.iter().collect();
        let place = |field: &str| COLUMNS.iter().position(|column| column.key == field).unwrap_or(COLUMNS.len());
        fields.sort_by_key(|(field, _)| place(field));
        for (field, about) in fields {
            let _ = writeln!(out, "| `{field}` | {} | {} |", unit(field), text(about));
        }
    }
    for variant in definition["oneOf"].as_array().into_iter().flatten() {
        let _ = writeln!(out, "- `{}`: {}", variant["const"].as_str().unwrap_or_default(), text(variant));
    }
}

#[test]
fn the_schema_in_the_repository_is_that_of_the_types() {
    let schema = schema();
    let json = serde_json::to_string_pretty(&schema).expect("JSON") + "\n";
    for (name, text) in [("sweep.schema.json", json), ("README.md", readme(&schema))] {
        let path = format!("{}/../../data/schema/{name}", env!("CARGO_MANIFEST_DIR"));
        if std::env::var_os("UPDATE_SCHEMA").is_some() {
            std::fs::write(&path, &text).expect("written");
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(committed == text, "{name} is not up to date: run UPDATE_SCHEMA=1 cargo test -p pliant-study schema");
    }
}

/// A report with a value in every field.
fn full() -> SweepReport {
    let mut report = hostile();
    let calibration = Some(Calibration { quiet_ms: 1.5, taken_ms: 2.5 });
    report.machine = Some(Machine { cpu: Some("cpu".to_owned()), threads: 2, calibration });
    report.refused.push(Refusal { model: "m".to_owned(), reason: "no".to_owned() });
    report.pictures.insert("0".repeat(32), "aGk=".to_owned());
    let time = Spread::of(&[1.0, 2.0]);
    let row = &mut report.rows[0];
    row.times = RowTimes {
        repeats: 2,
        simplify_ms: time,
        bind_ms: time,
        prepare_ms: time,
        drag_ms: time,
        drag_p95_ms: Some(2.0),
        propagate_ms: time,
        refine_ms: time,
        peak_memory_bytes: Some(1 << 40),
    };
    row.volume_change = Some(-0.1);
    row.flipped_faces = Some(3);
    for kind in [FailureKind::Input, FailureKind::Numeric] {
        let failure = Failure { kind, reason: "because".to_owned() };
        report.rows.push(SweepRow::default().failed(failure));
    }
    report
}

#[test]
fn reports_are_as_the_schema_says() {
    let validator = jsonschema::validator_for(&schema()).expect("a schema");
    let valid = |report: &SweepReport| validator.is_valid(&serde_json::from_str(&report.to_json()).expect("JSON"));
    let mut infinite = full();
    infinite.models[0].diagonal = f64::INFINITY;
    infinite.rows[0].edge_max = f64::NEG_INFINITY;
    infinite.rows[1].times.drag_ms = Spread::of(&[f64::NAN]);
    for report in [full(), sweep(100_000), SweepReport::new(Vec::new()), infinite] {
        assert!(valid(&report));
        assert!(SweepReport::read_json(&report.to_json(), "r.json").is_ok());
    }
}

/// The schema and the reader agree on what is a report, whichever single field is left out or has a value of another kind.
#[test]
fn the_schema_refuses_what_the_reader_refuses() {
    let validator = jsonschema::validator_for(&schema()).expect("a schema");
    let report: Value = serde_json::from_str(&full().to_json()).expect("JSON");
    let (mut refused, mut taken) = (0, 0);
    let mut compare = |changed: &Value, what: &str| {
        let readable = SweepReport::read_json(&changed.to_string(), "r.json").is_ok();
        assert_eq!(validator.is_valid(changed), readable, "{what}");
        *(if readable { &mut taken } else { &mut refused }) += 1;
    };
    let last = format!("/rows/{}/failure", report["rows"].as_array().map_or(0, Vec::len) - 1);
    for place in [
        "",
        "/machine",
        "/machine/calibration",
        "/models/0",
        "/refused/0",
        "/rows/0",
        "/rows/0/times",
        "/rows/0/times/bind_ms",
        &last,
    ] {
        let fields: &Map<String, Value> = report.pointer(place).and_then(Value::as_object).expect("an object");
        for field in fields.keys() {
            let mut changed = report.clone();
            let object = changed.pointer_mut(place).and_then(Value::as_object_mut).expect("an object");
            object.remove(field);
            compare(&changed, &format!("{place}/{field} left out"));
            for value in [json!(null), json!(-1), json!(0.5), json!("text"), json!(["text"]), json!(true)] {
                let mut changed = report.clone();
                changed.pointer_mut(place).expect("an object")[field.as_str()] = value.clone();
                compare(&changed, &format!("{place}/{field} as {value}"));
            }
        }
    }
    assert!(refused > 100 && taken > 100, "{refused} {taken}");
}
