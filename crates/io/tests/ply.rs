//! PLY: text and both byte orders, and what may stand between.

mod common;

use common::{CUBE_PLY, error, read};
use glam::DVec3;
use pliant_io::Format;

/// Header of a triangle with a colour at each vertex and a list between; `rest` is what stands after the vertices.
fn header(encoding: &str, rest: &str) -> Vec<u8> {
    format!(
        "ply\r\nformat {encoding} 1.0\r\ncomment caf\u{e9}\r\nelement vertex 3\r\nproperty double x\r\n\
         property list uint8 int16 marks\r\nproperty float32 y\r\nproperty short z\r\nproperty uchar red\r\n{rest}end_header\r\n"
    )
    .into_bytes()
}

const FACES: &str = "element edge 1\r\nproperty ushort a\r\nelement face 1\r\nproperty uint id\r\n\
    property list char uint16 vertex_index\r\n";

/// The same triangle in all three encodings: every width and signedness, lists before and after, in either byte order.
#[test]
fn encodings_agree() {
    let mut text = header("ascii", FACES);
    text.extend(b"0.5 2 7 -8 .25 -300 255\n\n  1. 0 1e0 2 0\n0 1 -1 +2 3 1 extra\n9\n4000000000 3 2 0 1\n");
    let text = read(text, Format::Ply);
    for little in [true, false] {
        let name = if little { "binary_little_endian" } else { "binary_big_endian" };
        let mut bytes = header(name, FACES);
        let mut put = |le: Vec<u8>| {
            if little { bytes.extend(le) } else { bytes.extend(le.into_iter().rev()) }
        };
        let vertices: [(f64, &[i16], f32, i16, u8); 3] =
            [(0.5, &[7, -8], 0.25, -300, 255), (1.0, &[], 1.0, 2, 0), (0.0, &[-1], 2.0, 3, 1)];
        for (x, marks, y, z, red) in vertices {
            put(x.to_le_bytes().to_vec());
            put(vec![marks.len() as u8]);
            marks.iter().for_each(|m| put(m.to_le_bytes().to_vec()));
            put(y.to_le_bytes().to_vec());
            put(z.to_le_bytes().to_vec());
            put(vec![red]);
        }
        put(9u16.to_le_bytes().to_vec());
        put(4_000_000_000u32.to_le_bytes().to_vec());
        put(vec![3]);
        [2u16, 0, 1].iter().for_each(|i| put(i.to_le_bytes().to_vec()));
        let binary = read(&bytes, Format::Ply);
        assert_eq!(binary.mesh.positions, text.mesh.positions, "{name}");
        assert_eq!(binary.mesh.triangles(), text.mesh.triangles());
    }
    assert_eq!(text.mesh.positions[0], DVec3::new(0.5, 0.25, -300.0));
    assert_eq!(text.mesh.triangles(), [[2, 0, 1]]);
    let dropped = &text.report.dropped;
    assert_eq!((dropped["vertex property \"red\""], dropped["vertex property \"marks\""]), (3, 3));
    assert_eq!((dropped["elements \"edge\""], dropped["words after the last value of a line"]), (1, 1));
}

/// Strips end at -1, and every second triangle of a strip is turned round, so all face the same way.
#[test]
fn strips() {
    let text = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
        element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
        0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n2 1 0\n9 0 2 1 3 -1 2 4 3 5\n";
    let asset = read(text, Format::Ply);
    assert_eq!(asset.mesh.face_count(), 4);
    for f in 0..4 {
        let [a, b, c] = asset.mesh.corners(f);
        assert_eq!((b - a).cross(c - a), DVec3::Z, "face {f}");
    }
}

/// Where lines end in a lone carriage return, a first binary value that equals a line feed is not eaten.
#[test]
fn first_byte_may_look_like_a_line_end() {
    for end in ["\r", "\n", "\r\n"] {
        let text = format!(
            "ply{end}format binary_little_endian 1.0{end}element vertex 3{end}property uchar x{end}property uchar y{end}\
             property uchar z{end}element face 1{end}property list uchar uchar vertex_indices{end}end_header{end}"
        );
        let mut bytes = text.into_bytes();
        bytes.extend([10, 13, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2]);
        assert_eq!(read(&bytes, Format::Ply).mesh.positions[0], DVec3::new(10.0, 13.0, 0.0), "{end:?}");
    }
}

/// Counts that the file cannot hold are refused before anything is allocated or looped over for them.
#[test]
fn lying_counts() {
    let huge = "18446744073709551615";
    for (from, to, expected) in [
        ("vertex 8", &format!("vertex {huge}")[..], "<bytes>:3: truncated: 18446744073709551615 elements \"vertex\""),
        ("face 6", &format!("face {huge}"), "<bytes>:7: truncated"),
        ("4 3 2 1 0", "4000000000 3 2 1 0", "<bytes>:18: a list declares 4000000000 values where at most 4"),
        ("4 3 2 1 0", "-1 3 2 1 0", "<bytes>:18: a list declares -1 values"),
        ("4 3 2 1 0", "1.5 3 2 1 0", "<bytes>:18: a list declares 1.5 values"),
    ] {
        let found = error(CUBE_PLY.replace(from, to), Format::Ply);
        assert!(found.starts_with(expected), "{to}: {found}");
    }
    // An element without properties takes no bytes, in any number.
    let binary = CUBE_PLY.replace("element face", &format!("element nothing {huge}\nelement face"));
    assert_eq!(read(binary, Format::Ply).mesh.face_count(), 12);
}

#[test]
fn errors_name_the_line() {
    for (from, to, expected) in [
        ("ply\n", "plx\n", "<bytes>:1: a PLY file starts with"),
        ("ascii 1.0", "ascii 2.0", "<bytes>:2: \"format ascii 2.0\" is not a line of a PLY 1.0 header"),
        ("ascii", "morse", "<bytes>:2: \"morse\" is not an encoding"),
        ("float x", "float u", "<bytes>:3: the vertices have no property \"x\""),
        ("float y", "half y", "<bytes>:5: \"half\" is not a type of PLY"),
        ("element face 6", "element vertex 6", "<bytes>:7: element \"vertex\" is declared a second time"),
        ("list uchar int vertex_indices", "int corner", "<bytes>:7: element \"face\" has no list \"vertex_indices\""),
        ("end_header\n", "", "<bytes>:9: \"0 0 0\" is not a line of a PLY 1.0 header"),
        ("\n1 0 0\n", "\n1 0\n", "<bytes>:11: the line has too few values"),
        ("\n1 0 0\n", "\n1 0 nan\n", "<bytes>:11: vertex 1: vertex 1 has a coordinate that is not a finite number"),
        ("4 3 2 1 0", "4 3 2 1 8", "<bytes>:18: face 0: names vertex 8, but there are 8 (numbered from 0)"),
        ("4 3 2 1 0", "4 3 2 1 -1", "<bytes>:18: face 0: names vertex -1"),
        ("\n4 3 0 4 7\n", "\n", "<bytes>:22: the file ends at face 5 of the 6 declared"),
    ] {
        let found = error(CUBE_PLY.replacen(from, to, 1), Format::Ply);
        assert!(found.starts_with(expected), "{from:?} to {to:?}: {found}");
    }
}
