use pliant_mesh::MeshError;
use thiserror::Error;

/// Why a control mesh or a binding could not be made.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum CageError {
    /// There is no surface to simplify or to bind to.
    #[error("the mesh has no faces")]
    NoFaces,
    /// An option is out of its range.
    #[error("{what} cannot be {found}")]
    BadOption {
        /// The option and its range.
        what: &'static str,
        /// The value given.
        found: String,
    },
    /// A prune rule could not be read.
    #[error("`{found}` is not a prune rule: use magnitude:SHARE, local:NEIGHBOURS, smooth:NEIGHBOURS or none")]
    BadPrune {
        /// What was given.
        found: String,
    },
    /// The rows would need more entries than 32-bit offsets can number.
    #[error("the binding would keep {entries} weights, more than 32-bit offsets can number")]
    TooManyEntries {
        /// How many.
        entries: usize,
    },
    /// A cage is bound to another shape than it was made of.
    #[error("the cage was made of a shape of {expected} vertices, this one has {found}")]
    OtherShape {
        /// Vertices of the shape that was simplified.
        expected: usize,
        /// Vertices of the shape given.
        found: usize,
    },
    /// The computation was told to stop ([`pliant_mesh::Progress::is_cancelled`]).
    #[error("{what} was cancelled")]
    Cancelled {
        /// What was being done.
        what: &'static str,
    },
    /// A mesh is broken.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}
