//! What happens once a frame: drags, and what they are compared with.

use std::hint::black_box;
use std::time::Instant;

use glam::{DVec3, Vec3};
use pliant_deform::{Constraint, Deformer, Goals, Handle, Region, Role};
use pliant_mesh::{NormalBuffer, VertexSet};
use rayon::prelude::*;

use super::TimingPlan;
use crate::StudyError;
use crate::pipeline::{Caged, Study, median};
use crate::settings::StartFrom;
use crate::stages::milliseconds;

/// Steps from rest to the goals; the drags timed go back and forth in the middle of them.
const STEPS: usize = 40;

/// Drags before those that are timed.
const WARM_UP: usize = 5;

/// Copies and normals timed.
const SHORT_REPEATS: usize = 25;

/// The handles of a scene on their way, each solve from the pose of the last.
pub(super) struct Drag<'a> {
    study: &'a Study<'a>,
    caged: &'a Caged,
    deformer: Box<dyn Deformer>,
    middle: [Goals; 2],
    pose: Vec<DVec3>,
}

/// Times of drags and of their parts, in milliseconds.
#[derive(Default)]
pub(super) struct DragTimes {
    pub(super) whole: Vec<f64>,
    pub(super) local: Vec<f64>,
    pub(super) global: Vec<f64>,
    pub(super) carry: Vec<f64>,
}

impl<'a> Drag<'a> {
    /// At rest, with the solver prepared.
    pub(super) fn new(study: &'a Study<'a>, plan: &TimingPlan, caged: &'a Caged) -> Result<Self, StudyError> {
        Ok(Self {
            study,
            caged,
            deformer: prepare(study, plan, caged)?,
            middle: [goals(study, STEPS / 2), goals(study, STEPS / 2 + 1)],
            pose: caged.mesh.positions.clone(),
        })
    }

    /// The first step from rest; `carry` brings the pose to where it is shown.
    pub(super) fn first(&mut self, carry: &mut dyn FnMut(&[DVec3])) -> Result<(), StudyError> {
        let solved = self.deformer.solve(&goals(self.study, 1), &mut self.pose);
        solved.map_err(|e| self.study.named(e))?;
        carry(&self.pose);
        Ok(())
    }

    /// Goes on to the middle, and times drags there.
    pub(super) fn repeat(
        &mut self,
        plan: &TimingPlan,
        carry: &mut dyn FnMut(&[DVec3]),
    ) -> Result<DragTimes, StudyError> {
        for step in 2..STEPS / 2 {
            let solved = self.deformer.solve(&goals(self.study, step), &mut self.pose);
            solved.map_err(|e| self.study.named(e))?;
        }
        for _ in 0..WARM_UP {
            self.solve()?;
            carry(&self.pose);
        }
        let mut times = DragTimes::default();
        let begun = Instant::now();
        while times.whole.is_empty() || (times.whole.len() < plan.drags && begun.elapsed() < plan.patience) {
            let start = Instant::now();
            self.solve()?;
            let solved = Instant::now();
            carry(&self.pose);
            times.carry.push(milliseconds(solved.elapsed()));
            times.whole.push(milliseconds(start.elapsed()));
            let steps = self.deformer.step_times();
            times.local.push(milliseconds(steps.local));
            times.global.push(milliseconds(steps.global));
        }
        Ok(times)
    }

    /// One step in the middle, forth or back.
    fn solve(&mut self) -> Result<(), StudyError> {
        self.middle.swap(0, 1);
        self.deformer.solve(&self.middle[0], &mut self.pose).map_err(|e| self.study.named(e))?;
        Ok(())
    }

    /// Moves `bytes` in all, half read and half written, by all threads. Each copy comes right after a solve, so it finds caches and
    /// sleeping threads as a propagation does: copies one after another would read what the last one left in a cache.
    pub(super) fn time_copy(&mut self, bytes: usize, plan: &TimingPlan) -> Result<f64, StudyError> {
        const CHUNK: usize = 1 << 15;
        let from = vec![DVec3::ONE; (bytes / 2 / size_of::<DVec3>()).max(1)];
        let mut to = vec![DVec3::ZERO; from.len()];
        let mut once = || {
            self.solve()?;
            let start = Instant::now();
            to.par_chunks_mut(CHUNK)
                .zip(black_box(&from).par_chunks(CHUNK))
                .for_each(|(to, from)| to.copy_from_slice(from));
            black_box(&mut to);
            Ok(milliseconds(start.elapsed()))
        };
        once()?;
        plan.median(SHORT_REPEATS, once()?, once)
    }

    /// Takes one vertex out of the first handle that has two and puts it back, again and again; or makes its handle soft and hard.
    pub(super) fn time_refactor(&mut self, plan: &TimingPlan) -> Result<f64, StudyError> {
        let roles = self.caged.region.roles();
        let roi = VertexSet::where_true(roles.len(), |v| roles[v as usize] != Role::Fixed);
        let mut handles: Vec<Handle> = self.caged.region.handles().to_vec();
        match handles.iter().position(|h| h.vertices.len() > 1) {
            Some(at) => handles[at].vertices = handles[at].vertices.iter().skip(1).collect(),
            None => {
                for handle in handles.iter_mut().take(1) {
                    handle.constraint = Constraint::Soft(1.0);
                }
            }
        }
        let changed = Region::new(roles.len(), &roi, &handles).map_err(|e| self.study.named(e))?;
        let (changed, _) = changed.without_unconstrained(self.caged.mesh.topology());
        let mut next = [&changed, &self.caged.region];
        let mut once = || {
            let start = Instant::now();
            self.deformer.set_region(next[0]).map_err(|e| self.study.named(e))?;
            next.swap(0, 1);
            Ok(milliseconds(start.elapsed()))
        };
        plan.median(2 * plan.repeats, once()?, once)
    }
}

/// The solver, prepared for a control mesh and the handles on it.
pub(super) fn prepare(study: &Study<'_>, plan: &TimingPlan, caged: &Caged) -> Result<Box<dyn Deformer>, StudyError> {
    let method = plan.method.with_iterations(plan.iterations);
    caged.prepare(&method, StartFrom::default()).map_err(|e| study.named(e))
}

/// Normals of a pose of the shape.
pub(super) fn time_normals(study: &Study<'_>, shape: &[Vec3], plan: &TimingPlan) -> Result<f64, StudyError> {
    let mut buffer = NormalBuffer::default();
    let mut normals = vec![Vec3::ZERO; shape.len()];
    let mut once = || {
        let start = Instant::now();
        buffer.compute(study.shape.topology(), shape, black_box(&mut normals));
        Ok(milliseconds(start.elapsed()))
    };
    once()?;
    plan.median(SHORT_REPEATS, once()?, once)
}

/// Times without a cage: to prepare, and a drag, which ends by rounding the pose as propagation does.
pub(super) fn time_direct(study: &Study<'_>, plan: &TimingPlan, caged: &Caged) -> Result<(f64, f64), StudyError> {
    let start = Instant::now();
    let mut drag = Drag::new(study, plan, caged)?;
    let prepare_ms = milliseconds(start.elapsed());
    let mut shape = vec![Vec3::ZERO; study.shape.vertex_count()];
    let mut round = |pose: &[DVec3]| {
        shape.par_iter_mut().zip(pose).with_min_len(4096).for_each(|(to, from)| *to = from.as_vec3());
        black_box(&mut shape);
    };
    drag.first(&mut round)?;
    Ok((prepare_ms, median(&drag.repeat(plan, &mut round)?.whole)))
}

fn goals(study: &Study<'_>, step: usize) -> Goals {
    study.scene.goals_with_turns(step as f64 / STEPS as f64)
}
