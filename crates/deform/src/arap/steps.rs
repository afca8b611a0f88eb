//! The two steps of an iteration, and the energy they lower.

use glam::DVec3;
use pliant_linalg::{Cholesky, LinalgError};
use pliant_mesh::threads::{CHUNK, for_each_chunk};
use pliant_mesh::{LANES, RotationBatch};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::cells::{Cells, NONE, Term};
use super::roles::{Roles, Spring};
use super::rows::Draws;

/// Terms whose energy is summed in one go; fixed, so that the sum does not depend on the number of threads.
pub(crate) const ENERGY_CHUNK: usize = 2048;

/// A point, padded to the width of a register by a 0.
pub(crate) type Row = [f64; 4];

/// A matrix by columns.
pub(crate) type Columns = [Row; 3];

pub(crate) fn row(p: DVec3) -> Row {
    [p.x, p.y, p.z, 0.0]
}

pub(crate) fn point([x, y, z, _]: Row) -> DVec3 {
    DVec3::new(x, y, z)
}

/// The local step: for each cell the rotation that best takes its rest edges to those of `pose`.
pub(crate) fn fit_rotations(cells: &Cells, roles: &Roles, pose: &[Row], rotations: &mut [Columns]) {
    for_each_chunk(rotations, |chunk, rotations| {
        let slots = roles.fitted.in_chunk(chunk);
        Arch::new().dispatch(FitCells { cells, slots, first: chunk * CHUNK, pose, rotations });
    });
}

/// Fits the cells of `slots`; `rotations` begins with that of slot `first`.
struct FitCells<'a> {
    cells: &'a Cells,
    slots: &'a [u32],
    first: usize,
    pose: &'a [Row],
    rotations: &'a mut [Columns],
}

impl WithSimd for FitCells<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { cells, slots, first, pose, rotations } = self;
        let mut batch = RotationBatch::default();
        for slots in slots.chunks(LANES) {
            for (lane, &slot) in slots.iter().enumerate() {
                batch.set(lane, &covariance(cells, slot as usize, pose).map(|[x, y, z, _]| [x, y, z]));
            }
            batch.fit(slots.len());
            for (lane, &slot) in slots.iter().enumerate() {
                rotations[slot as usize - first] = padded(batch.get(lane));
            }
        }
    }
}

/// `S_i` of a cell, by columns.
#[inline(always)]
pub(crate) fn covariance(cells: &Cells, i: usize, pose: &[Row]) -> Columns {
    let centre = pose[i];
    let mut s = Columns::default();
    for (&j, c) in cells.neighbours(i).iter().zip(cells.covariance(i)) {
        let edge = subtract(pose[j as usize], centre);
        for (column, &c) in s.iter_mut().zip(c) {
            add(column, edge, c);
        }
    }
    s
}

#[inline(always)]
pub(crate) fn padded(columns: [[f64; 3]; 3]) -> Columns {
    columns.map(|[x, y, z]| [x, y, z, 0.0])
}

#[inline(always)]
pub(crate) fn subtract(a: Row, b: Row) -> Row {
    std::array::from_fn(|l| a[l] - b[l])
}

/// `sum += factor * x`.
#[inline(always)]
pub(crate) fn add(sum: &mut Row, x: Row, factor: f64) {
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum += factor * x;
    }
}

/// The global step: with the rotations held, moves the unknowns of `pose` to the least energy.
///
/// Solves for the change, `A dx = b - A x`: the residual is formed edge by edge from differences of positions, so a
/// pose that already is the solution stays, to rounding, wherever it lies and however ill-conditioned `A` is.
/// `rhs` has a place for each slot of the region; it is left with how far each unknown was moved.
pub(crate) fn move_unknowns(
    cells: &Cells,
    roles: &Roles,
    factor: &mut Cholesky,
    rotations: &[Columns],
    draws: &mut Draws,
    pose: &mut [Row],
    rhs: &mut [[f64; 3]],
) -> Result<(), LinalgError> {
    let at = &*pose;
    for_each_chunk(rhs, |chunk, rhs| {
        let slots = roles.unknowns.in_chunk(chunk);
        Arch::new().dispatch(Residuals { cells, slots, first: chunk * CHUNK, rotations, pose: at, rhs });
    });
    for (spring, goal) in roles.springs.iter().zip(&draws.springs) {
        let slot = spring.slot as usize;
        for ((rhs, goal), at) in rhs[slot].iter_mut().zip(goal).zip(at[slot]) {
            *rhs += spring.stiffness * (goal - at);
        }
    }
    let unknowns = roles.unknowns.as_slice();
    roles.rows.pull(draws, at, unknowns, rhs);
    factor.solve_in_place(rhs)?;
    for &slot in unknowns {
        let [x, y, z] = rhs[slot as usize];
        add(&mut pose[slot as usize], [x, y, z, 0.0], 1.0);
    }
    roles.rows.meet(draws, factor, unknowns, pose, rhs)
}

/// Right-hand sides of the unknowns `slots` without springs; `rhs` begins with that of slot `first`.
struct Residuals<'a> {
    cells: &'a Cells,
    slots: &'a [u32],
    first: usize,
    rotations: &'a [Columns],
    pose: &'a [Row],
    rhs: &'a mut [[f64; 3]],
}

impl WithSimd for Residuals<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { cells, slots, first, rotations, pose, rhs } = self;
        for &slot in slots {
            let j = slot as usize;
            let (pulls, own) = cells.pulls(j);
            let centre = pose[j];
            let mut residual = [0.0; 4];
            for (&column, c) in rotations[j].iter().zip(own) {
                add(&mut residual, column, c);
            }
            for (&i, pull) in cells.neighbours(j).iter().zip(pulls) {
                let i = i as usize;
                for (&column, c) in rotations[i].iter().zip(*pull) {
                    add(&mut residual, column, c);
                }
                add(&mut residual, subtract(pose[i], centre), pull[3]);
            }
            let [x, y, z, _] = residual;
            rhs[j - first] = [x, y, z];
        }
    }
}

/// The energy of `pose` with the given rotations, without the springs.
///
/// `partial` has one place per [`ENERGY_CHUNK`] terms.
pub(crate) fn energy(
    terms: &[Term],
    roles: &Roles,
    rest: &[DVec3],
    pose: &[Row],
    rotations: &[Columns],
    partial: &mut [f64],
) -> f64 {
    partial.par_iter_mut().zip(terms.par_chunks(ENERGY_CHUNK)).for_each(|(sum, terms)| {
        *sum = 0.0;
        for term in terms {
            let [p, q] = term.ends.map(|end| end as usize);
            for &cell in term.cells.iter().filter(|&&cell| cell != NONE && roles.fitted.contains(cell as usize)) {
                let from = rest[p] - rest[q];
                let mut off = subtract(pose[p], pose[q]);
                for (&column, c) in rotations[cell as usize].iter().zip(from.to_array()) {
                    add(&mut off, column, -c);
                }
                *sum += term.weight * point(off).length_squared();
            }
        }
    });
    partial.iter().sum()
}

/// What springs add to the energy, per unit of multiplicity.
pub(crate) fn spring_energy(springs: &[Spring], draws: &[Row], pose: &[Row]) -> f64 {
    let stretched = |(spring, &goal): (&Spring, &Row)| {
        spring.stiffness * point(subtract(pose[spring.slot as usize], goal)).length_squared()
    };
    springs.iter().zip(draws).map(stretched).sum()
}
