//! What an editor may move, and by what.

use glam::DVec3;
use pliant_deform::Constraint;
use pliant_mesh::{Similarity, VertexSet};

use super::aims::LEAST_WEIGHT;
use super::rows::Corners;
use super::{Editor, EditorHandle, Grip, SurfacePoint};
use crate::SessionError;

/// The vertices that may move.
#[derive(Debug, Clone)]
pub(crate) struct Movable {
    pub(crate) vertices: VertexSet,
    /// Whether each vertex of the shape is one of them.
    inside: Vec<bool>,
}

impl Editor {
    /// The handles, in the order they were added.
    pub fn handles(&self) -> &[EditorHandle] {
        &self.handles
    }

    /// The vertices that may move; `None` is all.
    pub fn region(&self) -> Option<&VertexSet> {
        self.region.as_ref().map(|movable| &movable.vertices)
    }

    pub(crate) fn may_move(&self, vertex: u32) -> bool {
        self.region.as_ref().is_none_or(|movable| movable.inside[vertex as usize])
    }

    /// Says which vertices may move: all others keep their bits. `None` is all. Of hard handles that hold others, too, only the identity is
    /// taken as a goal.
    ///
    /// # Errors
    /// [`SessionError::BadGrip`] if it is empty or names a vertex that does not exist.
    pub fn set_region(&mut self, region: Option<VertexSet>) -> Result<(), SessionError> {
        if let Some(region) = &region {
            Grip::Vertices(region.clone()).check(&self.rest)?;
        }
        self.region = region.map(|vertices| {
            let mut inside = vec![false; self.rest.vertex_count()];
            vertices.iter().for_each(|v| inside[v as usize] = true);
            Movable { vertices, inside }
        });
        self.change();
        Ok(())
    }

    /// Adds a handle that meets its goals exactly; returns its number.
    ///
    /// Handles cost time when next something is solved, a few milliseconds in all for a thousand; adding one looks at all there are.
    ///
    /// # Errors
    /// [`SessionError::BadGrip`] if it names what does not exist, or what another handle holds: a vertex, or so much of a face that no corner is
    /// left for a point of it.
    pub fn grab(&mut self, grip: Grip) -> Result<u32, SessionError> {
        self.add_handle(grip, Constraint::Hard)
    }

    /// Adds a handle that stays where it is. It is a handle like others and can be dragged, too.
    ///
    /// # Errors
    /// As [`Self::grab`].
    pub fn anchor(&mut self, grip: Grip) -> Result<u32, SessionError> {
        self.grab(grip)
    }

    /// Adds a handle that is drawn to its goals with a weight, or held to them.
    ///
    /// # Errors
    /// As [`Self::grab`].
    pub fn add_handle(&mut self, grip: Grip, constraint: Constraint) -> Result<u32, SessionError> {
        grip.check(&self.rest)?;
        if let Constraint::Soft(weight) = constraint
            && !(weight > 0.0 && weight.is_finite())
        {
            return Err(SessionError::BadGrip { reason: format!("its weight is {weight}, not a number above 0") });
        }
        self.check_room(&grip, constraint)?;
        let id = self.next_id;
        self.next_id += 1;
        self.handles.push(EditorHandle { id, grip, constraint, goal: Similarity::IDENTITY });
        self.change();
        Ok(id)
    }

    /// Refuses a grip at what another handle holds.
    fn check_room(&self, grip: &Grip, constraint: Constraint) -> Result<(), SessionError> {
        let refuse = |reason: String| Err(SessionError::BadGrip { reason });
        let is_hard = |h: &&EditorHandle| h.constraint == Constraint::Hard;
        match grip {
            Grip::Vertices(own) => {
                for handle in &self.handles {
                    if let Some(v) = handle.grip.vertices().and_then(|other| common(own, other)) {
                        return refuse(format!("handle {} holds vertex {v}, too", handle.id));
                    }
                }
                // Points of which all corners would be held.
                for handle in self.handles.iter().filter(is_hard).filter(|_| constraint == Constraint::Hard) {
                    let Grip::Point(point) = &handle.grip else { continue };
                    let of = point.on(self.rest.triangles());
                    if of.vertices.iter().any(|v| own.contains(*v)) && self.free_weight(&of, Some(own)) < LEAST_WEIGHT {
                        return refuse(format!("it leaves no corner for the point that handle {} holds", handle.id));
                    }
                }
            }
            Grip::Point(point) => {
                let near = |other: &SurfacePoint| {
                    let apart = (0..3).map(|k| (other.barycentric[k] - point.barycentric[k]).abs()).fold(0.0, f64::max);
                    other.face == point.face && apart < LEAST_WEIGHT
                };
                let same = |h: &&EditorHandle| matches!(&h.grip, Grip::Point(other) if near(other));
                if let Some(other) = self.handles.iter().find(same) {
                    return refuse(format!("handle {} holds the same point", other.id));
                }
                let of = point.on(self.rest.triangles());
                if constraint == Constraint::Hard && self.free_weight(&of, None) < LEAST_WEIGHT {
                    return refuse(format!("other handles hold all corners of face {}", point.face));
                }
            }
        }
        Ok(())
    }

    /// Weight of a point's corners that no hard handle and no vertex of `others` hold.
    fn free_weight(&self, of: &Corners, others: Option<&VertexSet>) -> f64 {
        let hard = self.handles.iter().filter(|h| h.constraint == Constraint::Hard);
        let sets: Vec<&VertexSet> = hard.filter_map(|h| h.grip.vertices()).chain(others).collect();
        let is_free = |v: u32| sets.iter().all(|set| !set.contains(v));
        (0..3).filter(|&k| is_free(of.vertices[k])).map(|k| of.weights[k]).sum()
    }

    /// Takes a handle away.
    ///
    /// # Errors
    /// [`SessionError::NoHandle`].
    pub fn remove_handle(&mut self, handle: u32) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        self.handles.remove(at);
        self.change();
        Ok(())
    }

    /// Sets the goal of a handle, as a motion from where the step began. The newest goal counts; nothing is solved before
    /// [`Self::update`] or [`Self::release`].
    ///
    /// # Errors
    /// [`SessionError::NoHandle`], or [`SessionError::BadGrip`] for a motion that is no similarity.
    pub fn drag(&mut self, handle: u32, goal: Similarity) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        if !goal.is_valid() {
            return Err(SessionError::BadGrip { reason: format!("its goal is no similarity: {goal:?}") });
        }
        self.handles[at].goal = goal;
        Ok(())
    }

    /// Sets the goal of a handle so that its middle goes to a point, without turning.
    ///
    /// # Errors
    /// As [`Self::drag`].
    pub fn drag_to(&mut self, handle: u32, point: DVec3) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        let middle = match &self.handles[at].grip {
            Grip::Vertices(vertices) => {
                vertices.iter().map(|v| self.base.shape[v as usize]).sum::<DVec3>() / vertices.len() as f64
            }
            Grip::Point(point) => point.on(self.rest.triangles()).place(&self.base.shape),
        };
        self.drag(handle, Similarity::translation(point - middle))
    }

    fn place(&self, handle: u32) -> Result<usize, SessionError> {
        // Numbers increase with the places.
        self.handles.binary_search_by_key(&handle, |h| h.id).map_err(|_| SessionError::NoHandle { handle })
    }

    /// The handles or the region are others now.
    pub(super) fn change(&mut self) {
        self.released = None;
        if let Some(prepared) = &mut self.prepared {
            prepared.stale = true;
        }
    }
}

/// A vertex of both sets.
fn common(a: &VertexSet, b: &VertexSet) -> Option<u32> {
    let (small, large) = if a.len() < b.len() { (a, b) } else { (b, a) };
    small.iter().find(|v| large.contains(*v))
}
