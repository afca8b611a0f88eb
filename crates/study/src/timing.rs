//! How long each stage takes on a shape, on this machine.

mod drags;

use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use pliant_cage::{BindOptions, CageSize, Propagation, Propagator, Prune};
use pliant_deform::Method;
use pliant_mesh::Progress;
use serde::{Deserialize, Serialize};

use crate::StudyError;
use crate::machine::{cpu_name, peak_memory_bytes};
use crate::pipeline::{Study, count, median, percentile};
use crate::settings::SweepSize;
use crate::stages::{Stages, milliseconds, timed};
use drags::{Drag, prepare, time_direct, time_normals};

/// What is timed.
#[derive(Debug, Clone, PartialEq)]
pub struct TimingPlan {
    /// The cage.
    pub cage: SweepSize,
    /// How the shape is bound to it.
    pub bind: BindOptions,
    /// What solves on it; each solve does `iterations`.
    pub method: Method,
    /// Iterations a drag, after the initial guess.
    pub iterations: u32,
    /// Times that simplify, bind, prepare and refactor are done, at least 1.
    pub repeats: usize,
    /// Drags, at least 1.
    pub drags: usize,
    /// Nothing is repeated once its repeats have taken this long.
    pub patience: Duration,
    /// Also bind with the 3 % rule, the fast way and by looking at every cage face for every shape vertex.
    pub exact: bool,
    /// Also drag without a cage: the same solver on the shape itself.
    pub direct: bool,
}

/// Default options on a cage of 5 %, two iterations a drag, 5 repeats and 2000 drags of three seconds each at most.
impl Default for TimingPlan {
    fn default() -> Self {
        Self {
            cage: SweepSize::Cage(CageSize::Fraction(0.05)),
            bind: BindOptions::default(),
            method: Method::default(),
            iterations: 2,
            repeats: 5,
            drags: 2000,
            patience: Duration::from_secs(3),
            exact: false,
            direct: false,
        }
    }
}

impl TimingPlan {
    /// Median of a first time and of those of more repeats, as far as patience goes.
    fn median<E>(&self, repeats: usize, first: f64, mut again: impl FnMut() -> Result<f64, E>) -> Result<f64, E> {
        let start = Instant::now();
        let mut times = vec![first];
        while times.len() < repeats && start.elapsed() < self.patience {
            times.push(again()?);
        }
        Ok(median(&times))
    }
}

/// Times of one run, medians over repeats unless the name says otherwise; milliseconds and bytes.
///
/// A drag is what an editor does a frame: a solve on the cage from the pose of the last one, and propagation by frames to f32
/// positions in a buffer that is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// The shape.
    pub model: String,
    /// Its vertices.
    pub vertices: usize,
    /// Vertices of the cage.
    pub cage_vertices: usize,
    /// Name of the scene.
    pub scene: String,
    /// How the shape is bound.
    pub prune: String,
    /// Weights a row, mean.
    pub kept_mean: f64,
    /// The solver.
    pub method: String,
    /// Iterations a drag; `null` for a method that does not iterate.
    pub iterations: Option<u32>,
    /// Threads that worked.
    pub threads: usize,
    /// What the processor calls itself; `null` where the system does not tell.
    pub cpu: Option<String>,
    /// Times that the stages before a drag were done, or fewer where patience ended.
    pub repeats: usize,
    /// Drags timed.
    pub drags: usize,
    /// To read the shape, or to make it. Once.
    pub read_ms: f64,
    /// To make the cage.
    pub simplify_ms: f64,
    /// To bind the shape to it.
    pub bind_ms: f64,
    /// To bind exactly by the 3 % rule, every cage face for every shape vertex; once, and only if asked for.
    pub bind_exact_ms: Option<f64>,
    /// To bind by the 3 % rule the fast way, beside the exact one.
    pub bind_magnitude_ms: Option<f64>,
    /// To assemble and factor the solver's matrix.
    pub prepare_ms: f64,
    /// To do it again after a change of handles.
    pub refactor_ms: f64,
    /// From opening the file to the end of the first drag: read, weld, simplify, bind, prepare, drag. Once.
    pub first_drag_ms: f64,
    /// A whole drag.
    pub drag_ms_median: f64,
    /// 99 % of the drags take no longer; the longest of fewer than 100.
    pub drag_ms_p99: f64,
    /// Of a drag, the local steps: best rotations.
    pub local_ms: f64,
    /// Of a drag, the global steps: right-hand sides and triangular solves.
    pub solve_ms: f64,
    /// Of a drag, propagation.
    pub propagate_ms: f64,
    /// Normals of the shape, which a drag does not include.
    pub normals_ms: f64,
    /// Bytes that propagation reads and writes.
    pub propagate_bytes: usize,
    /// A plain copy, by as many threads, that reads half as many bytes and writes half as many; right after a solve, as propagation is.
    pub copy_ms: f64,
    /// Most memory that the process held up to the end of the drags, as the comparisons after them are no part of an edit; `null`
    /// where the system does not tell.
    pub peak_rss_bytes: Option<u64>,
    /// To prepare the solver without a cage; once, and only if asked for.
    pub direct_prepare_ms: Option<f64>,
    /// A drag without a cage, if asked for.
    pub direct_drag_ms: Option<f64>,
}

impl Timing {
    /// Billions of bytes a second, where those of a propagation take `time` milliseconds.
    pub fn gigabytes_a_second(&self, time: f64) -> f64 {
        self.propagate_bytes as f64 / (1e6 * time.max(1e-9))
    }

    /// These figures in words with units, one line for each stage.
    pub fn lines(&self) -> Vec<String> {
        let ms = |what: &str, time: f64, note: &str| format!("{what:<28} {time:>10.3} ms   {note}");
        let rate = |time: f64| self.gigabytes_a_second(time);
        let solve = self.iterations.map_or_else(|| "a solve".to_owned(), |n| format!("{n} iterations"));
        let mut lines = vec![
            ms("read or make", self.read_ms, "once"),
            ms("simplify", self.simplify_ms, ""),
            ms("bind", self.bind_ms, &format!("{}, {:.1} weights a row", self.prune, self.kept_mean)),
        ];
        if let (Some(fast), Some(exact)) = (self.bind_magnitude_ms, self.bind_exact_ms) {
            lines.push(ms("bind by the 3 % rule", fast, ""));
            let note = format!("every face for every vertex, once: {:.1} times as long", exact / fast);
            lines.push(ms("bind exactly by it", exact, &note));
        }
        lines.extend([
            ms("prepare", self.prepare_ms, "once per region of interest"),
            ms("refactor", self.refactor_ms, "after a change of handles"),
            ms("open to first drag", self.first_drag_ms, "read, simplify, bind, prepare, drag: the first of each"),
            ms(
                "drag, median",
                self.drag_ms_median,
                &format!("{solve} and propagation: {:.0} a second", 1e3 / self.drag_ms_median),
            ),
            ms("drag, 99 % within", self.drag_ms_p99, &format!("of {} drags", self.drags)),
            ms("  local steps", self.local_ms, ""),
            ms("  global steps", self.solve_ms, ""),
            ms("  propagation (frames)", self.propagate_ms, &format!("{:.1} GB/s", rate(self.propagate_ms))),
            ms(
                "plain copy of the bytes",
                self.copy_ms,
                &format!(
                    "after a solve: {:.1} GB/s; propagation reaches {:.0} % of it",
                    rate(self.copy_ms),
                    1e2 * self.copy_ms / self.propagate_ms
                ),
            ),
            ms("normals", self.normals_ms, "on request, not part of a drag"),
        ]);
        if let (Some(prepare), Some(drag)) = (self.direct_prepare_ms, self.direct_drag_ms) {
            lines.push(ms("prepare without a cage", prepare, "once"));
            let note = format!("{:.1} times as long as with one", drag / self.drag_ms_median);
            lines.push(ms("drag without a cage", drag, &note));
        }
        if let Some(bytes) = self.peak_rss_bytes {
            lines.push(format!("{:<28} {:>10.1} MB", "peak memory", bytes as f64 / 1e6));
        }
        lines
    }
}

/// Times every stage of an edit; `study` has the shape and its scene, `read_ms` is passed on.
///
/// First the way from the shape to its first drag, as a user takes it; then drags; then repeats of what came before them, and
/// comparisons. Only the first cage, binding and solver are kept, so repeats add nothing to the memory of an edit.
///
/// # Errors
/// As the stages themselves; [`StudyError::BadSize`] without a cage.
pub fn time_stages(
    study: &Study<'_>,
    plan: &TimingPlan,
    read_ms: f64,
    stages: &dyn Stages,
) -> Result<Timing, StudyError> {
    if !matches!(plan.cage, SweepSize::Cage(_)) {
        return Err(StudyError::BadSize { found: plan.cage.to_string() });
    }
    let start = Instant::now();
    let caged = study.cage(plan.cage, stages)?;
    let bound = study.bind(&caged, plan.bind, stages)?;
    let describe = |_: &_| format!("{} vertices", count(caged.mesh.vertex_count()));
    let (mut drag, prepare_ms) = timed(stages, "prepare", |_| Drag::new(study, plan, &caged), describe)?;
    let mut propagator = Propagator::new(Propagation::Frames).with_fit(study.frame_fit());
    let mut shape = vec![Vec3::ZERO; study.shape.vertex_count()];
    let mut carry = |pose: &[DVec3]| propagator.apply_f32(&bound.binding, pose, black_box(&mut shape), None);
    drag.first(&mut carry)?;
    let first_drag_ms = read_ms + milliseconds(start.elapsed());

    let work = |_: &dyn Progress| drag.repeat(plan, &mut carry);
    let (times, _) = timed(stages, "drag", work, |times| format!("{} drags", times.whole.len()))?;
    let normals_ms = time_normals(study, &shape, plan)?;
    let peak_rss_bytes = peak_memory_bytes();

    let propagate_bytes = bound.binding.propagated_bytes();
    let copy_ms = drag.time_copy(propagate_bytes, plan)?;
    let refactor_ms = drag.time_refactor(plan)?;
    let simplify_again = || study.cage(plan.cage, stages).map(|made| median(&made.simplify_ms));
    let bind_again = |options: BindOptions| study.bind(&caged, options, stages).map(|made| median(&made.bind_ms));
    let prepare_again = || {
        let start = Instant::now();
        prepare(study, plan, &caged)?;
        Ok::<_, StudyError>(milliseconds(start.elapsed()))
    };
    let rule = BindOptions::from(Prune::PAPER);
    let direct = match plan.direct {
        true => Some(time_direct(study, plan, &study.cage(SweepSize::None, stages)?)?),
        false => None,
    };
    Ok(Timing {
        model: study.model.clone(),
        vertices: study.shape.vertex_count(),
        cage_vertices: caged.mesh.vertex_count(),
        scene: study.scene.name.clone(),
        prune: plan.bind.to_string(),
        kept_mean: bound.binding.report().kept_mean,
        method: plan.method.with_default_iterations().to_string(),
        iterations: plan.method.iterates().then_some(plan.iterations),
        threads: rayon::current_num_threads(),
        cpu: cpu_name(),
        repeats: plan.repeats.max(1),
        drags: times.whole.len(),
        read_ms,
        simplify_ms: plan.median(plan.repeats, median(&caged.simplify_ms), simplify_again)?,
        bind_ms: plan.median(plan.repeats, median(&bound.bind_ms), || bind_again(plan.bind))?,
        bind_exact_ms: plan.exact.then(|| bind_again(BindOptions { exact: true, ..rule })).transpose()?,
        bind_magnitude_ms: plan
            .exact
            .then(|| plan.median(plan.repeats, bind_again(rule)?, || bind_again(rule)))
            .transpose()?,
        prepare_ms: plan.median(plan.repeats, prepare_ms, prepare_again)?,
        refactor_ms,
        first_drag_ms,
        drag_ms_p99: percentile(&times.whole, 99).unwrap_or(0.0),
        drag_ms_median: median(&times.whole),
        local_ms: median(&times.local),
        solve_ms: median(&times.global),
        propagate_ms: median(&times.carry),
        normals_ms,
        propagate_bytes,
        copy_ms,
        peak_rss_bytes,
        direct_prepare_ms: direct.map(|(prepare, _)| prepare),
        direct_drag_ms: direct.map(|(_, drag)| drag),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ranks of 1, 2, .. n in any order are the numbers themselves.
    #[test]
    fn of_100_times_99_do_not_exceed_the_percentile() {
        for (n, expected) in [(1_u32, 1.0), (2, 2.0), (99, 99.0), (100, 99.0), (101, 100.0), (300, 297.0)] {
            let times: Vec<f64> = (1..=n).rev().map(f64::from).collect();
            assert_eq!(percentile(&times, 99), Some(expected), "{n}");
        }
    }

    #[test]
    fn repeats_end_with_their_number_and_with_patience() {
        let (long, none) = (Duration::from_secs(3600), Duration::ZERO);
        for (repeats, patience, done) in [(7, long, 7), (1, long, 1), (0, long, 1), (7, none, 1)] {
            let mut calls = 1;
            let plan = TimingPlan { patience, ..TimingPlan::default() };
            let again = || {
                calls += 1;
                Ok::<_, StudyError>(f64::from(calls))
            };
            // Times are 1, 2, .. with the lower of two middle ones.
            assert_eq!(plan.median(repeats, 1.0, again).expect("no error"), f64::from((done + 1) / 2));
            assert_eq!(calls, done);
        }
    }
}
