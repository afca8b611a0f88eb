//! Cages keep what the shape is: topology, orientation, vertices, boundaries.

use std::collections::HashSet;

use glam::DVec3;
use pliant_cage::{CageError, CageSize, Simplified, SimplifyOptions, simplify};
use pliant_mesh::metrics::surface_distance;
use pliant_mesh::{Silent, TriMesh, face_area_vector, shapes, vertex_normals};

fn cage(shape: &TriMesh, size: CageSize) -> Simplified {
    simplify(shape, &size.into(), &Silent).expect("valid size")
}

/// Several meshes as one.
fn together(parts: &[TriMesh]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let start = positions.len() as u32;
        positions.extend_from_slice(&part.positions);
        triangles.extend(part.triangles().iter().map(|t| t.map(|v| v + start)));
    }
    TriMesh::new(positions, triangles).expect("parts are valid")
}

fn moved(mesh: &TriMesh, offset: DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| *p + offset).collect()).expect("finite")
}

fn families() -> Vec<(&'static str, TriMesh)> {
    let grid = shapes::plane_grid(30, 20, 3.0, 2.0).expect("valid");
    vec![
        ("sphere", shapes::icosphere(4)),
        ("torus", shapes::torus(1.0, 0.35, 60, 24).expect("valid")),
        ("bar", shapes::bar(40, 8, 8, DVec3::new(5.0, 1.0, 1.0)).expect("valid")),
        ("cylinder", shapes::cylinder(0.5, 3.0, 32, 40, 5).expect("valid")),
        ("flat sheet", grid.clone()),
        (
            "two spheres and a sheet",
            together(&[
                shapes::icosphere(3),
                moved(&shapes::icosphere(3), DVec3::new(4.0, 0.0, 0.0)),
                moved(&grid, DVec3::new(0.0, 0.0, 3.0)),
            ]),
        ),
        (
            "tiny sphere far away",
            moved(
                &shapes::icosphere(3)
                    .with_positions(shapes::icosphere(3).positions.iter().map(|p| *p * 1e-3).collect())
                    .expect("finite"),
                DVec3::splat(100.0),
            ),
        ),
    ]
}

/// Every claim of the documentation, at several sizes, over all families.
#[test]
fn cages_keep_topology_vertices_and_orientation() {
    for (name, shape) in families() {
        let before = shape.topology();
        let normals = vertex_normals(before, &shape.positions);
        for share in [0.5, 0.1, 0.05] {
            let Simplified { mesh, origin, report, .. } = cage(&shape, CageSize::Fraction(share));
            let after = mesh.topology();
            assert_eq!(report.reached, mesh.vertex_count(), "{name}");
            assert_eq!(report.asked, Some((share * shape.vertex_count() as f64).round() as usize), "{name}");
            assert_eq!(report.reached, report.asked.expect("asked for a number"), "{name}: {report:?}");
            assert_eq!(after.euler_characteristic(), before.euler_characteristic(), "{name}");
            assert_eq!(after.components().1, before.components().1, "{name}");
            assert_eq!(after.boundary_loops().len(), before.boundary_loops().len(), "{name}");
            after.require_manifold().expect(name);
            after.require_oriented().expect(name);
            assert!(
                (0..mesh.vertex_count()).all(|j| mesh.positions[j] == shape.positions[origin[j] as usize]),
                "{name}"
            );
            assert!(origin.windows(2).all(|w| w[0] < w[1]), "{name}");
            for t in mesh.triangles() {
                let area = face_area_vector(t.map(|v| mesh.positions[v as usize]));
                let outward: DVec3 = t.iter().map(|&v| normals[origin[v as usize] as usize]).sum();
                assert!(area.length() > 0.0 && area.dot(outward) >= 0.0, "{name}: a face is degenerate or flipped");
            }
            assert_eq!(report.flipped_faces, 0, "{name}");
        }
    }
}

#[test]
fn a_closed_component_asked_for_nothing_ends_as_a_tetrahedron() {
    let closed = [
        shapes::icosphere(3),
        shapes::bar(9, 4, 3, DVec3::new(3.0, 1.0, 0.7)).expect("valid"),
        shapes::cylinder(0.4, 3.0, 20, 20, 3).expect("valid"),
        shapes::creature(2000).expect("valid"),
    ];
    for (i, shape) in closed.iter().enumerate() {
        let smallest = cage(shape, CageSize::Vertices(0));
        assert_eq!(
            (smallest.mesh.vertex_count(), smallest.mesh.face_count()),
            (4, 4),
            "shape {i}: {:?}",
            smallest.report
        );
        smallest.mesh.topology().require_closed().expect("a tetrahedron is closed");
    }
    let parts: Vec<TriMesh> = (0..3).map(|i| moved(&closed[i], DVec3::new(10.0 * i as f64, 0.0, 0.0))).collect();
    let three = cage(&together(&parts), CageSize::Vertices(0));
    assert_eq!((three.mesh.vertex_count(), three.mesh.topology().components().1), (12, 3));
    // A torus cannot lose its hole: seven vertices are the fewest that have one (Csaszar).
    let torus = cage(&shapes::torus(1.0, 0.4, 24, 12).expect("valid"), CageSize::Vertices(0));
    assert_eq!(torus.mesh.topology().euler_characteristic(), 0);
    assert!((7..20).contains(&torus.mesh.vertex_count()), "{:?}", torus.report);
    assert!(!torus.report.warnings().is_empty(), "4 or fewer were asked for");
}

/// Flat parts cost nothing: a box keeps its shape exactly down to few vertices, a sheet its outline.
#[test]
fn flat_parts_go_first() {
    let bar = shapes::bar(20, 6, 6, DVec3::new(4.0, 1.0, 1.0)).expect("valid");
    let small = cage(&bar, CageSize::Vertices(24));
    let distance = surface_distance(&bar.positions, &small.mesh);
    assert!(distance.max < 1e-9, "{distance:?}");
    assert!((small.mesh.signed_volume() - 4.0).abs() < 1e-9);
    let sheet = shapes::plane_grid(12, 12, 1.0, 1.0).expect("valid");
    let corners = cage(&sheet, CageSize::Vertices(4));
    let area: f64 = (0..corners.mesh.face_count()).map(|f| face_area_vector(corners.mesh.corners(f)).length()).sum();
    assert!((area - 1.0).abs() < 1e-9, "the outline was lost: area {area}");
}

#[test]
fn a_distance_can_be_asked_for() {
    let shape = shapes::icosphere(5);
    let mut fewer = usize::MAX;
    for error in [1e-4, 1e-3, 1e-2] {
        let made = cage(&shape, CageSize::Error(error));
        assert!(made.report.estimated_error <= error && made.report.asked.is_none());
        // An estimate of the root mean square over planes; the true largest distance stays within a small multiple.
        let distance = surface_distance(&shape.positions, &made.mesh).max / shape.bounds().diagonal();
        assert!(distance < 10.0 * error, "asked {error}, {distance} away");
        assert!(made.mesh.vertex_count() < fewer);
        fewer = made.mesh.vertex_count();
    }
}

#[test]
fn cage_of_all_vertices_is_the_shape() {
    let shape = shapes::torus(1.0, 0.3, 12, 8).expect("valid");
    for size in [CageSize::Fraction(1.0), CageSize::Vertices(shape.vertex_count()), CageSize::Vertices(1_000_000)] {
        let made = cage(&shape, size);
        assert_eq!(made.mesh.positions, shape.positions);
        assert_eq!(made.mesh.triangles(), shape.triangles());
    }
}

/// A hub where three sheets meet along one edge: its ends stay, the rest is simplified round them.
#[test]
fn non_manifold_places_are_kept_and_counted() {
    let sheet = shapes::plane_grid(8, 8, 1.0, 1.0).expect("valid");
    let turned: Vec<TriMesh> = [0.0, 2.1, 4.2]
        .map(|angle: f64| {
            let positions =
                sheet.positions.iter().map(|p| DVec3::new((p.x + 0.5) * angle.cos(), p.y, (p.x + 0.5) * angle.sin()));
            sheet.with_positions(positions.collect()).expect("finite")
        })
        .into();
    let soup = together(&turned);
    // The side at p.x = -0.5 is the same in all three: weld it.
    let weld = pliant_mesh::clean_soup(
        &soup
            .positions
            .iter()
            .map(|p| if p.x.hypot(p.z) < 1e-12 { DVec3::new(0.0, p.y, 0.0) } else { *p })
            .collect::<Vec<_>>(),
        soup.triangles(),
    )
    .expect("valid");
    assert!(weld.mesh.topology().require_manifold().is_err());
    let edges = weld.mesh.topology().non_manifold_edge_count();
    let made = cage(&weld.mesh, CageSize::Fraction(0.2));
    assert_eq!(made.report.locked, 9);
    assert_eq!(made.mesh.topology().non_manifold_edge_count(), edges);
    assert_eq!(made.mesh.topology().euler_characteristic(), weld.mesh.topology().euler_characteristic());
}

/// Faces that turn either way are no reason to miss a neighbour or to break the surface.
#[test]
fn badly_oriented_shapes_keep_their_topology() {
    for shape in [shapes::icosphere(4), shapes::plane_grid(25, 20, 2.0, 1.0).expect("valid")] {
        let turn = |(i, t): (usize, &[u32; 3])| if i % 7 == 0 { [t[1], t[0], t[2]] } else { *t };
        let turned = shape.triangles().iter().enumerate().map(turn).collect();
        let turned = TriMesh::new(shape.positions.clone(), turned).expect("valid");
        assert!(turned.topology().require_oriented().is_err());
        for share in [0.5, 0.1, 0.02] {
            let made = cage(&turned, CageSize::Fraction(share));
            let (before, after) = (turned.topology(), made.mesh.topology());
            assert_eq!(Some(made.mesh.vertex_count()), made.report.asked);
            assert_eq!(after.euler_characteristic(), before.euler_characteristic());
            assert_eq!(after.boundary_edge_count() == 0, before.boundary_edge_count() == 0);
            after.require_manifold().expect("it was manifold");
        }
    }
}

/// Owners divide the shape into patches: connected along its edges, each with its cage vertex, none across components.
#[test]
fn what_a_cage_vertex_owns_is_connected() {
    for (name, shape) in families() {
        let topology = shape.topology();
        let (component, _) = topology.components();
        for size in [CageSize::Fraction(0.3), CageSize::Fraction(0.02), CageSize::Vertices(0), CageSize::Error(1e-3)] {
            let Simplified { mesh, origin, owner, .. } = cage(&shape, size);
            assert_eq!(owner.len(), shape.vertex_count(), "{name}");
            assert!(origin.iter().enumerate().all(|(j, &v)| owner[v as usize] as usize == j), "{name}");
            // Flooded from the cage vertices along edges within one patch, every vertex is reached.
            let mut reached = vec![false; owner.len()];
            let mut stack = origin.clone();
            while let Some(v) = stack.pop() {
                if !std::mem::replace(&mut reached[v as usize], true) {
                    let own = owner[v as usize];
                    stack.extend(topology.neighbours(v as usize).iter().filter(|&&w| owner[w as usize] == own));
                }
            }
            assert!(reached.iter().all(|r| *r), "{name}: a patch is in pieces");
            for (v, &own) in owner.iter().enumerate() {
                assert_eq!(component[v], component[origin[own as usize] as usize], "{name}");
            }
            // A face of the cage is one whose corners went to three patches, in its own order.
            let faces = shape.triangles().iter().map(|t| t.map(|v| owner[v as usize]));
            let apart: Vec<[u32; 3]> = faces.filter(|&[a, b, c]| a != b && b != c && c != a).collect();
            assert_eq!(mesh.triangles(), apart, "{name}");
        }
    }
}

/// Nor does it depend on the number of threads.
#[test]
fn the_same_every_time() {
    let shape = shapes::cylinder(0.5, 2.0, 24, 30, 4).expect("valid");
    let first = cage(&shape, CageSize::Fraction(0.1));
    for threads in [1, 2, 5] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads");
        let second = pool.install(|| cage(&shape, CageSize::Fraction(0.1)));
        assert_eq!(first.origin, second.origin);
        assert_eq!(first.owner, second.owner);
        assert_eq!(first.mesh.triangles(), second.mesh.triangles());
        assert_eq!(first.report, second.report);
    }
}

/// The cage of a scaled shape is the scaled cage: powers of two change no rounding.
#[test]
fn scale_does_not_matter() {
    let shape = shapes::icosphere(4);
    let plain = cage(&shape, CageSize::Fraction(0.1));
    for scale in [2.0_f64.powi(-40), 2.0_f64.powi(40)] {
        let scaled = shape.with_positions(shape.positions.iter().map(|p| *p * scale).collect()).expect("finite");
        let scaled = cage(&scaled, CageSize::Fraction(0.1));
        assert_eq!(scaled.origin, plain.origin);
        assert_eq!(scaled.owner, plain.owner);
    }
}

#[test]
fn bad_options_are_named() {
    let shape = shapes::icosphere(1);
    for size in [
        CageSize::Fraction(0.0),
        CageSize::Fraction(-1.0),
        CageSize::Fraction(f64::NAN),
        CageSize::Fraction(1.5),
        CageSize::Error(-1.0),
    ] {
        let error = simplify(&shape, &size.into(), &Silent).expect_err("out of range").to_string();
        assert!(error.contains("cage"), "{error}");
    }
    let options = SimplifyOptions { boundary_weight: f64::NAN, ..SimplifyOptions::default() };
    assert!(simplify(&shape, &options, &Silent).is_err());
    let points = TriMesh::new(vec![DVec3::ZERO; 3], Vec::new()).expect("points are a mesh");
    assert_eq!(simplify(&points, &SimplifyOptions::default(), &Silent).expect_err("no faces"), CageError::NoFaces);
}

#[test]
fn unused_vertices_are_left_out_and_counted() {
    let sphere = shapes::icosphere(2);
    let mut positions = vec![DVec3::splat(9.0)];
    positions.extend_from_slice(&sphere.positions);
    let triangles = sphere.triangles().iter().map(|t| t.map(|v| v + 1)).collect();
    let made = cage(&TriMesh::new(positions, triangles).expect("valid"), CageSize::Vertices(40));
    assert_eq!((made.report.unused, made.mesh.vertex_count()), (1, 40));
    let unowned: Vec<usize> = (0..made.owner.len()).filter(|&v| made.owner[v] == Simplified::NO_OWNER).collect();
    assert_eq!(unowned, [0]);
    let used: HashSet<u32> = made.mesh.triangles().iter().flatten().copied().collect();
    assert_eq!(used.len(), 40);
}

/// Pieces that hang together at one vertex: none loses its last face, and every vertex has an owner.
#[test]
fn pieces_joined_at_a_vertex_stay() {
    for petals in [3, 6, 40] {
        let (mut positions, mut triangles) = (vec![DVec3::ZERO], Vec::new());
        for k in 0..petals {
            let (angle, n) = (0.1 * f64::from(k), positions.len() as u32);
            let out = DVec3::new(angle.cos(), angle.sin(), 0.0);
            positions.extend([out, out + 0.1 * DVec3::Z]);
            triangles.push([0, n, n + 1]);
        }
        let flower = TriMesh::new(positions, triangles).expect("valid");
        for asked in [0, 4, 8, flower.vertex_count() - 1] {
            let made = simplify(&flower, &CageSize::Vertices(asked).into(), &Silent).expect("valid");
            assert_eq!(made.mesh.face_count(), petals as usize);
            assert!(made.owner.iter().all(|owner| (*owner as usize) < made.mesh.vertex_count()));
        }
    }
}
