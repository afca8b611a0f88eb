//! How far two poses are apart as surfaces.

mod bound;
mod sample;

#[cfg(test)]
mod tests;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use self::bound::farthest;
use self::sample::Samples;
use super::{FaceTree, unit_scale};
use crate::Topology;

/// How exactly [`hausdorff`] measures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HausdorffOptions {
    /// How far, as a share of it, the largest distance found may be below the bound. Default: 0.01.
    pub tolerance: f64,
    /// Pieces of faces to split in two at most, for each side, until that is reached. Default: 2^14.
    pub limit: usize,
}

impl Default for HausdorffOptions {
    fn default() -> Self {
        Self { tolerance: 0.01, limit: 1 << 14 }
    }
}

/// Distances of the points of one surface to the nearest points of another, in units of the model.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct OneSidedDistance {
    /// The largest distance found: some point is as far.
    pub max: f64,
    /// A bound: no point is farther.
    pub bound: f64,
    /// Mean over the area of the surface.
    pub mean: f64,
    /// Root of the mean square over its area.
    pub rms: f64,
    /// Samples whose search for the nearest point was cut short, so that mean and root mean square may be too large. 0 but where the
    /// other surface is crumpled: where faces are large compared to how far they are apart.
    pub unproven: usize,
}

/// Distances between two surfaces, both ways.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct HausdorffDistance {
    /// Of the first surface to the second.
    pub there: OneSidedDistance,
    /// Of the second to the first.
    pub back: OneSidedDistance,
}

impl HausdorffDistance {
    /// The Hausdorff distance as far as it was found: the larger of both largest distances.
    pub fn max(&self) -> f64 {
        super::largest([self.there.max, self.back.max])
    }

    /// What the Hausdorff distance does not exceed.
    pub fn bound(&self) -> f64 {
        super::largest([self.there.bound, self.back.bound])
    }

    /// The larger of both mean distances.
    pub fn mean(&self) -> f64 {
        super::largest([self.there.mean, self.back.mean])
    }

    /// The larger of both root mean squares.
    pub fn rms(&self) -> f64 {
        super::largest([self.there.rms, self.back.rms])
    }
}

/// Distances between two poses of a mesh as surfaces, whichever points of the mesh come to lie next to each other.
///
/// The largest is that of all points, not of the vertices alone: it lies between `max`, the exact distance of some point, and `bound`, at most
/// `options.tolerance` above it unless `options.limit` was reached. Faces and pieces of them are split until no piece can hold a point
/// that is farther off (branch and bound, as in Tang, Lee and Kim, "Interactive Hausdorff Distance Computation for General Polygonal
/// Models", 2009, section 4): the distance to one face of the other surface is convex, so that over a piece it is largest at a corner, and
/// so is the distance between the two poses of a point. The limit is reached where surfaces lie nearly on each other, edges across faces;
/// then the bound is still below the farthest that a vertex of these faces moved.
///
/// Mean and root mean square are integrals by the distances at the corners of each face (a twelfth each) and its centroid (three quarters),
/// which is exact for distances and squares of distances that are quadratic over the face. Where points are so much closer to each other
/// than to the other surface that it makes no more difference than `options.tolerance`, one search serves them all. On a surface without area all
/// faces weigh the same.
///
/// Meshes may be open or not manifold; vertices without faces do not count. All 0 without faces, all NaN if a position that a face uses is not
/// finite. `O(n log n)` on surfaces of `n` faces: for each side a search for each vertex, each face and twice for each split, of which none
/// looks at more than 2048 parts of a tree, as it would on a crumpled surface ([`OneSidedDistance::unproven`]). Parallel; the same bits for
/// any number of threads.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn hausdorff(topology: &Topology, a: &[DVec3], b: &[DVec3], options: &HausdorffOptions) -> HausdorffDistance {
    let triangles = topology.triangles();
    let is_finite = |pose: &[DVec3]| triangles.iter().flatten().all(|v| pose[*v as usize].is_finite());
    if !is_finite(a) || !is_finite(b) {
        let nan = OneSidedDistance { max: f64::NAN, bound: f64::NAN, mean: f64::NAN, rms: f64::NAN, unproven: 0 };
        return HausdorffDistance { there: nan, back: nan };
    }
    let scale = unit_scale(topology, a).min(unit_scale(topology, b));
    let [a, b] = [a, b].map(|pose| Surface::new(topology, pose, scale));
    let tolerance = options.tolerance.max(0.0);
    let one_sided = |own: &Surface, other: &Surface| {
        let samples = Samples::new(own, other, tolerance);
        let (max, bound) = farthest(own, other, &samples, tolerance, options.limit);
        let (mean, rms) = samples.means(own);
        OneSidedDistance {
            max: max / scale,
            bound: bound / scale,
            mean: mean / scale,
            rms: rms / scale,
            unproven: samples.unproven(),
        }
    };
    HausdorffDistance { there: one_sided(&a, &b), back: one_sided(&b, &a) }
}

/// A pose in units in which squares of distances neither over- nor underflow.
struct Surface<'a> {
    triangles: &'a [[u32; 3]],
    positions: Vec<DVec3>,
    tree: FaceTree,
}

impl<'a> Surface<'a> {
    fn new(topology: &'a Topology, pose: &[DVec3], scale: f64) -> Self {
        let positions: Vec<DVec3> = pose[..topology.vertex_count()].iter().map(|p| *p * scale).collect();
        let tree = FaceTree::new(&positions, topology.triangles());
        Self { triangles: topology.triangles(), positions, tree }
    }

    /// Corners of a face.
    fn corners(&self, face: usize) -> [DVec3; 3] {
        self.triangles[face].map(|v| self.positions[v as usize])
    }
}
