//! Lesson 6: a whole tool: pick a spot, pull it, take it back, save, and go on tomorrow.
//!
//! `cargo run --release --example 06_a_tool_of_your_own`

use std::error::Error;

use pliant::glam::DVec3;
use pliant::select::{self, Ray, RayCaster};
use pliant::{Document, Editor, EditorOptions, Grip, SavedCage, Silent, Similarity, SurfacePoint, creature};

fn main() -> Result<(), Box<dyn Error>> {
    let shape = creature(20_000)?;
    let folder = std::env::temp_dir();
    let (binding, session) = (folder.join("pliant-tool.pliant"), folder.join("pliant-tool.json"));

    // Open it; the cage is saved, so that opening takes no time from the second day on.
    let mut editor = Editor::open(shape.clone(), EditorOptions::default(), &Silent)?;
    editor.saved_cage().save(&binding)?;

    // Where a ray from the front meets the shape is the spot to pull, and only what is near it along the surface may move.
    let chest = DVec3::new(0.0, 1.0, 10.0);
    let hit = RayCaster::new(&shape).pick(&Ray { origin: chest, direction: -DVec3::Z }).ok_or("nothing was hit")?;
    let vertex = hit.vertex(shape.topology());
    let near = select::geodesic_ball(shape.topology(), &shape.positions, vertex, 0.4);
    editor.set_region(Some(near))?;
    let spot = editor.grab(Grip::Point(SurfacePoint { face: hit.face, barycentric: hit.barycentric }))?;
    editor.drag_to(spot, hit.point + 0.15 * DVec3::Z)?;
    let released = editor.release("pull the chest")?;
    println!(
        "pulled: {} solves, {:.1?}; the cage missed by {:.4}",
        released.solves, released.elapsed, released.snapped
    );

    editor.drag(spot, Similarity::translation(0.1 * DVec3::Y))?;
    editor.release("and up")?;
    editor.undo();
    println!("{:?} steps to undo and to redo", editor.undo_depth());

    // Tomorrow: the same bits from the document, and the cage from its file.
    editor.document("creature:20000").save(&session)?;
    let again = Editor::replay(&Document::load(&session)?, shape.clone(), &Silent)?;
    assert_eq!(again.positions(), editor.positions());
    let saved = SavedCage::load(&binding, &shape)?;
    let fresh = Editor::open_saved(shape, saved, EditorOptions::default(), &Silent)?;
    assert_eq!(fresh.undo_depth(), (0, 0));
    println!("wrote {} and {}", binding.display(), session.display());
    Ok(())
}
