//! Preparing an edit and solving it.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use pliant_linalg::{Cholesky, LinalgError};
use pliant_mesh::TriMesh;
use pliant_mesh::threads::among_threads;

use super::anderson::Anderson;
use super::carried::Carried;
use super::cells::{Cells, Term};
use super::roles::Roles;
use super::shape::Shape;
use super::steps::{Columns, ENERGY_CHUNK, Row, energy, fit_rotations, move_unknowns, point, row, spring_energy};
use super::{Acceleration, ArapOptions, Start};
use crate::fit::Fit;
use crate::frame::{Frame, check_count, check_pose};
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport, StepTimes};

/// Energy, per unit of weight and with a diagonal of 1, that is nothing but rounding.
const ROUNDING_ENERGY: f64 = 1e-29;

/// A prepared as-rigid-as-possible edit.
///
/// Computes in the rest shape's frame, centred and scaled by a power of two to a diagonal between 1/2 and 1, so
/// results follow any scale and offset of the scene. They are the same, bit for bit, for any number of threads.
///
/// What is prepared has three lifetimes: that of the rest shape (weights), of the region of interest (cells, order and symbolic
/// factor) and of the roles in it (who is solved for, the numbers of the factor).
pub struct Arap {
    options: ArapOptions,
    shape: Shape,
    edit: Edit,
}

/// What depends on the region.
struct Edit {
    region: Region,
    cells: Cells,
    roles: Roles,
    factor: Cholesky,
    /// If iterations are accelerated.
    anderson: Option<Anderson>,
    /// If they start from the turns of the handles.
    carried: Option<Carried>,
    /// Edges of the energy; only if it has been asked for.
    terms: Option<Vec<Term>>,
    /// In the frame, by slot.
    rest: Vec<DVec3>,
    scratch: Scratch,
    times: StepTimes,
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame.
#[derive(Default)]
struct Scratch {
    /// By slot; only of those that equations look at.
    pose: Vec<Row>,
    /// By cell; only of those that are fitted.
    rotations: Vec<Columns>,
    /// By slot of the region.
    rhs: Vec<[f64; 3]>,
    /// Where those held are to be.
    goals: Vec<Row>,
    /// Goals of the springs.
    draws: Vec<Row>,
    /// Goals of those led, in world units.
    landed: Vec<DVec3>,
    /// Of [`ENERGY_CHUNK`] terms each.
    energy: Vec<f64>,
}

impl Arap {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &ArapOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        check_count("vertices of the region", rest.vertex_count(), region.vertex_count())?;
        let shape = Shape::new(options, rest)?;
        let edit = Edit::new(options, &shape, region)?;
        Ok(Self { options: options.clone(), shape, edit })
    }

    /// The energy of a pose, with the best rotation of each cell, in world units (of weight times squared length).
    ///
    /// It is the sum, over the cells of free vertices and their neighbours, of `w |e' - R e|^2` (Borosan et al. 2010,
    /// Eq. 1), and over the vertices of soft handles of `m k |p' - goal|^2`, with `k` the handle's weight times the
    /// mean diagonal entry of the matrix and `m` the number of cells that count an edge (2 for spokes, 3 for spokes
    /// and rims). Hard handles are taken where the pose has them.
    ///
    /// # Errors
    /// As [`Deformer::solve`].
    pub fn energy(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<f64, DeformError> {
        self.edit.prepare_energy(&self.shape);
        self.edit.read(&self.shape.frame, goals, positions)?;
        self.edit.fit_rotations();
        Ok(self.edit.current_energy(self.shape.multiplicity()) * self.shape.frame.energy_unit())
    }

    /// Guess and iterations. The local step of iteration `k + 1` also tells the energy after iteration `k`.
    fn iterate(&mut self) -> Result<SolveReport, LinalgError> {
        let Self { options, shape, edit } = self;
        let mut report = SolveReport::default();
        edit.times = StepTimes::default();
        edit.guess()?;
        let rounding = ROUNDING_ENERGY * edit.terms.iter().flatten().map(|t| t.weight.abs()).sum::<f64>();
        let unit = shape.frame.energy_unit();
        let mut last = f64::INFINITY;
        loop {
            let at_end = report.iterations == options.iterations;
            if at_end && options.tolerance.is_none() {
                return Ok(report);
            }
            edit.fit_rotations();
            if options.tolerance.is_some() || edit.anderson.is_some() {
                let now = edit.safe_energy(last, shape.multiplicity());
                if let Some(tolerance) = options.tolerance {
                    report.energy_before.get_or_insert(now * unit);
                    report.energy_after = Some(now * unit);
                    report.converged = last - now <= tolerance * last && last.is_finite() || now <= rounding;
                    if report.converged || at_end {
                        return Ok(report);
                    }
                }
                last = now;
            }
            edit.global_step()?;
            report.iterations += 1;
            // The last step is not accelerated, as nobody would look at its energy.
            if report.iterations < options.iterations {
                edit.accelerate();
            }
        }
    }
}

impl Deformer for Arap {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.edit.read(&self.shape.frame, goals, positions)?;
        let report = among_threads(self.edit.cells.roi, || self.iterate());
        let report = report.map_err(|error| DeformError::of_system(error, &self.edit.cells.vertices))?;
        self.edit.write(&self.shape.frame, positions)?;
        Ok(report)
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        check_count("vertices of the region", self.edit.region.vertex_count(), region.vertex_count())?;
        if self.edit.has_same_roi(region) {
            self.edit.set_roles(&self.options, &self.shape, region)?;
        } else {
            self.edit = Edit::new(&self.options, &self.shape, region)?;
        }
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        PrepareReport {
            unknowns: self.edit.roles.unknowns.as_slice().len(),
            clamped_weights: self.shape.clamped,
            factor_len: self.edit.factor.solve_len(),
        }
    }

    fn step_times(&self) -> StepTimes {
        self.edit.times
    }
}

impl Edit {
    fn new(options: &ArapOptions, shape: &Shape, region: &Region) -> Result<Self, DeformError> {
        region.require_constrained(shape.topology())?;
        let roi: Vec<u32> = region.roi().collect();
        let cells = Cells::new(shape, &roi);
        let roles = Roles::new(shape, &cells, region);
        let factor = cells
            .pattern()
            .and_then(|pattern| {
                let free = |slot: usize| roles.unknowns.contains(slot);
                Cholesky::of_block(Arc::new(pattern), cells.laplacian(&roles.diagonal), free)
            })
            .map_err(|error| DeformError::of_system(error, &cells.vertices))?;
        let rest = cells.vertices.iter().map(|&v| shape.inner[v as usize]).collect();
        let mut scratch = Scratch {
            pose: vec![Row::default(); cells.vertices.len()],
            rotations: vec![Columns::default(); cells.cells],
            rhs: vec![[0.0; 3]; cells.roi],
            ..Scratch::default()
        };
        scratch.fit(&roles);
        let anderson = anderson(options, &roles);
        let is_accelerated = anderson.is_some();
        let region = region.clone();
        let times = StepTimes::default();
        let carried = carried(options, &cells, &roles);
        let mut edit = Self { region, cells, roles, factor, anderson, carried, terms: None, rest, scratch, times };
        if options.tolerance.is_some() || is_accelerated {
            edit.prepare_energy(shape);
        }
        Ok(edit)
    }

    fn has_same_roi(&self, region: &Region) -> bool {
        region.roi().eq(self.cells.vertices[..self.cells.roi].iter().copied())
    }

    /// Takes over the roles of a region with the same region of interest, or changes nothing.
    fn set_roles(&mut self, options: &ArapOptions, shape: &Shape, region: &Region) -> Result<(), DeformError> {
        let Self { cells, factor, .. } = self;
        let mut refactor = |roles: &Roles| {
            factor.refactor_block(cells.laplacian(&roles.diagonal), |slot| roles.unknowns.contains(slot))
        };
        region.require_constrained(shape.topology())?;
        let roles = Roles::new(shape, cells, region);
        if let Err(error) = refactor(&roles) {
            // The old numbers once more: they made a factor before. If not, every solve will say so.
            let _ = refactor(&self.roles);
            return Err(DeformError::of_system(error, &self.cells.vertices));
        }
        self.scratch.fit(&roles);
        self.anderson = anderson(options, &roles);
        self.carried = carried(options, &self.cells, &roles);
        self.roles = roles;
        self.region = region.clone();
        Ok(())
    }

    /// Makes ready for [`Self::current_energy`].
    fn prepare_energy(&mut self, shape: &Shape) {
        let terms = self.terms.get_or_insert_with(|| self.cells.terms(shape));
        self.scratch.energy.resize(terms.len().div_ceil(ENERGY_CHUNK), 0.0);
    }

    /// Checks the input and brings pose and goals into the frame.
    fn read(&mut self, frame: &Frame, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        goals.check(&self.region)?;
        check_pose(self.region.vertex_count(), positions)?;
        let Self { cells, roles, scratch, .. } = self;
        let enter = |slot: u32| row(frame.enter(positions[cells.vertices[slot as usize] as usize]));
        for &slot in roles.unknowns.as_slice() {
            scratch.pose[slot as usize] = enter(slot);
        }
        for (&slot, goal) in roles.held.iter().zip(&mut scratch.goals) {
            *goal = enter(slot);
            scratch.pose[slot as usize] = *goal;
        }
        for (led, landed) in roles.led.iter().zip(&mut scratch.landed) {
            *landed = goals.apply(led.handle, led.rest);
            let inner = frame.enter_goal(*landed, led.handle, led.vertex)?;
            if let Some(goal) = scratch.goals.get_mut(led.held as usize) {
                *goal = row(inner);
            }
        }
        for (spring, draw) in roles.springs.iter().zip(&mut scratch.draws) {
            let vertex = cells.vertices[spring.slot as usize];
            let goal = goals.apply(spring.handle, spring.rest);
            *draw = row(frame.enter_goal(goal, spring.handle, vertex)?);
        }
        if let Some(carried) = &mut self.carried {
            carried.read(roles, goals, &self.rest, &scratch.pose);
        }
        Ok(())
    }

    /// Writes the solution, or nothing if it cannot be written in world units.
    fn write(&self, frame: &Frame, positions: &mut [DVec3]) -> Result<(), DeformError> {
        let Self { cells, roles, scratch, .. } = self;
        let solved = roles
            .unknowns
            .as_slice()
            .iter()
            .map(|&slot| (cells.vertices[slot as usize], frame.leave(point(scratch.pose[slot as usize]))));
        for (vertex, position) in solved.clone() {
            if !position.is_finite() {
                return Err(DeformError::ResultNotFinite { vertex });
            }
        }
        for (vertex, position) in solved {
            positions[vertex as usize] = position;
        }
        for (led, &landed) in roles.led.iter().zip(&scratch.landed) {
            positions[led.vertex as usize] = landed;
        }
        Ok(())
    }

    /// The initial guess: the global step from the rotations of the incoming pose, or from those carried from the handles.
    ///
    /// The former rotations are taken before the handles jump: with handles already at their goals, the cells at their rims
    /// would see torn edges and no true rotation. From rest all of them are one rotation: the identity (Sorkine and
    /// Alexa's guess) unless the constraints turn as a whole.
    fn guess(&mut self) -> Result<(), LinalgError> {
        if let Some(anderson) = &mut self.anderson {
            anderson.forget();
        }
        if self.carried.is_some() {
            self.carry_rotations()?;
        } else {
            self.follow_constraints();
            self.fit_rotations();
        }
        let Scratch { pose, goals, .. } = &mut self.scratch;
        for (&slot, goal) in self.roles.held.iter().zip(goals) {
            pose[slot as usize] = *goal;
        }
        self.global_step()
    }

    /// Moves the whole pose along with what holds it, by the rigid motion that takes that nearest to its goals.
    ///
    /// A motion common to all constraints is thus followed exactly, whatever its angle, where the plain guess would
    /// need many iterations. On ordinary edits (ends turned, twisted, lifted or swung, in one jump or twenty steps) it
    /// lowered the energy after two iterations by a few to fifty percent and never raised it by more than one, so it
    /// is always done. The fit is over the constrained vertices next to an unknown and those of soft handles, as far
    /// as these count: no others enter the equations.
    fn follow_constraints(&mut self) {
        let Self { roles, scratch, .. } = self;
        let Scratch { pose, goals, draws, .. } = scratch;
        let hard = roles.held[..roles.rim].iter().zip(&*goals).map(|(&slot, goal)| (slot, goal, 1.0));
        let soft = roles.springs.iter().zip(&*draws).map(|(spring, goal)| (spring.slot, goal, spring.grip));
        let held = hard.chain(soft).map(|(slot, goal, grip)| (pose[slot as usize], *goal, grip));
        if held.clone().all(|(at, goal, _)| at == goal) {
            return;
        }
        let fit = Fit::rigid(held.map(|(at, goal, grip)| (point(at), point(goal), grip)));
        for &slot in roles.unknowns.as_slice().iter().chain(&roles.held) {
            let position = &mut pose[slot as usize];
            *position = row(fit.apply(point(*position)));
        }
    }

    fn carry_rotations(&mut self) -> Result<(), LinalgError> {
        let Self { cells, roles, factor, carried, scratch, times, .. } = self;
        let start = Instant::now();
        let turned = match carried {
            Some(carried) => carried.rotate(cells, roles, factor, &mut scratch.rotations, &mut scratch.rhs),
            None => Ok(()),
        };
        times.global += start.elapsed();
        turned
    }

    fn fit_rotations(&mut self) {
        let Self { cells, roles, scratch, times, .. } = self;
        let start = Instant::now();
        fit_rotations(cells, roles, &scratch.pose, &mut scratch.rotations);
        times.local += start.elapsed();
    }

    fn global_step(&mut self) -> Result<(), LinalgError> {
        let Self { cells, roles, factor, scratch, times, .. } = self;
        let Scratch { pose, draws, rotations, rhs, .. } = scratch;
        let start = Instant::now();
        let moved = move_unknowns(cells, roles, factor, rotations, draws, pose, rhs);
        times.global += start.elapsed();
        moved
    }

    /// Notes the global step just done, and goes where the steps so far seem to lead.
    fn accelerate(&mut self) {
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

    /// The current energy, after a local step. If it has risen above `last` by an acceleration, that is taken back.
    fn safe_energy(&mut self, last: f64, multiplicity: f64) -> f64 {
        let now = self.current_energy(multiplicity);
        if (now > last || now.is_nan()) && self.go_back() {
            self.fit_rotations();
            return self.current_energy(multiplicity);
        }
        now
    }

    /// Takes back an acceleration; whether there was one.
    fn go_back(&mut self) -> bool {
        let Self { roles, anderson, scratch, .. } = self;
        let Some(anderson) = anderson.as_mut().filter(|anderson| anderson.has_mixed()) else { return false };
        for (&slot, &end) in roles.unknowns.as_slice().iter().zip(anderson.end()) {
            scratch.pose[slot as usize] = end;
        }
        anderson.forget();
        true
    }

    /// The energy of the current pose and rotations, in the frame.
    fn current_energy(&mut self, multiplicity: f64) -> f64 {
        let Self { roles, terms, rest, scratch, .. } = self;
        let Scratch { pose, draws, rotations, energy: partial, .. } = scratch;
        energy(terms.as_deref().unwrap_or_default(), roles, rest, pose, rotations, partial)
            + multiplicity * spring_energy(&roles.springs, draws, pose)
    }
}

impl Scratch {
    /// As many places as there are held, drawn and led.
    fn fit(&mut self, roles: &Roles) {
        self.goals.resize(roles.held.len(), Row::default());
        self.draws.resize(roles.springs.len(), Row::default());
        self.landed.resize(roles.led.len(), DVec3::ZERO);
    }
}

fn carried(options: &ArapOptions, cells: &Cells, roles: &Roles) -> Option<Carried> {
    (options.start == Start::Propagated).then(|| Carried::new(cells, roles))
}

fn anderson(options: &ArapOptions, roles: &Roles) -> Option<Anderson> {
    match options.acceleration {
        Acceleration::None => None,
        Acceleration::Anderson { window } => Some(Anderson::new(window as usize, roles.unknowns.as_slice().len())),
    }
}

#[cfg(test)]
mod tests;
