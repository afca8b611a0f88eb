use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::{Topology, best_rotation, outer};

/// Number of faces of `pose` that turned over against the surface round them.
///
/// A face is flipped if its normal makes more than a right angle with its normal at rest, turned by the rotation that best takes the edges at
/// its three corners from rest to the pose (least squares, every edge weighing by its length squared). So a similarity flips none, nor does
/// a bend however far, and a face folded over onto its neighbours counts. Faces without area, at rest or in the pose, have no normal and
/// do not. A surface that is mirrored as a whole has no face that differs from its neighbours: its volume tells
/// ([`super::volume_change`]).
///
/// Costs one small rotation fit a face.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn flipped_faces(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> usize {
    let size = super::edge_length::longest_edge(topology, rest).max(super::edge_length::longest_edge(topology, pose));
    if !(size > 0.0 && size.is_finite()) {
        return 0;
    }
    // In units of the longest edge, so that products of six lengths neither over- nor underflow.
    let arm = |of: &[DVec3], from: u32, to: u32| (of[to as usize] - of[from as usize]) / size;
    let covariances: Vec<DMat3> = (0..topology.vertex_count() as u32)
        .into_par_iter()
        .map(|v| {
            let neighbours = topology.neighbours(v as usize).iter();
            neighbours.map(|&j| outer(arm(pose, v, j), arm(rest, v, j))).fold(DMat3::ZERO, |sum, term| sum + term)
        })
        .collect();
    let is_flipped = |&[a, b, c]: &[u32; 3]| {
        let normal = |of: &[DVec3]| arm(of, a, b).cross(arm(of, a, c));
        let rotation = best_rotation([a, b, c].iter().fold(DMat3::ZERO, |sum, &v| sum + covariances[v as usize]));
        normal(pose).dot(rotation * normal(rest)) < 0.0
    };
    topology.triangles().par_iter().filter(|face| is_flipped(face)).count()
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
}
