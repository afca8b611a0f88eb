//! Where hard handles set the shape.

use std::collections::HashMap;
use std::ops::Range;

use glam::DVec3;
use pliant_deform::Constraint;
use pliant_mesh::Similarity;
use pliant_mesh::ranges::widen;

use super::rows::Corners;
use super::{Editor, EditorHandle, Grip, Pose};
use crate::SessionError;
use crate::snap::{Fade, Place};

/// Corners of a point that may move with less weight than this in all cannot bring it to its goal.
pub(crate) const LEAST_WEIGHT: f64 = 1e-3;

/// Steps in which points that share corners are brought to their goals, and the share of the shape's diagonal within which they are there.
const STEPS: u32 = 200;

/// See [`STEPS`].
const THERE: f64 = 1e-13;

/// What hard handles set on the shape: each vertex once, those of vertex handles first, then corners of points.
#[derive(Default)]
pub(crate) struct Aims {
    pub(crate) vertices: Vec<u32>,
    /// Goals of the vertices of vertex handles.
    held: Vec<DVec3>,
    /// Whose these are: the place of the handle, the range of its vertices, and its goal.
    groups: Vec<(usize, Range<usize>, Similarity)>,
    points: Vec<Point>,
    /// Whether two points move the same corner.
    shared: bool,
    /// Places of handles that hold something outside the region, and the first such vertex: they can only stay.
    stuck: Vec<(usize, u32)>,
    /// Of the shape.
    diagonal: f64,
    /// The largest coordinate of the shape where the step begins.
    farthest: f64,
}

/// A point within a face that is to go somewhere.
struct Point {
    /// Place of its handle.
    handle: usize,
    of: Corners,
    /// Of each corner the place among the vertices that are set; none of one outside the region.
    set: [Option<usize>; 3],
    /// Which of the corners the point moves: those that no vertex handle has.
    moves: [bool; 3],
    goal: DVec3,
}

impl Point {
    /// The corners that it moves, as places among the vertices that are set, and their weights.
    fn moved(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        (0..3).filter(|&k| self.moves[k]).filter_map(|k| Some((self.set[k]?, self.of.weights[k])))
    }

    /// What it moves, with what follows that.
    fn reach(&self, fade: &Fade) -> Range<usize> {
        let mut reach = 0..0;
        self.moved().for_each(|(place, _)| widen(&mut reach, &fade.reach[place]));
        reach
    }

    /// From where it is to its goal, with corner `k` at `at(k)`.
    fn miss(&self, at: impl Fn(usize) -> DVec3) -> DVec3 {
        if self.of.weights[0] == 1.0 {
            return self.goal - at(0);
        }
        self.goal - (0..3).map(|k| self.of.weights[k] * at(k)).sum::<DVec3>()
    }
}

impl Aims {
    /// Of the editor's hard handles, as far as they lie within its region.
    pub(crate) fn new(editor: &Editor) -> Self {
        let base = &editor.base.shape;
        let inside = |v: u32| editor.may_move(v);
        let hard = || editor.handles.iter().enumerate().filter(|(_, h)| h.constraint == Constraint::Hard);
        let farthest = base.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let mut aims = Self { diagonal: editor.rest.bounds().diagonal(), farthest, ..Self::default() };
        for (at, handle) in hard() {
            let Grip::Vertices(set) = &handle.grip else { continue };
            let first = aims.held.len();
            aims.vertices.extend(set.iter().filter(|v| inside(*v)));
            aims.held.extend(aims.vertices[first..].iter().map(|&v| base[v as usize]));
            aims.groups.push((at, first..aims.held.len(), Similarity::IDENTITY));
            aims.stuck.extend(set.iter().find(|v| !inside(*v)).map(|v| (at, v)));
        }
        let mut places: HashMap<u32, usize> = aims.vertices.iter().copied().zip(0..).collect();
        for (at, handle) in hard() {
            let Grip::Point(point) = &handle.grip else { continue };
            let of = point.on(editor.rest.triangles());
            let moves = of.vertices.map(|v| inside(v) && places.get(&v).is_none_or(|place| *place >= aims.held.len()));
            let mut point = Point { handle: at, of, set: [None; 3], moves, goal: of.place(base) };
            if (0..3).filter(|&k| moves[k]).map(|k| of.weights[k]).sum::<f64>() < LEAST_WEIGHT {
                aims.stuck.push((at, of.vertices[0]));
                continue;
            }
            for (k, &v) in of.vertices.iter().enumerate() {
                if moves[k] {
                    let next = aims.vertices.len();
                    let place = *places.entry(v).or_insert(next);
                    if place == next {
                        aims.vertices.push(v);
                    } else {
                        aims.shared = true;
                    }
                }
                point.set[k] = places.get(&v).copied();
            }
            aims.points.push(point);
        }
        aims
    }

    /// The corners of points that are set.
    pub(crate) fn corners(&self) -> &[u32] {
        &self.vertices[self.held.len()..]
    }

    /// Refuses goals that cannot be met.
    ///
    /// # Errors
    /// [`SessionError::OutsideRegion`] for the handle of a vertex that may not move, [`SessionError::BadGrip`] for a goal too far away to
    /// compute with.
    pub(crate) fn check(&self, handles: &[EditorHandle]) -> Result<(), SessionError> {
        if let Some(&(at, vertex)) = self.stuck.iter().find(|(at, _)| handles[*at].goal != Similarity::IDENTITY) {
            return Err(SessionError::OutsideRegion { handle: handles[at].id, vertex });
        }
        let all = self.groups.iter().map(|group| group.0).chain(self.points.iter().map(|point| point.handle));
        for handle in all.map(|at| &handles[at]) {
            let farthest = 4.0 * self.farthest * handle.goal.scale + 4.0 * handle.goal.translation.abs().max_element();
            // Frames are in single precision.
            if farthest.is_nan() || farthest > f64::from(f32::MAX) {
                let reason = format!("the goal of handle {} is too far away to compute with", handle.id);
                return Err(SessionError::BadGrip { reason });
            }
        }
        Ok(())
    }

    /// Takes over the goals of the handles; the range of vertices that this moves, with those that follow them.
    pub(crate) fn set(&mut self, handles: &[EditorHandle], base: &Pose, fade: &Fade) -> Range<usize> {
        let mut changed = 0..0;
        for (at, places, last) in self.groups.iter_mut().filter(|(at, _, last)| handles[*at].goal != *last) {
            *last = handles[*at].goal;
            for place in places.clone() {
                let goal = last.apply(base.shape[self.vertices[place] as usize]);
                if differs(self.held[place], goal) {
                    self.held[place] = goal;
                    widen(&mut changed, &fade.reach[place]);
                }
            }
        }
        let mut moved = 0..0;
        for point in &mut self.points {
            let goal = handles[point.handle].goal.apply(point.of.place(&base.shape));
            if differs(point.goal, goal) {
                point.goal = goal;
                widen(&mut moved, &point.reach(fade));
            }
        }
        if self.shared && !moved.is_empty() {
            moved = self.reach_of_points(fade);
        }
        widen(&mut changed, &moved);
        changed
    }

    /// The range of vertices that are set, or follow those that are, elsewhere if the cage carries a range of vertices elsewhere.
    pub(crate) fn touched(&self, carried: &Range<usize>, fade: &Fade) -> Range<usize> {
        let inside = |v: &u32| carried.contains(&(*v as usize));
        let mut changed = 0..0;
        for (_, reach) in self.vertices.iter().zip(&fade.reach).filter(|(v, _)| inside(v)) {
            widen(&mut changed, reach);
        }
        let mut touched = self.points.iter().filter(|point| point.of.vertices.iter().any(inside));
        if self.shared {
            widen(&mut changed, &touched.next().map_or(0..0, |_| self.reach_of_points(fade)));
        } else {
            touched.for_each(|point| widen(&mut changed, &point.reach(fade)));
        }
        changed
    }

    fn reach_of_points(&self, fade: &Fade) -> Range<usize> {
        let mut reach = 0..0;
        self.points.iter().for_each(|point| widen(&mut reach, &point.reach(fade)));
        reach
    }

    /// Finds where each vertex goes of a shape as the cage has it; returns by how much a point misses its goal at most.
    ///
    /// The corners of a point that no vertex handle has move alike, by what the point misses its goal by over their weight. Where points
    /// share corners, those then move by as little as brings all points to their goals.
    pub(crate) fn place<P: Place>(&self, shape: &[P], places: &mut Places) -> f64 {
        let targets = &mut places.targets;
        targets.clear();
        targets.extend_from_slice(&self.held);
        targets.extend(self.corners().iter().map(|&v| shape[v as usize].double()));
        let miss = |point: &Point, targets: &[DVec3]| {
            point.miss(|k| match point.set[k] {
                Some(place) => targets[place],
                None => shape[point.of.vertices[k] as usize].double(),
            })
        };
        for point in &self.points {
            let step = miss(point, targets) / point.moved().map(|(_, weight)| weight).sum::<f64>();
            point.moved().for_each(|(place, _)| targets[place] += step);
        }
        if self.shared {
            self.meet_together(places, miss);
        }
        // Written so that NaN stays.
        let worse = |most: f64, miss: f64| if miss <= most { most } else { miss };
        self.points.iter().map(|point| miss(point, &places.targets).length()).fold(0.0, worse)
    }

    /// The least change of the corners that brings all points to their goals, or as near as may be where they contradict each other: conjugate
    /// gradients on the normal equations of `A`, whose rows are the weights of the points' corners (Björck 1996, CGLS).
    fn meet_together(&self, places: &mut Places, miss: impl Fn(&Point, &[DVec3]) -> DVec3) {
        let Places { targets, missed, direction, slope, .. } = places;
        missed.clear();
        missed.extend(self.points.iter().map(|point| miss(point, targets)));
        direction.clear();
        direction.resize(targets.len(), DVec3::ZERO);
        let square = |vectors: &[DVec3]| vectors.iter().map(|v| v.length_squared()).sum::<f64>();
        let mut before = f64::INFINITY;
        let mut first = 0.0;
        for step in 0..STEPS {
            if missed.iter().all(|m| m.length() <= THERE * self.diagonal) {
                break;
            }
            slope.clear();
            slope.resize(targets.len(), DVec3::ZERO);
            for (point, missed) in self.points.iter().zip(&*missed) {
                point.moved().for_each(|(place, weight)| slope[place] += weight * *missed);
            }
            let now = square(slope);
            if step == 0 {
                first = now;
            }
            // What is left contradicts itself.
            if now <= THERE * THERE * first {
                break;
            }
            let share = now / before;
            direction.iter_mut().zip(&*slope).for_each(|(d, s)| *d = share * *d + *s);
            before = now;
            let along = |point: &Point| point.moved().map(|(place, weight)| weight * direction[place]).sum::<DVec3>();
            let length = now / self.points.iter().map(|point| along(point).length_squared()).sum::<f64>();
            // In the span of the rows, so that this is no division by zero but for rounding.
            if !length.is_finite() {
                break;
            }
            for (point, missed) in self.points.iter().zip(&mut *missed) {
                *missed -= length * along(point);
            }
            targets.iter_mut().zip(&*direction).for_each(|(target, d)| *target += length * *d);
        }
    }
}

/// Where the vertices that are set go, with memory that is kept.
#[derive(Default)]
pub(crate) struct Places {
    pub(crate) targets: Vec<DVec3>,
    pub(crate) moved: Vec<DVec3>,
    missed: Vec<DVec3>,
    direction: Vec<DVec3>,
    slope: Vec<DVec3>,
}

/// Whether two positions have other bits.
pub(crate) fn differs(a: DVec3, b: DVec3) -> bool {
    a.to_array().map(f64::to_bits) != b.to_array().map(f64::to_bits)
}
