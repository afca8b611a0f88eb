//! Rows of one shape and scene, made one after another; what several share is made once.

use glam::DVec3;
use pliant_cage::BindOptions;
use pliant_deform::Method;

use crate::StudyError;
use crate::machine::{forget_peak_memory, peak_memory_bytes};
use crate::pipeline::{Bound, Caged, Dragged, Study};
use crate::report::{Failure, SweepRow};
use crate::settings::{Iterations, Schedule, Setting, SweepSize};
use crate::stages::Stages;

/// A row with the pose it is of.
#[derive(Debug, Clone)]
pub struct Made {
    /// The figures, or why there are none.
    pub row: SweepRow,
    /// Positions of the shape's vertices, or of the decimated mesh's; `None` where there are no figures.
    pub pose: Option<Vec<DVec3>>,
    /// The decimated mesh that was deformed in place of the shape.
    pub mesh: Option<pliant_mesh::TriMesh>,
}

/// Makes rows. Neighbours that share a cage, a binding or a drag share the work.
pub struct RowMaker<'s> {
    study: &'s Study<'s>,
    /// One, or none yet.
    cage: Vec<(CageKey, Result<Caged, Failure>)>,
    /// On that cage.
    bound: Vec<(BindOptions, Result<Bound, Failure>)>,
    dragged: Vec<((Method, Schedule), Result<Dragged, Failure>)>,
}

/// A size, and the schedule where the mesh depends on it.
type CageKey = (SweepSize, Option<Schedule>);

impl<'s> RowMaker<'s> {
    /// For a shape and its scene.
    pub fn new(study: &'s Study<'s>) -> Self {
        Self { study, cage: Vec::new(), bound: Vec::new(), dragged: Vec::new() }
    }

    /// The row of a setting. One that cannot be made says why.
    pub fn make(&mut self, setting: &Setting, stages: &dyn Stages) -> Made {
        forget_peak_memory();
        let study = self.study;
        let mut made = self.try_make(setting, stages).unwrap_or_else(|failure| Made {
            row: setting.row(&study.model, study.shape.vertex_count(), &study.scene.name).failed(failure),
            pose: None,
            mesh: None,
        });
        made.row.times.peak_memory_bytes = peak_memory_bytes();
        made
    }

    fn try_make(&mut self, setting: &Setting, stages: &dyn Stages) -> Result<Made, Failure> {
        let study = self.study;
        // One that does not iterate takes as long whatever number is asked for.
        let iterations = if setting.method.iterates() { setting.schedule.iterations } else { Iterations::Count(1) };
        let schedule = Schedule { iterations, ..setting.schedule };
        let key = (setting.size, matches!(setting.size, SweepSize::EqualTime(_)).then_some(schedule));
        if self.cage.iter().all(|(known, _)| *known != key) {
            // The old ones go first: there is no need to hold two.
            (self.cage, self.bound, self.dragged) = (Vec::new(), Vec::new(), Vec::new());
        }
        let caged = known(&mut self.cage, &key, || study.cage_for(setting.size, schedule, stages))?;
        let bound = known(&mut self.bound, &setting.bind, || study.bind(caged, setting.bind, stages))?;
        let drag = (setting.method.clone(), setting.schedule);
        let dragged = known(&mut self.dragged, &drag, || study.drag(caged, &drag.0, drag.1, stages))?;
        let (pose, mut row) = study.carry(caged, bound, dragged, setting.propagation, stages);
        if study.refine_steps > 0 && !setting.is_direct() {
            // The figures of the preview stand without those of its refinement.
            if let Err(error) = study.refine(&pose, &mut row, stages) {
                row.warnings.push(format!("not refined: {error}"));
            }
        }
        let decimated = setting.is_direct() && setting.size != SweepSize::None;
        Ok(Made { row, pose: Some(pose), mesh: decimated.then(|| caged.mesh.clone()) })
    }
}

/// What was made for a key before, or is made now.
fn known<'v, K: Clone + PartialEq, T>(
    made: &'v mut Vec<(K, Result<T, Failure>)>,
    key: &K,
    make: impl FnOnce() -> Result<T, StudyError>,
) -> Result<&'v T, Failure> {
    let at = match made.iter().position(|(other, _)| other == key) {
        Some(at) => at,
        None => {
            made.push((key.clone(), make().map_err(|error| error.failure())));
            made.len() - 1
        }
    };
    made[at].1.as_ref().map_err(Clone::clone)
}
