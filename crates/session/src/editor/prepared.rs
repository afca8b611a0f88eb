//! A step made ready to solve.

use std::ops::Range;

use glam::DVec3;
use pliant_cage::{Binding, Propagator};
use pliant_deform::{Deformer, Goals};
use pliant_mesh::{TriMesh, VertexSet};

use super::held::{Held, RowPoint, Target, on_cage, targets};
use super::{Editor, EditorHandle, Pose};
use crate::snap::{Fade, inner_shares};
use crate::{CoarseStart, SessionError};

/// Width of the strips in which a handle's last correction and the border of a region fade, in mean edges of the cage.
const STRIP: f64 = 3.0;

/// What depends on the region, the handles and where the step began, but not on the goals.
pub(crate) struct Prepared {
    /// `None` if the cage has nothing to move: its part in the region is empty, or led as a whole.
    solver: Option<CoarseStart>,
    propagator: Propagator,
    /// The handles that the cage knows.
    known: Vec<usize>,
    goals: Goals,
    /// Points that the cage is held by, where it has no vertex of a handle.
    rows: Vec<RowPoint>,
    /// Whether the rows' targets follow the frames of the cage. With many rows that would feed back: they make the frames.
    follows: bool,
    /// The cage, and what it was before the last solve.
    pub(crate) pose: Vec<DVec3>,
    before: Vec<DVec3>,
    /// Of the cage.
    diagonal: f64,
    fade: Fade,
    targets: Vec<DVec3>,
    /// For each target the handle that has it, by place.
    owners: Vec<(usize, Target)>,
    /// The vertices that may move, with what only they need; `None` if all may.
    part: Option<Part>,
    /// Whether the shape shown may differ from where the step began outside of the region, from before it was this one.
    pub(crate) unclean: bool,
    pub(crate) changed: Range<usize>,
    pub(crate) stale: bool,
    /// Whether nothing is left of other handles.
    pub(crate) fresh: bool,
}

/// The part of the shape that may move.
struct Part {
    vertices: VertexSet,
    binding: Binding,
    /// Positions, in the order of the vertices.
    points: Vec<DVec3>,
    /// Shares of motion: less than 1 near the border.
    shares: Vec<f64>,
}

impl Prepared {
    /// Prepares the step of an editor; `old` is what was prepared for other handles of it.
    pub(crate) fn new(editor: &Editor, old: Option<Self>) -> Result<Self, SessionError> {
        let (shape, base) = (&editor.rest, &editor.base);
        let roi = editor.region.clone().unwrap_or_else(|| VertexSet::all(shape.vertex_count()));
        let Held { region, known, mut rows, many } = on_cage(editor, &roi)?;
        let cage = editor.simplified.mesh.with_positions(base.cage.clone())?;
        let old = old.and_then(|old| old.solver);
        let fresh = old.is_none();
        let solver = match (region, old) {
            (None, _) => None,
            // The cage rests where it did: numbers change, patterns are kept where they can be.
            (Some(region), Some(mut solver)) => {
                solver.set_region(&region)?;
                Some(solver)
            }
            (Some(region), None) => Some(editor.levels.prepare(&editor.options.method, &cage, &region)?),
        };
        for row in &mut rows {
            row.begin(base);
        }
        let width = STRIP * mean_edge(&cage);
        let inside = |v: u32| editor.region.as_ref().is_none_or(|region| region.contains(v));
        let part = editor.region.as_ref().map(|vertices| {
            let shares = inner_shares(shape.topology(), &base.shape, inside, width);
            let of_part = |v: u32| shares.get(v as usize).copied().unwrap_or(1.0);
            Part {
                vertices: vertices.clone(),
                binding: editor.binding.part(vertices),
                points: vec![DVec3::ZERO; vertices.len()],
                shares: vertices.iter().map(of_part).collect(),
            }
        });
        let (sources, owners) = targets(editor);
        let set: VertexSet = sources.iter().copied().collect();
        let may_move = |v: u32| inside(v) && !set.contains(v);
        let fade = Fade::new(shape.topology(), &base.shape, sources, width, may_move);
        let first = roi.iter().next().unwrap_or(0) as usize;
        let end = roi.iter().last().map_or(0, |v| v as usize + 1);
        Ok(Self {
            solver,
            propagator: Propagator::default(),
            goals: Goals::identity(known.len()),
            known,
            follows: !many && !rows.is_empty(),
            rows,
            pose: base.cage.clone(),
            before: base.cage.clone(),
            diagonal: cage.bounds().diagonal(),
            fade,
            targets: vec![DVec3::ZERO; owners.len()],
            owners,
            part,
            unclean: true,
            changed: first..end,
            stale: false,
            fresh,
        })
    }

    /// Whether the cage is held by points whose targets depend on the shape shown last.
    pub(crate) fn follows(&self) -> bool {
        self.follows
    }

    /// Takes over the goals of the handles; with `anew` as if nothing had been shown yet.
    pub(crate) fn set_goals(&mut self, handles: &[EditorHandle], base: &Pose, anew: bool) {
        self.goals.transforms.clear();
        self.goals.transforms.extend(self.known.iter().map(|&at| handles[at].goal));
        for row in &mut self.rows {
            if anew {
                row.begin(base);
            }
            row.goal = handles[row.handle].goal.apply(row.of.place(&base.shape));
        }
        for (target, (at, kind)) in self.targets.iter_mut().zip(&mut self.owners) {
            match kind {
                Target::Vertex(v) => *target = handles[*at].goal.apply(base.shape[*v as usize]),
                Target::Corner { of, goal, .. } => *goal = handles[*at].goal.apply(of.place(&base.shape)),
            }
        }
    }

    /// One solve from `pose`, or the method's preview of one; returns how far the cage moved in it, as a share of its diagonal.
    pub(crate) fn solve(&mut self, preview: bool) -> Result<f64, SessionError> {
        let Some(solver) = &mut self.solver else { return Ok(0.0) };
        self.before.copy_from_slice(&self.pose);
        self.goals.points.clear();
        self.goals.points.extend(self.rows.iter().map(|row| row.goal - row.offset));
        match preview {
            true => solver.solve_preview(&self.goals, &mut self.pose)?,
            false => solver.solve(&self.goals, &mut self.pose)?,
        };
        let moved = self.before.iter().zip(&self.pose).map(|(a, b)| a.distance_squared(*b)).fold(0.0, f64::max);
        Ok(moved.sqrt() / self.diagonal)
    }

    /// Carries the cage's motion to the shape, keeps what lies outside the region, and sets hard handles on their goals; returns by how
    /// much that moved them at most.
    pub(crate) fn show(&mut self, binding: &Binding, base: &Pose, current: &mut Pose) -> f64 {
        let shape = &mut current.shape;
        // Outside of the region another pose may have been shown before.
        if self.unclean || self.part.is_none() {
            shape.copy_from_slice(&base.shape);
            self.unclean = false;
        }
        match &mut self.part {
            None => self.propagator.carry(binding, &base.cage, &self.pose, shape),
            Some(Part { vertices, binding, points, shares }) => {
                for (p, v) in points.iter_mut().zip(vertices.iter()) {
                    *p = base.shape[v as usize];
                }
                self.propagator.carry(binding, &base.cage, &self.pose, points);
                for ((p, &share), v) in points.iter().zip(&*shares).zip(vertices.iter()) {
                    let rest = base.shape[v as usize];
                    shape[v as usize] = if share < 1.0 { rest + share * (*p - rest) } else { *p };
                }
            }
        }
        for row in self.rows.iter_mut().filter(|_| self.follows) {
            row.offset = row.of.place(shape) - row.on_cage(&self.pose);
        }
        current.cage.copy_from_slice(&self.pose);
        for (target, (_, kind)) in self.targets.iter_mut().zip(&self.owners) {
            if let Target::Corner { vertex, of, weight, goal } = kind {
                *target = shape[*vertex as usize] + (*goal - of.place(shape)) / *weight;
            }
        }
        self.fade.apply(&self.targets, shape)
    }
}

fn mean_edge(mesh: &TriMesh) -> f64 {
    let (edges, p) = (mesh.topology().edges(), &mesh.positions);
    let sum: f64 = edges.iter().map(|&[a, b]| p[a as usize].distance(p[b as usize])).sum();
    sum / edges.len().max(1) as f64
}
