//! Linear rotation-invariant coordinates.

mod frames;

pub use frames::{DiscreteFrames, Tangent};
