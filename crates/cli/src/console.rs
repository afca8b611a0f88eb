//! Stages on the terminal: a line with time and size for each, a progress bar for those over a second.

use std::io::{IsTerminal, Write};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pliant::{Progress, Stages};
use serde::Serialize;

/// A stage that has ended.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct StageTime {
    pub(crate) stage: String,
    pub(crate) milliseconds: f64,
    pub(crate) result: String,
}

/// Prints stages as they end, and remembers them.
pub(crate) struct Console {
    /// Whether lines are printed; they are not beside `--json`.
    lines: bool,
    /// Whether those of stages are.
    stage_lines: bool,
    running: Arc<Mutex<Running>>,
    ended: Mutex<Vec<StageTime>>,
}

/// The stage at hand.
struct Running {
    stage: Option<(Instant, String)>,
    bar: ProgressBar,
}

/// Stages that end sooner show no bar.
const BAR_AFTER: Duration = Duration::from_secs(1);

/// What a stage shows that does not know how far it is, and one that does.
const SPINNER: &str = "  {msg:<24} {spinner} {elapsed}";
const BAR: &str = "  {msg:<24} [{bar:30}] {percent:>3} %  {eta} left";

impl Console {
    pub(crate) fn new(json: bool) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        let running = Arc::new(Mutex::new(Running { stage: None, bar }));
        // Bars go to standard error, and only if it is a terminal.
        if std::io::stderr().is_terminal() {
            let watched = Arc::downgrade(&running);
            std::thread::spawn(move || watch(&watched));
        }
        Self { lines: !json, stage_lines: !json, running, ended: Mutex::new(Vec::new()) }
    }

    /// Without lines for stages.
    pub(crate) fn quiet(json: bool) -> Self {
        Self { stage_lines: false, ..Self::new(json) }
    }

    /// Prints a line, unless JSON was asked for.
    pub(crate) fn say(&self, line: &str) -> std::io::Result<()> {
        if self.lines { writeln!(std::io::stdout().lock(), "{}", visible(line)) } else { Ok(()) }
    }

    /// Prints a warning to standard error.
    pub(crate) fn warn(&self, warning: &str) {
        complain(&format!("warning: {warning}"));
    }

    /// The stages so far.
    pub(crate) fn stages(&self) -> Vec<StageTime> {
        self.ended.lock().map(|ended| ended.clone()).unwrap_or_default()
    }
}

/// Shows the stage at hand once it has lasted, until the console is gone.
fn watch(running: &Weak<Mutex<Running>>) {
    while let Some(running) = running.upgrade() {
        if let Ok(running) = running.lock()
            && let Some((start, stage)) = &running.stage
            && start.elapsed() >= BAR_AFTER
        {
            if running.bar.is_hidden() {
                running.bar.set_draw_target(ProgressDrawTarget::stderr());
                running.bar.set_message(stage.clone());
            }
            running.bar.tick();
        }
        drop(running);
        std::thread::sleep(BAR_AFTER / 5);
    }
}

impl Progress for Console {
    fn advance(&self, done: usize, total: usize) {
        let Ok(running) = self.running.lock() else { return };
        if running.bar.length() != Some(total as u64) {
            set_style(&running.bar, BAR);
            running.bar.set_length(total as u64);
        }
        // Reports of several threads may arrive out of order: never go back.
        running.bar.set_position(running.bar.position().max(done as u64));
    }
}

fn set_style(bar: &ProgressBar, template: &str) {
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
}

impl Stages for Console {
    fn begin(&self, stage: &str) {
        let Ok(mut running) = self.running.lock() else { return };
        running.bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        set_style(&running.bar, SPINNER);
        running.stage = Some((Instant::now(), stage.to_owned()));
    }

    fn end(&self, stage: &str, time: Duration, result: &str) {
        if let Ok(mut running) = self.running.lock() {
            running.stage = None;
            running.bar.finish_and_clear();
        }
        if self.stage_lines {
            // A closed pipe is noticed when the result is printed.
            let line = visible(&format!("  {stage:<24} {:>10}   {result}", duration(time)));
            let _ = writeln!(std::io::stdout().lock(), "{line}");
        }
        if let Ok(mut ended) = self.ended.lock() {
            ended.push(StageTime {
                stage: stage.to_owned(),
                milliseconds: 1e3 * time.as_secs_f64(),
                result: result.to_owned(),
            });
        }
    }

    fn progress(&self) -> &dyn Progress {
        self
    }
}

/// A time with a unit that suits it.
pub(crate) fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 1e-3 {
        format!("{:.1} us", 1e6 * seconds)
    } else if seconds < 1.0 {
        format!("{:.1} ms", 1e3 * seconds)
    } else if seconds < 100.0 {
        format!("{seconds:.2} s")
    } else if seconds < 6000.0 {
        format!("{:.1} min", seconds / 60.0)
    } else {
        format!("{:.1} h", seconds / 3600.0)
    }
}

/// Writes a line to standard error.
pub(crate) fn complain(line: &str) {
    // Nobody to tell when standard error is gone.
    let _ = writeln!(std::io::stderr().lock(), "{}", visible(line));
}

/// Text without control characters: names come from files, and could tell a terminal to do anything.
fn visible(text: &str) -> String {
    text.chars().map(|c| if c.is_control() && c != '\n' { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

/// Prints a value as JSON to standard output.
pub(crate) fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    writeln!(std::io::stdout().lock(), "{}", serde_json::to_string_pretty(value)?)?;
    Ok(())
}
