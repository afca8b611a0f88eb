//! Whatever is done in whatever order, a document gives it back to the bit.

use std::time::Duration;

use glam::DVec3;
use pliant_cage::CageSize;
use pliant_deform::Constraint;
use pliant_mesh::{Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Document, Editor, EditorOptions, Grip, SessionError, SurfacePoint};

/// Sessions of a thousand operations.
const SESSIONS: u64 = 3;

fn bits(positions: &[DVec3]) -> Vec<[u64; 3]> {
    positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

fn where_x(mesh: &TriMesh, inside: impl Fn(f64) -> bool) -> VertexSet {
    VertexSet::where_true(mesh.vertex_count(), |v| inside(mesh.positions[v as usize].x))
}

/// A linear congruential generator (Knuth's multiplier).
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) % end
    }

    fn goal(&mut self) -> Similarity {
        let angle = self.below(100) as f64 / 200.0;
        Similarity { translation: DVec3::Y * angle, ..Similarity::about(DVec3::ZERO, DVec3::Z, angle, 1.0) }
    }

    fn handle(&mut self, editor: &Editor) -> Option<u32> {
        let count = editor.handles().len() as u64;
        (count > 0).then(|| editor.handles()[self.below(count) as usize].id)
    }

    fn grip(&mut self, shape: &TriMesh) -> Grip {
        match self.below(14) {
            0 => Grip::Vertices(where_x(shape, |x| x < -2.8)),
            1 => Grip::Vertices(where_x(shape, |x| x > 2.8)),
            2 => Grip::Vertices(where_x(shape, |x| x.abs() < 0.3)),
            3 | 4 => {
                let face = self.below(shape.face_count() as u64) as u32;
                Grip::Point(SurfacePoint { face, barycentric: [0.2, 0.3, 0.5] })
            }
            _ => Grip::vertex(self.below(shape.vertex_count() as u64) as u32),
        }
    }
}

/// Something an artist may do. What is refused is as good: it is to leave no trace.
fn operate(editor: &mut Editor, random: &mut Random) {
    let shape = editor.rest().clone();
    match random.below(14) {
        0 => _ = editor.undo(),
        1 => _ = editor.redo(),
        2 => _ = editor.grab(random.grip(&shape)),
        3 if editor.handles().len() > 1 => _ = random.handle(editor).map(|id| editor.remove_handle(id)),
        4 => _ = editor.update(Duration::ZERO),
        5 => editor.cancel(),
        6 => _ = editor.set_region((random.below(2) == 0).then(|| where_x(&shape, |x| x > -2.0))),
        7 => _ = editor.release_on("strokes"),
        8 => {
            let steps = random.below(4);
            let mut done = 0;
            let refined = editor.refine_with(|_| {
                done += 1;
                done < steps
            });
            assert!(refined.is_ok() || matches!(refined, Err(SessionError::NothingToRefine)), "{refined:?}");
        }
        9 => _ = editor.add_handle(random.grip(&shape), Constraint::Soft(1.0 + random.below(5) as f64)),
        10 => {
            let (goal, fails) = (random.goal(), random.below(2) == 0);
            let handle = random.handle(editor);
            _ = editor.transaction(|editor| {
                if let Some(handle) = handle {
                    editor.drag(handle, goal)?;
                    editor.release("both")?;
                }
                if fails { editor.grab(Grip::vertex(u32::MAX)).map(|_| ()) } else { Ok(()) }
            });
        }
        _ => {
            let goal = random.goal();
            if let Some(id) = random.handle(editor) {
                editor.drag(id, goal).expect("a similarity");
                _ = editor.release("step");
            }
        }
    }
}

/// The document of a session, replayed by another editor: the same positions, and the same after all that can be redone.
fn compare(editor: &mut Editor, what: &str) -> usize {
    editor.cancel();
    let document = Document::parse(editor.document("bar").to_json().expect("finite").as_bytes()).expect("own");
    let mut again = Editor::replay(&document, editor.rest().clone(), &Silent).expect("same mesh");
    let replayed = again.document("bar");
    for (k, (a, b)) in document.steps.iter().zip(&replayed.steps).enumerate() {
        assert!(a == b, "{what}: step {k} is {a:?}, replayed {b:?}");
    }
    assert!(replayed == document, "{what}: {} steps, replayed {}", document.steps.len(), replayed.steps.len());
    let same = |again: &Editor, editor: &Editor, when: &str| {
        assert!(bits(again.positions()) == bits(editor.positions()), "{what}, {when}");
        assert!(bits(again.cage_positions()) == bits(editor.cage_positions()), "{what}, {when}");
    };
    same(&again, editor, "replayed");
    let (done, depth) = editor.undo_depth();
    // What was undone and forgotten for the memory it took is in no document.
    assert!(done == again.undo_depth().0 || editor.forgotten_steps() > 0, "{what}");
    assert_eq!(depth, again.undo_depth().1, "{what}");
    for _ in 0..depth {
        assert!(again.redo() && editor.redo());
    }
    same(&again, editor, "redone");
    for _ in 0..depth {
        assert!(editor.undo());
    }
    document.steps.len()
}

/// A thousand operations, and again and again the document gives the same bits in another editor.
#[test]
fn random_sessions_never_diverge_from_their_replay() {
    let shape = shapes::bar(16, 3, 3, DVec3::new(6.0, 0.9, 0.9)).expect("valid");
    for session in 0..SESSIONS {
        let cage = CageSize::Fraction(0.1);
        // Every other one refines through levels; the third forgets its oldest steps.
        let levels_from = (session % 2 == 0).then_some(0);
        let history_bytes = if session % 3 == 2 { 50_000 } else { usize::MAX };
        let options = EditorOptions { cage, release_solves: 2, levels_from, history_bytes, ..EditorOptions::default() };
        let mut editor = Editor::open(shape.clone(), options, &Silent).expect("valid");
        editor.anchor(Grip::Vertices(where_x(&shape, |x| x < -2.8))).expect("valid");
        let mut random = Random(7 + session);
        let mut compared = 0;
        for operation in 0..1000 {
            operate(&mut editor, &mut random);
            if operation % 250 == 249 {
                compared += compare(&mut editor, &format!("session {session}, operation {operation}"));
            }
        }
        assert!(compared > 100, "{compared} steps");
    }
}
