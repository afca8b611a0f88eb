//! Handles exactly on their goals, the difference fading into the surroundings.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use pliant_mesh::Topology;

/// What a vertex near a handle takes over of what the handle's vertices are moved by.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fade {
    /// The vertices that are set, in the order of their targets.
    sources: Vec<u32>,
    /// Vertex, place of its nearest source, and its share of the source's displacement, 0 to 1.
    followers: Vec<(u32, u32, f64)>,
    moved: Vec<DVec3>,
}

impl Fade {
    /// Followers of `sources` (no vertex twice) up to `radius` along edges, among the vertices that `may_move`.
    ///
    /// Shares fall smoothly from 1 at a source to 0 at the radius. Costs `O(k log k)` for the `k` vertices reached.
    pub(crate) fn new(
        topology: &Topology,
        positions: &[DVec3],
        sources: Vec<u32>,
        radius: f64,
        may_move: impl Fn(u32) -> bool,
    ) -> Self {
        // Non-negative floats order like their bits; ties go to the lower vertex.
        let mut nearest = vec![(f64::INFINITY, u32::MAX); positions.len()];
        let mut heap = BinaryHeap::new();
        for (place, &v) in (0..).zip(&sources) {
            nearest[v as usize] = (0.0, place);
            heap.push(Reverse((0u64, v)));
        }
        let mut followers = Vec::new();
        while let Some(Reverse((bits, v))) = heap.pop() {
            let (here, place) = nearest[v as usize];
            if f64::from_bits(bits) > here {
                continue;
            }
            if here > 0.0 {
                let t = 1.0 - here / radius;
                followers.push((v, place, t * t * (3.0 - 2.0 * t)));
            }
            for &w in topology.neighbours(v as usize) {
                let there = here + positions[v as usize].distance(positions[w as usize]);
                if there < radius && there < nearest[w as usize].0 && may_move(w) {
                    nearest[w as usize] = (there, place);
                    heap.push(Reverse((there.to_bits(), w)));
                }
            }
        }
        followers.sort_unstable_by_key(|f| f.0);
        Self { moved: vec![DVec3::ZERO; sources.len()], sources, followers }
    }

    /// Puts the sources on their targets and moves the followers along; returns the largest distance a source was moved.
    pub(crate) fn apply(&mut self, targets: &[DVec3], points: &mut [DVec3]) -> f64 {
        let mut largest: f64 = 0.0;
        for ((&v, target), moved) in self.sources.iter().zip(targets).zip(&mut self.moved) {
            *moved = *target - points[v as usize];
            points[v as usize] = *target;
            largest = largest.max(moved.length_squared());
        }
        for &(v, place, share) in &self.followers {
            points[v as usize] += share * self.moved[place as usize];
        }
        largest.sqrt()
    }
}

/// For each vertex of a region how much of a motion it takes: 1 inside, falling smoothly to 0 at vertices outside, within `width` along
/// edges. Empty if the region is everything.
pub(crate) fn inner_shares(
    topology: &Topology,
    positions: &[DVec3],
    inside: impl Fn(u32) -> bool,
    width: f64,
) -> Vec<f64> {
    let n = positions.len();
    let mut distance: Vec<f64> = (0..n as u32).map(|v| if inside(v) { f64::INFINITY } else { 0.0 }).collect();
    if distance.iter().all(|d| *d > 0.0) {
        return Vec::new();
    }
    let mut heap: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
    let on_border = |v: &u32| !inside(*v) && topology.neighbours(*v as usize).iter().any(|&w| inside(w));
    heap.extend((0..n as u32).filter(on_border).map(|v| Reverse((0, v))));
    while let Some(Reverse((bits, v))) = heap.pop() {
        let here = f64::from_bits(bits);
        if here > distance[v as usize] {
            continue;
        }
        for &w in topology.neighbours(v as usize) {
            let there = here + positions[v as usize].distance(positions[w as usize]);
            if there < width && there < distance[w as usize] {
                distance[w as usize] = there;
                heap.push(Reverse((there.to_bits(), w)));
            }
        }
    }
    let share = |d: f64| {
        let t = (d / width).min(1.0);
        t * t * (3.0 - 2.0 * t)
    };
    distance.into_iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use pliant_mesh::shapes;

    use super::*;

    #[test]
    fn sources_land_and_the_rest_follows_less_with_distance() {
        let grid = shapes::plane_grid(30, 30, 3.0, 3.0).expect("valid");
        let centre = pliant_mesh::select::nearest_vertex(&grid.positions, DVec3::ZERO).expect("vertices");
        let mut fade = Fade::new(grid.topology(), &grid.positions, vec![centre], 0.8, |_| true);
        let mut points = grid.positions.clone();
        let target = points[centre as usize] + DVec3::Z;
        assert_eq!(fade.apply(&[target], &mut points), 1.0);
        assert_eq!(points[centre as usize], target);
        for (p, x) in points.iter().zip(&grid.positions) {
            let (lift, far) = (p.z - x.z, x.distance(grid.positions[centre as usize]));
            assert!((0.0..=1.0).contains(&lift) && (far < 0.8 || lift == 0.0), "{far}: {lift}");
            // Paths along edges are at most sqrt 2 longer here.
            let at = |d: f64| {
                let t = (1.0 - d / 0.8).max(0.0);
                t * t * (3.0 - 2.0 * t)
            };
            assert!(lift <= at(far) + 1e-12 && lift >= at(far * 2f64.sqrt()) - 1e-12);
        }
    }

    #[test]
    fn shares_are_zero_outside_and_one_deep_inside() {
        let grid = shapes::plane_grid(30, 30, 3.0, 3.0).expect("valid");
        let inside = |v: u32| grid.positions[v as usize].x > 0.0;
        let shares = inner_shares(grid.topology(), &grid.positions, inside, 0.5);
        for (v, (share, p)) in (0..).zip(shares.iter().zip(&grid.positions)) {
            assert!(inside(v) == (*share > 0.0) && (p.x < 0.75 || *share == 1.0), "{p}: {share}");
        }
        assert!(inner_shares(grid.topology(), &grid.positions, |_| true, 0.5).is_empty());
    }
}
