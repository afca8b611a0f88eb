use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::{Topology, best_rotation, outer};

/// Number of faces of `pose` that turned over against the surface round them.
///
/// A face is flipped if its normal makes more than a right angle with its normal at rest, turned by the rotation that best takes the edges at
/// its three corners from rest to the pose (least squares, every edge weighing by its length squared). So a similarity flips none, nor does
/// a bend however far, and a face folded over onto its neighbours counts. Faces without area, at rest or in the pose, have no normal and
/// do not. A face with a corner that is not finite does, so that no pose looks the better for it; edges to such a corner are left out of the
/// fits. A surface that is mirrored as a whole has no face that differs from its neighbours: its volume tells ([`super::volume_change`]).
///
/// Meshes may be open or not manifold. Costs one small rotation fit a face; parallel.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn flipped_faces(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> usize {
    let (rest, pose) = (Arms::new(topology, rest), Arms::new(topology, pose));
    let is_finite = |v: u32| rest.positions[v as usize].is_finite() && pose.positions[v as usize].is_finite();
    let covariances: Vec<DMat3> = (0..topology.vertex_count() as u32)
        .into_par_iter()
        .map(|v| {
            let neighbours = topology.neighbours(v as usize).iter().filter(|j| is_finite(**j));
            neighbours.map(|&j| outer(pose.arm(v, j), rest.arm(v, j))).fold(DMat3::ZERO, |sum, term| sum + term)
        })
        .collect();
    let is_flipped = |&[a, b, c]: &[u32; 3]| {
        let normal = |of: &Arms| of.arm(a, b).cross(of.arm(a, c));
        let rotation = best_rotation([a, b, c].iter().fold(DMat3::ZERO, |sum, &v| sum + covariances[v as usize]));
        normal(&pose).dot(rotation * normal(&rest)) < 0.0
    };
    let counts = |face: &&[u32; 3]| face.iter().any(|v| !is_finite(*v)) || is_flipped(face);
    topology.triangles().par_iter().filter(counts).count()
}

/// Edges of a pose in units of its longest, so that products of six lengths neither over- nor underflow.
struct Arms<'a> {
    positions: &'a [DVec3],
    unit: f64,
}

impl<'a> Arms<'a> {
    fn new(topology: &Topology, positions: &'a [DVec3]) -> Self {
        // Along the axes, and halved: squares, and differences of large coordinates, may overflow.
        let extent =
            |&[a, b]: &[u32; 2]| (0.5 * positions[a as usize] - 0.5 * positions[b as usize]).abs().max_element();
        let longest = topology.edges().iter().map(extent).filter(|e| e.is_finite()).fold(0.0, f64::max);
        Self { positions, unit: if longest > 0.0 { longest } else { 1.0 } }
    }

    fn arm(&self, from: u32, to: u32) -> DVec3 {
        self.positions[to as usize] / self.unit - self.positions[from as usize] / self.unit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Similarity, TriMesh, shapes};

    /// A grid of unit squares, `n` by `n` vertices, each square cut in two.
    fn grid(n: u32) -> TriMesh {
        let positions = (0..n * n).map(|i| DVec3::new(f64::from(i % n), f64::from(i / n), 0.0)).collect();
        let square = |i: u32| [[i, i + 1, i + n + 1], [i, i + n + 1, i + n]];
        let corners = (0..n * (n - 1)).filter(|i| i % n + 1 < n);
        TriMesh::new(positions, corners.flat_map(square).collect()).expect("a grid")
    }

    #[test]
    fn similarities_and_bends_flip_nothing_at_any_scale() {
        for mesh in [shapes::icosphere(3), grid(8)] {
            for scale in [1e-12, 1.0, 1e12] {
                let motion = Similarity::about(DVec3::ONE, DVec3::new(1.0, 2.0, 3.0), 2.5, scale);
                let pose: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
                assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &pose), 0);
            }
        }
        // A sheet rolled up twice: normals turn by 720 degrees from end to end.
        let mesh = grid(40);
        let turn = 4.0 * std::f64::consts::PI / 39.0;
        let roll = |p: &DVec3| DVec3::new((turn * p.x).sin() / turn, p.y, (1.0 - (turn * p.x).cos()) / turn);
        let pose: Vec<DVec3> = mesh.positions.iter().map(roll).collect();
        assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &pose), 0);
    }

    /// A vertex drawn across the far side of a face turns exactly that face over: of the six round it, the one whose opposite edge
    /// it crosses.
    #[test]
    fn a_vertex_drawn_over_an_edge_flips_the_face_between() {
        let mesh = grid(9);
        let v = 4 * 9 + 4;
        let mut pose = mesh.positions.clone();
        // The face to the upper right above the diagonal has the opposite edge from (5, 5) to (4, 5).
        pose[v] += DVec3::new(0.6, 1.2, 0.0);
        let signed = |of: &[DVec3], [a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|v| of[v as usize]);
            (b - a).cross(c - a).z
        };
        let turned = mesh.triangles().iter().filter(|face| signed(&pose, **face) < 0.0).count();
        assert_eq!((turned, flipped_faces(mesh.topology(), &mesh.positions, &pose)), (1, 1));
        // Turning all of it changes nothing, turned about an axis in the plane included.
        for axis in [DVec3::X, DVec3::new(1.0, -1.0, 2.0)] {
            let motion = Similarity::about(DVec3::ZERO, axis, 3.0, 2.0);
            let moved: Vec<DVec3> = pose.iter().map(|p| motion.apply(*p)).collect();
            assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &moved), 1, "{axis}");
        }
    }

    #[test]
    fn faces_without_area_are_not_flipped() {
        let mesh = grid(3);
        let point = vec![DVec3::ONE; 9];
        let line: Vec<DVec3> = mesh.positions.iter().map(|p| DVec3::X * p.x).collect();
        for pose in [&point, &line] {
            assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, pose), 0);
            assert_eq!(flipped_faces(mesh.topology(), pose, &mesh.positions), 0);
        }
    }

    /// A vertex that is not finite spoils its own faces and no other; sizes near the ends of the range of numbers spoil nothing.
    #[test]
    fn faces_that_are_not_finite_count() {
        let mesh = grid(9);
        let v = 4 * 9 + 4;
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut pose = mesh.positions.clone();
            pose[v].y = bad;
            assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &pose), 6);
            assert_eq!(flipped_faces(mesh.topology(), &pose, &mesh.positions), 6);
            pose.fill(DVec3::splat(bad));
            assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &pose), mesh.face_count());
        }
        let mut pose = mesh.positions.clone();
        pose[v] += DVec3::new(0.6, 1.2, 0.0);
        for scale in [1e-250, 1e-100, 1e200, 1e306] {
            let scaled: Vec<DVec3> = pose.iter().map(|p| *p * scale).collect();
            assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &scaled), 1, "{scale}");
        }
    }

    /// Three fans of faces on one edge, one of which is folded back.
    #[test]
    fn meshes_need_not_be_manifold() {
        let wing = |angle: f64| DVec3::new(angle.cos(), angle.sin(), 0.5);
        let positions: Vec<DVec3> = [DVec3::ZERO, DVec3::Z].into_iter().chain([0.0, 2.0, 4.0].map(wing)).collect();
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [0, 1, 3], [0, 1, 4]]).expect("valid indices");
        assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &mesh.positions), 0);
        let mut pose = mesh.positions.clone();
        pose[4] = wing(4.0 - std::f64::consts::PI);
        assert_eq!(flipped_faces(mesh.topology(), &mesh.positions, &pose), 1);
    }
}
