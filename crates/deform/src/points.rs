//! Points that are held without being vertices.

use glam::DVec3;

/// How far the weights of a row may be from a sum of 1.
const SUM_TOLERANCE: f64 = 1e-6;

/// Largest sum of magnitudes of a row's weights: beyond, their sum is rounding.
const LARGEST_SUM: f64 = 1e6;

/// What is wrong with a row.
pub(crate) enum RowFault {
    VertexOutOfRange(u32),
    NotFinite,
    Sum(f64),
}

/// Points as weighted sums of vertices, `sum_j c_j v_j`: one row per point, a list of vertices and weights that sum to 1.
///
/// On a control mesh they are the rows of a binding, so that a point of the shape is held to its goal; on a mesh of its own
/// they are points within faces, by barycentric coordinates.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointRows {
    /// Where each row ends.
    ends: Vec<u32>,
    entries: Vec<(u32, f64)>,
}

impl PointRows {
    /// No row yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a point, as vertices and weights. Weights at the same vertex add up; those of 0 are dropped.
    pub fn push(&mut self, row: impl IntoIterator<Item = (u32, f64)>) {
        let start = self.entries.len();
        self.entries.extend(row);
        self.entries[start..].sort_by_key(|&(vertex, _)| vertex);
        let mut end = start;
        for at in start..self.entries.len() {
            let (vertex, weight) = self.entries[at];
            if end > start && self.entries[end - 1].0 == vertex {
                self.entries[end - 1].1 += weight;
            } else {
                self.entries[end] = (vertex, weight);
                end += 1;
            }
        }
        // Of this row alone: a pass over all rows for each would take time in their square.
        let (mut kept, row) = (start, start..end);
        for at in row {
            if self.entries[at].1 != 0.0 {
                self.entries[kept] = self.entries[at];
                kept += 1;
            }
        }
        self.entries.truncate(kept);
        self.ends.push(self.entries.len() as u32);
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// The rows in the order given: vertices, increasing, and weights.
    pub fn iter(&self) -> impl Iterator<Item = &[(u32, f64)]> + Clone + '_ {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.entries[start as usize..end as usize])
    }

    /// The first row that cannot be used on a mesh of `vertices` vertices, and why.
    pub(crate) fn fault(&self, vertices: usize) -> Option<(usize, RowFault)> {
        self.iter().enumerate().find_map(|(number, row)| row_fault(row, vertices).map(|fault| (number, fault)))
    }
}

fn row_fault(row: &[(u32, f64)], vertices: usize) -> Option<RowFault> {
    if let Some(&(vertex, _)) = row.iter().find(|(vertex, _)| *vertex as usize >= vertices) {
        return Some(RowFault::VertexOutOfRange(vertex));
    }
    if !row.iter().all(|(_, weight)| weight.is_finite()) {
        return Some(RowFault::NotFinite);
    }
    let magnitude: f64 = row.iter().map(|(_, weight)| weight.abs()).sum();
    let sum: f64 = row.iter().map(|(_, weight)| weight).sum();
    // Written so that an overflow is at fault.
    let is_valid = (sum - 1.0).abs() <= SUM_TOLERANCE && magnitude <= LARGEST_SUM;
    (!is_valid).then_some(RowFault::Sum(sum))
}

impl<R: IntoIterator<Item = (u32, f64)>> FromIterator<R> for PointRows {
    fn from_iter<I: IntoIterator<Item = R>>(rows: I) -> Self {
        let mut all = Self::new();
        rows.into_iter().for_each(|row| all.push(row));
        all
    }
}

/// `sum_j c_j v_j`.
pub(crate) fn combine(row: &[(u32, f64)], at: impl Fn(u32) -> DVec3) -> DVec3 {
    row.iter().map(|&(vertex, weight)| weight * at(vertex)).sum()
}

/// `sum_j c_j`, which is 1 but for rounding of whoever made the row.
pub(crate) fn sum(row: &[(u32, f64)]) -> f64 {
    row.iter().map(|(_, weight)| weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_sorted_and_summed() {
        let rows: PointRows =
            [vec![(4, 0.25), (1, 0.5), (4, 0.25)], vec![], vec![(2, 0.0), (0, 1.0)]].into_iter().collect();
        assert_eq!(rows.len(), 3);
        let all: Vec<&[(u32, f64)]> = rows.iter().collect();
        assert_eq!(all, [&[(1, 0.5), (4, 0.5)][..], &[], &[(0, 1.0)]]);
        assert_eq!(combine(all[0], |v| DVec3::X * f64::from(v)), DVec3::X * 2.5);
        assert_eq!(sum(all[0]), 1.0);
    }
}
