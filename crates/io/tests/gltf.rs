//! glTF: scenes, primitives, buffers, and files that lie.

mod common;

use std::fs;

use common::{error, message, read};
use glam::DVec3;
use pliant_io::{Format, read as read_file, read_bytes};
use serde_json::{Value, json};

/// A unit square in the plane z = 0 as four f32 vertices, then the indices 0 1 2 3 as bytes: 52 bytes.
fn square() -> Vec<u8> {
    let corners: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    corners.as_flattened().iter().flat_map(|c| c.to_le_bytes()).chain([0, 1, 2, 3]).collect()
}

fn data_uri(bytes: &[u8]) -> String {
    use base64::Engine;
    format!("data:application/octet-stream;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// The square as a triangle strip on one node.
fn document() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 5}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5121, "count": 4, "type": "SCALAR"}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 4}
        ],
        "buffers": [{"byteLength": 52, "uri": data_uri(&square())}]
    })
}

/// The document with the value at a JSON pointer replaced, or added to its parent.
fn with(mut document: Value, pointer: &str, value: Value) -> Value {
    let (parent, key) = pointer.rsplit_once('/').expect("a pointer has a slash");
    match document.pointer_mut(parent).expect("the parent is there") {
        Value::Object(map) => drop(map.insert(key.to_owned(), value)),
        Value::Array(list) => list[key.parse::<usize>().expect("an index")] = value,
        _ => panic!("{parent} holds nothing"),
    }
    document
}

/// Sum of the faces' area vectors.
fn area(mesh: &pliant_mesh::TriMesh) -> DVec3 {
    (0..mesh.face_count()).map(|f| pliant_mesh::face_area_vector(mesh.corners(f))).sum()
}

/// Strips, fans, lists and unindexed lists of the same square all face the viewer: their area vector is +z.
#[test]
fn primitive_modes() {
    let cases = [
        (5, vec![0u8, 1, 2, 3], 2),
        (6, vec![0, 1, 3, 2], 2),
        (4, vec![0, 1, 2, 2, 1, 3], 2),
        (4, vec![0, 1, 2, 2, 1, 3, 0], 2),
    ];
    for (mode, indices, faces) in cases {
        let count = indices.len();
        let mut bytes = square();
        bytes.truncate(48);
        bytes.extend(indices);
        let mut document = with(document(), "/meshes/0/primitives/0/mode", json!(mode));
        document = with(document, "/accessors/1/count", json!(count));
        document = with(document, "/bufferViews/1/byteLength", json!(count));
        document = with(document, "/buffers/0", json!({"byteLength": bytes.len(), "uri": data_uri(&bytes)}));
        let asset = read(document.to_string(), Format::Gltf);
        assert_eq!(asset.mesh.face_count(), faces, "mode {mode}");
        assert_eq!(area(&asset.mesh), DVec3::Z, "mode {mode}");
    }
    let mut unindexed = document();
    unindexed["meshes"][0]["primitives"][0].as_object_mut().expect("an object").remove("indices");
    assert_eq!(area(&read(unindexed.to_string(), Format::Gltf).mesh), DVec3::Z);
    let points = with(document(), "/meshes/0/primitives/0/mode", json!(0)).to_string();
    assert_eq!(error(points, Format::Gltf), "<bytes>: there are no faces (0 vertices)");
}

/// A child is placed by its parents: scale 2, a quarter turn about z, a move by (5, 0, 0), then the parent's matrix,
/// which moves by (0, 0, 7). The square's corner (1, 0, 0) goes to (2, 0, 0), (0, 2, 0), (5, 2, 0), (5, 2, 7).
#[test]
fn nodes_place_meshes() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let nodes = json!([
        {"children": [1], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 7, 1]},
        {"mesh": 0, "translation": [5, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 2, 2]},
        {"mesh": 0}
    ]);
    let asset = read(with(document(), "/nodes", nodes).to_string(), Format::Gltf);
    assert_eq!(asset.mesh.face_count(), 2);
    assert!(asset.mesh.positions[1].distance(DVec3::new(5.0, 2.0, 7.0)) < 1e-12, "{}", asset.mesh.positions[1]);
    // The third node is in no scene.
    assert_eq!(asset.report.dropped["meshes outside the default scene"], 1);
}

/// A mirroring node keeps faces turned outwards, so the square seen from +z is still seen from +z.
#[test]
fn mirrors_turn_faces_back() {
    let nodes = json!([{"mesh": 0, "scale": [-1, 1, 1]}]);
    let asset = read(with(document(), "/nodes", nodes).to_string(), Format::Gltf);
    assert_eq!(asset.mesh.positions[1], DVec3::new(-1.0, 0.0, 0.0));
    assert_eq!(area(&asset.mesh), DVec3::Z);
}

/// A mesh that two nodes place is there twice; without a scene all roots are, and without nodes every mesh once.
#[test]
fn scenes() {
    let two = with(document(), "/nodes", json!([{"mesh": 0}, {"mesh": 0, "translation": [3, 0, 0]}]));
    let both = with(two.clone(), "/scenes/0/nodes", json!([0, 1]));
    assert_eq!(area(&read(both.to_string(), Format::Gltf).mesh), 2.0 * DVec3::Z);
    assert_eq!(area(&read(two.to_string(), Format::Gltf).mesh), DVec3::Z);
    for gone in [&["scene", "scenes"][..], &["scene"]] {
        let mut document = two.clone();
        gone.iter().for_each(|key| drop(document.as_object_mut().expect("an object").remove(*key)));
        let count = if gone.len() == 2 { 2.0 } else { 1.0 };
        assert_eq!(area(&read(document.to_string(), Format::Gltf).mesh), count * DVec3::Z, "{gone:?}");
    }
    let mut bare = document();
    ["scene", "scenes", "nodes"].iter().for_each(|key| drop(bare.as_object_mut().expect("an object").remove(*key)));
    assert_eq!(area(&read(bare.to_string(), Format::Gltf).mesh), DVec3::Z);
}

/// Positions as normalised 16-bit integers (KHR_mesh_quantization), 8 bytes apart: 32767 is 1.
#[test]
fn quantised_positions() {
    let corners: [[i16; 4]; 4] = [[0, 0, 0, 9], [i16::MAX, 0, 0, 9], [0, i16::MAX, 0, 9], [i16::MAX, i16::MAX, 0, 9]];
    let bytes: Vec<u8> = corners.as_flattened().iter().flat_map(|c| c.to_le_bytes()).chain([0, 1, 2, 3]).collect();
    let mut document = with(document(), "/accessors/0/componentType", json!(5122));
    document = with(document, "/accessors/0/normalized", json!(true));
    document = with(
        document,
        "/bufferViews",
        json!([
            {"buffer": 0, "byteLength": 32, "byteStride": 8},
            {"buffer": 0, "byteOffset": 32, "byteLength": 4}
        ]),
    );
    document = with(document, "/buffers/0", json!({"byteLength": 36, "uri": data_uri(&bytes)}));
    document = with(document, "/extensionsRequired", json!(["KHR_mesh_quantization"]));
    assert_eq!(area(&read(document.to_string(), Format::Gltf).mesh), DVec3::Z);
}

/// A sparse accessor moves single elements of another one, or of zeros.
#[test]
fn sparse_positions() {
    let mut bytes = square();
    bytes.extend([3, 0, 0, 0]);
    bytes.extend([2.0f32, 2.0, 0.0].iter().flat_map(|c| c.to_le_bytes()));
    let sparse = json!({"count": 1, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}});
    let mut document = with(document(), "/accessors/0/sparse", sparse);
    let views = document["bufferViews"].as_array_mut().expect("a list");
    views.push(json!({"buffer": 0, "byteOffset": 52, "byteLength": 1}));
    views.push(json!({"buffer": 0, "byteOffset": 56, "byteLength": 12}));
    document = with(document, "/buffers/0", json!({"byteLength": bytes.len(), "uri": data_uri(&bytes)}));
    assert_eq!(read(document.to_string(), Format::Gltf).mesh.positions[3], DVec3::new(2.0, 2.0, 0.0));
    // A kilobyte must not become a mesh of a thousand million zeros.
    document["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
    document = with(document, "/accessors/0/count", json!(1_000_000_000));
    let found = error(document.to_string(), Format::Gltf);
    assert!(found.starts_with("<bytes>: accessor 0: with it the scene expands to more than"), "{found}");
}

/// Every number that the JSON can get wrong ends in a message that names the part.
#[test]
fn errors_name_the_part() {
    for (pointer, value, expected) in [
        ("/asset/version", json!("1.0"), "glTF version \"1.0\" is not 2.0"),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), "the file needs the extension \"KHR_draco"),
        ("/scene", json!(4), "scene 4: is the default one, but is not there"),
        ("/scenes/0/nodes", json!([8]), "node 8: is not there"),
        ("/nodes/0/children", json!([0]), "node 0: is reached twice"),
        ("/nodes/0/mesh", json!(2), "node 0: there is no mesh 2"),
        ("/nodes/0/rotation", json!([0, 0, 0, 0]), "node 0: the rotation is no direction"),
        ("/meshes/0/primitives/0/mode", json!(9), "mesh 0, primitive 0: the mode is none of 0 to 6"),
        ("/meshes/0/primitives/0/indices", json!(7), "accessor 7: is not there"),
        ("/meshes/0/primitives/0/indices", json!(0), "accessor 0: the type is Valid(Vec3), where Scalar is needed"),
        ("/accessors/1/componentType", json!(5126), "accessor 1: indices cannot have the component type F32"),
        ("/accessors/0/componentType", json!(5125), "accessor 0: positions cannot have the component type U32"),
        ("/accessors/0/componentType", json!(1), "accessor 0: the component type is unknown"),
        ("/accessors/0/count", json!(5), "accessor 0: its 5 elements end beyond its buffer view"),
        ("/accessors/0/count", json!(u64::MAX), "accessor 0: its 18446744073709551615 elements end beyond"),
        ("/accessors/0/count", json!(3), "mesh 0, primitive 0: an index names vertex 3, but there are 3"),
        ("/accessors/0/byteOffset", json!(60), "accessor 0: it starts beyond its buffer view"),
        ("/accessors/0/bufferView", json!(6), "accessor 0: its buffer view is not there"),
        ("/bufferViews/0/byteStride", json!(4), "accessor 0: the stride is smaller than an element"),
        ("/bufferViews/0/byteLength", json!(99), "accessor 0: its buffer view ends beyond the buffer"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "accessor 0: its buffer view ends beyond the buffer"),
        ("/bufferViews/0/buffer", json!(3), "buffer 3: is not there"),
        ("/buffers/0/byteLength", json!(53), "buffer 0: truncated: 53 bytes are declared, 52 are there"),
        ("/buffers/0/uri", json!("data:text/plain,abc"), "buffer 0: its data: address is not base64"),
        ("/buffers/0/uri", json!("data:;base64,?"), "buffer 0: its data: address is not valid base64"),
        ("/buffers/0/uri", json!("square.bin"), "buffer 0: lies in another file, which is not opened here"),
        ("/buffers/0", json!({"byteLength": 4}), "buffer 0: has neither an address nor the file's binary chunk"),
    ] {
        let found = error(with(document(), pointer, value.clone()).to_string(), Format::Gltf);
        assert!(found.starts_with(&format!("<bytes>: {expected}")), "{pointer} = {value}: {found}");
    }
    let found = error("{\n\"asset\": {\n}", Format::Gltf);
    assert!(found.starts_with("<bytes>:3: the JSON is not glTF 2.0"), "{found}");
}

/// A chain of nodes as deep as one likes does not exhaust the stack.
#[test]
fn deep_nodes() {
    let depth = 100_000;
    let nodes: Vec<Value> = (1..depth).map(|i| json!({"children": [i]})).chain([json!({"mesh": 0})]).collect();
    assert_eq!(read(with(document(), "/nodes", json!(nodes)).to_string(), Format::Gltf).mesh.face_count(), 2);
}

/// A thousand nodes that each place the same mesh are a thousand squares, but there is an end to what a file may expand to.
#[test]
fn instances_are_bounded() {
    let instances = |n: usize| {
        let nodes = vec![json!({"mesh": 0}); n];
        let top: Vec<usize> = (0..n).collect();
        with(with(document(), "/nodes", json!(nodes)), "/scenes/0/nodes", json!(top))
    };
    assert_eq!(read(instances(1000).to_string(), Format::Gltf).report.file_faces, 2000);
    // 150,000 vertices of padding placed by 150 nodes: 67 million numbers from a file of some 3 MB would be allowed, so
    // the vertices come from nowhere: a sparse accessor's zeros.
    let mut large = instances(150);
    large["accessors"][0] = json!({"componentType": 5126, "count": 150_000, "type": "VEC3"});
    assert!(error(large.to_string(), Format::Gltf).contains("expands to more than"));
}

/// A buffer beside the file is read; its name may be percent-encoded and lie in a folder below. Nothing else is opened.
#[test]
fn buffers_beside_the_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let inside = folder.path().join("models");
    fs::create_dir_all(inside.join("my data")).expect("folders");
    fs::write(inside.join("my data/square.bin"), square()).expect("a file");
    fs::write(folder.path().join("secret.bin"), square()).expect("a file");
    let path = inside.join("square.gltf");
    let save = |uri: &str| {
        let document = with(document(), "/buffers/0/uri", json!(uri)).to_string();
        fs::write(&path, document).expect("a file");
        read_file(&path)
    };
    for uri in ["my%20data/square.bin", "./my data/square.bin"] {
        assert_eq!(area(&save(uri).expect("a buffer in the folder").mesh), DVec3::Z);
    }
    let absolute = folder.path().join("secret.bin").display().to_string();
    let outside = "is not that of a file in the folder";
    for (uri, expected) in [
        ("../secret.bin", outside),
        ("my%20data/../../secret.bin", outside),
        ("..%2Fsecret.bin", outside),
        ("..\\secret.bin", outside),
        (&absolute, outside),
        (&format!("file://{absolute}"), outside),
        ("http://localhost/a.bin", outside),
        ("", outside),
        ("a%00b", outside),
        ("%ff", "is not UTF-8"),
        ("missing.bin", "missing.bin: cannot open"),
        ("my data", "is a folder"),
    ] {
        let found = message(save(uri));
        assert!(found.contains("square.gltf: buffer 0: ") && found.contains(expected), "{uri}: {found}");
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(folder.path().join("secret.bin"), inside.join("link.bin")).expect("a link");
        assert!(message(save("link.bin")).contains("leads out of the folder"));
    }
}

/// The binary chunk of a GLB is buffer 0; lying lengths in its header and chunks are refused.
#[test]
fn glb_container() {
    let mut document = document();
    document["buffers"][0].as_object_mut().expect("an object").remove("uri");
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((12 + 8 + json.len() as u32 + 8 + 52).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(&json);
    glb.extend(52u32.to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(square());
    // Either extension may hold either form.
    for format in [Format::Glb, Format::Gltf] {
        assert_eq!(area(&read(&glb, format).mesh), DVec3::Z);
    }
    for (at, expected) in
        [(8, "at byte 8: truncated: the file declares"), (12, "not a GLB file"), (4, "not a GLB file")]
    {
        for lie in [0u32, 3, 11, 19, u32::MAX] {
            let mut wrong = glb.clone();
            wrong[at..at + 4].copy_from_slice(&lie.to_le_bytes());
            let found = message(read_bytes(&wrong, Format::Glb));
            assert!(found.contains(expected) || (at == 12 && found.contains("JSON")), "{at} {lie}: {found}");
        }
    }
}
