use pliant_files::FileError;
use thiserror::Error;

use crate::{ModelError, SceneError, StudyError};

/// Why a sweep over many models could not be planned, run or put together.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SweepError {
    /// A plan file is not understood.
    #[error("{file}: {message}")]
    Plan {
        /// The file.
        file: String,
        /// What is wrong, with its place.
        message: String,
    },
    /// A value cannot be used.
    #[error("{what}: `{found}`: {message}")]
    Value {
        /// Its name in a plan.
        what: &'static str,
        /// What was given.
        found: String,
        /// Why not.
        message: String,
    },
    /// There is nothing to do.
    #[error("no model is named: a sweep needs at least one file or generated shape, such as creature:20000")]
    NoModels,
    /// A scene cannot be used.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A model that the plan must look at first cannot be read.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A size, a number of iterations or a start is not understood.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// A file cannot be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// No job, or more than one, is meant.
    #[error("`{asked}` names {found} of the {jobs} jobs: use an id or the beginning of one, or a number from 0 to {}", jobs.saturating_sub(1))]
    NoSuchJob {
        /// What was given.
        asked: String,
        /// How many it fits.
        found: usize,
        /// How many there are.
        jobs: usize,
    },
    /// An array index is asked for outside of an array.
    #[error("{variable} is not set to a number: `slurm` works within a Slurm job array only")]
    NoArray {
        /// The environment's variable.
        variable: &'static str,
    },
    /// What is in a folder is no list of jobs, or no job.
    #[error("{file}: {message}")]
    Folder {
        /// The file.
        file: String,
        /// What is wrong.
        message: String,
    },
    /// Folders hold parts of different sweeps.
    #[error("{a} and {b} are of different sweeps: their lists of jobs differ")]
    OtherSweep {
        /// The first folder.
        a: String,
        /// The other.
        b: String,
    },
    /// Jobs are missing.
    #[error("{missing} of {jobs} jobs are not finished, the first is {first}: run them, or ask for a partial report")]
    Unfinished {
        /// How many.
        missing: usize,
        /// Of how many.
        jobs: usize,
        /// The first one's id and what it is.
        first: String,
    },
}

impl SweepError {
    pub(crate) fn value(what: &'static str, found: &str, message: &dyn std::fmt::Display) -> Self {
        Self::Value { what, found: found.to_owned(), message: message.to_string() }
    }
}
