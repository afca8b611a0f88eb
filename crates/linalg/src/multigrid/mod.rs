//! An approximate inverse of a mesh's Laplacian that needs no factor.

mod coarsen;
mod csr;

use crate::{Cholesky, LinalgError, SparseRows};
use coarsen::coarsen;
use csr::{Csr, Row};

/// Levels with no more unknowns than this are solved by a factor; so is one that cannot be made coarser, as its unknowns are hardly coupled.
const COARSEST: usize = 600;

/// A level must have at most this share of the unknowns of the one above it, or no more are made.
const LEAST_COARSENING: f64 = 0.7;

/// Share of the spectrum, from its upper end down, that smoothing damps: what remains is the coarser level's.
const SMOOTHED: f64 = 6.0;

/// A V-cycle of smoothed aggregation multigrid, as a symmetric positive definite preconditioner.
///
/// - Vaněk, Mandel, Brezina. *Algebraic Multigrid by Smoothed Aggregation for Second and Fourth Order Elliptic Problems.* Computing 56,
///   1996.
/// - Adams, Brezina, Hu, Tuminaro. *Parallel Multigrid Smoothing: Polynomial versus Gauss-Seidel.* J. Comput. Phys. 188, 2003:
///   Chebyshev polynomials as smoothers, which are as good and come out the same for any number of threads.
///
/// For matrices whose near-null space is constants, such as Laplacians with positive weights. Set up in time and memory linear in the
/// entries; the cycle runs in single precision, as an approximate inverse may.
#[derive(Debug)]
pub struct Multigrid {
    levels: Vec<Level>,
    coarsest: Option<Cholesky>,
    /// Scratch of the coarsest level.
    rhs: Vec<[f64; 3]>,
}

/// One level but the coarsest.
#[derive(Debug)]
struct Level {
    matrix: Csr,
    /// Of the diagonal.
    inverse: Vec<f32>,
    /// From the next coarser level, and to it.
    prolong: Csr,
    restrict: Csr,
    /// Bound of the largest eigenvalue of the matrix over its diagonal.
    bound: f32,
    /// Scratch: right-hand side and solution, what is left, and the last change.
    rhs: Vec<Row>,
    solution: Vec<Row>,
    residual: Vec<Row>,
    change: Vec<Row>,
}

impl Multigrid {
    /// Sets up the levels for a symmetric positive definite matrix, given by full rows (both triangles).
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] if it is not square, [`LinalgError::EntryNotFinite`], [`LinalgError::NotPositiveDefinite`] for a row
    /// without a positive diagonal or a coarsest level that is singular, and [`LinalgError::TooLarge`].
    pub fn new(matrix: &SparseRows) -> Result<Self, LinalgError> {
        let unknowns = matrix.row_count();
        if matrix.column_count() != unknowns {
            let found = matrix.column_count();
            return Err(LinalgError::WrongCount { what: "columns", expected: unknowns, found });
        }
        if matrix.values().len() > u32::MAX as usize {
            return Err(LinalgError::TooLarge { unknowns, entries: matrix.values().len() });
        }
        if let Some(entry) = matrix.values().iter().position(|x| !x.is_finite()) {
            return Err(LinalgError::EntryNotFinite { entry });
        }
        let mut levels = Vec::new();
        let mut finest: Option<SparseRows> = None;
        loop {
            let current = finest.as_ref().unwrap_or(matrix);
            let n = current.row_count();
            let made = if n > COARSEST { coarsen(current, levels.len())? } else { None };
            let Some(made) = made.filter(|made| (made.matrix.row_count() as f64) < LEAST_COARSENING * n as f64) else {
                let (coarsest, rhs) = factor(current)?;
                return Ok(Self { levels, coarsest, rhs });
            };
            let zeros = || vec![Row::default(); n];
            levels.push(Level {
                matrix: Csr::of(current),
                inverse: made.diagonal.iter().map(|d| (1.0 / d) as f32).collect(),
                restrict: Csr::of(&made.prolong.transpose()),
                prolong: Csr::of(&made.prolong),
                bound: made.bound as f32,
                rhs: zeros(),
                solution: zeros(),
                residual: zeros(),
                change: zeros(),
            });
            finest = Some(made.matrix);
        }
    }

    /// Unknowns of each level, finest first; that of the factor last.
    pub fn sizes(&self) -> impl Iterator<Item = usize> + '_ {
        self.levels.iter().map(|level| level.inverse.len()).chain([self.rhs.len()])
    }

    /// Writes the approximate solution for three right-hand sides to `x`: row `i` of either belongs to unknown `i`, a fourth number
    /// pads it.
    ///
    /// The map is linear up to rounding in f32 and symmetric positive definite. Allocates nothing.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`], and [`LinalgError::SolutionNotFinite`] if the coarsest level's is not.
    pub fn apply(&mut self, rhs: &[[f32; 4]], x: &mut [[f32; 4]]) -> Result<(), LinalgError> {
        let expected = self.levels.first().map_or(self.rhs.len(), |level| level.rhs.len());
        for found in [rhs.len(), x.len()] {
            if found != expected {
                return Err(LinalgError::WrongCount { what: "right-hand side rows", expected, found });
            }
        }
        let Some(first) = self.levels.first_mut() else {
            return solve(&mut self.coarsest, &mut self.rhs, rhs, x);
        };
        first.rhs.copy_from_slice(rhs);
        for at in 0..self.levels.len() {
            let (above, below) = self.levels.split_at_mut(at + 1);
            let level = &mut above[at];
            level.smooth_from_zero();
            if let Some(coarser) = below.first_mut() {
                level.restrict.multiply(&level.residual, &mut coarser.rhs);
            } else if let Some(coarsest) = &mut self.coarsest {
                let rhs = &mut self.rhs;
                level.restrict.multiply_to_double(&level.residual, rhs);
                coarsest.solve_in_place(rhs)?;
            }
        }
        for at in (0..self.levels.len()).rev() {
            let (above, below) = self.levels.split_at_mut(at + 1);
            let level = &mut above[at];
            match below.first() {
                Some(coarser) => level.prolong.add_multiplied(&coarser.solution, &mut level.solution),
                None => level.prolong.add_multiplied_double(&self.rhs, &mut level.solution),
            }
            level.smooth();
        }
        x.copy_from_slice(&self.levels[0].solution);
        Ok(())
    }
}

fn factor(matrix: &SparseRows) -> Result<(Option<Cholesky>, Vec<[f64; 3]>), LinalgError> {
    let n = matrix.row_count();
    let factor = if n == 0 { None } else { Some(Cholesky::of_rows(matrix)?) };
    Ok((factor, vec![[0.0; 3]; n]))
}

fn solve(
    factor: &mut Option<Cholesky>,
    scratch: &mut [[f64; 3]],
    rhs: &[Row],
    x: &mut [Row],
) -> Result<(), LinalgError> {
    let Some(factor) = factor else { return Ok(()) };
    for (to, from) in scratch.iter_mut().zip(rhs) {
        *to = std::array::from_fn(|k| f64::from(from[k]));
    }
    factor.solve_in_place(scratch)?;
    for (to, [x, y, z]) in x.iter_mut().zip(scratch) {
        *to = [*x as f32, *y as f32, *z as f32, 0.0];
    }
    Ok(())
}

impl Level {
    /// Two Chebyshev terms from a solution of zero; leaves the residual.
    fn smooth_from_zero(&mut self) {
        let Chebyshev { first, keep, add } = Chebyshev::of(self.bound);
        let Self { matrix, inverse, rhs, solution, residual, change, .. } = self;
        csr::scale(inverse, first, rhs, change);
        // residual = rhs - A change
        matrix.subtract_multiplied(change, rhs, residual);
        csr::next_term(inverse, keep, add, residual, change, solution);
        matrix.subtract_multiplied(solution, rhs, residual);
    }

    /// Two Chebyshev terms from the solution there is.
    fn smooth(&mut self) {
        let Chebyshev { first, keep, add } = Chebyshev::of(self.bound);
        let Self { matrix, inverse, rhs, solution, residual, change, .. } = self;
        matrix.subtract_multiplied(solution, rhs, residual);
        csr::scale(inverse, first, residual, change);
        matrix.take_off(change, residual);
        csr::add_two_terms(inverse, keep, add, residual, change, solution);
    }
}

/// Coefficients of two terms of the Chebyshev iteration on the upper part of a spectrum `0..bound`.
struct Chebyshev {
    first: f32,
    keep: f32,
    add: f32,
}

impl Chebyshev {
    fn of(bound: f32) -> Self {
        let low = bound / SMOOTHED as f32;
        let (middle, half) = (0.5 * (bound + low), 0.5 * (bound - low));
        let sigma = middle / half;
        let (rho, next) = (1.0 / sigma, 1.0 / (2.0 * sigma - 1.0 / sigma));
        Self { first: 1.0 / middle, keep: rho * next, add: 2.0 * next / half }
    }
}

#[cfg(test)]
mod tests;
