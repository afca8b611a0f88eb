//! Where cages, bindings and solvers meet: they do not know each other, and an edit needs all of them.
//!
//! [`Levels`] puts coarser cages above a cage, so that a solver starts near its goal. [`carry_region`] is the one place where handles
//! go from a mesh to a coarser one.

mod levels;
mod transfer;

pub use levels::{CoarseStart, Levels};
pub use transfer::{Carried, NoRoom, carry_region};
