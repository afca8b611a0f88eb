//! The local step with the energy, and the residual of the global one.

use pliant_mesh::threads::CHUNK;
use pliant_mesh::{LANES, RotationBatch};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::arap::cells::Cells;
use crate::arap::roles::Roles;
use crate::arap::steps::{Columns, Row, add, covariance, padded, subtract};

/// Fits the rotations of all cells and returns the sum of `tr(R^T S)` over them; `partial` has a place for each [`CHUNK`] of cells.
pub(super) fn fit(cells: &Cells, roles: &Roles, pose: &[Row], rotations: &mut [Columns], partial: &mut [f64]) -> f64 {
    let chunks = rotations.par_chunks_mut(CHUNK).zip(&mut *partial).enumerate();
    chunks.for_each(|(chunk, (rotations, sum))| {
        let slots = roles.fitted.in_chunk(chunk);
        *sum = Arch::new().dispatch(Fit { cells, slots, first: chunk * CHUNK, pose, rotations });
    });
    partial.iter().sum()
}

struct Fit<'a> {
    cells: &'a Cells,
    slots: &'a [u32],
    first: usize,
    pose: &'a [Row],
    rotations: &'a mut [Columns],
}

impl WithSimd for Fit<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { cells, slots, first, pose, rotations } = self;
        let mut batch = RotationBatch::default();
        let mut covariances = [Columns::default(); LANES];
        let mut sum = Row::default();
        for slots in slots.chunks(LANES) {
            for (lane, (&slot, s)) in slots.iter().zip(&mut covariances).enumerate() {
                *s = covariance(cells, slot as usize, pose);
                batch.set(lane, &s.map(|[x, y, z, _]| [x, y, z]));
            }
            batch.fit(slots.len());
            for (lane, (&slot, s)) in slots.iter().zip(&covariances).enumerate() {
                let rotation = padded(batch.get(lane));
                for (r, s) in rotation.iter().zip(s) {
                    for ((sum, r), s) in sum.iter_mut().zip(r).zip(s) {
                        *sum += r * s;
                    }
                }
                rotations[slot as usize - first] = rotation;
            }
        }
        sum.iter().sum()
    }
}

/// Writes the residual `b - A x` of each unknown for the given rotations, without springs, and returns the sum of `w |e'|^2` over the edges with an
/// end that is unknown; `partial` has a place for each [`CHUNK`] of unknowns.
pub(super) fn residual(
    cells: &Cells,
    roles: &Roles,
    pose: &[Row],
    rotations: &[Columns],
    residual: &mut [Row],
    partial: &mut [f64],
) -> f64 {
    let unknowns = roles.unknowns.as_slice().par_chunks(CHUNK);
    residual.par_chunks_mut(CHUNK).zip(unknowns).zip(&mut *partial).for_each(|((residual, slots), sum)| {
        *sum = Arch::new().dispatch(Residual { cells, roles, slots, pose, rotations, residual });
    });
    partial.iter().sum()
}

struct Residual<'a> {
    cells: &'a Cells,
    roles: &'a Roles,
    slots: &'a [u32],
    pose: &'a [Row],
    rotations: &'a [Columns],
    residual: &'a mut [Row],
}

impl WithSimd for Residual<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { cells, roles, slots, pose, rotations, residual } = self;
        let mut energy = Row::default();
        for (&slot, out) in slots.iter().zip(residual) {
            let j = slot as usize;
            let (pulls, own) = cells.pulls(j);
            let centre = pose[j];
            let mut sum = Row::default();
            for (&column, c) in rotations[j].iter().zip(own) {
                add(&mut sum, column, c);
            }
            for (&i, pull) in cells.neighbours(j).iter().zip(pulls) {
                let i = i as usize;
                for (&column, c) in rotations[i].iter().zip(*pull) {
                    add(&mut sum, column, c);
                }
                let edge = subtract(pose[i], centre);
                let weight = pull[3];
                add(&mut sum, edge, weight);
                // An edge between two unknowns is met from both of its ends.
                let share = if roles.unknowns.has(i) { 0.5 * weight } else { weight };
                for (energy, x) in energy.iter_mut().zip(edge) {
                    *energy += share * x * x;
                }
            }
            *out = sum;
        }
        energy.iter().sum()
    }
}
