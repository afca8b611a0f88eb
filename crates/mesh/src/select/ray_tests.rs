use glam::DVec2;

use super::*;
use crate::select::camera::tests::cameras;
use crate::shapes;

/// Numbers from -1 to 1, evenly spread.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// The hit by looking at every face, in the terms of `pick`.
fn brute_force(caster: &RayCaster, ray: &Ray) -> Option<(u32, f64)> {
    let unit = caster.to_unit(ray)?;
    let meets = |f: u32| unit.meet(caster.unit_corners(f)).map(|(t, _)| (t, f));
    let faces = 0..caster.topology.triangles().len() as u32;
    let (t, f) = faces.filter_map(meets).min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
    Some((f, (unit.skipped + t) / caster.frame.1))
}

/// Where a ray meets a face by solving for it in units of the model: `origin + t direction = a + u (b - a) + v (c - a)`.
fn solved(mesh: &TriMesh, ray: &Ray, face: u32) -> [f64; 3] {
    let [a, b, c] = mesh.corners(face as usize);
    let matrix = glam::DMat3::from_cols(-ray.direction, b - a, c - a);
    (matrix.inverse() * (ray.origin - a)).to_array()
}

fn check(mesh: &TriMesh, caster: &RayCaster, ray: &Ray) -> bool {
    let found = caster.pick(ray);
    assert_eq!(found.map(|h| (h.face, h.distance)), brute_force(caster, ray), "{ray:?}");
    let Some(hit) = found else { return false };
    let size = mesh.bounds().diagonal();
    let far = (ray.origin - mesh.bounds().centre()).length() + mesh.bounds().centre().length() + size;
    let [t, u, v] = solved(mesh, ray, hit.face);
    // Rays seen nearly along a face magnify rounding; they are left to the comparison above.
    let [a, b, c] = mesh.corners(hit.face as usize);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if normal.dot(ray.direction.normalize()).abs() > 0.05 {
        let along = ray.origin + ray.direction.normalize() * hit.distance;
        assert!(along.distance(hit.point) < 1e-13 * far * 20.0, "{along} is not {}", hit.point);
        let noise = 1e-11 * far / (b - a).length().min((c - a).length());
        assert!((t * ray.direction.length() - hit.distance).abs() < 1e-11 * far);
        assert!((u - hit.barycentric[1]).abs() < noise && (v - hit.barycentric[2]).abs() < noise);
    }
    assert!(
        hit.barycentric.iter().all(|w| *w >= 0.0) && (hit.barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-15 * 4.0
    );
    true
}

/// Every answer is that of looking at all faces, from within and outside, near and far, at rays along axes and through vertices.
#[test]
fn picks_are_those_of_brute_force() {
    let mut random = Random(1);
    for mesh in [
        shapes::icosphere(3),
        shapes::torus(1.0, 0.4, 40, 16).expect("valid radii"),
        shapes::plane_grid(12, 9, 2.0, 1.0).expect("valid size"),
        shapes::creature(2000).expect("in range"),
    ] {
        let caster = RayCaster::new(&mesh);
        let bounds = mesh.bounds();
        let mut hits = 0;
        for round in 0..1500_usize {
            let target = bounds.centre() + 0.5 * bounds.size() * random.vector();
            let reach = [0.0, 0.5, 3.0, 1e3][round % 4];
            let origin = target + bounds.diagonal() * reach * random.vector();
            let axis = [DVec3::X, DVec3::NEG_Y, DVec3::Z][round % 3];
            let direction = match round % 5 {
                0 => axis,
                1 => mesh.positions[round % mesh.vertex_count()] - origin,
                _ if reach == 0.0 => random.vector(),
                _ => (target - origin) * 10.0_f64.powf(6.0 * random.next()),
            };
            hits += usize::from(check(&mesh, &caster, &Ray { origin, direction }));
        }
        assert!(hits > 300, "only {hits} rays hit");
    }
}

/// From its middle every ray meets a closed convex surface once, right through edges and vertices too.
#[test]
fn no_ray_slips_through_an_edge() {
    let sphere = shapes::icosphere(3);
    let caster = RayCaster::new(&sphere);
    let origin = DVec3::new(1e-3, -2e-3, 5e-4);
    for &[a, b] in sphere.topology().edges() {
        let [a, b] = [a, b].map(|v| sphere.positions[v as usize]);
        for t in [0.0, 1e-9, 0.5, 0.731] {
            let on_edge = a.lerp(b, t);
            let hit = caster.pick(&Ray { origin, direction: on_edge - origin }).expect("a closed surface");
            assert!(hit.point.distance(on_edge) < 1e-13);
        }
    }
}

/// Far from the origin a mesh keeps as many digits as its coordinates have, and any scale is as good as another.
#[test]
fn offsets_and_scales_change_nothing_but_digits() {
    let sphere = shapes::icosphere(4);
    let caster = RayCaster::new(&sphere);
    let mut random = Random(7);
    for (scale, offset, digits) in [(1e-12, 0.0, 1e-13), (1e12, 0.0, 1e-13), (1.0, 1e6, 1e-8), (1e-3, -1e3, 1e-8)] {
        let place = |p: DVec3| p * scale + DVec3::splat(offset);
        let moved = sphere.with_positions(sphere.positions.iter().map(|&p| place(p)).collect()).expect("finite");
        let there = RayCaster::new(&moved);
        for _ in 0..200 {
            let (origin, target) = (3.0 * random.vector(), 0.5 * random.vector());
            let direction = target - origin;
            let here = caster.pick(&Ray { origin, direction });
            let hit = there.pick(&Ray { origin: place(origin), direction: direction * scale });
            let (Some(here), Some(hit)) = (here, hit) else {
                assert_eq!(here, hit);
                continue;
            };
            assert!((hit.distance / scale - here.distance).abs() < digits);
            assert!((hit.point - place(here.point)).length() < scale * digits);
        }
    }
}

/// A camera's ray through where a visible vertex is seen hits the surface at that vertex.
#[test]
fn rays_through_pixels_hit_what_is_seen_there() {
    let torus = shapes::torus(1.0, 0.4, 40, 16).expect("valid radii");
    let caster = RayCaster::new(&torus);
    for (camera, _) in cameras() {
        let mut seen = 0;
        for (v, &p) in torus.positions.iter().enumerate() {
            let (back, reach) = camera.to_eye(p);
            let hit = caster.pick(&camera.ray(camera.project(p).expect("before the camera")));
            let at_vertex = hit.is_some_and(|h| h.point.distance(p) < 1e-9 && h.vertex(torus.topology()) == v as u32);
            // Rays along the outline may miss by rounding. Faces at a vertex turn by up to 22.5 degrees from its normal.
            let turned = crate::vertex_normals(torus.topology(), &torus.positions)[v].dot(back.normalize());
            if turned.abs() > 22.5_f64.to_radians().sin() {
                assert_eq!(at_vertex, !caster.is_hidden(v as u32, back, reach), "{v}");
                seen += usize::from(at_vertex);
            }
        }
        assert!((100..400).contains(&seen), "{seen} of 640");
        assert!(caster.pick(&camera.ray(DVec2::new(1.0, 1.0))).is_none());
    }
}

/// A moved tree answers as a new one, little or wildly deformed.
#[test]
fn moved_trees_answer_as_new_ones() {
    let mesh = shapes::creature(2000).expect("in range");
    let mut caster = RayCaster::new(&mesh);
    let mut random = Random(3);
    let mut rebuilt = 0;
    for amount in [0.01, 0.3, 40.0, 0.0] {
        let wave =
            |p: &DVec3| *p * (1.0 + amount) + DVec3::new(amount * (37.0 * p.y).sin(), 0.0, amount * (29.0 * p.x).cos());
        let moved = mesh.with_positions(mesh.positions.iter().map(wave).collect()).expect("finite");
        let before = caster.built_cost;
        caster.update(&moved.positions).expect("as many");
        rebuilt += usize::from(caster.built_cost != before);
        let anew = RayCaster::new(&moved);
        let bounds = moved.bounds();
        for _ in 0..300 {
            let target = bounds.centre() + 0.4 * bounds.size() * random.vector();
            let ray = Ray { origin: target + bounds.diagonal() * random.vector(), direction: random.vector() };
            check(&moved, &caster, &ray);
            assert_eq!(caster.pick(&ray), anew.pick(&ray));
        }
    }
    assert!((1..4).contains(&rebuilt), "{rebuilt} trees were built anew");
    let short = caster.update(&mesh.positions[1..]);
    assert!(matches!(short, Err(MeshError::PositionCount { .. })));
    let mut bad = mesh.positions.clone();
    bad[7].y = f64::NAN;
    assert_eq!(caster.update(&bad), Err(MeshError::NotFinite { vertex: 7 }));
}

/// The lowest of faces in the same place is hit, whatever the tree; thousands of them make no tree too deep.
#[test]
fn the_lowest_of_equal_faces_is_hit() {
    let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    let ray = Ray { origin: DVec3::new(0.25, 0.25, 1.0), direction: DVec3::NEG_Z };
    for count in [1, 2, 9, 40, 5000] {
        let mesh = TriMesh::new(corners.clone(), vec![[0, 1, 2]; count]).expect("a soup");
        let hit = RayCaster::new(&mesh).pick(&ray).expect("in its way");
        assert_eq!((hit.face, hit.distance, hit.point), (0, 1.0, DVec3::new(0.25, 0.25, 0.0)));
    }
}

#[test]
fn nothing_is_hit_where_there_is_nothing_to_hit() {
    let ray = |origin, direction| Ray { origin, direction };
    let empty = RayCaster::new(&TriMesh::new(vec![], vec![]).expect("nothing"));
    assert_eq!(empty.pick(&ray(DVec3::ZERO, DVec3::X)), None);
    // Faces without area: a line and a point.
    let flat = TriMesh::new(vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, DVec3::X], vec![[0, 1, 2], [1, 3, 2]]);
    let flat = RayCaster::new(&flat.expect("a soup"));
    assert_eq!(flat.pick(&ray(DVec3::new(1.0, 0.0, 1.0), DVec3::NEG_Z)), None);
    let point = RayCaster::new(&TriMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).expect("a soup"));
    assert_eq!(point.pick(&ray(DVec3::ZERO, DVec3::ONE)), None);
    let sphere = RayCaster::new(&shapes::icosphere(2));
    for bad in [
        ray(DVec3::NAN, DVec3::X),
        ray(DVec3::ZERO, DVec3::NAN),
        ray(DVec3::ZERO, DVec3::ZERO),
        ray(DVec3::ZERO, DVec3::new(f64::INFINITY, 0.0, 1.0)),
        ray(DVec3::splat(f64::INFINITY), DVec3::X),
        ray(DVec3::splat(f64::MAX), DVec3::X),
    ] {
        assert_eq!(sphere.pick(&bad), None, "{bad:?}");
    }
    // Behind the ray, and beside it.
    assert_eq!(sphere.pick(&ray(DVec3::new(2.0, 0.0, 0.0), DVec3::X)), None);
    assert_eq!(sphere.pick(&ray(DVec3::new(2.0, 1.1, 0.0), DVec3::NEG_X)), None);
    // Directions whose squares overflow or vanish are as good as others.
    for length in [1e-300, 1e300] {
        assert!(sphere.pick(&ray(DVec3::new(3.0, 0.1, 0.1), DVec3::NEG_X * length)).is_some());
    }
    let huge = shapes::icosphere(1);
    let huge = huge.with_positions(huge.positions.iter().map(|p| *p * 1.7e308).collect()).expect("finite");
    assert!(RayCaster::new(&huge).pick(&ray(DVec3::new(0.1e308, 0.1e308, 0.05e308), DVec3::X)).is_some());
}
