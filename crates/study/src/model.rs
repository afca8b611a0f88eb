//! A model by its name: a file, or a generated shape.

use std::io::Read;
use std::path::{Path, PathBuf};

use pliant_cage::Fingerprint;
use pliant_io::{IoError, ReadReport, read};
use pliant_mesh::{MeshError, TriMesh, shapes};
use thiserror::Error;
use twox_hash::XxHash3_128;

use crate::pipeline::count;
use crate::stages::{Stages, timed};
use crate::{Scene, SceneError};

/// A mesh and where it comes from.
#[derive(Debug, Clone)]
pub struct Model {
    /// What reports call it: the file's name without its folder, or the generator, as `creature:100000`.
    pub name: String,
    /// The shape.
    pub mesh: TriMesh,
    /// What reading the file changed; `None` for a generated shape.
    pub file: Option<ReadReport>,
    /// The file; `None` for a generated shape.
    pub path: Option<PathBuf>,
}

/// Why there is no model of some name.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A generated shape is asked for without a number of vertices.
    #[error("`{found}`: after {shape}: comes a number of vertices, such as {shape}:100000")]
    BadCount {
        /// What was given.
        found: String,
        /// The generator.
        shape: String,
    },
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The shape cannot be generated.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The file's bytes cannot be read.
    #[error("{file}: {error}")]
    Bytes {
        /// Its path.
        file: String,
        /// The system's reason.
        error: std::io::Error,
    },
}

/// What a model's text asks for.
enum Source<'a> {
    /// A generator and what stands after its colon.
    Generated(&'a str, &'a str),
    File(&'a Path),
}

impl<'a> Source<'a> {
    fn of(text: &'a str) -> Self {
        match text.split_once(':') {
            Some((shape, vertices)) if shapes::NAMES.contains(&shape) => Self::Generated(shape, vertices),
            _ => Self::File(Path::new(text)),
        }
    }
}

impl Model {
    /// Reads or makes the model that `text` names: a path, or a generator with a number of vertices (`creature:100000`).
    ///
    /// # Errors
    /// As [`read`] and [`shapes::by_name`].
    pub fn open(text: &str, stages: &dyn Stages) -> Result<Self, ModelError> {
        let size =
            |mesh: &TriMesh| format!("{} vertices, {} faces", count(mesh.vertex_count()), count(mesh.face_count()));
        match Source::of(text) {
            Source::Generated(shape, vertices) => {
                let bad = |_| ModelError::BadCount { found: text.to_owned(), shape: shape.to_owned() };
                let vertices = vertices.parse().map_err(bad)?;
                let (mesh, _) = timed(stages, &format!("make {shape}"), |_| shapes::by_name(shape, vertices), size)?;
                Ok(Self { name: text.to_owned(), mesh, file: None, path: None })
            }
            Source::File(path) => {
                let (asset, _) = timed(stages, "read", |_| read(path), |asset| size(&asset.mesh))?;
                let name = Self::name_of(text);
                Ok(Self { name, mesh: asset.mesh, file: Some(asset.report), path: Some(path.to_owned()) })
            }
        }
    }

    /// Whether `text` names a generated shape, and not a file.
    pub(crate) fn is_generated(text: &str) -> bool {
        matches!(Source::of(text), Source::Generated(..))
    }

    /// What reports call the model that `text` names, whether or not it can be opened.
    pub fn name_of(text: &str) -> String {
        match Source::of(text) {
            Source::Generated(..) => text.to_owned(),
            Source::File(path) => {
                path.file_name().map_or_else(|| text.to_owned(), |n| n.to_string_lossy().into_owned())
            }
        }
    }

    /// Name of the scene that the model has where none is asked for: the creature its own, any other `auto`.
    pub fn own_scene(text: &str) -> &'static str {
        if matches!(Source::of(text), Source::Generated("creature", _)) { "creature" } else { "auto" }
    }

    /// The scene that was asked for; without one, the model's own.
    ///
    /// # Errors
    /// As [`Scene::find`].
    pub fn scene(&self, asked: Option<&str>) -> Result<Scene, SceneError> {
        let own = if self.path.is_none() { Self::own_scene(&self.name) } else { "auto" };
        Scene::find(asked.unwrap_or(own), &self.mesh.bounds())
    }

    /// A hash of what the model that `text` names is made of: a file's bytes, and those of the files it refers to; a generator's name.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn content_hash(text: &str) -> Result<u128, ModelError> {
        let mut hasher = XxHash3_128::default();
        match Source::of(text) {
            Source::Generated(..) => hasher.write(text.as_bytes()),
            Source::File(path) => {
                hash_file(path, &mut hasher)
                    .map_err(|error| ModelError::Bytes { file: path.display().to_string(), error })?;
                // What a glTF file keeps in others is known by the mesh that comes of it.
                if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gltf")) {
                    hasher.write(Fingerprint::of(&read(path)?.mesh).to_string().as_bytes());
                }
            }
        }
        Ok(hasher.finish_128())
    }

    /// Repairs made while reading that a user should know of.
    pub fn notes(&self) -> Vec<String> {
        let Some(file) = &self.file else { return Vec::new() };
        let clean = file.clean;
        let mut notes: Vec<String> = [
            (file.triangulated, "faces with more than three corners were cut into triangles"),
            (clean.welded, "vertices at the position of an earlier one were welded to it"),
            (clean.degenerate_faces, "faces with two corners in one place were left out"),
            (clean.repeated_faces, "repeated faces were left out"),
            (clean.unused_vertices, "vertices are used by no face"),
        ]
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{} {what}", count(*n)))
        .collect();
        notes.extend(file.dropped.iter().map(|(what, n)| format!("{} {what} were left out", count(*n))));
        notes
    }
}

fn hash_file(path: &Path, hasher: &mut XxHash3_128) -> std::io::Result<()> {
    // A pipe or a device may never end.
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("not a regular file"));
    }
    let mut file = std::fs::File::open(path)?;
    let mut buffer = vec![0; 1 << 16];
    loop {
        let n = file.read(&mut buffer)?;
        if n == 0 {
            return Ok(());
        }
        hasher.write(&buffer[..n]);
    }
}
