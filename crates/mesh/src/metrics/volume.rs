use glam::DVec3;

use crate::Topology;

/// Signed volume of a pose, in cubed units: positive for a closed mesh whose faces are counter-clockwise seen from outside.
///
/// `None` for a mesh that encloses none ([`Topology::is_cycle`]): one with a boundary, or with faces that are not oriented alike. NaN if a
/// position that a face uses is not finite. One pass over the faces.
///
/// # Panics
/// If `positions` is shorter than the number of vertices.
pub fn signed_volume(topology: &Topology, positions: &[DVec3]) -> Option<f64> {
    is_enclosing(topology).then(|| volume_and_rounding(topology, positions).0)
}

/// Change of the signed volume from `rest` to `pose` as a share of the volume at rest: 0 for a rigid motion, `s^3 - 1` for a scale `s`,
/// -2 where a mirror turned the surface inside out.
///
/// `None` for a mesh that encloses no volume ([`signed_volume`]), or none at rest that rounding could not be all of. NaN if a position that
/// a face uses is not finite.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn volume_change(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> Option<f64> {
    if !is_enclosing(topology) {
        return None;
    }
    let (before, rounding) = volume_and_rounding(topology, rest);
    // So that NaN, which is no answer but no absence either, passes.
    let is_flat = before.abs() <= rounding;
    (!is_flat).then(|| volume_and_rounding(topology, pose).0 / before - 1.0)
}

fn is_enclosing(topology: &Topology) -> bool {
    !topology.triangles().is_empty() && topology.is_cycle()
}

/// The signed volume, and a bound of what rounding of the positions and in the sum may have put into it.
fn volume_and_rounding(topology: &Topology, positions: &[DVec3]) -> (f64, f64) {
    // Any origin gives the same sum; one on the surface loses no digits to a mesh far from 0.
    let origin = topology.triangles().first().map_or(DVec3::ZERO, |face| positions[face[0] as usize]);
    let (mut six_fold, mut size) = (0.0, 0.0);
    for face in topology.triangles() {
        let [a, b, c] = face.map(|v| positions[v as usize]);
        let (arm, side, other) = (a - origin, b - a, c - a);
        six_fold += arm.dot(side.cross(other));
        size += (arm.length() + side.length()) * side.length() * other.length();
    }
    (six_fold / 6.0, 4.0 * f64::EPSILON * size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Similarity, TriMesh, shapes};

    /// A corner of a cube of side 2 has a sixth of its volume.
    fn corner() -> TriMesh {
        let corners = vec![DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y, 2.0 * DVec3::Z];
        TriMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]).expect("a tetrahedron")
    }

    #[test]
    fn volume_of_a_tetrahedron_at_any_place() {
        let mesh = corner();
        for offset in [0.0, -3.0, 1e6] {
            let moved: Vec<DVec3> = mesh.positions.iter().map(|p| *p + offset).collect();
            let volume = signed_volume(mesh.topology(), &moved).expect("closed");
            // Positions at 1e6 are spaced by 1e-10, differences of them are exact.
            assert!((volume - 8.0 / 6.0).abs() < 1e-12, "{volume}");
        }
        assert!((mesh.signed_volume() - 8.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn change_is_that_of_the_determinant() {
        for mesh in [corner(), shapes::icosphere(2)] {
            for stretch in [DVec3::ONE, DVec3::splat(1.1), DVec3::new(2.0, 0.5, 0.7), DVec3::new(-1.0, 1.0, 1.0)] {
                let pose: Vec<DVec3> = mesh.positions.iter().map(|p| *p * stretch).collect();
                let change = volume_change(mesh.topology(), &mesh.positions, &pose).expect("closed");
                assert!((change - (stretch.element_product() - 1.0)).abs() < 1e-12, "{stretch}: {change}");
            }
        }
    }

    /// Of a sheet turned out of the axes only rounding has a volume.
    #[test]
    fn open_and_flat_meshes_have_no_change() {
        let open = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).expect("a triangle");
        assert_eq!(volume_change(open.topology(), &open.positions, &open.positions), None);
        let turn = Similarity::about(DVec3::new(0.3, 0.1, -2.0), DVec3::new(1.0, 2.0, 3.0), 1.0, 1.0);
        for mesh in [corner(), shapes::icosphere(4)] {
            for scale in [1e-12, 1.0, 1e12] {
                let turned = |p: &DVec3| turn.apply(*p) * scale;
                let flat: Vec<DVec3> = mesh.positions.iter().map(|p| turned(&p.with_z(0.0))).collect();
                assert_eq!(volume_change(mesh.topology(), &flat, &mesh.positions), None);
                let squashed = |p: &DVec3| turned(&(*p * DVec3::new(1.0, 1.0, 1e-9)));
                let thin: Vec<DVec3> = mesh.positions.iter().map(squashed).collect();
                let full: Vec<DVec3> = mesh.positions.iter().map(turned).collect();
                let change = volume_change(mesh.topology(), &thin, &full).expect("closed");
                assert!((change * 1e-9 - 1.0).abs() < 1e-6, "{change}");
            }
            let point = vec![DVec3::X; mesh.vertex_count()];
            assert_eq!(volume_change(mesh.topology(), &mesh.positions, &point), Some(-1.0));
        }
    }

    /// Two tetrahedra on one edge enclose the sum of theirs, though four faces meet there; with one face turned over, the sum would depend
    /// on the origin.
    #[test]
    fn what_matters_is_orientation_not_manifoldness() {
        let corners =
            vec![DVec3::ZERO, 2.0 * DVec3::X, 2.0 * DVec3::Y, 2.0 * DVec3::Z, -2.0 * DVec3::Y, -2.0 * DVec3::Z];
        let mut faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 4, 1], [0, 1, 5], [1, 4, 5], [4, 0, 5]];
        let mesh = TriMesh::new(corners.clone(), faces.clone()).expect("valid indices");
        assert!(!mesh.topology().is_manifold());
        let volume = signed_volume(mesh.topology(), &mesh.positions).expect("closed");
        assert!((volume - 16.0 / 6.0).abs() < 1e-15, "{volume}");
        faces[2].swap(0, 1);
        let turned = TriMesh::new(corners, faces).expect("valid indices");
        assert!(turned.topology().is_closed());
        assert_eq!(signed_volume(turned.topology(), &turned.positions), None);
    }

    #[test]
    fn a_pose_that_is_not_finite_has_no_number_for_a_volume() {
        let mesh = corner();
        for bad in [f64::NAN, f64::INFINITY] {
            let mut pose = mesh.positions.clone();
            pose[2].z = bad;
            assert!(volume_change(mesh.topology(), &mesh.positions, &pose).expect("closed").is_nan());
            assert!(volume_change(mesh.topology(), &pose, &mesh.positions).expect("closed").is_nan());
        }
    }
}
