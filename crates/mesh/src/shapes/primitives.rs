//! Spheres, tori, planes, bars and cylinders: shapes whose area and volume are known in closed form.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::{MeshError, TriMesh};

/// Most subdivisions [`icosphere`] makes: 10,485,762 vertices.
pub const MAX_ICOSPHERE_LEVEL: u32 = 10;

/// Most vertices the other generators make.
const MAX_VERTICES: u64 = 50_000_000;

/// A sphere of radius 1 round the origin: an icosahedron whose faces are split in four `level` times, every new vertex
/// pushed out to the sphere.
///
/// `10 * 4^level + 2` vertices. Levels above [`MAX_ICOSPHERE_LEVEL`] give that level. The vertices of a level are the first
/// ones of the next.
pub fn icosphere(level: u32) -> TriMesh {
    let golden = 0.5 * (1.0 + 5.0_f64.sqrt());
    // Three golden rectangles, one in each coordinate plane.
    let mut positions: Vec<DVec3> = [(0, 1, 2), (1, 2, 0), (2, 0, 1)]
        .into_iter()
        .flat_map(|(zero, one, phi)| {
            [(-1.0, -golden), (1.0, -golden), (-1.0, golden), (1.0, golden)].map(|(a, b)| {
                let mut p = [0.0; 3];
                (p[zero], p[one], p[phi]) = (0.0, a, b);
                DVec3::from_array(p).normalize()
            })
        })
        .collect();
    let mut triangles = icosahedron_faces(&positions);
    for _ in 0..level.min(MAX_ICOSPHERE_LEVEL) {
        let mut middle_of: HashMap<[u32; 2], u32> = HashMap::with_capacity(triangles.len() * 3 / 2);
        let mut middle = |a: u32, b: u32| {
            *middle_of.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let p = (positions[a as usize] + positions[b as usize]).normalize();
                positions.push(p);
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    TriMesh::new(positions, triangles).expect("every index was handed out above")
}

/// The 20 triples of vertices at mutual distance of one edge, each turned outward.
fn icosahedron_faces(p: &[DVec3]) -> Vec<[u32; 3]> {
    // Neighbours have a dot product of 1/sqrt(5), all other pairs a negative one.
    let adjacent = |a: usize, b: usize| p[a].dot(p[b]) > 0.0;
    let mut faces = Vec::with_capacity(20);
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if adjacent(a, b) && adjacent(b, c) && adjacent(c, a) {
                    let outward = p[a].dot(p[b].cross(p[c])) > 0.0;
                    faces.push(if outward { [a, b, c] } else { [a, c, b] }.map(|v| v as u32));
                }
            }
        }
    }
    faces
}

/// A torus round the y axis: the tube has radius `minor`, its middle circle radius `major`.
///
/// `around * tube` vertices, `around` along the middle circle and `tube` around the tube, all quads split the same way.
///
/// # Errors
/// A radius that is not positive, `minor` not below `major`, or fewer than 3 vertices around.
pub fn torus(major: f64, minor: f64, around: u32, tube: u32) -> Result<TriMesh, MeshError> {
    let major = positive("major radius", major)?;
    let minor = positive("minor radius", minor)?;
    if minor >= major {
        return Err(bad("minor radius", format!("below the major radius {major}"), minor));
    }
    at_least("vertices around", around, 3)?;
    at_least("vertices of the tube", tube, 3)?;
    check_count(u64::from(around) * u64::from(tube))?;
    let mut positions = Vec::with_capacity((around * tube) as usize);
    let mut triangles = Vec::with_capacity(2 * (around * tube) as usize);
    for i in 0..around {
        let (sin_u, cos_u) = turn(i, around);
        for j in 0..tube {
            let (sin_v, cos_v) = turn(j, tube);
            let from_axis = major + minor * cos_v;
            positions.push(DVec3::new(from_axis * cos_u, minor * sin_v, from_axis * sin_u));
            let corner = |i: u32, j: u32| (i % around) * tube + j % tube;
            let (a, b, c, d) = (corner(i, j), corner(i, j + 1), corner(i + 1, j + 1), corner(i + 1, j));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(positions, triangles)
}

/// A flat grid in the plane z = 0, centred at the origin, `width` along x and `height` along y, facing +z.
///
/// `(columns + 1) * (rows + 1)` vertices, row by row from the lowest x and y. Diagonals alternate like the squares of a
/// chessboard, so that no direction is preferred.
///
/// # Errors
/// No columns or rows, or an extent that is not positive.
pub fn plane_grid(columns: u32, rows: u32, width: f64, height: f64) -> Result<TriMesh, MeshError> {
    height_field(columns, rows, width, height, |_, _| 0.0)
}

/// [`plane_grid`] with `bumps` by `bumps` smooth bumps of the given `amplitude`: the height over the plane at the fractions
/// `u`, `v` of its width and height is `amplitude * sin^2(pi bumps u) * sin^2(pi bumps v)`.
///
/// The border stays in the plane and is tangent to it; the bumps enclose the volume `amplitude * width * height / 4`.
///
/// # Errors
/// As [`plane_grid`]; no bumps, or an amplitude that is not finite. A negative one makes dents.
pub fn bumpy_plane(
    columns: u32,
    rows: u32,
    width: f64,
    height: f64,
    amplitude: f64,
    bumps: u32,
) -> Result<TriMesh, MeshError> {
    at_least("bumps", bumps, 1)?;
    if !amplitude.is_finite() {
        return Err(bad("amplitude", "a finite number".to_owned(), amplitude));
    }
    let wave = |t: f64| (PI * f64::from(bumps) * t).sin().powi(2);
    height_field(columns, rows, width, height, |u, v| amplitude * wave(u) * wave(v))
}

/// A grid over the plane z = 0 with heights given at fractions of its width and height.
fn height_field(
    columns: u32,
    rows: u32,
    width: f64,
    height: f64,
    z: impl Fn(f64, f64) -> f64,
) -> Result<TriMesh, MeshError> {
    at_least("columns", columns, 1)?;
    at_least("rows", rows, 1)?;
    let width = positive("width", width)?;
    let height = positive("height", height)?;
    check_count((u64::from(columns) + 1).saturating_mul(u64::from(rows) + 1))?;
    let mut positions = Vec::with_capacity(((columns + 1) * (rows + 1)) as usize);
    for j in 0..=rows {
        let v = f64::from(j) / f64::from(rows);
        for i in 0..=columns {
            let u = f64::from(i) / f64::from(columns);
            positions.push(DVec3::new(width * (u - 0.5), height * (v - 0.5), z(u, v)));
        }
    }
    let corner = |i: u32, j: u32| j * (columns + 1) + i;
    let mut triangles = Vec::with_capacity(2 * (columns * rows) as usize);
    for j in 0..rows {
        for i in 0..columns {
            let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
            triangles.extend(if (i + j) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
        }
    }
    TriMesh::new(positions, triangles)
}

/// The closed surface of a box of the given `size`, centred at the origin, its sides `nx`, `ny` and `nz` squares long.
///
/// `(nx+1)(ny+1)(nz+1) - (nx-1)(ny-1)(nz-1)` vertices: the lattice points on the surface. All quads of a side are split the
/// same way.
///
/// # Errors
/// A side without squares or without length.
pub fn bar(nx: u32, ny: u32, nz: u32, size: DVec3) -> Result<TriMesh, MeshError> {
    let n = [nx, ny, nz];
    for (what, count) in ["squares along x", "squares along y", "squares along z"].into_iter().zip(n) {
        at_least(what, count, 1)?;
    }
    for (what, extent) in ["size along x", "size along y", "size along z"].into_iter().zip(size.to_array()) {
        positive(what, extent)?;
    }
    let pairs = [(nx, ny), (ny, nz), (nz, nx)];
    check_count(pairs.into_iter().map(|(a, b)| u64::from(a) * u64::from(b)).fold(1, u64::saturating_add))?;
    let mut number_of: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions = Vec::new();
    let mut vertex = |at: [u32; 3]| {
        *number_of.entry(at).or_insert_with(|| {
            let fraction = |k: usize| f64::from(at[k]) / f64::from(n[k]) - 0.5;
            positions.push(size * DVec3::new(fraction(0), fraction(1), fraction(2)));
            positions.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        // (axis, right, up) is a right-handed triple, so right then up turns counter-clockwise seen from +axis.
        let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
        for side in [0, n[axis]] {
            for j in 0..n[up] {
                for i in 0..n[right] {
                    let mut corner = |i: u32, j: u32| {
                        let mut at = [0; 3];
                        (at[axis], at[right], at[up]) = (side, i, j);
                        vertex(at)
                    };
                    let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
                    triangles.extend(if side > 0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
                }
            }
        }
    }
    TriMesh::new(positions, triangles)
}

/// A closed cylinder round the y axis, centred at the origin, with a cap at either end.
///
/// The wall has `around` vertices in each of its `along + 1` rings; a cap has `rings` rings of edges between its rim and its
/// middle vertex. `around * (along + 2 * rings - 1) + 2` vertices in all.
///
/// # Errors
/// A length that is not positive, fewer than 3 vertices around, or no ring along the wall or in the caps.
pub fn cylinder(radius: f64, height: f64, around: u32, along: u32, rings: u32) -> Result<TriMesh, MeshError> {
    let radius = positive("radius", radius)?;
    let height = positive("height", height)?;
    at_least("vertices around", around, 3)?;
    at_least("rings along", along, 1)?;
    at_least("rings of a cap", rings, 1)?;
    check_count(u64::from(around).saturating_mul(u64::from(along) + 2 * u64::from(rings)))?;
    // Circles from the middle of the lower cap over the wall to the middle of the upper one: (radius, y).
    let share = |k: u32| radius * f64::from(k) / f64::from(rings);
    let lower = (1..rings).map(|k| (share(k), -0.5 * height));
    let wall = (0..=along).map(|k| (radius, height * (f64::from(k) / f64::from(along) - 0.5)));
    let upper = (1..rings).rev().map(|k| (share(k), 0.5 * height));
    let circles: Vec<(f64, f64)> = lower.chain(wall).chain(upper).collect();
    let mut positions = vec![DVec3::new(0.0, -0.5 * height, 0.0)];
    for &(r, y) in &circles {
        positions.extend((0..around).map(|i| {
            let (sin, cos) = turn(i, around);
            DVec3::new(r * cos, y, r * sin)
        }));
    }
    let top = positions.len() as u32;
    positions.push(DVec3::new(0.0, 0.5 * height, 0.0));
    let corner = |circle: u32, i: u32| 1 + circle * around + i % around;
    let last = circles.len() as u32 - 1;
    let mut triangles = Vec::new();
    for i in 0..around {
        triangles.push([0, corner(0, i), corner(0, i + 1)]);
        for k in 0..last {
            let (a, b, c, d) = (corner(k, i), corner(k + 1, i), corner(k + 1, i + 1), corner(k, i + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.push([top, corner(last, i + 1), corner(last, i)]);
    }
    TriMesh::new(positions, triangles)
}

/// Sine and cosine of the `i`-th of `n` equal parts of a full turn.
fn turn(i: u32, n: u32) -> (f64, f64) {
    (TAU * f64::from(i) / f64::from(n)).sin_cos()
}

fn bad(what: &'static str, expected: String, found: impl std::fmt::Display) -> MeshError {
    MeshError::BadParameter { what, expected, found: found.to_string() }
}

fn positive(what: &'static str, value: f64) -> Result<f64, MeshError> {
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err(bad(what, "a positive number".to_owned(), value)) }
}

fn at_least(what: &'static str, value: u32, least: u32) -> Result<(), MeshError> {
    if value >= least { Ok(()) } else { Err(bad(what, format!("at least {least}"), value)) }
}

fn check_count(vertices: u64) -> Result<(), MeshError> {
    if vertices <= MAX_VERTICES { Ok(()) } else { Err(bad("vertices", format!("at most {MAX_VERTICES}"), vertices)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{face_area_vector, shapes::tests::*};

    /// Errors of two meshes, the second with edges half as long: the order is the binary logarithm of their ratio.
    fn assert_second_order(what: &str, coarse: f64, fine: f64, exact: f64) {
        let (coarse_error, fine_error) = ((coarse - exact).abs(), (fine - exact).abs());
        let order = (coarse_error / fine_error).log2();
        assert!((order - 2.0).abs() < 0.1, "{what}: errors {coarse_error:e}, {fine_error:e}, order {order}");
    }

    #[test]
    fn spheres_have_their_counts_and_converge_to_second_order() {
        for level in 0..=5 {
            let sphere = icosphere(level);
            assert_eq!(sphere.vertex_count(), 10 * 4_usize.pow(level) + 2);
            assert_closed(&sphere, 2);
            assert!(sphere.positions.iter().all(|p| (p.length() - 1.0).abs() < 1e-15));
        }
        let (coarse, fine) = (icosphere(4), icosphere(5));
        assert_second_order("area", surface_area(&coarse), surface_area(&fine), 4.0 * PI);
        assert_second_order("volume", coarse.signed_volume(), fine.signed_volume(), 4.0 / 3.0 * PI);
        assert_eq!(coarse.positions[..], fine.positions[..coarse.vertex_count()]);
    }

    #[test]
    fn tori_have_their_counts_and_converge_to_second_order() {
        let at = |n: u32| torus(2.0, 0.7, 2 * n, n).expect("valid radii");
        let (coarse, fine) = (at(48), at(96));
        for mesh in [&at(3), &coarse, &fine] {
            assert_closed(mesh, 0);
        }
        assert_eq!(coarse.vertex_count(), 96 * 48);
        assert_second_order("area", surface_area(&coarse), surface_area(&fine), 4.0 * PI * PI * 2.0 * 0.7);
        let volume = 2.0 * PI * PI * 2.0 * 0.7 * 0.7;
        assert_second_order("volume", coarse.signed_volume(), fine.signed_volume(), volume);
    }

    #[test]
    fn cylinders_have_their_counts_and_converge_to_second_order() {
        let at = |n: u32| cylinder(0.8, 3.0, 2 * n, n, n / 4).expect("valid size");
        let (coarse, fine) = (at(32), at(64));
        for mesh in [&cylinder(1.0, 1.0, 3, 1, 1).expect("valid size"), &coarse, &fine] {
            assert_closed(mesh, 2);
        }
        assert_eq!(coarse.vertex_count(), 64 * (32 + 2 * 8 - 1) + 2);
        assert_second_order("area", surface_area(&coarse), surface_area(&fine), 2.0 * PI * 0.8 * (0.8 + 3.0));
        assert_second_order("volume", coarse.signed_volume(), fine.signed_volume(), PI * 0.8 * 0.8 * 3.0);
    }

    /// Flat sides are met exactly, so area and volume are those of the box to rounding.
    #[test]
    fn bars_are_exact_boxes() {
        for (nx, ny, nz) in [(1, 1, 1), (1, 2, 3), (20, 4, 5)] {
            let size = DVec3::new(5.0, 1.0, 1.25);
            let mesh = bar(nx, ny, nz, size).expect("valid size");
            assert_closed(&mesh, 2);
            let count = (nx + 1) * (ny + 1) * (nz + 1) - (nx - 1) * (ny - 1) * (nz - 1);
            assert_eq!(mesh.vertex_count(), count as usize);
            assert!((surface_area(&mesh) - 2.0 * (5.0 + 1.25 + 6.25)).abs() < 1e-12);
            assert!((mesh.signed_volume() - 6.25).abs() < 1e-12);
            assert_eq!((mesh.bounds().min, mesh.bounds().max), (-0.5 * size, 0.5 * size));
        }
    }

    #[test]
    fn grids_are_discs_that_face_up() {
        for (columns, rows) in [(1, 1), (4, 3), (10, 10)] {
            let grid = plane_grid(columns, rows, 2.0, 3.0).expect("valid size");
            assert_eq!(grid.vertex_count(), ((columns + 1) * (rows + 1)) as usize);
            let topology = grid.topology();
            assert_eq!(topology.euler_characteristic(), 1);
            assert!(topology.is_manifold() && topology.require_oriented().is_ok());
            assert_eq!(topology.boundary_edge_count(), 2 * (columns + rows) as usize);
            assert!((surface_area(&grid) - 6.0).abs() < 1e-12);
            assert!((0..grid.face_count()).all(|f| face_area_vector(grid.corners(f)).z > 0.0));
            assert!(grid.bounds().centre().length() < 1e-15);
        }
    }

    /// The trapezium rule is exact for a periodic function whose frequencies stay below the sampling rate.
    #[test]
    fn bumps_enclose_the_stated_volume_and_leave_the_border_flat() {
        let (n, width, height, amplitude) = (60, 2.0, 1.5, 0.2);
        let mesh = bumpy_plane(n, n, width, height, amplitude, 3).expect("valid size");
        let cell = width * height / f64::from(n * n);
        let volume: f64 = mesh.positions.iter().map(|p| p.z * cell).sum();
        assert!((volume - amplitude * width * height / 4.0).abs() < 1e-12, "{volume}");
        let boundary = mesh.topology().boundary_vertices();
        assert!(mesh.positions.iter().zip(boundary).all(|(p, border)| !border || p.z.abs() < 1e-30));
        assert!((mesh.bounds().max.z - amplitude).abs() < 1e-12);
    }

    #[test]
    fn wrong_parameters_are_named() {
        let named = |result: Result<TriMesh, MeshError>, name: &str| match result {
            Err(MeshError::BadParameter { what, .. }) => assert_eq!(what, name),
            other => panic!("{name}: {other:?}"),
        };
        named(torus(1.0, 1.0, 8, 8), "minor radius");
        named(torus(f64::NAN, 0.1, 8, 8), "major radius");
        named(torus(1.0, 0.1, 2, 8), "vertices around");
        named(plane_grid(0, 1, 1.0, 1.0), "columns");
        named(plane_grid(1, 1, 1.0, -1.0), "height");
        named(plane_grid(u32::MAX, u32::MAX, 1.0, 1.0), "vertices");
        named(bumpy_plane(2, 2, 1.0, 1.0, f64::INFINITY, 1), "amplitude");
        named(bumpy_plane(2, 2, 1.0, 1.0, 0.1, 0), "bumps");
        named(bar(1, 0, 1, DVec3::ONE), "squares along y");
        named(bar(1, 1, 1, DVec3::new(1.0, 1.0, 0.0)), "size along z");
        named(bar(u32::MAX, u32::MAX, u32::MAX, DVec3::ONE), "vertices");
        named(cylinder(1.0, 1.0, 3, 1, 0), "rings of a cap");
        named(cylinder(1.0, 1.0, u32::MAX, u32::MAX, u32::MAX), "vertices");
    }
}
