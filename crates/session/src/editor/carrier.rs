//! From a pose of the cage to what is shown: the shape carried along, kept outside the region, hard handles on their goals.

use std::cell::Cell;
use std::ops::Range;

use glam::{DVec3, Vec3};
use pliant_cage::{Binding, Propagator};
use pliant_mesh::ranges::widen;
use pliant_mesh::{VertexSet, select};

use super::aims::{Aims, differs};
use super::part::{Carried, Part};
use super::shown::Shown;
use super::{Editor, EditorHandle, Pose};
use crate::snap::Fade;

/// The shape's binding to the cage, and how far each cage vertex reaches ([`Binding::reach`]).
pub(crate) struct Bound {
    pub(crate) binding: Binding,
    reach: Vec<Range<usize>>,
}

impl Bound {
    pub(crate) fn new(binding: Binding) -> Self {
        Self { reach: binding.reach(), binding }
    }
}

/// What depends on the region, the handles and where the step began.
pub(crate) struct Carrier {
    /// The vertices that may move; `None` if all may.
    region: Option<Confined>,
    /// Where the vertices that may move are when the step begins.
    begin: Vec<Vec3>,
    /// Where they went last.
    after: Vec<Vec3>,
    aims: Aims,
    fade: Fade,
    /// Whether it has shown nothing yet, so that vertices outside its region may be elsewhere than where the step began.
    fresh: bool,
    /// How it was shown last.
    snapped: Snapped,
    scratch: Cell<Scratch>,
}

/// A region that is not everything.
struct Confined {
    part: Part,
    reach: Vec<Range<usize>>,
    /// The region and the vertices next to it: those whose normals may change.
    near: VertexSet,
}

/// How hard handles were set.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Snapped {
    /// Largest distance by which the cage alone missed a goal.
    pub(crate) by: f64,
    /// Largest distance by which the shape misses one.
    pub(crate) missed: f64,
}

/// From where a step began to a pose of the cage.
#[derive(Clone, Copy)]
pub(crate) struct Posed<'a> {
    pub(crate) bound: &'a Bound,
    pub(crate) base: &'a Pose,
    pub(crate) cage: &'a [DVec3],
}

/// Memory that is kept.
#[derive(Default)]
struct Scratch {
    propagator: Propagator,
    targets: Vec<DVec3>,
    moved: Vec<DVec3>,
}

impl Carrier {
    /// `shares` are those of [`Part::new`]; `width` is that of the strip in which a handle's last correction fades.
    pub(crate) fn new(editor: &Editor, shares: &[f64], width: f64) -> Self {
        let (topology, base) = (editor.rest.topology(), &editor.base.shape);
        let region = editor.region().map(|region| {
            let part = Part::new(&editor.bound.binding, region.clone(), shares);
            let near = select::grow(topology, region, 1).unwrap_or_else(|_| region.clone());
            Confined { reach: part.reach(), part, near }
        });
        let aims = Aims::new(editor);
        let mut set = vec![false; base.len()];
        aims.vertices.iter().for_each(|&v| set[v as usize] = true);
        let may_move = |v: u32| !set[v as usize] && editor.may_move(v);
        let fade = Fade::new(topology, base, aims.vertices.clone(), width, may_move);
        let begin = match editor.region() {
            None => base.iter().map(|p| p.as_vec3()).collect(),
            Some(region) => region.iter().map(|v| base[v as usize].as_vec3()).collect(),
        };
        let (snapped, scratch) = (Snapped::default(), Cell::default());
        Self { region, begin, after: Vec::new(), aims, fade, fresh: true, snapped, scratch }
    }

    pub(crate) fn aims(&self) -> &Aims {
        &self.aims
    }

    /// The vertices whose normals may change; `None` for all.
    pub(crate) fn near(&self) -> Option<&VertexSet> {
        self.region.as_ref().map(|region| &region.near)
    }

    /// Shows a pose of the cage, in single precision; the range of vertices that this moves.
    pub(crate) fn show(
        &mut self,
        shown: &mut Shown,
        posed: Posed<'_>,
        handles: &[EditorHandle],
    ) -> (Range<usize>, Snapped) {
        let base = &posed.base.shape;
        let reach = self.region.as_ref().map_or(&posed.bound.reach, |region| &region.reach);
        let mut carried = 0..0;
        for ((from, to), reach) in shown.cage.iter().zip(posed.cage).zip(reach) {
            if differs(*from, *to) {
                widen(&mut carried, reach);
            }
        }
        let mut changed = self.aims.set(handles, posed.base, &self.fade);
        widen(&mut changed, &self.aims.touched(&carried, &self.fade));
        widen(&mut changed, &carried);
        let left = if std::mem::take(&mut self.fresh) { shown.displaced.clone() } else { 0..0 };
        widen(&mut changed, &left);
        if !changed.is_empty() {
            let shape = shown.write();
            for (p, begin) in shape[left.clone()].iter_mut().zip(&base[left.clone()]) {
                *p = begin.as_vec3();
            }
            let mut after = std::mem::take(&mut self.after);
            self.snapped = self.carry(posed, &self.begin, &mut after, shape);
            self.after = after;
            shown.note(&changed, self.region.is_some() && left.is_empty());
        }
        shown.cage.copy_from_slice(posed.cage);
        (changed, self.snapped)
    }

    /// Takes over the goals of the handles, as [`Self::show`] does.
    pub(crate) fn aim(&mut self, handles: &[EditorHandle], base: &Pose) {
        self.aims.set(handles, base, &self.fade);
    }

    /// Writes the shape for a pose of the cage in double precision, with the goals that were taken over last.
    pub(crate) fn write(&self, posed: Posed<'_>, shape: &mut Vec<DVec3>) -> Snapped {
        let base = &posed.base.shape;
        shape.clone_from(base);
        match &self.region {
            None => self.carry(posed, base, &mut Vec::new(), shape),
            Some(region) => {
                let before: Vec<DVec3> = region.part.vertices.iter().map(|v| base[v as usize]).collect();
                self.carry(posed, &before, &mut Vec::new(), shape)
            }
        }
    }

    /// Carries `before`, the vertices that may move, and sets handles on their goals. `after` is memory that is kept.
    fn carry<P: Carried>(&self, posed: Posed<'_>, before: &[P], after: &mut Vec<P>, shape: &mut [P]) -> Snapped {
        let mut scratch = self.scratch.take();
        let (from, to, propagator) = (&posed.base.cage, posed.cage, &mut scratch.propagator);
        match &self.region {
            None => P::carry(propagator, &posed.bound.binding, from, to, before, shape),
            Some(Confined { part, .. }) => {
                part.carry(propagator, from, to, before, after);
                for (p, v) in after.iter().zip(part.vertices.iter()) {
                    shape[v as usize] = *p;
                }
            }
        }
        let missed = self.aims.targets(shape, &mut scratch.targets);
        let by = self.fade.apply(&scratch.targets, &mut scratch.moved, shape);
        self.scratch.set(scratch);
        Snapped { by, missed }
    }
}
