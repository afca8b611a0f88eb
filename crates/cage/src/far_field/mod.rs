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
use rayon::prelude::*;

use crate::mean_value::MeanValue;
use crate::prune::{drop_smallest, drop_within, magnitude};
use moments::{Moments, Surface};
use pack::{Pack, WIDTH};

/// Cage vertices in a tree eight wide.
pub(crate) struct FarField {
    /// The vertices in such an order that each run of 8, 64, 512, ... lies close together.
    order: Vec<u32>,
    /// Lowest first: item `i` of level 0 is vertex `order[i]`, of a higher level pack `i` of the one below.
    levels: Vec<Vec<Pack>>,
    arch: pulp::Arch,
}

/// A thread's working memory.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    open: Vec<(usize, u32)>,
    near: Vec<u32>,
    faces: Vec<u32>,
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
    pub exact: usize,
    pub ambiguous: usize,
    pub tau: usize,
    pub delta: f64,
    pub far_share: f64,
    pub t: [u64; 4],
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
    kept: f32,
    error: f32,
    weight: f32,
}

pub static TUNE: std::sync::RwLock<[f64; 3]> = std::sync::RwLock::new([1e-6, 1e-3, 1e-6]);

impl FarField {
    pub(crate) fn new(cage: &MeanValue, topology: &Topology) -> Self {
        let surface = Surface { positions: cage.positions(), normals: cage.normals(), topology };
        let mut order: Vec<u32> = (0..topology.vertex_count() as u32).collect();
        arrange(&mut order, surface.positions);
        let mut levels = Vec::new();
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
        Self { order, levels, arch: pulp::Arch::new() }
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
        let made = self.arch.dispatch(
            #[inline(always)]
            || maker.row(nearest, scratch, row),
        );
        scratch.stats.rows += 1;
        if !made { scratch.stats.exact += 1; }
        scratch.stats.kept += row.len();
        made
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
    fn row(&self, nearest: u32, scratch: &mut Scratch, row: &mut Vec<(u32, f64)>) -> bool {
        scratch.near.clear();
        scratch.near.push(nearest);
        if let Some(on) = self.weigh_near(scratch) {
            self.on_face(on, row);
            return true;
        }
        let tune = *TUNE.read().unwrap();
        // No more than the row's magnitude, and rarely less than a tenth of it.
        let mut size = scratch.near_weights[0].abs();
        let mut weight = tune[1] * size;
        let mut error = tune[0] * size;
        for _ in 0..4 {
            if !(size > 0.0 && size.is_finite()) {
                return false;
            }
            scratch.stats.tries += 1;
            let rest = self.sum(Limits { kept: (tune[2] * size) as f32, error: error as f32, weight: weight as f32 }, scratch);
            scratch.stats.near += scratch.near.len();
            if let Some(on) = self.weigh_near(scratch) {
                self.on_face(on, row);
                return true;
            }
            scratch.stats.faces += scratch.faces.len();
            row.clear();
            row.extend_from_slice(&scratch.entries);
            row.extend(scratch.near.iter().copied().zip(scratch.near_weights.iter().copied()));
            scratch.stats.listed += row.len();
            let total = magnitude(row) + rest.magnitude;
            scratch.stats.delta += rest.error / total;
            scratch.stats.far_share += rest.magnitude / total;
            size = total;
            let budget = self.share * total - rest.magnitude;
            if budget < 0.0 {
                weight *= 0.1;
                scratch.stats.tau += 1;
                continue;
            }
            let left = drop_within(row, budget);
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

    #[inline(always)]
    fn sum(&self, limits: Limits, scratch: &mut Scratch) -> Rest {
        let x = self.x.as_vec3().to_array();
        let mut rest = Rest::default();
        scratch.near.clear();
        scratch.entries.clear();
        scratch.open.clear();
        scratch.open.push((self.field.levels.len() - 1, 0));
        let (mut sums, mut errors) = ([0.0_f32; WIDTH], [0.0_f32; WIDTH]);
        while let Some((level, at)) = scratch.open.pop() {
            scratch.stats.packs += 1;
            let pack = &self.field.levels[level][at as usize];
            if level == 0 {
                let look = pack.look_at_vertices(x);
                let mut good = [false; WIDTH];
                let mut small = [false; WIDTH];
                for k in 0..WIDTH {
                    small[k] = look.error.0[k] <= limits.error && look.weight.0[k].abs() + look.error.0[k] < limits.weight;
                    good[k] = small[k] || look.error.0[k] <= limits.kept;
                    sums[k] += if small[k] { look.weight.0[k].abs() } else { 0.0 };
                    errors[k] += if good[k] { look.error.0[k] } else { 0.0 };
                }
                if small == [true; WIDTH] {
                    continue;
                }
                let first = at as usize * WIDTH;
                for (k, &vertex) in self.field.order[first..].iter().take(WIDTH).enumerate() {
                    if !good[k] {
                        scratch.near.push(vertex);
                    } else if !small[k] {
                        scratch.entries.push((vertex, f64::from(look.weight.0[k])));
                    }
                }
            } else {
                let look = pack.look_at_groups(x);
                let mut good = [false; WIDTH];
                for k in 0..WIDTH {
                    good[k] = look.error.0[k] <= limits.error && look.largest.0[k] <= limits.weight;
                    sums[k] += if good[k] { look.weight.0[k].abs() } else { 0.0 };
                    errors[k] += if good[k] { look.error.0[k] } else { 0.0 };
                }
                if good == [true; WIDTH] {
                    continue;
                }
                let below = self.field.levels[level - 1].len();
                for (k, good) in good.into_iter().enumerate() {
                    let child = at as usize * WIDTH + k;
                    if !good && child < below {
                        scratch.open.push((level - 1, child as u32));
                    }
                }
            }
        }
        for k in 0..WIDTH {
            rest.magnitude += f64::from(sums[k]);
            rest.error += f64::from(errors[k]);
        }
        rest.error = 0.1 * rest.error + 4e-6 * rest.magnitude;
        rest
    }

    #[inline(always)]
    fn weigh_near(&self, scratch: &mut Scratch) -> Option<(u32, [f64; 3])> {
        let Scratch { near, faces, seen, stamp, slot, near_weights, .. } = scratch;
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
        let on = faces::weigh_faces(self.cage, self.x, faces, |face, weights| {
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
pub fn calibrate(shape: &pliant_mesh::TriMesh, cage: &pliant_mesh::TriMesh) {
    let mv = MeanValue::new(cage);
    let field = FarField::new(&mv, cage.topology());
    let n = cage.vertex_count();
    let mut hist = vec![[0usize; 12]; field.levels.len()];
    let mut worst = vec![0.0f64; field.levels.len()];
    let mut sums = vec![[0.0f64;3]; field.levels.len()];
    for i in (0..shape.vertex_count()).step_by(97) {
        let x = mv.to_frame(shape.positions[i]);
        // exact unnormalised
        let mut w = vec![0.0; n];
        let mut on = false;
        for f in 0..cage.face_count() {
            match mv.face_weights(x, f) { crate::mean_value::FaceWeights::Weights(ww) => for (v, q) in cage.triangles()[f].iter().zip(ww) { w[*v as usize] += q }, _ => on = true }
        }
        if on { continue; }
        let total: f64 = w.iter().map(|w| w.abs()).sum();
        let mut size = 1;
        for (l, level) in field.levels.iter().enumerate() {
            for (p, pack) in level.iter().enumerate() {
                let xx = x.as_vec3().to_array();
                let look = if l == 0 { pack.look_at_vertices(xx) } else { pack.look_at_groups(xx) };
                for k in 0..WIDTH {
                    let a = (p * WIDTH + k) * size; if a >= n { continue; }
                    let g = &field.order[a..(a + size).min(n)];
                    let e = f64::from(look.error.0[k]);
                    if !(e <= 1e-4 * total) || e < 1e-8*total { continue; }
                    let truth = if l==0 {w[g[0] as usize]} else { let s: f64 = g.iter().map(|v| w[*v as usize].abs()).sum(); s };
                    let got = if l==0 {f64::from(look.weight.0[k])} else { f64::from(look.weight.0[k].abs()) };
                    let err = (got - truth).abs();
                    let ratio = err / e;
                    worst[l] = worst[l].max(ratio);
                    sums[l][0] += err; sums[l][1] += e; sums[l][2] += got - truth;
                    hist[l][((-ratio.log10()*2.0).floor().clamp(-1.0, 10.0) + 1.0) as usize] += 1;
                    if l > 0 && g.iter().any(|v| w[*v as usize].abs() > f64::from(look.largest.0[k])*1.000001) { eprintln!("largest broken {l}"); }
                }
            }
            size *= WIDTH;
        }
    }
    for l in 0..hist.len() { eprintln!("level {l} worst {:.3} mean ratio {:.4} signed {:.5} hist(>1, .3-1, .1-.3 ...) {:?}", worst[l], sums[l][0]/sums[l][1], sums[l][2]/sums[l][1], hist[l]); }
}
