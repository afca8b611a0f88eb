//! Sweeps as jobs: ids, splits, merging, resumption, and what cannot be swept.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use pliant::{
    FailureKind, JobFolder, JobList, RowDone, Silent, SweepJobs, SweepReport, SweepRow, SweepSize, SweepSpec,
    equal_time_vertices, merge_jobs, shapes, write,
};

fn spec(models: &[&str], sizes: &[&str]) -> SweepSpec {
    let texts = |list: &[&str]| list.iter().map(|text| (*text).to_owned()).collect();
    SweepSpec { models: texts(models), sizes: texts(sizes), ..SweepSpec::default() }
}

fn jobs(spec: &SweepSpec) -> SweepJobs {
    spec.jobs().expect("a plan")
}

fn quiet(_: RowDone<'_>) {}

/// All that must not depend on how or when a row was made.
fn figures(report: &SweepReport) -> String {
    let mut report = report.clone();
    report.machine = None;
    report.rows.iter_mut().for_each(|row| row.times = Default::default());
    report.to_json()
}

fn ids(jobs: &SweepJobs) -> Vec<String> {
    jobs.jobs.iter().map(|job| job.id.clone()).collect()
}

/// A mesh file of a cylinder.
fn file(folder: &Path, name: &str, sides: u32) -> String {
    let mesh = shapes::cylinder(0.4, 3.0, sides, 30, 3).expect("valid");
    let path = folder.join(name);
    write(&path, &mesh).expect("written");
    path.display().to_string()
}

#[test]
fn ids_belong_to_bytes_settings_and_scene_and_to_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let model = file(folder.path(), "a.obj", 16);
    let first = ids(&jobs(&spec(&[&model], &["10%", "20%", "none"])));
    assert_eq!(first, ids(&jobs(&spec(&[&model], &["10%", "20%", "none"]))));
    assert_eq!(first.iter().collect::<HashSet<_>>().len(), 3);
    assert!(first.iter().all(|id| id.len() == 32 && id.bytes().all(|b| b.is_ascii_hexdigit())));
    // Other neighbours, another order, another folder, and repeats make no other job.
    assert_eq!(ids(&jobs(&spec(&[&model], &["20%"]))), first[1..2]);
    let elsewhere = tempfile::tempdir().expect("a folder");
    let copy = |name: &str| {
        let path = elsewhere.path().join(name);
        fs::copy(&model, &path).expect("copied");
        path.display().to_string()
    };
    assert_eq!(ids(&jobs(&spec(&[&copy("a.obj")], &["10%"]))), first[..1]);
    let repeated = SweepSpec { repeats: Some(7), ..spec(&[&model], &["10%"]) };
    assert_eq!(ids(&jobs(&repeated)), first[..1]);
    // A byte of the model, and any setting that the figures depend on, do.
    let mut seen: HashSet<String> = first.iter().cloned().collect();
    // So does its name: reports tell models apart by it, and it says how the bytes are read.
    assert_eq!(jobs(&spec(&[&model, &copy("b.obj")], &["10%"])).jobs.len(), 2);
    let mut other = |spec: SweepSpec| assert!(seen.insert(ids(&jobs(&spec)).remove(0)), "{spec:?}");
    let one = || spec(&[&model], &["10%"]);
    other(spec(&[&copy("b.obj")], &["10%"]));
    let text = |text: &str| vec![text.to_owned()];
    other(SweepSpec { propagation: text("positions"), ..one() });
    other(SweepSpec { prune: text("smooth:15"), ..one() });
    other(SweepSpec { methods: text("arap:uniform"), ..one() });
    other(SweepSpec { iterations: text("3"), ..one() });
    other(SweepSpec { iterations: text("converged"), ..one() });
    other(SweepSpec { steps: Some(2), ..one() });
    other(SweepSpec { start: Some("pose".to_owned()), ..one() });
    other(SweepSpec { refine: Some(3), ..one() });
    other(SweepSpec { reference: Some(false), ..one() });
    other(SweepSpec { scenes: text("bar-twist-135"), ..one() });
    other(spec(&[&model], &["equal-time:10%"]));
    let bytes = fs::read_to_string(&model).expect("text");
    fs::write(&model, bytes + "# one more line\n").expect("written");
    other(one());
}

#[test]
fn shards_are_all_jobs_in_parts_of_equal_size() {
    let jobs = jobs(&spec(&["cylinder:500", "bar:500"], &["10%..40%:5", "none"]));
    for count in 1..=jobs.jobs.len() + 3 {
        let parts: Vec<Vec<usize>> = (1..=count).map(|k| jobs.shard(k, count).expect("a shard")).collect();
        assert_eq!(parts.concat(), (0..jobs.jobs.len()).collect::<Vec<_>>());
        let sizes = parts.iter().map(Vec::len);
        assert!(sizes.clone().max().expect("parts") - sizes.min().expect("parts") <= 1, "{count}");
    }
    assert!(jobs.shard(0, 2).is_err() && jobs.shard(3, 2).is_err() && jobs.shard(1, 0).is_err());
    // A number, an id, the beginning of one; nothing else.
    let id = &jobs.jobs[3].id;
    for asked in ["3", &id[..], &id[..8]] {
        assert_eq!(jobs.job(asked).expect(asked), 3);
    }
    for wrong in ["99999", "-1", "", "gggggggg", "1.0"] {
        assert!(jobs.job(wrong).is_err(), "{wrong}");
    }
}

/// Four processes with a folder each, merged in another order, and one process without a folder.
#[test]
fn shards_merged_are_the_whole() {
    let folder = tempfile::tempdir().expect("a folder");
    let spec =
        SweepSpec { equal_time: Some(true), ..spec(&["cylinder:600", "creature:2000"], &["10%", "30%", "none"]) };
    let whole = jobs(&spec).report(None, &Silent, &mut quiet).expect("a report");
    assert!(
        whole
            .rows
            .iter()
            .all(|row| row.failure.is_none() && row.refine_steps.is_some() != row.propagation.contains("none"))
    );
    let mut folders: Vec<PathBuf> = Vec::new();
    for k in 1..=4 {
        let jobs = jobs(&spec);
        let path = folder.path().join(k.to_string());
        let part = JobFolder::create(&path, &JobList::of(&jobs)).expect("made");
        jobs.run(&jobs.shard(k, 4).expect("a shard"), Some(&part), &Silent, &mut quiet).expect("run");
        folders.insert(0, path);
    }
    let merged = merge_jobs(&folders, false).expect("complete");
    assert_eq!(figures(&merged), figures(&whole));
    // Without one of them it is not complete, which is an error or a note.
    let error = merge_jobs(&folders[..3], false).expect_err("incomplete").to_string();
    assert!(error.contains("are not finished") && error.contains("cylinder:600"), "{error}");
    let partial = merge_jobs(&folders[..3], true).expect("partial");
    assert!(partial.rows.len() < whole.rows.len() && partial.notes.iter().any(|note| note.contains("not finished")));
    // Parts of another sweep do not fit.
    let other = self::spec(&["cylinder:600"], &["10%"]);
    let path = folder.path().join("other");
    JobFolder::create(&path, &JobList::of(&jobs(&other))).expect("made");
    let error = merge_jobs(&[folders[0].clone(), path], true).expect_err("another").to_string();
    assert!(error.contains("different sweeps"), "{error}");
}

/// Files that are missing, cut short, of another job or no JSON at all are made again, those that are whole are not.
#[test]
fn a_sweep_that_was_broken_off_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let jobs = jobs(&spec(&["cylinder:600"], &["10%", "20%", "30%", "none"]));
    let files = JobFolder::create(folder.path(), &JobList::of(&jobs)).expect("made");
    let first = jobs.report(Some(&files), &Silent, &mut quiet).expect("a report");
    let path = |k: usize| folder.path().join(format!("{}.json", jobs.jobs[k].id));
    let text = fs::read_to_string(path(0)).expect("there");
    fs::write(path(0), &text[..text.len() / 2]).expect("cut");
    fs::remove_file(path(1)).expect("there");
    fs::copy(path(3), path(2)).expect("copied");
    let mut found = Vec::new();
    let mut note = |done: RowDone<'_>| found.push(done.found);
    let again = jobs.report(Some(&files), &Silent, &mut note).expect("a report");
    assert_eq!(found, [false, false, false, true]);
    assert_eq!(figures(&again), figures(&first));
    let all_found = jobs.report(Some(&files), &Silent, &mut |done| assert!(done.found)).expect("a report");
    assert_eq!(all_found, again, "times included");
    // Asked for more repeats, a row is timed again, and its figures stay.
    let mut spec = spec(&["cylinder:600"], &["10%", "20%", "30%", "none"]);
    spec.repeats = Some(3);
    let timed = self::jobs(&spec).report(Some(&files), &Silent, &mut |done| assert!(!done.found)).expect("a report");
    assert_eq!(figures(&timed), figures(&first));
    for row in &timed.rows {
        let times = &row.times;
        assert_eq!(times.repeats, 3);
        for time in
            [times.simplify_ms, times.bind_ms, times.prepare_ms, times.drag_ms, times.refine_ms].into_iter().flatten()
        {
            assert!(0.0 < time.min && time.min <= time.median && time.median <= time.max, "{time:?}");
        }
        assert!(times.drag_p95_ms >= times.drag_ms.map(|time| time.median));
    }
}

#[test]
fn what_cannot_be_swept_is_listed_and_the_rest_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let bad = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).expect("written");
        path.display().to_string()
    };
    let good = file(folder.path(), "good.obj", 16);
    let models = [
        folder.path().join("missing.obj").display().to_string(),
        folder.path().display().to_string(),
        bad("garbage.ply", "not a mesh"),
        bad("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        bad("one.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        "creature:1".to_owned(),
        "creature:many".to_owned(),
        good.clone(),
    ];
    let models: Vec<&str> = models.iter().map(String::as_str).collect();
    let report = jobs(&spec(&models, &["10%", "none"])).report(None, &Silent, &mut quiet).expect("a report");
    let refused: Vec<&str> = report.refused.iter().map(|refusal| refusal.model.as_str()).collect();
    assert_eq!(refused, models[..2]);
    assert_eq!(report.rows.len(), 2 * 6);
    let (fine, failed): (Vec<&SweepRow>, Vec<&SweepRow>) = report.rows.iter().partition(|row| row.failure.is_none());
    assert!(fine.iter().filter(|row| row.model == "good.obj").count() == 2, "{fine:?}");
    for row in &failed {
        let failure = row.failure.as_ref().expect("a failure");
        assert_eq!(failure.kind, FailureKind::Input, "{failure:?}");
        assert!(row.rms_relative.is_nan() && !failure.reason.is_empty());
    }
    for model in ["garbage.ply", "points.obj", "creature:1", "creature:many"] {
        assert_eq!(failed.iter().filter(|row| row.model == model).count(), 2, "{model}");
    }
    let text = report.to_markdown(pliant::Detail::Main);
    assert!(text.contains("missing.obj") && text.contains("garbage.ply"), "{text}");
}

/// Two files of one name are two models in the report.
#[test]
fn files_of_one_name_are_told_apart() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::create_dir(folder.path().join("b")).expect("made");
    let models = [file(folder.path(), "a.obj", 16), file(&folder.path().join("b"), "a.obj", 20)];
    let models: Vec<&str> = models.iter().map(String::as_str).collect();
    let report = jobs(&spec(&models, &["none"])).report(None, &Silent, &mut quiet).expect("a report");
    assert_eq!(report.models.len(), 2);
    assert!(report.rows[0].key() != report.rows[1].key());
}

#[test]
fn plans_are_read_from_toml_and_json_alike() {
    let toml = "models = [\"cylinder:500\"]\nsizes = [50, \"5%\", \"none\"]\niterations = [2, \"converged\"]\nrefine = 0\n\
                [[cases]]\nmodel = \"bar:500\"\nscenes = [\"bar-twist-135\", \"auto\"]\n";
    let json = r#"{"models": ["cylinder:500"], "sizes": [50, "5%", "none"], "iterations": [2, "converged"], "refine": 0,
                   "cases": [{"model": "bar:500", "scenes": ["bar-twist-135", "auto"]}]}"#;
    let plan = SweepSpec::parse(toml, "a.toml").expect("TOML");
    assert_eq!(plan, SweepSpec::parse(json, "a.json").expect("JSON"));
    // Three sizes, two schedules, three scenes in all.
    let planned = jobs(&plan);
    assert_eq!(planned.jobs.len(), 3 * 2 * 3);
    let again = SweepSpec::parse(&serde_json::to_string(&plan).expect("JSON"), "a.json").expect("own JSON");
    assert_eq!(again, plan);
    for (text, says) in [
        ("models = [\"bar:500\"]\nsizes = [\"x\"]", vec!["x", "cage size"]),
        ("models = [\"bar:500\"]\nmethods = [\"magic\"]", vec!["methods", "magic", "arap"]),
        ("models = [\"bar:500\"]\niterations = [-1]", vec!["iterations"]),
        ("models = [\"bar:500\"]\ncolour = 1", vec!["colour", "line 2"]),
        ("models = [\"bar:500\"", vec!["plan.toml", "line 1"]),
        ("models = [\"bar:500\"]\nsteps = 0", vec!["steps", "1 to"]),
        ("models = [\"bar:500\"]\nrepeats = 1000000", vec!["repeats"]),
        ("models = [\"bar:500\"]\nscenes = [\"nowhere\"]", vec!["nowhere"]),
        ("sizes = [\"5%\"]", vec!["no model"]),
    ] {
        let error = SweepSpec::parse(text, "plan.toml").and_then(|plan| plan.jobs()).expect_err(text).to_string();
        assert!(says.iter().all(|word| error.contains(word)), "{text}: {error}");
    }
}

#[test]
fn ranges_are_in_equal_ratios_with_both_ends() {
    let texts = |range: &str| -> Vec<String> {
        SweepSize::parse_range(range).expect(range).iter().map(ToString::to_string).collect()
    };
    assert_eq!(texts("5%"), ["5%"]);
    assert_eq!(texts("none"), ["none"]);
    assert_eq!(texts("1%..16%"), ["1%", "2%", "4%", "8%", "16%"]);
    assert_eq!(texts("100..6400:3"), ["100", "800", "6400"]);
    let wide = texts("1%..50%");
    let shares: Vec<f64> = wide.iter().map(|text| text.trim_end_matches('%').parse().expect("a number")).collect();
    assert_eq!((shares[0], shares[shares.len() - 1]), (1.0, 50.0));
    // None more than twice the one before; rounded to three digits.
    assert!(shares.windows(2).all(|pair| pair[1] > pair[0] && pair[1] < 2.01 * pair[0]), "{wide:?}");
    assert!(wide.iter().all(|text| text.trim_end_matches('%').replace('.', "").len() <= 3), "{wide:?}");
    for wrong in
        ["50%..1%", "1%..1%", "0%..5%", "1%..200", "1..", "..5%", "1%..5%:1", "1%..5%:x", "none..5%", "1%..5%:99999"]
    {
        assert!(SweepSize::parse_range(wrong).is_err(), "{wrong}");
    }
}

/// Decimated to all its vertices a shape is itself, so the row is that without a cage.
#[test]
fn a_decimated_mesh_of_all_vertices_is_the_shape() {
    let spec = spec(&["cylinder:600"], &["decimated:100%", "decimated:20%", "none"]);
    let report = jobs(&spec).report(None, &Silent, &mut quiet).expect("a report");
    let [all, some, none] = &report.rows[..] else { panic!("three rows") };
    assert_eq!((all.rms_relative, all.edge_max), (none.rms_relative, none.edge_max));
    assert_eq!(all.distance_to_converged, none.distance_to_converged);
    assert!(all.is_decimated() && some.is_decimated() && !none.is_decimated() && !some.is_direct());
    assert!(
        some.cage_vertices < none.cage_vertices / 4
            && some.times.propagate_ms.is_none()
            && some.times.bind_ms.is_none()
    );
    assert!(some.distance_to_converged.is_some_and(|d| d > 0.0 && d < 0.2));
}

/// More iterations leave less room for propagation; a start from coarser cages leaves more.
#[test]
fn equal_time_grows_with_the_cage_and_shrinks_with_iterations() {
    let size = |cage, iterations| equal_time_vertices(100_000, cage, iterations, false);
    assert!(size(1000, 2) > 1000 && size(2000, 2) == size(1000, 2) + 1000);
    assert!(size(1000, 20) < size(1000, 2) && size(1000, 1_000_000) == 1000);
    assert!(equal_time_vertices(100_000, 1000, 2, true) > size(1000, 2));
    assert_eq!(size(100_000, 2), 100_000);
}
