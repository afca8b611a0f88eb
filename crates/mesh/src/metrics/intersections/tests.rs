use super::*;
use crate::metrics::test_meshes::grid;
use crate::{TriMesh, shapes};

/// A point with whole coordinates, of which all that is computed here is exact: up to 30 bits.
type Point = [i128; 3];

fn minus(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn cross(a: Point, b: Point) -> Point {
    [0, 1, 2].map(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
}

fn dot(a: Point, b: Point) -> i128 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

/// Twice the area vector of a triangle with two sides from `a`.
fn normal([a, b, c]: [Point; 3]) -> Point {
    cross(minus(b, a), minus(c, a))
}

/// Whether two triangles, one of which may be a line, have a point in common, by another theorem: convex sets are apart if and only if a plane
/// parts them. For triangles one is enough that is parallel to one of them, or to an edge of each, or stands upright on an edge of either.
fn overlap(s: [Point; 3], t: [Point; 3]) -> bool {
    let edges = |t: [Point; 3]| [0, 1, 2].map(|k| minus(t[(k + 1) % 3], t[k]));
    let normals = [normal(s), normal(t)];
    let mut axes = normals.to_vec();
    for e in edges(s) {
        axes.extend(edges(t).map(|f| cross(e, f)));
    }
    for e in edges(s).into_iter().chain(edges(t)) {
        axes.extend(normals.map(|n| cross(n, e)));
    }
    let range = |axis, of: [Point; 3]| {
        let along = of.map(|p| dot(axis, p));
        (along[0].min(along[1]).min(along[2]), along[0].max(along[1]).max(along[2]))
    };
    axes.into_iter().all(|axis| {
        let ((least, most), (low, high)) = (range(axis, s), range(axis, t));
        least <= high && low <= most
    })
}

/// Whether two faces intersect by the rule for as many vertices as they share, and how many that is.
fn rule(points: &[Point], f: [u32; 3], g: [u32; 3]) -> (usize, bool) {
    let at = |v: u32| points[v as usize];
    let not_in = |own: [u32; 3], other: [u32; 3]| own.into_iter().filter(|v| !other.contains(v)).collect::<Vec<u32>>();
    let (s, t) = (f.map(at), g.map(at));
    match (not_in(f, g)[..].to_vec().as_slice(), not_in(g, f).as_slice()) {
        ([], _) => (3, true),
        (&[a], &[b]) => {
            let edge: Vec<Point> = f.into_iter().filter(|v| *v != a).map(at).collect();
            let up = [a, b].map(|v| normal([edge[0], edge[1], at(v)]));
            (2, cross(up[0], up[1]) == [0; 3] && dot(up[0], up[1]) > 0)
        }
        (&[q, r], &[b, c]) => (1, overlap([q, r, r].map(at), t) || overlap(s, [b, c, c].map(at))),
        _ => (0, overlap(s, t)),
    }
}

/// The pairs that intersect, of all that there are, by [`rule`]; and how many of each kind.
fn by_brute_force(points: &[Point], faces: &[[u32; 3]]) -> (Vec<[u32; 2]>, [u64; 3]) {
    let (mut pairs, mut kinds) = (Vec::new(), [0; 3]);
    let with_area: Vec<usize> =
        (0..faces.len()).filter(|f| normal(faces[*f].map(|v| points[v as usize])) != [0; 3]).collect();
    for (i, &f) in with_area.iter().enumerate() {
        for &g in &with_area[i + 1..] {
            if let (shared, true) = rule(points, faces[f], faces[g]) {
                pairs.push([f as u32, g as u32]);
                kinds[shared.min(2)] += 1;
            }
        }
    }
    (pairs, kinds)
}

fn mesh_of(points: &[Point], faces: &[[u32; 3]]) -> TriMesh {
    let positions = points.iter().map(|p| DVec3::from_array(p.map(|x| x as f64))).collect();
    TriMesh::new(positions, faces.to_vec()).expect("valid indices")
}

fn count_with(mesh: &TriMesh, listed: usize) -> SelfIntersections {
    let options = IntersectionOptions { listed, ..IntersectionOptions::default() };
    self_intersections(mesh.topology(), &mesh.positions, &options)
}

fn kinds(found: &SelfIntersections) -> [u64; 3] {
    assert!(found.complete, "{found:?}");
    [found.apart, found.at_vertices, found.at_edges]
}

/// Counts of each kind, of a mesh all of whose faces have an area.
fn count(mesh: &TriMesh) -> [u64; 3] {
    let found = count_with(mesh, 0);
    assert_eq!((found.without_area, found.not_finite), (0, 0));
    kinds(&found)
}

fn moved(mesh: &TriMesh, to: impl Fn(DVec3) -> DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| to(*p)).collect()).expect("finite")
}

/// Both meshes as one.
fn joined(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let first = a.vertex_count() as u32;
    let positions = a.positions.iter().chain(&b.positions).copied().collect();
    let faces = a.triangles().iter().copied().chain(b.triangles().iter().map(|face| face.map(|v| v + first)));
    TriMesh::new(positions, faces.collect()).expect("valid indices")
}

/// Whole numbers below `range`, the same on every run.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, range: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % range
    }
}

/// Soups on few grid points, where nearly everything touches or is coplanar; on many; and on points near a slanted plane, where determinants
/// of 90 bits decide that cancel to a few.
#[test]
fn soups_intersect_as_exact_comparison_of_all_pairs_says() {
    let mut numbers = Numbers(1);
    let mut totals = [[0; 3]; 4];
    for round in 0..240 {
        let family = round % 4;
        let mut point = |_| -> Point {
            match family {
                0 => [0; 3].map(|_| i128::from(numbers.below(3))),
                1 => [0; 3].map(|_| i128::from(numbers.below(6))),
                2 => [0; 3].map(|_| i128::from(numbers.below(1 << 30))),
                _ => {
                    let [u, v, off] = [1 << 14, 1 << 14, 2].map(|range| i128::from(numbers.below(range)));
                    [12_345 * u, 23_456 * v, 9_876 * u + 19_753 * v + off]
                }
            }
        };
        let points: Vec<Point> = (0..16).map(&mut point).collect();
        let mut faces = Vec::new();
        while faces.len() < 30 {
            let face = [0; 3].map(|_| numbers.below(16) as u32);
            if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
                faces.push(face);
            }
        }
        let (pairs, expected) = by_brute_force(&points, &faces);
        let mesh = mesh_of(&points, &faces);
        let found = count_with(&mesh, usize::MAX);
        assert_eq!((kinds(&found), &found.listed), (expected, &pairs), "round {round}: {points:?} {faces:?}");
        let flat = faces.iter().filter(|face| normal(face.map(|v| points[v as usize])) == [0; 3]).count();
        assert_eq!((found.without_area, found.not_finite), (flat, 0));
        // Powers of two round nothing, however near to the ends of the range of numbers.
        for scale in [2.0_f64.powi(-1040), 2.0_f64.powi(-40), 2.0_f64.powi(990)] {
            assert_eq!(count_with(&moved(&mesh, |p| p * scale), usize::MAX), found, "round {round} at {scale}");
        }
        for (total, kind) in totals[family].iter_mut().zip(expected) {
            *total += kind;
        }
    }
    // Every kind occurs in every family, but folds of points in no special place.
    for (family, [apart, at_vertices, at_edges]) in totals.into_iter().enumerate() {
        assert!(apart > 400 && at_vertices > 400 && (at_edges > 10 || family >= 2), "{family}: {totals:?}");
    }
}

/// Two triangles without a vertex in common: apart, touching in a point, along a line, crossing, in one plane.
#[test]
fn to_touch_is_to_intersect() {
    let s = [[0, 0, 0], [4, 0, 0], [0, 4, 0]];
    for (name, t, expected) in [
        ("above", [[0, 0, 1], [4, 0, 1], [0, 4, 1]], 0),
        ("corner on the inside", [[1, 1, 0], [1, 1, 2], [2, 1, 2]], 1),
        ("corner on an edge", [[2, 2, 0], [2, 2, 3], [3, 3, 3]], 1),
        ("corner on a corner", [[4, 0, 0], [5, 0, 1], [5, 1, 1]], 1),
        ("corner beside", [[3, 3, 0], [3, 3, 2], [4, 3, 2]], 0),
        ("edge on the inside", [[1, 1, 0], [2, 1, 0], [1, 1, 2]], 1),
        ("edge along an edge", [[1, 0, 0], [2, 0, 0], [1, -2, 2]], 1),
        ("edge across an edge", [[2, 2, -1], [2, 2, 1], [4, 4, 0]], 1),
        ("edge past an edge", [[3, 2, -1], [3, 2, 1], [5, 4, 0]], 0),
        ("through the inside", [[1, 1, -1], [1, 1, 1], [2, 1, 1]], 1),
        ("through the plane beside", [[5, 5, -1], [5, 5, 1], [6, 5, 1]], 0),
        ("same plane, overlapping", [[1, 1, 0], [5, 1, 0], [1, 5, 0]], 1),
        ("same plane, inside", [[1, 1, 0], [2, 1, 0], [1, 2, 0]], 1),
        ("same plane, crossing like a star", [[3, 3, 0], [-1, 3, 0], [3, -1, 0]], 1),
        ("same plane, corner to corner", [[4, 0, 0], [6, 0, 0], [6, 2, 0]], 1),
        ("same plane, edge to edge", [[1, 3, 0], [3, 1, 0], [4, 4, 0]], 1),
        ("same plane, boxes overlapping", [[3, 2, 0], [4, 4, 0], [2, 3, 0]], 0),
        ("same place", [[0, 0, 0], [4, 0, 0], [0, 4, 0]], 1),
    ] {
        let points = [s, t].concat();
        assert_eq!(count(&mesh_of(&points, &[[0, 1, 2], [3, 4, 5]])), [expected, 0, 0], "{name}");
        assert_eq!(count(&mesh_of(&points, &[[4, 3, 5], [1, 0, 2]])), [expected, 0, 0], "{name}, other way round");
    }
}

/// Two sheets that cross at right angles along a line. It runs through two faces of each row of squares, changing face where it meets an edge:
/// n - 1 sides of squares and n diagonals of the narrower sheet, and n of each of the wider one within the narrower. No two places
/// coincide, so each adds a pair to the first.
#[test]
fn crossing_sheets_intersect_once_for_each_edge_on_their_line() {
    for n in [1, 2, 7, 40] {
        let sheet = moved(&grid(3, n), |p| p - DVec3::new(1.3, 0.0, 0.0));
        let other = moved(&grid(3, n + 1), |p| DVec3::new(0.0, p.y - 0.45, p.x - 1.6));
        // Diagonals are crossed at 0.3 of a row by x = 0 and at 0.6 - 0.45 by z = 0.
        let crossing = joined(&sheet, &other);
        assert_eq!(count(&crossing), [4 * u64::from(n), 0, 0]);
        // A face that flew off does not make the others vanish next to it.
        let far = TriMesh::new(vec![DVec3::X * 1e150, DVec3::Y * 2e150, DVec3::Z * 3e150], vec![[0, 1, 2]]);
        assert_eq!(count(&joined(&crossing, &far.expect("valid"))), [4 * u64::from(n), 0, 0]);
        let beside = moved(&other, |p| p + DVec3::new(0.0, 0.0, 1.7));
        assert_eq!(count(&joined(&sheet, &beside)), [0; 3]);
    }
}

/// A sheet folded along a line of edges: flat against itself, all pairs of faces that lie over each other intersect; by any less, none.
#[test]
fn sheets_intersect_where_they_are_folded_flat() {
    let mesh = grid(4, 1);
    let folded = |turn: f64| {
        moved(&mesh, |p| {
            let beyond = (p.x - 2.0).max(0.0);
            DVec3::new(p.x.min(2.0) + beyond * turn.cos(), p.y, beyond * turn.sin())
        })
    };
    assert_eq!(count(&folded(3.1)), [0; 3]);
    assert_eq!(count(&folded(0.0)), [0; 3]);
    let flat = count(&moved(&mesh, |p| p.with_x(p.x.min(4.0 - p.x))));
    // Whole coordinates: compared with all pairs.
    let points: Vec<Point> = mesh.positions.iter().map(|p| [p.x.min(4.0 - p.x) as i128, p.y as i128, 0]).collect();
    assert_eq!(flat, by_brute_force(&points, mesh.triangles()).1);
    // Of the two faces at the fold, which share the edge there, one pair is folded; diagonals mirror each other.
    assert_eq!(flat[2], 1);
}

#[test]
fn generated_shapes_do_not_intersect_themselves() {
    let mut meshes: Vec<(String, TriMesh)> = shapes::NAMES
        .iter()
        .flat_map(|name| [2000, 6000].map(|n| (format!("{name}:{n}"), shapes::by_name(name, n).expect("in range"))))
        .collect();
    meshes.push(("sphere".to_owned(), shapes::icosphere(4)));
    for (name, mesh) in meshes {
        assert_eq!(count(&mesh), [0; 3], "{name}");
        assert_eq!(count(&moved(&mesh, |p| p * 1e-12)), [0; 3], "{name}, small");
    }
}

/// The tube of a torus laid along a figure of eight, so that it passes through itself in the middle: positions are rounded to whole numbers, of
/// which all pairs can be compared exactly.
#[test]
fn a_torus_pushed_through_itself_is_found_face_by_face() {
    let torus = shapes::torus(1.0, 0.3, 24, 9).expect("valid radii");
    let pushed = |push: f64| -> Vec<Point> {
        let eight = |p: &DVec3| {
            // The tube's section moves along with the point of its middle line.
            let out = DVec3::new(p.x, 0.0, p.z).normalize();
            let at = DVec3::new(out.x, 0.0, out.z * ((1.0 - push) + push * out.x));
            let q = (at + 0.6 * (*p - out)) * f64::from(1 << 20);
            q.to_array().map(|x| x.round() as i128)
        };
        torus.positions.iter().map(eight).collect()
    };
    assert_eq!(by_brute_force(&pushed(0.0), torus.triangles()).1, [0; 3]);
    for (push, least) in [(0.0, 0), (0.8, 0), (1.0, 40)] {
        let points = pushed(push);
        let (pairs, expected) = by_brute_force(&points, torus.triangles());
        let found = count_with(&mesh_of(&points, torus.triangles()), usize::MAX);
        assert_eq!((kinds(&found), &found.listed), (expected, &pairs), "{push}");
        assert!(found.apart >= least, "{push}: {found:?}");
    }
}

#[test]
fn faces_without_area_or_end_are_left_out_and_counted() {
    let sphere = shapes::icosphere(2);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut pose = sphere.positions.clone();
        pose[0].y = bad;
        let faces = sphere.topology().vertex_faces(0).len();
        let options = IntersectionOptions::default();
        let found = self_intersections(sphere.topology(), &pose, &options);
        assert_eq!((kinds(&found), found.without_area, found.not_finite), ([0; 3], 0, faces));
        pose.fill(DVec3::splat(bad));
        let found = self_intersections(sphere.topology(), &pose, &options);
        assert_eq!((kinds(&found), found.not_finite), ([0; 3], sphere.face_count()));
    }
    let flat = count_with(&moved(&sphere, |p| DVec3::X * p.x), 0);
    assert_eq!((kinds(&flat), flat.without_area), ([0; 3], sphere.face_count()));
    let none = TriMesh::new(Vec::new(), Vec::new()).expect("empty");
    assert_eq!(count(&none), [0; 3]);
    let one = mesh_of(&[[0, 0, 0], [1, 0, 0], [0, 1, 0]], &[[0, 1, 2]]);
    assert_eq!(count(&one), [0; 3]);
    // A needle through a sheet, drawn from one of its faces whose other end is beside it: the needle has no area, the face beside it does.
    let points = [[0, 0, 0], [9, 0, 0], [0, 9, 0], [2, 2, -4], [2, 2, 4], [2, 2, 0], [2, 3, 4]];
    let found = count_with(&mesh_of(&points, &[[0, 1, 2], [3, 4, 5], [3, 4, 6]]), 5);
    assert_eq!((kinds(&found), found.without_area, found.listed), ([1, 0, 0], 1, vec![[0, 2]]));
}

/// A ball of needles from one place, drawn at random: tens of thousands of pairs.
fn crumpled(n: u32) -> TriMesh {
    let mut numbers = Numbers(7);
    let mut coordinate = || numbers.below(1 << 20) as f64;
    let mut point = || DVec3::new(coordinate(), coordinate(), coordinate());
    let positions: Vec<DVec3> = (0..n).map(|_| point()).collect();
    TriMesh::new(positions, (0..n - 2).map(|v| [v, v + 1, v + 2]).collect()).expect("valid indices")
}

#[test]
fn results_and_limits_are_the_same_for_any_number_of_threads() {
    let mesh = crumpled(800);
    let all = count_with(&mesh, 0);
    assert!(all.complete && all.pairs() > 15_000, "{all:?}");
    for limit in [u64::MAX, 1 << 22, 1 << 20, 1000, 0] {
        let options = IntersectionOptions { listed: 1000, limit: Some(limit) };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| self_intersections(mesh.topology(), &mesh.positions, &options))
        };
        let found = run(1);
        for threads in [2, 3, 8] {
            assert_eq!(run(threads), found, "{threads} threads, {limit}");
        }
        assert_eq!(found.complete, limit == u64::MAX, "{limit}");
        assert_eq!(found.pairs() == all.pairs(), found.complete);
        assert_eq!(found.listed.len() as u64, found.pairs().min(1000));
        assert!(found.listed.is_sorted() && found.listed.iter().all(|[f, g]| f < g));
        // A face's own turn is the least that is done: one more than the limit allows.
        let most = limit.saturating_add(17 * mesh.face_count() as u64 * 2);
        assert!(found.pairs().saturating_mul(FACES) <= most, "{limit}: {found:?}");
    }
}
