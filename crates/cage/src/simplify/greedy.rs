//! The greedy loop: which vertex is collapsed next, and into which neighbour.

use glam::DVec3;
use pliant_mesh::{Progress, TriMesh, face_area_vector};
use rayon::prelude::*;

use super::collapse::{Guard, Site, Working};
use super::quadric::Quadric;
use super::queue::Queue;
use super::{Simplified, SimplifyReport};
use crate::CageError;

/// A tiny pull towards the vertices that were merged, relative to the planes: on flat parts, where all planes agree,
/// it prefers short edges and even triangles.
const POINT_WEIGHT: f64 = 1e-6;

/// Collapses allowed, in order of strictness. The first keeps faces from turning by more than about 78 degrees at a time and
/// from looking inward; the others are for the smallest cages alone.
const GUARDS: [Guard; 3] = [
    Guard { min_cosine: 0.2, faces_outward: true },
    Guard { min_cosine: 0.0, faces_outward: false },
    Guard { min_cosine: -1.1, faces_outward: false },
];

const AHEAD: usize = 64;

/// Quality of a face (1 if equilateral) below which a collapse that makes it costs more, by the square of the ratio. Needles
/// are put off rather than forbidden: some scans consist of them.
const GOOD_QUALITY: f64 = 0.2;

pub(super) struct Simplifier {
    working: Working,
    quadrics: Vec<Quadric>,
    /// Cheapest neighbour of each vertex that may move, legal or not.
    cheapest: Vec<Cheapest>,
    queue: Queue,
    /// Vertex that each was collapsed into, itself while it is there.
    owner: Vec<u32>,
    /// Vertices still there.
    count: usize,
    unused: usize,
    /// Connected components that have faces.
    components: usize,
    /// Largest distance a collapse may have, and the largest one made.
    max_error: f64,
    error: f64,
    /// Scratch: neighbours, vertices read ahead, and targets.
    ring: Vec<u32>,
    ahead: Vec<u32>,
    others: Vec<Target>,
}

/// A neighbour to collapse into.
#[derive(Debug, Clone, Copy)]
struct Target {
    cost: f64,
    vertex: u32,
}

/// The cheapest neighbour of a vertex, the lower number first, and a cost that no other neighbour falls below.
#[derive(Debug, Clone, Copy)]
struct Cheapest {
    best: Target,
    others: f64,
}

impl Cheapest {
    const NONE: Self = Self { best: Target { cost: f64::INFINITY, vertex: u32::MAX }, others: f64::INFINITY };

    /// Takes another neighbour, or one that was offered before at the same cost, into account.
    fn offer(&mut self, target: Target) {
        if target.cost < self.best.cost || target.cost == self.best.cost && target.vertex < self.best.vertex {
            self.others = self.best.cost;
            self.best = target;
        } else if target.cost < self.others && target.vertex != self.best.vertex {
            self.others = target.cost;
        }
    }
}

/// The cheapest legal collapse of a vertex so far.
struct Choice {
    cost: f64,
    vertex: u32,
    distance: f64,
}

impl Simplifier {
    pub(super) fn new(shape: &TriMesh, boundary_weight: f64, max_error: f64) -> Self {
        let topology = shape.topology();
        let n = shape.vertex_count();
        let (centre, scale) = shape.bounds().normal_frame();
        let positions: Vec<DVec3> = shape.positions.par_iter().map(|p| (*p - centre) * scale).collect();
        let unused = (0..n).filter(|&v| topology.vertex_faces(v).is_empty()).count();
        let boundary = topology.boundary_vertices();
        let (mut sites, mut quadrics) = (Vec::new(), Vec::new());
        let ((), components) = rayon::join(
            || {
                let weight = |v: usize| if boundary[v] { boundary_weight } else { 0.0 };
                let site = |v: usize| vertex_site(shape, &positions, weight(v), v);
                (0..n).into_par_iter().map(site).unzip_into_vecs(&mut sites, &mut quadrics);
            },
            || topology.components().1,
        );
        let mut simplifier = Self {
            working: Working::new(topology, sites, boundary),
            quadrics,
            cheapest: Vec::new(),
            queue: Queue::new(n),
            owner: (0..n as u32).collect(),
            count: n - unused,
            unused,
            // Every unused vertex counts as a component of its own.
            components: components - unused,
            max_error,
            error: 0.0,
            ring: Vec::new(),
            ahead: Vec::new(),
            others: Vec::new(),
        };
        simplifier.cheapest = (0..n as u32).into_par_iter().map(|v| simplifier.find_cheapest(v)).collect();
        simplifier
    }

    pub(super) fn run(&mut self, asked: Option<usize>, progress: &dyn Progress) -> Result<(), CageError> {
        let target = asked.unwrap_or(0);
        let total = self.count.saturating_sub(target);
        let smallest = asked.is_some_and(|asked| asked <= 4 * self.components);
        let mut steps = 0_usize;
        for guard in &GUARDS[..if smallest { GUARDS.len() } else { 1 }] {
            let (working, cheapest) = (&self.working, &self.cheapest);
            let moving = (0..self.owner.len() as u32).filter(|&v| working.may_move(v));
            self.queue.fill(moving.map(|v| (v, cheapest[v as usize].best.cost)));
            while self.count > target {
                let Some(u) = self.queue.pop() else { break };
                self.read_ahead();
                self.step(u, *guard);
                steps += 1;
                if steps.is_multiple_of((total / 100).max(1)) {
                    progress.advance(total - (self.count - target), total);
                    if progress.is_cancelled() {
                        return Err(CageError::Cancelled { what: "simplification" });
                    }
                }
            }
        }
        progress.advance(total, total);
        Ok(())
    }

    /// Reads what the steps of the next vertices will, so that it is in the cache by then.
    ///
    /// A step meets some fifty lines of the cache, scattered over the arrays, and waits for many of them one by one as each
    /// says where the next is. Read for many vertices at once, they are waited for together. Nothing else comes of it.
    fn read_ahead(&mut self) {
        let mut ahead = std::mem::take(&mut self.ahead);
        self.queue.announce(AHEAD, &mut ahead);
        let mut read = 0;
        for &u in &ahead {
            read ^= self.working.fans.touch(u) ^ u64::from(self.cheapest[u as usize].best.vertex);
        }
        for centre in [|_: &Self, u| u, |s: &Self, u| s.cheapest[u as usize].best.vertex] {
            for &u in &ahead {
                for wedge in self.working.fans.row(centre(self, u)) {
                    let w = wedge.next() as usize;
                    read ^= self.working.fans.touch(w as u32) ^ self.queue.touch(w as u32);
                    read ^= self.working.sites[w].area.to_bits() ^ self.cheapest[w].others.to_bits();
                    read ^= self.quadrics[w].touch();
                }
            }
        }
        // Without this the compiler would see that nobody asks for the result.
        std::hint::black_box(read);
        self.ahead = ahead;
    }

    /// Collapses `u` into its cheapest legal neighbour if nothing cheaper waits; puts it back at its true cost otherwise.
    fn step(&mut self, u: u32, guard: Guard) {
        let mut best = Choice { cost: f64::INFINITY, vertex: u, distance: 0.0 };
        let first = self.cheapest[u as usize].best;
        self.judge(u, first, guard, &mut best);
        // Judging only adds to costs: if nothing was added to that of the cheapest neighbour, no other can be cheaper.
        if best.cost > first.cost {
            let mut others = std::mem::take(&mut self.others);
            others.clear();
            let cheaper = |t: &Target| t.vertex != first.vertex && t.cost < best.cost;
            self.for_each_target(u, |t| others.extend(Some(t).filter(cheaper)));
            others.sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost).then(a.vertex.cmp(&b.vertex)));
            for &other in &others {
                if other.cost >= best.cost {
                    break;
                }
                self.judge(u, other, guard, &mut best);
            }
            self.others = others;
        }
        let Choice { cost, vertex: v, distance } = best;
        if v == u {
            // No legal neighbour: it waits outside until its ring changes.
        } else if cost > self.queue.least() {
            self.queue.set(u, cost);
        } else {
            self.error = self.error.max(distance);
            self.collapse(u, v);
        }
    }

    /// Takes a target as the best choice if its collapse is legal and cheaper, needles counted.
    fn judge(&mut self, u: u32, target: Target, guard: Guard, best: &mut Choice) {
        let Target { cost, vertex } = target;
        if cost >= best.cost {
            return;
        }
        let distance = self.distance(u, vertex, cost);
        if distance > self.max_error {
            return;
        }
        if let Some(quality) = self.working.may_collapse(u, vertex, guard, GOOD_QUALITY) {
            let cost = cost * (GOOD_QUALITY / quality).max(1.0).powi(2);
            if cost < best.cost {
                *best = Choice { cost, vertex, distance };
            }
        }
    }

    /// Collapses `u` into `v` and brings costs up to date.
    ///
    /// For a vertex next to `v` only the cost of `v` changes, and that of `u` is gone: its own quadric is as it was. As the
    /// quadric of `v` only gains, so does its cost; a bound on the others therefore stays one. (Where rounding says that
    /// `v` lost, all is done anew.)
    fn collapse(&mut self, u: u32, v: u32) {
        let merged = self.quadrics[u as usize];
        self.quadrics[v as usize].add(&merged);
        let area = self.working.sites[u as usize].area;
        let site = &mut self.working.sites[v as usize];
        let before = site.at_home;
        site.area += area;
        site.at_home = self.quadrics[v as usize].at(site.position);
        let (at_home, position) = (site.at_home, site.position);
        let grew = at_home >= before;

        let mut ring = std::mem::take(&mut self.ring);
        let (cheapest, quadrics) = (&mut self.cheapest, &self.quadrics);
        self.working.collapse(u, v, &mut ring, |w, renamed, is_open| {
            let known = &mut cheapest[w as usize];
            if known.best.vertex == u {
                // The cost follows below, as for all that had `v` already.
                known.best.vertex = v;
            } else if !renamed.lost && (renamed.followed || is_open) && at_home <= known.others {
                known.offer(Target { cost: quadrics[w as usize].at(position) + at_home, vertex: v });
            }
        });
        self.owner[u as usize] = v;
        self.count -= 1;
        self.working.fans.ring(v, &mut ring);
        for &w in &ring {
            if self.working.locked[w as usize] {
                continue;
            }
            let mut known = self.cheapest[w as usize];
            if known.best.vertex == v {
                known.best.cost = self.cost(w, v);
            }
            if !grew || known.best.vertex == v && known.best.cost >= known.others {
                known = self.find_cheapest(w);
            }
            self.cheapest[w as usize] = known;
            self.queue.set(w, known.best.cost);
        }
        if !self.working.locked[v as usize] {
            self.cheapest[v as usize] = self.find_cheapest(v);
            self.queue.set(v, self.cheapest[v as usize].best.cost);
        }
        self.ring = ring;
    }

    /// The cheapest neighbour of `u`.
    fn find_cheapest(&self, u: u32) -> Cheapest {
        let mut cheapest = Cheapest::NONE;
        self.for_each_target(u, |t| cheapest.offer(t));
        cheapest
    }

    /// What collapsing `u` into each of its neighbours costs: both quadrics at the neighbour's place.
    fn for_each_target(&self, u: u32, mut each: impl FnMut(Target)) {
        let own = &self.quadrics[u as usize];
        let mut target = |v: u32| {
            let site = &self.working.sites[v as usize];
            each(Target { cost: own.at(site.position) + site.at_home, vertex: v });
        };
        let row = self.working.fans.row(u);
        row.iter().for_each(|wedge| target(wedge.next()));
        // Around a closed fan every neighbour follows `u` in exactly one face. Elsewhere some may be told twice.
        if self.working.is_open_fan(u) {
            row.iter().for_each(|wedge| target(wedge.last));
        }
    }

    /// What collapsing `u` into its neighbour `v` costs.
    fn cost(&self, u: u32, v: u32) -> f64 {
        let site = &self.working.sites[v as usize];
        self.quadrics[u as usize].at(site.position) + site.at_home
    }

    /// Root mean square distance that a cost stands for, over the area of both vertices.
    fn distance(&self, u: u32, v: u32, cost: f64) -> f64 {
        let area = self.working.sites[u as usize].area + self.working.sites[v as usize].area;
        if area > 0.0 { (cost / area).sqrt() } else { 0.0 }
    }

    pub(super) fn finish(mut self, shape: &TriMesh, asked: Option<usize>) -> Result<Simplified, CageError> {
        let n = self.owner.len() as u32;
        let origin: Vec<u32> = (0..n).filter(|&v| self.working.fans.face_count(v) > 0).collect();
        let mut number = vec![Simplified::NO_OWNER; self.owner.len()];
        for (new, &old) in origin.iter().enumerate() {
            number[old as usize] = new as u32;
        }
        compress(&mut self.owner);
        let owner: Vec<u32> = self.owner.iter().map(|&v| number[v as usize]).collect();
        // A face is gone once two of its corners are one. One that was not touched is as it was, even if the shape folds there.
        let kept = |t: &&[u32; 3]| {
            let [a, b, c] = t.map(|v| owner[v as usize]);
            a != b && b != c && c != a
        };
        let faces: Vec<[u32; 3]> =
            shape.triangles().par_iter().filter(kept).map(|t| t.map(|v| owner[v as usize])).collect();
        let flipped = shape.triangles().par_iter().filter(kept).filter(|t| {
            let now = t.map(|v| self.owner[v as usize]);
            now != **t && self.working.is_flipped(now)
        });
        let report = SimplifyReport {
            asked,
            reached: origin.len(),
            estimated_error: self.error,
            locked: self.working.locked.iter().filter(|l| **l).count(),
            unused: self.unused,
            flipped_faces: flipped.count(),
        };
        let positions = origin.iter().map(|&v| shape.positions[v as usize]).collect();
        Ok(Simplified { mesh: TriMesh::new(positions, faces)?, origin, owner, report })
    }
}

/// Makes every entry of a forest, given by parents, point to its root.
fn compress(parent: &mut [u32]) {
    for start in 0..parent.len() {
        let mut root = start as u32;
        while parent[root as usize] != root {
            root = parent[root as usize];
        }
        let mut at = start as u32;
        while parent[at as usize] != root {
            at = std::mem::replace(&mut parent[at as usize], root);
        }
    }
}

/// Site and quadric of shape vertex `v` (Garland and Heckbert, Section 5): planes of the incident faces weighted by area, and
/// steep planes through boundary edges, of the given weight.
fn vertex_site(shape: &TriMesh, positions: &[DVec3], boundary_weight: f64, v: usize) -> (Site, Quadric) {
    let topology = shape.topology();
    let position = positions[v];
    let mut site = Site { position, ..Site::default() };
    let mut quadric = Quadric::default();
    for &f in topology.vertex_faces(v) {
        let t = shape.triangles()[f as usize];
        let p = t.map(|w| positions[w as usize]);
        let area_vector = face_area_vector(p);
        site.normal += area_vector;
        let area = area_vector.length();
        let Some(normal) = area_vector.try_normalize() else { continue };
        for (k, e) in topology.face_edges(f as usize).into_iter().enumerate() {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            if boundary_weight > 0.0 && t[k] as usize != v && topology.is_boundary_edge(e as usize) {
                let side = p[j] - p[i];
                let weight = boundary_weight * side.length_squared();
                if let Some(across) = side.cross(normal).try_normalize() {
                    quadric.add(&Quadric::plane(across, p[i], weight));
                }
            }
        }
        quadric.add(&Quadric::plane(normal, p[0], area));
        quadric.add(&Quadric::point(position, POINT_WEIGHT * area));
        site.area += area;
    }
    site.normal = site.normal.normalize_or_zero();
    site.at_home = quadric.at(position);
    (site, quadric)
}
