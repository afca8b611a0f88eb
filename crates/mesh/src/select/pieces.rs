use super::{check_vertex, mask};
use crate::{MeshError, Topology, VertexSet};

/// The connected pieces of a set, joined by edges between members, in the order of their lowest vertices. Linear time.
///
/// # Errors
/// A member that is no vertex.
pub fn pieces(topology: &Topology, set: &VertexSet) -> Result<Vec<VertexSet>, MeshError> {
    let mut left = mask(topology, set)?;
    let mut found = Vec::new();
    for v in set.iter() {
        if left[v as usize] {
            found.push(take_piece(topology, &mut left, v));
        }
    }
    Ok(found)
}

/// The connected piece of a set that holds `vertex`; empty if the vertex is no member.
///
/// # Errors
/// `vertex` or a member is no vertex.
pub fn piece_at(topology: &Topology, set: &VertexSet, vertex: u32) -> Result<VertexSet, MeshError> {
    check_vertex(topology, "the vertex", vertex)?;
    let mut left = mask(topology, set)?;
    Ok(if left[vertex as usize] { take_piece(topology, &mut left, vertex) } else { VertexSet::default() })
}

fn take_piece(topology: &Topology, left: &mut [bool], start: u32) -> VertexSet {
    let mut piece = vec![start];
    left[start as usize] = false;
    let mut next = 0;
    while let Some(&v) = piece.get(next) {
        next += 1;
        for &w in topology.neighbours(v as usize) {
            if std::mem::take(&mut left[w as usize]) {
                piece.push(w);
            }
        }
    }
    piece.into_iter().collect()
}

/// The members that share an edge with a vertex that is no member.
///
/// # Errors
/// A member that is no vertex.
pub fn border(topology: &Topology, set: &VertexSet) -> Result<VertexSet, MeshError> {
    let inside = mask(topology, set)?;
    Ok(set.iter().filter(|&v| topology.neighbours(v as usize).iter().any(|&w| !inside[w as usize])).collect())
}

/// Border of the patch of faces that have all three corners in the set: closed loops of vertices, each running with the patch on
/// its left.
///
/// Where the patch reaches a border of the mesh, the loop runs along it. Members without a face of the patch (single vertices,
/// chains of edges) are on no loop. What [`Topology::boundary_loops`] says of loops that touch, and of faces badly oriented, is
/// true here too. Linear time.
///
/// # Errors
/// A member that is no vertex.
pub fn border_loops(topology: &Topology, set: &VertexSet) -> Result<Vec<Vec<u32>>, MeshError> {
    let inside = mask(topology, set)?;
    let patch = topology.triangles().iter().copied().filter(|t| t.iter().all(|&v| inside[v as usize])).collect();
    Ok(Topology::new(topology.vertex_count(), patch)?.boundary_loops())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::{geodesic_ball, in_sphere};
    use crate::shapes;
    use glam::DVec3;

    #[test]
    fn stripes_of_a_grid_are_its_pieces() {
        let grid = shapes::plane_grid(20, 20, 1.0, 1.0).expect("valid size");
        let stripes = VertexSet::where_true(441, |v| v % 21 % 3 != 2);
        let found = pieces(grid.topology(), &stripes).expect("vertices");
        assert_eq!(found.len(), 7);
        for (k, piece) in (0..).zip(&found) {
            assert_eq!(*piece, VertexSet::where_true(441, |v| v % 21 / 3 == k && v % 21 % 3 != 2));
            assert_eq!(piece_at(grid.topology(), &stripes, 3 * k + 21), Ok(piece.clone()));
        }
        assert!(piece_at(grid.topology(), &stripes, 2).expect("a vertex").is_empty());
        assert_eq!(pieces(grid.topology(), &VertexSet::default()), Ok(vec![]));
    }

    /// The patch of a ball on a sphere is a disc: one loop, whose vertices lie on the ball's border or next to it.
    #[test]
    fn a_ball_on_a_sphere_has_one_loop() {
        let sphere = shapes::icosphere(4);
        for (source, radius) in [(0, 0.3), (100, 0.8), (7, 1.4), (500, 2.2)] {
            let ball = in_sphere(&sphere.positions, sphere.positions[source], radius_of_chord(radius));
            let loops = border_loops(sphere.topology(), &ball).expect("vertices");
            assert_eq!(loops.len(), 1, "{source}, {radius}");
            let edge_of_patch = border(sphere.topology(), &ball).expect("vertices");
            assert!(loops[0].iter().all(|&v| edge_of_patch.contains(v)));
            // With the patch on its left the loop turns round the source counter-clockwise, seen from outside.
            let p = |i: usize| sphere.positions[loops[0][i % loops[0].len()] as usize];
            let turn: DVec3 = (0..loops[0].len()).map(|i| p(i).cross(p(i + 1))).sum();
            assert!(turn.dot(sphere.positions[source]) > 0.0);
            let along = geodesic_ball(sphere.topology(), &sphere.positions, source as u32, radius);
            assert_eq!(pieces(sphere.topology(), &along).expect("vertices").len(), 1);
        }
    }

    /// Chord of an arc of the unit circle.
    fn radius_of_chord(arc: f64) -> f64 {
        2.0 * (0.5 * arc).sin()
    }

    /// Bands round a tube have two loops, and the loop of a patch at the mesh's border runs along that border.
    #[test]
    fn loops_of_bands_and_of_patches_at_the_border() {
        let torus = shapes::torus(1.0, 0.4, 40, 16).expect("valid radii");
        let band = VertexSet::where_true(torus.vertex_count(), |v| torus.positions[v as usize].x > 0.3);
        assert_eq!(border_loops(torus.topology(), &band).expect("vertices").len(), 2);
        let grid = shapes::plane_grid(4, 4, 1.0, 1.0).expect("valid size");
        let left = VertexSet::where_true(25, |v| v % 5 < 2);
        let mut loops = border_loops(grid.topology(), &left).expect("vertices");
        loops[0].sort_unstable();
        assert_eq!(loops, [left.as_slice().to_vec()]);
        assert_eq!(border(grid.topology(), &left), Ok(VertexSet::where_true(25, |v| v % 5 == 1)));
        // An edge alone has no face.
        assert!(border_loops(grid.topology(), &VertexSet::from_iter([0, 1])).expect("vertices").is_empty());
    }

    #[test]
    fn bad_members_are_refused() {
        let sphere = shapes::icosphere(1);
        let bad = VertexSet::from_iter([42]);
        let refused = |e: MeshError| e.to_string().contains("42 vertices");
        assert!(pieces(sphere.topology(), &bad).is_err_and(refused));
        assert!(border(sphere.topology(), &bad).is_err_and(refused));
        assert!(border_loops(sphere.topology(), &bad).is_err_and(refused));
        assert!(piece_at(sphere.topology(), &VertexSet::default(), 42).is_err_and(refused));
    }
}
