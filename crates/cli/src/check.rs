//! `pliant check`: a baseline's rows are made again, compared, and said to be as good or not.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use pliant::{
    GateError, GateReport, Places, Rerun, RerunOptions, RowDone, Stages, SweepReport, SweepSpec, Tolerances, Verdict,
    can_write, compare_reports, read_report, write_atomic,
};

use crate::args::CheckOptions;
use crate::console::Console;
use crate::exit::{Ending, Misuse};
use crate::model::check_not_read;
use crate::sweep::Teller;

pub(crate) fn run(options: &CheckOptions) -> Result<Ending> {
    let tolerances = tolerances(options)?;
    check_outputs(options)?;
    let console = Console::quiet(options.json);
    let baseline = baseline(options)?;
    let (report, gate) = match &options.report {
        Some(path) => {
            let report = read_report(path)?;
            let gate = compare_reports(&baseline, &report, &tolerances);
            (report, gate)
        }
        None => {
            let threads = threads(options, &baseline);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let pool = pool.with_context(|| format!("{threads} threads could not be started"))?;
            pool.install(|| make(options, &baseline, &tolerances, &console))?
        }
    };
    let texts = [
        (&options.output, report.to_json()),
        (&options.markdown, gate.to_markdown()),
        (&options.junit, gate.to_junit()),
    ];
    for (path, text) in texts {
        if let Some(path) = path {
            write_atomic(path, text.as_bytes())?;
        }
    }
    let text = if options.json { gate.to_json() } else { gate.to_text() };
    write!(std::io::stdout().lock(), "{text}")?;
    let refused = !report.refused.is_empty();
    if options.update {
        return update(options, report, &tolerances, &console);
    }
    Ok(match gate.verdict {
        Verdict::Pass | Verdict::Regression if refused => Ending::BadInput,
        Verdict::Pass => Ending::Done,
        Verdict::Regression => Ending::Regression,
        Verdict::Numeric => Ending::Numeric,
        Verdict::Internal => Ending::Internal,
    })
}

/// Those of the file, with the flags in place of what it says.
fn tolerances(options: &CheckOptions) -> Result<Tolerances> {
    let mut tolerances = match &options.tolerances {
        Some(path) => Tolerances::read(path)?,
        None => Tolerances::default(),
    };
    if let Some(times) = options.time_tolerance {
        tolerances.times = times;
    }
    for (figure, tolerance) in &options.tolerance {
        tolerances.set(figure, *tolerance)?;
    }
    if options.no_times {
        tolerances.leave_out_times();
    }
    Ok(tolerances)
}

/// Refuses what cannot be written, before anything is computed.
fn check_outputs(options: &CheckOptions) -> Result<()> {
    let inputs = [Some(&options.baseline), options.report.as_ref(), options.plan.as_ref(), options.tolerances.as_ref()];
    let inputs: Vec<&PathBuf> = inputs.into_iter().flatten().chain(&options.files).chain(&options.scene).collect();
    let outputs: Vec<&PathBuf> = outputs(options).collect();
    if let Some(twice) = (1..outputs.len()).find(|&k| outputs[..k].contains(&outputs[k])) {
        return Err(Misuse(format!("{}: two results would be written to it", outputs[twice].display())).into());
    }
    for output in outputs {
        check_not_read(output, inputs.iter().map(|input| (input.as_path(), "read")))?;
        can_write(output, &[])?;
    }
    if options.update { Ok(can_write(&options.baseline, &[])?) } else { Ok(()) }
}

fn outputs(options: &CheckOptions) -> impl Iterator<Item = &PathBuf> {
    [&options.output, &options.markdown, &options.junit].into_iter().flatten()
}

/// The report to compare with; an empty one where it is about to be made.
fn baseline(options: &CheckOptions) -> Result<SweepReport> {
    let new = options.update && (options.report.is_some() || options.plan.is_some());
    if new && !options.baseline.exists() {
        return Ok(SweepReport::new(Vec::new()));
    }
    let baseline = read_report(&options.baseline)?;
    if baseline.rows.is_empty() && !options.update {
        let message = "there are no rows in it to compare with".to_owned();
        return Err(GateError::File { file: options.baseline.display().to_string(), message }.into());
    }
    Ok(baseline)
}

/// As many as are asked for, or as the baseline is of.
fn threads(options: &CheckOptions, baseline: &SweepReport) -> usize {
    let most = std::thread::available_parallelism().map_or(1, usize::from);
    let of_baseline = baseline.machine.as_ref().map(|machine| machine.threads.clamp(1, most));
    options.threads.map(|threads| threads as usize).or(of_baseline).unwrap_or(most)
}

/// The rows of the baseline, or of the plan, as they are now.
fn make(
    options: &CheckOptions,
    baseline: &SweepReport,
    tolerances: &Tolerances,
    console: &Console,
) -> Result<(SweepReport, GateReport)> {
    let rerun = match &options.plan {
        Some(path) => Rerun::of_jobs(baseline, SweepSpec::read(path)?.jobs()?),
        None => Rerun::of_rows(baseline, &places(options))?,
    };
    for output in outputs(options) {
        check_not_read(output, rerun.models().map(|model| (Path::new(model), "a model")))?;
    }
    let timed = tolerances.compare_times() || options.update && !options.no_times;
    let rerun_options = RerunOptions {
        repeats: options.repeats.map(|n| n as usize).or((!timed).then_some(1)),
        // A baseline is worth some care.
        rounds: if options.update && timed { 3 } else { 1 },
        retries: if options.update { 0 } else { options.retries as usize },
        ..RerunOptions::default()
    };
    let mut teller = Teller::new(console);
    let mut rounds = 0;
    let mut tell = |row: RowDone<'_>| {
        rounds += usize::from(row.done == 1);
        if row.done == 1 && rounds > 1 {
            let why = if options.update { "for the shortest times" } else { "as they seem slow" };
            // A closed pipe is noticed when the result is printed.
            let _ = console.say(&format!("made again, {why}:"));
            teller = Teller::new(console);
        }
        teller.tell(row);
    };
    let checked = rerun.check(tolerances, rerun_options, console as &dyn Stages, &mut tell)?;
    console.say("")?;
    Ok((checked.report, checked.gate))
}

fn places(options: &CheckOptions) -> Places {
    let beside = options.baseline.parent().filter(|folder| !folder.as_os_str().is_empty()).map(Path::to_owned);
    Places {
        models: options.files.clone(),
        scenes: options.scene.clone(),
        folders: options.models.iter().cloned().chain(beside).chain([PathBuf::from(".")]).collect(),
    }
}

/// Makes the report the baseline.
fn update(options: &CheckOptions, report: SweepReport, tolerances: &Tolerances, console: &Console) -> Result<Ending> {
    let failed = report.failures().count() + report.refused.len();
    if failed > 0 && !options.force {
        console.warn(&format!(
            "{}: not updated, as {failed} rows failed; --force does it all the same",
            options.baseline.display()
        ));
        return Ok(Ending::of_rows(report.rows.iter()).max(Ending::BadInput));
    }
    let kept = report.into_baseline(tolerances.compare_times());
    write_atomic(&options.baseline, kept.to_json().as_bytes())?;
    console.say(&format!("wrote {}", options.baseline.display()))?;
    Ok(Ending::Done)
}
