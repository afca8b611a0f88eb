use anyhow::Result;
use pliant::{
    Model, SimplifyReport, SurfaceDistance, SweepSize, can_write_mesh, count, simplify, surface_distance, timed, write,
};
use serde::Serialize;

use crate::args::CageOptions;
use crate::console::{Console, StageTime, print_json};
use crate::exit::Misuse;
use crate::model::check_outputs;

/// What `pliant cage --json` prints.
#[derive(Serialize)]
struct CageResult {
    model: String,
    vertices: usize,
    cage_vertices: usize,
    cage_faces: usize,
    simplify: SimplifyReport,
    manifold: bool,
    euler_characteristic: i64,
    model_manifold: bool,
    model_euler_characteristic: i64,
    /// From the model's vertices to the cage's surface, as shares of the model's diagonal.
    distance: SurfaceDistance,
    output: String,
    warnings: Vec<String>,
    stages: Vec<StageTime>,
}

pub(crate) fn run(options: &CageOptions) -> Result<()> {
    let SweepSize::Cage(size) = options.size else {
        return Err(Misuse(
            "--size none: a cage has some size; use a number of vertices (2000), a share (5%) or a distance (error:0.002)".to_owned(),
        )
        .into());
    };
    can_write_mesh(&options.output)?;
    let console = Console::new(options.json);
    let model = Model::open(&options.model, &console)?;
    check_outputs(&model, [options.output.as_path()], None)?;
    let shape = &model.mesh;
    let (cage, _) = timed(
        &console,
        "simplify",
        |p| simplify(shape, &size.into(), p),
        |made| format!("{} of {} vertices", count(made.report.reached), count(shape.vertex_count())),
    )?;
    let (absolute, _) = timed(
        &console,
        "measure",
        |_| anyhow::Ok(surface_distance(&shape.positions, &cage.mesh)),
        |_| "distance of the model's vertices to the cage".to_owned(),
    )?;
    timed(&console, "write", |_| write(&options.output, &cage.mesh), |()| options.output.display().to_string())?;

    let (_, scale) = model.mesh.bounds().normal_frame();
    let (before, after) = (shape.topology(), cage.mesh.topology());
    let result = CageResult {
        model: model.name.clone(),
        vertices: shape.vertex_count(),
        cage_vertices: cage.mesh.vertex_count(),
        cage_faces: cage.mesh.face_count(),
        simplify: cage.report,
        manifold: after.is_manifold(),
        euler_characteristic: after.euler_characteristic(),
        model_manifold: before.is_manifold(),
        model_euler_characteristic: before.euler_characteristic(),
        distance: SurfaceDistance { rms: absolute.rms * scale, max: absolute.max * scale },
        output: options.output.display().to_string(),
        warnings: model.notes().into_iter().chain(cage.report.warnings()).collect(),
        stages: console.stages(),
    };
    if options.json {
        return print_json(&result);
    }
    let yes = |is: bool| if is { "manifold" } else { "not manifold" };
    console.say(&format!(
        "{}: {}, Euler characteristic {} (the model: {}, {})",
        result.output,
        yes(result.manifold),
        result.euler_characteristic,
        yes(result.model_manifold),
        result.model_euler_characteristic,
    ))?;
    console.say(&format!(
        "distance from the model: {:.4} % of the diagonal (root mean square), {:.4} % (largest)",
        1e2 * result.distance.rms,
        1e2 * result.distance.max
    ))?;
    for warning in &result.warnings {
        console.warn(warning);
    }
    Ok(())
}
