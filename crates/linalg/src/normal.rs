use crate::rows::{add, check};
use crate::{LinalgError, Partition, SparseRows};

/// The least-squares problem `min |A x - b|^2` over the free columns, the others given, and its normal equations
/// `N x_f = A_f^T (b - A_c x_c)` with `N = A_f^T A_f`.
#[derive(Debug)]
pub(crate) struct NormalEquations {
    pub(crate) a: SparseRows,
    partition: Partition,
    /// Column `k` of `A_f` is `offsets[k]..offsets[k + 1]` of `entries`: row, and place among the values of `a`.
    offsets: Vec<u32>,
    entries: Vec<(u32, u32)>,
}

impl NormalEquations {
    pub(crate) fn new(a: SparseRows, is_free: impl FnMut(usize) -> bool) -> Result<Self, LinalgError> {
        let (unknowns, entries) = (a.column_count(), a.values().len());
        if unknowns.max(entries).max(a.row_count()) > i32::MAX as usize {
            return Err(LinalgError::TooLarge { unknowns, entries });
        }
        let partition = Partition::new(unknowns, is_free)?;
        let free = partition.free().len();
        let mut offsets = vec![0u32; free + 1];
        for column in a.columns().iter().filter_map(|&col| partition.free_index(col as usize)) {
            offsets[column + 1] += 1;
        }
        for column in 0..free {
            offsets[column + 1] += offsets[column];
        }
        let mut cursor = offsets.clone();
        let mut entries = vec![(0, 0); offsets[free] as usize];
        for row in 0..a.row_count() {
            let places = a.row_range(row);
            for (place, &col) in places.clone().zip(&a.columns()[places]) {
                if let Some(column) = partition.free_index(col as usize) {
                    let at = &mut cursor[column];
                    entries[*at as usize] = (row as u32, place as u32);
                    *at += 1;
                }
            }
        }
        Ok(Self { a, partition, offsets, entries })
    }

    /// Number of unknowns: free columns.
    pub(crate) fn unknowns(&self) -> usize {
        self.partition.free().len()
    }

    /// The column behind an unknown.
    pub(crate) fn column(&self, unknown: usize) -> usize {
        self.partition.free().get(unknown).map_or(unknown, |&column| column as usize)
    }

    /// An error about an unknown, told of its column.
    pub(crate) fn named(&self, error: LinalgError) -> LinalgError {
        match error {
            LinalgError::NotPositiveDefinite { unknown } => {
                LinalgError::NotPositiveDefinite { unknown: self.column(unknown) }
            }
            LinalgError::SolutionNotFinite { unknown } => {
                LinalgError::SolutionNotFinite { unknown: self.column(unknown) }
            }
            other => other,
        }
    }

    /// Refuses values that are not finite and free columns without a value other than 0.
    pub(crate) fn check_values(&self) -> Result<(), LinalgError> {
        if let Some(entry) = self.a.values().iter().position(|value| !value.is_finite()) {
            return Err(LinalgError::EntryNotFinite { entry });
        }
        let empty = |k: &usize| self.entries_of(*k).iter().all(|&(_, place)| self.a.values()[place as usize] == 0.0);
        match (0..self.unknowns()).find(empty) {
            Some(k) => Err(LinalgError::NotPositiveDefinite { unknown: self.column(k) }),
            None => Ok(()),
        }
    }

    pub(crate) fn check_counts(&self, b: &[[f64; 3]], x: &[[f64; 3]]) -> Result<(), LinalgError> {
        check("right-hand side rows", self.a.row_count(), b.len())?;
        check("unknowns", self.a.column_count(), x.len())
    }

    /// The upper triangle of `N` by columns, as [`crate::SpdPattern::of_columns`] takes it.
    pub(crate) fn pattern(&self) -> Result<(Vec<u32>, Vec<u32>), LinalgError> {
        let unknowns = self.unknowns();
        let mut seen_by = vec![u32::MAX; unknowns];
        let (mut col_ptr, mut row_idx) = (vec![0], Vec::new());
        for k in 0..unknowns {
            let start = row_idx.len();
            seen_by[k] = k as u32;
            row_idx.push(k as u32);
            self.for_each_product(k, |other, _| {
                if other < k && seen_by[other] != k as u32 {
                    seen_by[other] = k as u32;
                    row_idx.push(other as u32);
                }
            });
            if row_idx.len() > i32::MAX as usize {
                return Err(LinalgError::TooLarge { unknowns, entries: row_idx.len() });
            }
            row_idx[start..].sort_unstable();
            col_ptr.push(row_idx.len() as u32);
        }
        Ok((col_ptr, row_idx))
    }

    /// The values of `N` at the places of [`Self::pattern`]; `sums` is zero, one per unknown, and is zero again afterwards.
    pub(crate) fn values(&self, col_ptr: &[u32], row_idx: &[u32], sums: &mut [f64], values: &mut [f64]) {
        for (k, ends) in col_ptr.windows(2).enumerate() {
            self.for_each_product(k, |other, product| sums[other] += product);
            // Rows above and below the diagonal alike were summed up; only the former are kept.
            let places = ends[0] as usize..ends[1] as usize;
            for (value, &row) in values[places.clone()].iter_mut().zip(&row_idx[places]) {
                *value = sums[row as usize];
            }
            self.for_each_product(k, |other, _| sums[other] = 0.0);
        }
    }

    /// The diagonal of `N`, of one unknown.
    pub(crate) fn diagonal(&self, unknown: usize) -> f64 {
        let mut sum = 0.0;
        self.for_each_product(unknown, |other, product| {
            if other == unknown {
                sum += product;
            }
        });
        sum
    }

    /// `r = b - A x`, `x` with a row per column.
    pub(crate) fn residual(&self, b: &[[f64; 3]], x: &[[f64; 3]], r: &mut [[f64; 3]]) {
        for (row, (r, b)) in r.iter_mut().zip(b).enumerate() {
            *r = *b;
            add(r, -1.0, self.a.dot(row, x));
        }
    }

    /// `out = A_f p`, `p` with a row per unknown.
    pub(crate) fn multiply(&self, p: &[[f64; 3]], out: &mut [[f64; 3]]) {
        for (row, out) in out.iter_mut().enumerate() {
            *out = [0.0; 3];
            let (columns, values) = self.a.row(row);
            for (&col, &value) in columns.iter().zip(values) {
                if let Some(k) = self.partition.free_index(col as usize) {
                    add(out, value, p[k]);
                }
            }
        }
    }

    /// `out = A_f^T r`, with a row per unknown.
    pub(crate) fn gather(&self, r: &[[f64; 3]], out: &mut [[f64; 3]]) {
        for (k, out) in out.iter_mut().enumerate() {
            *out = [0.0; 3];
            for &(row, place) in self.entries_of(k) {
                add(out, self.a.values()[place as usize], r[row as usize]);
            }
        }
    }

    /// `x_f += factor * dx`, per right-hand side.
    pub(crate) fn advance(&self, x: &mut [[f64; 3]], factor: [f64; 3], dx: &[[f64; 3]]) {
        for (&column, dx) in self.partition.free().iter().zip(dx) {
            for c in 0..3 {
                x[column as usize][c] += factor[c] * dx[c];
            }
        }
    }

    /// Sets `x_f` to 0.
    pub(crate) fn clear(&self, x: &mut [[f64; 3]]) {
        for &column in self.partition.free() {
            x[column as usize] = [0.0; 3];
        }
    }

    /// Copies `x_f` out of `x`.
    pub(crate) fn read(&self, x: &[[f64; 3]], free: &mut [[f64; 3]]) {
        for (free, &column) in free.iter_mut().zip(self.partition.free()) {
            *free = x[column as usize];
        }
    }

    /// The largest magnitude in `x_f`; not finite if one of them is not.
    pub(crate) fn size(&self, x: &[[f64; 3]]) -> f64 {
        largest(self.partition.free().iter().map(|&column| x[column as usize]))
    }

    fn entries_of(&self, unknown: usize) -> &[(u32, u32)] {
        &self.entries[self.offsets[unknown] as usize..self.offsets[unknown + 1] as usize]
    }

    /// Calls `each` with the unknowns and values that sum up to row `unknown` of `N`, in a fixed order.
    fn for_each_product(&self, unknown: usize, mut each: impl FnMut(usize, f64)) {
        for &(row, place) in self.entries_of(unknown) {
            let factor = self.a.values()[place as usize];
            let (columns, values) = self.a.row(row as usize);
            for (&col, &value) in columns.iter().zip(values) {
                if let Some(other) = self.partition.free_index(col as usize) {
                    each(other, factor * value);
                }
            }
        }
    }
}

/// The largest magnitude; not a number if one of them is not.
pub(crate) fn largest(rows: impl Iterator<Item = [f64; 3]>) -> f64 {
    rows.flatten().fold(0.0, |m, x| if x.abs() > m || x.is_nan() { x.abs() } else { m })
}
