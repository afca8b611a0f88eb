//! Generated models for tests, examples, benches and the demo: nothing has to be downloaded to try anything.
//!
//! Every generator is deterministic to the bit, for any number of threads, and orients its faces counter-clockwise seen
//! from outside. y is up and +z is to the front.

mod bones;
mod by_name;
mod cactus;
mod creature;
mod even;
mod implicit;
mod lattice;
mod primitives;
mod relief;

pub use by_name::{NAMES, by_name};
pub use cactus::cactus;
pub use creature::creature;
pub use primitives::{MAX_ICOSPHERE_LEVEL, bar, bumpy_plane, cylinder, icosphere, plane_grid, torus};

use crate::MeshError;

/// Refuses a number of vertices out of a generator's range.
fn check_vertices(vertices: usize, least: usize, most: usize) -> Result<(), MeshError> {
    if (least..=most).contains(&vertices) {
        return Ok(());
    }
    let expected = format!("between {least} and {most}");
    Err(MeshError::BadParameter { what: "vertices", expected, found: vertices.to_string() })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::{TriMesh, face_area_vector};

    /// Sum over the vertices of a full turn less the angles of the faces there.
    pub(super) fn total_angle_defect(mesh: &TriMesh) -> f64 {
        let mut defect = vec![std::f64::consts::TAU; mesh.vertex_count()];
        for (f, triangle) in mesh.triangles().iter().enumerate() {
            let p = mesh.corners(f);
            for k in 0..3 {
                defect[triangle[k] as usize] -= angle(p, k);
            }
        }
        defect.iter().sum()
    }

    /// Angle of a triangle at corner `k`, in radians.
    pub(super) fn angle(p: [DVec3; 3], k: usize) -> f64 {
        let (u, v) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        u.cross(v).length().atan2(u.dot(v))
    }

    /// The smallest angle of any face, in radians.
    pub(super) fn smallest_angle(mesh: &TriMesh) -> f64 {
        let angles = (0..mesh.face_count()).flat_map(|f| (0..3).map(move |k| angle(mesh.corners(f), k)));
        angles.fold(f64::INFINITY, f64::min)
    }

    pub(super) fn surface_area(mesh: &TriMesh) -> f64 {
        (0..mesh.face_count()).map(|f| face_area_vector(mesh.corners(f)).length()).sum()
    }

    /// Asserts the number of vertices to 2 %.
    pub(super) fn assert_count(mesh: &TriMesh, vertices: usize) {
        let found = mesh.vertex_count();
        assert!(found.abs_diff(vertices) * 50 <= vertices, "{found} instead of {vertices}");
    }

    /// Asserts one closed, manifold, outward oriented component of the given Euler characteristic, with Gauss-Bonnet.
    pub(super) fn assert_closed(mesh: &TriMesh, euler: i64) {
        let topology = mesh.topology();
        assert_eq!(topology.require_manifold(), Ok(()));
        assert_eq!(topology.require_closed(), Ok(()));
        assert_eq!(topology.require_oriented(), Ok(()));
        assert_eq!(topology.components().1, 1);
        assert_eq!(topology.euler_characteristic(), euler);
        assert!(mesh.signed_volume() > 0.0);
        let expected = std::f64::consts::TAU * euler as f64;
        let defect = total_angle_defect(mesh);
        // Angles are exact to a few units in the last place of a full turn, and errors add up at worst.
        assert!((defect - expected).abs() < 1e-14 * (10 * mesh.vertex_count()) as f64, "{defect} is not {expected}");
    }
}
