//! Control meshes: made by simplification, bound by mean value coordinates, propagated to the shape.
//!
//! The shape is the full-resolution mesh; the cage, or control mesh, is what a solver moves. [`simplify`] makes the
//! cage, [`Binding`] ties the shape to it once at rest, and a [`Propagator`] carries every later pose of the cage over.
//!
//! [`SavedCage`] keeps a cage and its binding as a file.
//!
//! This crate knows no solver, no mesh format and no handle.

mod binding;
mod error;
mod face_terms;
#[cfg(test)]
mod families;
mod far_field;
mod file;
mod lanes;
mod mean_value;
mod packed;
mod propagate;
mod prune;
mod report;
mod rows;
mod simplify;
mod sparse;
mod support;

pub use binding::{BindOptions, Binding};
pub use error::CageError;
pub use file::{BindingFault, BindingFileError, Fingerprint, RowFault, SavedCage};
pub use mean_value::MeanValue;
pub use propagate::{Propagation, Propagator};
pub use prune::Prune;
pub use report::{BindReport, UNSAFE_MAGNITUDE};
pub use simplify::{CageSize, Simplified, SimplifyOptions, SimplifyReport, simplify};
pub use support::Support;
