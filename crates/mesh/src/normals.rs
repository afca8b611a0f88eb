use glam::DVec3;

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
