//! How fast refinement takes the preview of an edit to the converged full-resolution ARAP, against solving that from rest.
//!
//! `scripts/fetch-models`, then `cargo bench --bench refine`; `cargo bench --bench refine -- man.off creature:100000` takes the models
//! named. Under `cargo test` it takes one small generated model.
//!
//! The automatic scene with a turn by 60 degrees, previewed on a cage of 5 % in one jump of two iterations. *Direct* is
//! `ArapOptions::converged()` on the shape itself: prepare, and iterate from rest until the energy falls by less than 1e-6 of itself, at
//! most 1000 times. Energies and errors (root mean square of relative edge errors) are given as ratios to direct's; times as ratios to
//! prepare and solve of direct, those of refinement with its own preparation, all in one run. A target is met by the first step after
//! which energy and error both are below it and stay so.

mod common;

use std::error::Error;
use std::time::{Duration, Instant};

use common::{Arguments, arguments, model};
use pliant::glam::DVec3;
use pliant::{
    ArapOptions, BindOptions, CageSize, Deformer, GlobalSolver, Goals, Handle, Iterations, Method, Propagation,
    RefineOptions, RefineStep, Refiner, Region, ResolvedScene, Scene, Schedule, Silent, StartFrom, Study, SweepSize,
    TriMesh, VertexSet, edge_errors,
};
use pliant_deform::arap::Arap;

const MODELS: [&str; 6] =
    ["creature:30000", "man.off", "camel.off", "bear.off", "armadillo.off", "refined_elephant.off"];

/// Full steps at most.
const STEPS: u32 = 60;

/// What energy and error are to come down to.
const TARGETS: [f64; 2] = [1.05, 1.01];

/// Ways to refine: what solves, and steps in the cage's subspace before the full ones.
const WAYS: [(GlobalSolver, u32); 4] =
    [(GlobalSolver::Multigrid, 0), (GlobalSolver::Multigrid, 2), (GlobalSolver::Factor, 0), (GlobalSolver::Factor, 2)];

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
        Edit::new(name, &shape)?.report()?;
    }
    Ok(())
}

/// A shape with handles, its preview, and where it should come to.
struct Edit<'a> {
    shape: &'a TriMesh,
    region: Region,
    goals: Goals,
    preview: Vec<DVec3>,
    rows: pliant::Binding,
    direct: Arap,
    direct_time: Duration,
    energy: f64,
    error: f64,
}

impl<'a> Edit<'a> {
    fn new(name: &str, shape: &'a TriMesh) -> Result<Self, Box<dyn Error>> {
        let mut scene = Scene::auto(&shape.bounds());
        if let Some(turn) = scene.handles.last_mut().and_then(|h| h.motion.as_mut()).and_then(|m| m.rotate.as_mut()) {
            turn.degrees = 60.0;
        }
        let (region, goals) = on_shape(&scene.resolve(shape)?, shape)?;

        let study = Study::new(name, shape, &scene)?;
        let caged = study.cage(SweepSize::Cage(CageSize::Fraction(0.05)), &Silent)?;
        let bound = study.bind(&caged, BindOptions::default(), &Silent)?;
        let schedule = Schedule { steps: 1, iterations: Iterations::Count(2), start: StartFrom::Levels };
        let dragged = study.drag(&caged, &Method::default(), schedule, &Silent)?;
        let (preview, _) = study.carry(&caged, &bound, &dragged, Propagation::Frames, &Silent);

        let start = Instant::now();
        let mut direct = Arap::prepare(&ArapOptions::converged(), shape, &region)?;
        let prepare = start.elapsed();
        let mut pose = shape.positions.clone();
        let report = direct.solve(&goals, &mut pose)?;
        let direct_time = start.elapsed();
        let energy = direct.energy(&goals, &pose)?;
        let rows = bound.binding;
        let mut edit = Self { shape, region, goals, preview, rows, direct, direct_time, energy, error: 1.0 };
        edit.error = edit.error_of(&pose);
        println!(
            "{name}, {} vertices. Direct: prepare {:.1} ms, all {:.1} ms, {} iterations{}, energy {energy:.4e}, error {:.4}",
            shape.vertex_count(),
            ms(prepare),
            ms(direct_time),
            report.iterations,
            if report.converged { "" } else { " (not converged)" },
            edit.error
        );
        Ok(edit)
    }

    /// Relative to that of the direct solve, once that is known.
    fn error_of(&self, pose: &[DVec3]) -> f64 {
        edge_errors(self.shape.topology(), &self.shape.positions, pose).rms_relative / self.error
    }

    fn report(&mut self) -> Result<(), Box<dyn Error>> {
        for (solver, subspace) in WAYS {
            let start = Instant::now();
            let mut refiner =
                Refiner::prepare(self.shape, &self.region, &RefineOptions { solver, ..RefineOptions::default() })?;
            if subspace > 0 {
                refiner.set_subspace(self.rows.cage_vertex_count(), |v| self.rows.row(v))?;
            }
            let prepare = start.elapsed();
            let first = refiner.begin(&self.goals, &self.preview)?;
            let mut clock = start.elapsed();
            let begun = self.at(&refiner, first)?;
            println!(
                "  {solver:?}, {subspace} subspace steps: prepare {:.1} ms; preview at {:.3} of the energy, {:.3} of the error",
                ms(prepare),
                begun[0],
                begun[1]
            );
            let mut met = [None; TARGETS.len()];
            for count in 0..subspace + STEPS {
                let step = if count < subspace { refiner.subspace_step()? } else { refiner.step()? };
                clock += step.elapsed;
                let now = self.at(&refiner, step.energy)?;
                for (met, target) in met.iter_mut().zip(TARGETS) {
                    *met = if now.iter().all(|x| *x <= target) { met.or(Some(clock)) } else { None };
                }
                self.print(&step, clock, now);
                if step.settled {
                    break;
                }
            }
            for (met, target) in met.iter().zip(TARGETS) {
                match met {
                    Some(time) => println!("    {target}x: {:.1} ms, {:.3} of direct", ms(*time), self.share(*time)),
                    None => println!("    {target}x: not within {STEPS} steps"),
                }
            }
        }
        Ok(())
    }

    /// Energy and error as ratios; the energy as the direct solver counts it agrees with what the step says.
    fn at(&mut self, refiner: &Refiner, energy: f64) -> Result<[f64; 2], Box<dyn Error>> {
        let mut pose = self.preview.clone();
        refiner.positions(&mut pose)?;
        let counted = self.direct.energy(&self.goals, &pose)?;
        assert!((counted - energy).abs() <= 1e-6 * counted, "{counted} is not {energy}");
        Ok([energy / self.energy, self.error_of(&pose)])
    }

    fn print(&self, step: &RefineStep, clock: Duration, [energy, error]: [f64; 2]) {
        let RefineStep { kind, iteration, elapsed, .. } = step;
        // As many lines as can be read.
        if *iteration <= 10 || iteration % 5 == 0 {
            println!(
                "    {iteration:3} {kind:?} {:.2} ms, {:.4} of direct: energy {energy:.4}, error {error:.4}",
                ms(*elapsed),
                self.share(clock)
            );
        }
    }

    fn share(&self, time: Duration) -> f64 {
        time.as_secs_f64() / self.direct_time.as_secs_f64()
    }
}

/// Handles and goals of a scene; what is joined to no handle stays where it is.
fn on_shape(scene: &ResolvedScene, shape: &TriMesh) -> Result<(Region, Goals), Box<dyn Error>> {
    let n = shape.vertex_count();
    let handles: Vec<Handle> = scene.handles.iter().map(|h| Handle::hard(h.vertices.clone())).collect();
    let (region, _) = Region::new(n, &VertexSet::all(n), &handles)?.without_unconstrained(shape.topology());
    Ok((region, Goals::new(scene.goals(1.0))))
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}
