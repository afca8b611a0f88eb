//! The simplifier's working mesh: faces that change, and what a half-edge collapse may do to them.
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
use pliant_mesh::{TriMesh, face_area_vector, vertex_normals};

/// How strictly the geometry of new faces is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guard {
    /// Least cosine between a face's normal before and after.
    pub(super) min_cosine: f64,
    /// Whether a face must look to the same side as the original surface at its corners.
    pub(super) faces_outward: bool,
}

/// Mesh whose vertices are collapsed into neighbours one at a time.
pub(super) struct Working {
    pub(super) positions: Vec<DVec3>,
    /// Unit normals of the original surface.
    normals: Vec<DVec3>,
    /// Vertices of each face; [`DEAD`] marks one that is gone.
    pub(super) faces: Vec<[u32; 3]>,
    lists: Lists,
    /// On an edge with one face.
    boundary: Vec<bool>,
    /// At an edge or vertex that is not manifold: never moved.
    pub(super) locked: Vec<bool>,
    /// Marks vertices of the ring at hand with the current stamp.
    marks: Vec<u32>,
    stamp: u32,
}

pub(super) const DEAD: [u32; 3] = [u32::MAX; 3];

impl Working {
    /// A working copy of `mesh` at other (normalised) positions.
    pub(super) fn new(mesh: &TriMesh, positions: Vec<DVec3>) -> Self {
        let topology = mesh.topology();
        let n = topology.vertex_count();
        let mut locked: Vec<bool> = (0..n).map(|v| topology.fan_count(v) > 1).collect();
        for (e, &[a, b]) in topology.edges().iter().enumerate() {
            if topology.edge_faces(e).len() > 2 {
                locked[a as usize] = true;
                locked[b as usize] = true;
            }
        }
        Self {
            normals: vertex_normals(topology, &positions),
            positions,
            faces: mesh.triangles().to_vec(),
            lists: Lists::new((0..n).map(|v| topology.vertex_faces(v))),
            boundary: topology.boundary_vertices(),
            locked,
            marks: vec![0; n],
            stamp: 0,
        }
    }

    /// In each face of `v`, the corner that comes `steps` (1 or 2) after it.
    pub(super) fn followers(&self, v: u32, steps: usize) -> impl Iterator<Item = u32> + '_ {
        self.lists.row(v).iter().map(move |&f| {
            let t = self.faces[f as usize];
            let k = t.iter().position(|&w| w == v).unwrap_or(0);
            t[(k + steps) % 3]
        })
    }

    /// Whether the faces round `v` may leave out an edge of it: on a boundary, or where the surface is not manifold.
    pub(super) fn is_open_fan(&self, v: u32) -> bool {
        self.boundary[v as usize] || self.locked[v as usize]
    }

    /// Collects the neighbours of `v` without repeats, in the order its faces name them.
    pub(super) fn ring(&mut self, v: u32, ring: &mut Vec<u32>) {
        ring.clear();
        self.stamp += 1;
        self.marks[v as usize] = self.stamp;
        for &f in self.lists.row(v) {
            for w in self.faces[f as usize] {
                if self.marks[w as usize] != self.stamp {
                    self.marks[w as usize] = self.stamp;
                    ring.push(w);
                }
            }
        }
    }

    /// Whether collapsing `u` into its neighbour `v` keeps the surface what it is; if so, the quality of the worst face
    /// that it makes worse, 1 if there is none.
    pub(super) fn may_collapse(&mut self, u: u32, v: u32, guard: Guard) -> Option<f64> {
        let allowed = !self.locked[u as usize] && self.keeps_topology(u, v);
        if allowed { self.worst_face(u, v, guard) } else { None }
    }

    /// The link condition (Dey et al. 1999): vertices next to both ends are exactly those opposite to their edge.
    fn keeps_topology(&mut self, u: u32, v: u32) -> bool {
        let mut opposite = [u32::MAX; 2];
        let mut shared = 0;
        for &f in self.lists.row(u) {
            let t = self.faces[f as usize];
            if t.contains(&v) {
                if shared == 2 {
                    return false;
                }
                opposite[shared] = third(t, u, v);
                shared += 1;
            }
        }
        // A boundary vertex slides along its boundary only; an inner vertex has two faces at every edge.
        let on_boundary = self.boundary[u as usize];
        if on_boundary && !(shared == 1 && self.boundary[v as usize]) || !on_boundary && shared != 2 {
            return false;
        }
        // The last face of a component stays.
        if opposite[..shared].iter().any(|&a| self.lists.row(a).len() < 2) {
            return false;
        }
        if self.common_neighbours(u, v) != shared {
            return false;
        }
        // A tetrahedron passes the test above: both ends form a face with the two opposite vertices.
        let [a, b] = opposite;
        let has_face = |w: u32| {
            self.lists.row(w).iter().any(|&f| {
                let t = self.faces[f as usize];
                t.contains(&a) && t.contains(&b)
            })
        };
        !(shared == 2 && has_face(u) && has_face(v))
    }

    fn common_neighbours(&mut self, u: u32, v: u32) -> usize {
        self.stamp += 2;
        let (of_u, counted) = (self.stamp - 1, self.stamp);
        for &f in self.lists.row(u) {
            for w in self.faces[f as usize] {
                self.marks[w as usize] = of_u;
            }
        }
        self.marks[u as usize] = counted;
        self.marks[v as usize] = counted;
        let mut common = 0;
        for &f in self.lists.row(v) {
            for w in self.faces[f as usize] {
                if self.marks[w as usize] == of_u {
                    self.marks[w as usize] = counted;
                    common += 1;
                }
            }
        }
        common
    }

    /// Quality of the worst face made worse; `None` if a face turns over, away from the original surface, or into a line.
    fn worst_face(&self, u: u32, v: u32, guard: Guard) -> Option<f64> {
        let to = self.positions[v as usize];
        let mut worst = 1.0_f64;
        for &f in self.lists.row(u) {
            let t = self.faces[f as usize];
            if t.contains(&v) {
                continue;
            }
            let before = t.map(|w| self.positions[w as usize]);
            let moved = t.map(|w| if w == u { v } else { w });
            let after = t.map(|w| if w == u { to } else { self.positions[w as usize] });
            let (old, new) = (face_area_vector(before), face_area_vector(after));
            let outward: DVec3 = moved.iter().map(|&w| self.normals[w as usize]).sum();
            let quality = quality(after, new);
            // A face without area has no side to keep.
            if quality < MIN_QUALITY
                || old.dot(new) < guard.min_cosine * old.length() * new.length()
                || (guard.faces_outward && outward.dot(new) < 0.0)
            {
                return None;
            }
            if quality < self::quality(before, old) {
                worst = worst.min(quality);
            }
        }
        Some(worst)
    }

    /// Carries the collapse out. Call only where [`Self::may_collapse`].
    pub(super) fn collapse(&mut self, u: u32, v: u32) {
        for f in self.lists.take(u) {
            let t = self.faces[f as usize];
            if t.contains(&v) {
                self.faces[f as usize] = DEAD;
                self.lists.drop_item(v, f);
                self.lists.drop_item(third(t, u, v), f);
            } else {
                self.faces[f as usize] = t.map(|w| if w == u { v } else { w });
                self.lists.push(v, f);
            }
        }
    }

    /// Whether the face looks away from the original surface at its corners.
    pub(super) fn is_flipped(&self, face: [u32; 3]) -> bool {
        let outward: DVec3 = face.iter().map(|&w| self.normals[w as usize]).sum();
        outward.dot(face_area_vector(face.map(|w| self.positions[w as usize]))) < 0.0
    }
}

/// Faces below this quality count as degenerate: none is made.
const MIN_QUALITY: f64 = 1e-3;

/// `4 sqrt(3) area / (sum of squared sides)`: 1 for an equilateral triangle, 0 for a flat one.
fn quality([a, b, c]: [DVec3; 3], area: DVec3) -> f64 {
    let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if sides > 0.0 { 4.0 * 3.0_f64.sqrt() * area.length() / sides } else { 0.0 }
}

/// The corner that is neither `u` nor `v`.
fn third(t: [u32; 3], u: u32, v: u32) -> u32 {
    t.into_iter().find(|&w| w != u && w != v).unwrap_or(u32::MAX)
}

/// Growing lists in one array; a list that outgrows its place moves to the end with room to spare.
struct Lists {
    items: Vec<u32>,
    /// Start, length and room of each list.
    spans: Vec<[u32; 3]>,
}

impl Lists {
    fn new<'a>(rows: impl Iterator<Item = &'a [u32]>) -> Self {
        let (mut items, mut spans) = (Vec::new(), Vec::new());
        for row in rows {
            let length = row.len() as u32;
            spans.push([items.len() as u32, length, length]);
            items.extend_from_slice(row);
        }
        Self { items, spans }
    }

    fn row(&self, list: u32) -> &[u32] {
        let [start, length, _] = self.spans[list as usize];
        &self.items[start as usize..(start + length) as usize]
    }

    /// Empties a list and returns what was in it.
    fn take(&mut self, list: u32) -> Vec<u32> {
        let row = self.row(list).to_vec();
        self.spans[list as usize][1] = 0;
        row
    }

    fn push(&mut self, list: u32, item: u32) {
        let [start, length, room] = self.spans[list as usize];
        if length == room {
            let to = self.items.len() as u32;
            let grown = (2 * length).max(8);
            self.items.extend_from_within(start as usize..(start + length) as usize);
            self.items.resize((to + grown) as usize, 0);
            self.spans[list as usize] = [to, length, grown];
        }
        let [start, length, _] = self.spans[list as usize];
        self.items[(start + length) as usize] = item;
        self.spans[list as usize][1] += 1;
    }

    fn drop_item(&mut self, list: u32, item: u32) {
        let [start, length, _] = self.spans[list as usize];
        let row = &mut self.items[start as usize..(start + length) as usize];
        if let Some(at) = row.iter().position(|&i| i == item) {
            row.copy_within(at + 1.., at);
            self.spans[list as usize][1] -= 1;
        }
    }
}
