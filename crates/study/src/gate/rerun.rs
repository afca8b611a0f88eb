//! Makes the rows of a baseline again.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use pliant_mesh::{Bounds, Silent};

use super::{Change, ChangeKind, GateError, GateReport, Tolerances, compare_reports};
use crate::model::Model;
use crate::report::{Calibration, Machine, ModelInfo, NO_CAGE, Refusal, RowTimes, Spread, SweepReport, SweepRow};
use crate::settings::{Iterations, Schedule, Setting, StartFrom};
use crate::stages::Stages;
use crate::sweep::{MOST, RowDone, SweepError, SweepJob, SweepJobs};
use crate::{Scene, SceneError};

/// Where the models and scenes of a report are, which it knows by name only.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Places {
    /// Files of models.
    pub models: Vec<PathBuf>,
    /// Files of scenes.
    pub scenes: Vec<PathBuf>,
    /// Folders in which files of both are looked for, in this order.
    pub folders: Vec<PathBuf>,
}

/// How rows are made again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RerunOptions {
    /// How often each stage is run to time it; `None` for as often as in the baseline, at least three times.
    pub repeats: Option<usize>,
    /// How often all rows are made, at least once; the smallest times are kept.
    pub rounds: usize,
    /// How often a row that seems slow is made again before that is said.
    pub retries: usize,
    /// How long to wait before that; twice as long each time, as what else a machine does comes and goes.
    pub pause: Duration,
}

/// As often as in the baseline, in one round, and five retries after 0.2 to 3.2 seconds.
impl Default for RerunOptions {
    fn default() -> Self {
        Self { repeats: None, rounds: 1, retries: 5, pause: Duration::from_millis(200) }
    }
}

/// Rows that are to be made and compared with a baseline.
#[derive(Debug, Clone)]
pub struct Rerun<'b> {
    baseline: &'b SweepReport,
    /// With whether distances to the converged pose are measured, steps of refinement, and repeats.
    jobs: Vec<(SweepJob, (bool, usize, usize))>,
    refused: Vec<Refusal>,
}

/// What making the rows again came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The rows, as they are now.
    pub report: SweepReport,
    /// What moved.
    pub gate: GateReport,
}

/// Repeats that make a shortest time of a busy machine one of a quiet machine, as a rule.
const LEAST_REPEATS: usize = 3;

impl<'b> Rerun<'b> {
    /// The rows of the baseline itself: finds their models and scenes, and reads their settings.
    ///
    /// # Errors
    /// A model or scene is not found or cannot be read, or a row says something that cannot be asked for.
    pub fn of_rows(baseline: &'b SweepReport, places: &Places) -> Result<Self, GateError> {
        let names: BTreeSet<&str> = baseline.rows.iter().map(|row| row.model.as_str()).collect();
        for name in names.into_iter().filter(|name| !Model::is_generated(name)) {
            // Better said before an hour's work than as a row that fails after it.
            Model::open(&places.model(name)?, &Silent)?;
        }
        let jobs = baseline.rows.iter().map(|row| {
            let job = SweepJob::loose(places.model(&row.model)?, &row.model, places.scene(row)?, setting_of(row)?);
            let repeats = row.times.repeats.min(MOST);
            let common = (row.distance_to_converged.is_some(), row.refine_steps.unwrap_or(0), repeats);
            Ok((job, common))
        });
        Ok(Self { baseline, jobs: jobs.collect::<Result<_, GateError>>()?, refused: Vec::new() })
    }

    /// The rows of a plan.
    pub fn of_jobs(baseline: &'b SweepReport, jobs: SweepJobs) -> Self {
        let common = jobs.common();
        Self { baseline, jobs: jobs.jobs.into_iter().map(|job| (job, common)).collect(), refused: jobs.refused }
    }

    /// The models, as they are opened by.
    pub fn models(&self) -> impl Iterator<Item = &str> {
        self.jobs.iter().map(|(job, _)| job.model.as_str())
    }

    /// Makes all rows and compares them; those that seem slow, or to take more memory, are made again and keep the smallest figures.
    /// `done` is told each row.
    ///
    /// # Errors
    /// None but in the sweep itself, which keeps nothing and so has none.
    pub fn check(
        &self,
        tolerances: &Tolerances,
        options: RerunOptions,
        stages: &dyn Stages,
        done: &mut dyn FnMut(RowDone<'_>),
    ) -> Result<Checked, SweepError> {
        let all: Vec<usize> = (0..self.jobs.len()).collect();
        let mut runs = Vec::new();
        let mut report = SweepReport { refused: self.refused.clone(), ..SweepReport::new(Vec::new()) };
        for (model, row) in self.make(&all, options, true, stages, &mut runs, done)? {
            if report.models.iter().all(|known| known.name != model.name) {
                report.models.push(model);
            }
            report.rows.push(row);
        }
        for _ in 1..options.rounds {
            self.make_again(&all, &mut report, options, stages, &mut runs, done)?;
        }
        let compare = |report: &mut SweepReport, runs: &[Calibration]| {
            report.machine = Some(Machine { calibration: Calibration::of(runs), ..Machine::this() });
            compare_reports(self.baseline, report, tolerances)
        };
        let mut gate = compare(&mut report, &runs);
        for retry in 0..options.retries {
            let slow = self.slow_rows(&gate, &report);
            if slow.is_empty() {
                break;
            }
            std::thread::sleep(options.pause * 2_u32.saturating_pow(retry as u32));
            self.make_again(&slow, &mut report, options, stages, &mut runs, done)?;
            gate = compare(&mut report, &runs);
        }
        Ok(Checked { report, gate })
    }

    /// Makes rows of a report again, which keep the smallest times and memory.
    fn make_again(
        &self,
        chosen: &[usize],
        report: &mut SweepReport,
        options: RerunOptions,
        stages: &dyn Stages,
        runs: &mut Vec<Calibration>,
        done: &mut dyn FnMut(RowDone<'_>),
    ) -> Result<(), SweepError> {
        let again = self.make(chosen, options, false, stages, runs, done)?;
        for (&at, (_, row)) in chosen.iter().zip(again) {
            if let Some(kept) = report.rows.get_mut(at) {
                keep_smallest(&mut kept.times, &row.times);
            }
        }
        Ok(())
    }

    /// Makes some rows, and adds to the calibrations.
    fn make(
        &self,
        chosen: &[usize],
        options: RerunOptions,
        reference: bool,
        stages: &dyn Stages,
        runs: &mut Vec<Calibration>,
        done: &mut dyn FnMut(RowDone<'_>),
    ) -> Result<Vec<(ModelInfo, SweepRow)>, SweepError> {
        let mut made = Vec::with_capacity(chosen.len());
        let common = |k: usize| {
            let (measured, refine_steps, repeats) = self.jobs[k].1;
            (reference && measured, refine_steps, options.repeats.unwrap_or(repeats.max(LEAST_REPEATS)))
        };
        // Rows with all of this in common share their work.
        for group in chosen.chunk_by(|a, b| common(*a) == common(*b)) {
            let jobs = SweepJobs::loose(group.iter().map(|&k| self.jobs[k].0.clone()).collect(), common(group[0]));
            let (before, numbers) = (made.len(), (0..group.len()).collect::<Vec<_>>());
            let mut told = |row: RowDone<'_>| done(RowDone { done: before + row.done, total: chosen.len(), ..row });
            let results = jobs.run(&numbers, None, stages, &mut told)?;
            runs.extend(results.iter().filter_map(|result| result.machine.calibration));
            made.extend(results.into_iter().map(|result| (result.model, result.row)));
        }
        Ok(made)
    }

    /// Numbers of the rows of which a time or the memory is worse.
    fn slow_rows(&self, gate: &GateReport, report: &SweepReport) -> Vec<usize> {
        let takes = |change: &&Change| {
            change.kind == ChangeKind::Worse && change.unit.is_some_and(super::Unit::can_be_disturbed)
        };
        let here = |at: usize| {
            let key = self.baseline.rows[at].key();
            let same = |k: &usize| report.rows.get(*k).is_some_and(|row| row.key() == key);
            // As a rule it has the same number; in another plan it may have another.
            Some(at).filter(same).or_else(|| (0..report.rows.len()).find(same))
        };
        let mut rows: Vec<usize> =
            gate.changes.iter().filter(takes).filter_map(|change| change.at).filter_map(here).collect();
        rows.sort_unstable();
        rows.dedup();
        rows
    }
}

/// What other programs do only ever adds to a time.
fn keep_smallest(times: &mut RowTimes, other: &RowTimes) {
    let pairs = [
        (&mut times.simplify_ms, other.simplify_ms),
        (&mut times.bind_ms, other.bind_ms),
        (&mut times.prepare_ms, other.prepare_ms),
        (&mut times.drag_ms, other.drag_ms),
        (&mut times.propagate_ms, other.propagate_ms),
        (&mut times.refine_ms, other.refine_ms),
    ];
    for (kept, other) in pairs {
        let smaller = |a: Spread, b: Spread| Spread {
            median: a.median.min(b.median),
            min: a.min.min(b.min),
            max: a.max.max(b.max),
        };
        *kept = kept.zip(other).map(|(a, b)| smaller(a, b)).or(*kept);
    }
    let least = times.peak_memory_bytes.zip(other.peak_memory_bytes).map(|(a, b)| a.min(b));
    times.peak_memory_bytes = least.or(times.peak_memory_bytes);
}

impl Places {
    /// What the model of a report is opened by.
    fn model(&self, name: &str) -> Result<String, GateError> {
        if Model::is_generated(name) {
            return Ok(name.to_owned());
        }
        let named =
            |path: &&PathBuf| Model::name_of(&path.to_string_lossy()) == name || path.as_path() == Path::new(name);
        let in_folder = || self.folders.iter().map(|folder| folder.join(name)).find(|path| path.is_file());
        let found = self.models.iter().find(named).cloned().or_else(in_folder);
        found.map(|path| path.to_string_lossy().into_owned()).ok_or_else(|| {
            let folders: Vec<String> = self.folders.iter().map(|folder| folder.display().to_string()).collect();
            GateError::NoModel { model: name.to_owned(), looked: folders.join(", ") }
        })
    }

    /// What the scene of a row is found by: a file, or a name.
    fn scene(&self, row: &SweepRow) -> Result<String, GateError> {
        let bad = |error: SceneError| GateError::Row { row: row.key().to_string(), reason: error.to_string() };
        for path in &self.scenes {
            if Scene::read(path).map_err(bad)?.name == row.scene {
                return Ok(path.to_string_lossy().into_owned());
            }
        }
        let file = format!("{}.json", row.scene);
        let unknown = match Scene::find(&row.scene, &Bounds::of(&[])) {
            Ok(_) => return Ok(row.scene.clone()),
            Err(error) => error,
        };
        let found = self.folders.iter().map(|folder| folder.join(&file)).find(|path| path.is_file());
        found.map(|path| path.to_string_lossy().into_owned()).ok_or_else(|| bad(unknown))
    }
}

/// What a row was asked to be.
fn setting_of(row: &SweepRow) -> Result<Setting, GateError> {
    let bad = |reason: String| GateError::Row { row: row.key().to_string(), reason };
    let size = row.cage_asked.parse().map_err(|error: crate::StudyError| bad(error.to_string()))?;
    let method: pliant_deform::Method =
        row.method.parse().map_err(|error: pliant_deform::DeformError| bad(error.to_string()))?;
    let iterations = match row.iterations {
        Some(n) => n.to_string().parse().map_err(|error: crate::StudyError| bad(error.to_string()))?,
        None => Iterations::Converged,
    };
    if !(1..=MOST).contains(&row.steps) {
        return Err(bad(format!("its steps are not 1 to {MOST}")));
    }
    if row.refine_steps.is_some_and(|steps| steps > MOST) {
        return Err(bad(format!("its steps of refinement are not 0 to {MOST}")));
    }
    let or_default = |text: &str| (text != NO_CAGE && !text.is_empty()).then(|| text.to_owned());
    let start = or_default(&row.start).map_or(Ok(StartFrom::default()), |text| text.parse());
    let propagation = or_default(&row.propagation).map_or(Ok(Default::default()), |text| text.parse());
    let bind = or_default(&row.prune).map_or(Ok(Default::default()), |text| text.parse());
    let setting = Setting {
        size,
        method,
        schedule: Schedule { steps: row.steps, iterations, start: start.map_err(|error| bad(error.to_string()))? },
        propagation: propagation.map_err(|error: pliant_cage::CageError| bad(error.to_string()))?,
        bind: bind.map_err(|error: pliant_cage::CageError| bad(error.to_string()))?,
    };
    // What reads as something else would be compared with a row that is not there.
    let again = setting.row(&row.model, row.vertices, &row.scene);
    if again.key() == row.key() {
        return Ok(setting);
    }
    Err(bad(format!("its settings read as {}", again.key().setting())))
}
