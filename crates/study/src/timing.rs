//! How long each stage takes on a shape, on this machine.

use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use pliant_cage::{BindOptions, Propagation, Propagator, Prune};
use pliant_deform::{Constraint, Deformer, Goals, Handle, Method, Region, Role};
use pliant_mesh::VertexSet;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::StudyError;
use crate::pipeline::{Bound, Caged, Study, SweepSize, median};
use crate::stages::{Stages, milliseconds};

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
    /// Times that simplify, bind, prepare and refactor are repeated, at least 1.
    pub repeats: usize,
    /// Also bind with the 3 % rule by looking at every cage face for every shape vertex.
    pub exact: bool,
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
    /// Iterations a drag.
    pub iterations: u32,
    /// Threads that worked.
    pub threads: usize,
    /// Times that the stages before a drag were repeated.
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
    /// To assemble and factor the solver's matrix.
    pub prepare_ms: f64,
    /// To do it again after a change of handles.
    pub refactor_ms: f64,
    /// A whole drag.
    pub drag_ms_median: f64,
    /// 99 % of the drags take no longer.
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
    /// A plain copy, by as many threads, that reads half as many bytes and writes half as many.
    pub copy_ms: f64,
    /// Most memory that the process held so far; `null` where the system does not tell.
    pub peak_rss_bytes: Option<u64>,
}

impl Timing {
    /// What to do to see these figures, stage by stage, in words with units: one line each.
    pub fn lines(&self) -> Vec<String> {
        let ms = |what: &str, time: f64, note: &str| format!("{what:<28} {time:>10.3} ms   {note}");
        let rate = |time: f64| self.propagate_bytes as f64 / (1e6 * time.max(1e-9));
        let mut lines = vec![
            ms("read or make", self.read_ms, "once"),
            ms("simplify", self.simplify_ms, ""),
            ms("bind", self.bind_ms, &format!("{}, {:.1} weights a row", self.prune, self.kept_mean)),
        ];
        if let Some(exact) = self.bind_exact_ms {
            lines.push(ms("bind exactly (3 % rule)", exact, "every face for every vertex, once"));
        }
        lines.extend([
            ms("prepare", self.prepare_ms, "once per region of interest"),
            ms("refactor", self.refactor_ms, "after a change of handles"),
            ms(
                "drag, median",
                self.drag_ms_median,
                &format!("{} iterations and propagation: {:.0} a second", self.iterations, 1e3 / self.drag_ms_median),
            ),
            ms("drag, 99 % within", self.drag_ms_p99, &format!("of {} drags", self.drags)),
            ms("  local steps", self.local_ms, ""),
            ms("  global steps", self.solve_ms, ""),
            ms("  propagation (frames)", self.propagate_ms, &format!("{:.1} GB/s", rate(self.propagate_ms))),
            ms(
                "plain copy of the bytes",
                self.copy_ms,
                &format!(
                    "{:.1} GB/s; propagation reaches {:.0} % of it",
                    rate(self.copy_ms),
                    1e2 * self.copy_ms / self.propagate_ms
                ),
            ),
            ms("normals", self.normals_ms, "on request, not part of a drag"),
        ]);
        if let Some(bytes) = self.peak_rss_bytes {
            lines.push(format!("{:<28} {:>10.1} MB", "peak memory", bytes as f64 / 1e6));
        }
        lines
    }
}

/// Drags timed at most and at least, and for how long in between.
const DRAGS: (usize, usize, Duration) = (200, 2000, Duration::from_secs(3));

/// Steps from rest to the goals; the drags timed go back and forth in the middle of them.
const STEPS: usize = 40;

/// Drags before those that are timed.
const WARM_UP: usize = 5;

/// Copies and normals timed.
const SHORT_REPEATS: usize = 25;

/// Times every stage of an edit; `study` has the shape and its scene, `read_ms` is passed on.
///
/// # Errors
/// As the stages themselves; [`StudyError::BadSize`] without a cage.
pub fn time_stages(
    study: &Study<'_>,
    plan: &TimingPlan,
    read_ms: f64,
    stages: &dyn Stages,
) -> Result<Timing, StudyError> {
    if plan.cage == SweepSize::None {
        return Err(StudyError::BadSize { found: plan.cage.to_string() });
    }
    let repeats = plan.repeats.max(1);
    let (caged, simplify_ms) = repeated(repeats, || study.cage(plan.cage, stages), |caged, _| caged.simplify_ms)?;
    let (bound, bind_ms) = repeated(repeats, || study.bind(&caged, plan.bind, stages), |bound, _| bound.bind_ms)?;
    let bind_exact_ms = match plan.exact {
        true => Some(study.bind(&caged, EXACT, stages)?.bind_ms),
        false => None,
    };
    let drag = Drags::run(study, plan, &caged, &bound, stages)?;
    let report = bound.binding.report();
    Ok(Timing {
        model: study.model.clone(),
        vertices: study.shape.vertex_count(),
        cage_vertices: caged.mesh.vertex_count(),
        scene: study.scene.name.clone(),
        prune: plan.bind.to_string(),
        kept_mean: report.kept_mean,
        iterations: plan.iterations,
        threads: rayon::current_num_threads(),
        repeats,
        drags: drag.whole.len(),
        read_ms,
        simplify_ms,
        bind_ms,
        bind_exact_ms,
        prepare_ms: drag.prepare_ms,
        refactor_ms: drag.refactor_ms,
        drag_ms_p99: high_percentile(&drag.whole),
        drag_ms_median: median(drag.whole),
        local_ms: median(drag.local),
        solve_ms: median(drag.global),
        propagate_ms: median(drag.propagate),
        normals_ms: drag.normals_ms,
        propagate_bytes: bound.binding.propagated_bytes(),
        copy_ms: time_copy(bound.binding.propagated_bytes()),
        peak_rss_bytes: peak_rss_bytes(),
    })
}

/// The exact way of the paper's rule.
const EXACT: BindOptions =
    BindOptions { prune: Prune::PAPER, support: pliant_cage::Support::Surface, smoothing: 0, exact: true };

/// Times of drags.
struct Drags {
    prepare_ms: f64,
    refactor_ms: f64,
    normals_ms: f64,
    whole: Vec<f64>,
    local: Vec<f64>,
    global: Vec<f64>,
    propagate: Vec<f64>,
}

impl Drags {
    fn run(
        study: &Study<'_>,
        plan: &TimingPlan,
        caged: &Caged,
        bound: &Bound,
        stages: &dyn Stages,
    ) -> Result<Self, StudyError> {
        let named = |e| StudyError::deform(e, study.scene.handles.iter().map(|h| h.name.as_str()));
        let method = plan.method.with_iterations(plan.iterations);
        stages.begin("drag");
        let begun = Instant::now();
        let prepare = || method.prepare(&caged.mesh, &caged.region).map_err(named);
        let (mut deformer, prepare_ms) = repeated(plan.repeats, prepare, |_, time| time)?;
        let refactor = refactor(&mut *deformer, caged, plan.repeats.max(1)).map_err(named)?;
        let mut propagator = Propagator::new(Propagation::Frames).with_fit(study.frame_fit());
        let goals = |step: usize| study.scene.goals_with_turns(step as f64 / STEPS as f64);
        let mut pose = caged.mesh.positions.clone();
        for step in 1..STEPS / 2 {
            deformer.solve(&goals(step), &mut pose).map_err(named)?;
        }
        let ends = [goals(STEPS / 2), goals(STEPS / 2 + 1)];
        let mut shape = vec![Vec3::ZERO; study.shape.vertex_count()];
        let mut made = Self {
            prepare_ms,
            refactor_ms: median(refactor),
            normals_ms: 0.0,
            whole: Vec::with_capacity(DRAGS.1),
            local: Vec::with_capacity(DRAGS.1),
            global: Vec::with_capacity(DRAGS.1),
            propagate: Vec::with_capacity(DRAGS.1),
        };
        let mut drag = |made: &mut Self, goals: &Goals, shape: &mut [Vec3], propagator: &mut Propagator| {
            let start = Instant::now();
            deformer.solve(goals, &mut pose)?;
            let solved = Instant::now();
            propagator.apply_f32(&bound.binding, &pose, black_box(shape), None);
            made.propagate.push(milliseconds(solved.elapsed()));
            made.whole.push(milliseconds(start.elapsed()));
            let times = deformer.step_times();
            made.local.push(milliseconds(times.local));
            made.global.push(milliseconds(times.global));
            Ok(())
        };
        for warm in 0..WARM_UP {
            drag(&mut made, &ends[warm % 2], &mut shape, &mut propagator).map_err(named)?;
        }
        for times in [&mut made.whole, &mut made.local, &mut made.global, &mut made.propagate] {
            times.clear();
        }
        let start = Instant::now();
        while made.whole.len() < DRAGS.0 || (made.whole.len() < DRAGS.1 && start.elapsed() < DRAGS.2) {
            let end = &ends[(made.whole.len() + WARM_UP) % 2];
            drag(&mut made, end, &mut shape, &mut propagator).map_err(named)?;
        }
        let mut buffer = pliant_mesh::NormalBuffer::default();
        let mut normals = vec![Vec3::ZERO; shape.len()];
        let mut once = || {
            let start = Instant::now();
            buffer.compute(study.shape.topology(), &shape, black_box(&mut normals));
            milliseconds(start.elapsed())
        };
        once();
        made.normals_ms = median((0..SHORT_REPEATS).map(|_| once()).collect());
        stages.end("drag", begun.elapsed(), &format!("{} drags", made.whole.len()));
        Ok(made)
    }
}

/// Makes something `repeats` times, at least once: the last one, and the median of the times that `time` makes of each and of the
/// milliseconds it took.
fn repeated<T, E>(
    repeats: usize,
    make: impl Fn() -> Result<T, E>,
    time: impl Fn(&T, f64) -> f64,
) -> Result<(T, f64), E> {
    let timed = || {
        let start = Instant::now();
        let made = make()?;
        let own = time(&made, milliseconds(start.elapsed()));
        Ok((made, own))
    };
    let (mut made, first) = timed()?;
    let mut times = vec![first];
    for _ in 1..repeats {
        let (again, time) = timed()?;
        made = again;
        times.push(time);
    }
    Ok((made, median(times)))
}

/// Takes one vertex out of the first handle that has two and puts it back, again and again; or makes its handle soft and hard.
fn refactor(
    deformer: &mut dyn Deformer,
    caged: &Caged,
    repeats: usize,
) -> Result<Vec<f64>, pliant_deform::DeformError> {
    let region = &caged.region;
    let roi = VertexSet::where_true(region.vertex_count(), |v| region.roles()[v as usize] != Role::Fixed);
    let mut handles: Vec<Handle> = region.handles().to_vec();
    match handles.iter().position(|h| h.vertices.len() > 1) {
        Some(at) => handles[at].vertices = handles[at].vertices.iter().skip(1).collect(),
        None => {
            for handle in handles.iter_mut().take(1) {
                handle.constraint = Constraint::Soft(1.0);
            }
        }
    }
    let changed = Region::new(region.vertex_count(), &roi, &handles)?;
    let (changed, _) = changed.without_unconstrained(caged.mesh.topology());
    let mut times = Vec::with_capacity(2 * repeats);
    for _ in 0..repeats {
        for region in [&changed, region] {
            let start = Instant::now();
            deformer.set_region(region)?;
            times.push(milliseconds(start.elapsed()));
        }
    }
    Ok(times)
}

/// Moves `bytes` in all, half read and half written, by all threads.
fn time_copy(bytes: usize) -> f64 {
    const CHUNK: usize = 1 << 15;
    let from = vec![DVec3::ONE; (bytes / 2 / size_of::<DVec3>()).max(1)];
    let mut to = vec![DVec3::ZERO; from.len()];
    let mut once = || {
        let start = Instant::now();
        to.par_chunks_mut(CHUNK)
            .zip(black_box(&from).par_chunks(CHUNK))
            .for_each(|(to, from)| to.copy_from_slice(from));
        black_box(&mut to);
        milliseconds(start.elapsed())
    };
    once();
    median((0..SHORT_REPEATS).map(|_| once()).collect())
}

/// The smallest time that 99 % of them do not exceed.
fn high_percentile(times: &[f64]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = (99 * sorted.len()).div_ceil(100).saturating_sub(1);
    sorted.get(at).copied().unwrap_or(0.0)
}

/// High-water mark of the resident set, which Linux keeps.
fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}
