//! What contradicts itself, is taken back halfway, or does not belong together.

use std::time::Duration;

use glam::DVec3;
use pliant_cage::CageSize;
use pliant_mesh::{Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Editor, EditorOptions, Grip, SessionError, SurfacePoint};

fn open_with(shape: &TriMesh, options: EditorOptions) -> Editor {
    let cage = CageSize::Fraction(0.05);
    Editor::open(shape.clone(), EditorOptions { cage, ..options }, &Silent).expect("valid")
}

fn open(shape: &TriMesh) -> Editor {
    open_with(shape, EditorOptions::default())
}

fn lift(by: f64) -> Similarity {
    Similarity::translation(by * DVec3::Z)
}

/// Points that share corners, one of them dragged: as near as may be, never nothing, and told how near. On one edge three points cannot go
/// three ways, but middles of faces around a vertex of odd valence can.
#[test]
fn points_that_contradict_each_other_miss_by_what_is_told() {
    let shape = shapes::icosphere(4);
    let place = |point: &SurfacePoint, positions: &[DVec3]| {
        let corners = shape.triangles()[point.face as usize];
        (0..3).map(|k| point.barycentric[k] * positions[corners[k] as usize]).sum::<DVec3>()
    };
    let on_edge = |weights: &[f64]| -> Vec<SurfacePoint> {
        weights.iter().map(|&w| SurfacePoint { face: 40, barycentric: [w, 1.0 - w, 0.0] }).collect()
    };
    let middles = |vertex: u32| -> Vec<SurfacePoint> {
        let faces = shape.topology().vertex_faces(vertex as usize).iter();
        faces.map(|&face| SurfacePoint { face, barycentric: [1.0 / 3.0; 3] }).collect()
    };
    // (points, whether their rows are independent): the first twelve vertices have five faces, all others six.
    let cases = [
        (on_edge(&[0.5, 0.25]), true),
        (on_edge(&[0.5, 0.25, 0.75]), false),
        (middles(7), true),
        (middles(700), false),
    ];
    for (points, meets) in cases {
        let mut editor = open(&shape);
        let far = VertexSet::where_true(shape.vertex_count(), |v| {
            shape.positions[v as usize].dot(place(&points[0], &shape.positions)) < -0.5
        });
        editor.anchor(Grip::Vertices(far)).expect("valid");
        let handles: Vec<u32> = points.iter().map(|p| editor.grab(Grip::Point(*p)).expect("apart")).collect();
        editor.drag(handles[1], lift(0.05)).expect("valid");
        for released in [false, true] {
            let update = if released { editor.release("pull") } else { editor.update(Duration::ZERO) };
            let told = update.expect("solvable").missed;
            let goal = |k: usize| place(&points[k], &shape.positions) + DVec3::Z * if k == 1 { 0.05 } else { 0.0 };
            let missed = (0..points.len()).map(|k| place(&points[k], editor.positions()).distance(goal(k)));
            let missed = missed.fold(0.0, f64::max);
            assert!((missed - told).abs() < 1e-6, "{missed} told as {told}");
            assert!(if meets { missed < 1e-6 } else { missed > 1e-3 && missed < 0.05 }, "{missed}");
            // Five times the way that one point was dragged: middles of faces alternate.
            let moved =
                editor.positions().iter().zip(&shape.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
            assert!(moved < 0.5, "{moved} {points:?} {released} missed {missed}");
        }
    }
}

/// Taken back and dragged again to the same place, a vertex is there again, and that it moved is told.
#[test]
fn the_same_goal_after_a_cancel_is_shown_again() {
    let shape = shapes::icosphere(3);
    for undo in [false, true] {
        let mut editor = open(&shape);
        let kept: VertexSet = editor.saved_cage().simplified.expect("made").1.origin.into_iter().collect();
        let lost = (0..).find(|v| !kept.contains(*v)).expect("most are lost");
        editor.set_region(Some([lost].into_iter().collect())).expect("valid");
        let handle = editor.grab(Grip::vertex(lost)).expect("valid");
        for _ in 0..3 {
            editor.drag(handle, lift(0.3)).expect("valid");
            let update = editor.update(Duration::ZERO).expect("solvable");
            assert!(update.changed.contains(&(lost as usize)));
            assert_eq!(editor.positions()[lost as usize], shape.positions[lost as usize] + 0.3 * DVec3::Z);
            if undo {
                assert!(editor.undo());
            } else {
                editor.cancel();
            }
            assert_eq!(editor.positions(), shape.positions);
        }
    }
}

/// Without the handle that moved it, a piece goes back to where the step began with the next update.
#[test]
fn what_no_handle_holds_any_more_goes_back() {
    let one = shapes::icosphere(3);
    let n = one.vertex_count() as u32;
    let positions = one.positions.iter().copied().chain(one.positions.iter().map(|p| *p + 3.0 * DVec3::X)).collect();
    let triangles = one.triangles().iter().copied().chain(one.triangles().iter().map(|t| t.map(|v| v + n))).collect();
    let shape = TriMesh::new(positions, triangles).expect("valid");
    let mut editor = open(&shape);
    let cap = VertexSet::where_true(n as usize, |v| one.positions[v as usize].y < -0.8);
    editor.anchor(Grip::Vertices(cap)).expect("valid");
    let handle = editor.grab(Grip::vertex(n + 10)).expect("valid");
    editor.drag(handle, lift(1.0)).expect("valid");
    editor.update(Duration::ZERO).expect("solvable");
    editor.remove_handle(handle).expect("there");
    editor.update(Duration::ZERO).expect("solvable");
    assert_eq!(editor.positions()[n as usize..], shape.positions[n as usize..]);
    // The other piece had no reason to move at all.
    let off = editor.positions().iter().zip(&shape.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off}");
}

#[test]
fn strokes_are_one_step_however_little_memory_there_is() {
    let shape = shapes::icosphere(3);
    let mut editor = open_with(&shape, EditorOptions { history_bytes: 0, ..EditorOptions::default() });
    let handle = editor.grab(Grip::vertex(3)).expect("valid");
    for _ in 0..3 {
        editor.drag(handle, lift(0.1)).expect("valid");
        editor.release_on("stroke").expect("solvable");
    }
    assert!(editor.undo());
    assert_eq!(editor.positions(), shape.positions);
}

/// Refined while the next drag is under way, what is dragged stays where it is shown.
#[test]
fn refining_leaves_a_drag_under_way_on_its_goal() {
    let shape = shapes::icosphere(3);
    let mut editor = open(&shape);
    editor.anchor(Grip::vertex(40)).expect("valid");
    let handle = editor.grab(Grip::vertex(3)).expect("valid");
    editor.drag(handle, lift(0.2)).expect("valid");
    editor.release("pull").expect("solvable");
    let goal = shape.positions[3] + 0.5 * DVec3::Z;
    editor.drag_to(handle, goal).expect("valid");
    editor.update(Duration::ZERO).expect("solvable");
    editor.refine(Duration::ZERO).expect("released");
    assert!(editor.positions()[3].distance(goal) < 1e-12);
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let (shape, other) = (shapes::icosphere(3), shapes::icosphere(4));
    for (a, b) in [(&shape, &other), (&other, &shape)] {
        let opened = Editor::open_saved(a.clone(), open(b).saved_cage(), EditorOptions::default(), &Silent);
        assert!(matches!(opened, Err(SessionError::BadGrip { .. })));
    }
    let mut editor = open(&shape);
    let handle = editor.grab(Grip::vertex(3)).expect("valid");
    editor.drag(handle, lift(1e100)).expect("a similarity");
    // Frames are in single precision.
    assert!(editor.update(Duration::ZERO).is_err() && editor.release("far").is_err());
    editor.drag(handle, lift(0.1)).expect("valid");
    editor.release("pull").expect("solvable");
    let mut document = editor.document("sphere");
    document.steps[0].handles[0].scale = f64::NAN;
    assert!(matches!(document.to_json(), Err(SessionError::Document(_))));
}
