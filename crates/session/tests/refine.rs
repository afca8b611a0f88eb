//! What a refinement through coarser levels promises, wherever it is stopped.

use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;
use pliant_cage::{CageError, CageSize};
use pliant_deform::{Constraint, StepKind};
use pliant_mesh::{Cancellable, Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Editor, EditorOptions, Grip, RefineReport, Refinement, SessionError, SurfacePoint};

fn options(levels: bool) -> EditorOptions {
    EditorOptions {
        cage: CageSize::Fraction(0.02),
        levels_from: levels.then_some(0),
        release_solves: 3,
        ..EditorOptions::default()
    }
}

fn meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("bar", shapes::bar(120, 12, 12, DVec3::new(6.0, 0.7, 0.7)).expect("valid")),
        ("bumpy plane", shapes::bumpy_plane(80, 60, 3.0, 2.0, 0.1, 3).expect("valid")),
        ("creature", shapes::creature(6000).expect("valid")),
    ]
}

/// Vertices whose place along the longest axis is between shares of the bounds.
fn between(mesh: &TriMesh, low: f64, high: f64) -> VertexSet {
    let bounds = mesh.bounds();
    let axis = bounds.size().max_position();
    VertexSet::where_true(mesh.vertex_count(), |v| {
        let at = bounds.to_box(mesh.positions[v as usize])[axis];
        at >= low && at <= high
    })
}

fn turn(mesh: &TriMesh, degrees: f64) -> Similarity {
    Similarity::about(mesh.bounds().centre(), DVec3::new(0.2, 0.3, 1.0), degrees.to_radians(), 1.0)
}

/// An editor whose last step turned one end.
fn released(mesh: &TriMesh, options: EditorOptions) -> Editor {
    let mut editor = Editor::open(mesh.clone(), options, &Silent).expect("valid");
    editor.anchor(Grip::Vertices(between(mesh, 0.0, 0.1))).expect("valid");
    let handle = editor.grab(Grip::Vertices(between(mesh, 0.9, 1.0))).expect("valid");
    editor.drag(handle, turn(mesh, 50.0)).expect("valid");
    editor.release("turn").expect("solvable");
    editor
}

/// So many steps at most.
fn steps(editor: &mut Editor, count: usize) -> (Refinement, Vec<RefineReport>) {
    let mut reports = Vec::new();
    let refinement = editor.refine_with(|report| {
        reports.push(*report);
        reports.len() < count
    });
    (refinement.expect("just released"), reports)
}

fn bits(positions: &[DVec3]) -> Vec<[u64; 3]> {
    positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

/// The energy after so many steps on the shape.
fn after(reports: &[RefineReport], count: usize) -> f64 {
    reports.iter().filter(|r| r.level == 0).take(count).last().expect("steps on the shape").energy
}

/// The levels take the shape nearer to its minimum than as many steps on the shape alone do, and it is the same minimum in the end.
#[test]
fn the_shape_starts_near_its_minimum() {
    for (name, mesh) in meshes() {
        let (mut with, mut alone) = (released(&mesh, options(true)), released(&mesh, options(false)));
        let mut sizes: Vec<usize> = with.prepare_levels(&Silent).expect("valid").sizes().collect();
        assert_eq!(sizes.len(), 2, "{name}: {sizes:?}");
        sizes.insert(0, mesh.vertex_count());

        let (converged, other) = steps(&mut alone, 10_000);
        assert!(converged.settled && other.iter().all(|r| r.level == 0 && r.vertices == mesh.vertex_count()));
        let minimum = converged.energy[1];

        let mut reports: Vec<RefineReport> = Vec::new();
        let (mut energy, mut settled) = (converged.energy[0], false);
        while !settled {
            let (done, report) = steps(&mut with, 1);
            // The energy of the shape never rises, and on a mesh its own does not.
            assert!(done.steps == 1 && done.energy[0] == energy && done.energy[1] <= energy, "{name}");
            if let Some(before) = reports.last() {
                assert!(report[0].level < before.level || report[0].energy <= before.energy, "{name}");
                assert!(report[0].level <= before.level && report[0].steps == before.steps + 1, "{name}");
            }
            assert_eq!((report[0].vertices, report[0].kind), (sizes[report[0].level], StepKind::Full), "{name}");
            (energy, settled) = (done.energy[1], done.settled);
            reports.extend(report);
        }
        assert!((0..3).all(|level| reports.iter().any(|r| r.level == level)), "{name}");
        assert!(energy < 1.001 * minimum, "{name}: {}", energy / minimum);
        for count in 1..=12 {
            let [with, alone] = [&reports, &other].map(|reports| after(reports, count) / minimum - 1.0);
            // Measured: 0.02 to 0.6.
            assert!(with < 0.75 * alone, "{name}, {count} steps: {with} above the minimum, {alone} without levels");
        }
    }
}

/// However many steps are done in one go, the bits are those of as many done one by one, also in a replay; at any stop handles are at
/// their goals, nothing has moved outside of the region, and one undo takes all of it back.
#[test]
fn it_can_be_stopped_anywhere() {
    let mesh = shapes::creature(4000).expect("valid");
    let region = between(&mesh, 0.05, 1.0);
    let editor = || {
        let mut editor = Editor::open(mesh.clone(), options(true), &Silent).expect("valid");
        editor.set_region(Some(region.clone())).expect("valid");
        let handle = editor.grab(Grip::Vertices(between(&mesh, 0.9, 1.0))).expect("valid");
        editor.add_handle(Grip::Vertices(between(&mesh, 0.5, 0.55)), Constraint::Soft(0.1)).expect("valid");
        editor.drag(handle, turn(&mesh, 40.0)).expect("valid");
        editor.release("turn").expect("solvable");
        editor
    };
    let (mut stopped, mut levels, mut shapes) = (editor(), Vec::new(), Vec::new());
    let first = bits(stopped.positions());
    while levels.iter().filter(|level| **level == 0).count() < 4 {
        let (_, report) = steps(&mut stopped, 1);
        levels.push(report[0].level);
        shapes.push(bits(stopped.positions()));
        for (v, (p, x)) in stopped.positions().iter().zip(&mesh.positions).enumerate() {
            assert!(region.contains(v as u32) || p.to_array().map(f64::to_bits) == x.to_array().map(f64::to_bits));
        }
        for v in between(&mesh, 0.9, 1.0).iter().map(|v| v as usize) {
            assert_eq!(stopped.positions()[v], turn(&mesh, 40.0).apply(mesh.positions[v]));
        }
    }
    // A level shows once it has ended, and no sooner.
    for (k, pair) in shapes.windows(2).enumerate() {
        let [before, at] = [levels[k], levels[k + 1]];
        let ended = levels.get(k + 2).is_some_and(|next| *next < at);
        assert!(at == 0 || ended || pair[0] == pair[1], "step {} on level {at} after {before}", k + 2);
    }
    assert!(shapes.iter().filter(|shape| **shape == first).count() < levels.iter().filter(|l| **l > 0).count());
    let end_of = |level: usize| levels.iter().rposition(|l| *l == level).expect("all levels are gone through") + 1;
    let total = levels.len();
    for count in [1, end_of(2) - 1, end_of(2), end_of(2) + 2, end_of(1), end_of(1) + 1, total] {
        let mut at_once = editor();
        let (done, _) = steps(&mut at_once, count);
        assert!(done.steps as usize == count && bits(at_once.positions()) == shapes[count - 1], "{count} steps");
        let again = Editor::replay(&at_once.document("creature"), mesh.clone(), &Silent).expect("same mesh");
        assert!(bits(again.positions()) == shapes[count - 1], "{count} steps replayed");
        assert!(at_once.undo() && bits(at_once.positions()) == bits(&mesh.positions) && !at_once.undo());
        assert!(at_once.redo() && bits(at_once.positions()) == shapes[count - 1]);
        assert!(matches!(at_once.refine_with(|_| true), Err(SessionError::NothingToRefine)));
    }
}

#[test]
fn threads_do_not_change_bits() {
    let mesh = shapes::creature(4000).expect("valid");
    let refined = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut editor = released(&mesh, options(true));
            let (_, reports) = steps(&mut editor, 60);
            assert_eq!(reports.last().expect("steps").level, 0);
            bits(editor.positions())
        })
    };
    let one = refined(1);
    assert!(refined(2) == one && refined(5) == one);
}

/// A point within a face has no vertex on any level, and still takes the levels along; a step that begins where another ended rests there.
#[test]
fn points_and_later_steps_are_refined_as_well() {
    let mesh = shapes::creature(6000).expect("valid");
    let bounds = mesh.bounds();
    let tip = between(&mesh, 0.97, 1.0).iter().next().expect("a vertex");
    let face = mesh.triangles().iter().position(|t| t.contains(&tip)).expect("it has faces");
    let point = SurfacePoint { face: face as u32, barycentric: [0.3, 0.3, 0.4] };
    let place = |positions: &[DVec3]| {
        let corners = mesh.triangles()[face];
        (0..3).map(|k| point.barycentric[k] * positions[corners[k] as usize]).sum::<DVec3>()
    };
    let edited = |levels: bool| {
        let mut editor = released(&mesh, options(levels));
        editor.refine_with(|_| true).expect("just released");
        let end = editor.handles()[1].id;
        editor.remove_handle(end).expect("there");
        let handle = editor.grab(Grip::Point(point)).expect("valid");
        let goal = place(editor.positions()) + 0.2 * bounds.diagonal() * DVec3::new(0.3, 1.0, 0.2);
        editor.drag_to(handle, goal).expect("valid");
        editor.release("pull a point").expect("solvable");
        let (done, reports) = steps(&mut editor, 10_000);
        assert!(place(editor.positions()).distance(goal) < 1e-9 * bounds.diagonal());
        (done, reports)
    };
    let ((alone, other), (done, reports)) = (edited(false), edited(true));
    assert!(reports.iter().any(|r| r.level == 2) && reports.iter().any(|r| r.level == 1));
    let minimum = alone.energy[1];
    assert!(done.settled && done.energy[1] < 1.01 * minimum, "{} against {minimum}", done.energy[1]);
    for count in 1..=12 {
        let [with, alone] = [&reports, &other].map(|reports| after(reports, count) / minimum - 1.0);
        assert!(with < 0.75 * alone, "{count} steps: {with} above the minimum, {alone} without levels");
    }
}

/// A refinement while the next step is under way is where that goes on from, as in a replay.
#[test]
fn a_step_under_way_goes_on_from_what_is_refined() {
    let mesh = shapes::creature(4000).expect("valid");
    for levels in [false, true] {
        let mut editor = Editor::open(mesh.clone(), options(levels), &Silent).expect("valid");
        editor.set_region(Some(between(&mesh, 0.3, 1.0))).expect("valid");
        let handle = editor.grab(Grip::Vertices(between(&mesh, 0.9, 1.0))).expect("valid");
        for degrees in [50.0, -20.0] {
            editor.drag(handle, turn(&mesh, degrees)).expect("valid");
            editor.update(std::time::Duration::ZERO).expect("solvable");
            _ = editor.refine_with(|report| report.steps < 60);
            editor.release("turn").expect("solvable");
        }
        assert!(editor.steps()[0].refined > 0);
        let again = Editor::replay(&editor.document("creature"), mesh.clone(), &Silent).expect("same mesh");
        assert!(bits(again.positions()) == bits(editor.positions()));
    }
}

/// Steps in the motions of the cage come first on the shape, whether there are levels or not.
#[test]
fn steps_in_the_cages_motions_lower_the_energy() {
    let mesh = shapes::creature(4000).expect("valid");
    for levels in [false, true] {
        let mut editor = released(&mesh, EditorOptions { subspace_steps: 2, ..options(levels) });
        let (done, reports) = steps(&mut editor, 60);
        let on_shape: Vec<&RefineReport> = reports.iter().filter(|r| r.level == 0).collect();
        let kinds: Vec<StepKind> = on_shape.iter().take(3).map(|r| r.kind).collect();
        assert_eq!(kinds, [StepKind::Subspace, StepKind::Subspace, StepKind::Full]);
        assert!(done.energy[1] < done.energy[0] && on_shape.windows(2).all(|r| r[1].energy <= r[0].energy));
        // From the preview, where the cage was never asked about the shape's energy, its motions lower that.
        assert!(levels || on_shape[1].energy < 0.97 * done.energy[0], "{:?}", done.energy);
        let again = Editor::replay(&editor.document("creature"), mesh.clone(), &Silent).expect("same mesh");
        assert!(bits(again.positions()) == bits(editor.positions()));
    }
}

/// Levels that are made ahead are those that a refinement makes, and giving up on making them breaks nothing.
#[test]
fn levels_can_be_made_ahead() {
    let mesh = shapes::creature(4000).expect("valid");
    let mut lazy = released(&mesh, options(true));
    steps(&mut lazy, 30);
    let mut ahead = Editor::open(mesh.clone(), options(true), &Silent).expect("valid");
    let cancel = AtomicBool::new(true);
    let stopped = ahead.prepare_levels(&Cancellable::new(&Silent, &cancel));
    assert!(matches!(stopped, Err(SessionError::Cage(CageError::Cancelled { .. }))));
    cancel.store(false, Ordering::Relaxed);
    let sizes: Vec<usize> = ahead.prepare_levels(&Cancellable::new(&Silent, &cancel)).expect("valid").sizes().collect();
    assert_eq!(sizes, [mesh.vertex_count() / 4, mesh.vertex_count() / 16]);
    ahead.anchor(Grip::Vertices(between(&mesh, 0.0, 0.1))).expect("valid");
    let handle = ahead.grab(Grip::Vertices(between(&mesh, 0.9, 1.0))).expect("valid");
    ahead.drag(handle, turn(&mesh, 50.0)).expect("valid");
    ahead.release("turn").expect("solvable");
    steps(&mut ahead, 30);
    assert!(bits(ahead.positions()) == bits(lazy.positions()));
}

/// Small steps of large shapes, and shapes of many pieces that cannot be made coarser, are refined alone.
#[test]
fn what_gains_nothing_from_levels_goes_without() {
    let mesh = shapes::creature(4000).expect("valid");
    let free = between(&mesh, 0.1, 0.9).len();
    for (least, levels) in [(free - 60, true), (free + 60, false)] {
        let mut editor = released(&mesh, EditorOptions { levels_from: Some(least), ..options(true) });
        let (_, reports) = steps(&mut editor, 3);
        assert_eq!(reports[0].level > 0, levels, "{least} of {free}");
    }
    // Tetrahedra in a row: none can lose a vertex.
    let one = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let positions = (0..60).flat_map(|k| one.map(|p| p + 2.0 * f64::from(k) * DVec3::X)).collect();
    let faces = |k: u32| [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]].map(|t: [u32; 3]| t.map(|v| 4 * k + v));
    let pieces = TriMesh::new(positions, (0..60).flat_map(faces).collect()).expect("valid");
    let mut editor = Editor::open(pieces, options(true), &Silent).expect("valid");
    editor.anchor(Grip::vertex(0)).expect("valid");
    let handle = editor.grab(Grip::vertex(3)).expect("valid");
    editor.drag(handle, Similarity::translation(DVec3::Z)).expect("valid");
    editor.release("stretch").expect("solvable");
    let (done, reports) = steps(&mut editor, 50);
    assert!(reports.iter().all(|r| r.level == 0) && done.energy[1] <= done.energy[0]);
}
