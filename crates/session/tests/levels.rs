//! What starting from coarser cages promises.

use glam::DVec3;
use pliant_cage::{CageSize, simplify};
use pliant_deform::arap::Arap;
use pliant_deform::{ArapOptions, Deformer, Goals, Handle, Method, Region};
use pliant_mesh::{Silent, Similarity, TriMesh, VertexSet, shapes};
use pliant_session::{Levels, NoRoom, carry_region};

fn meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("bar", shapes::bar(60, 8, 8, DVec3::new(6.0, 0.8, 0.8)).expect("valid")),
        ("bumpy plane", shapes::bumpy_plane(40, 30, 3.0, 2.0, 0.1, 3).expect("valid")),
        ("creature", shapes::creature(3000).expect("valid")),
    ]
}

/// The two ends along the longest axis; with `part`, only the half by the second end takes part.
fn ends(mesh: &TriMesh, part: bool) -> Region {
    let (n, bounds) = (mesh.vertex_count(), mesh.bounds());
    let axis = bounds.size().max_position();
    let along = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
    let high = Handle::hard(VertexSet::where_true(n, |v| along(v) >= 0.9));
    let low = Handle::hard(VertexSet::where_true(n, |v| along(v) <= 0.1));
    let handles = if part { vec![high] } else { vec![high, low] };
    let roi = VertexSet::where_true(n, |v| !part || along(v) > 0.4);
    Region::new(n, &roi, &handles).expect("both ends have vertices")
}

fn goals(mesh: &TriMesh, region: &Region, degrees: f64) -> Goals {
    let turn = Similarity::about(mesh.bounds().centre(), DVec3::new(0.2, 0.3, 1.0), degrees.to_radians(), 1.0);
    let mut transforms = vec![turn, Similarity::IDENTITY];
    transforms.truncate(region.handles().len());
    Goals::new(transforms)
}

fn largest(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
}

/// Two iterations end at an energy at least a fifth below that of two from the pose.
#[test]
fn the_energy_is_lower_than_from_the_pose() {
    for (name, mesh) in meshes() {
        let region = ends(&mesh, false);
        let levels = Levels::new(&mesh, &Silent).expect("valid");
        assert!(levels.sizes().count() >= 2, "{name}: {:?}", levels.sizes().collect::<Vec<_>>());
        let method = Method::Arap(ArapOptions::default());
        for degrees in [30.0, 70.0] {
            let goals = goals(&mesh, &region, degrees);
            let mut energy_of = Arap::prepare(&ArapOptions::default(), &mesh, &region).expect("valid");
            let mut solved = |mut deformer: Box<dyn Deformer>| {
                let mut pose = mesh.positions.clone();
                deformer.solve(&goals, &mut pose).expect("valid");
                energy_of.energy(&goals, &pose).expect("valid")
            };
            let from_levels = solved(Box::new(levels.prepare(&method, &mesh, &region).expect("valid")));
            let from_pose = solved(method.prepare(&mesh, &region).expect("valid"));
            assert!(from_levels < 0.8 * from_pose, "{name}, {degrees}: {from_levels:e} against {from_pose:e}");
        }
    }
}

#[test]
fn rest_rigid_motions_and_fixed_vertices_are_kept() {
    for (name, mesh) in meshes() {
        let levels = Levels::new(&mesh, &Silent).expect("valid");
        let region = ends(&mesh, false);
        let mut start = levels.prepare(&Method::default(), &mesh, &region).expect("valid");
        assert!(start.level_count() >= 1);
        let diagonal = mesh.bounds().diagonal();
        let mut pose = mesh.positions.clone();
        start.solve(&region.identity_goals(), &mut pose).expect("valid");
        assert!(largest(&pose, &mesh.positions) < 1e-12 * diagonal, "{name}");
        let motion = Similarity::about(DVec3::new(1.0, -2.0, 0.5), DVec3::new(0.3, 1.0, 0.2), 1.9, 1.0);
        start.solve(&Goals::new(vec![motion; 2]), &mut pose).expect("valid");
        let moved: Vec<DVec3> = mesh.positions.iter().map(|p| motion.apply(*p)).collect();
        // Each level adds the rounding of its rotations.
        assert!(largest(&pose, &moved) < 1e-9 * diagonal, "{name}: {:e}", largest(&pose, &moved));

        let part = ends(&mesh, true);
        start.set_region(&part).expect("valid");
        let mut pose = mesh.positions.clone();
        let goals = goals(&mesh, &part, 50.0);
        start.solve(&goals, &mut pose).expect("valid");
        let fixed = |v: usize| part.roles()[v] == pliant_deform::Role::Fixed;
        assert!((0..pose.len()).all(|v| !fixed(v) || pose[v] == mesh.positions[v]), "{name}");
        for v in part.handles()[0].vertices.iter().map(|v| v as usize) {
            assert_eq!(pose[v], goals.transforms[0].apply(mesh.positions[v]), "{name}");
        }
    }
}

/// The pose is the only state: what was solved before does not matter.
#[test]
fn a_solve_depends_on_the_pose_alone() {
    let (_, mesh) = meshes().remove(0);
    let region = ends(&mesh, false);
    let levels = Levels::new(&mesh, &Silent).expect("valid");
    let mut used = levels.prepare(&Method::default(), &mesh, &region).expect("valid");
    let mut elsewhere = mesh.positions.clone();
    used.solve(&goals(&mesh, &region, -60.0), &mut elsewhere).expect("valid");
    let mut fresh = levels.prepare(&Method::default(), &mesh, &region).expect("valid");
    let (mut a, mut b) = (mesh.positions.clone(), mesh.positions.clone());
    for degrees in [50.0, 50.5, 20.0] {
        used.solve(&goals(&mesh, &region, degrees), &mut a).expect("valid");
        fresh.solve(&goals(&mesh, &region, degrees), &mut b).expect("valid");
        assert!(a == b, "{degrees}");
    }
}

#[test]
fn what_is_wrong_with_goals_or_pose_is_said() {
    let (_, mesh) = meshes().remove(0);
    let region = ends(&mesh, false);
    let mut start =
        Levels::new(&mesh, &Silent).expect("valid").prepare(&Method::default(), &mesh, &region).expect("valid");
    let mut pose = mesh.positions.clone();
    assert!(start.solve(&Goals::identity(1), &mut pose).is_err());
    assert!(start.solve(&region.identity_goals(), &mut pose[1..]).is_err());
    pose[7].x = f64::NAN;
    assert!(start.solve(&goals(&mesh, &region, 40.0), &mut pose).is_err());
}

#[test]
fn handles_go_to_coarser_meshes() {
    let (_, mesh) = meshes().remove(0);
    let made = simplify(&mesh, &CageSize::Fraction(0.1).into(), &Silent).expect("valid");
    let region = ends(&mesh, false);
    let carried = carry_region(&region, &made.origin, &mesh.positions, &made.mesh.positions).expect("room");
    for (role, &v) in carried.region.roles().iter().zip(&made.origin) {
        assert_eq!(*role, region.roles()[v as usize]);
    }
    assert_eq!(carried.stand_ins, Vec::<usize>::new());

    // A handle of one vertex that the cage lacks gets the nearest one that is free.
    let lost = (0..mesh.vertex_count() as u32).find(|v| !made.origin.contains(v)).expect("most are lost");
    let single = Handle::hard(VertexSet::from_iter([lost]));
    let region = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &[single]).expect("valid");
    let carried = carry_region(&region, &made.origin, &mesh.positions, &made.mesh.positions).expect("room");
    assert_eq!(carried.stand_ins, [0]);
    let holder = carried.region.handles()[0].vertices.iter().next().expect("one") as usize;
    let distance = |j: usize| made.mesh.positions[j].distance(mesh.positions[lost as usize]);
    assert!((0..made.origin.len()).all(|j| distance(j) >= distance(holder)));
    // None is left for the second of two on a mesh of one vertex.
    let two = [0, 1].map(|v| Handle::hard(VertexSet::from_iter([v])));
    let region = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &two).expect("valid");
    let refused = carry_region(&region, &[5], &mesh.positions, &mesh.positions[5..6]);
    assert_eq!(refused, Err(NoRoom::Handle(1)));
}
