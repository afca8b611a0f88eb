//! One row of a binding at a time: which cage vertices a shape vertex follows, and how much.

use std::num::NonZero;

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use pliant_mesh::metrics::FaceTree;
use pliant_mesh::{Topology, TriMesh};

use crate::binding::BindOptions;
use crate::far_field::{self, FarField, View};
use crate::mean_value::{Corners, FaceWeights, MeanValue};
use crate::prune::{Prune, drop_smallest};

/// Makes rows for one cage and prune rule; shared by the threads.
pub(crate) struct RowMaker<'a> {
    coordinates: MeanValue,
    cage: &'a Topology,
    prune: Prune,
    /// Cage vertices in the coordinates' normal frame; `None` if there are none.
    vertices: Option<ImmutableKdTree<f64, 3>>,
    /// Cage faces in the same frame, for the local rule and for `far_field`.
    faces: Option<FaceTree>,
    /// For the magnitude rule, unless it is to be exact.
    far_field: Option<FarField>,
}

/// A thread's own working memory.
pub(crate) struct Scratch {
    dense: Vec<f64>,
    corners: Corners,
    far_field: far_field::Scratch,
    weights: Vec<f64>,
    /// The row made last: (cage vertex, weight), summing to 1, increasing by vertex.
    pub(crate) row: Vec<(u32, f64)>,
    /// Faces already looked at, marked with the current stamp.
    seen: Vec<u32>,
    stamp: u32,
    /// Where a nearest cage vertex stands in `row`, plus one.
    slot: Vec<u32>,
}

/// What had to be done to get a row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct RowFacts {
    /// The weights cancelled, so the row comes from the smooth rule.
    pub(crate) replaced: bool,
    /// How far the whole row (nothing dropped) is from linear precision, in units of the normal frame;
    /// 0 for rules that never form it.
    pub(crate) precision_error: f64,
}

/// A kept row whose weights sum to less than this share of their magnitudes cannot be scaled to sum 1.
const CANCELLED: f64 = 1e-9;

/// Below this share nearly every cage vertex may be kept, and groups gain nothing.
const LEAST_SHARE: f64 = 1e-4;

/// Neighbours for rows that have to be replaced under a rule that has no number of its own.
const REPLACEMENT_NEIGHBOURS: usize = 24;

impl<'a> RowMaker<'a> {
    pub(crate) fn new(cage: &'a TriMesh, options: &BindOptions) -> Self {
        let prune = options.prune;
        let coordinates = MeanValue::new(cage);
        let points: Vec<[f64; 3]> = coordinates.positions().iter().map(DVec3::to_array).collect();
        let grouped = matches!(prune, Prune::Magnitude(share) if share >= LEAST_SHARE) && !options.exact;
        let local = matches!(prune, Prune::Local { .. });
        Self {
            far_field: grouped.then(|| FarField::new(&coordinates, cage.topology())),
            vertices: ImmutableKdTree::new_from_slice(&points).ok(),
            faces: (local || grouped).then(|| FaceTree::new(coordinates.positions(), cage.triangles())),
            coordinates,
            cage: cage.topology(),
            prune,
        }
    }

    pub(crate) fn scratch(&self) -> Scratch {
        let vertices = self.cage.vertex_count();
        Scratch {
            dense: Vec::new(),
            corners: Corners::default(),
            far_field: far_field::Scratch::default(),
            weights: Vec::new(),
            row: Vec::new(),
            seen: vec![0; self.cage.triangles().len()],
            stamp: 0,
            slot: vec![0; vertices],
        }
    }

    /// Makes the row of a point of model space in `scratch.row`.
    pub(crate) fn make(&self, point: DVec3, scratch: &mut Scratch) -> RowFacts {
        let mut facts = RowFacts::default();
        let made = match self.prune {
            Prune::None => self.mean_value(point, 0.0, scratch, &mut facts),
            Prune::Magnitude(share) => self.mean_value(point, share, scratch, &mut facts),
            Prune::Local { neighbours } => self.local(point, neighbours, scratch),
            Prune::Smooth { neighbours } => self.smooth(point, neighbours, scratch),
        };
        if !made {
            facts.replaced = true;
            let neighbours = match self.prune {
                Prune::Local { neighbours } | Prune::Smooth { neighbours } => neighbours,
                Prune::None | Prune::Magnitude(_) => REPLACEMENT_NEIGHBOURS,
            };
            self.smooth(point, neighbours, scratch);
        }
        scratch.row.sort_unstable_by_key(|e| e.0);
        facts
    }

    /// All mean value coordinates less the smallest.
    fn mean_value(&self, point: DVec3, share: f64, scratch: &mut Scratch, facts: &mut RowFacts) -> bool {
        if let Some((field, faces)) = self.far_field.as_ref().zip(self.faces.as_ref()) {
            let x = self.coordinates.to_frame(point);
            let view = View { cage: &self.coordinates, topology: self.cage, x };
            let nearest = faces.nearest(x).map(|(face, _)| face as usize);
            if nearest.is_some_and(|f| field.row(view, f, share, &mut scratch.far_field, &mut scratch.row)) {
                return normalise(&mut scratch.row);
            }
        }
        scratch.dense.resize(self.cage.vertex_count(), 0.0);
        if !self.coordinates.coordinates_with(point, &mut scratch.dense, &mut scratch.corners) {
            return false;
        }
        let x = self.coordinates.to_frame(point);
        let reproduced: DVec3 = self.coordinates.positions().iter().zip(&scratch.dense).map(|(y, c)| *y * *c).sum();
        facts.precision_error = reproduced.distance(x);
        scratch.row.clear();
        scratch.row.extend(scratch.dense.iter().enumerate().map(|(j, c)| (j as u32, *c)));
        drop_smallest(&mut scratch.row, share);
        normalise(&mut scratch.row)
    }

    /// Half the positive part of the coordinates over the nearest cage vertices, fading out, and half distance weights; more of
    /// these where the nearest vertices hold only a part of the coordinates.
    ///
    /// Only weights of nearest vertices are needed, so just the faces round them are looked at, and the nearest face:
    /// in the middle of a large one, none of its corners may be among the nearest vertices. Of the normaliser, these faces give
    /// the sign, and an estimate good enough to tell how much of the coordinates the nearest vertices have.
    fn local(&self, point: DVec3, neighbours: usize, scratch: &mut Scratch) -> bool {
        let x = self.coordinates.to_frame(point);
        let fall_off = self.nearest(x, neighbours, scratch);
        for (at, (j, _)) in scratch.row.iter().enumerate() {
            scratch.slot[*j as usize] = at as u32 + 1;
        }
        let mut weights = std::mem::take(&mut scratch.weights);
        let others = self.sum_faces(x, scratch, &mut weights);
        for (j, _) in &scratch.row {
            scratch.slot[*j as usize] = 0;
        }
        let sign = if weights.iter().sum::<f64>() + others < 0.0 { -1.0 } else { 1.0 };
        let (mut faded, mut held, mut total, mut smooth) = (0.0, 0.0, (sign * others).max(0.0), 0.0);
        for (w, far) in weights.iter_mut().zip(&fall_off) {
            *w = (sign * *w).max(0.0);
            total += *w;
            held += *w * (FULL_CREDIT * far).min(1.0);
            *w *= far;
            faded += *w;
            smooth += far * far;
        }
        let from_vertex = 1.0 - fall_off.iter().copied().fold(0.0, f64::max);
        let share = match faded > 0.0 {
            true => BLEND * (held / (ENOUGH * total)).min(1.0) * (from_vertex / APART).min(1.0),
            false => 0.0,
        };
        for ((entry, w), far) in scratch.row.iter_mut().zip(&weights).zip(&fall_off) {
            let local = if share > 0.0 { share * w / faded } else { 0.0 };
            entry.1 = local + (1.0 - share) * far * far / smooth;
        }
        scratch.weights = weights;
        scratch.row.retain(|e| e.1 > 0.0);
        normalise(&mut scratch.row)
    }

    /// Unnormalised weights of the vertices in `scratch.row` over all faces round them and the nearest face; returns what
    /// these faces give to other vertices.
    fn sum_faces(&self, x: DVec3, scratch: &mut Scratch, weights: &mut Vec<f64>) -> f64 {
        weights.clear();
        weights.resize(scratch.row.len(), 0.0);
        let mut others = 0.0;
        scratch.stamp += 1;
        let nearest = self.faces.as_ref().and_then(|faces| faces.nearest(x)).map(|(face, _)| face);
        let round = scratch.row.iter().flat_map(|&(j, _)| self.cage.vertex_faces(j as usize).iter().copied());
        for f in nearest.into_iter().chain(round) {
            if scratch.seen[f as usize] == scratch.stamp {
                continue;
            }
            scratch.seen[f as usize] = scratch.stamp;
            let (values, on) = match self.coordinates.face_weights(x, f as usize) {
                FaceWeights::On(barycentric) => (barycentric, true),
                FaceWeights::Weights(values) => (values, false),
            };
            if on {
                weights.fill(0.0);
                others = 0.0;
            }
            for (v, value) in self.cage.triangles()[f as usize].into_iter().zip(values) {
                match scratch.slot[v as usize].checked_sub(1) {
                    Some(slot) => weights[slot as usize] += value,
                    None => others += value,
                }
            }
            if on {
                break;
            }
        }
        others
    }

    /// Distance weights alone.
    fn smooth(&self, point: DVec3, neighbours: usize, scratch: &mut Scratch) -> bool {
        let fall_off = self.nearest(self.coordinates.to_frame(point), neighbours, scratch);
        for (entry, far) in scratch.row.iter_mut().zip(fall_off) {
            entry.1 = far * far;
        }
        scratch.row.retain(|e| e.1 > 0.0);
        normalise(&mut scratch.row)
    }

    /// Puts the nearest cage vertices into `scratch.row`, nearest first, and returns `1 - d_j / d_(k+1)` for each.
    ///
    /// All 1 where all are equally far (the centre of a regular cage).
    fn nearest(&self, x: DVec3, neighbours: usize, scratch: &mut Scratch) -> Vec<f64> {
        scratch.row.clear();
        let (Some(tree), Some(wanted)) = (&self.vertices, NonZero::new(neighbours.saturating_add(1))) else {
            return Vec::new();
        };
        let wanted = wanted.min(NonZero::new(self.cage.vertex_count()).unwrap_or(NonZero::<usize>::MIN));
        let found = tree.query(&x.to_array()).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let mut found: Vec<(f64, u32)> = found.iter().map(|n| (n.distance.sqrt(), n.item)).collect();
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // Where all vertices are taken, as if the next one were a tenth farther than the last.
        let farthest = found.last().map_or(0.0, |n| 1.1 * n.0);
        let beyond = found.get(neighbours).map_or(farthest, |n| n.0);
        found.truncate(neighbours);
        scratch.row.extend(found.iter().map(|n| (n.1, 0.0)));
        let all_equal = found.first().is_some_and(|n| n.0 >= beyond);
        found.iter().map(|n| if all_equal { 1.0 } else { 1.0 - n.0 / beyond }).collect()
    }
}

/// A nearest vertex counts in full for what the local rule holds of the coordinates until its fall-off is below the
/// inverse of this; from there its credit fades, so that nothing jumps when the nearest ones change.
const FULL_CREDIT: f64 = 3.0;

/// Share of the coordinates that counts as all of them.
const ENOUGH: f64 = 0.95;

/// Share of a row given to coordinates where they are all held. Alone they follow each bend of the cage, and on thin parts
/// differ wildly from row to row; distance weights alone blur round shapes. Half of each is
/// better than either on nearly every model and scene tried, at two iterations and converged.
const BLEND: f64 = 0.5;

/// Distance to the nearest cage vertex, as a share of the distance to the first one left out, below which coordinates lose
/// their share again. Close to a cage vertex all of them go to it, and right beside it, across a fold of the cage, to another: an
/// edge far shorter than the cage's would be torn.
const APART: f64 = 0.1;

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
