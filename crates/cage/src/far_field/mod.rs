//! Rows of the magnitude rule without looking at the whole cage.
//!
//! What the rule drops counts only as a sum of magnitudes, so far vertices are summed in groups: the tree of fast winding
//! numbers (Barill, Dickson, Schmidt, Levin and Jacobson 2018) with the kernel `N . r / |r|^4` of mean value coordinates, Taylor terms to
//! degree 2, and two things that a cut needs beside the sum: how far it may be from the sum of the magnitudes, where signs
//! differ, and a bound on the largest weight, which might be kept. Vertices too near for their own Taylor terms are
//! summed exactly, face by face.
//!
//! Every row ends with the check that its cut holds in spite of all errors made. If it does not, the row is made again with
//! smaller ones, and at last left to the exact path.

mod descent;
mod moments;
mod pack;
#[cfg(test)]
mod tests;

use glam::DVec3;
use pliant_mesh::Topology;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use crate::face_terms::{Patch, View};
use crate::mean_value::MeanValue;
use crate::prune::{drop_smallest, drop_within, magnitude};
use descent::{Descent, Limits, Rest};
use moments::{Moments, Surface};
use pack::{Dipoles, Pack, WIDTH};

/// Cage vertices in a tree eight wide.
pub(crate) struct FarField {
    /// The vertices in such an order that each run of 8, 64, 512, ... lies close together; padded to whole packs.
    order: Vec<u32>,
    /// Lowest first: group `i` of level 0 is vertex `order[i]`, of a higher level pack `i` of the one below.
    levels: Vec<Vec<Pack>>,
    /// Level 0 in brief.
    dipoles: Vec<Dipoles>,
    arch: Arch,
}

/// A thread's own working memory.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    descent: Descent,
    /// Exact weights of the vertices in `descent.near`.
    patch: Patch,
}

/// A row may be made this often before it is left to the exact path: rarely more than twice.
const TRIES: usize = 6;

/// Errors are made this much smaller if they allow another cut.
const FINER: f64 = 0.3;

/// Errors that would have to be smaller by this make nearly every vertex near: the weights nearly cancel.
const HOPELESS: f64 = 1e-3;

/// A cut closer than this to another one, in shares of the row's magnitude, may be that other one.
const TIE: f64 = 1e-4;

/// Largest error of a kept weight, once scaled.
const WEIGHT_ERROR: f64 = 5e-5;

/// Share of the sum of errors of kept weights that is taken for the error of the weights' sum.
const SUM_BIAS: f64 = 0.3;

/// What a try at a row came to.
enum Cut {
    Holds,
    /// A vertex that was not listed may have to be kept: look for all from this weight on.
    Below(f64),
    /// The errors allow another cut, or are too large for the weights that are left: make them this much smaller.
    Unsure(f64),
}

impl FarField {
    /// Sorts a cage's vertices into a tree: about 10 us a vertex.
    pub(crate) fn new(cage: &MeanValue, topology: &Topology) -> Self {
        let surface = Surface { positions: cage.positions(), normals: cage.normals(), topology };
        let mut order: Vec<u32> = (0..topology.vertex_count() as u32).collect();
        arrange(&mut order, surface.positions);
        let (mut levels, mut dipoles) = (Vec::new(), Vec::new());
        let mut size = 1;
        loop {
            let groups: Vec<Moments> = order.par_chunks(size).map(|group| Moments::of(&surface, group)).collect();
            levels.push(groups.chunks(WIDTH).map(Pack::new).collect::<Vec<_>>());
            if size == 1 {
                dipoles = groups.chunks(WIDTH).map(Dipoles::new).collect();
            }
            if groups.len() <= WIDTH {
                break;
            }
            size *= WIDTH;
        }
        order.resize(order.len().next_multiple_of(WIDTH), 0);
        Self { order, levels, dipoles, arch: Arch::new() }
    }

    /// Makes the row of `x` (normal frame) into `row`: what is kept, not yet scaled, in no particular order.
    ///
    /// `nearest` is the face nearest to the point. Weights are within 1e-4 of the exact ones once scaled, and the
    /// cut is the exact one or within 1e-4 of the row's magnitude of it. Returns `false` if the row has to be made exactly.
    pub(crate) fn row(
        &self,
        view: View<'_>,
        nearest: usize,
        share: f64,
        scratch: &mut Scratch,
        row: &mut Vec<(u32, f64)>,
    ) -> bool {
        self.arch.dispatch(MakeRow { field: self, view, nearest, share, scratch, row })
    }
}

/// One row, to be compiled for the processor's vector registers with all that is inlined into it.
struct MakeRow<'a> {
    field: &'a FarField,
    view: View<'a>,
    nearest: usize,
    share: f64,
    scratch: &'a mut Scratch,
    row: &'a mut Vec<(u32, f64)>,
}

impl WithSimd for MakeRow<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { field, view, nearest, share, scratch: Scratch { descent, patch }, row } = self;
        // The nearest face's corners have most of the row's magnitude, or at least a good part.
        descent.near.clear();
        descent.near.extend(view.topology.triangles()[nearest]);
        patch.clear();
        let mut limits = None;
        for _ in 0..TRIES {
            let rest = limits.map(|limits| descent.sum(simd, field, view.x, limits));
            if let Some((face, barycentric)) = patch.weigh(simd, view, descent.near.iter().copied(), None) {
                row.clear();
                row.extend(view.topology.triangles()[face as usize].into_iter().zip(barycentric));
                drop_smallest(row, share);
                return true;
            }
            let Some((rest, known)) = rest.zip(limits) else {
                limits = Limits::of(patch.weights().iter().map(|w| w.abs()).sum(), share);
                if limits.is_none() {
                    return false;
                }
                continue;
            };
            row.clear();
            row.extend_from_slice(&descent.listed);
            row.extend(descent.near.iter().copied().zip(patch.weights().iter().copied()));
            limits = match cut(row, &descent.listed, share, rest, known) {
                Cut::Holds => return true,
                Cut::Below(weight) => Some(known.below(weight)),
                Cut::Unsure(factor) if factor < HOPELESS => return false,
                Cut::Unsure(factor) => Some(known.finer(factor)),
            };
        }
        false
    }
}

/// Drops from `row`, and with it all of the `rest`, what the rule drops.
fn cut(row: &mut Vec<(u32, f64)>, listed: &[(u32, f64)], share: f64, rest: Rest, limits: Limits) -> Cut {
    let total = magnitude(row) + rest.magnitude;
    let budget = share * total - rest.magnitude;
    if budget < 0.0 {
        return Cut::Below(0.1 * f64::from(limits.weight));
    }
    let left = drop_within(row, budget);
    let smallest = row.iter().map(|e| e.1.abs()).fold(f64::INFINITY, f64::min);
    if smallest < f64::from(limits.weight) {
        return Cut::Below(0.5 * smallest);
    }
    let close = left.min(smallest - left) < rest.error;
    let sum: f64 = row.iter().map(|e| e.1).sum();
    // A weight is off by its own error and by that of the sum that it is scaled by.
    let inexact = listed.iter().filter(|e| e.1.abs() >= smallest).count();
    let of_weights = f64::from(limits.kept) * (1.0 + SUM_BIAS * inexact as f64);
    let allowed = WEIGHT_ERROR * sum.abs();
    if of_weights > allowed {
        return Cut::Unsure(0.9 * allowed / of_weights);
    }
    if close && rest.error > TIE * total {
        return Cut::Unsure(FINER);
    }
    Cut::Holds
}

/// Sorts vertices so that each run of `8^k` from a multiple of it lies close together: split across the longest side, again
/// and again, where the lower part takes a power of two.
fn arrange(vertices: &mut [u32], positions: &[DVec3]) {
    /// Below this, handing work to another thread costs more than it saves.
    const ALONE: usize = 1024;
    if vertices.len() <= 1 {
        return;
    }
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &v in vertices.iter() {
        low = low.min(positions[v as usize]);
        high = high.max(positions[v as usize]);
    }
    let axis = (high - low).max_position();
    let half = vertices.len().next_power_of_two() / 2;
    let key = |v: u32| positions[v as usize][axis];
    vertices.select_nth_unstable_by(half, |&a, &b| key(a).total_cmp(&key(b)).then(a.cmp(&b)));
    let (left, right) = vertices.split_at_mut(half);
    if half < ALONE {
        arrange(left, positions);
        arrange(right, positions);
    } else {
        rayon::join(|| arrange(left, positions), || arrange(right, positions));
    }
}
