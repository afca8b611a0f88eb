use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::{Topology, VertexSet};

/// Half the cross product of two sides: along the normal, as long as the area.
pub fn face_area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    0.5 * (b - a).cross(c - a)
}

/// Unit normal of each face (right-hand rule); zero where a face has no area.
///
/// `positions` is any pose of `topology`, one position per vertex.
pub fn face_normals(topology: &Topology, positions: &[DVec3]) -> Vec<DVec3> {
    let area = |t: &[u32; 3]| face_area_vector(t.map(|v| positions[v as usize]));
    topology.triangles().iter().map(|t| area(t).normalize_or_zero()).collect()
}

/// Unit normal of each vertex, the faces weighted by area; zero for a vertex whose faces cancel or that has none.
///
/// `positions` is any pose of `topology`, one position per vertex.
pub fn vertex_normals(topology: &Topology, positions: &[DVec3]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; topology.vertex_count()];
    for triangle in topology.triangles() {
        let area = face_area_vector(triangle.map(|v| positions[v as usize]));
        for &v in triangle {
            normals[v as usize] += area;
        }
    }
    for normal in &mut normals {
        *normal = normal.normalize_or_zero();
    }
    normals
}

/// Vertex normals in single precision for frame after frame, in memory kept from one to the next.
#[derive(Debug, Clone, Default)]
pub struct NormalBuffer {
    /// Area vectors of the faces.
    faces: Vec<Vec3>,
}

/// Vertices or faces that are worth a task.
const GRAIN: usize = 4096;

impl NormalBuffer {
    /// Writes the unit normal of each vertex, as [`vertex_normals`] has them: the faces weighted by area; zero for a vertex whose
    /// faces cancel or that has none.
    ///
    /// `positions` is any pose of `topology`; both slices have one entry per vertex. In parallel; allocates only on the first call.
    /// The same bits for any number of threads. Edges should be longer than 1e-18 and shorter than 1e18 units.
    ///
    /// # Panics
    /// If a slice has another length.
    pub fn compute(&mut self, topology: &Topology, positions: &[Vec3], normals: &mut [Vec3]) {
        assert_eq!(positions.len(), topology.vertex_count());
        assert_eq!(normals.len(), topology.vertex_count());
        self.faces.resize(topology.triangles().len(), Vec3::ZERO);
        self.faces.par_iter_mut().zip(topology.triangles()).with_min_len(GRAIN).for_each(|(area, triangle)| {
            *area = twice_area(triangle, positions);
        });
        let faces = &self.faces[..];
        normals.par_iter_mut().enumerate().with_min_len(GRAIN).for_each(|(v, normal)| {
            *normal = unit(topology.vertex_faces(v), |f| faces[f]);
        });
    }

    /// As [`Self::compute`], for some vertices alone: the other normals stay as they are. The same bits.
    ///
    /// A vertex costs half as much again, as each face is looked at from its corners. Allocates nothing.
    ///
    /// # Panics
    /// If a slice has another length, or one of `vertices` is none of the topology.
    pub fn compute_some(topology: &Topology, positions: &[Vec3], vertices: &VertexSet, normals: &mut [Vec3]) {
        assert_eq!(positions.len(), topology.vertex_count());
        assert_eq!(normals.len(), topology.vertex_count());
        let triangles = topology.triangles();
        let normal = |v| unit(topology.vertex_faces(v), |f| twice_area(&triangles[f], positions));
        write_some(vertices.as_slice(), 0, normals, &normal);
    }
}

/// The cross product of two sides. Written out, as a `map` over the corners is a call to each.
#[inline]
fn twice_area(triangle: &[u32; 3], positions: &[Vec3]) -> Vec3 {
    let corner = positions[triangle[0] as usize];
    (positions[triangle[1] as usize] - corner).cross(positions[triangle[2] as usize] - corner)
}

/// The direction of the sum of the faces' area vectors.
#[inline]
fn unit(faces: &[u32], area: impl Fn(usize) -> Vec3) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for &f in faces {
        sum += area(f as usize);
    }
    // The square of a small area is nothing in f32.
    sum.as_dvec3().normalize_or_zero().as_vec3()
}

/// Writes a value for each of `vertices`, which increase, into `values`, the first of which belongs to vertex `first`.
fn write_some<T: Send>(vertices: &[u32], first: usize, values: &mut [T], value: &(impl Fn(usize) -> T + Sync)) {
    if vertices.len() <= GRAIN {
        for &v in vertices {
            values[v as usize - first] = value(v as usize);
        }
        return;
    }
    let (low, high) = vertices.split_at(vertices.len() / 2);
    let middle = high[0] as usize;
    let (low_values, high_values) = values.split_at_mut(middle - first);
    rayon::join(|| write_some(low, first, low_values, value), || write_some(high, middle, high_values, value));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    /// Some normals made anew are those of all of them, to the bit, and the others stay; with enough vertices for several tasks.
    #[test]
    fn some_normals_are_as_all_of_them() {
        let mesh = shapes::creature(20_000).expect("valid");
        let topology = mesh.topology();
        let positions: Vec<Vec3> = mesh.positions.iter().map(|p| p.as_vec3()).collect();
        let mut all = vec![Vec3::ZERO; positions.len()];
        NormalBuffer::default().compute(topology, &positions, &mut all);
        let exact = vertex_normals(topology, &positions.iter().map(|p| p.as_dvec3()).collect::<Vec<_>>());
        assert!(all.iter().zip(&exact).all(|(n, e)| n.as_dvec3().distance(*e) < 1e-4));
        for every in [1, 2, 10_000] {
            let some = VertexSet::where_true(positions.len(), |v| v % every == every / 2);
            let mut normals = vec![Vec3::NAN; positions.len()];
            NormalBuffer::compute_some(topology, &positions, &some, &mut normals);
            for (v, (made, expected)) in (0..).zip(normals.iter().zip(&all)) {
                assert!(if some.contains(v) { made == expected } else { made.is_nan() }, "vertex {v}");
            }
        }
        NormalBuffer::compute_some(topology, &positions, &VertexSet::default(), &mut all);
    }
}
