//! glTF 2.0, `.gltf` and `.glb`.
//!
//! The JSON is parsed by `gltf::json`; everything behind it is read by an own checked pass, because the accessors of
//! gltf 1.4 panic on wrong types and strides, give nothing for an unreadable index list (as for no list at all), allocate
//! from counts in the file, follow paths anywhere, and its validation panics on an accessor out of range.

mod accessor;
mod buffers;
mod scene;

use std::path::Path;

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Root, accessor::Type};
use glam::{DAffine3, DVec3};

use crate::error::Fault;
use crate::soup::Soup;
use accessor::Accessors;
use buffers::{Buffers, container};

pub(crate) fn read(bytes: &[u8], folder: Option<&Path>, soup: &mut Soup) -> Result<(), Fault> {
    let (json, chunk) = container(bytes)?;
    let root = Root::from_slice(json).map_err(|e| Fault::line(e.line(), format!("the JSON is not glTF 2.0: {e}")))?;
    check_version(&root)?;
    let buffers = Buffers::new(&root, chunk, folder);
    let mut accessors = Accessors::new(&root, &buffers, bytes.len());
    for (node, mesh, transform) in scene::placed_meshes(&root, soup)? {
        let Some(parts) = root.meshes.get(mesh) else {
            return Err(Fault::item(format!("node {node}"), format!("there is no mesh {mesh}")));
        };
        for (k, primitive) in parts.primitives.iter().enumerate() {
            add_primitive(&mut accessors, primitive, transform, &format!("mesh {mesh}, primitive {k}"), soup)?;
        }
        soup.drop("morph targets", parts.primitives.iter().flat_map(|p| &p.targets).map(Vec::len).sum());
    }
    soup.drop("animations", root.animations.len());
    soup.drop("materials", root.materials.len());
    Ok(())
}

fn check_version(root: &Root) -> Result<(), Fault> {
    if !root.asset.version.starts_with("2.") {
        return Err(Fault::file(format!("glTF version {:?} is not 2.0", root.asset.version)));
    }
    // These change how a surface looks, or are handled here; any other may change where it is.
    let harmless = ["KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "MSFT_texture_"];
    let unknown = |e: &&String| !harmless.iter().any(|h| e.starts_with(h)) && *e != "KHR_mesh_quantization";
    match root.extensions_required.iter().find(unknown) {
        Some(extension) => {
            Err(Fault::file(format!("the file needs the extension {extension:?}, which is not supported")))
        }
        None => Ok(()),
    }
}

/// Adds the triangles of a primitive, its vertices moved by `transform`.
fn add_primitive(
    accessors: &mut Accessors<'_>,
    primitive: &Primitive,
    transform: DAffine3,
    name: &str,
    soup: &mut Soup,
) -> Result<(), Fault> {
    let Checked::Valid(mode) = primitive.mode else {
        return Err(Fault::item(name, "the mode is none of 0 to 6"));
    };
    if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        soup.drop("primitives of points or lines", 1);
        return Ok(());
    }
    let Some(positions) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
        soup.drop("primitives without positions", 1);
        return Ok(());
    };
    let coordinates = accessors.numbers(positions.value(), Type::Vec3)?;
    let first = soup.positions.len();
    for (i, point) in coordinates.chunks_exact(3).enumerate() {
        let placed = transform.transform_point3(DVec3::new(point[0], point[1], point[2]));
        soup.vertex(placed).map_err(|reason| Fault::item(name, format!("position {i}: {reason}")))?;
    }
    let count = soup.positions.len() - first;
    let mut corners: Vec<u32> = match primitive.indices {
        // Fits: `Soup::vertex` numbers vertices in 32 bits.
        None => (first as u32..soup.positions.len() as u32).collect(),
        Some(indices) => {
            let numbers = accessors.numbers(indices.value(), Type::Scalar)?;
            if let Some(bad) = numbers.iter().find(|&&i| i >= count as f64) {
                return Err(Fault::item(name, format!("an index names vertex {bad}, but there are {count}")));
            }
            numbers.iter().map(|&i| first as u32 + i as u32).collect()
        }
    };
    for semantic in primitive.attributes.keys() {
        let Checked::Valid(semantic) = semantic else { continue };
        if *semantic != Semantic::Positions {
            soup.drop(&format!("vertex attributes {}", semantic.to_string()), count);
        }
    }
    // A mirroring transform turns every triangle inside out; glTF asks to turn them back.
    let mirrored = transform.matrix3.determinant() < 0.0;
    let start = soup.triangles.len();
    match mode {
        Mode::Triangles => {
            let whole = corners.len() / 3 * 3;
            soup.drop("indices after the last whole triangle", corners.len() - whole);
            corners.truncate(whole);
            for corners in corners.chunks_exact(3) {
                soup.polygon(corners);
            }
        }
        Mode::TriangleStrip => soup.strip(&corners),
        _ => {
            soup.faces += corners.len().saturating_sub(2);
            for pair in corners.get(1..).unwrap_or_default().windows(2) {
                soup.triangles.push([pair[0], pair[1], corners[0]]);
            }
        }
    }
    if mirrored {
        for triangle in &mut soup.triangles[start..] {
            triangle.swap(1, 2);
        }
    }
    Ok(())
}
