//! Where cages, bindings and solvers meet: they do not know each other, and an edit needs all of them.
//!
//! [`Editor`] is an editing session: handles on the shape, previews at display rate, releases, undo, documents.
//! [`Levels`] puts coarser meshes above a cage or a large shape, so that a solver starts near its goal. [`carry_region`] is the one place where handles
//! go from a mesh to a coarser one.

mod coarse_start;
mod editor;
mod error;
mod history;
mod levels;
mod snap;
mod transfer;

pub use coarse_start::CoarseStart;
pub use editor::{
    Autosave, Document, DocumentHandle, DocumentStep, Editor, EditorHandle, EditorOptions, Frame, Grip, Ranges,
    RefineReport, Refinement, SurfacePoint, Update,
};
pub use error::SessionError;
pub use levels::Levels;
pub use transfer::{Carried, NoRoom, carry_region};
