use std::time::Instant;

use glam::DVec3;
use pliant_linalg::LinalgError;
use pliant_mesh::TriMesh;
use pliant_mesh::threads::{CHUNK, among_threads};

use super::inverse::Inverse;
use super::memory::Memory;
use super::subspace::Subspace;
use super::{RefineOptions, RefineStep, StepKind, local};
use crate::arap::ArapOptions;
use crate::arap::cells::Cells;
use crate::arap::roles::Roles;
use crate::arap::shape::Shape;
use crate::arap::steps::{Columns, Row, add, point, row, spring_energy};
use crate::frame::{check_count, check_pose};
use crate::{DeformError, Goals, Region};

/// How often a step that raises the energy is halved before it is given up.
const HALVINGS: u32 = 3;

/// A prepared refinement.
///
/// After [`Self::begin`] and any number of [`Self::step`]s, [`Self::positions`] are a valid pose: vertices of hard handles exactly at
/// their goals, fixed ones as they were, and no more energy than before. Results are the same, bit for bit, for any number of threads.
pub struct Refiner {
    shape: Shape,
    region: Region,
    cells: Cells,
    roles: Roles,
    inverse: Inverse,
    memory: Memory,
    subspace: Option<Subspace>,
    /// `sum w |e|^2` over the edges of all cells at rest.
    rest_energy: f64,
    /// Edges of fitted cells between slots that are held: ends, and weight times the number of such cells.
    held_edges: Vec<([u32; 2], f64)>,
    state: State,
}

/// One refinement. All in the frame.
struct State {
    begun: bool,
    /// By slot; only of those that equations look at.
    pose: Vec<Row>,
    rotations: Vec<Columns>,
    /// By unknown: the residual at `pose`, that at a pose that is tried, a direction, and the unknowns before it.
    residual: Vec<Row>,
    trial: Vec<Row>,
    direction: Vec<Row>,
    before: Vec<Row>,
    /// Residual with the rotations from before the handles jumped, which the first step starts from, if they did.
    guess: Vec<Row>,
    has_guess: bool,
    draws: Vec<Row>,
    landed: Vec<DVec3>,
    goals: Vec<Row>,
    /// Of edges that are held.
    held_energy: f64,
    energy: f64,
    iteration: u32,
    /// Partial sums over chunks of cells and of unknowns.
    partial: [Vec<f64>; 2],
}

impl Refiner {
    /// Makes ready to refine poses of `rest` in `region`, whose handles have vertices only.
    ///
    /// Takes about 2 us a vertex with the multigrid solver, and some 250 bytes a vertex for what steps teach.
    ///
    /// # Errors
    /// As [`crate::Method::prepare`]; [`DeformError::PointsNotTaken`] for handles with rows.
    pub fn prepare(rest: &TriMesh, region: &Region, options: &RefineOptions) -> Result<Self, DeformError> {
        check_count("vertices of the region", rest.vertex_count(), region.vertex_count())?;
        if let Some((handle, ..)) = region.rows().next() {
            return Err(DeformError::PointsNotTaken { handle: handle as usize });
        }
        let arap = ArapOptions { weights: options.weights, energy: options.energy, ..ArapOptions::default() };
        let shape = Shape::new(&arap, rest)?;
        region.require_constrained(shape.topology())?;
        let roi: Vec<u32> = region.roi().collect();
        let cells = Cells::new(&shape, &roi);
        let roles = Roles::new(&shape, &cells, region);
        let inverse = Inverse::new(options.solver, &cells, &roles)?;
        let unknowns = roles.unknowns.as_slice().len();
        let (held_edges, rest_energy) = held_edges(&shape, &cells, &roles);
        let rows = || vec![Row::default(); unknowns];
        let state = State {
            begun: false,
            pose: vec![Row::default(); cells.vertices.len()],
            rotations: vec![Columns::default(); cells.cells],
            residual: rows(),
            trial: rows(),
            direction: rows(),
            before: rows(),
            guess: rows(),
            has_guess: false,
            draws: vec![Row::default(); roles.springs.len()],
            landed: vec![DVec3::ZERO; roles.led.len()],
            goals: vec![Row::default(); roles.held.len()],
            held_energy: 0.0,
            energy: 0.0,
            iteration: 0,
            partial: [vec![0.0; cells.cells.div_ceil(CHUNK)], vec![0.0; unknowns.div_ceil(CHUNK)]],
        };
        let memory = Memory::new(unknowns);
        Ok(Self {
            shape,
            region: region.clone(),
            cells,
            roles,
            inverse,
            memory,
            subspace: None,
            rest_energy,
            held_edges,
            state,
        })
    }

    /// Starts from `positions` with the handles at `goals`, and returns the energy there, in world units.
    ///
    /// # Errors
    /// As [`crate::Deformer::solve`]; then there is nothing to step on.
    pub fn begin(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<f64, DeformError> {
        self.state.begun = false;
        goals.check(&self.region)?;
        check_pose(self.region.vertex_count(), positions)?;
        self.read(goals, positions)?;
        among_threads(self.cells.roi, || self.start());
        self.state.begun = true;
        Ok(self.state.energy * self.shape.frame.energy_unit())
    }

    /// Adds the motions of a cage as a subspace to step in.
    ///
    /// `row` gives, for a vertex of the mesh, the cage vertices it follows, below `cage_vertices`, and their weights: the rows of a
    /// binding. Costs a sparse product `W^T L W` and its factor, and does not change the refinement that is going on.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`] for a row with a cage vertex that does not exist, [`DeformError::DegenerateSubspace`], and
    /// [`DeformError::TooLarge`]. Then the refiner is as before.
    pub fn set_subspace<'a>(
        &mut self,
        cage_vertices: usize,
        row: impl Fn(usize) -> (&'a [u32], &'a [f32]),
    ) -> Result<(), DeformError> {
        self.subspace = Subspace::new(&self.cells, &self.roles, cage_vertices, row)?;
        Ok(())
    }

    /// One step towards the minimum, some 0.25 us a vertex. Allocates nothing.
    ///
    /// # Errors
    /// [`DeformError::ResultNotFinite`] if the equations lead nowhere; the pose stays as it was. Without a refinement begun nothing is done.
    pub fn step(&mut self) -> Result<RefineStep, DeformError> {
        self.timed(StepKind::Full, Self::lower)
    }

    /// One step towards the minimum within the motions of the cage; nowhere without [`Self::set_subspace`]. Allocates nothing.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn subspace_step(&mut self) -> Result<RefineStep, DeformError> {
        self.timed(StepKind::Subspace, Self::lower_in_subspace)
    }

    fn timed(
        &mut self,
        kind: StepKind,
        lower: impl FnOnce(&mut Self) -> Result<bool, LinalgError> + Send,
    ) -> Result<RefineStep, DeformError> {
        let start = Instant::now();
        let last = self.state.energy;
        let mut settled = true;
        if self.state.begun {
            let lowered = among_threads(self.cells.roi, || lower(self));
            settled = !lowered.map_err(|error| DeformError::of_system(error, &self.cells.vertices))?;
            self.state.iteration += 1;
        }
        let State { energy, iteration, .. } = self.state;
        Ok(RefineStep {
            kind,
            iteration,
            energy: energy * self.shape.frame.energy_unit(),
            relative_change: if last > 0.0 { (last - energy) / last } else { 0.0 },
            settled,
            elapsed: start.elapsed(),
        })
    }

    /// Writes the current pose: what is solved for and what is led; all else is left alone.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`], and [`DeformError::ResultNotFinite`] for a pose that cannot be written in world units; then nothing is
    /// written.
    pub fn positions(&self, positions: &mut [DVec3]) -> Result<(), DeformError> {
        check_count("positions", self.region.vertex_count(), positions.len())?;
        if !self.state.begun {
            return Ok(());
        }
        let Self { cells, roles, state, .. } = self;
        let at = |slot: u32| self.shape.frame.leave(point(state.pose[slot as usize]));
        let solved = roles.unknowns.as_slice().iter().map(|&slot| (cells.vertices[slot as usize], at(slot)));
        for (vertex, position) in solved.clone() {
            if !position.is_finite() {
                return Err(DeformError::ResultNotFinite { vertex });
            }
        }
        for (vertex, position) in solved {
            positions[vertex as usize] = position;
        }
        for (led, &landed) in roles.led.iter().zip(&state.landed) {
            positions[led.vertex as usize] = landed;
        }
        Ok(())
    }

    /// How many vertices are solved for.
    pub fn unknowns(&self) -> usize {
        self.roles.unknowns.as_slice().len()
    }

    /// Brings pose and goals into the frame.
    fn read(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        let Self { shape, cells, roles, state, .. } = self;
        let frame = &shape.frame;
        let enter = |slot: u32| row(frame.enter(positions[cells.vertices[slot as usize] as usize]));
        for &slot in roles.unknowns.as_slice() {
            state.pose[slot as usize] = enter(slot);
        }
        for (&slot, goal) in roles.held.iter().zip(&mut state.goals) {
            *goal = enter(slot);
            state.pose[slot as usize] = *goal;
        }
        for (led, landed) in roles.led.iter().zip(&mut state.landed) {
            *landed = goals.apply(led.handle, led.rest);
            let inner = frame.enter_goal(*landed, led.handle, led.vertex)?;
            if let Some(goal) = state.goals.get_mut(led.held as usize) {
                *goal = row(inner);
            }
        }
        for (spring, draw) in roles.springs.iter().zip(&mut state.draws) {
            let vertex = cells.vertices[spring.slot as usize];
            *draw = row(frame.enter_goal(goals.apply(spring.handle, spring.rest), spring.handle, vertex)?);
        }
        Ok(())
    }

    /// Puts the handles where they are to be.
    ///
    /// The first step takes the rotations from before: with handles already at their goals, the cells at their rims would see torn
    /// edges and no true rotation.
    fn start(&mut self) {
        self.memory.forget();
        let Self { cells, roles, state, held_edges, .. } = self;
        state.iteration = 0;
        let mut jumped = false;
        local::fit(cells, roles, &state.pose, &mut state.rotations, &mut state.partial[0]);
        for (&slot, goal) in roles.held.iter().zip(&state.goals) {
            let at = &mut state.pose[slot as usize];
            jumped |= at != goal;
            *at = *goal;
        }
        let square = |&([p, q], weight): &([u32; 2], f64)| {
            weight * point(state.pose[p as usize]).distance_squared(point(state.pose[q as usize]))
        };
        state.held_energy = held_edges.iter().map(square).sum();
        self.residual_of_rotations();
        std::mem::swap(&mut self.state.guess, &mut self.state.trial);
        self.state.has_guess = jumped;
        self.state.energy = self.evaluate();
        std::mem::swap(&mut self.state.residual, &mut self.state.trial);
    }

    /// Goes to a lower energy; whether there was one.
    fn lower(&mut self) -> Result<bool, LinalgError> {
        if self.state.take_guess() {
            self.inverse.apply(&self.roles, &mut self.state.direction)?;
            if self.attempt() {
                return Ok(true);
            }
        }
        if !self.memory.is_empty() {
            let state = &mut self.state;
            let mix = self.memory.reduce(&state.residual, &mut state.direction);
            self.inverse.apply(&self.roles, &mut state.direction)?;
            self.memory.restore(&mix, &mut state.direction);
            if self.attempt() {
                return Ok(true);
            }
            self.memory.forget();
        }
        self.state.direction.copy_from_slice(&self.state.residual);
        self.inverse.apply(&self.roles, &mut self.state.direction)?;
        Ok(self.attempt_shorter())
    }

    /// Goes to a lower energy by a motion of the cage; whether there was one.
    fn lower_in_subspace(&mut self) -> Result<bool, LinalgError> {
        let Some(subspace) = &mut self.subspace else { return Ok(false) };
        if self.state.take_guess() {
            subspace.apply(&mut self.state.direction)?;
            if self.attempt() {
                return Ok(true);
            }
        }
        let Some(subspace) = &mut self.subspace else { return Ok(false) };
        self.state.direction.copy_from_slice(&self.state.residual);
        subspace.apply(&mut self.state.direction)?;
        Ok(self.attempt_shorter())
    }

    /// Goes along the direction, if need be not all the way; whether the energy did not rise.
    fn attempt_shorter(&mut self) -> bool {
        for _ in 0..=HALVINGS {
            if self.attempt() {
                return true;
            }
            self.state.direction.iter_mut().flatten().for_each(|x| *x *= 0.5);
        }
        false
    }

    /// Goes along the direction if the energy does not rise, and else stays.
    fn attempt(&mut self) -> bool {
        let State { pose, before, direction, .. } = &mut self.state;
        for ((&slot, before), &direction) in self.roles.unknowns.as_slice().iter().zip(before).zip(&*direction) {
            let at = &mut pose[slot as usize];
            *before = *at;
            add(at, direction, 1.0);
        }
        let energy = self.evaluate();
        let Self { roles, state, memory, .. } = self;
        let unknowns = roles.unknowns.as_slice();
        // Written so that NaN is no success.
        if energy <= state.energy {
            state.energy = energy;
            let pose = &state.pose;
            memory.note(&state.before, |k| pose[unknowns[k] as usize], &state.residual, &state.trial);
            std::mem::swap(&mut state.residual, &mut state.trial);
            true
        } else {
            for (&slot, &before) in unknowns.iter().zip(&state.before) {
                state.pose[slot as usize] = before;
            }
            false
        }
    }

    /// The energy of the pose with its best rotations, in the frame; leaves its residual in `trial`.
    fn evaluate(&mut self) -> f64 {
        let Self { cells, roles, state, .. } = self;
        let trace = local::fit(cells, roles, &state.pose, &mut state.rotations, &mut state.partial[0]);
        let stretch = self.residual_of_rotations();
        let Self { roles, state, shape, .. } = self;
        let m = shape.multiplicity();
        let rest = self.rest_energy;
        let elastic = m * stretch + state.held_energy + rest - 2.0 * trace;
        // Below 0 only by rounding; NaN stays.
        let elastic = if elastic < 0.0 { 0.0 } else { elastic };
        elastic + m * spring_energy(&roles.springs, &state.draws, &state.pose)
    }

    /// Residuals of the unknowns at the current rotations, into `trial`, and the energy's sum over their edges.
    fn residual_of_rotations(&mut self) -> f64 {
        let Self { cells, roles, state, .. } = self;
        let State { pose, rotations, trial, partial, draws, .. } = state;
        let stretch = local::residual(cells, roles, pose, rotations, trial, &mut partial[1]);
        let unknowns = roles.unknowns.as_slice();
        for (spring, goal) in roles.springs.iter().zip(&*draws) {
            // Springs are unknowns, so it is found.
            if let Ok(unknown) = unknowns.binary_search(&spring.slot) {
                for ((sum, goal), at) in trial[unknown].iter_mut().zip(goal).zip(pose[spring.slot as usize]) {
                    *sum += spring.stiffness * (goal - at);
                }
            }
        }
        stretch
    }
}

impl State {
    /// Makes the direction what is known from before the handles jumped, once; whether they did.
    fn take_guess(&mut self) -> bool {
        if self.has_guess {
            self.direction.copy_from_slice(&self.guess);
        }
        std::mem::take(&mut self.has_guess)
    }
}

/// The edges of fitted cells whose ends are both held, with their weight times the number of cells, and `sum w |e|^2` over all edges of
/// fitted cells at rest.
fn held_edges(shape: &Shape, cells: &Cells, roles: &Roles) -> (Vec<([u32; 2], f64)>, f64) {
    let at = |slot: u32| shape.inner[cells.vertices[slot as usize] as usize];
    let is_cell = |slot: u32| roles.fitted.has(slot as usize);
    let (mut held, mut rest) = (Vec::new(), 0.0);
    cells.for_each_term(shape, |term| {
        let count = term.cells.iter().filter(|&&cell| is_cell(cell)).count();
        if count == 0 {
            return;
        }
        let weight = term.weight * count as f64;
        let [p, q] = term.ends;
        rest += weight * at(p).distance_squared(at(q));
        if !roles.unknowns.has(p as usize) && !roles.unknowns.has(q as usize) {
            held.push((term.ends, weight));
        }
    });
    (held, rest)
}
