//! Control meshes by quadric error simplification (Garland and Heckbert, Surface Simplification Using Quadric Error
//! Metrics, SIGGRAPH 1997), with half-edge collapses only: cage vertices are a subset of the shape's vertices, as
//! Borosan et al. 2010, Section 3, have them.

mod collapse;
mod quadric;
mod queue;

use glam::DVec3;
use pliant_mesh::{Progress, TriMesh, face_area_vector};
use serde::{Deserialize, Serialize};

use crate::CageError;
use collapse::{DEAD, Guard, Working};
use quadric::Quadric;
use queue::Queue;

/// How large a cage is to be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CageSize {
    /// Number of vertices. What cannot be reached ends as near above it as possible: a closed surface of genus 0
    /// never goes below a tetrahedron, so 0 asks for the smallest cage there is.
    Vertices(usize),
    /// Share of the shape's vertices, above 0 and at most 1.
    Fraction(f64),
    /// Largest estimated distance from the shape (root mean square over the planes a vertex stands for), as a share of
    /// the bounding-box diagonal.
    Error(f64),
}

/// Settings of [`simplify`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SimplifyOptions {
    /// Size of the cage. Default: 5 % of the shape's vertices.
    pub size: CageSize,
    /// Weight of the planes that hold the boundary in place, relative to those of faces of the same size. Default: 10.
    pub boundary_weight: f64,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self { size: CageSize::Fraction(0.05), boundary_weight: 10.0 }
    }
}

impl From<CageSize> for SimplifyOptions {
    fn from(size: CageSize) -> Self {
        Self { size, ..Self::default() }
    }
}

/// A control mesh and where it comes from.
#[derive(Debug, Clone)]
pub struct Simplified {
    /// The control mesh; its vertices keep the order they have in the shape.
    pub mesh: TriMesh,
    /// Shape vertex of each cage vertex, increasing.
    pub origin: Vec<u32>,
    /// What was asked for and what came of it.
    pub report: SimplifyReport,
}

/// How a simplification went.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct SimplifyReport {
    /// Vertices asked for; `None` when a distance was asked for.
    pub asked: Option<usize>,
    /// Vertices of the cage.
    pub reached: usize,
    /// Largest estimated distance of a collapse, as a share of the shape's diagonal (see [`CageSize::Error`]).
    pub estimated_error: f64,
    /// Shape vertices kept because the surface is not manifold there.
    pub locked: usize,
    /// Shape vertices without faces, which no cage can hold.
    pub unused: usize,
    /// Faces of the cage, not of the shape, that look away from the shape's normals at their corners. 0 but for the smallest
    /// cages (see [`simplify`]).
    pub flipped_faces: usize,
}

impl SimplifyReport {
    /// What a user should know about the cage; empty if it is as asked for and without flaws.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(asked) = self.asked.filter(|&asked| self.reached > asked) {
            warnings.push(format!(
                "a cage of {asked} vertices was asked for and {} reached: what is left cannot be collapsed without changing the topology, turning faces over or flattening them",
                self.reached
            ));
        }
        if let Some(asked) = self.asked.filter(|&asked| self.reached < asked) {
            warnings.push(format!("a cage of {asked} vertices was asked for, but the shape has only {}", self.reached));
        }
        if self.locked > 0 {
            warnings.push(format!("{} vertices at non-manifold places were kept as they are", self.locked));
        }
        if self.unused > 0 {
            warnings.push(format!("{} vertices without faces are not part of the cage", self.unused));
        }
        if self.flipped_faces > 0 {
            warnings.push(format!("{} faces of the cage look away from the shape's surface", self.flipped_faces));
        }
        warnings
    }
}

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

/// Quality of a face (1 if equilateral) below which a collapse that makes it costs more, by the square of the ratio. Needles
/// are put off rather than forbidden: some scans consist of them.
const GOOD_QUALITY: f64 = 0.2;

/// Builds a control mesh of `shape` by collapsing its vertices into neighbours, cheapest first.
///
/// Keeps what the shape is: manifold where it was manifold, the same Euler characteristic, boundaries, components. Vertices
/// at non-manifold places stay. Works on open shapes and on several components. Ties are broken by vertex
/// number, so the result is the same on every run. `O(n log n)`; about 7 us a collapse.
///
/// No face is turned over to reach a size: the cage then stays larger, as the report says. Only when no more than four
/// vertices per component are asked for, the smallest cage there is, does the last stretch give up normals to get there:
/// a closed component of genus 0 ends as a tetrahedron, an open one as a triangle.
///
/// # Errors
/// A fraction that is not above 0 and at most 1, a negative or non-finite distance or boundary weight, a shape without faces, or
/// [`CageError::Cancelled`].
pub fn simplify(shape: &TriMesh, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Simplified, CageError> {
    let (asked, max_error) = resolve(shape, options)?;
    let (centre, scale) = shape.bounds().normal_frame();
    let positions: Vec<DVec3> = shape.positions.iter().map(|p| (*p - centre) * scale).collect();
    let mut simplifier = Simplifier::new(shape, positions, options.boundary_weight, max_error);
    simplifier.run(asked, progress)?;
    simplifier.finish(shape, asked)
}

/// Number of vertices asked for and the largest distance allowed.
fn resolve(shape: &TriMesh, options: &SimplifyOptions) -> Result<(Option<usize>, f64), CageError> {
    if shape.face_count() == 0 {
        return Err(CageError::NoFaces);
    }
    if !(options.boundary_weight >= 0.0 && options.boundary_weight.is_finite()) {
        return Err(CageError::BadOption { what: "boundary weight", found: options.boundary_weight.to_string() });
    }
    match options.size {
        CageSize::Vertices(n) => Ok((Some(n), f64::INFINITY)),
        CageSize::Fraction(f) if f > 0.0 && f <= 1.0 => {
            Ok((Some((f * shape.vertex_count() as f64).round() as usize), f64::INFINITY))
        }
        CageSize::Fraction(f) => {
            Err(CageError::BadOption { what: "cage size (a share above 0 and at most 1)", found: f.to_string() })
        }
        CageSize::Error(e) if e >= 0.0 && e.is_finite() => Ok((None, e)),
        CageSize::Error(e) => {
            Err(CageError::BadOption { what: "cage error (a share of the diagonal, 0 or above)", found: e.to_string() })
        }
    }
}

struct Simplifier {
    working: Working,
    quadrics: Vec<Quadric>,
    queue: Queue,
    /// Vertices still there.
    alive: Vec<bool>,
    count: usize,
    unused: usize,
    /// Connected components that have faces.
    components: usize,
    /// Largest distance a collapse may have, and the largest one made.
    max_error: f64,
    error: f64,
    /// Scratch: neighbours, and candidate targets by cost.
    ring: Vec<u32>,
    candidates: Vec<(f64, u32)>,
}

impl Simplifier {
    fn new(shape: &TriMesh, positions: Vec<DVec3>, boundary_weight: f64, max_error: f64) -> Self {
        let n = shape.vertex_count();
        let quadrics = vertex_quadrics(shape, &positions, boundary_weight);
        let alive: Vec<bool> = (0..n).map(|v| !shape.topology().vertex_faces(v).is_empty()).collect();
        let count = alive.iter().filter(|a| **a).count();
        Self {
            working: Working::new(shape, positions),
            quadrics,
            queue: Queue::new(n),
            alive,
            count,
            unused: n - count,
            // Every unused vertex counts as a component of its own.
            components: shape.topology().components().1 - (n - count),
            max_error,
            error: 0.0,
            ring: Vec::new(),
            candidates: Vec::new(),
        }
    }

    fn run(&mut self, asked: Option<usize>, progress: &dyn Progress) -> Result<(), CageError> {
        let target = asked.unwrap_or(0);
        let total = self.count.saturating_sub(target);
        let smallest = asked.is_some_and(|asked| asked <= 4 * self.components);
        for guard in &GUARDS[..if smallest { GUARDS.len() } else { 1 }] {
            for v in 0..self.alive.len() as u32 {
                self.requeue(v);
            }
            while self.count > target {
                let Some(u) = self.queue.pop() else { break };
                self.step(u, *guard);
                let done = total - (self.count - target);
                if done.is_multiple_of((total / 100).max(1)) {
                    progress.advance(done, total);
                    if progress.is_cancelled() {
                        return Err(CageError::Cancelled { what: "simplification" });
                    }
                }
            }
        }
        progress.advance(total, total);
        Ok(())
    }

    /// Collapses `u` into its cheapest legal neighbour if nothing cheaper waits; puts it back at its true cost otherwise.
    fn step(&mut self, u: u32, guard: Guard) {
        self.find_candidates(u);
        self.candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut best = (f64::INFINITY, u, 0.0);
        for i in 0..self.candidates.len() {
            let (cost, v) = self.candidates[i];
            if cost >= best.0 {
                break;
            }
            let distance = self.distance(u, v, cost);
            if distance > self.max_error {
                continue;
            }
            if let Some(quality) = self.working.may_collapse(u, v, guard) {
                let cost = cost * (GOOD_QUALITY / quality).max(1.0).powi(2);
                if cost < best.0 {
                    best = (cost, v, distance);
                }
            }
        }
        let (cost, v, distance) = best;
        if v == u {
            // No legal neighbour: it waits outside until its ring changes.
        } else if cost > self.queue.least() {
            self.queue.set(u, cost);
        } else {
            self.error = self.error.max(distance);
            self.collapse(u, v);
        }
    }

    fn collapse(&mut self, u: u32, v: u32) {
        self.working.collapse(u, v);
        self.alive[u as usize] = false;
        self.count -= 1;
        let merged = self.quadrics[u as usize];
        self.quadrics[v as usize].add(&merged);
        let mut ring = std::mem::take(&mut self.ring);
        self.working.ring(v, &mut ring);
        self.requeue(v);
        for &w in &ring {
            self.requeue(w);
        }
        self.ring = ring;
    }

    /// Puts a vertex in the queue at the cost of its cheapest neighbour, legal or not.
    fn requeue(&mut self, u: u32) {
        if !self.alive[u as usize] || self.working.locked[u as usize] {
            return;
        }
        self.find_candidates(u);
        match self.candidates.iter().map(|c| c.0).min_by(f64::total_cmp) {
            Some(least) => self.queue.set(u, least),
            None => self.queue.remove(u),
        }
    }

    /// Cost of collapsing `u` into each of its neighbours: both quadrics at the neighbour's place.
    fn find_candidates(&mut self, u: u32) {
        let mut candidates = std::mem::take(&mut self.candidates);
        candidates.clear();
        let own = self.quadrics[u as usize];
        let candidate = |v: u32| {
            let p = self.working.positions[v as usize];
            (own.at(p) + self.quadrics[v as usize].at(p), v)
        };
        // Around a closed fan every neighbour follows `u` in exactly one face.
        candidates.extend(self.working.followers(u, 1).map(candidate));
        if self.working.is_open_fan(u) {
            let known = candidates.len();
            for last in self.working.followers(u, 2) {
                if candidates[..known].iter().all(|c| c.1 != last) {
                    candidates.push(candidate(last));
                }
            }
        }
        self.candidates = candidates;
    }

    /// Root mean square distance that a cost stands for, over the area of both vertices.
    fn distance(&self, u: u32, v: u32, cost: f64) -> f64 {
        let area = self.quadrics[u as usize].area + self.quadrics[v as usize].area;
        if area > 0.0 { (cost / area).sqrt() } else { 0.0 }
    }

    fn finish(self, shape: &TriMesh, asked: Option<usize>) -> Result<Simplified, CageError> {
        let origin: Vec<u32> = (0..self.alive.len() as u32).filter(|&v| self.alive[v as usize]).collect();
        let mut number = vec![u32::MAX; self.alive.len()];
        for (new, &old) in origin.iter().enumerate() {
            number[old as usize] = new as u32;
        }
        let working = &self.working;
        let faces: Vec<[u32; 3]> = working.faces.iter().copied().filter(|f| *f != DEAD).collect();
        // A face that was not touched is as it was, even if the shape folds over there.
        let changed =
            working.faces.iter().zip(shape.triangles()).filter(|(now, before)| **now != DEAD && now != before);
        let flipped_faces = changed.filter(|(now, _)| working.is_flipped(**now)).count();
        let report = SimplifyReport {
            asked,
            reached: origin.len(),
            estimated_error: self.error,
            locked: self.working.locked.iter().filter(|l| **l).count(),
            unused: self.unused,
            flipped_faces,
        };
        let positions = origin.iter().map(|&v| shape.positions[v as usize]).collect();
        let mesh = TriMesh::new(positions, faces.into_iter().map(|f| f.map(|v| number[v as usize])).collect())?;
        Ok(Simplified { mesh, origin, report })
    }
}

/// Garland and Heckbert, Section 5: planes of the incident faces weighted by area, and steep planes through boundary edges.
fn vertex_quadrics(shape: &TriMesh, positions: &[DVec3], boundary_weight: f64) -> Vec<Quadric> {
    let topology = shape.topology();
    let mut quadrics = vec![Quadric::default(); positions.len()];
    for (f, t) in shape.triangles().iter().enumerate() {
        let p = t.map(|v| positions[v as usize]);
        let area_vector = face_area_vector(p);
        let area = area_vector.length();
        let Some(normal) = area_vector.try_normalize() else { continue };
        let mut plane = Quadric::plane(normal, p[0], area);
        plane.area = area;
        for (k, e) in topology.face_edges(f).into_iter().enumerate() {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            if topology.is_boundary_edge(e as usize) {
                let side = p[j] - p[i];
                let weight = boundary_weight * side.length_squared();
                if let Some(across) = side.cross(normal).try_normalize() {
                    let steep = Quadric::plane(across, p[i], weight);
                    quadrics[t[i] as usize].add(&steep);
                    quadrics[t[j] as usize].add(&steep);
                }
            }
        }
        for &v in t {
            quadrics[v as usize].add(&plane);
            quadrics[v as usize].add(&Quadric::point(positions[v as usize], POINT_WEIGHT * area));
        }
    }
    quadrics
}
