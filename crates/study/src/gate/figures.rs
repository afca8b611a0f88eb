//! What of a row is compared, and how it is read to people.

use serde::{Deserialize, Serialize};

use crate::report::{Spread, SweepRow};

/// A figure of a row.
pub(super) struct Figure {
    /// Its name in reports.
    pub(super) name: &'static str,
    pub(super) group: Group,
    pub(super) unit: Unit,
    /// Its value; smaller ones are better, signs aside. `None` and what is not finite is no value.
    pub(super) of: fn(&SweepRow) -> Option<f64>,
}

/// Figures with a tolerance in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Group {
    Error,
    /// To the converged pose.
    Distance,
    Count,
    Time,
    Memory,
    /// Neither better nor worse when it moves.
    Neutral,
}

/// What a figure is counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    /// A fraction, shown in percent.
    Share,
    /// A fraction of the diagonal of the model's bounding box, shown in percent.
    ShareOfDiagonal,
    /// A factor or a mean number.
    Number,
    /// A whole number.
    Count,
    /// Milliseconds of the machine that the baseline is of.
    Milliseconds,
    /// Bytes, shown in millions.
    Bytes,
}

fn count(figure: Option<usize>) -> Option<f64> {
    figure.map(|n| n as f64)
}

/// The shortest time: what else the machine does only ever adds to it.
fn shortest(spread: Option<Spread>) -> Option<f64> {
    spread.map(|spread| spread.min).filter(|ms| *ms > 0.0)
}

/// Every figure, those first that matter most.
pub(super) const FIGURES: [Figure; 31] = {
    use Group::{Count, Distance, Error, Memory, Neutral, Time};
    use Unit::{Bytes, Milliseconds, Number, Share, ShareOfDiagonal};

    const fn figure(name: &'static str, group: Group, unit: Unit, of: fn(&SweepRow) -> Option<f64>) -> Figure {
        Figure { name, group, unit, of }
    }

    [
        figure("rms_relative", Error, Share, |r| Some(r.rms_relative)),
        figure("relative_rms", Error, Share, |r| Some(r.relative_rms)),
        figure("edge_median", Error, Share, |r| Some(r.edge_median)),
        figure("edge_p95", Error, Share, |r| Some(r.edge_p95)),
        figure("edge_p99", Error, Share, |r| Some(r.edge_p99)),
        figure("edge_max", Error, Share, |r| Some(r.edge_max)),
        figure("max_free_stretch", Error, Number, |r| Some(r.max_free_stretch)),
        figure("cage_rms_relative", Error, Share, |r| Some(r.cage_rms_relative)),
        figure("rest_rms_relative", Error, Share, |r| Some(r.rest_rms_relative)),
        figure("rest_error_max", Error, ShareOfDiagonal, |r| Some(r.rest_error_max)),
        figure("handle_error_max", Error, ShareOfDiagonal, |r| Some(r.handle_error_max)),
        figure("distance_to_converged", Distance, ShareOfDiagonal, |r| r.distance_to_converged),
        figure("hausdorff_to_converged", Distance, ShareOfDiagonal, |r| r.hausdorff_to_converged),
        figure("refined_rms_relative", Error, Share, |r| r.refined_rms_relative),
        figure("refined_distance_to_converged", Distance, ShareOfDiagonal, |r| r.refined_distance_to_converged),
        figure("volume_change", Error, Share, |r| r.volume_change),
        figure("area_change", Error, Share, |r| r.area_change),
        figure("flipped_faces", Count, Unit::Count, |r| count(r.flipped_faces)),
        figure("intersecting_faces", Count, Unit::Count, |r| count(r.intersecting_faces)),
        figure("unsafe_rows", Count, Unit::Count, |r| count(Some(r.unsafe_rows))),
        figure("cage_vertices", Neutral, Unit::Count, |r| count(Some(r.cage_vertices))),
        figure("kept_mean", Neutral, Number, |r| Some(r.kept_mean)),
        figure("kept_max", Neutral, Unit::Count, |r| count(Some(r.kept_max))),
        figure("negative_share", Neutral, Share, |r| Some(r.negative_share)),
        figure("simplify_ms", Time, Milliseconds, |r| shortest(r.times.simplify_ms)),
        figure("bind_ms", Time, Milliseconds, |r| shortest(r.times.bind_ms)),
        figure("prepare_ms", Time, Milliseconds, |r| shortest(r.times.prepare_ms)),
        figure("drag_ms", Time, Milliseconds, |r| shortest(r.times.drag_ms)),
        figure("propagate_ms", Time, Milliseconds, |r| shortest(r.times.propagate_ms)),
        figure("refine_ms", Time, Milliseconds, |r| shortest(r.times.refine_ms)),
        figure("peak_memory_bytes", Memory, Bytes, |r| r.times.peak_memory_bytes.map(|bytes| bytes as f64)),
    ]
};

impl Unit {
    /// Whether other programs can make it more.
    pub(super) fn can_be_disturbed(self) -> bool {
        matches!(self, Self::Milliseconds | Self::Bytes)
    }

    /// Two values of a figure with their unit, with as many digits as tell them apart.
    pub(super) fn shown(self, values: [f64; 2]) -> [String; 2] {
        let (factor, unit, least) = match self {
            Self::Share => (1e2, " %", 2),
            Self::ShareOfDiagonal => (1e2, " % of the diagonal", 3),
            Self::Number => (1.0, "", 3),
            Self::Count => (1.0, "", 0),
            Self::Milliseconds => (1.0, " ms", 2),
            Self::Bytes => (1e-6, " MB", 1),
        };
        let [a, b] = values.map(|value| factor * value);
        // Two digits of the difference.
        let apart = (1.0 - (a - b).abs().log10().floor()).clamp(0.0, 12.0);
        let decimals = if a == b || self == Self::Count { least } else { least.max(apart as usize) };
        let tiny = a.abs().max(b.abs()) < 0.5 * 10_f64.powi(-(least as i32));
        [a, b].map(|x| {
            if !x.is_finite() {
                "nothing".to_owned()
            } else if tiny && x != 0.0 {
                format!("{x:.2e}{unit}")
            } else {
                format!("{x:.decimals$}{unit}")
            }
        })
    }
}
