use std::path::Path;

use anyhow::{Context, Result};
use pliant::{
    BindOptions, Document, Editor, Method, Model, PictureOptions, Propagation, Prune, Scene, Schedule, Study, SweepRow,
    TriMesh, can_write, can_write_mesh, edge_errors, render, timed, write, write_png,
};
use serde::Serialize;

use crate::args::EditOptions;
use crate::console::{Console, StageTime, print_json};
use crate::model::check_outputs;

/// What `pliant edit --json` prints: the row a sweep would have, and the files.
#[derive(Serialize)]
struct EditResult<'a> {
    #[serde(flatten)]
    row: &'a SweepRow,
    /// Repairs made while reading.
    notes: Vec<String>,
    output: String,
    picture: Option<String>,
    stages: Vec<StageTime>,
}

pub(crate) fn run(options: &EditOptions) -> Result<()> {
    can_write_mesh(&options.output)?;
    if let Some(picture) = &options.picture {
        can_write(picture, &["png"])?;
    }
    let console = Console::new(options.json);
    let model = Model::open(&options.model, &console)?;
    let outputs = std::iter::once(options.output.as_path()).chain(options.picture.as_deref());
    if let Some(document) = &options.document {
        check_outputs(&model, outputs, document.to_str())?;
        return replay(options, document, &model, &console);
    }
    check_outputs(&model, outputs, options.scene.as_deref())?;
    let scene = model.scene(options.scene.as_deref())?;

    let study = Study::new(model.name.clone(), &model.mesh, &scene)?;
    let caged = study.cage(options.cage, &console)?;
    let prune = options.prune.unwrap_or(match options.propagation {
        Propagation::Frames => BindOptions::default(),
        Propagation::Positions => Prune::PAPER.into(),
    });
    let bound = study.bind(&caged, prune, &console)?;
    let schedule = Schedule { steps: options.steps as usize, iterations: options.iterations, start: options.start };
    let method = method(options.method.as_ref(), &scene);
    let dragged = study.drag(&caged, &method, schedule, &console)?;
    let (pose, row) = study.carry(&caged, &bound, &dragged, options.propagation, &console);

    write_all(options, &model.mesh.with_positions(pose)?, &console)?;
    let picture = options.picture.as_ref().map(|p| p.display().to_string());
    if options.json {
        let output = options.output.display().to_string();
        return print_json(&EditResult { row: &row, notes: model.notes(), output, picture, stages: console.stages() });
    }
    console.say(&format!("scene {}: {}", scene.name, handle_list(&study)))?;
    console.say(&format!(
        "edge length error {:.2} % (root mean square of relative errors), {:.2} % (relative root mean square), 99 % of edges below {:.1} %",
        1e2 * row.rms_relative,
        1e2 * row.relative_rms,
        1e2 * row.edge_p99
    ))?;
    console.say(&format!("handles are met to {:.2} % of the diagonal", 1e2 * row.handle_error_max))?;
    for warning in model.notes().iter().chain(&row.warnings) {
        console.warn(warning);
    }
    Ok(())
}

/// The method that was asked for, else the scene's, else the default.
pub(crate) fn method(asked: Option<&Method>, scene: &Scene) -> Method {
    asked.or(scene.method.as_ref()).cloned().unwrap_or_default()
}

/// The edited model, and its picture if one is wanted.
fn write_all(options: &EditOptions, edited: &TriMesh, console: &Console) -> Result<()> {
    timed(console, "write", |_| write(&options.output, edited), |()| options.output.display().to_string())?;
    if let Some(path) = &options.picture {
        let draw =
            |_: &dyn pliant::Progress| anyhow::Ok(write_png(path, &render(edited, &PictureOptions::default())?)?);
        timed(console, "draw", draw, |()| path.display().to_string())?;
    }
    Ok(())
}

/// What `pliant edit --document --json` prints.
#[derive(Serialize)]
struct ReplayResult {
    /// Steps that are done at the end, by name.
    steps: Vec<String>,
    undone: usize,
    vertices: usize,
    cage_vertices: usize,
    rms_relative: f64,
    relative_rms: f64,
    edge_p99: f64,
    edge_max: f64,
    notes: Vec<String>,
    output: String,
    picture: Option<String>,
    stages: Vec<StageTime>,
}

/// Does the steps of a document.
fn replay(options: &EditOptions, path: &Path, model: &Model, console: &Console) -> Result<()> {
    let document = Document::load(path).with_context(|| path.display().to_string())?;
    let done = document.steps.len().saturating_sub(document.undone);
    let work = |progress: &dyn pliant::Progress| Editor::replay(&document, model.mesh.clone(), progress);
    let (editor, _) = timed(console, "replay", work, |_| format!("{} steps, {} undone", done, document.undone))
        .with_context(|| path.display().to_string())?;
    write_all(options, &model.mesh.with_positions(editor.positions().to_vec())?, console)?;
    let errors = edge_errors(model.mesh.topology(), &model.mesh.positions, editor.positions());
    if options.json {
        return print_json(&ReplayResult {
            steps: document.steps[..done].iter().map(|step| step.name.clone()).collect(),
            undone: document.undone,
            vertices: model.mesh.vertex_count(),
            cage_vertices: editor.cage_positions().len(),
            rms_relative: errors.rms_relative,
            relative_rms: errors.relative_rms,
            edge_p99: errors.p99,
            edge_max: errors.max,
            notes: model.notes(),
            output: options.output.display().to_string(),
            picture: options.picture.as_ref().map(|p| p.display().to_string()),
            stages: console.stages(),
        });
    }
    for (number, step) in document.steps[..done].iter().enumerate() {
        console.say(&format!("{}. {}", number + 1, step.name))?;
    }
    console.say(&format!(
        "edge length error {:.2} % (root mean square of relative errors), {:.2} % (relative root mean square), 99 % of edges below {:.1} %",
        1e2 * errors.rms_relative,
        1e2 * errors.relative_rms,
        1e2 * errors.p99
    ))?;
    for warning in model.notes() {
        console.warn(&warning);
    }
    Ok(())
}

/// `feet (812 vertices), hand (90 vertices)`.
pub(crate) fn handle_list(study: &Study<'_>) -> String {
    let handles: Vec<String> =
        study.handles().map(|(name, n)| format!("{name} ({} vertices)", pliant::count(n))).collect();
    handles.join(", ")
}
