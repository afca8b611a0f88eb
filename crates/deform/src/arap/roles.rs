//! What depends on the roles within a region of interest.

use glam::DVec3;
use pliant_mesh::threads::CHUNK;

use super::cells::{Cells, NONE};
use super::rows::Rows;
use super::shape::Shape;
use crate::patch::soft_weight;
use crate::{Constraint, Region, Role};

/// Who of the region is solved for, and what holds them.
pub(crate) struct Roles {
    /// Slots that are solved for: free and in soft handles.
    pub(crate) unknowns: Slots,
    /// Slots that have a rotation: unknown or next to one.
    pub(crate) fitted: Slots,
    /// Slots that equations look at but that are not solved for; the first `rim` ones have a rotation.
    pub(crate) held: Vec<u32>,
    pub(crate) rim: usize,
    /// Unknowns in soft handles.
    pub(crate) springs: Vec<Spring>,
    /// Points that are no vertices.
    pub(crate) rows: Rows,
    /// Vertices in hard handles.
    pub(crate) led: Vec<Led>,
    /// Which connected piece of what equations look at each slot is in, from 0.
    pub(crate) pieces: Vec<u32>,
    /// Of the matrix without rows, by slot of the region.
    pub(crate) diagonal: Vec<f64>,
}

/// Some slots, increasing, with a list for each [`CHUNK`] of all slots.
#[derive(Default)]
pub(crate) struct Slots {
    list: Vec<u32>,
    /// Where the list of each chunk begins, and the end of the last.
    starts: Vec<u32>,
    member: Vec<bool>,
}

/// An unknown drawn to a goal.
pub(crate) struct Spring {
    pub(crate) slot: u32,
    pub(crate) handle: u32,
    /// What it adds to the matrix's diagonal.
    pub(crate) stiffness: f64,
    /// How much its goal counts where a hard one counts 1.
    pub(crate) grip: f64,
    /// In world units.
    pub(crate) rest: DVec3,
}

/// A vertex of a hard handle.
pub(crate) struct Led {
    pub(crate) vertex: u32,
    pub(crate) handle: u32,
    /// Its place among those held, [`NONE`] if no equation looks at it.
    pub(crate) held: u32,
    /// In world units.
    pub(crate) rest: DVec3,
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

    pub(crate) fn as_slice(&self) -> &[u32] {
        &self.list
    }

    /// Those in `chunk * CHUNK..(chunk + 1) * CHUNK`.
    #[inline(always)]
    pub(crate) fn in_chunk(&self, chunk: usize) -> &[u32] {
        &self.list[self.starts[chunk] as usize..self.starts[chunk + 1] as usize]
    }

    pub(crate) fn contains(&self, slot: usize) -> bool {
        self.member[slot]
    }

    /// As [`Self::contains`], for any slot.
    #[inline(always)]
    pub(crate) fn has(&self, slot: usize) -> bool {
        self.member.get(slot) == Some(&true)
    }
}

impl Roles {
    /// `region` has the region of interest that `cells` was made for.
    pub(crate) fn new(shape: &Shape, cells: &Cells, region: &Region) -> Self {
        let roi = &cells.vertices[..cells.roi];
        let unknown: Vec<bool> = roi.iter().map(|&v| region.is_unknown(v as usize)).collect();
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
        let rows = Rows::new(cells, region, &diagonal, mean);
        rows.steady(shape, cells, region, mean, &mut diagonal);
        let (mut springs, mut led) = (Vec::new(), Vec::new());
        for (slot, &vertex) in roi.iter().enumerate() {
            let Role::Handle(handle) = region.roles()[vertex as usize] else { continue };
            let rest = shape.rest.positions[vertex as usize];
            match region.handles()[handle as usize].constraint {
                Constraint::Hard => led.push(Led { vertex, handle, held: place[slot], rest }),
                Constraint::Soft(weight) => {
                    let weight = soft_weight(weight);
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
        let pieces = pieces(cells, &rows);
        Self { unknowns, fitted, held, rim, springs, rows, led, pieces, diagonal }
    }
}

/// Numbers connected pieces of the slots, from 0; points between pieces connect them.
fn pieces(cells: &Cells, rows: &Rows) -> Vec<u32> {
    let mut piece = cells.pieces(|_| false);
    for (_, entries) in rows.iter() {
        let Some(&(first, _)) = entries.first() else { continue };
        for &(slot, _) in entries {
            let (to, from) = (piece[first as usize], piece[slot as usize]);
            // Few points lie between pieces.
            if from != to {
                piece.iter_mut().filter(|piece| **piece == from).for_each(|piece| *piece = to);
            }
        }
    }
    piece
}
