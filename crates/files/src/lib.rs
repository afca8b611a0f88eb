//! Files: written whole or not at all, and only regular ones read.
//!
//! This crate knows no format and no mesh.

mod atomic;
mod source;

use std::path::PathBuf;

use thiserror::Error;

pub use atomic::{probe, write_atomic};
pub use source::read_regular;

/// Why a file could not be read or written; every message starts with the file's path.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FileError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    System {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb phrase ("open", "write").
        action: &'static str,
        /// Its answer.
        source: std::io::Error,
    },
    /// The path leads to something that is not read or overwritten: a folder, a pipe, a device, a write-protected file, one that is
    /// too large.
    #[error("{}: {reason}", path.display())]
    Refused {
        /// The path.
        path: PathBuf,
        /// What was tried, "read" or "write".
        action: &'static str,
        /// Why.
        reason: String,
    },
}

impl FileError {
    /// Whether a file was to be written, and not read.
    pub fn is_writing(&self) -> bool {
        matches!(self, Self::System { action: WRITE, .. } | Self::Refused { action: WRITE, .. })
    }
}

/// The verb of what failed.
pub(crate) const READ: &str = "read";
pub(crate) const WRITE: &str = "write";
