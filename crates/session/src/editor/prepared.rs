//! A step made ready to solve.

use glam::DVec3;
use pliant_deform::{Deformer, Goals, Region, Role};
use pliant_mesh::TriMesh;

use super::carrier::Carrier;
use super::held::{Held, named, on_cage};
use super::rows::Rows;
use super::{Editor, EditorHandle};
use crate::snap::inner_shares;
use crate::{CoarseStart, SessionError};

/// Width of the strips in which a handle's last correction and the border of a region fade, in mean edges of the cage.
const STRIP: f64 = 3.0;

/// What depends on the region, the handles and where the step began, but not on the goals.
pub(crate) struct Prepared {
    /// `None` if the cage has nothing to move: its part in the region is empty, or led as a whole.
    solver: Option<CoarseStart>,
    /// The handles that the cage knows: their places and their numbers.
    known: Vec<(usize, u32)>,
    goals: Goals,
    pub(crate) rows: Rows,
    /// Whether each cage vertex may leave its place; none if no one may.
    moves: Vec<bool>,
    /// The cage, and what it was before the last solve.
    pub(crate) pose: Vec<DVec3>,
    before: Vec<DVec3>,
    /// Of the cage.
    diagonal: f64,
    pub(crate) carrier: Carrier,
    pub(crate) stale: bool,
    /// Whether nothing is left of other handles.
    pub(crate) fresh: bool,
}

impl Prepared {
    /// Prepares the step of an editor; `old` is what was prepared for other handles of it.
    pub(crate) fn new(editor: &Editor, old: Option<Self>) -> Result<Self, SessionError> {
        let base = &editor.base;
        let Held { region, known, rows, many } = on_cage(editor)?;
        let cage = editor.simplified.mesh.with_positions(base.cage.clone())?;
        let known: Vec<(usize, u32)> = known.into_iter().map(|at| (at, editor.handles[at].id)).collect();
        let old = old.and_then(|old| old.solver);
        let fresh = old.is_none();
        let id = |at: usize| known[at].1;
        let moves = region.iter().flat_map(Region::roles).map(|role| *role != Role::Fixed).collect();
        let solver = match (region, old) {
            (None, _) => None,
            // The cage rests where it did: numbers change, patterns are kept where they can be.
            (Some(region), Some(mut solver)) => {
                solver.set_region(&region).map_err(|error| named(error, id))?;
                Some(solver)
            }
            (Some(region), None) => {
                let made = editor.levels.prepare(&editor.options.method, &cage, &region);
                Some(made.map_err(|error| named(error, id))?)
            }
        };
        let width = STRIP * mean_edge(&cage);
        let shares = match &editor.region {
            Some(_) => inner_shares(editor.rest.topology(), &base.shape, |v| editor.may_move(v), width),
            None => Vec::new(),
        };
        // With many rows following would feed back: they make the frames.
        let mut rows = Rows::new(rows, !many, &editor.bound.binding, base, &shares);
        rows.begin(&base.cage);
        Ok(Self {
            solver,
            goals: Goals::identity(known.len()),
            known,
            rows,
            moves,
            pose: base.cage.clone(),
            before: base.cage.clone(),
            diagonal: cage.bounds().diagonal(),
            carrier: Carrier::new(editor, &shares, width),
            stale: false,
            fresh,
        })
    }

    /// Starts from the cage as it is shown, but for what is held where the step began: with other handles it may have left.
    pub(crate) fn start_from(&mut self, shown: &[DVec3], base: &[DVec3]) {
        self.pose.copy_from_slice(base);
        for ((pose, shown), _) in self.pose.iter_mut().zip(shown).zip(&self.moves).filter(|(_, moves)| **moves) {
            *pose = *shown;
        }
    }

    /// Takes over the goals of the handles.
    ///
    /// # Errors
    /// As [`super::aims::Aims::check`]; then nothing is taken over.
    pub(crate) fn aim(&mut self, handles: &[EditorHandle]) -> Result<(), SessionError> {
        self.carrier.aims().check(handles)?;
        self.goals.transforms.clear();
        self.goals.transforms.extend(self.known.iter().map(|&(at, _)| handles[at].goal));
        self.rows.aim(handles);
        Ok(())
    }

    /// One solve from `pose`, or the method's preview of one; returns how far the cage moved in it, as a share of its diagonal.
    pub(crate) fn solve(&mut self, preview: bool) -> Result<f64, SessionError> {
        let Some(solver) = &mut self.solver else { return Ok(0.0) };
        self.before.copy_from_slice(&self.pose);
        self.goals.points.clear();
        self.goals.points.extend(self.rows.targets());
        let solved = match preview {
            true => solver.solve_preview(&self.goals, &mut self.pose),
            false => solver.solve(&self.goals, &mut self.pose),
        };
        solved.map_err(|error| named(error, |at| self.known[at].1))?;
        let moved = self.before.iter().zip(&self.pose).map(|(a, b)| a.distance_squared(*b)).fold(0.0, f64::max);
        Ok(moved.sqrt() / self.diagonal)
    }
}

fn mean_edge(mesh: &TriMesh) -> f64 {
    let (edges, p) = (mesh.topology().edges(), &mesh.positions);
    let sum: f64 = edges.iter().map(|&[a, b]| p[a as usize].distance(p[b as usize])).sum();
    sum / edges.len().max(1) as f64
}
