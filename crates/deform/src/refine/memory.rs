//! What the last steps taught about the curvature of the energy.
//!
//! - Nocedal, Wright. *Numerical Optimization*, 2nd ed. 2006, Alg. 7.4: the two loops of L-BFGS, here by inner products, so that each
//!   of the stored differences is read twice a direction.
//! - Liu, Bouaziz, Kavan. *Quasi-Newton Methods for Real-Time Simulation of Hyperelastic Materials.* ACM TOG 36(3), 2017: the inverse
//!   of the Laplacian as what L-BFGS starts from.

use rayon::prelude::*;

use crate::arap::steps::Row;

/// Steps that are remembered.
const WINDOW: usize = 8;

/// Rows that one task sums; fixed, so that sums do not depend on the number of threads.
const GRAIN: usize = 2048;

/// Differences in single precision: they only shape directions.
type Short = [f32; 4];

type Sums = [f64; WINDOW];

/// Differences of positions `s` and of gradients `y` of the last steps.
pub(super) struct Memory {
    /// By place in the window, then by unknown.
    s: Vec<Vec<Short>>,
    y: Vec<Vec<Short>>,
    /// `s_i . y_j` by place, where `i` is not newer than `j`.
    gram: [Sums; WINDOW],
    /// Places, oldest first.
    order: [usize; WINDOW],
    known: usize,
    /// Scratch: partial sums.
    partial: Vec<Sums>,
}

impl Memory {
    pub(super) fn new(unknowns: usize) -> Self {
        // Each by itself: clones would be written at once, zeros are when they are needed.
        let columns = || (0..WINDOW).map(|_| vec![Short::default(); unknowns]).collect();
        Self {
            s: columns(),
            y: columns(),
            gram: [Sums::default(); WINDOW],
            order: std::array::from_fn(|k| k),
            known: 0,
            partial: vec![Sums::default(); unknowns.div_ceil(GRAIN)],
        }
    }

    pub(super) fn forget(&mut self) {
        self.known = 0;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.known == 0
    }

    /// Notes a step from `before` to `after` that took the negative gradient from `from` to `to`.
    ///
    /// One along which the gradient does not grow, or is too large or small for single precision, is left out.
    pub(super) fn note(&mut self, before: &[Row], after: impl Fn(usize) -> Row + Sync, from: &[Row], to: &[Row]) {
        if self.known == WINDOW {
            self.order.rotate_left(1);
            self.known -= 1;
        }
        let at = self.order[self.known];
        let short = |a: Row, b: Row| -> Short { std::array::from_fn(|k| (a[k] - b[k]) as f32) };
        let pairs = self.s[at].par_iter_mut().zip(&mut self.y[at]).enumerate().with_min_len(GRAIN);
        pairs.for_each(|(k, (s, y))| (*s, *y) = (short(after(k), before[k]), short(from[k], to[k])));
        let steps = by_age(&self.s, &self.order);
        let products = dots(&steps[..=self.known], &self.y[at], &mut self.partial);
        if products[self.known] > 0.0 && products.iter().all(|p| p.is_finite()) {
            for (&place, product) in self.order.iter().zip(products) {
                self.gram[place][at] = product;
            }
            self.known += 1;
        }
    }

    /// First half: `q = residual - sum a y`, with the coefficients `a`, by age.
    pub(super) fn reduce(&mut self, residual: &[Row], q: &mut [Row]) -> Sums {
        let steps = by_age(&self.s, &self.order);
        let mut a = dots(&steps[..self.known], residual, &mut self.partial);
        for i in (0..self.known).rev() {
            let newer: f64 = (i + 1..self.known).map(|k| a[k] * self.product(i, k)).sum();
            a[i] = (a[i] - newer) / self.product(i, i);
        }
        let columns = by_age(&self.y, &self.order);
        q.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, q)| {
            q.copy_from_slice(&residual[chunk * GRAIN..][..q.len()]);
            add_columns(&columns[..self.known], &a.map(|a| -a), chunk, q);
        });
        a
    }

    /// Second half: makes of the preconditioned `q` the direction.
    pub(super) fn restore(&mut self, a: &Sums, direction: &mut [Row]) {
        let columns = by_age(&self.y, &self.order);
        let t = dots(&columns[..self.known], direction, &mut self.partial);
        let mut c = Sums::default();
        for i in 0..self.known {
            let older: f64 = (0..i).map(|k| c[k] * self.product(k, i)).sum();
            c[i] = a[i] - (t[i] + older) / self.product(i, i);
        }
        let columns = by_age(&self.s, &self.order);
        direction.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, rows)| {
            add_columns(&columns[..self.known], &c, chunk, rows);
        });
    }

    /// `s_i . y_k`, by age.
    fn product(&self, i: usize, k: usize) -> f64 {
        self.gram[self.order[i]][self.order[k]]
    }
}

/// The columns that are in use, oldest first, and places after them.
fn by_age<'a>(columns: &'a [Vec<Short>], order: &[usize; WINDOW]) -> [&'a [Short]; WINDOW] {
    order.map(|place| columns[place].as_slice())
}

/// The inner products of the columns with `x`, by chunks in a fixed order.
fn dots<T: Copy + Into<f64> + Sync>(columns: &[&[Short]], x: &[[T; 4]], partial: &mut [Sums]) -> Sums {
    partial.par_iter_mut().zip(x.par_chunks(GRAIN)).enumerate().for_each(|(chunk, (sums, x))| {
        *sums = Sums::default();
        for (sum, column) in sums.iter_mut().zip(columns) {
            let mut lanes = Row::default();
            for (c, x) in column[chunk * GRAIN..].iter().zip(x) {
                for ((lane, &c), &x) in lanes.iter_mut().zip(c).zip(x) {
                    *lane += f64::from(c) * x.into();
                }
            }
            *sum = lanes.iter().sum();
        }
    });
    partial.iter().fold(Sums::default(), |total, sums| std::array::from_fn(|k| total[k] + sums[k]))
}

/// `rows += sum_k factors_k columns_k`
fn add_columns(columns: &[&[Short]], factors: &Sums, chunk: usize, rows: &mut [Row]) {
    for (column, factor) in columns.iter().zip(factors) {
        for (row, c) in rows.iter_mut().zip(&column[chunk * GRAIN..]) {
            for (row, &c) in row.iter_mut().zip(c) {
                *row += factor * f64::from(c);
            }
        }
    }
}
