//! The one list of columns that both CSV and Markdown are written from.

use super::{Spread, SweepRow};

/// A column of the table.
pub(super) struct Column {
    /// Its name in CSV; the same as the field's in JSON.
    pub(super) key: &'static str,
    /// Its name for people, with the unit.
    pub(super) heading: &'static str,
    /// When Markdown shows it.
    pub(super) shown: Shown,
    /// Its value in a row.
    pub(super) cell: fn(&SweepRow) -> Cell,
}

/// Which Markdown tables show a column.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shown {
    /// Every one, even if the column is constant: what the table is about.
    Always,
    /// Every one, unless constant: what was asked.
    Setting,
    /// Every one, unless constant over several rows: what came out.
    Main,
    /// Only full ones.
    Full,
    /// None: said below the table.
    Never,
}

/// A value with the way people read it.
pub(super) enum Cell {
    Text(String),
    Count(usize),
    /// A fraction, shown in percent.
    Share(f64),
    /// A plain number.
    Number(f64),
    /// Milliseconds.
    Time(f64),
    /// Bytes, shown in millions.
    Bytes(u64),
    Missing,
}

impl Cell {
    /// As programs read it: fractions, full precision, nothing where there is no value.
    pub(super) fn exact(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Count(count) => count.to_string(),
            Self::Bytes(count) => count.to_string(),
            Self::Share(x) | Self::Number(x) | Self::Time(x) => format!("{x:?}"),
            Self::Missing => String::new(),
        }
    }

    /// As people read it: percent, and as many digits as matter.
    pub(super) fn rounded(&self) -> String {
        match self {
            Self::Share(x) | Self::Number(x) | Self::Time(x) if x.is_nan() => "-".to_owned(),
            Self::Share(x) => fixed_or_tiny(100.0 * x, 2),
            Self::Number(x) => fixed_or_tiny(*x, 2),
            Self::Time(x) if x.abs() >= 99.95 => format!("{x:.0}"),
            Self::Time(x) if x.abs() >= 9.995 => format!("{x:.1}"),
            Self::Time(x) => fixed_or_tiny(*x, 2),
            Self::Bytes(count) => format!("{:.0}", *count as f64 / 1e6),
            _ => self.exact(),
        }
    }

    /// Whether a column of these is aligned to the right.
    pub(super) fn is_number(&self) -> bool {
        !matches!(self, Self::Text(_) | Self::Missing)
    }
}

/// A number with fixed decimals; with one digit and an exponent if those decimals would all be 0 and it is not, or if it
/// is too large for decimals to matter.
fn fixed_or_tiny(x: f64, decimals: i32) -> String {
    let smallest = 0.5 * 10.0_f64.powi(-decimals);
    if x == 0.0 {
        "0".to_owned()
    } else if x.abs() < smallest || (x.is_finite() && x.abs() >= 1e6) {
        format!("{x:.0e}")
    } else {
        format!("{x:.*}", decimals as usize)
    }
}

fn text(text: &str) -> Cell {
    Cell::Text(text.to_owned())
}

fn share(figure: Option<f64>) -> Cell {
    figure.map_or(Cell::Missing, Cell::Share)
}

fn count(figure: Option<usize>) -> Cell {
    figure.map_or(Cell::Missing, Cell::Count)
}

fn time(figure: Option<f64>) -> Cell {
    figure.map_or(Cell::Missing, Cell::Time)
}

fn median(spread: Option<Spread>) -> Cell {
    time(spread.map(|spread| spread.median))
}

fn min(spread: Option<Spread>) -> Cell {
    time(spread.map(|spread| spread.min))
}

fn max(spread: Option<Spread>) -> Cell {
    time(spread.map(|spread| spread.max))
}

/// Every column in the order of the tables, from what was asked over what came out to what it took.
pub(super) const COLUMNS: [Column; 62] = {
    use Shown::{Always, Full, Main, Never, Setting};

    const fn column(key: &'static str, heading: &'static str, shown: Shown, cell: fn(&SweepRow) -> Cell) -> Column {
        Column { key, heading, shown, cell }
    }

    [
        column("id", "id", Never, |r| text(&r.id)),
        column("model", "model", Setting, |r| text(&r.model)),
        column("vertices", "vertices", Setting, |r| Cell::Count(r.vertices)),
        column("scene", "scene", Setting, |r| text(&r.scene)),
        column("method", "method", Setting, |r| text(&r.method)),
        column("steps", "steps", Setting, |r| Cell::Count(r.steps)),
        column("iterations", "iterations", Setting, |r| match r.iterations {
            Some(count) => Cell::Count(count),
            None if r.linear => Cell::Missing,
            None => text("converged"),
        }),
        column("linear", "linear", Never, |r| text(if r.linear { "true" } else { "false" })),
        column("start", "start", Setting, |r| text(&r.start)),
        column("propagation", "propagation", Setting, |r| text(&r.propagation)),
        column("prune", "prune", Setting, |r| text(&r.prune)),
        column("cage_asked", "cage asked", Setting, |r| text(&r.cage_asked)),
        column("cage_vertices", "cage vertices", Always, |r| Cell::Count(r.cage_vertices)),
        column("rms_relative", "RMS relative (%)", Always, |r| Cell::Share(r.rms_relative)),
        column("relative_rms", "relative RMS (%)", Main, |r| Cell::Share(r.relative_rms)),
        column("published", "published (%)", Main, |r| share(r.published)),
        column("edge_median", "median (%)", Full, |r| Cell::Share(r.edge_median)),
        column("edge_p95", "p95 (%)", Full, |r| Cell::Share(r.edge_p95)),
        column("edge_p99", "p99 (%)", Main, |r| Cell::Share(r.edge_p99)),
        column("edge_max", "max (%)", Main, |r| Cell::Share(r.edge_max)),
        column("max_free_stretch", "free stretch (x)", Full, |r| Cell::Number(r.max_free_stretch)),
        column("cage_rms_relative", "cage RMS (%)", Full, |r| Cell::Share(r.cage_rms_relative)),
        column("rest_rms_relative", "rest RMS (%)", Main, |r| Cell::Share(r.rest_rms_relative)),
        column("rest_error_max", "rest max (% of diagonal)", Main, |r| Cell::Share(r.rest_error_max)),
        column("handle_error_max", "handles off by (% of diagonal)", Full, |r| Cell::Share(r.handle_error_max)),
        column("distance_to_converged", "from converged ARAP (% of diagonal)", Main, |r| {
            share(r.distance_to_converged)
        }),
        column("hausdorff_to_converged", "Hausdorff from it (% of diagonal)", Main, |r| {
            share(r.hausdorff_to_converged)
        }),
        column("refine_steps", "refine steps", Setting, |r| count(r.refine_steps)),
        column("refined_rms_relative", "refined RMS (%)", Main, |r| share(r.refined_rms_relative)),
        column("refined_distance_to_converged", "refined, from converged (% of diagonal)", Main, |r| {
            share(r.refined_distance_to_converged)
        }),
        column("volume_change", "volume change (%)", Main, |r| share(r.volume_change)),
        column("area_change", "area change (%)", Full, |r| share(r.area_change)),
        column("flipped_faces", "flipped faces", Main, |r| count(r.flipped_faces)),
        column("intersecting_faces", "intersecting face pairs", Main, |r| count(r.intersecting_faces)),
        column("kept_mean", "kept mean", Main, |r| Cell::Number(r.kept_mean)),
        column("kept_max", "kept max", Main, |r| Cell::Count(r.kept_max)),
        column("negative_share", "negative weights (%)", Full, |r| Cell::Share(r.negative_share)),
        column("unsafe_rows", "unsafe rows", Full, |r| Cell::Count(r.unsafe_rows)),
        column("repeats", "repeats", Setting, |r| Cell::Count(r.times.repeats)),
        column("simplify_ms", "simplify (ms)", Main, |r| median(r.times.simplify_ms)),
        column("simplify_ms_min", "simplify, min (ms)", Never, |r| min(r.times.simplify_ms)),
        column("simplify_ms_max", "simplify, max (ms)", Never, |r| max(r.times.simplify_ms)),
        column("bind_ms", "bind (ms)", Main, |r| median(r.times.bind_ms)),
        column("bind_ms_min", "bind, min (ms)", Never, |r| min(r.times.bind_ms)),
        column("bind_ms_max", "bind, max (ms)", Never, |r| max(r.times.bind_ms)),
        column("prepare_ms", "prepare (ms)", Main, |r| median(r.times.prepare_ms)),
        column("prepare_ms_min", "prepare, min (ms)", Never, |r| min(r.times.prepare_ms)),
        column("prepare_ms_max", "prepare, max (ms)", Never, |r| max(r.times.prepare_ms)),
        column("drag_ms", "drag (ms)", Main, |r| median(r.times.drag_ms)),
        column("drag_ms_min", "drag, min (ms)", Never, |r| min(r.times.drag_ms)),
        column("drag_ms_max", "drag, max (ms)", Never, |r| max(r.times.drag_ms)),
        column("drag_p95_ms", "drag, p95 (ms)", Full, |r| time(r.times.drag_p95_ms)),
        column("propagate_ms", "propagate (ms)", Main, |r| median(r.times.propagate_ms)),
        column("propagate_ms_min", "propagate, min (ms)", Never, |r| min(r.times.propagate_ms)),
        column("propagate_ms_max", "propagate, max (ms)", Never, |r| max(r.times.propagate_ms)),
        column("refine_ms", "refine (ms)", Main, |r| median(r.times.refine_ms)),
        column("refine_ms_min", "refine, min (ms)", Never, |r| min(r.times.refine_ms)),
        column("refine_ms_max", "refine, max (ms)", Never, |r| max(r.times.refine_ms)),
        column("peak_memory_bytes", "peak memory (MB)", Full, |r| {
            r.times.peak_memory_bytes.map_or(Cell::Missing, Cell::Bytes)
        }),
        column("published_ms", "published (ms)", Main, |r| time(r.published_ms)),
        column("failure", "failure", Never, |r| r.failure.as_ref().map_or(Cell::Missing, |f| text(&f.reason))),
        column("warnings", "warnings", Never, |r| Cell::Text(r.warnings.join("; "))),
    ]
};
