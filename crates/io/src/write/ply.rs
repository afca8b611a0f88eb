use glam::DVec3;
use pliant_mesh::TriMesh;

/// PLY, binary little endian, double positions, faces as lists of three uint.
pub(super) fn encode(mesh: &TriMesh) -> Vec<u8> {
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment written by Pliant\n\
         element vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.vertex_count(),
        mesh.face_count()
    );
    let mut bytes = Vec::with_capacity(header.len() + 24 * mesh.vertex_count() + 13 * mesh.face_count());
    bytes.extend_from_slice(header.as_bytes());
    for coordinate in mesh.positions.iter().flat_map(DVec3::to_array) {
        bytes.extend_from_slice(&coordinate.to_le_bytes());
    }
    for triangle in mesh.triangles() {
        bytes.push(3);
        for vertex in triangle {
            bytes.extend_from_slice(&vertex.to_le_bytes());
        }
    }
    bytes
}
