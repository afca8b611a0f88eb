//! `pliant check`, and the codes that every command ends in.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};
use tempfile::TempDir;

fn run(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("pliant"));
    command.args(arguments).current_dir(folder).output().expect("started")
}

/// Runs a command that must end in a code; all that it printed.
fn ends(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    said
}

/// A folder with the report of a small sweep: `base.json`.
fn swept() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = ["sweep", "creature:2000", "--sizes", "10%", "--propagation", "positions", "--prune", "magnitude:0.03"];
    ends(folder.path(), 0, &[&sweep[..], &["--refine", "0", "-o", "base", "--formats", "json"]].concat());
    folder
}

fn read(folder: &Path, name: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(folder.join(name)).expect(name)).expect("JSON")
}

/// Copies the report with a change.
fn changed(folder: &Path, name: &str, change: impl FnOnce(&mut Value)) {
    let mut report = read(folder, "base.json");
    change(&mut report);
    std::fs::write(folder.join(name), report.to_string()).expect("written");
}

const CHECK: [&str; 4] = ["check", "--no-times", "--baseline", "base.json"];

#[test]
fn an_unchanged_tree_passes_and_a_worse_one_fails() {
    let folder = swept();
    let folder = folder.path();
    assert!(ends(folder, 0, &CHECK).contains("nothing moved"));
    let was = read(folder, "base.json")["rows"][0]["rms_relative"].as_f64().expect("a figure");
    changed(folder, "strict.json", |report| report["rows"][0]["rms_relative"] = json!(0.5 * was));
    let check = [
        "check",
        "--no-times",
        "--baseline",
        "strict.json",
        "--markdown",
        "m.md",
        "--junit",
        "j.xml",
        "-o",
        "now.json",
    ];
    let said = ends(folder, 1, &check);
    for text in [said, std::fs::read_to_string(folder.join("m.md")).expect("written")] {
        for words in ["rms_relative", "2.0 times as much", "creature:2000, scene creature, cage 10%", "REGRESSION"] {
            assert!(text.contains(words), "{words}: {text}");
        }
    }
    assert!(
        std::fs::read_to_string(folder.join("j.xml")).expect("written").contains("<failure message=\"rms_relative")
    );
    assert_eq!(read(folder, "now.json")["rows"][0]["rms_relative"], json!(was));
    let printed = run(folder, &[&check[..4], &["--json"]].concat()).stdout;
    let gate: Value = serde_json::from_slice(&printed).expect("one JSON value and nothing else");
    assert_eq!((&gate["verdict"], &gate["changes"][0]["figure"]), (&json!("regression"), &json!("rms_relative")));
    // What is allowed passes; what is kept is the new baseline.
    ends(folder, 0, &[&check[..4], &["--tolerance", "rms_relative=101%"]].concat());
    ends(folder, 0, &[&check[..4], &["--update"]].concat());
    ends(folder, 0, &check[..4]);
}

#[test]
fn every_end_has_its_code() {
    let folder = swept();
    let folder = folder.path();
    let with = |more: &[&'static str]| [&CHECK[..], more].concat();
    // 2: arguments that make no sense.
    for more in
        [&["--tolerance", "rms=1%"][..], &["--tolerance", "errors"], &["--force"], &["--report", "x", "--plan", "y"]]
    {
        ends(folder, 2, &with(more));
    }
    ends(folder, 2, &with(&["--junit", "base.json"]));
    ends(folder, 2, &["sweep", "bar:1000", "--sizes", "3"]);
    for use_ in
        [&["check"][..], &["info", "creature:few"], &["info", "creature:10"], &["edit", "creature:2000", "-o", "a.xyz"]]
    {
        ends(folder, 2, use_);
    }
    // 3: what is read is missing or wrong.
    std::fs::write(folder.join("bad.json"), "{ \"rows\": [").expect("written");
    std::fs::write(folder.join("bad.toml"), "sizes = [\"few\"]\nmodels = [\"creature:2000\"]\n").expect("written");
    std::fs::write(folder.join("bad.obj"), "v 0 0 0\nf 1 2 3\n").expect("written");
    changed(folder, "old.json", |report| report["schema"] = json!("pliant-sweep/1"));
    changed(folder, "other.json", |report| report["rows"][0]["model"] = json!("gone.obj"));
    changed(folder, "broken.json", |report| report["rows"][0]["model"] = json!("bad.obj"));
    for (baseline, words) in [
        ("missing.json", "missing.json"),
        ("bad.json", "bad.json:1"),
        ("old.json", "pliant-sweep/1"),
        ("other.json", "gone.obj"),
        ("broken.json", "bad.obj:2"),
        (".", "folder"),
    ] {
        let said = ends(folder, 3, &["check", "--baseline", baseline]);
        assert!(said.contains(words), "{baseline}: {said}");
    }
    for read in [&["--report", "bad.json"][..], &["--plan", "bad.toml"], &["--tolerances", "missing.toml"]] {
        ends(folder, 3, &with(read));
    }
    ends(folder, 3, &["info", "missing.obj"]);
    ends(folder, 3, &["sweep", "--plan", "bad.toml"]);
    // Of a sweep the rest is done, and reported, whether a model is not there or cannot be read.
    for (model, place) in [("missing.obj", "refused"), ("bad.obj", "rows")] {
        let sweep = ["sweep", model, "bar:1000", "--sizes", "5%", "--no-pictures", "-o", "rest", "--formats", "json"];
        assert!(ends(folder, 3, &sweep).contains(model));
        let rest = read(folder, "rest.json");
        assert!(rest[place].as_array().expect("a list").iter().any(|one| one["model"] == json!(model)), "{rest}");
        let rows = rest["rows"].as_array().expect("rows");
        assert!(rows.iter().any(|row| row["model"] == json!("bar:1000") && row["failure"].is_null()), "{rest}");
    }
    // 1 and 4: a row without figures is a regression where it was asked for too much, and a failure where numbers fail.
    for (kind, code) in [("input", 1), ("numeric", 4), ("internal", 70)] {
        changed(folder, "now.json", |report| {
            report["rows"][0]["failure"] = json!({ "kind": kind, "reason": "no solution" });
        });
        let said = ends(folder, code, &with(&["--report", "now.json", "--markdown", "m.md"]));
        assert!(said.contains("no solution") && folder.join("m.md").exists(), "{said}");
        // A baseline is not replaced by rows that failed, unless that is insisted on.
        std::fs::copy(folder.join("base.json"), folder.join("kept.json")).expect("copied");
        let update = ["check", "--baseline", "kept.json", "--report", "now.json", "--update"];
        assert!(ends(folder, code.max(3), &update).contains("--force"));
        assert_eq!(read(folder, "kept.json"), read(folder, "base.json"));
        ends(folder, 0, &[&update[..], &["--force"]].concat());
        assert_eq!(read(folder, "kept.json")["rows"][0]["failure"]["kind"], json!(kind));
    }
    // 5: a result cannot be written.
    ends(folder, 5, &with(&["--markdown", "missing/m.md"]));
    ends(folder, 5, &["edit", "creature:2000", "-o", "missing/a.obj"]);
    assert!(ends(folder, 0, &["--help"]).contains("70  internal error"));
}
