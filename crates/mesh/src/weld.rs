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
/// Names the first vertex of the soup that is not finite, or the first face with an index out of range.
pub fn clean_soup(positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<Cleaned, MeshError> {
    // Checked here, so that the vertex is named by its number in the soup.
    if let Some(vertex) = positions.iter().position(|p| !p.is_finite()) {
        return Err(MeshError::NotFinite { vertex });
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    /// A sphere cut into separate triangles and put together again is the sphere, in the order of first use.
    #[test]
    fn a_soup_of_separate_triangles_becomes_the_closed_mesh_it_was() {
        let sphere = shapes::icosphere(3);
        let soup: Vec<DVec3> = sphere.triangles().iter().flatten().map(|&v| sphere.positions[v as usize]).collect();
        let triangles: Vec<[u32; 3]> = (0..sphere.face_count() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
        let cleaned = clean_soup(&soup, &triangles).expect("a valid soup");
        assert_eq!(cleaned.mesh.vertex_count(), sphere.vertex_count());
        assert_eq!(
            cleaned.report,
            CleanReport { welded: soup.len() - sphere.vertex_count(), ..CleanReport::default() }
        );
        assert!(cleaned.mesh.topology().is_closed() && cleaned.mesh.topology().is_manifold());
        for (v, p) in soup.iter().enumerate() {
            assert_eq!(cleaned.mesh.positions[cleaned.weld[v] as usize], *p);
        }
        // First copies come in increasing order.
        let mut next = 0;
        for &v in &cleaned.weld {
            assert!(v <= next);
            next = next.max(v + 1);
        }
    }

    #[test]
    fn a_clean_mesh_keeps_its_numbers() {
        let torus = shapes::torus(1.0, 0.4, 9, 7).expect("valid radii");
        let cleaned = clean_soup(&torus.positions, torus.triangles()).expect("a valid soup");
        assert_eq!(cleaned.mesh.triangles(), torus.triangles());
        assert_eq!(cleaned.weld, (0..63).collect::<Vec<u32>>());
        assert_eq!(cleaned.report, CleanReport::default());
    }

    /// Vertex 3 lies on vertex 0 but for the sign of a zero, vertex 5 is unused; one face of each kind goes.
    #[test]
    fn every_repair_is_counted() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.0, 0.0], [1.0, 1.0, 0.0], [9.0, 9.0, 9.0]];
        let triangles = [[0, 1, 2], [0, 3, 1], [2, 3, 1], [1, 4, 2], [1, 3, 2], [4, 4, 1]];
        let cleaned = clean_soup(&p.map(DVec3::from), &triangles).expect("valid indices");
        // Face 2 is face 0 turned round, face 4 is its mirror image and stays.
        assert_eq!(cleaned.mesh.triangles(), [[0, 1, 2], [1, 3, 2], [1, 0, 2]]);
        assert_eq!(cleaned.weld, [0, 1, 2, 0, 3, 4]);
        let report = CleanReport { welded: 1, degenerate_faces: 2, repeated_faces: 1, unused_vertices: 1 };
        assert_eq!(cleaned.report, report);
    }

    /// A mirror image has the same vertices in the other order, for every way to start it.
    #[test]
    fn faces_are_repeats_only_in_the_same_orientation() {
        for [a, b, c] in [[0, 1, 2], [5, 9, 7], [3, 2, 8]] {
            let same = [[a, b, c], [b, c, a], [c, a, b]].map(lowest_first);
            assert!(same[0] == same[1] && same[1] == same[2]);
            assert!([[a, c, b], [c, b, a], [b, a, c]].iter().all(|&t| lowest_first(t) != same[0]));
        }
    }

    #[test]
    fn errors_name_the_vertex_and_the_face_of_the_soup() {
        let mut p = vec![DVec3::ZERO, DVec3::ZERO, DVec3::X, DVec3::Y];
        let error = clean_soup(&p, &[[0, 2, 3], [1, 2, 4]]).expect_err("there is no vertex 4");
        assert_eq!(error, MeshError::IndexOutOfRange { face: 1, vertex: 4, vertices: 4 });
        p[3].y = f64::NAN;
        assert_eq!(clean_soup(&p, &[[0, 2, 3]]).expect_err("not a number"), MeshError::NotFinite { vertex: 3 });
    }
}
