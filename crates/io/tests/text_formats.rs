//! OBJ, OFF and text STL: small literal files, each with what it shows.

mod common;

use common::{CUBE_OBJ, CUBE_OFF, binary_stl, error, read, sphere, tetrahedron_stl};
use glam::DVec3;
use pliant_io::Format;

/// A cube of quads becomes twelve triangles that bound a volume of 1, so every fan is turned outwards.
#[test]
fn quads_become_fans() {
    for (text, format) in [(CUBE_OBJ, Format::Obj), (CUBE_OFF, Format::Off), (common::CUBE_PLY, Format::Ply)] {
        let cube = read(text, format);
        assert_eq!((cube.mesh.vertex_count(), cube.mesh.face_count()), (8, 12), "{format:?}");
        assert_eq!((cube.report.file_faces, cube.report.triangulated), (6, 6));
        assert_eq!(cube.weld, [0, 1, 2, 3, 4, 5, 6, 7]);
        // Exact: all coordinates are 0 or 1.
        assert_eq!(cube.mesh.signed_volume(), 1.0);
        assert!(cube.mesh.topology().require_closed().is_ok());
        assert!(cube.report.dropped.is_empty(), "{:?}", cube.report.dropped);
    }
}

/// Vertices keep their order and number even where groups, objects and materials change and where no face uses them.
#[test]
fn obj_groups_do_not_split() {
    let text = "mtllib a b\\nonsense.mtl\no one\nv 9 9 9\nv 0 0 0\nusemtl \ng a b\nv 1 0 0\nf 2 3 4\nv 0 1 0\n\
        usemtl \u{e9}\ns off\nv 0 0 1\nf 2 4 5\n";
    // The accented name in Latin-1, which is not UTF-8.
    let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
    let asset = read(latin, Format::Obj);
    assert_eq!(asset.mesh.positions[0], DVec3::splat(9.0));
    assert_eq!(asset.mesh.triangles(), [[1, 2, 3], [1, 3, 4]]);
    assert_eq!(asset.report.clean.unused_vertices, 1);
    assert_eq!(asset.report.dropped["material statements"], 3);
    assert_eq!(asset.report.dropped["object and group names"], 2);
}

/// Corners name a vertex, and may name a texture coordinate and a normal; negative numbers count back from the last vertex.
#[test]
fn obj_corners() {
    let start = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";
    for face in ["f 1 2 3", "f 1/1 2/1 3/1", "f 1//1 2//1 3//1", "f 1/1/1 2/1/1 3/1/1", "f -3 -2 -1", "f -3/-1/-1 2 3"]
    {
        let asset = read(format!("{start}{face}\nv 5 5 5"), Format::Obj);
        assert_eq!(asset.mesh.triangles(), [[0, 1, 2]], "{face}");
    }
}

/// A backslash joins lines, but not in a comment; ends of lines, tabs, comments after data and a byte-order mark do not matter.
#[test]
fn obj_lines() {
    let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for text in [
        "v 0 \\\n0 0\nv 1 0 0\nv 0 1 0\nf 1 \\\n 2 \\\n 3".to_owned(),
        "# from C:\\models\\\nv 0 0 0 # first \\\nv\t1 0 0\n\n  v 0 1 0\t\nf 1 2 3 # only".to_owned(),
        plain.replace('\n', "\r\n"),
        plain.replace('\n', "\r"),
        plain.replace("v 1", "v \\\r\n1").replace("\nv 0 1", "\r\nv 0 1"),
        format!("\u{feff}{plain}"),
    ] {
        let asset = read(&text, Format::Obj);
        assert_eq!(asset.mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::Y], "{text:?}");
        assert_eq!(asset.mesh.triangles(), [[0, 1, 2]]);
    }
}

/// Numbers after the position are a weight, which does not divide it, or a colour; all digits of an f64 count.
#[test]
fn obj_vertex_numbers() {
    let text = "v 1000000.0000000001 .5 -1.e-3 2\nv 0 0 0 0.1 0.2 0.3\nv 0 1 0 1 1 1 1\nf 1 2 3\n";
    let asset = read(text, Format::Obj);
    assert_eq!(asset.mesh.positions[0], DVec3::new(1_000_000.000_000_000_1, 0.5, -0.001));
    assert_eq!(asset.report.dropped["vertex weights (w)"], 1);
    assert_eq!(asset.report.dropped["vertex colours"], 2);
}

/// Two vertices that differ in the last bit stay two; equal ones become one, and the weld map says which.
#[test]
fn welding_is_exact() {
    let text = "v 1 0 0\nv 1.0000000000000002 0 0\nv 0 1 0\nv 1.0 0 0\nf 1 3 2\nf 4 2 3\n";
    let asset = read(text, Format::Obj);
    assert_eq!(asset.weld, [0, 1, 2, 0]);
    assert_eq!((asset.report.clean.welded, asset.mesh.face_count()), (1, 2));
}

/// Lines, points and faces of two corners are counted, not turned into triangles.
#[test]
fn what_is_no_face_is_counted() {
    let asset = read("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\np 1\nf 1 2\nf 1 2 3\nf 2 3 2\nwhat 1\n", Format::Obj);
    assert_eq!(asset.mesh.face_count(), 1);
    let dropped = &asset.report.dropped;
    assert_eq!((dropped["lines"], dropped["points"], dropped["unknown statements"]), (1, 1, 1));
    assert_eq!(dropped["faces with fewer than three corners"], 1);
    assert_eq!(asset.report.clean.degenerate_faces, 1);
}

/// A message says on which line what is wrong.
#[test]
fn obj_errors_name_the_line() {
    let start = "v 0 0 0\r\nv 1 0 0\n\nv 0 1 0\n";
    for (line, expected) in [
        ("v 1 2", "<bytes>:5: a vertex needs 3 coordinates, this one has 2"),
        ("v 1 2 x", "<bytes>:5: \"x\" is not a number"),
        ("v 1 nan 2", "<bytes>:5: \"nan\" is not a finite number"),
        ("v 1 1e999 2", "<bytes>:5: \"1e999\" is not a finite number"),
        ("f 1 2 4", "<bytes>:5: the face names vertex 4, but the file has 3"),
        ("f 0 1 2", "<bytes>:5: a face names vertex 0, but vertices are numbered from 1"),
        ("f 1 2 -4", "<bytes>:5: the face names vertex -4, but only 3 vertices come before it"),
        ("f 1 2 3.5", "<bytes>:5: \"3.5\" is not a face corner"),
        ("f 1 2 99999999999", "<bytes>:5: the face names vertex 99999999999"),
        ("f 1 2 -9223372036854775808", "<bytes>:5: the face names vertex"),
        ("# no face", "<bytes>: there are no faces (3 vertices)"),
    ] {
        let found = error(format!("{start}{line}\n"), Format::Obj);
        assert!(found.starts_with(expected), "{line}: {found}");
    }
}

/// Colours, normals and texture coordinates follow the position whatever the first word says; the counts may share its
/// line, even without a space (as in ModelNet), the number of edges may be missing, and the word too.
#[test]
fn off_headers() {
    for text in [
        "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2 1 0 0\n",
        "NOFF 3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n",
        "STOFF\n3 1\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
        "OFF3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "# made by hand\n\n3 1 0\n0 0 0 # origin\n\n1 0 0\n# middle\n0 1 0\n3 0 1 2\n",
        "OFF # three vertices\r\n3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2",
    ] {
        let asset = read(text, Format::Off);
        assert_eq!(asset.mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::Y], "{text:?}");
        assert_eq!(asset.mesh.triangles(), [[0, 1, 2]]);
    }
}

#[test]
fn off_errors_name_the_line() {
    for (text, expected) in [
        ("", "<bytes>: the file is empty"),
        ("PLY\n", "<bytes>:1: \"PLY\" is not the start of an OFF file"),
        ("4OFF\n1 1 1\n", "<bytes>:1: \"4OFF\" is not a whole number"),
        ("OFF BINARY\n", "<bytes>:1: binary OFF is not supported"),
        ("OFF\n3\n", "<bytes>:2: the numbers of vertices and faces"),
        ("OFF\n3 -1 0\n", "<bytes>:2: \"-1\" is not a whole number"),
        ("OFF\n18446744073709551615 9 0\n0 0 0\n", "<bytes>:2: 18446744073709551615 vertices and 9 faces are declared"),
        ("OFF\n2 1 0\n0 0 0\n3 0 0 0\n", "<bytes>:4: the file ends at face 0 of the 1 declared"),
        ("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "<bytes>:4: the face names vertex 1, but there are 1"),
        ("OFF\n1 1 0\n0 0 0\n9 0 0\n", "<bytes>:4: a face of 9 corners has only 2"),
        ("OFF\n1 1 0\n0 0 inf\n3 0 0 0\n", "<bytes>:3: \"inf\" is not a finite number"),
    ] {
        let found = error(text, Format::Off);
        assert!(found.starts_with(expected), "{text:?}: {found}");
    }
}

/// STL repeats every corner; welding finds the tetrahedron again, of volume 1/6 and closed.
#[test]
fn stl_is_welded() {
    let text = tetrahedron_stl();
    let upper = text.to_uppercase().replace("SOLID TETRAHEDRON", "SOLID").replace('\n', "\r\n");
    for text in [&text, &upper] {
        let asset = read(text, Format::Stl);
        assert_eq!((asset.mesh.vertex_count(), asset.report.file_vertices, asset.report.clean.welded), (4, 12, 8));
        assert!((asset.mesh.signed_volume() - 1.0 / 6.0).abs() < 1e-15);
        assert!(asset.mesh.topology().require_closed().is_ok());
    }
}

/// A binary file may begin with the word that begins text files; its length tells. Bytes after the last triangle are counted.
#[test]
fn binary_stl_by_length() {
    let mesh = sphere(1);
    for header in ["", "solid made by an exporter"] {
        let mut bytes = binary_stl(&mesh, header.as_bytes());
        let asset = read(&bytes, Format::Stl);
        assert_eq!((asset.mesh.vertex_count(), asset.mesh.face_count()), (18, 32));
        bytes.truncate(bytes.len() - 1);
        let found = error(&bytes, Format::Stl);
        let expected = if header.is_empty() { "<bytes>: truncated: 1683 of the 1684 bytes" } else { "<bytes>:1: " };
        assert!(found.starts_with(expected), "{found}");
    }
    let mut longer = binary_stl(&mesh, b"");
    longer.extend(b"\n\n\n");
    assert_eq!(read(&longer, Format::Stl).report.dropped["bytes after the last triangle"], 3);
}

#[test]
fn stl_errors_name_the_place() {
    for (text, expected) in [
        ("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n", "<bytes>:4: a vertex needs 3 coordinates"),
        ("solid a\nvertex 0 0 0\n", "<bytes>:2: \"vertex\" is not expected here"),
        ("solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", "<bytes>:4: the file ends inside a solid"),
        ("solid a\nendsolid a\n", "<bytes>: there are no faces (0 vertices)"),
        ("nothing", "<bytes>: 7 bytes are neither text STL nor"),
    ] {
        let found = error(text, Format::Stl);
        assert!(found.starts_with(expected), "{text:?}: {found}");
    }
    let mut bytes = binary_stl(&sphere(0), b"");
    bytes[84 + 50 + 12..84 + 50 + 16].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(error(&bytes, Format::Stl).starts_with("<bytes>: at byte 134: triangle 1: vertex 3 has a coordinate"));
}
