use std::fmt;
use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::cholesky::simplicial::SymbolicSimplicialCholesky;
use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side, Spec};

use crate::panels::{Columns, Panels};
use crate::{LinalgError, SparseRows, SpdPattern, Triplet};

/// The factors of surfaces have too little work to share out among threads.
const PAR: Par = Par::Seq;

/// A pivot below this share of its diagonal entry is what rounding leaves of a zero: about 1e-16 for a hundred
/// unknowns of a mesh's Laplacian, over 1e-14 for ten thousand. A true pivot so small would leave four digits of the
/// solution.
const SMALLEST_PIVOT: f64 = 1e-12;

/// A factored symmetric positive definite matrix, with the memory for factoring again and for solving.
///
/// The factor is kept twice: as faer computes it, and as panels to solve with, which for three right-hand sides takes a third of the
/// time and leaves out what is not free.
pub struct Cholesky {
    pattern: Arc<SpdPattern>,
    /// Values of the pattern's upper triangle.
    values: Vec<f64>,
    /// Values of the factor, in faer's order.
    factor: Vec<f64>,
    panels: Panels,
    memory: MemBuffer,
    /// What the last factorisation came to: a failed one leaves nothing to solve with.
    state: Result<(), LinalgError>,
}

impl fmt::Debug for Cholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pattern, state, .. } = self;
        f.debug_struct("Cholesky").field("unknowns", &pattern.unknowns).field("state", state).finish_non_exhaustive()
    }
}

impl Cholesky {
    /// Factors the matrix with the given pattern; `values` runs parallel to the pattern's entries.
    ///
    /// # Errors
    /// As [`Self::refactor`], and [`LinalgError::TooLarge`] if the factor does not fit in memory.
    pub fn new(pattern: Arc<SpdPattern>, values: impl IntoIterator<Item = f64>) -> Result<Self, LinalgError> {
        Self::of_block(pattern, values, |_| true)
    }

    /// As [`Self::new`], for the block of the free unknowns alone: see [`Self::refactor_block`].
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_block(
        pattern: Arc<SpdPattern>,
        values: impl IntoIterator<Item = f64>,
        is_free: impl Fn(usize) -> bool,
    ) -> Result<Self, LinalgError> {
        let mut factor = Vec::new();
        factor.try_reserve_exact(pattern.factor_len()).map_err(|_| pattern.too_large())?;
        factor.resize(pattern.factor_len(), 0.0);
        let scratch = pattern
            .symbolic
            .as_ref()
            .map_or(StackReq::EMPTY, |symbolic| symbolic.factorize_numeric_llt_scratch::<f64>(PAR, Spec::default()));
        let memory = MemBuffer::try_new(scratch).map_err(|_| pattern.too_large())?;
        let sums = vec![0.0; pattern.row_idx.len()];
        let mut cholesky = Self { pattern, values: sums, factor, panels: Panels::default(), memory, state: Ok(()) };
        cholesky.refactor_block(values, is_free)?;
        Ok(cholesky)
    }

    /// Pattern and factor in one call, for a matrix that is factored once.
    ///
    /// # Errors
    /// As [`SpdPattern::new`] and [`Self::new`].
    pub fn of_triplets(unknowns: usize, triplets: &[Triplet]) -> Result<Self, LinalgError> {
        let pattern = Arc::new(SpdPattern::new(unknowns, triplets)?);
        Self::new(pattern, triplets.iter().map(|t| t.value))
    }

    /// Pattern and factor of a symmetric matrix given by full rows; only what is on and below the diagonal is read.
    ///
    /// # Errors
    /// As [`Self::of_triplets`].
    pub fn of_rows(matrix: &SparseRows) -> Result<Self, LinalgError> {
        let mut lower = Vec::new();
        for i in 0..matrix.row_count() {
            let (columns, values) = matrix.row(i);
            let entries = columns.iter().zip(values).filter(|(j, _)| **j as usize <= i);
            lower.extend(entries.map(|(&j, &value)| Triplet::new(i as u32, j, value)));
        }
        Self::of_triplets(matrix.row_count(), &lower)
    }

    /// Factors again with other values in the same places, in the same memory; the result is bit for bit that of a
    /// fresh factorisation.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] or [`LinalgError::EntryNotFinite`] for values that do not fit, and
    /// [`LinalgError::NotPositiveDefinite`] with the unknown at which no pivot was left. After an error there is no
    /// factor, and solving repeats the error.
    pub fn refactor(&mut self, values: impl IntoIterator<Item = f64>) -> Result<(), LinalgError> {
        self.refactor_block(values, |_| true)
    }

    /// As [`Self::refactor`], for the block of the unknowns with `is_free` alone: rows and columns of the others are left out, and
    /// [`Self::solve_in_place`] does not touch their rows.
    ///
    /// Which unknowns are free is a matter of values: the order and the pattern of the factor stay as they are. The others become rows of
    /// the identity while the numbers are computed, which takes as long as without any, and are dropped from what is solved with.
    ///
    /// # Errors
    /// As [`Self::refactor`].
    pub fn refactor_block(
        &mut self,
        values: impl IntoIterator<Item = f64>,
        is_free: impl Fn(usize) -> bool,
    ) -> Result<(), LinalgError> {
        self.state = self.sum_values(values).and_then(|()| {
            self.leave_out(&is_free);
            self.factorise()?;
            self.check_pivots()
        });
        if self.state.is_ok() {
            let pattern = Arc::clone(&self.pattern);
            let (columns, unknown) = (pattern.unknowns, |k| pattern.unknown_of_pivot(k));
            match pattern.symbolic.as_ref().map(SymbolicCholesky::raw) {
                None => {}
                Some(SymbolicCholeskyRaw::Simplicial(symbolic)) => {
                    let factor = Simplicial { symbolic, values: &self.factor };
                    self.panels.fill(columns, &factor, unknown, is_free);
                }
                Some(SymbolicCholeskyRaw::Supernodal(symbolic)) => {
                    let factor = Supernodal::new(symbolic, &self.factor);
                    self.panels.fill(columns, &factor, unknown, is_free);
                }
            }
        }
        self.state.clone()
    }

    /// The pattern.
    pub fn pattern(&self) -> &Arc<SpdPattern> {
        &self.pattern
    }

    /// Numbers stored for solving: the cost of a solve in memory and, nearly, in operations per right-hand side.
    pub fn solve_len(&self) -> usize {
        self.panels.len()
    }

    /// Replaces each of three right-hand sides by its solution; row `i` of `rhs` belongs to unknown `i`. Allocates
    /// nothing.
    ///
    /// Costs about two operations per stored number of the factor and right-hand side.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`], [`LinalgError::SolutionNotFinite`] (then `rhs` is spoilt), or the error of the last
    /// factorisation.
    pub fn solve_in_place(&mut self, rhs: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        self.state.clone()?;
        let unknowns = self.pattern.unknowns;
        if rhs.len() != unknowns {
            return Err(LinalgError::WrongCount { what: "right-hand side rows", expected: unknowns, found: rhs.len() });
        }
        // faer lets an infinite pivot pass, and an infinite right-hand side gives an infinite solution.
        self.panels.solve(rhs).map_err(|unknown| LinalgError::SolutionNotFinite { unknown })
    }

    fn sum_values(&mut self, values: impl IntoIterator<Item = f64>) -> Result<(), LinalgError> {
        self.values.fill(0.0);
        let expected = self.pattern.entries();
        let mut found = 0;
        for (entry, value) in values.into_iter().enumerate() {
            if !value.is_finite() {
                return Err(LinalgError::EntryNotFinite { entry });
            }
            if let Some(place) = self.pattern.place(entry) {
                self.values[place] += value;
            }
            found += 1;
        }
        if found == expected { Ok(()) } else { Err(LinalgError::WrongCount { what: "values", expected, found }) }
    }

    /// Makes rows and columns of unknowns that are not free those of the identity.
    fn leave_out(&mut self, is_free: &impl Fn(usize) -> bool) {
        let pattern = &*self.pattern;
        for (col, ends) in pattern.col_ptr.windows(2).enumerate() {
            let entries = ends[0] as usize..ends[1] as usize;
            let column_is_free = is_free(col);
            for (value, &row) in self.values[entries.clone()].iter_mut().zip(&pattern.row_idx[entries]) {
                if !(column_is_free && is_free(row as usize)) {
                    *value = if row as usize == col { 1.0 } else { 0.0 };
                }
            }
        }
    }

    fn factorise(&mut self) -> Result<(), LinalgError> {
        let pattern = &*self.pattern;
        let Some(symbolic) = &pattern.symbolic else { return Ok(()) };
        let n = pattern.unknowns;
        let places = SymbolicSparseColMatRef::new_checked(n, n, &pattern.col_ptr, None, &pattern.row_idx);
        let matrix = SparseColMatRef::new(places, &self.values);
        let stack = MemStack::new(&mut self.memory);
        symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                matrix,
                Side::Upper,
                Default::default(),
                PAR,
                stack,
                Spec::default(),
            )
            .map(|_| ())
            .map_err(|LltError::NonPositivePivot { index }| {
                // faer 0.24 counts pivots from 1 in its simplicial code and from 0 in its supernodal code.
                let k = match symbolic.raw() {
                    SymbolicCholeskyRaw::Simplicial(_) => index.saturating_sub(1),
                    SymbolicCholeskyRaw::Supernodal(_) => index,
                };
                LinalgError::NotPositiveDefinite { unknown: pattern.unknown_of_pivot(k) }
            })
    }

    /// Refuses pivots that are only rounding: a singular matrix need not end in an exact zero.
    fn check_pivots(&self) -> Result<(), LinalgError> {
        let pattern = &*self.pattern;
        let check = |k: usize, root: f64| {
            let unknown = pattern.unknown_of_pivot(k);
            let diagonal = self.values[pattern.diagonal_place(unknown)];
            // Written so that NaN and infinity fail.
            if root * root > SMALLEST_PIVOT * diagonal && root.is_finite() {
                Ok(())
            } else {
                Err(LinalgError::NotPositiveDefinite { unknown })
            }
        };
        match pattern.symbolic.as_ref().map(SymbolicCholesky::raw) {
            None => Ok(()),
            // The diagonal is stored first in each column of the factor.
            Some(SymbolicCholeskyRaw::Simplicial(s)) => {
                (0..s.nrows()).try_for_each(|k| check(k, self.factor[s.col_ptr()[k] as usize]))
            }
            // Each supernode is a dense column-major block whose top square is lower triangular.
            Some(SymbolicCholeskyRaw::Supernodal(s)) => (0..s.n_supernodes()).try_for_each(|block| {
                let (begin, end) = (s.supernode_begin()[block] as usize, s.supernode_end()[block] as usize);
                let (start, stop) = (s.col_ptr_for_val()[block] as usize, s.col_ptr_for_val()[block + 1] as usize);
                let rows = (stop - start) / (end - begin).max(1);
                (begin..end).try_for_each(|k| check(k, self.factor[start + (k - begin) * (rows + 1)]))
            }),
        }
    }
}

/// A factor stored column by column.
struct Simplicial<'a> {
    symbolic: &'a SymbolicSimplicialCholesky<u32>,
    values: &'a [f64],
}

impl Columns for Simplicial<'_> {
    fn for_each(&self, column: usize, mut entry: impl FnMut(usize, f64)) {
        let ends = &self.symbolic.col_ptr()[column..column + 2];
        let entries = ends[0] as usize..ends[1] as usize;
        for (&row, &value) in self.symbolic.row_idx()[entries.clone()].iter().zip(&self.values[entries]) {
            entry(row as usize, value);
        }
    }
}

/// A factor stored in dense blocks: each supernode is column-major, its top square lower triangular.
struct Supernodal<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<u32>,
    values: &'a [f64],
    /// Supernode of each column.
    block: Vec<u32>,
}

impl<'a> Supernodal<'a> {
    fn new(symbolic: &'a SymbolicSupernodalCholesky<u32>, values: &'a [f64]) -> Self {
        let ends = symbolic.supernode_begin().iter().zip(symbolic.supernode_end()).enumerate();
        let block = ends.flat_map(|(s, (&begin, &end))| (begin..end).map(move |_| s as u32)).collect();
        Self { symbolic, values, block }
    }
}

impl Columns for Supernodal<'_> {
    fn for_each(&self, column: usize, mut entry: impl FnMut(usize, f64)) {
        let (symbolic, s) = (self.symbolic, self.block[column] as usize);
        let (begin, end) = (symbolic.supernode_begin()[s] as usize, symbolic.supernode_end()[s] as usize);
        let start = symbolic.col_ptr_for_row_idx()[s] as usize;
        let pattern = &symbolic.row_idx()[start..symbolic.col_ptr_for_row_idx()[s + 1] as usize];
        let rows = end - begin + pattern.len();
        let values = symbolic.col_ptr_for_val()[s] as usize + (column - begin) * rows;
        let (square, below) = self.values[values..values + rows].split_at(end - begin);
        for (row, &value) in (begin..end).zip(square).skip(column - begin) {
            entry(row, value);
        }
        for (&row, &value) in pattern.iter().zip(below) {
            entry(row as usize, value);
        }
    }
}
