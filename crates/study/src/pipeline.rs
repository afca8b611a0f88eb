//! The way from a shape and a scene to an edited shape, one function per arrow: cage, binding, drag, carry.
//!
//! A single edit and a sweep take the same way; a sweep keeps what several rows share.

use std::fmt;
use std::str::FromStr;
use std::time::Instant;

use glam::DVec3;
use pliant_cage::{BindOptions, Binding, CageSize, Propagation, Propagator, Simplified, simplify};
use pliant_deform::{ArapOptions, Handle, Method, Region};
use pliant_mesh::metrics::{edge_errors, largest_free_stretch};
use pliant_mesh::{FrameFit, TriMesh, VertexSet};
use serde::{Deserialize, Serialize};

use crate::report::NO_CAGE;
use crate::stages::{Stages, milliseconds, timed};
use crate::{ResolvedScene, Scene, StudyError, SweepRow};

/// The cage of a row, or none: the shape is then deformed directly.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SweepSize {
    /// A cage of this size.
    Cage(CageSize),
    /// No cage.
    None,
}

impl fmt::Display for SweepSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cage(CageSize::Vertices(n)) => write!(f, "{n}"),
            // Rounded to 1e-9 so that 0.07 does not read 7.000000000000001 %.
            Self::Cage(CageSize::Fraction(share)) => write!(f, "{}%", (share * 1e11).round() / 1e9),
            Self::Cage(CageSize::Error(e)) => write!(f, "error:{e}"),
            Self::None => f.write_str(NO_CAGE),
        }
    }
}

/// Reads `2000` (vertices), `5%` (of the shape's vertices), `error:0.002` (of the diagonal) or `none`.
impl FromStr for SweepSize {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        let bad = || StudyError::BadSize { found: text.to_owned() };
        let number = |digits: &str| digits.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(bad);
        if text == NO_CAGE {
            Ok(Self::None)
        } else if let Some(percent) = text.strip_suffix('%') {
            let share = number(percent.trim_end())? / 100.0;
            if share > 0.0 && share <= 1.0 { Ok(Self::Cage(CageSize::Fraction(share))) } else { Err(bad()) }
        } else if let Some(error) = text.strip_prefix("error:") {
            let error = number(error)?;
            if error >= 0.0 { Ok(Self::Cage(CageSize::Error(error))) } else { Err(bad()) }
        } else {
            text.parse().map(|n| Self::Cage(CageSize::Vertices(n))).map_err(|_| bad())
        }
    }
}

/// How often the solver iterates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Iterations {
    /// This many in every step.
    Count(u32),
    /// Two in every step but the last, which goes on until the energy falls by less than [`CONVERGED`] of itself in an iteration.
    Converged,
}

/// Relative fall of the energy in an iteration that counts as converged.
pub const CONVERGED: f64 = 1e-5;

/// Iterations after which a solve that should converge is ended all the same.
const MOST_ITERATIONS: u32 = 2000;

impl fmt::Display for Iterations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Count(n) => write!(f, "{n}"),
            Self::Converged => f.write_str("converged"),
        }
    }
}

/// Reads a number or `converged`.
impl FromStr for Iterations {
    type Err = StudyError;

    fn from_str(text: &str) -> Result<Self, StudyError> {
        match text {
            "converged" => Ok(Self::Converged),
            _ => match text.parse() {
                Ok(n) if n <= MOST_ITERATIONS => Ok(Self::Count(n)),
                _ => Err(StudyError::BadIterations { found: text.to_owned(), most: MOST_ITERATIONS }),
            },
        }
    }
}

/// How the handles travel to their goals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schedule {
    /// Equal steps from rest to the goals, at least 1; each starts at the pose of the one before.
    pub steps: usize,
    /// Iterations in each.
    pub iterations: Iterations,
}

/// A shape, its scene, and what every row says of them.
pub struct Study<'a> {
    /// The shape at rest.
    pub shape: &'a TriMesh,
    /// What reports call it.
    pub model: String,
    pub(crate) scene: ResolvedScene,
    /// Handle of each shape vertex, counted from 1; 0 for free ones.
    labels: Vec<u32>,
}

/// A control mesh with the scene's handles on it. Without a cage, the shape itself.
pub struct Caged {
    /// What was asked for.
    pub size: SweepSize,
    /// The control mesh.
    pub mesh: TriMesh,
    /// How it was made; `None` without a cage.
    pub simplified: Option<Simplified>,
    /// Time it took to make.
    pub simplify_ms: f64,
    pub(crate) region: Region,
    warnings: Vec<String>,
}

/// A binding and the time it took.
pub struct Bound {
    /// The rows.
    pub binding: Binding,
    /// How they were made; `None` without a cage.
    pub options: Option<BindOptions>,
    /// Time to bind.
    pub bind_ms: f64,
}

/// A pose of the control mesh and the times it took.
pub struct Dragged {
    /// Positions of the control mesh's vertices.
    pub pose: Vec<DVec3>,
    method: String,
    schedule: Schedule,
    prepare_ms: f64,
    drag_ms: f64,
    warnings: Vec<String>,
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
        Ok(Self { shape, model: model.into(), scene, labels })
    }

    /// Handles of the scene: name, and vertices on the shape.
    pub fn handles(&self) -> impl Iterator<Item = (&str, usize)> {
        self.scene.handles.iter().map(|h| (h.name.as_str(), h.vertices.len()))
    }

    /// Makes the control mesh and puts the handles on it.
    ///
    /// # Errors
    /// The size is out of range, or two handles would have to share a cage vertex.
    pub fn cage(&self, size: SweepSize, stages: &dyn Stages) -> Result<Caged, StudyError> {
        let SweepSize::Cage(cage_size) = size else {
            let (region, warnings) = self.region(self.shape, None)?;
            let mesh = self.shape.clone();
            return Ok(Caged { size, mesh, simplified: None, simplify_ms: 0.0, region, warnings });
        };
        let work = |progress: &dyn pliant_mesh::Progress| simplify(self.shape, &cage_size.into(), progress);
        let describe = |made: &Simplified| {
            format!("{} of {} vertices", count(made.report.reached), count(self.shape.vertex_count()))
        };
        let (made, simplify_ms) = timed(stages, "simplify", work, describe)?;
        // With nothing collapsed the cage is the shape itself, vertices without faces included.
        let whole = made.report.reached + made.report.unused == self.shape.vertex_count();
        let (mesh, origin) =
            if whole { (self.shape.clone(), None) } else { (made.mesh.clone(), Some(&made.origin[..])) };
        let (region, mut warnings) = self.region(&mesh, origin)?;
        warnings.extend(made.report.warnings());
        Ok(Caged { size, mesh, simplified: Some(made), simplify_ms, region, warnings })
    }

    /// The handles of the shape on a control mesh: a cage vertex belongs to the handle of the shape vertex it came from.
    ///
    /// This is the one place where a selection goes from the shape to the cage. A handle so small that no cage vertex
    /// came from it takes the free one nearest to its middle, with a warning.
    fn region(&self, cage: &TriMesh, origin: Option<&[u32]>) -> Result<(Region, Vec<String>), StudyError> {
        let mut label: Vec<u32> = match origin {
            Some(origin) => origin.iter().map(|&v| self.labels[v as usize]).collect(),
            None => self.labels.clone(),
        };
        let mut warnings = Vec::new();
        for (k, handle) in self.scene.handles.iter().enumerate() {
            let own = k as u32 + 1;
            if label.contains(&own) {
                continue;
            }
            let middle = handle.vertices.iter().map(|v| self.shape.positions[v as usize]).sum::<DVec3>()
                / handle.vertices.len() as f64;
            let free = (0..label.len()).filter(|&j| label[j] == 0);
            let nearest = free
                .map(|j| (cage.positions[j].distance_squared(middle), j))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .ok_or_else(|| StudyError::NoRoom { handle: handle.name.clone(), vertices: label.len() })?;
            label[nearest.1] = own;
            warnings.push(format!(
                "no cage vertex lies in handle '{}': it holds the nearest one; a larger cage follows it better",
                handle.name
            ));
        }
        let handles: Vec<Handle> = (1..=self.scene.handles.len() as u32)
            .map(|own| Handle::hard(VertexSet::where_true(label.len(), |j| label[j as usize] == own)))
            .collect();
        let region = Region::new(label.len(), &VertexSet::all(label.len()), &handles)?;
        let (region, left_out) = region.without_unconstrained(cage.topology());
        if left_out > 0 {
            warnings.push(format!(
                "{} vertices of the control mesh are joined to no handle and stay where they are",
                count(left_out)
            ));
        }
        Ok((region, warnings))
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
        let Some(cage) = &caged.simplified else {
            return Ok(Bound { binding: Binding::identity(self.shape), options: None, bind_ms: 0.0 });
        };
        let whole = caged.mesh.vertex_count() == self.shape.vertex_count();
        let (binding, bind_ms) = timed(
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
        let named = |e| StudyError::deform(e, self.scene.handles.iter().map(|h| h.name.as_str()));
        let (first, last) = match schedule.iterations {
            Iterations::Count(n) => (method.with_iterations(n), None),
            Iterations::Converged => {
                (method.with_iterations(2), Some(method.until_converged(CONVERGED, MOST_ITERATIONS)))
            }
        };
        let steps = schedule.steps.max(1);
        let describe = |caged: &Caged| format!("{} vertices", count(caged.mesh.vertex_count()));
        let (mut stepper, mut prepare_ms) = timed(
            stages,
            "prepare",
            |_| {
                if steps > 1 || last.is_none() { first.prepare(&caged.mesh, &caged.region).map(Some) } else { Ok(None) }
            },
            |_| describe(caged),
        )
        .map_err(named)?;
        let mut finisher = None;
        if let Some(last) = &last {
            let start = Instant::now();
            finisher = Some(last.prepare(&caged.mesh, &caged.region).map_err(named)?);
            prepare_ms = milliseconds(start.elapsed());
        }
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
        let told = format!("{steps} {}, {}", if steps == 1 { "step" } else { "steps" }, schedule.text());
        let ((pose, times), _) = timed(stages, "solve", work, |_| told).map_err(named)?;
        // A drag of so many iterations costs the same each time; one that converges is only worth its total.
        let drag_ms = if last.is_some() { times.iter().sum() } else { median(times) };
        Ok(Dragged {
            pose,
            // Iterations are the schedule's, which rows tell apart.
            method: method.with_iterations(ArapOptions::default().iterations).to_string(),
            schedule: Schedule { steps, ..schedule },
            prepare_ms,
            drag_ms,
            warnings,
        })
    }

    /// Frames that turn, and scale if a handle of the scene does.
    pub(crate) fn frame_fit(&self) -> FrameFit {
        let scales = self.scene.handles.iter().any(|h| h.motion.is_some_and(|m| m.scale != 1.0));
        if scales { FrameFit::Similarity } else { FrameFit::Rotation }
    }

    /// Carries a pose of the control mesh to the shape, and measures it.
    pub fn carry(
        &self,
        caged: &Caged,
        bound: &Bound,
        dragged: &Dragged,
        propagation: Propagation,
        stages: &dyn Stages,
    ) -> (Vec<DVec3>, SweepRow) {
        let mut propagator = Propagator::new(propagation).with_fit(self.frame_fit());
        let mut pose = self.shape.positions.clone();
        propagator.apply(&bound.binding, &caged.mesh.positions, &mut pose);
        let topology = self.shape.topology();
        let rest = edge_errors(topology, &self.shape.positions, &pose);
        let (_, scale) = self.shape.bounds().normal_frame();
        let moved = pose.iter().zip(&self.shape.positions).map(|(p, x)| p.distance(*x) * scale);
        let rest_error_max = moved.fold(0.0, f64::max);

        let mut times = Vec::new();
        let direct = bound.options.is_none();
        if direct {
            pose.copy_from_slice(&dragged.pose);
            times.push(0.0);
        } else {
            stages.begin("propagate");
            for _ in 0..PROPAGATIONS_TIMED {
                let start = Instant::now();
                propagator.apply(&bound.binding, &dragged.pose, &mut pose);
                times.push(milliseconds(start.elapsed()));
            }
            let time = std::time::Duration::from_secs_f64(median(times.clone()) / 1e3);
            stages.end("propagate", time, &format!("{} vertices by {propagation}", count(pose.len())));
        }
        let errors = edge_errors(topology, &self.shape.positions, &pose);
        let cage_errors = edge_errors(caged.mesh.topology(), &caged.mesh.positions, &dragged.pose);
        let report = bound.binding.report();
        let goals = self.scene.goals(1.0);
        let missed = self.scene.handles.iter().zip(&goals).flat_map(|(handle, goal)| {
            handle.vertices.iter().map(|v| v as usize).map(|v| pose[v].distance(goal.apply(self.shape.positions[v])))
        });
        let handle_error_max = missed.fold(0.0, f64::max) * scale;
        let mut warnings: Vec<String> = caged.warnings.iter().chain(&dragged.warnings).cloned().collect();
        warnings.extend(report.warnings());
        if rest.rms_relative > POP {
            warnings.push(format!(
                "with nothing deformed, propagation by {propagation} under {} already changes edge lengths by {:.0} % \
                 (root mean square); propagation by frames changes none",
                bound.options.map_or(NO_CAGE.to_owned(), |p| p.to_string()),
                1e2 * rest.rms_relative
            ));
        }
        let row = SweepRow {
            model: self.model.clone(),
            vertices: self.shape.vertex_count(),
            scene: self.scene.name.clone(),
            cage_asked: caged.size.to_string(),
            cage_vertices: caged.mesh.vertex_count(),
            method: dragged.method.clone(),
            propagation: if direct { NO_CAGE.to_owned() } else { propagation.to_string() },
            prune: bound.options.map_or(NO_CAGE.to_owned(), |p| p.to_string()),
            steps: dragged.schedule.steps,
            iterations: match dragged.schedule.iterations {
                Iterations::Count(n) => Some(n as usize),
                Iterations::Converged => None,
            },
            max_free_stretch: largest_free_stretch(topology, &self.shape.positions, &pose, |v| self.labels[v as usize]),
            cage_rms_relative: cage_errors.rms_relative,
            rest_rms_relative: rest.rms_relative,
            rest_error_max,
            handle_error_max,
            kept_mean: report.kept_mean,
            kept_max: report.kept_max,
            negative_share: report.negative_share,
            unsafe_rows: report.unsafe_rows,
            simplify_ms: caged.simplify_ms,
            bind_ms: bound.bind_ms,
            prepare_ms: dragged.prepare_ms,
            drag_ms: dragged.drag_ms,
            propagate_ms: median(times),
            warnings,
            ..SweepRow::default()
        };
        (pose, row.with_edge_errors(&errors))
    }
}

/// Edge length error at rest from which a row carries a warning: more than the paper's own tables show.
const POP: f64 = 0.1;

/// Propagations timed per row; the median is reported.
const PROPAGATIONS_TIMED: usize = 5;

impl Schedule {
    fn text(self) -> String {
        match self.iterations {
            Iterations::Count(1) => "1 iteration each".to_owned(),
            Iterations::Count(n) => format!("{n} iterations each"),
            Iterations::Converged => "until converged".to_owned(),
        }
    }
}

/// The middle value; the lower of two middle ones; 0 of none.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
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
