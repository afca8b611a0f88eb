//! Runs jobs, those of one model and scene together.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use super::folder::assemble;
use super::jobs::Camera;
use super::{JobFolder, JobList, JobResult, Made, RowMaker, SweepError, SweepJob, SweepJobs};
use crate::StudyError;
use crate::calibrate::calibrate;
use crate::model::Model;
use crate::pictures::{draw_pose, usual_view};
use crate::pipeline::Study;
use crate::report::{Calibration, Failure, FailureKind, Machine, ModelInfo, SweepReport, SweepRow};
use crate::stages::Stages;
use crate::sweep::folder::JOB_SCHEMA;

/// Told after each row.
#[derive(Debug, Clone, Copy)]
pub struct RowDone<'a> {
    /// Rows done, this one included.
    pub done: usize,
    /// Rows to do in all.
    pub total: usize,
    /// The figures.
    pub row: &'a SweepRow,
    /// Whether it was finished before.
    pub found: bool,
}

impl SweepJobs {
    /// Runs the jobs with the given numbers, and tells `done` after each.
    ///
    /// With a folder each finished row is kept there at once and not made again, so that a run that is broken off loses the row in
    /// flight. A row that cannot be made says why, and the others go on, whatever happens.
    ///
    /// # Errors
    /// The folder cannot be written.
    ///
    /// # Panics
    /// If a number is not below that of the jobs.
    pub fn run(
        &self,
        chosen: &[usize],
        folder: Option<&JobFolder>,
        stages: &dyn Stages,
        done: &mut dyn FnMut(RowDone<'_>),
    ) -> Result<Vec<JobResult>, SweepError> {
        let mut results = Vec::with_capacity(chosen.len());
        let jobs: Vec<&SweepJob> = chosen.iter().map(|&k| &self.jobs[k]).collect();
        for group in jobs.chunk_by(|a, b| (&a.model, &a.scene) == (&b.model, &b.scene)) {
            let mut told = |result: JobResult, found: bool| {
                results.push(result);
                let (done_now, row) = (results.len(), &results[results.len() - 1].row);
                done(RowDone { done: done_now, total: jobs.len(), row, found });
            };
            self.run_group(group, folder, stages, &mut told)?;
        }
        Ok(results)
    }

    /// Runs all jobs without a folder, or with one, to a report.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn report(
        &self,
        folder: Option<&JobFolder>,
        stages: &dyn Stages,
        done: &mut dyn FnMut(RowDone<'_>),
    ) -> Result<SweepReport, SweepError> {
        let all: Vec<usize> = (0..self.jobs.len()).collect();
        let results = self.run(&all, folder, stages, done)?;
        let results: HashMap<String, JobResult> = results.into_iter().map(|r| (r.row.id.clone(), r)).collect();
        Ok(assemble(&JobList::of(self), results))
    }

    /// What is finished already; anything that is not whole, or was timed less often than asked for, is to be done again.
    fn finished(&self, job: &SweepJob, folder: Option<&JobFolder>) -> Option<JobResult> {
        let result = folder?.result(&job.id).ok()??;
        let times = &result.row.times;
        let camera = self.common.camera.map(|camera| camera.to_string());
        let drawn = camera.is_none() || camera == result.camera;
        (result.row.failure.is_some() || (times.repeats >= self.common.repeats && drawn)).then_some(result)
    }

    /// Jobs of one model and scene.
    fn run_group(
        &self,
        group: &[&SweepJob],
        folder: Option<&JobFolder>,
        stages: &dyn Stages,
        told: &mut dyn FnMut(JobResult, bool),
    ) -> Result<(), SweepError> {
        let mut finished: Vec<Option<JobResult>> = group.iter().map(|job| self.finished(job, folder)).collect();
        let (mut place, mut machine, mut calibrated) = (None, Machine::this(), Instant::now());
        if finished.iter().any(Option::is_none) {
            place = group.first().map(|job| self.open(job, stages));
            machine.calibration = Calibration::of(&[calibrate(), calibrate()]);
        }
        let model = place.as_ref().and_then(|place| place.as_ref().ok());
        let study = model.map(|place| place.study(self, group[0], folder, stages));
        let mut maker = study.as_ref().and_then(|study| study.as_ref().ok()).map(|(study, _)| RowMaker::new(study));
        for (job, finished) in group.iter().zip(&mut finished) {
            if let Some(result) = finished.take() {
                told(result, true);
                continue;
            }
            if calibrated.elapsed() > CALIBRATED_FOR {
                (machine.calibration, calibrated) = (Some(calibrate()), Instant::now());
            }
            let failed = |failure: &Failure| {
                let vertices = model.map_or(0, |place| place.model.mesh.vertex_count());
                let scene = model.map_or(&job.scene, |place| &place.scene.name);
                let row = job.setting.row(&job.name, vertices, scene).failed(failure.clone());
                Made { row, pose: None, mesh: None }
            };
            let mut made = match (&place, &study, &mut maker) {
                (Some(Err(failure)), ..) | (_, Some(Err(failure)), _) => failed(failure),
                (_, Some(Ok((study, _))), Some(maker)) => {
                    let work = AssertUnwindSafe(|| maker.make(&job.setting, stages));
                    catch_unwind(work).unwrap_or_else(|panic| {
                        // What it holds may be half made.
                        *maker = RowMaker::new(study);
                        failed(&Failure { kind: FailureKind::Internal, reason: said(&*panic) })
                    })
                }
                _ => continue,
            };
            made.row.id.clone_from(&job.id);
            if let Some(Ok((_, Some(warning)))) = &study {
                made.row.warnings.push(warning.clone());
            }
            let info = model.map_or_else(
                || ModelInfo { name: job.name.clone(), ..ModelInfo::default() },
                |place| place.info.clone(),
            );
            let mut picture = None;
            if let (Some(camera), Some(Ok((study, _)))) = (self.common.camera, &study) {
                match draw(study, &made, camera) {
                    Ok(drawn) => picture = drawn,
                    // Figures do not depend on it.
                    Err(error) => made.row.warnings.push(format!("there is no picture: {error}")),
                }
            }
            let result = JobResult {
                schema: JOB_SCHEMA.to_owned(),
                model: info,
                row: made.row,
                picture,
                camera: self.common.camera.map(|camera| camera.to_string()),
                machine: machine.clone(),
            };
            if let Some(folder) = folder {
                folder.keep(&result)?;
            }
            told(result, false);
        }
        Ok(())
    }

    fn open(&self, job: &SweepJob, stages: &dyn Stages) -> Result<Place, Failure> {
        let fault = |reason: String| Failure { kind: FailureKind::Input, reason };
        let model = Model::open(&job.model, stages).map_err(|error| fault(error.to_string()))?;
        let info = ModelInfo { notes: model.notes(), ..ModelInfo::of(&job.name, &model.mesh) };
        let scene = model.scene(Some(&job.scene)).map_err(|error| fault(error.to_string()))?;
        Ok(Place { model, info, scene })
    }
}

/// What else a machine does, and so how fast it seems, may have changed after this long.
const CALIBRATED_FOR: Duration = Duration::from_secs(1);

/// A model and a scene.
struct Place {
    model: Model,
    info: ModelInfo,
    scene: crate::Scene,
}

impl Place {
    /// The study, with the converged pose if that is asked for, or with what kept it from being found.
    fn study(
        &self,
        jobs: &SweepJobs,
        job: &SweepJob,
        folder: Option<&JobFolder>,
        stages: &dyn Stages,
    ) -> Result<(Study<'_>, Option<String>), Failure> {
        let made = Study::new(job.name.clone(), &self.model.mesh, &self.scene);
        let mut study = made.map_err(|error| error.failure())?;
        (study.repeats, study.refine_steps) = (jobs.common.repeats, jobs.common.refine_steps);
        if !jobs.common.reference {
            return Ok((study, None));
        }
        study.converged = folder.and_then(|folder| folder.converged(&job.place, self.model.mesh.vertex_count()));
        if study.converged.is_some() {
            return Ok((study, None));
        }
        let start = Instant::now();
        let found = catch_unwind(AssertUnwindSafe(|| study.find_converged(stages)));
        let found = found.unwrap_or_else(|panic| Err(StudyError::Internal { reason: said(&*panic) }));
        if let Err(error) = found {
            return Ok((study, Some(format!("there is no converged pose to measure distances from: {error}"))));
        }
        if let (Some(folder), Some(pose)) = (folder, &study.converged)
            && start.elapsed().as_secs_f64() > WORTH_KEEPING
        {
            folder.keep_converged(&job.place, pose);
        }
        Ok((study, None))
    }
}

/// The picture of a row that has a pose, in base64.
fn draw(study: &Study<'_>, made: &Made, camera: Camera) -> Result<Option<String>, StudyError> {
    let Some(pose) = &made.pose else { return Ok(None) };
    let view = match camera {
        Camera::Usual => usual_view(&study.shape.bounds()),
        Camera::From(view) => view,
    };
    let rest = made.mesh.as_ref().unwrap_or(study.shape);
    Ok(Some(BASE64_STANDARD.encode(draw_pose(rest, pose, &study.framing(), view)?)))
}

/// A pose that is found in less, in seconds, is found again rather than kept.
const WORTH_KEEPING: f64 = 0.1;

/// What a panic said.
fn said(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("a fault of Pliant, please report it: {}", text.unwrap_or("no more is known"))
}
