//! Cage sizes against error and time.

use pliant_cage::{BindOptions, Propagation, Prune};
use pliant_deform::{ArapOptions, Method};
use pliant_mesh::TriMesh;

use crate::paper::paper_sizes;
use crate::pipeline::Study;
use crate::report::{ModelInfo, SweepReport};
use crate::settings::{Iterations, Schedule, StartFrom, SweepSize};
use crate::stages::Stages;
use crate::{Scene, StudyError};

/// The rows of a sweep: every combination of what is listed.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepPlan {
    /// Cage sizes; [`SweepSize::None`] gives one row per method and number of iterations.
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
}

impl SweepPlan {
    /// Table 1 of Hybrid Mesh Editing (Borosan et al. 2010) for a shape of `vertices` vertices: its cage sizes, both
    /// propagations and prune rules, unit weights, dragged in 20 steps of 2 iterations, and converged.
    pub fn paper(vertices: usize) -> Self {
        let size =
            |cage: Option<usize>| cage.map_or(SweepSize::None, |n| SweepSize::Cage(pliant_cage::CageSize::Vertices(n)));
        Self {
            sizes: paper_sizes(vertices).sizes.iter().map(|(cage, _)| size(*cage)).collect(),
            propagations: vec![Propagation::Positions, Propagation::Frames],
            bindings: vec![Prune::PAPER.into(), BindOptions::default()],
            methods: vec![Method::Arap(ArapOptions::faithful())],
            iterations: vec![Iterations::Count(2), Iterations::Converged],
            steps: PAPER_STEPS,
            start: StartFrom::Pose,
            reference: false,
        }
    }
}

/// Runs a sweep. Each cage is made once, each binding once per cage and rule, each drag once per cage, method and iterations.
///
/// Rows stand in the order of the plan: sizes, then methods, iterations, propagations, prune rules. The paper's figure
/// is set beside rows made the paper's way, where model and cage size are the paper's.
///
/// # Errors
/// The first row that cannot be made ends the sweep.
pub fn sweep(
    model: &str,
    shape: &TriMesh,
    scene: &Scene,
    plan: &SweepPlan,
    stages: &dyn Stages,
) -> Result<SweepReport, StudyError> {
    let mut study = Study::new(model, shape, scene)?;
    if plan.reference {
        study.find_converged(stages)?;
    }
    let mut report = SweepReport::new(ModelInfo::of(model, shape), scene.name.clone());
    for &size in &plan.sizes {
        let caged = study.cage(size, stages)?;
        let bindings = if size == SweepSize::None { &[BindOptions::default()] } else { &plan.bindings[..] };
        let bound =
            bindings.iter().map(|&options| study.bind(&caged, options, stages)).collect::<Result<Vec<_>, _>>()?;
        let propagations = if size == SweepSize::None { &[Propagation::Positions] } else { &plan.propagations[..] };
        for method in &plan.methods {
            // One that does not iterate gives the same for any number of iterations.
            let differing = if method.iterates() { plan.iterations.len() } else { 1 };
            for &iterations in plan.iterations.iter().take(differing) {
                let schedule = Schedule { steps: plan.steps, iterations, start: plan.start };
                let dragged = study.drag(&caged, method, schedule, stages)?;
                for &propagation in propagations {
                    for bound in &bound {
                        report.rows.push(study.carry(&caged, bound, &dragged, propagation, stages).1);
                    }
                }
            }
        }
    }
    set_published(&mut report);
    Ok(report)
}

/// Puts the paper's figures beside rows of its models, cage sizes and ways: positions, 3 %, unit weights, 20 steps of two
/// iterations, or no cage.
fn set_published(report: &mut SweepReport) {
    let sizes = paper_sizes(report.model.vertices).sizes;
    let papers_method = Method::Arap(ArapOptions::faithful()).to_string();
    let papers_way = [Propagation::Positions.to_string(), Prune::PAPER.to_string()];
    for row in &mut report.rows {
        let same_way = row.is_direct() || [&row.propagation, &row.prune] == [&papers_way[0], &papers_way[1]];
        let same_drag = row.iterations == Some(2) && row.steps == PAPER_STEPS && row.method == papers_method;
        if !(same_way && same_drag && row.scene == PAPER_SCENE) {
            continue;
        }
        let cage = (!row.is_direct()).then_some(row.cage_vertices);
        if let Some((_, Some(published))) = sizes.iter().find(|(size, _)| *size == cage) {
            row.published = Some(published.rms);
            row.published_ms = Some(published.ms);
        }
    }
}

/// Steps of the drag that comes nearest to them as well.
const PAPER_STEPS: usize = 20;

/// The scene that comes nearest to the paper's figures without a cage.
pub const PAPER_SCENE: &str = "armadillo-2";
