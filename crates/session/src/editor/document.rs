//! Sessions as documents: what was done, step by step, to be done again.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use pliant_cage::Fingerprint;
use pliant_deform::Constraint;
use pliant_mesh::{Progress, Similarity, TriMesh, VertexSet};
use serde::{Deserialize, Serialize};

use super::{Editor, EditorHandle, EditorOptions, Grip, SurfacePoint};
use crate::SessionError;

/// The version of documents that this program writes and reads.
const VERSION: u32 = 1;

/// An editing session as a document: the mesh it was on, how the editor was set up, and what was done.
///
/// [`Editor::replay`] gives back the very bits, on the same version of this library.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    /// Version of the form.
    pub version: u32,
    /// The mesh: where it was read from, in the words of whoever saves the document.
    pub mesh: String,
    /// Its fingerprint ([`Fingerprint`], as text).
    pub fingerprint: String,
    /// How the editor was set up.
    pub options: EditorOptions,
    /// Steps, the oldest first; those that were undone come last.
    pub steps: Vec<DocumentStep>,
    /// How many of the steps are undone.
    pub undone: usize,
}

/// One step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DocumentStep {
    /// What it is called.
    pub name: String,
    /// The vertices that might move; all if missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<Ranges>,
    /// The handles and where they went.
    pub handles: Vec<DocumentHandle>,
    /// Steps it was refined by after its release ([`Editor::refine`]).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub refined: u32,
    /// Whether it is undone together with the step before.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub joined: bool,
}

fn is_zero(n: &u32) -> bool {
    *n == 0
}

/// A handle and its goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DocumentHandle {
    /// The vertices it holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertices: Option<Ranges>,
    /// The point it holds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<SurfacePoint>,
    /// How.
    #[serde(default)]
    pub constraint: Constraint,
    /// Rotation of its goal: a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Scale of its goal.
    pub scale: f64,
    /// Translation of its goal, after rotation and scale about the origin.
    pub translation: [f64; 3],
}

/// Vertices as ranges of numbers, first and last.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ranges(pub Vec<[u32; 2]>);

impl Ranges {
    /// The ranges of a set.
    pub fn of(set: &VertexSet) -> Self {
        let mut ranges: Vec<[u32; 2]> = Vec::new();
        for v in set.iter() {
            match ranges.last_mut() {
                Some([_, last]) if *last + 1 == v => *last = v,
                _ => ranges.push([v, v]),
            }
        }
        Self(ranges)
    }

    /// The set, of a shape with so many vertices.
    ///
    /// # Errors
    /// [`SessionError::OutOfRange`] for a range that is not one or leaves the shape.
    pub fn to_set(&self, vertices: usize) -> Result<VertexSet, SessionError> {
        // Checked before anything is made of them.
        for &[first, last] in &self.0 {
            if first > last || last as usize >= vertices {
                return Err(SessionError::OutOfRange {
                    what: "a range of vertices",
                    found: format!("{first} to {last}"),
                    expected: format!("the shape has vertices 0 to {}", vertices.saturating_sub(1)),
                });
            }
        }
        let mut inside = vec![false; vertices];
        for &[first, last] in &self.0 {
            inside[first as usize..=last as usize].fill(true);
        }
        Ok(VertexSet::where_true(vertices, |v| inside[v as usize]))
    }
}

impl DocumentStep {
    pub(crate) fn new(name: &str, region: Option<&VertexSet>, handles: &[EditorHandle]) -> Self {
        let handles = handles.iter().map(DocumentHandle::of).collect();
        Self { name: name.to_owned(), region: region.map(Ranges::of), handles, refined: 0, joined: false }
    }

    /// Whether `next` goes on with the same handles, under the same name.
    pub(crate) fn is_continued_by(&self, next: &Self) -> bool {
        let same = |(a, b): (&DocumentHandle, &DocumentHandle)| {
            (&a.vertices, &a.point, a.constraint) == (&b.vertices, &b.point, b.constraint)
        };
        self.name == next.name
            && self.region == next.region
            && self.handles.len() == next.handles.len()
            && self.handles.iter().zip(&next.handles).all(same)
    }
}

impl DocumentHandle {
    fn of(handle: &EditorHandle) -> Self {
        let (vertices, point) = match &handle.grip {
            Grip::Vertices(set) => (Some(Ranges::of(set)), None),
            Grip::Point(point) => (None, Some(*point)),
        };
        let Similarity { rotation, scale, translation } = handle.goal;
        let (rotation, translation) = (rotation.to_array(), translation.to_array());
        Self { vertices, point, constraint: handle.constraint, rotation, scale, translation }
    }

    fn grip(&self, vertices: usize) -> Result<Grip, SessionError> {
        match (&self.vertices, self.point) {
            (Some(ranges), None) => Ok(Grip::Vertices(ranges.to_set(vertices)?)),
            (None, Some(point)) => Ok(Grip::Point(point)),
            _ => Err(SessionError::BadGrip { reason: "it needs vertices or a point, not both".to_owned() }),
        }
    }

    fn goal(&self) -> Similarity {
        Similarity {
            rotation: DQuat::from_array(self.rotation),
            scale: self.scale,
            translation: DVec3::from_array(self.translation),
        }
    }
}

impl Document {
    /// Reads a document.
    ///
    /// # Errors
    /// [`SessionError::Document`] with line and column, [`SessionError::Version`].
    pub fn parse(json: &[u8]) -> Result<Self, SessionError> {
        #[derive(Deserialize)]
        struct Head {
            version: u32,
        }
        // The version first: another one may have other fields.
        let head: Head = serde_json::from_slice(json).map_err(SessionError::Document)?;
        if head.version != VERSION {
            return Err(SessionError::Version { found: head.version, supported: VERSION });
        }
        serde_json::from_slice(json).map_err(SessionError::Document)
    }

    /// As JSON, the same bytes for the same document.
    ///
    /// # Errors
    /// [`SessionError::Document`] for a number that is not finite.
    pub fn to_json(&self) -> Result<String, SessionError> {
        let text = serde_json::to_string_pretty(self).map_err(SessionError::Document)? + "\n";
        // JSON has no words for numbers that are not finite: they would be read as something else, or not at all.
        match serde_json::from_str::<Self>(&text) {
            Ok(read) if read == *self => Ok(text),
            _ => Err(SessionError::Document(serde::ser::Error::custom("a number in it is not finite"))),
        }
    }

    /// Writes it to a file, whole or not at all.
    ///
    /// # Errors
    /// As [`Self::to_json`], and [`SessionError::File`].
    pub fn save(&self, path: &Path) -> Result<(), SessionError> {
        Ok(pliant_files::write_atomic(path, self.to_json()?.as_bytes())?)
    }

    /// Documents of more bytes (256 MiB) are not read.
    pub const MOST_BYTES: u64 = 1 << 28;

    /// Reads it from a file.
    ///
    /// # Errors
    /// As [`Self::parse`], and [`SessionError::File`].
    pub fn load(path: &Path) -> Result<Self, SessionError> {
        Self::parse(&pliant_files::read_regular(path, Self::MOST_BYTES)?)
    }
}

impl Editor {
    /// What was done so far, with `mesh` as the words for where the shape is from. A step under way is not in it.
    pub fn document(&self, mesh: &str) -> Document {
        Document {
            version: VERSION,
            mesh: mesh.to_owned(),
            fingerprint: Fingerprint::of(&self.rest).to_string(),
            options: self.options.clone(),
            steps: self.steps.clone(),
            undone: self.redoable_steps(),
        }
    }

    /// Opens the shape of a document and does all its steps again; those that were undone are undone. The result has the bits that the
    /// editor had when the document was made.
    ///
    /// # Errors
    /// [`SessionError::OtherMesh`], and [`SessionError::Step`] naming the step that cannot be done.
    pub fn replay(document: &Document, shape: TriMesh, progress: &dyn Progress) -> Result<Self, SessionError> {
        let found = Fingerprint::of(&shape);
        if document.fingerprint != found.to_string() {
            return Err(SessionError::OtherMesh { expected: document.fingerprint.clone(), found });
        }
        if document.undone > document.steps.len() {
            return Err(SessionError::OutOfRange {
                what: "the number of undone steps",
                found: document.undone.to_string(),
                expected: format!("there are {} steps", document.steps.len()),
            });
        }
        let mut editor = Self::open(shape, document.options.clone(), progress)?;
        for (number, step) in document.steps.iter().enumerate() {
            editor.redo_step(step).map_err(|source| SessionError::Step {
                step: number + 1,
                name: step.name.clone(),
                source: Box::new(source),
            })?;
        }
        while editor.redoable_steps() < document.undone {
            if !editor.undo() {
                break;
            }
        }
        editor.handles.clear();
        editor.prepared = None;
        Ok(editor)
    }

    fn redo_step(&mut self, step: &DocumentStep) -> Result<(), SessionError> {
        let vertices = self.rest.vertex_count();
        let region = step.region.as_ref().map(|ranges| ranges.to_set(vertices)).transpose()?;
        self.handles.clear();
        self.prepared = None;
        self.set_region(region)?;
        for handle in &step.handles {
            let id = self.add_handle(handle.grip(vertices)?, handle.constraint)?;
            self.drag(id, handle.goal())?;
        }
        if step.joined {
            self.release_on(&step.name)?;
        } else {
            self.release(&step.name)?;
        }
        if step.refined > 0 {
            self.refine_steps(step.refined)?;
        }
        Ok(())
    }
}

/// Saves a document from time to time.
#[derive(Debug)]
pub struct Autosave {
    path: PathBuf,
    every: Duration,
    last: Instant,
    saved: Option<Document>,
}

impl Autosave {
    /// To a file, no more often than `every`.
    pub fn new(path: impl Into<PathBuf>, every: Duration) -> Self {
        Self { path: path.into(), every, last: Instant::now(), saved: None }
    }

    /// Saves if it is time to and something has changed; whether it did. Call it whenever nothing else is to do.
    ///
    /// # Errors
    /// As [`Document::save`]; the file that was there stays.
    pub fn tick(&mut self, editor: &Editor, mesh: &str) -> Result<bool, SessionError> {
        if self.last.elapsed() < self.every {
            return Ok(false);
        }
        self.last = Instant::now();
        let document = editor.document(mesh);
        if self.saved.as_ref() == Some(&document) {
            return Ok(false);
        }
        document.save(&self.path)?;
        self.saved = Some(document);
        Ok(true)
    }
}
