use std::sync::Arc;

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, leaf_collapser::collapse, reinsertion::ReinsertionOptimizer};
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

use super::check_positions;
use crate::{Bounds, MeshError, Topology, TriMesh};

/// A half-line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it leads; any length but 0.
    pub direction: DVec3,
}

/// Where a ray meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The face.
    pub face: u32,
    /// Weights of the face's corners at the point: not negative, with a sum of 1.
    pub barycentric: [f64; 3],
    /// From the ray's origin to the point, in units of the model.
    pub distance: f64,
    /// The point, on the face.
    pub point: DVec3,
}

impl Hit {
    /// The corner of the face with the largest weight: the vertex that a click means.
    ///
    /// # Panics
    /// If the hit is of another mesh with fewer faces.
    pub fn vertex(&self, topology: &Topology) -> u32 {
        let [a, b, c] = self.barycentric;
        let corner = if a >= b && a >= c { 0 } else { 1 + usize::from(c > b) };
        topology.triangles()[self.face as usize][corner]
    }
}

/// Answers where rays meet a surface, by a tree of boxes.
///
/// Boxes are kept in single precision, in a frame where the surface fills a unit cube, and a little too large; rays and
/// faces meet in double precision. So the tree only decides what is looked at, and every answer is that of looking at
/// all faces.
#[derive(Clone)]
pub struct RayCaster {
    topology: Arc<Topology>,
    /// In units of the model.
    positions: Vec<DVec3>,
    /// Centre and scale of the unit frame, as in `(p - centre) * scale`.
    frame: (DVec3, f64),
    tree: Bvh2,
    /// Cost of the tree when it was built.
    built_cost: f64,
}

impl std::fmt::Debug for RayCaster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let nodes = self.tree.nodes.len();
        f.debug_struct("RayCaster").field("faces", &self.topology.triangles().len()).field("nodes", &nodes).finish()
    }
}

/// A ray in the unit frame, moved up to the surface's box.
struct UnitRay {
    origin: DVec3,
    /// Of unit length.
    direction: DVec3,
    inverse: DVec3,
    /// How far it was moved.
    skipped: f64,
    /// Axes in the order of Woop et al., the last being the one it is steepest along, and the shear that makes it that axis.
    axes: [usize; 3],
    shear: [f64; 2],
}

/// What boxes are enlarged by, in the unit frame: well over the rounding of single precision, and of rays within the frame.
const MARGIN: f64 = 1e-6;
/// A tree is built anew once moved faces have made it this many times as costly as it was.
const WORN: f64 = 2.0;
/// Hits nearer than this to a vertex, in the unit frame, are at the vertex.
const TOUCH: f64 = 1e-9;

impl RayCaster {
    /// A tree of the faces of `mesh`. `O(n log n)`, about half a second for a million faces.
    pub fn new(mesh: &TriMesh) -> Self {
        let mut caster = Self {
            topology: mesh.shared_topology(),
            positions: mesh.positions.clone(),
            frame: unit_frame(&mesh.positions),
            tree: Bvh2::default(),
            built_cost: 0.0,
        };
        caster.build();
        caster
    }

    /// Moves the vertices. Boxes are fitted to the faces in linear time; where that makes a bad tree, it is built anew.
    ///
    /// # Errors
    /// Another number of positions than of vertices, or one that is not finite; then nothing is changed.
    pub fn update(&mut self, positions: &[DVec3]) -> Result<(), MeshError> {
        check_positions(&self.topology, positions)?;
        if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NotFinite { vertex });
        }
        self.positions.copy_from_slice(positions);
        self.frame = unit_frame(positions);
        for n in 0..self.tree.nodes.len() {
            let node = &self.tree.nodes[n];
            if node.is_leaf() {
                let faces = node.first_index as usize..(node.first_index + node.prim_count) as usize;
                let boxes = self.tree.primitive_indices[faces].iter().map(|&f| self.face_box(f));
                if let Some(around) = boxes.reduce(|a, b| a.union(&b)) {
                    self.tree.nodes[n].set_aabb(around);
                }
            }
        }
        self.tree.refit_all();
        if self.cost() > WORN * self.built_cost {
            self.build();
        }
        Ok(())
    }

    /// The first face that a ray meets, from either side; the lowest one where several are equally far. `None` if it meets none, or
    /// is not finite, or has no direction. About `O(log n)`.
    ///
    /// The test of a face is watertight (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", 2013): a ray does not slip
    /// through between faces that share an edge. Faces without area, and those seen exactly from the side, are not met.
    pub fn pick(&self, ray: &Ray) -> Option<Hit> {
        let ray = self.to_unit(ray)?;
        let mut best: Option<(f64, u32, [f64; 3])> = None;
        self.visit(&ray, f64::INFINITY, |face, limit| {
            if let Some((t, weights)) = ray.meet(self.unit_corners(face))
                && best.is_none_or(|(least, lowest, _)| t < least || (t == least && face < lowest))
            {
                best = Some((t, face, weights));
                return t;
            }
            limit
        });
        let (t, face, barycentric) = best?;
        let corners = self.topology.triangles()[face as usize].map(|v| self.positions[v as usize]);
        // Round one corner, so that the point of a face far from the origin stays on it.
        let point =
            corners[0] + (corners[1] - corners[0]) * barycentric[1] + (corners[2] - corners[0]) * barycentric[2];
        Some(Hit { face, barycentric, distance: (ray.skipped + t) / self.frame.1, point })
    }

    /// Whether a face lies between a vertex and the point `reach * direction` away from it. Faces at the vertex, or that touch its
    /// place, do not count.
    pub(super) fn is_hidden(&self, vertex: u32, direction: DVec3, reach: f64) -> bool {
        let origin = self.positions[vertex as usize];
        let reach = reach * direction.length() * self.frame.1;
        let Some(ray) = self.to_unit(&Ray { origin, direction }) else {
            return false;
        };
        let mut hidden = false;
        self.visit(&ray, reach, |face, limit| {
            let own = || self.topology.triangles()[face as usize].contains(&vertex);
            let meets = |t: f64| t > TOUCH && t < reach;
            hidden = hidden || (ray.meet(self.unit_corners(face)).is_some_and(|(t, _)| meets(t)) && !own());
            if hidden { f64::NEG_INFINITY } else { limit }
        });
        hidden
    }

    /// Number of vertices of the surface.
    pub(super) fn vertex_count(&self) -> usize {
        self.positions.len()
    }

    fn build(&mut self) {
        let boxes: Vec<Aabb> = (0..self.topology.triangles().len() as u32).map(|f| self.face_box(f)).collect();
        let all = (0..boxes.len() as u32).collect();
        let mut builder = PlocBuilder::with_capacity(boxes.len());
        self.tree = builder.build(PlocSearchDistance::Low, &boxes, all, SortPrecision::U64, 2);
        ReinsertionOptimizer::default().run(&mut self.tree, 0.02, None);
        collapse(&mut self.tree, 8, 3.0);
        self.built_cost = self.cost();
    }

    /// Summed area of the boxes against that of the outermost: the expected number of boxes that a random ray meets.
    fn cost(&self) -> f64 {
        let area = |aabb: &Aabb| f64::from(aabb.half_area());
        let all: f64 = self.tree.nodes.iter().map(|n| area(n.aabb())).sum();
        self.tree.nodes.first().map_or(0.0, |root| all / area(root.aabb()))
    }

    fn to_frame(&self, p: DVec3) -> DVec3 {
        (p - self.frame.0) * self.frame.1
    }

    fn unit_corners(&self, face: u32) -> [DVec3; 3] {
        self.topology.triangles()[face as usize].map(|v| self.to_frame(self.positions[v as usize]))
    }

    fn face_box(&self, face: u32) -> Aabb {
        let [a, b, c] = self.unit_corners(face);
        let (min, max) = (a.min(b).min(c) - MARGIN, a.max(b).max(c) + MARGIN);
        Aabb::new(Vec3A::from(min.as_vec3()), Vec3A::from(max.as_vec3()))
    }

    fn to_unit(&self, ray: &Ray) -> Option<UnitRay> {
        // Brought to about unit length first, as squares of a long direction overflow and those of a short one vanish.
        let direction = (ray.direction / ray.direction.abs().max_element()).try_normalize()?;
        let origin = self.to_frame(ray.origin);
        let inverse = direction.recip();
        let root = self.tree.nodes.first()?.aabb();
        let skipped = enter(root, origin, inverse, f64::INFINITY).filter(|_| origin.is_finite())?;
        let last = (0..3).max_by(|&i, &j| direction[i].abs().total_cmp(&direction[j].abs()))?;
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let shear = [0, 1].map(|k| direction[axes[k]] / direction[last]);
        Some(UnitRay { origin: origin + direction * skipped, direction, inverse, skipped, axes, shear })
    }

    /// Calls `look(face, limit)` for all faces whose boxes the ray meets within `limit`, nearer boxes first; the answer is the limit
    /// from there on.
    fn visit(&self, ray: &UnitRay, mut limit: f64, mut look: impl FnMut(u32, f64) -> f64) {
        let nodes = &self.tree.nodes;
        // Boxes are entered up to their margin before what they hold; a hit may be that much nearer than its box.
        let entry = |n: u32, limit: f64| enter(nodes[n as usize].aabb(), ray.origin, ray.inverse, limit + MARGIN);
        let mut stack = Vec::with_capacity(64);
        stack.extend((!nodes.is_empty()).then_some((0.0, 0_u32)));
        while let Some((at, n)) = stack.pop() {
            if at > limit + MARGIN {
                continue;
            }
            let node = &nodes[n as usize];
            if node.is_leaf() {
                let faces = node.first_index as usize..(node.first_index + node.prim_count) as usize;
                for &face in &self.tree.primitive_indices[faces] {
                    limit = look(face, limit);
                }
                continue;
            }
            let [left, right] = [node.first_index, node.first_index + 1].map(|c| entry(c, limit).map(|t| (t, c)));
            let swap = left.zip(right).is_some_and(|(l, r)| l.0 < r.0);
            let (later, sooner) = if swap { (right, left) } else { (left, right) };
            stack.extend(later);
            stack.extend(sooner);
        }
    }
}

impl UnitRay {
    /// How far off the face is and the weights of its corners at the hit.
    fn meet(&self, corners: [DVec3; 3]) -> Option<(f64, [f64; 3])> {
        let [x, y, z] = self.axes;
        let [a, b, c] = corners.map(|p| p - self.origin);
        let [(ax, ay), (bx, by), (cx, cy)] =
            [a, b, c].map(|p| (p[x] - self.shear[0] * p[z], p[y] - self.shear[1] * p[z]));
        // Twice the areas between the ray and the edges, seen along the ray. The products are the same, up to order, for both faces
        // of an edge, so that no ray is on the outer side of it for both.
        let areas = [cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax];
        let sum: f64 = areas.iter().sum();
        let outside = areas.iter().any(|&u| u < 0.0) && areas.iter().any(|&u| u > 0.0);
        if outside || sum == 0.0 {
            return None;
        }
        let weights = areas.map(|u| u / sum);
        let depth = weights[0] * a[z] + weights[1] * b[z] + weights[2] * c[z];
        let t = depth / self.direction[z];
        (t >= 0.0 && t.is_finite()).then_some((t, weights))
    }
}

/// How far along a ray a box is entered (0 from within), if that is within `limit`.
fn enter(aabb: &Aabb, origin: DVec3, inverse: DVec3, limit: f64) -> Option<f64> {
    let (mut near, mut far) = (0.0_f64, limit);
    for k in 0..3 {
        let a = (f64::from(aabb.min[k]) - origin[k]) * inverse[k];
        let b = (f64::from(aabb.max[k]) - origin[k]) * inverse[k];
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    (near <= far).then_some(near)
}

/// Centre and scale that put points into the cube from -1/2 to 1/2; without extent, or with one too small to divide by, the scale is 1.
fn unit_frame(positions: &[DVec3]) -> (DVec3, f64) {
    let bounds = Bounds::of(positions);
    // Halved first: the difference of two large coordinates may overflow.
    let scale = 0.5 / (0.5 * bounds.max - 0.5 * bounds.min).max_element();
    (bounds.centre(), if scale.is_finite() { scale } else { 1.0 })
}

#[cfg(test)]
#[path = "ray_tests.rs"]
mod tests;
