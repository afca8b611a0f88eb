use pliant_cage::CageError;
use pliant_deform::{DeformError, HandleFault};
use pliant_io::picture::PictureError;
use pliant_mesh::MeshError;
use thiserror::Error;

use crate::SceneError;
use crate::report::{Failure, FailureKind};

/// Why an edit or a sweep could not be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StudyError {
    /// The scene is wrong or does not fit the shape.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The cage or the binding could not be made.
    #[error(transparent)]
    Cage(#[from] CageError),
    /// The solver refused or failed.
    #[error(transparent)]
    Deform(#[from] DeformError),
    /// The solver refused a handle of the scene.
    #[error("handle '{name}' {fault}")]
    Handle {
        /// Its name in the scene.
        name: String,
        /// What is wrong with it.
        fault: HandleFault,
    },
    /// Positions are not those of a shape's vertices.
    #[error("this pose cannot be drawn: {0}")]
    Pose(MeshError),
    /// A picture cannot be drawn as asked.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A cage is too small for the scene.
    #[error("a cage of {vertices} vertices has no vertex left for handle '{handle}'; ask for a larger cage")]
    NoRoom {
        /// The handle's name.
        handle: String,
        /// Vertices of the cage.
        vertices: usize,
    },
    /// Pliant is at fault.
    #[error("{reason}")]
    Internal {
        /// What is known of it.
        reason: String,
    },
    /// A cage size could not be read.
    #[error(
        "`{found}` is not a cage size: use a number of vertices (2000; 4 or more), a share (5%), a distance (error:0.002), \
         one of these after decimated: or equal-time:, or none"
    )]
    BadSize {
        /// What was given.
        found: String,
    },
    /// A range of cage sizes could not be read.
    #[error(
        "`{found}` is not a range of cage sizes: use two numbers of vertices or two shares, the smaller one first \
         (100..5000, 1%..50%), and how many, 2 to {most}, after a colon if you like (1%..50%:8)"
    )]
    BadRange {
        /// What was given.
        found: String,
        /// The largest number allowed.
        most: usize,
    },
    /// What is looked for among cage sizes could not be read.
    #[error(
        "`{found}` is not what cage sizes are searched for: use error:5%, no-cage:10% (above the error without a cage), or bend"
    )]
    BadKnee {
        /// What was given.
        found: String,
    },
    /// What a solve starts from could not be read.
    #[error("`{found}` is not a start: use levels or pose")]
    BadStart {
        /// What was given.
        found: String,
    },
    /// A number of iterations could not be read.
    #[error("`{found}` is not a number of iterations: use 0 to {most}, or converged")]
    BadIterations {
        /// What was given.
        found: String,
        /// The largest number allowed.
        most: u32,
    },
}

impl StudyError {
    /// Whose fault it is, and in what words.
    pub fn failure(&self) -> Failure {
        let kind = match self {
            Self::Internal { .. } => FailureKind::Internal,
            Self::Deform(error) if error.is_numeric() => FailureKind::Numeric,
            _ => FailureKind::Input,
        };
        Failure { kind, reason: self.to_string() }
    }

    /// A solver's error in the scene's words.
    pub(crate) fn deform<'n>(error: DeformError, mut names: impl Iterator<Item = &'n str>) -> Self {
        match error {
            DeformError::Handle { handle, fault } => match names.nth(handle) {
                Some(name) => Self::Handle { name: name.to_owned(), fault },
                None => Self::Deform(DeformError::Handle { handle, fault }),
            },
            other => Self::Deform(other),
        }
    }
}
