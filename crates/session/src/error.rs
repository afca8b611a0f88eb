use pliant_cage::{BindingFault, CageError, Fingerprint};
use pliant_deform::DeformError;
use pliant_mesh::MeshError;
use thiserror::Error;

/// Why an editor refused. What it holds is as it was before the call.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The cage or the binding could not be made, or opening was cancelled.
    #[error(transparent)]
    Cage(#[from] CageError),
    /// A saved cage does not fit.
    #[error(transparent)]
    Binding(#[from] BindingFault),
    /// The solver refused or failed.
    #[error(transparent)]
    Deform(#[from] DeformError),
    /// The shape cannot be used.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// There is no handle of this number.
    #[error("there is no handle {handle}")]
    NoHandle {
        /// Its number.
        handle: u32,
    },
    /// A handle cannot be used.
    #[error("the handle cannot be used: {reason}")]
    BadGrip {
        /// Why.
        reason: String,
    },
    /// Something was asked for that needs handles.
    #[error("nothing is grabbed: add a handle first")]
    NothingGrabbed,
    /// There is no step to refine.
    #[error("nothing to refine: release a step first, and refine it before anything else is done")]
    NothingToRefine,
    /// A hard handle holds vertices outside the region, which may not move.
    #[error("handle {handle} is to move vertex {vertex}, which is outside the region")]
    OutsideRegion {
        /// The handle.
        handle: u32,
        /// The first such vertex.
        vertex: u32,
    },
    /// A document is of another mesh.
    #[error("the document was made for another mesh ({expected}), this one is ({found})")]
    OtherMesh {
        /// Fingerprint in the document.
        expected: String,
        /// Fingerprint of the mesh given.
        found: Fingerprint,
    },
    /// A document cannot be read.
    #[error("not a document of an editing session: {0}")]
    Document(#[source] serde_json::Error),
    /// A document is of another version.
    #[error("the document has version {found}; this program reads version {supported}")]
    Version {
        /// In the document.
        found: u32,
        /// What is read.
        supported: u32,
    },
    /// A step of a document cannot be done.
    #[error("step {step} of the document ('{name}'): {source}")]
    Step {
        /// Its number, from 1.
        step: usize,
        /// Its name.
        name: String,
        /// Why.
        source: Box<SessionError>,
    },
    /// A number of a document is out of range.
    #[error("{what} is {found}; {expected}")]
    OutOfRange {
        /// What it is.
        what: &'static str,
        /// The number.
        found: String,
        /// What it may be.
        expected: String,
    },
    /// Writing a document failed.
    #[error(transparent)]
    File(#[from] pliant_files::FileError),
}
