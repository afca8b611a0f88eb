//! A solver on a cage that starts from the answer of coarser ones.

use std::sync::Arc;

use glam::DVec3;
use pliant_cage::{Propagation, Propagator};
use pliant_deform::{
    Acceleration, ArapOptions, DeformError, Deformer, Goals, ImplicitReport, Method, PrepareReport, Region,
    SolveReport, StepTimes,
};
use pliant_mesh::TriMesh;

use crate::Levels;
use crate::levels::Level;

/// Iterations on the coarsest level, and on those between it and the cage: on meshes of so few vertices they cost little.
const ITERATIONS: [u32; 2] = [24, 4];

/// How far acceleration looks back on the levels.
const WINDOW: u32 = 5;

/// A handle farther from its goal than this share of the cage's diagonal is a jump.
const JUMP: f64 = 0.02;

impl Levels {
    /// Prepares a method on the cage the levels were made for, in whatever pose it rests now, to start from their answer where the goals
    /// are far.
    ///
    /// # Errors
    /// As [`Method::prepare`]. A level on which the region cannot be prepared is left out.
    ///
    /// # Panics
    /// If `cage` has not as many vertices as the cage the levels were made for.
    pub fn prepare(&self, method: &Method, cage: &TriMesh, region: &Region) -> Result<CoarseStart, DeformError> {
        let finest = method.prepare(cage, region)?;
        let mut start = CoarseStart {
            rest: cage.positions.clone(),
            diagonal: cage.bounds().diagonal(),
            coarse_method: coarse(method),
            region: region.clone(),
            finest,
            all: self.clone(),
            active: Vec::new(),
            start: Vec::new(),
            coarse_goals: Goals::identity(0),
            propagator: Propagator::new(Propagation::Frames),
        };
        start.activate();
        Ok(start)
    }
}

/// What runs on the levels: the method itself where it iterates, accelerated.
fn coarse(method: &Method) -> Option<ArapOptions> {
    match method {
        Method::Arap(options) => {
            let acceleration = Acceleration::Anderson { window: WINDOW };
            Some(ArapOptions { tolerance: None, acceleration, ..options.clone() })
        }
        _ => None,
    }
}

/// A method on a cage that starts from the answer of coarser levels.
///
/// A goal that is near (a drag from frame to frame) is solved from the pose as it is. For one that is far, the pose is taken up to the
/// levels, solved there from the coarsest down, and each level's motion is carried to the next finer mesh and at last to
/// the cage by frames, as an increment: what the pose had of its own stays. The result depends on the incoming pose alone.
pub struct CoarseStart {
    rest: Vec<DVec3>,
    diagonal: f64,
    coarse_method: Option<ArapOptions>,
    region: Region,
    finest: Box<dyn Deformer>,
    all: Levels,
    /// Finest first.
    active: Vec<Active>,
    start: Vec<DVec3>,
    /// For the levels, where handles have no points.
    coarse_goals: Goals,
    propagator: Propagator,
}

/// A level with the region on it.
struct Active {
    level: Arc<Level>,
    rest: Vec<DVec3>,
    region: Region,
    deformer: Box<dyn Deformer>,
    /// The pose before and after the solve.
    from: Vec<DVec3>,
    to: Vec<DVec3>,
}

impl CoarseStart {
    /// Number of levels in use.
    pub fn level_count(&self) -> usize {
        self.active.len()
    }

    /// Makes the levels ready for the region, up to the first on which that fails. Those that are prepared already are changed.
    fn activate(&mut self) {
        let Self { rest, coarse_method: Some(options), region, all, active, .. } = self else { return };
        for (k, level) in all.levels.iter().enumerate() {
            let (finer, coarser) = active.split_at_mut(k);
            let (region, finer_rest) = match finer.last() {
                None => (&*region, &*rest),
                Some(finer) => (&finer.region, &finer.rest),
            };
            // The cage may have been edited since the levels were made: what it is now is at rest.
            let rest: Vec<DVec3> = level.part_of(finer_rest).collect();
            let made = level.region(region, finer_rest, &rest).and_then(|region| {
                if let Some(known) = coarser.first_mut() {
                    known.deformer.set_region(&region).ok()?;
                    known.region = region;
                    return Some(None);
                }
                let iterations = ITERATIONS[usize::from(k + 1 < all.levels.len())];
                let method = Method::Arap(ArapOptions { iterations, ..options.clone() });
                let mesh = level.mesh.with_positions(rest.clone()).ok()?;
                let deformer = method.prepare(&mesh, &region).ok()?;
                let (from, to) = (rest.clone(), rest.clone());
                Some(Some(Active { level: Arc::clone(level), rest, region, deformer, from, to }))
            });
            match made {
                Some(new) => active.extend(new),
                None => return active.truncate(k),
            }
        }
    }

    /// Whether a handle is far from its goal.
    fn is_jump(&self, goals: &Goals, positions: &[DVec3]) -> bool {
        let far = (JUMP * self.diagonal).powi(2);
        self.region.handles().iter().zip(&goals.transforms).any(|(handle, goal)| {
            let mut vertices = handle.vertices.iter().map(|v| v as usize);
            vertices.any(|v| positions[v].distance_squared(goal.apply(self.rest[v])) > far)
        })
    }

    /// Brings `self.start`, a copy of the incoming pose, near the solution.
    fn start_from_levels(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        let Self { region, active, start, coarse_goals, propagator, .. } = self;
        coarse_goals.copy_transforms(goals);
        for k in 0..active.len() {
            let (finer, coarser) = active.split_at_mut(k);
            let pose = finer.last().map_or(positions, |finer| &finer.from);
            let Active { level, from, to, .. } = &mut coarser[0];
            for (from, at) in from.iter_mut().zip(level.part_of(pose)) {
                *from = at;
            }
            to.copy_from_slice(from);
        }
        for k in (0..active.len()).rev() {
            let (finer, coarser) = active.split_at_mut(k);
            let Active { level, deformer, from, to, .. } = &mut coarser[0];
            deformer.solve(coarse_goals, to)?;
            let (region, before, after) = match finer.last_mut() {
                Some(finer) => (&finer.region, &finer.from[..], &mut finer.to[..]),
                None => (&*region, positions, &mut start[..]),
            };
            level.carry(propagator, [from, to], region, before, after);
        }
        Ok(())
    }
}

impl Deformer for CoarseStart {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        goals.check(&self.region)?;
        let usable = positions.len() == self.rest.len() && positions.iter().all(|p| p.is_finite());
        if !usable || self.active.is_empty() || !self.is_jump(goals, positions) {
            // Says what is wrong with the pose, too.
            return self.finest.solve(goals, positions);
        }
        self.start.clear();
        self.start.extend_from_slice(positions);
        if self.start_from_levels(goals, positions).is_err() || self.start.iter().any(|p| !p.is_finite()) {
            // A level may break down where the cage does not.
            return self.finest.solve(goals, positions);
        }
        let report = self.finest.solve(goals, &mut self.start)?;
        positions.copy_from_slice(&self.start);
        Ok(report)
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        let report = self.finest.set_region(region)?;
        self.region = region.clone();
        self.activate();
        Ok(report)
    }

    fn solve_preview(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        // Only a method that no level starts has a stage of its own to show.
        if self.coarse_method.is_some() {
            self.solve(goals, positions)
        } else {
            self.finest.solve_preview(goals, positions)
        }
    }

    fn prepared(&self) -> PrepareReport {
        self.finest.prepared()
    }

    fn implicit_report(&self) -> Option<ImplicitReport> {
        self.finest.implicit_report()
    }

    fn step_times(&self) -> StepTimes {
        let levels = self.active.iter().map(|level| level.deformer.step_times());
        levels.fold(self.finest.step_times(), |sum, own| StepTimes {
            local: sum.local + own.local,
            global: sum.global + own.global,
        })
    }
}
