//! Groups of cage vertices as moments about a centre.
//!
//! The weight of cage vertex `j` at `x` is the sum over its faces of `integral a_j(p) N . (p - x) / |p - x|^4 dp`, with
//! `a_j` its hat function and `N` the face's unit normal: the solid angle of Ju, Schaefer and Warren 2005 (Section 2)
//! divided by the distance. So a vertex, or any group of them, acts like a cloud of dipoles on its faces.

use glam::DVec3;
use pliant_mesh::Topology;

/// Six points of a triangle (barycentric) and their shares of its area: exact to degree 4 (Dunavant 1985), where a hat function times
/// second moments has degree 3.
const RULE: [([f64; 3], f64); 6] = {
    const A: f64 = 0.445_948_490_915_965;
    const B: f64 = 0.091_576_213_509_771;
    const WA: f64 = 0.223_381_589_678_011;
    const WB: f64 = 0.109_951_743_655_322;
    const fn at(c: f64, k: usize) -> [f64; 3] {
        let mut p = [c; 3];
        p[k] = 1.0 - 2.0 * c;
        p
    }
    [(at(A, 0), WA), (at(A, 1), WA), (at(A, 2), WA), (at(B, 0), WB), (at(B, 1), WB), (at(B, 2), WB)]
};

/// The cage's geometry as the moments need it, in the normal frame.
pub(super) struct Surface<'a> {
    pub(super) positions: &'a [DVec3],
    /// Unit normals of the faces; zero where a face has no area.
    pub(super) normals: &'a [DVec3],
    pub(super) topology: &'a Topology,
}

/// A part of a vertex's hat on one face: where it is and its area along the normal.
struct Dipole {
    at: DVec3,
    area: f64,
    normal: DVec3,
}

impl Surface<'_> {
    fn corners(&self, face: u32) -> [DVec3; 3] {
        self.topology.triangles()[face as usize].map(|v| self.positions[v as usize])
    }

    fn faces<'b>(&'b self, vertices: &'b [u32]) -> impl Iterator<Item = (u32, u32)> + 'b {
        vertices.iter().flat_map(|&v| self.topology.vertex_faces(v as usize).iter().map(move |&f| (v, f)))
    }

    fn dipoles<'b>(&'b self, vertices: &'b [u32]) -> impl Iterator<Item = Dipole> + 'b {
        self.faces(vertices).flat_map(|(v, f)| {
            let [a, b, c] = self.corners(f);
            let normal = self.normals[f as usize];
            // A face without area has no normal and no say.
            let area = 0.5 * (b - a).cross(c - a).dot(normal);
            let own = self.topology.triangles()[f as usize].iter().position(|&w| w == v).unwrap_or(0);
            RULE.into_iter().map(move |(t, share)| Dipole {
                at: a * t[0] + b * t[1] + c * t[2],
                area: area * share * t[own],
                normal,
            })
        })
    }
}

/// What a group of vertices gives to a far point, and how wrong that can be.
///
/// With `r` from the point to the centre, `s = 1 / |r|` and `u = r s`, the sum of the group's weights is
/// `s^3 (dipole . u + s (trace + first(u, u)) + s^2 (vector . u + second(u, u, u)))` up to terms in `s^6`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    pub(super) centre: DVec3,
    pub(super) dipole: DVec3,
    pub(super) trace: f64,
    /// Coefficients of xx, yy, zz, xy, xz, yz.
    pub(super) first: [f64; 6],
    pub(super) vector: DVec3,
    /// Coefficients of xxx, yyy, zzz, xxy, xxz, xyy, yyz, xzz, yzz, xyz.
    pub(super) second: [f64; 10],
    /// Sum of the dipoles' magnitudes: a third of the area of the faces round each vertex.
    pub(super) area: f64,
    /// Largest such area of one vertex.
    pub(super) largest: f64,
    /// Sums of magnitude times squared and cubed distance from the centre.
    pub(super) square: f64,
    pub(super) cube: f64,
    /// Sum of magnitude times squared height `(N . (u + s d))^2`: coefficients of xx, yy, zz, xy, xz, yz in `u`, of `u` times `s`
    /// and of `s^2`.
    pub(super) heights: [f64; 10],
    /// All faces lie within this of the centre.
    pub(super) radius: f64,
    /// Unit axis of a cone that holds all normals, and its half angle: `PI` where there is none narrower than a half-space.
    pub(super) axis: DVec3,
    pub(super) angle: f64,
    /// Largest distance of the centre from the plane of a face.
    pub(super) offset: f64,
}

impl Moments {
    /// Of the hats of `vertices`; all zero if they have no area.
    pub(super) fn of(surface: &Surface<'_>, vertices: &[u32]) -> Self {
        let mut m = Self::default();
        let mut weighted = DVec3::ZERO;
        for v in vertices {
            let mut area = 0.0;
            for d in surface.dipoles(std::slice::from_ref(v)) {
                area += d.area;
                weighted += d.at * d.area;
                m.dipole += d.normal * d.area;
            }
            m.area += area;
            m.largest = m.largest.max(area);
        }
        if m.area <= 0.0 {
            m.centre = vertices.first().map_or(DVec3::ZERO, |&v| surface.positions[v as usize]);
            return m;
        }
        m.centre = weighted / m.area;
        for d in surface.dipoles(vertices) {
            m.add(&d);
        }
        m.bound(surface, vertices);
        m
    }

    /// Taylor terms of `n . (r + d) / |r + d|^4`, of degree 1 and 2 in `d`.
    fn add(&mut self, dipole: &Dipole) {
        let d = dipole.at - self.centre;
        let n = dipole.normal * dipole.area;
        self.trace += n.dot(d);
        let first =
            [n.x * d.x, n.y * d.y, n.z * d.z, n.x * d.y + n.y * d.x, n.x * d.z + n.z * d.x, n.y * d.z + n.z * d.y];
        for (sum, term) in self.first.iter_mut().zip(first) {
            *sum -= 4.0 * term;
        }
        self.vector -= 2.0 * (2.0 * n.dot(d) * d + n * d.length_squared());
        let pair = |a: f64, na: f64, b: f64, nb: f64| nb * a * a + 2.0 * na * a * b;
        let second = [
            n.x * d.x * d.x,
            n.y * d.y * d.y,
            n.z * d.z * d.z,
            pair(d.x, n.x, d.y, n.y),
            pair(d.x, n.x, d.z, n.z),
            pair(d.y, n.y, d.x, n.x),
            pair(d.y, n.y, d.z, n.z),
            pair(d.z, n.z, d.x, n.x),
            pair(d.z, n.z, d.y, n.y),
            2.0 * (n.x * d.y * d.z + n.y * d.x * d.z + n.z * d.x * d.y),
        ];
        for (sum, term) in self.second.iter_mut().zip(second) {
            *sum += 12.0 * term;
        }
        let (n, along) = (dipole.normal, dipole.normal.dot(d));
        let heights = [
            n.x * n.x,
            n.y * n.y,
            n.z * n.z,
            2.0 * n.x * n.y,
            2.0 * n.x * n.z,
            2.0 * n.y * n.z,
            2.0 * along * n.x,
            2.0 * along * n.y,
            2.0 * along * n.z,
            along * along,
        ];
        for (sum, term) in self.heights.iter_mut().zip(heights) {
            *sum += dipole.area * term;
        }
        self.square += dipole.area * d.length_squared();
        self.cube += dipole.area * d.length_squared() * d.length();
    }

    fn bound(&mut self, surface: &Surface<'_>, vertices: &[u32]) {
        self.axis = self.dipole.normalize_or_zero();
        let mut cosine = if self.axis == DVec3::ZERO { -1.0 } else { 1.0_f64 };
        for (_, f) in surface.faces(vertices) {
            let normal = surface.normals[f as usize];
            if normal == DVec3::ZERO {
                continue;
            }
            let corners = surface.corners(f).map(|p| p - self.centre);
            self.radius = corners.iter().map(|d| d.length()).fold(self.radius, f64::max);
            self.offset = self.offset.max(normal.dot(corners[0]).abs());
            cosine = cosine.min(normal.dot(self.axis));
        }
        self.angle = if cosine > 0.0 { cosine.min(1.0).acos() } else { std::f64::consts::PI };
    }
}
