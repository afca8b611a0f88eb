//! Lesson 5: an editor inside a program that draws frames.
//!
//! `cargo run --release --example 05_drag_in_a_loop` (and a number of vertices, 100000 if none is given)

use std::error::Error;
use std::time::{Duration, Instant};

use pliant::glam::DVec3;
use pliant::{Editor, EditorOptions, Frame, Grip, Silent, Similarity, VertexSet, creature};

fn main() -> Result<(), Box<dyn Error>> {
    let vertices = std::env::args().nth(1).map_or(Ok(100_000), |n| n.parse())?;
    let shape = creature(vertices)?;
    let bounds = shape.bounds();
    let part = |inside: &dyn Fn(DVec3) -> bool| {
        let at = |v: u32| bounds.to_box(shape.positions[v as usize]);
        Grip::Vertices(VertexSet::where_true(shape.vertex_count(), |v| inside(at(v))))
    };

    let start = Instant::now();
    let mut editor = Editor::open(shape.clone(), EditorOptions::default(), &Silent)?;
    println!("opened {} vertices in {:.0?}", shape.vertex_count(), start.elapsed());
    editor.anchor(part(&|p| p.y < 0.1))?;
    let hand = editor.grab(part(&|p| p.x > 0.9))?;

    // The mouse moves a little from frame to frame; a frame shows where it was last.
    let mut times = Vec::new();
    for frame in 0..300 {
        let swing = 0.15 * bounds.diagonal() * (f64::from(frame) / 40.0).sin();
        let begun = Instant::now();
        editor.drag(hand, Similarity::translation(DVec3::new(0.0, swing, 0.3 * swing)))?;
        // At least one solve, and no more of them than a millisecond allows.
        editor.update(Duration::from_millis(1))?;
        // What a GPU has to be given again.
        let Frame { positions, normals, changed } = editor.display();
        let (positions, normals) = (&positions[changed.clone()], &normals[changed]);
        assert_eq!(positions.len(), normals.len());
        times.push(begun.elapsed());
    }
    times.sort_unstable();
    let percentile = |p: usize| times[p * (times.len() - 1) / 100];
    println!(
        "a frame, from goal to positions and normals for a GPU: p50 {:.2?}, p95 {:.2?}, p99 {:.2?}",
        percentile(50),
        percentile(95),
        percentile(99)
    );

    let released = editor.release("swing the hand")?;
    println!("released in {:.0?}, {} solves", released.elapsed, released.solves);
    Ok(())
}
