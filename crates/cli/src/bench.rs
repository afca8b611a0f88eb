use anyhow::{Context, Result};
use pliant::{Model, Study, SweepSize, Timing, TimingPlan, count, time_stages};

use crate::args::BenchOptions;
use crate::console::{Console, print_json};
use crate::edit::method;
use crate::exit::Misuse;

pub(crate) fn run(options: &BenchOptions) -> Result<()> {
    if options.cage == SweepSize::None {
        return Err(Misuse(
            "--cage none: there would be nothing to bind and nothing to propagate; use a number of vertices (2000) or a share (5%)".to_owned(),
        )
        .into());
    }
    match options.threads {
        None => measure(options),
        Some(threads) => {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build();
            pool.with_context(|| format!("--threads {threads}: the threads could not be started"))?
                .install(|| measure(options))
        }
    }
}

fn measure(options: &BenchOptions) -> Result<()> {
    let console = Console::new(options.json);
    let start = std::time::Instant::now();
    let model = Model::open(&options.model, &console)?;
    let read_ms = 1e3 * start.elapsed().as_secs_f64();
    let scene = model.scene(options.scene.as_deref())?;
    let study = Study::new(model.name.clone(), &model.mesh, &scene)?;
    let plan = TimingPlan {
        cage: options.cage,
        bind: options.prune,
        method: method(options.method.as_ref(), &scene),
        iterations: options.iterations,
        repeats: options.repeats as usize,
        exact: options.exact,
        direct: options.direct,
        ..TimingPlan::default()
    };
    let timing = time_stages(&study, &plan, read_ms, &console)?;
    if options.json {
        return print_json(&timing);
    }
    print(&timing, &console)
}

fn print(timing: &Timing, console: &Console) -> Result<()> {
    console.say("")?;
    console.say(&format!(
        "{}: {} vertices, cage of {}, scene {}, {}; {} thread{} on {}; medians of up to {} (drags: of {})",
        timing.model,
        count(timing.vertices),
        count(timing.cage_vertices),
        timing.scene,
        timing.method,
        timing.threads,
        if timing.threads == 1 { "" } else { "s" },
        timing.cpu.as_deref().unwrap_or("an unnamed processor"),
        timing.repeats,
        timing.drags,
    ))?;
    for line in timing.lines() {
        console.say(&format!("  {line}"))?;
    }
    Ok(())
}
