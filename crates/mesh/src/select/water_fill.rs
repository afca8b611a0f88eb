//! Water filling after Luo et al., "Mesh Editing in ROI with Dual Laplacian", 2007, section 3.1.

use glam::DVec3;

use super::plane::{curves, heights};
use super::{PlaneCurve, check_positions, check_vertex};
use crate::{MeshError, Topology, VertexSet};

/// What stops the flood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FillLimit {
    /// The plane, wherever it meets the surface: Luo's rule. Right where the first vertex's side of the plane, as far as it is
    /// connected, is closed off by the curve at the last vertex alone: a leg, an arm, a tail or a head cut across.
    #[default]
    Plane,
    /// The curve of plane and surface that is nearest to the last vertex, and as few more as keep the flood from coming round
    /// to its other side; elsewhere the flood passes the plane.
    ///
    /// - A bent limb that comes back through the plane is filled up to the cut at its root.
    /// - On a limb at a torso, what the plane meets far away (the other limbs) does not cut.
    /// - Of two limbs that the same plane cuts, the one with the last vertex is cut; seen from the torso, the other belongs to
    ///   the region.
    /// - On a handle one curve does not part the surface: the nearest ones that do are added, so the handle is cut at both ends.
    /// - On an open mesh the flood ends at the border of the mesh, as it does for `Plane`.
    NearestCurves,
}

/// How a filled region is closed off from the rest of its surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closure {
    /// By one closed curve: the case that water filling is meant for.
    Cap,
    /// By several closed curves: the plane also cuts something else off, or cuts a handle.
    Band {
        /// How many.
        curves: usize,
    },
    /// The flood reached a border of the mesh.
    OpenBorder {
        /// Edges with one face that have an end in the region.
        edges: usize,
    },
    /// By nothing: the region is all of the first vertex's connected surface.
    Everything,
}

impl Closure {
    /// Whether the flood went where Luo's rule does not foresee it; then the region is to be looked at before it is used.
    pub fn leaked(self) -> bool {
        self != Self::Cap
    }
}

/// A region found by water filling.
#[derive(Debug, Clone, PartialEq)]
pub struct WaterFill {
    /// The flooded vertices, with those exactly on the plane where it stopped.
    pub region: VertexSet,
    /// The curves where the flood was stopped, in the order of their lowest edges.
    pub curves: Vec<PlaneCurve>,
    /// How the region is closed off.
    pub closure: Closure,
}

/// The region between two picked vertices: a flood from `first` over the surface, up to the plane through `last` that is
/// perpendicular to the line between them.
///
/// A vertex belongs to the region as a whole, so the region ends less than an edge before the curves in which plane and surface meet,
/// or on them where vertices lie on the plane. Where the plane only touches the surface it stops nothing. Costs a few passes
/// over vertices and edges; with [`FillLimit::NearestCurves`] also up to the square of the number of curves.
///
/// # Errors
/// Another number of positions than of vertices, a vertex that does not exist, or two vertices in the same place.
pub fn water_fill(
    topology: &Topology,
    positions: &[DVec3],
    first: u32,
    last: u32,
    limit: FillLimit,
) -> Result<WaterFill, MeshError> {
    check_positions(topology, positions)?;
    check_vertex(topology, "the first vertex", first)?;
    check_vertex(topology, "the last vertex", last)?;
    let [from, to] = [first, last].map(|v| positions[v as usize]);
    let line = (to - from).try_normalize().ok_or_else(|| MeshError::BadParameter {
        what: "the last vertex",
        expected: format!("away from vertex {first}"),
        found: last.to_string(),
    })?;
    let heights = heights(positions, to, line);
    let mut curves = curves(topology, positions, &heights);
    let parts = Parts::new(topology, &heights, &curves);
    let start = parts.of_vertex[first as usize];
    let stops = match limit {
        FillLimit::Plane => parts.doors.iter().map(|door| !door.only_touches).collect(),
        FillLimit::NearestCurves => parts.nearest_stops(start, &curves, to),
    };
    let flooded = parts.flood(start, &stops);
    let is_flooded = |v: u32| flooded[parts.of_vertex[v as usize] as usize];
    // On the plane and next to the water: where the flood stops, not where it goes on from.
    let is_shore = |v: u32| {
        let wet = |&w: &u32| heights[w as usize] < 0.0 && is_flooded(w);
        heights[v as usize] == 0.0 && topology.neighbours(v as usize).iter().any(wet)
    };
    let region = VertexSet::where_true(positions.len(), |v| is_flooded(v) || is_shore(v));
    let mut index = 0..;
    curves.retain(|_| {
        let c = index.next().unwrap_or_default();
        stops[c] && parts.doors[c].between.iter().any(|&p| flooded[p as usize])
    });
    let connected = parts.flood(start, &vec![false; stops.len()]);
    let all = parts.of_vertex.iter().filter(|&&p| connected[p as usize]).count();
    let closure = closure(topology, &region, all, &curves);
    Ok(WaterFill { region, curves, closure })
}

fn closure(topology: &Topology, region: &VertexSet, all: usize, curves: &[PlaneCurve]) -> Closure {
    if region.len() == all {
        return Closure::Everything;
    }
    let in_region = |e: &usize| topology.edges()[*e].iter().any(|&v| region.contains(v));
    let edges = (0..topology.edges().len()).filter(|&e| topology.is_boundary_edge(e)).filter(in_region).count();
    match (edges, curves) {
        (0, [PlaneCurve { closed: true, .. }]) => Closure::Cap,
        (0, _) => Closure::Band { curves: curves.len() },
        _ => Closure::OpenBorder { edges },
    }
}

/// The surface in the parts that the plane cuts it into, each wholly below the plane or wholly not, and the curves as doors
/// between them. All ends of a curve's edges on one side are connected on that side, so a door joins exactly two parts.
struct Parts {
    of_vertex: Vec<u32>,
    doors: Vec<Door>,
    count: usize,
}

struct Door {
    /// The part below the plane and the one beyond.
    between: [u32; 2],
    /// Whether nothing of the part beyond rises over the plane, nor leads anywhere else.
    only_touches: bool,
}

impl Parts {
    fn new(topology: &Topology, heights: &[f64], curves: &[PlaneCurve]) -> Self {
        const NONE: u32 = u32::MAX;
        let mut of_vertex = vec![NONE; heights.len()];
        let mut rises = Vec::new();
        let mut stack = Vec::new();
        for seed in 0..heights.len() {
            if of_vertex[seed] != NONE {
                continue;
            }
            let part = rises.len() as u32;
            let mut over = false;
            of_vertex[seed] = part;
            stack.push(seed as u32);
            while let Some(v) = stack.pop() {
                over |= heights[v as usize] > 0.0;
                for &w in topology.neighbours(v as usize) {
                    if of_vertex[w as usize] == NONE && (heights[w as usize] < 0.0) == (heights[v as usize] < 0.0) {
                        of_vertex[w as usize] = part;
                        stack.push(w);
                    }
                }
            }
            rises.push(over);
        }
        let between = |curve: &PlaneCurve| {
            let [a, b] = topology.edges()[curve.edges[0] as usize];
            let [below, beyond] = if heights[a as usize] < 0.0 { [a, b] } else { [b, a] };
            [below, beyond].map(|v| of_vertex[v as usize])
        };
        let between: Vec<[u32; 2]> = curves.iter().map(between).collect();
        let mut below = vec![NONE; rises.len()];
        for &[low, high] in &between {
            let seen = &mut below[high as usize];
            if *seen == NONE {
                *seen = low;
            } else if *seen != low {
                // Joins two parts, as a ridge between two valleys does.
                rises[high as usize] = true;
            }
        }
        let door = |between: [u32; 2]| Door { between, only_touches: !rises[between[1] as usize] };
        Self { count: rises.len(), doors: between.into_iter().map(door).collect(), of_vertex }
    }

    /// The parts reached from `start` through the doors that are no stops.
    fn flood(&self, start: u32, stops: &[bool]) -> Vec<bool> {
        let mut open = vec![Vec::new(); self.count];
        for (door, _) in self.doors.iter().zip(stops).filter(|(_, stop)| !**stop) {
            let [a, b] = door.between;
            open[a as usize].push(b);
            open[b as usize].push(a);
        }
        let mut reached = vec![false; self.count];
        reached[start as usize] = true;
        let mut stack = vec![start];
        while let Some(part) = stack.pop() {
            for &next in &open[part as usize] {
                if !std::mem::replace(&mut reached[next as usize], true) {
                    stack.push(next);
                }
            }
        }
        reached
    }

    /// The door nearest to `to`, and the nearest further ones without which the flood would come to both of its sides.
    fn nearest_stops(&self, start: u32, curves: &[PlaneCurve], to: DVec3) -> Vec<bool> {
        let mut stops = vec![false; curves.len()];
        let connected = self.flood(start, &stops);
        let mut order: Vec<(f64, usize)> = (0..curves.len())
            .filter(|&c| !self.doors[c].only_touches && connected[self.doors[c].between[0] as usize])
            .map(|c| (curves[c].distance(to), c))
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let Some(&(_, nearest)) = order.first() else {
            return stops;
        };
        let passes = |flooded: &[bool], c: usize| self.doors[c].between.iter().all(|&p| flooded[p as usize]);
        let mut added = Vec::new();
        stops[nearest] = true;
        loop {
            let flooded = self.flood(start, &stops);
            let next = order.iter().find(|&&(_, c)| !stops[c] && passes(&flooded, c));
            let Some(&(_, c)) = next.filter(|_| passes(&flooded, nearest)) else {
                break;
            };
            stops[c] = true;
            added.push(c);
        }
        for c in added.into_iter().rev() {
            stops[c] = false;
            stops[c] = passes(&self.flood(start, &stops), nearest);
        }
        stops
    }
}

#[cfg(test)]
#[path = "water_fill_tests.rs"]
mod tests;
