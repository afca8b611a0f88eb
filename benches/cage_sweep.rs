//! Cage size against RMS edge-length error and time, on the creature: what a smaller cage saves and what it costs.
//!
//! `cargo bench --bench cage_sweep` sweeps cages of 1, 2, 5 and 10 % and no cage on 50,000 vertices;
//! `cargo bench --bench cage_sweep -- 200000` takes another number. Under `cargo test` it takes 2,000.
//!
//! The creature's scene is dragged in 20 steps of 2 iterations through each cage, with default options (frames,
//! cotangent weights), and the error is that of the last step. A drag step is one solve and one propagation. What limits it is
//! the solve's, so roughly linear in the number of cage vertices, plus a propagation that depends on the shape alone:
//! small cages gain less and less.
//!
//! The sweep runs five times and each time is the median, so a busy moment spoils one sweep and not one row. Errors do
//! not vary at all, which is checked. Times of different runs should not be compared: read the ratios below the table.

mod common;

use std::error::Error;
use std::time::Instant;

use pliant::{CageSize, Detail, Scene, Silent, SweepPlan, SweepReport, SweepSize, creature, sweep};

const VERTICES: usize = 50_000;
const VERTICES_IN_TESTS: usize = 2_000;
const REPEATS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let Some(arguments) = common::arguments("cage_sweep") else { return Ok(()) };
    let default = if arguments.measured { VERTICES } else { VERTICES_IN_TESTS };
    let vertices = arguments.numbers.first().copied().unwrap_or(default);
    let shape = creature(vertices)?;
    let scene = Scene::builtin("creature")?;
    let cages = [0.01, 0.02, 0.05, 0.1].map(|share| SweepSize::Cage(CageSize::Fraction(share)));
    let plan = SweepPlan {
        sizes: cages.into_iter().chain([SweepSize::None]).collect(),
        steps: 20,
        repeats: REPEATS,
        ..SweepPlan::default()
    };
    let start = Instant::now();
    let mut report = sweep(&format!("creature:{vertices}"), &shape, &scene, &plan, &Silent)?;
    eprintln!("{REPEATS} repeats: {:.1?}", start.elapsed());
    report.notes.push(format!("Times are medians of {REPEATS} repeats."));
    println!("{}", report.to_markdown(Detail::Main));
    print_ratios(&report);
    Ok(())
}

fn print_ratios(report: &SweepReport) {
    let Some(direct) = report.rows.iter().find(|row| row.is_direct()) else { return };
    for row in report.rows.iter().filter(|row| !row.is_direct()) {
        println!(
            "cage {}: error {:.2} of the direct one's, time per drag step (solve + propagate) direct over caged {:.1}",
            row.cage_asked,
            row.rms_relative / direct.rms_relative,
            direct.edit_ms() / row.edit_ms(),
        );
    }
}
