//! The second system, without shear (section 4).

use std::time::{Duration, Instant};

use glam::{DMat3, DVec3};
use pliant_linalg::{LeastSquares, LinalgError, SparseRows};
use pliant_mesh::best_rotation;
use pliant_mesh::threads::for_each_chunk;

use super::plan::{Hold, Plan};
use super::rows::LaplacianRows;
use super::stencils::{NONE, Stencils};
use crate::patch::{Held, Patch};

/// `D(v~) = R D(v)` or `R S D(v)` (Eq. 9, 10) with places for what is held, in the least-squares sense.
///
/// It has the rows of the first system's `E_L`: of the unknown vertices and of their neighbours. The latter join the surface smoothly to
/// what is held, and make it a true least-squares system, which spreads what the displaced vertices were off (section 3.3, Fig. 3f).
pub(super) struct Shear {
    system: LeastSquares,
    rows: Vec<Row>,
    /// Vertices of soft handles, with the root of the weight of the row that draws them.
    springs: Vec<(u32, f64)>,
    rhs: Vec<[f64; 3]>,
    x: Vec<[f64; 3]>,
    /// By number of the gradient.
    similarities: Vec<DMat3>,
}

struct Row {
    vertex: u32,
    /// Number of its gradient, or [`NONE`] where it is given.
    gradient: u32,
    /// `r D(v)`, at rest and not displaced.
    rest: DVec3,
}

impl Shear {
    /// Assembles and factors.
    ///
    /// # Errors
    /// As [`LeastSquares::new`], with numbers of vertices of the patch.
    pub(super) fn new(
        patch: &Patch,
        plan: &Plan,
        laplacian: &LaplacianRows,
        stencils: &Stencils,
    ) -> Result<Self, LinalgError> {
        let count = patch.held.len();
        let mut matrix = SparseRows::new(count);
        let mut rows = Vec::new();
        let mut squares = vec![0.0; count];
        for v in (0..count).filter(|&v| plan.has_row[v] && (plan.is_given[v] || stencils.gradient[v] != NONE)) {
            matrix.push_row(laplacian.row(v))?;
            for (k, value) in laplacian.row(v) {
                squares[k as usize] += value * value;
            }
            let gradient = if plan.is_given[v] { NONE } else { stencils.gradient[v] };
            rows.push(Row { vertex: v as u32, gradient, rest: laplacian.apply(v, &patch.mesh.positions) });
        }
        let unknowns = plan.is_unknown.iter().filter(|unknown| **unknown).count();
        let total: f64 = squares.iter().zip(&plan.is_unknown).filter(|(_, unknown)| **unknown).map(|(s, _)| s).sum();
        let mean = total / unknowns.max(1) as f64;
        let mean = if mean > 0.0 { mean } else { 1.0 };
        let mut springs = Vec::new();
        for (v, held) in patch.held.iter().enumerate() {
            if let Held::Spring { weight, .. } = held
                && plan.draws_positions()
            {
                let root = (weight * mean).sqrt();
                matrix.push_row([(v as u32, root)])?;
                springs.push((v as u32, root));
            }
        }
        let rhs = vec![[0.0; 3]; matrix.row_count()];
        let system = LeastSquares::new(matrix, |v| plan.is_unknown[v])?;
        let similarities = vec![DMat3::ZERO; stencils.len()];
        Ok(Self { system, rows, springs, rhs, x: vec![[0.0; 3]; count], similarities })
    }

    /// Numbers stored for solving.
    pub(super) fn solve_len(&self) -> usize {
        self.system.solve_len()
    }

    /// Solves for the unknown points of `solution`, the others given; returns the time that the gradients took.
    pub(super) fn remove(
        &mut self,
        gradients: &[DMat3],
        is_scaled: bool,
        plan: &Plan,
        hold: &Hold,
        solution: &mut [DVec3],
    ) -> Result<Duration, LinalgError> {
        let start = Instant::now();
        let chunk = pliant_mesh::threads::CHUNK;
        for_each_chunk(&mut self.similarities, |number, out| {
            for (out, gradient) in out.iter_mut().zip(&gradients[number * chunk..]) {
                *out = without_shear(*gradient, is_scaled);
            }
        });
        let time = start.elapsed();
        for (row, rhs) in self.rows.iter().zip(&mut self.rhs) {
            let similarity = match row.gradient {
                NONE => without_shear(hold.gradients[row.vertex as usize], is_scaled),
                gradient => self.similarities[gradient as usize],
            };
            *rhs = (similarity * row.rest).to_array();
        }
        for (&(v, root), rhs) in self.springs.iter().zip(&mut self.rhs[self.rows.len()..]) {
            *rhs = (root * hold.places[v as usize]).to_array();
        }
        for (x, p) in self.x.iter_mut().zip(&*solution) {
            *x = p.to_array();
        }
        self.system.solve(&self.rhs, &mut self.x)?;
        for ((p, x), _) in solution.iter_mut().zip(&self.x).zip(&plan.is_unknown).filter(|(_, unknown)| **unknown) {
            *p = DVec3::from_array(*x);
        }
        Ok(time)
    }
}

/// The rotation of a gradient, times its scale if features are to be scaled.
///
/// `U V^T` of the singular value decomposition `M = U W V^T` is the rotation that maximises `trace(R^T M)`, so it is found without
/// decomposing. The text does not treat reflections: of `M` with a negative determinant the sign of the smallest singular value
/// changes, which makes the nearest rotation that is proper. `s = sqrt((l1^2 + l2^2 + l3^2) / 3)` is the Frobenius norm over the
/// root of 3.
fn without_shear(gradient: DMat3, is_scaled: bool) -> DMat3 {
    let rotation = best_rotation(gradient);
    if !is_scaled {
        return rotation;
    }
    let squares: f64 = gradient.to_cols_array().iter().map(|entry| entry * entry).sum();
    rotation * (squares / 3.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A proper rotation for any gradient, mirrored ones too, and the root mean square of singular values that are known.
    #[test]
    fn shear_and_mirrors_leave_proper_rotations() {
        for i in 0..60 {
            let t = f64::from(i);
            let turn =
                |a: f64| DMat3::from_axis_angle(DVec3::new((a * t).sin(), a.cos(), (t + a).cos()).normalize(), a * t);
            for values in [DVec3::new(3.0, 1.0, 0.2), DVec3::new(2.0, 1.0, -0.5), DVec3::new(1.0, 0.4, 0.0)] {
                let gradient = turn(0.3) * DMat3::from_diagonal(values) * turn(0.7);
                let rotation = without_shear(gradient, false);
                assert!((rotation.determinant() - 1.0).abs() < 1e-12);
                let scaled = without_shear(gradient, true);
                let scale = values.length() / 3.0_f64.sqrt();
                assert!((scaled.determinant().cbrt() / scale - 1.0).abs() < 1e-12);
                // U V^T with the sign on the smallest singular value.
                let expected = turn(0.3) * turn(0.7);
                let off = (rotation - expected).to_cols_array().iter().map(|x| x.abs()).fold(0.0, f64::max);
                assert!(off < 1e-12, "{values}: {off:e}");
            }
        }
    }
}
