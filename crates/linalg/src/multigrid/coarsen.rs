//! From one level to the next coarser one.

use crate::{LinalgError, SparseRows};

/// No aggregate yet.
const NONE: u32 = u32::MAX;

/// Entries below this share of the geometric mean of their diagonals couple weakly; halved from level to level (Vaněk et al. 1996, Eq.
/// 5.1).
const STRONG: f64 = 0.08;

pub(super) struct Coarsened {
    pub(super) matrix: SparseRows,
    pub(super) prolong: SparseRows,
    pub(super) diagonal: Vec<f64>,
    /// Bound of the largest eigenvalue of the fine matrix over its diagonal.
    pub(super) bound: f64,
}

/// The next coarser level; `None` if every unknown stays by itself.
pub(super) fn coarsen(matrix: &SparseRows, level: usize) -> Result<Option<Coarsened>, LinalgError> {
    let n = matrix.row_count();
    let mut diagonal = vec![0.0; n];
    // Gershgorin's.
    let mut bound = 1.0f64;
    for (i, diagonal) in diagonal.iter_mut().enumerate() {
        let (columns, values) = matrix.row(i);
        *diagonal = columns.iter().position(|&j| j as usize == i).map_or(0.0, |at| values[at]);
        if *diagonal <= 0.0 {
            return Err(LinalgError::NotPositiveDefinite { unknown: i });
        }
        bound = bound.max(values.iter().map(|x| x.abs()).sum::<f64>() / *diagonal);
    }
    let threshold = STRONG * 0.5f64.powi(level as i32);
    let (diagonals, square) = (&diagonal, threshold * threshold);
    let strong = move |i: usize, j: u32, value: f64| {
        i != j as usize && value * value >= square * diagonals[i] * diagonals[j as usize]
    };
    let (aggregate, count) = aggregates(matrix, &strong);
    if count >= n {
        return Ok(None);
    }
    let prolong = prolongation(matrix, &diagonal, bound, &aggregate, count, &strong)?;
    let matrix = matrix.galerkin(&prolong)?;
    Ok(Some(Coarsened { matrix, prolong, diagonal, bound }))
}

/// Puts each unknown into an aggregate of strongly coupled ones: their numbers, and how many there are.
fn aggregates(matrix: &SparseRows, strong: &impl Fn(usize, u32, f64) -> bool) -> (Vec<u32>, usize) {
    let n = matrix.row_count();
    let neighbours = |i: usize| {
        let (columns, values) = matrix.row(i);
        columns.iter().zip(values).filter(move |&(&j, &value)| strong(i, j, value)).map(|(&j, &value)| (j, value))
    };
    let (mut aggregate, mut count) = (vec![NONE; n], 0);
    // Whole neighbourhoods that are still free.
    for i in 0..n {
        if aggregate[i] == NONE && neighbours(i).all(|(j, _)| aggregate[j as usize] == NONE) {
            aggregate[i] = count;
            neighbours(i).for_each(|(j, _)| aggregate[j as usize] = count);
            count += 1;
        }
    }
    // The others join the one they are coupled to most, among those of the first pass.
    let first = aggregate.clone();
    for i in (0..n).filter(|&i| first[i] == NONE) {
        let mut best = (0.0, NONE);
        for (j, value) in neighbours(i).filter(|(j, _)| first[*j as usize] != NONE) {
            if value.abs() > best.0 {
                best = (value.abs(), first[j as usize]);
            }
        }
        aggregate[i] = best.1;
    }
    // What is left has nobody of the first pass next to it.
    for i in 0..n {
        if aggregate[i] == NONE {
            aggregate[i] = count;
            for (j, _) in neighbours(i) {
                if aggregate[j as usize] == NONE {
                    aggregate[j as usize] = count;
                }
            }
            count += 1;
        }
    }
    (aggregate, count as usize)
}

/// `(1 - w D^-1 A) P` with `P` constant on each aggregate and weak entries of `A` added to its diagonal.
fn prolongation(
    matrix: &SparseRows,
    diagonal: &[f64],
    bound: f64,
    aggregate: &[u32],
    count: usize,
    strong: &(impl Fn(usize, u32, f64) -> bool + Sync),
) -> Result<SparseRows, LinalgError> {
    let factor = 4.0 / 3.0 / bound;
    SparseRows::of_rows(count, matrix.row_count(), |i, row| {
        row.push((aggregate[i], 0.0));
        let (columns, values) = matrix.row(i);
        let mut lumped = diagonal[i];
        for (&j, &value) in columns.iter().zip(values).filter(|(j, _)| **j as usize != i) {
            if !strong(i, j, value) {
                lumped += value;
                continue;
            }
            let to = aggregate[j as usize];
            match row.iter_mut().find(|(at, _)| *at == to) {
                Some((_, sum)) => *sum -= factor * value,
                None => row.push((to, -factor * value)),
            }
        }
        // A row with little but weak entries keeps its diagonal.
        let lumped = lumped.max(0.1 * diagonal[i]);
        row.iter_mut().for_each(|(_, value)| *value /= lumped);
        row[0].1 += 1.0 - factor;
        row.sort_unstable_by_key(|&(j, _)| j);
    })
}
