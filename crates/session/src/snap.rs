//! Handles exactly on their goals, the difference fading into the surroundings.

use std::ops::{ControlFlow, Range};

use glam::{DVec3, Vec3};
use pliant_mesh::Topology;
use pliant_mesh::ranges::widen;
use pliant_mesh::select::EdgeWalk;

/// A position in the precision it is stored in; what is computed with it is in double precision.
pub(crate) trait Place: Copy + PartialEq + Send + Sync {
    fn double(self) -> DVec3;

    fn rounded(place: DVec3) -> Self;
}

impl Place for DVec3 {
    fn double(self) -> DVec3 {
        self
    }

    fn rounded(place: DVec3) -> Self {
        place
    }
}

impl Place for Vec3 {
    fn double(self) -> DVec3 {
        self.as_dvec3()
    }

    fn rounded(place: DVec3) -> Self {
        place.as_vec3()
    }
}

/// What a vertex near a handle takes over of what the handle's vertices are moved by.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fade {
    /// The vertices that are set, in the order of their targets.
    pub(crate) sources: Vec<u32>,
    /// Vertex, place of its nearest source, and its share of the source's displacement, 0 to 1.
    followers: Vec<(u32, u32, f64)>,
    /// For each source, itself and its followers, from the first to the last.
    pub(crate) reach: Vec<Range<usize>>,
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
        let mut followers = Vec::new();
        let mut reach: Vec<Range<usize>> = sources.iter().map(|&v| v as usize..v as usize + 1).collect();
        let mut walk = EdgeWalk::new(positions.len());
        walk.visit(topology, positions, sources.iter().copied(), radius, may_move, |v, distance, place| {
            if sources[place as usize] != v {
                followers.push((v, place, smooth_step(1.0 - distance / radius)));
                widen(&mut reach[place as usize], &(v as usize..v as usize + 1));
            }
            ControlFlow::Continue(())
        });
        followers.sort_unstable_by_key(|f| f.0);
        Self { sources, followers, reach }
    }

    /// Puts the sources on their targets and moves the followers along; returns the largest distance a source was moved. `moved` is memory
    /// that is kept.
    pub(crate) fn apply<P: Place>(&self, targets: &[DVec3], moved: &mut Vec<DVec3>, points: &mut [P]) -> f64 {
        let mut largest: f64 = 0.0;
        moved.clear();
        for (&v, target) in self.sources.iter().zip(targets) {
            let (before, after) = (points[v as usize], P::rounded(*target));
            points[v as usize] = after;
            // What rounding alone leaves moves no follower.
            let step = if before == after { DVec3::ZERO } else { *target - before.double() };
            largest = largest.max(step.length_squared());
            moved.push(step);
        }
        for &(v, place, share) in &self.followers {
            let point = &mut points[v as usize];
            *point = P::rounded(point.double() + share * moved[place as usize]);
        }
        largest.sqrt()
    }
}

/// From 0 to 1 as `t` does, level at both ends; 1 beyond.
fn smooth_step(t: f64) -> f64 {
    let t = t.min(1.0);
    t * t * (3.0 - 2.0 * t)
}

/// For each vertex of a region how much of a motion it takes: 1 inside, falling smoothly to 0 at vertices outside, within `width` along
/// edges. Empty if the region is everything.
pub(crate) fn inner_shares(
    topology: &Topology,
    positions: &[DVec3],
    inside: impl Fn(u32) -> bool,
    width: f64,
) -> Vec<f64> {
    let n = positions.len() as u32;
    let mut shares: Vec<f64> = (0..n).map(|v| f64::from(u8::from(inside(v)))).collect();
    let on_border = |v: &u32| !inside(*v) && topology.neighbours(*v as usize).iter().any(|&w| inside(w));
    let mut outside = (0..n).filter(|v| !inside(*v)).peekable();
    if outside.peek().is_none() {
        return Vec::new();
    }
    let mut walk = EdgeWalk::new(positions.len());
    walk.visit(topology, positions, outside.filter(on_border), width, &inside, |v, distance, _| {
        shares[v as usize] = smooth_step(distance / width);
        ControlFlow::Continue(())
    });
    shares
}

#[cfg(test)]
mod tests {
    use pliant_mesh::shapes;

    use super::*;

    #[test]
    fn sources_land_and_the_rest_follows_less_with_distance() {
        let grid = shapes::plane_grid(30, 30, 3.0, 3.0).expect("valid");
        let centre = pliant_mesh::select::nearest_vertex(&grid.positions, DVec3::ZERO).expect("vertices");
        let fade = Fade::new(grid.topology(), &grid.positions, vec![centre], 0.8, |_| true);
        let mut points = grid.positions.clone();
        let target = points[centre as usize] + DVec3::Z;
        assert_eq!(fade.apply(&[target], &mut Vec::new(), &mut points), 1.0);
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
