//! From what the cage says to what the shape itself would.

use std::time::{Duration, Instant};

use glam::DVec3;
use pliant_deform::StepKind;
use pliant_mesh::{Progress, Silent};

use super::Editor;
use super::descent::bind_options;
use super::refining::{Means, Refining, Released, Step};
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
    /// nothing is to be gained; one step of it at least, and none once it has settled. Call it again when idle. Handles stay on their goals,
    /// nothing moves outside the region, and the energy of the shape never rises.
    ///
    /// A large shape ([`EditorOptions::levels_from`](super::EditorOptions::levels_from)) is refined on coarser levels of itself first, the coarsest
    /// first. The shape follows as each of them ends, not before. They are made by the first call, unless
    /// [`Self::prepare_levels`] did.
    ///
    /// Holds about 1 KB a free vertex from the first step until something else is done, and 0.4 KB more while it is on levels.
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
        let mut pose = self.base.shape.clone();
        self.refine_while(|refining, step| {
            // What cannot be written ends the refinement with its error.
            let written = refining.positions(&mut pose).is_ok();
            let (steps, rms_relative) = (refining.steps, refining.rms_relative(&pose));
            let Step { level, vertices, kind, energy, elapsed, .. } = *step;
            written && goes_on(&RefineReport { steps, level, vertices, kind, energy, rms_relative, elapsed })
        })
    }

    /// Makes the levels that refinements of large steps go through, so that the first of them need not; all that is reported to `progress`
    /// is one part of it after the other. They depend on the shape as it was opened alone, and are kept as long as the editor.
    ///
    /// Takes about 4 us a vertex of the shape, and 400 bytes.
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

    fn refine_while(&mut self, goes_on: impl FnMut(&mut Refining, &Step) -> bool) -> Result<Refinement, SessionError> {
        let begun = Instant::now();
        let Some(Released { held, refining, .. }) = &self.released else { return Err(SessionError::NothingToRefine) };
        if refining.is_none() && held.on_levels.is_some() && self.prepare_levels(&Silent).is_err() {
            self.shape_levels = Some(Levels::default());
        }
        let made = self.refine_shape(goes_on);
        let (made, shape) = made.inspect_err(|_| self.released = None)?;
        if let (Some(step), Some(released)) = (self.steps.last_mut(), &self.released) {
            step.refined = released.refining.as_ref().map_or(0, |refining| refining.steps);
        }
        if let Some(shape) = shape {
            self.history.amend(self.base.arrays(), [&shape, &self.base.cage]);
            self.base.shape = shape;
            self.current.copy_from(&self.base);
            // A step under way goes on from here; one that cannot is for the next update to tell.
            self.prepared = None;
            if self.is_under_way() {
                _ = self.update(Duration::ZERO);
            }
        }
        Ok(Refinement { elapsed: begun.elapsed(), ..made })
    }

    /// Does the steps, and gives the shape they leave if it is another.
    fn refine_shape(
        &mut self,
        mut goes_on: impl FnMut(&mut Refining, &Step) -> bool,
    ) -> Result<(Refinement, Option<Vec<DVec3>>), SessionError> {
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
                empty.insert(Refining::new(rest, &released.held, &self.base.shape, &means)?)
            }
        };
        let (first, before, changes) = (refining.steps, refining.energy, refining.changes);
        // A step more once it has settled would be one that a replay, which ends there, does not do.
        while !refining.settled {
            let step = refining.step()?;
            if !goes_on(refining, &step) {
                break;
            }
        }
        let mut shape = None;
        if refining.changes != changes {
            let pose = shape.insert(self.base.shape.clone());
            refining.positions(pose)?;
        }
        let refinement = Refinement {
            steps: refining.steps - first,
            energy: [before, refining.energy],
            rms_relative: refining.rms_relative(shape.as_deref().unwrap_or(&self.base.shape)),
            settled: refining.settled,
            elapsed: Duration::ZERO,
        };
        Ok((refinement, shape))
    }
}
