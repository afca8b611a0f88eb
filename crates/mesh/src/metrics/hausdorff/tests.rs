use super::*;
use crate::metrics::closest_on_triangle;
use crate::metrics::test_meshes::grid;
use crate::{Similarity, TriMesh, shapes};

fn measure(mesh: &TriMesh, pose: &[DVec3]) -> HausdorffDistance {
    hausdorff(mesh.topology(), &mesh.positions, pose, &HausdorffOptions::default())
}

fn moved(mesh: &TriMesh, to: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    mesh.positions.iter().map(|p| to(*p)).collect()
}

fn assert_close(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() <= 1e-12 * expected.abs().max(1e-3), "{what}: {found} is not {expected}");
}

#[test]
fn parallel_sheets_are_as_far_apart_everywhere() {
    let mesh = grid(7, 4);
    for distance in [1e-6, 0.3, 50.0] {
        let found = measure(&mesh, &moved(&mesh, |p| p + distance * DVec3::Z));
        for side in [found.there, found.back] {
            for figure in [side.max, side.bound, side.mean, side.rms] {
                assert_close(figure, distance, "a figure");
            }
        }
    }
    assert_eq!(measure(&mesh, &mesh.positions), HausdorffDistance::default());
}

/// A sheet of width `w` pushed along by `t`: what is past the edge of the other grows farther linearly, so the mean is
/// `t^2 / 2w` and the mean square `t^3 / 3w`. Nothing is farther than `t`, though every vertex moved by as much.
#[test]
fn sheets_that_slide_are_apart_where_they_stick_out() {
    let mesh = grid(8, 3);
    for t in [1.0, 3.0, 8.0] {
        let found = measure(&mesh, &moved(&mesh, |p| p + t * DVec3::X));
        assert_eq!(
            found.there,
            hausdorff(
                mesh.topology(),
                &mesh.positions,
                &moved(&mesh, |p| p - t * DVec3::X),
                &HausdorffOptions::default()
            )
            .back
        );
        for side in [found.there, found.back] {
            assert_close(side.max, t, "max");
            assert_close(side.bound, t, "bound");
            assert_close(side.mean, t * t / 16.0, "mean");
            assert_close(side.rms, (t * t * t / 24.0).sqrt(), "rms");
        }
    }
}

/// Of a sphere and a smaller copy inside: vertices lie over vertices, at the difference of the radii, and the distance to a convex body is
/// convex, so that nothing is farther. The other way round only a little less, by the sag of the faces.
#[test]
fn spheres_are_apart_by_the_difference_of_their_radii() {
    let sphere = shapes::icosphere(4);
    for radius in [0.2, 0.5, 0.95] {
        let found = measure(&sphere, &moved(&sphere, |p| p * radius));
        let apart = 1.0 - radius;
        assert_close(found.there.max, apart, "max");
        assert!(found.there.bound >= found.there.max && found.there.bound <= 1.01 * apart, "{found:?}");
        let sag = 0.002;
        assert!(found.back.max <= apart && found.back.max >= apart - sag, "{found:?}");
        assert!((found.back.mean - apart).abs() < sag && (found.there.rms - apart).abs() < sag, "{found:?}");
        assert_eq!((found.max(), found.there.unproven), (found.there.max, 0));
    }
}

/// An upright sheet between two level ones: halfway up it is farthest, at neither a corner nor a centroid, where samples find two thirds.
#[test]
fn the_farthest_point_may_be_anywhere_on_a_face() {
    let upright = [[0.0, 0.0, -1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 2.0], [0.0, 0.0, 2.0]];
    let level = |z: f64| [[-5.0, -5.0, z], [5.0, -5.0, z], [5.0, 5.0, z], [-5.0, 5.0, z]];
    let pose = |sheets: [[[f64; 3]; 4]; 2]| sheets.concat().into_iter().map(DVec3::from_array).collect::<Vec<DVec3>>();
    let faces = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let mesh = TriMesh::new(pose([upright, level(2.0)]), faces).expect("valid indices");
    for tolerance in [0.1, 0.01, 1e-4] {
        let options = HausdorffOptions { tolerance, ..HausdorffOptions::default() };
        let found = hausdorff(mesh.topology(), &mesh.positions, &pose([level(-1.0), level(2.0)]), &options).there;
        assert!(found.max <= 1.5 && found.bound >= 1.5 && found.bound <= (1.0 + tolerance) * found.max, "{found:?}");
    }
    let unsplit = HausdorffOptions { limit: 0, ..HausdorffOptions::default() };
    let found = hausdorff(mesh.topology(), &mesh.positions, &pose([level(-1.0), level(2.0)]), &unsplit).there;
    assert!((found.max - 1.0).abs() < 1e-12 && found.bound >= 1.5, "{found:?}");
}

/// Poses that bend, fold, pass through themselves, shrink, or are nothing but noise.
fn poses(mesh: &TriMesh) -> Vec<(&'static str, Vec<DVec3>)> {
    let bounds = mesh.bounds();
    let (centre, size) = (bounds.centre(), bounds.diagonal());
    let twist = |p: DVec3| Similarity::about(centre, DVec3::X, 4.0 * (p - centre).x / size, 1.0).apply(p);
    let noise = |p: DVec3| DVec3::new((91.0 * p.y + p.z).sin(), (83.0 * p.z + p.x).sin(), (97.0 * p.x + p.y).sin());
    vec![
        ("twisted", moved(mesh, twist)),
        ("waved", moved(mesh, |p| p + 0.03 * size * (9.0 * p.y / size).sin() * DVec3::Z)),
        ("folded", moved(mesh, |p| p.with_x(centre.x - (p.x - centre.x).abs()))),
        ("flat", moved(mesh, |p| p.with_y(0.3 * p.x))),
        ("small", moved(mesh, |p| centre + 0.1 * size * DVec3::ONE + 0.01 * (p - centre))),
        ("noisy", moved(mesh, |p| p + 0.02 * size * noise(p))),
        ("crumpled", moved(mesh, |p| centre + 0.3 * size * noise(p))),
    ]
}

/// Figures against those of many points of each face and all faces of the other surface: no point is beyond the bound, and means are those of
/// the points but for what lies between the four of each face that are looked at.
#[test]
fn no_point_of_the_surface_is_beyond_the_bound() {
    let meshes = [
        shapes::torus(1.0, 0.4, 16, 7).expect("valid radii"),
        shapes::bumpy_plane(10, 7, 3.0, 2.0, 0.4, 2).expect("valid size"),
    ];
    for mesh in meshes {
        for (name, pose) in poses(&mesh) {
            let found = measure(&mesh, &pose);
            for (own, other, side) in [(&mesh.positions, &pose, found.there), (&pose, &mesh.positions, found.back)] {
                let (mean, rms, max) = by_brute_force(&mesh, own, other);
                let rounding = 1e-14 * mesh.bounds().diagonal();
                // Half of the folded torus lies exactly on the other half, with other diagonals: there the limit is reached.
                let slack = if max < rounding { 0.01 * mesh.bounds().diagonal() } else { rounding };
                assert!(side.bound <= (1.01 * side.max).max(side.max + slack), "{name}: {side:?}");
                assert!(max <= side.bound + rounding && side.max >= max / 1.01 - rounding, "{name}: {max} of {side:?}");
                // Integrals by four points a face; faces are a tenth of the mesh, or all of it.
                let off = if name == "crumpled" { 0.15 } else { 0.06 };
                assert!((side.mean - mean).abs() < off * mean + rounding, "{name}: {mean} of {side:?}");
                assert!((side.rms - rms).abs() < off * rms + rounding, "{name}: {rms} of {side:?}");
                assert_eq!(side.unproven, 0);
            }
        }
    }
}

/// Mean, root mean square and maximum of the distances of the middles of 36 parts of each face.
fn by_brute_force(mesh: &TriMesh, own: &[DVec3], other: &[DVec3]) -> (f64, f64, f64) {
    const PARTS: usize = 6;
    let at = |pose: &[DVec3], face: &[u32; 3]| face.map(|v| pose[v as usize]);
    let faces: Vec<[DVec3; 3]> = mesh.triangles().iter().map(|face| at(other, face)).collect();
    let (mut sum, mut squares, mut total, mut max) = (0.0, 0.0, 0.0, 0.0_f64);
    for face in mesh.triangles() {
        let [a, b, c] = at(own, face);
        let area = (b - a).cross(c - a).length();
        // Middles of the parts that stand like the face, and of those upside down, in thirds of a part.
        let upright = (0..PARTS).flat_map(|i| (0..PARTS - i).map(move |j| (3 * i + 1, 3 * j + 1)));
        let turned = (0..PARTS - 1).flat_map(|i| (0..PARTS - 1 - i).map(move |j| (3 * i + 2, 3 * j + 2)));
        for (u, v) in upright.chain(turned) {
            let [u, v] = [u, v].map(|w| w as f64 / (3 * PARTS) as f64);
            let p = a + (b - a) * u + (c - a) * v;
            let square = faces
                .iter()
                .map(|face| p.distance_squared(closest_on_triangle(p, *face)))
                .fold(f64::INFINITY, f64::min);
            (sum, squares, total) = (sum + area * square.sqrt(), squares + area * square, total + area);
            max = max.max(square.sqrt());
        }
    }
    (sum / total, (squares / total).sqrt(), max)
}

/// A sphere turned within itself: distances are the sag of the faces, far less than the slide. What cannot be told within the limit is bounded
/// by the slide.
#[test]
fn surfaces_that_slide_along_each_other_are_bounded_by_the_slide() {
    let sphere = shapes::icosphere(4);
    let turn = Similarity::about(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), 0.01, 1.0);
    let found = measure(&sphere, &moved(&sphere, |p| turn.apply(p)));
    let sag = 0.002;
    for side in [found.there, found.back] {
        assert!(side.max > 0.0 && side.max < sag && side.bound >= side.max && side.bound <= 0.01, "{side:?}");
    }
}

/// Where all is close together compared to how far off it is, one search tells all distances well enough.
#[test]
fn distances_of_small_surfaces_are_within_the_tolerance() {
    let sphere = shapes::icosphere(4);
    for (scale, tolerance) in [(0.3, 0.01), (0.01, 0.01), (0.01, 0.1), (1e-9, 1e-6)] {
        let options = |tolerance| HausdorffOptions { tolerance, ..HausdorffOptions::default() };
        let pose = moved(&sphere, |p| DVec3::new(0.2, 0.1, 0.4) + scale * p);
        let exact = hausdorff(sphere.topology(), &sphere.positions, &pose, &options(0.0)).back;
        let found = hausdorff(sphere.topology(), &sphere.positions, &pose, &options(tolerance)).back;
        for (figure, exact) in [(found.mean, exact.mean), (found.rms, exact.rms)] {
            assert!(figure >= exact * (1.0 - 1e-12) && figure <= exact * (1.0 + tolerance), "{found:?} {exact:?}");
        }
        assert!(found.max <= exact.bound && found.bound >= exact.max, "{found:?} {exact:?}");
        assert!(found.bound <= found.max * (1.0 + tolerance), "{found:?}");
    }
}

#[test]
fn results_are_the_same_for_any_number_of_threads_and_at_any_scale() {
    let torus = shapes::torus(1.0, 0.4, 30, 15).expect("valid radii");
    for (name, pose) in poses(&torus) {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| measure(&torus, &pose))
        };
        let found = run(1);
        for threads in [2, 5] {
            assert_eq!(run(threads), found, "{name}, {threads} threads");
        }
        for scale in [2.0_f64.powi(-900), 2.0_f64.powi(-40), 2.0_f64.powi(900)] {
            let [a, b] = [&torus.positions, &pose].map(|pose| pose.iter().map(|p| *p * scale).collect::<Vec<DVec3>>());
            let scaled = hausdorff(torus.topology(), &a, &b, &HausdorffOptions::default());
            for (side, scaled) in [(found.there, scaled.there), (found.back, scaled.back)] {
                let figures = [side.max, side.bound, side.mean, side.rms].map(|figure| figure * scale);
                assert_eq!([scaled.max, scaled.bound, scaled.mean, scaled.rms], figures, "{name} at {scale}");
            }
        }
    }
}

#[test]
fn what_is_not_a_surface_has_no_distance() {
    let sphere = shapes::icosphere(2);
    for bad in [f64::NAN, f64::INFINITY] {
        let mut pose = sphere.positions.clone();
        pose[7].y = bad;
        for found in [
            measure(&sphere, &pose),
            hausdorff(sphere.topology(), &pose, &sphere.positions, &HausdorffOptions::default()),
        ] {
            assert!([found.max(), found.bound(), found.mean(), found.rms()].iter().all(|figure| figure.is_nan()));
        }
    }
    let none = TriMesh::new(vec![DVec3::ONE], Vec::new()).expect("no face");
    assert_eq!(measure(&none, &[DVec3::NAN]), HausdorffDistance::default());
    // A vertex without faces is not part of the surface, wherever it is.
    let mut positions = sphere.positions.clone();
    positions.push(DVec3::splat(1e300));
    let stray = TriMesh::new(positions.clone(), sphere.triangles().to_vec()).expect("valid");
    let mut pose = moved(&stray, |p| 1.5 * p);
    pose[sphere.vertex_count()] = DVec3::NAN;
    assert_eq!(measure(&stray, &pose), measure(&sphere, &moved(&sphere, |p| 1.5 * p)));
    // Without area all faces weigh the same: of a point, its distance, of one in the middle of a sphere the least radius.
    let found = measure(&sphere, &vec![DVec3::ZERO; sphere.vertex_count()]);
    let inner = (0..sphere.face_count()).map(|f| closest_on_triangle(DVec3::ZERO, sphere.corners(f)).length());
    let inner = inner.fold(f64::INFINITY, f64::min);
    for figure in [found.back.max, found.back.mean, found.back.rms] {
        assert_close(figure, inner, "a figure");
    }
    assert_close(found.there.max, 1.0, "max");
    // Options out of range ask for as much as can be had.
    for tolerance in [f64::NAN, -1.0, 0.0] {
        let options = HausdorffOptions { tolerance, limit: 1000 };
        let found = hausdorff(sphere.topology(), &sphere.positions, &moved(&sphere, |p| 0.5 * p), &options);
        assert_close(found.there.max, 0.5, "max");
        assert!(found.bound() >= 0.5 && found.bound() < 0.6, "{found:?}");
    }
}

/// Faces that all lie over each other: searches end in time, and say so.
#[test]
fn crumpled_surfaces_take_bounded_time() {
    let torus = shapes::torus(1.0, 0.4, 80, 40).expect("valid radii");
    let noise =
        |p: DVec3| DVec3::new((9100.0 * p.y + p.z).sin(), (8300.0 * p.z + p.x).sin(), (9700.0 * p.x + p.y).sin());
    let pose = moved(&torus, noise);
    let found = measure(&torus, &pose);
    assert!(found.there.unproven > 0, "{found:?}");
    assert!(found.there.max <= found.there.bound && found.there.mean <= found.there.bound, "{found:?}");
}
