use std::collections::HashMap;

use glam::DVec3;
use serde::Serialize;

use crate::{MeshError, TriMesh};

/// A mesh in normal form, and how the soup it came from maps to it.
#[derive(Debug, Clone)]
pub struct Cleaned {
    /// Welded, without faces that name a vertex twice.
    pub mesh: TriMesh,
    /// Mesh vertex of each vertex of the soup.
    pub weld: Vec<u32>,
    /// What had to be repaired.
    pub report: CleanReport,
}

/// Repairs made on the way to normal form; nothing is changed without being counted here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct CleanReport {
    /// Vertices merged into an earlier one at exactly the same position.
    pub welded: usize,
    /// Faces dropped because two of their corners are one vertex (after welding).
    pub degenerate_faces: usize,
    /// Faces dropped because an earlier face has the same three vertices in the same orientation.
    pub repeated_faces: usize,
    /// Vertices that no face uses; kept, so that vertex numbers stay those of the file.
    pub unused_vertices: usize,
}

/// Brings a triangle soup to normal form: vertices at bit-equal positions become one, collapsed and repeated faces go.
///
/// Mesh vertices keep the order in which their first copies stand in the soup, so a soup without repeats keeps its
/// vertex numbers. Vertices without faces are kept, and welded like the rest. Linear time.
///
/// # Errors
/// As [`TriMesh::new`].
pub fn clean_soup(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<Cleaned, MeshError> {
    let mut first_at: HashMap<[u64; 3], u32> = HashMap::with_capacity(positions.len());
    let mut welded_positions = Vec::with_capacity(positions.len());
    let weld: Vec<u32> = positions
        .iter()
        .map(|p| {
            // Adding 0 turns -0 into +0, so that the two are one position.
            let key = p.to_array().map(|c| (c + 0.0).to_bits());
            *first_at.entry(key).or_insert_with(|| {
                welded_positions.push(*p);
                welded_positions.len() as u32 - 1
            })
        })
        .collect();
    let mut report = CleanReport { welded: positions.len() - welded_positions.len(), ..CleanReport::default() };
    let mut seen = std::collections::HashSet::with_capacity(triangles.len());
    let mut kept = Vec::with_capacity(triangles.len());
    for (face, triangle) in triangles.iter().enumerate() {
        if let Some(&vertex) = triangle.iter().find(|&&v| v as usize >= weld.len()) {
            return Err(MeshError::IndexOutOfRange { face, vertex, vertices: weld.len() });
        }
        let [a, b, c] = triangle.map(|v| weld[v as usize]);
        if a == b || b == c || c == a {
            report.degenerate_faces += 1;
        } else if !seen.insert(lowest_first([a, b, c])) {
            report.repeated_faces += 1;
        } else {
            kept.push([a, b, c]);
        }
    }
    let mesh = TriMesh::new(welded_positions, kept)?;
    report.unused_vertices = (0..mesh.vertex_count()).filter(|&v| mesh.topology().vertex_faces(v).is_empty()).count();
    Ok(Cleaned { mesh, weld, report })
}

/// The same face starting at its lowest vertex.
fn lowest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
