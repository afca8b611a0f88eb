//! What the writers make, read back by our readers and by other people's.

mod common;

use common::{awkward, read, same_bits, sphere};
use glam::DVec3;
use pliant_io::{Format, IoError, write_bytes};
use pliant_mesh::TriMesh;

fn encode(mesh: &TriMesh, format: Format) -> Vec<u8> {
    write_bytes(mesh, format).expect("the mesh can be written")
}

/// OBJ and PLY give back every bit, of the smallest and largest numbers too, and vertices that no face uses.
#[test]
fn f64_formats_are_lossless() {
    let mut positions = awkward().positions;
    positions.insert(0, DVec3::new(0.1, 0.2, 0.3));
    let triangles = awkward().triangles().iter().map(|t| t.map(|v| v + 1)).collect();
    let mesh = TriMesh::new(positions, triangles).expect("one more vertex");
    for format in [Format::Obj, Format::Ply] {
        let back = read(encode(&mesh, format), format);
        assert!(same_bits(&back.mesh, &mesh), "{format:?}");
        assert_eq!(back.report.file_faces, mesh.face_count());
        // Writing what was read makes the same bytes.
        assert_eq!(encode(&back.mesh, format), encode(&mesh, format));
    }
}

/// GLB gives back every position rounded to f32.
#[test]
fn glb_keeps_single_precision() {
    let mesh = sphere(2);
    let mesh = mesh.with_positions(mesh.positions.iter().map(|p| *p * 0.1 + 0.01).collect()).expect("finite");
    let back = read(encode(&mesh, Format::Glb), Format::Glb);
    let rounded: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
    assert_eq!(back.mesh.positions, rounded);
    assert_eq!(back.mesh.triangles(), mesh.triangles());
}

/// Far from the origin f32 would merge vertices (their spacing at 1e7 is 1, the edges are 0.2 long); stored relative to
/// the node, each is right to half a spacing of the numbers up to the mesh's own size of 1.
#[test]
fn glb_far_from_the_origin() {
    let near = sphere(3);
    let offset = DVec3::new(1e7, -3e6, 123_456.7);
    let mesh = near.with_positions(near.positions.iter().map(|p| *p + offset).collect()).expect("finite");
    let back = read(encode(&mesh, Format::Glb), Format::Glb);
    assert_eq!(back.mesh.vertex_count(), mesh.vertex_count());
    assert_eq!(back.report.clean.welded, 0);
    // The node's translation is rounded to f32 first and subtracted in f64, so it costs nothing but the size of the
    // remainder: at most 1 plus the rounding of 1e7, 0.5.
    let bound = 2.0 * f64::from(f32::EPSILON) / 2.0 + 1e-8;
    for (a, b) in back.mesh.positions.iter().zip(&mesh.positions) {
        assert!((*a - *b).abs().max_element() <= bound, "{a} {b}");
    }
}

/// A GLB says what glTF demands: least and greatest position, unit normals, all lengths right.
#[test]
fn glb_is_valid() {
    let mesh = sphere(2);
    let bytes = encode(&mesh, Format::Glb);
    // The gltf crate's own validation.
    let parsed = gltf::Gltf::from_slice(&bytes).expect("valid glTF");
    let blob = parsed.blob.clone().expect("a binary chunk");
    let primitive = parsed.meshes().next().and_then(|m| m.primitives().next()).expect("a primitive");
    let bounds = primitive.bounding_box();
    assert_eq!((bounds.min, bounds.max), ([-1.0; 3], [1.0; 3]));
    let reader = primitive.reader(|_| Some(&blob));
    let positions: Vec<_> = reader.read_positions().expect("positions").collect();
    let normals: Vec<_> = reader.read_normals().expect("normals").collect();
    assert_eq!((positions.len(), normals.len()), (mesh.vertex_count(), mesh.vertex_count()));
    for (p, n) in positions.iter().zip(&normals) {
        let (p, n) = (glam::Vec3::from_array(*p), glam::Vec3::from_array(*n));
        assert!((n.length() - 1.0).abs() < 1e-6);
        // On a sphere the normal is the position; the triangles are a quarter of a radian wide.
        assert!(n.dot(p) > 0.97, "{n} at {p}");
    }
    let indices: Vec<u32> = reader.read_indices().expect("indices").into_u32().collect();
    assert_eq!(indices, mesh.triangles().as_flattened());
}

/// ply-rs-bw reads our PLY to the same numbers.
#[test]
fn ply_means_the_same_to_others() {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};
    let mesh = awkward();
    let bytes = encode(&mesh, Format::Ply);
    let ply = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).expect("a PLY file");
    for (vertex, p) in ply.payload["vertex"].iter().zip(&mesh.positions) {
        assert_eq!([&vertex["x"], &vertex["y"], &vertex["z"]], p.to_array().map(Property::Double).each_ref());
    }
    for (face, t) in ply.payload["face"].iter().zip(mesh.triangles()) {
        assert_eq!(face["vertex_indices"], Property::ListUInt(t.to_vec()));
    }
    assert_eq!(ply.payload["face"].len(), mesh.face_count());
}

/// stl_io reads text and binary STL to the same triangles as we do.
#[test]
fn stl_means_the_same_to_others() {
    for bytes in [common::tetrahedron_stl().into_bytes(), common::binary_stl(&sphere(2), b"x")] {
        let ours = read(&bytes, Format::Stl).mesh;
        let theirs = stl_io::read_stl(&mut std::io::Cursor::new(bytes)).expect("an STL file");
        assert_eq!(ours.face_count(), theirs.faces.len());
        for (f, face) in theirs.faces.iter().enumerate() {
            let corners = face.vertices.map(|v| DVec3::from_array(theirs.vertices[v].0.map(f64::from)));
            assert_eq!(ours.corners(f), corners);
        }
    }
}

/// What cannot be written is refused with a reason: numbers that are none or too large, no faces, a format that is only read.
#[test]
fn refusals() {
    let mut broken = sphere(0);
    broken.positions[4].y = f64::NAN;
    for format in [Format::Obj, Format::Ply, Format::Glb] {
        let found = common::message(write_bytes(&broken, format));
        assert_eq!(found, "<bytes>: vertex 4 has a coordinate that is not a finite number");
    }
    broken.positions[4].y = 1e39;
    broken.positions[3].y = -1e39;
    let found = common::message(write_bytes(&broken, Format::Glb));
    assert!(
        found.starts_with("<bytes>: vertex 3: ") && found.ends_with("is too large for GLB's f32; write PLY"),
        "{found}"
    );
    let points = TriMesh::new(vec![DVec3::ZERO], Vec::new()).expect("a point");
    assert!(matches!(write_bytes(&points, Format::Obj), Err(IoError::NoFaces { vertices: 1, .. })));
    let found = common::message(write_bytes(&sphere(0), Format::Stl));
    assert_eq!(found, "<bytes>: cannot write \".stl\" files; use one of: obj, ply, glb");
}
