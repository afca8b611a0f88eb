use std::ops::ControlFlow;

use glam::DVec3;

use super::EdgeWalk;
use crate::{Topology, VertexSet};

/// Vertices at most `radius` from `source`, measured along edges ([`EdgeWalk`]). Costs an array over all vertices besides.
///
/// # Panics
/// If `source` is not a vertex or `positions` is too short.
pub fn geodesic_ball(topology: &Topology, positions: &[DVec3], source: u32, radius: f64) -> VertexSet {
    let mut reached = Vec::new();
    let mut walk = EdgeWalk::new(topology.vertex_count());
    walk.visit(
        topology,
        positions,
        [source],
        radius,
        |_| true,
        |v, _, _| {
            reached.push(v);
            ControlFlow::Continue(())
        },
    );
    reached.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::nearest_vertex;
    use crate::shapes;

    /// Two sheets that nearly touch are far apart along the surface.
    #[test]
    fn a_geodesic_ball_does_not_jump_to_another_component() {
        let one = shapes::icosphere(3);
        let n = one.vertex_count() as u32;
        let mut positions = one.positions.clone();
        positions.extend(one.positions.iter().map(|p| *p + DVec3::new(2.001, 0.0, 0.0)));
        let mut triangles = one.triangles().to_vec();
        triangles.extend(one.triangles().iter().map(|t| t.map(|v| v + n)));
        let topology = Topology::new(positions.len(), triangles).expect("two spheres");
        let source = nearest_vertex(&positions[..n as usize], DVec3::X).expect("not empty");
        let ball = geodesic_ball(&topology, &positions, source, 1.0);
        assert!(ball.iter().all(|v| v < n));
        // A cap of angle 1 holds (1 - cos 1) / 2 = 23 % of the sphere; edge paths shrink it a little.
        let share = ball.len() as f64 / f64::from(n);
        assert!(share > 0.16 && share < 0.24, "{share}");
    }
}
