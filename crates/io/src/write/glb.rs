use std::borrow::Cow;

use glam::{DVec3, Vec3};
use gltf::Glb;
use gltf::binary::Header;
use gltf::json::accessor::{Accessor, ComponentType, GenericComponentType, Type};
use gltf::json::buffer::{self, Buffer, Target};
use gltf::json::material::{PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf::json::mesh::{Mesh, Mode, Primitive, Semantic};
use gltf::json::scene::{Node, Scene};
use gltf::json::validation::{Checked, USize64};
use gltf::json::{Asset, Index, Material, Root, Value};
use pliant_mesh::{TriMesh, vertex_normals};

use crate::error::Fault;

/// Largest acceptable spacing of f32 numbers at the largest coordinate, in median edge lengths.
const COARSEST_SPACING: f64 = 1e-4;

/// Bytes of a position or normal.
const VECTOR: u64 = 12;

/// glTF 2.0 in one file: positions, normals, indices; one mesh, one node, one scene.
pub(super) fn encode(mesh: &TriMesh) -> Result<Vec<u8>, Fault> {
    let offset = node_offset(mesh);
    let positions = single_precision(mesh, offset)?;
    let normals = vertex_normals(mesh.topology(), &mesh.positions);
    let json = serde_json::to_vec(&document(mesh, &positions, offset))
        .map_err(|e| Fault::file(format!("cannot describe the mesh in JSON: {e}")))?;
    let vectors = VECTOR * mesh.vertex_count() as u64;
    let length = 2 * vectors + 12 * mesh.face_count() as u64;
    // Header, two chunk headers, and both chunks padded to four bytes.
    let whole = 12 + 8 + json.len() as u64 + 3 + 8 + length;
    if u32::try_from(whole).is_err() {
        return Err(Fault::file(format!("a GLB file of {whole} bytes is not possible (4 GiB at most); write PLY")));
    }
    let mut bin = Vec::with_capacity(length as usize);
    let mut push = |v: Vec3| v.to_array().iter().for_each(|c| bin.extend_from_slice(&c.to_le_bytes()));
    positions.iter().for_each(|&p| push(p));
    // A vertex without faces has no normal, but glTF wants unit vectors.
    normals.iter().for_each(|&n| push(if n == DVec3::ZERO { Vec3::Z } else { n.as_vec3() }));
    for vertex in mesh.triangles().as_flattened() {
        bin.extend_from_slice(&vertex.to_le_bytes());
    }
    let header = Header { magic: *b"glTF", version: 2, length: whole as u32 };
    let glb = Glb { header, json: Cow::Owned(json), bin: Some(Cow::Owned(bin)) };
    glb.to_vec().map_err(|e| Fault::file(format!("cannot make a GLB file: {e}")))
}

/// Translation of the node: zero, or the middle of the box if f32 is too coarse where the mesh is.
fn node_offset(mesh: &TriMesh) -> Vec3 {
    let bounds = mesh.bounds();
    let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
    let mut lengths: Vec<f64> = mesh
        .topology()
        .edges()
        .iter()
        .map(|&[a, b]| mesh.positions[a as usize].distance(mesh.positions[b as usize]))
        .collect();
    let middle = lengths.len() / 2;
    let median = if lengths.is_empty() { 0.0 } else { *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 };
    let spacing = largest * f64::from(f32::EPSILON);
    if spacing > COARSEST_SPACING * median { bounds.centre().as_vec3() } else { Vec3::ZERO }
}

fn single_precision(mesh: &TriMesh, offset: Vec3) -> Result<Vec<Vec3>, Fault> {
    let relative = |(vertex, p): (usize, &DVec3)| {
        let single = (*p - offset.as_dvec3()).as_vec3();
        let too_large =
            || Fault::item(format!("vertex {vertex}"), format!("{p} is too large for GLB's f32; write PLY"));
        if single.is_finite() { Ok(single) } else { Err(too_large()) }
    };
    mesh.positions.iter().enumerate().map(relative).collect()
}

/// The JSON part, whose three buffer views follow each other in the binary one.
fn document(mesh: &TriMesh, positions: &[Vec3], offset: Vec3) -> Root {
    let vectors = VECTOR * mesh.vertex_count() as u64;
    let indices = 12 * mesh.face_count() as u64;
    let mut root =
        Root { asset: Asset { generator: Some("Pliant".to_owned()), ..Asset::default() }, ..Root::default() };
    let buffer = root.push(Buffer {
        byte_length: USize64(2 * vectors + indices),
        name: None,
        uri: None,
        extensions: None,
        extras: Default::default(),
    });
    let mut view = |offset, length, target| {
        root.push(buffer::View {
            buffer,
            byte_length: USize64(length),
            byte_offset: Some(USize64(offset)),
            byte_stride: None,
            name: None,
            target: Some(Checked::Valid(target)),
            extensions: None,
            extras: Default::default(),
        })
    };
    let position_view = view(0, vectors, Target::ArrayBuffer);
    let normal_view = view(vectors, vectors, Target::ArrayBuffer);
    let index_view = view(2 * vectors, indices, Target::ElementArrayBuffer);
    let corner =
        |pick: fn(Vec3, Vec3) -> Vec3| positions.iter().copied().reduce(pick).map(|v| Value::from(&v.to_array()[..]));
    let vertices = mesh.vertex_count();
    let position =
        Accessor { min: corner(Vec3::min), max: corner(Vec3::max), ..vector_accessor(position_view, vertices) };
    let position = root.push(position);
    let normal = root.push(vector_accessor(normal_view, vertices));
    let index = root.push(Accessor {
        count: USize64::from(3 * mesh.face_count()),
        component_type: Checked::Valid(GenericComponentType(ComponentType::U32)),
        type_: Checked::Valid(Type::Scalar),
        ..vector_accessor(index_view, 0)
    });
    let material = root.push(clay());
    let primitive = Primitive {
        attributes: [(Semantic::Positions, position), (Semantic::Normals, normal)]
            .map(|(semantic, accessor)| (Checked::Valid(semantic), accessor))
            .into(),
        extensions: None,
        extras: Default::default(),
        indices: Some(index),
        material: Some(material),
        mode: Checked::Valid(Mode::Triangles),
        targets: None,
    };
    let mesh = root.push(Mesh {
        extensions: None,
        extras: Default::default(),
        name: None,
        primitives: vec![primitive],
        weights: None,
    });
    let translation = (offset != Vec3::ZERO).then(|| offset.to_array());
    let node = root.push(Node { mesh: Some(mesh), translation, ..Node::default() });
    let scene = Scene { extensions: None, extras: Default::default(), name: None, nodes: vec![node] };
    root.scene = Some(root.push(scene));
    root
}

fn vector_accessor(view: Index<buffer::View>, count: usize) -> Accessor {
    Accessor {
        buffer_view: Some(view),
        byte_offset: Some(USize64(0)),
        count: USize64::from(count),
        component_type: Checked::Valid(GenericComponentType(ComponentType::F32)),
        extensions: None,
        extras: Default::default(),
        type_: Checked::Valid(Type::Vec3),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
    }
}

/// Matt and seen from both sides: glTF's default is a metal, which is black where there is nothing to reflect.
fn clay() -> Material {
    Material {
        double_sided: true,
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor([0.6, 0.42, 0.3, 1.0]),
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(0.7),
            ..PbrMetallicRoughness::default()
        },
        ..Material::default()
    }
}
