//! Cage sizes against error and time.

mod error;
mod folder;
mod jobs;
mod rows;
mod run;
mod spec;

use pliant_cage::{BindOptions, CageSize, Propagation, Prune};
use pliant_deform::{ArapOptions, Method};
use pliant_mesh::TriMesh;

pub use error::SweepError;
pub use folder::{JobFolder, JobList, JobResult, merge_jobs};
pub use jobs::{JobEntry, SweepJob, SweepJobs};
pub use rows::{Made, RowMaker};
pub use run::RowDone;
pub(crate) use spec::MOST;
pub use spec::{Preset, SweepCase, SweepSpec};

use crate::paper::paper_sizes;
use crate::pipeline::Study;
use crate::report::{Machine, ModelInfo, SweepReport};
use crate::settings::{Iterations, Schedule, Setting, StartFrom, SweepSize};
use crate::stages::Stages;
use crate::{Scene, StudyError};

/// The rows of a sweep over one shape and scene: every combination of what is listed.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPlan {
    /// Cage sizes; [`SweepSize::None`] and decimated meshes give one row per method and number of iterations.
    pub sizes: Vec<SweepSize>,
    /// Ways to propagate.
    pub propagations: Vec<Propagation>,
    /// Prune rules and what goes with them.
    pub bindings: Vec<BindOptions>,
    /// Methods.
    pub methods: Vec<Method>,
    /// Iterations; a method that does not iterate has one row for all of them.
    pub iterations: Vec<Iterations>,
    /// Steps of each drag.
    pub steps: usize,
    /// What each solve on a cage starts from.
    pub start: StartFrom,
    /// Also measure the distance to converged as-rigid-as-possible deformation without a cage, found once ([`Study::find_converged`]).
    pub reference: bool,
    /// Steps of refinement at full resolution after each drag on a cage; 0 for none.
    pub refine_steps: usize,
    /// How often each stage is run to time it, at least once.
    pub repeats: usize,
}

/// The default method and binding at five sizes and without a cage, in one step of two iterations, each stage timed once.
impl Default for SweepPlan {
    fn default() -> Self {
        let cages = [0.01, 0.02, 0.05, 0.1, 0.2].map(|share| SweepSize::Cage(CageSize::Fraction(share)));
        Self {
            sizes: cages.into_iter().chain([SweepSize::None]).collect(),
            propagations: vec![Propagation::default()],
            bindings: vec![BindOptions::default()],
            methods: vec![Method::default()],
            iterations: vec![Iterations::Count(2)],
            steps: 1,
            start: StartFrom::default(),
            reference: false,
            refine_steps: 0,
            repeats: 1,
        }
    }
}

impl SweepPlan {
    /// Table 1 of Hybrid Mesh Editing (Borosan et al. 2010) for a shape of `vertices` vertices: its cage sizes, both
    /// propagations and prune rules, unit weights, dragged in 20 steps of 2 iterations, and converged.
    pub fn paper(vertices: usize) -> Self {
        let size = |cage: Option<usize>| cage.map_or(SweepSize::None, |n| SweepSize::Cage(CageSize::Vertices(n)));
        Self {
            sizes: paper_sizes(vertices).sizes.iter().map(|(cage, _)| size(*cage)).collect(),
            propagations: vec![Propagation::Positions, Propagation::Frames],
            bindings: vec![Prune::PAPER.into(), BindOptions::default()],
            methods: vec![Method::Arap(ArapOptions::faithful())],
            iterations: vec![Iterations::Count(2), Iterations::Converged],
            steps: PAPER_STEPS,
            start: StartFrom::Pose,
            ..Self::default()
        }
    }

    /// The settings of the rows: sizes, then methods, iterations, propagations, prune rules. Each once.
    pub fn settings(&self) -> Vec<Setting> {
        let mut settings: Vec<Setting> = Vec::new();
        for &size in &self.sizes {
            let direct = !matches!(size, SweepSize::Cage(_));
            // Without a cage nothing is bound and nothing carried.
            let bindings = if direct { &[BindOptions::default()] } else { &self.bindings[..] };
            let propagations = if direct { &[Propagation::Positions] } else { &self.propagations[..] };
            for method in &self.methods {
                // One that does not iterate gives the same for any number of iterations.
                let differing = if method.iterates() { self.iterations.len() } else { 1 };
                for &iterations in self.iterations.iter().take(differing) {
                    let schedule = Schedule { steps: self.steps.max(1), iterations, start: self.start };
                    for &propagation in propagations {
                        for &bind in bindings {
                            let setting = Setting { size, method: method.clone(), schedule, propagation, bind };
                            if !settings.contains(&setting) {
                                settings.push(setting);
                            }
                        }
                    }
                }
            }
        }
        settings
    }
}

/// Runs a sweep. Each cage is made once, each binding once per cage and rule, each drag once per cage, method and iterations.
///
/// Rows stand in the order of [`SweepPlan::settings`]; one that cannot be made says why in [`crate::SweepRow::failure`]. The paper's figure
/// is set beside rows made the paper's way, where model and cage size are the paper's.
///
/// # Errors
/// The scene does not fit the shape, or the converged pose was asked for and cannot be found.
pub fn sweep(
    model: &str,
    shape: &TriMesh,
    scene: &Scene,
    plan: &SweepPlan,
    stages: &dyn Stages,
) -> Result<SweepReport, StudyError> {
    let mut study = Study::new(model, shape, scene)?;
    (study.repeats, study.refine_steps) = (plan.repeats.max(1), plan.refine_steps);
    if plan.reference {
        study.find_converged(stages)?;
    }
    let mut report = SweepReport::new(vec![ModelInfo::of(model, shape)]);
    report.machine = Some(Machine::this());
    let mut maker = RowMaker::new(&study);
    report.rows = plan.settings().iter().map(|setting| maker.make(setting, stages).row).collect();
    report.set_published();
    Ok(report)
}

impl SweepReport {
    /// Puts the paper's figures beside rows of its models, cage sizes and ways: positions, 3 %, unit weights, 20 steps of two
    /// iterations, or no cage.
    pub(crate) fn set_published(&mut self) {
        let papers_method = Method::Arap(ArapOptions::faithful()).to_string();
        let papers_way = [Propagation::Positions.to_string(), Prune::PAPER.to_string()];
        for row in &mut self.rows {
            let same_way = row.is_direct() || [&row.propagation, &row.prune] == [&papers_way[0], &papers_way[1]];
            let same_drag = row.iterations == Some(2) && row.steps == PAPER_STEPS && row.method == papers_method;
            if !(same_way && same_drag && row.scene == PAPER_SCENE) {
                continue;
            }
            let cage = (!row.is_direct()).then_some(row.cage_vertices);
            let sizes = paper_sizes(row.vertices).sizes;
            if let Some((_, Some(published))) = sizes.iter().find(|(size, _)| *size == cage) {
                row.published = Some(published.rms);
                row.published_ms = Some(published.ms);
            }
        }
    }
}

/// Steps of the drag that comes nearest to them as well.
const PAPER_STEPS: usize = 20;

/// The scene that comes nearest to the paper's figures without a cage.
pub const PAPER_SCENE: &str = "armadillo-2";
