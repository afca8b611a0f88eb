//! Methods side by side on one scene.

use glam::DVec3;
use pliant_cage::{BindOptions, Propagation};
use pliant_deform::Method;
use pliant_mesh::TriMesh;

use crate::pipeline::{Bound, Caged, Study};
use crate::report::{ImplicitRow, ModelInfo, SweepReport};
use crate::settings::{Iterations, Schedule, StartFrom, SweepSize};
use crate::stages::Stages;
use crate::{Scene, StudyError};

/// What is compared, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparePlan {
    /// The cage that all methods run on, or none.
    pub size: SweepSize,
    /// The methods, a row each.
    pub methods: Vec<Method>,
    /// How the handles travel; iterations matter to methods that iterate.
    pub schedule: Schedule,
}

/// [`DEFAULT_METHODS`] without a cage, in 20 steps of 2 iterations.
impl Default for ComparePlan {
    fn default() -> Self {
        let methods = DEFAULT_METHODS.iter().map(|text| text.parse().expect("every text is a method"));
        Self {
            size: SweepSize::None,
            methods: methods.collect(),
            schedule: Schedule { steps: 20, iterations: Iterations::Count(2), start: StartFrom::default() },
        }
    }
}

/// The methods compared where none are named: every family, and within each what differs most.
pub const DEFAULT_METHODS: [&str; 10] = [
    "arap",
    "arap:uniform+spokes",
    "arap:propagated",
    "laplacian",
    "laplacian:two-step",
    "laplacian:similarity",
    "laplacian:propagated",
    "implicit",
    "dual",
    "rotation-invariant",
];

/// Methods on one scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// A row for each method, in their order.
    pub report: SweepReport,
    /// Where each method put the shape; `None` from one that refused.
    pub poses: Vec<Option<Vec<DVec3>>>,
    /// A line for each implicit method.
    pub implicit: Vec<ImplicitRow>,
}

/// Runs methods on a scene: on one cage with one binding, or on the shape itself. The distance to converged as-rigid-as-possible
/// deformation is measured ([`Study::find_converged`]).
///
/// A method that refuses the case has a row without figures, with the reason as its warning; the others run.
///
/// # Errors
/// The scene does not fit, or the cage or the binding cannot be made.
pub fn compare(
    model: &str,
    shape: &TriMesh,
    scene: &Scene,
    plan: &ComparePlan,
    stages: &dyn Stages,
) -> Result<Compared, StudyError> {
    let mut study = Study::new(model, shape, scene)?;
    let caged = study.cage(plan.size, stages)?;
    let bound = study.bind(&caged, BindOptions::default(), stages)?;
    let mut report = SweepReport::new(vec![ModelInfo::of(model, shape)]);
    if let Err(error) = study.find_converged(stages) {
        report.notes.push(format!("There is no converged pose to measure distances from: {error}."));
    }
    let mut compared = Compared { report, poses: Vec::new(), implicit: Vec::new() };
    for method in &plan.methods {
        compared.run(&study, &caged, &bound, method, plan.schedule, stages);
    }
    Ok(compared)
}

impl Compared {
    fn run(
        &mut self,
        study: &Study<'_>,
        caged: &Caged,
        bound: &Bound,
        method: &Method,
        schedule: Schedule,
        stages: &dyn Stages,
    ) {
        let dragged = match study.drag(caged, method, schedule, stages) {
            Ok(dragged) => dragged,
            Err(error) => {
                let row = study.row(caged, bound, method, schedule, Propagation::default());
                self.report.rows.push(row.failed(error.failure()));
                self.poses.push(None);
                return;
            }
        };
        let (pose, row) = study.carry(caged, bound, &dragged, Propagation::default(), stages);
        if let Some(report) = &dragged.implicit {
            self.implicit.push(ImplicitRow::new(&row.model, &row.scene, &row.method, report));
        }
        self.report.rows.push(row);
        self.poses.push(Some(pose));
    }
}
