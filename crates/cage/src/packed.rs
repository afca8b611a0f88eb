//! Rows as propagation reads them: in blocks, each sorted by row length and then by place on the cage.
//!
//! Propagation does little with each weight, so little else should cost time. Three things would. The
//! length of rows varies, and each surprise costs the processor more than a row does: within a block rows of one length
//! follow each other. Cage vertices lie scattered: they are numbered along a space-filling curve, and rows of one length are
//! in the order of the cage vertex they lead with. And indices take as much room as weights: cages of up to 65,536 vertices
//! have indices of two bytes. A block is a stretch of the shape's vertices, so the tasks write to stretches of their own.

use std::ops::{Add, Mul, Sub};

use glam::{DVec3, Vec3};
use pliant_mesh::Bounds;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use crate::sparse::Rows;

/// Shape vertices a block; a place within it fits 16 bits, and its positions fit the first-level cache as f32.
pub(crate) const BLOCK: usize = 2048;

/// A number that rows are summed in.
pub(crate) trait Real:
    Copy + Send + Sync + Default + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + From<f32>
{
    /// As many as fill a vector register.
    type Register<S: Simd>: Copy;

    /// From the precision that frames are computed in.
    fn rounded(x: f64) -> Self;

    /// The register with this number in every lane.
    fn splat<S: Simd>(self, simd: S) -> Self::Register<S>;

    /// `sum + weight * value`, rounded twice: so bits do not depend on the processor.
    fn add_product<S: Simd>(
        simd: S,
        sum: Self::Register<S>,
        weight: Self::Register<S>,
        value: Self::Register<S>,
    ) -> Self::Register<S>;

    /// Numbers as registers; all of them, if their count is a multiple of the lanes of a register.
    fn registers<S: Simd>(numbers: &[Self]) -> &[Self::Register<S>];

    /// See [`Self::registers`].
    fn registers_mut<S: Simd>(numbers: &mut [Self]) -> &mut [Self::Register<S>];
}

/// [`Real`] for one of the two precisions, by pulp's names for it.
macro_rules! real {
    ($real:ty, $register:ident, $splat:ident, $mul:ident, $add:ident, $split:ident, $split_mut:ident) => {
        impl Real for $real {
            type Register<S: Simd> = S::$register;

            #[inline(always)]
            fn rounded(x: f64) -> Self {
                x as Self
            }

            #[inline(always)]
            fn splat<S: Simd>(self, simd: S) -> S::$register {
                simd.$splat(self)
            }

            #[inline(always)]
            fn add_product<S: Simd>(
                simd: S,
                sum: S::$register,
                weight: S::$register,
                value: S::$register,
            ) -> S::$register {
                simd.$add(sum, simd.$mul(weight, value))
            }

            #[inline(always)]
            fn registers<S: Simd>(numbers: &[Self]) -> &[S::$register] {
                S::$split(numbers).0
            }

            #[inline(always)]
            fn registers_mut<S: Simd>(numbers: &mut [Self]) -> &mut [S::$register] {
                S::$split_mut(numbers).0
            }
        }
    };
}

real!(f32, f32s, splat_f32s, mul_f32s, add_f32s, as_simd_f32s, as_mut_simd_f32s);
real!(f64, f64s, splat_f64s, mul_f64s, add_f64s, as_simd_f64s, as_mut_simd_f64s);

/// What a cage vertex does to a point `x` (relative to a centre): moves it by `linear x + offset`. The columns of the linear part, then
/// the offset, each filled up to four numbers: a whole number of vector registers, and one line of the cache in single precision.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(crate) struct Move<T>(pub(crate) [T; 16]);

/// Rows in the order of their blocks.
#[derive(Debug, Clone)]
pub(crate) struct Packed {
    blocks: Vec<Block>,
    /// Place of each cage vertex along the curve, its rank: what indices mean.
    pub(crate) rank: Vec<u32>,
    /// The cage vertex of each rank.
    pub(crate) by_rank: Vec<u32>,
    /// A point near the cage, which f32 holds exactly.
    pub(crate) centre: DVec3,
}

#[derive(Debug, Clone)]
struct Block {
    /// Length and number of rows, by increasing length.
    runs: Vec<(u32, u32)>,
    /// Of each row, its shape vertex within the block.
    place: Vec<u16>,
    /// Of each row, the rest position of its shape vertex.
    rest: Vec<Vec3>,
    indices: Indices,
    weights: Vec<f32>,
}

#[derive(Debug, Clone)]
enum Indices {
    Narrow(Vec<u16>),
    Wide(Vec<u32>),
}

impl Packed {
    pub(crate) fn new(rows: &Rows, shape: &[DVec3], cage: &[DVec3]) -> Self {
        let by_rank = along_curve(cage);
        let mut rank = vec![0; cage.len()];
        for (at, &j) in (0..).zip(&by_rank) {
            rank[j as usize] = at;
        }
        let narrow = cage.len() <= 1 << 16;
        let starts: Vec<usize> = (0..rows.len()).step_by(BLOCK).collect();
        let block = |&first: &usize| Block::new(rows, shape, first..(first + BLOCK).min(rows.len()), &rank, narrow);
        let blocks = starts.par_iter().map(block).collect();
        Self { blocks, rank, by_rank, centre: Bounds::of(cage).centre().as_vec3().as_dvec3() }
    }

    pub(crate) fn bytes(&self) -> usize {
        let of = |b: &Block| {
            let index = match b.indices {
                Indices::Narrow(_) => size_of::<u16>(),
                Indices::Wide(_) => size_of::<u32>(),
            };
            b.weights.len() * (size_of::<f32>() + index) + b.place.len() * (2 + 2 * size_of::<Vec3>())
        };
        self.blocks.iter().map(of).sum()
    }

    /// Sums every row of `values`, which are in the order of ranks, and has `finish` turn each sum into a vertex of the shape.
    pub(crate) fn sum<T: Real, V: Lanes<T, N>, F: Finish<T, N>, const N: usize>(
        &self,
        values: &[V],
        shape: &mut [F::Point],
        finish: &F,
    ) {
        let arch = pulp::Arch::new();
        shape.par_chunks_mut(BLOCK).zip(&self.blocks).enumerate().for_each(|(b, (shape, block))| {
            arch.dispatch(SumRows { block, first: b * BLOCK, values, shape, finish });
        });
    }
}

/// What is summed.
pub(crate) trait Lanes<T: Real, const N: usize>: Copy + Sync {
    /// `weight values[indices[0]] + sum_e weights[e] values[indices[e]]` over the other entries of a row.
    fn sum<S: Simd, I: Copy + Into<u32>>(simd: S, values: &[Self], row: (&[I], &[f32]), weight: T) -> [T; N];
}

impl<T: Real> Lanes<T, 4> for [T; 4] {
    #[inline(always)]
    fn sum<S: Simd, I: Copy + Into<u32>>(_: S, values: &[Self], row: (&[I], &[f32]), weight: T) -> [T; 4] {
        let mut sum = values[row.0[0].into() as usize].map(|v| weight * v);
        for (&j, &w) in row.0[1..].iter().zip(&row.1[1..]) {
            for (sum, v) in sum.iter_mut().zip(values[j.into() as usize]) {
                *sum = *sum + T::from(w) * v;
            }
        }
        sum
    }
}

impl<T: Real> Lanes<T, 16> for Move<T> {
    #[inline(always)]
    fn sum<S: Simd, I: Copy + Into<u32>>(simd: S, values: &[Self], row: (&[I], &[f32]), weight: T) -> [T; 16] {
        // As many of these are used as the 16 numbers fill; the compiler does away with the others.
        let mut sums = [T::default().splat(simd); 16];
        let mut add = |j: I, w: T| {
            let weight = w.splat(simd);
            for (sum, value) in sums.iter_mut().zip(T::registers::<S>(&values[j.into() as usize].0)) {
                *sum = T::add_product(simd, *sum, weight, *value);
            }
        };
        add(row.0[0], weight);
        for (&j, &w) in row.0[1..].iter().zip(&row.1[1..]) {
            add(j, T::from(w));
        }
        let mut numbers = Move::default();
        for (to, sum) in T::registers_mut::<S>(&mut numbers.0).iter_mut().zip(sums) {
            *to = sum;
        }
        numbers.0
    }
}

/// What becomes of a row's sum.
pub(crate) trait Finish<T, const N: usize>: Sync {
    /// A vertex of the shape.
    type Point: Send;

    /// Whether the leading weight is what the others leave of 1, so that weights sum to 1 beyond the precision they are stored in.
    const EXACT: bool;

    /// The place of shape vertex `i` with the given rest position, whose row of `length` entries leads with the cage vertex of
    /// rank `leading`.
    fn finish(&self, i: usize, rest: Vec3, leading: usize, length: usize, sum: &[T; N]) -> Self::Point;
}

impl Block {
    fn new(rows: &Rows, shape: &[DVec3], range: std::ops::Range<usize>, rank: &[u32], narrow: bool) -> Self {
        let first = range.start;
        let mut order: Vec<(u32, u32, u16)> = range
            .map(|i| {
                let (indices, _) = rows.row(i);
                (indices.len() as u32, rank[indices[0] as usize], (i - first) as u16)
            })
            .collect();
        order.sort_unstable();
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for &(length, _, _) in &order {
            match runs.last_mut() {
                Some(run) if run.0 == length => run.1 += 1,
                _ => runs.push((length, 1)),
            }
        }
        let row = |o: &(u32, u32, u16)| rows.row(first + o.2 as usize);
        let entries = order.iter().map(|o| o.0 as usize).sum();
        let mut weights = Vec::with_capacity(entries);
        order.iter().for_each(|o| weights.extend_from_slice(row(o).1));
        let indices = match narrow {
            true => Indices::Narrow(gather(order.iter().map(|o| row(o).0), entries, |j| rank[j as usize] as u16)),
            false => Indices::Wide(gather(order.iter().map(|o| row(o).0), entries, |j| rank[j as usize])),
        };
        Self {
            runs,
            rest: order.iter().map(|o| shape[first + o.2 as usize].as_vec3()).collect(),
            place: order.iter().map(|o| o.2).collect(),
            indices,
            weights,
        }
    }
}

/// The numbers of all rows' indices end to end, `entries` in all.
fn gather<'a, I>(rows: impl Iterator<Item = &'a [u32]>, entries: usize, number: impl Fn(u32) -> I) -> Vec<I> {
    let mut gathered = Vec::with_capacity(entries);
    rows.for_each(|indices| gathered.extend(indices.iter().map(|&j| number(j))));
    gathered
}

/// The work on one block, compiled for the widest vectors there are. Products and sums stay apart, so bits do not depend on
/// them.
struct SumRows<'a, T, V, F: Finish<T, N>, const N: usize> {
    block: &'a Block,
    first: usize,
    values: &'a [V],
    shape: &'a mut [F::Point],
    finish: &'a F,
}

impl<T: Real, V: Lanes<T, N>, F: Finish<T, N>, const N: usize> WithSimd for SumRows<'_, T, V, F, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match &self.block.indices {
            Indices::Narrow(indices) => self.sum(simd, indices),
            Indices::Wide(indices) => self.sum(simd, indices),
        }
    }
}

impl<T: Real, V: Lanes<T, N>, F: Finish<T, N>, const N: usize> SumRows<'_, T, V, F, N> {
    #[inline(always)]
    fn sum<S: Simd, I: Copy + Into<u32>>(self, simd: S, indices: &[I]) {
        let Self { block, first, values, shape, finish } = self;
        // Sums are put by before they are finished: a loop that does both is compiled for lanes that no register has.
        let mut sums = [[T::default(); N]; GROUP];
        let (mut row, mut at) = (0, 0);
        for &(length, count) in &block.runs {
            let (length, end) = (length as usize, row + count as usize);
            while row < end {
                let count = GROUP.min(end - row);
                let entries = at..at + length * count;
                let indices = indices[entries.clone()].chunks_exact(length);
                let weights = block.weights[entries].chunks_exact(length);
                for ((sum, indices), weights) in sums.iter_mut().zip(indices.clone()).zip(weights) {
                    let weight = if F::EXACT { left_of_one(&weights[1..]) } else { T::from(weights[0]) };
                    *sum = V::sum(simd, values, (indices, weights), weight);
                }
                let places = block.place[row..row + count].iter().zip(&block.rest[row..row + count]);
                for ((sum, indices), (&place, &rest)) in sums.iter().zip(indices).zip(places) {
                    let (leading, place) = (indices[0].into() as usize, place as usize);
                    shape[place] = finish.finish(first + place, rest, leading, length, sum);
                }
                row += count;
                at += length * count;
            }
        }
    }
}

/// Rows that are summed before they are finished.
const GROUP: usize = 32;

/// The leading weight of a row whose other weights are given.
#[inline(always)]
pub(crate) fn left_of_one<T: Real>(others: &[f32]) -> T {
    T::from(1.0) - others.iter().fold(T::default(), |sum, &w| sum + T::from(w))
}

/// The points in the order of a Morton curve through all of them, by number on ties.
pub(crate) fn along_curve(points: &[DVec3]) -> Vec<u32> {
    let bounds = Bounds::of(points);
    let cell = |p: &DVec3| {
        let share = (*p - bounds.min) / bounds.size().max_element();
        // A cloud without extent has no shares; NaN becomes 0.
        (share * 1023.0).to_array().map(|x| x as u32)
    };
    // Spreads ten bits three apart.
    let spread = |x: u32| (0..10).fold(0u32, |code, bit| code | ((x >> bit) & 1) << (3 * bit));
    let code = |p: &DVec3| {
        let [x, y, z] = cell(p);
        spread(x) | spread(y) << 1 | spread(z) << 2
    };
    let mut order: Vec<(u32, u32)> = (0..).zip(points).map(|(j, p)| (code(p), j)).collect();
    order.sort_unstable();
    order.into_iter().map(|o| o.1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Neighbours on the curve are neighbours in space, on average: on a grid, most steps go to an adjacent point.
    #[test]
    fn the_curve_visits_every_point_and_stays_near() {
        let grid: Vec<DVec3> =
            (0..4096).map(|i| DVec3::new((i % 16) as f64, (i / 16 % 16) as f64, (i / 256) as f64)).collect();
        let order = along_curve(&grid);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..4096), "a permutation");
        let order: Vec<DVec3> = order.iter().map(|&j| grid[j as usize]).collect();
        let mean = order.windows(2).map(|w| w[0].distance(w[1])).sum::<f64>() / 4095.0;
        assert!(mean < 2.5, "{mean}");
        assert_eq!(along_curve(&[DVec3::ONE; 3]), [0, 1, 2]);
    }
}
