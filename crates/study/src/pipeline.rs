//! The way from a shape and a scene to an edited shape, one function per arrow: cage, binding, drag, carry.
//!
//! A single edit and a sweep take the same way; a sweep keeps what several rows share.

use std::time::Instant;

use glam::DVec3;
use pliant_cage::{BindOptions, Binding, CageError, CageSize, Simplified, simplify};
use pliant_deform::{DeformError, Deformer, Handle, ImplicitReport, Method, Region};
use pliant_mesh::{FrameFit, Silent, TriMesh, VertexSet};
use pliant_session::{Levels, NoRoom, carry_region};

use crate::settings::{CONVERGED, Iterations, MOST_ITERATIONS, Schedule, StartFrom, SweepSize, equal_time_vertices};
use crate::stages::{Stages, milliseconds, repeated, timed};
use crate::{ResolvedScene, Scene, StudyError};

/// A shape, its scene, and what every row says of them.
pub struct Study<'a> {
    /// The shape at rest.
    pub shape: &'a TriMesh,
    /// What reports call it.
    pub model: String,
    pub(crate) scene: ResolvedScene,
    /// Handle of each shape vertex, counted from 1; 0 for free ones.
    pub(crate) labels: Vec<u32>,
    /// The pose that results are compared with, if that was asked for.
    pub(crate) converged: Option<Vec<DVec3>>,
    /// How often each stage is run to time it, at least once.
    pub repeats: usize,
    /// Steps of refinement on the shape after each drag on a cage; 0 for none.
    pub refine_steps: usize,
}

/// A control mesh with the scene's handles on it. Without a cage, the shape itself.
pub struct Caged {
    /// What was asked for.
    pub size: SweepSize,
    /// The control mesh.
    pub mesh: TriMesh,
    /// How it was made; `None` without a cage.
    pub simplified: Option<Simplified>,
    /// Times it took to make, in milliseconds; none without a cage.
    pub simplify_ms: Vec<f64>,
    pub(crate) region: Region,
    levels: Levels,
    pub(crate) warnings: Vec<String>,
}

impl Caged {
    /// Prepares a method for the handles of the scene on the control mesh.
    ///
    /// # Errors
    /// As [`Method::prepare`].
    pub(crate) fn prepare(&self, method: &Method, start: StartFrom) -> Result<Box<dyn Deformer>, DeformError> {
        match start {
            StartFrom::Levels => Ok(Box::new(self.levels.prepare(method, &self.mesh, &self.region)?)),
            StartFrom::Pose => method.prepare(&self.mesh, &self.region),
        }
    }
}

/// A binding and the time it took.
pub struct Bound {
    /// The rows.
    pub binding: Binding,
    /// How they were made; `None` without a cage.
    pub options: Option<BindOptions>,
    /// Times to bind, in milliseconds; none without a cage.
    pub bind_ms: Vec<f64>,
}

/// A pose of the control mesh and the times it took.
pub struct Dragged {
    /// Positions of the control mesh's vertices.
    pub pose: Vec<DVec3>,
    pub(crate) method: Method,
    pub(crate) schedule: Schedule,
    pub(crate) prepare_ms: Vec<f64>,
    /// Of every step and repeat; of all steps of a repeat together where it ran until it converged.
    pub(crate) drag_ms: Vec<f64>,
    /// What an implicit method counted and timed.
    pub(crate) implicit: Option<ImplicitReport>,
    pub(crate) warnings: Vec<String>,
}

impl<'a> Study<'a> {
    /// A shape and a scene on it.
    ///
    /// # Errors
    /// The scene does not fit the shape ([`Scene::resolve`]).
    pub fn new(model: impl Into<String>, shape: &'a TriMesh, scene: &Scene) -> Result<Self, StudyError> {
        let scene = scene.resolve(shape)?;
        let handle_of_vertex = scene.handle_of_vertex(shape.vertex_count());
        let labels = handle_of_vertex.into_iter().map(|h| h.map_or(0, |k| k as u32 + 1)).collect();
        Ok(Self { shape, model: model.into(), scene, labels, converged: None, repeats: 1, refine_steps: 0 })
    }

    /// Handles of the scene: name, and vertices on the shape.
    pub fn handles(&self) -> impl Iterator<Item = (&str, usize)> {
        self.scene.handles.iter().map(|h| (h.name.as_str(), h.vertices.len()))
    }

    /// Makes the control mesh, or the decimated one, and puts the handles on it.
    ///
    /// # Errors
    /// The size is out of range, or two handles would have to share a cage vertex.
    pub fn cage(&self, size: SweepSize, stages: &dyn Stages) -> Result<Caged, StudyError> {
        let schedule = Schedule { steps: 1, iterations: Iterations::Count(2), start: StartFrom::default() };
        self.cage_for(size, schedule, stages)
    }

    /// As [`Self::cage`]; a mesh of [`SweepSize::EqualTime`] is for such a schedule.
    pub(crate) fn cage_for(
        &self,
        size: SweepSize,
        schedule: Schedule,
        stages: &dyn Stages,
    ) -> Result<Caged, StudyError> {
        let region = self.region_of_scene()?;
        let mut warnings = Vec::new();
        let (cage_size, decimated) = match size {
            SweepSize::Cage(size) => (size, false),
            SweepSize::Decimated(size) => (size, true),
            SweepSize::EqualTime(size) => (CageSize::Vertices(self.equal_time(size, schedule)?), true),
            SweepSize::None => {
                let (mesh, region) = (self.shape.clone(), Self::joined(&region, self.shape, &mut warnings));
                let (simplified, simplify_ms, levels) = (None, Vec::new(), Levels::default());
                return Ok(Caged { size, mesh, simplified, simplify_ms, region, levels, warnings });
            }
        };
        let work = |progress: &dyn pliant_mesh::Progress| {
            let made = simplify(self.shape, &cage_size.into(), progress)?;
            // A decimated mesh is deformed as the shape itself would be, without levels.
            let levels = if decimated { Levels::default() } else { Levels::new(&made.mesh, progress)? };
            Ok::<_, CageError>((made, levels))
        };
        let describe = |(made, _): &(Simplified, Levels)| {
            format!("{} of {} vertices", count(made.report.reached), count(self.shape.vertex_count()))
        };
        let ((made, levels), simplify_ms) = repeated(self.repeats, stages, "simplify", work, describe)?;
        // With nothing collapsed the cage is the shape itself, vertices without faces included.
        let whole = made.report.reached + made.report.unused == self.shape.vertex_count();
        let (mesh, region, levels) = if whole {
            (self.shape.clone(), region, Levels::default())
        } else {
            let mesh = made.mesh.clone();
            let carried = carry_region(&region, &made.origin, &self.shape.positions, &mesh.positions)
                .map_err(|no_room| self.no_room(no_room, mesh.vertex_count()))?;
            warnings.extend(carried.stand_ins.iter().map(|&handle| {
                format!(
                    "no cage vertex lies in handle '{}': it holds the nearest one; a larger cage follows it better",
                    self.scene.handles[handle].name
                )
            }));
            (mesh, carried.region, levels)
        };
        let region = Self::joined(&region, &mesh, &mut warnings);
        warnings.extend(made.report.warnings());
        Ok(Caged { size, mesh, simplified: Some(made), simplify_ms, region, levels, warnings })
    }

    /// Vertices of the decimated mesh that takes as long as a cage of some size.
    fn equal_time(&self, size: CageSize, schedule: Schedule) -> Result<usize, StudyError> {
        let shape = self.shape.vertex_count();
        let cage = match size {
            CageSize::Vertices(n) => n,
            CageSize::Fraction(share) => (share * shape as f64).round() as usize,
            // Only the simplifier knows how many vertices keep within a distance.
            CageSize::Error(_) => simplify(self.shape, &size.into(), &Silent)?.report.reached,
        };
        let iterations = match schedule.iterations {
            Iterations::Count(n) => n,
            Iterations::Converged => USUAL_ITERATIONS,
        };
        // In many steps the goals are near.
        let from_levels = schedule.start == StartFrom::Levels && schedule.steps <= FAR_STEPS;
        Ok(equal_time_vertices(shape, cage, iterations, from_levels))
    }

    /// The handles of the scene on the shape.
    pub(crate) fn region_of_scene(&self) -> Result<Region, DeformError> {
        let n = self.shape.vertex_count();
        let handles: Vec<Handle> = (1..=self.scene.handles.len() as u32)
            .map(|own| Handle::hard(VertexSet::where_true(n, |v| self.labels[v as usize] == own)))
            .collect();
        Region::new(n, &VertexSet::all(n), &handles)
    }

    /// The region without what is joined to no handle on the control mesh, which stays where it is; said in a warning.
    pub(crate) fn joined(region: &Region, mesh: &TriMesh, warnings: &mut Vec<String>) -> Region {
        let (region, left_out) = region.without_unconstrained(mesh.topology());
        if left_out > 0 {
            warnings.push(format!(
                "{} vertices of the control mesh are joined to no handle and stay where they are",
                count(left_out)
            ));
        }
        region
    }

    fn no_room(&self, no_room: NoRoom, vertices: usize) -> StudyError {
        match no_room {
            NoRoom::Handle(handle) => StudyError::NoRoom { handle: self.scene.handles[handle].name.clone(), vertices },
            NoRoom::Region(error) => error.into(),
        }
    }

    /// Binds the shape to a control mesh; without a cage, or with one of all vertices, to itself.
    ///
    /// # Errors
    /// As [`Binding::new`].
    pub fn bind(
        &self,
        caged: &Caged,
        options: impl Into<BindOptions>,
        stages: &dyn Stages,
    ) -> Result<Bound, StudyError> {
        let options = options.into();
        let (SweepSize::Cage(_), Some(cage)) = (caged.size, &caged.simplified) else {
            return Ok(Bound { binding: Binding::identity(self.shape), options: None, bind_ms: Vec::new() });
        };
        let whole = caged.mesh.vertex_count() == self.shape.vertex_count();
        let (binding, bind_ms) = repeated(
            self.repeats,
            stages,
            &format!("bind {options}"),
            |progress| {
                if whole { Ok(Binding::identity(self.shape)) } else { cage.bind(self.shape, &options, progress) }
            },
            |made| format!("{} rows, {:.1} weights each", count(made.report().rows), made.report().kept_mean),
        )?;
        Ok(Bound { binding, options: Some(options), bind_ms })
    }

    /// Prepares the method for the handles and takes them to their goals.
    ///
    /// # Errors
    /// As [`Method::prepare`] and `solve`; an error of a handle carries its name.
    pub fn drag(
        &self,
        caged: &Caged,
        method: &Method,
        schedule: Schedule,
        stages: &dyn Stages,
    ) -> Result<Dragged, StudyError> {
        let mut dragged = self.drag_once(caged, method, schedule, stages)?;
        for _ in 1..self.repeats {
            let again = self.drag_once(caged, method, schedule, &Silent)?;
            dragged.prepare_ms.extend(again.prepare_ms);
            dragged.drag_ms.extend(again.drag_ms);
        }
        Ok(dragged)
    }

    /// As [`Self::drag`], timed once.
    pub(crate) fn drag_once(
        &self,
        caged: &Caged,
        method: &Method,
        schedule: Schedule,
        stages: &dyn Stages,
    ) -> Result<Dragged, StudyError> {
        let named = |e| self.named(e);
        let (first, last) = match schedule.iterations {
            _ if !method.iterates() => (method.clone(), None),
            Iterations::Count(n) => (method.with_iterations(n), None),
            Iterations::Converged => {
                (method.with_iterations(2), Some(method.until_converged(CONVERGED, MOST_ITERATIONS)))
            }
        };
        let steps = schedule.steps.max(1);
        // Those of the steps before the last, and of the last one if it is another.
        let prepare = |_: &dyn pliant_mesh::Progress| {
            let stepper = if steps > 1 || last.is_none() { Some(caged.prepare(&first, schedule.start)?) } else { None };
            let finisher = last.as_ref().map(|last| caged.prepare(last, schedule.start)).transpose()?;
            Ok((stepper, finisher))
        };
        let size = format!("{} vertices", count(caged.mesh.vertex_count()));
        let ((mut stepper, mut finisher), prepare_ms) = timed(stages, "prepare", prepare, |_| size).map_err(named)?;
        let mut warnings = Vec::new();
        let work = |progress: &dyn pliant_mesh::Progress| {
            let mut pose = caged.mesh.positions.clone();
            let mut times = Vec::with_capacity(steps);
            for step in 1..=steps {
                let goals = self.scene.goals_with_turns(step as f64 / steps as f64);
                let start = Instant::now();
                let deformer = match &mut finisher {
                    Some(finisher) if step == steps => Some(finisher),
                    _ => stepper.as_mut(),
                };
                if let Some(deformer) = deformer {
                    let report = deformer.solve(&goals, &mut pose)?;
                    if step == steps && last.is_some() && !report.converged {
                        warnings.push(format!("not converged after {} iterations", report.iterations));
                    }
                }
                times.push(milliseconds(start.elapsed()));
                progress.advance(step, steps);
            }
            Ok((pose, times))
        };
        let told = format!("{steps} {}, {}", if steps == 1 { "step" } else { "steps" }, schedule.text(method));
        let ((pose, times), _) = timed(stages, "solve", work, |_| told).map_err(named)?;
        // A drag of so many iterations costs the same each time; one that converges is only worth its total.
        let drag_ms = if last.is_some() { vec![times.iter().sum()] } else { times };
        Ok(Dragged {
            pose,
            method: method.clone(),
            schedule: Schedule { steps, ..schedule },
            prepare_ms: vec![prepare_ms],
            drag_ms,
            implicit: finisher.or(stepper).and_then(|deformer| deformer.implicit_report()),
            warnings,
        })
    }

    /// A solver's error in the scene's words.
    pub(crate) fn named(&self, error: DeformError) -> StudyError {
        StudyError::deform(error, self.scene.handles.iter().map(|h| h.name.as_str()))
    }

    /// Frames that turn, and scale if a handle of the scene does.
    pub(crate) fn frame_fit(&self) -> FrameFit {
        let scales = self.scene.handles.iter().any(|h| h.motion.is_some_and(|m| m.scale != 1.0));
        if scales { FrameFit::Similarity } else { FrameFit::Rotation }
    }
}

/// In more steps than this goals are reckoned to be near.
const FAR_STEPS: usize = 5;

/// Iterations that one which ends by itself is reckoned to take.
const USUAL_ITERATIONS: u32 = 100;

/// The smallest of some values that so many percent of them do not exceed: 0 for the least, 50 for the middle one (the lower of two), 100
/// for the largest; none of none.
pub(crate) fn percentile(values: &[f64], percent: usize) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted.get((percent * sorted.len()).div_ceil(100).saturating_sub(1)).copied()
}

/// The middle value; the lower of two middle ones; 0 of none.
pub(crate) fn median(values: &[f64]) -> f64 {
    percentile(values, 50).unwrap_or(0.0)
}

/// A number with its thousands set apart.
pub fn count(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}
