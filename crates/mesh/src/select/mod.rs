//! Choosing vertices by geometry and connectivity, as the tools of an artist do.
//!
//! | how | where |
//! |---|---|
//! | in space | [`in_box`], [`in_sphere`], [`in_half_space`], [`nearest_vertex`] |
//! | along the surface | [`geodesic_ball`], [`EdgeWalk`], [`water_fill`]; where a plane cuts it, [`plane_curves`] |
//! | by rings and pieces of a set | [`grow`], [`shrink`], [`pieces`], [`piece_at`], [`border`], [`border_loops`] |
//! | on the screen | [`ScreenCamera`], [`lasso`], [`screen_box`], [`RayCaster`] |
//!
//! Sets combine by [`VertexSet::union`] and its siblings. No result depends on the number of threads.

mod camera;
mod edge_walk;
mod geodesic;
mod pieces;
mod plane;
mod ray;
mod rings;
mod screen;
mod space;
mod water_fill;

pub use camera::ScreenCamera;
pub use edge_walk::EdgeWalk;
pub use geodesic::geodesic_ball;
pub use pieces::{border, border_loops, piece_at, pieces};
pub use plane::{PlaneCurve, plane_curves};
pub use ray::{Hit, Ray, RayCaster};
pub use rings::{grow, shrink};
pub use screen::{Seen, lasso, screen_box};
pub use space::{in_box, in_half_space, in_sphere, nearest_vertex};
pub use water_fill::{Closure, FillLimit, WaterFill, water_fill};

use glam::DVec3;

use crate::{MeshError, Topology, VertexSet};

/// Refuses a vertex that the mesh does not have.
fn check_vertex(topology: &Topology, what: &'static str, vertex: u32) -> Result<(), MeshError> {
    if (vertex as usize) < topology.vertex_count() {
        return Ok(());
    }
    let expected = format!("one of {} vertices (numbered from 0)", topology.vertex_count());
    Err(MeshError::BadParameter { what, expected, found: vertex.to_string() })
}

/// Refuses positions that do not fit the connectivity.
fn check_positions(topology: &Topology, positions: &[DVec3]) -> Result<(), MeshError> {
    if positions.len() == topology.vertex_count() {
        return Ok(());
    }
    Err(MeshError::PositionCount { expected: topology.vertex_count(), found: positions.len() })
}

/// Whether each vertex is a member; refuses a set with vertices that the mesh does not have.
fn mask(topology: &Topology, set: &VertexSet) -> Result<Vec<bool>, MeshError> {
    if let Some(&last) = set.as_slice().last() {
        check_vertex(topology, "a member of a vertex set", last)?;
    }
    let mut mask = vec![false; topology.vertex_count()];
    for v in set.iter() {
        mask[v as usize] = true;
    }
    Ok(mask)
}
