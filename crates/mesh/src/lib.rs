//! Triangle meshes and everything that is pure geometry on them.
//!
//! Connectivity is made once and shared; positions are the only state. A [`TriMesh`] holds positions and an
//! `Arc` of its [`Topology`]; an edit, an undo or a frame for a viewer is a position array for known connectivity.
//!
//! This crate knows no matrix, no solver, no file format and no cage.

mod areas;
mod bounds;
mod error;
mod frames;
pub mod metrics;
mod normals;
mod progress;
pub mod ranges;
mod rotation;
pub mod select;
pub mod shapes;
mod similarity;
pub mod threads;
mod topology;
mod tri_mesh;
mod vertex_set;
mod weights;
mod weld;

pub use areas::mixed_voronoi_areas;
pub use bounds::Bounds;
pub use error::MeshError;
pub use frames::{FrameFit, Frames};
pub use normals::{NormalBuffer, face_area_vector, face_normals, vertex_normals};
pub use progress::{Cancellable, Progress, Silent};
pub use rotation::{LANES, RotationBatch, best_rotation, best_scale, outer};
pub use similarity::{Motion, Similarity};
pub use topology::Topology;
pub use tri_mesh::TriMesh;
pub use vertex_set::VertexSet;
pub use weights::{EdgeWeights, MIN_RELATIVE_COTANGENT};
pub use weld::{CleanReport, Cleaned, clean_soup};
