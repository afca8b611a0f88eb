//! What an editor promises, whatever is done with it.

use std::time::Duration;

use glam::DVec3;
use pliant_cage::{CageSize, SavedCage};
use pliant_deform::arap::Arap;
use pliant_deform::{Acceleration, ArapOptions, Constraint, Deformer, Goals, Handle, Region};
use pliant_mesh::{Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Autosave, Document, Editor, EditorOptions, Grip, SessionError, SurfacePoint};

fn bar() -> TriMesh {
    shapes::bar(40, 6, 6, DVec3::new(6.0, 0.9, 0.9)).expect("valid")
}

fn options() -> EditorOptions {
    EditorOptions { cage: CageSize::Fraction(0.1), ..EditorOptions::default() }
}

fn open(shape: &TriMesh) -> Editor {
    Editor::open(shape.clone(), options(), &Silent).expect("valid")
}

fn where_x(mesh: &TriMesh, inside: impl Fn(f64) -> bool) -> VertexSet {
    VertexSet::where_true(mesh.vertex_count(), |v| inside(mesh.positions[v as usize].x))
}

fn low(mesh: &TriMesh) -> Grip {
    Grip::Vertices(where_x(mesh, |x| x < -2.8))
}

fn high(mesh: &TriMesh) -> Grip {
    Grip::Vertices(where_x(mesh, |x| x > 2.8))
}

fn turn() -> Similarity {
    Similarity { translation: DVec3::new(-1.0, 1.5, 0.2), ..Similarity::about(DVec3::ZERO, DVec3::Z, 0.7, 1.0) }
}

fn bits(positions: &[DVec3]) -> Vec<[u64; 3]> {
    positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

#[test]
fn hard_handles_land_exactly_and_the_rest_stays_whole() {
    let shape = bar();
    let mut editor = open(&shape);
    editor.anchor(low(&shape)).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    editor.drag(handle, turn()).expect("a similarity");
    for _ in 0..3 {
        editor.update(Duration::ZERO).expect("solvable");
        for v in where_x(&shape, |x| x > 2.8).iter().map(|v| v as usize) {
            assert_eq!(editor.positions()[v], turn().apply(shape.positions[v]));
        }
    }
    let released = editor.release("bend").expect("solvable");
    assert!(released.solves > 1 && released.changed == (0..shape.vertex_count()));
    // A bend by 40 degrees over four lengths of the bar's width: no edge doubles or halves.
    for &[a, b] in shape.topology().edges() {
        let [a, b] = [a as usize, b as usize];
        let ratio =
            editor.positions()[a].distance(editor.positions()[b]) / shape.positions[a].distance(shape.positions[b]);
        assert!(ratio > 0.5 && ratio < 2.0, "{ratio}");
    }
    assert!(editor.handles().iter().all(|h| h.goal == Similarity::IDENTITY));
}

/// One vertex that the cage does not have, a point inside a face, and a thousand single vertices at once.
#[test]
fn handles_need_no_cage_vertices() {
    let shape = shapes::icosphere(4);
    let mut editor = open(&shape);
    let saved = editor.saved_cage();
    let origin = &saved.simplified.as_ref().expect("made of the shape").1.origin;
    let lost = (0..shape.vertex_count() as u32).find(|v| !origin.contains(v)).expect("most are lost");
    let far = |mesh: &TriMesh, from: DVec3| {
        VertexSet::where_true(mesh.vertex_count(), |v| mesh.positions[v as usize].dot(from) < -0.5)
    };
    let at = shape.positions[lost as usize];
    editor.anchor(Grip::Vertices(far(&shape, at))).expect("valid");
    let handle = editor.grab(Grip::vertex(lost)).expect("valid");
    editor.drag_to(handle, 1.4 * at).expect("valid");
    let released = editor.release("pull a vertex").expect("solvable");
    assert!(editor.positions()[lost as usize].distance(1.4 * at) < 1e-12);
    // The cage went there by itself, but for what its frames turned in the last solves.
    assert!(released.snapped < 0.05, "{}", released.snapped);

    let mut editor = open(&shape);
    let point = SurfacePoint { face: 17, barycentric: [0.2, 0.5, 0.3] };
    let place = |positions: &[DVec3]| {
        let corners = shape.triangles()[17];
        (0..3).map(|k| point.barycentric[k] * positions[corners[k] as usize]).sum::<DVec3>()
    };
    let before = place(&shape.positions);
    editor.anchor(Grip::Vertices(far(&shape, before))).expect("valid");
    let handle = editor.grab(Grip::Point(point)).expect("valid");
    editor.drag_to(handle, 1.3 * before).expect("valid");
    editor.release("pull a point").expect("solvable");
    assert!(place(editor.positions()).distance(1.3 * before) < 1e-12);
}

#[test]
fn outside_the_region_nothing_moves() {
    let shape = bar();
    let mut editor = open(&shape);
    let region = where_x(&shape, |x| x > 0.5);
    editor.set_region(Some(region.clone())).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    editor.drag(handle, turn()).expect("a similarity");
    let update = editor.release("bend one half").expect("solvable");
    for v in 0..shape.vertex_count() {
        if !region.contains(v as u32) {
            assert_eq!(bits(&editor.positions()[v..=v]), bits(&shape.positions[v..=v]));
        }
    }
    let moved = (0..shape.vertex_count()).filter(|&v| editor.positions()[v] != shape.positions[v]);
    assert!(moved.clone().count() > 100 && moved.clone().all(|v| update.changed.contains(&v)));
}

#[test]
fn two_edits_and_two_undos_give_back_the_bits() {
    let shape = shapes::creature(2000).expect("valid");
    let mut editor = open(&shape);
    let bounds = shape.bounds();
    let part = |low: bool| {
        Grip::Vertices(VertexSet::where_true(shape.vertex_count(), |v| {
            let y = bounds.to_box(shape.positions[v as usize]).y;
            if low { y < 0.15 } else { y > 0.85 }
        }))
    };
    let [held, moved] = [part(true), part(false)].map(|grip| editor.grab(grip).expect("valid"));
    editor.drag(moved, Similarity::about(bounds.centre(), DVec3::Z, 0.5, 1.0)).expect("valid");
    editor.release("first").expect("solvable");
    let first = bits(editor.positions());
    editor.drag(held, Similarity::translation(DVec3::X * 0.1 * bounds.diagonal())).expect("valid");
    editor.release("second").expect("solvable");
    let second = bits(editor.positions());
    assert!(editor.undo() && bits(editor.positions()) == first);
    assert!(editor.undo() && bits(editor.positions()) == bits(&shape.positions));
    assert!(!editor.undo());
    assert!(editor.redo() && editor.redo() && !editor.redo());
    assert!(bits(editor.positions()) == second);
}

#[test]
fn strokes_are_one_step() {
    let shape = bar();
    let mut editor = open(&shape);
    editor.anchor(low(&shape)).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    for _ in 0..3 {
        editor.drag(handle, Similarity::translation(DVec3::Y * 0.2)).expect("valid");
        editor.release_on("lift").expect("solvable");
    }
    assert_eq!(editor.undo_depth(), (1, 0));
    let lifted = bits(editor.positions());
    assert!(editor.undo() && bits(editor.positions()) == bits(&shape.positions));
    assert!(editor.redo() && bits(editor.positions()) == lifted);
    let again = Editor::replay(&editor.document("bar"), shape.clone(), &Silent).expect("same mesh");
    assert!(bits(again.positions()) == lifted && again.undo_depth() == (1, 0));
}

#[test]
fn a_failed_transaction_leaves_no_trace() {
    let shape = bar();
    let mut editor = open(&shape);
    editor.anchor(low(&shape)).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    editor.drag(handle, turn()).expect("valid");
    editor.release("kept").expect("solvable");
    editor.undo();
    let (before, document) = (bits(editor.positions()), editor.document("bar"));
    let failed = editor.transaction(|editor| {
        editor.drag(handle, Similarity::translation(DVec3::X))?;
        editor.release("lost")?;
        editor.grab(Grip::vertex(u32::MAX))
    });
    assert!(matches!(failed, Err(SessionError::BadGrip { .. })));
    assert!(bits(editor.positions()) == before && editor.document("bar") == document);
    assert_eq!((editor.handles().len(), editor.undo_depth()), (2, (0, 1)));
    assert!(editor.redo());
    // A goal out of reach is refused by the solver, and what is shown stays.
    editor.drag(handle, Similarity::translation(DVec3::X * 1e300)).expect("finite");
    let shown = bits(editor.positions());
    assert!(editor.update(Duration::ZERO).is_err() && editor.release("far").is_err());
    assert!(bits(editor.positions()) == shown);
}

#[test]
fn saved_cages_open_to_the_same_editor() {
    let shape = bar();
    let mut first = open(&shape);
    let bytes = first.saved_cage().to_bytes().expect("small");
    let saved = SavedCage::from_bytes(&bytes, &shape).expect("own");
    let mut second = Editor::open_saved(shape.clone(), saved, EditorOptions::default(), &Silent).expect("valid");
    for editor in [&mut first, &mut second] {
        editor.anchor(low(&shape)).expect("valid");
        let handle = editor.grab(high(&shape)).expect("valid");
        editor.drag(handle, turn()).expect("valid");
        editor.release("bend").expect("solvable");
    }
    assert!(bits(first.positions()) == bits(second.positions()));
    assert!(SavedCage::from_bytes(&bytes, &shapes::icosphere(2)).is_err());
}

#[test]
fn bad_grips_and_documents_are_refused_by_name() {
    let shape = bar();
    let mut editor = open(&shape);
    let n = shape.vertex_count() as u32;
    for grip in [
        Grip::Vertices(VertexSet::default()),
        Grip::vertex(n),
        Grip::Point(SurfacePoint { face: u32::MAX, barycentric: [1.0, 0.0, 0.0] }),
        Grip::Point(SurfacePoint { face: 0, barycentric: [f64::NAN, 0.5, 0.5] }),
        Grip::Point(SurfacePoint { face: 0, barycentric: [2.0, -0.5, -0.5] }),
    ] {
        assert!(matches!(editor.grab(grip), Err(SessionError::BadGrip { .. })));
    }
    assert!(matches!(editor.update(Duration::ZERO), Err(SessionError::NothingGrabbed)));
    assert!(matches!(editor.drag(3, Similarity::IDENTITY), Err(SessionError::NoHandle { handle: 3 })));

    let handle = editor.grab(high(&shape)).expect("valid");
    editor.anchor(low(&shape)).expect("valid");
    let middle = where_x(&shape, |x| x.abs() < 0.1);
    editor.add_handle(Grip::Vertices(middle), Constraint::Soft(1.0)).expect("valid");
    editor.drag(handle, turn()).expect("valid");
    editor.release("bend").expect("solvable");
    let document = editor.document("bar");
    let json = document.to_json().expect("finite");
    assert_eq!(Document::parse(json.as_bytes()).expect("own").to_json().expect("finite"), json);
    let refused = |json: &str, shape: &TriMesh| {
        let made =
            Document::parse(json.as_bytes()).and_then(|d| Editor::replay(&d, shape.clone(), &Silent).map(|_| ()));
        made.expect_err("refused").to_string()
    };
    assert!(refused(&json, &shapes::icosphere(3)).contains("another mesh"));
    assert!(refused(&json.replace("\"version\": 1", "\"version\": 9"), &shape).contains("version 9"));
    assert!(refused(&json[..json.len() / 2], &shape).contains("line"));
    assert!(refused(&json.replace("\"undone\": 0", "\"undone\": 7"), &shape).contains('7'));
    let mut bad = document.clone();
    bad.steps[0].handles[0].scale = -1.0;
    assert!(refused(&bad.to_json().expect("finite"), &shape).contains("step 1"));
    let mut bad = document.clone();
    bad.steps[0].handles[0].vertices = Some(pliant_session::Ranges(vec![[0, u32::MAX]]));
    assert!(refused(&bad.to_json().expect("finite"), &shape).contains("step 1"));
    let mut bad = document;
    bad.steps[0].handles[0].point = Some(SurfacePoint { face: 0, barycentric: [1.0, 0.0, 0.0] });
    assert!(refused(&bad.to_json().expect("finite"), &shape).contains("not both"));
}

#[test]
fn autosaves_write_what_has_changed_and_whole() {
    let shape = bar();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.json");
    let mut editor = open(&shape);
    let mut autosave = Autosave::new(&path, Duration::ZERO);
    assert!(autosave.tick(&editor, "bar").expect("writable"));
    assert!(!autosave.tick(&editor, "bar").expect("writable"), "nothing has changed");
    editor.anchor(low(&shape)).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    editor.drag(handle, turn()).expect("valid");
    editor.release("bend").expect("solvable");
    assert_eq!(editor.steps()[0].name, "bend");
    assert!(autosave.tick(&editor, "bar").expect("writable"));
    assert_eq!(Document::load(&path).expect("own"), editor.document("bar"));
    assert!(!Autosave::new(&path, Duration::from_secs(3600)).tick(&editor, "bar").expect("not yet"));
    // Into nowhere: an error, and the editor goes on.
    assert!(Autosave::new(folder.path().join("no/where.json"), Duration::ZERO).tick(&editor, "bar").is_err());
    assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 1);
}

/// Refined within steps that can be stopped anywhere, undone as one, and replayed to the same bits.
#[test]
fn refining_lowers_the_energy_to_that_of_a_direct_solve() {
    let shape = bar();
    let mut editor = open(&shape);
    assert!(matches!(editor.refine(Duration::ZERO), Err(SessionError::NothingToRefine)));
    editor.anchor(low(&shape)).expect("valid");
    let handle = editor.grab(high(&shape)).expect("valid");
    editor.drag(handle, turn()).expect("valid");
    editor.release("bend").expect("solvable");
    let first = editor.refine(Duration::ZERO).expect("just released");
    assert!(first.steps == 1 && first.energy[1] < first.energy[0] && !first.settled);
    let mut told = Vec::new();
    let mut last = editor
        .refine_with(|report| {
            told.push(*report);
            told.len() < 3
        })
        .expect("still the last step");
    assert_eq!(told.iter().map(|report| report.steps).collect::<Vec<_>>(), [2, 3, 4]);
    assert!(told.windows(2).all(|pair| pair[1].energy <= pair[0].energy));
    assert_eq!((told[2].energy, told[2].rms_relative), (last.energy[1], last.rms_relative));
    while !last.settled {
        let next = editor.refine(Duration::from_millis(5)).expect("still the last step");
        assert!(next.energy[0] == last.energy[1] && next.energy[1] <= next.energy[0]);
        last = next;
    }
    for v in where_x(&shape, |x| x > 2.8).iter().map(|v| v as usize) {
        assert!(editor.positions()[v].distance(turn().apply(shape.positions[v])) < 1e-12);
    }
    // The same minimum as without a cage.
    let n = shape.vertex_count();
    let handles = [where_x(&shape, |x| x < -2.8), where_x(&shape, |x| x > 2.8)].map(Handle::hard);
    let region = Region::new(n, &VertexSet::all(n), &handles).expect("valid");
    let options = ArapOptions { acceleration: Acceleration::Anderson { window: 5 }, ..ArapOptions::converged() };
    let mut direct = Arap::prepare(&options, &shape, &region).expect("valid");
    let goals = Goals::new(vec![Similarity::IDENTITY, turn()]);
    let mut pose = editor.positions().to_vec();
    direct.solve(&goals, &mut pose).expect("solvable");
    let minimum = direct.energy(&goals, &pose).expect("valid");
    let refined = direct.energy(&goals, editor.positions()).expect("valid");
    assert!(refined <= 1.01 * minimum, "{refined:e} against {minimum:e}");

    let refined = bits(editor.positions());
    let again = Editor::replay(&editor.document("bar"), shape.clone(), &Silent).expect("same mesh");
    assert!(bits(again.positions()) == refined);
    assert!(editor.undo() && bits(editor.positions()) == bits(&shape.positions) && editor.undo_depth() == (0, 1));
    assert!(editor.redo() && bits(editor.positions()) == refined);
    assert!(editor.refine(Duration::ZERO).is_err());
}

/// A single handle without a cage vertex takes all of the shape along.
#[test]
fn one_handle_translates_the_whole() {
    let shape = bar();
    let mut editor = open(&shape);
    let saved = editor.saved_cage();
    let origin = &saved.simplified.as_ref().expect("made of the shape").1.origin;
    let lost = (0..shape.vertex_count() as u32).find(|v| !origin.contains(v)).expect("most are lost");
    let handle = editor.grab(Grip::vertex(lost)).expect("valid");
    editor.drag(handle, Similarity::translation(DVec3::X)).expect("valid");
    editor.release("away").expect("solvable");
    for (p, x) in editor.positions().iter().zip(&shape.positions) {
        assert!(p.distance(*x + DVec3::X) < 1e-6, "{p} from {x}");
    }
}

/// Hundreds of handles, each a vertex with a goal of its own on a smooth motion: the shape follows the motion in between.
#[test]
fn many_handles_follow_a_smooth_motion() {
    let shape = shapes::icosphere(4);
    let mut editor = open(&shape);
    let motion = |p: DVec3| p + 0.1 * DVec3::new((2.0 * p.y).sin(), 0.0, (2.0 * p.x).cos());
    let held: Vec<u32> = (0..shape.vertex_count() as u32).step_by(4).collect();
    for &v in &held {
        let handle = editor.grab(Grip::vertex(v)).expect("valid");
        editor.drag_to(handle, motion(shape.positions[v as usize])).expect("valid");
    }
    editor.release("wave").expect("solvable");
    for &v in &held {
        assert!(editor.positions()[v as usize].distance(motion(shape.positions[v as usize])) < 1e-12);
    }
    // Between handles an edge or two apart the motion bends by a few hundredths of an edge.
    let off = editor.positions().iter().zip(&shape.positions).map(|(p, x)| p.distance(motion(*x))).fold(0.0, f64::max);
    assert!(off < 0.02, "{off}");
}

/// Every method moves the shape, and the implicit one previews what its release then frees of shear.
#[test]
fn every_method_edits() {
    let shape = bar();
    let methods = ["laplacian", "laplacian:two-step", "implicit", "dual", "rotation-invariant", "arap:propagated"];
    for method in methods {
        let options = EditorOptions { method: method.parse().expect("a method"), ..options() };
        let mut editor = Editor::open(shape.clone(), options, &Silent).expect("valid");
        editor.anchor(low(&shape)).expect("valid");
        let handle = editor.grab(high(&shape)).expect("valid");
        editor.drag(handle, turn()).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        let preview = editor.positions().to_vec();
        editor.release("bend").expect("solvable");
        for v in where_x(&shape, |x| x > 2.8).iter().map(|v| v as usize) {
            assert_eq!(editor.positions()[v], turn().apply(shape.positions[v]), "{method}");
        }
        let off = preview.iter().zip(editor.positions()).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        // One solve is the whole answer of the others, which do not look at the pose they start from.
        assert_eq!(off > 1e-6, ["implicit", "dual"].contains(&method), "{method}: {off:e}");
    }
}
