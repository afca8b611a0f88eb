//! Rows of the magnitude rule without looking at the whole cage.
//!
//! What the rule drops only counts as a sum of magnitudes, so far vertices are summed in groups: the tree of
//! fast winding numbers (Barill et al. 2018), with the kernel `N . r / |r|^4` of mean value coordinates, Taylor terms to degree 2,
//! and two things that a cut needs beside the sum: proof that a group's weights have one sign (else the sum is not that
//! of the magnitudes), and a bound on its largest weight (else one of them might be kept). Vertices too near for
//! their own Taylor terms are summed face by face.
//!
//! Every row ends with the check that its cut holds in spite of all errors made. If it does not, the row is made again with
//! smaller ones, and at last left to the exact path.

mod faces;
mod lanes;
mod moments;
mod pack;

use glam::DVec3;
use pliant_mesh::Topology;
use pulp::Simd;
use rayon::prelude::*;

use crate::mean_value::MeanValue;
use crate::prune::{drop_smallest, drop_within, magnitude};
use moments::{Moments, Surface};
use pack::{Dipoles, Eight, Look, Pack, WIDTH};

/// Cage vertices in a tree eight wide.
pub(crate) struct FarField {
    /// The vertices in such an order that each run of 8, 64, 512, ... lies close together.
    order: Vec<u32>,
    /// Lowest first: item `i` of level 0 is vertex `order[i]`, of a higher level pack `i` of the one below.
    levels: Vec<Vec<Pack>>,
    /// Level 0 in brief.
    dipoles: Vec<Dipoles>,
    arch: pulp::Arch,
}

/// A thread's working memory.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    open: Vec<u32>,
    opened: Vec<u32>,
    near: Vec<u32>,
    faces: Vec<u32>,
    batch: faces::Faces,
    seen: Vec<u32>,
    stamp: u32,
    /// Where a vertex stands in `near`, plus one.
    slot: Vec<u32>,
    near_weights: Vec<f64>,
    entries: Vec<(u32, f64)>,
    pub stats: Stats,
}

#[derive(Debug, Default, Clone, Copy)]
pub struct Stats {
    pub rows: usize,
    pub tries: usize,
    pub packs: usize,
    pub near: usize,
    pub faces: usize,
    pub listed: usize,
    pub grouped: usize,
    pub kept: usize,
    pub brief: f64, pub t: [u64; 4], pub h: [usize; 12], pub hf: [usize; 12], pub hp: [usize; 12],
    pub exact: usize,
    pub ambiguous: usize,
    pub tau: usize,
    pub delta: f64,
    pub far_share: f64,
    pub why: [[usize; 3]; 4],

}

/// What was not listed by vertex.
#[derive(Debug, Clone, Copy, Default)]
struct Rest {
    magnitude: f64,
    error: f64,
}

/// Largest errors and weights that a row may leave unseen.
#[derive(Debug, Clone, Copy)]
struct Limits {
    brief: f32,
    kept: f32,
    error: f32,
    weight: f32,
}

/// Share of the errors' sum that is taken for the error of the sum: they have all signs, and the bound is seldom reached. On smooth
/// and folded cages alike the sum's error stays below 0.03 of it (see the tests).
const CANCELLING: f64 = 0.1;

/// Rounding of sums in single precision, relative to the sum.
const SUM_ROUNDING: f64 = 4e-6;

pub static TUNE: std::sync::RwLock<[f64; 4]> = std::sync::RwLock::new([1e-5, 1e-3, 1e-5, 0.1]);

impl FarField {
    pub(crate) fn new(cage: &MeanValue, topology: &Topology) -> Self {
        let surface = Surface { positions: cage.positions(), normals: cage.normals(), topology };
        let mut order: Vec<u32> = (0..topology.vertex_count() as u32).collect();
        arrange(&mut order, surface.positions);
        let mut levels = Vec::new();
        let dipoles: Vec<Dipoles> = order.par_chunks(WIDTH).map(|pack| {
            let groups: Vec<Moments> = pack.chunks(1).map(|group| Moments::of(&surface, group)).collect();
            Dipoles::new(&groups)
        }).collect();
        let mut size = 1;
        loop {
            let level: Vec<Pack> = order
                .par_chunks(size * WIDTH)
                .map(|pack| {
                    let groups: Vec<Moments> = pack.chunks(size).map(|group| Moments::of(&surface, group)).collect();
                    Pack::new(&groups)
                })
                .collect();
            let top = level.len() <= 1;
            levels.push(level);
            if top {
                break;
            }
            size *= WIDTH;
        }
        // So that each pack has its eight.
        order.resize(order.len().next_multiple_of(WIDTH), 0);
        Self { order, levels, dipoles, arch: pulp::Arch::new() }
    }

    /// Makes the row of `x` (normal frame) into `row`, not yet scaled; `nearest` is a cage vertex close to it.
    /// `false` if the row has to be made exactly.
    pub(crate) fn row(
        &self,
        cage: &MeanValue,
        topology: &Topology,
        x: DVec3,
        nearest: u32,
        share: f64,
        scratch: &mut Scratch,
        row: &mut Vec<(u32, f64)>,
    ) -> bool {
        scratch.slot.resize(topology.vertex_count(), 0);
        scratch.seen.resize(topology.triangles().len(), 0);
        let maker = Maker { field: self, cage, topology, x, share };
        let made = self.arch.dispatch(MakeRow { maker, nearest, scratch, row });
        scratch.stats.rows += 1;
        if !made { scratch.stats.exact += 1; }
        scratch.stats.kept += row.len();
        made
    }
}

struct MakeRow<'a> {
    maker: Maker<'a>,
    nearest: u32,
    scratch: &'a mut Scratch,
    row: &'a mut Vec<(u32, f64)>,
}

/// Compiled for the processor's vector instructions, with all that is inlined into it.
impl pulp::WithSimd for MakeRow<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        self.maker.row(simd, self.nearest, self.scratch, self.row)
    }
}

/// One row.
struct Maker<'a> {
    field: &'a FarField,
    cage: &'a MeanValue,
    topology: &'a Topology,
    x: DVec3,
    share: f64,
}

impl Maker<'_> {
    #[inline(always)]
    fn row<S: Simd>(&self, simd: S, nearest: u32, scratch: &mut Scratch, row: &mut Vec<(u32, f64)>) -> bool {
        scratch.near.clear();
        scratch.near.extend(self.topology.triangles()[nearest as usize]);
        if let Some(on) = self.weigh_near(simd, scratch) {
            self.on_face(on, row);
            return true;
        }
        let tune = *TUNE.read().unwrap();
        // No more than the row's magnitude, and rarely less than a tenth of it.
        let mut size = scratch.near_weights.iter().map(|w| w.abs()).sum::<f64>();
        let mut weight = tune[1] * size;
        let mut error = tune[0] * size;
        for _ in 0..4 {
            if !(size > 0.0 && size.is_finite()) {
                return false;
            }
            scratch.stats.tries += 1;
            let t0 = std::time::Instant::now(); let p0 = scratch.stats.packs;
            let rest = self.sum(simd, Limits { brief: (tune[3] * error) as f32, kept: (tune[2] * size) as f32, error: error as f32, weight: weight as f32 }, scratch);
            scratch.stats.near += scratch.near.len();
            let t1 = std::time::Instant::now();
            if let Some(on) = self.weigh_near(simd, scratch) {
                self.on_face(on, row);
                return true;
            }
            let t2 = std::time::Instant::now();
            scratch.stats.t[0] += (t1 - t0).as_nanos() as u64;
            scratch.stats.t[1] += (t2 - t1).as_nanos() as u64;
            scratch.stats.faces += scratch.faces.len();
            row.clear();
            row.extend_from_slice(&scratch.entries);
            row.extend(scratch.near.iter().copied().zip(scratch.near_weights.iter().copied()));
            scratch.stats.listed += row.len();
            let total = magnitude(row) + rest.magnitude;
            scratch.stats.delta += rest.error / total;
            scratch.stats.far_share += rest.magnitude / total;
            { let r = total/size; let b=(r.log2()*2.0).floor().clamp(0.,11.) as usize; scratch.stats.h[b]+=1; scratch.stats.hf[b]+=scratch.faces.len(); scratch.stats.hp[b]+=scratch.stats.packs-p0; }
            size = total;
            let budget = self.share * total - rest.magnitude;
            if budget < 0.0 {
                weight *= 0.1;
                scratch.stats.tau += 1;
                continue;
            }
            let left = drop_within(row, budget);
            scratch.stats.t[2] += t2.elapsed().as_nanos() as u64;
            let smallest = row.iter().map(|e| e.1.abs()).fold(f64::INFINITY, f64::min);
            if smallest < weight {
                weight = 0.5 * smallest;
                scratch.stats.tau += 1;
                continue;
            }
            if rest.error > 5e-5 * total && (left < rest.error || smallest - left < rest.error) {
                scratch.stats.ambiguous += 1;
                error *= 0.03;
                continue;
            }
            return true;
        }
        false
    }

    fn on_face(&self, (face, barycentric): (u32, [f64; 3]), row: &mut Vec<(u32, f64)>) {
        row.clear();
        row.extend(self.topology.triangles()[face as usize].into_iter().zip(barycentric));
        drop_smallest(row, self.share);
    }

    /// Goes down the tree: sums what is far, lists what is not.
    #[inline(always)]
    fn sum<S: Simd>(&self, simd: S, limits: Limits, scratch: &mut Scratch) -> Rest {
        let x = self.x.as_vec3().to_array();
        let mut sums = Sums::default();
        scratch.open.clear();
        scratch.open.push(0);
        for level in self.field.levels.iter().skip(1).rev() {
            scratch.stats.packs += scratch.open.len();
            open_groups(simd, x, level, limits, &mut sums, &scratch.open, &mut scratch.opened);
            std::mem::swap(&mut scratch.open, &mut scratch.opened);
        }
        scratch.stats.packs += scratch.open.len();
        open_dipoles(simd, x, &self.field.dipoles, limits, &mut sums, &scratch.open, &mut scratch.opened);
        scratch.stats.grouped += scratch.opened.len();
        open_vertices(simd, x, self.field, limits, &mut sums, scratch);
        sums.rest()
    }

    #[inline(always)]
    fn weigh_near<S: Simd>(&self, simd: S, scratch: &mut Scratch) -> Option<(u32, [f64; 3])> {
        let Scratch { near, faces, batch, seen, stamp, slot, near_weights, .. } = scratch;
        *stamp += 1;
        faces.clear();
        for (at, &v) in near.iter().enumerate() {
            slot[v as usize] = at as u32 + 1;
            for &f in self.topology.vertex_faces(v as usize) {
                if seen[f as usize] != *stamp {
                    seen[f as usize] = *stamp;
                    faces.push(f);
                }
            }
        }
        near_weights.clear();
        near_weights.resize(near.len(), 0.0);
        let on = batch.weigh(simd, self.cage, self.x, faces, #[inline(always)] |face, weights| {
            for (v, w) in self.topology.triangles()[face as usize].into_iter().zip(weights) {
                let at = slot[v as usize];
                if at > 0 {
                    near_weights[at as usize - 1] += w;
                }
            }
        });
        for &v in near.iter() {
            slot[v as usize] = 0;
        }
        on
    }
}

/// Sums over the tree, lane by lane.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    weight: Eight,
    error: Eight,
}

impl Sums {
    /// Adds the groups that are marked.
    #[inline(always)]
    fn add(&mut self, look: &Look, good: &[bool; WIDTH]) {
        for k in 0..WIDTH {
            let (weight, error) = (self.weight[k] + look.weight[k].abs(), self.error[k] + look.error[k]);
            self.weight[k] = if good[k] { weight } else { self.weight[k] };
            self.error[k] = if good[k] { error } else { self.error[k] };
        }
    }

    fn rest(&self) -> Rest {
        let total = |lanes: &Eight| lanes.iter().map(|&lane| f64::from(lane)).sum::<f64>();
        let magnitude = total(&self.weight);
        Rest { magnitude, error: CANCELLING * total(&self.error) + SUM_ROUNDING * magnitude }
    }
}

/// Adds the groups of `packs` that are far, and lists the others, which are packs of the level below.
#[inline(always)]
fn open_groups<S: Simd>(
    simd: S,
    x: [f32; 3],
    level: &[Pack],
    limits: Limits,
    sums: &mut Sums,
    packs: &[u32],
    opened: &mut Vec<u32>,
) {
    opened.clear();
    opened.resize(packs.len() * WIDTH, 0);
    let mut count = 0;
    let mut look = Look::default();
    for &at in packs {
        level[at as usize].look_at_groups(simd, x, &mut look);
        let mut good = [false; WIDTH];
        for k in 0..WIDTH {
            good[k] = (look.error[k] <= limits.error) & (look.largest[k] <= limits.weight);
        }
        sums.add(&look, &good);
        for k in 0..WIDTH {
            // Without a branch: which way it goes cannot be foreseen.
            opened[count] = at * WIDTH as u32 + k as u32;
            count += usize::from(!good[k]);
        }
    }
    opened.truncate(count);
}

/// Adds the packs whose vertices all are small and far enough to be dipoles; lists the others.
#[inline(always)]
fn open_dipoles<S: Simd>(
    simd: S,
    x: [f32; 3],
    dipoles: &[Dipoles],
    limits: Limits,
    sums: &mut Sums,
    packs: &[u32],
    opened: &mut Vec<u32>,
) {
    opened.clear();
    opened.resize(packs.len(), 0);
    let mut count = 0;
    let mut look = Look::default();
    for &at in packs {
        dipoles[at as usize].look(simd, x, &mut look);
        let mut far = true;
        for k in 0..WIDTH {
            far &= (look.error[k] <= limits.brief) & (look.weight[k].abs() + look.error[k] < limits.weight);
        }
        sums.add(&look, &[far; WIDTH]);
        opened[count] = at;
        count += usize::from(!far);
    }
    opened.truncate(count);
}

/// Adds the vertices of the opened packs that are far and small, lists far ones with their weights, and the near ones.
#[inline(always)]
fn open_vertices<S: Simd>(
    simd: S,
    x: [f32; 3],
    field: &FarField,
    limits: Limits,
    sums: &mut Sums,
    scratch: &mut Scratch,
) {
    let Scratch { opened, near, entries, .. } = scratch;
    near.clear();
    near.resize(opened.len() * WIDTH, 0);
    entries.clear();
    entries.resize(opened.len() * WIDTH, (0, 0.0));
    let (mut near_count, mut entry_count) = (0, 0);
    let mut look = Look::default();
    for &at in opened.iter() {
        field.levels[0][at as usize].look_at_vertices(simd, x, &mut look);
        let (mut small, mut known) = ([false; WIDTH], [false; WIDTH]);
        for k in 0..WIDTH {
            let below = look.weight[k].abs() + look.error[k] < limits.weight;
            small[k] = (look.error[k] <= limits.error) & below;
            known[k] = small[k] | (look.error[k] <= limits.kept);
        }
        sums.add(&look, &small);
        let vertices = &field.order[at as usize * WIDTH..][..WIDTH];
        for k in 0..WIDTH {
            near[near_count] = vertices[k];
            near_count += usize::from(!known[k]);
            entries[entry_count] = (vertices[k], f64::from(look.weight[k]));
            entry_count += usize::from(known[k] & !small[k]);
        }
    }
    near.truncate(near_count);
    entries.truncate(entry_count);
}

/// Sorts vertices so that each run of `8^k` from a multiple of it lies close together: split by the longest side, again
/// and again, where the lower part takes a power of two.
fn arrange(vertices: &mut [u32], positions: &[DVec3]) {
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
    if half < 1024 {
        arrange(left, positions);
        arrange(right, positions);
    } else {
        rayon::join(|| arrange(left, positions), || arrange(right, positions));
    }
}
