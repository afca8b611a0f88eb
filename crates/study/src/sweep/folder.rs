//! A folder of finished jobs: one file each, whole or not there, whoever wrote it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use pliant_files::{read_regular, write_atomic};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

use super::{JobEntry, SweepError, SweepJobs};
use crate::Calibration;
use crate::report::{Machine, ModelInfo, Refusal, SweepReport, SweepRow};

/// What the file of a job holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobResult {
    /// `pliant-job/1`.
    pub schema: String,
    /// The shape.
    pub model: ModelInfo,
    /// The figures.
    pub row: SweepRow,
    /// The shape as it was edited: PNG in base64; none of a row without figures, or if no pictures were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<String>,
    /// Where the picture is seen from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<String>,
    /// Where it ran.
    pub machine: Machine,
}

/// The list of jobs in a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobList {
    /// `pliant-jobs/1`.
    pub schema: String,
    /// Version of Pliant that planned them.
    pub version: String,
    /// In the order of the report's rows.
    pub jobs: Vec<JobEntry>,
    /// Models for which nothing can be planned.
    pub refused: Vec<Refusal>,
    /// What a reader of the report must know, as whole sentences.
    pub notes: Vec<String>,
}

/// What [`JobResult::schema`] says of this form.
pub(super) const JOB_SCHEMA: &str = "pliant-job/1";

/// What [`JobList::schema`] says of this form.
const LIST_SCHEMA: &str = "pliant-jobs/1";

/// No job's file needs more.
const MAX_BYTES: u64 = 64 << 20;

/// The list's file.
const LIST: &str = "jobs.json";

impl JobList {
    /// The list of a planned sweep.
    pub fn of(jobs: &SweepJobs) -> Self {
        Self {
            schema: LIST_SCHEMA.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            jobs: jobs.entries(),
            refused: jobs.refused.clone(),
            notes: jobs.notes.clone(),
        }
    }

    /// Indented JSON, ending with a line break.
    pub fn to_json(&self) -> String {
        json(self)
    }
}

/// Files of jobs in one folder, `jobs.json` and `ID.json`; any number of processes may work in it.
#[derive(Debug, Clone)]
pub struct JobFolder {
    path: PathBuf,
}

impl JobFolder {
    /// Makes the folder, if need be, and writes the list.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(path: &Path, list: &JobList) -> Result<Self, SweepError> {
        let fail = |error: std::io::Error| SweepError::Folder {
            file: path.display().to_string(),
            message: format!("cannot be made: {error}"),
        };
        std::fs::create_dir_all(path).map_err(fail)?;
        let folder = Self { path: path.to_owned() };
        write_atomic(&folder.path.join(LIST), list.to_json().as_bytes())?;
        Ok(folder)
    }

    /// A folder that is there, and its list.
    ///
    /// # Errors
    /// There is no list in it, or one that is not understood.
    pub fn open(path: &Path) -> Result<(Self, JobList), SweepError> {
        let list: JobList = parse(&path.join(LIST), LIST_SCHEMA, |list: &JobList| &list.schema)?;
        Ok((Self { path: path.to_owned() }, list))
    }

    fn file(&self, id: &str) -> PathBuf {
        self.path.join(format!("{id}.json"))
    }

    /// What a finished job came to; `None` if it is not finished.
    ///
    /// # Errors
    /// Its file is there and cannot be understood, or is of another job.
    pub fn result(&self, id: &str) -> Result<Option<JobResult>, SweepError> {
        let file = self.file(id);
        if !file.exists() {
            return Ok(None);
        }
        let result: JobResult = parse(&file, JOB_SCHEMA, |result: &JobResult| &result.schema)?;
        if result.row.id == id {
            return Ok(Some(result));
        }
        let message = format!("is of job {}", result.row.id);
        Err(SweepError::Folder { file: file.display().to_string(), message })
    }

    /// Keeps what a job came to.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn keep(&self, result: &JobResult) -> Result<(), SweepError> {
        Ok(write_atomic(&self.file(&result.row.id), json(result).as_bytes())?)
    }

    /// The converged pose of a model and scene that some job found, if it is whole.
    pub(super) fn converged(&self, place: &str, vertices: usize) -> Option<Vec<DVec3>> {
        let bytes = read_regular(&self.pose_file(place), 16 + 24 * vertices as u64).ok()?;
        let (check, pose) = bytes.split_first_chunk::<16>()?;
        if pose.len() != 24 * vertices || XxHash3_128::oneshot(pose).to_le_bytes() != *check {
            return None;
        }
        let numbers = pose.chunks_exact(8).map(|eight| f64::from_le_bytes(eight.try_into().unwrap_or_default()));
        let numbers: Vec<f64> = numbers.collect();
        Some(numbers.chunks_exact(3).map(DVec3::from_slice).collect())
    }

    /// Keeps a converged pose for the jobs to come. It can be found again, so a failure to write does no harm.
    pub(super) fn keep_converged(&self, place: &str, pose: &[DVec3]) {
        let numbers: Vec<u8> = pose.iter().flat_map(DVec3::to_array).flat_map(f64::to_le_bytes).collect();
        let check = XxHash3_128::oneshot(&numbers).to_le_bytes();
        let _ = write_atomic(&self.pose_file(place), &[&check[..], &numbers].concat());
    }

    fn pose_file(&self, place: &str) -> PathBuf {
        self.path.join(format!("converged-{place}.bin"))
    }
}

/// Puts the finished jobs of folders together to a report. Which folder holds which job does not matter, nor their order.
///
/// With `partial` jobs that are not finished, or whose files are not understood, are left out, and a note says so.
///
/// # Errors
/// Folders of different sweeps, jobs that are not finished or whose files are not understood in any folder.
pub fn merge_jobs(folders: &[PathBuf], partial: bool) -> Result<SweepReport, SweepError> {
    let mut opened = Vec::new();
    for path in folders {
        let (folder, list) = JobFolder::open(path)?;
        if let Some((first, expected)) = opened.first().map(|(folder, list): &(JobFolder, JobList)| (folder, list))
            && *expected != list
        {
            let (a, b) = (first.path.display().to_string(), path.display().to_string());
            return Err(SweepError::OtherSweep { a, b });
        }
        opened.push((folder, list));
    }
    let Some((_, list)) = opened.first() else { return Ok(SweepReport::new(Vec::new())) };
    let mut results = HashMap::new();
    for entry in &list.jobs {
        let (found, faults): (Vec<_>, Vec<_>) =
            opened.iter().map(|(folder, _)| folder.result(&entry.id)).partition(Result::is_ok);
        // Of several one with figures; else any, but always the same.
        let failed = |result: &JobResult| result.row.failure.is_some();
        let order = |a: &JobResult, b: &JobResult| failed(a).cmp(&failed(b)).then_with(|| json(a).cmp(&json(b)));
        let best = found.into_iter().filter_map(Result::ok).flatten().min_by(order);
        match (best, faults.into_iter().find_map(Result::err)) {
            (Some(result), _) => _ = results.insert(entry.id.clone(), result),
            (None, Some(fault)) if !partial => return Err(fault),
            _ => {}
        }
    }
    let missing: Vec<&JobEntry> = list.jobs.iter().filter(|entry| !results.contains_key(&entry.id)).collect();
    if let (false, Some(first)) = (partial, missing.first()) {
        let first = format!("{} ({}, scene {}, {})", first.id, first.model, first.scene, first.asked);
        return Err(SweepError::Unfinished { missing: missing.len(), jobs: list.jobs.len(), first });
    }
    let missing = missing.len();
    let mut report = assemble(list, results);
    if missing > 0 {
        report.notes.push(format!("{missing} of {} jobs are not finished and have no row.", list.jobs.len()));
    }
    Ok(report)
}

/// A report of what is finished, in the order of the list.
pub(super) fn assemble(list: &JobList, mut results: HashMap<String, JobResult>) -> SweepReport {
    let mut report = SweepReport::new(Vec::new());
    (report.notes, report.refused) = (list.notes.clone(), list.refused.clone());
    let mut machines: Vec<Machine> = Vec::new();
    for result in list.jobs.iter().filter_map(|entry| results.remove(&entry.id)) {
        if report.models.iter().all(|model| model.name != result.model.name) {
            report.models.push(result.model);
        }
        machines.push(result.machine);
        report.pictures.extend(result.picture.map(|picture| (result.row.id.clone(), picture)));
        report.rows.push(result.row);
    }
    report.machine = common_machine(&machines);
    report.set_published();
    report
}

/// The machine, if it was the same one for all, with what all runs of its loop say.
fn common_machine(machines: &[Machine]) -> Option<Machine> {
    let first = machines.first()?;
    let same = |machine: &Machine| (&machine.cpu, machine.threads) == (&first.cpu, first.threads);
    let runs: Vec<Calibration> = machines.iter().filter_map(|machine| machine.calibration).collect();
    machines.iter().all(same).then(|| Machine { calibration: Calibration::of(&runs), ..first.clone() })
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).expect("every key is a string and no value can fail") + "\n"
}

fn parse<T: DeserializeOwned>(file: &Path, schema: &str, own: fn(&T) -> &String) -> Result<T, SweepError> {
    let bad = |message: String| SweepError::Folder { file: file.display().to_string(), message };
    let value: T = serde_json::from_slice(&read_regular(file, MAX_BYTES)?).map_err(|error| bad(error.to_string()))?;
    if own(&value) != schema {
        return Err(bad(format!("is of the form {}, where {schema} is needed", own(&value))));
    }
    Ok(value)
}
