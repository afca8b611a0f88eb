//! How the fixed part stands in the incoming pose.

use glam::{DMat3, DVec3};
use pliant_mesh::{TriMesh, best_rotation, best_scale, face_area_vector, outer};

use super::orientation::Turn;
use crate::patch::{Held, Patch};

/// A face whose area is below this share of its longest side's square says nothing of how it is turned.
const FLAT: f64 = 1e-6;

/// Fixed vertices next to unknown ones, whose frames are read from the pose.
///
/// The turn of such a vertex is the rotation (and scale) that best takes the edges to its neighbours from rest to the pose, looked for in
/// faces that are fixed as a whole: other faces stand where an earlier solution left them, and the result must not depend on that. Where
/// there is no such face, it is that of all fixed vertices together, so that lone ones act as anchors.
pub(super) struct Rim {
    vertices: Vec<RimVertex>,
    /// Ends of edges of fixed faces at the vertices.
    ends: Vec<u32>,
    /// All of the patch.
    fixed: Vec<u32>,
}

struct RimVertex {
    vertex: u32,
    /// Of `ends`.
    first: usize,
    last: usize,
}

impl Rim {
    pub(super) fn new(patch: &Patch) -> Self {
        let (mesh, held) = (&patch.mesh, &patch.held);
        let is_fixed = |v: u32| held[v as usize] == Held::Fixed;
        let (mut vertices, mut ends) = (Vec::new(), Vec::new());
        let fixed: Vec<u32> = (0..held.len() as u32).filter(|&v| is_fixed(v)).collect();
        for &v in &fixed {
            let topology = mesh.topology();
            if !topology.neighbours(v as usize).iter().any(|&w| held[w as usize].is_unknown()) {
                continue;
            }
            let first = ends.len();
            for &face in topology.vertex_faces(v as usize) {
                let triangle = mesh.triangles()[face as usize];
                if triangle.iter().all(|&w| is_fixed(w)) && is_broad(mesh.corners(face as usize)) {
                    ends.extend(triangle.into_iter().filter(|&w| w != v));
                }
            }
            vertices.push(RimVertex { vertex: v, first, last: ends.len() });
        }
        Self { vertices, ends, fixed }
    }

    /// Writes the turns of the rim's vertices in a pose, one point per vertex of the patch.
    pub(super) fn read(&self, rest: &TriMesh, pose: &[DVec3], turns: &mut [Turn]) {
        let rest = &rest.positions;
        let whole = if self.vertices.iter().any(|v| v.first == v.last) {
            let mean = |points: &[DVec3]| {
                self.fixed.iter().map(|&v| points[v as usize]).sum::<DVec3>() / self.fixed.len() as f64
            };
            fit(rest, pose, (mean(rest), mean(pose)), &self.fixed)
        } else {
            Turn::IDENTITY
        };
        for &RimVertex { vertex, first, last } in &self.vertices {
            let v = vertex as usize;
            turns[v] = if first == last { whole } else { fit(rest, pose, (rest[v], pose[v]), &self.ends[first..last]) };
        }
    }
}

fn is_broad([a, b, c]: [DVec3; 3]) -> bool {
    let side = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    face_area_vector([a, b, c]).length() > FLAT * side
}

/// The rotation and scale that best take the vectors from a centre to `ends` from rest to pose.
fn fit(rest: &[DVec3], pose: &[DVec3], centres: (DVec3, DVec3), ends: &[u32]) -> Turn {
    let vectors = || ends.iter().map(|&w| (rest[w as usize] - centres.0, pose[w as usize] - centres.1));
    // Exactly, where nothing has moved.
    if vectors().all(|(e, moved)| e == moved) {
        return Turn::IDENTITY;
    }
    let (mut covariance, mut squares) = (DMat3::ZERO, 0.0);
    for (e, moved) in vectors() {
        covariance += outer(moved, e);
        squares += e.length_squared();
    }
    let rotation = best_rotation(covariance);
    Turn { linear: rotation, log_scale: best_scale(rotation, covariance, squares).ln() }
}
