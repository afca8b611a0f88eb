//! The inverse of the matrix of the global step, exact or nearly.

use std::sync::Arc;

use pliant_linalg::{Cholesky, LinalgError, Multigrid, SparseRows};
use rayon::prelude::*;

use super::GlobalSolver;
use crate::DeformError;
use crate::arap::cells::{Cells, NONE};
use crate::arap::roles::Roles;
use crate::arap::steps::Row;

/// Rows that one task converts.
const GRAIN: usize = 2048;

/// What takes a residual to a change of the unknowns.
pub(super) enum Inverse {
    Factor {
        factor: Cholesky,
        /// By slot of the region.
        rows: Vec<[f64; 3]>,
    },
    Multigrid {
        multigrid: Multigrid,
        /// By unknown.
        rhs: Vec<[f32; 4]>,
        solution: Vec<[f32; 4]>,
    },
}

impl Inverse {
    pub(super) fn new(solver: GlobalSolver, cells: &Cells, roles: &Roles) -> Result<Self, DeformError> {
        let made = match solver {
            GlobalSolver::Factor => factor(cells, roles),
            GlobalSolver::Multigrid => multigrid(cells, roles).map_err(|error| match error {
                // In the numbering of the unknowns.
                LinalgError::NotPositiveDefinite { unknown } => {
                    let slot = roles.unknowns.as_slice().get(unknown).map_or(usize::MAX, |&slot| slot as usize);
                    LinalgError::NotPositiveDefinite { unknown: slot }
                }
                other => other,
            }),
        };
        made.map_err(|error| DeformError::of_system(error, &cells.vertices))
    }

    /// Replaces `rows`, by unknown, by what the inverse makes of them.
    pub(super) fn apply(&mut self, roles: &Roles, rows: &mut [Row]) -> Result<(), LinalgError> {
        let unknowns = roles.unknowns.as_slice();
        match self {
            Self::Factor { factor, rows: scratch } => {
                for (&slot, &[x, y, z, _]) in unknowns.iter().zip(&*rows) {
                    scratch[slot as usize] = [x, y, z];
                }
                factor.solve_in_place(scratch)?;
                for (&slot, row) in unknowns.iter().zip(rows) {
                    let [x, y, z] = scratch[slot as usize];
                    *row = [x, y, z, 0.0];
                }
            }
            Self::Multigrid { multigrid, rhs, solution } => {
                // Single precision has not the range of double: a power of two takes the largest number near 1.
                let largest =
                    rows.par_iter().with_min_len(GRAIN).map(|row| row.iter().fold(0.0, |m: f64, x| m.max(x.abs())));
                let largest = largest.reduce(|| 0.0, f64::max);
                if largest == 0.0 {
                    return Ok(());
                }
                let unit = f64::from_bits(largest.clamp(f64::MIN_POSITIVE, 1e300).to_bits() & 0x7FF0_0000_0000_0000);
                let scale = 1.0 / unit;
                let pairs = rhs.par_iter_mut().zip(&*rows).with_min_len(GRAIN);
                pairs.for_each(|(to, from)| *to = from.map(|x| (scale * x) as f32));
                multigrid.apply(rhs, solution)?;
                let pairs = rows.par_iter_mut().zip(&*solution).with_min_len(GRAIN);
                pairs.for_each(|(to, from)| *to = from.map(|x| unit * f64::from(x)));
            }
        }
        Ok(())
    }
}

fn factor(cells: &Cells, roles: &Roles) -> Result<Inverse, LinalgError> {
    let free = |slot: usize| roles.unknowns.contains(slot);
    let factor = Cholesky::of_block(Arc::new(cells.pattern()?), cells.laplacian(&roles.diagonal), free)?;
    Ok(Inverse::Factor { factor, rows: vec![[0.0; 3]; cells.roi] })
}

fn multigrid(cells: &Cells, roles: &Roles) -> Result<Inverse, LinalgError> {
    let zeros = || vec![[0.0; 4]; roles.unknowns.as_slice().len()];
    let multigrid = Multigrid::new(&matrix(cells, roles)?)?;
    Ok(Inverse::Multigrid { multigrid, rhs: zeros(), solution: zeros() })
}

/// The matrix of the global step, by unknowns.
pub(super) fn matrix(cells: &Cells, roles: &Roles) -> Result<SparseRows, LinalgError> {
    let unknowns = roles.unknowns.as_slice();
    let mut unknown_of = vec![NONE; cells.vertices.len()];
    for (unknown, &slot) in (0..).zip(unknowns) {
        unknown_of[slot as usize] = unknown;
    }
    SparseRows::of_rows(unknowns.len(), unknowns.len(), |unknown, entries| {
        let slot = unknowns[unknown] as usize;
        let row = cells.neighbours(slot).iter().zip(cells.pulls(slot).0);
        let row = row.map(|(&other, [.., weight])| (unknown_of[other as usize], -weight));
        entries.push((unknown as u32, roles.diagonal[slot]));
        entries.extend(row.filter(|(other, _)| *other != NONE));
    })
}
