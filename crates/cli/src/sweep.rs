use std::path::{Path, PathBuf};

use anyhow::Result;
use pliant::{Detail, PAPER_SCENE, Scene, Stages, SweepPlan, SweepReport, can_write, paper_sizes, sweep, write_atomic};

use crate::args::{Preset, SweepOptions};
use crate::console::Console;
use crate::edit::method;
use crate::model::Model;

pub(crate) fn run(options: &SweepOptions) -> Result<()> {
    if let Some(prefix) = &options.output {
        for (path, kind) in files(prefix) {
            can_write(&path, &[kind])?;
        }
    }
    let console = Console::new(options.json);
    let model = Model::open(&options.model, &console)?;
    if let Some(prefix) = &options.output {
        let outputs = files(prefix).map(|(path, _)| path);
        model.check_outputs(outputs.iter().map(PathBuf::as_path), options.scene.as_deref())?;
    }
    let (scene, plan, mut notes) = plan(options, &model)?;
    let mut report = sweep(&model.name, &model.mesh, &scene, &plan, &console as &dyn Stages)?;
    notes.extend(model.notes());
    report.notes.append(&mut notes);

    let mut written = Vec::new();
    if let Some(prefix) = &options.output {
        written = write_reports(prefix, &report)?;
    }
    if options.json {
        use std::io::Write;
        writeln!(std::io::stdout().lock(), "{}", report.to_json())?;
        return Ok(());
    }
    console.say("")?;
    console.say(&report.to_markdown(Detail::Main))?;
    for path in written {
        console.say(&format!("wrote {}", path.display()))?;
    }
    Ok(())
}

/// Scene and rows that were asked for, and what to say about them.
fn plan(options: &SweepOptions, model: &Model) -> Result<(Scene, SweepPlan, Vec<String>)> {
    let mut notes = Vec::new();
    if options.preset == Some(Preset::Paper) {
        let vertices = model.mesh.vertex_count();
        let mut plan = SweepPlan::paper(vertices);
        // Typed methods replace the paper's.
        if !options.methods.is_empty() {
            plan.methods.clone_from(&options.methods);
        }
        notes.extend(paper_sizes(vertices).note());
        let scene = match &options.scene {
            Some(scene) => model.scene(Some(scene))?,
            None => {
                let papers = Scene::builtin(PAPER_SCENE)?;
                match papers.resolve(&model.mesh) {
                    Ok(_) => papers,
                    Err(error) => {
                        let own = model.scene(None)?;
                        notes.push(format!(
                            "The paper's scene does not fit this model ({error}); scene {} is used.",
                            own.name
                        ));
                        own
                    }
                }
            }
        };
        return Ok((scene, plan, notes));
    }
    let scene = model.scene(options.scene.as_deref())?;
    let plan = SweepPlan {
        sizes: options.sizes.clone(),
        propagations: options.propagation.clone(),
        bindings: options.prune.clone(),
        methods: if options.methods.is_empty() { vec![method(None, &scene)] } else { options.methods.clone() },
        iterations: options.iterations.clone(),
        steps: options.steps as usize,
        start: options.start,
        reference: options.reference,
        ..SweepPlan::default()
    };
    Ok((scene, plan, notes))
}

/// The files of a report and their extensions.
fn files(prefix: &Path) -> [(PathBuf, &'static str); 4] {
    with_extensions(prefix, ["json", "csv", "md", "svg"])
}

/// A prefix with each extension.
pub(crate) fn with_extensions<const N: usize>(
    prefix: &Path,
    extensions: [&'static str; N],
) -> [(PathBuf, &'static str); N] {
    extensions.map(|extension| {
        // Appended, so that a dot in the prefix is kept.
        let mut name = prefix.as_os_str().to_owned();
        name.push(".");
        name.push(extension);
        (name.into(), extension)
    })
}

/// Writes a report in all its forms.
pub(crate) fn write_reports(prefix: &Path, report: &SweepReport) -> Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    for (path, kind) in files(prefix) {
        let text = match kind {
            "json" => report.to_json(),
            "csv" => report.to_csv(),
            "md" => report.to_markdown(Detail::Full),
            _ => report.to_svg(),
        };
        write_atomic(&path, text.as_bytes())?;
        written.push(path);
    }
    Ok(written)
}
