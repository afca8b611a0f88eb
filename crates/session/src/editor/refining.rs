//! A refinement under way.

use std::time::{Duration, Instant};

use glam::DVec3;
use pliant_cage::Binding;
use pliant_deform::{ArapOptions, DeformError, Goals, Method, RefineOptions, Refiner, StepKind};
use pliant_mesh::TriMesh;
use pliant_mesh::metrics::edge_errors;

use super::Pose;
use super::descent::Descent;
use super::held::OnShape;
use crate::Levels;

/// A step on the shape that lowers the energy by less than this share of it ends a refinement.
const SETTLED: f64 = 1e-6;

/// A step that was released, as far as refining it needs.
pub(super) struct Released {
    /// Where it began.
    pub(super) began: Pose,
    pub(super) held: OnShape,
    pub(super) refining: Option<Refining>,
}

/// What a refinement works with besides.
pub(super) struct Means<'a> {
    pub(super) method: &'a Method,
    pub(super) levels: Option<&'a Levels>,
    pub(super) binding: &'a Binding,
    pub(super) subspace_steps: u32,
}

/// A refinement that can be stopped after any step: through the levels, if there are any, and then on the shape.
///
/// While it is on levels, a stop leaves the shape as the levels that have ended made it, at best, or as it was where that was of less
/// energy. So what a number of steps comes to does not depend on stops, and is no worse than what fewer came to.
pub(super) struct Refining {
    shape: Refiner,
    /// The shape where the step began.
    rest: TriMesh,
    goals: Goals,
    descent: Option<Descent>,
    /// The best pose from a level, if it is better than that at first.
    best: Option<Vec<DVec3>>,
    /// Whether the refiner of the shape is at what a stop would leave.
    at_best: bool,
    /// Of the shape as a stop would leave it.
    pub(super) energy: f64,
    /// Steps in the motions of the cage that are still to come.
    subspace_steps: u32,
    /// Steps since it began.
    pub(super) steps: u32,
    /// Whether more steps would change nothing to speak of.
    pub(super) settled: bool,
    /// How often what a stop would leave has become another.
    pub(super) changes: u32,
    /// Error of the shape, and after which change.
    error: Option<(u32, f64)>,
}

/// What a step came to.
pub(super) struct Step {
    /// The mesh it was on: 0 is the shape, 1 the level above it.
    pub(super) level: usize,
    pub(super) vertices: usize,
    pub(super) kind: StepKind,
    /// Of that mesh.
    pub(super) energy: f64,
    pub(super) elapsed: Duration,
}

impl Refining {
    /// Makes ready to refine a pose of the shape, of which `rest` is where the step began.
    pub(super) fn new(rest: TriMesh, held: &OnShape, pose: &[DVec3], means: &Means<'_>) -> Result<Self, DeformError> {
        let options = options(means.method);
        let mut shape = Refiner::prepare(&rest, &held.region, &options)?;
        if means.subspace_steps > 0 {
            shape.set_subspace(means.binding.cage_vertex_count(), |v| means.binding.row(v))?;
        }
        let energy = shape.begin(&held.goals, pose)?;
        let descent = means
            .levels
            .zip(held.on_levels.as_ref())
            .map(|(levels, on_levels)| Descent::new(levels, &rest.positions, pose, on_levels, &held.region, &options));
        Ok(Self {
            shape,
            rest,
            goals: held.goals.clone(),
            descent,
            best: None,
            at_best: true,
            energy,
            subspace_steps: means.subspace_steps,
            steps: 0,
            settled: false,
            changes: 0,
            error: None,
        })
    }

    pub(super) fn step(&mut self) -> Result<Step, DeformError> {
        let begun = Instant::now();
        let mut step = match self.descent.as_mut().and_then(Descent::step) {
            Some((step, carried)) => {
                if let Some(pose) = carried {
                    self.offer(pose);
                }
                step
            }
            None => {
                self.land()?;
                self.on_shape()?
            }
        };
        self.steps += 1;
        step.elapsed = begun.elapsed();
        Ok(step)
    }

    /// Keeps a pose from a level if the shape has less energy in it.
    fn offer(&mut self, mut pose: Vec<DVec3>) {
        let made = self.shape.begin(&self.goals, &pose);
        let made = made.and_then(|energy| self.shape.positions(&mut pose).map(|()| energy));
        // A pose that is none, of a level that broke down, is no better.
        self.at_best = match made {
            Ok(energy) if energy < self.energy => {
                (self.energy, self.best) = (energy, Some(pose));
                self.changes += 1;
                true
            }
            _ => false,
        };
    }

    /// Leaves the levels for the shape.
    fn land(&mut self) -> Result<(), DeformError> {
        if let Some(descent) = self.descent.take() {
            let best = self.best.take();
            if !self.at_best {
                self.shape.begin(&self.goals, best.as_deref().unwrap_or_else(|| descent.before()))?;
            }
        }
        Ok(())
    }

    fn on_shape(&mut self) -> Result<Step, DeformError> {
        let step = if self.subspace_steps > 0 {
            self.subspace_steps -= 1;
            self.shape.subspace_step()?
        } else {
            self.shape.step()?
        };
        self.energy = step.energy.min(self.energy);
        self.changes += 1;
        self.settled = step.kind == StepKind::Full && (step.settled || step.relative_change < SETTLED);
        Ok(Step {
            level: 0,
            vertices: self.rest.vertex_count(),
            kind: step.kind,
            energy: step.energy,
            elapsed: step.elapsed,
        })
    }

    /// Writes what a stop leaves to the pose at first, or to that of a stop before.
    pub(super) fn positions(&self, pose: &mut [DVec3]) -> Result<(), DeformError> {
        match (&self.descent, &self.best) {
            (None, _) => self.shape.positions(pose)?,
            (Some(_), Some(best)) => pose.copy_from_slice(best),
            (Some(_), None) => {}
        }
        Ok(())
    }

    /// Root mean square of relative edge length changes in `pose`, which is what a stop would leave.
    pub(super) fn rms_relative(&mut self, pose: &[DVec3]) -> f64 {
        match self.error {
            Some((at, error)) if at == self.changes => error,
            _ => {
                let error = edge_errors(self.rest.topology(), &self.rest.positions, pose).rms_relative;
                self.error = Some((self.changes, error));
                error
            }
        }
    }
}

/// The weights and the energy of the method that made the preview, or the default ones of a method without.
fn options(method: &Method) -> RefineOptions {
    match method {
        Method::Arap(ArapOptions { weights, energy, .. }) => {
            RefineOptions { weights: *weights, energy: *energy, ..RefineOptions::default() }
        }
        _ => RefineOptions::default(),
    }
}
