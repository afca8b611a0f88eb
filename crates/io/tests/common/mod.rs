//! Small meshes and files shared by the tests.
#![allow(dead_code, reason = "each test file uses some of them")]

use glam::DVec3;
use pliant_io::{Asset, Format, read_bytes};
use pliant_mesh::TriMesh;

/// Reads a literal file that is right.
pub(crate) fn read(text: impl AsRef<[u8]>, format: Format) -> Asset {
    read_bytes(text.as_ref(), format).expect("the file is right")
}

/// The message for a literal file that is wrong.
pub(crate) fn error(text: impl AsRef<[u8]>, format: Format) -> String {
    read_bytes(text.as_ref(), format).expect_err("the file is wrong").to_string()
}

/// The message of any result.
pub(crate) fn message<T>(result: Result<T, impl std::fmt::Display>) -> String {
    result.err().expect("this fails").to_string()
}

/// A unit sphere: an octahedron whose faces are cut in four `level` times; closed, `4^(level + 1) + 2` vertices.
pub(crate) fn sphere(level: u32) -> TriMesh {
    let mut positions = vec![DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let mut faces: Vec<[u32; 3]> =
        vec![[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]];
    for _ in 0..level {
        let mut middles = std::collections::BTreeMap::new();
        let mut cut = Vec::new();
        for [a, b, c] in faces {
            let mut middle = |p: u32, q: u32| {
                *middles.entry((p.min(q), p.max(q))).or_insert_with(|| {
                    positions.push((positions[p as usize] + positions[q as usize]).normalize());
                    positions.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            cut.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = cut;
    }
    TriMesh::new(positions, faces).expect("a subdivided octahedron")
}

/// A sphere with awkward coordinates: no digits in common, tiny and huge exponents, both signs of zero.
pub(crate) fn awkward() -> TriMesh {
    let mesh = sphere(2);
    let moved = mesh.positions.iter().enumerate().map(|(i, p)| {
        let p = *p * (1.0 + (i as f64).sin() / 3.0) + DVec3::new(0.1, 1e-7, -1e3);
        match i {
            0 => DVec3::new(-0.0, 5e-324, 1.0 / 3.0),
            1 => DVec3::new(1e15 + 0.3, f64::MIN_POSITIVE, -1.0000000000000002),
            2 => DVec3::new(123_456_789.123_456_79, 1e300, -1e23),
            _ => p,
        }
    });
    mesh.with_positions(moved.collect()).expect("finite")
}

/// Whether two meshes have the same faces and the same bits of every position.
pub(crate) fn same_bits(a: &TriMesh, b: &TriMesh) -> bool {
    let bits = |m: &TriMesh| -> Vec<[u64; 3]> { m.positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect() };
    a.triangles() == b.triangles() && bits(a) == bits(b)
}

/// A unit cube of six quads, corners numbered from 1, seen from outside counter-clockwise.
pub(crate) const CUBE_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// The same cube as text PLY, corners numbered from 0.
pub(crate) const CUBE_PLY: &str = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
    property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
    4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

/// The same cube as OFF.
pub(crate) const CUBE_OFF: &str = "OFF\n8 6 12\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n\
    4 3 2 1 0\n4 4 5 6 7\n4 0 1 5 4\n4 1 2 6 5\n4 2 3 7 6\n4 3 0 4 7\n";

/// A tetrahedron of volume 1/6 as text STL.
pub(crate) fn tetrahedron_stl() -> String {
    let corners = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"];
    let facet = |[a, b, c]: [usize; 3]| {
        let [a, b, c] = [corners[a], corners[b], corners[c]];
        format!("facet normal 0 0 0\nouter loop\nvertex {a}\nvertex {b}\nvertex {c}\nendloop\nendfacet\n")
    };
    let facets: String = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]].map(facet).concat();
    format!("solid tetrahedron\n{facets}endsolid tetrahedron\n")
}

/// A mesh as binary STL, `header` at its start.
pub(crate) fn binary_stl(mesh: &TriMesh, header: &[u8]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend((mesh.face_count() as u32).to_le_bytes());
    for f in 0..mesh.face_count() {
        bytes.extend([0; 12]);
        for c in mesh.corners(f).iter().flat_map(DVec3::to_array) {
            bytes.extend((c as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}
