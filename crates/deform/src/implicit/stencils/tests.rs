use pliant_mesh::shapes;

use super::*;

fn mesh(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
    TriMesh::new(points.iter().map(|p| DVec3::from_array(*p)).collect(), triangles.to_vec()).expect("valid")
}

/// Closed, open, flat, and each special case of section 3.3 and beyond: corners of two neighbours, a corner whose three neighbours are on
/// one line, a book of two faces, a fan folded flat on itself, coincident vertices.
fn meshes() -> Vec<(&'static str, TriMesh)> {
    let strip: Vec<[f64; 3]> = (0..8).map(|i| [f64::from(i / 2), f64::from(i % 2), 0.0]).collect();
    let strip_faces: Vec<[u32; 3]> =
        (0..6).map(|i| if i % 2 == 0 { [i, i + 2, i + 1] } else { [i, i + 1, i + 2] }).collect();
    let corner = [
        [0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 2.0, 0.0],
        [2.0, 2.0, 0.0],
        [3.0, 1.0, 0.0],
        [1.0, 3.0, 0.0],
    ];
    let corner_faces = [[0, 1, 2], [0, 2, 3], [1, 4, 2], [2, 4, 3], [1, 5, 4], [3, 4, 6]];
    let folded = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let folded_faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]];
    vec![
        ("sphere", shapes::icosphere(2)),
        ("bar", shapes::bar(8, 3, 2, DVec3::new(4.0, 1.5, 1.0)).expect("valid")),
        ("plane", shapes::plane_grid(7, 5, 2.0, 1.5).expect("valid")),
        ("bumps", shapes::bumpy_plane(9, 7, 2.0, 1.5, 0.1, 2).expect("valid")),
        ("triangle", mesh(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.5, 1.0, 0.3]], &[[0, 1, 2]])),
        ("strip", mesh(&strip, &strip_faces)),
        ("straight corner", mesh(&corner, &corner_faces)),
        ("book", mesh(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], &[[0, 1, 2], [1, 0, 3]])),
        ("folded fan", mesh(&folded, &folded_faces)),
        ("coincident", mesh(&[[1.0, 1.0, 1.0]; 4], &[[0, 1, 2], [1, 3, 2]])),
    ]
}

fn all(mesh: &TriMesh) -> Stencils {
    Stencils::new(mesh, &vec![Need::Always; mesh.vertex_count()])
}

fn size(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|x| x.abs()).fold(0.0, f64::max)
}

/// Eq. 2: an affine map of the points is found at every vertex, degenerate or not, and only its linear part.
#[test]
fn an_affine_map_is_its_own_gradient() {
    let linear = DMat3::from_cols(DVec3::new(1.0, 0.4, -0.3), DVec3::new(-2.0, 0.7, 0.1), DVec3::new(0.2, 0.9, 1.5));
    for (name, mesh) in meshes() {
        let stencils = all(&mesh);
        assert_eq!(stencils.len(), mesh.vertex_count());
        for map in [DMat3::ZERO, DMat3::IDENTITY, linear, DMat3::from_diagonal(DVec3::new(1.0, -1.0, 3.0))] {
            let image: Vec<DVec3> = stencils.points.iter().map(|p| map * *p + DVec3::new(3.0, -1.0, 2.0)).collect();
            for g in 0..stencils.len() {
                let off = size(stencils.evaluate(g, &image) - map);
                // Rounding of coordinates of some units, over a displacement of a fifth of an edge.
                assert!(off < 1e-12, "{name}, {g}: {off:e}");
                let sum: DVec3 = stencils.terms(g).map(|(_, p)| p).sum();
                let largest = stencils.terms(g).map(|(_, p)| p.length()).fold(0.0, f64::max);
                assert!(sum.length() < 1e-13 * largest, "{name}: {sum}");
            }
        }
    }
}

/// Eq. 4 as it is printed, with matrices of the whole ring, for points moved anyhow.
#[test]
fn gradients_are_those_of_the_closed_form() {
    for (name, mesh) in [("sphere", shapes::icosphere(2)), ("creature", shapes::creature(2000).expect("valid"))] {
        let stencils = all(&mesh);
        let moved = |p: DVec3| DVec3::new((3.0 * p.y).sin() + p.x, p.z * p.x - p.y, (2.0 * p.x).cos());
        let points: Vec<DVec3> = stencils.points.iter().map(|p| moved(*p)).collect();
        let ring = |i: usize, of: &[DVec3]| {
            let ring: Vec<DVec3> = mesh.topology().neighbours(i).iter().map(|&j| of[j as usize]).collect();
            let centre = ring.iter().sum::<DVec3>() / ring.len() as f64;
            std::iter::once(of[i]).chain(ring).map(|p| p - centre).collect::<Vec<DVec3>>()
        };
        let mut compared = 0;
        for i in 0..mesh.vertex_count() {
            if stencils.terms(stencils.gradient[i] as usize).count() > mesh.topology().neighbours(i).len() + 1 {
                continue;
            }
            let (v, image) = (ring(i, &stencils.points), ring(i, &points));
            let product = |a: &[DVec3]| a.iter().zip(&v).fold(DMat3::ZERO, |sum, (a, b)| sum + outer(*a, *b));
            let expected = product(&image) * product(&v).inverse();
            let off = size(stencils.evaluate(stencils.gradient[i] as usize, &points) - expected);
            // The inverse of a matrix of condition 2e5.
            assert!(off < 1e-9 * size(expected).max(1.0), "{name}, {i}: {off:e}");
            compared += 1;
        }
        assert!(compared > 100, "{name}: {compared}");
    }
}

/// Eq. 8: displaced along the normal by a fifth of the mean length of its edges; and afterwards no ring of the plane is flat.
#[test]
fn degenerate_vertices_are_displaced_by_equation_8() {
    let (name, plane) = ("plane", shapes::plane_grid(12, 9, 3.0, 2.0).expect("valid"));
    let need = vec![Need::Always; plane.vertex_count()];
    let mut rings = Rings::new(&plane, &need);
    assert!((0..need.len()).all(|i| rings.condition(i) > LARGEST_CONDITION), "{name} is flat everywhere");
    rings.displace();
    rings.complete();
    let mut displaced = 0;
    for i in 0..need.len() {
        assert!(rings.condition(i) <= LARGEST_CONDITION, "{name}, {i}: {}", rings.condition(i));
        let neighbours = plane.topology().neighbours(i);
        let lengths: f64 = neighbours.iter().map(|&j| plane.positions[j as usize].distance(plane.positions[i])).sum();
        let step = rings.points[i] - plane.positions[i];
        if step != DVec3::ZERO {
            displaced += 1;
            assert!(step.distance(DVec3::Z * DISPLACEMENT * lengths / neighbours.len() as f64) < 1e-14);
        }
        // A corner of one triangle gets a point over the middle of the opposite edge; nobody else needs one.
        assert_eq!(rings.added[i].len(), usize::from(neighbours.len() == 2), "{i}");
        if let [point] = rings.added[i][..] {
            let middle = (plane.positions[neighbours[0] as usize] + plane.positions[neighbours[1] as usize]) / 2.0;
            assert!((point - middle).truncate().length() < 1e-14 && point.z > 0.0);
        }
    }
    // One after the other, so that a good part of them is cured by a neighbour.
    assert!(displaced > need.len() / 8 && displaced < need.len() / 2, "{displaced} of {}", need.len());
}

/// A boundary vertex whose neighbours are on one line has the inner one of them displaced, not itself.
#[test]
fn straight_neighbours_have_an_inner_one_displaced() {
    let (_, corner) = meshes().into_iter().find(|(name, _)| *name == "straight corner").expect("it is there");
    assert_eq!(corner.topology().neighbours(0), [1, 2, 3]);
    let need = vec![Need::Always; corner.vertex_count()];
    let mut rings = Rings::new(&corner, &need);
    assert!(rings.is_ring_straight(0) && !rings.is_ring_straight(2));
    rings.cure(0);
    assert_eq!(rings.points[0], corner.positions[0]);
    assert!(rings.points[2].z > 0.1 && rings.condition(0) <= LARGEST_CONDITION);
}

#[test]
fn what_is_not_asked_for_is_not_displaced() {
    let plane = shapes::plane_grid(6, 6, 1.0, 1.0).expect("valid");
    let n = plane.vertex_count();
    let sound = Stencils::new(&plane, &vec![Need::IfSound; n]);
    assert_eq!((sound.len(), sound.degenerate), (0, 0));
    let in_place = Stencils::new(&plane, &vec![Need::InPlace; n]);
    assert_eq!((in_place.len(), in_place.degenerate), (n, n));
    assert_eq!(in_place.points[..n], plane.positions);
    let bumps = shapes::icosphere(1);
    let sound = Stencils::new(&bumps, &vec![Need::IfSound; bumps.vertex_count()]);
    assert_eq!((sound.len(), sound.degenerate), (bumps.vertex_count(), 0));
}

/// `A v = l v` for round, flat and thin matrices, with orthonormal vectors.
#[test]
fn eigenvectors_are_those() {
    for t in (0..100).map(f64::from) {
        let turn = DMat3::from_axis_angle(DVec3::new(t.sin(), (2.0 * t).cos(), 0.3).normalize(), t);
        for values in [[3.0, 2.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1e-6, 1e-12], [2.0, 2.0, 2.0], [0.0, 0.0, 0.0]] {
            let matrix = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
            let (found, axes) = eigen(matrix);
            assert!(found.iter().zip(values).all(|(f, v)| (f - v).abs() < 1e-14), "{found:?}");
            assert!(size(axes.transpose() * axes - DMat3::IDENTITY) < 1e-14);
            assert!((0..3).all(|k| (matrix * axes.col(k) - found[k] * axes.col(k)).length() < 1e-14));
        }
    }
}
