//! Mean value coordinates for closed triangular meshes (Ju, Schaefer and Warren 2005), at any point of space.
//!
//! For a point `x` and a face with corners `x + v_k`, let `theta_k` be the angle at `x` between the corners other than `k` and
//! `n_k` the unit normal of the plane through them and `x`. The mean vector of the face is
//! `m = 1/2 sum theta_k n_k` (Section 3.1), and the weights of its corners solve `sum w_k v_k = m`:
//! `w_k = (n_k . m) / (n_k . v_k)`. Since the mean vectors of a closed mesh cancel, the normalised weights
//! have linear precision.
//!
//! The article's Figure 4 computes the same from spherical angles by `asin`, which swallows points closer than about 1e-6
//! to a face. The vector form with `atan2` is as accurate 1e-13 from a face as far away, so it is used here.

use glam::DVec3;
use pliant_mesh::metrics::closest_on_triangle;
use pliant_mesh::{Topology, TriMesh, face_normals};

/// A point nearer to a face than this share of the cage's diagonal takes the barycentric coordinates of the nearest
/// point on that face: the limit of mean value coordinates (Ju et al., Section 3.3), on edges and at vertices too.
pub(crate) const ON_FACE: f64 = 1e-13;

/// Height over a face's plane, as a share of the distance to the face, below which the face is seen edge-on.
pub(crate) const EDGE_ON: f64 = 1e-4;

/// What one face gives to the coordinates of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum FaceWeights {
    /// The point lies on the face: barycentric coordinates, nothing else counts.
    On([f64; 3]),
    /// Unnormalised weights of the corners; negative where the point is on the outer side.
    Weights([f64; 3]),
}

/// The cage as the coordinates see it: centred, scaled to unit diagonal.
pub struct MeanValue {
    positions: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    /// Unit normals; zero where a face has no area.
    normals: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
    /// Edge opposite to each corner, and 1 if the face runs along it from its first end to its second, else -1.
    face_edges: Vec<[(u32, f64); 3]>,
    centre: DVec3,
    scale: f64,
}

impl MeanValue {
    /// Prepares the coordinates of a cage.
    pub fn new(cage: &TriMesh) -> Self {
        let (centre, scale) = cage.bounds().normal_frame();
        let positions: Vec<DVec3> = cage.positions.iter().map(|p| (*p - centre) * scale).collect();
        Self {
            faces: cage.triangles().to_vec(),
            normals: face_normals(cage.topology(), &positions),
            edges: cage.topology().edges().to_vec(),
            face_edges: (0..cage.face_count()).map(|f| directed_edges(cage.topology(), f)).collect(),
            positions,
            centre,
            scale,
        }
    }

    /// The normal frame's coordinates of a point.
    pub(crate) fn to_frame(&self, point: DVec3) -> DVec3 {
        (point - self.centre) * self.scale
    }

    /// Cage vertices in the normal frame.
    pub(crate) fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Unit normals of the faces; zero where a face has no area.
    pub(crate) fn normals(&self) -> &[DVec3] {
        &self.normals
    }

    /// Corners of a face in the normal frame.
    #[inline(always)]
    pub(crate) fn corners(&self, face: usize) -> [DVec3; 3] {
        let [a, b, c] = self.faces[face];
        [self.positions[a as usize], self.positions[b as usize], self.positions[c as usize]]
    }

    /// Writes the coordinates of `point` (model space) with respect to every cage vertex to `row`; they sum to 1.
    ///
    /// At a cage vertex this is 1 for that vertex; on a face, its barycentric coordinates. Inside and outside alike
    /// `sum row[j] * cage[j] = point`, if the cage is closed. Returns `false`, and leaves `row` without meaning,
    /// where the weights cancel and no coordinates exist. Linear in the number of faces, about 60 ns each.
    ///
    /// # Panics
    /// If `row` has not one entry per cage vertex.
    pub fn coordinates(&self, point: DVec3, row: &mut [f64]) -> bool {
        self.coordinates_with(self.to_frame(point), row, &mut Corners::default())
    }

    /// [`Self::coordinates`] of a point of the normal frame, with memory kept from point to point.
    pub(crate) fn coordinates_with(&self, x: DVec3, row: &mut [f64], corners: &mut Corners) -> bool {
        assert_eq!(row.len(), self.positions.len());
        row.fill(0.0);
        corners.look_from(x, self);
        for face in 0..self.faces.len() {
            let weights = match self.shared_weights(face, corners) {
                Some(weights) => weights,
                None => match self.face_weights(x, face) {
                    FaceWeights::Weights(weights) => weights,
                    FaceWeights::On(barycentric) => {
                        row.fill(0.0);
                        self.add(face, barycentric, row);
                        return true;
                    }
                },
            };
            self.add(face, weights, row);
        }
        let total: f64 = row.iter().sum();
        for w in row.iter_mut() {
            *w /= total;
        }
        total != 0.0 && row.iter().all(|w| w.is_finite())
    }

    /// [`Self::face_weights`] from angles that the two faces of an edge share; `None` where the face needs a closer look.
    fn shared_weights(&self, face: usize, corners: &Corners) -> Option<[f64; 3]> {
        let ends = self.faces[face];
        let v = ends.map(|v| corners.toward[v as usize]);
        let nearest = ends.iter().map(|&v| corners.distance[v as usize]).fold(f64::INFINITY, f64::min);
        let height = v[0].dot(self.normals[face]);
        if height.abs() <= (EDGE_ON * nearest).max(ON_FACE) {
            return None;
        }
        let edges = self.face_edges[face];
        let mean: DVec3 = edges.iter().map(|&(e, sign)| sign * corners.arcs[e as usize]).sum();
        let crosses = edges.map(|(e, sign)| sign * corners.crosses[e as usize]);
        let determinant = v[0].dot(crosses[0]);
        Some(if determinant == 0.0 { [0.0; 3] } else { crosses.map(|c| c.dot(mean) / determinant) })
    }

    fn add(&self, face: usize, weights: [f64; 3], row: &mut [f64]) {
        for (v, w) in self.faces[face].into_iter().zip(weights) {
            row[v as usize] += w;
        }
    }

    /// What `face` gives to a point of the normal frame.
    pub(crate) fn face_weights(&self, x: DVec3, face: usize) -> FaceWeights {
        let corners = self.corners(face);
        let v = corners.map(|p| p - x);
        let normal = self.normals[face];
        if normal == DVec3::ZERO {
            // A segment: nothing lies between its corners' directions, its mean vector vanishes.
            return FaceWeights::Weights([0.0; 3]);
        }
        let height = v[0].dot(normal);
        let nearest_corner = v[0].length_squared().min(v[1].length_squared()).min(v[2].length_squared()).sqrt();
        // The distance to the face is at most that to a corner, so most faces are dealt with here.
        if height.abs() > (EDGE_ON * nearest_corner).max(ON_FACE) {
            return FaceWeights::Weights(vector_weights(v));
        }
        let nearest = closest_on_triangle(x, corners);
        let distance = nearest.distance(x);
        if distance <= ON_FACE {
            return FaceWeights::On(barycentric(nearest, corners));
        }
        if height.abs() > EDGE_ON * distance {
            return FaceWeights::Weights(vector_weights(v));
        }
        // Seen edge-on from outside the triangle, n . m and n . v both vanish and their quotient is rounding. The weight
        // is height * integral(a_k / |p|^4), where the integral hardly changes with the height: take
        // it from a higher place, and let the weight go to 0 with the height (Ju et al.: coplanar faces are ignored).
        let raised = EDGE_ON * distance;
        let weights = vector_weights(v.map(|p| p + normal * (raised - height)));
        FaceWeights::Weights(weights.map(|w| w * (height / raised)))
    }
}

/// The cage as seen from one point: what faces share.
#[derive(Debug, Default)]
pub(crate) struct Corners {
    /// From the point to each vertex, and how far that is.
    toward: Vec<DVec3>,
    distance: Vec<f64>,
    /// Cross product of the directions to the ends of each edge, and half its angle along the unit normal.
    crosses: Vec<DVec3>,
    arcs: Vec<DVec3>,
}

impl Corners {
    fn look_from(&mut self, x: DVec3, cage: &MeanValue) {
        self.toward.clear();
        self.toward.extend(cage.positions.iter().map(|p| *p - x));
        self.distance.clear();
        self.distance.extend(self.toward.iter().map(|v| v.length()));
        self.crosses.clear();
        self.arcs.clear();
        for &[a, b] in &cage.edges {
            let (a, b) = (self.toward[a as usize], self.toward[b as usize]);
            let cross = a.cross(b);
            self.crosses.push(cross);
            self.arcs.push(arc(cross, a.dot(b)));
        }
    }
}

/// Half the angle between two directions along the normal of their plane; zero for parallel ones, whose plane is undefined and whose
/// share of a mean vector vanishes (or, right on an edge, is not needed).
fn arc(cross: DVec3, dot: f64) -> DVec3 {
    let sine = cross.length();
    if sine > 0.0 { cross * (0.5 * sine.atan2(dot) / sine) } else { DVec3::ZERO }
}

/// Edges of a face, opposite to its corners, and whether it runs along them (1) or against them (-1).
fn directed_edges(topology: &Topology, face: usize) -> [(u32, f64); 3] {
    let t = topology.triangles()[face];
    let edges = topology.face_edges(face);
    std::array::from_fn(|k| {
        let along = topology.edges()[edges[k] as usize][0] == t[(k + 1) % 3];
        (edges[k], if along { 1.0 } else { -1.0 })
    })
}

/// `w_k = (n_k . m) / (n_k . v_k)` with `m = 1/2 sum theta_k n_k`.
fn vector_weights(v: [DVec3; 3]) -> [f64; 3] {
    let crosses = [v[1].cross(v[2]), v[2].cross(v[0]), v[0].cross(v[1])];
    let dots = [v[1].dot(v[2]), v[2].dot(v[0]), v[0].dot(v[1])];
    let mean: DVec3 = crosses.into_iter().zip(dots).map(|(cross, dot)| arc(cross, dot)).sum();
    // n_k . v_k is the same determinant for every k once n_k is left unnormalised; using one
    // value keeps the ratios of the weights right where it is nearly lost to cancellation.
    let determinant = v[0].dot(crosses[0]);
    if determinant == 0.0 {
        return [0.0; 3];
    }
    crosses.map(|c| c.dot(mean) / determinant)
}

/// Barycentric coordinates of a point of the triangle.
fn barycentric(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let square = normal.length_squared();
    let area = |q: DVec3, r: DVec3| ((q - p).cross(r - p).dot(normal) / square).clamp(0.0, 1.0);
    // At a corner two of the areas are exactly 0.
    let weights = [area(b, c), area(c, a), area(a, b)];
    let total: f64 = weights.iter().sum();
    weights.map(|w| w / total)
}
