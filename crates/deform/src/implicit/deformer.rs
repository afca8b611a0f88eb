//! Preparing an edit and solving it.

use std::time::{Duration, Instant};

use glam::{DMat3, DVec3};
use pliant_linalg::LinalgError;
use pliant_mesh::threads::among_threads;
use pliant_mesh::{TriMesh, best_rotation, best_scale, outer};

use super::energy::Energy;
use super::plan::{Hold, Plan, release_positions};
use super::rows::LaplacianRows;
use super::shear::Shear;
use super::{FeatureSize, ImplicitConstraints, ImplicitOptions, ImplicitStage};
use crate::patch::{Held, Patch};
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport, StepTimes};

/// A goal that scales by more than this scales features, by default.
const RIGID: f64 = 1e-9;

/// A prepared implicit Laplacian edit.
///
/// Results do not depend on the incoming pose of the vertices that are solved for, follow any scale and offset of the scene, and are the
/// same, bit for bit, for any number of threads. A similarity common to all handles (and to what is fixed) is reproduced to
/// rounding times the condition of the equations, unless [`FeatureSize::Keep`] asks for features of another size.
pub struct Implicit {
    options: ImplicitOptions,
    rest: TriMesh,
    edit: Edit,
}

/// What the paper's Table 1 lists. Times of solving are those of the last solve, zero for what it did not do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ImplicitReport {
    /// Vertices solved for.
    pub free_vertices: usize,
    /// Vertices without a well-conditioned ring: those displaced, and those whose rings were added to (section 3.3).
    pub degenerate_vertices: usize,
    /// Assembling and factoring Eq. 7.
    pub factor_first: Duration,
    /// Solving Eq. 7 for three coordinates, with refinement and multipliers.
    pub solve_first: Duration,
    /// Assembling and factoring Eq. 9 and 10, which share a matrix.
    pub factor_second: Duration,
    /// Solving Eq. 9 or 10 for three coordinates.
    pub solve_second: Duration,
    /// Rotations and scales of all gradients; the paper decomposes them by singular values.
    pub svd: Duration,
}

/// What depends on the region.
struct Edit {
    patch: Patch,
    plan: Plan,
    laplacian: LaplacianRows,
    energy: Energy,
    shear: Shear,
    hold: Hold,
    solution: Vec<DVec3>,
    report: ImplicitReport,
}

impl Implicit {
    /// Assembles and factors both systems; see [`crate::Method::prepare`].
    ///
    /// With two rings the first matrix has some 60 entries a row, the second some 20.
    ///
    /// # Errors
    /// As [`crate::Method::prepare`]. [`DeformError::Unconstrained`] also for gradients alone where a part of the region touches no fixed
    /// vertex.
    pub fn prepare(options: &ImplicitOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        let edit = Edit::new(options, rest, region)?;
        Ok(Self { options: options.clone(), rest: rest.clone(), edit })
    }

    /// Counts and times, as the paper's Table 1 has them.
    pub fn report(&self) -> ImplicitReport {
        self.edit.report
    }
}

impl Deformer for Implicit {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.edit.solve(&self.options, self.options.stage, goals, positions)
    }

    fn solve_preview(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.edit.solve(&self.options, ImplicitStage::Preview, goals, positions)
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        self.edit = Edit::new(&self.options, &self.rest, region)?;
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        PrepareReport {
            unknowns: self.edit.report.free_vertices,
            clamped_weights: self.edit.laplacian.clamped,
            factor_len: self.edit.energy.solve_len() + self.edit.shear.solve_len(),
        }
    }

    fn step_times(&self) -> StepTimes {
        let ImplicitReport { svd, solve_first, solve_second, .. } = self.edit.report;
        StepTimes { local: svd, global: solve_first + solve_second }
    }

    fn implicit_report(&self) -> Option<ImplicitReport> {
        Some(self.report())
    }
}

impl Edit {
    fn new(options: &ImplicitOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        // Gradients of fixed vertices within the rings are those of their fixed neighbours.
        let mut patch = Patch::new(rest, region, options.rings as usize + 1)?;
        if options.constraints == ImplicitConstraints::Gradients {
            release_positions(&mut patch);
            require_fixed(&patch)?;
        }
        let plan = Plan::new(&patch, options);
        let named = |error| named(error, &patch);
        let start = Instant::now();
        let laplacian = LaplacianRows::new(&patch.mesh, options.weights);
        let energy = Energy::new(&patch, &plan, &laplacian).map_err(named)?;
        let factor_first = start.elapsed();
        let start = Instant::now();
        let shear = Shear::new(&patch, &plan, &laplacian, &energy.stencils).map_err(named)?;
        let report = ImplicitReport {
            free_vertices: patch.unknown_count(),
            degenerate_vertices: energy.stencils.degenerate,
            factor_first,
            factor_second: start.elapsed(),
            ..ImplicitReport::default()
        };
        let hold = Hold { places: Vec::new(), gradients: vec![DMat3::IDENTITY; patch.held.len()] };
        Ok(Self { patch, plan, laplacian, energy, shear, hold, solution: Vec::new(), report })
    }

    fn solve(
        &mut self,
        options: &ImplicitOptions,
        stage: ImplicitStage,
        goals: &Goals,
        positions: &mut [DVec3],
    ) -> Result<SolveReport, DeformError> {
        self.patch.read(goals, positions, &mut self.hold.places)?;
        self.read_gradients(goals);
        let Self { patch, plan, laplacian, energy, shear, hold, solution, report } = self;
        solution.clone_from(&hold.places);
        let start = Instant::now();
        energy.minimise(laplacian, hold, solution).map_err(|error| named(error, patch))?;
        report.solve_first = start.elapsed();
        (report.svd, report.solve_second) = (Duration::ZERO, Duration::ZERO);
        if stage == ImplicitStage::Full {
            let is_scaled = match options.features {
                FeatureSize::Keep => false,
                FeatureSize::Scale => true,
                FeatureSize::Auto => goals.transforms.iter().any(|goal| (goal.scale - 1.0).abs() > RIGID),
            };
            let start = Instant::now();
            let gradients = energy.gradients();
            let svd = among_threads(gradients.len(), || shear.remove(gradients, is_scaled, plan, hold, solution))
                .map_err(|error| named(error, patch))?;
            report.svd = svd;
            report.solve_second = start.elapsed() - svd;
        }
        patch.write(solution, goals, positions)?;
        Ok(SolveReport::default())
    }

    /// The gradients of what is held: linear parts of goals, and of fixed vertices what their fixed neighbours have undergone since rest.
    ///
    /// The paper has the border of the region at rest, so that its gradients are the identity; they are here too as long as no earlier edit
    /// moved it.
    fn read_gradients(&mut self, goals: &Goals) {
        let Self { patch, plan, hold, .. } = self;
        for (v, held) in patch.held.iter().enumerate().filter(|(v, _)| plan.is_read[*v]) {
            hold.gradients[v] = match held.handle() {
                Some(handle) => goals.transforms[handle as usize].linear(),
                None if *held == Held::Fixed => fixed_similarity(patch, &hold.places, v),
                None => continue,
            };
        }
    }
}

/// The similarity that takes a fixed vertex and its fixed neighbours nearest from rest to where they are; the identity if it has none.
/// Neighbours on one line leave the turn about it open: the smallest is taken.
fn fixed_similarity(patch: &Patch, places: &[DVec3], v: usize) -> DMat3 {
    let rest = &patch.mesh.positions;
    let fixed = patch.mesh.topology().neighbours(v).iter().map(|&j| j as usize);
    let (mut covariance, mut squares) = (DMat3::ZERO, 0.0);
    for j in fixed.filter(|&j| patch.held[j] == Held::Fixed) {
        let arm = rest[j] - rest[v];
        covariance += outer(places[j] - places[v], arm);
        squares += arm.length_squared();
    }
    let rotation = best_rotation(covariance);
    rotation * best_scale(rotation, covariance, squares)
}

/// Refuses unknown vertices that no path through unknown ones joins to a fixed one.
fn require_fixed(patch: &Patch) -> Result<(), DeformError> {
    let topology = patch.mesh.topology();
    let mut is_reached: Vec<bool> = patch.held.iter().map(|held| *held == Held::Fixed).collect();
    let mut stack: Vec<u32> = (0..).zip(&is_reached).filter(|(_, reached)| **reached).map(|(v, _)| v).collect();
    while let Some(v) = stack.pop() {
        for &j in topology.neighbours(v as usize) {
            if !std::mem::replace(&mut is_reached[j as usize], true) {
                stack.push(j);
            }
        }
    }
    let count = is_reached.iter().filter(|reached| !**reached).count();
    match is_reached.iter().position(|reached| !reached) {
        Some(first) => Err(DeformError::Unconstrained { vertex: patch.vertices[first], count }),
        None => Ok(()),
    }
}

/// An error of a system, whose unknowns are numbered as the vertices of the patch.
fn named(error: LinalgError, patch: &Patch) -> DeformError {
    let vertex = |unknown: usize| patch.vertices.get(unknown).copied().unwrap_or(u32::MAX);
    match error {
        LinalgError::NotPositiveDefinite { unknown } => DeformError::Singular { vertex: vertex(unknown) },
        LinalgError::SolutionNotFinite { unknown } => DeformError::ResultNotFinite { vertex: vertex(unknown) },
        error => DeformError::TooLarge(error),
    }
}
