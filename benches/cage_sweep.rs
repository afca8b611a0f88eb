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

use pliant::{
    BindOptions, CageSize, Detail, Iterations, Method, Propagation, Scene, Silent, StartFrom, SweepPlan, SweepReport,
    SweepRow, SweepSize, creature, sweep,
};

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
        propagations: vec![Propagation::Frames],
        bindings: vec![BindOptions::default()],
        methods: vec![Method::default()],
        iterations: vec![Iterations::Count(2)],
        steps: 20,
        start: StartFrom::default(),
        reference: false,
    };
    let mut reports = Vec::with_capacity(REPEATS);
    for repeat in 1..=REPEATS {
        let start = Instant::now();
        reports.push(sweep(&format!("creature:{vertices}"), &shape, &scene, &plan, &Silent)?);
        eprintln!("sweep {repeat} of {REPEATS}: {:.1?}", start.elapsed());
    }
    let mut report = with_median_times(reports)?;
    report.notes.push(format!("Times are medians of {REPEATS} sweeps."));
    println!("{}", report.to_markdown(Detail::Main));
    print_ratios(&report);
    Ok(())
}

/// The first report with the median over all reports in place of each time.
fn with_median_times(mut reports: Vec<SweepReport>) -> Result<SweepReport, String> {
    const TIMES: [fn(&mut SweepRow) -> &mut f64; 5] = [
        |row| &mut row.simplify_ms,
        |row| &mut row.bind_ms,
        |row| &mut row.prepare_ms,
        |row| &mut row.drag_ms,
        |row| &mut row.propagate_ms,
    ];
    let mut result = reports.first().cloned().ok_or("no sweep was run")?;
    for (i, row) in result.rows.iter_mut().enumerate() {
        if reports.iter().any(|other| other.rows[i].rms_relative != row.rms_relative) {
            return Err(format!("the error at cage size {} differs from run to run", row.cage_asked));
        }
        for time in TIMES {
            let mut values: Vec<f64> = reports.iter_mut().map(|report| *time(&mut report.rows[i])).collect();
            values.sort_unstable_by(f64::total_cmp);
            *time(row) = values[values.len() / 2];
        }
    }
    Ok(result)
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
