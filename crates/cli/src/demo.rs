use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use pliant::{
    BindOptions, Bounds, Iterations, Method, Model, Picture, PictureOptions, Propagation, Scene, Schedule, Stages,
    StartFrom, Study, SweepPlan, SweepReport, SweepRow, SweepSize, TriMesh, render, strip, sweep, timed, trim_alike,
    write, write_png,
};
use serde::Serialize;

use crate::args::{DEFAULT_FORMATS, DemoOptions};
use crate::console::{Console, StageTime, print_json};
use crate::edit::handle_list;
use crate::sweep::write_reports;

/// What `pliant demo --json` prints.
#[derive(Serialize)]
struct DemoResult<'a> {
    edit: &'a SweepRow,
    sweep: &'a SweepReport,
    files: Vec<String>,
    stages: Vec<StageTime>,
}

/// The cage of the demo.
const CAGE: SweepSize = SweepSize::Cage(pliant::CageSize::Fraction(0.05));

pub(crate) fn run(options: &DemoOptions) -> Result<()> {
    let out = &options.out;
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot make the folder", out.display()))?;
    let console = Console::new(options.json);
    console.say("A creature, edited through a cage of 5 % of its vertices:")?;
    let model = Model::open(&format!("creature:{}", options.vertices), &console)?;
    let scene = model.scene(None)?;
    let study = Study::new(model.name.clone(), &model.mesh, &scene)?;

    let caged = study.cage(CAGE, &console)?;
    let bound = study.bind(&caged, BindOptions::default(), &console)?;
    let schedule = Schedule { steps: 10, iterations: Iterations::Converged, start: StartFrom::default() };
    let dragged = study.drag(&caged, &Method::default(), schedule, &console)?;
    let (pose, row) = study.carry(&caged, &bound, &dragged, Propagation::default(), &console);

    let edited = model.mesh.with_positions(pose)?;
    let caged_after = caged.mesh.with_positions(dragged.pose.clone())?;
    let meshes = [
        ("shape-before", &model.mesh),
        ("shape-after", &edited),
        ("cage-before", &caged.mesh),
        ("cage-after", &caged_after),
    ];
    let mut files = write_meshes(out, &meshes, &console)?;
    files.extend(draw(out, &meshes, &console)?);

    console.say(&format!("handles: {}", handle_list(&study)))?;
    console.say(&format!(
        "edge length error {:.2} % (root mean square of relative errors); nothing deformed: {:.2} %",
        1e2 * row.rms_relative,
        1e2 * row.rest_rms_relative
    ))?;
    console.say("")?;
    console.say("The same edit at several cage sizes, two iterations from a standing start:")?;
    let report = small_sweep(&model, &scene, &console)?;
    files.extend(write_reports(&out.join("sweep"), &DEFAULT_FORMATS, &report)?);
    if options.json {
        let files = files.iter().map(|f| f.display().to_string()).collect();
        return print_json(&DemoResult { edit: &row, sweep: &report, files, stages: console.stages() });
    }
    console.say("")?;
    console.say(&report.to_markdown(pliant::Detail::Main))?;
    console.say("Files:")?;
    for file in &files {
        console.say(&format!("  {}", file.display()))?;
    }
    for warning in &row.warnings {
        console.warn(warning);
    }
    console.say("")?;
    console.say("Next, an edit of a model of your own (obj, ply, off, stl, glb, gltf):")?;
    console.say(&format!("  cargo run --release -- edit MODEL --cage 5% -o {}", out.join("edited.glb").display()))?;
    Ok(())
}

fn write_meshes(out: &Path, meshes: &[(&str, &TriMesh)], console: &Console) -> Result<Vec<PathBuf>> {
    let paths: Vec<PathBuf> = meshes.iter().map(|(name, _)| out.join(format!("{name}.glb"))).collect();
    timed(
        console as &dyn Stages,
        "write meshes",
        |_| paths.iter().zip(meshes).try_for_each(|(path, (_, mesh))| write(path, mesh)),
        |()| format!("{} GLB files", paths.len()),
    )?;
    Ok(paths)
}

/// A picture of each mesh, all seen by one camera, and one of all side by side.
fn draw(out: &Path, meshes: &[(&str, &TriMesh)], console: &Console) -> Result<Vec<PathBuf>> {
    let points: Vec<_> = meshes.iter().flat_map(|(_, mesh)| [mesh.bounds().min, mesh.bounds().max]).collect();
    let framing = Bounds::of(&points).corners();
    let work = |_: &dyn pliant::Progress| -> Result<Vec<PathBuf>> {
        let mut small = Vec::new();
        let mut paths = Vec::new();
        for (name, mesh) in meshes {
            let options = PictureOptions {
                wireframe: name.starts_with("cage"),
                framing: framing.to_vec(),
                ..PictureOptions::default()
            };
            paths.push(out.join(format!("{name}.png")));
            write_png(&paths[paths.len() - 1], &render(mesh, &options)?)?;
            small.push(render(mesh, &PictureOptions { width: 640, height: 480, ..options })?);
        }
        // Shape before, cage before, cage after, shape after: the way an edit takes.
        let order: Vec<Picture> = [0, 2, 3, 1].map(|i| small[i].clone()).into();
        let background = PictureOptions::default().background;
        paths.push(out.join("demo.png"));
        write_png(&paths[paths.len() - 1], &strip(&trim_alike(&order, 10, background), 0, background))?;
        Ok(paths)
    };
    let (paths, _) =
        timed(console as &dyn Stages, "draw", work, |paths: &Vec<PathBuf>| format!("{} PNG files", paths.len()))?;
    Ok(paths)
}

fn small_sweep(model: &Model, scene: &Scene, console: &Console) -> Result<SweepReport> {
    let plan = SweepPlan {
        sizes: ["1%", "2%", "5%", "10%", "none"].iter().map(|s| s.parse()).collect::<Result<_, _>>()?,
        ..SweepPlan::default()
    };
    Ok(sweep(&model.name, &model.mesh, scene, &plan, console)?)
}
