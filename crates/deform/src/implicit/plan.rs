//! Who is solved for, whose gradient is given, and which gradients are compared.

use glam::{DMat3, DVec3};
use pliant_linalg::LinalgError;
use pliant_mesh::TriMesh;

use super::stencils::{NONE, Need, Stencils};
use super::{ImplicitConstraints, ImplicitOptions};
use crate::patch::{Held, Patch};

/// Most pairs of gradients. Surfaces have some ten a vertex with two rings; but all neighbours of a vertex are pairs, so that a fan of tens
/// of thousands of triangles has billions.
const MOST_PAIRS: usize = 1 << 25;

/// Most entries of the matrix: over a gigabyte. Surfaces have some thirty a vertex with two rings.
pub(super) const MOST_ENTRIES: usize = 1 << 27;

/// Positions and gradients that the surface is held by, one each per vertex of the patch; where nothing holds one, it is not read.
#[derive(Default)]
pub(super) struct Hold {
    pub(super) places: Vec<DVec3>,
    pub(super) gradients: Vec<DMat3>,
}

/// What the constraints make of the vertices.
pub(super) struct Plan {
    /// Whether a vertex's position is solved for.
    pub(super) is_unknown: Vec<bool>,
    /// Whether its gradient is given.
    pub(super) is_given: Vec<bool>,
    /// Whether the paper's energies have a row for it: it or a neighbour is unknown.
    pub(super) has_row: Vec<bool>,
    /// Whether [`Hold::gradients`] of it is read.
    pub(super) is_read: Vec<bool>,
    pub(super) need: Vec<Need>,
    rings: u32,
    pub(super) constraints: ImplicitConstraints,
}

impl Plan {
    pub(super) fn new(patch: &Patch, options: &ImplicitOptions) -> Self {
        let constraints = options.constraints;
        let by_gradient = constraints != ImplicitConstraints::Positions;
        let topology = patch.mesh.topology();
        let is_unknown: Vec<bool> = patch.held.iter().map(|held| held.is_unknown()).collect();
        let is_given =
            patch.held.iter().map(|held| by_gradient && (!held.is_unknown() || is_hard_gradient(*held))).collect();
        let touches = |v: usize| topology.neighbours(v).iter().any(|&j| is_unknown[j as usize]);
        let has_row: Vec<bool> = (0..is_unknown.len()).map(|v| is_unknown[v] || touches(v)).collect();
        let is_apart = |v: usize| topology.neighbours(v).is_empty();
        let need = (0..is_unknown.len())
            .map(|v| match (patch.held[v], is_unknown[v]) {
                _ if is_apart(v) => Need::None,
                (Held::Spring { .. }, _) if !by_gradient => Need::InPlace,
                (_, true) => Need::Always,
                _ if !by_gradient => Need::IfSound,
                _ if has_row[v] => Need::Always,
                _ => Need::None,
            })
            .collect();
        let is_read = vec![false; is_unknown.len()];
        let mut plan = Self { is_unknown, is_given, has_row, is_read, need, rings: options.rings, constraints };
        let mut ball = Ball::new(plan.need.len());
        for v in 0..plan.need.len() {
            plan.is_read[v] |= plan.has_row[v] || patch.held[v].handle().is_some();
            if plan.is_unknown[v] {
                for &j in ball.around(&patch.mesh, v, plan.rings) {
                    plan.is_read[j as usize] = true;
                }
            }
        }
        plan
    }

    /// Whether the vertex's handle, if it has a soft one, draws its position.
    pub(super) fn draws_positions(&self) -> bool {
        self.constraints != ImplicitConstraints::Gradients
    }
}

/// Whether a vertex is solved for, but its gradient is held hard: in place of a hard handle's position, where gradients alone count.
pub(super) fn is_hard_gradient(held: Held) -> bool {
    matches!(held, Held::Spring { weight: f64::INFINITY, .. })
}

/// Makes the vertices of hard handles unknowns whose gradient alone is held: see [`is_hard_gradient`].
pub(super) fn release_positions(patch: &mut Patch) {
    for held in &mut patch.held {
        if let Held::Led { handle } = *held {
            *held = Held::Spring { handle, weight: f64::INFINITY };
        }
    }
}

/// Vertices within some rings of one.
struct Ball {
    seen: Vec<u32>,
    found: Vec<u32>,
    stamp: u32,
}

impl Ball {
    fn new(vertices: usize) -> Self {
        Self { seen: vec![0; vertices], found: Vec::new(), stamp: 0 }
    }

    /// Without the vertex itself, from near to far.
    fn around(&mut self, mesh: &TriMesh, vertex: usize, rings: u32) -> &[u32] {
        self.stamp += 1;
        self.found.clear();
        self.found.push(vertex as u32);
        self.seen[vertex] = self.stamp;
        let mut inner = 0;
        for _ in 0..rings {
            let end = self.found.len();
            for k in inner..end {
                for &j in mesh.topology().neighbours(self.found[k] as usize) {
                    if self.seen[j as usize] != self.stamp {
                        self.seen[j as usize] = self.stamp;
                        self.found.push(j);
                    }
                }
            }
            inner = end;
        }
        &self.found[1..]
    }
}

/// The pairs of Eq. 6 in which something is unknown: between gradients, and with given ones.
pub(super) fn coherence(patch: &Patch, plan: &Plan, stencils: &Stencils) -> Result<(Lists, Lists), LinalgError> {
    let (mut pairs, mut pulls) = (Lists::new(), Lists::new());
    let mut ball = Ball::new(plan.need.len());
    let is_faint = plan.constraints == ImplicitConstraints::Positions;
    for v in 0..plan.need.len() {
        let own = stencils.gradient[v];
        if own == NONE {
            continue;
        }
        if !plan.is_given[v] {
            for &j in ball.around(&patch.mesh, v, plan.rings) {
                let j = j as usize;
                let (other, either) = (stencils.gradient[j], plan.is_unknown[v] || plan.is_unknown[j]);
                if !plan.is_given[j] && other != NONE && other > own && either {
                    pairs.items.push(other);
                }
                if plan.is_given[j] || is_faint && plan.is_unknown[v] && !plan.is_unknown[j] {
                    pulls.items.push(j as u32);
                }
            }
        }
        if pairs.items.len() + pulls.items.len() > MOST_PAIRS {
            let (unknowns, entries) = (plan.need.len(), pairs.items.len() + pulls.items.len());
            return Err(LinalgError::TooLarge { unknowns, entries });
        }
        pairs.ends.push(pairs.items.len());
        pulls.ends.push(pulls.items.len());
    }
    Ok((pairs, pulls))
}

/// Lists of numbers, end to end.
pub(super) struct Lists {
    ends: Vec<usize>,
    pub(super) items: Vec<u32>,
}

impl Lists {
    fn new() -> Self {
        Self { ends: Vec::new(), items: Vec::new() }
    }

    pub(super) fn get(&self, i: usize) -> &[u32] {
        let start = if i == 0 { 0 } else { self.ends[i - 1] };
        &self.items[start..self.ends[i]]
    }

    /// For each of `count` items, the lists that have it.
    pub(super) fn transposed(lists: impl Iterator<Item = (u32, u32)> + Clone, count: usize) -> Self {
        let mut ends = vec![0; count];
        for (_, item) in lists.clone() {
            ends[item as usize] += 1;
        }
        let mut start = 0;
        for end in &mut ends {
            (start, *end) = (start + *end, start);
        }
        let mut items = vec![0; start];
        for (list, item) in lists {
            let cursor = &mut ends[item as usize];
            items[*cursor] = list;
            *cursor += 1;
        }
        Self { ends, items }
    }
}
