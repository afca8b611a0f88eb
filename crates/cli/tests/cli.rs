//! The command as a user meets it: what it prints, writes and refuses.

use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use pliant::Scene;
use serde_json::Value;

fn pliant(arguments: &[&str]) -> Output {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin!("pliant"));
    command.args(arguments).output().expect("runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// Standard output of a call that must succeed.
fn said(arguments: &[&str]) -> String {
    let output = pliant(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Standard error of a call that must be refused.
fn refused(arguments: &[&str]) -> String {
    let output = pliant(arguments);
    assert!(!output.status.success(), "{arguments:?} was accepted");
    text(&output.stderr)
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&said(arguments)).expect("one JSON value and nothing else")
}

fn path(folder: &tempfile::TempDir, name: &str) -> String {
    folder.path().join(name).display().to_string()
}

#[test]
fn demo_writes_what_it_names() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = path(&folder, "out");
    let printed = said(&["demo", "--vertices", "3000", "--out", &out]);
    assert!(!printed.contains('\u{1b}'), "control characters where there is no terminal");
    for part in ["before", "after"] {
        for (what, kind) in [("shape", "glb"), ("shape", "png"), ("cage", "glb"), ("cage", "png")] {
            let name = format!("{what}-{part}.{kind}");
            assert!(printed.contains(&name) && Path::new(&out).join(&name).exists(), "{name}");
        }
    }
    for name in ["sweep.md", "sweep.csv", "sweep.svg", "sweep.json", "demo.png"] {
        assert!(printed.contains(name) && Path::new(&out).join(name).exists(), "{name}");
    }
    for stage in ["make creature", "simplify", "bind", "prepare", "solve", "propagate", "write meshes", "draw"] {
        assert!(printed.contains(stage), "{stage}");
    }
    assert!(printed.contains("edit MODEL"), "names no next command");
    let before = json(&["info", &Path::new(&out).join("shape-before.glb").display().to_string(), "--json"]);
    assert_eq!(before["euler_characteristic"], 2);
    assert_eq!((&before["closed"], &before["manifold"]), (&Value::Bool(true), &Value::Bool(true)));
}

#[test]
fn edit_moves_what_the_scene_says_and_writes_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mesh, picture) = (path(&folder, "edited.ply"), path(&folder, "edited.png"));
    let row = json(&["edit", "creature:3000", "-o", &mesh, "--picture", &picture, "--json"]);
    assert_eq!(row["scene"], "creature");
    assert!(row["rms_relative"].as_f64().is_some_and(|e| e > 0.0 && e < 0.1), "{row}");
    assert!(Path::new(&picture).exists());
    let (rest, edited) = (json(&["info", "creature:3000", "--json"]), json(&["info", &mesh, "--json"]));
    assert_eq!(rest["vertices"], edited["vertices"]);
    assert_ne!(rest["size"], edited["size"]);
}

#[test]
fn the_same_file_for_any_number_of_threads() {
    let folder = tempfile::tempdir().expect("a folder");
    let files: Vec<Vec<u8>> = ["1", "2", "4"]
        .map(|threads| {
            let mesh = path(&folder, &format!("{threads}.obj"));
            let mut command = Command::new(assert_cmd::cargo::cargo_bin!("pliant"));
            command.env("RAYON_NUM_THREADS", threads).args(["edit", "creature:4000", "-o", &mesh]).assert().success();
            std::fs::read(&mesh).expect("written")
        })
        .into();
    assert!(files[0] == files[1] && files[0] == files[2]);
}

#[test]
fn a_cage_of_all_vertices_writes_the_file_of_no_cage() {
    let folder = tempfile::tempdir().expect("a folder");
    let files: Vec<Vec<u8>> = ["100%", "none"]
        .map(|cage| {
            let mesh = path(&folder, &format!("{cage}.obj"));
            said(&["edit", "creature:2500", "--cage", cage, "-o", &mesh]);
            std::fs::read(&mesh).expect("written")
        })
        .into();
    assert!(files[0] == files[1]);
}

#[test]
fn cage_and_sweep_print_tables_and_json() {
    let folder = tempfile::tempdir().expect("a folder");
    let cage = path(&folder, "cage.glb");
    let made = json(&["cage", "creature:3000", "--size", "200", "-o", &cage, "--json"]);
    assert_eq!((&made["cage_vertices"], &made["euler_characteristic"]), (&Value::from(200), &Value::from(2)));
    assert!(made["distance"]["rms"].as_f64().is_some_and(|d| d > 0.0 && d < 0.02), "{made}");

    let prefix = path(&folder, "report");
    let arguments = ["sweep", "creature:3000", "--sizes", "5%,none", "--iterations", "2,converged", "-o", &prefix];
    assert!(said(&arguments).contains("RMS relative"));
    for kind in ["json", "csv", "md", "svg"] {
        assert!(Path::new(&format!("{prefix}.{kind}")).exists(), "{kind}");
    }
    let rows = json(&["sweep", "creature:3000", "--sizes", "5%,none", "--json"])["rows"].clone();
    assert_eq!(rows.as_array().map(Vec::len), Some(2));
}

#[test]
fn the_papers_preset_runs_its_sizes_both_ways() {
    let report = json(&["sweep", "creature:2000", "--preset", "paper", "--json"]);
    let rows = report["rows"].as_array().expect("rows");
    // Four sizes of the smaller model, four ways, two schedules; and no cage twice.
    assert_eq!(rows.len(), 4 * 4 * 2 + 2);
    assert!(rows.iter().all(|r| r["steps"] == 20 && r["method"] == "arap:uniform+spokes"));
    assert!(!report["notes"].as_array().expect("notes").is_empty(), "the sizes are scaled and the scene is another");
}

/// Every scene made for a generated shape runs on it.
#[test]
fn the_classic_scenes_run_on_their_shapes() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = path(&folder, "out.ply");
    for name in Scene::builtin_names() {
        let Some(shape) = Scene::builtin(name).expect("built in").shape else { continue };
        let row = json(&["edit", &format!("{shape}:2000"), "--scene", name, "--cage", "25%", "-o", &out, "--json"]);
        assert_eq!(row["scene"], name);
        assert!(row["rms_relative"].as_f64().is_some_and(|error| error > 0.0 && error.is_finite()), "{row}");
    }
}

/// A typed method goes before the scene's, and that before the default.
#[test]
fn methods_are_typed_or_saved_in_scenes() {
    let folder = tempfile::tempdir().expect("a folder");
    let (out, file) = (path(&folder, "out.ply"), path(&folder, "scene.json"));
    let scene =
        Scene { method: Some("dual".parse().expect("a method")), ..Scene::builtin("creature").expect("built in") };
    std::fs::write(&file, scene.to_json().expect("finite")).expect("written");
    let edit = ["edit", "creature:2000", "--cage", "20%", "-o", &out, "--json"];
    assert_eq!(json(&edit)["method"], "arap");
    assert_eq!(json(&[&edit[..], &["--scene", &file]].concat())["method"], "dual");
    let typed = json(&[&edit[..], &["--scene", &file, "--method", "laplacian:two-step"]].concat());
    assert_eq!((&typed["method"], &typed["iterations"]), (&Value::from("laplacian:two-step"), &Value::Null));
    let swept = ["sweep", "creature:2000", "--sizes", "20%", "--methods", "arap,implicit", "--json"];
    let rows = json(&swept)["rows"].clone();
    assert_eq!((&rows[0]["method"], &rows[1]["method"]), (&Value::from("arap"), &Value::from("implicit")));
    assert!(rows[1]["distance_to_converged"].as_f64().is_some_and(|d| d > 0.0 && d < 0.1), "{rows}");
}

#[test]
fn compare_makes_a_table_and_a_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let prefix = path(&folder, "made/on the way/methods");
    let arguments = ["compare", "creature:2000", "--methods", "arap,implicit", "--steps", "2", "-o", &prefix];
    let printed = said(&arguments);
    for words in ["flipped faces", "volume change", "from converged ARAP", "solve Eq. 7"] {
        assert!(printed.contains(words), "{words}: {printed}");
    }
    for kind in ["json", "csv", "md", "png"] {
        assert!(Path::new(&format!("{prefix}.{kind}")).exists(), "{kind}");
    }
    let classic = path(&folder, "classic");
    let arguments = ["compare", "--classic", "--vertices", "2000", "--methods", "laplacian", "-o", &classic, "--json"];
    let report = json(&arguments);
    assert_eq!(report["cases"].as_array().map(Vec::len), Some(Scene::classic_names().count()));
}

/// Each refusal names what is wrong, and leaves nothing behind.
#[test]
fn refusals_name_the_culprit() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = path(&folder, "out.obj");
    let nowhere = path(&folder, "missing/out.obj");
    let model = path(&folder, "model.obj");
    std::fs::write(&model, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").expect("written");
    let scene = path(&folder, "scene.json");
    std::fs::write(&scene, "{ \"name\": \"s\", \"handles\": [ { \"nmae\": 1 } ] }").expect("written");
    for (arguments, words) in [
        (vec!["edit", "missing.obj", "-o", &out], vec!["missing.obj"]),
        (vec!["edit", &model, "-o", &out], vec!["model.obj:4", "9"]),
        (vec!["edit", "creature:10", "-o", &out], vec!["2000", "10"]),
        (vec!["edit", "creature:many", "-o", &out], vec!["creature:many"]),
        (vec!["edit", "plane:1", "-o", &out], vec!["40", "1"]),
        (vec!["edit", "creature:2000", "-o", &nowhere], vec!["missing"]),
        (vec!["edit", "creature:2000", "-o", "out.xyz"], vec![".xyz", "glb"]),
        (vec!["edit", "creature:2000", "--scene", &scene, "-o", &out], vec!["scene.json", "nmae"]),
        (vec!["edit", "creature:2000", "--scene", "nothing", "-o", &out], vec!["nothing", "creature"]),
        (vec!["edit", "creature:2000", "--cage", "-5", "-o", &out], vec!["-5"]),
        (vec!["edit", "creature:2000", "--prune", "local:0", "-o", &out], vec!["local:0", "neighbours"]),
        (vec!["cage", "creature:2000", "--size", "none", "-o", &out], vec!["none"]),
        (vec!["sweep", "creature:2000", "--iterations", "few"], vec!["few"]),
        (
            vec!["edit", "creature:2000", "--method", "magic", "-o", &out],
            vec!["magic", "arap", "dual", "rotation-invariant"],
        ),
        (vec!["sweep", "creature:2000", "--methods", "arap,laplacian:magic"], vec!["magic", "two-step"]),
        (vec!["compare", "-o", &out], vec!["MODEL"]),
        (vec!["bench", "creature:2000", "--cage", "none"], vec!["none", "bind"]),
        (vec!["bench", "creature:2000", "--threads", "0"], vec!["threads"]),
        (vec!["bench", "creature:2000", "--prune", "smooth:16+far"], vec!["far", "surface"]),
    ] {
        let error = refused(&arguments);
        for word in words {
            assert!(error.contains(word), "{arguments:?} said: {error}");
        }
        assert!(!Path::new(&out).exists());
    }
}

/// All figures are there under their names, and fit each other.
#[test]
fn bench_times_every_stage() {
    let keys = [
        "vertices",
        "cage_vertices",
        "threads",
        "read_ms",
        "simplify_ms",
        "bind_ms",
        "prepare_ms",
        "refactor_ms",
        "first_drag_ms",
        "drag_ms_median",
        "drag_ms_p99",
        "local_ms",
        "solve_ms",
        "propagate_ms",
        "propagate_bytes",
        "copy_ms",
    ];
    let figure = |timing: &Value, key: &str| timing[key].as_f64().unwrap_or_else(|| panic!("{key}: {timing}"));
    let timing = json(&["bench", "creature:2000", "--cage", "10%", "--threads", "1", "--repeats", "1", "--json"]);
    for key in keys {
        assert!(figure(&timing, key) > 0.0, "{key}");
    }
    for key in ["bind_exact_ms", "bind_magnitude_ms", "direct_prepare_ms", "direct_drag_ms"] {
        assert_eq!(timing.get(key), Some(&Value::Null), "{key}");
    }
    assert!(timing.get("peak_rss_bytes").is_some() && timing.get("cpu").is_some());
    // With one repeat each, these times are parts of that one.
    let parts: f64 = ["read_ms", "simplify_ms", "bind_ms", "prepare_ms"].iter().map(|key| figure(&timing, key)).sum();
    assert!(figure(&timing, "first_drag_ms") > parts);
    assert_eq!(figure(&timing, "threads"), 1.0);
    assert!(figure(&timing, "drag_ms_p99") >= figure(&timing, "drag_ms_median"));
    let more = ["--exact", "--direct", "--threads", "2", "--repeats", "2", "--json"];
    let more = json(&[&["bench", "creature:2000"][..], &more].concat());
    for key in ["bind_exact_ms", "bind_magnitude_ms", "direct_prepare_ms", "direct_drag_ms"] {
        assert!(figure(&more, key) > 0.0, "{key}");
    }
    assert_eq!(figure(&more, "threads"), 2.0);
    let text = said(&["bench", "creature:2000", "--repeats", "1", "--direct"]);
    for line in ["drag, median", "open to first drag", "drag without a cage"] {
        assert!(text.contains(line), "{line}: {text}");
    }
}

#[test]
fn the_model_itself_is_never_written_over() {
    let folder = tempfile::tempdir().expect("a folder");
    let model = path(&folder, "model.obj");
    said(&["cage", "creature:2000", "--size", "500", "-o", &model]);
    let before = std::fs::read(&model).expect("written");
    assert!(refused(&["edit", &model, "-o", &model]).contains("model itself"));
    assert!(std::fs::read(&model).expect("still there") == before);
}

#[test]
fn every_command_explains_itself() {
    assert!(said(&["--help"]).contains("pliant demo"));
    for command in ["demo", "info", "cage", "edit", "sweep", "compare", "bench"] {
        let help = said(&[command, "--help"]);
        assert!(help.contains("--json"), "{command}");
    }
}

/// A document of an editing session is done again: the file written has the editor's positions.
#[test]
fn edit_replays_documents() {
    use pliant::glam::DVec3;
    use pliant::{Editor, EditorOptions, Grip, Silent, VertexSet, creature, read};
    let folder = tempfile::tempdir().expect("a folder");
    let shape = creature(2000).expect("in range");
    let mut editor = Editor::open(shape.clone(), EditorOptions::default(), &Silent).expect("valid");
    let low = VertexSet::where_true(shape.vertex_count(), |v| shape.positions[v as usize].y < 0.2);
    editor.anchor(Grip::Vertices(low)).expect("valid");
    let top = (0..shape.vertex_count()).max_by(|&a, &b| shape.positions[a].y.total_cmp(&shape.positions[b].y));
    let top = top.expect("vertices");
    let spot = editor.grab(Grip::vertex(top as u32)).expect("valid");
    editor.drag_to(spot, shape.positions[top] + 0.1 * DVec3::X).expect("valid");
    editor.release("push the top").expect("solvable");
    let (document, output) = (path(&folder, "session.json"), path(&folder, "edited.ply"));
    editor.document("creature:2000").save(document.as_ref()).expect("writable");
    let result = json(&["edit", "creature:2000", "--document", &document, "-o", &output, "--json"]);
    assert_eq!(result["steps"], serde_json::json!(["push the top"]));
    let written = read(output.as_ref()).expect("own file").mesh;
    let off = written.positions.iter().zip(editor.positions()).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
    // A file of single precision.
    assert!(off < 1e-6, "{off:e}");
    let error = refused(&["edit", "creature:3000", "--document", &document, "-o", &output]);
    assert!(error.contains("another mesh"), "{error}");
}
