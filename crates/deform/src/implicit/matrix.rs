//! The matrix of the first system.

use glam::DVec3;
use pliant_linalg::LinalgError;

use super::energy::{PAIR, Row};
use super::plan::{Lists, MOST_ENTRIES};
use super::rows::LaplacianRows;
use super::stencils::{NONE, Stencils};
use crate::patch::{Held, Patch};

/// The matrix of the energy, which is the same for x, y and z: upper triangle by columns.
pub(super) struct Matrix<'a> {
    stencils: &'a Stencils,
    laplacian: &'a LaplacianRows,
    unknown: &'a [u32],
    pairs: &'a Lists,
    rows: &'a [Row],
    own: Vec<f64>,
    columns: Vec<u32>,
    row_idx: Vec<u32>,
    values: Vec<f64>,
}

impl<'a> Matrix<'a> {
    /// `own`: of each gradient, the sum of the weights of the terms it is in.
    pub(super) fn new(
        stencils: &'a Stencils,
        laplacian: &'a LaplacianRows,
        unknown: &'a [u32],
        pairs: &'a Lists,
        rows: &'a [Row],
        own: Vec<f64>,
    ) -> Self {
        let (columns, row_idx, values) = (vec![0], Vec::new(), Vec::new());
        Self { stencils, laplacian, unknown, pairs, rows, own, columns, row_idx, values }
    }

    /// Ends of the columns, row of each entry, and its value.
    pub(super) fn into_parts(self) -> (Vec<u32>, Vec<u32>, Vec<f64>) {
        (self.columns, self.row_idx, self.values)
    }

    /// Column by column, each as the derivative of the energy along one unknown: its gradients, what they do to those they are compared
    /// with, and what those do to their points. No row of a pair is ever made; there are a hundred times as many as vertices.
    pub(super) fn assemble(&mut self, count: usize) -> Result<(), LinalgError> {
        let stencils = self.stencils;
        let in_gradients =
            (0..stencils.len() as u32).flat_map(|g| stencils.terms(g as usize).map(move |(k, _)| (g, k as u32)));
        let in_gradients = Lists::transposed(in_gradients, stencils.points.len());
        let backward = (0..stencils.len() as u32).flat_map(|g| self.pairs.get(g as usize).iter().map(move |&o| (g, o)));
        let backward = Lists::transposed(backward, stencils.len());
        let row_values: Vec<Vec<(u32, f64)>> = self.rows.iter().map(|row| self.row_values(row)).collect();
        let in_rows = (0..).zip(&row_values).flat_map(|(r, row)| row.iter().map(move |&(k, _)| (r, k)));
        let in_rows = Lists::transposed(in_rows, stencils.points.len());

        let mut forces = Sums::new(stencils.len(), DVec3::ZERO);
        let mut column = Sums::new(count, 0.0);
        for (k, &unknown) in self.unknown.iter().enumerate().filter(|(_, unknown)| **unknown != NONE) {
            for &g in in_gradients.get(k) {
                let Some((_, p)) = stencils.terms(g as usize).find(|&(other, _)| other == k) else { continue };
                *forces.at(g) += self.own[g as usize] * p;
                for &other in self.pairs.get(g as usize).iter().chain(backward.get(g as usize)) {
                    *forces.at(other) -= PAIR * p;
                }
            }
            for &g in &forces.touched {
                let force = forces.sums[g as usize];
                for (other, p) in stencils.terms(g as usize) {
                    // NONE is above every unknown.
                    if self.unknown[other] <= unknown {
                        *column.at(self.unknown[other]) += force.dot(p);
                    }
                }
            }
            forces.clear(DVec3::ZERO);
            for &r in in_rows.get(k) {
                let row = &row_values[r as usize];
                let value: f64 = row.iter().filter(|(other, _)| *other as usize == k).map(|(_, value)| value).sum();
                for &(other, factor) in row {
                    if self.unknown[other as usize] <= unknown {
                        *column.at(self.unknown[other as usize]) += value * factor;
                    }
                }
            }
            // Every column has its diagonal, even of a vertex without neighbours.
            column.at(unknown);
            column.touched.sort_unstable();
            self.row_idx.extend(&column.touched);
            self.values.extend(column.touched.iter().map(|&row| column.sums[row as usize]));
            column.clear(0.0);
            if self.row_idx.len() > MOST_ENTRIES {
                return Err(LinalgError::TooLarge { unknowns: count, entries: self.row_idx.len() });
            }
            self.columns.push(self.row_idx.len() as u32);
        }
        Ok(())
    }

    /// A row of `E_L` for one coordinate: Laplacian coordinates less those that the gradient makes of the rest ones.
    fn row_values(&self, row: &Row) -> Vec<(u32, f64)> {
        let mut values: Vec<(u32, f64)> = self.laplacian.row(row.vertex as usize).collect();
        if row.gradient != NONE {
            for (k, p) in self.stencils.terms(row.gradient as usize) {
                let value = -p.dot(row.rest);
                // Both lists start with the vertex and its neighbours in the same order, but a gradient may have points more.
                match values.iter_mut().find(|(other, _)| *other as usize == k) {
                    Some((_, sum)) => *sum += value,
                    None => values.push((k as u32, value)),
                }
            }
        }
        values
    }

    /// Springs of soft handles, relative to the mean diagonal entry.
    pub(super) fn add_springs(&mut self, patch: &Patch) -> Vec<(u32, f64)> {
        let ends = &self.columns[1..];
        let total: f64 = ends.iter().map(|&end| self.values[end as usize - 1]).sum();
        let mean = total / ends.len().max(1) as f64;
        // Vertices without neighbours alone make an empty matrix.
        let mean = if mean > 0.0 { mean } else { 1.0 };
        let mut springs = Vec::new();
        for (v, held) in patch.held.iter().enumerate() {
            if let Held::Spring { weight, .. } = held
                && self.unknown[v] != NONE
            {
                springs.push((v as u32, weight * mean));
                self.values[ends[self.unknown[v] as usize] as usize - 1] += weight * mean;
            }
        }
        springs
    }
}

/// Sparse sums over a range of numbers.
struct Sums<T> {
    sums: Vec<T>,
    is_touched: Vec<bool>,
    touched: Vec<u32>,
}

impl<T: Copy> Sums<T> {
    fn new(count: usize, zero: T) -> Self {
        Self { sums: vec![zero; count], is_touched: vec![false; count], touched: Vec::new() }
    }

    fn at(&mut self, i: u32) -> &mut T {
        if !std::mem::replace(&mut self.is_touched[i as usize], true) {
            self.touched.push(i);
        }
        &mut self.sums[i as usize]
    }

    fn clear(&mut self, zero: T) {
        for &i in &self.touched {
            self.sums[i as usize] = zero;
            self.is_touched[i as usize] = false;
        }
        self.touched.clear();
    }
}
