//! What depends on the roles within a region of interest.

use glam::DVec3;
use pliant_mesh::threads::CHUNK;

use super::cells::{Cells, NONE};
use super::shape::Shape;
use crate::{Constraint, Region, Role};

/// Soft weights beyond these act as these.
const SOFT_RANGE: [f64; 2] = [1e-10, 1e12];

/// Who of the region is solved for, and what holds them.
pub(super) struct Roles {
    /// Slots that are solved for: free and in soft handles, and connected to something held.
    pub(super) unknowns: Slots,
    /// Slots that have a rotation: unknown or next to one.
    pub(super) fitted: Slots,
    /// Slots that equations look at but that are not solved for; the first `rim` ones have a rotation.
    pub(super) held: Vec<u32>,
    pub(super) rim: usize,
    /// Unknowns in soft handles.
    pub(super) springs: Vec<Spring>,
    /// Vertices in hard handles.
    pub(super) led: Vec<Led>,
    /// Of the matrix, by slot of the region.
    pub(super) diagonal: Vec<f64>,
    /// Vertices that should be solved for but are connected to nothing that holds them.
    pub(super) unconstrained: usize,
}

/// Some slots, increasing, with a list for each [`CHUNK`] of all slots.
#[derive(Default)]
pub(super) struct Slots {
    list: Vec<u32>,
    /// Where the list of each chunk begins, and the end of the last.
    starts: Vec<u32>,
    member: Vec<bool>,
}

/// An unknown drawn to a goal.
pub(super) struct Spring {
    pub(super) slot: u32,
    pub(super) handle: u32,
    /// What it adds to the matrix's diagonal.
    pub(super) stiffness: f64,
    /// How much its goal counts where a hard one counts 1.
    pub(super) grip: f64,
    /// In world units.
    pub(super) rest: DVec3,
}

/// A vertex of a hard handle.
pub(super) struct Led {
    pub(super) vertex: u32,
    pub(super) handle: u32,
    /// Its place among those held, [`NONE`] if no equation looks at it.
    pub(super) held: u32,
    /// In world units.
    pub(super) rest: DVec3,
}

impl Slots {
    fn new(member: Vec<bool>) -> Self {
        let mut list = Vec::new();
        let mut starts = vec![0];
        for (chunk, members) in member.chunks(CHUNK).enumerate() {
            let first = chunk * CHUNK;
            list.extend(members.iter().enumerate().filter(|(_, member)| **member).map(|(k, _)| (first + k) as u32));
            starts.push(list.len() as u32);
        }
        Self { list, starts, member }
    }

    pub(super) fn as_slice(&self) -> &[u32] {
        &self.list
    }

    /// Those in `chunk * CHUNK..(chunk + 1) * CHUNK`.
    #[inline(always)]
    pub(super) fn in_chunk(&self, chunk: usize) -> &[u32] {
        &self.list[self.starts[chunk] as usize..self.starts[chunk + 1] as usize]
    }

    pub(super) fn contains(&self, slot: usize) -> bool {
        self.member[slot]
    }
}

impl Roles {
    /// `region` has the region of interest that `cells` was made for.
    pub(super) fn new(shape: &Shape, cells: &Cells, region: &Region) -> Self {
        let roi = &cells.vertices[..cells.roi];
        let (unknown, unconstrained) = find_unknowns(cells, region);
        let mut fitted = vec![false; cells.cells];
        let mut looked_at = vec![false; cells.vertices.len()];
        for slot in (0..cells.roi).filter(|&slot| unknown[slot]) {
            fitted[slot] = true;
            for &other in cells.neighbours(slot) {
                fitted[other as usize] = true;
            }
        }
        for slot in (0..cells.cells).filter(|&slot| fitted[slot]) {
            looked_at[slot] = true;
            for &other in cells.neighbours(slot) {
                looked_at[other as usize] = true;
            }
        }
        let is_unknown = |slot: usize| unknown.get(slot) == Some(&true);
        let is_fitted = |slot: usize| fitted.get(slot) == Some(&true);
        let passive = (0..looked_at.len()).filter(|&slot| looked_at[slot] && !is_unknown(slot));
        let (mut held, outer): (Vec<u32>, Vec<u32>) = passive.map(|s| s as u32).partition(|&s| is_fitted(s as usize));
        let rim = held.len();
        held.extend(outer);
        let mut place = vec![NONE; cells.vertices.len()];
        for (at, &slot) in (0..).zip(&held) {
            place[slot as usize] = at;
        }

        let mut diagonal: Vec<f64> = (0..cells.roi).map(|slot| cells.diagonal(slot)).collect();
        let count = unknown.iter().filter(|unknown| **unknown).count();
        let sum: f64 = diagonal.iter().zip(&unknown).filter(|(_, unknown)| **unknown).map(|(d, _)| d).sum();
        // A matrix of lone vertices is zero; any scale will do.
        let mean = if sum > 0.0 { sum / count as f64 } else { 1.0 };
        let (mut springs, mut led) = (Vec::new(), Vec::new());
        for (slot, &vertex) in roi.iter().enumerate() {
            let Role::Handle(handle) = region.roles()[vertex as usize] else { continue };
            let rest = shape.rest.positions[vertex as usize];
            match region.handles()[handle as usize].constraint {
                Constraint::Hard => led.push(Led { vertex, handle, held: place[slot], rest }),
                Constraint::Soft(weight) => {
                    let weight = weight.clamp(SOFT_RANGE[0], SOFT_RANGE[1]);
                    // In series with a surface of stiffness 1.
                    let grip = weight / (1.0 + weight);
                    let stiffness = weight * mean;
                    diagonal[slot] += stiffness;
                    springs.push(Spring { slot: slot as u32, handle, stiffness, grip, rest });
                }
            }
        }
        // So that of several bad goals the first is named.
        led.sort_by_key(|led| led.handle);
        let (unknowns, fitted) = (Slots::new(unknown), Slots::new(fitted));
        Self { unknowns, fitted, held, rim, springs, led, diagonal, unconstrained }
    }
}

/// Whether each slot of the region is to be solved for, and how many that should be are connected to nothing that holds them.
///
/// Every weight is positive, so a vertex is held if and only if edges between unknowns lead from it to a soft handle
/// or to a neighbour that is not solved for. What is held by nothing would make the matrix singular, and stays where
/// it is.
fn find_unknowns(cells: &Cells, region: &Region) -> (Vec<bool>, usize) {
    let vertex = |slot: usize| cells.vertices[slot] as usize;
    let soft = |slot: usize| matches!(region.constraint(vertex(slot)), Some(Constraint::Soft(_)));
    let candidate: Vec<bool> =
        (0..cells.roi).map(|slot| region.roles()[vertex(slot)] == Role::Free || soft(slot)).collect();
    let is_candidate = |slot: u32| candidate.get(slot as usize) == Some(&true);
    let mut reached = vec![false; cells.roi];
    let mut stack: Vec<u32> = Vec::new();
    for slot in (0..cells.roi).filter(|&slot| candidate[slot]) {
        if soft(slot) || cells.neighbours(slot).iter().any(|&other| !is_candidate(other)) {
            reached[slot] = true;
            stack.push(slot as u32);
        }
    }
    while let Some(slot) = stack.pop() {
        for &other in cells.neighbours(slot as usize) {
            if is_candidate(other) && !reached[other as usize] {
                reached[other as usize] = true;
                stack.push(other);
            }
        }
    }
    let unconstrained = candidate.iter().zip(&reached).filter(|(candidate, reached)| **candidate && !**reached).count();
    (reached, unconstrained)
}
