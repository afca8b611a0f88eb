//! Pictures: areas, depth, cameras, colours and sameness.

mod common;

use common::sphere;
use glam::DVec3;
use pliant_io::picture::{
    Picture, PictureOptions, SheetCell, SheetRow, Values, View, colour_map, contact_sheet, render, render_values,
    strip, trim_alike, write_png,
};
use pliant_mesh::TriMesh;

const FRONT: View = View { from: DVec3::Z, up: DVec3::Y };

fn small() -> PictureOptions {
    PictureOptions { width: 240, height: 180, view: FRONT, ..PictureOptions::default() }
}

fn covered(picture: &Picture) -> usize {
    picture.rgb.chunks_exact(3).filter(|p| *p != [255, 255, 255]).count()
}

/// A square of side 1 at `z`, seen from +z, its middle at (x, 0).
fn square(x: f64, z: f64) -> Vec<DVec3> {
    [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(a, b)| DVec3::new(x + a, b, z)).to_vec()
}

fn squares(places: &[(f64, f64)]) -> TriMesh {
    let positions = places.iter().flat_map(|&(x, z)| square(x, z)).collect();
    let faces = (0..places.len() as u32).flat_map(|i| [[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    TriMesh::new(positions, faces.collect()).expect("squares")
}

/// A sphere's outline is a disc from every side. Its diameter is 92 % of the shorter side (4 % margins), so of a height
/// of 180 its area is pi/4 (0.92 * 180)^2 pixels; pixels that the outline only touches, at most its length of
/// pi * 0.92 * 180 pixels times sqrt 2, are coloured too.
#[test]
fn a_sphere_covers_its_disc() {
    let diameter = 0.92 * 180.0;
    let area = std::f64::consts::PI / 4.0 * diameter * diameter;
    let outline = std::f64::consts::PI * diameter * std::f64::consts::SQRT_2;
    for from in [DVec3::X, DVec3::Y, DVec3::new(1.0, -2.0, 0.5), View::default().from] {
        for wireframe in [false, true] {
            let options = PictureOptions { view: View { from, up: DVec3::Y }, wireframe, ..small() };
            let found = covered(&render(&sphere(5), &options).expect("a picture")) as f64;
            assert!(found > area - outline && found < area + outline, "{found} of {area} from {from}");
        }
    }
}

/// Of two squares one behind the other only the nearer is seen, whichever comes first in the mesh.
#[test]
fn the_nearer_face_hides_the_farther() {
    let values =
        |near_first: bool| -> Vec<f64> { (0..8).map(|v| f64::from(u8::from((v < 4) == near_first))).collect() };
    for near_first in [true, false] {
        let (first, second) = if near_first { (1.0, -1.0) } else { (-1.0, 1.0) };
        let mesh = squares(&[(0.0, first), (0.0, second)]);
        let values = values(near_first);
        let coloured = Values { of_vertices: &values, range: (0.0, 1.0) };
        let picture = render_values(&mesh, coloured, &small()).expect("a picture");
        // The near square has value 1, which is yellow (little blue); the far one violet (more blue than green).
        for (x, y) in [(120, 90), (60, 30), (180, 150)] {
            let [_, green, blue] = picture.pixel(x, y);
            assert!(green > 2 * blue, "{:?} at {x}, {y}", picture.pixel(x, y));
        }
    }
}

/// With one framing for both, what did not move is in the same pixels: here the left of two squares.
#[test]
fn pictures_share_a_camera() {
    let before = squares(&[(-2.0, 0.0), (1.0, 0.0)]);
    let after = squares(&[(-2.0, 0.0), (1.8, 0.3)]);
    let all: Vec<DVec3> = before.positions.iter().chain(&after.positions).copied().collect();
    let options = PictureOptions { framing: all, ..small() };
    let [a, b] = [before, after].map(|m| render(&m, &options).expect("a picture"));
    assert_ne!(a, b);
    for y in 0..a.height {
        for x in 0..a.width / 2 {
            assert_eq!(a.pixel(x, y), b.pixel(x, y), "at {x}, {y}");
        }
    }
}

/// The projection keeps the picture upright and unmirrored: a triangle's corner on the +x side is on the right, the one
/// on the +y side at the top.
#[test]
fn up_is_up_and_right_is_right() {
    let mesh = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).expect("a triangle");
    let picture = render(&mesh, &small()).expect("a picture");
    // The right angle is at the lower left; 92 % of 180 pixels is the side, 180 - 7 the bottom, 120 - 83 the left.
    assert_ne!(picture.pixel(40, 170), [255; 3]);
    assert_ne!(picture.pixel(195, 170), [255; 3]);
    assert_ne!(picture.pixel(40, 15), [255; 3]);
    assert_eq!(picture.pixel(195, 15), [255; 3]);
    // From behind, x runs to the left.
    let behind = PictureOptions { view: View { from: DVec3::NEG_Z, up: DVec3::Y }, ..small() };
    let picture = render(&mesh, &behind).expect("a picture");
    assert_eq!(picture.pixel(40, 15), [255; 3]);
    assert_ne!(picture.pixel(195, 15), [255; 3]);
}

/// The picture does not depend on where the mesh is, how large it is, or on the number of threads.
#[test]
fn the_same_picture() {
    let mesh = sphere(4);
    let relief = |p: &DVec3| *p * (1.0 + 0.02 * (20.0 * p.x).sin() * (20.0 * p.y).sin());
    let mesh = mesh.with_positions(mesh.positions.iter().map(relief).collect()).expect("finite");
    let options = PictureOptions { view: View::default(), ..small() };
    let picture = render(&mesh, &options).expect("a picture");
    assert_eq!(render(&mesh, &options), Ok(picture.clone()));
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        assert_eq!(pool.install(|| render(&mesh, &options)), Ok(picture.clone()), "{threads} threads");
    }
    // A power of two scales without rounding, so the bits are the same.
    let scaled = mesh.with_positions(mesh.positions.iter().map(|p| *p * 1024.0).collect()).expect("finite");
    assert_eq!(render(&scaled, &options), Ok(picture));
}

/// Relief of 1 % of the size is seen. Waves of that height (0.035 from top to bottom, the sphere's diagonal being 3.46)
/// and 0.35 apart tilt the surface by 0.16 (rms), which changes the light by some 15 % where it comes from the side, that
/// is the sRGB value by 6 %: half of all bytes must change by a third of this, 5 of 255, at least.
#[test]
fn small_relief_shows() {
    let smooth = sphere(5);
    let bump = |p: &DVec3| *p * (1.0 + 0.0175 * (18.0 * p.x).sin() * (18.0 * p.y).sin());
    let bumpy = smooth.with_positions(smooth.positions.iter().map(bump).collect()).expect("finite");
    let options = PictureOptions { framing: smooth.positions.clone(), ..small() };
    let [a, b] = [&smooth, &bumpy].map(|m| render(m, &options).expect("a picture"));
    let differ = a.rgb.iter().zip(&b.rgb).filter(|(a, b)| a.abs_diff(**b) >= 5).count();
    assert!(2 * differ > 3 * covered(&a), "{differ} of {} bytes", 3 * covered(&a));
}

/// Lines are dark where edges are and nowhere else: on a square of two triangles, along the sides and one diagonal.
#[test]
fn wireframe_draws_edges() {
    let mesh = squares(&[(0.0, 0.0)]);
    let picture = render(&mesh, &PictureOptions { wireframe: true, ..small() }).expect("a picture");
    let dark = |x, y| picture.pixel(x, y)[0] < 150;
    // The diagonal from the lower left to the upper right, through the middle.
    assert!(dark(120, 90) || dark(119, 90));
    assert!((dark(80, 130) || dark(79, 130)) && (dark(160, 50) || dark(159, 50)));
    assert!(!dark(80, 50) && !dark(160, 130));
}

/// The inner side of a face is darker, so an inside-out mesh is seen as one.
#[test]
fn inner_sides_differ() {
    let light = |from| {
        let picture = render(&squares(&[(0.0, 0.0)]), &PictureOptions { view: View { from, up: DVec3::Y }, ..small() });
        picture.expect("a picture").pixel(120, 90).iter().map(|&c| u32::from(c)).sum::<u32>()
    };
    assert!(2 * light(DVec3::NEG_Z) < light(DVec3::Z) + light(DVec3::Z) / 2);
}

#[test]
fn bad_options_are_refused() {
    let mesh = sphere(1);
    let wrong = |options: PictureOptions| render(&mesh, &options).expect_err("a bad option").to_string();
    assert!(
        wrong(PictureOptions { width: 0, ..small() }).starts_with("a picture's size must be 1 to 268435456 samples")
    );
    assert!(wrong(PictureOptions { width: u32::MAX, height: u32::MAX, ..small() }).starts_with("a picture's size"));
    assert!(wrong(PictureOptions { supersampling: 9, ..small() }).ends_with("must be 1 to 8, not 9"));
    assert!(wrong(PictureOptions { view: View { from: DVec3::ZERO, up: DVec3::Y }, ..small() }).contains("view"));
    let values = Values { of_vertices: &[0.0], range: (0.0, 1.0) };
    let found = render_values(&mesh, values, &small()).expect_err("one value").to_string();
    assert_eq!(found, "1 values given for a mesh of 18 vertices");
    let values = Values { of_vertices: &[0.0; 18], range: (1.0, 1.0) };
    assert!(render_values(&mesh, values, &small()).is_err());
    // Looking straight down is fine: another direction is up.
    assert!(render(&mesh, &PictureOptions { view: View { from: DVec3::Y, up: DVec3::Y }, ..small() }).is_ok());
}

/// One pixel, one colour at the ends of the range and beyond; NaN is grey.
#[test]
fn colours_of_values() {
    assert_eq!(colour_map(-3.0), colour_map(0.0));
    assert_eq!(colour_map(7.0), colour_map(1.0));
    assert_eq!(colour_map(f64::NAN), [128; 3]);
}

/// Pictures stand side by side from left to right with gaps; trimming cuts all of them alike.
#[test]
fn strips_and_margins() {
    let mut a = Picture::filled(10, 6, [255; 3]);
    let mut b = Picture::filled(10, 6, [255; 3]);
    a.rgb[3 * (2 * 10 + 3)] = 0;
    b.rgb[3 * (4 * 10 + 7)] = 0;
    let trimmed = trim_alike(&[a.clone(), b], 1, [255; 3]);
    // Columns 3 to 7 and rows 2 to 4 and one more on each side; row 6 would be outside.
    assert_eq!(trimmed.iter().map(|p| (p.width, p.height)).collect::<Vec<_>>(), [(7, 5), (7, 5)]);
    assert_eq!((trimmed[0].pixel(1, 1), trimmed[1].pixel(5, 3)), ([0, 255, 255], [0, 255, 255]));
    let joined = strip(&[a, Picture::filled(2, 2, [9; 3])], 3, [1; 3]);
    assert_eq!((joined.width, joined.height), (15, 6));
    assert_eq!((joined.pixel(3, 2), joined.pixel(11, 2)), ([0, 255, 255], [1; 3]));
    assert_eq!((joined.pixel(13, 2), joined.pixel(14, 3), joined.pixel(13, 4)), ([9; 3], [9; 3], [1; 3]));
    assert_eq!(strip(&[], 5, [0; 3]).rgb.len(), 0);
}

/// Pictures stand in a grid of equal columns under their headings; a place may stay empty, and rows may differ in length.
#[test]
fn contact_sheets() {
    let (red, blue) = (Picture::filled(40, 20, [255, 0, 0]), Picture::filled(30, 10, [0, 0, 255]));
    let cell = |picture: Option<&Picture>| SheetCell { picture: picture.cloned(), caption: "caption".to_owned() };
    let rows = [
        SheetRow { title: "first".to_owned(), cells: vec![cell(Some(&red)), cell(Some(&blue)), cell(None)] },
        SheetRow { title: "second".to_owned(), cells: vec![cell(Some(&blue))] },
    ];
    let sheet = contact_sheet(&["a".to_owned(), "b".to_owned()], &rows, [255; 3]);
    let pixels = |colour: [u8; 3]| sheet.rgb.chunks_exact(3).filter(|pixel| *pixel == colour).count();
    // Every picture is there, whole.
    assert_eq!((pixels([255, 0, 0]), pixels([0, 0, 255])), (40 * 20, 2 * 30 * 10));
    let first = |colour: [u8; 3]| {
        let at = sheet.rgb.chunks_exact(3).position(|pixel| pixel == colour).expect("drawn") as u32;
        (at % sheet.width, at / sheet.width)
    };
    // The smaller picture is in the middle of the second column, its row as high as the first one's.
    let ((x, y), (right, below)) = (first([255, 0, 0]), first([0, 0, 255]));
    assert_eq!((right - x - (sheet.width - 8) / 3, below - y), (5, 5));
    // Words are as wide as their letters: with less room nothing is written over the edge.
    let mut narrow = Picture::filled(9, 13, [255; 3]);
    narrow.write_text(0, 0, "MMMM", [0; 3]);
    assert!(narrow.rgb.contains(&0) && narrow.rgb.len() == 9 * 13 * 3);
    let blank = narrow.clone();
    narrow.write_text(9, 0, "M", [7; 3]);
    narrow.write_text(u32::MAX, u32::MAX, "M", [7; 3]);
    assert_eq!(narrow, blank);
    assert_eq!(contact_sheet(&[], &[], [0; 3]).rgb.len(), 0);
}

/// Width, height and bytes (red, green, blue) of a PNG.
fn decoded(png: impl std::io::BufRead + std::io::Seek) -> (u32, u32, Vec<u8>) {
    let mut decoder = png::Decoder::new(png);
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().expect("a PNG");
    let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut rgb).expect("an image");
    (info.width, info.height, rgb)
}

/// A PNG holds the picture's bytes, and only a file with that extension is written.
#[test]
fn png_round_trip() {
    let picture = render(&sphere(2), &PictureOptions { width: 31, height: 17, ..small() }).expect("a picture");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sphere.png");
    write_png(&path, &picture).expect("written");
    let file = std::io::BufReader::new(std::fs::File::open(&path).expect("there"));
    assert_eq!(decoded(file), (31, 17, picture.rgb.clone()));
    assert!(write_png(&folder.path().join("sphere.jpg"), &picture).is_err());
    let broken = Picture { width: 2, ..picture };
    assert!(write_png(&path, &broken).is_err() && broken.to_small_png().is_err());
}

/// With few colours a small PNG is exact. With many it takes half the bytes and is off by less than 3 of 255 (root mean square), the
/// background by nothing; a colour of 30 pixels among 20,000 is still told from those round it.
#[test]
fn small_pngs() {
    let few = Picture { width: 16, height: 16, rgb: (0..=255).flat_map(|i| [i, 7, 255 - i]).collect() };
    assert_eq!(decoded(std::io::Cursor::new(few.to_small_png().expect("a PNG"))), (16, 16, few.rgb));

    let mesh = sphere(5);
    let spot: Vec<f64> = mesh.positions.iter().map(|p| f64::from(u8::from(p.z > 0.995))).collect();
    let values = Values { of_vertices: &spot, range: (0.0, 1.0) };
    let picture = render_values(&mesh, values, &small()).expect("a picture");
    let bytes = picture.to_small_png().expect("a PNG");
    let exact = picture.to_png().expect("a PNG").len();
    assert!(2 * bytes.len() < exact, "{} of {exact} bytes", bytes.len());
    let (_, _, rgb) = decoded(std::io::Cursor::new(bytes));
    let squares: f64 = rgb.iter().zip(&picture.rgb).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    let off = (squares / rgb.len() as f64).sqrt();
    assert!(off < 3.0, "{off}");
    let small = Picture { rgb, ..picture.clone() };
    assert_eq!(covered(&small), covered(&picture));
    let yellow = |p: &Picture| p.rgb.chunks_exact(3).filter(|c| c[0] > 150 && c[2] < 100).count();
    let (before, after) = (yellow(&picture), yellow(&small));
    assert!(before > 30 && after.abs_diff(before) <= before / 4, "{after} of {before} pixels");
}

/// Views are read as they are written, by name or by number, and the names mean what they say.
#[test]
fn views_as_text() {
    for name in ["front", "back", "left", "right", "top", "bottom", "iso"] {
        let view: View = name.parse().expect("a view");
        assert_eq!(view.to_string(), name);
        assert_eq!(view.from.dot(view.up) == 0.0, name != "iso");
    }
    let seen_from = |text: &str| text.parse::<View>().expect("a view").from;
    assert_eq!((seen_from("front"), seen_from("right"), seen_from("top")), (DVec3::Z, DVec3::X, DVec3::Y));
    for view in [
        View::default(),
        View { from: DVec3::new(0.1, -2e-9, 3e40), up: DVec3::Y },
        View { from: DVec3::new(0.5, -1.0, 0.45), up: DVec3::Z },
    ] {
        assert_eq!(view.to_string().parse::<View>(), Ok(view));
        let json = serde_json::to_string(&view).expect("text");
        assert_eq!(serde_json::from_str::<View>(&json).expect("a view"), view);
    }
    assert_eq!(" 0.5, -1 ,0.45 ".parse::<View>(), Ok(View { from: DVec3::new(0.5, -1.0, 0.45), up: DVec3::Y }));
    for wrong in ["", "Front", "1,2", "1,2,3,4", "0,0,0", "1,2,inf", "nan,0,1", "1e400,0,0", "1,2,3,0,0,0", "1,2,3,"] {
        let error = wrong.parse::<View>().expect_err("no view").to_string();
        assert!(
            error.starts_with("a picture's view must be front, back, left, right, top, bottom, iso, or"),
            "{error}"
        );
        assert!(error.ends_with(&format!("not `{wrong}`")), "{error}");
        assert!(serde_json::from_str::<View>(&format!("\"{wrong}\"")).is_err());
    }
}
