//! Preparing an edit and solving it.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use pliant_linalg::{Cholesky, LinalgError, Partition, SpdPattern, Triplet};
use pliant_mesh::{MeshError, Topology, TriMesh};

use super::cells::{CellEdges, Cells};
use super::steps::{ENERGY_CHUNK, Spring, energy, fit_rigid, fit_rotations, move_unknowns};
use super::{ArapEnergy, ArapOptions};
use crate::error::HandleFault;
use crate::operators::{FaceWeights, edge_sums, edge_weights, laplacian};
use crate::{Constraint, DeformError, Deformer, Goals, PrepareReport, Region, Role, SolveReport};

/// Soft weights beyond these act as these.
const SOFT_RANGE: [f64; 2] = [1e-10, 1e12];

/// Farthest goal, in diagonals of the rest shape: squares of it and their products must not overflow.
const FARTHEST: f64 = 1e100;

/// Energy, per unit of weight and with a diagonal of 1, that is nothing but rounding.
const ROUNDING_ENERGY: f64 = 1e-29;

/// A prepared as-rigid-as-possible edit.
///
/// Computes in the rest shape's frame, centred and scaled by a power of two to a diagonal between 1/2 and 1, so
/// results follow any scale and offset of the scene. They are the same, bit for bit, for any number of threads.
pub struct Arap {
    options: ArapOptions,
    region: Region,
    frame: Frame,
    cells: Cells,
    multiplicity: f64,
    /// Unknowns in soft handles.
    springs: Vec<Spring>,
    /// Vertices in hard handles.
    led: Vec<Led>,
    factor: Cholesky,
    report: PrepareReport,
    /// Rest positions in world units of the vertices of `led`, then of `springs`.
    world_rest: Vec<DVec3>,
    /// In the frame, by slot.
    rest: Vec<DVec3>,
    scratch: Scratch,
}

/// A vertex of a hard handle.
struct Led {
    vertex: u32,
    handle: u32,
    /// `None` if no free vertex is near.
    slot: Option<u32>,
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame.
#[derive(Default)]
struct Scratch {
    /// By slot.
    pose: Vec<DVec3>,
    /// By slot; unused for unknowns without a spring.
    goals: Vec<DVec3>,
    /// By cell.
    rotations: Vec<DMat3>,
    /// By unknown.
    rhs: Vec<[f64; 3]>,
    /// Of [`ENERGY_CHUNK`] terms each.
    energy: Vec<f64>,
    /// Goals of `led` in world units.
    landed: Vec<DVec3>,
}

/// A centred frame of unit size. The scale is a power of two, so going there and back rounds only once.
#[derive(Debug, Clone, Copy)]
struct Frame {
    centre: DVec3,
    scale: f64,
}

impl Frame {
    fn of(mesh: &TriMesh) -> Self {
        let (centre, scale) = mesh.bounds().normal_frame();
        // Keeps the exponent and drops the digits.
        let power = f64::from_bits(scale.clamp(f64::MIN_POSITIVE, 1e300).to_bits() & 0xFFF0_0000_0000_0000);
        Self { centre, scale: power }
    }

    fn enter(&self, world: DVec3) -> DVec3 {
        (world - self.centre) * self.scale
    }

    fn leave(&self, inner: DVec3) -> DVec3 {
        inner / self.scale + self.centre
    }
}

impl Arap {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &ArapOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        if region.vertex_count() != rest.vertex_count() {
            let (expected, found) = (rest.vertex_count(), region.vertex_count());
            return Err(DeformError::WrongCount { what: "vertices of the region", expected, found });
        }
        let frame = Frame::of(rest);
        let inner = rest.with_positions(rest.positions.iter().map(|&p| frame.enter(p)).collect())?;
        let topology = inner.topology();
        let (edges, matrix, clamped_weights) = weigh(options, &inner);
        let (unknown, unconstrained) = find_unknowns(topology, region);
        let partition = Partition::new(rest.vertex_count(), |v| unknown[v]).map_err(DeformError::TooLarge)?;
        let mut block = partition.free_block(&laplacian(topology, &matrix)).map_err(DeformError::TooLarge)?;
        let springs = springs(region, &partition, mean_diagonal(&block, partition.free().len()));
        block.extend(springs.iter().map(|s| Triplet::new(s.slot, s.slot, s.stiffness)));
        let factor = factor(&partition, &block)?;

        let cells = Cells::new(topology, &inner.positions, &edges, &matrix, partition.free());
        let led = led(region, &cells);
        let soft = springs.iter().map(|s| cells.vertices[s.slot as usize]);
        let world_rest = led.iter().map(|l| l.vertex).chain(soft).map(|v| rest.positions[v as usize]).collect();
        let rest = cells.vertices.iter().map(|&v| inner.positions[v as usize]).collect();
        let report = PrepareReport {
            unknowns: cells.unknowns,
            unconstrained,
            clamped_weights,
            factor_len: factor.pattern().factor_len(),
        };
        let scratch = Scratch::new(&cells, led.len());
        let (options, region, multiplicity) = (options.clone(), region.clone(), edges.multiplicity());
        Ok(Self {
            options,
            region,
            frame,
            cells,
            multiplicity,
            springs,
            led,
            factor,
            report,
            world_rest,
            rest,
            scratch,
        })
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
        self.read(goals, positions)?;
        fit_rotations(&self.cells, &self.scratch.pose, &mut self.scratch.rotations);
        Ok(self.current_energy() / (self.frame.scale * self.frame.scale))
    }

    /// Checks the input and brings pose and goals into the frame.
    fn read(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        goals.check(&self.region)?;
        let (expected, found) = (self.region.vertex_count(), positions.len());
        if expected != found {
            return Err(DeformError::WrongCount { what: "positions", expected, found });
        }
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NotFinite { vertex }.into());
        }
        let Self { frame, cells, scratch, .. } = self;
        for ((pose, goal), &v) in scratch.pose.iter_mut().zip(&mut scratch.goals).zip(&cells.vertices) {
            *pose = frame.enter(positions[v as usize]);
            *goal = *pose;
        }
        let (led_rest, soft_rest) = self.world_rest.split_at(self.led.len());
        for ((led, &rest), landed) in self.led.iter().zip(led_rest).zip(&mut scratch.landed) {
            *landed = goals.apply(led.handle, rest);
            let inner = within_reach(frame, *landed, led.handle, led.vertex)?;
            if let Some(slot) = led.slot {
                scratch.goals[slot as usize] = inner;
            }
        }
        for (spring, &rest) in self.springs.iter().zip(soft_rest) {
            let vertex = cells.vertices[spring.slot as usize];
            scratch.goals[spring.slot as usize] =
                within_reach(frame, goals.apply(spring.handle, rest), spring.handle, vertex)?;
        }
        Ok(())
    }

    /// The initial guess: the global step from the rotations of the incoming pose.
    ///
    /// Those rotations are taken before the handles jump: with handles already at their goals, the cells at their rims
    /// would see torn edges and no true rotation. From rest all of them are one rotation: the identity (Sorkine and
    /// Alexa's guess) unless the constraints turn as a whole.
    fn guess(&mut self) -> Result<(), LinalgError> {
        self.follow_constraints();
        let Self { cells, scratch, .. } = self;
        fit_rotations(cells, &scratch.pose, &mut scratch.rotations);
        scratch.pose[cells.unknowns..].copy_from_slice(&scratch.goals[cells.unknowns..]);
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
        let Self { cells, scratch, springs, .. } = self;
        let Scratch { pose, goals, .. } = scratch;
        let hard = (cells.unknowns..cells.cells).map(|slot| (slot, 1.0));
        let held = hard.chain(springs.iter().map(|s| (s.slot as usize, s.grip)));
        if held.clone().all(|(slot, _)| pose[slot] == goals[slot]) {
            return;
        }
        let (rotation, translation) = fit_rigid(held.map(|(slot, grip)| (pose[slot], goals[slot], grip)));
        for position in pose {
            *position = rotation * *position + translation;
        }
    }

    fn global_step(&mut self) -> Result<(), LinalgError> {
        let Self { cells, factor, springs, scratch, .. } = self;
        let Scratch { pose, goals, rotations, rhs, .. } = scratch;
        move_unknowns(cells, factor, rotations, springs, goals, pose, rhs)
    }

    /// The energy of the current pose and rotations, in the frame.
    fn current_energy(&mut self) -> f64 {
        let Self { cells, rest, springs, scratch, multiplicity, .. } = self;
        let Scratch { pose, goals, rotations, energy: partial, .. } = scratch;
        let stretched = |s: &Spring| s.stiffness * (pose[s.slot as usize] - goals[s.slot as usize]).length_squared();
        energy(cells, rest, pose, rotations, partial) + *multiplicity * springs.iter().map(stretched).sum::<f64>()
    }

    /// Guess and iterations. The local step of iteration `k + 1` also tells the energy after iteration `k`.
    fn iterate(&mut self) -> Result<SolveReport, LinalgError> {
        let mut report = SolveReport { unconstrained: self.report.unconstrained, ..SolveReport::default() };
        self.guess()?;
        let rounding = ROUNDING_ENERGY * self.cells.terms.iter().map(|t| t.weight.abs()).sum::<f64>();
        let unit = 1.0 / (self.frame.scale * self.frame.scale);
        let mut last = f64::INFINITY;
        loop {
            let at_end = report.iterations == self.options.iterations;
            if at_end && self.options.tolerance.is_none() {
                return Ok(report);
            }
            fit_rotations(&self.cells, &self.scratch.pose, &mut self.scratch.rotations);
            if let Some(tolerance) = self.options.tolerance {
                let now = self.current_energy();
                report.energy_before.get_or_insert(now * unit);
                report.energy_after = Some(now * unit);
                report.converged = last - now <= tolerance * last && last.is_finite() || now <= rounding;
                if report.converged || at_end {
                    return Ok(report);
                }
                last = now;
            }
            self.global_step()?;
            report.iterations += 1;
        }
    }

    /// Names the vertex behind an unknown.
    fn vertex(&self, unknown: usize) -> u32 {
        self.cells.vertices.get(unknown).copied().unwrap_or(u32::MAX)
    }
}

impl Deformer for Arap {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.read(goals, positions)?;
        let report = self.iterate().map_err(|error| match error {
            LinalgError::SolutionNotFinite { unknown } => DeformError::ResultNotFinite { vertex: self.vertex(unknown) },
            LinalgError::NotPositiveDefinite { unknown } => DeformError::Singular { vertex: self.vertex(unknown) },
            other => DeformError::TooLarge(other),
        })?;
        let solved = self.cells.vertices[..self.cells.unknowns].iter().zip(&self.scratch.pose);
        for (&vertex, &p) in solved.clone() {
            if !self.frame.leave(p).is_finite() {
                return Err(DeformError::ResultNotFinite { vertex });
            }
        }
        for (&vertex, &p) in solved {
            positions[vertex as usize] = self.frame.leave(p);
        }
        for (led, &landed) in self.led.iter().zip(&self.scratch.landed) {
            positions[led.vertex as usize] = landed;
        }
        Ok(report)
    }

    fn prepared(&self) -> PrepareReport {
        self.report
    }
}

impl Scratch {
    fn new(cells: &Cells, led: usize) -> Self {
        Self {
            pose: vec![DVec3::ZERO; cells.vertices.len()],
            goals: vec![DVec3::ZERO; cells.vertices.len()],
            rotations: vec![DMat3::IDENTITY; cells.cells],
            rhs: vec![[0.0; 3]; cells.unknowns],
            energy: vec![0.0; cells.terms.len().div_ceil(ENERGY_CHUNK)],
            landed: vec![DVec3::ZERO; led],
        }
    }
}

/// Weights of the energy, weights of the matrix per edge, and how many were clamped.
fn weigh(options: &ArapOptions, mesh: &TriMesh) -> (CellEdges, Vec<f64>, usize) {
    match options.energy {
        ArapEnergy::Spokes => {
            let weights = edge_weights(mesh, options.weights);
            (CellEdges::Spokes(weights.values.clone()), weights.values, weights.clamped)
        }
        ArapEnergy::SpokesAndRims => {
            let weights = FaceWeights::new(mesh, options.weights);
            let (matrix, clamped) = (edge_sums(mesh.topology(), &weights.values), weights.clamped);
            (CellEdges::SpokesAndRims(weights), matrix, clamped)
        }
    }
}

/// Whether each vertex is to be solved for, and how many that should be are connected to nothing that holds them.
///
/// Every weight is positive, so a vertex is held if and only if edges between unknowns lead from it to a soft handle
/// or to a neighbour that is not solved for. What is held by nothing would make the matrix singular, and stays where
/// it is.
fn find_unknowns(topology: &Topology, region: &Region) -> (Vec<bool>, usize) {
    let count = region.vertex_count();
    let soft = |v: usize| matches!(region.constraint(v), Some(Constraint::Soft(_)));
    let candidate = |v: usize| region.roles()[v] == Role::Free || soft(v);
    let mut reached = vec![false; count];
    let mut stack: Vec<u32> = Vec::new();
    for v in (0..count).filter(|&v| candidate(v)) {
        if soft(v) || topology.neighbours(v).iter().any(|&w| !candidate(w as usize)) {
            reached[v] = true;
            stack.push(v as u32);
        }
    }
    while let Some(v) = stack.pop() {
        for &w in topology.neighbours(v as usize) {
            if candidate(w as usize) && !reached[w as usize] {
                reached[w as usize] = true;
                stack.push(w);
            }
        }
    }
    let unconstrained = (0..count).filter(|&v| candidate(v) && !reached[v]).count();
    (reached, unconstrained)
}

fn mean_diagonal(block: &[Triplet], unknowns: usize) -> f64 {
    let sum: f64 = block.iter().filter(|t| t.row == t.col).map(|t| t.value).sum();
    // A matrix of lone vertices is zero; any scale will do.
    if sum > 0.0 { sum / unknowns as f64 } else { 1.0 }
}

fn springs(region: &Region, partition: &Partition, mean_diagonal: f64) -> Vec<Spring> {
    let of_unknown = |(slot, &v): (usize, &u32)| match (region.roles()[v as usize], region.constraint(v as usize)) {
        (Role::Handle(handle), Some(Constraint::Soft(weight))) => {
            let weight = weight.clamp(SOFT_RANGE[0], SOFT_RANGE[1]);
            // In series with a surface of stiffness 1.
            let grip = weight / (1.0 + weight);
            Some(Spring { slot: slot as u32, handle, stiffness: weight * mean_diagonal, grip })
        }
        _ => None,
    };
    partition.free().iter().enumerate().filter_map(of_unknown).collect()
}

fn factor(partition: &Partition, block: &[Triplet]) -> Result<Cholesky, DeformError> {
    let vertex = |unknown: usize| partition.free().get(unknown).copied().unwrap_or(u32::MAX);
    SpdPattern::new(partition.free().len(), block)
        .and_then(|pattern| Cholesky::new(Arc::new(pattern), block.iter().map(|t| t.value)))
        .map_err(|error| match error {
            LinalgError::NotPositiveDefinite { unknown } => DeformError::Singular { vertex: vertex(unknown) },
            other => DeformError::TooLarge(other),
        })
}

fn led(region: &Region, cells: &Cells) -> Vec<Led> {
    let mut slots: Vec<(u32, u32)> = (0..).zip(&cells.vertices).map(|(slot, &v)| (v, slot)).collect();
    slots.sort_unstable();
    let slot = |vertex: u32| slots.binary_search_by_key(&vertex, |&(v, _)| v).ok().map(|at| slots[at].1);
    let hard =
        |(handle, h): (u32, &crate::Handle)| (h.constraint == Constraint::Hard).then_some((handle, h.vertices.clone()));
    (0..)
        .zip(region.handles())
        .filter_map(hard)
        .flat_map(|(handle, vertices)| {
            let led = |&vertex: &u32| Led { vertex, handle, slot: slot(vertex) };
            vertices.as_slice().iter().map(led).collect::<Vec<_>>()
        })
        .collect()
}

/// A handle vertex's goal in the frame, if it can be computed with.
fn within_reach(frame: &Frame, goal: DVec3, handle: u32, vertex: u32) -> Result<DVec3, DeformError> {
    let inner = frame.enter(goal);
    // Written so that NaN and infinity are too far.
    if inner.abs().max_element() <= FARTHEST && goal.is_finite() {
        Ok(inner)
    } else {
        Err(DeformError::handle(handle as usize, HandleFault::TooFar { vertex }))
    }
}
