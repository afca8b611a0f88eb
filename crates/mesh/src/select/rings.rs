use super::mask;
use crate::{MeshError, Topology, VertexSet};

/// The set and all vertices at most `rings` edges away from it: its k-ring.
///
/// Costs a pass over the vertices and the edges of what is added.
///
/// # Errors
/// A member that is no vertex.
pub fn grow(topology: &Topology, set: &VertexSet, rings: usize) -> Result<VertexSet, MeshError> {
    let mut inside = mask(topology, set)?;
    let mut members = set.as_slice().to_vec();
    let mut start = 0;
    for _ in 0..rings {
        let end = members.len();
        if start == end {
            break;
        }
        for i in start..end {
            for &w in topology.neighbours(members[i] as usize) {
                if !inside[w as usize] {
                    inside[w as usize] = true;
                    members.push(w);
                }
            }
        }
        start = end;
    }
    Ok(members.into_iter().collect())
}

/// The members more than `rings` edges away from every vertex that is no member: what growing the rest leaves.
///
/// A border of the mesh has nothing behind it, so a set does not shrink from there. [`grow`] then `shrink` closes gaps and loses
/// no member; `shrink` then [`grow`] removes thin parts and adds no vertex. Linear time.
///
/// # Errors
/// A member that is no vertex.
pub fn shrink(topology: &Topology, set: &VertexSet, rings: usize) -> Result<VertexSet, MeshError> {
    // Members are checked, as inverting forgets those that are no vertices.
    mask(topology, set)?;
    let n = topology.vertex_count();
    Ok(grow(topology, &set.inverted(n), rings)?.inverted(n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    /// Diagonals alternate, so that every way from a vertex of 8 neighbours is as long as a king's on a chessboard.
    #[test]
    fn rings_of_a_grid_are_squares() {
        let grid = shapes::plane_grid(20, 20, 1.0, 1.0).expect("valid size");
        let centre = 10 * 21 + 10;
        assert_eq!(grid.topology().neighbours(centre as usize).len(), 8);
        let middle = VertexSet::from_iter([centre]);
        for k in 0..10_u32 {
            let square = grow(grid.topology(), &middle, k as usize).expect("a vertex");
            let near = |at: u32| at.abs_diff(10) <= k;
            assert_eq!(square, VertexSet::where_true(441, |v| near(v % 21) && near(v / 21)));
            assert_eq!(shrink(grid.topology(), &square, k as usize), Ok(middle.clone()));
            assert!(shrink(grid.topology(), &square, k as usize + 1).expect("vertices").is_empty());
        }
        assert_eq!(grow(grid.topology(), &middle, usize::MAX), Ok(VertexSet::all(441)));
    }

    /// Half of the grid does not shrink from the border of the mesh, only from the other half: a column per ring.
    #[test]
    fn sets_shrink_from_the_other_vertices_only() {
        let grid = shapes::plane_grid(20, 20, 1.0, 1.0).expect("valid size");
        let columns = |n: u32| VertexSet::where_true(441, |v| v % 21 < n);
        for rings in 0..5 {
            assert_eq!(shrink(grid.topology(), &columns(10), rings as usize), Ok(columns(10 - rings)));
            assert_eq!(grow(grid.topology(), &columns(10), rings as usize), Ok(columns(10 + rings)));
        }
        assert_eq!(shrink(grid.topology(), &VertexSet::all(441), 7), Ok(VertexSet::all(441)));
    }

    #[test]
    fn closing_loses_nothing_and_opening_adds_nothing() {
        let torus = shapes::torus(1.0, 0.4, 40, 16).expect("valid radii");
        let (topology, n) = (torus.topology(), torus.vertex_count());
        for modulus in [2, 3, 7, 31, 97] {
            let set = VertexSet::where_true(n, |v| (v * v + 3 * v) % modulus < 1 + modulus / 3);
            for k in 0..4 {
                let closed = shrink(topology, &grow(topology, &set, k).expect("set"), k).expect("set");
                let opened = grow(topology, &shrink(topology, &set, k).expect("set"), k).expect("set");
                assert!(set.difference(&closed).is_empty() && opened.difference(&set).is_empty());
            }
        }
    }

    #[test]
    fn empty_sets_and_bad_members() {
        let sphere = shapes::icosphere(1);
        let none = VertexSet::default();
        assert_eq!(grow(sphere.topology(), &none, 3), Ok(none.clone()));
        assert_eq!(shrink(sphere.topology(), &none, 3), Ok(none));
        let bad = VertexSet::from_iter([3, 42]);
        for found in [grow(sphere.topology(), &bad, 1), shrink(sphere.topology(), &bad, 1)] {
            assert!(matches!(found, Err(MeshError::BadParameter { found, .. }) if found == "42"));
        }
    }
}
