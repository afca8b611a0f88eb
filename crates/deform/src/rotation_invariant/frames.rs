//! Discrete frames and what is measured in them.

use glam::{DMat3, DVec3};
use pliant_mesh::{TriMesh, face_area_vector};
use serde::{Deserialize, Serialize};

/// Below this share of the summed areas, what is left of the face normals of a vertex is no direction but rounding.
const CANCELLED: f64 = 1e-8;

/// Sine of the angle to the normal below which a direction has no projection worth normalising.
const SHORT: f64 = 1e-3;

/// Which tangent of a vertex is the first vector of its frame.
///
/// Frames differ, and with them the coordinates measured in them; the shape that is rebuilt from both is the same to rounding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tangent {
    /// The edge to the lowest neighbour, projected to the tangent plane (Meyer et al. 2003): turns with the shape, so
    /// transfer matrices and local coordinates do not change when it is turned.
    #[default]
    Edge,
    /// `(y_N, -x_N, 0)` of the normal `(x_N, y_N, z_N)` (Yuan, section 4.2): no neighbour is asked, but the frame turns with the
    /// shape only about the z axis. Where the normal is along z it is the x axis, projected.
    Normal,
}

/// A right-handed orthonormal frame per vertex: two tangents and the normal (Lipman et al. 2005; Yuan, section 4.1).
///
/// The normal is the area-weighted mean of those of the faces round the vertex. Where they cancel, have no area or are missing (needles,
/// folded rings, stray vertices) it is any direction across the first edge that has a length, and z if there is none. Any
/// frame will do for rebuilding a shape, as long as it is measured and rebuilt in the same one.
#[derive(Debug, Clone, PartialEq)]
pub struct DiscreteFrames {
    /// Columns `b1`, `b2`, `N` of each vertex: the transpose of the papers' `F`, whose rows these are.
    columns: Vec<DMat3>,
}

impl DiscreteFrames {
    /// The frames of a mesh, in time linear in its size.
    pub fn of(mesh: &TriMesh, tangent: Tangent) -> Self {
        let columns = normals(mesh).into_iter().enumerate().map(|(v, normal)| {
            let b1 = match tangent {
                Tangent::Edge => along_edge(mesh, v, normal).unwrap_or_else(|| across(normal)),
                Tangent::Normal => across(normal),
            };
            DMat3::from_cols(b1, normal.cross(b1), normal)
        });
        Self { columns: columns.collect() }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// `b1`, `b2` and `N` of a vertex as columns.
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn columns(&self, vertex: usize) -> DMat3 {
        self.columns[vertex]
    }

    /// The transfer matrix `T_ij` with `F_j = T_ij F_i`, whose rows are the vectors of frame `j` in frame `i` (Yuan, Eq. 13: the
    /// identity plus the connection coefficients of Eq. 12).
    ///
    /// # Panics
    /// If there is no such vertex.
    pub fn transfer(&self, i: usize, j: usize) -> DMat3 {
        self.columns[j].transpose() * self.columns[i]
    }

    /// A vector in the frame of a vertex: its dot products with `b1`, `b2` and `N` (Yuan, Eq. 14).
    pub(crate) fn local(&self, vertex: usize, global: DVec3) -> DVec3 {
        self.columns[vertex].transpose() * global
    }
}

/// Unit normals, by the rule of [`DiscreteFrames`].
fn normals(mesh: &TriMesh) -> Vec<DVec3> {
    let mut sums = vec![(DVec3::ZERO, 0.0); mesh.vertex_count()];
    for (face, triangle) in mesh.triangles().iter().enumerate() {
        let area = face_area_vector(mesh.corners(face));
        for &v in triangle {
            let (vector, total) = &mut sums[v as usize];
            *vector += area;
            *total += area.length();
        }
    }
    let unit = |(v, (vector, total)): (usize, (DVec3, f64))| {
        let clear = vector.length() > CANCELLED * total;
        vector.try_normalize().filter(|_| clear).unwrap_or_else(|| {
            let mut edges = edges_at(mesh, v).filter_map(DVec3::try_normalize);
            edges.next().map_or(DVec3::Z, DVec3::any_orthonormal_vector)
        })
    };
    sums.into_iter().enumerate().map(unit).collect()
}

fn edges_at(mesh: &TriMesh, v: usize) -> impl Iterator<Item = DVec3> + '_ {
    mesh.topology().neighbours(v).iter().map(move |&w| mesh.positions[w as usize] - mesh.positions[v])
}

/// The first edge at `v` that is not along the normal, projected to the tangent plane.
fn along_edge(mesh: &TriMesh, v: usize, normal: DVec3) -> Option<DVec3> {
    edges_at(mesh, v).filter_map(DVec3::try_normalize).find_map(|edge| project(edge, normal))
}

/// `(y_N, -x_N, 0)`, normalised; the projected x axis for a normal along z.
fn across(normal: DVec3) -> DVec3 {
    let flat = DVec3::new(normal.y, -normal.x, 0.0);
    // Both fail only for a normal along z and x at once.
    project(flat, normal).or_else(|| project(DVec3::X, normal)).unwrap_or_else(|| normal.any_orthonormal_vector())
}

/// The direction of `vector`, of length at most 1, in the plane across the unit vector `normal`.
fn project(vector: DVec3, normal: DVec3) -> Option<DVec3> {
    let flat = vector.reject_from_normalized(normal);
    let unit = flat.try_normalize().filter(|_| flat.length() > SHORT)?;
    // Once more: what rounding left along the normal was magnified.
    unit.reject_from_normalized(normal).try_normalize()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use pliant_mesh::shapes;

    use super::*;

    const TANGENTS: [Tangent; 2] = [Tangent::Edge, Tangent::Normal];

    fn distance(a: DMat3, b: DMat3) -> f64 {
        (0..3).map(|k| (a.col(k) - b.col(k)).length()).fold(0.0, f64::max)
    }

    fn assert_orthonormal(frames: &DiscreteFrames) {
        for v in 0..frames.len() {
            let f = frames.columns(v);
            assert!(distance(f.transpose() * f, DMat3::IDENTITY) < 1e-14, "vertex {v}: {f}");
            assert!(f.determinant() > 0.0);
        }
    }

    fn some_shapes() -> Vec<TriMesh> {
        vec![
            shapes::icosphere(2),
            shapes::cactus(900).expect("in range"),
            shapes::plane_grid(5, 4, 2.0, 1.0).expect("valid"),
            shapes::bar(6, 2, 2, DVec3::new(3.0, 1.0, 1.0)).expect("valid"),
        ]
    }

    /// On a unit sphere the normal is the point itself, to the order of the edge length squared.
    #[test]
    fn frames_are_right_handed_and_orthonormal_with_the_normal_last() {
        for mesh in some_shapes() {
            for tangent in TANGENTS {
                assert_orthonormal(&DiscreteFrames::of(&mesh, tangent));
            }
        }
        let sphere = shapes::icosphere(3);
        let frames = DiscreteFrames::of(&sphere, Tangent::Normal);
        for (v, p) in sphere.positions.iter().enumerate() {
            assert!(frames.columns(v).z_axis.distance(*p) < 0.02);
            let b1 = frames.columns(v).x_axis;
            // The tangent of the second kind is level, but where it does not exist.
            assert!(b1.z.abs() < 1e-14 || p.truncate().length() < 0.02, "{p}: {b1}");
        }
    }

    /// A normal exactly along z, up and down: the x axis stands in.
    #[test]
    fn a_normal_along_z_takes_the_x_axis() {
        let mut mesh = shapes::plane_grid(3, 3, 1.0, 1.0).expect("valid");
        for tilt in [DQuat::IDENTITY, DQuat::from_rotation_x(1.0), DQuat::from_rotation_y(0.5)] {
            let (before, up) = (mesh.positions.clone(), face_area_vector(mesh.corners(0)).normalize());
            let to_z = DQuat::from_rotation_arc(up, DVec3::Z);
            for p in &mut mesh.positions {
                *p = tilt * to_z * *p;
            }
            let frames = DiscreteFrames::of(&mesh, Tangent::Normal);
            assert_orthonormal(&frames);
            if tilt == DQuat::IDENTITY {
                assert!(frames.columns(5).x_axis.distance(DVec3::X) < 1e-12);
            }
            mesh.positions = before;
        }
    }

    /// Transfers along a path compose, and going back is the inverse.
    #[test]
    fn transfers_compose_along_paths() {
        for mesh in some_shapes() {
            for tangent in TANGENTS {
                let frames = DiscreteFrames::of(&mesh, tangent);
                let (mut at, mut path) = (0, DMat3::IDENTITY);
                for step in 0..30 {
                    let ring = mesh.topology().neighbours(at);
                    let next = ring[step % ring.len()] as usize;
                    path = frames.transfer(at, next) * path;
                    assert!(distance(frames.transfer(next, at) * frames.transfer(at, next), DMat3::IDENTITY) < 1e-14);
                    at = next;
                }
                assert!(distance(path, frames.transfer(0, at)) < 1e-13);
                // F_j = T F_i, with frames as rows.
                let rows = frames.transfer(0, at) * frames.columns(0).transpose();
                assert!(distance(rows, frames.columns(at).transpose()) < 1e-14);
            }
        }
    }

    /// The representation does not know how the shape stands: neither turned, nor moved, nor scaled. Frames from the normal alone
    /// do, but about z.
    #[test]
    fn transfers_and_local_coordinates_are_those_of_the_turned_shape() {
        let skew = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -1.0).normalize(), 2.0);
        for mesh in some_shapes() {
            for (tangent, turn) in [(Tangent::Edge, skew), (Tangent::Normal, DQuat::from_rotation_z(2.0))] {
                let moved = |p: &DVec3| 3.0 * (turn * *p) + DVec3::new(0.3, -2.0, 1.0);
                let turned = mesh.with_positions(mesh.positions.iter().map(moved).collect()).expect("finite");
                let (a, b) = (DiscreteFrames::of(&mesh, tangent), DiscreteFrames::of(&turned, tangent));
                for &[i, j] in mesh.topology().edges() {
                    let (i, j) = (i as usize, j as usize);
                    // A normal along z has no turning tangent.
                    let along_z = |v: usize| a.columns(v).z_axis.truncate().length() < 0.01;
                    if tangent == Tangent::Normal && (along_z(i) || along_z(j)) {
                        continue;
                    }
                    assert!(distance(a.transfer(i, j), b.transfer(i, j)) < 1e-10);
                    let edge = |m: &TriMesh| m.positions[j] - m.positions[i];
                    assert!((3.0 * a.local(i, edge(&mesh))).distance(b.local(i, edge(&turned))) < 1e-10);
                }
            }
        }
    }

    /// Needles, two faces back to back, coinciding points and a vertex without a face.
    #[test]
    fn degenerate_rings_have_frames_too() {
        let line = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let folded = vec![[0, 1, 2], [0, 2, 1]];
        for (points, triangles) in [
            (vec![line(0.0, 0.0), line(1.0, 0.0), line(0.0, 1.0), line(5.0, 5.0)], folded.clone()),
            (vec![line(0.0, 0.0), line(1.0, 0.0), line(2.0, 0.0)], vec![[0, 1, 2]]),
            (vec![line(0.0, 0.0), line(1.0, 1e-200), line(2.0, 0.0)], vec![[0, 1, 2]]),
            (vec![DVec3::ZERO; 3], vec![[0, 1, 2]]),
            (vec![DVec3::ZERO, DVec3::Z, 2.0 * DVec3::Z], folded),
        ] {
            let mesh = TriMesh::new(points, triangles).expect("valid");
            for tangent in TANGENTS {
                assert_orthonormal(&DiscreteFrames::of(&mesh, tangent));
            }
        }
    }
}
