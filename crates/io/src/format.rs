use std::path::Path;

use serde::Serialize;

use crate::IoError;

/// A mesh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Wavefront OBJ, text.
    Obj,
    /// Stanford PLY, text or binary of either byte order.
    Ply,
    /// Geomview OFF, text.
    Off,
    /// STL, text or binary.
    Stl,
    /// glTF 2.0: JSON with buffers beside it or inside it.
    Gltf,
    /// glTF 2.0 in one binary file.
    Glb,
}

impl Format {
    /// Formats that [`crate::read`] takes.
    pub const READABLE: &'static [Self] = &[Self::Obj, Self::Ply, Self::Off, Self::Stl, Self::Glb, Self::Gltf];
    /// Formats that [`crate::write`] makes.
    pub const WRITABLE: &'static [Self] = &[Self::Obj, Self::Ply, Self::Glb];

    /// The file extension, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Ply => "ply",
            Self::Off => "off",
            Self::Stl => "stl",
            Self::Gltf => "gltf",
            Self::Glb => "glb",
        }
    }

    /// The format among `formats` that the path's extension names; upper and lower case are one.
    pub(crate) fn among(formats: &[Self], path: &Path, action: &'static str) -> Result<Self, IoError> {
        let names: Vec<&str> = formats.iter().map(|f| f.extension()).collect();
        let index = check_extension(path, &names, action)?;
        Ok(formats[index])
    }
}

/// The position in `supported` of the path's extension.
pub(crate) fn check_extension(path: &Path, supported: &[&str], action: &'static str) -> Result<usize, IoError> {
    let extension = path.extension().map(|e| e.to_string_lossy().into_owned());
    let found = extension.as_deref().and_then(|e| supported.iter().position(|s| s.eq_ignore_ascii_case(e)));
    found.ok_or_else(|| IoError::Extension {
        path: path.to_owned(),
        extension,
        action,
        supported: supported.iter().map(ToString::to_string).collect(),
    })
}

/// Whether a file could be written: for use before a long computation whose result should go there.
///
/// Checks that the extension is one of `extensions` (without dots, case ignored; an empty list allows any) and that a file
/// could be written there ([`pliant_files::probe`]). Meshes: [`can_write_mesh`].
///
/// # Errors
/// Another extension, or what [`pliant_files::write_atomic`] would say.
pub fn can_write(path: &Path, extensions: &[&str]) -> Result<(), IoError> {
    if !extensions.is_empty() {
        check_extension(path, extensions, "write")?;
    }
    Ok(pliant_files::probe(path)?)
}

/// [`can_write`] for the formats of [`crate::write`].
///
/// # Errors
/// As [`can_write`].
pub fn can_write_mesh(path: &Path) -> Result<(), IoError> {
    let extensions: Vec<&str> = Format::WRITABLE.iter().map(|f| f.extension()).collect();
    can_write(path, &extensions)
}
