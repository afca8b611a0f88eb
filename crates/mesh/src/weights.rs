use rayon::prelude::*;

use crate::{Topology, TriMesh};

/// Cotangent weights are kept above this share of their median.
///
/// On a simplified mesh obtuse triangles make some weights negative and the matrix indefinite; clamped weights keep
/// every energy bounded below.
pub const MIN_RELATIVE_COTANGENT: f64 = 1e-3;

/// One weight per undirected edge, in the order of [`Topology::edges`].
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeWeights {
    /// Positive and finite.
    pub values: Vec<f64>,
    /// How many weights were raised to the smallest one allowed.
    pub clamped: usize,
}

impl EdgeWeights {
    /// Weight 1 on every edge.
    pub fn uniform(topology: &Topology) -> Self {
        Self { values: vec![1.0; topology.edges().len()], clamped: 0 }
    }

    /// Cotangent weights, `(cot a + cot b) / 2` with the angles opposite to the edge (Pinkall and Polthier 1993).
    ///
    /// Weights below [`MIN_RELATIVE_COTANGENT`] times their median are raised to it and counted. A face
    /// without area adds nothing. Weights do not change when the mesh is scaled.
    pub fn cotangent(mesh: &TriMesh) -> Self {
        let topology = mesh.topology();
        let halves = |face: usize| {
            let p = mesh.corners(face);
            std::array::from_fn(|k| {
                let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                let cotangent = u.dot(v) / u.cross(v).length();
                if cotangent.is_finite() { 0.5 * cotangent } else { 0.0 }
            })
        };
        let halves: Vec<[f64; 3]> = (0..mesh.face_count()).into_par_iter().map(halves).collect();
        let mut values = topology.edge_sums(&halves);
        let smallest = MIN_RELATIVE_COTANGENT * typical(&values);
        let mut clamped = 0;
        for w in &mut values {
            if *w < smallest {
                *w = smallest;
                clamped += 1;
            }
        }
        Self { values, clamped }
    }
}

/// The median of the weights, which changes continuously with them (many are 0 but for rounding where right angles are
/// common) and which a few needles with cotangents up to 1e16 do not raise; the mean of the positive parts should the
/// median not be positive, and 1 should there be none.
fn typical(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    let middle = sorted.len() / 2;
    let median = if sorted.is_empty() { 0.0 } else { *sorted.select_nth_unstable_by(middle, f64::total_cmp).1 };
    let mean = values.iter().map(|w| w.max(0.0)).sum::<f64>() / values.len().max(1) as f64;
    [median, mean].into_iter().find(|t| *t > 0.0).unwrap_or(1.0)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::shapes;

    /// `sum w_ij (f_i - f_j)^2 / 2` over the edges: for cotangent weights the integral of `|grad f|^2 / 2`.
    fn energy(mesh: &TriMesh, weights: &EdgeWeights, f: impl Fn(DVec3) -> f64) -> f64 {
        let value = |v: u32| f(mesh.positions[v as usize]);
        let edges = mesh.topology().edges().iter().zip(&weights.values);
        edges.map(|(&[a, b], w)| 0.5 * w * (value(a) - value(b)).powi(2)).sum()
    }

    /// A sheared grid of equilateral triangles.
    fn equilateral() -> TriMesh {
        let (n, height) = (6, 0.75_f64.sqrt());
        let at = |i: u32, j: u32| j * (n + 1) + i;
        let point = |i: u32, j: u32| DVec3::new(f64::from(i) + 0.5 * f64::from(j), height * f64::from(j), 0.0);
        let positions = (0..=n).flat_map(|j| (0..=n).map(move |i| point(i, j))).collect();
        let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
        let triangles = cells.flat_map(|(i, j)| {
            [[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]]
        });
        TriMesh::new(positions, triangles.collect()).expect("a grid")
    }

    #[test]
    fn uniform_weights_are_one() {
        let sphere = shapes::icosphere(1);
        let weights = EdgeWeights::uniform(sphere.topology());
        assert_eq!(weights, EdgeWeights { values: vec![1.0; 120], clamped: 0 });
    }

    /// Both angles are 60 degrees: `cot 60 = 1 / sqrt(3)`, and half of it at the border.
    #[test]
    fn equilateral_triangles_have_weights_in_closed_form() {
        let mesh = equilateral();
        let weights = EdgeWeights::cotangent(&mesh);
        assert_eq!(weights.clamped, 0);
        for (e, w) in weights.values.iter().enumerate() {
            let faces = mesh.topology().edge_faces(e).len() as f64;
            assert!((w - 0.5 * faces / 3.0_f64.sqrt()).abs() < 1e-14);
        }
    }

    /// Linear finite elements represent linear functions, so their energy is exact: `|gradient|^2 area / 2`.
    #[test]
    fn energies_of_constant_and_linear_functions_on_a_plane_are_exact() {
        // Uneven but without obtuse angles beyond a right one, so that nothing is clamped but the diagonals.
        let mut mesh = equilateral();
        for p in &mut mesh.positions {
            *p += 0.05 * DVec3::new((2.0 * p.x + p.y).sin(), (p.x - 3.0 * p.y).cos(), 0.0);
        }
        let weights = EdgeWeights::cotangent(&mesh);
        assert_eq!(weights.clamped, 0);
        let area: f64 = (0..mesh.face_count()).map(|f| crate::face_area_vector(mesh.corners(f)).length()).sum();
        let gradient = DVec3::new(0.3, -1.7, 0.0);
        assert_eq!(energy(&mesh, &weights, |_| 4.2), 0.0);
        let linear = energy(&mesh, &weights, |p| gradient.dot(p) + 2.0);
        assert!((linear / (0.5 * gradient.length_squared() * area) - 1.0).abs() < 1e-13);
    }

    /// On the unit sphere the coordinate functions are eigenfunctions of eigenvalue 2: `E = 1/2 * 2 * 4 pi / 3`.
    #[test]
    fn the_energy_of_a_coordinate_on_a_sphere_converges_to_second_order() {
        let exact = 4.0 * std::f64::consts::PI / 3.0;
        let error = |level: u32| {
            let sphere = shapes::icosphere(level);
            (energy(&sphere, &EdgeWeights::cotangent(&sphere), |p| p.x) - exact).abs()
        };
        assert!((error(4) / error(5) - 4.0).abs() < 0.2, "{} {}", error(4), error(5));
    }

    /// The diagonals of squares are opposite to right angles: weight 0, raised and counted.
    #[test]
    fn weights_that_are_not_positive_are_raised_and_counted() {
        let grid = shapes::plane_grid(4, 4, 1.0, 1.0).expect("valid size");
        let weights = EdgeWeights::cotangent(&grid);
        assert_eq!(weights.clamped, 16);
        // 24 inner edges of weight 1, 16 border edges of weight 1/2, 16 diagonals of weight 0 to rounding: the median is 1/2.
        let smallest = weights.values.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((smallest / (MIN_RELATIVE_COTANGENT * 0.5) - 1.0).abs() < 1e-12, "{smallest}");
        assert!(weights.values.iter().all(|w| w.is_finite() && *w > 0.0));
    }

    /// A face without area says nothing about its edges, and one needle leaves the other weights as they are.
    #[test]
    fn degenerate_faces_and_needles_do_no_harm() {
        let mut mesh = equilateral();
        let even = EdgeWeights::cotangent(&mesh);
        let touched: Vec<u32> =
            mesh.topology().vertex_faces(24).iter().flat_map(|&f| mesh.triangles()[f as usize]).collect();
        for offset in [0.0, 1e-9, 1e-15] {
            mesh.positions[24] = mesh.positions[25] + DVec3::new(0.0, offset, 0.0);
            let weights = EdgeWeights::cotangent(&mesh);
            assert!(weights.values.iter().all(|w| w.is_finite() && *w > 0.0), "{offset}");
            for (e, ends) in mesh.topology().edges().iter().enumerate() {
                if !ends.iter().any(|v| touched.contains(v)) {
                    assert_eq!(weights.values[e], even.values[e]);
                }
            }
        }
    }

    #[test]
    fn weights_do_not_depend_on_scale() {
        let mesh = shapes::torus(1.0, 0.3, 20, 9).expect("valid radii");
        let weights = EdgeWeights::cotangent(&mesh);
        for scale in [1e-12, 1e-3, 1e12] {
            let scaled = mesh.with_positions(mesh.positions.iter().map(|p| *p * scale).collect()).expect("finite");
            let other = EdgeWeights::cotangent(&scaled);
            assert_eq!(weights.clamped, other.clamped);
            // Cotangents of about 1 may cancel to a small weight, so the difference is to rounding of 1.
            let off = weights.values.iter().zip(&other.values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-13, "{scale}: {off}");
        }
    }
}
