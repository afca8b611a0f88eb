//! A step made ready to solve.

use std::ops::Range;

use glam::DVec3;
use pliant_cage::{Binding, Propagator};
use pliant_deform::{Constraint, Deformer, Goals, Handle, Region};
use pliant_mesh::{TriMesh, VertexSet};

use super::{Editor, EditorHandle, Grip, Pose};
use crate::snap::{Fade, inner_shares};
use crate::{CoarseStart, NoRoom, SessionError, carry_region};

/// Width of the strips in which a handle's last correction and the border of a region fade, in mean edges of the cage.
const STRIP: f64 = 3.0;

/// What depends on the region, the handles and where the step began, but not on the goals.
pub(crate) struct Prepared {
    solver: CoarseStart,
    propagator: Propagator,
    goals: Goals,
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
    unclean: bool,
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

/// What is set on the shape.
#[derive(Debug, Clone, Copy)]
enum Target {
    /// A vertex goes to the goal of itself.
    Vertex(u32),
    /// A corner of a point's face moves by what the point misses its goal by, over the weight of the corners that move.
    Corner { vertex: u32, of: Corners, weight: f64 },
}

/// A point of the surface by its corners.
#[derive(Debug, Clone, Copy)]
struct Corners {
    vertices: [u32; 3],
    weights: [f64; 3],
}

impl Corners {
    fn place(&self, positions: &[DVec3]) -> DVec3 {
        (0..3).map(|k| self.weights[k] * positions[self.vertices[k] as usize]).sum()
    }
}

impl Prepared {
    /// Prepares the step of an editor; `old` is what was prepared for other handles of it.
    pub(crate) fn new(editor: &Editor, old: Option<Self>) -> Result<Self, SessionError> {
        let (shape, base) = (&editor.rest, &editor.base);
        let n = shape.vertex_count();
        let roi = editor.region.clone().unwrap_or_else(|| VertexSet::all(n));
        let handles = on_shape(editor)?;
        let region = Region::new(n, &roi, &handles)?;
        let carried = carry_region(&region, &editor.simplified.origin, &base.shape, &base.cage);
        let carried = carried.map_err(|no_room| match no_room {
            NoRoom::Handle(at) => {
                SessionError::NoRoom { handle: editor.handles[at].id, vertices: editor.simplified.mesh.vertex_count() }
            }
            NoRoom::Region(error) => error.into(),
        })?;
        let (cage_region, _) = carried.region.without_unconstrained(editor.simplified.mesh.topology());
        let cage = editor.simplified.mesh.with_positions(base.cage.clone())?;
        let fresh = old.is_none();
        let solver = match old {
            // The cage rests where it did: numbers change, patterns are kept where they can be.
            Some(mut old) => {
                old.solver.set_region(&cage_region)?;
                old.solver
            }
            None => editor.levels.prepare(&editor.options.method, &cage, &cage_region)?,
        };
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
            goals: Goals::identity(handles.len()),
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

    /// Takes over the goals of the handles.
    pub(crate) fn set_goals(&mut self, handles: &[EditorHandle], base: &Pose) {
        self.goals.transforms.clear();
        self.goals.transforms.extend(handles.iter().map(|h| h.goal));
        for (target, &(at, kind)) in self.targets.iter_mut().zip(&self.owners) {
            if let Target::Vertex(v) = kind {
                *target = handles[at].goal.apply(base.shape[v as usize]);
            }
        }
    }

    /// One solve from `pose`; returns how far the cage moved in it, as a share of its diagonal.
    pub(crate) fn solve(&mut self) -> Result<f64, SessionError> {
        self.before.copy_from_slice(&self.pose);
        self.solver.solve(&self.goals, &mut self.pose)?;
        let moved = self.before.iter().zip(&self.pose).map(|(a, b)| a.distance_squared(*b)).fold(0.0, f64::max);
        Ok(moved.sqrt() / self.diagonal)
    }
    /// Carries the cage's motion to the shape, keeps what lies outside the region, and sets hard handles on their goals; returns by how
    /// much that moved them at most.
    pub(crate) fn show(&mut self, binding: &Binding, base: &Pose, current: &mut Pose) -> f64 {
        let shape = &mut current.shape;
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
        current.cage.copy_from_slice(&self.pose);
        for (place, &(at, kind)) in self.owners.iter().enumerate() {
            if let Target::Corner { vertex, of, weight } = kind {
                let goal = self.goals.transforms[at].apply(of.place(&base.shape));
                self.targets[place] = shape[vertex as usize] + (goal - of.place(shape)) / weight;
            }
        }
        self.fade.apply(&self.targets, shape)
    }
}

/// The handles as vertices of the shape. A point stands for a corner of its face that no other handle has.
fn on_shape(editor: &Editor) -> Result<Vec<Handle>, SessionError> {
    let mut taken: VertexSet = editor.handles.iter().filter_map(vertices).flat_map(VertexSet::iter).collect();
    editor
        .handles
        .iter()
        .map(|handle| {
            let vertices = match &handle.grip {
                Grip::Vertices(set) => set.clone(),
                Grip::Point(point) => {
                    let corner = point.corners(editor.rest.triangles()).into_iter().find(|v| !taken.contains(*v));
                    let corner = corner.ok_or_else(|| SessionError::BadGrip {
                        reason: format!("other handles hold all corners of face {}", point.face),
                    })?;
                    taken = taken.union(&VertexSet::from_iter([corner]));
                    VertexSet::from_iter([corner])
                }
            };
            Ok(Handle { vertices, constraint: handle.constraint })
        })
        .collect()
}

/// The vertices of a handle that holds vertices.
fn vertices(handle: &EditorHandle) -> Option<&VertexSet> {
    match &handle.grip {
        Grip::Vertices(set) => Some(set),
        Grip::Point(_) => None,
    }
}

/// What hard handles set on the shape: each vertex once, those of vertex handles first.
fn targets(editor: &Editor) -> (Vec<u32>, Vec<(usize, Target)>) {
    let hard = || editor.handles.iter().enumerate().filter(|(_, h)| h.constraint == Constraint::Hard);
    let mut owners: Vec<(usize, Target)> = hard()
        .filter_map(|(at, handle)| Some((at, vertices(handle)?)))
        .flat_map(|(at, set)| set.iter().map(move |v| (at, Target::Vertex(v))))
        .collect();
    let mut sources: Vec<u32> = owners.iter().map(|(_, target)| target.vertex()).collect();
    let mut taken: VertexSet = sources.iter().copied().collect();
    for (at, handle) in hard() {
        let Grip::Point(point) = &handle.grip else { continue };
        let of = Corners { vertices: editor.rest.triangles()[point.face as usize], weights: point.barycentric };
        let free: Vec<usize> = (0..3).filter(|&k| !taken.contains(of.vertices[k])).collect();
        let weight: f64 = free.iter().map(|&k| of.weights[k]).sum();
        // With next to no weight left the point is held by its neighbours' handles.
        if weight < 1e-3 {
            continue;
        }
        for k in free {
            owners.push((at, Target::Corner { vertex: of.vertices[k], of, weight }));
            sources.push(of.vertices[k]);
        }
        taken = sources.iter().copied().collect();
    }
    (sources, owners)
}

impl Target {
    fn vertex(&self) -> u32 {
        match self {
            Self::Vertex(vertex) | Self::Corner { vertex, .. } => *vertex,
        }
    }
}

fn mean_edge(mesh: &TriMesh) -> f64 {
    let (edges, p) = (mesh.topology().edges(), &mesh.positions);
    let sum: f64 = edges.iter().map(|&[a, b]| p[a as usize].distance(p[b as usize])).sum();
    sum / edges.len().max(1) as f64
}
