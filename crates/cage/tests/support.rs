//! Which cage vertices rows consist of: the nearest ones exactly, and none across a gap.

mod common;

use common::{Pair, horseshoe, pairs};
use pliant_cage::{BindOptions, Binding, CageSize, Prune, Simplified, Support, simplify};
use pliant_mesh::{Silent, TriMesh};

/// Entries below this share of a row's largest weight are dropped.
const TINY: f64 = 5e-3;

fn options(neighbours: usize, support: Support) -> BindOptions {
    BindOptions { prune: Prune::Smooth { neighbours }, support, ..BindOptions::default() }
}

fn bind(shape: &TriMesh, cage: &Simplified, options: &BindOptions) -> Binding {
    cage.bind(shape, options, &Silent).expect("valid")
}

/// The shared search of an owner's vertices against looking at every cage vertex: the same rows, whoever owns whom.
#[test]
fn rows_in_space_are_those_of_the_nearest_vertices() {
    for Pair { name, shape, cage } in pairs() {
        for neighbours in [1, 5, 12, 24, 5000] {
            let own = bind(&shape, &cage, &options(neighbours, Support::Space));
            let nearest =
                Binding::new(&shape, &cage.mesh, &options(neighbours, Support::Space), &Silent).expect("valid");
            for (i, x) in shape.positions.iter().enumerate() {
                let mut near: Vec<(f64, u32)> =
                    (0..).zip(&cage.mesh.positions).map(|(j, y)| (y.distance(*x), j)).collect();
                near.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
                let last = near[near.len().min(neighbours) - 1].0;
                let beyond = near.get(neighbours).map_or(1.1 * last, |n| n.0);
                near.truncate(neighbours);
                let weights: Vec<f64> = near.iter().map(|n| (1.0 - n.0 / beyond).powi(2)).collect();
                let largest = weights.iter().copied().fold(0.0, f64::max);
                // Right at the limit, and where all are equally near, rounding decides.
                if weights.iter().any(|w| (w - TINY * largest).abs() < 1e-9) || largest < 1e-9 {
                    continue;
                }
                let sum: f64 = weights.iter().filter(|w| **w >= TINY * largest).sum();
                let kept = weights.iter().filter(|w| **w >= TINY * largest).count();
                for binding in [&own, &nearest] {
                    let (indices, made) = binding.row(i);
                    assert_eq!(indices.len(), kept, "{name}, {neighbours} neighbours, row {i}");
                    for (&j, &w) in indices.iter().zip(made) {
                        let at = near.iter().position(|n| n.1 == j).expect("one of the nearest");
                        // Distances are computed in another frame, and weights are f32.
                        assert!((f64::from(w) - weights[at] / sum).abs() < 1e-6, "{name}, row {i}");
                    }
                }
            }
        }
    }
}

/// The ends of a horseshoe nearly touch and are far apart along the surface; in space each follows the other.
#[test]
fn limbs_that_touch_do_not_follow_each_other() {
    let shape = horseshoe();
    for share in [0.05, 0.1, 0.3] {
        let cage = simplify(&shape, &CageSize::Fraction(share).into(), &Silent).expect("valid");
        let is_end = |p: glam::DVec3| p.y < 0.0 && p.x.abs() < 0.5;
        let leaks = |support| {
            let binding = bind(&shape, &cage, &options(12, support));
            let followed = |i: usize| binding.row(i).0.iter().map(|&j| cage.mesh.positions[j as usize]);
            let ends = (0..shape.vertex_count()).filter(|&i| is_end(shape.positions[i]));
            ends.filter(|&i| followed(i).any(|y| is_end(y) && y.x * shape.positions[i].x < 0.0)).count()
        };
        assert_eq!(leaks(Support::Surface), 0, "{share}");
        assert_eq!(leaks(Support::Rings), 0, "{share}");
        assert!(leaks(Support::Space) > 20, "{share}");
    }
}

/// Components never follow each other along the surface, smoothing included.
#[test]
fn components_do_not_follow_each_other() {
    let Pair { shape, cage, .. } = pairs().swap_remove(2);
    let half = shape.vertex_count() / 2;
    let component = |j: u32| cage.origin[j as usize] as usize >= half;
    let binding = bind(&shape, &cage, &BindOptions::default());
    for i in 0..shape.vertex_count() {
        assert!(binding.row(i).0.iter().all(|&j| component(j) == (i >= half)), "row {i}");
    }
    for j in 0..cage.mesh.vertex_count() as u32 {
        assert!(binding.smoothing_row(j).0.iter().all(|&k| component(k) == component(j)), "cage vertex {j}");
    }
}

/// Where the way along the surface is nowhere much longer than the straight one, both supports are the same.
#[test]
fn on_round_shapes_both_supports_agree() {
    let Pair { shape, cage, .. } = pairs().swap_remove(0);
    let (surface, space) =
        (bind(&shape, &cage, &options(12, Support::Surface)), bind(&shape, &cage, &options(12, Support::Space)));
    assert!((0..shape.vertex_count()).all(|i| surface.row(i) == space.row(i)));
}

/// The most that the rows of an edge's two ends differ, by the sum of magnitudes.
fn largest_change(shape: &TriMesh, cage: &Simplified, options: &BindOptions) -> f64 {
    let binding = bind(shape, cage, options);
    let mut dense = vec![0.0; cage.mesh.vertex_count()];
    let mut add = |i: u32, sign: f64| {
        let (indices, weights) = binding.row(i as usize);
        for (&j, &w) in indices.iter().zip(weights) {
            dense[j as usize] += sign * f64::from(w);
        }
        dense.iter().map(|w| w.abs()).sum::<f64>()
    };
    let change = |&[a, b]: &[u32; 2]| {
        add(a, 1.0);
        let change = add(b, -1.0);
        add(a, -1.0);
        add(b, 1.0);
        change
    };
    shape.topology().edges().iter().map(change).fold(0.0, f64::max)
}

/// Rows change little from a vertex to its neighbour, also where trust fades: what jumps is an edge error. In space, where rows
/// are a continuous function of the point, the most that any edge's rows differ is what the spacing of the vertices makes.
#[test]
fn rows_change_as_smoothly_along_the_surface_as_in_space() {
    for Pair { name, shape, cage } in pairs() {
        let [surface, space] =
            [Support::Surface, Support::Space].map(|support| largest_change(&shape, &cage, &options(12, support)));
        assert!(surface < 1.25 * space, "{name}: {surface} along the surface, {space} in space");
    }
}

/// So do short rows from rings of vertices, on a cage nearly as dense as the shape.
#[test]
fn short_rows_of_rings_change_as_smoothly() {
    for Pair { name, shape, .. } in pairs() {
        let cage = simplify(&shape, &CageSize::Fraction(0.25).into(), &Silent).expect("valid");
        let [rings, space] =
            [Support::Rings, Support::Space].map(|support| largest_change(&shape, &cage, &options(6, support)));
        assert!(rings < 1.25 * space, "{name}: {rings} from rings, {space} in space");
    }
}

/// A fan round one vertex has all of its vertices within two edges of each: too many to list, and still bound in no time.
#[test]
fn a_fan_of_many_faces_is_bound_by_rings() {
    let rim = 20_000u32;
    let angle = |k: u32| std::f64::consts::TAU * f64::from(k) / f64::from(rim);
    let mut positions = vec![glam::DVec3::Z];
    positions.extend((0..rim).map(|k| glam::DVec3::new(angle(k).cos(), angle(k).sin(), 0.0)));
    let triangles = (0..rim).map(|k| [0, 1 + k, 1 + (k + 1) % rim]).collect();
    let fan = TriMesh::new(positions, triangles).expect("valid");
    let binding = Binding::new(&fan, &fan, &options(6, Support::Rings), &Silent).expect("valid");
    for i in 0..fan.vertex_count() {
        let (indices, weights) = binding.row(i);
        // A vertex that is one of the cage follows itself most.
        assert_eq!(indices[0] as usize, i);
        assert!(weights.iter().all(|w| *w > 0.0) && indices.len() <= 6, "row {i}");
    }
}
