//! Another region for a prepared deformer: the same bits as preparing anew, and nothing changed where it is refused.

mod common;

use common::{along_x, bar, distance, pyramid, sheet, torus, variants};
use glam::DVec3;
use pliant_deform::arap::{Arap, ArapOptions, EdgeWeightKind};
use pliant_deform::{DeformError, Deformer, Goals, Handle, Region, Role};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

/// Knuth's 64-bit linear congruential generator: the high bits as a number in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() * n as f64) as usize
    }
}

fn shapes() -> Vec<(&'static str, TriMesh)> {
    let scaled = |mesh: TriMesh, scale: f64| {
        let positions = mesh.positions.iter().map(|p| *p * scale).collect();
        mesh.with_positions(positions).expect("finite")
    };
    // Two components, of which handles may leave one alone.
    let (one, other) = (bar(2), torus(12, 6));
    let mut positions = one.positions.clone();
    positions.extend(other.positions.iter().map(|p| *p + DVec3::new(2.0, 3.0, 0.0)));
    let n = one.vertex_count() as u32;
    let triangles = one.triangles().iter().copied().chain(other.triangles().iter().map(|t| t.map(|v| v + n)));
    let two = TriMesh::new(positions, triangles.collect()).expect("valid");
    vec![
        ("pyramid", pyramid()),
        ("sheet", sheet(16, 8)),
        ("small torus", scaled(torus(24, 10), 1e-6)),
        ("large bar", scaled(bar(4), 1e6)),
        ("bar and torus", two),
        // Large enough for dense blocks inside the factorisation.
        ("fine torus", torus(70, 40)),
    ]
}

/// With a tolerance, so that energies are compared too.
fn watched() -> impl Iterator<Item = ArapOptions> {
    variants().into_iter().map(|options| ArapOptions { tolerance: Some(1e-3), ..options })
}

/// Slabs along x, each hard, soft, free or, in one case of three, fixed.
fn any_region(mesh: &TriMesh, random: &mut Random) -> Region {
    let n = mesh.vertex_count();
    loop {
        let slabs = 2 + random.below(5);
        let whole = random.below(3) > 0;
        let (mut roi, mut handles) = (Vec::new(), Vec::new());
        for k in 0..slabs {
            let at = |k: usize| k as f64 / slabs as f64;
            let slab = along_x(mesh, at(k)..=at(k + 1) - if k + 1 == slabs { 0.0 } else { 1e-9 });
            let kind = random.below(if whole { 3 } else { 4 });
            if kind < 3 {
                roi.extend(slab.iter());
            }
            match kind {
                _ if slab.is_empty() => {}
                0 => handles.push(Handle::hard(slab)),
                1 => handles.push(Handle::soft(slab, 10f64.powf(8.0 * random.next() - 4.0))),
                _ => {}
            }
        }
        if let Ok(region) = Region::new(n, &VertexSet::from_iter(roi), &handles) {
            return region.without_unconstrained(mesh.topology()).0;
        }
    }
}

fn any_goals(mesh: &TriMesh, region: &Region, random: &mut Random) -> Goals {
    let (centre, size) = (mesh.bounds().centre(), mesh.bounds().diagonal());
    let goal = |_: &Handle| {
        let axis = DVec3::new(random.next() - 0.5, random.next() - 0.5, random.next());
        let mut goal = Similarity::about(centre, axis, random.next() - 0.5, 0.8 + 0.4 * random.next());
        goal.translation += 0.2 * size * DVec3::new(random.next(), random.next(), random.next());
        goal
    };
    Goals::new(region.handles().iter().map(goal).collect())
}

#[test]
fn another_region_is_as_good_as_a_fresh_deformer() {
    let mut random = Random(1);
    let mut same_roi = 0;
    for (name, mesh) in shapes() {
        for options in watched() {
            let mut before = any_region(&mesh, &mut random);
            let mut kept = Arap::prepare(&options, &mesh, &before).expect("valid");
            let mut pose = mesh.positions.clone();
            for step in 0..12 {
                let region = any_region(&mesh, &mut random);
                let fixed = |region: &Region| region.roles().iter().map(|r| *r == Role::Fixed).collect::<Vec<_>>();
                same_roi += usize::from(fixed(&region) == fixed(&before));
                let report = kept.set_region(&region).expect("valid");
                let mut fresh = Arap::prepare(&options, &mesh, &region).expect("valid");
                assert_eq!(report, fresh.prepared());
                let mut expected = pose.clone();
                for _ in 0..2 {
                    let goals = any_goals(&mesh, &region, &mut random);
                    let report = kept.solve(&goals, &mut pose).expect("solvable");
                    assert_eq!(report, fresh.solve(&goals, &mut expected).expect("solvable"), "{name}, step {step}");
                    assert!(pose == expected, "{name}, {options:?}, step {step}");
                    let energies = [&mut kept, &mut fresh].map(|arap| arap.energy(&goals, &pose).expect("valid"));
                    assert_eq!(energies[0].to_bits(), energies[1].to_bits());
                }
                before = region;
            }
        }
    }
    assert!(same_roi > 30, "the cheap way was hardly taken: {same_roi}");
}

/// One handle through all it can be, and back: the last solution is the first.
#[test]
fn a_handle_may_become_soft_free_and_hard_again() {
    for (name, mesh) in shapes() {
        let n = mesh.vertex_count();
        let anchor = Handle::hard(along_x(&mesh, 0.0..=0.2));
        let tip = along_x(&mesh, 0.85..=1.0);
        let with = |handle: Option<Handle>| {
            let handles: Vec<Handle> = std::iter::once(anchor.clone()).chain(handle).collect();
            let region = Region::new(n, &VertexSet::all(n), &handles).expect("valid");
            region.without_unconstrained(mesh.topology()).0
        };
        let roles = [
            Some(Handle::hard(tip.clone())),
            Some(Handle::soft(tip.clone(), 1e6)),
            Some(Handle::soft(tip.clone(), 1e-3)),
            None,
            Some(Handle::hard(tip.clone())),
        ];
        let lift = Similarity::translation(0.3 * mesh.bounds().diagonal() * DVec3::Y);
        let mut kept = Arap::prepare(&ArapOptions::default(), &mesh, &with(roles[0].clone())).expect("valid");
        let solutions = roles.map(|role| {
            let region = with(role);
            kept.set_region(&region).expect("valid");
            let mut goals = Goals::new(vec![Similarity::IDENTITY, lift]);
            goals.transforms.truncate(region.handles().len());
            let mut pose = mesh.positions.clone();
            kept.solve(&goals, &mut pose).expect("solvable");
            pose
        });
        assert!(solutions[0] == solutions[4], "{name}");
        let gap = |k: usize| {
            let rest = &mesh.positions;
            let off = |v: u32| lift.apply(rest[v as usize]).distance(solutions[k][v as usize]);
            tip.iter().map(off).fold(0.0, f64::max) / mesh.bounds().diagonal()
        };
        let gaps = [0, 1, 2, 3].map(gap);
        assert!(gaps[0] == 0.0 && gaps[1] < 1e-3 && gaps[1] < gaps[2] && gaps[2] < gaps[3] + 1e-9, "{name}: {gaps:?}");
        // Without the handle, at rest.
        assert!(distance(&solutions[3], &mesh.positions) < 1e-11 * mesh.bounds().diagonal(), "{name}");
    }
}

/// A triangle with all corners on one line is stiff, and a weak spring from each of them is lost in rounding.
#[test]
fn a_region_that_is_refused_changes_nothing() {
    let one = sheet(60, 40);
    let corner = one.vertex_count() as u32;
    let mut positions = one.positions.clone();
    positions.extend([DVec3::ZERO, DVec3::X, DVec3::new(0.5, 1e-12, 0.0)]);
    let triangles = one.triangles().iter().copied().chain([[corner, corner + 1, corner + 2]]).collect();
    let mesh = TriMesh::new(positions, triangles).expect("valid");
    let n = mesh.vertex_count();
    let (all, needle) = (VertexSet::all(n), VertexSet::from_iter(corner..corner + 3));
    let ends = [0.0..=0.1, 0.9..=1.0].map(|range| Handle::hard(along_x(&one, range)));
    let weak = Handle::soft(needle.clone(), 1e-10);
    // The needle hangs on the second handle.
    let second = Handle::hard(ends[1].vertices.iter().chain([corner]).collect());
    let good = Region::new(n, &all, &[ends[0].clone(), second]).expect("valid");
    let singular = Region::new(n, &all, &[ends[0].clone(), weak]).expect("valid");
    let elsewhere = Region::new(n, &VertexSet::where_true(n, |v| !needle.contains(v)), &ends).expect("valid");
    let foreign = Region::new(n + 1, &all, &ends).expect("valid");

    let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::new(0.0, 0.2, 0.4))]);
    for options in watched() {
        // The second has to prepare everything for the region that is refused, not only to refactor.
        for before in [&good, &elsewhere] {
            let mut arap = Arap::prepare(&options, &mesh, before).expect("valid");
            let solve = |arap: &mut Arap| {
                let mut pose = mesh.positions.clone();
                let report = arap.solve(&goals, &mut pose).expect("solvable");
                (pose, report, arap.prepared())
            };
            let expected = solve(&mut arap);
            let error = arap.set_region(&foreign).expect_err("another mesh");
            assert_eq!(error, DeformError::WrongCount { what: "vertices of the region", expected: n, found: n + 1 });
            assert!(solve(&mut arap) == expected);
            if options.weights == EdgeWeightKind::Cotangent {
                let error = arap.set_region(&singular).expect_err("nothing is left of the spring");
                assert!(matches!(error, DeformError::Singular { vertex } if needle.contains(vertex)), "{error}");
                assert!(solve(&mut arap) == expected, "{options:?}");
            } else {
                arap.set_region(&singular).expect("stiff enough beside weights of 1");
            }
        }
    }
}
