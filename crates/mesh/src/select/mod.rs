//! Choosing vertices by geometry: boxes, balls and half-spaces in space, and balls along the surface.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use crate::{Bounds, Topology, VertexSet};

/// Vertices inside or on an axis-aligned box.
pub fn in_box(positions: &[DVec3], bounds: &Bounds) -> VertexSet {
    VertexSet::where_true(positions.len(), |v| {
        let p = positions[v as usize];
        p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()
    })
}

/// Vertices at most `radius` from `centre`.
pub fn in_sphere(positions: &[DVec3], centre: DVec3, radius: f64) -> VertexSet {
    VertexSet::where_true(positions.len(), |v| positions[v as usize].distance(centre) <= radius)
}

/// Vertices on the side of the plane through `point` that `normal` points to, the plane included.
pub fn in_half_space(positions: &[DVec3], point: DVec3, normal: DVec3) -> VertexSet {
    VertexSet::where_true(positions.len(), |v| (positions[v as usize] - point).dot(normal) >= 0.0)
}

/// The vertex nearest to a point, the lowest number on a tie; `None` without vertices. Linear time.
pub fn nearest_vertex(positions: &[DVec3], point: DVec3) -> Option<u32> {
    let mut best: Option<(f64, u32)> = None;
    for (v, p) in positions.iter().enumerate() {
        let d = p.distance_squared(point);
        if best.is_none_or(|(least, _)| d < least) {
            best = Some((d, v as u32));
        }
    }
    best.map(|(_, v)| v)
}

/// Vertices at most `radius` from `source`, measured along edges (Dijkstra).
///
/// Paths along edges are longer than the true geodesic, by about a tenth on an even mesh. Costs `O(k log k)` for the `k`
/// vertices reached.
///
/// # Panics
/// If `source` is not a vertex or `positions` is too short.
pub fn geodesic_ball(topology: &Topology, positions: &[DVec3], source: u32, radius: f64) -> VertexSet {
    // Non-negative floats order like their bits, so that distances can be heap keys.
    let key = |d: f64| d.to_bits();
    let mut distance = vec![f64::INFINITY; topology.vertex_count()];
    let mut heap = BinaryHeap::from([Reverse((key(0.0), source))]);
    distance[source as usize] = 0.0;
    let mut reached = Vec::new();
    while let Some(Reverse((bits, v))) = heap.pop() {
        let here = f64::from_bits(bits);
        if here > distance[v as usize] {
            continue;
        }
        reached.push(v);
        for &w in topology.neighbours(v as usize) {
            let there = here + positions[v as usize].distance(positions[w as usize]);
            if there <= radius && there < distance[w as usize] {
                distance[w as usize] = there;
                heap.push(Reverse((key(there), w)));
            }
        }
    }
    reached.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn space_selections_agree_with_their_definitions_on_a_grid() {
        let grid = shapes::plane_grid(10, 10, 1.0, 1.0).expect("valid size");
        let quarter = Bounds { min: DVec3::new(-0.5, -0.5, -1.0), max: DVec3::new(0.0, 0.0, 1.0) };
        assert_eq!(in_box(&grid.positions, &quarter).len(), 36);
        assert_eq!(in_half_space(&grid.positions, DVec3::ZERO, DVec3::X).len(), 6 * 11);
        assert_eq!(in_sphere(&grid.positions, DVec3::ZERO, 0.1001).len(), 5);
        assert_eq!(nearest_vertex(&grid.positions, DVec3::new(-9.0, -9.0, 0.0)), Some(0));
    }

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
