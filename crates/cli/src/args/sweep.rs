//! What can be typed after `pliant sweep`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use pliant::{
    BindOptions, Iterations, KneeTarget, Method, Preset, Propagation, ReportFormat, StartFrom, StudyError, SweepSize,
    View,
};

/// Edit models at several cage sizes, and tabulate error and time against size.
///
/// Every combination of models, scenes and what else is listed becomes a row. Errors are changes of edge lengths: `rms_relative` is
/// sqrt(mean(((l' - l) / l)^2)), `relative_rms` is sqrt(sum (l' - l)^2 / sum l^2).
///
/// With -o, rows that are finished are kept in PREFIX.jobs: a sweep that is broken off goes on where it was.
#[derive(Debug, Args)]
#[command(
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true,
    after_help = "Examples:\n  pliant sweep bunny.obj --sizes 1%..50%,none -o out/bunny\n  pliant sweep armadillo.obj --preset paper -o out/paper\n  pliant sweep --plan sweep.toml -o out/all\n  pliant sweep creature:20000 --prune magnitude:0.03,smooth:16 --propagation positions,frames --json\n\nSplit among machines, by whatever starts processes:\n  pliant sweep plan --plan sweep.toml                        the jobs and their ids\n  pliant sweep run --plan sweep.toml --dir jobs --shard 2/4  a quarter of them\n  pliant sweep run --plan sweep.toml --dir jobs --job slurm  the one of a Slurm array index\n  pliant sweep merge jobs -o out/all                         the report, whoever ran what"
)]
pub(crate) struct SweepCommand {
    #[command(subcommand)]
    pub(crate) part: Option<SweepPart>,
    #[command(flatten)]
    pub(crate) spec: SpecOptions,
    #[command(flatten)]
    pub(crate) output: OutputOptions,
    /// Make rows anew that an earlier run has finished.
    #[arg(long)]
    pub(crate) fresh: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum SweepPart {
    Plan(PlanOptions),
    Run(RunOptions),
    Merge(MergeOptions),
}

/// List the jobs of a sweep: number, id, and what each is.
#[derive(Debug, Args)]
pub(crate) struct PlanOptions {
    #[command(flatten)]
    pub(crate) spec: SpecOptions,
    /// Print JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Run some jobs of a sweep, and keep each in a file of its own.
///
/// Any number of these may run at a time, on any machines that see the folder, or each with a folder of its own. Errors are the same
/// whatever the split.
#[derive(Debug, Args)]
pub(crate) struct RunOptions {
    #[command(flatten)]
    pub(crate) spec: SpecOptions,
    /// Folder for the jobs' files; made if it is not there. Jobs that it has already are not run again.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) dir: PathBuf,
    /// Run the I-th of N parts, I from 1; or `slurm`, for the part that a Slurm array index is.
    #[arg(long, value_name = "I/N", conflicts_with = "job")]
    pub(crate) shard: Option<String>,
    /// Run one job: an id or its beginning, or a number as `sweep plan` lists it; or `slurm`, for the number that the Slurm array index is.
    /// May be given several times. Without it and --shard, all jobs are run.
    #[arg(long, value_name = "ID")]
    pub(crate) job: Vec<String>,
    /// Print the rows as JSON instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Put finished jobs together to a report.
///
/// Which folder holds which job does not matter. Settings are not asked for again: the folders know them.
#[derive(Debug, Args)]
pub(crate) struct MergeOptions {
    /// Folders of jobs.
    #[arg(required = true, value_name = "FOLDER")]
    pub(crate) dirs: Vec<PathBuf>,
    /// Leave out jobs that are not finished, and say so in the report.
    #[arg(long)]
    pub(crate) partial: bool,
    #[command(flatten)]
    pub(crate) output: OutputOptions,
}

/// Where a report goes.
#[derive(Debug, Args)]
pub(crate) struct OutputOptions {
    /// Write PREFIX.json and the other forms that --formats names; folders are made if they are not there.
    #[arg(short, long, value_name = "PREFIX")]
    pub(crate) output: Option<PathBuf>,
    /// Forms to write: json, csv, jsonl (a row a line), md, summary (Markdown that fits a GitHub step summary), svg, relative (an SVG
    /// of errors over that without a cage), html (one file with
    /// plots, tables and pictures), junit,
    /// github-benchmark (of github-action-benchmark), bencher, and parquet where it is built in. All others can be made of json.
    #[arg(long, value_delimiter = ',', requires = "output", default_values_t = DEFAULT_FORMATS)]
    pub(crate) formats: Vec<ReportFormat>,
    /// Say which is the smallest cage within an error (error:3%), within a share of the error without a cage (no-cage:10%), or at the bend
    /// of the curve (bend).
    #[arg(long, value_name = "TARGET", value_delimiter = ',')]
    pub(crate) knee: Vec<KneeTarget>,
    /// Print the JSON report instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// What most people look at, and what the rest can be made of.
pub(crate) const DEFAULT_FORMATS: [ReportFormat; 5] =
    [ReportFormat::Json, ReportFormat::Csv, ReportFormat::Markdown, ReportFormat::Svg, ReportFormat::Html];

/// What is swept. A flag replaces what a plan file says.
#[derive(Debug, Args)]
pub(crate) struct SpecOptions {
    /// Mesh files (obj, ply, off, stl, glb, gltf), or generated shapes with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    #[arg(value_name = "MODELS", required_unless_present = "plan")]
    pub(crate) models: Vec<String>,
    /// A plan file (TOML or JSON) with models and settings under the names of these flags; paths are relative to the current folder.
    #[arg(long, value_name = "FILE")]
    pub(crate) plan: Option<PathBuf>,
    /// Scene files (JSON), or names of built-in scenes, or auto.
    #[arg(long, value_name = "SCENES", value_delimiter = ',', alias = "scenes")]
    pub(crate) scene: Vec<String>,
    /// Take sizes, schedules, bindings and scene from here; other flags that say what is swept then have no say, but --methods.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["sizes", "propagation", "prune", "iterations", "steps", "start"])]
    pub(crate) preset: Option<Preset>,
    /// Cage sizes: vertices (2000), shares (5%), distances (error:0.002), ranges in equal ratios (1%..50%, 100..5000:6), none to deform the
    /// model itself, decimated:SIZE to deform a decimated mesh, equal-time:SIZE for one that takes as long as that cage.
    /// Default: 1%,2%,5%,10%,none.
    #[arg(long, value_delimiter = ',', value_parser = size_range)]
    pub(crate) sizes: Vec<String>,
    /// Beside each cage also deform a decimated mesh that takes as long (Borosan et al. 2010, Figure 2).
    #[arg(long)]
    pub(crate) equal_time: bool,
    /// How the cage's motion is carried to the model: frames, positions. Default: frames.
    #[arg(long, value_delimiter = ',')]
    pub(crate) propagation: Vec<Propagation>,
    /// Which weights are kept: smooth:NEIGHBOURS, local:NEIGHBOURS, magnitude:SHARE (the paper's rule: 0.03), none; each may have
    /// +space, +smoothing:N or +exact added. Default: smooth:16.
    #[arg(long, value_delimiter = ',')]
    pub(crate) prune: Vec<BindOptions>,
    /// Iterations of the solver in each step: numbers, or converged. Default: 2.
    #[arg(long, value_delimiter = ',')]
    pub(crate) iterations: Vec<Iterations>,
    /// Equal steps in which the handles travel to their goals. Default: 1.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) steps: Option<u32>,
    /// What each solve on a cage starts from: levels (coarser cages, where the goals are far; the default) or pose (the last pose alone).
    #[arg(long)]
    pub(crate) start: Option<StartFrom>,
    /// Methods, as `pliant edit --method` takes them: arap,laplacian:two-step,implicit. Default: the scene's, else arap.
    #[arg(long, value_name = "METHODS", value_delimiter = ',')]
    pub(crate) methods: Vec<Method>,
    /// Do not find converged as-rigid-as-possible deformation without a cage, which takes long on large models: no distances to it then.
    #[arg(long)]
    pub(crate) no_reference: bool,
    /// Steps of refinement at full resolution after each drag on a cage; 0 for none. Default: 10.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=10_000))]
    pub(crate) refine: Option<u32>,
    /// Times that each stage is run to time it; medians are shown, and the spread is kept. Default: 1.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) repeats: Option<u32>,
    /// Where pictures are seen from: front, back, left, right, top, bottom, iso, or a direction x,y,z towards the camera. Default: as suits
    /// the model.
    #[arg(long, value_name = "VIEW", allow_hyphen_values = true)]
    pub(crate) camera: Option<View>,
    /// Make no pictures.
    #[arg(long)]
    pub(crate) no_pictures: bool,
}

/// A text that is a size or a range of them.
fn size_range(text: &str) -> Result<String, StudyError> {
    SweepSize::parse_range(text).map(|_| text.to_owned())
}
