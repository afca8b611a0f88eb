//! One row of a binding at a time: which cage vertices a shape vertex follows, and how much.

use glam::DVec3;
use pliant_mesh::metrics::FaceTree;
use pliant_mesh::{Topology, TriMesh};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::binding::BindOptions;
use crate::face_terms::{Patch, View};
use crate::far_field::{self, FarField};
use crate::mean_value::{Corners, MeanValue};
use crate::packed::along_curve;
use crate::prune::{Prune, drop_smallest};
use crate::support::{Group, Near, Neighbourhoods, Whose, past_all};

/// Makes rows for points, one cage and prune rule; shared by the threads.
pub(crate) struct RowMaker<'a> {
    coordinates: MeanValue,
    cage: &'a Topology,
    prune: Prune,
    /// [`BindOptions::tiny`].
    tiny: f64,
    neighbourhoods: Neighbourhoods<'a>,
    /// The points, in the coordinates' normal frame.
    points: Vec<DVec3>,
    /// Cage faces in the same frame, for the local rule and for `far_field`.
    faces: Option<FaceTree>,
    /// For the magnitude rule, unless it is to be exact.
    far_field: Option<FarField>,
    arch: Arch,
}

/// A thread's own working memory.
#[derive(Default)]
pub(crate) struct Scratch {
    dense: Vec<f64>,
    corners: Corners,
    far_field: far_field::Scratch,
    group: Group,
    near: Vec<Near>,
    patch: Patch,
    /// The face nearest to the last point: where the search for the next one's starts.
    nearest: Option<u32>,
    /// The row made last: (cage vertex, weight), summing to 1, increasing by vertex.
    pub(crate) row: Vec<(u32, f64)>,
}

/// What had to be done to get rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct RowFacts {
    /// Rows whose weights cancelled and that come from the smooth rule instead.
    pub(crate) replaced: usize,
    /// How far whole rows (nothing dropped) are from linear precision at most, in units of the normal frame;
    /// 0 where none was formed.
    pub(crate) precision_error: f64,
    /// Rows of mean value coordinates that were made without forming the whole row.
    pub(crate) unmeasured: usize,
}

impl RowFacts {
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            replaced: self.replaced + other.replaced,
            precision_error: self.precision_error.max(other.precision_error),
            unmeasured: self.unmeasured + other.unmeasured,
        }
    }
}

/// A kept row whose weights sum to less than this share of their magnitudes cannot be scaled to sum 1.
pub(crate) const CANCELLED: f64 = 1e-9;

/// Below this share nearly every cage vertex may be kept, and groups gain nothing.
const LEAST_SHARE: f64 = 1e-4;

/// Neighbours for rows that have to be replaced under a rule that has no number of its own.
const REPLACEMENT_NEIGHBOURS: usize = 24;

impl<'a> RowMaker<'a> {
    /// `owners` as in [`Neighbourhoods::new`].
    pub(crate) fn new(points: &[DVec3], owners: Option<&[u32]>, cage: &'a TriMesh, options: &BindOptions) -> Self {
        let BindOptions { prune, support, smoothing, tiny, exact } = *options;
        let coordinates = MeanValue::new(cage);
        let points: Vec<DVec3> = points.par_iter().map(|p| coordinates.to_frame(*p)).collect();
        let (neighbours, owned) = match prune {
            Prune::Local { neighbours } | Prune::Smooth { neighbours } => (neighbours, &points[..]),
            Prune::None | Prune::Magnitude(_) => (0, &[][..]),
        };
        let most = neighbours.max(smoothing);
        let positions = coordinates.positions();
        let local = matches!(prune, Prune::Local { .. });
        let grouped = matches!(prune, Prune::Magnitude(share) if share >= LEAST_SHARE) && !exact;
        Self {
            far_field: grouped.then(|| FarField::new(&coordinates, cage.topology())),
            neighbourhoods: Neighbourhoods::new(cage.topology(), positions, owned, owners, most, support),
            faces: (local || grouped).then(|| FaceTree::new(positions, cage.triangles())),
            coordinates,
            points,
            cage: cage.topology(),
            prune,
            tiny,
            arch: Arch::new(),
        }
    }

    /// All points, in the order in which their rows are made fastest.
    pub(crate) fn order(&self) -> Vec<u32> {
        match self.prune {
            Prune::None => (0..self.points.len() as u32).collect(),
            // What is near one point is near the next.
            Prune::Magnitude(_) => along_curve(&self.points),
            Prune::Local { .. } | Prune::Smooth { .. } => self.neighbourhoods.order(),
        }
    }

    /// Makes the row of point `i` in `scratch.row`.
    pub(crate) fn make(&self, i: u32, scratch: &mut Scratch) -> RowFacts {
        let i = i as usize;
        let mut facts = RowFacts::default();
        let made = match self.prune {
            Prune::None => self.mean_value(self.points[i], 0.0, scratch, &mut facts),
            Prune::Magnitude(share) => self.mean_value(self.points[i], share, scratch, &mut facts),
            Prune::Local { neighbours } => self.local(i, neighbours, scratch),
            Prune::Smooth { neighbours } => {
                let whose = Whose::Point(i, self.points[i]);
                let beyond = self.neighbourhoods.find(whose, neighbours, &mut scratch.group, &mut scratch.near);
                smooth(&scratch.near, beyond, &mut scratch.row) && drop_tiny(self.tiny, &mut scratch.row)
            }
        };
        if !made {
            facts.replaced = 1;
            self.replace(self.points[i], scratch);
        }
        scratch.row.sort_unstable_by_key(|e| e.0);
        facts
    }

    /// Makes the row by which the motion of cage vertex `j` is averaged, in `scratch.row`.
    pub(crate) fn smooth_cage(&self, j: u32, neighbours: usize, scratch: &mut Scratch) {
        let whose = Whose::CageVertex(j);
        let beyond = self.neighbourhoods.find(whose, neighbours, &mut scratch.group, &mut scratch.near);
        if !(smooth(&scratch.near, beyond, &mut scratch.row) && drop_tiny(self.tiny, &mut scratch.row)) {
            scratch.row.clear();
            scratch.row.push((j, 1.0));
        }
        scratch.row.sort_unstable_by_key(|e| e.0);
    }

    /// All mean value coordinates less the smallest.
    fn mean_value(&self, x: DVec3, share: f64, scratch: &mut Scratch, facts: &mut RowFacts) -> bool {
        if let Some((field, faces)) = self.far_field.as_ref().zip(self.faces.as_ref()) {
            let view = View { cage: &self.coordinates, topology: self.cage, x };
            scratch.nearest = faces.nearest_from(x, scratch.nearest).map(|(face, _)| face);
            if scratch
                .nearest
                .is_some_and(|f| field.row(view, f as usize, share, &mut scratch.far_field, &mut scratch.row))
            {
                facts.unmeasured = 1;
                return normalise(&mut scratch.row);
            }
        }
        scratch.dense.resize(self.cage.vertex_count(), 0.0);
        if !self.coordinates.coordinates_with(x, &mut scratch.dense, &mut scratch.corners) {
            return false;
        }
        let reproduced: DVec3 = self.coordinates.positions().iter().zip(&scratch.dense).map(|(y, c)| *y * *c).sum();
        facts.precision_error = reproduced.distance(x);
        scratch.row.clear();
        scratch.row.extend(scratch.dense.iter().enumerate().map(|(j, c)| (j as u32, *c)));
        drop_smallest(&mut scratch.row, share);
        normalise(&mut scratch.row)
    }

    /// Distance weights of the nearest cage vertices in space, where coordinates cancel.
    fn replace(&self, x: DVec3, scratch: &mut Scratch) {
        let found = self.neighbourhoods.nearest_in_space(x, REPLACEMENT_NEIGHBOURS + 1, f64::INFINITY);
        let nearest = found.iter().take(REPLACEMENT_NEIGHBOURS);
        scratch.near.clear();
        scratch.near.extend(nearest.map(|&(distance, vertex)| Near { distance, vertex, trust: 1.0 }));
        let beyond = found.get(REPLACEMENT_NEIGHBOURS).map_or_else(|| past_all(&scratch.near), |next| next.0);
        smooth(&scratch.near, beyond, &mut scratch.row);
    }

    /// Half the positive part of the coordinates over the nearest cage vertices, fading out, and half distance weights; more of
    /// these where the nearest vertices hold only a part of the coordinates.
    ///
    /// Only weights of nearest vertices are needed, so just the faces round them are looked at, and the nearest face:
    /// in the middle of a large one, none of its corners may be among the nearest vertices. Of the normaliser, these faces give
    /// the sign, and an estimate good enough to tell how much of the coordinates the nearest vertices have.
    fn local(&self, i: usize, neighbours: usize, scratch: &mut Scratch) -> bool {
        let x = self.points[i];
        let beyond = self.neighbourhoods.find(Whose::Point(i, x), neighbours, &mut scratch.group, &mut scratch.near);
        if !smooth(&scratch.near, beyond, &mut scratch.row) {
            return false;
        }
        let nearest =
            self.faces.as_ref().and_then(|faces| faces.nearest_from(x, scratch.nearest)).map(|(face, _)| face);
        scratch.nearest = nearest;
        let view = View { cage: &self.coordinates, topology: self.cage, x };
        self.arch.dispatch(Weigh { patch: &mut scratch.patch, view, near: &scratch.near, nearest });
        let (weights, others) = scratch.patch.weights_mut();
        let sign = if weights.iter().sum::<f64>() + others < 0.0 { -1.0 } else { 1.0 };
        let (mut faded, mut held, mut total) = (0.0, 0.0, (sign * others).max(0.0));
        let mut from_vertex = 1.0_f64;
        for (w, near) in weights.iter_mut().zip(&scratch.near) {
            let far = fall_off(near, beyond);
            *w = (sign * *w).max(0.0);
            total += *w;
            held += *w * (FULL_CREDIT * far).min(1.0);
            *w *= far * near.trust;
            faded += *w;
            from_vertex = from_vertex.min(1.0 - far);
        }
        let share = match faded > 0.0 {
            true => BLEND * (held / (ENOUGH * total)).min(1.0) * (from_vertex / APART).min(1.0),
            false => 0.0,
        };
        if share > 0.0 {
            for (entry, w) in scratch.row.iter_mut().zip(weights) {
                entry.1 = share * *w / faded + (1.0 - share) * entry.1;
            }
        }
        drop_tiny(self.tiny, &mut scratch.row)
    }
}

/// What the faces round the vertices in `near`, and the nearest face, give to these, to be compiled for the processor's
/// vector registers.
struct Weigh<'a> {
    patch: &'a mut Patch,
    view: View<'a>,
    near: &'a [Near],
    nearest: Option<u32>,
}

impl WithSimd for Weigh<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.patch.clear();
        self.patch.weigh(simd, self.view, self.near.iter().map(|n| n.vertex), self.nearest);
    }
}

/// A nearest vertex counts in full for what the local rule holds of the coordinates until its fall-off is below the
/// inverse of this; from there its credit fades, so that nothing jumps when the nearest ones change.
const FULL_CREDIT: f64 = 3.0;

/// Share of the coordinates that counts as all of them.
const ENOUGH: f64 = 0.95;

/// Share of a row given to coordinates where they are all held. Alone they follow each bend of the cage, and on thin parts
/// differ wildly from row to row.
const BLEND: f64 = 0.5;

/// Distance to the nearest cage vertex, as a share of the distance to the first one left out, below which coordinates lose
/// their share again. Close to a cage vertex all of them go to it, and right beside it, across a fold of the cage, to another: an
/// edge far shorter than the cage's would be torn.
const APART: f64 = 0.1;

/// `1 - d_j / d_(k+1)`: 1 at a cage vertex, 0 where the row ends.
fn fall_off(near: &Near, beyond: f64) -> f64 {
    if beyond > 0.0 { 1.0 - near.distance / beyond } else { 1.0 }
}

/// Distance weights `(1 - d_j / d_(k+1))^2` of the nearest vertices times their trust, in the order given.
///
/// Equal weights where all are equally far (the centre of a regular cage).
fn smooth(near: &[Near], beyond: f64, row: &mut Vec<(u32, f64)>) -> bool {
    row.clear();
    row.extend(near.iter().map(|n| (n.vertex, fall_off(n, beyond).powi(2) * n.trust)));
    if row.iter().all(|e| e.1 <= 0.0) {
        row.iter_mut().zip(near).for_each(|(e, n)| e.1 = n.trust);
    }
    normalise(row)
}

/// Drops what is below the share `tiny` of the largest entry of a row that sums to 1, and scales the rest to sum 1.
fn drop_tiny(tiny: f64, row: &mut Vec<(u32, f64)>) -> bool {
    let largest = row.iter().map(|e| e.1).fold(0.0, f64::max);
    row.retain(|e| e.1 >= tiny * largest);
    normalise(row)
}

/// Scales a row to sum 1; `false` if its weights cancel or there are none.
fn normalise(row: &mut [(u32, f64)]) -> bool {
    let (sum, magnitude) = row.iter().fold((0.0, 0.0), |(s, m), e| (s + e.1, m + e.1.abs()));
    if !(sum.abs() > CANCELLED * magnitude && sum.is_finite()) {
        return false;
    }
    for entry in row {
        entry.1 /= sum;
    }
    true
}
