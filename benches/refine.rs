//! How fast refinement takes a released edit to the converged full-resolution ARAP, against solving that from rest.
//!
//! `scripts/fetch-models`, then `cargo bench --bench refine`; `cargo bench --bench refine -- man.off creature:1000000` takes the models
//! named (most of the time of a large one goes into the direct solve). Under `cargo test` it takes one small generated model.
//!
//! The automatic scene with a turn by 60 degrees, in an editor with a cage of 5 %: released, and refined in several ways. *Direct* is
//! `ArapOptions::converged()` on the shape itself, *plain* as it is and *direct* with Anderson acceleration: prepare, and iterate from rest
//! until the energy falls by less than 1e-6 of itself, at most 1000 times. That may still be far from the minimum, so steps of a refiner
//! go on from there until a hundred of them lower the energy by less than 1e-4 of it: this is what energies and errors (root mean square
//! of relative edge errors) are given as ratios to. Times are shares of prepare and solve of direct, and where a target is met of plain, too; those of refinement count all from the
//! release on, but for the levels, which are made once a shape. A target is met by the first step after which energy and error both are below it and stay so. All
//! in one run.

mod common;

use std::error::Error;
use std::time::{Duration, Instant};

use common::{Arguments, arguments, model};
use pliant::glam::DVec3;
use pliant::{
    Acceleration, ArapOptions, Deformer, Editor, EditorOptions, Goals, Grip, Handle, RefineOptions, RefineReport,
    Refiner, Region, ResolvedScene, Scene, Silent, TriMesh, VertexSet, edge_errors,
};
use pliant_deform::arap::Arap;

const MODELS: [&str; 6] =
    ["creature:30000", "man.off", "camel.off", "bear.off", "armadillo.off", "refined_elephant.off"];

/// Steps on the shape at most.
const STEPS: usize = 60;

/// What energy and error are to come down to.
const TARGETS: [f64; 2] = [1.05, 1.01];

/// Ways to refine: through levels or not, and with how many steps in the motions of the cage.
const WAYS: [(bool, u32); 4] = [(true, 0), (false, 0), (true, 2), (false, 2)];

fn main() -> Result<(), Box<dyn Error>> {
    let Some(Arguments { measured, models, .. }) = arguments("refine") else { return Ok(()) };
    let mut names: Vec<&str> = models.iter().map(String::as_str).collect();
    match (names.is_empty(), measured) {
        (true, true) => names.extend(MODELS),
        (true, false) => names.push("creature:2000"),
        _ => {}
    }
    for name in names {
        let Some(shape) = model(name)? else { continue };
        let mut scene = Scene::auto(&shape.bounds());
        if let Some(turn) = scene.handles.last_mut().and_then(|h| h.motion.as_mut()).and_then(|m| m.rotate.as_mut()) {
            turn.degrees = 60.0;
        }
        let scene = scene.resolve(&shape)?;
        println!("{name}, {} vertices", shape.vertex_count());
        let to = Converged::of(&shape, &scene)?;
        for (levels, subspace_steps) in WAYS {
            refine(&shape, &scene, levels, subspace_steps, &to)?;
        }
    }
    Ok(())
}

/// Where a refinement should come to.
struct Converged {
    direct: Duration,
    plain: Duration,
    energy: f64,
    error: f64,
}

impl Converged {
    fn of(shape: &TriMesh, scene: &ResolvedScene) -> Result<Self, Box<dyn Error>> {
        let n = shape.vertex_count();
        let handles: Vec<Handle> = scene.handles.iter().map(|h| Handle::hard(h.vertices.clone())).collect();
        // What is joined to no handle stays where it is.
        let (region, _) = Region::new(n, &VertexSet::all(n), &handles)?.without_unconstrained(shape.topology());
        let goals = Goals::new(scene.goals(1.0));
        let error_of = |pose: &[DVec3]| edge_errors(shape.topology(), &shape.positions, pose).rms_relative;

        let options = ArapOptions::converged();
        let (_, _, plain) = solved(&options, shape, &region, &goals, "plain")?;
        let options = ArapOptions { acceleration: Acceleration::Anderson { window: 5 }, ..options };
        let (mut solver, mut pose, direct) = solved(&options, shape, &region, &goals, "direct")?;
        let energy = solver.energy(&goals, &pose)?;
        // Memory of large factors.
        drop(solver);

        let mut refiner = Refiner::prepare(shape, &region, &RefineOptions::default())?;
        let mut energies = vec![refiner.begin(&goals, &pose)?];
        let settles = |energies: &[f64]| match energies {
            [.., last] if energies.len() > 100 => energies[energies.len() - 101] - last < 1e-4 * last,
            _ => false,
        };
        while energies.len() < 5000 && !settles(&energies) {
            let step = refiner.step()?;
            energies.push(step.energy);
            if step.settled {
                break;
            }
        }
        let (at, steps) = (error_of(&pose), energies.len() - 1);
        refiner.positions(&mut pose)?;
        let made = Self { direct, plain, energy: energies[steps], error: error_of(&pose) };
        println!(
            "  direct at energy {:.4}, error {:.4}; converged after {steps} steps more: energy {:.4e}, error {:.4}",
            energy / made.energy,
            at / made.error,
            made.energy,
            made.error
        );
        Ok(made)
    }

    fn share(&self, time: Duration) -> f64 {
        time.as_secs_f64() / self.direct.as_secs_f64()
    }
}

/// Prepares and solves from rest: the solver, the pose, and how long both took.
fn solved(
    options: &ArapOptions,
    shape: &TriMesh,
    region: &Region,
    goals: &Goals,
    name: &str,
) -> Result<(Arap, Vec<DVec3>, Duration), Box<dyn Error>> {
    let start = Instant::now();
    let mut solver = Arap::prepare(options, shape, region)?;
    let prepare = start.elapsed();
    let mut pose = shape.positions.clone();
    let report = solver.solve(goals, &mut pose)?;
    let all = start.elapsed();
    println!(
        "  {name}: prepare {:.2} s, all {:.2} s, {} iterations{}",
        prepare.as_secs_f64(),
        all.as_secs_f64(),
        report.iterations,
        if report.converged { "" } else { " (not converged)" },
    );
    Ok((solver, pose, all))
}

/// Releases the scene in an editor, and refines it.
fn refine(
    shape: &TriMesh,
    scene: &ResolvedScene,
    levels: bool,
    subspace_steps: u32,
    to: &Converged,
) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    let options = EditorOptions { levels_from: levels.then_some(0), subspace_steps, ..EditorOptions::default() };
    let mut editor = Editor::open(shape.clone(), options, &Silent)?;
    let opened = start.elapsed();
    for (handle, goal) in scene.handles.iter().zip(scene.goals(1.0)) {
        let id = editor.grab(Grip::Vertices(handle.vertices.clone()))?;
        editor.drag(id, goal)?;
    }
    let start = Instant::now();
    if levels {
        editor.prepare_levels(&Silent)?;
    }
    let made = start.elapsed();
    let released = editor.release("turn")?.elapsed;
    let error = edge_errors(shape.topology(), &shape.positions, editor.positions()).rms_relative / to.error;

    let (mut clock, mut steps, mut on_shape) = (Duration::ZERO, Vec::new(), 0);
    let start = Instant::now();
    let done = editor.refine_with(|report| {
        // Preparation comes before the first step; what it costs to tell of a step does not count.
        clock = if steps.is_empty() { start.elapsed() } else { clock + report.elapsed };
        steps.push((*report, clock));
        on_shape += usize::from(report.level == 0);
        on_shape < STEPS
    })?;
    println!(
        "  {}, {subspace_steps} steps in the cage's motions: opened in {:.2} s, levels made in {:.2} s, released in {:.2} s at energy {:.4}, error {error:.4}",
        if levels { "Through levels" } else { "On the shape alone" },
        opened.as_secs_f64(),
        made.as_secs_f64(),
        released.as_secs_f64(),
        done.energy[0] / to.energy,
    );
    tell(&steps, made, to);
    Ok(())
}

/// As many lines of the steps as can be read, and when targets are met.
fn tell(steps: &[(RefineReport, Duration)], made: Duration, to: &Converged) {
    let mut met = [None; TARGETS.len()];
    let mut count = 0;
    for (k, (report, clock)) in steps.iter().enumerate() {
        let RefineReport { level, vertices, kind, energy, rms_relative, elapsed, .. } = *report;
        let error = rms_relative / to.error;
        if level > 0 {
            let ends = steps.get(k + 1).is_some_and(|(next, _)| next.level < level);
            if ends {
                let count = steps.iter().filter(|(r, _)| r.level == level).count();
                println!(
                    "    level of {vertices}: {count} steps, {:.4} of direct: energy of the level {energy:.4e}, error {error:.4}",
                    to.share(*clock)
                );
            }
            continue;
        }
        count += 1;
        let energy = energy / to.energy;
        for (met, target) in met.iter_mut().zip(TARGETS) {
            *met = if energy.max(error) <= target { met.or(Some(*clock)) } else { None };
        }
        if count <= 5 || count % 10 == 0 {
            println!(
                "    {count:3} {kind:?} {:.2} ms, {:.4} of direct: energy {energy:.4}, error {error:.4}",
                1e3 * elapsed.as_secs_f64(),
                to.share(*clock)
            );
        }
    }
    for (met, target) in met.iter().zip(TARGETS) {
        match met {
            Some(time) => println!(
                "    {target}x: {:.3} s, {:.4} of direct, {:.4} of plain; with the making of levels {:.4} of direct",
                time.as_secs_f64(),
                to.share(*time),
                time.as_secs_f64() / to.plain.as_secs_f64(),
                to.share(*time + made)
            ),
            None => println!("    {target}x: not within {STEPS} steps"),
        }
    }
}
