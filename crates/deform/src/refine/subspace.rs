//! The energy minimised over the motions of a cage.
//!
//! With the rotations held, the energy along `x + W dy` is least where `(W^T L W) dy = W^T r`, `r` being the residual of the global step at
//! `x`. The frames that carry the cage's motion stay as they are in `x`, and vertices that are held have no row in `W`, so handles stay at
//! their goals. (Huang, Shi, Liu, Zhou, Wei, Teng, Bao, Guo, Shum. *Subspace Gradient Domain Mesh Deformation.* SIGGRAPH 2006, section 4,
//! for the reduction to a cage by a linear map.)

use pliant_linalg::{Cholesky, LinalgError, SparseRows};

use super::inverse::matrix;
use crate::DeformError;
use crate::arap::cells::Cells;
use crate::arap::roles::Roles;
use crate::arap::steps::Row;

/// Share of its diagonal that is added to the matrix: columns of `W` may depend on each other once held rows are left out. Shortens a step
/// along others by as little.
const REGULAR: f64 = 1e-8;

pub(super) struct Subspace {
    /// `W` by unknowns, without columns that are 0, and its transpose.
    rows: SparseRows,
    columns: SparseRows,
    factor: Cholesky,
    /// Scratch: by unknown, by column.
    fine: Vec<[f64; 3]>,
    coarse: Vec<[f64; 3]>,
}

impl Subspace {
    /// `row` gives columns below `columns` and weights for a mesh vertex. `None` if no unknown has any weight.
    pub(super) fn new<'a>(
        cells: &Cells,
        roles: &Roles,
        columns: usize,
        row: impl Fn(usize) -> (&'a [u32], &'a [f32]),
    ) -> Result<Option<Self>, DeformError> {
        let all = weights(cells, roles, columns, row)?;
        let mut used = vec![false; columns];
        for (&column, &weight) in all.columns().iter().zip(all.values()) {
            used[column as usize] |= weight != 0.0;
        }
        let mut number = vec![0u32; columns];
        let mut count = 0;
        for (number, _) in number.iter_mut().zip(&used).filter(|(_, used)| **used) {
            *number = count;
            count += 1;
        }
        if count == 0 {
            return Ok(None);
        }
        let mut rows = SparseRows::new(count as usize);
        let build = |rows: &mut SparseRows| -> Result<Cholesky, LinalgError> {
            for i in 0..all.row_count() {
                let (columns, values) = all.row(i);
                let entries = columns.iter().zip(values).filter(|(column, _)| used[**column as usize]);
                rows.push_row(entries.map(|(&column, &value)| (number[column as usize], value)))?;
            }
            let mut reduced = matrix(cells, roles)?.galerkin(rows)?;
            for i in 0..reduced.row_count() {
                let range = reduced.row_range(i);
                if let Ok(at) = reduced.row(i).0.binary_search(&(i as u32)) {
                    reduced.values_mut()[range.start + at] *= 1.0 + REGULAR;
                }
            }
            Cholesky::of_rows(&reduced)
        };
        let factor = build(&mut rows).map_err(|error| match error {
            LinalgError::NotPositiveDefinite { unknown } => {
                let column = used.iter().enumerate().filter(|(_, used)| **used).nth(unknown);
                DeformError::DegenerateSubspace { column: column.map_or(unknown, |(column, _)| column) }
            }
            other => DeformError::TooLarge(other),
        })?;
        let (fine, coarse) = (vec![[0.0; 3]; rows.row_count()], vec![[0.0; 3]; count as usize]);
        Ok(Some(Self { columns: rows.transpose(), rows, factor, fine, coarse }))
    }

    /// Replaces residuals by the best motion in the subspace.
    pub(super) fn apply(&mut self, rows: &mut [Row]) -> Result<(), LinalgError> {
        for (fine, &[x, y, z, _]) in self.fine.iter_mut().zip(&*rows) {
            *fine = [x, y, z];
        }
        self.columns.multiply(&self.fine, &mut self.coarse)?;
        self.factor.solve_in_place(&mut self.coarse)?;
        self.rows.multiply(&self.coarse, &mut self.fine)?;
        for (row, &[x, y, z]) in rows.iter_mut().zip(&self.fine) {
            *row = [x, y, z, 0.0];
        }
        Ok(())
    }
}

/// `W` with a row for each unknown.
fn weights<'a>(
    cells: &Cells,
    roles: &Roles,
    columns: usize,
    row: impl Fn(usize) -> (&'a [u32], &'a [f32]),
) -> Result<SparseRows, DeformError> {
    let mut rows = SparseRows::new(columns);
    for &slot in roles.unknowns.as_slice() {
        let (indices, weights) = row(cells.vertices[slot as usize] as usize);
        for (&column, weight) in indices.iter().zip(weights) {
            let column = column as usize;
            if column >= columns {
                return Err(DeformError::WrongCount { what: "cage vertices", expected: column + 1, found: columns });
            }
            if !weight.is_finite() {
                return Err(DeformError::DegenerateSubspace { column });
            }
        }
        let entries = indices.iter().copied().zip(weights.iter().map(|&w| f64::from(w)));
        rows.push_row(entries).map_err(DeformError::TooLarge)?;
    }
    Ok(rows)
}
