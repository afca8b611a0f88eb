use serde_json::{Value, json};

use super::figures::{FIGURES, Group};
use super::*;
use crate::Calibration;
use crate::report::{Machine, SweepRow};

/// Pseudo-random numbers: xorshift.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }

    /// Of any size and sign, 0, or what is no number.
    fn figure(&mut self) -> f64 {
        match self.below(12) {
            0 => 0.0,
            1 => f64::NAN,
            2 => f64::INFINITY,
            3 => f64::from_bits(self.next()),
            _ => (self.below(2000) as f64 - 1000.0) * 10_f64.powi(self.below(20) as i32 - 12),
        }
    }

    fn pick<'a>(&mut self, texts: &[&'a str]) -> &'a str {
        texts[self.below(texts.len() as u64) as usize]
    }
}

/// Where a figure stands in a row's JSON.
fn path(figure: &str, group: Group) -> String {
    match group {
        Group::Time => format!("/times/{figure}/min"),
        Group::Memory => format!("/times/{figure}"),
        _ => format!("/{figure}"),
    }
}

fn with(row: &SweepRow, figure: &str, value: Value) -> SweepRow {
    let group = FIGURES.iter().find(|f| f.name == figure).map_or(Group::Error, |f| f.group);
    let mut json = serde_json::to_value(row).expect("JSON");
    if group == Group::Time {
        json["times"][figure] = json!({ "median": 0.0, "min": 0.0, "max": 0.0 });
    }
    *json.pointer_mut(&path(figure, group)).expect(figure) = value;
    serde_json::from_value(json).expect("a row")
}

fn machine(quiet_ms: f64, taken_ms: f64) -> Option<Machine> {
    Some(Machine { cpu: None, threads: 1, calibration: Some(Calibration { quiet_ms, taken_ms }) })
}

/// A report of rows on a quiet machine.
fn report(rows: Vec<SweepRow>) -> SweepReport {
    SweepReport { rows, machine: machine(70.0, 70.0), ..SweepReport::new(Vec::new()) }
}

/// A row with a value for each figure.
fn row(cage: &str) -> SweepRow {
    let bare = SweepRow {
        model: "creature:5000".to_owned(),
        vertices: 5004,
        scene: "creature".to_owned(),
        cage_asked: cage.to_owned(),
        method: "arap".to_owned(),
        propagation: "positions".to_owned(),
        prune: "magnitude:0.03".to_owned(),
        steps: 20,
        start: "levels".to_owned(),
        iterations: Some(2),
        ..SweepRow::default()
    };
    FIGURES.iter().fold(bare, |row, figure| match figure.group {
        Group::Count => with(&row, figure.name, json!(10)),
        Group::Memory => with(&row, figure.name, json!(100_000_000_u64)),
        _ if figure.unit == Unit::Count => with(&row, figure.name, json!(250)),
        _ => with(&row, figure.name, json!(0.25)),
    })
}

fn compare_rows(old: SweepRow, new: SweepRow) -> GateReport {
    compare_reports(&report(vec![old]), &report(vec![new]), &Tolerances::default())
}

fn random_report(random: &mut Random) -> SweepReport {
    let mut rows = Vec::new();
    for _ in 0..random.below(9) {
        let mut made = row(random.pick(&["1%", "5%", "none"]));
        made.model = random.pick(&["a.obj", "b|<&>\u{1}\"\n"]).to_owned();
        for figure in &FIGURES {
            let value = match figure.unit {
                Unit::Count => json!(random.below(5)),
                Unit::Bytes => json!(random.next()),
                _ => json!(random.figure()),
            };
            // A spread has no null.
            if figure.group != Group::Time || value.is_number() {
                made = with(&made, figure.name, value);
            }
        }
        if random.below(5) == 0 {
            let kind = if random.below(2) == 0 { FailureKind::Numeric } else { FailureKind::Input };
            made = made.failed(Failure { kind, reason: "for <some> reason".to_owned() });
        }
        rows.push(made);
    }
    let calibration =
        (random.below(4) > 0).then(|| Calibration { quiet_ms: random.figure(), taken_ms: random.figure() });
    let machine = (random.below(4) > 0).then_some(Machine { cpu: None, threads: 1, calibration });
    SweepReport { machine, ..report(rows) }
}

#[test]
fn any_report_passes_against_itself() {
    let mut random = Random(7);
    let mut rows = 0;
    for _ in 0..300 {
        let report = random_report(&mut random);
        let gate = compare_reports(&report, &report, &Tolerances::default());
        rows += gate.rows.len();
        assert_eq!((gate.verdict, gate.changes.len()), (Verdict::Pass, 0), "{}", gate.to_text());
    }
    assert!(rows > 900, "{rows}");
}

/// Whatever two reports say, every form of the result can be written, and says the same.
#[test]
fn any_two_reports_are_compared() {
    let mut random = Random(11);
    for _ in 0..300 {
        let (a, b) = (random_report(&mut random), random_report(&mut random));
        let gate = compare_reports(&a, &b, &Tolerances::default());
        assert_eq!(gate.verdict == Verdict::Pass, gate.regressions().next().is_none());
        let json: GateReport = serde_json::from_str(&gate.to_json()).expect("own JSON");
        assert_eq!((json.verdict, json.changes.len()), (gate.verdict, gate.changes.len()));
        let xml = gate.to_junit();
        let xml = roxmltree::Document::parse(&xml).expect("well-formed");
        let count = |name: &str| xml.descendants().filter(|node| node.has_tag_name(name)).count();
        assert_eq!(count("testcase"), a.rows.len());
        let suite = xml.descendants().find(|node| node.has_tag_name("testsuite")).expect("a suite");
        for (attribute, element) in [("tests", "testcase"), ("failures", "failure"), ("errors", "error")] {
            assert_eq!(suite.attribute(attribute), Some(count(element).to_string().as_str()), "{attribute}");
        }
        assert!((count("failure") + count("error") > 0) == (gate.verdict > Verdict::Pass));
        let table = gate.to_markdown();
        assert!(
            table.lines().filter(|line| line.starts_with("| ")).all(|line| line
                .replace("\\|", "")
                .matches('|')
                .count()
                == 4)
        );
    }
}

/// At its edge a tolerance allows; the next number above fails; the same far below is better and passes.
#[test]
fn each_figure_fails_above_its_tolerance_and_never_below() {
    for figure in &FIGURES {
        let old = row("5%");
        let was = (figure.of)(&old).expect("has every figure");
        let tolerance = Tolerances::default().of(figure.name, figure.group);
        let whole = matches!(figure.unit, Unit::Count | Unit::Bytes);
        let edge = if whole { tolerance.most(was).floor() } else { tolerance.most(was) };
        let value = |x: f64| if whole { json!(x as u64) } else { json!(x) };
        let above = if whole { edge + 1.0 } else { edge.next_up() };
        let neutral = figure.group == Group::Neutral;
        let outcome = |x: f64| {
            let gate = compare_rows(old.clone(), with(&old, figure.name, value(x)));
            let kinds: Vec<ChangeKind> = gate.changes.iter().map(|change| change.kind).collect();
            (gate.verdict, kinds)
        };
        assert_eq!(outcome(was), (Verdict::Pass, vec![]), "{}", figure.name);
        assert_eq!(outcome(edge), (Verdict::Pass, vec![]), "{}", figure.name);
        let worse = if neutral {
            (Verdict::Pass, vec![ChangeKind::Different])
        } else {
            (Verdict::Regression, vec![ChangeKind::Worse])
        };
        assert_eq!(outcome(above), worse, "{}", figure.name);
        assert_eq!(outcome(100.0 * was + 1e9), worse, "{}", figure.name);
        let better = if neutral { ChangeKind::Different } else { ChangeKind::Better };
        let small = if figure.group == Group::Time { 1e-3 } else { 0.0 };
        assert_eq!(outcome(small), (Verdict::Pass, vec![better]), "{}", figure.name);
        if figure.group == Group::Error {
            // A value of the other sign is as bad as its size says.
            assert_eq!(outcome(-was).0, Verdict::Pass, "{}", figure.name);
            assert_eq!(outcome(-above), worse, "{}", figure.name);
            // What is no number any more is worse; what was none is not compared with.
            let none = with(&old, figure.name, Value::Null);
            assert_eq!(compare_rows(old.clone(), none.clone()).verdict, Verdict::Regression, "{}", figure.name);
            assert_eq!(compare_rows(none.clone(), old.clone()).verdict, Verdict::Pass, "{}", figure.name);
            assert_eq!(compare_rows(none.clone(), none).changes, [], "{}", figure.name);
        }
    }
}

#[test]
fn the_message_names_figure_row_old_and_new_value() {
    let old = with(&row("5%"), "rms_relative", json!(0.0459));
    let gate = compare_rows(old.clone(), with(&old, "rms_relative", json!(0.091)));
    let text = gate.to_text();
    let row = "creature:5000, scene creature, cage 5%, arap, positions, magnitude:0.03, start levels, 20 x 2";
    for words in
        ["WORSE", "rms_relative 4.59 % -> 9.10 %", "+98.3 %", "up to 4.59 % allowed", row, "REGRESSION", "1 worse"]
    {
        assert!(text.contains(words), "{words}: {text}");
        assert!(gate.to_markdown().contains(words), "{words}: {}", gate.to_markdown());
    }
    let gate = compare_rows(old.clone(), with(&old, "rms_relative", json!(0.04)));
    assert!(gate.notes.iter().any(|note| note.contains("--update")), "{:?}", gate.notes);
    // As many digits as tell them apart, however small the difference.
    let gate = compare_rows(old.clone(), with(&old, "rms_relative", json!(0.0459 * (1.0 + 2e-6))));
    assert!(gate.to_text().contains("rms_relative 4.5900000 % -> 4.5900092 % (+2.0e-4 %"), "{}", gate.to_text());
    let gate = compare_rows(with(&old, "rest_error_max", json!(1e-15)), with(&old, "rest_error_max", json!(1e-8)));
    assert!(gate.to_text().contains("1.00e-13 % of the diagonal -> 1.00e-6 %"), "{}", gate.to_text());
    let gate = compare_rows(with(&old, "flipped_faces", json!(0)), with(&old, "flipped_faces", json!(3)));
    assert!(gate.to_text().contains("flipped_faces 0 -> 3 (up to 0 allowed)"), "{}", gate.to_text());
}

#[test]
fn the_worst_comes_first() {
    let old = row("5%");
    let mut new = with(&old, "edge_p95", json!(0.26));
    for (figure, value) in [("edge_max", 2.5), ("rms_relative", 0.5), ("relative_rms", 0.1), ("edge_p99", 0.01)] {
        new = with(&new, figure, json!(value));
    }
    let gate = compare_rows(old, new);
    let order: Vec<&str> = gate.changes.iter().filter_map(|change| change.figure.as_deref()).collect();
    assert_eq!(order, ["edge_max", "rms_relative", "edge_p95", "edge_p99", "relative_rms"]);
}

#[test]
fn rows_are_matched_by_what_was_asked() {
    let (a, b, c) = (row("1%"), row("5%"), row("none"));
    let kinds = |old: &[&SweepRow], new: &[&SweepRow]| {
        let of = |rows: &[&SweepRow]| report(rows.iter().copied().cloned().collect());
        let gate = compare_reports(&of(old), &of(new), &Tolerances::default());
        (gate.verdict, gate.changes.iter().map(|change| change.kind).collect::<Vec<_>>())
    };
    use ChangeKind::{Added, Failed, Missing, OtherModel, Recovered};
    // The order means nothing, nor does what is measured beside.
    let b_again =
        SweepRow { id: "other".to_owned(), warnings: vec!["a".to_owned()], published: Some(0.1), ..b.clone() };
    assert_eq!(kinds(&[&a, &b, &c], &[&c, &b_again, &a]), (Verdict::Pass, vec![]));
    assert_eq!(kinds(&[&a, &b], &[&b]), (Verdict::Regression, vec![Missing]));
    assert_eq!(kinds(&[&a], &[&a, &b]), (Verdict::Pass, vec![Added]));
    assert_eq!(kinds(&[], &[]), (Verdict::Pass, vec![]));
    // Of rows with one key each has its own.
    assert_eq!(kinds(&[&a, &a], &[&a]), (Verdict::Regression, vec![Missing]));
    assert_eq!(kinds(&[&a], &[&a, &a]), (Verdict::Pass, vec![Added]));
    let failed = |kind| a.clone().failed(Failure { kind, reason: "no solution".to_owned() });
    let (refused, broken, wrong) =
        (failed(FailureKind::Input), failed(FailureKind::Numeric), failed(FailureKind::Internal));
    assert_eq!(kinds(&[&a], &[&refused]), (Verdict::Regression, vec![Failed]));
    assert_eq!(kinds(&[&a], &[&broken]), (Verdict::Numeric, vec![Failed]));
    assert_eq!(kinds(&[&a, &b], &[&broken]), (Verdict::Numeric, vec![Failed, Missing]));
    assert_eq!(kinds(&[&a], &[&wrong]), (Verdict::Internal, vec![Failed]));
    assert_eq!(kinds(&[&broken], &[&broken]), (Verdict::Pass, vec![]));
    assert_eq!(kinds(&[&broken], &[&a]), (Verdict::Pass, vec![Recovered]));
    let finer = SweepRow { vertices: 6000, rms_relative: 9.0, ..a.clone() };
    assert_eq!(kinds(&[&a], &[&finer]), (Verdict::Regression, vec![OtherModel]));
}

/// Times are multiples of the loop: a machine of half the speed passes, a stage of half the speed does not, a busy machine is not blamed.
#[test]
fn times_are_compared_as_multiples_of_the_loop() {
    let times = |ms: f64| {
        FIGURES.iter().filter(|f| f.group == Group::Time).fold(row("5%"), |row, f| with(&row, f.name, json!(ms)))
    };
    let on = |machine: Option<Machine>, ms: f64| SweepReport { machine, ..report(vec![times(ms)]) };
    let gate = |then: &SweepReport, now: &SweepReport| compare_reports(then, now, &Tolerances::default());
    for ms in [1.0, 100.0] {
        let then = on(machine(70.0, 70.0), ms);
        assert_eq!(gate(&then, &on(machine(140.0, 140.0), 2.0 * ms)).changes, []);
        let slower = gate(&then, &on(machine(70.0, 70.0), 2.0 * ms));
        assert_eq!((slower.verdict, slower.changes.len()), (Verdict::Regression, 6), "{}", slower.to_text());
        assert!(slower.to_text().contains("bind_ms"), "{}", slower.to_text());
        // On a machine of half the speed it is still seen, and shown as at the baseline.
        let slower = gate(&then, &on(machine(140.0, 140.0), 4.0 * ms));
        assert_eq!((slower.verdict, slower.changes[0].new), (Verdict::Regression, Some(2.0 * ms)));
        let faster = gate(&then, &on(machine(70.0, 70.0), 0.3 * ms));
        assert_eq!((faster.verdict, faster.changes.len()), (Verdict::Pass, 6));
    }
    // Disturbed twice over: long stages may be, short ones are not.
    let busy = machine(70.0, 140.0);
    let long = gate(&on(machine(70.0, 70.0), 100.0), &on(busy.clone(), 200.0));
    assert_eq!(long.changes, [], "{}", long.to_text());
    assert!(long.notes.iter().any(|note| note.contains("busy")), "{:?}", long.notes);
    assert_eq!(gate(&on(machine(70.0, 70.0), 1.0), &on(busy.clone(), 2.0)).verdict, Verdict::Regression);
    // That the baseline was made on a busy machine makes nothing slower.
    assert_eq!(gate(&on(busy, 1.0), &on(machine(70.0, 70.0), 1.0)).changes, []);
    // What cannot be compared is not, and that is said.
    let then = on(machine(70.0, 70.0), 1.0);
    let threads = machine(70.0, 70.0).map(|machine| Machine { threads: 2, ..machine });
    let bare = Some(Machine { cpu: None, threads: 1, calibration: None });
    for other in [threads, bare, None, machine(0.0, f64::NAN)] {
        let gate = gate(&then, &on(other, 100.0));
        assert_eq!((gate.verdict, gate.notes.len()), (Verdict::Pass, 1), "{}", gate.to_text());
        assert!(gate.notes[0].starts_with("Times are not compared"), "{:?}", gate.notes);
    }
    let off = Tolerances { times: Tolerance::OFF, ..Tolerances::default() };
    let untimed = compare_reports(&then, &on(None, 100.0), &off);
    assert_eq!((untimed.changes.len(), untimed.notes.len()), (0, 0));
}

#[test]
fn tolerances_are_read_as_written() {
    let read = |text: &str| text.parse::<Tolerance>().map(|t| (t.relative, t.absolute)).ok();
    for (text, value) in [
        ("1%", (0.01, 0.0)),
        ("0", (0.0, 0.0)),
        ("0.5", (0.5, 0.0)),
        ("1e-6+1e-9", (1e-6, 1e-9)),
        ("2e+1+3", (20.0, 3.0)),
        ("1 % + 0.002", (0.01, 0.002)),
        ("off", (f64::INFINITY, 0.0)),
    ] {
        assert_eq!(read(text), Some(value), "{text}");
        let tolerance = Tolerance { relative: value.0, absolute: value.1 };
        assert_eq!(tolerance.to_string().parse::<Tolerance>().ok(), Some(tolerance), "{text}");
    }
    for bad in ["", "%", "-1%", "nan", "inf", "1%+", "+1", "1%%", "1+2+3", "few", "1e999"] {
        assert_eq!(read(bad), None, "{bad}");
    }
    let text =
        "errors = \"1%\"\ncounts = 0.5\ntimes = \"off\"\n[figures]\nedge_max = \"5%+0.01\"\nbind_ms = \"100%\"\n";
    let tolerances = Tolerances::parse(text, "t.toml").expect("valid");
    assert_eq!(tolerances.of("rms_relative", Group::Error).relative, 0.01);
    assert_eq!(tolerances.of("edge_max", Group::Error), Tolerance { relative: 0.05, absolute: 0.01 });
    assert_eq!(tolerances.of("flipped_faces", Group::Count).relative, 0.5);
    assert_eq!(tolerances.memory, Tolerances::default().memory);
    assert!(tolerances.compare_times());
    assert_eq!(Tolerances::parse(&toml_of(&tolerances), "t.toml").expect("own text"), tolerances);
    for (text, words) in [
        ("errors = \"-1%\"", ["t.toml", "-1%"]),
        ("errors = -1", ["t.toml", "-1"]),
        ("wrong = 1", ["t.toml", "wrong"]),
        ("[figures]\nrms = 1", ["t.toml", "rms_relative"]),
        ("errors", ["t.toml", "line 1"]),
    ] {
        let error = Tolerances::parse(text, "t.toml").expect_err(text).to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
    }
}

/// TOML of tolerances, which nothing but this test writes.
fn toml_of(tolerances: &Tolerances) -> String {
    let value = serde_json::to_value(tolerances).expect("JSON");
    let line = |(name, value): (&String, &Value)| format!("{name} = {value}\n");
    let plain = value.as_object().expect("a table").iter().filter(|(_, value)| value.is_string()).map(line);
    let figures = value["figures"].as_object().expect("a table").iter().map(line);
    plain.chain(["[figures]\n".to_owned()]).chain(figures).collect()
}

#[test]
fn reports_are_refused_that_are_none() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = |name: &str, text: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        read_report(&path).map_err(|error| error.to_string())
    };
    let good = report(vec![row("5%")]);
    assert_eq!(file("good.json", good.to_json().as_bytes()), Ok(good.clone()));
    let whole = good.to_json();
    let older = SweepReport { schema: "pliant-sweep/1".to_owned(), ..good };
    let json = older.to_json();
    for (name, text, words) in [
        ("old.json", json.as_bytes(), ["old.json", "pliant-sweep/1", "pliant-sweep/2"]),
        ("other.json", b"{ \"a\": 1 }", ["other.json:1", "schema", ""]),
        ("cut.json", &whole.as_bytes()[..200], ["cut.json:", "EOF", ""]),
        ("bytes.json", b"\xff\xfe\x00", ["bytes.json", "UTF-8", ""]),
        ("empty.json", b"", ["empty.json", "EOF", ""]),
        ("deep.json", "[".repeat(100_000).as_bytes(), ["deep.json", "", ""]),
    ] {
        let error = file(name, text).expect_err(name);
        assert!(words.iter().all(|word| error.contains(word)), "{name}: {error}");
    }
    assert!(read_report(folder.path()).expect_err("a folder").to_string().contains("folder"));
}

/// What is kept in a repository differs in no figure, is as short as may be, and is itself when it is kept again.
#[test]
fn a_baseline_is_the_report_without_what_changes_in_vain() {
    let mut made = row("5%");
    made.id = "0123".to_owned();
    made.times.bind_ms = Some(crate::Spread { median: 12.345678, min: 0.012344, max: 12345.678 });
    let mut report = report(vec![made]);
    report.pictures.insert("0123".to_owned(), "iVBO".to_owned());
    let kept = report.clone().into_baseline(true);
    assert_eq!(compare_reports(&report, &kept, &Tolerances::default()).changes, []);
    assert_eq!(kept.clone().into_baseline(true), kept);
    let json = kept.to_json();
    for (text, there) in
        [("iVBO", false), ("0123\"", false), ("12.345", false), ("0.0123,", true), ("12.3,", true), ("12300.0", true)]
    {
        assert_eq!(json.contains(text), there, "{text}: {json}");
    }
    let untimed = report.clone().into_baseline(false);
    assert_eq!((untimed.machine.clone(), untimed.rows[0].times.bind_ms), (None, None));
    let gate = compare_reports(&untimed, &report, &Tolerances { times: Tolerance::OFF, ..Tolerances::default() });
    assert_eq!(gate.changes, [], "{}", gate.to_text());
}
