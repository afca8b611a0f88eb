use pliant_mesh::metrics::EdgeErrors;
use serde::{Deserialize, Serialize};

/// What [`SweepRow::cage_asked`], [`SweepRow::propagation`] and [`SweepRow::prune`] hold where the shape is deformed directly.
pub const NO_CAGE: &str = "none";

/// One edit: a cage size and a way to bind, solve and propagate, with its errors and times.
///
/// Errors are fractions (0.05 is 5 %), times milliseconds. Edge errors compare edge lengths of the edited shape with those
/// at rest ([`EdgeErrors`]). A figure that is not finite is `null` in JSON and is read back as NaN.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SweepRow {
    /// The shape: file name or generator.
    pub model: String,
    /// Its vertices.
    pub vertices: usize,
    /// Name of the scene.
    pub scene: String,
    /// The cage size as asked for: `2000`, `5%`, or [`NO_CAGE`].
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

    /// `sqrt(mean ((l' - l) / l)^2)`: the headline.
    #[serde(with = "null_is_nan")]
    pub rms_relative: f64,
    /// `sqrt(sum (l' - l)^2 / sum l^2)`: its sibling.
    #[serde(with = "null_is_nan")]
    pub relative_rms: f64,
    /// Half of all edges have a relative error up to this.
    #[serde(with = "null_is_nan")]
    pub edge_median: f64,
    /// 95 % of them.
    #[serde(with = "null_is_nan")]
    pub edge_p95: f64,
    /// 99 % of them.
    #[serde(with = "null_is_nan")]
    pub edge_p99: f64,
    /// The largest.
    #[serde(with = "null_is_nan")]
    pub edge_max: f64,
    /// Largest ratio of length to rest length over edges that do not cross a handle's border (a factor, 1 at rest).
    #[serde(with = "null_is_nan")]
    pub max_free_stretch: f64,
    /// `rms_relative` of the cage's own edges: the solver's part of the error.
    #[serde(with = "null_is_nan")]
    pub cage_rms_relative: f64,
    /// `rms_relative` of the shape with nothing deformed: the binding's part.
    #[serde(with = "null_is_nan")]
    pub rest_rms_relative: f64,
    /// Largest distance that the binding moves a vertex with nothing deformed, as a fraction of the diagonal.
    #[serde(with = "null_is_nan")]
    pub rest_error_max: f64,
    /// Largest distance between a vertex of a handle and where the scene wants it, as a fraction of the diagonal: a cage
    /// meets handles only as closely as it follows their borders.
    #[serde(default, with = "null_is_nan")]
    pub handle_error_max: f64,
    /// Change of the signed volume as a share of that at rest; `null` for an open mesh.
    #[serde(default)]
    pub volume_change: Option<f64>,
    /// Faces that turned over against the surface round them ([`flipped_faces`](pliant_mesh::metrics::flipped_faces)); `null` where the
    /// method gave no pose.
    #[serde(default)]
    pub flipped_faces: Option<usize>,
    /// Root mean square distance of the vertices to where converged as-rigid-as-possible deformation without a cage puts them, as a
    /// fraction of the diagonal; `null` unless asked for.
    #[serde(default)]
    pub distance_to_converged: Option<f64>,
    /// The paper's error for this model and cage size.
    #[serde(default)]
    pub published: Option<f64>,
    /// The paper's time for this model and cage size.
    #[serde(default)]
    pub published_ms: Option<f64>,

    /// Cage vertices kept per shape vertex, mean.
    #[serde(with = "null_is_nan")]
    pub kept_mean: f64,
    /// The most that any shape vertex kept.
    pub kept_max: usize,
    /// Share of negative weights among those kept.
    #[serde(with = "null_is_nan")]
    pub negative_share: f64,
    /// Shape vertices whose weights are so large that they may blow up.
    pub unsafe_rows: usize,

    /// Time to make the cage.
    #[serde(with = "null_is_nan")]
    pub simplify_ms: f64,
    /// Time to bind the shape to it.
    #[serde(with = "null_is_nan")]
    pub bind_ms: f64,
    /// Time to assemble and factor the solver's matrix for these handles.
    #[serde(with = "null_is_nan")]
    pub prepare_ms: f64,
    /// Time to solve on the cage: of one step (the median over the steps), or of all steps together when it ran until it
    /// converged.
    #[serde(with = "null_is_nan")]
    pub drag_ms: f64,
    /// Time to carry one step's result to the shape (the median over the steps).
    #[serde(with = "null_is_nan")]
    pub propagate_ms: f64,
    /// What the user must know about this row.
    #[serde(default)]
    pub warnings: Vec<String>,
}

impl SweepRow {
    /// Whether the shape was deformed directly.
    pub fn is_direct(&self) -> bool {
        self.cage_asked == NO_CAGE
    }

    /// Time from a moved handle to the moved shape: solve and propagation.
    pub fn edit_ms(&self) -> f64 {
        self.drag_ms + self.propagate_ms
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

    /// The row of a method that gave no pose: no figures, and the reason as a warning.
    #[must_use]
    pub fn refused(self, reason: &str) -> Self {
        let nothing = EdgeErrors {
            rms_relative: f64::NAN,
            relative_rms: f64::NAN,
            median: f64::NAN,
            p95: f64::NAN,
            p99: f64::NAN,
            max: f64::NAN,
            degenerate: 0,
        };
        let mut row = Self {
            max_free_stretch: f64::NAN,
            cage_rms_relative: f64::NAN,
            handle_error_max: f64::NAN,
            prepare_ms: f64::NAN,
            drag_ms: f64::NAN,
            propagate_ms: f64::NAN,
            volume_change: None,
            flipped_faces: None,
            distance_to_converged: None,
            ..self
        };
        row.warnings.push(format!("{} refused: {reason}", row.method));
        row.with_edge_errors(&nothing)
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
