use pliant_mesh::TriMesh;

/// Wavefront OBJ.
pub(super) fn encode(mesh: &TriMesh) -> Vec<u8> {
    let mut text = String::with_capacity(60 * mesh.vertex_count() + 24 * mesh.face_count());
    for position in &mesh.positions {
        text.push('v');
        for coordinate in position.to_array() {
            text.push(' ');
            push_shortest(&mut text, coordinate);
        }
        text.push('\n');
    }
    for triangle in mesh.triangles() {
        text.push('f');
        for &vertex in triangle {
            text.push(' ');
            text.push_str(&(u64::from(vertex) + 1).to_string());
        }
        text.push('\n');
    }
    text.into_bytes()
}

/// The shortest decimal that reads back to the same bits; with an exponent where that saves more than a few zeros.
fn push_shortest(text: &mut String, value: f64) {
    let size = value.abs();
    let formatted = if size == 0.0 || (1e-4..1e16).contains(&size) { format!("{value}") } else { format!("{value:e}") };
    text.push_str(&formatted);
}
