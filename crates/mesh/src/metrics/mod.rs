//! How far one pose is from another, and one surface from another.
//!
//! Metrics compare position arrays; they know no method, so no method can favour itself.

mod distance;
mod edge_length;
mod face_tree;

pub use distance::closest_on_triangle;
pub use distance::{SurfaceDistance, distances_to_surface, surface_distance};
pub use edge_length::{EdgeErrors, edge_errors, largest_free_stretch};
pub use face_tree::FaceTree;
