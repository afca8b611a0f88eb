//! Generated models for tests, examples, benches and the demo: nothing has to be downloaded to try anything.
//!
//! Every generator is deterministic to the bit, for any number of threads, and orients its faces counter-clockwise seen
//! from outside. y is up and +z is to the front.

mod bones;
mod creature;
mod even;
mod implicit;
mod primitives;
mod relief;

pub use creature::creature;
pub use primitives::{MAX_ICOSPHERE_LEVEL, bar, bumpy_plane, cylinder, icosphere, plane_grid, torus};

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::TriMesh;

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
