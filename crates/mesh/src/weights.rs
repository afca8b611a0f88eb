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
