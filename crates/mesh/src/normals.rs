use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::Topology;

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
        self.faces.par_iter_mut().zip(topology.triangles()).with_min_len(4096).for_each(|(area, t)| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            *area = (b - a).cross(c - a);
        });
        let faces = &self.faces;
        normals.par_iter_mut().enumerate().with_min_len(4096).for_each(|(v, normal)| {
            let sum: Vec3 = topology.vertex_faces(v).iter().map(|&f| faces[f as usize]).sum();
            // The square of a small area is nothing in f32.
            *normal = sum.as_dvec3().normalize_or_zero().as_vec3();
        });
    }
}
