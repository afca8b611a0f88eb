//! Stages on the terminal: a line with time and size for each, a progress bar for those over a second.

use std::io::Write;
use std::sync::Mutex;
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
    bar: ProgressBar,
    /// When the stage at hand began.
    began: Mutex<Option<(Instant, String)>>,
    ended: Mutex<Vec<StageTime>>,
}

/// Stages that end sooner show no bar.
const BAR_AFTER: Duration = Duration::from_secs(1);

impl Console {
    pub(crate) fn new(json: bool) -> Self {
        // Standard error, and only if it is a terminal: indicatif draws nothing elsewhere.
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("  {msg:<24} [{bar:30}] {percent:>3} %  {eta} left");
        if let Ok(style) = style {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { lines: !json, bar, began: Mutex::new(None), ended: Mutex::new(Vec::new()) }
    }

    /// Prints a line, unless JSON was asked for.
    pub(crate) fn say(&self, line: &str) -> std::io::Result<()> {
        if self.lines { writeln!(std::io::stdout().lock(), "{line}") } else { Ok(()) }
    }

    /// Prints a warning to standard error.
    pub(crate) fn warn(&self, warning: &str) {
        // Nobody to tell when standard error is gone.
        let _ = writeln!(std::io::stderr().lock(), "warning: {warning}");
    }

    /// The stages so far.
    pub(crate) fn stages(&self) -> Vec<StageTime> {
        self.ended.lock().map(|ended| ended.clone()).unwrap_or_default()
    }
}

impl Progress for Console {
    fn advance(&self, done: usize, total: usize) {
        let Ok(began) = self.began.lock() else { return };
        let Some((start, stage)) = began.as_ref() else { return };
        if start.elapsed() < BAR_AFTER {
            return;
        }
        if self.bar.is_hidden() {
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
            self.bar.set_message(stage.clone());
        }
        self.bar.set_length(total as u64);
        // Reports of several threads may arrive out of order: never go back.
        self.bar.set_position(self.bar.position().max(done as u64));
    }
}

impl Stages for Console {
    fn begin(&self, stage: &str) {
        if let Ok(mut began) = self.began.lock() {
            *began = Some((Instant::now(), stage.to_owned()));
        }
        self.bar.reset();
    }

    fn end(&self, stage: &str, time: Duration, result: &str) {
        self.bar.finish_and_clear();
        self.bar.set_draw_target(ProgressDrawTarget::hidden());
        if self.lines {
            // A closed pipe is noticed when the result is printed.
            let _ = writeln!(std::io::stdout().lock(), "  {stage:<24} {:>10}   {result}", duration(time));
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
fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 1e-3 {
        format!("{:.1} us", 1e6 * seconds)
    } else if seconds < 1.0 {
        format!("{:.1} ms", 1e3 * seconds)
    } else {
        format!("{seconds:.2} s")
    }
}

/// Prints a value as JSON to standard output.
pub(crate) fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    writeln!(std::io::stdout().lock(), "{}", serde_json::to_string_pretty(value)?)?;
    Ok(())
}
