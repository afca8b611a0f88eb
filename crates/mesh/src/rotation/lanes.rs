//! Best rotations of several matrices at once: the same plain arithmetic in every lane.

use std::ops::{Add, Div, Mul, Sub};

use glam::DMat3;

use super::settle;

/// Matrices in a [`RotationBatch`]: two vector registers of four numbers, so that one computes while the other waits.
pub const LANES: usize = 8;

/// Length of the longest column of the adjugate below which a rotation counts as ambiguous and is settled by Jacobi rotations.
///
/// The column is at least half as long as the slope of the polynomial at its root; the slope is about twice the gap between the two
/// largest eigenvalues, and both the root's and the column's rounding grow with its inverse.
const AMBIGUOUS: f64 = 1e-2;

/// Sizes (squared) between which no square or product below leaves the range of numbers.
const SIZES: [f64; 2] = [1e-200, 1e200];

/// Newton steps; where the root is simple enough to be used, two or three do.
const MOST_STEPS: u32 = 12;

/// Up to [`LANES`] matrices whose best rotations are computed together.
///
/// Every lane gets the bits of [`best_rotation`](crate::best_rotation), whatever is in the others. Inlined into its caller and so compiled
/// for the processor features that are enabled there: call it under `pulp::Arch::dispatch`.
#[derive(Debug, Clone, Copy)]
pub struct RotationBatch {
    /// Entries by columns, then by lanes.
    entries: [[f64; LANES]; 9],
}

impl Default for RotationBatch {
    #[inline(always)]
    fn default() -> Self {
        Self { entries: [[0.0; LANES]; 9] }
    }
}

impl RotationBatch {
    /// Sets the matrix of a lane, given by columns.
    ///
    /// # Panics
    /// If there is no such lane.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, columns: &[[f64; 3]; 3]) {
        for (entries, &value) in self.entries.iter_mut().zip(columns.as_flattened()) {
            entries[lane] = value;
        }
    }

    /// Replaces the matrices of the first `count` lanes by their best rotations; what is in the others is undefined.
    #[inline(always)]
    pub fn fit(&mut self, count: usize) {
        let (rotations, found) = horn(&self.entries);
        // Rare, so out of the way.
        if found.iter().take(count).any(|found| !found) {
            self.fit_ambiguous(rotations, found, count);
        } else {
            self.entries = rotations;
        }
    }

    #[cold]
    #[inline(never)]
    fn fit_ambiguous(&mut self, rotations: [[f64; LANES]; 9], found: [bool; LANES], count: usize) {
        let given = std::mem::replace(&mut self.entries, rotations);
        for lane in (0..count.min(LANES)).filter(|&lane| !found[lane]) {
            let rotation = settle(DMat3::from_cols_array(&given.map(|entries| entries[lane])));
            self.set(lane, &rotation.to_cols_array_2d());
        }
    }

    /// The matrix of a lane, by columns.
    ///
    /// # Panics
    /// If there is no such lane.
    #[inline(always)]
    pub fn get(&self, lane: usize) -> [[f64; 3]; 3] {
        let e = |k: usize| self.entries[k][lane];
        [[e(0), e(1), e(2)], [e(3), e(4), e(5)], [e(6), e(7), e(8)]]
    }
}

/// The best rotation of each matrix (entries by columns) and whether it was found; where not, the numbers mean nothing.
///
/// Lanes do not know each other, and every lane does the same operations in the same order, so the bits depend on nothing but its
/// matrix.
#[inline(always)]
pub(super) fn horn<const N: usize>(s: &[[f64; N]; 9]) -> ([[f64; N]; 9], [bool; N]) {
    let size = sum_of_squares(|k| Wide(s[k]), 9);
    let scale = Wide([1.0; N]) / size.sqrt();
    // Not `map`, which the compiler does not always inline: it would then be compiled for narrow registers.
    let s: [Wide<N>; 9] = std::array::from_fn(|k| Wide(s[k]) * scale);
    let (q, length_squared) = longest_adjugate_column(&s, largest_root(&s));
    let found = std::array::from_fn(|l| {
        // Written so that NaN is not found.
        size.0[l] > SIZES[0] && size.0[l] < SIZES[1] && length_squared.0[l] > AMBIGUOUS * AMBIGUOUS
    });
    let rotation = rotation(&q, length_squared);
    (std::array::from_fn(|k| rotation[k].0), found)
}

/// The largest eigenvalue of Horn's matrix of each matrix of Frobenius norm 1, or NaN where Newton's method did not settle.
///
/// With the cofactor matrix `C` of `s`, the characteristic polynomial is `(x^2 - 1)^2 - 4 |C|^2 - 8 det(s) x`. Its
/// largest root is `x = sqrt(1 + 2 sqrt(|C|^2 + 2 det(s) x))`, the sum of the singular values with the sign of the determinant at the
/// least of them. The right side, taken at a bound of `x`, is a bound from above that is exact for flat rings; right of all roots
/// Newton's method falls monotonically.
#[inline(always)]
fn largest_root<const N: usize>(s: &[Wide<N>; 9]) -> Wide<N> {
    let [xx, yx, zx, xy, yy, zy, xz, yz, zz] = *s;
    let cofactors = [
        yy * zz - yz * zy,
        zy * xz - xy * zz,
        xy * yz - yy * xz,
        zx * yz - yx * zz,
        xx * zz - zx * xz,
        yx * xz - xx * yz,
        yx * zy - zx * yy,
        zx * xy - xx * zy,
        xx * yy - yx * xy,
    ];
    let det = xx * cofactors[0] + yx * cofactors[1] + zx * cofactors[2];
    let (four_square, eight_det) = (sum_of_squares(|k| cofactors[k], 9) * 4.0, det * 8.0);
    // Where the determinant is negative the bound falls as `x` grows, so it is taken at 0; else at sqrt(3), the most there is.
    let inner = four_square + eight_det.map(|d| d.max(0.0)) * 3.0_f64.sqrt();
    let mut x = (inner.sqrt() + 1.0).sqrt();
    let mut going = [true; N];
    for _ in 0..MOST_STEPS {
        let y = x * x - 1.0;
        let step = (y * y - (four_square + eight_det * x)) / (x * y * 4.0 - eight_det);
        // A lane that has settled stays as it is, however long the others take.
        x = Wide(std::array::from_fn(|l| if going[l] { x.0[l] - step.0[l] } else { x.0[l] }));
        // The next step would be of the order of the square of this one.
        going = std::array::from_fn(|l| going[l] && step.0[l].abs() > 1e-9);
        if going.iter().all(|going| !going) {
            break;
        }
    }
    Wide(std::array::from_fn(|l| if going[l] { f64::NAN } else { x.0[l] }))
}

/// The eigenvector of Horn's matrix `K` (`q^T K q = trace(R(q)^T s)` for a unit quaternion `q = (x, y, z, w)`) for its largest
/// eigenvalue, not normalised, and its squared length.
///
/// It is the longest column of the adjugate of `K - root`, which is `q q^T` times the product of the other eigenvalues of that: its
/// diagonal says which column is longest.
#[inline(always)]
fn longest_adjugate_column<const N: usize>(s: &[Wide<N>; 9], root: Wide<N>) -> ([Wide<N>; 4], Wide<N>) {
    let [xx, yx, zx, xy, yy, zy, xz, yz, zz] = *s;
    let (m00, m11, m22, m33) = (xx - yy - zz - root, yy - xx - zz - root, zz - xx - yy - root, xx + yy + zz - root);
    let (m01, m02, m12) = (xy + yx, xz + zx, yz + zy);
    let (m03, m13, m23) = (zy - yz, xz - zx, yx - xy);
    // 2 x 2 minors of the lower two rows and of the upper two, by their columns.
    let (low01, low02, low03) = (m02 * m13 - m12 * m03, m02 * m23 - m22 * m03, m02 * m33 - m23 * m03);
    let (low12, low13, low23) = (m12 * m23 - m22 * m13, m12 * m33 - m23 * m13, m22 * m33 - m23 * m23);
    let (high01, high02, high03) = (m00 * m11 - m01 * m01, m00 * m12 - m02 * m01, m00 * m13 - m03 * m01);
    let (high12, high13) = (m01 * m12 - m02 * m11, m01 * m13 - m03 * m11);
    let a00 = m11 * low23 - m12 * low13 + m13 * low12;
    let a01 = m12 * low03 - m01 * low23 - m13 * low02;
    let a02 = m01 * low13 - m11 * low03 + m13 * low01;
    let a03 = m11 * low02 - m01 * low12 - m12 * low01;
    let a11 = m00 * low23 - m02 * low03 + m03 * low02;
    let a12 = m01 * low03 - m00 * low13 - m03 * low01;
    let a13 = m00 * low12 - m01 * low02 + m02 * low01;
    let a22 = m03 * high13 - m13 * high03 + m33 * high01;
    let a23 = m13 * high02 - m03 * high12 - m23 * high01;
    let a33 = m02 * high12 - m12 * high02 + m22 * high01;
    let mut q = [a00, a01, a02, a03];
    let mut longest = a00.map(f64::abs);
    for (column, diagonal) in [([a01, a11, a12, a13], a11), ([a02, a12, a22, a23], a22), ([a03, a13, a23, a33], a33)] {
        let diagonal = diagonal.map(f64::abs);
        for (q, c) in q.iter_mut().zip(column) {
            *q = Wide(std::array::from_fn(|l| if diagonal.0[l] > longest.0[l] { c.0[l] } else { q.0[l] }));
        }
        longest = Wide(std::array::from_fn(|l| diagonal.0[l].max(longest.0[l])));
    }
    (q, sum_of_squares(|k| q[k], 4))
}

/// The rotation matrix of a quaternion that is not normalised, by columns.
#[inline(always)]
fn rotation<const N: usize>(q: &[Wide<N>; 4], length_squared: Wide<N>) -> [Wide<N>; 9] {
    let [x, y, z, w] = *q;
    let twice = Wide([2.0; N]) / length_squared;
    let (tx, ty, tz) = (x * twice, y * twice, z * twice);
    let (xx, yy, zz) = (x * tx, y * ty, z * tz);
    let (xy, xz, yz) = (x * ty, x * tz, y * tz);
    let (wx, wy, wz) = (w * tx, w * ty, w * tz);
    let one = Wide([1.0; N]);
    [one - (yy + zz), xy + wz, xz - wy, xy - wz, one - (xx + zz), yz + wx, xz + wy, yz - wx, one - (xx + yy)]
}

/// One number a lane.
#[derive(Clone, Copy)]
struct Wide<const N: usize>([f64; N]);

impl<const N: usize> Wide<N> {
    #[inline(always)]
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self(std::array::from_fn(|l| f(self.0[l])))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }
}

/// Summed in order.
#[inline(always)]
fn sum_of_squares<const N: usize>(term: impl Fn(usize) -> Wide<N>, terms: usize) -> Wide<N> {
    let mut total = Wide([0.0; N]);
    for k in 0..terms {
        total = total + term(k) * term(k);
    }
    total
}

/// Lane by lane with another lane set, or with one number for all lanes.
macro_rules! lanewise {
    ($($operator:ident, $name:ident, $sign:tt;)*) => {$(
        impl<const N: usize> $operator for Wide<N> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self(std::array::from_fn(|l| self.0[l] $sign other.0[l]))
            }
        }

        impl<const N: usize> $operator<f64> for Wide<N> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: f64) -> Self {
                self.map(|a| a $sign other)
            }
        }
    )*};
}

lanewise! {
    Add, add, +;
    Sub, sub, -;
    Mul, mul, *;
    Div, div, /;
}
