//! How far one pose is from another, and one surface from another.
//!
//! Metrics compare position arrays; they know no method, so no method can favour itself. Positions that are not finite make lengths, areas,
//! volumes and distances NaN or infinite, never a number that looks like a result; what counts faces counts those too.

mod area;
mod distance;
mod edge_length;
mod face_tree;
mod flips;
mod hausdorff;
mod intersections;
#[cfg(test)]
mod test_meshes;
mod volume;

use glam::DVec3;

use crate::Topology;

pub use area::area_change;
pub use distance::closest_on_triangle;
pub use distance::{SurfaceDistance, distances_to_surface, rms_distance, surface_distance};
pub use edge_length::{EdgeErrors, edge_errors, edge_errors_at_vertices, largest_free_stretch};
pub use face_tree::FaceTree;
pub use flips::flipped_faces;
pub use hausdorff::{HausdorffDistance, HausdorffOptions, OneSidedDistance, hausdorff};
pub use intersections::{IntersectionOptions, SelfIntersections, self_intersections};
pub use volume::{signed_volume, volume_change};

/// The largest of lengths; 0 without any, NaN if one is.
fn largest(lengths: impl IntoIterator<Item = f64>) -> f64 {
    lengths.into_iter().fold(0.0, |most, length| if length > most || length.is_nan() { length } else { most })
}

/// A power of two that brings the largest finite coordinate of a face to between 1 and 2; scaling by it rounds nothing.
fn unit_scale(topology: &Topology, positions: &[DVec3]) -> f64 {
    let corners = topology.triangles().iter().flatten().map(|v| positions[*v as usize]);
    let size = corners.filter(|p| p.is_finite()).map(|p| p.abs().max_element()).fold(0.0, f64::max);
    // Exponents are stored plus 1023; those of numbers whose inverse is a number too are from 1 to 2045.
    let exponent = (size.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}
