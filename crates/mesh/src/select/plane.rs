use glam::DVec3;

use super::check_positions;
use crate::{Bounds, MeshError, Topology};

/// A curve in which a plane meets a surface.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneCurve {
    /// Corners of the curve in order, one for each edge that it crosses, less those that coincide with the one before.
    pub points: Vec<DVec3>,
    /// Whether the last point joins the first. An open curve ends at borders of the mesh, or where more than two faces meet.
    pub closed: bool,
    /// The crossed edges, in order along the curve.
    pub edges: Vec<u32>,
}

impl PlaneCurve {
    /// Length, in units of the model.
    pub fn length(&self) -> f64 {
        self.segments().map(|[a, b]| a.distance(b)).sum()
    }

    /// Area within a closed curve, in square units of the model; for an open one, as if its ends were joined.
    pub fn area(&self) -> f64 {
        // Taken round one of its points, so that a curve far from the origin loses no digits.
        let Some(&anchor) = self.points.first() else {
            return 0.0;
        };
        0.5 * self.segments().map(|[a, b]| (a - anchor).cross(b - anchor)).sum::<DVec3>().length()
    }

    /// Distance to the nearest point of the curve.
    pub fn distance(&self, point: DVec3) -> f64 {
        let single = self.points.first().map_or(f64::INFINITY, |p| p.distance(point));
        self.segments().map(|[a, b]| distance_to_segment(point, a, b)).fold(single, f64::min)
    }

    fn segments(&self) -> impl Iterator<Item = [DVec3; 2]> + '_ {
        let last = self.points.last().zip(self.points.first()).filter(|_| self.closed).map(|(a, b)| [*a, *b]);
        self.points.windows(2).map(|w| [w[0], w[1]]).chain(last)
    }
}

fn distance_to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let along = b - a;
    let t = (p - a).dot(along) / along.length_squared();
    p.distance(a + along * if t > 0.0 { t.min(1.0) } else { 0.0 })
}

/// The curves in which the plane through `point` across `normal` (of any length but 0) meets a surface, in the order of their
/// lowest edges.
///
/// A vertex on the plane counts as a little beyond it, so that curves never branch: where the plane only touches the surface from
/// behind there is no curve, and where it touches from the other side there is one of length 0. Costs a pass over vertices, edges
/// and the faces met.
///
/// # Errors
/// Another number of positions than of vertices, or a plane that is not finite or has no normal.
pub fn plane_curves(
    topology: &Topology,
    positions: &[DVec3],
    point: DVec3,
    normal: DVec3,
) -> Result<Vec<PlaneCurve>, MeshError> {
    check_positions(topology, positions)?;
    let unit = normal.try_normalize().filter(|_| point.is_finite()).ok_or_else(|| MeshError::BadParameter {
        what: "the plane",
        expected: "finite, with a normal that is not 0".into(),
        found: format!("the plane through {point} across {normal}"),
    })?;
    Ok(curves(topology, positions, &heights(positions, point, unit)))
}

/// Signed distance of each vertex to a plane, exactly 0 within what rounding makes of the coordinates.
pub(super) fn heights(positions: &[DVec3], point: DVec3, unit: DVec3) -> Vec<f64> {
    let bounds = Bounds::of(positions);
    let largest = bounds.min.abs().max(bounds.max.abs()).max(point.abs()).max_element();
    let noise = 16.0 * f64::EPSILON * largest;
    let height = |p: &DVec3| Some((*p - point).dot(unit)).filter(|h| h.abs() > noise).unwrap_or(0.0);
    positions.iter().map(height).collect()
}

/// The curves between vertices below the plane and the others.
pub(super) fn curves(topology: &Topology, positions: &[DVec3], heights: &[f64]) -> Vec<PlaneCurve> {
    let is_crossed = |e: u32| {
        let [a, b] = topology.edges()[e as usize];
        (heights[a as usize] < 0.0) != (heights[b as usize] < 0.0)
    };
    let crossed: Vec<u32> = (0..topology.edges().len() as u32).filter(|&e| is_crossed(e)).collect();
    let mut walk = Walk { topology, is_crossed: &is_crossed, used: vec![false; topology.triangles().len()] };
    let ends = |e: &&u32| topology.edge_faces(**e as usize).len() != 2;
    let mut found = Vec::new();
    // Open curves first, from their ends; what is left is closed.
    for &start in crossed.iter().filter(ends).chain(&crossed) {
        for &face in topology.edge_faces(start as usize) {
            found.extend(walk.from(start, face));
        }
    }
    found.sort_by_cached_key(|(edges, _)| edges.iter().min().copied());
    let on_edge = |e: &u32| crossing(topology.edges()[*e as usize], positions, heights);
    found
        .into_iter()
        .map(|(edges, closed)| {
            let mut points: Vec<DVec3> = edges.iter().map(on_edge).collect();
            points.dedup();
            while closed && points.len() > 1 && points.first() == points.last() {
                points.pop();
            }
            PlaneCurve { points, closed, edges }
        })
        .collect()
}

/// Where the plane meets an edge with one end below it.
fn crossing([a, b]: [u32; 2], positions: &[DVec3], heights: &[f64]) -> DVec3 {
    let (near, far) = if heights[a as usize] < 0.0 { (a as usize, b as usize) } else { (b as usize, a as usize) };
    if heights[far] == 0.0 {
        return positions[far];
    }
    positions[near].lerp(positions[far], heights[near] / (heights[near] - heights[far]))
}

/// Steps from crossed edge to crossed edge: a face has none or two of them.
struct Walk<'a, F> {
    topology: &'a Topology,
    is_crossed: F,
    /// Faces walked through.
    used: Vec<bool>,
}

impl<F: Fn(u32) -> bool> Walk<'_, F> {
    /// The edges met from `start` through `face` on, and whether the way came back; `None` if it was walked before.
    fn from(&mut self, start: u32, face: u32) -> Option<(Vec<u32>, bool)> {
        let (mut edges, mut at, mut through) = (vec![start], start, Some(face));
        while let Some(face) = through.filter(|&f| !self.used[f as usize]) {
            self.used[face as usize] = true;
            at = self.topology.face_edges(face as usize).into_iter().find(|&e| e != at && (self.is_crossed)(e))?;
            edges.push(at);
            through = match *self.topology.edge_faces(at as usize) {
                [f, g] => Some(if f == face { g } else { f }),
                _ => None,
            };
        }
        let closed = edges.len() > 1 && at == start;
        if closed {
            edges.pop();
        }
        (edges.len() > 1).then_some((edges, closed))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::{TriMesh, shapes};

    fn cut(mesh: &TriMesh, point: DVec3, normal: DVec3) -> Vec<PlaneCurve> {
        plane_curves(mesh.topology(), &mesh.positions, point, normal).expect("a plane")
    }

    /// A sphere of radius 1 is cut in a circle of radius `sqrt(1 - h^2)`. Faces of an icosphere of level 5 have edges of at
    /// most 0.04, so they lie within 0.04^2 / 6 of the sphere, which changes areas by less than a thousandth.
    #[test]
    fn a_sphere_is_cut_in_circles() {
        let sphere = shapes::icosphere(5);
        for (height, normal) in [(0.0, DVec3::Y), (0.3, DVec3::new(1.0, 2.0, -0.5)), (-0.8, DVec3::new(0.0, -3.0, 1.0))]
        {
            let curves = cut(&sphere, normal.normalize() * height, normal);
            assert!(curves.len() == 1 && curves[0].closed);
            let square = 1.0 - height * height;
            assert!((curves[0].area() / (PI * square) - 1.0).abs() < 2e-3, "{}", curves[0].area());
            assert!((curves[0].length() / (TAU * square.sqrt()) - 1.0).abs() < 2e-3);
            assert!(curves[0].points.iter().all(|p| (p.dot(normal.normalize()) - height).abs() < 1e-14));
            assert!((curves[0].distance(normal) - normal.distance(curves[0].points[0])).abs() < 2e-3);
        }
        assert!(cut(&sphere, DVec3::new(0.0, 1.1, 0.0), DVec3::Y).is_empty());
    }

    /// Through the axis of a torus there are two circles of the tube, across the axis one within the other.
    #[test]
    fn a_torus_is_cut_in_two_circles() {
        let torus = shapes::torus(1.0, 0.25, 400, 100).expect("valid radii");
        let tubes = cut(&torus, DVec3::ZERO, DVec3::new(0.3, 0.0, 1.0));
        let rings = cut(&torus, DVec3::new(0.0, 0.1, 0.0), DVec3::Y);
        let across = (0.25_f64.powi(2) - 0.01).sqrt();
        let mut expected = [(1.0 + across).powi(2), (1.0 - across).powi(2)].map(|s| PI * s);
        let mut found: Vec<f64> = rings.iter().map(PlaneCurve::area).collect();
        found.sort_by(f64::total_cmp);
        expected.sort_by(f64::total_cmp);
        assert!(tubes.len() == 2 && rings.len() == 2);
        for (a, b) in found
            .iter()
            .zip(expected)
            .chain(tubes.iter().map(PlaneCurve::area).collect::<Vec<_>>().iter().zip([PI / 16.0; 2]))
        {
            assert!((a / b - 1.0).abs() < 2e-3, "{a} is not {b}");
        }
    }

    /// Along a row of vertices and between rows a grid is cut in one straight open curve of its width; behind its last row,
    /// which counts as beyond the plane, there is one more, and before its first row none.
    #[test]
    fn a_grid_is_cut_in_open_lines() {
        let grid = shapes::plane_grid(10, 10, 2.0, 1.0).expect("valid size");
        for (y, count) in [(0.1, 1), (0.137, 1), (0.5, 1), (-0.5, 0)] {
            let curves = cut(&grid, DVec3::new(7.0, y, -3.0), DVec3::Y);
            assert_eq!(curves.len(), count);
            for curve in &curves {
                assert!(!curve.closed && (curve.length() - 2.0).abs() < 1e-12);
                assert!(curve.points.iter().all(|p| (p.y - y).abs() < 1e-12));
            }
        }
    }

    /// A cylinder cut aslant is an ellipse, cut along its axis a rectangle; the same far from the origin and at any scale.
    #[test]
    fn a_cylinder_is_cut_in_an_ellipse_or_a_rectangle() {
        let cylinder = shapes::cylinder(0.5, 4.0, 500, 40, 6).expect("valid size");
        for (scale, offset) in [(1.0, 0.0), (1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)] {
            let place = |p: DVec3| p * scale + DVec3::splat(offset);
            let moved =
                cylinder.with_positions(cylinder.positions.iter().map(|&p| place(p)).collect()).expect("finite");
            let aslant = cut(&moved, place(DVec3::new(0.0, 0.3, 0.0)), DVec3::new(1.0, 1.0, 0.0) * scale);
            let along = cut(&moved, place(DVec3::ZERO), DVec3::new(0.3, 0.0, 1.0));
            assert!(aslant.len() == 1 && along.len() == 1);
            let square = scale * scale;
            assert!((aslant[0].area() / (PI * 0.25 * 2.0_f64.sqrt() * square) - 1.0).abs() < 1e-3);
            assert!((along[0].area() / (4.0 * square) - 1.0).abs() < 1e-3);
        }
    }

    /// Three pages of a book: at the spine the curve ends, and each page has its own.
    #[test]
    fn curves_end_where_more_than_two_faces_meet() {
        let pages = vec![[1, 4, 0], [1, 4, 2], [1, 4, 3]];
        let corners = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let book = TriMesh::new(corners.map(DVec3::from_array).to_vec(), pages).expect("a soup");
        let curves = cut(&book, DVec3::new(0.0, 0.0, 0.25), DVec3::Z);
        assert_eq!(curves.len(), 3);
        assert!(curves.iter().all(|c| !c.closed && (c.length() - 0.75).abs() < 1e-15));
    }

    #[test]
    fn bad_planes_and_positions_are_refused() {
        let sphere = shapes::icosphere(1);
        for (point, normal) in [(DVec3::ZERO, DVec3::ZERO), (DVec3::NAN, DVec3::X), (DVec3::ZERO, DVec3::INFINITY)] {
            assert!(plane_curves(sphere.topology(), &sphere.positions, point, normal).is_err());
        }
        let short = plane_curves(sphere.topology(), &sphere.positions[1..], DVec3::ZERO, DVec3::X);
        assert_eq!(short, Err(MeshError::PositionCount { expected: 42, found: 41 }));
    }
}
