use super::*;
use crate::select::{border_loops, in_half_space, nearest_vertex, piece_at};
use crate::{TriMesh, shapes};

/// A cactus whose +x arm comes out of the stem at y = 0.85 and ends upwards at (0.7, 1.65, 0).
fn cactus() -> TriMesh {
    shapes::cactus(6000).expect("in range")
}

fn at(mesh: &TriMesh, x: f64, y: f64, z: f64) -> u32 {
    nearest_vertex(&mesh.positions, DVec3::new(x, y, z)).expect("not empty")
}

fn fill(mesh: &TriMesh, first: u32, last: u32, limit: FillLimit) -> WaterFill {
    water_fill(mesh.topology(), &mesh.positions, first, last, limit).expect("two vertices")
}

/// The paper's words, step by step and slowly: take neighbours of what is found until nothing changes, but go on only from vertices on the
/// near side of the plane, and take none beyond it.
fn by_definition(mesh: &TriMesh, first: u32, last: u32) -> VertexSet {
    let [from, to] = [first, last].map(|v| mesh.positions[v as usize]);
    let height = |v: u32| (mesh.positions[v as usize] - to).dot((to - from).normalize());
    let mut found = vec![false; mesh.vertex_count()];
    found[first as usize] = true;
    loop {
        let mut changed = false;
        for &[a, b] in mesh.topology().edges() {
            for (a, b) in [(a, b), (b, a)] {
                let steps = found[a as usize] && !found[b as usize] && height(a) < -1e-14 && height(b) <= 1e-14;
                found[b as usize] |= steps;
                changed |= steps;
            }
        }
        if !changed {
            return VertexSet::where_true(found.len(), |v| found[v as usize]);
        }
    }
}

/// On limbs of the creature and arms of the cactus: the region of the definition, within the right part of space, closed by one curve
/// round the limb near which its border runs.
#[test]
fn limbs_are_filled_up_to_their_cut() {
    let creature = shapes::creature(10_000).expect("in range");
    let cactus = cactus();
    let leg = (at(&creature, 0.28, 0.06, 0.3), at(&creature, 0.22, 0.3, 0.14));
    let arm = (at(&creature, 0.86, 0.985, 0.25), at(&creature, 0.45, 0.96, 0.06));
    let tail = (at(&creature, 0.26, 0.56, -1.2), at(&creature, 0.0, 0.45, -0.57));
    let left = (at(&cactus, 0.7, 1.66, 0.0), at(&cactus, 0.84, 1.3, 0.0));
    let right = (at(&cactus, -0.63, 1.9, 0.0), at(&cactus, -0.5, 1.5, 0.0));
    type Within = fn(DVec3) -> bool;
    let cases: [(&TriMesh, (u32, u32), Within); 5] = [
        (&creature, leg, |p| p.x > 0.05 && p.y < 0.45),
        (&creature, arm, |p| p.x > 0.4 && p.y > 0.8),
        (&creature, tail, |p| p.z < -0.4 && p.y < 0.8),
        (&cactus, left, |p| p.x > 0.4),
        (&cactus, right, |p| p.x < -0.4),
    ];
    for (mesh, (first, last), within) in cases {
        for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
            let filled = fill(mesh, first, last, limit);
            assert_eq!(filled.region, by_definition(mesh, first, last));
            assert_eq!(filled.closure, Closure::Cap);
            assert!(!filled.closure.leaked() && filled.region.contains(first) && filled.region.contains(last));
            let astray = filled.region.iter().map(|v| mesh.positions[v as usize]).find(|&p| !within(p));
            assert!(filled.region.len() > 50 && astray.is_none(), "{} vertices, {astray:?}", filled.region.len());
            assert_eq!(border_loops(mesh.topology(), &filled.region).expect("vertices").len(), 1);
            let [curve] = &filled.curves[..] else { panic!("{} curves", filled.curves.len()) };
            assert!(curve.closed && curve.distance(mesh.positions[last as usize]) == 0.0);
        }
    }
}

/// A limb cut across a cylinder: exactly its rings on one side of the plane, the ring on the plane included.
#[test]
fn a_cylinder_is_filled_ring_by_ring() {
    let cylinder = shapes::cylinder(0.5, 4.0, 24, 20, 3).expect("valid size");
    let top = at(&cylinder, 0.0, 2.0, 0.0);
    // The line from the top's middle is aslant, so the plane is too.
    let last = at(&cylinder, 0.5, 0.4, 0.0);
    let filled = fill(&cylinder, top, last, FillLimit::Plane);
    let [p, q] = [top, last].map(|v| cylinder.positions[v as usize]);
    assert_eq!(filled.region, in_half_space(&cylinder.positions, q + (q - p) * 1e-12, p - q));
    // The ellipse of a plane whose normal is tilted by atan(0.5 / 1.6) has area pi r^2 / cos; 24 corners cut off 1.2 %.
    let ellipse = std::f64::consts::PI * 0.25 * (1.6_f64.powi(2) + 0.25).sqrt() / 1.6;
    assert!((filled.curves[0].area() / ellipse - 1.0).abs() < 0.015);
    // On a wall of vertices right above each other the plane lies in a ring.
    let wall = shapes::bar(4, 4, 10, DVec3::new(1.0, 1.0, 5.0)).expect("valid size");
    let [first, last] = [2.5, 0.5].map(|z| at(&wall, 0.5, 0.5, z));
    let filled = fill(&wall, first, last, FillLimit::Plane);
    assert_eq!(filled.region, VertexSet::where_true(wall.vertex_count(), |v| wall.positions[v as usize].z > 0.49));
    assert!((filled.curves[0].area() - 1.0).abs() < 1e-12 && filled.closure == Closure::Cap);
}

/// A walking stick: its tip hangs beside the shaft, lower than the last vertex, so the plane cuts both. Luo's flood from
/// the tip stops at the first cut; the one that only the cut at the last vertex stops goes round the crook and comes to
/// it from beyond.
#[test]
fn a_bent_limb_is_filled_up_to_the_cut_at_its_root() {
    let (tip, turn, shaft) = (3.0, 0.6 * std::f64::consts::PI, 6.0);
    let bar = shapes::bar(120, 4, 4, DVec3::new(tip + turn + shaft, 0.3, 0.3)).expect("valid size");
    let start = bar.bounds().min.x;
    let along: Vec<f64> = bar.positions.iter().map(|p| p.x - start).collect();
    let bend = |(p, &s): (&DVec3, &f64)| {
        let out = 0.6 + p.y;
        let angle = (s - tip).clamp(0.0, turn) / 0.6;
        let down = (tip - s).max(0.0) + (s - tip - turn).max(0.0);
        DVec3::new(-out * angle.cos(), out * angle.sin() - down, p.z)
    };
    let stick = bar.with_positions(bar.positions.iter().zip(&along).map(bend).collect()).expect("finite");
    let (first, last) = (at(&stick, -0.6, -3.0, 0.0), at(&stick, 0.75, -0.5, 0.0));
    let plain = fill(&stick, first, last, FillLimit::Plane);
    assert_eq!(plain.region, by_definition(&stick, first, last));
    assert!(plain.region.iter().all(|v| along[v as usize] < tip + 0.5 * turn));
    let whole = fill(&stick, first, last, FillLimit::NearestCurves);
    let [p, q] = [first, last].map(|v| stick.positions[v as usize]);
    let beyond = in_half_space(&stick.positions, q, q - p);
    assert_eq!(
        whole.region,
        VertexSet::where_true(along.len(), |v| along[v as usize] < tip + 0.5 * turn).union(&beyond)
    );
    for filled in [plain, whole] {
        assert_eq!((filled.curves.len(), filled.closure), (1, Closure::Cap));
    }
}

/// A torus is not parted by one of the two circles in which a plane cuts it: both are needed.
#[test]
fn a_handle_is_cut_at_both_ends() {
    let torus = shapes::torus(1.0, 0.3, 64, 24).expect("valid radii");
    let (first, last) = (at(&torus, 0.7, 0.0, 0.2), at(&torus, 0.7, 0.0, -0.2));
    for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
        let filled = fill(&torus, first, last, limit);
        assert_eq!((filled.curves.len(), filled.closure), (2, Closure::Band { curves: 2 }));
        assert_eq!(filled.region, by_definition(&torus, first, last));
        assert_eq!(border_loops(torus.topology(), &filled.region).expect("vertices").len(), 2);
    }
}

/// Part 0 is joined to part 1 by the curves 0 and 2, a handle, and to a limb, part 2, by curve 1. Curve 2 is needed to part 0 from 1; curve
/// 1, though nearer, is not.
#[test]
fn no_more_curves_cut_than_needed() {
    let point = |x: f64| PlaneCurve { points: vec![DVec3::new(x, 0.0, 0.0)], closed: true, edges: vec![0] };
    let door = |a, b| Door { between: [a, b], only_touches: false };
    let parts = Parts { of_vertex: vec![], doors: vec![door(0, 1), door(0, 2), door(0, 1)], count: 3 };
    for (places, stops) in [([1.0, 2.0, 3.0], [true, false, true]), ([2.0, 1.0, 3.0], [false, true, false])] {
        let curves = places.map(point);
        assert_eq!(parts.nearest_stops(0, &curves, DVec3::ZERO), stops);
        assert_eq!(parts.nearest_stops(1, &curves, DVec3::ZERO), stops);
    }
}

/// Seen from the creature's belly, a plane at one knee meets both legs: Luo's rule cuts both off, the nearest curve only one.
#[test]
fn of_two_limbs_in_the_plane_the_picked_one_is_cut() {
    let creature = shapes::creature(10_000).expect("in range");
    let first = at(&creature, 0.235, 0.75, 0.2);
    let last = at(&creature, 0.235, 0.28, 0.16);
    let both = fill(&creature, first, last, FillLimit::Plane);
    let one = fill(&creature, first, last, FillLimit::NearestCurves);
    assert_eq!(both.region, by_definition(&creature, first, last));
    assert!(matches!(both.closure, Closure::Band { curves } if curves >= 2), "{:?}", both.closure);
    assert_eq!((one.closure, one.curves.len()), (Closure::Cap, 1));
    let [left, right] = [0.28, -0.28].map(|x| at(&creature, x, 0.05, 0.3));
    assert!(!both.region.contains(left) && !both.region.contains(right));
    assert!(!one.region.contains(left) && one.region.contains(right));
    assert!(both.region.difference(&one.region).is_empty());
    // The rest is one piece: the lower leg.
    let rest = one.region.inverted(creature.vertex_count());
    assert_eq!(piece_at(creature.topology(), &rest, left), Ok(rest));
}

/// A closed curve parts a surface of genus 0, so there one cut is always enough; and fewer cuts never make a region smaller.
#[test]
fn one_cut_is_enough_without_handles() {
    let creature = shapes::creature(3000).expect("in range");
    let n = creature.vertex_count() as u32;
    let mut curves = 0;
    for (first, last) in (0..60).map(|i| (i * 7919 % n, i * 104_729 % n)).filter(|(a, b)| a != b) {
        let plain = fill(&creature, first, last, FillLimit::Plane);
        let one = fill(&creature, first, last, FillLimit::NearestCurves);
        assert_eq!(plain.region, by_definition(&creature, first, last));
        assert!(one.curves.len() <= 1 && matches!(one.closure, Closure::Cap | Closure::Everything));
        assert!(plain.region.difference(&one.region).is_empty());
        curves = plain.curves.len().max(curves);
    }
    assert!(curves > 2, "no plane cut more than {curves} curves");
}

/// A sleeve is open at the near end; a grid is open all round; and a plane through the farthest vertex stops nothing.
#[test]
fn leaks_are_told() {
    let cylinder = shapes::cylinder(0.5, 4.0, 24, 20, 3).expect("valid size");
    let wall = |t: &&[u32; 3]| t.iter().any(|&v| cylinder.positions[v as usize].y < 1.99);
    let sleeve: Vec<[u32; 3]> = cylinder.triangles().iter().filter(wall).copied().collect();
    let sleeve = TriMesh::new(cylinder.positions.clone(), sleeve).expect("a soup");
    let (first, last) = (at(&sleeve, 0.5, 1.8, 0.0), at(&sleeve, 0.5, 0.4, 0.0));
    for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
        let filled = fill(&sleeve, first, last, limit);
        assert_eq!(filled.closure, Closure::OpenBorder { edges: 24 });
        assert_eq!(filled.region, by_definition(&sleeve, first, last));
        assert_eq!(fill(&sleeve, last, first, limit).closure, Closure::Cap);
    }
    let grid = shapes::plane_grid(10, 10, 1.0, 1.0).expect("valid size");
    let strip = fill(&grid, 5 * 11, 5 * 11 + 4, FillLimit::NearestCurves);
    assert_eq!(strip.region, VertexSet::where_true(121, |v| v % 11 <= 4));
    assert_eq!(strip.closure, Closure::OpenBorder { edges: 10 + 2 * 5 });
    let sphere = shapes::icosphere(4);
    let (south, north) = (at(&sphere, 0.0, -1.0, 0.0), at(&sphere, 0.0, 1.0, 0.0));
    for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
        let all = fill(&sphere, south, north, limit);
        assert_eq!((all.region.len(), all.closure), (sphere.vertex_count(), Closure::Everything));
        assert!(all.curves.is_empty());
    }
}

/// A vertex of another body as the last pick: the plane still counts, other bodies never do.
#[test]
fn only_the_surface_of_the_first_vertex_is_flooded() {
    let sphere = shapes::icosphere(3);
    let n = sphere.vertex_count() as u32;
    let mut positions = sphere.positions.clone();
    positions.extend(sphere.positions.iter().map(|p| *p + DVec3::new(1.5, 0.0, 0.0)));
    let triangles = sphere.triangles().iter().flat_map(|t| [*t, t.map(|v| v + n)]).collect();
    let pair = TriMesh::new(positions, triangles).expect("two spheres");
    let first = at(&sphere, -1.0, 0.0, 0.0);
    let last = n + at(&sphere, -1.0, 0.0, 0.0);
    for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
        let filled = fill(&pair, first, last, limit);
        assert_eq!(filled.region, by_definition(&pair, first, last));
        assert!(filled.region.iter().all(|v| v < n) && filled.closure == Closure::Cap);
    }
}

#[test]
fn bad_picks_are_refused() {
    let sphere = shapes::icosphere(1);
    let ask = |first, last| water_fill(sphere.topology(), &sphere.positions, first, last, FillLimit::Plane);
    for (first, last) in [(42, 0), (0, 42), (7, 7), (u32::MAX, u32::MAX)] {
        assert!(matches!(ask(first, last), Err(MeshError::BadParameter { .. })), "{first}, {last}");
    }
    let short = water_fill(sphere.topology(), &sphere.positions[1..], 0, 1, FillLimit::Plane);
    assert_eq!(short, Err(MeshError::PositionCount { expected: 42, found: 41 }));
    // Coordinates that are not finite, which a mesh would refuse, panic nowhere.
    let nan = vec![DVec3::NAN; 42];
    assert!(water_fill(sphere.topology(), &nan, 0, 1, FillLimit::NearestCurves).is_err());
    let mut one = sphere.positions.clone();
    one[9] = DVec3::splat(f64::INFINITY);
    assert!(water_fill(sphere.topology(), &one, 0, 1, FillLimit::NearestCurves).is_ok());
}
