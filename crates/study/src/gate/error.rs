use pliant_files::FileError;
use thiserror::Error;

use crate::{ModelError, ReportError};

/// Why nothing could be compared.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum GateError {
    /// A tolerance could not be read.
    #[error("`{found}` is not a tolerance: use a share (1%), a share and more in the figure's unit (1%+0.001), or off")]
    BadTolerance {
        /// What was given.
        found: String,
    },
    /// A tolerance is for a figure that rows do not have.
    #[error("`{found}` is no figure: use errors, distances, counts, times, memory, or one of {known}")]
    NoSuchFigure {
        /// What was given.
        found: String,
        /// The figures there are.
        known: String,
    },
    /// What is in a file is not understood.
    #[error("{file}: {message}")]
    File {
        /// The file.
        file: String,
        /// What is wrong, with its place.
        message: String,
    },
    /// A report is not understood.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A file cannot be read.
    #[error(transparent)]
    Read(#[from] FileError),
    /// The model of a row is not found.
    #[error("the baseline's model {model} is not found in {looked}: name the file, or its folder with --models")]
    NoModel {
        /// What the report calls it.
        model: String,
        /// Folders that were looked through.
        looked: String,
    },
    /// The model of a row cannot be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A row does not say what was asked.
    #[error("{row}: cannot be made again: {reason}")]
    Row {
        /// The row.
        row: String,
        /// Why not.
        reason: String,
    },
}
