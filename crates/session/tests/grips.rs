//! Whatever is grabbed goes where it is put, and what cannot be is refused by name.

use std::time::Duration;

use glam::DVec3;
use pliant_cage::CageSize;
use pliant_mesh::{Silent, Similarity, TriMesh, VertexSet, select, shapes};
use pliant_session::{Editor, EditorOptions, Grip, SessionError, SurfacePoint};

fn open(shape: &TriMesh, cage: f64) -> Editor {
    let options = EditorOptions { cage: CageSize::Fraction(cage), ..EditorOptions::default() };
    Editor::open(shape.clone(), options, &Silent).expect("valid")
}

/// The vertices of the shape that the cage has kept.
fn kept(editor: &Editor) -> VertexSet {
    let simplified = editor.saved_cage().simplified.expect("made of the shape").1;
    simplified.origin.into_iter().collect()
}

/// A sphere with a wart of a few edges' width in its north, too small for the cage to have more than a vertex of it.
fn warty() -> (TriMesh, DVec3) {
    let sphere = shapes::icosphere(5);
    let north = DVec3::new(0.2, 0.1, 1.0).normalize();
    let raised = |p: &DVec3| {
        let near = (1.0 - p.distance(north) / 0.08).max(0.0);
        *p * (1.0 + 0.05 * near * near)
    };
    let positions = sphere.positions.iter().map(raised).collect();
    (TriMesh::new(positions, sphere.triangles().to_vec()).expect("valid"), north)
}

/// Of the vertices near `at`, the one that is farthest from all of a cage.
fn farthest_from_cage(shape: &TriMesh, cage: &VertexSet, at: DVec3, radius: f64) -> u32 {
    let gap = |v: u32| {
        let p = shape.positions[v as usize];
        cage.iter().map(|c| shape.positions[c as usize].distance(p)).fold(f64::INFINITY, f64::min)
    };
    let near = VertexSet::where_true(shape.vertex_count(), |v| shape.positions[v as usize].distance(at) < radius);
    near.iter().max_by(|a, b| gap(*a).total_cmp(&gap(*b))).expect("something is near")
}

/// A vertex, a patch and a point on a detail, each far from all of the cage: shown, released and refined they are on their goals.
#[test]
fn a_fine_detail_far_from_the_cage_lands_on_its_goal() {
    let (shape, north) = warty();
    let bounds = shape.bounds();
    let allowed = 1e-6 * bounds.diagonal();
    let south =
        || Grip::Vertices(VertexSet::where_true(shape.vertex_count(), |v| shape.positions[v as usize].z < -0.8));
    for cage in [0.005, 0.02] {
        let vertex = farthest_from_cage(&shape, &kept(&open(&shape, cage)), north, 0.08);
        let patch = select::grow(shape.topology(), &VertexSet::from_iter([vertex]), 1).expect("a vertex of it");
        let lost = patch.difference(&kept(&open(&shape, cage)));
        let face = shape.triangles().iter().position(|t| t.contains(&vertex)).expect("it has faces");
        let point = SurfacePoint { face: face as u32, barycentric: [0.2, 0.3, 0.5] };
        for grip in [Grip::vertex(vertex), Grip::Vertices(lost), Grip::Point(point)] {
            let mut editor = open(&shape, cage);
            editor.anchor(south()).expect("valid");
            let handle = editor.grab(grip.clone()).expect("valid");
            let goal = Similarity {
                translation: DVec3::new(0.1, -0.05, 0.3),
                ..Similarity::about(shape.positions[vertex as usize], DVec3::X, 0.4, 1.0)
            };
            let held = |positions: &[DVec3]| match &grip {
                Grip::Vertices(set) => set.iter().map(|v| positions[v as usize]).collect(),
                Grip::Point(point) => {
                    let corners = shape.triangles()[point.face as usize];
                    vec![(0..3).map(|k| point.barycentric[k] * positions[corners[k] as usize]).sum::<DVec3>()]
                }
            };
            let goals: Vec<DVec3> = held(&shape.positions).iter().map(|p| goal.apply(*p)).collect();
            editor.drag(handle, goal).expect("valid");
            let lands = |editor: &Editor, what: &str| {
                for (p, goal) in held(editor.positions()).iter().zip(&goals) {
                    assert!(p.distance(*goal) <= allowed, "{what} {grip:?} at {cage}: {:e}", p.distance(*goal));
                }
            };
            editor.update(Duration::ZERO).expect("solvable");
            lands(&editor, "shown");
            editor.release("pull").expect("solvable");
            lands(&editor, "released");
            editor.refine(Duration::ZERO).expect("just released");
            lands(&editor, "refined");
        }
    }
}

/// Two regions of hundreds of vertices over a cage with a few in each: exactly on their goals, and the edges that lead out of them are
/// stretched no more than the others around.
#[test]
fn large_regions_are_set_exactly_and_fade_into_their_surroundings() {
    let (shape, _) = warty();
    let cap =
        |above: f64| VertexSet::where_true(shape.vertex_count(), |v| shape.positions[v as usize].y * above > 0.85);
    let [north, south] = [1.0, -1.0].map(cap);
    let goal = Similarity { translation: DVec3::new(0.2, 0.4, 0.0), ..Similarity::about(DVec3::Y, DVec3::Y, 0.5, 1.0) };
    for cage in [0.005, 0.02] {
        let mut editor = open(&shape, cage);
        assert!(kept(&editor).iter().filter(|v| north.contains(*v)).count() * 20 < north.len());
        editor.anchor(Grip::Vertices(south.clone())).expect("valid");
        let handle = editor.grab(Grip::Vertices(north.clone())).expect("valid");
        editor.drag(handle, goal).expect("valid");
        let snapped = editor.release("twist").expect("solvable").snapped;
        for v in north.iter().map(|v| v as usize) {
            assert_eq!(editor.positions()[v], goal.apply(shape.positions[v]));
        }
        let (mut border, mut around) = (Vec::new(), Vec::new());
        for &[a, b] in shape.topology().edges() {
            let [was, is] = [&shape.positions, editor.positions()].map(|x| x[a as usize].distance(x[b as usize]));
            let inside = [a, b].map(|v| north.contains(v));
            let near = shape.positions[a as usize].y > 0.6;
            match inside {
                [false, false] if near => around.push(is / was - 1.0),
                [true, false] | [false, true] => border.push(is / was - 1.0),
                _ => {}
            }
        }
        let rms = |x: &[f64]| (x.iter().map(|e| e * e).sum::<f64>() / x.len() as f64).sqrt();
        // Set without a fade, they would take all of what the cage misses the goals by within one edge.
        assert!(snapped > 0.05, "the cage alone meets the goals: {snapped}");
        assert!(rms(&border) < 1.2 * rms(&around), "{} against {}", rms(&border), rms(&around));
    }
}

/// A single vertex that the cage has, too, is exactly there at once, and pulls its surroundings along.
#[test]
fn a_vertex_of_the_cage_leads_it() {
    let (shape, _) = warty();
    let mut editor = open(&shape, 0.02);
    let led = kept(&editor).iter().next().expect("a cage has vertices");
    let at = shape.positions[led as usize];
    let far = VertexSet::where_true(shape.vertex_count(), |v| shape.positions[v as usize].dot(at) < -0.5);
    editor.anchor(Grip::Vertices(far)).expect("valid");
    let handle = editor.grab(Grip::vertex(led)).expect("valid");
    editor.drag_to(handle, 1.2 * at).expect("valid");
    let update = editor.update(Duration::ZERO).expect("solvable");
    assert!(editor.positions()[led as usize].distance(1.2 * at) < 1e-12 && update.missed < 1e-12);
    // It goes seven edges far.
    for &v in shape.topology().neighbours(led as usize) {
        let [was, is] = [&shape.positions, editor.positions()].map(|x| x[led as usize].distance(x[v as usize]));
        assert!(is < 2.0 * was, "{is} of {was}");
    }
}

#[test]
fn what_cannot_be_grabbed_or_dragged_is_refused_by_name() {
    let shape = shapes::icosphere(3);
    let mut editor = open(&shape, 0.1);
    let refusal = |made: Result<u32, SessionError>| match made {
        Err(SessionError::BadGrip { reason }) => reason,
        other => panic!("{other:?}"),
    };
    let [a, b, c] = shape.triangles()[7];
    let point = |barycentric| Grip::Point(SurfacePoint { face: 7, barycentric });
    let first = editor.grab(Grip::Vertices([a, b].into_iter().collect())).expect("valid");
    assert!(refusal(editor.grab(Grip::vertex(b))).contains(&format!("handle {first} holds vertex {b}")));
    // One corner is left, and has no weight in the middle of the opposite edge.
    assert!(refusal(editor.grab(point([0.5, 0.5, 0.0]))).contains("face 7"));
    let held = editor.grab(point([0.2, 0.3, 0.5])).expect("a corner is left");
    assert!(refusal(editor.grab(point([0.2, 0.3, 0.5]))).contains(&format!("handle {held} holds the same point")));
    assert!(refusal(editor.grab(Grip::vertex(c))).contains(&format!("handle {held}")));
    assert_eq!(editor.handles().len(), 2);

    for bad in [DVec3::NAN, DVec3::new(0.0, f64::INFINITY, 0.0)] {
        assert!(matches!(editor.drag_to(held, bad), Err(SessionError::BadGrip { .. })));
        assert!(matches!(editor.drag(held, Similarity::translation(bad)), Err(SessionError::BadGrip { .. })));
    }
    assert!(editor.handles().iter().all(|handle| handle.goal == Similarity::IDENTITY));
    editor.update(Duration::ZERO).expect("nothing is dragged");
    assert_eq!(editor.positions(), shape.positions);
}

/// A hard handle half outside the region may stay, and no more; a soft one is drawn as far as the region goes.
#[test]
fn what_is_outside_the_region_cannot_be_dragged() {
    let shape = shapes::bar(40, 6, 6, DVec3::new(6.0, 0.9, 0.9)).expect("valid");
    let where_x = |inside: &dyn Fn(f64) -> bool| {
        VertexSet::where_true(shape.vertex_count(), |v| inside(shape.positions[v as usize].x))
    };
    let (region, ends) = (where_x(&|x| x > 0.0), where_x(&|x| x > 2.8));
    let astride = where_x(&|x| x.abs() < 0.5);
    let out = astride.difference(&region).iter().next().expect("half of it");
    let mut editor = open(&shape, 0.1);
    editor.set_region(Some(region.clone())).expect("valid");
    let stuck = editor.anchor(Grip::Vertices(astride)).expect("it stays");
    let handle = editor.grab(Grip::Vertices(ends)).expect("valid");
    editor.drag(handle, Similarity::translation(DVec3::Y)).expect("valid");
    editor.update(Duration::ZERO).expect("the anchor stays");
    let shown = editor.positions().to_vec();
    editor.drag(stuck, Similarity::translation(0.1 * DVec3::Y)).expect("a similarity");
    for refused in [editor.update(Duration::ZERO), editor.release("both")] {
        match refused {
            Err(SessionError::OutsideRegion { handle, vertex }) => assert_eq!((handle, vertex), (stuck, out)),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(editor.positions(), shown);
    editor.set_region(None).expect("valid");
    editor.release("both").expect("everything may move");
}
