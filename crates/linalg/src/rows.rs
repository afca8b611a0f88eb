use crate::LinalgError;

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
