//! What a sweep says of one edit.

use pliant_mesh::metrics::EdgeErrors;
use serde::{Deserialize, Serialize};

use crate::pipeline::percentile;
use crate::settings::{DECIMATED, EQUAL_TIME};

/// What [`SweepRow::cage_asked`], [`SweepRow::propagation`] and [`SweepRow::prune`] hold where the shape is deformed directly.
pub const NO_CAGE: &str = "none";

/// One edit: a cage size and a way to bind, solve and propagate, with its errors and times.
///
/// Errors are fractions (0.05 is 5 %), times milliseconds. Edge errors compare edge lengths of the edited shape with those
/// at rest ([`EdgeErrors`]). A figure that is not finite is `null` in JSON and is read back as NaN. All but [`Self::times`] is the same,
/// bit for bit, wherever and however often the row is made.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SweepRow {
    /// 32 hexadecimal digits that belong to the model's bytes, scene, settings and version; empty where none were asked for.
    #[serde(default)]
    pub id: String,
    /// The shape: file name or generator.
    pub model: String,
    /// Its vertices.
    pub vertices: usize,
    /// Name of the scene.
    pub scene: String,
    /// The cage size as asked for: `2000`, `5%`, [`NO_CAGE`], or a decimated mesh in its place: `decimated:3000`, `equal-time:5%`.
    pub cage_asked: String,
    /// Vertices of the cage that was made; all of the shape's without a cage.
    pub cage_vertices: usize,
    /// The solver and its weights.
    pub method: String,
    /// How the cage's motion is carried to the shape: `positions`, `frames`, or [`NO_CAGE`].
    pub propagation: String,
    /// How rows of the binding are cut: `magnitude:0.03`, `local:24`, ..., or [`NO_CAGE`].
    pub prune: String,
    /// Steps the handles took from rest to their goals.
    pub steps: usize,
    /// What each solve starts from: `levels` (coarser cages), `pose`, or [`NO_CAGE`].
    #[serde(default)]
    pub start: String,
    /// Iterations of the solver in each step; `null` when it ran until it converged, or when the method does not iterate.
    pub iterations: Option<usize>,
    /// Whether the method solves linear systems instead of iterating.
    #[serde(default)]
    pub linear: bool,
    /// Why the row has no figures; `null` for one that has.
    #[serde(default)]
    pub failure: Option<Failure>,

    /// `sqrt(mean ((l' - l) / l)^2)`: the headline.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub rms_relative: f64,
    /// `sqrt(sum (l' - l)^2 / sum l^2)`: its sibling.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub relative_rms: f64,
    /// Half of all edges have a relative error up to this.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub edge_median: f64,
    /// 95 % of them.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub edge_p95: f64,
    /// 99 % of them.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub edge_p99: f64,
    /// The largest.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub edge_max: f64,
    /// Largest ratio of length to rest length over edges that do not cross a handle's border (a factor, 1 at rest).
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub max_free_stretch: f64,
    /// `rms_relative` of the cage's own edges: the solver's part of the error.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub cage_rms_relative: f64,
    /// `rms_relative` of the shape with nothing deformed: the binding's part.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub rest_rms_relative: f64,
    /// Largest distance that the binding moves a vertex with nothing deformed, as a fraction of the diagonal.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub rest_error_max: f64,
    /// Largest distance between a vertex of a handle and where the scene wants it, as a fraction of the diagonal: a cage
    /// meets handles only as closely as it follows their borders.
    #[serde(default, with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub handle_error_max: f64,
    /// Change of the signed volume as a share of that at rest; `null` for an open mesh.
    #[serde(default)]
    pub volume_change: Option<f64>,
    /// Change of the area as a share of that at rest.
    #[serde(default)]
    pub area_change: Option<f64>,
    /// Faces that turned over against the surface round them ([`flipped_faces`](pliant_mesh::metrics::flipped_faces)).
    #[serde(default)]
    pub flipped_faces: Option<usize>,
    /// Pairs of faces that pass through each other.
    #[serde(default)]
    pub intersecting_faces: Option<usize>,
    /// Root mean square distance of the vertices to where converged as-rigid-as-possible deformation without a cage puts them, as a
    /// fraction of the diagonal; `null` unless asked for.
    #[serde(default)]
    pub distance_to_converged: Option<f64>,
    /// Hausdorff distance of the surface to that of converged as-rigid-as-possible deformation without a cage (of a decimated mesh, between
    /// vertices and surfaces, both ways), as a fraction of the
    /// diagonal; `null` unless asked for.
    #[serde(default)]
    pub hausdorff_to_converged: Option<f64>,
    /// Steps of refinement at full resolution that the two figures below are of; `null` unless asked for.
    #[serde(default)]
    pub refine_steps: Option<usize>,
    /// [`Self::rms_relative`] after refinement.
    #[serde(default)]
    pub refined_rms_relative: Option<f64>,
    /// [`Self::distance_to_converged`] after refinement.
    #[serde(default)]
    pub refined_distance_to_converged: Option<f64>,
    /// The paper's error for this model and cage size.
    #[serde(default)]
    pub published: Option<f64>,
    /// The paper's time for this model and cage size.
    #[serde(default)]
    pub published_ms: Option<f64>,

    /// Cage vertices kept per shape vertex, mean.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub kept_mean: f64,
    /// The most that any shape vertex kept.
    pub kept_max: usize,
    /// Share of negative weights among those kept.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub negative_share: f64,
    /// Shape vertices whose weights are so large that they may blow up.
    pub unsafe_rows: usize,
    /// What the user must know about this row.
    #[serde(default)]
    pub warnings: Vec<String>,

    /// What it took, which differs from run to run.
    #[serde(default)]
    pub times: RowTimes,
}

/// Times and memory of a row. Stages that rows share are timed once and stand in each of them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RowTimes {
    /// How often each stage was run to time it.
    pub repeats: usize,
    /// To make the cage; `null` without one, as for the next.
    pub simplify_ms: Option<Spread>,
    /// To bind the shape to it.
    pub bind_ms: Option<Spread>,
    /// To assemble and factor the solver's matrix for these handles.
    pub prepare_ms: Option<Spread>,
    /// To solve on the cage: one step, over all steps and repeats; or all steps together where it ran until it converged.
    pub drag_ms: Option<Spread>,
    /// 95 % of those took no longer.
    pub drag_p95_ms: Option<f64>,
    /// To carry one step's result to the shape.
    pub propagate_ms: Option<Spread>,
    /// To refine at full resolution, preparation included.
    pub refine_ms: Option<Spread>,
    /// The most memory that the process held while the row was made, in bytes; `null` where the system does not tell. Rows made one after
    /// the other share what they have in common, which counts for each.
    pub peak_memory_bytes: Option<u64>,
}

/// Repeated times, in milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Spread {
    /// The middle one; the lower of two.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub median: f64,
    /// The shortest.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub min: f64,
    /// The longest.
    #[serde(with = "null_is_nan")]
    #[cfg_attr(test, schemars(with = "f64"))]
    pub max: f64,
}

impl Spread {
    /// Of one time or more; none of none.
    pub fn of(times: &[f64]) -> Option<Self> {
        let at = |percent| percentile(times, percent);
        Some(Self { median: at(50)?, min: at(0)?, max: at(100)? })
    }
}

/// Why a row has no figures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Failure {
    /// Whose fault it is.
    pub kind: FailureKind,
    /// In a sentence.
    pub reason: String,
}

/// Kinds of failures of rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum FailureKind {
    /// What was given cannot be done: a model that cannot be read, a scene that does not fit it, a cage too small for it.
    Input,
    /// The computation led to nothing that can be used.
    Numeric,
    /// Pliant is at fault: it came to a state it holds impossible.
    Internal,
}

impl FailureKind {
    /// As it stands in JSON: `input`, `numeric` or `internal`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Numeric => "numeric",
            Self::Internal => "internal",
        }
    }
}

impl SweepRow {
    /// Whether the shape was deformed directly.
    pub fn is_direct(&self) -> bool {
        self.cage_asked == NO_CAGE
    }

    /// Whether a decimated mesh was deformed in place of the shape.
    pub fn is_decimated(&self) -> bool {
        is_decimated(&self.cage_asked)
    }

    /// What was asked, without model bytes and version: rows of two reports with the same key are to be compared.
    pub fn key(&self) -> RowKey<'_> {
        RowKey {
            model: &self.model,
            scene: &self.scene,
            method: &self.method,
            cage: &self.cage_asked,
            propagation: &self.propagation,
            prune: &self.prune,
            steps: self.steps,
            start: &self.start,
            iterations: self.iterations,
        }
    }

    /// Time from a moved handle to the moved shape, solve and propagation: medians. NaN where there are none.
    pub fn edit_ms(&self) -> f64 {
        let RowTimes { drag_ms: Some(drag), propagate_ms, .. } = self.times else { return f64::NAN };
        drag.median + propagate_ms.map_or(0.0, |time| time.median)
    }

    /// The row with the edge errors of the edited shape filled in, and a warning if some edges have none.
    #[must_use]
    pub fn with_edge_errors(mut self, errors: &EdgeErrors) -> Self {
        if errors.degenerate > 0 {
            let count = errors.degenerate;
            self.warnings.push(format!("{count} edges have length 0 at rest, so no relative error, and are left out"));
        }
        Self {
            rms_relative: errors.rms_relative,
            relative_rms: errors.relative_rms,
            edge_median: errors.median,
            edge_p95: errors.p95,
            edge_p99: errors.p99,
            edge_max: errors.max,
            ..self
        }
    }

    /// The row of an edit that gave no pose: no figures of it, and the reason.
    #[must_use]
    pub fn failed(self, failure: Failure) -> Self {
        let nothing = EdgeErrors {
            rms_relative: f64::NAN,
            relative_rms: f64::NAN,
            median: f64::NAN,
            p95: f64::NAN,
            p99: f64::NAN,
            max: f64::NAN,
            degenerate: 0,
        };
        Self {
            max_free_stretch: f64::NAN,
            cage_rms_relative: f64::NAN,
            handle_error_max: f64::NAN,
            rest_rms_relative: f64::NAN,
            rest_error_max: f64::NAN,
            kept_mean: f64::NAN,
            negative_share: f64::NAN,
            failure: Some(failure),
            ..self
        }
        .with_edge_errors(&nothing)
    }

    /// `20 steps of 2 iterations`, `2 iterations`, `converged`, `linear`, ...
    pub fn schedule(&self) -> String {
        let each = match self.iterations {
            _ if self.linear => "linear".to_owned(),
            Some(1) => "1 iteration".to_owned(),
            Some(count) => format!("{count} iterations"),
            None => "converged".to_owned(),
        };
        match (self.steps, self.iterations) {
            (..=1, _) => each,
            (steps, Some(_)) => format!("{steps} steps of {each}"),
            (steps, None) => format!("{steps} steps, {each}"),
        }
    }
}

fn is_decimated(cage_asked: &str) -> bool {
    [DECIMATED, EQUAL_TIME].iter().any(|start| cage_asked.starts_with(start))
}

/// What a row was asked to be; see [`SweepRow::key`]. Its text names the row to people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct RowKey<'a> {
    model: &'a str,
    scene: &'a str,
    method: &'a str,
    cage: &'a str,
    propagation: &'a str,
    prune: &'a str,
    steps: usize,
    start: &'a str,
    iterations: Option<usize>,
}

impl std::fmt::Display for RowKey<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}, scene {}, {}", self.model, self.scene, self.setting())
    }
}

impl RowKey<'_> {
    /// What else was asked for.
    pub(crate) fn but_for_prune(self) -> Self {
        Self { prune: "", ..self }
    }

    /// All but model and scene, in words: `cage 5%, arap, frames, smooth:16, start levels, 1 x 2`.
    pub fn setting(&self) -> String {
        let Self { method, cage, propagation, prune, steps, start, iterations, .. } = *self;
        let mut parts = vec![match cage {
            NO_CAGE => "no cage".to_owned(),
            decimated if is_decimated(decimated) => decimated.to_owned(),
            cage => format!("cage {cage}"),
        }];
        parts.push(method.to_owned());
        if propagation != NO_CAGE {
            parts.extend([propagation.to_owned(), prune.to_owned()]);
        }
        if !start.is_empty() && start != NO_CAGE {
            parts.push(format!("start {start}"));
        }
        parts.push(match iterations {
            Some(count) => format!("{steps} x {count}"),
            None => format!("{steps} x all"),
        });
        parts.join(", ")
    }
}

/// JSON has no NaN and no infinity: they are written as `null`, and `null` is read as NaN.
pub(super) mod null_is_nan {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(in crate::report) fn serialize<S: Serializer>(figure: &f64, to: S) -> Result<S::Ok, S::Error> {
        figure.is_finite().then_some(*figure).serialize(to)
    }

    pub(in crate::report) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::NAN))
    }
}
