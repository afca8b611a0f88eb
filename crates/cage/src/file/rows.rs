//! Rows of weights, and what makes them sound.

use rayon::prelude::*;

use super::bytes::{Reader, Writer};
use super::{BindingFault, RowFault};
use crate::rows::CANCELLED;
use crate::sparse::Rows;

/// Rows that one task checks.
const GRAIN: usize = 2048;

/// How far from 1 weights may sum, besides [`ROUNDING`].
const SLACK: f64 = 1e-6;

/// What rounding to f32 may take from a weight at most, as a share of it, and as much again.
const ROUNDING: f64 = f32::EPSILON as f64;

/// Writes the number of entries, the length of each row, all indices, all weights.
pub(super) fn write(rows: &Rows, writer: &mut Writer) {
    writer.count(rows.indices.len());
    let lengths: Vec<u32> = rows.offsets.windows(2).map(|ends| ends[1] - ends[0]).collect();
    writer.u32s(&lengths);
    writer.u32s(&rows.indices);
    writer.f32s(&rows.weights);
}

/// Reads `count` rows that follow a cage of `vertices` vertices; `what` one of them is called.
///
/// Lengths are stored rather than ends: there is no way for ends to decrease.
pub(super) fn read(
    reader: &mut Reader<'_>,
    what: &'static str,
    count: usize,
    vertices: usize,
) -> Result<Rows, BindingFault> {
    let entries = reader.u64(what)?;
    if u32::try_from(entries).is_err() {
        return Err(BindingFault::Value { what: "the number of weights (32 bits)", found: entries.to_string() });
    }
    let lengths = reader.u32s(what, count as u64)?;
    let indices = reader.u32s(what, entries)?;
    let weights = reader.f32s(what, entries)?;
    let fault = |row, fault| BindingFault::Row { what, row, fault };
    let mut offsets = Vec::with_capacity(count + 1);
    let mut end = 0u64;
    offsets.push(0);
    for (row, length) in lengths.into_iter().enumerate() {
        end += u64::from(length);
        if length == 0 {
            return Err(fault(row, RowFault::Empty));
        }
        if end > entries {
            return Err(fault(row, RowFault::PastEnd { end, entries }));
        }
        offsets.push(end as u32);
    }
    if end != entries {
        return Err(BindingFault::Entries { what, expected: entries, found: end });
    }
    let rows = Rows { offsets, indices, weights };
    let broken = |row: usize| Some((row, check(rows.row(row), vertices).err()?));
    match (0..count).into_par_iter().with_min_len(GRAIN).find_map_first(broken) {
        Some((row, found)) => Err(fault(row, found)),
        None => Ok(rows),
    }
}

/// What [`crate::Binding`] says of its rows.
fn check((indices, weights): (&[u32], &[f32]), vertices: usize) -> Result<(), RowFault> {
    let (leading, largest) = (indices[0], weights[0]);
    let (mut highest, mut in_order, mut before) = (leading, true, None);
    let (mut sum, mut magnitude) = (f64::from(largest), f64::from(largest.abs()));
    for (&vertex, &weight) in indices[1..].iter().zip(&weights[1..]) {
        in_order &= before < Some(vertex) && vertex != leading && weight <= largest;
        before = Some(vertex);
        highest = highest.max(vertex);
        sum += f64::from(weight);
        magnitude += f64::from(weight.abs());
    }
    if highest as usize >= vertices {
        return Err(RowFault::Vertex { vertex: highest, vertices });
    }
    // Rows that cancel beyond this are replaced when they are made.
    if !magnitude.is_finite() || magnitude * CANCELLED > 1.0 + SLACK {
        let largest = weights.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()));
        return Err(RowFault::Weight { weight: largest.unwrap_or_default() });
    }
    if (sum - 1.0).abs() > SLACK + ROUNDING * magnitude {
        return Err(RowFault::Sum { sum });
    }
    if in_order { Ok(()) } else { Err(RowFault::Order) }
}
