//! The dual mesh and what is kept of it: weights and heights.

use glam::{DMat3, DVec3};
use pliant_mesh::{Topology, best_rotation, outer};

/// A dual triangle with less area than this share of its longest side squared has no normal to speak of.
const THINNEST: f64 = 1e-3;

/// A sum of the magnitudes of barycentric coordinates above this means that the foot of the height is far outside the dual triangle.
const FARTHEST: f64 = 20.0;

/// A face that has three dual neighbours: how its barycentre lies to theirs (Luo et al., Eq. 3).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stencil {
    pub(super) face: u32,
    /// Faces across the edges opposite to its corners 0, 1, 2: they go round in the same sense as the corners.
    pub(super) neighbours: [u32; 3],
    /// Barycentric coordinates of the foot of the height; their sum is 1.
    pub(super) weights: [f64; 3],
    pub(super) detail: Detail,
}

/// What is kept of `v_i - sum_j w_ij v_ij`.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Detail {
    /// Its signed length along the outward unit normal of the plane of the dual neighbours.
    Height(f64),
    /// The whole vector, which turns with the surroundings: where the dual neighbours lie nearly on a line, or their plane's normal
    /// meets it too far away.
    Vector(DVec3),
}

/// The faces across the three edges of a face, opposite to its corners; `None` if an edge has not exactly two faces.
pub(super) fn dual_neighbours(topology: &Topology, face: usize) -> Option<[u32; 3]> {
    let mut neighbours = [0; 3];
    for (neighbour, edge) in neighbours.iter_mut().zip(topology.face_edges(face)) {
        match *topology.edge_faces(edge as usize) {
            [a, b] => *neighbour = if a as usize == face { b } else { a },
            _ => return None,
        }
    }
    Some(neighbours)
}

/// The barycentre of a face (Eq. 1).
pub(super) fn barycentre(topology: &Topology, pose: &[DVec3], face: usize) -> DVec3 {
    let [a, b, c] = topology.triangles()[face].map(|v| pose[v as usize]);
    (a + b + c) / 3.0
}

/// The unit normal of three dual vertices, outward where they go round counter-clockwise; `None` where they have none.
///
/// Sides are scaled first, so that nothing overflows.
pub(super) fn dual_normal([a, b, c]: [DVec3; 3]) -> Option<DVec3> {
    (b - a).try_normalize()?.cross((c - a).try_normalize()?).try_normalize()
}

impl Stencil {
    /// `dual` has the barycentres of all faces at rest.
    pub(super) fn new(face: usize, neighbours: [u32; 3], dual: &[DVec3]) -> Self {
        let at = dual[face];
        let around = neighbours.map(|j| dual[j as usize]);
        let (weights, detail) = decompose(at, around).unwrap_or_else(|| {
            let weights = [1.0 / 3.0; 3];
            (weights, Detail::Vector(at - combine(weights, around)))
        });
        Self { face: face as u32, neighbours, weights, detail }
    }

    /// `v_i - sum_j w_ij v_ij`: minus the dual Laplacian coordinate as Luo et al. sign it (Eq. 4).
    pub(super) fn difference(&self, dual: &[DVec3]) -> DVec3 {
        dual[self.face as usize] - combine(self.weights, self.around(dual))
    }

    pub(super) fn around(&self, dual: &[DVec3]) -> [DVec3; 3] {
        self.neighbours.map(|j| dual[j as usize])
    }

    /// The rotation that best takes corners and dual neighbours, as seen from the barycentre, from rest to a pose.
    pub(super) fn rotation(
        &self,
        topology: &Topology,
        rest: (&[DVec3], &[DVec3]),
        pose: (&[DVec3], &[DVec3]),
    ) -> DMat3 {
        let spokes = |(vertices, dual): (&[DVec3], &[DVec3])| {
            let centre = dual[self.face as usize];
            let [a, b, c] = topology.triangles()[self.face as usize].map(|v| vertices[v as usize]);
            let [d, e, f] = self.around(dual);
            [a, b, c, d, e, f].map(|p| p - centre)
        };
        let pairs = spokes(pose).into_iter().zip(spokes(rest));
        best_rotation(pairs.fold(DMat3::ZERO, |s, (now, before)| s + outer(now, before)))
    }
}

/// Barycentric coordinates of the foot of the height over the triangle `[a, b, c]`, and the height; `None` where they mean nothing.
fn decompose(at: DVec3, [a, b, c]: [DVec3; 3]) -> Option<([f64; 3], Detail)> {
    let normal = (b - a).cross(c - a);
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    let twice_area = normal.length();
    // A triangle of no size is thin too.
    let is_wide = twice_area > 2.0 * THINNEST * longest;
    if !is_wide {
        return None;
    }
    // What `at` has along the normal does not count in these.
    let share = |p: DVec3, q: DVec3| (p - at).cross(q - at).dot(normal) / (twice_area * twice_area);
    let (u, v) = (share(b, c), share(c, a));
    let weights = [u, v, 1.0 - u - v];
    let height = (at - a).dot(normal) / twice_area;
    (weights.iter().map(|w| w.abs()).sum::<f64>() <= FARTHEST).then_some((weights, Detail::Height(height)))
}

fn combine([u, v, w]: [f64; 3], [a, b, c]: [DVec3; 3]) -> DVec3 {
    u * a + v * b + w * c
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{TriMesh, shapes};

    use super::*;

    fn stencils(mesh: &TriMesh) -> (Vec<DVec3>, Vec<Stencil>) {
        let topology = mesh.topology();
        let dual: Vec<DVec3> = (0..mesh.face_count()).map(|f| barycentre(topology, &mesh.positions, f)).collect();
        let of = |f: usize| dual_neighbours(topology, f).map(|neighbours| Stencil::new(f, neighbours, &dual));
        let all = (0..mesh.face_count()).filter_map(of).collect();
        (dual, all)
    }

    #[test]
    fn a_dual_vertex_is_a_foot_and_a_height() {
        let plane = shapes::bumpy_plane(14, 9, 2.0, 1.0, 0.2, 5).expect("valid size");
        for (mesh, closed) in
            [(shapes::icosphere(3), true), (shapes::cactus(1500).expect("in range"), true), (plane, false)]
        {
            let (dual, all) = stencils(&mesh);
            assert_eq!(all.len() == mesh.face_count(), closed);
            let mut heights = 0;
            for stencil in &all {
                let (at, around) = (dual[stencil.face as usize], stencil.around(&dual));
                // The last weight is 1 less the others.
                assert!((stencil.weights.iter().sum::<f64>() - 1.0).abs() <= 1e-14 * FARTHEST);
                let Detail::Height(height) = stencil.detail else { continue };
                heights += 1;
                let normal = dual_normal(around).expect("not thin");
                // Positions are below 2 in size, and areas above THINNEST of squared lengths.
                assert!(stencil.difference(&dual).distance(height * normal) < 1e-12, "{stencil:?}");
                assert!((at - height * normal - around[0]).dot(normal).abs() < 1e-14);
            }
            assert!(10 * heights > 9 * all.len(), "{heights} of {}", all.len());
        }
    }

    /// On a sphere every barycentre is outside the plane of its neighbours, and farther out than the normal's foot.
    #[test]
    fn heights_of_a_convex_shape_are_positive() {
        let (_, all) = stencils(&shapes::icosphere(2));
        assert!(all.iter().all(|s| matches!(s.detail, Detail::Height(h) if h > 0.0)));
    }

    #[test]
    fn thin_stencils_keep_the_whole_vector() {
        let at = DVec3::new(0.3, 0.2, 0.1);
        let line = [DVec3::ZERO, DVec3::X, DVec3::new(0.4, 1e-4, 0.0)];
        // Not thin, but seen from afar.
        let far = [DVec3::new(30.0, 0.0, 0.0), DVec3::new(31.0, 0.0, 0.0), DVec3::new(30.0, 1.0, 0.0)];
        for around in [line, far, [at; 3], [DVec3::ZERO; 3]] {
            let dual = [at, around[0], around[1], around[2]];
            let stencil = Stencil::new(0, [1, 2, 3], &dual);
            let mean = (around[0] + around[1] + around[2]) / 3.0;
            assert_eq!(stencil.weights, [1.0 / 3.0; 3]);
            let Detail::Vector(rest) = stencil.detail else { panic!("{stencil:?}") };
            assert!(rest.distance(at - mean) < 1e-14 && stencil.difference(&dual).distance(rest) < 1e-14);
        }
        assert_eq!(dual_normal(line.map(|p| DVec3::new(p.x, 0.0, 0.0))), None);
        assert_eq!(dual_normal([DVec3::ZERO; 3]), None);
        let large = [DVec3::ZERO, DVec3::X * 1e100, DVec3::Y * 1e100];
        assert_eq!(dual_normal(large), Some(DVec3::Z));
    }
}
