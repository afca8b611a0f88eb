use std::f64::consts::{PI, TAU};

use glam::DVec3;
use pliant_mesh::{Bounds, Similarity, TriMesh, shapes};

use super::*;

/// A closed box of `cells` cells, its surface meshed with one quad (two triangles) per cell face; vertices are unique.
fn box_mesh(cells: [u32; 3], lo: DVec3, hi: DVec3) -> TriMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    let mut index = std::collections::BTreeMap::new();
    let mut vertex = |at: [u32; 3]| {
        *index.entry(at).or_insert_with(|| {
            let share = DVec3::from_array([0, 1, 2].map(|a| f64::from(at[a]) / f64::from(cells[a])));
            positions.push(lo + share * (hi - lo));
            positions.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, i, j) in [0, cells[axis]]
            .into_iter()
            .flat_map(|s| (0..cells[u]).flat_map(move |i| (0..cells[v]).map(move |j| (s, i, j))))
        {
            let mut corner = |di: u32, dj: u32| {
                let mut at = [side; 3];
                (at[u], at[v]) = (i + di, j + dj);
                vertex(at)
            };
            let quad = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            let [a, b, c, d] = if side == 0 { [quad[0], quad[3], quad[2], quad[1]] } else { quad };
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(positions, triangles).expect("a box")
}

fn tower() -> TriMesh {
    box_mesh([4, 12, 6], DVec3::new(-3.0, 10.0, 2.0), DVec3::new(1.0, 34.0, 5.0))
}

fn one_handle(region: SceneRegion, motion: Option<SceneMotion>) -> Scene {
    let handle = SceneHandle { name: "only".to_owned(), region, motion };
    Scene { name: "test".to_owned(), description: String::new(), shape: None, method: None, handles: vec![handle] }
}

fn held(mesh: &TriMesh, region: SceneRegion) -> Vec<u32> {
    one_handle(region, None).resolve(mesh).expect("a region with vertices").handles[0].vertices.as_slice().to_vec()
}

fn where_true(mesh: &TriMesh, holds: impl Fn(DVec3) -> bool) -> Vec<u32> {
    (0..mesh.vertex_count() as u32).filter(|&v| holds(mesh.positions[v as usize])).collect()
}

/// The error message of a scene text, which must have one.
fn message(json: &str) -> String {
    Scene::parse(json.as_bytes(), "test.json").expect_err("a faulty scene").to_string()
}

/// A scene of one handle `left hand` with the given region and what follows it.
fn with_region(rest: &str) -> String {
    format!(r#"{{"name": "s", "handles": [{{"name": "left hand", "region": {rest}}}]}}"#)
}

#[test]
fn the_test_box_is_closed() {
    let mesh = tower();
    mesh.topology().require_closed().expect("closed");
    mesh.topology().require_oriented().expect("oriented");
    assert!((mesh.signed_volume() - 4.0 * 24.0 * 3.0).abs() < 1e-9);
}

#[test]
fn a_box_keeps_what_its_limits_allow() {
    let mesh = tower();
    let n = |p: DVec3| mesh.bounds().to_box(p);
    let (min, max) = ([None, Some(0.25), None], [Some(0.5), Some(0.75), None]);
    let expected = where_true(&mesh, |p| n(p).x <= 0.5 && n(p).y >= 0.25 && n(p).y <= 0.75);
    assert!(!expected.is_empty());
    assert_eq!(held(&mesh, SceneRegion::Box { min, max }), expected);
    // Without limits it is the whole shape.
    let everything = SceneRegion::Box { min: [None; 3], max: [None; 3] };
    assert_eq!(held(&mesh, everything).len(), mesh.vertex_count());
}

#[test]
fn a_sphere_is_a_ball_in_space_even_on_a_long_box() {
    let mesh = tower();
    let diagonal = (16.0_f64 + 576.0 + 9.0).sqrt();
    let centre = DVec3::new(-1.0, 34.0, 3.5);
    let expected = where_true(&mesh, |p| p.distance(centre) <= 0.1 * diagonal);
    assert!(expected.len() > 10);
    assert_eq!(held(&mesh, SceneRegion::Sphere { centre: DVec3::new(0.5, 1.0, 0.5), radius: 0.1 }), expected);
}

#[test]
fn a_half_space_keeps_the_side_its_normal_points_to_whatever_the_normals_length() {
    let mesh = tower();
    let normal = DVec3::new(1.0, -2.0, 0.5);
    let point = DVec3::new(-1.1, 22.3, 3.6);
    let expected = where_true(&mesh, |p| (p - point).dot(normal) >= 0.0);
    assert!(!expected.is_empty() && expected.len() < mesh.vertex_count());
    for length in [1.0, 1e-300, 1e300] {
        let point = mesh.bounds().to_box(point);
        assert_eq!(held(&mesh, SceneRegion::HalfSpace { point, normal: length * normal }), expected);
    }
}

/// Round the middle of one side of the box the surface is flat, and the ball stays on it; distances along the edges of a
/// grid whose cells are 1 wide (x) and 2 high (y), with one diagonal, are those of a small Floyd-Warshall.
#[test]
fn a_geodesic_ball_matches_all_pairs_distances() {
    let mesh = box_mesh([2, 3, 2], DVec3::ZERO, DVec3::new(2.0, 6.0, 3.0));
    let n = mesh.vertex_count();
    let mut d = vec![vec![f64::INFINITY; n]; n];
    (0..n).for_each(|v| d[v][v] = 0.0);
    for &[a, b] in mesh.topology().edges() {
        let (a, b) = (a as usize, b as usize);
        d[a][b] = mesh.positions[a].distance(mesh.positions[b]);
        d[b][a] = d[a][b];
    }
    for k in 0..n {
        for i in 0..n {
            for j in 0..n {
                d[i][j] = d[i][j].min(d[i][k] + d[k][j]);
            }
        }
    }
    let source = where_true(&mesh, |p| p == DVec3::new(1.0, 2.0, 0.0))[0] as usize;
    for radius in [0.0, 0.2, 0.45, 0.7, 2.0] {
        let reach = radius * 7.0; // The diagonal of 2 x 6 x 3 is 7.
        let expected: Vec<u32> = (0..n as u32).filter(|&v| d[source][v as usize] <= reach).collect();
        // Slightly outside the box and off the vertex: still nearest to it.
        let near = DVec3::new(0.52, 0.34, -0.1);
        assert_eq!(held(&mesh, SceneRegion::Geodesic { near, radius }), expected, "radius {radius}");
    }
}

#[test]
fn a_geodesic_ball_starts_on_the_surface_and_not_at_an_unused_vertex() {
    let mut positions = tower().positions;
    positions.push(DVec3::new(-1.0, 22.0, 3.5));
    let mesh = TriMesh::new(positions, tower().triangles().to_vec()).expect("a box and a loose vertex");
    let ball = held(&mesh, SceneRegion::Geodesic { near: DVec3::splat(0.5), radius: 0.0 });
    assert_eq!(ball.len(), 1);
    assert!((ball[0] as usize) < mesh.vertex_count() - 1);
}

#[test]
fn all_is_the_intersection_and_any_the_union() {
    let mesh = tower();
    let low = SceneRegion::Box { min: [None; 3], max: [None, Some(0.3), None] };
    let left = SceneRegion::HalfSpace { point: DVec3::splat(0.5), normal: -DVec3::X };
    let n = |p: DVec3| mesh.bounds().to_box(p);
    let (a, b) = (|p: DVec3| n(p).y <= 0.3, |p: DVec3| p.x <= -1.0);
    let all = SceneRegion::All(vec![low.clone(), left.clone()]);
    let any = SceneRegion::Any(vec![low, left]);
    assert_eq!(held(&mesh, all.clone()), where_true(&mesh, |p| a(p) && b(p)));
    assert_eq!(held(&mesh, any.clone()), where_true(&mesh, |p| a(p) || b(p)));
    // They nest.
    let nested = SceneRegion::Any(vec![all, SceneRegion::All(vec![any])]);
    assert_eq!(held(&mesh, nested), where_true(&mesh, |p| a(p) || b(p)));
}

#[test]
fn the_first_region_wins_and_no_vertex_has_two_handles() {
    let mesh = tower();
    let part = |name: &str, to: f64| SceneHandle {
        name: name.to_owned(),
        region: SceneRegion::Box { min: [None; 3], max: [None, Some(to), None] },
        motion: None,
    };
    let scene = Scene { handles: vec![part("a", 0.2), part("b", 0.5)], ..one_handle(part("", 1.0).region, None) };
    let resolved = scene.resolve(&mesh).expect("two handles");
    let owner = resolved.handle_of_vertex(mesh.vertex_count());
    for (v, p) in mesh.positions.iter().enumerate() {
        let y = mesh.bounds().to_box(*p).y;
        let expected = if y <= 0.2 { Some(0) } else { (y <= 0.5).then_some(1) };
        assert_eq!(owner[v], expected);
    }
    let hidden = Scene { handles: vec![part("a", 0.5), part("b", 0.2)], ..scene };
    let error = hidden.resolve(&mesh).expect_err("b is inside a").to_string();
    assert_eq!(error, "scene test, handle 'b': every vertex in its region already belongs to an earlier handle");
}

#[test]
fn goals_run_from_rest_to_the_whole_motion() {
    let mesh = tower();
    let diagonal = mesh.bounds().diagonal();
    let motion = SceneMotion {
        rotate: Some(SceneRotation { axis: DVec3::new(0.0, 0.0, 7.0), degrees: 90.0 }),
        about: Some(DVec3::new(0.5, 0.5, 0.5)),
        translate: DVec3::new(0.0, 0.0, 0.25),
        scale: 4.0,
    };
    let top = SceneRegion::Box { min: [None, Some(0.9), None], max: [None; 3] };
    let resolved = one_handle(top, Some(motion)).resolve(&mesh).expect("a top");
    assert_eq!(resolved.goals(0.0), [Similarity::IDENTITY]);
    // A quarter turn about z takes +x to +y.
    let pivot = DVec3::new(-1.0, 22.0, 3.5);
    let full = resolved.goals(1.0)[0].apply(pivot + DVec3::X);
    assert!(full.distance(pivot + 4.0 * DVec3::Y + 0.25 * diagonal * DVec3::Z) < 1e-12 * diagonal);
    // Half of it: 45 degrees, half the way, twice the size.
    let half = resolved.goals(0.5)[0].apply(pivot + DVec3::X);
    let expected = pivot + 2.0 * DVec3::new((PI / 4.0).cos(), (PI / 4.0).sin(), 0.0) + 0.125 * diagonal * DVec3::Z;
    assert!(half.distance(expected) < 1e-12 * diagonal);
}

#[test]
fn half_way_of_two_turns_is_one_turn() {
    let mesh = tower();
    let rotate = Some(SceneRotation { axis: DVec3::new(1.0, 2.0, 3.0), degrees: 720.0 });
    let everything = SceneRegion::Box { min: [None; 3], max: [None; 3] };
    let scene = one_handle(everything, Some(SceneMotion { rotate, ..SceneMotion::default() }));
    let resolved = scene.resolve(&mesh).expect("everything");
    assert_eq!(resolved.handles[0].motion.map(|m| m.at(0.5)), Some(resolved.goals(0.5)[0]));
    let angle = resolved.handles[0].motion.expect("moves").angle;
    assert!((0.5 * angle - TAU).abs() < 1e-15);
    for &p in &mesh.positions {
        assert!(resolved.goals(0.5)[0].apply(p).distance(p) < 1e-12);
        // A quarter of the way is half a turn about the centre of the region, which is not the identity.
        let centre = mesh.bounds().centre();
        let opposite = resolved.goals(0.25)[0].apply(p) - centre;
        let axis = DVec3::new(1.0, 2.0, 3.0).normalize();
        assert!((opposite + (p - centre) - 2.0 * (p - centre).dot(axis) * axis).length() < 1e-12);
    }
}

/// The same scene on a shape and on a scaled, moved copy of it: the same vertices, and goals that commute with the change.
#[test]
fn a_scene_follows_the_shape_through_scale_and_offset() {
    let mesh = tower();
    let scene = Scene::auto(&mesh.bounds());
    for (scale, offset) in [(1e-9, DVec3::ZERO), (1e9, DVec3::new(-4.0, 7.0, 1.0)), (1.0, DVec3::splat(100.0))] {
        let place = |p: DVec3| scale * (p + offset);
        let copy = mesh.with_positions(mesh.positions.iter().map(|&p| place(p)).collect()).expect("finite");
        let (one, other) = (scene.resolve(&mesh).expect("tower"), scene.resolve(&copy).expect("its copy"));
        assert_eq!(one.handles[1].vertices, other.handles[1].vertices);
        let size = copy.bounds().diagonal();
        for &p in &mesh.positions {
            let error = other.goals(0.7)[1].apply(place(p)).distance(place(one.goals(0.7)[1].apply(p)));
            // Rounding grows with the coordinates' size, at most a few times the copy's own here.
            assert!(error < 1e-13 * size.max(place(p).length()), "{error:e}");
        }
    }
}

#[test]
fn auto_bends_the_long_axis_about_the_short_one_on_boxes_of_every_axis_order() {
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let [long, middle, short] = order;
        let mut size = DVec3::ZERO;
        (size[long], size[middle], size[short]) = (20.0, 5.0, 2.0);
        let mut cells = [0; 3];
        (cells[long], cells[middle], cells[short]) = (20, 5, 2);
        let mesh = box_mesh(cells, DVec3::splat(3.0), DVec3::splat(3.0) + size);
        let resolved = Scene::auto(&mesh.bounds()).resolve(&mesh).expect("both ends hold vertices");
        let [low, high] = &resolved.handles[..] else { panic!("two handles") };
        // 20 cells along: two of the 21 layers at each end are within a tenth (2.0), and the third lies on the limit.
        for v in 0..mesh.vertex_count() as u32 {
            let along = mesh.positions[v as usize][long] - 3.0;
            assert_eq!(low.vertices.contains(v), along < 2.0 + 1e-9, "{along}");
            assert_eq!(high.vertices.contains(v), along > 18.0 - 1e-9, "{along}");
        }
        assert_eq!(low.motion, None);
        let motion = high.motion.expect("the high end moves");
        assert_eq!(motion.axis.abs(), DVec3::AXES[short]);
        assert!((motion.angle - PI / 6.0).abs() < 1e-15);
        let centre = mesh.bounds().from_box(DVec3::splat(0.5)) + 9.0 * DVec3::AXES[long];
        assert!(motion.pivot.distance(centre) < 1e-12);
        // The turn tips the tip's outward direction to the side that the translation goes to.
        let tipped = motion.at(1.0).rotation * DVec3::AXES[long];
        assert!((tipped[middle].abs() - 0.5).abs() < 1e-12, "sin 30 degrees: {tipped}");
        assert!((motion.translation.length() - 0.1 * mesh.bounds().diagonal()).abs() < 1e-12);
        assert!((motion.translation[middle] - motion.translation.length() * tipped[middle].signum()).abs() < 1e-12);
    }
}

#[test]
fn auto_on_a_cube_and_on_a_flat_sheet_takes_distinct_axes() {
    let cube = Scene::auto(&Bounds { min: DVec3::ZERO, max: DVec3::ONE });
    let Some(SceneMotion { rotate: Some(rotate), translate, .. }) = cube.handles[1].motion else { panic!("moves") };
    assert_eq!((rotate.axis, translate), (DVec3::Z, 0.1 * DVec3::Y));
    let sheet = box_mesh([10, 10, 1], DVec3::ZERO, DVec3::new(2.0, 1.0, 0.0));
    assert_eq!(Scene::auto(&sheet.bounds()).resolve(&sheet).expect("two ends").handles.len(), 2);
}

#[test]
fn built_in_scenes_are_named_after_their_files_and_survive_a_round_trip() {
    for name in Scene::builtin_names() {
        let scene = Scene::builtin(name).expect("a built-in scene");
        assert_eq!(scene.name, name);
        let json = scene.to_json().expect("valid");
        assert_eq!(Scene::parse(json.as_bytes(), "round trip").expect("own JSON"), scene);
    }
    let error = Scene::builtin("armadillo").expect_err("unknown").to_string();
    assert_eq!(
        error,
        format!(
            "there is no built-in scene 'armadillo'; there are auto, {}",
            Scene::builtin_names().collect::<Vec<_>>().join(", ")
        )
    );
}

/// At any resolution every handle has vertices and something is left to solve for.
#[test]
fn built_in_scenes_fit_the_shapes_they_name() {
    let mut fitted = 0;
    for name in Scene::builtin_names() {
        let scene = Scene::builtin(name).expect("a built-in scene");
        let Some(shape) = &scene.shape else { continue };
        assert!(name.starts_with(shape), "{name} is for {shape}");
        for vertices in [2000, 9000] {
            let mesh = shapes::by_name(shape, vertices).expect("a generated shape");
            let resolved = scene.resolve(&mesh).expect("every handle has vertices");
            let held: usize = resolved.handles.iter().map(|handle| handle.vertices.len()).sum();
            assert!(held < mesh.vertex_count() * 7 / 8, "{name}: {held} of {} are held", mesh.vertex_count());
        }
        fitted += 1;
    }
    assert!(fitted >= 8);
}

/// The bent cylinder's end is where an arc as long as its axis ends, at a right angle to it.
#[test]
fn the_bend_of_the_cylinder_keeps_the_length_of_its_axis() {
    let mesh = shapes::by_name("cylinder", 5000).expect("in range");
    let scene = Scene::builtin("cylinder-bend-120").expect("built in").resolve(&mesh).expect("fits");
    let goal = scene.goals(1.0)[1];
    let (foot, top) = (DVec3::new(0.0, -1.6, 0.0), DVec3::new(0.0, 1.6, 0.0));
    let angle = 120_f64.to_radians();
    let radius = 3.2 / angle;
    let end = foot + radius * DVec3::new(1.0 - angle.cos(), angle.sin(), 0.0);
    // The scene has four decimals, and the box of a polygon is a little narrower than the circle's.
    assert!(goal.apply(top).distance(end) < 0.02, "{} is not {end}", goal.apply(top));
    let direction = goal.rotation * DVec3::Y;
    assert!(direction.distance(DVec3::new(angle.sin(), angle.cos(), 0.0)) < 1e-12);
}

#[test]
fn armadillo_2_is_armadillo_0_with_angles_times_two_fifths() {
    let (whole, part) = (Scene::builtin("armadillo-0").expect("0"), Scene::builtin("armadillo-2").expect("2"));
    for (a, b) in whole.handles.iter().zip(&part.handles) {
        assert_eq!((&a.name, &a.region), (&b.name, &b.region));
        let (Some(a), Some(b)) = (a.motion, b.motion) else {
            assert_eq!((a.motion, b.motion), (None, None));
            continue;
        };
        let (turn, less) = (a.rotate.expect("turns"), b.rotate.expect("turns"));
        assert!((0.4 * turn.degrees - less.degrees).abs() < 1e-12);
        assert_eq!(SceneMotion { rotate: None, ..a }, SceneMotion { rotate: None, ..b });
    }
    assert_eq!(whole.handles.len(), part.handles.len());
}

#[test]
fn every_part_of_the_format_survives_a_round_trip() {
    let text = r#"{
        "name": "all of it", "description": "é \" \\",
        "handles": [
            { "name": "a", "region": { "box": { "min": [0, null, 0.25] } } },
            { "name": "b", "region": { "sphere": { "center": [0.5, 0.9, 0.7], "radius": 0.1 } }, "motion": {} },
            { "name": "c", "region": { "all": [ { "half_space": { "point": [0, 0.1, 0], "normal": [0, -1, 0] } },
                { "any": [ { "geodesic": { "near": [1, 1, 1], "radius": 0.08 } }, { "box": {} } ] } ] },
              "motion": { "rotate": { "axis": [0, 1, 0], "degrees": 1e3 }, "about": [0.1, 0.2, 0.3],
                "translate": [0, 0.1, 0], "scale": 0.7 } }
        ] }"#;
    let scene = Scene::parse(text.as_bytes(), "test.json").expect("valid");
    assert_eq!(scene.handles[1].motion, Some(SceneMotion::default()));
    assert_eq!(scene.handles[0].region, SceneRegion::Box { min: [Some(0.0), None, Some(0.25)], max: [None; 3] });
    let again = Scene::parse(scene.to_json().expect("valid").as_bytes(), "again").expect("own JSON");
    assert_eq!(again, scene);
    // A byte-order mark changes nothing.
    assert_eq!(Scene::parse(format!("\u{feff}{text}").as_bytes(), "marked").expect("valid"), scene);
}

#[test]
fn syntax_errors_name_file_line_and_column() {
    let error = message("{\n  \"name\": \"s\",\n  \"handels\": []\n}");
    assert!(error.starts_with("test.json:3:") && error.contains("unknown field `handels`"), "{error}");
    assert!(!error.contains("at line"), "{error}");
    for (faulty, says) in [
        ("", "EOF"),
        ("{\"name\": \"s\"}", "missing field `handles`"),
        (&with_region(r#"{"ball": {}}"#), "unknown variant `ball`"),
        (&with_region(r#"{"sphere": {"centre": [0, 0], "radius": 1}}"#), "invalid length 2"),
        (&with_region(r#"{"sphere": {"centre": [0, 0, 0], "radius": NaN}}"#), "expected value"),
        (&with_region(r#"{"sphere": {"centre": [0, 0, 0], "radius": 1e999}}"#), "number out of range"),
        (&with_region(r#"{"box": {"min": [0, 0, 0], "mid": 1}}"#), "unknown field `mid`"),
        (
            &with_region(r#"{"box": {}}, "motion": {"rotate": {"axis": [0,0,1], "radians": 1}}"#),
            "unknown field `radians`",
        ),
        (&with_region(&"{\"all\": [".repeat(200)), "recursion limit exceeded"),
    ] {
        let error = message(faulty);
        assert!(error.starts_with("test.json:1:") && error.contains(says), "{faulty}: {error}");
    }
    // Bytes that are no text are refused, not read as something else.
    assert!(Scene::parse(b"{\"name\": \"\xff\"}", "test.json").is_err());
}

#[test]
fn values_out_of_range_are_named_by_handle_and_path() {
    let in_hand = |rest: &str| message(&with_region(rest));
    for (rest, says) in [
        (
            r#"{"sphere": {"centre": [0,0,0], "radius": -0.1}}"#,
            "region.sphere.radius must be a finite number not below 0, not -0.1",
        ),
        (
            r#"{"any": [{"box": {}}, {"geodesic": {"near": [0,0,0], "radius": -1}}]}"#,
            "region.any[1].geodesic.radius must be a finite number not below 0, not -1",
        ),
        (r#"{"all": []}"#, "region.all must be a list of at least one region, not empty"),
        (
            r#"{"half_space": {"point": [0,0,0], "normal": [0,0,0]}}"#,
            "region.half_space.normal must be three finite numbers that are not all 0, not [0, 0, 0]",
        ),
        (
            r#"{"box": {"min": [0,0.5,0], "max": [1,0.25,1]}}"#,
            "region.box.min.y must be at most the same component of max, not 0.5 above 0.25",
        ),
        (r#"{"box": {}}, "motion": {"scale": 0}"#, "motion.scale must be a finite number above 0, not 0"),
        (
            r#"{"box": {}}, "motion": {"rotate": {"axis": [0,0,0], "degrees": 10}}"#,
            "motion.rotate.axis must be three finite numbers that are not all 0, not [0, 0, 0]",
        ),
    ] {
        assert_eq!(in_hand(rest), format!("test.json: scene s, handle 'left hand': {says}"));
    }
    assert_eq!(
        message(r#"{"name": "s", "handles": []}"#),
        "test.json: scene s: handles must be a list of at least one handle, not empty"
    );
    let twice =
        r#"{"name": "s", "handles": [{"name": "a", "region": {"box": {}}}, {"name": "a", "region": {"box": {}}}]}"#;
    assert_eq!(message(twice), "test.json: scene s: handles[1].name must be used once, not 'a' again");
}

/// JSON has no NaN, but a scene made by code may.
#[test]
fn numbers_that_are_not_finite_are_refused_by_name() {
    let everything = SceneRegion::Box { min: [None; 3], max: [None; 3] };
    let rotate = Some(SceneRotation { axis: DVec3::X, degrees: f64::NAN });
    let scene = one_handle(everything.clone(), Some(SceneMotion { rotate, ..SceneMotion::default() }));
    let says = "scene test, handle 'only': motion.rotate.degrees must be a finite number, not NaN";
    assert_eq!(scene.resolve(&tower()).expect_err("NaN").to_string(), says);
    assert_eq!(scene.to_json().expect_err("NaN").to_string(), says);
    let limit = SceneRegion::Box { min: [None, None, Some(f64::INFINITY)], max: [None; 3] };
    let error = one_handle(limit, None).check().expect_err("infinite").to_string();
    assert_eq!(error, "scene test, handle 'only': region.box.min.z must be a finite number or null, not inf");
    // Finite in the scene, but not once it is multiplied by the diagonal.
    let far = SceneMotion { translate: DVec3::splat(1e308), ..SceneMotion::default() };
    let error = one_handle(everything, Some(far)).resolve(&tower()).expect_err("overflow").to_string();
    assert!(error.starts_with("scene test, handle 'only': motion must be finite"), "{error}");
}

#[test]
fn an_empty_region_and_a_shape_without_extent_are_named() {
    let outside = SceneRegion::Box { min: [Some(2.0), None, None], max: [None; 3] };
    let error = one_handle(outside, None).resolve(&tower()).expect_err("outside").to_string();
    assert_eq!(error, "scene test, handle 'only': its region holds no vertex of this shape");
    for positions in [vec![], vec![DVec3::ONE; 3]] {
        let point = TriMesh::new(positions, vec![]).expect("vertices without faces");
        let error = Scene::auto(&point.bounds()).resolve(&point).expect_err("no extent").to_string();
        assert_eq!(error, "scene auto: the shape's bounding box has a diagonal of 0, so regions mean nothing on it");
    }
}

#[test]
fn files_are_found_by_name_and_refused_when_too_large() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("own.json");
    let scene = Scene { name: "own".to_owned(), ..Scene::builtin("armadillo-2").expect("built in") };
    std::fs::write(&file, scene.to_json().expect("valid")).expect("written");
    let name = file.to_str().expect("a plain path");
    let bounds = tower().bounds();
    assert_eq!(Scene::find(name, &bounds).expect("a file"), scene);
    assert_eq!(Scene::find("auto", &bounds).expect("auto"), Scene::auto(&bounds));
    assert_eq!(Scene::find("armadillo-2", &bounds).expect("built in").name, "armadillo-2");
    assert!(matches!(Scene::find("nothing", &bounds), Err(SceneError::UnknownName { .. })));
    assert!(matches!(Scene::find("nothing.json", &bounds), Err(SceneError::Read { .. })));
    std::fs::write(&file, " ".repeat(MAX_FILE_BYTES as usize + 1)).expect("written");
    let error = Scene::read(&file).expect_err("too large").to_string();
    assert!(error.starts_with(name) && error.contains("at most 1048576 bytes"), "{error}");
}

#[test]
fn classic_scenes_are_built_in_and_have_a_shape() {
    for name in Scene::classic_names() {
        let scene = Scene::builtin(name).expect("built in");
        assert!(scene.shape.is_some_and(|shape| shapes::NAMES.contains(&shape.as_str())), "{name}");
    }
}
