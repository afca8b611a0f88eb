use serde::Serialize;

use crate::binding::Binding;
use crate::propagate::{Propagation, Propagator};
use crate::rows::RowFacts;

/// What the rows of a binding look like.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct BindReport {
    /// Shape vertices: rows.
    pub rows: usize,
    /// Weights kept per row: mean.
    pub kept_mean: f64,
    /// Weights kept per row: median.
    pub kept_median: usize,
    /// Weights kept per row: 99 % of the rows keep at most this many.
    pub kept_p99: usize,
    /// Weights kept per row: largest.
    pub kept_max: usize,
    /// How far [`Propagation::Positions`] moves the shape with nothing deformed: root mean square, as a
    /// share of the shape's diagonal. [`Propagation::Frames`] moves nothing.
    pub rest_error_rms: f64,
    /// The same: largest.
    pub rest_error_max: f64,
    /// Share of the kept weights that are negative.
    pub negative_share: f64,
    /// Largest sum of magnitudes of a row: how far a row can throw an error of its cage vertices.
    pub largest_magnitude: f64,
    /// Rows whose magnitudes sum to more than [`UNSAFE_MAGNITUDE`].
    pub unsafe_rows: usize,
    /// Rows whose coordinates cancelled and that follow the nearest cage vertices instead.
    pub replaced_rows: usize,
    /// Edges of the cage with one face: above 0, the cage is open and mean value coordinates lose their linear precision.
    pub cage_open_edges: usize,
    /// Largest distance between a shape vertex and what its whole row (before pruning) makes of the cage, as a share of
    /// the cage's diagonal. Measured under [`Prune::None`](crate::Prune::None) and with
    /// [`BindOptions::exact`](crate::BindOptions::exact); 0 elsewhere, but for the few rows that needed every cage face.
    pub linear_precision_error: f64,
    /// Rows of mean value coordinates whose linear precision was not measured, as they were made without looking at the whole cage.
    pub unmeasured_rows: usize,
}

/// A row whose magnitudes sum to more than this is unsafe: sound rows stay below 2.6 even on coarse tight cages.
pub const UNSAFE_MAGNITUDE: f64 = 3.0;

impl BindReport {
    pub(crate) fn of(binding: &Binding, facts: RowFacts) -> Self {
        let rows = binding.shape_vertex_count();
        let mut kept: Vec<usize> = (0..rows).map(|i| binding.row(i).0.len()).collect();
        kept.sort_unstable();
        let quantile = |share: f64| kept.get(((share * rows as f64).ceil() as usize).max(1) - 1).copied().unwrap_or(0);
        let magnitude = |i: usize| binding.row(i).1.iter().map(|w| f64::from(w.abs())).sum::<f64>();
        let magnitudes: Vec<f64> = (0..rows).map(magnitude).collect();
        let negative = binding.rows.weights.iter().filter(|w| **w < 0.0).count();
        let (rest_error_rms, rest_error_max) = rest_error(binding);
        let topology = &binding.cage_topology;
        Self {
            rows,
            kept_mean: binding.rows.weights.len() as f64 / rows.max(1) as f64,
            kept_median: quantile(0.5),
            kept_p99: quantile(0.99),
            kept_max: quantile(1.0),
            rest_error_rms,
            rest_error_max,
            negative_share: negative as f64 / binding.rows.weights.len().max(1) as f64,
            largest_magnitude: magnitudes.iter().copied().fold(0.0, f64::max),
            unsafe_rows: magnitudes.iter().filter(|m| **m > UNSAFE_MAGNITUDE).count(),
            replaced_rows: facts.replaced,
            cage_open_edges: topology.boundary_edge_count(),
            linear_precision_error: facts.precision_error,
            unmeasured_rows: facts.unmeasured,
        }
    }

    /// What a user should know before editing with this binding; empty if all is well.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.unsafe_rows > 0 {
            warnings.push(format!(
                "{} of {} rows are unsafe: their weights' magnitudes sum to up to {:.1}, so small moves of the cage are thrown far; \
                 bind with the prune rule smooth:16 and propagate by frames instead",
                self.unsafe_rows, self.rows, self.largest_magnitude
            ));
        }
        if self.replaced_rows > 0 {
            warnings.push(format!(
                "{} of {} rows have coordinates that cancel; they follow the nearest cage vertices by distance instead",
                self.replaced_rows, self.rows
            ));
        }
        if self.linear_precision_error > 1e-6 {
            let cause = if self.cage_open_edges > 0 {
                format!("the cage is open ({} edges with one face)", self.cage_open_edges)
            } else {
                "the cage folds over itself, or vertices lie many diagonals away from it".to_owned()
            };
            warnings.push(format!(
                "{cause}: mean value coordinates are off by up to {:.2e} of the diagonal at rest; propagation by frames is not affected",
                self.linear_precision_error
            ));
        } else if self.cage_open_edges > 0 && self.unmeasured_rows > 0 {
            warnings.push(format!(
                "the cage is open ({} edges with one face): mean value coordinates are off at rest, by how much was not measured; \
                 propagation by frames is not affected",
                self.cage_open_edges
            ));
        }
        warnings
    }
}

/// Root mean square and largest distance by which positions propagation moves the shape at rest, in diagonals.
fn rest_error(binding: &Binding) -> (f64, f64) {
    let mut moved = vec![glam::DVec3::ZERO; binding.shape_vertex_count()];
    Propagator::new(Propagation::Positions).apply(binding, &binding.cage, &mut moved);
    let (_, scale) = pliant_mesh::Bounds::of(&binding.shape).normal_frame();
    let distances = moved.iter().zip(&binding.shape).map(|(m, x)| m.distance(*x) * scale);
    let (square, max) = distances.fold((0.0, 0.0_f64), |(s, m), d| (s + d * d, m.max(d)));
    ((square / moved.len().max(1) as f64).sqrt(), max)
}
