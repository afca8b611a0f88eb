//! What is shown: positions in double precision for those who ask, and in single precision, with normals, for a GPU.

use std::cell::{Cell, OnceCell};
use std::ops::Range;

use glam::{DVec3, Vec3};
use pliant_mesh::ranges::{differing, widen};
use pliant_mesh::{NormalBuffer, Topology, VertexSet};
use rayon::prelude::*;

use super::Pose;

/// What leaves for a GPU: see [`Editor::display`](super::Editor::display).
#[derive(Debug, Clone, PartialEq)]
pub struct Frame<'a> {
    /// Where the shape's vertices are, in the shape's units.
    pub positions: &'a [Vec3],
    /// Their unit normals, the faces weighted by area; zero where there are none.
    pub normals: &'a [Vec3],
    /// Vertices out of this range have the position and the normal that they had in the frame before; all of the first frame are new.
    pub changed: Range<usize>,
}

/// The shape and the cage as they are shown. A drag writes single precision alone; double precision follows when it is asked for.
#[derive(Default)]
pub(crate) struct Shown {
    pub(crate) cage: Vec<DVec3>,
    /// Empty while only the single precision is up to date; then the editor can carry the cage's pose to it.
    shape: OnceCell<Vec<DVec3>>,
    /// The memory of the last one.
    spare: Cell<Vec<DVec3>>,
    /// Out of this range the shape is where the step began.
    pub(crate) displaced: Range<usize>,
    positions: Vec<Vec3>,
    /// Whether the single precision is still to be made of the double.
    behind: bool,
    normals: Vec<Vec3>,
    buffer: NormalBuffer,
    /// Where positions have changed since the last frame.
    changed: Range<usize>,
    /// Whether only vertices that the editor's region lets move have changed since the last frame.
    confined: bool,
}

/// Vertices that are worth a task.
const GRAIN: usize = 4096;

impl Shown {
    pub(crate) fn new(pose: &Pose) -> Self {
        let mut shown = Self { confined: true, ..Self::default() };
        shown.copy_from(pose);
        shown
    }

    /// Shows a pose in which a step begins.
    pub(crate) fn copy_from(&mut self, pose: &Pose) {
        let mut shape = self.shape.take().unwrap_or_else(|| self.spare.take());
        shape.clone_from(&pose.shape);
        self.shape = OnceCell::from(shape);
        self.cage.clone_from(&pose.cage);
        self.displaced = 0..0;
        self.behind = true;
    }

    /// Shows what was shown before, displaced in some range.
    pub(crate) fn restore(&mut self, pose: &Pose, displaced: Range<usize>) {
        self.copy_from(pose);
        self.displaced = displaced;
    }

    /// In double precision. `carry` writes it if only the single precision is up to date.
    pub(crate) fn shape(&self, carry: impl FnOnce(&mut Vec<DVec3>)) -> &[DVec3] {
        self.shape.get_or_init(|| {
            let mut shape = self.spare.take();
            carry(&mut shape);
            shape
        })
    }

    /// Where the next update writes; all of it is up to date, and what is in double precision no longer.
    pub(crate) fn write(&mut self) -> &mut [Vec3] {
        self.catch_up();
        if let Some(shape) = self.shape.take() {
            self.spare.set(shape);
        }
        &mut self.positions
    }

    /// Notes what an update has written; whether it was `confined` to the region of the editor.
    pub(crate) fn note(&mut self, changed: &Range<usize>, confined: bool) {
        widen(&mut self.changed, changed);
        widen(&mut self.displaced, changed);
        self.confined &= confined;
    }

    /// The editor's region is no longer the one that changes were confined to.
    pub(crate) fn unconfine(&mut self) {
        self.confined &= self.changed.is_empty();
    }

    /// Single precision of what is in double precision.
    fn catch_up(&mut self) {
        let Some(shape) = self.shape.get().filter(|_| self.behind) else { return };
        self.behind = false;
        if self.positions.len() != shape.len() {
            self.positions.resize(shape.len(), Vec3::NAN);
        }
        let range = differing(&self.positions, shape, |p, x| *p != x.as_vec3());
        let pairs = self.positions[range.clone()].par_iter_mut().zip(&shape[range.clone()]);
        pairs.with_min_len(GRAIN).for_each(|(p, x)| *p = x.as_vec3());
        self.confined &= range.is_empty();
        widen(&mut self.changed, &range);
    }

    /// Positions and normals; `near` has the vertices that may change as long as changes are confined to the region of the editor, and those
    /// next to them.
    pub(crate) fn frame(&mut self, topology: &Topology, near: Option<&VertexSet>) -> Frame<'_> {
        self.catch_up();
        let positions = &self.positions;
        let mut changed = std::mem::take(&mut self.changed);
        if self.normals.len() != positions.len() {
            self.normals.resize(positions.len(), Vec3::ZERO);
            changed = 0..positions.len();
            self.confined = false;
        }
        if !changed.is_empty() {
            if let Some(near) = near.filter(|_| self.confined) {
                NormalBuffer::compute_some(topology, positions, near, &mut self.normals);
                changed = with_ring(topology, &changed, near.as_slice().iter().copied());
            } else {
                self.buffer.compute(topology, positions, &mut self.normals);
                changed = with_ring(topology, &changed, 0..positions.len() as u32);
            }
        }
        self.confined = true;
        Frame { positions, normals: &self.normals, changed }
    }
}

/// The range that holds, of some vertices in increasing order, those in `range` or next to one in it.
fn with_ring(
    topology: &Topology,
    range: &Range<usize>,
    vertices: impl DoubleEndedIterator<Item = u32> + Clone,
) -> Range<usize> {
    let inside = |v: u32| range.contains(&(v as usize));
    let near = |v: &u32| inside(*v) || topology.neighbours(*v as usize).iter().any(|&w| inside(w));
    match (vertices.clone().find(near), vertices.rev().find(near)) {
        (Some(first), Some(last)) => first as usize..last as usize + 1,
        _ => range.clone(),
    }
}
