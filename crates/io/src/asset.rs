use std::collections::BTreeMap;
use std::path::Path;

use pliant_files::read_regular;
use pliant_mesh::{CleanReport, TriMesh, clean_soup};
use serde::Serialize;

use crate::error::Fault;
use crate::soup::Soup;
use crate::{Format, IoError, gltf, obj, off, ply, stl};

/// A mesh read from a file, in normal form, and how the file maps to it.
#[derive(Debug, Clone)]
pub struct Asset {
    /// Welded and triangulated; has at least one face.
    pub mesh: TriMesh,
    /// Mesh vertex of each vertex of the file, in the file's order.
    pub weld: Vec<u32>,
    /// What the file held and what became of it.
    pub report: ReadReport,
}

/// What a file held and what was changed or left out on the way to the mesh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ReadReport {
    /// The file's format.
    pub format: Format,
    /// Vertices in the file (each corner counts in STL; each instance in glTF).
    pub file_vertices: usize,
    /// Faces in the file, of any number of corners.
    pub file_faces: usize,
    /// Faces with more than three corners, cut into a fan round their first corner.
    pub triangulated: usize,
    /// Repairs on the way to normal form.
    pub clean: CleanReport,
    /// What the file held that the mesh does not, and how often: lines, points, normals, texture coordinates, skins...
    pub dropped: BTreeMap<String, usize>,
}

/// Reads a mesh; the format is that of the extension (obj, ply, off, stl, glb, gltf in upper or lower case).
///
/// All of the file becomes one mesh: OBJ groups and materials do not split it, and the meshes of a glTF scene are
/// placed by their nodes. Vertices keep their order; those at bit-equal positions become one ([`Asset::weld`]).
/// Polygons are cut into fans. Takes time and memory in proportion to the file's size (a glTF file may use one mesh
/// many times; its expansion is bounded).
///
/// # Errors
/// The path and the line, byte, accessor or node at fault; also for a file without faces, and for anything that is
/// not a regular file.
pub fn read(path: &Path) -> Result<Asset, IoError> {
    let format = Format::among(Format::READABLE, path, "read")?;
    let bytes = read_regular(path, u64::MAX)?;
    // The folder of "mesh.gltf" is "", which means here.
    let folder = path.parent().map(|p| if p.as_os_str().is_empty() { Path::new(".") } else { p });
    parse(&bytes, format, path, folder)
}

/// Reads a mesh from the bytes of a file; `<bytes>` stands for its path in messages.
///
/// A glTF file must bring its buffers with it: nothing is opened.
///
/// # Errors
/// As [`read`].
pub fn read_bytes(bytes: &[u8], format: Format) -> Result<Asset, IoError> {
    parse(bytes, format, Path::new("<bytes>"), None)
}

fn parse(bytes: &[u8], format: Format, path: &Path, folder: Option<&Path>) -> Result<Asset, IoError> {
    let mut soup = Soup::default();
    let outcome: Result<(), Fault> = match format {
        Format::Obj => obj::read(bytes, &mut soup),
        Format::Ply => ply::read(bytes, &mut soup),
        Format::Off => off::read(bytes, &mut soup),
        Format::Stl => stl::read(bytes, &mut soup),
        Format::Gltf | Format::Glb => gltf::read(bytes, folder, &mut soup),
    };
    outcome.map_err(|fault| fault.of(path))?;
    let no_faces = |vertices| IoError::NoFaces { path: path.to_owned(), vertices };
    if soup.triangles.is_empty() {
        return Err(no_faces(soup.positions.len()));
    }
    let cleaned = clean_soup(&soup.positions, &soup.triangles)
        .map_err(|source| IoError::Mesh { path: path.to_owned(), source })?;
    if cleaned.mesh.face_count() == 0 {
        // All faces had two corners at one point.
        return Err(no_faces(cleaned.mesh.vertex_count()));
    }
    let report = ReadReport {
        format,
        file_vertices: soup.positions.len(),
        file_faces: soup.faces,
        triangulated: soup.triangulated,
        clean: cleaned.report,
        dropped: soup.dropped,
    };
    Ok(Asset { mesh: cleaned.mesh, weld: cleaned.weld, report })
}
