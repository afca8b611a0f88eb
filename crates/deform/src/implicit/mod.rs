//! Implicit Laplacian editing.
//!
//! - Fu, Au, Tai. *Effective Derivation of Similarity Transformations for Implicit Laplacian Mesh Editing.* Technical report, HKUST,
//!   2006 (Computer Graphics Forum 26(1), 2007). Sections, equations and figures named in this module are its.
//! - Meyer, Desbrun, Schröder, Barr. *Discrete Differential-Geometry Operators for Triangulated 2-Manifolds.* VisMath 2002: the cotangent
//!   Laplacian and its Voronoi areas.
//!
//! Two linear systems, both factored when an edit is prepared:
//!
//! 1. Each vertex gets the affine map that takes its rest ring nearest to its deformed ring, its *deformation gradient* `M_i`. That is linear
//!    in the unknown positions (Eq. 4), so positions that keep transformed Laplacian coordinates (Eq. 5) under gradients that vary
//!    little (Eq. 6) solve a linear system (Eq. 7).
//! 2. Of each gradient only the rotation and, by choice, the scale is kept, and the surface with Laplacian coordinates so transformed
//!    (Eq. 9, 10) takes away the shear (section 4).
//!
//! # Limits
//! - Gradients are found by least squares, which takes the shorter way round: a handle turned by `pi` or more against another is reached by a
//!   rotation below `pi`, and near `pi` the gradients between them pass close to 0, where rotations are undetermined. Several
//!   handles with less than `pi` between successive ones go farther (section 6).
//! - A region held by a few vertices is oversensitive to where these are; refine the mesh round them, or hold more (section 6).

mod deformer;
mod energy;
mod matrix;
mod options;
mod plan;
mod rows;
mod shear;
mod stencils;

pub use deformer::{Implicit, ImplicitReport};
pub use options::{FeatureSize, ImplicitConstraints, ImplicitOptions, ImplicitStage, MAX_RINGS};
