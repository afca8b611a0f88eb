//! The gate over whole edits: what is unchanged passes, a binding made worse on purpose does not.

use std::time::Duration;

use pliant::{
    Change, ChangeKind, FailureKind, GateError, GateReport, Places, Rerun, RerunOptions, Scene, Silent, SweepReport,
    SweepSpec, Tolerances, Verdict, compare_reports, creature, read_report, shapes, write,
};

/// Once each, and no second look: times have no say here.
const ONCE: RerunOptions = RerunOptions { repeats: Some(1), rounds: 1, retries: 0, pause: Duration::ZERO };

fn untimed() -> Tolerances {
    let mut tolerances = Tolerances::default();
    tolerances.leave_out_times();
    tolerances
}

fn swept(plan: &str) -> SweepReport {
    let jobs = SweepSpec::parse(plan, "plan.toml").and_then(|spec| spec.jobs()).expect("a plan");
    jobs.report(None, &Silent, &mut |_| {}).expect("kept nowhere")
}

fn checked(baseline: &SweepReport, places: &Places) -> GateReport {
    let rerun = Rerun::of_rows(baseline, places).expect("all is there");
    rerun.check(&untimed(), ONCE, &Silent, &mut |_| {}).expect("kept nowhere").gate
}

/// Every kind of row is made again from what the report says of it, to the same bits.
#[test]
fn every_kind_of_row_is_made_again() {
    let plan = "models = [\"creature:2000\", \"bar:600\"]\nscenes = [\"auto\"]\n\
        sizes = [\"10%\", \"150\", \"error:0.01\", \"none\", \"decimated:200\", \"equal-time:10%\"]\n\
        methods = [\"arap\", \"arap:uniform+spokes\", \"laplacian:two-step\", \"dual\"]\npropagation = [\"frames\", \"positions\"]\n\
        prune = [\"smooth:12+space\", \"magnitude:0.05\"]\niterations = [1, \"converged\"]\nsteps = 2\nstart = \"pose\"\nrefine = 1\n";
    let baseline = swept(plan);
    assert!(baseline.rows.len() > 100, "{}", baseline.rows.len());
    let gate = checked(&baseline, &Places::default());
    assert_eq!((gate.verdict, gate.rows.len()), (Verdict::Pass, baseline.rows.len()), "{}", gate.to_text());
    assert_eq!(gate.changes, [], "{}", gate.to_text());
    assert!(gate.figures > 15 * baseline.rows.len(), "{}", gate.figures);
}

/// Rows of the 3 % rule, made by one of 10 % that takes its name.
#[test]
fn a_binding_made_worse_fails_with_figure_row_and_values() {
    let plan = |prune: &str| {
        format!(
            "models = [\"creature:3000\"]\nsizes = [\"5%\", \"none\"]\npropagation = [\"positions\"]\nprune = [\"{prune}\"]\n\
             refine = 0\n"
        )
    };
    let baseline = swept(&plan("magnitude:0.03"));
    let mut worse = swept(&plan("magnitude:0.1"));
    worse.rows.iter_mut().filter(|row| !row.is_direct()).for_each(|row| row.prune = "magnitude:0.03".to_owned());
    let gate = compare_reports(&baseline, &worse, &untimed());
    assert_eq!(gate.verdict, Verdict::Regression);
    let of = |figure: &str| gate.changes.iter().find(|change| change.figure.as_deref() == Some(figure)).expect("moved");
    for figure in ["rms_relative", "rest_rms_relative", "rest_error_max"] {
        let Change { kind, old, new, .. } = of(figure);
        assert_eq!(*kind, ChangeKind::Worse, "{figure}");
        let cage = |report: &SweepReport| serde_json::to_value(&report.rows[0]).expect("JSON")[figure].as_f64();
        assert_eq!((*old, *new), (cage(&baseline), cage(&worse)), "{figure}");
    }
    assert_eq!(of("kept_mean").kind, ChangeKind::Different);
    let (old, new) = (1e2 * baseline.rows[0].rms_relative, 1e2 * worse.rows[0].rms_relative);
    let text = gate.to_text();
    assert!(text.contains(&format!("rms_relative {old:.2} % -> {new:.2} %")), "{text}");
    assert!(text.contains("creature:3000, scene creature, cage 5%, arap, positions, magnitude:0.03"), "{text}");
    assert!(gate.changes.iter().all(|change| !change.row.contains("no cage")), "{text}");
    // The other way round it is better, and passes.
    let gate = compare_reports(&worse, &baseline, &untimed());
    assert_eq!(gate.verdict, Verdict::Pass, "{}", gate.to_text());
    assert!(gate.changes.iter().any(|change| change.kind == ChangeKind::Better));
}

/// Files of models and scenes are found by their names, in the places that are told, or the reason is.
#[test]
fn models_and_scenes_are_found_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let (model, scene) = (folder.path().join("own.obj"), folder.path().join("nod.json"));
    write(&model, &creature(2000).expect("in range")).expect("written");
    let nod = Scene { name: "nod".to_owned(), ..Scene::builtin("creature").expect("built in") };
    std::fs::write(&scene, nod.to_json().expect("valid")).expect("written");
    let plan = format!(
        "models = [{model:?}]\nscenes = [{scene:?}]\nsizes = [\"10%\"]\nmethods = [\"arap\", \"implicit:gradients\"]\nrefine = 0\nreference = false\n"
    );
    let mut baseline = swept(&plan);
    assert_eq!((baseline.rows[0].model.as_str(), baseline.rows[0].scene.as_str()), ("own.obj", "nod"));
    // The second method refuses a scene that fixes nothing.
    assert_eq!(baseline.rows[1].failure.as_ref().map(|failure| failure.kind), Some(FailureKind::Input));
    let in_folder = Places { folders: vec![folder.path().to_owned()], ..Places::default() };
    let named = Places { models: vec![model.clone()], scenes: vec![scene.clone()], ..Places::default() };
    for places in [&in_folder, &named] {
        let gate = checked(&baseline, places);
        assert_eq!((gate.verdict, &gate.changes[..]), (Verdict::Pass, &[][..]), "{}", gate.to_text());
        assert!(gate.notes.iter().any(|note| note.contains("as in the baseline")), "{:?}", gate.notes);
    }
    // A row that had figures and has none now.
    let small = baseline.rows[1].clone();
    baseline.rows[1] = pliant::SweepRow { failure: None, ..small };
    let gate = checked(&baseline, &in_folder);
    assert_eq!((gate.verdict, gate.changes[0].kind), (Verdict::Regression, ChangeKind::Failed), "{}", gate.to_text());
    // The model has become another.
    write(&model, &shapes::by_name("bar", 900).expect("in range")).expect("written");
    baseline.rows.truncate(1);
    let gate = checked(&baseline, &in_folder);
    assert_eq!(gate.changes[0].kind, ChangeKind::OtherModel, "{}", gate.to_text());
    let refused = |places: &Places| Rerun::of_rows(&baseline, places).expect_err("refused").to_string();
    assert!(refused(&Places::default()).contains("own.obj"));
    let no_scene = Places { models: vec![model.clone()], ..Places::default() };
    assert!(refused(&no_scene).contains("nod"), "{}", refused(&no_scene));
    std::fs::write(&model, "v 0 0 0\nf 1 2 3\n").expect("written");
    assert!(refused(&in_folder).contains("own.obj:2"), "{}", refused(&in_folder));
}

#[test]
fn rows_that_cannot_be_asked_for_are_refused() {
    let baseline = swept("models = [\"bar:600\"]\nsizes = [\"20%\"]\nrefine = 0\nreference = false\n");
    type Spoil = fn(&mut pliant::SweepRow);
    let spoil: [Spoil; 8] = [
        |row| row.cage_asked = "few".to_owned(),
        |row| row.method = "magic".to_owned(),
        |row| row.prune = "magnitude:x".to_owned(),
        |row| row.propagation = "hope".to_owned(),
        |row| row.start = "anywhere".to_owned(),
        |row| row.iterations = Some(usize::MAX),
        |row| row.steps = usize::MAX,
        |row| row.cage_asked = " 5%".to_owned(),
    ];
    for spoil in spoil {
        let mut spoilt = baseline.clone();
        spoil(&mut spoilt.rows[0]);
        let error = Rerun::of_rows(&spoilt, &Places::default()).expect_err("refused");
        assert!(matches!(error, GateError::Row { .. }), "{error}");
        assert!(error.to_string().contains("bar:600"), "{error}");
    }
}

/// The project's own baseline is a report of the rows that its plan asks for.
#[test]
fn the_projects_own_baseline_is_of_its_plan() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/data/gate");
    let baseline = read_report(format!("{folder}/baseline.json").as_ref()).expect("a report");
    let plan = SweepSpec::read(format!("{folder}/plan.toml").as_ref()).expect("a plan");
    let jobs = plan.jobs().expect("models that are generated").entries();
    let rows: Vec<String> = baseline.rows.iter().map(|row| row.key().setting()).collect();
    assert_eq!(rows, jobs.iter().map(|job| job.asked.clone()).collect::<Vec<_>>());
    assert_eq!(baseline.failures().count(), 0);
    assert_eq!(baseline.clone().into_baseline(true), baseline, "not as --update writes it");
}
