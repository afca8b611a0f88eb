//! Broken files of every format: whatever they hold, reading returns.

mod common;

use common::{CUBE_OBJ, CUBE_OFF, CUBE_PLY, binary_stl, sphere, tetrahedron_stl};
use pliant_io::{Format, read_bytes, write_bytes};

/// A small file of each format and encoding.
fn samples() -> Vec<(Format, Vec<u8>)> {
    let encode = |format| write_bytes(&sphere(0), format).expect("written");
    let mut big_endian = CUBE_PLY.replace("ascii", "binary_big_endian").into_bytes();
    let header = CUBE_PLY.find("end_header\n").expect("a header") + "end_header\n".len();
    big_endian.truncate(header + "binary_big_endian".len() - "ascii".len());
    for corner in 0..8u8 {
        for axis in 0..3 {
            big_endian.extend(f32::from((corner >> axis) & 1).to_be_bytes());
        }
    }
    for face in 0..6u8 {
        big_endian.push(3);
        (0..3).for_each(|k| big_endian.extend(i32::from((face + k) & 7).to_be_bytes()));
    }
    let everything_obj = format!("{CUBE_OBJ}vn 0 0 1\nvt 0 0\nf -1/1/1 -2//1 \\\n-3 # end\n");
    vec![
        (Format::Obj, everything_obj.into_bytes()),
        (Format::Off, CUBE_OFF.as_bytes().to_vec()),
        (Format::Ply, CUBE_PLY.as_bytes().to_vec()),
        (Format::Ply, encode(Format::Ply)),
        (Format::Ply, big_endian),
        (Format::Stl, tetrahedron_stl().into_bytes()),
        (Format::Stl, binary_stl(&sphere(0), b"")),
        (Format::Stl, binary_stl(&sphere(0), b"solid")),
        (Format::Glb, encode(Format::Glb)),
    ]
}

/// Every sample is right to begin with, and cut off after any number of bytes it ends in a mesh or an error.
///
/// Binary files know their length, so every cut of one is an error.
#[test]
fn truncation() {
    for (format, bytes) in samples() {
        assert!(read_bytes(&bytes, format).is_ok(), "{format:?}: {:?}", read_bytes(&bytes, format));
        let knows_length = std::str::from_utf8(&bytes).is_err() || format == Format::Glb;
        for length in 0..bytes.len() {
            let outcome = read_bytes(&bytes[..length], format);
            assert!(outcome.is_err() || !knows_length, "{format:?} of {length} bytes");
        }
    }
}

/// Every bit turned over, every byte set to values that mean something, ends in a mesh or an error.
#[test]
fn single_bytes() {
    for (format, bytes) in samples() {
        for at in 0..bytes.len() {
            let flips = (0..8).map(|bit| bytes[at] ^ (1 << bit));
            for value in flips.chain([0, 0xff, b'\n', b'\r', b'\\', b' ', b'-', b'9', b'"']) {
                let mut broken = bytes.clone();
                broken[at] = value;
                check(&broken, format);
            }
        }
    }
}

/// Random bytes, alone and after a right beginning, in every format.
#[test]
fn garbage() {
    // A multiplicative generator (Knuth's MMIX constants): any bytes do, and the same ones every time.
    let mut state = 1u64;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    for (format, bytes) in samples() {
        for round in 0..200 {
            let start = if round % 2 == 0 { 0 } else { usize::from(next()) % bytes.len() };
            let mut broken = bytes[..start].to_vec();
            broken.extend((0..300).map(|_| next()));
            check(&broken, format);
        }
    }
}

/// A mesh that comes out has at least one face and only finite positions; an error names the file.
fn check(bytes: &[u8], format: Format) {
    match read_bytes(bytes, format) {
        Ok(asset) => {
            assert!(asset.mesh.face_count() > 0);
            assert!(asset.mesh.positions.iter().all(|p| p.is_finite()));
            assert_eq!(asset.weld.len(), asset.report.file_vertices);
        }
        Err(e) => assert!(e.to_string().starts_with("<bytes>"), "{e}"),
    }
}
