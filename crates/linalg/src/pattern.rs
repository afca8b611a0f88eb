use faer::Side;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};

use crate::{LinalgError, Triplet};

/// The pattern of a symmetric matrix with a fill-reducing order (AMD) and the pattern of its Cholesky factor.
///
/// The costliest part of a first factorisation; shared by all matrices with entries in the same places.
#[derive(Debug)]
pub struct SpdPattern {
    pub(crate) unknowns: usize,
    /// Upper triangle by columns, rows increasing; the diagonal is always there and ends its column.
    pub(crate) col_ptr: Vec<u32>,
    pub(crate) row_idx: Vec<u32>,
    /// For each entry given, where in `row_idx` it is added; `None` if they were given in that order.
    place: Option<Vec<u32>>,
    /// `None` for a system without unknowns.
    pub(crate) symbolic: Option<SymbolicCholesky<u32>>,
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
        Self::analyse(unknowns, col_ptr, row_idx, Some(place))
    }

    /// Analyses the matrix given by the columns of its upper triangle: the rows of column `j` are
    /// `row_idx[col_ptr[j]..col_ptr[j + 1]]`, increasing and ending with `j` itself. Values then run parallel to `row_idx`.
    ///
    /// For those who have their entries in this order already: nothing is sorted.
    ///
    /// # Errors
    /// [`LinalgError::BadColumn`] for the first column that is not of this form, and [`LinalgError::TooLarge`] as [`Self::new`].
    pub fn of_columns(col_ptr: Vec<u32>, row_idx: Vec<u32>) -> Result<Self, LinalgError> {
        let unknowns = col_ptr.len().saturating_sub(1);
        if unknowns.saturating_add(row_idx.len()) > i32::MAX as usize {
            return Err(LinalgError::TooLarge { unknowns, entries: row_idx.len() });
        }
        let mut end = 0;
        for (col, ends) in col_ptr.windows(2).enumerate() {
            let rows = row_idx.get(ends[0] as usize..ends[1] as usize).unwrap_or_default();
            let increasing = rows.windows(2).all(|pair| pair[0] < pair[1]);
            if !(ends[0] == end && rows.last() == Some(&(col as u32)) && increasing) {
                return Err(LinalgError::BadColumn { col });
            }
            end = ends[1];
        }
        if end as usize != row_idx.len() {
            return Err(LinalgError::BadColumn { col: unknowns });
        }
        Self::analyse(unknowns, col_ptr, row_idx, None)
    }

    fn analyse(
        unknowns: usize,
        col_ptr: Vec<u32>,
        row_idx: Vec<u32>,
        place: Option<Vec<u32>>,
    ) -> Result<Self, LinalgError> {
        let symbolic = if unknowns == 0 {
            None
        } else {
            let matrix = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &col_ptr, None, &row_idx);
            let params = CholeskySymbolicParams::default();
            let symbolic = factorize_symbolic_cholesky(matrix, Side::Upper, SymmetricOrdering::Amd, params);
            Some(symbolic.map_err(|_| LinalgError::TooLarge { unknowns, entries: row_idx.len() })?)
        };
        Ok(Self { unknowns, col_ptr, row_idx, place, symbolic })
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Numbers stored for the factor of the whole matrix.
    pub fn factor_len(&self) -> usize {
        self.symbolic.as_ref().map_or(0, SymbolicCholesky::len_val)
    }

    /// Number of entries given.
    pub(crate) fn entries(&self) -> usize {
        self.place.as_ref().map_or(self.row_idx.len(), Vec::len)
    }

    /// Where in `row_idx` an entry is added.
    pub(crate) fn place(&self, entry: usize) -> Option<usize> {
        match &self.place {
            Some(place) => place.get(entry).map(|&place| place as usize),
            None => (entry < self.row_idx.len()).then_some(entry),
        }
    }

    /// The unknown behind row `k` of the permuted matrix.
    pub(crate) fn unknown_of_pivot(&self, k: usize) -> usize {
        match self.symbolic.as_ref().and_then(SymbolicCholesky::perm) {
            Some(perm) => perm.arrays().0.get(k).map_or(k, |&unknown| unknown as usize),
            None => k,
        }
    }

    /// Where the diagonal entry of an unknown is: last in its column of the upper triangle.
    pub(crate) fn diagonal_place(&self, unknown: usize) -> usize {
        self.col_ptr[unknown + 1] as usize - 1
    }

    pub(crate) fn too_large(&self) -> LinalgError {
        LinalgError::TooLarge { unknowns: self.unknowns, entries: self.entries() }
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
