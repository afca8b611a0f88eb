//! The two steps of an iteration, and the energy they lower.

use glam::{DMat3, DVec3};
use pliant_linalg::{Cholesky, LinalgError};
use pliant_mesh::{best_rotation, outer};
use rayon::prelude::*;

use super::cells::{Cells, NONE};

/// Cells or rows below which a thread is not worth its start.
const GRAIN: usize = 256;

/// Terms whose energy is summed in one go; fixed, so that the sum does not depend on the number of threads.
pub(super) const ENERGY_CHUNK: usize = 2048;

/// An unknown drawn to a goal.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spring {
    pub(super) slot: u32,
    pub(super) handle: u32,
    /// What it adds to the matrix's diagonal.
    pub(super) stiffness: f64,
    /// How much its goal counts where a hard one counts 1.
    pub(super) grip: f64,
}

/// The local step: for each cell the rotation that best takes its rest edges to those of `pose`.
pub(super) fn fit_rotations(cells: &Cells, pose: &[DVec3], rotations: &mut [DMat3]) {
    rotations.par_iter_mut().enumerate().with_min_len(GRAIN).for_each(|(i, rotation)| {
        let row = cells.row(i);
        let mut s = DMat3::ZERO;
        for (&j, &c) in cells.neighbours[row.clone()].iter().zip(&cells.covariance[row]) {
            s += outer(pose[j as usize] - pose[i], c);
        }
        *rotation = best_rotation(s);
    });
}

/// The rigid motion `(Q, t)`, `x -> Q x + t`, that best takes points to their goals in the weighted least-squares
/// sense.
///
/// `points` yields position, goal and weight.
pub(super) fn fit_rigid(points: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> (DMat3, DVec3) {
    let sums =
        points.clone().fold((DVec3::ZERO, DVec3::ZERO, 0.0), |(x, y, n), (p, q, w)| (x + w * p, y + w * q, n + w));
    let (from, to, total) = sums;
    if total == 0.0 {
        return (DMat3::IDENTITY, DVec3::ZERO);
    }
    let (from, to) = (from / total, to / total);
    let s = points.fold(DMat3::ZERO, |s, (p, q, w)| s + outer(q - to, w * (p - from)));
    let rotation = best_rotation(s);
    (rotation, to - rotation * from)
}

/// The global step: with the rotations held, moves the unknowns of `pose` to the least energy.
///
/// Solves for the change, `A dx = b - A x`: the residual is formed edge by edge from differences of positions, so a
/// pose that already is the solution stays, to rounding, wherever it lies and however ill-conditioned `A` is.
pub(super) fn move_unknowns(
    cells: &Cells,
    factor: &mut Cholesky,
    rotations: &[DMat3],
    springs: &[Spring],
    goals: &[DVec3],
    pose: &mut [DVec3],
    rhs: &mut [[f64; 3]],
) -> Result<(), LinalgError> {
    let at = &*pose;
    rhs.par_iter_mut().enumerate().with_min_len(GRAIN).for_each(|(j, rhs)| {
        let mut residual = rotations[j] * cells.own_pull[j];
        let row = cells.row(j);
        for (&i, pull) in cells.neighbours[row.clone()].iter().zip(&cells.pulls[row]) {
            residual += rotations[i as usize] * pull.rest - pull.weight * (at[j] - at[i as usize]);
        }
        *rhs = residual.to_array();
    });
    for spring in springs {
        let slot = spring.slot as usize;
        let pull = DVec3::from_array(rhs[slot]) + spring.stiffness * (goals[slot] - pose[slot]);
        rhs[slot] = pull.to_array();
    }
    factor.solve_in_place(rhs)?;
    for (position, &change) in pose.iter_mut().zip(rhs.iter()) {
        *position += DVec3::from_array(change);
    }
    Ok(())
}

/// The energy of `pose` with the given rotations, without the springs.
///
/// `partial` has one place per [`ENERGY_CHUNK`] terms.
pub(super) fn energy(cells: &Cells, rest: &[DVec3], pose: &[DVec3], rotations: &[DMat3], partial: &mut [f64]) -> f64 {
    let chunks = cells.terms.par_chunks(ENERGY_CHUNK);
    partial.par_iter_mut().zip(chunks).for_each(|(sum, terms)| {
        *sum = 0.0;
        for term in terms {
            let [p, q] = term.ends.map(|end| end as usize);
            let (from, to) = (rest[p] - rest[q], pose[p] - pose[q]);
            for &cell in term.cells.iter().filter(|&&cell| cell != NONE) {
                *sum += term.weight * (to - rotations[cell as usize] * from).length_squared();
            }
        }
    });
    partial.iter().sum()
}
