//! How far one pose is from another, and one surface from another.
//!
//! Metrics compare position arrays; they know no method, so no method can favour itself.

mod distance;
mod edge_length;
mod face_tree;
mod flips;
mod volume;

pub use distance::closest_on_triangle;
pub use distance::{SurfaceDistance, distances_to_surface, rms_distance, surface_distance};
pub use edge_length::{EdgeErrors, edge_errors, edge_errors_at_vertices, largest_free_stretch};
pub use face_tree::FaceTree;
pub use flips::flipped_faces;
pub use volume::{signed_volume, volume_change};
