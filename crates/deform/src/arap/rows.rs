//! Points that are no vertices, as conditions on the global step.
//!
//! With the points' weights as rows of a matrix `K` and their targets `t`, a soft row adds `k |K x - t|^2` to the energy. Hard rows
//! `K x = t` are met by the method of multipliers (Hestenes 1969; Powell 1969): the energy gets `r |K x - t|^2` with a penalty `r` that leaves
//! the matrix well-conditioned, and a force `f = K^T l` that is corrected by `r K^T (K x - t)` after each solve until nothing is missing.
//! Each correction shrinks the miss some `r` times. No row is taken out of the equations, so it does not matter how many there are or
//! whether they depend on each other: where they contradict each other the force stops changing at the least squares of what
//! is missing (Chiche, Gilbert 2016, *How the augmented Lagrangian algorithm can deal with an infeasible convex quadratic optimization
//! problem*). The rows enter the matrix as `K^T K`, which couples the vertices of each row.

use glam::DVec3;
use pliant_linalg::{Cholesky, LinalgError, SpdPattern};

use super::cells::{Cells, NONE};
use super::roles::Roles;
use super::shape::Shape;
use super::steps::{Row, add, point, row, subtract};
use crate::error::HandleFault;
use crate::frame::Frame;
use crate::patch::SOFT_RANGE;
use crate::points::{combine, sum};
use crate::region::reach;
use crate::{Constraint, DeformError, Goals, Region};

/// Penalty of hard rows and most that a soft one may weigh: where the vertices' own stiffness counts 1.
const PENALTY: f64 = 1e6;

/// A force in units of the penalty that is met: some rounding errors of positions.
const MET: f64 = 1e-13;

/// Corrections of the force in one global step at most.
const MOST_CORRECTIONS: u32 = 20;

/// Stiffness, relative to the mean, that keeps what rows alone hold where it is if they may leave it a way to move.
const STAY: f64 = 1e-4;

/// A component of the mesh that has less than this of a row's weight is not sure to be held by it.
const SURE: f64 = 1e-2;

/// Most products of two weights that the matrix may have to sum.
const MOST_PRODUCTS: usize = 1 << 30;

/// The rows of a region, on the slots that are solved for.
pub(crate) struct Rows {
    pub(crate) list: Vec<Tie>,
    /// Slots and weights, row by row.
    entries: Vec<(u32, f64)>,
    hard: bool,
}

/// One row.
pub(crate) struct Tie {
    handle: u32,
    is_hard: bool,
    /// Where its entries end.
    end: u32,
    /// What it adds to the matrix, per product of weights.
    stiffness: f64,
    /// How much its target counts where that of a hard vertex counts 1.
    grip: f64,
}

/// What springs and rows are drawn to in a solve, and with which forces; in the frame.
#[derive(Default)]
pub(crate) struct Draws {
    /// Goals of the springs.
    pub(crate) springs: Vec<Row>,
    /// Targets, less what is not solved for.
    targets: Vec<Row>,
    /// `f` by slot of the region; only with hard rows, as the next.
    forces: Vec<[f64; 3]>,
    correction: Vec<[f64; 3]>,
    /// Where the rows' points are in the incoming pose, and where they are to be.
    ends: Vec<[DVec3; 2]>,
}

impl Rows {
    /// `diagonal` is that of the Laplacian by slot of the region, `mean` its mean over the slots that are solved for.
    pub(crate) fn new(cells: &Cells, region: &Region, diagonal: &[f64], mean: f64) -> Self {
        let slot = slots(cells, region);
        let mut rows = Self { list: Vec::new(), entries: Vec::new(), hard: false };
        for (handle, constraint, _, row) in region.rows() {
            let start = rows.entries.len();
            let unknown = row.iter().filter(|&&(v, _)| region.is_unknown(v as usize));
            rows.entries.extend(unknown.map(|&(v, weight)| (slot[v as usize], weight)));
            let mine = &rows.entries[start..];
            let squares: f64 = mine.iter().map(|(_, c)| c * c).sum();
            let (is_hard, stiffness, grip) = match constraint {
                Constraint::Hard => {
                    let own = |slot: u32| if diagonal[slot as usize] > 0.0 { diagonal[slot as usize] } else { mean };
                    let yielding: f64 = mine.iter().map(|&(slot, c)| c * c / own(slot)).sum();
                    (true, if yielding > 0.0 { PENALTY / yielding } else { 0.0 }, 1.0)
                }
                Constraint::Soft(weight) => {
                    let weight = weight.clamp(SOFT_RANGE[0], PENALTY);
                    (false, weight * mean / squares.max(1.0), weight / (1.0 + weight))
                }
            };
            rows.hard |= is_hard;
            rows.list.push(Tie { handle, is_hard, end: rows.entries.len() as u32, stiffness, grip });
        }
        rows
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (&Tie, &[(u32, f64)])> + Clone {
        let starts = std::iter::once(0).chain(self.list.iter().map(|tie| tie.end));
        starts.zip(&self.list).map(|(start, tie)| (tie, &self.entries[start as usize..tie.end as usize]))
    }

    /// Targets as incoming points and goals, with a slot that each follows and how much it counts.
    pub(crate) fn pairs<'a>(
        &'a self,
        draws: &'a Draws,
    ) -> impl Iterator<Item = (u32, (DVec3, DVec3, f64))> + Clone + 'a {
        let ends = self.iter().zip(&draws.ends);
        ends.map(|((tie, entries), &[from, to])| (entries.first().map_or(NONE, |entry| entry.0), (from, to, tie.grip)))
    }

    /// What soft rows add to the energy, per unit of multiplicity.
    pub(crate) fn energy(&self, draws: &Draws, pose: &[Row]) -> f64 {
        let missed = self.missed(draws, pose).filter(|(tie, ..)| !tie.is_hard);
        missed.map(|(tie, _, miss)| tie.stiffness * point(miss).length_squared()).sum()
    }

    /// Largest distance of a hard row's point from its target, in the frame; `None` without hard rows.
    pub(crate) fn unmet(&self, draws: &Draws, pose: &[Row]) -> Option<f64> {
        let misses = self.missed(draws, pose).filter(|(tie, ..)| tie.is_hard).map(|(.., miss)| point(miss).length());
        self.hard.then(|| misses.fold(0.0, f64::max))
    }

    /// The rows with `t - K x`.
    fn missed<'a>(
        &'a self,
        draws: &'a Draws,
        pose: &'a [Row],
    ) -> impl Iterator<Item = (&'a Tie, &'a [(u32, f64)], Row)> + 'a {
        self.iter().zip(&draws.targets).map(|((tie, entries), &target)| {
            let mut at = Row::default();
            for &(slot, weight) in entries {
                add(&mut at, pose[slot as usize], weight);
            }
            (tie, entries, subtract(target, at))
        })
    }

    /// Adds the forces on the slots to the right-hand sides of the unknowns.
    pub(crate) fn pull(&self, draws: &Draws, pose: &[Row], unknowns: &[u32], rhs: &mut [[f64; 3]]) {
        for (tie, entries, miss) in self.missed(draws, pose) {
            spread(entries, tie.stiffness, miss, rhs);
        }
        if self.hard {
            for &slot in unknowns {
                for (rhs, force) in rhs[slot as usize].iter_mut().zip(draws.forces[slot as usize]) {
                    *rhs -= force;
                }
            }
        }
    }

    /// Moves the unknowns until nothing is missing from hard rows, with `moved` the way they go on from a solve.
    pub(crate) fn meet(
        &self,
        draws: &mut Draws,
        factor: &mut Cholesky,
        unknowns: &[u32],
        pose: &mut [Row],
        moved: &mut [[f64; 3]],
    ) -> Result<(), LinalgError> {
        if !self.hard {
            return Ok(());
        }
        let mut correction = std::mem::take(&mut draws.correction);
        let mut last = f64::INFINITY;
        for _ in 0..MOST_CORRECTIONS {
            for &slot in unknowns {
                correction[slot as usize] = [0.0; 3];
            }
            let mut size = 0.0_f64;
            for (tie, entries, miss) in self.missed(draws, pose).filter(|(tie, ..)| tie.is_hard) {
                spread(entries, tie.stiffness, miss, &mut correction);
            }
            for (tie, entries) in self.iter().filter(|(tie, _)| tie.is_hard) {
                for &(slot, weight) in entries {
                    let force = DVec3::from(correction[slot as usize]).abs().max_element();
                    size = size.max(weight.abs() * force / tie.stiffness);
                }
            }
            // Less than half of the last: what is left are ways that rows hardly tell apart.
            if size <= MET || size > 0.5 * last {
                break;
            }
            last = size;
            for &slot in unknowns {
                for (force, more) in draws.forces[slot as usize].iter_mut().zip(correction[slot as usize]) {
                    *force -= more;
                }
            }
            factor.solve_in_place(&mut correction)?;
            for &slot in unknowns {
                let [x, y, z] = correction[slot as usize];
                add(&mut pose[slot as usize], [x, y, z, 0.0], 1.0);
                for (moved, more) in moved[slot as usize].iter_mut().zip([x, y, z]) {
                    *moved += more;
                }
            }
        }
        draws.correction = correction;
        Ok(())
    }

    /// What has to be added to the diagonal, by slot: see [`STAY`].
    pub(crate) fn steady(&self, shape: &Shape, cells: &Cells, region: &Region, mean: f64, diagonal: &mut [f64]) {
        if self.list.is_empty() {
            return;
        }
        let topology = shape.topology();
        let mut sure = region.anchored(topology);
        reach(topology, &mut sure);
        // What is next to something that is not surely held is not either, so it is in the region.
        let component = cells.pieces(|slot| slot >= cells.roi || sure[cells.vertices[slot] as usize]);
        let count = component.iter().filter(|&&c| c != NONE).max().map_or(0, |&c| c as usize + 1);
        let mut held = vec![false; count];
        for (_, entries) in self.iter() {
            let loose = || entries.iter().filter(|&&(slot, _)| component[slot as usize] != NONE);
            let Some(&(first, _)) = loose().next() else { continue };
            let first = component[first as usize];
            let weight: f64 = loose().map(|(_, weight)| weight).sum();
            if weight.abs() >= SURE && loose().all(|&(slot, _)| component[slot as usize] == first) {
                held[first as usize] = true;
            }
        }
        for (diagonal, &component) in diagonal.iter_mut().zip(&component) {
            if held.get(component as usize) == Some(&false) {
                *diagonal += STAY * mean;
            }
        }
    }
}

impl Draws {
    pub(crate) fn new(cells: &Cells, roles: &Roles) -> Self {
        let rows = &roles.rows;
        let forces = if rows.hard { vec![[0.0; 3]; cells.roi] } else { Vec::new() };
        let count = rows.list.len();
        let (targets, ends) = (vec![Row::default(); count], vec![[DVec3::ZERO; 2]; count]);
        let springs = vec![Row::default(); roles.springs.len()];
        Self { springs, targets, correction: forces.clone(), forces, ends }
    }

    /// Brings targets of rows into the frame, and forgets the forces.
    pub(crate) fn read(
        &mut self,
        frame: &Frame,
        region: &Region,
        rest: &[DVec3],
        goals: &Goals,
        positions: &[DVec3],
    ) -> Result<(), DeformError> {
        self.forces.fill([0.0; 3]);
        let places = self.targets.iter_mut().zip(&mut self.ends);
        for ((number, (handle, _, at, entries)), (target, ends)) in region.rows().enumerate().zip(places) {
            let too_far = || DeformError::handle(handle as usize, HandleFault::Target { row: at });
            let whole = sum(entries);
            let goal = frame.enter_sum(goals.target(number, handle, entries, rest), whole).ok_or_else(too_far)?;
            let from = combine(entries, |v| frame.enter(positions[v as usize]));
            let held = entries.iter().filter(|&&(v, _)| !region.is_unknown(v as usize)).map(|&(v, weight)| {
                let v = v as usize;
                // Handles' goals have been checked.
                let there = match region.roles()[v] {
                    crate::Role::Handle(handle) => goals.apply(handle, rest[v]),
                    _ => positions[v],
                };
                weight * frame.enter(there)
            });
            *target = row(goal - held.sum::<DVec3>());
            *ends = [from, goal];
        }
        Ok(())
    }

    /// Draws each row to `turn` of its handle, for the rotation vectors of its vertices.
    pub(crate) fn read_turns(&mut self, rows: &Rows, turn: impl Fn(u32) -> DVec3) {
        self.forces.fill([0.0; 3]);
        for ((tie, entries), target) in rows.iter().zip(&mut self.targets) {
            *target = row(turn(tie.handle) * sum(entries));
        }
    }
}

/// `out += factor K^T miss` for one row.
fn spread(entries: &[(u32, f64)], factor: f64, miss: Row, out: &mut [[f64; 3]]) {
    for &(slot, weight) in entries {
        for (out, miss) in out[slot as usize].iter_mut().zip(miss) {
            *out += factor * weight * miss;
        }
    }
}

/// Slots by vertex, [`NONE`] outside the region of interest; empty if there are no rows to look up.
fn slots(cells: &Cells, region: &Region) -> Vec<u32> {
    let mut slot = if region.row_count() > 0 { vec![NONE; region.vertex_count()] } else { Vec::new() };
    for (k, &v) in (0..).zip(&cells.vertices[..cells.roi]) {
        if let Some(slot) = slot.get_mut(v as usize) {
            *slot = k;
        }
    }
    slot
}

/// Where the matrix of a region has entries, whatever the roles: those of the Laplacian, and of each pair of vertices in one row.
pub(crate) struct Places {
    /// Upper triangle by columns, as [`SpdPattern::of_columns`] has it; empty without rows.
    col_ptr: Vec<u32>,
    row_idx: Vec<u32>,
}

impl Places {
    pub(crate) fn new(cells: &Cells, region: &Region) -> Result<(Self, SpdPattern), LinalgError> {
        let mut places = Self { col_ptr: Vec::new(), row_idx: Vec::new() };
        if region.row_count() == 0 {
            return Ok((places, cells.pattern()?));
        }
        let slot = slots(cells, region);
        let (mut ends, mut entries) = (Vec::new(), Vec::new());
        let mut products = 0_usize;
        for (.., row) in region.rows() {
            let start = entries.len();
            entries.extend(row.iter().map(|&(v, _)| (slot[v as usize], 0.0)).filter(|&(slot, _)| slot != NONE));
            products = products.saturating_add((entries.len() - start).pow(2));
            ends.push(entries.len() as u32);
        }
        if products > MOST_PRODUCTS {
            return Err(LinalgError::TooLarge { unknowns: cells.roi, entries: products });
        }
        let rows_of = Transpose::new(cells.roi, &ends, &entries);
        let mut seen = vec![NONE; cells.roi];
        places.col_ptr.push(0);
        for col in 0..cells.roi as u32 {
            let start = places.row_idx.len();
            let mut note = |slot: u32| {
                if slot < col && std::mem::replace(&mut seen[slot as usize], col) != col {
                    places.row_idx.push(slot);
                }
            };
            cells.neighbours(col as usize).iter().for_each(|&slot| note(slot));
            for &(tie, _) in rows_of.of(col) {
                entries[range(&ends, tie)].iter().for_each(|&(slot, _)| note(slot));
            }
            places.row_idx[start..].sort_unstable();
            places.row_idx.push(col);
            places.col_ptr.push(places.row_idx.len() as u32);
        }
        let pattern = SpdPattern::of_columns(places.col_ptr.clone(), places.row_idx.clone())?;
        Ok((places, pattern))
    }

    /// The entries in the order of the pattern; `diagonal` has those of the Laplacian and its springs.
    pub(crate) fn values<'a>(&self, cells: &'a Cells, rows: &Rows, diagonal: &'a [f64]) -> Vec<f64> {
        let laplacian = cells.laplacian(diagonal);
        if self.col_ptr.is_empty() {
            return laplacian.collect();
        }
        let ends: Vec<u32> = rows.list.iter().map(|tie| tie.end).collect();
        let rows_of = Transpose::new(cells.roi, &ends, &rows.entries);
        let mut laplacian = laplacian;
        let mut values = Vec::with_capacity(self.row_idx.len());
        let mut sums = vec![0.0; cells.roi];
        for col in 0..cells.roi as u32 {
            // The entries of the Laplacian come as its pattern has them: those before the diagonal, then the diagonal.
            for &slot in cells.neighbours(col as usize).iter().filter(|&&slot| slot < col).chain([&col]) {
                sums[slot as usize] = laplacian.next().unwrap_or_default();
            }
            for &(tie, weight) in rows_of.of(col) {
                let factor = rows.list[tie as usize].stiffness * weight;
                for &(slot, weight) in rows.entries[range(&ends, tie)].iter().filter(|&&(slot, _)| slot <= col) {
                    sums[slot as usize] += factor * weight;
                }
            }
            let column = self.col_ptr[col as usize] as usize..self.col_ptr[col as usize + 1] as usize;
            values.extend(self.row_idx[column].iter().map(|&slot| std::mem::take(&mut sums[slot as usize])));
        }
        values
    }
}

/// Rows and weights by slot.
struct Transpose {
    starts: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl Transpose {
    fn new(slots: usize, ends: &[u32], entries: &[(u32, f64)]) -> Self {
        let mut starts = vec![0; slots + 1];
        for &(slot, _) in entries {
            starts[slot as usize + 1] += 1;
        }
        for slot in 0..slots {
            starts[slot + 1] += starts[slot];
        }
        let mut next = starts.clone();
        let mut by_slot = vec![(0, 0.0); entries.len()];
        for tie in 0..ends.len() as u32 {
            for &(slot, weight) in &entries[range(ends, tie)] {
                by_slot[next[slot as usize] as usize] = (tie, weight);
                next[slot as usize] += 1;
            }
        }
        Self { starts, entries: by_slot }
    }

    fn of(&self, slot: u32) -> &[(u32, f64)] {
        &self.entries[self.starts[slot as usize] as usize..self.starts[slot as usize + 1] as usize]
    }
}

/// Where the entries of row `tie` are.
fn range(ends: &[u32], tie: u32) -> std::ops::Range<usize> {
    let start = if tie == 0 { 0 } else { ends[tie as usize - 1] };
    start as usize..ends[tie as usize] as usize
}
