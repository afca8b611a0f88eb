use glam::DVec3;
use rayon::prelude::*;

use super::Surface;
use super::sample::{PARTS, Samples, centroid};
use crate::metrics::{FaceTree, closest_on_triangle, largest};

/// A part of a face.
#[derive(Clone, Copy)]
struct Piece {
    corners: [DVec3; 3],
    /// A face of the other surface near the middle.
    near: u32,
    /// No point of the piece is farther from the other surface.
    bound: f64,
}

/// Pieces that are split before it is looked anew which are the farthest.
const BATCH: usize = 1024;

/// The largest distance that was found of a point of one surface to the other, and a bound of all such distances. Those pieces that may hold
/// the farthest points are split until both are within `tolerance`, as a share of the first, or `limit` splits are done.
pub(super) fn farthest(own: &Surface, other: &Surface, samples: &Samples, tolerance: f64, limit: usize) -> (f64, f64) {
    let Some(mut most) = samples.max(own, &other.tree) else {
        return (0.0, 0.0);
    };
    // What rounding alone may put between a distance and its bound.
    let rounding = 4.0 * (own.tree.rounding() + other.tree.rounding());
    let enough = |most: f64| most + (tolerance * most).max(rounding);
    let (mut pieces, mut bound) = open_faces(own, other, samples, most, enough(most), limit);
    let mut left = limit;
    while !pieces.is_empty() && left > 0 {
        let count = BATCH.min(left).min(pieces.len());
        if count < pieces.len() {
            pieces.select_nth_unstable_by(count, |p, q| q.bound.total_cmp(&p.bound));
        }
        let halves: Vec<(Piece, f64)> = pieces[..count]
            .par_iter()
            .flat_map_iter(|piece| piece.halves().map(|half| half.measured(&other.tree, enough(most))))
            .collect();
        left -= count;
        most = halves.iter().fold(most, |most, (_, distance)| most.max(*distance));
        pieces.drain(..count);
        pieces.extend(halves.into_iter().map(|(half, _)| half));
        pieces.retain(|piece| {
            let is_open = piece.bound > enough(most);
            if !is_open {
                bound = bound.max(piece.bound);
            }
            is_open
        });
    }
    (most, pieces.iter().fold(bound.max(most), |bound, piece| bound.max(piece.bound)))
}

/// The faces that may hold points farther than `enough`, the farthest `limit` of them, and a bound of all others and of `most`.
fn open_faces(
    own: &Surface,
    other: &Surface,
    samples: &Samples,
    most: f64,
    enough: f64,
    limit: usize,
) -> (Vec<Piece>, f64) {
    let faces = (0..own.triangles.len()).into_par_iter();
    let bounds: Vec<f64> = faces.map(|face| face_bound(own, other, samples, face, most)).collect();
    let mut open: Vec<usize> = (0..bounds.len()).filter(|face| bounds[*face] > enough).collect();
    if open.len() > limit {
        // Not more of them can be split, and once all of these need not be, neither do the others.
        open.select_nth_unstable_by(limit, |f, g| bounds[*g].total_cmp(&bounds[*f]).then(f.cmp(g)));
        open.truncate(limit);
    }
    let whole =
        |&face: &usize| Piece { corners: own.corners(face), near: samples.centroids[face].face, bound: bounds[face] };
    let pieces = open.iter().map(whole).collect();
    let mut others = bounds;
    open.into_iter().for_each(|face| others[face] = 0.0);
    (pieces, largest(others).max(most))
}

/// What the distance of no point of a face exceeds; only roughly where that is at most `most`, the largest distance known.
fn face_bound(own: &Surface, other: &Surface, samples: &Samples, face: usize, most: f64) -> f64 {
    let corners = own.corners(face);
    let (centre, near) = (centroid(corners), samples.centroids[face]);
    let rough = near.distance + largest(corners.map(|p| p.distance(centre)));
    if rough <= most {
        return rough;
    }
    // The same point of the other pose is no farther than it moved: convex again.
    let twins = other.corners(face);
    let moved = largest([0, 1, 2].map(|k| corners[k].distance(twins[k])));
    let near = samples.corners(own.triangles[face]).into_iter().chain([near]);
    near.map(|near| to_face(corners, &other.tree, near.face)).fold(rough.min(moved), f64::min)
}

/// The largest distance of a point of a triangle to a face: as the distance to a convex set is convex, that of a corner.
fn to_face(corners: [DVec3; 3], tree: &FaceTree, face: u32) -> f64 {
    let face = tree.corners(face);
    largest(corners.map(|p| p.distance(closest_on_triangle(p, face))))
}

impl Piece {
    /// Both parts of the piece, split across its longest edge.
    fn halves(&self) -> [Self; 2] {
        let length = |k: usize| self.corners[k].distance_squared(self.corners[(k + 1) % 3]);
        let longest = (1..3).fold(0, |longest, k| if length(k) > length(longest) { k } else { longest });
        let ends = [longest, (longest + 1) % 3];
        let middle = 0.5 * (self.corners[ends[0]] + self.corners[ends[1]]);
        ends.map(|end| {
            let mut half = *self;
            half.corners[end] = middle;
            half
        })
    }

    /// The piece with a bound of its own, and the distance of its centroid: 0 where it was not found in time, or the bound is at most
    /// `enough` without it.
    fn measured(mut self, other: &FaceTree, enough: f64) -> (Self, f64) {
        self.bound = self.bound.min(to_face(self.corners, other, self.near));
        if self.bound <= enough {
            return (self, 0.0);
        }
        let Some(found) = other.nearest_within(centroid(self.corners), Some(self.near), PARTS) else {
            return (self, 0.0);
        };
        self.near = found.face;
        self.bound = self.bound.min(to_face(self.corners, other, found.face));
        (self, if found.is_proven { found.distance } else { 0.0 })
    }
}
