//! MODEL on the command line: a file, or a generated shape.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use pliant::{Bounds, ReadReport, Scene, SceneError, Stages, TriMesh, count, read, shapes, timed};

/// A mesh and where it comes from.
pub(crate) struct Model {
    pub(crate) name: String,
    pub(crate) mesh: TriMesh,
    /// `None` for a generated shape.
    pub(crate) file: Option<ReadReport>,
    path: Option<PathBuf>,
}

impl Model {
    /// Reads or makes the model that `text` names.
    pub(crate) fn open(text: &str, stages: &dyn Stages) -> Result<Self> {
        let size =
            |mesh: &TriMesh| format!("{} vertices, {} faces", count(mesh.vertex_count()), count(mesh.face_count()));
        let generated = text.split_once(':').filter(|(shape, _)| shapes::NAMES.contains(shape));
        if let Some((shape, vertices)) = generated {
            let vertices = vertices.parse().with_context(|| {
                format!("`{text}`: after {shape}: comes a number of vertices, such as {shape}:100000")
            })?;
            let (mesh, _) = timed(stages, &format!("make {shape}"), |_| shapes::by_name(shape, vertices), size)?;
            return Ok(Self { name: text.to_owned(), mesh, file: None, path: None });
        }
        let path = Path::new(text);
        let (asset, _) = timed(stages, "read", |_| read(path), |asset| size(&asset.mesh))?;
        let name = path.file_name().map_or_else(|| text.to_owned(), |n| n.to_string_lossy().into_owned());
        Ok(Self { name, mesh: asset.mesh, file: Some(asset.report), path: Some(path.to_owned()) })
    }

    /// The scene that was asked for; without one, the creature's own or `auto`.
    pub(crate) fn scene(&self, asked: Option<&str>) -> Result<Scene, SceneError> {
        let own = if self.name.starts_with("creature:") && self.path.is_none() { "creature" } else { "auto" };
        Scene::find(asked.unwrap_or(own), &self.mesh.bounds())
    }

    /// Repairs made while reading that a user should know of.
    pub(crate) fn notes(&self) -> Vec<String> {
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

    /// Bounding box, in units of the model.
    pub(crate) fn bounds(&self) -> Bounds {
        self.mesh.bounds()
    }

    /// Refuses to write over the model's own file or the scene's, by whatever name.
    pub(crate) fn check_outputs<'a>(
        &self,
        outputs: impl IntoIterator<Item = &'a Path>,
        scene: Option<&str>,
    ) -> Result<()> {
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        let inputs = [(self.path.as_deref(), "the model"), (scene.map(Path::new), "the scene")];
        for output in outputs {
            for (input, what) in inputs {
                if input.is_some_and(|input| same(input, output)) {
                    bail!("{}: this is {what} itself; write to another file", output.display());
                }
            }
        }
        Ok(())
    }
}
