//! Writers of meshes: each makes the bytes of a file.

mod glb;
mod obj;
mod ply;

use std::path::Path;

use pliant_mesh::{MeshError, TriMesh};

use crate::{Format, IoError, write_atomic};

/// Writes a mesh; the format is that of the extension (obj, ply, glb in upper or lower case).
///
/// | format | positions | besides |
/// |---|---|---|
/// | obj | the shortest decimals that read back to the same f64 | |
/// | ply | f64 (binary, little endian) | |
/// | glb | f32, relative to a node's translation (see below) | vertex normals, weighted by area |
///
/// GLB has f32 only. Where rounding to it would show (the spacing of f32 numbers at the largest coordinate exceeds 1e-4
/// of the median edge), positions are stored relative to the middle of the bounding box, and the node that places the
/// mesh has the middle as its translation; [`crate::read`] and every viewer put the two together again.
///
/// The file appears complete or not at all ([`write_atomic`]).
///
/// # Errors
/// Another extension; a mesh without faces or with a position that is not finite; a GLB whose positions exceed f32 or
/// whose size exceeds 4 GiB; or the system's answer.
pub fn write(path: &Path, mesh: &TriMesh) -> Result<(), IoError> {
    let format = Format::among(Format::WRITABLE, path, "write")?;
    Ok(write_atomic(path, &encode(mesh, format, path)?)?)
}

/// The bytes of a file, as [`write()`] makes them; `<bytes>` stands for its path in messages.
///
/// # Errors
/// As [`write()`].
pub fn write_bytes(mesh: &TriMesh, format: Format) -> Result<Vec<u8>, IoError> {
    encode(mesh, format, Path::new("<bytes>"))
}

fn encode(mesh: &TriMesh, format: Format, path: &Path) -> Result<Vec<u8>, IoError> {
    if mesh.face_count() == 0 {
        return Err(IoError::NoFaces { path: path.to_owned(), vertices: mesh.vertex_count() });
    }
    if let Some(vertex) = mesh.positions.iter().position(|p| !p.is_finite()) {
        return Err(IoError::Mesh { path: path.to_owned(), source: MeshError::NotFinite { vertex } });
    }
    match format {
        Format::Obj => Ok(obj::encode(mesh)),
        Format::Ply => Ok(ply::encode(mesh)),
        Format::Glb => glb::encode(mesh).map_err(|fault| fault.of(path)),
        Format::Off | Format::Stl | Format::Gltf => Err(IoError::Extension {
            path: path.to_owned(),
            extension: Some(format.extension().to_owned()),
            action: "write",
            supported: Format::WRITABLE.iter().map(|f| f.extension().to_owned()).collect(),
        }),
    }
}
