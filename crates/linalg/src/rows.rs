use rayon::prelude::*;

use crate::LinalgError;

/// Rows that one task makes.
const GRAIN: usize = 512;

/// No row.
const NONE: u32 = u32::MAX;

/// A sparse matrix by rows, of any shape: each row is a list of columns and values.
///
/// Entries of a row at the same column add up. Columns need not be sorted.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseRows {
    column_count: usize,
    /// Row `i` is `offsets[i]..offsets[i + 1]` of the lists below.
    offsets: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SparseRows {
    /// A matrix with `column_count` columns and no row yet.
    pub fn new(column_count: usize) -> Self {
        Self { column_count, offsets: vec![0], columns: Vec::new(), values: Vec::new() }
    }

    /// Adds a row of `(column, value)`.
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`] for the first column there is not; then no row is added. Its `entry` counts the entries of
    /// all rows.
    pub fn push_row(&mut self, entries: impl IntoIterator<Item = (u32, f64)>) -> Result<(), LinalgError> {
        let start = self.columns.len();
        for (col, value) in entries {
            if col as usize >= self.column_count {
                let (entry, row) = (self.columns.len(), self.row_count() as u32);
                self.columns.truncate(start);
                self.values.truncate(start);
                return Err(LinalgError::IndexOutOfRange { entry, row, col, unknowns: self.column_count });
            }
            self.columns.push(col);
            self.values.push(value);
        }
        self.offsets.push(self.columns.len());
        Ok(())
    }

    /// A matrix whose rows are made in parallel: `row(i, entries)` puts those of row `i` into an empty list.
    ///
    /// # Errors
    /// As [`Self::push_row`], for the first row with such a column.
    pub fn of_rows(
        column_count: usize,
        row_count: usize,
        row: impl Fn(usize, &mut Vec<(u32, f64)>) + Sync,
    ) -> Result<Self, LinalgError> {
        let made = Self::in_parallel(column_count, row_count, Vec::new, |entries, i, columns, values| {
            entries.clear();
            row(i, entries);
            columns.extend(entries.iter().map(|&(column, _)| column));
            values.extend(entries.iter().map(|&(_, value)| value));
        });
        match made.columns.iter().position(|&col| col as usize >= column_count) {
            None => Ok(made),
            Some(entry) => {
                let (row, col) = (made.offsets.partition_point(|&at| at <= entry) as u32 - 1, made.columns[entry]);
                Err(LinalgError::IndexOutOfRange { entry, row, col, unknowns: column_count })
            }
        }
    }

    /// Rows of columns and values that `make(scratch, i, columns, values)` adds to lists with rows before.
    fn in_parallel<S>(
        column_count: usize,
        row_count: usize,
        scratch: impl Fn() -> S + Sync + Send,
        make: impl Fn(&mut S, usize, &mut Vec<u32>, &mut Vec<f64>) + Sync,
    ) -> Self {
        let tasks = (0..row_count.div_ceil(GRAIN)).into_par_iter();
        let made = tasks.map_init(scratch, |scratch, task| {
            let (mut ends, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
            for row in task * GRAIN..((task + 1) * GRAIN).min(row_count) {
                make(scratch, row, &mut columns, &mut values);
                ends.push(columns.len());
            }
            (ends, columns, values)
        });
        let made: Vec<(Vec<usize>, Vec<u32>, Vec<f64>)> = made.collect();
        let mut all = Self::new(column_count);
        let count = made.iter().map(|(_, columns, _)| columns.len()).sum();
        all.offsets.reserve_exact(row_count);
        all.columns.reserve_exact(count);
        all.values.reserve_exact(count);
        for (ends, columns, values) in made {
            let before = all.columns.len();
            all.offsets.extend(ends.iter().map(|end| before + end));
            all.columns.extend(columns);
            all.values.extend(values);
        }
        all
    }

    /// The transpose; each of its rows has increasing columns.
    pub fn transpose(&self) -> Self {
        let mut offsets = vec![0; self.column_count + 1];
        self.columns.iter().for_each(|&j| offsets[j as usize + 1] += 1);
        for j in 0..self.column_count {
            offsets[j + 1] += offsets[j];
        }
        let mut next = offsets.clone();
        let (mut columns, mut values) = (vec![0; self.columns.len()], vec![0.0; self.columns.len()]);
        for i in 0..self.row_count() {
            let (of_row, numbers) = self.row(i);
            for (&j, &value) in of_row.iter().zip(numbers) {
                let at = next[j as usize];
                (columns[at], values[at]) = (i as u32, value);
                next[j as usize] += 1;
            }
        }
        Self { column_count: self.row_count(), offsets, columns, values }
    }

    /// The product with another matrix, row by row (Gustavson 1978), in parallel; each row has increasing columns.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] if `other` has not one row for each column.
    pub fn product(&self, other: &Self) -> Result<Self, LinalgError> {
        let (expected, found) = (self.column_count, other.row_count());
        if expected != found {
            return Err(LinalgError::WrongCount { what: "rows of the other factor", expected, found });
        }
        let count = other.column_count;
        let scratch = || (vec![0.0; count], vec![NONE; count]);
        Ok(Self::in_parallel(count, self.row_count(), scratch, |(sums, seen), row, columns, values| {
            let start = columns.len();
            let (inner, factors) = self.row(row);
            for (&k, &factor) in inner.iter().zip(factors) {
                let (places, numbers) = other.row(k as usize);
                for (&j, &number) in places.iter().zip(numbers) {
                    if seen[j as usize] != row as u32 {
                        (seen[j as usize], sums[j as usize]) = (row as u32, 0.0);
                        columns.push(j);
                    }
                    sums[j as usize] += factor * number;
                }
            }
            columns[start..].sort_unstable();
            values.extend(columns[start..].iter().map(|&j| sums[j as usize]));
        }))
    }

    /// `P^T A P` for this matrix `A`.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`] if sizes do not fit.
    pub fn galerkin(&self, p: &Self) -> Result<Self, LinalgError> {
        p.transpose().product(&self.product(p)?)
    }

    /// Number of columns.
    pub fn column_count(&self) -> usize {
        self.column_count
    }

    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Columns and values of a row.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.offsets[row]..self.offsets[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Where the entries of a row are in [`Self::values`].
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row_range(&self, row: usize) -> std::ops::Range<usize> {
        self.offsets[row]..self.offsets[row + 1]
    }

    /// Columns of all entries, row by row.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    /// Values of all entries, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The same, to be changed.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// `out = A x` for three right-hand sides: one row of `x` per column, one of `out` per row.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`]; then nothing is changed.
    pub fn multiply(&self, x: &[[f64; 3]], out: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        check("rows to multiply", self.column_count, x.len())?;
        check("rows of the product", self.row_count(), out.len())?;
        for (row, out) in out.iter_mut().enumerate() {
            *out = self.dot(row, x);
        }
        Ok(())
    }

    /// `out = A^T y` for three right-hand sides: one row of `y` per row, one of `out` per column.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`]; then nothing is changed.
    pub fn transpose_multiply(&self, y: &[[f64; 3]], out: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        check("rows to multiply", self.row_count(), y.len())?;
        check("rows of the product", self.column_count, out.len())?;
        out.fill([0.0; 3]);
        for (row, &y) in y.iter().enumerate() {
            let (columns, values) = self.row(row);
            for (&col, &value) in columns.iter().zip(values) {
                add(&mut out[col as usize], value, y);
            }
        }
        Ok(())
    }

    /// Row `row` of `A x`; `x` has a row per column.
    #[inline]
    pub(crate) fn dot(&self, row: usize, x: &[[f64; 3]]) -> [f64; 3] {
        let (columns, values) = self.row(row);
        let mut sum = [0.0; 3];
        for (&col, &value) in columns.iter().zip(values) {
            add(&mut sum, value, x[col as usize]);
        }
        sum
    }
}

/// `sum += factor * x`.
#[inline]
pub(crate) fn add(sum: &mut [f64; 3], factor: f64, x: [f64; 3]) {
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum += factor * x;
    }
}

pub(crate) fn check(what: &'static str, expected: usize, found: usize) -> Result<(), LinalgError> {
    if expected == found { Ok(()) } else { Err(LinalgError::WrongCount { what, expected, found }) }
}
