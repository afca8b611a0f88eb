//! `pliant sweep` as a user, a job array and a power cut see it.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;

fn pliant(folder: &TempDir, arguments: &[&str]) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("pliant"));
    command.args(arguments).current_dir(folder.path());
    command
}

fn done(folder: &TempDir, arguments: &[&str]) -> Output {
    let output = pliant(folder, arguments).output().expect("started");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// A report without what differs from run to run.
fn figures(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).expect("a report");
    let mut report: Value = serde_json::from_str(&text).expect("JSON");
    report["machine"].take();
    report["rows"].as_array_mut().expect("rows").iter_mut().for_each(|row| drop(row["times"].take()));
    report
}

const SWEPT: [&str; 4] = ["sweep", "creature:3000", "--sizes", "2%..30%,none"];

/// Killed at many moments and begun again each time, a sweep gives the report of an unbroken one.
#[test]
fn a_killed_sweep_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let with_output = |prefix| [&SWEPT[..], &["-o", prefix]].concat();
    done(&folder, &with_output("whole"));
    let whole = figures(&folder.path().join("whole.json"));
    let mut kills = 0;
    // Later and later, so that each run gets on; the time of one row is some 20 ms.
    for wait in (5..).step_by(7).take(60) {
        let mut run = pliant(&folder, &with_output("out/broken"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("started");
        std::thread::sleep(Duration::from_millis(wait));
        let ended = run.try_wait().expect("a process").is_some();
        let _ = run.kill();
        run.wait().expect("a process");
        // Whatever it left is whole.
        if let Ok(files) = std::fs::read_dir(folder.path().join("out/broken.jobs")) {
            for file in files.map(|file| file.expect("a file").path()) {
                if file.extension().is_some_and(|kind| kind == "json") {
                    let text = std::fs::read_to_string(&file).expect("readable");
                    serde_json::from_str::<Value>(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
                }
            }
        }
        if ended {
            break;
        }
        kills += 1;
    }
    assert!(kills > 0, "nothing was broken off");
    // Once more, when it has finished a row at least, however slow the machine.
    let mut run = pliant(&folder, &with_output("out/broken"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("started");
    // Besides the list of jobs and what is half written.
    let is_row = |name: &str| name.ends_with(".json") && name != "jobs.json" && !name.starts_with('.');
    let has_row = || {
        let files = std::fs::read_dir(folder.path().join("out/broken.jobs")).into_iter().flatten().flatten();
        files.map(|file| file.file_name()).any(|name| name.to_str().is_some_and(is_row))
    };
    while !has_row() && run.try_wait().expect("a process").is_none() {
        std::thread::sleep(Duration::from_millis(2));
    }
    let _ = run.kill();
    run.wait().expect("a process");
    let last = done(&folder, &with_output("out/broken"));
    assert_eq!(figures(&folder.path().join("out/broken.json")), whole);
    assert!(String::from_utf8_lossy(&last.stdout).contains("finished before"));
    // Asked to, it makes all rows anew.
    let fresh = done(&folder, &[&with_output("out/broken")[..], &["--fresh"]].concat());
    assert!(!String::from_utf8_lossy(&fresh.stdout).contains("finished before"));
    assert_eq!(figures(&folder.path().join("out/broken.json")), whole);
}

/// An array of jobs, each a process that knows its index alone; and two shards that Slurm numbers.
#[test]
fn a_job_array_makes_the_report_of_one_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let swept = ["creature:2000", "--sizes", "10%,none", "--methods", "arap,laplacian"];
    let part = |rest: &[&'static str]| [&["sweep", "run"][..], &swept, rest].concat();
    let plan = done(&folder, &[&["sweep", "plan"][..], &swept, &["--json"]].concat());
    let plan: Value = serde_json::from_slice(&plan.stdout).expect("JSON");
    let jobs = plan["jobs"].as_array().expect("jobs");
    assert_eq!(jobs.len(), 4);
    for index in 0..jobs.len() {
        let mut run = pliant(&folder, &part(&["--dir", "array", "--job", "slurm"]));
        let ran = run.env("SLURM_ARRAY_TASK_ID", index.to_string()).output().expect("started");
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }
    for task in ["3", "5"] {
        let mut run = pliant(&folder, &part(&["--dir", "shards", "--shard", "slurm", "--json"]));
        run.env("SLURM_ARRAY_TASK_ID", task).env("SLURM_ARRAY_TASK_MIN", "3");
        run.env("SLURM_ARRAY_TASK_STEP", "2").env("SLURM_ARRAY_TASK_COUNT", "2");
        let ran = run.output().expect("started");
        let rows: Value = serde_json::from_slice(&ran.stdout).expect("JSON");
        assert_eq!(rows.as_array().map(Vec::len), Some(2));
    }
    done(&folder, &[&["sweep"][..], &swept, &["-o", "whole"]].concat());
    for dir in ["array", "shards"] {
        done(&folder, &["sweep", "merge", dir, "-o", dir]);
        assert_eq!(figures(&folder.path().join(format!("{dir}.json"))), figures(&folder.path().join("whole.json")));
    }
    // Ids may be typed; what names no job is told so.
    let id = jobs[1]["id"].as_str().expect("an id");
    done(&folder, &[&part(&["--dir", "one"])[..], &["--job", &id[..10]]].concat());
    let missing = pliant(&folder, &["sweep", "merge", "one"]).output().expect("started");
    assert!(!missing.status.success() && String::from_utf8_lossy(&missing.stderr).contains("3 of 4 jobs"));
    for (wrong, says) in [("9", "0 to 3"), ("slurm", "SLURM_ARRAY_TASK_ID")] {
        let refused = pliant(&folder, &part(&["--dir", "one", "--job", wrong])).output().expect("started");
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.contains(says), "{said}");
    }
}

#[test]
fn a_plan_file_and_flags_say_the_same() {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = "models = [\"creature:2000\"]\nsizes = [\"5%\", \"none\"]\nprune = [\"magnitude:0.03\"]\nrefine = 0\n";
    std::fs::write(folder.path().join("plan.toml"), plan).expect("written");
    done(&folder, &["sweep", "--plan", "plan.toml", "-o", "a"]);
    let flags = ["creature:2000", "--sizes", "5%,none", "--prune", "magnitude:0.03", "--refine", "0"];
    done(&folder, &[&["sweep"][..], &flags, &["-o", "b"]].concat());
    assert_eq!(figures(&folder.path().join("a.json")), figures(&folder.path().join("b.json")));
    // A report is not written over the plan that asks for it.
    std::fs::copy(folder.path().join("plan.toml"), folder.path().join("own.csv")).expect("copied");
    let refused = pliant(&folder, &["sweep", "--plan", "own.csv", "-o", "own"]).output().expect("started");
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("this is the plan itself"));
    assert_eq!(std::fs::read_to_string(folder.path().join("own.csv")).expect("there"), plan);
    // A flag replaces what the plan says.
    let listed = done(&folder, &["sweep", "plan", "--plan", "plan.toml", "--prune", "smooth:8", "cylinder:500"]);
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    assert!(listed.contains("smooth:8") && listed.contains("cylinder:500") && !listed.contains("creature"), "{listed}");
}
