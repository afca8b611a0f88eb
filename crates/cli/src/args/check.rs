//! What can be typed after `pliant check`.

use std::path::PathBuf;

use clap::Args;
use pliant::{GateError, Tolerance};

/// Compare with an earlier report, and fail if something is worse.
///
/// The baseline is the JSON report of a sweep. Its rows are made again, of the same models, scenes and settings, and every figure is compared:
/// errors to a millionth, times as multiples of a loop that is run beside them, so that neither another machine nor a busy one fails. Rows
/// that seem slow are made again, several times, before that is said.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  pliant sweep creature:20000 --repeats 5 -o base             the first baseline: base.json\n  pliant check --baseline base.json                           makes its rows again and compares\n  pliant check --baseline base.json --update                  keeps what is there now\n  pliant check --baseline base.json --report new.json         compares two reports\n  pliant check --baseline base.json --models meshes --tolerance rms_relative=1%,times=100%\n\nExit codes: 0 nothing is worse, 1 something is, 3 baseline or models cannot be read, 4 rows failed numerically\n(the others: pliant --help)."
)]
pub(crate) struct CheckOptions {
    /// Files of the baseline's models, which are known by their names. They are also looked for in --models, beside the baseline and in the
    /// current folder.
    #[arg(value_name = "MODELS")]
    pub(crate) files: Vec<PathBuf>,
    /// The report to compare with (JSON, as `pliant sweep` writes it).
    #[arg(short, long, value_name = "FILE")]
    pub(crate) baseline: PathBuf,
    /// Folder with the baseline's models and scene files.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) models: Vec<PathBuf>,
    /// Scene files (JSON) of the baseline's rows; built-in scenes are known.
    #[arg(long, value_name = "FILES", value_delimiter = ',', alias = "scenes")]
    pub(crate) scene: Vec<PathBuf>,
    /// Make the rows of this plan, instead of the baseline's.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["files", "models", "scene", "report"])]
    pub(crate) plan: Option<PathBuf>,
    /// Make no rows, but compare those of this report.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["files", "models", "scene", "repeats", "retries", "threads"])]
    pub(crate) report: Option<PathBuf>,
    /// How far a figure may move: rms_relative=1%, errors=1%, counts=0+2, times=off; of its own unit after a plus: edge_max=1%+0.001.
    #[arg(long, value_name = "FIGURE=TOLERANCE", value_delimiter = ',', value_parser = tolerance)]
    pub(crate) tolerance: Vec<(String, Tolerance)>,
    /// A file of tolerances (TOML): errors, distances, counts, times, memory, and single figures below [figures].
    #[arg(long, value_name = "FILE")]
    pub(crate) tolerances: Option<PathBuf>,
    /// How much longer a stage may take: 50 % unless said otherwise.
    #[arg(long, value_name = "TOLERANCE")]
    pub(crate) time_tolerance: Option<Tolerance>,
    /// Do not compare times and memory, and keep none with --update.
    #[arg(long, conflicts_with = "time_tolerance")]
    pub(crate) no_times: bool,
    /// Times that each stage is run to time it. Default: as in the baseline, at least 3.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: Option<u32>,
    /// Times that rows which seem slow are made again before that is said.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(0..=100))]
    pub(crate) retries: u32,
    /// Threads that work. Default: as many as the baseline is of, if there are so many, as times of other numbers are not compared. One
    /// makes times that fit any machine.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Write the rows that were made to this file (JSON).
    #[arg(short, long, value_name = "FILE", conflicts_with = "report")]
    pub(crate) output: Option<PathBuf>,
    /// Also write what moved as Markdown.
    #[arg(long, value_name = "FILE")]
    pub(crate) markdown: Option<PathBuf>,
    /// Also write it as JUnit XML.
    #[arg(long, value_name = "FILE")]
    pub(crate) junit: Option<PathBuf>,
    /// Make the rows that are there now the baseline, whatever moved. Without a baseline to begin with, give --report or --plan.
    #[arg(long)]
    pub(crate) update: bool,
    /// Update even if rows failed.
    #[arg(long, requires = "update")]
    pub(crate) force: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// `FIGURE=TOLERANCE`.
fn tolerance(text: &str) -> Result<(String, Tolerance), GateError> {
    let (figure, tolerance) = text.split_once('=').ok_or_else(|| GateError::BadTolerance { found: text.to_owned() })?;
    Ok((figure.trim().to_owned(), tolerance.trim().parse()?))
}
