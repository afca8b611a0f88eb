use glam::DVec3;

use crate::Topology;

/// Signed volume of a pose, in cubed units: positive for a closed mesh whose faces are counter-clockwise seen from outside.
///
/// `None` for a mesh with a boundary, which holds none. One pass over the faces.
///
/// # Panics
/// If `positions` is shorter than the number of vertices.
pub fn signed_volume(topology: &Topology, positions: &[DVec3]) -> Option<f64> {
    let &[first, ..] = topology.triangles().first()?;
    if !topology.is_closed() {
        return None;
    }
    // Any origin gives the same sum; one on the surface loses no digits to a mesh far from 0.
    let origin = positions[first as usize];
    let six_fold = topology.triangles().iter().map(|face| {
        let [a, b, c] = face.map(|v| positions[v as usize] - origin);
        a.dot(b.cross(c))
    });
    Some(six_fold.sum::<f64>() / 6.0)
}

/// Change of the signed volume from `rest` to `pose` as a share of the volume at rest: 0 for a rigid motion, `s^3 - 1` for a scale `s`,
/// -2 where a mirror turned the surface inside out.
///
/// `None` for a mesh with a boundary or without volume at rest.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn volume_change(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> Option<f64> {
    let before = signed_volume(topology, rest).filter(|volume| *volume != 0.0)?;
    Some(signed_volume(topology, pose)? / before - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriMesh, shapes};

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

    #[test]
    fn open_and_flat_meshes_have_no_change() {
        let open = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).expect("a triangle");
        assert_eq!(volume_change(open.topology(), &open.positions, &open.positions), None);
        let mesh = corner();
        let flat = vec![DVec3::X; 4];
        assert_eq!(volume_change(mesh.topology(), &flat, &mesh.positions), None);
        assert_eq!(volume_change(mesh.topology(), &mesh.positions, &flat), Some(-1.0));
    }
}
