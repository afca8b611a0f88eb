use glam::DVec3;

use crate::{Bounds, VertexSet};

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
}
