//! Where a surface passes through itself.

mod in_order;
mod triangles;

#[cfg(test)]
mod tests;

use std::cell::Cell;
use std::sync::atomic::Ordering;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::in_order::in_order;
use self::triangles::{are_folded, flat_axis, meet, meet_beyond_corner};
use super::{FaceTree, unit_scale};
use crate::Topology;

/// How far [`self_intersections`] goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IntersectionOptions {
    /// Most pairs to list. Default: 0.
    pub listed: usize,
    /// Work after which to stop with what was found until then: to compare two boxes counts 1, to compare two faces 16 more; 10^8 take about
    /// a second. Default (`None`): 2^26, and 2^11 for each face, which is ten times what surfaces without intersections take.
    pub limit: Option<u64>,
}

/// Pairs of faces of a surface that intersect.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SelfIntersections {
    /// Pairs without a vertex in common that have a point in common.
    pub apart: u64,
    /// Pairs with one vertex in common that have another point in common.
    pub at_vertices: u64,
    /// Pairs with two vertices in common that are folded flat onto each other, and pairs with the same three.
    pub at_edges: u64,
    /// Whether all pairs were compared; if not, there are at least as many of each kind.
    pub complete: bool,
    /// Faces that were left out because they have no area.
    pub without_area: usize,
    /// Faces that were left out because a corner is not finite.
    pub not_finite: usize,
    /// Some of the pairs, as many as were asked for: the lower face first, in increasing order.
    pub listed: Vec<[u32; 2]>,
}

impl SelfIntersections {
    /// Pairs of any kind.
    pub fn pairs(&self) -> u64 {
        self.apart + self.at_vertices + self.at_edges
    }
}

/// Counts the pairs of faces of a pose that intersect, each pair once.
///
/// Faces are closed triangles: to touch is to intersect. What two faces share by their vertices' numbers does not count: faces with one
/// vertex in common intersect if they have a point besides it in common, and faces with an edge in common if they are folded flat onto each
/// other. Vertices with other numbers are others, even at the same place. Every answer is exact for the positions as they are, without a
/// tolerance (but coordinates below 2^-600 of the largest are taken for 0). Faces without area are left out; what they pass through, faces
/// next to them reach too.
///
/// Meshes may be open or not manifold. `O((n + k) log n)` on ordinary surfaces of `n` faces, of which `k` pairs have boxes that meet,
/// and never more than `options.limit`: a pose crumpled into a point has `n^2 / 2` such pairs. Memory is linear in `n`. Parallel, with the
/// same result for any number of threads, a limit that was reached included.
///
/// # Panics
/// If `pose` is shorter than the number of vertices.
pub fn self_intersections(topology: &Topology, pose: &[DVec3], options: &IntersectionOptions) -> SelfIntersections {
    let limit = options.limit.unwrap_or((1 << 26) + ((topology.triangles().len() as u64) << 11));
    let (soup, mut found) = Soup::new(topology, pose);
    let (mut work, mut chunks) = (0_u64, Vec::new());
    in_order(
        soup.tree.order().len().div_ceil(CHUNK),
        |chunk, is_over| soup.compare(chunk, limit, || is_over.load(Ordering::Relaxed), |_| ()),
        |chunk, tally| {
            let [none, one, more] = tally.pairs;
            (found.apart, found.at_vertices, found.at_edges) =
                (found.apart + none, found.at_vertices + one, found.at_edges + more);
            if tally.pairs != [0; 3] && chunks.len() < options.listed {
                chunks.push(chunk);
            }
            work = work.saturating_add(tally.work);
            found.complete = work <= limit;
            found.complete
        },
    );
    // Pairs are looked for again where there are some: lists of all chunks that are done before their turn could be long.
    let left = Cell::new(options.listed);
    for chunk in chunks {
        soup.compare(
            chunk,
            limit,
            || left.get() == 0,
            |pair| {
                if left.get() > 0 {
                    left.set(left.get() - 1);
                    found.listed.push(pair);
                }
            },
        );
    }
    found.listed.sort_unstable();
    found
}

/// Faces that a thread compares with all to their right at a time.
const CHUNK: usize = 256;

/// Work of comparing two faces, in comparisons of boxes.
const FACES: u64 = 16;

/// The faces that can be compared.
struct Soup<'a> {
    topology: &'a Topology,
    tree: FaceTree,
    /// Number of each face of the tree in the mesh.
    numbers: Vec<u32>,
    /// An axis along which each face of the tree is seen to have an area.
    axes: Vec<u8>,
}

/// What comparing some faces has found and cost.
#[derive(Default)]
struct Tally {
    /// Pairs that intersect, by the number of vertices they have in common (0, 1 or more).
    pairs: [u64; 3],
    work: u64,
}

impl<'a> Soup<'a> {
    /// The faces, and a result that counts those left out.
    fn new(topology: &'a Topology, pose: &[DVec3]) -> (Self, SelfIntersections) {
        // Coordinates below 2^300 whose last digit is above 2^-353, so that no product of three over- or underflows, exact to its last digit.
        const MOST: f64 = f64::from_bits((1023 + 299) << 52);
        const LEAST: f64 = f64::from_bits((1023 - 300) << 52);
        let scale = unit_scale(topology, pose);
        let settle = |x: f64| if (x * scale * MOST).abs() < LEAST { 0.0 } else { x * scale * MOST };
        let positions: Vec<DVec3> = pose[..topology.vertex_count()]
            .par_iter()
            .map(|p| DVec3::new(settle(p.x), settle(p.y), settle(p.z)))
            .collect();
        let corners = |face: &[u32; 3]| face.map(|v| positions[v as usize]);
        let triangles = topology.triangles();
        let is_finite = |face: &[u32; 3]| corners(face).iter().all(|p| p.is_finite());
        let axes: Vec<Option<usize>> =
            triangles.par_iter().map(|face| if is_finite(face) { flat_axis(corners(face)) } else { None }).collect();
        let numbers: Vec<u32> = (0..triangles.len() as u32).filter(|f| axes[*f as usize].is_some()).collect();
        let kept: Vec<[u32; 3]> = numbers.iter().map(|f| triangles[*f as usize]).collect();
        let not_finite = triangles.par_iter().filter(|face| !is_finite(face)).count();
        let soup = Self {
            topology,
            tree: FaceTree::new(&positions, &kept),
            axes: axes.into_iter().flatten().map(|axis| axis as u8).collect(),
            numbers,
        };
        let without_area = triangles.len() - kept.len() - not_finite;
        (soup, SelfIntersections { complete: true, without_area, not_finite, ..SelfIntersections::default() })
    }

    /// Compares the faces of a chunk with those to their right until all is done, `limit` is exceeded or `is_over`; hands pairs that
    /// intersect to `list`.
    fn compare(&self, chunk: usize, limit: u64, is_over: impl Fn() -> bool, mut list: impl FnMut([u32; 2])) -> Tally {
        let mut tally = Tally::default();
        let order = self.tree.order();
        for (place, &f) in order.iter().enumerate().skip(CHUNK * chunk).take(CHUNK) {
            if tally.work > limit || is_over() {
                break;
            }
            let Tally { pairs, work } = &mut tally;
            let boxes = self.tree.for_each_meeting(place, |g| {
                *work += FACES;
                if let Some(shared) = self.intersect(f, g) {
                    pairs[shared.min(2)] += 1;
                    let [f, g] = [f, g].map(|face| self.numbers[face as usize]);
                    list([f.min(g), f.max(g)]);
                }
            });
            tally.work += boxes;
        }
        tally
    }

    /// The number of vertices that two faces of the tree have in common, if they intersect.
    fn intersect(&self, f: u32, g: u32) -> Option<usize> {
        let axis = usize::from(self.axes[f as usize]);
        let [own, others] = [f, g].map(|face| self.topology.triangles()[self.numbers[face as usize] as usize]);
        let [mut s, mut t] = [f, g].map(|face| self.tree.corners(face));
        // Where each vertex of `f` is among those of `g`.
        let twins = own.map(|v| others.iter().position(|w| *w == v));
        let shared = twins.iter().flatten().count();
        let intersect = match shared {
            0 => meet(s, t, axis),
            1 => {
                s.rotate_left(twins.iter().position(Option::is_some)?);
                t.rotate_left(*twins.iter().flatten().next()?);
                meet_beyond_corner(s, t, axis)
            }
            2 => {
                let third = twins.iter().position(Option::is_none)?;
                let other = 3 - twins.iter().flatten().sum::<usize>();
                are_folded([s[(third + 1) % 3], s[(third + 2) % 3]], s[third], t[other], axis)
            }
            _ => true,
        };
        intersect.then_some(shared)
    }
}
