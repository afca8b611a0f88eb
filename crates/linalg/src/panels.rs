//! A Cholesky factor laid out for solving: panels of up to four columns, over rows of three right-hand sides padded to the
//! width of a register.

use pulp::{Arch, Simd, WithSimd};

/// Columns of a panel: its solution stays in registers while its rows pass.
const WIDEST: usize = 4;

/// Zeros that may be stored to make a panel wider, as a share of its numbers below the diagonal: a number costs less than
/// fetching and storing a row of right-hand sides once more.
const MOST_ZEROS: f64 = 0.3;

/// One row of right-hand sides; the last number is always 0.
type Row = [f64; 4];

/// Lower triangular factor `L` of the free unknowns, in the order of elimination.
///
/// A panel is some consecutive columns with the same rows below them (zeros are stored where they differ), so that each row of
/// right-hand sides is fetched once for all of them.
#[derive(Default)]
pub(crate) struct Panels {
    /// Unknown behind each pivot.
    order: Vec<u32>,
    panels: Vec<Panel>,
    /// Pivots of the rows below each panel, increasing.
    rows: Vec<u32>,
    /// Per panel its triangle by rows, with inverted diagonal, then its rows below that.
    values: Vec<f64>,
    /// By pivot.
    work: Vec<Row>,
}

#[derive(Clone, Copy)]
struct Panel {
    /// Its first pivot.
    first: u32,
    width: u32,
    /// Where its rows begin; they end where those of the next panel do.
    rows: usize,
    /// Where its values begin.
    values: usize,
}

/// A factor as faer has it: entries of a column below the diagonal, and the diagonal.
pub(crate) trait Columns {
    /// Calls `entry(row, value)` for the stored entries of a column, the diagonal first and rows increasing.
    fn for_each(&self, column: usize, entry: impl FnMut(usize, f64));
}

impl Panels {
    /// Takes over the columns of free unknowns, in the same memory; `unknown` says which is behind each of `columns` columns.
    ///
    /// Entries in rows of unknowns that are not free are left out: they are 0.
    pub(crate) fn fill(
        &mut self,
        columns: usize,
        factor: &impl Columns,
        unknown: impl Fn(usize) -> usize,
        is_free: impl Fn(usize) -> bool,
    ) {
        const LEFT_OUT: u32 = u32::MAX;
        self.order.clear();
        self.panels.clear();
        self.rows.clear();
        self.values.clear();
        let mut pivot = vec![LEFT_OUT; columns];
        let mut kept = Vec::new();
        for (column, pivot) in pivot.iter_mut().enumerate() {
            let unknown = unknown(column);
            if is_free(unknown) {
                *pivot = kept.len() as u32;
                kept.push(column);
                self.order.push(unknown as u32);
            }
        }
        // Where a row is in the open panel.
        let mut place = vec![0u32; kept.len()];
        let mut below: Vec<u32> = Vec::new();
        let mut first = 0;
        for (k, &column) in kept.iter().enumerate() {
            let before = std::mem::take(&mut below);
            factor.for_each(column, |row, _| {
                if pivot[row] != LEFT_OUT && row != column {
                    below.push(pivot[row]);
                }
            });
            // If the open panel has this row, then its further rows are among this column's, as elimination fills them in.
            let width = k - first;
            let zeros = (below.len() + 1).saturating_sub(before.len()) * width;
            let joins = before.first() == Some(&(k as u32))
                && width < WIDEST
                && zeros as f64 <= MOST_ZEROS * ((width + 1) * below.len()) as f64;
            if !joins && k > 0 {
                self.close(first, &kept[first..k], &before, &pivot, &mut place, factor);
                first = k;
            }
        }
        if first < kept.len() {
            self.close(first, &kept[first..], &below, &pivot, &mut place, factor);
        }
        self.work.clear();
        self.work.resize(kept.len(), [0.0; 4]);
    }

    /// Stores a panel of the given columns.
    fn close(
        &mut self,
        first: usize,
        columns: &[usize],
        below: &[u32],
        pivot: &[u32],
        place: &mut [u32],
        factor: &impl Columns,
    ) {
        let width = columns.len();
        let values = self.values.len();
        self.panels.push(Panel { first: first as u32, width: width as u32, rows: self.rows.len(), values });
        self.rows.extend_from_slice(below);
        let triangle = width * (width + 1) / 2;
        self.values.resize(values + triangle + below.len() * width, 0.0);
        let panel = &mut self.values[values..];
        for (at, &row) in below.iter().enumerate() {
            place[row as usize] = (triangle + at * width) as u32;
        }
        for (c, &column) in columns.iter().enumerate() {
            factor.for_each(column, |row, value| {
                // Rows left out are beyond all pivots.
                let row = pivot[row] as usize;
                if row < first + width {
                    let r = row - first;
                    panel[r * (r + 1) / 2 + c] = if r == c { 1.0 / value } else { value };
                } else if let Some(&at) = place.get(row) {
                    panel[at as usize + c] = value;
                }
            });
        }
    }

    /// Numbers stored.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Solves for the rows of free unknowns and leaves the others as they are. The least unknown whose solution is not finite, if any.
    pub(crate) fn solve(&mut self, rhs: &mut [[f64; 3]]) -> Result<(), usize> {
        Arch::new().dispatch(Solve { panels: self, rhs })
    }
}

struct Solve<'a> {
    panels: &'a mut Panels,
    rhs: &'a mut [[f64; 3]],
}

impl WithSimd for Solve<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { panels: Panels { order, panels, rows, values, work }, rhs } = self;
        for (row, &unknown) in work.iter_mut().zip(&*order) {
            let [x, y, z] = rhs[unknown as usize];
            *row = [x, y, z, 0.0];
        }
        let mut ends = (rows.len(), values.len());
        for (k, panel) in panels.iter().enumerate() {
            let next = panels.get(k + 1).map_or(ends, |next| (next.rows, next.values));
            let (rows, values) = (&rows[panel.rows..next.0], &values[panel.values..next.1]);
            match panel.width {
                1 => forward::<1>(panel, rows, values, work),
                2 => forward::<2>(panel, rows, values, work),
                3 => forward::<3>(panel, rows, values, work),
                _ => forward::<WIDEST>(panel, rows, values, work),
            }
        }
        for panel in panels.iter().rev() {
            let (rows, values) = (&rows[panel.rows..ends.0], &values[panel.values..ends.1]);
            match panel.width {
                1 => backward::<1>(panel, rows, values, work),
                2 => backward::<2>(panel, rows, values, work),
                3 => backward::<3>(panel, rows, values, work),
                _ => backward::<WIDEST>(panel, rows, values, work),
            }
            ends = (panel.rows, panel.values);
        }
        let mut finite = true;
        for (row, &unknown) in work.iter().zip(&*order) {
            let [x, y, z, _] = *row;
            finite &= x.is_finite() & y.is_finite() & z.is_finite();
            rhs[unknown as usize] = [x, y, z];
        }
        if finite {
            return Ok(());
        }
        let broken = |&unknown: &u32| !rhs[unknown as usize].iter().all(|x| x.is_finite());
        Err(order.iter().copied().filter(broken).min().map_or(0, |unknown| unknown as usize))
    }
}

/// `y -= factor * x`.
#[inline(always)]
fn subtract(y: &mut Row, factor: f64, x: &Row) {
    for (y, x) in y.iter_mut().zip(x) {
        *y -= factor * x;
    }
}

#[inline(always)]
fn scale(y: &mut Row, factor: f64) {
    for y in y {
        *y *= factor;
    }
}

/// The panel's part of `L y = b`.
#[inline(always)]
fn forward<const W: usize>(panel: &Panel, rows: &[u32], values: &[f64], work: &mut [Row]) {
    let first = panel.first as usize;
    let (triangle, below) = values.split_at(W * (W + 1) / 2);
    let mut x = [[0.0; 4]; W];
    x.copy_from_slice(&work[first..first + W]);
    for r in 0..W {
        let (solved, rest) = x.split_at_mut(r);
        for (c, solved) in solved.iter().enumerate() {
            subtract(&mut rest[0], triangle[r * (r + 1) / 2 + c], solved);
        }
        scale(&mut rest[0], triangle[r * (r + 1) / 2 + r]);
    }
    work[first..first + W].copy_from_slice(&x);
    for (&row, factors) in rows.iter().zip(below.as_chunks::<W>().0) {
        let mut y = work[row as usize];
        for (&factor, x) in factors.iter().zip(&x) {
            subtract(&mut y, factor, x);
        }
        work[row as usize] = y;
    }
}

/// The panel's part of `L^T x = y`.
#[inline(always)]
fn backward<const W: usize>(panel: &Panel, rows: &[u32], values: &[f64], work: &mut [Row]) {
    let first = panel.first as usize;
    let (triangle, below) = values.split_at(W * (W + 1) / 2);
    let mut x = [[0.0; 4]; W];
    x.copy_from_slice(&work[first..first + W]);
    for (&row, factors) in rows.iter().zip(below.as_chunks::<W>().0) {
        let y = work[row as usize];
        for (&factor, x) in factors.iter().zip(&mut x) {
            subtract(x, factor, &y);
        }
    }
    for r in (0..W).rev() {
        let (open, solved) = x.split_at_mut(r + 1);
        let open = &mut open[r];
        for (s, solved) in (r + 1..).zip(&*solved) {
            subtract(open, triangle[s * (s + 1) / 2 + r], solved);
        }
        scale(open, triangle[r * (r + 1) / 2 + r]);
    }
    work[first..first + W].copy_from_slice(&x);
}
