//! Some vertices of the shape, carried along with the cage by themselves.

use std::ops::Range;

use glam::{DVec3, Vec3};
use pliant_cage::{Binding, Propagator};
use pliant_mesh::VertexSet;

use crate::snap::Place;

/// A precision that points are carried in.
pub(crate) trait Carried: Place {
    /// Writes to `after` where `before` goes as the cage goes from `from` to `to`.
    fn carry(
        propagator: &mut Propagator,
        binding: &Binding,
        from: &[DVec3],
        to: &[DVec3],
        before: &[Self],
        after: &mut [Self],
    );
}

impl Carried for DVec3 {
    fn carry(
        propagator: &mut Propagator,
        binding: &Binding,
        from: &[DVec3],
        to: &[DVec3],
        before: &[Self],
        after: &mut [Self],
    ) {
        after.copy_from_slice(before);
        propagator.carry(binding, from, to, after);
    }
}

impl Carried for Vec3 {
    fn carry(
        propagator: &mut Propagator,
        binding: &Binding,
        from: &[DVec3],
        to: &[DVec3],
        before: &[Self],
        after: &mut [Self],
    ) {
        propagator.carry_f32(binding, from, to, before, after);
    }
}

/// Some vertices of the shape.
pub(crate) struct Part {
    pub(crate) vertices: VertexSet,
    binding: Binding,
    /// In the order of the vertices: which share of the cage's motion each takes, less than 1 near the border of a region.
    shares: Vec<f64>,
}

impl Part {
    /// `shares` has those of all vertices of the shape; none if all are 1.
    pub(crate) fn new(binding: &Binding, vertices: VertexSet, shares: &[f64]) -> Self {
        let share = |v: u32| shares.get(v as usize).copied().unwrap_or(1.0);
        Self { binding: binding.part(&vertices), shares: vertices.iter().map(share).collect(), vertices }
    }

    /// Writes to `after` where the points `before` go, in the order of the vertices, as the cage goes from `from` to `to`.
    pub(crate) fn carry<P: Carried>(
        &self,
        propagator: &mut Propagator,
        from: &[DVec3],
        to: &[DVec3],
        before: &[P],
        after: &mut Vec<P>,
    ) {
        after.resize(before.len(), P::rounded(DVec3::ZERO));
        P::carry(propagator, &self.binding, from, to, before, after);
        for ((after, before), &share) in
            after.iter_mut().zip(before).zip(&self.shares).filter(|(_, share)| **share < 1.0)
        {
            let (begin, end) = (before.double(), after.double());
            *after = P::rounded(begin + share * (end - begin));
        }
    }

    /// [`Binding::reach`], in the numbers of the shape.
    pub(crate) fn reach(&self) -> Vec<Range<usize>> {
        let vertices = self.vertices.as_slice();
        let of_shape = |range: Range<usize>| match range.is_empty() {
            true => 0..0,
            false => vertices[range.start] as usize..vertices[range.end - 1] as usize + 1,
        };
        self.binding.reach().into_iter().map(of_shape).collect()
    }
}
