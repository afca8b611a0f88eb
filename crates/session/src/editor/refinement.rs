//! From what the cage says to what the shape itself would.

use std::time::{Duration, Instant};

use pliant_deform::StepKind;
use pliant_mesh::metrics::edge_errors;
use pliant_mesh::{Progress, Silent};

use super::descent::bind_options;
use super::refining::{Means, Refining, Step};
use super::{Editor, Pose};
use crate::{Levels, SessionError};

/// How far a refinement has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineReport {
    /// Steps since the release, this one included.
    pub steps: u32,
    /// The mesh that the step was on: 0 is the shape, 1 the level of a quarter of its vertices, and so on.
    pub level: usize,
    /// Vertices of that mesh.
    pub vertices: usize,
    /// Where the step could go.
    pub kind: StepKind,
    /// Energy of that mesh after the step, in world units; on the shape as [`Refinement::energy`]. Never rises from step to step on a
    /// mesh, but is not to be compared with that of another.
    pub energy: f64,
    /// Root mean square of relative edge length changes of the shape, from where the step of the session began to where it would be left
    /// now.
    pub rms_relative: f64,
    /// Time that the step took.
    pub elapsed: Duration,
}

/// What a refinement did.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Steps done in this call.
    pub steps: u32,
    /// Energy of the shape before and after, in world units ([`pliant_deform::arap::Arap::energy`]). Never rises.
    pub energy: [f64; 2],
    /// Root mean square of relative edge length changes from where the step began to the refined shape.
    pub rms_relative: f64,
    /// Whether more steps would change nothing to speak of.
    pub settled: bool,
    /// Time taken, preparation included.
    pub elapsed: Duration,
}

impl Editor {
    /// Takes the step released last towards the converged as-rigid-as-possible solution on the shape itself, until the time is up or
    /// nothing is to be gained; one step of it at least. Call it again when idle. Handles stay on their goals, nothing moves outside the
    /// region, and the energy of the shape never rises.
    ///
    /// A large shape ([`EditorOptions::levels_from`](super::EditorOptions::levels_from)) is refined on coarser levels of itself first, the coarsest
    /// first. The shape follows as each of them ends, not before. They are made by the first call, unless
    /// [`Self::prepare_levels`] did.
    ///
    /// The step is still one step to undo, and a document replays its refinement to the same bits: they depend on the number of steps in all, not
    /// on where it was stopped between.
    ///
    /// # Errors
    /// [`SessionError::NothingToRefine`] if nothing was released since the last undo, redo or change of handles; as
    /// [`pliant_deform::Refiner::prepare`] and [`pliant_deform::Refiner::step`]. Then the shape is as it was, and there is nothing to refine any more.
    pub fn refine(&mut self, budget: Duration) -> Result<Refinement, SessionError> {
        let begun = Instant::now();
        self.refine_while(|_, _| begun.elapsed() < budget)
    }

    /// As [`Self::refine`], telling energy and edge error after each step, for as long as `goes_on` says so.
    ///
    /// # Errors
    /// As [`Self::refine`].
    pub fn refine_with(&mut self, mut goes_on: impl FnMut(&RefineReport) -> bool) -> Result<Refinement, SessionError> {
        let (topology, mut pose) = (self.rest.shared_topology(), self.base.shape.clone());
        let Some(released) = &self.released else { return Err(SessionError::NothingToRefine) };
        let began = released.began.shape.clone();
        self.refine_while(|refining, step| {
            // What cannot be written ends the refinement with its error.
            let written = refining.positions(&mut pose).is_ok();
            let rms_relative = edge_errors(&topology, &began, &pose).rms_relative;
            let Step { level, vertices, kind, energy, elapsed, .. } = *step;
            let steps = refining.steps;
            written && goes_on(&RefineReport { steps, level, vertices, kind, energy, rms_relative, elapsed })
        })
    }

    /// Makes the levels that refinements of large steps go through, so that the first of them need not; all that is reported to `progress`
    /// is one part of it after the other. They depend on the shape as it was opened alone, and are kept as long as the editor.
    ///
    /// Takes about 4 us a vertex of the shape, and 500 bytes.
    ///
    /// # Errors
    /// As [`Levels::down_to`]; cancelling is one of them. Then refinements make them, or go without if they cannot be made.
    pub fn prepare_levels(&mut self, progress: &dyn Progress) -> Result<&Levels, SessionError> {
        let made = match self.shape_levels.take() {
            Some(made) => made,
            None => Levels::down_to(self.simplified.mesh.vertex_count(), &self.rest, &bind_options(), progress)?,
        };
        Ok(self.shape_levels.insert(made))
    }

    /// So many steps, or until nothing is to be gained.
    pub(super) fn refine_steps(&mut self, steps: u32) -> Result<Refinement, SessionError> {
        self.refine_while(|refining, _| refining.steps < steps)
    }

    fn refine_while(&mut self, goes_on: impl FnMut(&Refining, &Step) -> bool) -> Result<Refinement, SessionError> {
        let begun = Instant::now();
        let goes_through_levels =
            self.released.as_ref().is_some_and(|r| r.refining.is_none() && r.held.on_levels.is_some());
        if goes_through_levels && self.prepare_levels(&Silent).is_err() {
            self.shape_levels = Some(Levels::default());
        }
        let mut refined = self.base.clone();
        let made = self.refine_pose(&mut refined, goes_on);
        let made = made.inspect_err(|_| self.released = None)?;
        if let (Some(step), Some(refining)) =
            (self.steps.last_mut(), self.released.as_ref().and_then(|r| r.refining.as_ref()))
        {
            step.refined = refining.steps;
        }
        self.history.amend(self.base.arrays(), refined.arrays());
        self.base = refined;
        self.current.copy_from(&self.base);
        Ok(Refinement { elapsed: begun.elapsed(), ..made })
    }

    /// Refines `pose`, which is the one at the end of the last step.
    fn refine_pose(
        &mut self,
        pose: &mut Pose,
        mut goes_on: impl FnMut(&Refining, &Step) -> bool,
    ) -> Result<Refinement, SessionError> {
        let Some(released) = &mut self.released else { return Err(SessionError::NothingToRefine) };
        let refining = match &mut released.refining {
            Some(refining) => refining,
            empty => {
                let rest = self.rest.with_positions(released.began.shape.clone())?;
                let means = Means {
                    method: &self.options.method,
                    levels: self.shape_levels.as_ref(),
                    binding: &self.bound.binding,
                    subspace_steps: self.options.subspace_steps,
                };
                empty.insert(Refining::new(&rest, &released.held, &pose.shape, &means)?)
            }
        };
        let (before, first) = (refining.energy, refining.steps);
        let settled = loop {
            let step = refining.step()?;
            // Told of the last step, too.
            if !goes_on(refining, &step) || step.settled {
                break step.settled;
            }
        };
        refining.positions(&mut pose.shape)?;
        let rms_relative = edge_errors(self.rest.topology(), &released.began.shape, &pose.shape).rms_relative;
        Ok(Refinement {
            steps: refining.steps - first,
            energy: [before, refining.energy],
            rms_relative,
            settled,
            elapsed: Duration::ZERO,
        })
    }
}
