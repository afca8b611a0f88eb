use std::time::{Duration, Instant};

use pliant_mesh::{Progress, Silent};

/// Told which stage of a longer piece of work begins and ends; what a command line prints from.
pub trait Stages: Progress {
    /// A stage begins; [`Progress::advance`] may follow.
    fn begin(&self, stage: &str);

    /// The stage ended after `time`; `result` says in a few words with units what came of it.
    fn end(&self, stage: &str, time: Duration, result: &str);

    /// This trait object as a reporter of progress.
    fn progress(&self) -> &dyn Progress;
}

impl Stages for Silent {
    fn begin(&self, _stage: &str) {}

    fn end(&self, _stage: &str, _time: Duration, _result: &str) {}

    fn progress(&self) -> &dyn Progress {
        self
    }
}

/// Runs `work` as a stage and returns what it made with its time in milliseconds. A stage that fails is not reported as ended.
///
/// # Errors
/// Whatever `work` returns.
pub fn timed<T, E>(
    stages: &dyn Stages,
    stage: &str,
    work: impl FnOnce(&dyn Progress) -> Result<T, E>,
    result: impl FnOnce(&T) -> String,
) -> Result<(T, f64), E> {
    stages.begin(stage);
    let start = Instant::now();
    let made = work(stages.progress())?;
    let time = start.elapsed();
    stages.end(stage, time, &result(&made));
    Ok((made, milliseconds(time)))
}

/// Runs `work` as a stage, then again until it was run `repeats` times, and returns what it made first and how long each took, in
/// milliseconds.
///
/// # Errors
/// Whatever `work` returns.
pub(crate) fn repeated<T, E>(
    repeats: usize,
    stages: &dyn Stages,
    stage: &str,
    work: impl Fn(&dyn Progress) -> Result<T, E>,
    result: impl FnOnce(&T) -> String,
) -> Result<(T, Vec<f64>), E> {
    let (made, first) = timed(stages, stage, &work, result)?;
    let mut times = vec![first];
    for _ in 1..repeats {
        let start = Instant::now();
        work(&Silent)?;
        times.push(milliseconds(start.elapsed()));
    }
    Ok((made, times))
}

/// A duration in milliseconds.
pub(crate) fn milliseconds(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}
