//! The one list of columns that both CSV and Markdown are written from.

use super::{Spread, SweepRow};

/// A column of the table.
pub(super) struct Column {
    /// Its name in CSV; the same as the field's in JSON.
    pub(super) key: &'static str,
    /// Its name for people, with the unit.
    pub(super) heading: &'static str,
    /// What its values are.
    pub(super) kind: Kind,
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
    /// Every one, unless constant over several rows: what came out. Narrow tables have room for the lowest ranks only.
    Main(u8),
    /// Only full ones.
    Full,
    /// None: said below the table.
    Never,
}

/// What the values of a column are, whichever of them are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Text,
    Flag,
    Count,
    /// A fraction, shown in percent.
    Share,
    /// A length as a fraction of the diagonal, shown in percent.
    Length,
    /// A plain number.
    Number,
    /// Milliseconds.
    Time,
    Bytes,
}

impl Kind {
    /// Whether a column of these is aligned to the right.
    pub(super) fn is_number(self) -> bool {
        !matches!(self, Self::Text | Self::Flag)
    }

    /// The unit of the values that programs read; none of what is no number.
    #[cfg(any(test, feature = "parquet"))]
    pub(super) fn unit(self) -> Option<&'static str> {
        match self {
            Self::Text | Self::Flag => None,
            Self::Count | Self::Number => Some("1"),
            Self::Share => Some("fraction"),
            Self::Length => Some("fraction of diagonal"),
            Self::Time => Some("ms"),
            Self::Bytes => Some("bytes"),
        }
    }
}

/// A value with the way people read it.
pub(super) enum Cell {
    Text(String),
    Flag(bool),
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
            Self::Flag(flag) => flag.to_string(),
            Self::Count(count) => count.to_string(),
            Self::Bytes(count) => count.to_string(),
            Self::Share(x) | Self::Number(x) | Self::Time(x) if x.is_finite() => format!("{x:?}"),
            Self::Share(_) | Self::Number(_) | Self::Time(_) => String::new(),
            Self::Missing => String::new(),
        }
    }

    /// As people read it: percent, and as many digits as matter.
    pub(super) fn rounded(&self) -> String {
        match self {
            Self::Share(x) | Self::Number(x) | Self::Time(x) if !x.is_finite() => "-".to_owned(),
            Self::Share(x) => fixed_or_tiny(100.0 * x, 2),
            Self::Number(x) => fixed_or_tiny(*x, 2),
            Self::Time(x) if x.abs() >= 99.95 => format!("{x:.0}"),
            Self::Time(x) if x.abs() >= 9.995 => format!("{x:.1}"),
            Self::Time(x) => fixed_or_tiny(*x, 2),
            Self::Bytes(count) => format!("{:.0}", *count as f64 / 1e6),
            _ => self.exact(),
        }
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

/// A count that a row without figures has not, though its field cannot say so.
fn made(row: &SweepRow, figure: usize) -> Cell {
    if row.failure.is_some() && figure == 0 { Cell::Missing } else { Cell::Count(figure) }
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
pub(super) const COLUMNS: [Column; 63] = {
    use Kind::{Bytes, Count, Flag, Length, Number, Share, Text, Time};
    use Shown::{Always, Full, Main, Never, Setting};

    const fn column(
        key: &'static str,
        heading: &'static str,
        kind: Kind,
        shown: Shown,
        cell: fn(&SweepRow) -> Cell,
    ) -> Column {
        Column { key, heading, kind, shown, cell }
    }

    [
        column("id", "id", Text, Never, |r| text(&r.id)),
        column("model", "model", Text, Setting, |r| text(&r.model)),
        column("vertices", "vertices", Count, Setting, |r| Cell::Count(r.vertices)),
        column("scene", "scene", Text, Setting, |r| text(&r.scene)),
        column("method", "method", Text, Setting, |r| text(&r.method)),
        column("steps", "steps", Count, Setting, |r| Cell::Count(r.steps)),
        column("iterations", "iterations", Count, Setting, |r| match r.iterations {
            Some(count) => Cell::Count(count),
            None if r.linear => Cell::Missing,
            None => text("converged"),
        }),
        column("linear", "linear", Flag, Never, |r| Cell::Flag(r.linear)),
        column("start", "start", Text, Setting, |r| text(&r.start)),
        column("propagation", "propagation", Text, Setting, |r| text(&r.propagation)),
        column("prune", "prune", Text, Setting, |r| text(&r.prune)),
        column("cage_asked", "cage asked", Text, Setting, |r| text(&r.cage_asked)),
        column("cage_vertices", "cage vertices", Count, Always, |r| made(r, r.cage_vertices)),
        column("rms_relative", "RMS relative (%)", Share, Always, |r| Cell::Share(r.rms_relative)),
        column("relative_rms", "relative RMS (%)", Share, Main(15), |r| Cell::Share(r.relative_rms)),
        column("published", "published (%)", Share, Main(2), |r| share(r.published)),
        column("edge_median", "median (%)", Share, Full, |r| Cell::Share(r.edge_median)),
        column("edge_p95", "p95 (%)", Share, Main(4), |r| Cell::Share(r.edge_p95)),
        column("edge_p99", "p99 (%)", Share, Full, |r| Cell::Share(r.edge_p99)),
        column("edge_max", "max (%)", Share, Main(5), |r| Cell::Share(r.edge_max)),
        column("max_free_stretch", "free stretch (x)", Number, Main(21), |r| Cell::Number(r.max_free_stretch)),
        column("cage_rms_relative", "cage RMS (%)", Share, Main(22), |r| Cell::Share(r.cage_rms_relative)),
        column("rest_rms_relative", "rest RMS (%)", Share, Main(18), |r| Cell::Share(r.rest_rms_relative)),
        column("rest_error_max", "rest max (% of diagonal)", Length, Main(17), |r| Cell::Share(r.rest_error_max)),
        column("handle_error_max", "handles off by (% of diagonal)", Length, Main(16), |r| {
            Cell::Share(r.handle_error_max)
        }),
        column("distance_to_converged", "from converged ARAP (% of diagonal)", Length, Main(6), |r| {
            share(r.distance_to_converged)
        }),
        column("hausdorff_to_converged", "Hausdorff from it (% of diagonal)", Length, Main(19), |r| {
            share(r.hausdorff_to_converged)
        }),
        column("refine_steps", "refine steps", Count, Setting, |r| count(r.refine_steps)),
        column("refined_rms_relative", "refined RMS (%)", Share, Main(7), |r| share(r.refined_rms_relative)),
        column("refined_distance_to_converged", "refined, from converged (% of diagonal)", Length, Main(20), |r| {
            share(r.refined_distance_to_converged)
        }),
        column("volume_change", "volume change (%)", Share, Main(8), |r| share(r.volume_change)),
        column("area_change", "area change (%)", Share, Full, |r| share(r.area_change)),
        column("flipped_faces", "flipped faces", Count, Main(9), |r| count(r.flipped_faces)),
        column("intersecting_faces", "intersecting face pairs", Count, Main(10), |r| count(r.intersecting_faces)),
        column("kept_mean", "kept mean", Number, Main(23), |r| Cell::Number(r.kept_mean)),
        column("kept_max", "kept max", Count, Main(24), |r| made(r, r.kept_max)),
        column("negative_share", "negative weights (%)", Share, Full, |r| Cell::Share(r.negative_share)),
        column("unsafe_rows", "unsafe rows", Count, Full, |r| made(r, r.unsafe_rows)),
        column("repeats", "repeats", Count, Setting, |r| made(r, r.times.repeats)),
        column("simplify_ms", "simplify (ms)", Time, Main(12), |r| median(r.times.simplify_ms)),
        column("simplify_ms_min", "simplify, min (ms)", Time, Never, |r| min(r.times.simplify_ms)),
        column("simplify_ms_max", "simplify, max (ms)", Time, Never, |r| max(r.times.simplify_ms)),
        column("bind_ms", "bind (ms)", Time, Main(11), |r| median(r.times.bind_ms)),
        column("bind_ms_min", "bind, min (ms)", Time, Never, |r| min(r.times.bind_ms)),
        column("bind_ms_max", "bind, max (ms)", Time, Never, |r| max(r.times.bind_ms)),
        column("prepare_ms", "prepare (ms)", Time, Main(13), |r| median(r.times.prepare_ms)),
        column("prepare_ms_min", "prepare, min (ms)", Time, Never, |r| min(r.times.prepare_ms)),
        column("prepare_ms_max", "prepare, max (ms)", Time, Never, |r| max(r.times.prepare_ms)),
        column("drag_ms", "drag (ms)", Time, Main(0), |r| median(r.times.drag_ms)),
        column("drag_ms_min", "drag, min (ms)", Time, Never, |r| min(r.times.drag_ms)),
        column("drag_ms_max", "drag, max (ms)", Time, Never, |r| max(r.times.drag_ms)),
        column("drag_p95_ms", "drag, p95 (ms)", Time, Full, |r| time(r.times.drag_p95_ms)),
        column("propagate_ms", "propagate (ms)", Time, Main(1), |r| median(r.times.propagate_ms)),
        column("propagate_ms_min", "propagate, min (ms)", Time, Never, |r| min(r.times.propagate_ms)),
        column("propagate_ms_max", "propagate, max (ms)", Time, Never, |r| max(r.times.propagate_ms)),
        column("refine_ms", "refine (ms)", Time, Main(14), |r| median(r.times.refine_ms)),
        column("refine_ms_min", "refine, min (ms)", Time, Never, |r| min(r.times.refine_ms)),
        column("refine_ms_max", "refine, max (ms)", Time, Never, |r| max(r.times.refine_ms)),
        column("peak_memory_bytes", "peak memory (MB)", Bytes, Full, |r| {
            r.times.peak_memory_bytes.map_or(Cell::Missing, Cell::Bytes)
        }),
        column("published_ms", "published (ms)", Time, Main(3), |r| time(r.published_ms)),
        column("failure_kind", "failure kind", Text, Never, |r| {
            r.failure.as_ref().map_or(Cell::Missing, |f| text(f.kind.name()))
        }),
        column("failure", "failure", Text, Never, |r| r.failure.as_ref().map_or(Cell::Missing, |f| text(&f.reason))),
        column("warnings", "warnings", Text, Never, |r| Cell::Text(r.warnings.join("; "))),
    ]
};
