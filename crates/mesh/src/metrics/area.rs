use glam::DVec3;

use crate::{Topology, face_area_vector};

/// Change of the surface's area from `rest` to `pose` as a share of the area at rest: 0 for a rigid motion, `s^2 - 1` for a scale `s`,
/// -1 where the pose has none. Meshes may be open or not manifold.
///
/// A surface without area at rest has a change of 0 if it stays so, else an infinite one. NaN if a position that a face uses is not
/// finite. One pass over the faces.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn area_change(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> f64 {
    let (before, after) = (area(topology, rest), area(topology, pose));
    if before == 0.0 && after == 0.0 { 0.0 } else { (after - before) / before }
}

fn area(topology: &Topology, positions: &[DVec3]) -> f64 {
    topology.triangles().iter().map(|face| face_area_vector(face.map(|v| positions[v as usize])).length()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Similarity, TriMesh, shapes};

    #[test]
    fn similarities_change_area_by_the_square_of_their_scale() {
        let sheet = shapes::bumpy_plane(12, 7, 3.0, 1.0, 0.4, 2).expect("valid size");
        for mesh in [shapes::icosphere(2), sheet] {
            for scale in [1e-6, 0.5, 1.0, 3.0] {
                let motion = Similarity::about(DVec3::ONE, DVec3::new(1.0, 2.0, 3.0), 2.5, scale);
                let pose: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
                let change = area_change(mesh.topology(), &mesh.positions, &pose);
                assert!((change - (scale * scale - 1.0)).abs() < 1e-12, "{scale}: {change}");
            }
        }
    }

    /// Three unit squares on one edge, one of them stretched to twice its height: a third more area.
    #[test]
    fn meshes_need_not_be_manifold() {
        let ends = [DVec3::ZERO, DVec3::Z];
        let arms = [DVec3::X, DVec3::Y, -DVec3::X];
        let positions: Vec<DVec3> = ends.into_iter().chain(arms.iter().flat_map(|a| [*a, *a + DVec3::Z])).collect();
        let square = |k: u32| [[0, 2 * k, 2 * k + 1], [0, 2 * k + 1, 1]];
        let mesh = TriMesh::new(positions.clone(), (1..4).flat_map(square).collect()).expect("valid indices");
        let mut pose = positions;
        pose[4] = 2.0 * DVec3::Y;
        pose[5] = 2.0 * DVec3::Y + DVec3::Z;
        assert!((area_change(mesh.topology(), &mesh.positions, &pose) - 1.0 / 3.0).abs() < 1e-15);
        let line = vec![DVec3::X; 8];
        assert_eq!(area_change(mesh.topology(), &mesh.positions, &line), -1.0);
        assert_eq!(area_change(mesh.topology(), &line, &line), 0.0);
        assert_eq!(area_change(mesh.topology(), &line, &pose), f64::INFINITY);
        pose[3].y = f64::NAN;
        assert!(area_change(mesh.topology(), &mesh.positions, &pose).is_nan());
    }
}
