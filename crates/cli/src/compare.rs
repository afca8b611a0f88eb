use std::path::PathBuf;

use anyhow::Result;
use pliant::glam::DVec3;
use pliant::{
    Bounds, CageSize, ComparePlan, Compared, Comparison, Detail, Model, Picture, PictureOptions, Scene, Schedule,
    SheetCell, SheetRow, StartFrom, SweepSize, TriMesh, can_write, coloured, compare, contact_sheet, timed, trim_alike,
    usual_view, write_atomic, write_png,
};

use crate::args::CompareOptions;
use crate::console::Console;
use crate::model::check_outputs;
use crate::sweep::{make_folder_of, with_extensions};

pub(crate) fn run(options: &CompareOptions) -> Result<()> {
    let files = with_extensions(&options.output, ["json", "csv", "md", "png"]);
    make_folder_of(&options.output)?;
    for (path, kind) in &files {
        can_write(path, &[kind])?;
    }
    let console = Console::new(options.json);
    let plan = plan(options);
    let mut comparison = Comparison::default();
    let mut rows = Vec::new();
    for (model, scene) in cases(options, &console, &files)? {
        let mut compared = compare(&model.name, &model.mesh, &scene, &plan, &console)?;
        for info in &mut compared.report.models {
            info.notes = model.notes();
        }
        let (row, _) = timed(
            &console,
            "draw",
            |_| draw(&model.mesh, &compared),
            |row: &SheetRow| format!("{} pictures", row.cells.len()),
        )?;
        rows.push(row);
        comparison.cases.push(compared.report);
        comparison.implicit.extend(compared.implicit);
    }
    for (path, kind) in &files {
        match *kind {
            "json" => write_atomic(path, comparison.to_json().as_bytes())?,
            "csv" => write_atomic(path, comparison.to_csv().as_bytes())?,
            "md" => write_atomic(path, comparison.to_markdown(Detail::Full).as_bytes())?,
            _ => {
                let headings: Vec<String> = plan.methods.iter().map(ToString::to_string).collect();
                write_png(path, &contact_sheet(&headings, &rows, PictureOptions::default().background))?;
            }
        }
    }
    if options.json {
        use std::io::Write;
        writeln!(std::io::stdout().lock(), "{}", comparison.to_json())?;
        return Ok(());
    }
    console.say("")?;
    console.say(&comparison.to_markdown(Detail::Main))?;
    for (path, _) in files {
        console.say(&format!("wrote {}", path.display()))?;
    }
    Ok(())
}

fn plan(options: &CompareOptions) -> ComparePlan {
    let mut plan = ComparePlan {
        size: options.cage.unwrap_or(if options.classic {
            SweepSize::None
        } else {
            SweepSize::Cage(CageSize::Fraction(0.05))
        }),
        schedule: Schedule {
            steps: options.steps as usize,
            iterations: options.iterations,
            start: StartFrom::default(),
        },
        ..ComparePlan::default()
    };
    if !options.methods.is_empty() {
        plan.methods.clone_from(&options.methods);
    }
    plan
}

/// The shapes and the scenes on them.
fn cases(options: &CompareOptions, console: &Console, files: &[(PathBuf, &str)]) -> Result<Vec<(Model, Scene)>> {
    let Some(name) = &options.model else {
        let scenes = Scene::classic_names().map(Scene::builtin).collect::<Result<Vec<_>, _>>()?;
        let made_for = scenes.into_iter().filter_map(|scene| Some((scene.shape.clone()?, scene)));
        return made_for
            .map(|(shape, scene)| Ok((Model::open(&format!("{shape}:{}", options.vertices), console)?, scene)))
            .collect();
    };
    let model = Model::open(name, console)?;
    check_outputs(&model, files.iter().map(|(path, _)| path.as_path()), options.scene.as_deref())?;
    let scene = model.scene(options.scene.as_deref())?;
    Ok(vec![(model, scene)])
}

/// The shape by each method, from one camera, coloured by edge errors.
fn draw(shape: &TriMesh, compared: &Compared) -> Result<SheetRow> {
    let base =
        PictureOptions { width: 150, height: 130, view: usual_view(&shape.bounds()), ..PictureOptions::default() };
    let options = PictureOptions { framing: framing(shape, compared).corners().to_vec(), ..base };
    let mut pictures = Vec::new();
    for pose in compared.poses.iter().flatten() {
        pictures.push(coloured(shape, pose, &options)?);
    }
    let mut pictures = trim_alike(&pictures, 2, options.background).into_iter();
    let report = &compared.report;
    let cells = report.rows.iter().zip(&compared.poses).map(|(row, pose)| {
        let picture: Option<Picture> = pose.as_ref().and_then(|_| pictures.next());
        let caption = if picture.is_some() { format!("{:.1} %", 1e2 * row.rms_relative) } else { "refused".to_owned() };
        SheetCell { picture, caption }
    });
    Ok(SheetRow { title: report.subject(), cells: cells.collect() })
}

/// What all pictures of a row show: every pose that is no more than twice as large as the shape at rest, so that one which breaks apart
/// does not make all others small.
fn framing(shape: &TriMesh, compared: &Compared) -> Bounds {
    let rest = shape.bounds();
    let poses = compared.poses.iter().flatten().map(|pose| Bounds::of(pose));
    let corners: Vec<DVec3> = poses
        .filter(|bounds| bounds.diagonal() <= 2.0 * rest.diagonal())
        .flat_map(|bounds| [bounds.min, bounds.max])
        .collect();
    if corners.is_empty() { rest } else { Bounds::of(&corners) }
}
