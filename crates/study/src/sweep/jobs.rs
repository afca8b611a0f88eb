//! The jobs of a sweep: one a row, with an id that is the same wherever it is planned.

use std::collections::{HashMap, HashSet};
use std::fmt;

use pliant_io::picture::{PictureError, View};
use pliant_mesh::{Bounds, Silent};
use serde::{Deserialize, Serialize};
use twox_hash::XxHash3_128;

use super::{PAPER_SCENE, Preset, SweepError, SweepSpec};
use crate::Scene;
use crate::model::{Model, ModelError};
use crate::paper::paper_sizes;
use crate::report::{Refusal, SCHEMA};
use crate::settings::Setting;

/// A planned sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepJobs {
    /// In the order of the report's rows: neighbours share work.
    pub jobs: Vec<SweepJob>,
    /// Models for which nothing can be planned.
    pub refused: Vec<Refusal>,
    /// What a reader of the report must know, as whole sentences.
    pub notes: Vec<String>,
    /// What all jobs have in common.
    pub(super) common: Common,
}

/// What all jobs of a sweep have in common.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Common {
    pub(super) reference: bool,
    pub(super) refine_steps: usize,
    pub(super) repeats: usize,
    /// Where pictures are seen from; `None` for none.
    pub(super) camera: Option<Camera>,
}

/// Where pictures are seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Camera {
    /// As suits the shape.
    Usual,
    /// From there.
    From(View),
}

/// The view's own text, or `usual`.
impl fmt::Display for Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usual => f.write_str("usual"),
            Self::From(view) => view.fmt(f),
        }
    }
}

/// A row that is to be made.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepJob {
    /// 32 hexadecimal digits: a hash of the model's bytes and what reports call it, the scene, the settings, and Pliant's version.
    pub id: String,
    /// The model, as the plan names it.
    pub model: String,
    /// What reports call it.
    pub name: String,
    /// The scene, as the plan names it.
    pub scene: String,
    /// The rest.
    pub setting: Setting,
    /// Of the model's bytes, its name and the scene.
    pub(super) place: String,
}

/// What a list of jobs says of one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JobEntry {
    /// Its number, from 0: what `--job` and an array index mean.
    pub index: usize,
    /// [`SweepJob::id`].
    pub id: String,
    /// The model, as the plan names it.
    pub model: String,
    /// The scene.
    pub scene: String,
    /// The settings, in words.
    pub asked: String,
}

impl SweepSpec {
    /// Plans the rows: every model with each of its scenes and settings, each once. Files are read to hash them; a model that cannot be
    /// read is refused, the others go on.
    ///
    /// # Errors
    /// Nothing is named, a value or a scene cannot be read.
    pub fn jobs(&self) -> Result<SweepJobs, SweepError> {
        let cases = self.all_cases();
        if cases.is_empty() {
            return Err(SweepError::NoModels);
        }
        let mut planned = SweepJobs {
            jobs: Vec::new(),
            refused: Vec::new(),
            notes: Vec::new(),
            common: Common { reference: false, refine_steps: 0, repeats: 1, camera: self.camera()? },
        };
        // Of scenes by name.
        let mut contents = HashMap::new();
        let mut known = HashSet::new();
        for (model, scenes) in &cases {
            let hash = match Model::content_hash(model) {
                Ok(hash) => hash,
                Err(error) => {
                    planned.refused.push(refusal(model, &error));
                    continue;
                }
            };
            let alike = |other: &str| other != *model && Model::name_of(other) == Model::name_of(model);
            // Two files of one name are told apart by their folders.
            let twice = cases.iter().any(|(other, _)| alike(other));
            let name = if twice { (*model).to_owned() } else { Model::name_of(model) };
            for scene in scenes {
                for job in self.jobs_of(model, &name, *scene, hash, &mut contents, &mut planned)? {
                    if known.insert(job.id.clone()) {
                        planned.jobs.push(job);
                    }
                }
            }
        }
        Ok(planned)
    }

    fn camera(&self) -> Result<Option<Camera>, SweepError> {
        let camera = match &self.camera {
            None => Camera::Usual,
            Some(text) => {
                Camera::From(text.parse().map_err(|error: PictureError| SweepError::value("camera", text, &error))?)
            }
        };
        Ok(self.pictures.unwrap_or(true).then_some(camera))
    }

    /// Jobs for a model and a scene.
    fn jobs_of(
        &self,
        model: &str,
        name: &str,
        scene: Option<&str>,
        hash: u128,
        scenes: &mut HashMap<String, String>,
        planned: &mut SweepJobs,
    ) -> Result<Vec<SweepJob>, SweepError> {
        let mut scene = scene.unwrap_or_else(|| Model::own_scene(model)).to_owned();
        let mut vertices = None;
        if self.preset == Some(Preset::Paper) {
            let opened = match Model::open(model, &Silent) {
                Ok(opened) => opened,
                Err(error) => {
                    planned.refused.push(refusal(model, &error));
                    return Ok(Vec::new());
                }
            };
            vertices = Some(opened.mesh.vertex_count());
            if self.scenes.is_empty() && self.models.iter().any(|own| own == model) {
                match Scene::builtin(PAPER_SCENE)?.resolve(&opened.mesh) {
                    Ok(_) => PAPER_SCENE.clone_into(&mut scene),
                    Err(error) => planned
                        .notes
                        .push(format!("The paper's scene does not fit {name} ({error}); scene {scene} is used.")),
                }
            }
            planned.notes.extend(paper_sizes(opened.mesh.vertex_count()).note().map(|note| format!("{name}: {note}")));
        }
        // What `auto` is depends on the model alone.
        let found = if scene == "auto" { None } else { Some(Scene::find(&scene, &Bounds::of(&[]))?) };
        let contents = found.as_ref().map_or_else(|| Ok(scene.clone()), Scene::to_json)?;
        let called = found.as_ref().map_or(&scene, |found| &found.name);
        if scenes.entry(called.clone()).or_insert_with(|| contents.clone()) != &contents {
            let message = "another scene has this name: in reports they could not be told apart";
            return Err(SweepError::value("scenes", called, &message));
        }
        let plan = self.plan(found.and_then(|found| found.method), || Ok(vertices.unwrap_or_default()))?;
        let Common { reference, refine_steps, repeats, .. } = &mut planned.common;
        (*reference, *refine_steps, *repeats) = (plan.reference, plan.refine_steps, plan.repeats);
        // The name says how the bytes are read.
        let place = hex(&[&format!("{hash:032x}"), name, &contents]);
        let options = format!("reference {}, refine {}", plan.reference, plan.refine_steps);
        let job = |setting: Setting| {
            let asked = setting.row("", 0, "").key().to_string();
            SweepJob {
                id: hex(&[SCHEMA, env!("CARGO_PKG_VERSION"), &place, &asked, &options]),
                model: model.to_owned(),
                name: name.to_owned(),
                scene: scene.clone(),
                setting,
                place: place.clone(),
            }
        };
        Ok(plan.settings().into_iter().map(job).collect())
    }
}

impl SweepJob {
    /// A job that is not of a plan: it has no id, and is kept in no folder.
    pub(crate) fn loose(model: String, name: &str, scene: String, setting: Setting) -> Self {
        Self { id: String::new(), model, name: name.to_owned(), scene, setting, place: String::new() }
    }
}

impl SweepJobs {
    /// Jobs that are not of a plan, whether distances to the converged pose are measured, steps of refinement, and repeats.
    pub(crate) fn loose(jobs: Vec<SweepJob>, (reference, refine_steps, repeats): (bool, usize, usize)) -> Self {
        Self {
            jobs,
            refused: Vec::new(),
            notes: Vec::new(),
            common: Common { reference, refine_steps, repeats, camera: None },
        }
    }

    /// What [`Self::loose`] is told.
    pub(crate) fn common(&self) -> (bool, usize, usize) {
        (self.common.reference, self.common.refine_steps, self.common.repeats)
    }

    /// The jobs in words.
    pub fn entries(&self) -> Vec<JobEntry> {
        let entry = |(index, job): (usize, &SweepJob)| JobEntry {
            index,
            id: job.id.clone(),
            model: job.model.clone(),
            scene: job.scene.clone(),
            asked: job.setting.row(&job.name, 0, &job.scene).key().setting(),
        };
        self.jobs.iter().enumerate().map(entry).collect()
    }

    /// Numbers of the jobs of one shard of `count`, counted from 1: neighbours, as they share work, and as many as in any other, give or
    /// take one.
    ///
    /// # Errors
    /// The shard is not among them.
    pub fn shard(&self, shard: usize, count: usize) -> Result<Vec<usize>, SweepError> {
        if shard == 0 || shard > count {
            let found = format!("{shard}/{count}");
            return Err(SweepError::value("shard", &found, &"use 1/N to N/N"));
        }
        let at = |k: usize| (self.jobs.len() as u128 * k as u128 / count as u128) as usize;
        Ok((at(shard - 1)..at(shard)).collect())
    }

    /// The number of the job that `asked` names: an id, the beginning of one (6 digits at least), or a number with fewer digits.
    ///
    /// # Errors
    /// There is no such job, or more than one.
    pub fn job(&self, asked: &str) -> Result<usize, SweepError> {
        let wrong = |found| SweepError::NoSuchJob { asked: asked.to_owned(), found, jobs: self.jobs.len() };
        if asked.len() < LEAST_DIGITS {
            return asked.parse().ok().filter(|k| *k < self.jobs.len()).ok_or_else(|| wrong(0));
        }
        let mut fitting = self.jobs.iter().enumerate().filter(|(_, job)| job.id.starts_with(asked));
        match (fitting.next(), fitting.count()) {
            (Some((k, _)), 0) => Ok(k),
            (first, more) => Err(wrong(usize::from(first.is_some()) + more)),
        }
    }
}

/// Digits of an id that are enough to name a job; fewer are a number.
const LEAST_DIGITS: usize = 6;

/// Of a model, whose name the error need not say again.
fn refusal(model: &str, error: &ModelError) -> Refusal {
    let reason = error.to_string();
    let reason = reason.strip_prefix(&format!("{model}: ")).unwrap_or(&reason).to_owned();
    Refusal { model: model.to_owned(), reason }
}

/// 32 hexadecimal digits of some texts.
fn hex(parts: &[&str]) -> String {
    let mut hasher = XxHash3_128::default();
    for part in parts {
        // Lengths keep the parts apart.
        hasher.write(&(part.len() as u64).to_le_bytes());
        hasher.write(part.as_bytes());
    }
    format!("{:032x}", hasher.finish_128())
}
