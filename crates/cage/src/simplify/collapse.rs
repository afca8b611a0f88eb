//! The simplifier's working mesh: fans that change, and what a half-edge collapse may do to them.
//!
//! ```text
//!          a                     a
//!        / | \                  / \
//!       /  |  \                /   \
//!   ---u-->v---      =>    ---v-----     faces (u v a) and (v u b) go,
//!       \  |  /                \   /     every other face of u gets v in u's place
//!        \ | /                  \ /
//!          b                     b
//! ```
//!
//! On the boundary one of the two faces is missing.

use glam::DVec3;
use pliant_mesh::{Topology, face_area_vector};
use rayon::prelude::*;

use super::fans::{Fans, Renamed};

/// How strictly the geometry of new faces is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guard {
    /// Least cosine between a face's normal before and after.
    pub(super) min_cosine: f64,
    /// Whether a face must look to the same side as the original surface at its corners.
    pub(super) faces_outward: bool,
}

/// What is asked about a vertex by its neighbours, in one line of the cache.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(super) struct Site {
    pub(super) position: DVec3,
    /// Unit normal of the original surface.
    pub(super) normal: DVec3,
    /// Value of its quadric at its own place.
    pub(super) at_home: f64,
    /// Area of the faces its quadric stands for, each counted at every corner.
    pub(super) area: f64,
}

/// Mesh whose vertices are collapsed into neighbours one at a time.
pub(super) struct Working {
    pub(super) sites: Vec<Site>,
    pub(super) fans: Fans,
    /// On an edge with one face.
    boundary: Vec<bool>,
    /// At an edge or vertex that is not manifold: never moved.
    pub(super) locked: Vec<bool>,
    /// Whether all faces turn the same way.
    oriented: bool,
}

impl Working {
    /// A working copy of a mesh; `boundary` says which vertices are on an edge with one face.
    pub(super) fn new(topology: &Topology, sites: Vec<Site>, boundary: Vec<bool>) -> Self {
        let of_fans = || -> Vec<bool> { (0..sites.len()).into_par_iter().map(|v| topology.fan_count(v) > 1).collect() };
        let (mut locked, (fans, oriented)) =
            rayon::join(of_fans, || (Fans::new(topology), topology.require_oriented().is_ok()));
        for (e, &[a, b]) in topology.edges().iter().enumerate() {
            if topology.edge_faces(e).len() > 2 {
                locked[a as usize] = true;
                locked[b as usize] = true;
            }
        }
        Self { sites, fans, boundary, locked, oriented }
    }

    /// Whether `v` is there, with faces, and not locked.
    pub(super) fn may_move(&self, v: u32) -> bool {
        self.fans.face_count(v) > 0 && !self.locked[v as usize]
    }

    /// Whether some neighbour of `v` may not come next in any face of it: on a boundary, where the surface is not manifold, and
    /// anywhere if faces do not turn the same way.
    pub(super) fn is_open_fan(&self, v: u32) -> bool {
        self.boundary[v as usize] || self.locked[v as usize] || !self.oriented
    }

    /// Whether collapsing `u` into its neighbour `v` keeps the surface what it is; if so, the quality of the worst face
    /// that it makes worse, if that is below `good`; else 1.
    pub(super) fn may_collapse(&mut self, u: u32, v: u32, guard: Guard, good: f64) -> Option<f64> {
        let allowed = !self.locked[u as usize] && self.keeps_topology(u, v);
        if allowed { self.worst_face(u, v, guard, good) } else { None }
    }

    /// The link condition (Dey et al. 1999): vertices next to both ends are exactly those opposite to their edge.
    fn keeps_topology(&mut self, u: u32, v: u32) -> bool {
        let mut opposite = [u32::MAX; 2];
        let mut shared = 0;
        for third in self.fans.row(u).iter().filter_map(|wedge| wedge.opposite(v)) {
            if shared == 2 {
                return false;
            }
            opposite[shared] = third;
            shared += 1;
        }
        // A boundary vertex slides along its boundary only; an inner vertex has two faces at every edge.
        let on_boundary = self.boundary[u as usize];
        if on_boundary && !(shared == 1 && self.boundary[v as usize]) || !on_boundary && shared != 2 {
            return false;
        }
        // The last face of a component stays.
        if opposite[..shared].iter().any(|&a| self.fans.face_count(a) < 2) {
            return false;
        }
        // Nor does the end that stays lose its last, where pieces hang together at the third corner.
        if self.fans.face_count(u) + self.fans.face_count(v) <= 2 * shared {
            return false;
        }
        if self.fans.common_neighbours(u, v) != shared {
            return false;
        }
        // A tetrahedron passes the test above: both ends form a face with the two opposite vertices.
        let [a, b] = opposite;
        let has_face = |w: u32| self.fans.row(w).iter().any(|wedge| wedge.has(a) && wedge.has(b));
        !(shared == 2 && has_face(u) && has_face(v))
    }

    /// Quality of the worst face made worse, if below `good`; `None` if a face turns over, away from the original surface,
    /// or into a line.
    fn worst_face(&self, u: u32, v: u32, guard: Guard, good: f64) -> Option<f64> {
        let mut worst = good;
        for wedge in self.fans.row(u).iter().filter(|wedge| !wedge.has(v)) {
            let [a, b, c] = wedge.face(v);
            let sites = [&self.sites[a as usize], &self.sites[b as usize], &self.sites[c as usize]];
            let after = [sites[0].position, sites[1].position, sites[2].position];
            let [a, b, c] = wedge.face(u);
            let before =
                [self.sites[a as usize].position, self.sites[b as usize].position, self.sites[c as usize].position];
            let (old, new) = (face_area_vector(before), face_area_vector(after));
            let outward = sites[0].normal + sites[1].normal + sites[2].normal;
            let quality = quality(after, new);
            // A face without area has no side to keep.
            if quality < MIN_QUALITY
                || old.dot(new) < guard.min_cosine * old.length() * new.length()
                || (guard.faces_outward && outward.dot(new) < 0.0)
            {
                return None;
            }
            if quality < worst && quality < self::quality(before, old) {
                worst = quality;
            }
        }
        Some(if worst < good { worst } else { 1.0 })
    }

    /// Carries the collapse out and tells `renamed` of every other neighbour that `u` had, and whether its fan is open.
    /// Call only where [`Self::may_collapse`]. `ring` is scratch.
    pub(super) fn collapse(
        &mut self,
        u: u32,
        v: u32,
        ring: &mut Vec<u32>,
        mut renamed: impl FnMut(u32, Renamed, bool),
    ) {
        self.fans.ring(u, ring);
        for &w in ring.iter().filter(|&&w| w != v) {
            renamed(w, self.fans.rename(w, u, v), self.is_open_fan(w));
        }
        self.fans.merge(u, v);
    }

    /// Whether a face looks away from the original surface at its corners.
    pub(super) fn is_flipped(&self, face: [u32; 3]) -> bool {
        let sites = face.map(|w| self.sites[w as usize]);
        let outward: DVec3 = sites.iter().map(|s| s.normal).sum();
        outward.dot(face_area_vector(sites.map(|s| s.position))) < 0.0
    }
}

/// Faces below this quality count as degenerate: none is made.
const MIN_QUALITY: f64 = 1e-3;

/// `4 sqrt(3) area / (sum of squared sides)`: 1 for an equilateral triangle, 0 for a flat one.
fn quality([a, b, c]: [DVec3; 3], area: DVec3) -> f64 {
    let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if sides > 0.0 { 4.0 * 3.0_f64.sqrt() * area.length() / sides } else { 0.0 }
}
