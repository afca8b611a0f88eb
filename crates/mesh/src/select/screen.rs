use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{RayCaster, ScreenCamera, check_positions};
use crate::{MeshError, Topology, VertexSet, face_area_vector};

/// Which of the vertices under a lasso are meant.
#[derive(Debug, Clone, Copy, Default)]
pub enum Seen<'a> {
    /// All, through the whole model.
    #[default]
    Through,
    /// Those with a face whose front looks to the camera.
    Facing,
    /// Those that no face hides, by rays to the eye. The caster has to be in the same pose.
    ///
    /// On a closed surface these face the camera too; of an open one both sides count.
    Unhidden(&'a RayCaster),
}

/// Vertices that are seen within a polygon on the screen, by the even-odd rule: where the outline crosses itself, what is enclosed twice
/// is outside. Corners are in pixels; the last one is joined to the first.
///
/// A vertex right on the outline belongs to the polygon on one side of it, so polygons that share an edge share no vertex. What is
/// not before the camera is never taken, what is beyond the viewport is. Costs `O(vertices * corners)`, less where the polygon is small,
/// and a ray per vertex for [`Seen::Unhidden`]; parallel.
///
/// # Errors
/// A corner that is not finite, another number of positions than of vertices, or a caster for another number of vertices.
pub fn lasso(
    topology: &Topology,
    positions: &[DVec3],
    camera: &ScreenCamera,
    polygon: &[DVec2],
    seen: Seen<'_>,
) -> Result<VertexSet, MeshError> {
    check_finite(polygon)?;
    let Some(&start) = polygon.first() else {
        return under(topology, positions, camera, seen, |_| false);
    };
    let (min, max) = polygon.iter().fold((start, start), |(min, max), &p| (min.min(p), max.max(p)));
    let inside = |p: DVec2| p.cmpge(min).all() && p.cmple(max).all() && encloses(polygon, p);
    under(topology, positions, camera, seen, inside)
}

/// Vertices that are seen in the box with two opposite corners on the screen, its sides included; else as [`lasso`].
///
/// # Errors
/// As [`lasso`].
pub fn screen_box(
    topology: &Topology,
    positions: &[DVec3],
    camera: &ScreenCamera,
    corners: [DVec2; 2],
    seen: Seen<'_>,
) -> Result<VertexSet, MeshError> {
    check_finite(&corners)?;
    let (min, max) = (corners[0].min(corners[1]), corners[0].max(corners[1]));
    under(topology, positions, camera, seen, |p| p.cmpge(min).all() && p.cmple(max).all())
}

fn check_finite(corners: &[DVec2]) -> Result<(), MeshError> {
    match corners.iter().find(|p| !p.is_finite()) {
        None => Ok(()),
        Some(found) => Err(MeshError::BadParameter {
            what: "a corner on the screen",
            expected: "finite".into(),
            found: found.to_string(),
        }),
    }
}

/// Whether a ray to the right crosses the outline an odd number of times.
fn encloses(polygon: &[DVec2], p: DVec2) -> bool {
    let mut inside = false;
    let mut a = polygon[polygon.len() - 1];
    for &b in polygon {
        if (a.y > p.y) != (b.y > p.y) {
            // Computed from the upper end, so that both polygons at an edge agree.
            let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
            inside ^= p.x < low.x + (high.x - low.x) * ((p.y - low.y) / (high.y - low.y));
        }
        a = b;
    }
    inside
}

fn under(
    topology: &Topology,
    positions: &[DVec3],
    camera: &ScreenCamera,
    seen: Seen<'_>,
    inside: impl Fn(DVec2) -> bool + Sync,
) -> Result<VertexSet, MeshError> {
    check_positions(topology, positions)?;
    if let Seen::Unhidden(caster) = seen
        && caster.vertex_count() != positions.len()
    {
        return Err(MeshError::PositionCount { expected: positions.len(), found: caster.vertex_count() });
    }
    let is_seen = |v: usize| {
        let (to_eye, reach) = camera.to_eye(positions[v]);
        match seen {
            Seen::Through => true,
            Seen::Facing => topology.vertex_faces(v).iter().any(|&f| {
                let corners = topology.triangles()[f as usize].map(|w| positions[w as usize]);
                face_area_vector(corners).dot(to_eye) > 0.0
            }),
            Seen::Unhidden(caster) => !caster.is_hidden(v as u32, to_eye, reach),
        }
    };
    let taken: Vec<u32> = (0..positions.len())
        .into_par_iter()
        .filter(|&v| camera.project(positions[v]).is_some_and(&inside) && is_seen(v))
        .map(|v| v as u32)
        .collect();
    Ok(taken.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::camera::tests::cameras;
    use crate::{TriMesh, shapes};

    /// Sum of the angles that the corners turn round a point, in turns: the even-odd rule by another way.
    fn turns(polygon: &[DVec2], p: DVec2) -> f64 {
        let next = polygon.iter().cycle().skip(1);
        polygon.iter().zip(next).map(|(a, b)| (*a - p).angle_to(*b - p)).sum::<f64>() / std::f64::consts::TAU
    }

    fn star(centre: DVec2, radius: f64) -> Vec<DVec2> {
        let corner = |i: i32| centre + radius * DVec2::from_angle(f64::from(2 * i) * std::f64::consts::TAU / 5.0);
        (0..5).map(corner).collect()
    }

    /// A five-pointed star, whose middle is enclosed twice, against projection and winding of every vertex.
    #[test]
    fn a_lasso_takes_what_projects_into_it() {
        let torus = shapes::torus(1.0, 0.4, 60, 24).expect("valid radii");
        for (camera, _) in cameras() {
            let polygon = star(DVec2::new(420.0, 290.0), 180.0);
            let found = lasso(torus.topology(), &torus.positions, &camera, &polygon, Seen::Through).expect("a lasso");
            let wound = |v: u32| turns(&polygon, camera.project(torus.positions[v as usize]).expect("seen")).round();
            assert_eq!(found, VertexSet::where_true(1440, |v| wound(v) as i64 % 2 != 0));
            assert!(!found.is_empty() && (0..1440).any(|v| wound(v).abs() == 2.0));
        }
    }

    /// A sphere of radius 1 seen from distance d shows its cap of points with `p . e > 1 / d` (0 from infinitely far).
    #[test]
    fn the_near_side_of_a_sphere_faces_and_is_unhidden() {
        let sphere = shapes::icosphere(4);
        let caster = RayCaster::new(&sphere);
        let everything = [DVec2::ZERO, DVec2::new(800.0, 600.0)];
        for (camera, eye) in cameras() {
            let (back, reach) = camera.to_eye(DVec3::ZERO);
            let bound = if reach.is_finite() { eye.length().recip() } else { 0.0 };
            let take =
                |seen| screen_box(sphere.topology(), &sphere.positions, &camera, everything, seen).expect("a box");
            // Faces are up to an edge (0.08) before and behind a vertex; faces hide what is that near to the outline.
            for (found, name) in [(take(Seen::Facing), "facing"), (take(Seen::Unhidden(&caster)), "unhidden")] {
                for v in 0..sphere.vertex_count() as u32 {
                    let over = sphere.positions[v as usize].dot(back.normalize()) - bound;
                    assert!(over.abs() < 0.09 || found.contains(v) == (over > 0.0), "{v} {name}: {over}");
                }
            }
            assert_eq!(take(Seen::Through).len(), sphere.vertex_count());
        }
    }

    /// Of two squares one behind the other, the far one is hidden and faces the camera none the less; turned over, it does not.
    #[test]
    fn hidden_and_facing_are_not_the_same() {
        let square =
            |z: f64| [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| DVec3::new(x, y, z) * 0.3);
        let positions: Vec<DVec3> = square(0.0).into_iter().chain(square(-1.0).map(|p| p * 0.5)).collect();
        let faces = vec![[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]];
        let mesh = TriMesh::new(positions, faces).expect("squares");
        let view = glam::dcamera::rh::view::look_at_mat4(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y);
        let lens = glam::dcamera::rh::proj::directx::perspective(0.8, 1.0, 0.1, 10.0);
        let camera = ScreenCamera::new(lens * view, DVec2::splat(100.0)).expect("a camera");
        let caster = RayCaster::new(&mesh);
        let everything = [DVec2::splat(100.0), DVec2::ZERO];
        let take = |seen| screen_box(mesh.topology(), &mesh.positions, &camera, everything, seen).expect("a box");
        let near: VertexSet = (0..4).collect();
        assert_eq!(take(Seen::Unhidden(&caster)), near);
        assert_eq!(take(Seen::Facing), near);
        assert_eq!(take(Seen::Through), VertexSet::all(8));
        let turned =
            TriMesh::new(mesh.positions.clone(), vec![[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]]).expect("squares");
        let facing =
            screen_box(turned.topology(), &turned.positions, &camera, everything, Seen::Facing).expect("a box");
        assert_eq!(facing, (4..8).collect());
    }

    /// Two polygons that share a way across the screen part the vertices between them, also those right on it.
    #[test]
    fn polygons_side_by_side_share_no_vertex() {
        let grid = shapes::plane_grid(20, 20, 2.0, 2.0).expect("valid size");
        let view = glam::dcamera::rh::view::look_at_mat4(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y);
        let lens = glam::dcamera::rh::proj::directx::orthographic(-1.0, 1.0, -1.0, 1.0, 1.0, 10.0);
        let camera = ScreenCamera::new(lens * view, DVec2::splat(64.0)).expect("a camera");
        let [far, middle] = [-10.0, 32.0].map(DVec2::splat);
        let way = [DVec2::new(32.0, -10.0), middle, DVec2::new(100.0, 100.0)];
        let take =
            |polygon: &[DVec2]| lasso(grid.topology(), &grid.positions, &camera, polygon, Seen::Through).expect("one");
        let left = take(&[way[0], way[1], way[2], DVec2::new(-10.0, 100.0), far]);
        let right = take(&[way[2], way[1], way[0], DVec2::new(100.0, -10.0)]);
        assert!(left.intersection(&right).is_empty() && !right.is_empty());
        assert_eq!(left.union(&right), VertexSet::all(441));
    }

    #[test]
    fn what_is_no_lasso_takes_nothing_or_is_refused() {
        let sphere = shapes::icosphere(1);
        let (camera, _) = cameras()[0];
        let take = |polygon: &[DVec2], seen| lasso(sphere.topology(), &sphere.positions, &camera, polygon, seen);
        for corners in 0..3 {
            assert_eq!(
                take(&star(DVec2::new(400.0, 300.0), 900.0)[..corners], Seen::Through),
                Ok(VertexSet::default())
            );
        }
        assert!(take(&[DVec2::ZERO, DVec2::X, DVec2::NAN], Seen::Through).is_err());
        let other = RayCaster::new(&shapes::icosphere(2));
        let found = take(&star(DVec2::ZERO, 100.0), Seen::Unhidden(&other));
        assert_eq!(found, Err(MeshError::PositionCount { expected: 42, found: 162 }));
        let short = lasso(sphere.topology(), &sphere.positions[1..], &camera, &[], Seen::Through);
        assert_eq!(short, Err(MeshError::PositionCount { expected: 42, found: 41 }));
    }
}
