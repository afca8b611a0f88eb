use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{FaceTree, largest};
use crate::TriMesh;

/// One-sided distance from points to a surface, in units of the model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SurfaceDistance {
    /// Root mean square.
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

/// Distance of each point to the nearest face of `surface`; infinite if it has no face. Parallel, `O(log faces)` a point.
pub fn distances_to_surface(points: &[DVec3], surface: &TriMesh) -> Vec<f64> {
    let tree = FaceTree::new(&surface.positions, surface.triangles());
    points.par_iter().map(|p| tree.nearest(*p).map_or(f64::INFINITY, |(_, distance)| distance)).collect()
}

/// Root mean square and largest distance of the points to `surface`; 0 without points, NaN if one of them is not a number.
pub fn surface_distance(points: &[DVec3], surface: &TriMesh) -> SurfaceDistance {
    let distances = distances_to_surface(points, surface);
    let square: f64 = distances.iter().map(|d| d * d).sum();
    SurfaceDistance { rms: (square / distances.len().max(1) as f64).sqrt(), max: largest(distances) }
}

/// Root mean square of the distances between the positions of the same vertex in two poses, in units of the model; 0 without vertices, NaN or
/// infinite if a position is.
///
/// # Panics
/// If the poses differ in their numbers of vertices.
pub fn rms_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len(), "poses of one mesh");
    let square: f64 = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum();
    (square / a.len().max(1) as f64).sqrt()
}

/// The point of a triangle nearest to `p` (Ericson, Real-Time Collision Detection, 5.1.5: by Voronoi region of the plane).
pub fn closest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    // An edge without length, whose quotient would be 0 / 0, is left to the others.
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    let (along, back) = (d4 - d3, d5 - d6);
    if va <= 0.0 && along >= 0.0 && back >= 0.0 && along + back > 0.0 {
        return b + (c - b) * (along / (along + back));
    }
    // Over the inside: straight down. Weights of the corners would be as far off as the triangle is narrow.
    let normal = ab.cross(ac);
    let square = normal.length_squared();
    if square > 0.0 { p - normal * (normal.dot(ap) / square) } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    /// Every point of a triangle is at least as far as the one found, to rounding.
    #[test]
    fn no_sampled_point_of_the_triangle_is_nearer() {
        let triangle = [DVec3::ZERO, DVec3::new(2.0, 0.1, 0.0), DVec3::new(0.3, 1.0, 0.4)];
        let steps = 40;
        for i in 0..400 {
            let t = f64::from(i);
            let p = DVec3::new((0.37 * t).sin() * 3.0, (0.91 * t).cos() * 3.0, (1.7 * t).sin() * 2.0);
            let found = p.distance(closest_on_triangle(p, triangle));
            for u in 0..=steps {
                for v in 0..=steps - u {
                    let (u, v) = (f64::from(u) / f64::from(steps), f64::from(v) / f64::from(steps));
                    let q = triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v;
                    assert!(p.distance(q) >= found - 1e-12);
                }
            }
        }
    }

    /// Two vertices moved by 3 and by 4: the mean of 9 and 16 is 12.5.
    #[test]
    fn distance_of_poses_is_the_root_mean_square_of_displacements() {
        let rest = [DVec3::ONE, DVec3::ZERO];
        let pose = [DVec3::ONE + 3.0 * DVec3::X, 4.0 * DVec3::Z];
        assert!((rms_distance(&rest, &pose) - 12.5_f64.sqrt()).abs() < 1e-15);
        assert_eq!((rms_distance(&rest, &rest), rms_distance(&[], &[])), (0.0, 0.0));
        assert!(rms_distance(&rest, &[DVec3::ONE, DVec3::NAN]).is_nan());
        assert_eq!(rms_distance(&rest, &[DVec3::ONE, DVec3::INFINITY]), f64::INFINITY);
    }

    #[test]
    fn points_of_a_scaled_sphere_are_a_known_distance_away() {
        let sphere = shapes::icosphere(4);
        let points: Vec<DVec3> = shapes::icosphere(3).positions.iter().map(|p| 1.5 * *p).collect();
        let distance = surface_distance(&points, &sphere);
        // A chord of the sphere of 4 subdivisions sags by less than 0.002.
        assert!(distance.rms >= 0.5 && distance.max < 0.502, "{distance:?}");
        let with_none = [DVec3::NAN, points[0]];
        assert!(surface_distance(&with_none, &sphere).max.is_nan() && surface_distance(&[], &sphere).max == 0.0);
    }
}
