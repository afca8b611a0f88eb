//! Dragging allocates nothing.

use std::time::Duration;

use allocation_counter::measure;
use glam::DVec3;
use pliant_mesh::{Silent, Similarity, VertexSet, shapes};
use pliant_session::{Editor, EditorOptions, Grip, SurfacePoint};

#[test]
fn an_update_allocates_nothing_from_the_second_time_on() {
    let shape = shapes::bar(60, 10, 10, DVec3::new(6.0, 1.0, 1.0)).expect("valid");
    let part = |inside: fn(f64) -> bool| {
        VertexSet::where_true(shape.vertex_count(), |v| inside(shape.positions[v as usize].x))
    };
    for region in [None, Some(part(|x| x > -1.0))] {
        let mut editor = Editor::open(shape.clone(), EditorOptions::default(), &Silent).expect("valid");
        editor.set_region(region.clone()).expect("valid");
        editor.anchor(Grip::Vertices(part(|x| x < -2.8))).expect("valid");
        // Two points in one face, too.
        let middle = |v: &u32| (1.0..2.0).contains(&shape.positions[*v as usize].x);
        let face = shape.triangles().iter().position(|t| t.iter().all(middle));
        let face = face.expect("there is one") as u32;
        for barycentric in [[0.5, 0.25, 0.25], [0.25, 0.25, 0.5]] {
            editor.anchor(Grip::Point(SurfacePoint { face, barycentric })).expect("valid");
        }
        let handle = editor.grab(Grip::Vertices(part(|x| x > 2.8))).expect("valid");
        let mut drag = |step: u32| {
            // Near goals and far ones: a jump goes through the coarser cages.
            let lift = if step % 3 == 2 { 1.0 } else { 0.01 * f64::from(step) };
            editor.drag(handle, Similarity::translation(DVec3::Y * lift)).expect("valid");
            editor.update(Duration::ZERO).expect("solvable");
            let moved = editor.display().changed;
            assert!(moved.len() > shape.vertex_count() / 3);
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
        pool.install(|| (0..4).for_each(&mut drag));
        let info = pool.install(|| measure(|| (4..12).for_each(&mut drag)));
        assert_eq!(info.count_total, 0, "{}", region.is_some());
    }
}
