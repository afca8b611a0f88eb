//! `pliant sweep`: flags and plan files become jobs, jobs become rows, rows a report.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use pliant::{
    Detail, FormatError, JobFolder, JobList, ReportFormat, RowDone, Stages, SweepError, SweepJobs, SweepReport,
    SweepSpec, can_write, merge_jobs, write_atomic,
};

use crate::args::{MergeOptions, OutputOptions, PlanOptions, RunOptions, SpecOptions, SweepCommand, SweepPart};
use crate::console::{Console, duration, print_json};
use crate::exit::{Ending, Misuse};
use crate::model::check_not_read;

pub(crate) fn run(command: &SweepCommand) -> Result<Ending> {
    match &command.part {
        None => whole(command),
        Some(SweepPart::Plan(options)) => plan(options).map(|()| Ending::Done),
        Some(SweepPart::Run(options)) => run_part(options),
        Some(SweepPart::Merge(options)) => merge_parts(options),
    }
}

/// All at once.
fn whole(command: &SweepCommand) -> Result<Ending> {
    let spec = spec(&command.spec)?;
    let jobs = spec.jobs()?;
    check_outputs(&command.output, || inputs(&spec, command.spec.plan.as_deref()))?;
    let mut folder = None;
    if let Some(prefix) = &command.output.output {
        let path = with_extension(prefix, "jobs");
        if command.fresh && path.exists() {
            if !path.join("jobs.json").exists()
                && std::fs::read_dir(&path).map_or(true, |mut files| files.next().is_some())
            {
                let what = "this holds no jobs of a sweep, and is not emptied";
                return Err(Misuse(format!("{}: {what}; use another prefix", path.display())).into());
            }
            std::fs::remove_dir_all(&path).with_context(|| format!("{}: cannot be emptied", path.display()))?;
        }
        folder = Some(JobFolder::create(&path, &JobList::of(&jobs))?);
    }
    let console = Console::quiet(command.output.json);
    let mut teller = Teller::new(&console);
    let report = jobs.report(folder.as_ref(), &console as &dyn Stages, &mut |row| teller.tell(row))?;
    if let (found @ 1.., Some(prefix)) = (teller.found, &command.output.output) {
        let path = with_extension(prefix, "jobs");
        console.say(&format!("{found} rows were finished before ({}); --fresh makes them anew", path.display()))?;
    }
    publish(report, &command.output, &console)
}

fn plan(options: &PlanOptions) -> Result<()> {
    let list = JobList::of(&spec(&options.spec)?.jobs()?);
    if options.json {
        return print_json(&list);
    }
    let console = Console::quiet(false);
    for job in &list.jobs {
        console.say(&format!("{:>4}  {}  {}, scene {}, {}", job.index, job.id, job.model, job.scene, job.asked))?;
    }
    list.refused.iter().for_each(|refused| console.warn(&format!("{}: {}", refused.model, refused.reason)));
    list.notes.iter().for_each(|note| console.warn(note));
    Ok(())
}

fn run_part(options: &RunOptions) -> Result<Ending> {
    let jobs = spec(&options.spec)?.jobs()?;
    let chosen = chosen(options, &jobs)?;
    let folder = JobFolder::create(&options.dir, &JobList::of(&jobs))?;
    let console = Console::quiet(options.json);
    jobs.refused.iter().for_each(|refused| console.warn(&format!("{}: {}", refused.model, refused.reason)));
    let mut teller = Teller::new(&console);
    let results = jobs.run(&chosen, Some(&folder), &console as &dyn Stages, &mut |row| teller.tell(row))?;
    if options.json {
        print_json(&results.iter().map(|result| &result.row).collect::<Vec<_>>())?;
    } else {
        console.say(&format!("{} of {} jobs are in {}", results.len(), jobs.jobs.len(), options.dir.display()))?;
    }
    // A part may well have nothing to do.
    Ok(if results.is_empty() { Ending::Done } else { Ending::of_rows(results.iter().map(|result| &result.row)) })
}

/// Numbers of the jobs that are asked for.
fn chosen(options: &RunOptions, jobs: &SweepJobs) -> Result<Vec<usize>, SweepError> {
    if let Some(shard) = &options.shard {
        let bad = || SweepError::Value {
            what: "shard",
            found: shard.clone(),
            message: "use I/N, as 1/4 for the first of four, or slurm".to_owned(),
        };
        let (part, count) = if shard == SLURM {
            let step = array("SLURM_ARRAY_TASK_STEP").unwrap_or(1).max(1);
            let place = array(TASK)?.saturating_sub(array("SLURM_ARRAY_TASK_MIN")?) / step;
            (place + 1, array("SLURM_ARRAY_TASK_COUNT")?)
        } else {
            let (part, count) = shard.split_once('/').ok_or_else(bad)?;
            (part.parse().map_err(|_| bad())?, count.parse().map_err(|_| bad())?)
        };
        return jobs.shard(part, count);
    }
    if options.job.is_empty() {
        return Ok((0..jobs.jobs.len()).collect());
    }
    let number = |asked: &String| match asked.as_str() {
        SLURM => jobs.job(&array(TASK)?.to_string()),
        asked => jobs.job(asked),
    };
    options.job.iter().map(number).collect()
}

/// The word for what Slurm says in the environment.
const SLURM: &str = "slurm";

/// Slurm's index in an array of jobs.
const TASK: &str = "SLURM_ARRAY_TASK_ID";

fn array(variable: &'static str) -> Result<usize, SweepError> {
    std::env::var(variable).ok().and_then(|text| text.parse().ok()).ok_or(SweepError::NoArray { variable })
}

fn merge_parts(options: &MergeOptions) -> Result<Ending> {
    check_outputs(&options.output, std::iter::empty)?;
    for format in &options.output.formats {
        let Some(prefix) = &options.output.output else { break };
        let path = with_extension(prefix, format.extension());
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        check_not_read(folder, options.dirs.iter().map(|dir| (dir.as_path(), "a folder of jobs")))?;
    }
    let report = merge_jobs(&options.dirs, options.partial)?;
    publish(report, &options.output, &Console::quiet(options.output.json))
}

/// The plan file with the flags in place of what it says.
fn spec(options: &SpecOptions) -> Result<SweepSpec, SweepError> {
    let mut spec = match &options.plan {
        Some(path) => SweepSpec::read(path)?,
        None => SweepSpec::default(),
    };
    let texts = |values: Vec<String>, list: &mut Vec<String>| {
        if !values.is_empty() {
            *list = values;
        }
    };
    if !options.models.is_empty() {
        // Models that are typed are all that is meant.
        spec.models.clone_from(&options.models);
        spec.cases.clear();
    }
    texts(options.scene.clone(), &mut spec.scenes);
    texts(options.sizes.clone(), &mut spec.sizes);
    texts(options.methods.iter().map(ToString::to_string).collect(), &mut spec.methods);
    texts(options.propagation.iter().map(ToString::to_string).collect(), &mut spec.propagation);
    texts(options.prune.iter().map(ToString::to_string).collect(), &mut spec.prune);
    texts(options.iterations.iter().map(ToString::to_string).collect(), &mut spec.iterations);
    spec.preset = options.preset.or(spec.preset);
    spec.steps = options.steps.map(|n| n as usize).or(spec.steps);
    spec.start = options.start.map(|start| start.to_string()).or(spec.start);
    spec.refine = options.refine.map(|n| n as usize).or(spec.refine);
    spec.repeats = options.repeats.map(|n| n as usize).or(spec.repeats);
    spec.camera = options.camera.map(|view| view.to_string()).or(spec.camera);
    spec.pictures = options.no_pictures.then_some(false).or(spec.pictures);
    spec.equal_time = options.equal_time.then_some(true).or(spec.equal_time);
    spec.reference = options.no_reference.then_some(false).or(spec.reference);
    Ok(spec)
}

/// Files that a sweep reads, with what they are.
fn inputs<'a>(spec: &'a SweepSpec, plan: Option<&'a Path>) -> impl Iterator<Item = (&'a Path, &'static str)> {
    let cases = spec.cases.iter().flat_map(|case| std::iter::once(&case.model).chain(&case.scenes));
    let named = spec.models.iter().chain(&spec.scenes).chain(cases).map(Path::new);
    let plan = plan.map(|plan| (plan, "the plan itself"));
    named.map(|input| (input, "a model or a scene of the sweep")).chain(plan)
}

/// Tells each row as it is done, and how long the others will take.
pub(crate) struct Teller<'a> {
    console: &'a Console,
    begun: Instant,
    /// Rows made in this run, and found from an earlier one.
    made: usize,
    found: usize,
}

impl<'a> Teller<'a> {
    pub(crate) fn new(console: &'a Console) -> Self {
        Self { console, begun: Instant::now(), made: 0, found: 0 }
    }

    pub(crate) fn tell(&mut self, done: RowDone<'_>) {
        let row = done.row;
        if done.found {
            self.found += 1;
            return;
        }
        self.made += 1;
        let figures = match &row.failure {
            Some(failure) => failure.reason.clone(),
            None => format!("RMS {:.2} %, edit {}", 1e2 * row.rms_relative, milliseconds(row.edit_ms())),
        };
        let each = self.begun.elapsed().as_secs_f64() / self.made as f64;
        let left = Duration::from_secs_f64(each * (done.total - done.done) as f64);
        let left = if done.done < done.total { format!("; {} left", duration(left)) } else { String::new() };
        let width = done.total.to_string().len();
        // A closed pipe is noticed when the result is printed.
        let _ = self.console.say(&format!("[{:>width$}/{}] {}: {figures}{left}", done.done, done.total, row.key()));
    }
}

fn milliseconds(ms: f64) -> String {
    if ms.is_finite() { duration(Duration::from_secs_f64(ms.max(0.0) / 1e3)) } else { "-".to_owned() }
}

/// Writes the files that were asked for, and prints.
fn publish(mut report: SweepReport, output: &OutputOptions, console: &Console) -> Result<Ending> {
    report.knees = output.knee.iter().flat_map(|&target| report.find_knees(target)).collect();
    let written = match &output.output {
        Some(prefix) => write_reports(prefix, &output.formats, &report)?,
        None => Vec::new(),
    };
    if output.json {
        use std::io::Write;
        writeln!(std::io::stdout().lock(), "{}", report.to_json())?;
        return Ok(Ending::of_report(&report));
    }
    console.say("")?;
    console.say(&report.to_markdown(Detail::Main))?;
    for path in written {
        console.say(&format!("wrote {}", path.display()))?;
    }
    Ok(Ending::of_report(&report))
}

/// Refuses what cannot be written, before anything is computed.
fn check_outputs<'a, I>(output: &OutputOptions, inputs: impl Fn() -> I) -> Result<()>
where
    I: Iterator<Item = (&'a Path, &'static str)>,
{
    let Some(prefix) = &output.output else { return Ok(()) };
    for format in &output.formats {
        if !format.is_built() {
            return Err(FormatError::NotBuilt { format: *format }.into());
        }
    }
    make_folder_of(prefix)?;
    for format in &output.formats {
        let path = with_extension(prefix, format.extension());
        let kind = format.extension().rsplit('.').next().unwrap_or_default();
        can_write(&path, &[kind])?;
        check_not_read(&path, inputs())?;
    }
    Ok(())
}

/// Makes the folder that files with this prefix lie in.
pub(crate) fn make_folder_of(prefix: &Path) -> Result<()> {
    match prefix.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => {
            std::fs::create_dir_all(folder).with_context(|| format!("{}: the folder cannot be made", folder.display()))
        }
        _ => Ok(()),
    }
}

/// A prefix with each extension.
pub(crate) fn with_extensions<const N: usize>(
    prefix: &Path,
    extensions: [&'static str; N],
) -> [(PathBuf, &'static str); N] {
    extensions.map(|extension| (with_extension(prefix, extension), extension))
}

/// A prefix with an extension: appended, so that a dot in the prefix is kept.
fn with_extension(prefix: &Path, extension: &str) -> PathBuf {
    let mut name = prefix.as_os_str().to_owned();
    name.push(".");
    name.push(extension);
    name.into()
}

/// Writes a report in some forms.
pub(crate) fn write_reports(prefix: &Path, formats: &[ReportFormat], report: &SweepReport) -> Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    for format in formats {
        let path = with_extension(prefix, format.extension());
        write_atomic(&path, &report.to_bytes(*format)?)?;
        written.push(path);
    }
    Ok(written)
}
