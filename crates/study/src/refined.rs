//! The shape at full resolution: refined after a drag, and converged as what results are compared with.

use glam::DVec3;
use pliant_deform::{DeformError, Method, RefineOptions, Refiner};
use pliant_mesh::Progress;
use pliant_mesh::metrics::{edge_errors, rms_distance};

use crate::pipeline::Study;
use crate::report::Spread;
use crate::settings::{Iterations, Schedule, StartFrom, SweepSize};
use crate::stages::{Stages, repeated, timed};
use crate::{StudyError, SweepRow};

/// Steps in which the pose that results are compared with is reached: none of them turns a handle by half a turn before five full ones.
pub const CONVERGED_STEPS: usize = 10;

/// A step of refinement that lowers the energy by less than this share of it is the last, where the minimum is looked for.
const MINIMUM: f64 = 1e-7;

/// Steps after which the minimum is given up.
const MOST_STEPS: usize = 500;

impl Study<'_> {
    /// Finds the pose that [`SweepRow::distance_to_converged`] is measured from: as-rigid-as-possible deformation without a cage, default
    /// options, taken to the goals in [`CONVERGED_STEPS`] steps of two iterations and from there to the minimum by refinement
    /// ([`Refiner`]), which gets there in a few percent of the time that more iterations take. Rows made before have none.
    ///
    /// # Errors
    /// As [`Self::drag`].
    pub fn find_converged(&mut self, stages: &dyn Stages) -> Result<(), StudyError> {
        let iterations = Iterations::Count(2);
        let schedule = Schedule { steps: CONVERGED_STEPS, iterations, start: StartFrom::Pose };
        let direct = self.cage(SweepSize::None, stages)?;
        // Once, however often stages are timed.
        let pose = self.drag_once(&direct, &Method::default(), schedule, stages)?.pose;
        let work = |progress: &dyn Progress| self.refined(&pose, MOST_STEPS, MINIMUM, progress);
        let ((pose, _), _) = timed(stages, "converge", work, |(_, steps)| format!("{steps} steps at full resolution"))
            .map_err(|error| self.named(error))?;
        self.converged = Some(pose);
        Ok(())
    }

    /// Refines a pose of the shape at full resolution, and adds what came of it to its row.
    ///
    /// # Errors
    /// As [`Refiner::prepare`] and [`Refiner::step`].
    pub fn refine(&self, pose: &[DVec3], row: &mut SweepRow, stages: &dyn Stages) -> Result<Vec<DVec3>, StudyError> {
        let work = |progress: &dyn Progress| self.refined(pose, self.refine_steps, 0.0, progress);
        let described = |(_, steps): &(Vec<DVec3>, usize)| format!("{steps} steps at full resolution");
        let ((refined, _), times) =
            repeated(self.repeats, stages, "refine", work, described).map_err(|error| self.named(error))?;
        row.times.refine_ms = Spread::of(&times);
        row.refine_steps = Some(self.refine_steps);
        let rest = &self.shape.positions;
        row.refined_rms_relative = Some(edge_errors(self.shape.topology(), rest, &refined).rms_relative);
        row.refined_distance_to_converged =
            self.converged.as_ref().map(|converged| rms_distance(&refined, converged) * self.scale());
        Ok(refined)
    }

    /// A pose after some steps of refinement, fewer if one gains less than a share of the energy; and how many they were.
    fn refined(
        &self,
        pose: &[DVec3],
        most: usize,
        least_gain: f64,
        progress: &dyn Progress,
    ) -> Result<(Vec<DVec3>, usize), DeformError> {
        let region = Self::joined(&self.region_of_scene()?, self.shape, &mut Vec::new());
        let mut refined = pose.to_vec();
        let mut refiner = Refiner::prepare(self.shape, &region, &RefineOptions::default())?;
        refiner.begin(&self.scene.goals_with_turns(1.0), pose)?;
        let mut steps = 0;
        while steps < most {
            let step = refiner.step()?;
            steps += 1;
            progress.advance(steps, most);
            if step.settled || step.relative_change < least_gain {
                break;
            }
        }
        refiner.positions(&mut refined)?;
        Ok((refined, steps))
    }
}
