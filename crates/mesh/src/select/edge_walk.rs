use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::ControlFlow;

use glam::DVec3;

use crate::Topology;

/// Shortest ways along edges (Dijkstra), in memory kept from walk to walk.
///
/// Ways along edges are longer than true geodesics, by about a tenth on an even mesh.
#[derive(Debug, Clone)]
pub struct EdgeWalk {
    reached: Vec<Reached>,
    /// Number of the last walk, from 1.
    walk: u32,
    heap: BinaryHeap<Reverse<(u64, u32)>>,
}

/// How a vertex was reached by the walk that did so last.
#[derive(Debug, Clone, Copy, Default)]
struct Reached {
    distance: f64,
    walk: u32,
    source: u32,
}

impl EdgeWalk {
    /// For meshes of up to so many vertices.
    pub fn new(vertices: usize) -> Self {
        Self { reached: vec![Reached::default(); vertices], walk: 0, heap: BinaryHeap::new() }
    }

    /// Calls `visit(vertex, distance, source)` for each vertex at most `radius` from the nearest of `sources`, nearest first and by number on
    /// ties, until it breaks. `source` is the place of that source among them: the one the way was found from first.
    ///
    /// The way leads through vertices that it `may_enter`; sources need not be such. Costs `O(k log k)` for the `k` vertices reached.
    ///
    /// # Panics
    /// If a source is not a vertex, or the topology has more vertices than the walk was made for or than there are positions.
    pub fn visit(
        &mut self,
        topology: &Topology,
        positions: &[DVec3],
        sources: impl IntoIterator<Item = u32>,
        radius: f64,
        may_enter: impl Fn(u32) -> bool,
        mut visit: impl FnMut(u32, f64, u32) -> ControlFlow<()>,
    ) {
        self.walk += 1;
        self.heap.clear();
        for (source, v) in (0..).zip(sources) {
            if self.distance(v) > 0.0 {
                self.reach(v, 0.0, source);
            }
        }
        while let Some(Reverse((bits, v))) = self.heap.pop() {
            let here = f64::from_bits(bits);
            let Reached { distance, source, .. } = self.reached[v as usize];
            if here > distance {
                continue;
            }
            if visit(v, here, source).is_break() {
                return;
            }
            for &w in topology.neighbours(v as usize) {
                let there = here + positions[v as usize].distance(positions[w as usize]);
                if there <= radius && there < self.distance(w) && may_enter(w) {
                    self.reach(w, there, source);
                }
            }
        }
    }

    fn reach(&mut self, vertex: u32, distance: f64, source: u32) {
        self.reached[vertex as usize] = Reached { distance, walk: self.walk, source };
        // Non-negative floats order like their bits.
        self.heap.push(Reverse((distance.to_bits(), vertex)));
    }

    /// Of a vertex that the last walk visited, from the nearest source; infinite where it did not come.
    pub fn distance(&self, vertex: u32) -> f64 {
        let reached = &self.reached[vertex as usize];
        if reached.walk == self.walk { reached.distance } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    /// Against all pairs by relaxing edges until nothing changes.
    #[test]
    fn ways_are_the_shortest_there_are() {
        let mesh = shapes::bumpy_plane(9, 7, 1.3, 1.0, 0.1, 5).expect("valid");
        let (topology, p) = (mesh.topology(), &mesh.positions);
        let may_enter = |v: u32| v % 5 != 3;
        let mut walk = EdgeWalk::new(p.len());
        for sources in [vec![0], vec![40, 7, 13, 7]] {
            let mut expected = vec![f64::INFINITY; p.len()];
            sources.iter().for_each(|&s| expected[s as usize] = 0.0);
            for _ in 0..p.len() {
                for &[a, b] in topology.edges() {
                    let length = p[a as usize].distance(p[b as usize]);
                    for (a, b) in [(a, b), (b, a)] {
                        if may_enter(b) {
                            expected[b as usize] = expected[b as usize].min(expected[a as usize] + length);
                        }
                    }
                }
            }
            let (mut last, mut seen) = (0.0, vec![false; p.len()]);
            walk.visit(topology, p, sources.iter().copied(), 0.9, may_enter, |v, distance, source| {
                assert!(!std::mem::replace(&mut seen[v as usize], true) && distance >= last && distance <= 0.9);
                assert!((distance - expected[v as usize]).abs() < 1e-12);
                assert!(p[v as usize].distance(p[sources[source as usize] as usize]) <= distance + 1e-12);
                last = distance;
                ControlFlow::Continue(())
            });
            for v in 0..p.len() {
                assert_eq!(seen[v], expected[v] <= 0.9);
                assert_eq!(walk.distance(v as u32).is_finite(), seen[v]);
            }
        }
        // A walk that breaks comes no farther, and the next one knows nothing of it.
        walk.visit(topology, p, [0], 2.0, |_| true, |_, _, _| ControlFlow::Break(()));
        walk.visit(topology, p, [1], 0.0, |_| true, |_, _, _| ControlFlow::Continue(()));
        assert!(walk.distance(0).is_infinite() && walk.distance(1) == 0.0);
    }
}
