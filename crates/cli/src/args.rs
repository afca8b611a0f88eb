//! What can be typed.

mod check;
mod sweep;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use pliant::{BindOptions, Iterations, Method, Propagation, StartFrom, SweepSize};

pub(crate) use check::CheckOptions;
pub(crate) use sweep::{
    DEFAULT_FORMATS, MergeOptions, OutputOptions, PlanOptions, RunOptions, SpecOptions, SweepCommand, SweepPart,
};

const LEARN_MORE: &str = "\
Start with `pliant demo`, then try an edit of your own:
  pliant edit bunny.obj --cage 5% -o out/bunny.glb
  pliant sweep bunny.obj --sizes 1%,5%,none -o out/bunny
`pliant COMMAND --help` explains each command with examples.";

/// Edit large triangle meshes through small control meshes.
///
/// A quadric-error simplifier makes a control mesh (cage) of the shape, mean value coordinates bind the shape to it, a
/// solver moves the cage, and the shape follows.
#[derive(Debug, Parser)]
#[command(name = "pliant", version, after_help = format!("{LEARN_MORE}\n\n{}", crate::exit::TABLE))]
pub(crate) struct Arguments {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(DemoOptions),
    Info(InfoOptions),
    Cage(CageOptions),
    Edit(EditOptions),
    Sweep(Box<SweepCommand>),
    Check(Box<CheckOptions>),
    Compare(CompareOptions),
    Bench(BenchOptions),
}

/// Make a creature of 100,000 vertices, edit it through a 5 % cage, and write meshes, pictures and a small sweep.
///
/// Nothing is read and nothing is downloaded. Every stage is printed with its time; the files are named at the end.
#[derive(Debug, Args)]
pub(crate) struct DemoOptions {
    /// Folder for the results; made if it is not there.
    #[arg(short, long, value_name = "FOLDER", default_value = "out")]
    pub(crate) out: PathBuf,
    /// Vertices of the creature, 2,000 to 1,000,000.
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = clap::value_parser!(u32).range(2000..=1_000_000))]
    pub(crate) vertices: u32,
    /// Print one JSON object instead of text (progress still goes to standard error on a terminal).
    #[arg(long)]
    pub(crate) json: bool,
}

/// Say what a mesh is: sizes, components, holes, places where it is not manifold, and what reading it changed.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  pliant info bunny.obj\n  pliant info creature:10000 --json")]
pub(crate) struct InfoOptions {
    /// A mesh file (obj, ply, off, stl, glb, gltf), or a generated shape with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    pub(crate) model: String,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Make a control mesh of a model and write it.
///
/// Its vertices are a subset of the model's. It is manifold wherever the model is, and has the same holes, handles and
/// components.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  pliant cage dragon.ply --size 5% -o cage.glb\n  pliant cage dragon.ply --size error:0.001 -o cage.obj"
)]
pub(crate) struct CageOptions {
    /// A mesh file (obj, ply, off, stl, glb, gltf), or a generated shape with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    pub(crate) model: String,
    /// Size of the cage: vertices (2000), share (5%), or largest estimated distance as a share of the diagonal (error:0.002).
    #[arg(short, long, default_value = "5%")]
    pub(crate) size: SweepSize,
    /// File to write: obj, ply or glb.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Edit a model as a scene says, through a cage, and write the result.
///
/// The scene names regions by geometry and where each goes, so one scene fits every resolution of a model.
/// Without a scene the creature has its own; any other model gets `auto`: the lowest tenth along its longest axis is
/// held, the highest tenth turned by 30 degrees and moved.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  pliant edit bunny.obj -o bent.glb\n  pliant edit armadillo.obj --scene armadillo-2 --cage 2000 -o edited.obj\n  pliant edit man.off --scene my-scene.json --cage none --method implicit -o direct.ply"
)]
pub(crate) struct EditOptions {
    /// A mesh file (obj, ply, off, stl, glb, gltf), or a generated shape with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    pub(crate) model: String,
    /// A scene file (JSON), or the name of a built-in scene, or auto.
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<String>,
    /// Do the steps of an editing session (JSON, as the library's `Document` saves it) instead of a scene.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "cage", "propagation", "prune", "iterations", "steps", "start", "method"])]
    pub(crate) document: Option<PathBuf>,
    /// Size of the cage: vertices (2000), share (5%), distance (error:0.002), or none to deform the model itself.
    #[arg(long, value_name = "SIZE", default_value = "5%")]
    pub(crate) cage: SweepSize,
    /// How the cage's motion is carried to the model: frames or positions.
    #[arg(long, default_value_t)]
    pub(crate) propagation: Propagation,
    /// Which weights are kept: smooth:NEIGHBOURS, local:NEIGHBOURS, magnitude:SHARE (the paper's rule: 0.03) or none; then
    /// +space (nearest in space, not along the surface) or +smoothing:N (neighbours each cage vertex is averaged over).
    /// Default: smooth:16 with frames, magnitude:0.03 with positions, which need its precision.
    #[arg(long)]
    pub(crate) prune: Option<BindOptions>,
    /// Iterations of the solver in each step: a number, or converged.
    #[arg(long, value_name = "N", default_value = "converged")]
    pub(crate) iterations: Iterations,
    /// Equal steps in which the handles travel to their goals; more steps follow large turns better.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) steps: u32,
    /// What each solve on a cage starts from: levels (coarser cages, where the goals are far) or pose (the last pose alone).
    #[arg(long, default_value_t)]
    pub(crate) start: StartFrom,
    /// The method: NAME or NAME:OPTION+OPTION, with arap, laplacian, implicit, dual or rotation-invariant, such as
    /// arap:uniform+spokes, arap:propagated, laplacian:two-step, implicit:rings=1. Default: the scene's, else arap.
    #[arg(long, value_name = "METHOD")]
    pub(crate) method: Option<Method>,
    /// File to write: obj, ply or glb.
    #[arg(short, long, value_name = "FILE")]
    pub(crate) output: PathBuf,
    /// Also draw the edited model to this PNG file.
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Deform by several methods, side by side: a table of errors and times, and a picture of each.
///
/// A row has edge length errors, the distance to converged as-rigid-as-possible deformation without a cage, the change of volume, faces
/// turned over, and times. The picture has all methods in one row, from one camera, coloured by the mean relative length error of the
/// edges at each vertex, from 0 (violet) to 30 % (yellow).
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  pliant compare bunny.obj -o out/bunny\n  pliant compare creature:20000 --cage none --methods arap,dual,implicit -o out/creature\n  pliant compare --classic -o out/classic"
)]
pub(crate) struct CompareOptions {
    /// A mesh file (obj, ply, off, stl, glb, gltf), or a generated shape with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    #[arg(required_unless_present = "classic")]
    pub(crate) model: Option<String>,
    /// Run the classic tests instead, each scene on the shape it was made for, and make a row of pictures of each.
    #[arg(long, conflicts_with_all = ["model", "scene"])]
    pub(crate) classic: bool,
    /// Vertices of each shape of the classic tests.
    #[arg(long, value_name = "N", default_value_t = 5000, requires = "classic", value_parser = clap::value_parser!(u32).range(2000..=1_000_000))]
    pub(crate) vertices: u32,
    /// A scene file (JSON), or the name of a built-in scene, or auto.
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<String>,
    /// Size of the cage: vertices (2000), share (5%), distance (error:0.002), or none. Default: 5%, and none with --classic.
    #[arg(long, value_name = "SIZE")]
    pub(crate) cage: Option<SweepSize>,
    /// Methods, as `pliant edit --method` takes them. Default: ten, of every family.
    #[arg(long, value_name = "METHODS", value_delimiter = ',')]
    pub(crate) methods: Vec<Method>,
    /// Iterations in each step, of methods that iterate: a number, or converged.
    #[arg(long, value_name = "N", default_value = "2")]
    pub(crate) iterations: Iterations,
    /// Equal steps in which the handles travel to their goals.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) steps: u32,
    /// Write PREFIX.json, PREFIX.csv, PREFIX.md and PREFIX.png.
    #[arg(short, long, value_name = "PREFIX")]
    pub(crate) output: PathBuf,
    /// Print the JSON report instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Time every stage of an edit of a model on this machine: cage, binding, drags, propagation.
///
/// A drag is a solve on the cage from the pose of the last one, and propagation by frames to single-precision positions.
/// Medians of one run; on a busy machine look at ratios, such as that of propagation and a plain copy of as many bytes.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  pliant bench creature:100000\n  pliant bench dragon.ply --cage 1% --threads 1 --direct\n  pliant bench bunny.obj --prune magnitude:0.03 --exact --json"
)]
pub(crate) struct BenchOptions {
    /// A mesh file (obj, ply, off, stl, glb, gltf), or a generated shape with about N vertices: creature:N, bar:N,
    /// cactus:N, cylinder:N or plane:N.
    pub(crate) model: String,
    /// Size of the cage: vertices (2000), share (5%) or distance (error:0.002).
    #[arg(long, value_name = "SIZE", default_value = "5%")]
    pub(crate) cage: SweepSize,
    /// A scene file (JSON), or the name of a built-in scene, or auto.
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<String>,
    /// Which weights are kept: smooth:NEIGHBOURS, local:NEIGHBOURS, magnitude:SHARE or none; then +space, +smoothing:N or +exact.
    #[arg(long, default_value_t)]
    pub(crate) prune: BindOptions,
    /// Iterations of the solver in each drag.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub(crate) iterations: u32,
    /// The method: NAME or NAME:OPTION+OPTION, with arap, laplacian, implicit, dual or rotation-invariant, such as
    /// arap:uniform+spokes, arap:propagated, laplacian:two-step, implicit:rings=1. Default: the scene's, else arap.
    #[arg(long, value_name = "METHOD")]
    pub(crate) method: Option<Method>,
    /// Threads that work; all there are if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub(crate) threads: Option<u32>,
    /// Times that the stages before a drag are done, unless that takes more than some seconds.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub(crate) repeats: u32,
    /// Also bind by the 3 % rule, the fast way and the exact one, every cage face for every vertex: about 60 ns a pair.
    #[arg(long)]
    pub(crate) exact: bool,
    /// Also drag without a cage, the solver working on the model itself.
    #[arg(long)]
    pub(crate) direct: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(crate) json: bool,
}
