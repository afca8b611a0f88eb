use std::sync::Arc;

use crate::normal::{NormalEquations, largest};
use crate::{Cholesky, LinalgError, SparseRows, SpdPattern};

/// Most steps of refinement. Each wins the digits that the factor has, so that more than two are rare.
const MOST_REFINEMENTS: u32 = 4;

/// A step below this share of the solution changes nothing but rounding.
const SETTLED: f64 = 1e-15;

/// Minimises `|A x - b|^2` over the free columns of `A`, the others given, for three right-hand sides, by a Cholesky factor of the normal
/// equations `A_f^T A_f`.
///
/// A soft constraint is one more row. The pattern of the normal equations is analysed once.
///
/// Normal equations square the condition number, so a solution is refined on the residual `b - A x`. What is left is of the order of
/// `cond(A)` times rounding where `A x = b` can be met, and of its square times the residual where it cannot.
#[derive(Debug)]
pub struct LeastSquares {
    normal: NormalEquations,
    factor: Cholesky,
    /// Sums up rows of the normal equations.
    sums: Vec<f64>,
    values: Vec<f64>,
    /// `b - A x`.
    residual: Vec<[f64; 3]>,
    step: Vec<[f64; 3]>,
    /// What the last change of values came to.
    state: Result<(), LinalgError>,
}

impl LeastSquares {
    /// Assembles and factors the normal equations of the columns with `is_free`.
    ///
    /// Costs the sum of the squared lengths of the rows, and a sparse factorisation.
    ///
    /// # Errors
    /// [`LinalgError::EntryNotFinite`]; [`LinalgError::NotPositiveDefinite`] with a column that the rows do not determine, the first
    /// one that no row touches if there is such a one; [`LinalgError::TooLarge`].
    pub fn new(a: SparseRows, is_free: impl FnMut(usize) -> bool) -> Result<Self, LinalgError> {
        let normal = NormalEquations::new(a, is_free)?;
        normal.check_values()?;
        let (col_ptr, row_idx) = normal.pattern()?;
        let (mut sums, mut values) = (vec![0.0; normal.unknowns()], vec![0.0; row_idx.len()]);
        normal.values(&col_ptr, &row_idx, &mut sums, &mut values);
        let pattern = Arc::new(SpdPattern::of_columns(col_ptr, row_idx)?);
        let factor = Cholesky::new(pattern, values.iter().copied()).map_err(|error| normal.named(error))?;
        let residual = vec![[0.0; 3]; normal.a.row_count()];
        let step = vec![[0.0; 3]; normal.unknowns()];
        Ok(Self { normal, factor, sums, values, residual, step, state: Ok(()) })
    }

    /// The matrix.
    pub fn matrix(&self) -> &SparseRows {
        &self.normal.a
    }

    /// Numbers stored for solving.
    pub fn solve_len(&self) -> usize {
        self.factor.solve_len()
    }

    /// Factors again with other values in the same places: `change` gets the values of all entries, row by row.
    ///
    /// # Errors
    /// As [`Self::new`]. After an error there is no factor, and solving repeats the error.
    pub fn set_values(&mut self, change: impl FnOnce(&mut [f64])) -> Result<(), LinalgError> {
        change(self.normal.a.values_mut());
        self.state = self.refactor();
        self.state.clone()
    }

    fn refactor(&mut self) -> Result<(), LinalgError> {
        let Self { normal, factor, sums, values, .. } = self;
        normal.check_values()?;
        let pattern = Arc::clone(factor.pattern());
        normal.values(&pattern.col_ptr, &pattern.row_idx, sums, values);
        factor.refactor(values.iter().copied()).map_err(|error| normal.named(error))
    }

    /// Solves: `b` has a row per row of the matrix; of `x`, with a row per column, the given ones are read and the free ones written.
    /// Allocates nothing.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`], [`LinalgError::SolutionNotFinite`] with its column (then the free rows of `x` are spoilt), or the
    /// error of the last factorisation.
    pub fn solve(&mut self, b: &[[f64; 3]], x: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        self.state.clone()?;
        self.normal.check_counts(b, x)?;
        self.normal.clear(x);
        let mut last = f64::INFINITY;
        for _ in 0..=MOST_REFINEMENTS {
            let size = self.find_step(b, x)?;
            // Where steps do not get smaller, the factor has no digit to give: what there is stays.
            if size > 0.5 * last {
                break;
            }
            self.normal.advance(x, [1.0; 3], &self.step);
            if size <= SETTLED * self.normal.size(x) {
                break;
            }
            last = size;
        }
        Ok(())
    }

    /// Goes from the free rows of `x`, as they are, to the solution in one step: as [`Self::solve`] with the first of its steps alone, and
    /// so in a third of the time or less. For those who solve again and again for right-hand sides that change little: what is
    /// left is a share of the way, some `1e-16` times the condition number of the normal equations.
    ///
    /// # Errors
    /// As [`Self::solve`].
    pub fn refine(&mut self, b: &[[f64; 3]], x: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        self.state.clone()?;
        self.normal.check_counts(b, x)?;
        self.find_step(b, x)?;
        self.normal.advance(x, [1.0; 3], &self.step);
        Ok(())
    }

    /// The step from `x` to the solution; returns its largest entry.
    fn find_step(&mut self, b: &[[f64; 3]], x: &[[f64; 3]]) -> Result<f64, LinalgError> {
        let Self { normal, factor, residual, step, .. } = self;
        normal.residual(b, x, residual);
        normal.gather(residual, step);
        factor.solve_in_place(step).map_err(|error| normal.named(error))?;
        Ok(largest(step.iter().copied()))
    }
}
