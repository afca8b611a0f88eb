use std::fmt;
use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::{LinalgError, Triplet};

/// Right-hand sides solved together: the coordinates of a point.
const RIGHT_HAND_SIDES: usize = 3;

/// faer's own threads make a solve with three right-hand sides 8 to 25 times slower: there is too little work to share
/// out.
const PAR: Par = Par::Seq;

/// A pivot below this share of its diagonal entry is what rounding leaves of a zero: about 1e-16 for a hundred
/// unknowns of a mesh's Laplacian, over 1e-14 for ten thousand. A true pivot so small would leave four digits of the
/// solution.
const SMALLEST_PIVOT: f64 = 1e-12;

/// The pattern of a symmetric matrix with a fill-reducing order (AMD) and the pattern of its Cholesky factor.
///
/// The costliest part of a first factorisation; shared by all matrices with entries in the same places.
#[derive(Debug)]
pub struct SpdPattern {
    unknowns: usize,
    /// Upper triangle by columns, rows increasing; the diagonal is always there and ends its column.
    col_ptr: Vec<u32>,
    row_idx: Vec<u32>,
    /// For each entry given, where in `row_idx` it is added.
    place: Vec<u32>,
    /// `None` for a system without unknowns.
    symbolic: Option<SymbolicCholesky<u32>>,
}

impl SpdPattern {
    /// Analyses the matrix with `unknowns` rows whose entries lie where `triplets` say; their values are not read.
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`] for the first entry outside the matrix; [`LinalgError::TooLarge`] if the
    /// factor cannot be indexed with 31 bits or does not fit in memory.
    pub fn new(unknowns: usize, triplets: &[Triplet]) -> Result<Self, LinalgError> {
        let too_large = || LinalgError::TooLarge { unknowns, entries: triplets.len() };
        // Places are 32 bits wide, and faer's own indices 31.
        if unknowns.saturating_add(triplets.len()) > i32::MAX as usize {
            return Err(too_large());
        }
        if let Some(entry) = triplets.iter().position(|t| t.row.max(t.col) as usize >= unknowns) {
            let Triplet { row, col, .. } = triplets[entry];
            return Err(LinalgError::IndexOutOfRange { entry, row, col, unknowns });
        }
        let (col_ptr, row_idx, place) = compress(unknowns, triplets);
        let symbolic = if unknowns == 0 {
            None
        } else {
            let matrix = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &col_ptr, None, &row_idx);
            let params = CholeskySymbolicParams::default();
            let symbolic = factorize_symbolic_cholesky(matrix, Side::Upper, SymmetricOrdering::Amd, params);
            Some(symbolic.map_err(|_| too_large())?)
        };
        Ok(Self { unknowns, col_ptr, row_idx, place, symbolic })
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Numbers stored for the factor: its cost in memory and, nearly, in operations per solve and right-hand side.
    pub fn factor_len(&self) -> usize {
        self.symbolic.as_ref().map_or(0, SymbolicCholesky::len_val)
    }

    /// The unknown behind row `k` of the permuted matrix.
    fn unknown_of_pivot(&self, k: usize) -> usize {
        match self.symbolic.as_ref().and_then(SymbolicCholesky::perm) {
            Some(perm) => perm.arrays().0.get(k).map_or(k, |&unknown| unknown as usize),
            None => k,
        }
    }

    /// Where the diagonal entry of an unknown is: last in its column of the upper triangle.
    fn diagonal_place(&self, unknown: usize) -> usize {
        self.col_ptr[unknown + 1] as usize - 1
    }

    fn too_large(&self) -> LinalgError {
        LinalgError::TooLarge { unknowns: self.unknowns, entries: self.place.len() }
    }
}

/// Sorts the entries into the upper triangle by (column, row), adds the diagonal, and says where each entry went.
///
/// Two stable counting sorts, so linear in the number of entries.
fn compress(unknowns: usize, triplets: &[Triplet]) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let given = triplets.len();
    // Entries numbered `given..` are the diagonal, so that every column has one.
    let cell = |entry: u32| {
        let entry = entry as usize;
        if entry < given {
            let Triplet { row, col, .. } = triplets[entry];
            (row.min(col), row.max(col))
        } else {
            ((entry - given) as u32, (entry - given) as u32)
        }
    };
    let all: Vec<u32> = (0..(given + unknowns) as u32).collect();
    let by_row = counting_sort(unknowns, &all, |e| cell(e).0);
    let sorted = counting_sort(unknowns, &by_row, |e| cell(e).1);

    let mut col_ptr = vec![0u32; unknowns + 1];
    let mut row_idx: Vec<u32> = Vec::with_capacity(sorted.len());
    let mut place = vec![0u32; given];
    let mut last = None;
    for &entry in &sorted {
        let (row, col) = cell(entry);
        if last != Some((row, col)) {
            row_idx.push(row);
            col_ptr[col as usize + 1] += 1;
            last = Some((row, col));
        }
        if let Some(place) = place.get_mut(entry as usize) {
            *place = row_idx.len() as u32 - 1;
        }
    }
    for col in 0..unknowns {
        col_ptr[col + 1] += col_ptr[col];
    }
    (col_ptr, row_idx, place)
}

fn counting_sort(keys: usize, items: &[u32], key: impl Fn(u32) -> u32) -> Vec<u32> {
    let mut start = vec![0u32; keys + 1];
    for &item in items {
        start[key(item) as usize + 1] += 1;
    }
    for k in 0..keys {
        start[k + 1] += start[k];
    }
    let mut sorted = vec![0; items.len()];
    for &item in items {
        let at = &mut start[key(item) as usize];
        sorted[*at as usize] = item;
        *at += 1;
    }
    sorted
}

/// A factored symmetric positive definite matrix, with the memory for factoring again and for solving.
pub struct Cholesky {
    pattern: Arc<SpdPattern>,
    /// Values of the pattern's upper triangle.
    values: Vec<f64>,
    /// Values of the factor, in faer's order.
    factor: Vec<f64>,
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
    /// Factors the matrix with the given pattern; `values` runs parallel to the pattern's triplets.
    ///
    /// # Errors
    /// As [`Self::refactor`], and [`LinalgError::TooLarge`] if the factor does not fit in memory.
    pub fn new(pattern: Arc<SpdPattern>, values: impl IntoIterator<Item = f64>) -> Result<Self, LinalgError> {
        let mut factor = Vec::new();
        factor.try_reserve_exact(pattern.factor_len()).map_err(|_| pattern.too_large())?;
        factor.resize(pattern.factor_len(), 0.0);
        let scratch = pattern.symbolic.as_ref().map_or(StackReq::EMPTY, |symbolic| {
            StackReq::any_of(&[
                symbolic.factorize_numeric_llt_scratch::<f64>(PAR, Spec::default()),
                symbolic.solve_in_place_scratch::<f64>(RIGHT_HAND_SIDES, PAR),
            ])
        });
        let memory = MemBuffer::try_new(scratch).map_err(|_| pattern.too_large())?;
        let sums = vec![0.0; pattern.row_idx.len()];
        let mut cholesky = Self { pattern, values: sums, factor, memory, state: Ok(()) };
        cholesky.refactor(values)?;
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

    /// Factors again with other values in the same places, in the same memory; the result is bit for bit that of a
    /// fresh factorisation.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] or [`LinalgError::EntryNotFinite`] for values that do not fit, and
    /// [`LinalgError::NotPositiveDefinite`] with the unknown at which no pivot was left. After an error there is no
    /// factor, and solving repeats the error.
    pub fn refactor(&mut self, values: impl IntoIterator<Item = f64>) -> Result<(), LinalgError> {
        self.state = self.sum_values(values).and_then(|()| self.factorise()).and_then(|()| self.check_pivots());
        self.state.clone()
    }

    /// The pattern.
    pub fn pattern(&self) -> &Arc<SpdPattern> {
        &self.pattern
    }

    /// Replaces each of three right-hand sides by its solution; row `i` of `rhs` belongs to unknown `i`. Allocates
    /// nothing.
    ///
    /// Costs about two operations per stored number of the factor and right-hand side.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`], [`LinalgError::SolutionNotFinite`] (then `rhs` is spoilt), or the error of the last
    /// factorisation.
    pub fn solve_in_place(&mut self, rhs: &mut [[f64; RIGHT_HAND_SIDES]]) -> Result<(), LinalgError> {
        self.state.clone()?;
        let unknowns = self.pattern.unknowns;
        if rhs.len() != unknowns {
            return Err(LinalgError::WrongCount { what: "right-hand side rows", expected: unknowns, found: rhs.len() });
        }
        if let Some(symbolic) = &self.pattern.symbolic {
            let columns = MatMut::from_row_major_slice_mut(rhs.as_flattened_mut(), unknowns, RIGHT_HAND_SIDES);
            let stack = MemStack::new(&mut self.memory);
            LltRef::new(symbolic, &self.factor).solve_in_place_with_conj(Conj::No, columns, PAR, stack);
        }
        // faer lets an infinite pivot pass, and an infinite right-hand side gives an infinite solution.
        match rhs.iter().position(|row| !row.iter().all(|x| x.is_finite())) {
            Some(unknown) => Err(LinalgError::SolutionNotFinite { unknown }),
            None => Ok(()),
        }
    }

    fn sum_values(&mut self, values: impl IntoIterator<Item = f64>) -> Result<(), LinalgError> {
        self.values.fill(0.0);
        let expected = self.pattern.place.len();
        let mut found = 0;
        for (entry, value) in values.into_iter().enumerate() {
            if !value.is_finite() {
                return Err(LinalgError::EntryNotFinite { entry });
            }
            if let Some(&place) = self.pattern.place.get(entry) {
                self.values[place as usize] += value;
            }
            found += 1;
        }
        if found == expected { Ok(()) } else { Err(LinalgError::WrongCount { what: "values", expected, found }) }
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
