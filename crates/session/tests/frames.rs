//! What leaves for a GPU is what the editor has, and what is said to have changed is all that has.

use std::time::Duration;

use glam::{DVec3, Vec3};
use pliant_cage::CageSize;
use pliant_mesh::{NormalBuffer, Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Editor, EditorOptions, Frame, Grip, SessionError, SurfacePoint};

fn open(shape: &TriMesh) -> Editor {
    let options = EditorOptions { cage: CageSize::Fraction(0.1), ..EditorOptions::default() };
    Editor::open(shape.clone(), options, &Silent).expect("valid")
}

fn bar() -> TriMesh {
    shapes::bar(40, 6, 6, DVec3::new(6.0, 0.9, 0.9)).expect("valid")
}

fn where_x(mesh: &TriMesh, inside: impl Fn(f64) -> bool) -> VertexSet {
    VertexSet::where_true(mesh.vertex_count(), |v| inside(mesh.positions[v as usize].x))
}

/// A program that gives its GPU what is said to have changed, and nothing else.
#[derive(Default)]
struct Mirror {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
}

impl Mirror {
    /// Takes over a frame and holds it against what the editor says in double precision, within `tolerance`.
    fn look(&mut self, editor: &mut Editor, tolerance: f64, what: &str) -> std::ops::Range<usize> {
        let Frame { positions, normals, changed } = editor.display();
        self.positions.resize(positions.len(), Vec3::NAN);
        self.normals.resize(positions.len(), Vec3::NAN);
        self.positions[changed.clone()].copy_from_slice(&positions[changed.clone()]);
        self.normals[changed.clone()].copy_from_slice(&normals[changed.clone()]);
        assert!(self.positions == positions && self.normals == normals, "{what}: more has changed than {changed:?}");
        let mut expected = vec![Vec3::NAN; positions.len()];
        NormalBuffer::default().compute(editor.rest().topology(), &self.positions, &mut expected);
        assert!(self.normals == expected, "{what}: normals");
        let off = editor.positions().iter().zip(&self.positions).map(|(p, s)| p.distance(s.as_dvec3()));
        let off = off.fold(0.0, f64::max);
        assert!(off <= tolerance, "{what}: {off:e} of {tolerance:e}");
        changed
    }
}

/// Whatever is done, a mirror that takes over what has changed has all of it; twice is nothing.
#[test]
fn a_mirror_of_what_changed_has_all_of_it() {
    let shape = bar();
    let mut editor = open(&shape);
    let mut mirror = Mirror::default();
    // Coordinates up to 6, some roundings of 6e-8 each; and where double precision is at hand, half a unit in the last place of 4.
    let (drag, still) = (5e-6, 2.5e-7);
    let n = shape.vertex_count();
    assert_eq!(mirror.look(&mut editor, still, "opened"), 0..n);
    assert_eq!(mirror.look(&mut editor, still, "again"), 0..0);
    let half = where_x(&shape, |x| x > 0.5);
    let low = editor.anchor(Grip::Vertices(where_x(&shape, |x| x < -2.8))).expect("valid");
    let high = editor.grab(Grip::Vertices(where_x(&shape, |x| x > 2.8))).expect("valid");
    let lift = |by: f64| Similarity { translation: DVec3::Y * by, ..Similarity::about(DVec3::ZERO, DVec3::Z, by, 1.0) };
    let point = SurfacePoint { face: 700, barycentric: [0.2, 0.5, 0.3] };
    for round in 0..3 {
        for step in 1..4 {
            editor.drag(high, lift(0.1 * f64::from(step))).expect("valid");
            editor.update(Duration::ZERO).expect("solvable");
            mirror.look(&mut editor, drag, "update");
        }
        // Without a look in between, so that changes of two regions come together.
        let region = (round % 2 == 0).then(|| half.clone());
        editor.set_region(region.clone()).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        editor.set_region(None).expect("valid");
        editor.drag(high, lift(0.2)).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        mirror.look(&mut editor, drag, "another region");
        editor.set_region(region).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        mirror.look(&mut editor, drag, "the region again");
        let held = editor.grab(Grip::Point(point)).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        mirror.look(&mut editor, drag, "a point");
        editor.remove_handle(held).expect("there");
        mirror.look(&mut editor, drag, "handle removed");
        editor.cancel();
        mirror.look(&mut editor, still, "cancelled");
        editor.drag(high, lift(-0.2)).expect("valid");
        editor.update(Duration::ZERO).expect("solvable");
        let failed = editor.transaction(|editor| {
            editor.drag(low, Similarity::IDENTITY)?;
            editor.update(Duration::ZERO)?;
            editor.release("lost")?;
            editor.grab(Grip::vertex(u32::MAX))
        });
        assert!(matches!(failed, Err(SessionError::BadGrip { .. })));
        mirror.look(&mut editor, drag, "a failed transaction");
        editor.release("lift").expect("solvable");
        mirror.look(&mut editor, still, "released");
        editor.refine(Duration::ZERO).expect("just released");
        mirror.look(&mut editor, still, "refined");
        assert!(editor.undo());
        mirror.look(&mut editor, still, "undone");
        assert!(editor.redo());
        mirror.look(&mut editor, still, "redone");
        editor.set_region(None).expect("valid");
    }
}

/// In both precisions: hard handles are on their goals, vertices out of the range told have kept their bits.
#[test]
fn updates_tell_what_they_move() {
    let shape = bar();
    let (top, end) = (where_x(&shape, |x| x > 2.8), where_x(&shape, |x| x > 1.0));
    for region in [None, Some(end.clone())] {
        let mut editor = open(&shape);
        editor.set_region(region.clone()).expect("valid");
        if region.is_none() {
            editor.anchor(Grip::Vertices(where_x(&shape, |x| x < -2.8))).expect("valid");
        }
        let handle = editor.grab(Grip::Vertices(top.clone())).expect("valid");
        let mut before = editor.positions().to_vec();
        for step in 0..6 {
            let goal = Similarity::about(DVec3::new(1.0, 0.0, 0.0), DVec3::Z, 0.1 * f64::from(step / 2), 1.0);
            editor.drag(handle, goal).expect("valid");
            let update = editor.update(Duration::ZERO).expect("solvable");
            assert!(step > 1 || (update.changed == (0..0) && !editor.undo()), "nothing has been dragged yet");
            assert!(update.missed == 0.0);
            let frame = editor.display().positions.to_vec();
            let after = editor.positions().to_vec();
            for v in 0..after.len() {
                let inside = update.changed.contains(&v);
                assert!(inside || after[v].to_array().map(f64::to_bits) == before[v].to_array().map(f64::to_bits));
                if top.contains(v as u32) {
                    assert_eq!(after[v], goal.apply(shape.positions[v]));
                    assert_eq!(frame[v], after[v].as_vec3());
                }
                if region.as_ref().is_some_and(|region| !region.contains(v as u32)) {
                    assert_eq!(after[v], shape.positions[v]);
                }
            }
            before = after;
        }
    }
}

/// Two bars in one mesh: the range told is that of the one that is dragged.
#[test]
fn what_is_not_joined_does_not_change() {
    let one = bar();
    let n = one.vertex_count();
    let mut positions = one.positions.clone();
    positions.extend(one.positions.iter().map(|p| *p + DVec3::Y * 0.95));
    let mut triangles = one.triangles().to_vec();
    triangles.extend(one.triangles().iter().map(|t| t.map(|v| v + n as u32)));
    let shape = TriMesh::new(positions, triangles).expect("valid");
    let mut editor = open(&shape);
    editor.display();
    let second = |low: f64, high: f64| {
        VertexSet::where_true(2 * n, |v| v as usize >= n && (low..high).contains(&shape.positions[v as usize].x))
    };
    editor.anchor(Grip::Vertices(second(-4.0, -2.8))).expect("valid");
    let handle = editor.grab(Grip::Vertices(second(2.8, 4.0))).expect("valid");
    editor.drag(handle, Similarity::translation(DVec3::Y)).expect("valid");
    let update = editor.update(Duration::ZERO).expect("solvable");
    assert!(update.changed.start >= n && update.changed.len() > n / 2, "{:?}", update.changed);
    assert!(editor.display().changed.start >= n);
    // Goals are of the editor, whatever is at hand.
    let released = editor.release("lift").expect("solvable");
    assert!(released.changed.start >= n);
    assert_eq!(editor.positions()[..n], shape.positions[..n]);
}

#[test]
fn frames_have_the_same_bits_for_any_number_of_threads() {
    let shape = shapes::creature(12_000).expect("valid");
    let bounds = shape.bounds();
    let part = |inside: &dyn Fn(DVec3) -> bool| {
        VertexSet::where_true(shape.vertex_count(), |v| inside(bounds.to_box(shape.positions[v as usize])))
    };
    let made = |threads: usize, region: bool| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let mut editor = open(&shape);
            editor.set_region(region.then(|| part(&|p| p.x > 0.5))).expect("valid");
            editor.anchor(Grip::Vertices(part(&|p| p.y < 0.1 && p.x > 0.5))).expect("valid");
            let hand = editor.grab(Grip::Vertices(part(&|p| p.x > 0.9))).expect("valid");
            editor.drag(hand, Similarity::translation(DVec3::Y * 0.1 * bounds.diagonal())).expect("valid");
            editor.update(Duration::ZERO).expect("solvable");
            let frame = editor.display();
            (frame.positions.to_vec(), frame.normals.to_vec(), frame.changed)
        })
    };
    for region in [false, true] {
        assert!(made(1, region) == made(3, region));
    }
}
