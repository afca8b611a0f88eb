//! Sparse matrices in single precision, applied to rows of three numbers and a pad.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::SparseRows;

pub(super) type Row = [f32; 4];

/// Rows that one task takes.
const GRAIN: usize = 2048;

#[derive(Debug)]
pub(super) struct Csr {
    offsets: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f32>,
}

impl Csr {
    pub(super) fn of(rows: &SparseRows) -> Self {
        let offsets = (0..rows.row_count()).map(|i| rows.row_range(i).start as u32);
        let offsets = offsets.chain([rows.values().len() as u32]).collect();
        let values = rows.values().iter().map(|&x| x as f32).collect();
        Self { offsets, columns: rows.columns().to_vec(), values }
    }

    /// Calls `finish(i, (A x)_i, out_i)` for each row.
    fn each<T: Send>(&self, x: &[Row], out: &mut [T], finish: impl Fn(usize, Row, &mut T) + Sync) {
        out.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, out)| {
            Arch::new().dispatch(Rows { matrix: self, first: chunk * GRAIN, x, out, finish: &finish });
        });
    }

    /// `y = A x`
    pub(super) fn multiply(&self, x: &[Row], y: &mut [Row]) {
        self.each(x, y, |_, sum, y| *y = sum);
    }

    /// `y = A x`, in double precision from here on.
    pub(super) fn multiply_to_double(&self, x: &[Row], y: &mut [[f64; 3]]) {
        self.each(x, y, |_, sum, y| *y = std::array::from_fn(|k| f64::from(sum[k])));
    }

    /// `y = b - A x`
    pub(super) fn subtract_multiplied(&self, x: &[Row], b: &[Row], y: &mut [Row]) {
        self.each(x, y, |i, sum, y| *y = std::array::from_fn(|k| b[i][k] - sum[k]));
    }

    /// `y -= A x`
    pub(super) fn take_off(&self, x: &[Row], y: &mut [Row]) {
        self.each(x, y, |_, sum, y| *y = std::array::from_fn(|k| y[k] - sum[k]));
    }

    /// `y += A x`
    pub(super) fn add_multiplied(&self, x: &[Row], y: &mut [Row]) {
        self.each(x, y, |_, sum, y| *y = std::array::from_fn(|k| y[k] + sum[k]));
    }

    /// `y += A x`
    pub(super) fn add_multiplied_double(&self, x: &[[f64; 3]], y: &mut [Row]) {
        for (i, y) in y.iter_mut().enumerate() {
            let entries = self.offsets[i] as usize..self.offsets[i + 1] as usize;
            for (&j, &value) in self.columns[entries.clone()].iter().zip(&self.values[entries]) {
                for (y, &x) in y.iter_mut().zip(&x[j as usize]) {
                    *y += value * x as f32;
                }
            }
        }
    }
}

struct Rows<'a, T, F> {
    matrix: &'a Csr,
    first: usize,
    x: &'a [Row],
    out: &'a mut [T],
    finish: &'a F,
}

impl<T, F: Fn(usize, Row, &mut T)> WithSimd for Rows<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { matrix, first, x, out, finish } = self;
        let offsets = &matrix.offsets[first..first + out.len() + 1];
        for (k, (ends, out)) in offsets.windows(2).zip(out).enumerate() {
            let entries = ends[0] as usize..ends[1] as usize;
            let mut sum = Row::default();
            for (&j, &value) in matrix.columns[entries.clone()].iter().zip(&matrix.values[entries]) {
                for (sum, x) in sum.iter_mut().zip(x[j as usize]) {
                    *sum += value * x;
                }
            }
            finish(first + k, sum, out);
        }
    }
}

/// `y = factor D^-1 x`
pub(super) fn scale(inverse: &[f32], factor: f32, x: &[Row], y: &mut [Row]) {
    y.par_iter_mut().with_min_len(GRAIN).zip(x).zip(inverse).for_each(|((y, x), d)| *y = x.map(|x| factor * d * x));
}

/// `y = c + keep c + add D^-1 r`: the sum of a first term `c` and the second.
pub(super) fn next_term(inverse: &[f32], keep: f32, add: f32, r: &[Row], c: &[Row], y: &mut [Row]) {
    y.par_iter_mut().with_min_len(GRAIN).zip(r).zip(c).zip(inverse).for_each(|(((y, r), c), d)| {
        *y = std::array::from_fn(|k| (1.0 + keep) * c[k] + add * d * r[k]);
    });
}

/// `y += c + keep c + add D^-1 r`
pub(super) fn add_two_terms(inverse: &[f32], keep: f32, add: f32, r: &[Row], c: &[Row], y: &mut [Row]) {
    y.par_iter_mut().with_min_len(GRAIN).zip(r).zip(c).zip(inverse).for_each(|(((y, r), c), d)| {
        *y = std::array::from_fn(|k| y[k] + (1.0 + keep) * c[k] + add * d * r[k]);
    });
}
