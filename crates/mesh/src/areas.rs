use crate::{TriMesh, face_area_vector};

/// The area that belongs to each vertex, in square units of the model: the *mixed Voronoi areas* of Meyer, Desbrun, Schröder and Barr,
/// *Discrete Differential-Geometry Operators for Triangulated 2-Manifolds* (2003), section 3.3, figure 4.
///
/// A face that is not obtuse gives each corner the part that is nearest to it; an obtuse one gives half its area to the obtuse corner and
/// a quarter to each of the others. The areas sum up to that of the surface. A vertex without faces, or with faces of no area alone, has 0.
pub fn mixed_voronoi_areas(mesh: &TriMesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.vertex_count()];
    for (face, triangle) in mesh.triangles().iter().enumerate() {
        let p = mesh.corners(face);
        let area = face_area_vector(p).length();
        if area == 0.0 {
            continue;
        }
        // Scalar product of the two sides at each corner: the cotangent times twice the area.
        let dots = [0, 1, 2].map(|k| (p[(k + 1) % 3] - p[k]).dot(p[(k + 2) % 3] - p[k]));
        let obtuse = dots.iter().position(|dot| *dot < 0.0);
        for (k, &v) in triangle.iter().enumerate() {
            areas[v as usize] += match obtuse {
                Some(corner) => area * if corner == k { 0.5 } else { 0.25 },
                None => {
                    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                    // (|side to i|^2 cot j + |side to j|^2 cot i) / 8.
                    (p[i].distance_squared(p[k]) * dots[j] + p[j].distance_squared(p[k]) * dots[i]) / (16.0 * area)
                }
            };
        }
    }
    areas
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::shapes;

    fn triangle(apex: DVec3) -> Vec<f64> {
        let mesh = TriMesh::new(vec![DVec3::ZERO, DVec3::X, apex], vec![[0, 1, 2]]).expect("valid");
        mixed_voronoi_areas(&mesh)
    }

    #[test]
    fn the_areas_sum_up_to_that_of_the_surface() {
        for mesh in [
            shapes::icosphere(3),
            shapes::torus(1.0, 0.3, 30, 9).expect("valid radii"),
            shapes::bumpy_plane(12, 7, 3.0, 1.0, 0.4, 2).expect("valid size"),
            shapes::cactus(800).expect("in range"),
        ] {
            for scale in [1e-3, 1.0, 1e3] {
                let positions = mesh.positions.iter().map(|p| *p * scale).collect();
                let mesh = mesh.with_positions(positions).expect("finite");
                let areas = mixed_voronoi_areas(&mesh);
                let surface: f64 = (0..mesh.face_count()).map(|f| face_area_vector(mesh.corners(f)).length()).sum();
                assert!((areas.iter().sum::<f64>() / surface - 1.0).abs() < 1e-12);
                assert!(areas.iter().all(|a| *a > 0.0));
            }
        }
    }

    /// A third each in an equilateral triangle; in a right-angled one half at the right angle, as in an obtuse one, so that
    /// the areas do not jump where a triangle becomes obtuse.
    #[test]
    fn triangles_have_the_areas_of_the_paper() {
        let equilateral = triangle(DVec3::new(0.5, 0.75_f64.sqrt(), 0.0));
        assert!(equilateral.iter().all(|a| (a - 0.75_f64.sqrt() / 6.0).abs() < 1e-15));
        let share = [0.25, 0.125, 0.125];
        for tilt in [-1e-9, 0.0, 1e-9] {
            let right = triangle(DVec3::new(tilt, 1.0, 0.0));
            assert!(right.iter().zip(share).all(|(a, s)| (a - s).abs() < 1e-8), "{right:?}");
        }
        assert_eq!(triangle(DVec3::new(-3.0, 1.0, 0.0)), share);
        assert_eq!(triangle(DVec3::new(2.0, 0.0, 0.0)), [0.0; 3]);
    }

    /// The vertex of a square grid owns a square.
    #[test]
    fn cells_of_a_grid_are_squares() {
        let grid = shapes::plane_grid(4, 4, 1.0, 1.0).expect("valid size");
        let border = grid.topology().boundary_vertices();
        for (area, _) in mixed_voronoi_areas(&grid).iter().zip(border).filter(|(_, border)| !border) {
            assert!((area - 1.0 / 16.0).abs() < 1e-15);
        }
    }
}
