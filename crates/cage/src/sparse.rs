//! Sparse rows: which cage vertices each point follows, and how much.

use rayon::prelude::*;

use crate::CageError;
use crate::rows::{RowFacts, Scratch};

/// One row of weights per point, stored end to end.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    /// Row `i` is entries `offsets[i]..offsets[i + 1]`.
    pub(crate) offsets: Vec<u32>,
    pub(crate) indices: Vec<u32>,
    pub(crate) weights: Vec<f32>,
}

/// Rows of the points listed in one chunk of an order.
pub(crate) struct Chunk {
    /// End of each row within this chunk.
    ends: Vec<u32>,
    indices: Vec<u32>,
    weights: Vec<f32>,
    pub(crate) facts: RowFacts,
}

/// Rows that one task copies.
const BLOCK: usize = 4096;

impl Rows {
    /// Each point follows itself.
    pub(crate) fn identity(n: u32) -> Self {
        Self { offsets: (0..=n).collect(), indices: (0..n).collect(), weights: vec![1.0; n as usize] }
    }

    pub(crate) fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    pub(crate) fn row(&self, i: usize) -> (&[u32], &[f32]) {
        let range = self.offsets[i] as usize..self.offsets[i + 1] as usize;
        (&self.indices[range.clone()], &self.weights[range])
    }

    /// Row `r` is the old row `order[r]`, with `numbers[j]` for every index `j`.
    pub(crate) fn renumbered(&self, order: &[u32], numbers: &[u32]) -> Self {
        let mut renumbered = Self { offsets: vec![0], indices: Vec::new(), weights: Vec::new() };
        for &i in order {
            let (indices, weights) = self.row(i as usize);
            renumbered.indices.extend(indices.iter().map(|&j| numbers[j as usize]));
            renumbered.weights.extend_from_slice(weights);
            renumbered.offsets.push(renumbered.indices.len() as u32);
        }
        renumbered
    }

    /// Puts rows in the order of their points: `chunks` hold those of `order`, `chunk_len` at a time.
    ///
    /// # Errors
    /// More weights than 32-bit offsets can number.
    pub(crate) fn gather(order: &[u32], chunk_len: usize, chunks: &[Chunk]) -> Result<Self, CageError> {
        let entries: usize = chunks.iter().map(|c| c.indices.len()).sum();
        check_entries(entries)?;
        let mut place = vec![0u32; order.len()];
        for (at, &i) in order.iter().enumerate() {
            place[i as usize] = at as u32;
        }
        let found = |i: usize| {
            let (chunk, at) = (&chunks[place[i] as usize / chunk_len], place[i] as usize % chunk_len);
            let start = if at == 0 { 0 } else { chunk.ends[at - 1] };
            (chunk, start as usize..chunk.ends[at] as usize)
        };
        let mut offsets = Vec::with_capacity(order.len() + 1);
        let mut end = 0;
        offsets.push(0);
        offsets.extend((0..order.len()).map(|i| {
            end += found(i).1.len() as u32;
            end
        }));
        let (mut indices, mut weights) = (vec![0; entries], vec![0.0; entries]);
        // The tasks' own stretches of both arrays.
        let (mut rest, mut stretches) = ((&mut indices[..], &mut weights[..]), Vec::new());
        for first in (0..order.len()).step_by(BLOCK) {
            let last = (first + BLOCK).min(order.len());
            let length = (offsets[last] - offsets[first]) as usize;
            let (own_indices, other_indices) = rest.0.split_at_mut(length);
            let (own_weights, other_weights) = rest.1.split_at_mut(length);
            stretches.push((first..last, own_indices, own_weights));
            rest = (other_indices, other_weights);
        }
        stretches.into_par_iter().for_each(|(points, indices, weights)| {
            let mut to = 0;
            for i in points {
                let (chunk, from) = found(i);
                let length = from.len();
                indices[to..to + length].copy_from_slice(&chunk.indices[from.clone()]);
                weights[to..to + length].copy_from_slice(&chunk.weights[from]);
                to += length;
            }
        });
        Ok(Self { offsets, indices, weights })
    }
}

/// Refuses more entries than 32-bit offsets can number.
pub(crate) fn check_entries(entries: usize) -> Result<(), CageError> {
    if u32::try_from(entries).is_ok() { Ok(()) } else { Err(CageError::TooManyEntries { entries }) }
}

impl Chunk {
    /// Collects the rows that `make` leaves in the scratch memory, one for each of `points`.
    pub(crate) fn of(points: &[u32], scratch: &mut Scratch, make: impl Fn(u32, &mut Scratch) -> RowFacts) -> Self {
        let (ends, facts) = (Vec::with_capacity(points.len()), RowFacts::default());
        let mut chunk = Self { ends, indices: Vec::new(), weights: Vec::new(), facts };
        for &point in points {
            chunk.facts = chunk.facts.and(make(point, scratch));
            // The largest first (the lowest vertex on a tie): propagation takes it as what the others add up to 1 with.
            let mut first = 0;
            for (at, entry) in scratch.row.iter().enumerate() {
                if entry.1 > scratch.row[first].1 {
                    first = at;
                }
            }
            let leading = scratch.row[first];
            let others = scratch.row.iter().enumerate().filter(|(at, _)| *at != first).map(|(_, e)| *e);
            for (j, weight) in std::iter::once(leading).chain(others) {
                // A weight that vanishes in f32 moves nothing.
                if weight as f32 != 0.0 {
                    chunk.indices.push(j);
                    chunk.weights.push(weight as f32);
                }
            }
            chunk.ends.push(chunk.indices.len() as u32);
        }
        chunk
    }
}
