use crate::{Topology, TriMesh};

/// Cotangent weights are kept above this share of their mean.
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
    /// Weights below [`MIN_RELATIVE_COTANGENT`] times the mean of the positive ones are raised to it and counted. A face
    /// without area adds nothing. Weights do not change when the mesh is scaled.
    pub fn cotangent(mesh: &TriMesh) -> Self {
        let topology = mesh.topology();
        let mut values = vec![0.0; topology.edges().len()];
        for face in 0..mesh.face_count() {
            let p = mesh.corners(face);
            for (k, edge) in topology.face_edges(face).into_iter().enumerate() {
                let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
                let cotangent = u.dot(v) / u.cross(v).length();
                if cotangent.is_finite() {
                    values[edge as usize] += 0.5 * cotangent;
                }
            }
        }
        let (sum, count) = values.iter().filter(|w| **w > 0.0).fold((0.0, 0usize), |(s, n), w| (s + w, n + 1));
        // A needle has cotangents up to 1e16, which would raise the mean and with it every other weight: cap first.
        let smallest = if count > 0 { MIN_RELATIVE_COTANGENT * typical(&values, sum / count as f64) } else { 1.0 };
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

/// The mean of the positive weights not above ten times `mean`.
fn typical(values: &[f64], mean: f64) -> f64 {
    let (sum, count) =
        values.iter().filter(|w| **w > 0.0 && **w <= 10.0 * mean).fold((0.0, 0usize), |(s, n), w| (s + w, n + 1));
    if count > 0 { sum / count as f64 } else { mean }
}
