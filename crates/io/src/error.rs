use std::fmt;
use std::path::{Path, PathBuf};

use pliant_files::FileError;
use pliant_mesh::MeshError;
use thiserror::Error;

/// Why a file could not be read or written; every message starts with the file's path.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum IoError {
    /// The file itself could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The file's extension names no known format.
    #[error("{}: cannot {action} {}; use one of: {}", path.display(), extension_text(extension.as_deref()), supported.join(", "))]
    Extension {
        /// The path.
        path: PathBuf,
        /// Its extension, if it has one.
        extension: Option<String>,
        /// "read" or "write".
        action: &'static str,
        /// Extensions that would do, without the dot.
        supported: Vec<String>,
    },
    /// The content breaks the rules of its format or uses a part of it that is not supported.
    #[error("{}{place}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong there.
        reason: String,
    },
    /// The mesh has no faces, so there is nothing to deform.
    #[error("{}: there are no faces ({vertices} vertices)", path.display())]
    NoFaces {
        /// The file.
        path: PathBuf,
        /// How many vertices there are.
        vertices: usize,
    },
    /// The mesh itself is at fault.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with the mesh.
        source: MeshError,
    },
}

fn extension_text(extension: Option<&str>) -> String {
    extension.map_or_else(|| "a file without an extension".to_owned(), |e| format!("\".{e}\" files"))
}

/// Where in a file something is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// No one place.
    File,
    /// A line, numbered from 1.
    Line(usize),
    /// An offset in bytes from the start.
    Byte(usize),
    /// A numbered part, such as "accessor 3".
    Item(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(line) => write!(f, ":{line}"),
            Self::Byte(byte) => write!(f, ": at byte {byte}"),
            Self::Item(item) => write!(f, ": {item}"),
        }
    }
}

/// An [`IoError::Content`] that does not know its file yet: what the readers of the formats return.
#[derive(Debug)]
pub(crate) struct Fault {
    place: Place,
    reason: String,
}

impl Fault {
    pub(crate) fn file(reason: impl Into<String>) -> Self {
        Self { place: Place::File, reason: reason.into() }
    }

    pub(crate) fn line(line: usize, reason: impl Into<String>) -> Self {
        Self { place: Place::Line(line), reason: reason.into() }
    }

    pub(crate) fn byte(byte: usize, reason: impl Into<String>) -> Self {
        Self { place: Place::Byte(byte), reason: reason.into() }
    }

    pub(crate) fn item(item: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { place: Place::Item(item.into()), reason: reason.into() }
    }

    pub(crate) fn of(self, path: &Path) -> IoError {
        IoError::Content { path: path.to_owned(), place: self.place, reason: self.reason }
    }
}
