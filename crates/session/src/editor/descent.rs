//! From a pose of a large shape to near its minimum, by coarser meshes.
//!
//! What is far from settled in a large shape are motions that are smooth over many of its edges, and these a mesh with a quarter of the
//! vertices shows as well for a quarter of the time. As in a full multigrid cycle, the coarsest mesh is refined first, and each motion,
//! from the pose before to that after, is where the next finer one starts.

use std::sync::Arc;

use glam::DVec3;
use pliant_cage::{BindOptions, Propagation, Propagator, Prune, Support};
use pliant_deform::{ArapEnergy, Goals, RefineOptions, RefineStep, Refiner, Region};
use pliant_mesh::TriMesh;

use super::refining::Step;
use crate::Levels;
use crate::levels::Level;

/// A level is left once as many steps as the first of these together lower its energy by less than the second's share of it.
///
/// A step costs a fourth of one on the next finer mesh, so that it pays until it gains little; a single step may stall.
const STALLED: (usize, f64) = (4, 1e-3);

/// Rows just long enough to be smooth: what they leave rough, two or three steps on the finer mesh take away.
pub(super) fn bind_options() -> BindOptions {
    BindOptions { support: Support::Rings, smoothing: 0, ..Prune::Smooth { neighbours: 6 }.into() }
}

/// Levels of a shape that are still to be gone through.
pub(super) struct Descent {
    /// Finest first; the last is at work.
    stations: Vec<Station>,
    at_work: Option<Work>,
    goals: Goals,
    options: RefineOptions,
    /// The region of the shape, and its pose before.
    region: Region,
    before: Vec<DVec3>,
    propagator: Propagator,
}

/// A level with the region on it.
struct Station {
    level: Arc<Level>,
    rest: Vec<DVec3>,
    region: Region,
    /// The pose before, and where its refinement starts or ended.
    before: Vec<DVec3>,
    pose: Vec<DVec3>,
}

struct Work {
    refiner: Refiner,
    /// Energies, the first before any step.
    energies: Vec<f64>,
}

impl Descent {
    /// Through the levels above a shape, as many as the region of `on_levels` is found on, which has vertices of the shape for all
    /// handles. `rest` and `before` are positions of the shape; what `region` has fixed stays.
    pub(super) fn new(
        levels: &Levels,
        rest: &[DVec3],
        before: &[DVec3],
        on_levels: &(Region, Goals),
        region: &Region,
        options: &RefineOptions,
    ) -> Self {
        let mut stations: Vec<Station> = Vec::new();
        for level in &levels.levels {
            let (finer_region, finer_rest, finer) = match stations.last() {
                None => (&on_levels.0, rest, before),
                Some(finer) => (&finer.region, &finer.rest[..], &finer.before[..]),
            };
            let rest: Vec<DVec3> = level.part_of(finer_rest).collect();
            let Some(region) = level.region(finer_region, finer_rest, &rest) else { break };
            let before: Vec<DVec3> = level.part_of(finer).collect();
            stations.push(Station { level: Arc::clone(level), rest, region, pose: before.clone(), before });
        }
        // Cells resist bending by the square of their size: those of levels too much, whatever the energy, and those of spokes least.
        let options = RefineOptions { energy: ArapEnergy::Spokes, ..options.clone() };
        let propagator = Propagator::new(Propagation::Frames);
        let (goals, region, before) = (on_levels.1.clone(), region.clone(), before.to_vec());
        Self { stations, at_work: None, goals, options, region, before, propagator }
    }

    /// The pose of the shape at first.
    pub(super) fn before(&self) -> &[DVec3] {
        &self.before
    }

    /// A step on the coarsest level left, and the pose of the shape after it if the level ends with it; `None` if there is none left. A
    /// level on which a step cannot be done is left out.
    pub(super) fn step(&mut self) -> Option<(Step, Option<Vec<DVec3>>)> {
        loop {
            let level = self.stations.len();
            let station = self.stations.last_mut()?;
            let work = self.at_work.take().or_else(|| Work::begin(station, &self.goals, &self.options));
            let Some((mut work, step)) = work.and_then(|mut work| work.refiner.step().ok().map(|step| (work, step)))
            else {
                self.stations.pop();
                continue;
            };
            let vertices = station.rest.len();
            work.energies.push(step.energy);
            let mut carried = None;
            if step.settled || work.has_stalled() {
                if work.refiner.positions(&mut station.pose).is_err() {
                    station.pose.copy_from_slice(&station.before);
                }
                carried = Some(self.carry());
                self.stations.pop();
            } else {
                self.at_work = Some(work);
            }
            let RefineStep { kind, energy, elapsed, .. } = step;
            return Some((Step { level, vertices, kind, energy, elapsed }, carried));
        }
    }

    /// Carries the motion of the coarsest level to all finer ones, which start there, and to the shape.
    fn carry(&mut self) -> Vec<DVec3> {
        let mut shape = self.before.clone();
        for k in (0..self.stations.len()).rev() {
            let (finer, coarser) = self.stations.split_at_mut(k);
            let Station { level, before, pose, .. } = &coarser[0];
            let (region, from, to) = match finer.last_mut() {
                None => (&self.region, &self.before[..], &mut shape[..]),
                Some(finer) => {
                    finer.pose.copy_from_slice(&finer.before);
                    (&finer.region, &finer.before[..], &mut finer.pose[..])
                }
            };
            level.carry(&mut self.propagator, [before, pose], region, from, to);
        }
        shape
    }
}

impl Work {
    fn begin(station: &Station, goals: &Goals, options: &RefineOptions) -> Option<Self> {
        let mesh: TriMesh = station.level.mesh.with_positions(station.rest.clone()).ok()?;
        let mut refiner = Refiner::prepare(&mesh, &station.region, options).ok()?;
        let energy = refiner.begin(goals, &station.pose).ok()?;
        Some(Self { refiner, energies: vec![energy] })
    }

    fn has_stalled(&self) -> bool {
        let (steps, share) = STALLED;
        let Some(at) = self.energies.len().checked_sub(steps + 1) else { return false };
        let [before, last] = [at, at + steps].map(|k| self.energies[k]);
        before - last <= share * before
    }
}
