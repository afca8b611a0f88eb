use super::*;
use crate::shapes;

fn topology(vertex_count: usize, triangles: &[[u32; 3]]) -> Topology {
    Topology::new(vertex_count, triangles.to_vec()).expect("valid indices")
}

/// A loop starting at its lowest vertex.
fn from_lowest(mut ring: Vec<u32>) -> Vec<u32> {
    let lowest = (0..ring.len()).min_by_key(|&i| ring[i]).unwrap_or(0);
    ring.rotate_left(lowest);
    ring
}

#[test]
fn edges_faces_and_neighbours_agree_with_each_other() {
    let grid = shapes::plane_grid(7, 5, 1.0, 1.0).expect("valid size");
    let torus = shapes::torus(1.0, 0.4, 9, 5).expect("valid radii");
    for topology in [grid.topology(), torus.topology(), shapes::icosphere(2).topology()] {
        assert!(topology.edges().is_sorted() && topology.edges().iter().all(|[a, b]| a < b));
        for (f, triangle) in topology.triangles().iter().enumerate() {
            for (k, edge) in topology.face_edges(f).into_iter().enumerate() {
                let (a, b) = (triangle[(k + 1) % 3], triangle[(k + 2) % 3]);
                assert_eq!(topology.edges()[edge as usize], [a.min(b), a.max(b)]);
                assert!(topology.edge_faces(edge as usize).contains(&(f as u32)));
                assert!(topology.vertex_faces(triangle[k] as usize).contains(&(f as u32)));
            }
        }
        let (mut around_vertices, mut around_edges) = (0, 0);
        for v in 0..topology.vertex_count() {
            let ring = topology.neighbours(v);
            assert!(ring.is_sorted() && topology.vertex_faces(v).is_sorted());
            around_vertices += topology.vertex_faces(v).len();
            for (&w, &e) in ring.iter().zip(topology.neighbour_edges(v)) {
                assert_eq!(topology.edges()[e as usize], [w.min(v as u32), w.max(v as u32)]);
            }
        }
        for e in 0..topology.edges().len() {
            assert!(topology.edge_faces(e).is_sorted());
            around_edges += topology.edge_faces(e).len();
        }
        // Every corner and every side is counted once.
        assert_eq!((around_vertices, around_edges), (3 * topology.triangles().len(), 3 * topology.triangles().len()));
    }
}

#[test]
fn euler_characteristics_and_closedness_of_known_shapes() {
    let grid = shapes::plane_grid(4, 3, 1.0, 1.0).expect("valid size");
    let torus = shapes::torus(1.0, 0.4, 6, 5).expect("valid radii");
    let sphere = shapes::icosphere(1);
    for (topology, euler, closed) in
        [(grid.topology(), 1, false), (torus.topology(), 0, true), (sphere.topology(), 2, true)]
    {
        assert_eq!(topology.euler_characteristic(), euler);
        assert_eq!(topology.is_closed(), closed);
        assert!(topology.is_manifold() && topology.require_oriented().is_ok());
        assert_eq!(topology.components().1, 1);
    }
}

/// The border of a grid, counter-clockwise: its faces look up, so they are on the left.
#[test]
fn the_boundary_of_a_grid_is_one_loop_with_the_faces_on_its_left() {
    let grid = shapes::plane_grid(3, 2, 1.0, 1.0).expect("valid size");
    let loops = grid.topology().boundary_loops();
    assert_eq!(loops, [vec![0, 1, 2, 3, 7, 11, 10, 9, 8, 4]]);
    let boundary = grid.topology().boundary_vertices();
    let expected: Vec<bool> = (0..12).map(|v| loops[0].contains(&v)).collect();
    assert_eq!(boundary, expected);
    assert_eq!(grid.topology().boundary_edge_count(), 10);
    assert!(shapes::icosphere(1).topology().boundary_loops().is_empty());
}

/// A square ring has an outer loop and an inner one that runs the other way round.
#[test]
fn an_annulus_has_two_loops() {
    let grid = shapes::plane_grid(3, 3, 1.0, 1.0).expect("valid size");
    let hole = [5, 6, 9, 10];
    let kept: Vec<[u32; 3]> =
        grid.triangles().iter().copied().filter(|t| !t.iter().all(|v| hole.contains(v))).collect();
    let loops = topology(16, &kept).boundary_loops();
    let loops: Vec<Vec<u32>> = loops.into_iter().map(from_lowest).collect();
    assert_eq!(loops, [vec![0, 1, 2, 3, 7, 11, 15, 14, 13, 12, 8, 4], vec![5, 9, 10, 6]]);
}

/// Two triangles that share one vertex, under every numbering of the five: two loops, each through the shared vertex.
#[test]
fn loops_that_touch_at_a_vertex_stay_apart() {
    let numberings = (0..120_usize).map(|mut k| {
        let mut left: Vec<u32> = (0..5).collect();
        [5, 4, 3, 2, 1].map(|n| {
            let v = left.remove(k % n);
            k /= n;
            v
        })
    });
    for [shared, a, b, c, d] in numberings {
        let bow_tie = topology(5, &[[shared, a, b], [shared, c, d]]);
        let mut loops: Vec<Vec<u32>> = bow_tie.boundary_loops().into_iter().map(from_lowest).collect();
        loops.sort_unstable();
        let mut expected = vec![from_lowest(vec![shared, a, b]), from_lowest(vec![shared, c, d])];
        expected.sort_unstable();
        assert_eq!(loops, expected);
        assert_eq!(bow_tie.require_manifold(), Err(MeshError::NonManifoldVertex { vertex: shared, fans: 2 }));
        assert_eq!(bow_tie.fan_count(shared as usize), 2);
    }
}

/// Faces of opposite orientation break the loop; nothing is lost and nothing repeated.
#[test]
fn boundaries_of_badly_oriented_meshes_are_followed_as_far_as_possible() {
    let bad = topology(4, &[[0, 1, 2], [1, 2, 3]]);
    assert_eq!(bad.require_oriented(), Err(MeshError::InconsistentOrientation { a: 1, b: 2, faces: [0, 1] }));
    let loops = bad.boundary_loops();
    assert_eq!(loops.iter().map(Vec::len).sum::<usize>(), bad.boundary_edge_count());
}

#[test]
fn components_are_numbered_by_their_lowest_vertex() {
    // Faces on 1-3-5 and 0-2-6; vertex 4 is unused.
    let (component, count) = topology(7, &[[5, 3, 1], [6, 0, 2]]).components();
    assert_eq!((component, count), (vec![0, 1, 0, 1, 2, 1, 0], 3));
    assert_eq!(topology(7, &[[5, 3, 1], [6, 0, 2]]).euler_characteristic(), 2);
    assert_eq!(topology(0, &[]).components(), (vec![], 0));
}

#[test]
fn what_is_wrong_is_named() {
    // Three pages of a book along the spine 1-4.
    let book = topology(5, &[[1, 4, 0], [1, 4, 2], [1, 4, 3]]);
    assert_eq!(book.require_manifold(), Err(MeshError::NonManifoldEdge { a: 1, b: 4, faces: 3 }));
    assert_eq!(book.non_manifold_edge_count(), 1);
    assert_eq!(book.fan_count(1), 1);
    // One face of a sphere is missing: three open edges.
    let sphere = shapes::icosphere(0);
    let open = topology(12, &sphere.triangles()[1..]);
    let [a, b, c] = {
        let mut t = sphere.triangles()[0];
        t.sort_unstable();
        t
    };
    assert_eq!(open.require_closed(), Err(MeshError::OpenEdge { a, b, open: 3 }));
    assert_eq!(from_lowest(open.boundary_loops().remove(0)).len(), [a, b, c].len());
    assert_eq!(
        Topology::new(3, vec![[0, 1, 2], [0, 1, 3]]).expect_err("there is no vertex 3"),
        MeshError::IndexOutOfRange { face: 1, vertex: 3, vertices: 3 }
    );
    for (triangle, vertex) in [([0, 0, 1], 0), ([1, 0, 0], 0), ([2, 0, 2], 2)] {
        assert_eq!(
            Topology::new(3, vec![triangle]).expect_err("a repeated vertex"),
            MeshError::RepeatedVertex { face: 0, vertex }
        );
    }
}

/// Two cones that touch at their tips: each tip ring is one fan.
#[test]
fn fans_are_counted_also_on_closed_surfaces() {
    let sphere = shapes::icosphere(0);
    let n = sphere.vertex_count() as u32;
    // A second sphere whose vertex 0 is vertex 0 of the first.
    let other = sphere.triangles().iter().map(|t| t.map(|v| if v == 0 { 0 } else { v + n - 1 }));
    let triangles: Vec<[u32; 3]> = sphere.triangles().iter().copied().chain(other).collect();
    let pair = topology(2 * n as usize - 1, &triangles);
    assert!(pair.is_closed() && pair.require_oriented().is_ok());
    assert_eq!(pair.require_manifold(), Err(MeshError::NonManifoldVertex { vertex: 0, fans: 2 }));
    assert_eq!((pair.fan_count(0), pair.fan_count(1)), (2, 1));
    // Two spheres less one shared vertex.
    assert_eq!(pair.euler_characteristic(), 3);
    assert_eq!(topology(1, &[]).fan_count(0), 0);
}

/// Few faces are counted in another way than many; both agree on faces drawn at random round one vertex: books, fans, holes.
#[test]
fn fans_of_few_faces_are_those_of_many() {
    let mut state = 1_u64;
    let mut random = |below: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 33) % below) as u32
    };
    let mut seen = [0; 4];
    for round in 0..400 {
        let mut triangles = Vec::new();
        for _ in 0..1 + round % 12 {
            let (centre, a, b) = (4, 5 + random(12), 5 + random(12));
            let turned = [[centre, a, b], [b, centre, a], [a, b, centre]][random(3) as usize];
            triangles.extend(Some(turned).filter(|_| a != b));
        }
        let drawn = topology(17, &triangles);
        let fans = drawn.fan_count(4);
        assert_eq!(fans, drawn.fan_count_of_many(4), "{triangles:?}");
        seen[fans.min(3)] += 1;
    }
    assert!(seen[1..].iter().all(|&n| n > 10), "not all kinds were drawn: {seen:?}");
}
