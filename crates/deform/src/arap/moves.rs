//! The moves of a solve: guess, local and global steps, and the energies they are judged by.

use std::time::Instant;

use pliant_linalg::LinalgError;

use super::edit::{Edit, Scratch};
use super::steps::{energy, fit_rotations, move_unknowns, point, row, spring_energy};
use crate::fit::Fit;

/// Smoothed rotations of a pose are settled where a local step lowers the energy by no more than this share of it, or after so many.
const SETTLED: f64 = 1e-9;
const MOST_SWEEPS: u32 = 1000;

impl Edit {
    /// The initial guess: the global step from the rotations of the incoming pose, or from those carried from the handles.
    ///
    /// The former rotations are taken before the handles jump: with handles already at their goals, the cells at their rims
    /// would see torn edges and no true rotation. From rest all of them are one rotation: the identity (Sorkine and
    /// Alexa's guess) unless the constraints turn as a whole.
    pub(crate) fn guess(&mut self) -> Result<(), LinalgError> {
        if let Some(anderson) = &mut self.anderson {
            anderson.forget();
        }
        if self.carried.is_some() {
            self.carry_rotations()?;
        } else {
            self.follow_constraints();
            self.start_rotations();
        }
        let Scratch { pose, goals, .. } = &mut self.scratch;
        for (&slot, goal) in self.roles.held.iter().zip(goals) {
            pose[slot as usize] = *goal;
        }
        self.global_step()
    }

    /// Moves the pose of each connected piece along with what holds it, by the rigid motion that takes that nearest to its goals.
    ///
    /// A motion common to all constraints is thus followed exactly, whatever its angle, where the plain guess would
    /// need many iterations. On ordinary edits (ends turned, twisted, lifted or swung, in one jump or twenty steps) it
    /// lowered the energy after two iterations by a few to fifty percent and never raised it by more than one, so it
    /// is always done. The fit is over the constrained vertices next to an unknown, those of soft handles and all points, as
    /// far as these count: no others enter the equations.
    pub(crate) fn follow_constraints(&mut self) {
        let Self { roles, scratch, .. } = self;
        let Scratch { pose, goals, draws, follow, .. } = scratch;
        let piece = |slot: u32| roles.pieces[slot as usize] as usize;
        let hard = roles.held[..roles.rim].iter().zip(&*goals).map(|(&slot, goal)| (slot, goal, 1.0));
        let soft = roles.springs.iter().zip(&draws.springs).map(|(spring, goal)| (spring.slot, goal, spring.grip));
        let held = hard.chain(soft).map(|(slot, goal, grip)| (slot, (point(pose[slot as usize]), point(*goal), grip)));
        let held = held.chain(roles.rows.pairs(draws));
        follow.fill(None);
        for (slot, (at, goal, _)) in held.clone() {
            if at != goal {
                follow[piece(slot)] = Some(Fit::IDENTITY);
            }
        }
        if follow.iter().all(Option::is_none) {
            return;
        }
        for (k, fit) in follow.iter_mut().enumerate().filter(|(_, fit)| fit.is_some()) {
            *fit = Some(Fit::rigid(held.clone().filter(|&(slot, _)| piece(slot) == k).map(|(_, pair)| pair)));
        }
        for &slot in roles.unknowns.as_slice().iter().chain(&roles.held) {
            if let Some(fit) = &follow[piece(slot)] {
                let position = &mut pose[slot as usize];
                *position = row(fit.apply(point(*position)));
            }
        }
    }

    pub(crate) fn carry_rotations(&mut self) -> Result<(), LinalgError> {
        let Self { cells, roles, factor, carried, scratch, times, .. } = self;
        let start = Instant::now();
        let turned = match carried {
            Some(carried) => carried.rotate(cells, roles, factor, &mut scratch.rotations, &mut scratch.rhs),
            None => Ok(()),
        };
        times.global += start.elapsed();
        turned
    }

    /// Rotations that depend on the pose alone.
    pub(crate) fn start_rotations(&mut self) {
        let Self { cells, roles, smoother, scratch, times, .. } = self;
        let start = Instant::now();
        fit_rotations(cells, roles, &scratch.pose, &mut scratch.rotations);
        times.local += start.elapsed();
        if smoother.is_some() {
            self.fit_rotations();
        }
    }

    /// The local step, from the current rotations where these are smoothed.
    pub(crate) fn fit_rotations(&mut self) {
        let Self { cells, roles, smoother, scratch, times, .. } = self;
        let start = Instant::now();
        match smoother {
            None => fit_rotations(cells, roles, &scratch.pose, &mut scratch.rotations),
            Some(smoother) => smoother.sweep(cells, roles, &scratch.pose, &mut scratch.rotations),
        }
        times.local += start.elapsed();
    }

    pub(crate) fn global_step(&mut self) -> Result<(), LinalgError> {
        let Self { cells, roles, factor, scratch, times, .. } = self;
        let Scratch { pose, draws, rotations, rhs, .. } = scratch;
        let start = Instant::now();
        let moved = move_unknowns(cells, roles, factor, rotations, draws, pose, rhs);
        times.global += start.elapsed();
        moved
    }

    /// Notes the global step just done, and goes where the steps so far seem to lead.
    pub(crate) fn accelerate(&mut self) {
        let Self { roles, anderson, scratch, .. } = self;
        let Some(anderson) = anderson else { return };
        let Scratch { pose, rhs, .. } = scratch;
        let unknowns = roles.unknowns.as_slice();
        anderson.note(unknowns.iter().map(|&slot| {
            let [x, y, z] = rhs[slot as usize];
            ([x, y, z, 0.0], pose[slot as usize])
        }));
        if anderson.mix() {
            for (unknown, &slot) in unknowns.iter().enumerate() {
                pose[slot as usize] = anderson.mixed(unknown);
            }
        }
    }

    /// The energy of the current pose with its best rotations.
    pub(crate) fn settled_energy(&mut self, multiplicity: f64) -> f64 {
        self.start_rotations();
        let mut energy = self.current_energy(multiplicity);
        if self.smoother.is_some() {
            for _ in 0..MOST_SWEEPS {
                self.fit_rotations();
                let last = std::mem::replace(&mut energy, self.current_energy(multiplicity));
                if last - energy <= SETTLED * last {
                    break;
                }
            }
        }
        energy
    }

    /// The current energy, after a local step. If it has risen above `last` by an acceleration, that is taken back.
    pub(crate) fn safe_energy(&mut self, last: f64, multiplicity: f64) -> f64 {
        let now = self.current_energy(multiplicity);
        if (now > last || now.is_nan()) && self.go_back() {
            self.fit_rotations();
            return self.current_energy(multiplicity);
        }
        now
    }

    /// Takes back an acceleration; whether there was one.
    pub(crate) fn go_back(&mut self) -> bool {
        let Self { roles, anderson, smoother, scratch, .. } = self;
        let Some(anderson) = anderson.as_mut().filter(|anderson| anderson.has_mixed()) else { return false };
        for (&slot, &end) in roles.unknowns.as_slice().iter().zip(anderson.end()) {
            scratch.pose[slot as usize] = end;
        }
        // Those that the step to `end` was made with, so that the next fit cannot be worse.
        if let Some(smoother) = smoother {
            smoother.undo(&mut scratch.rotations);
        }
        anderson.forget();
        true
    }

    /// Largest distance from a hard row's point to its target, in the frame; only where there are such rows.
    pub(crate) fn unmet(&self) -> Option<f64> {
        self.roles.rows.unmet(&self.scratch.draws, &self.scratch.pose)
    }

    /// The energy of the current pose and rotations, in the frame.
    pub(crate) fn current_energy(&mut self, multiplicity: f64) -> f64 {
        let Self { cells, roles, smoother, terms, rest, scratch, .. } = self;
        let Scratch { pose, draws, rotations, energy: partial, .. } = scratch;
        let smooth = smoother.as_ref().map_or(0.0, |smoother| smoother.energy(cells, roles, rotations));
        energy(terms.as_deref().unwrap_or_default(), roles, rest, pose, rotations, partial)
            + multiplicity * (spring_energy(&roles.springs, &draws.springs, pose) + roles.rows.energy(draws, pose))
            + smooth
    }
}
