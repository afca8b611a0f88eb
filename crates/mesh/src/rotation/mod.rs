//! The rotation nearest to a matrix, one at a time or several in the lanes of vector registers.

mod jacobi;
mod lanes;

use glam::{DMat3, DVec3};

use jacobi::settle;
use lanes::horn;
pub use lanes::{LANES, RotationBatch};

/// The proper rotation `R` (determinant +1) that maximises `trace(R^T * s)`.
///
/// For `s = sum w e' e^T` this is the rotation that best takes the vectors `e` to `e'` in the least-squares sense
/// (Sorkine and Alexa 2007, Eq. 5-6, with the transpose of their covariance). Where several rotations are equally good (vectors
/// on one line or none at all, a reflection without a preferred plane) the one nearest to the identity is taken, so
/// the result is always finite and the same on every run. For a matrix that is zero or not finite it is the identity.
///
/// Costs about 0.1 us, most of it waiting for earlier results; [`RotationBatch`] does [`LANES`] in the time of two,
/// with the same bits. The unit quaternion of `R` is the eigenvector of the largest eigenvalue of a symmetric 4 x 4
/// matrix (Horn 1987): found by Newton's method on its characteristic polynomial, or by Jacobi rotations where that is
/// ill-conditioned. With singular values `a >= b >= c` of `s / |s|` and the sign `d` of its determinant, the gap to the next
/// eigenvalue is `g = 2 (b + d c)`; the result is off by some `1e-16 / g^2`, and never by more than 1e-10.
pub fn best_rotation(s: DMat3) -> DMat3 {
    let (columns, [found]) = horn(&s.to_cols_array().map(|entry| [entry]));
    if found { DMat3::from_cols_array(&columns.map(|[entry]| entry)) } else { settle(s) }
}

/// The uniform scale that, after the best rotation `r`, takes vectors of summed weighted square length
/// `rest` to those whose covariance with them is `s`: `trace(r^T s) / rest` (Umeyama 1991, Eq. 42).
///
/// Never below `1e-6`; 1 where `rest` is 0.
pub fn best_scale(r: DMat3, s: DMat3, rest: f64) -> f64 {
    let trace = r.x_axis.dot(s.x_axis) + r.y_axis.dot(s.y_axis) + r.z_axis.dot(s.z_axis);
    if rest > 0.0 { (trace / rest).max(1e-6) } else { 1.0 }
}

/// `target * rest^T`, the outer product that covariances are summed from.
pub fn outer(target: DVec3, rest: DVec3) -> DMat3 {
    DMat3::from_cols(target * rest.x, target * rest.y, target * rest.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(a: DMat3, b: DMat3) -> f64 {
        (0..3).map(|i| (a.col(i) - b.col(i)).length_squared()).sum::<f64>().sqrt()
    }

    fn some_rotations() -> impl Iterator<Item = DMat3> {
        (0..200).map(|i| {
            let t = f64::from(i);
            let axis = DVec3::new((1.3 * t).sin(), (0.7 * t).cos(), (2.1 * t).sin()).normalize();
            DMat3::from_axis_angle(axis, 0.11 * t)
        })
    }

    /// A positive definite stretch loses to the rotation in front of it: R * P has best rotation R.
    #[test]
    fn rotation_times_stretch_gives_back_the_rotation() {
        for (i, r) in some_rotations().enumerate() {
            let stretch = DMat3::from_diagonal(DVec3::new(1.0 + 0.01 * i as f64, 0.5, 0.02));
            for scale in [1e-12, 1.0, 1e12] {
                let found = best_rotation(r * stretch * scale);
                assert!(distance(found, r) < 1e-10, "rotation {i}: off by {}", distance(found, r));
            }
        }
    }

    /// No rotation of a fine net scores better, whatever the determinant's sign.
    #[test]
    fn nothing_scores_better_than_the_best() {
        let score = |r: DMat3, s: DMat3| (0..3).map(|c| r.col(c).dot(s.col(c))).sum::<f64>();
        for (i, q) in some_rotations().enumerate() {
            let s =
                q * DMat3::from_diagonal(DVec3::new(1.0, 0.3 - 0.002 * i as f64, -0.2)) * DMat3::from_rotation_x(0.3);
            let best = best_rotation(s);
            assert!((best.determinant() - 1.0).abs() < 1e-12);
            for other in some_rotations() {
                assert!(score(other, s) <= score(best, s) + 1e-12);
            }
        }
    }

    /// Vectors on one line leave the turn about the line open: the smallest turn is taken.
    #[test]
    fn ambiguous_cases_take_the_rotation_nearest_to_the_identity() {
        assert_eq!(best_rotation(DMat3::ZERO), DMat3::IDENTITY);
        let (from, to) = (DVec3::X, DVec3::new(1.0, 1.0, 0.0).normalize());
        let expected = DMat3::from_rotation_z(std::f64::consts::FRAC_PI_4);
        assert!(distance(best_rotation(outer(to, from)), expected) < 1e-12);
        // Opposite directions: any half turn across the line, but a proper rotation.
        let half_turn = best_rotation(outer(-DVec3::X, DVec3::X));
        assert!((half_turn.determinant() - 1.0).abs() < 1e-12);
        assert!((half_turn * DVec3::X + DVec3::X).length() < 1e-12);
        // The reflection -I: still proper.
        assert!((best_rotation(-DMat3::IDENTITY).determinant() - 1.0).abs() < 1e-12);
        assert!(best_rotation(DMat3::from_cols(DVec3::NAN, DVec3::X, DVec3::Y)) == DMat3::IDENTITY);
    }

    /// Matrices with singular values in decreasing order, the last with the sign of the determinant: round, flat, nearly flat,
    /// mirrored, on a line, and on the way to a tie of two rotations.
    fn families() -> Vec<(DMat3, [f64; 3])> {
        let mut all = Vec::new();
        for [a, b, c] in [
            [1.0, 1.0, 1.0],
            [1.0, 0.8, 0.5],
            [1.0, 0.9, 0.0],
            [1.0, 1.0, 1e-9],
            [1.0, 0.7, -0.1],
            [1.0, 0.5, -0.45],
            [1.0, 0.1, -0.09],
            [1.0, 1.0, -0.99],
            [1.0, 1e-3, 0.0],
            [1.0, 1e-5, -1e-6],
            [1.0, 0.0, 0.0],
            [1.0, 0.3, -0.3],
            [1.0, 1.0, -1.0],
        ] {
            for (left, right) in some_rotations().zip(some_rotations().skip(31)) {
                all.push((left * DMat3::from_diagonal(DVec3::new(a, b, c)) * right, [a, b, c]));
            }
        }
        all
    }

    /// The two ways agree as far as each is sharp: the root is off by rounding over the gap, and so is the column for a given root.
    #[test]
    fn newton_and_jacobi_agree() {
        let mut worst = 0.0f64;
        for (s, [a, b, c]) in families() {
            let gap = 2.0 * (b + c) / DVec3::new(a, b, c).length();
            if gap > 1e-9 {
                let off = distance(best_rotation(s), settle(s));
                let bound = 4e-15 + 4e-16 / (gap * gap).max(1e-5);
                assert!(off <= bound, "{a} {b} {c}: {off:e} over {bound:e}");
                worst = worst.max(off);
            }
        }
        assert!(worst > 0.0, "nothing was compared");
    }

    #[test]
    fn rotations_are_proper_whatever_the_scale() {
        for (s, [_, b, c]) in families() {
            let plain = best_rotation(s);
            for scale in [1e-300, 1e-150, 1e-90, 1.0, 1e90, 1e150, 1e300] {
                let r = best_rotation(s * scale);
                assert!(distance(r * r.transpose(), DMat3::IDENTITY) < 1e-14);
                assert!((r.determinant() - 1.0).abs() < 1e-14);
                // Where two rotations tie, rounding of the scale may choose.
                if b + c > 1e-2 {
                    assert!(distance(r, plain) < 1e-11, "{s} times {scale:e}");
                }
            }
        }
    }

    /// The same bits as one at a time: in every lane, beside any others, in full and in short batches.
    #[test]
    fn lanes_do_not_know_each_other() {
        let mut matrices: Vec<DMat3> = families().into_iter().map(|(s, _)| s).collect();
        let broken =
            [DMat3::ZERO, DMat3::from_diagonal(DVec3::new(1.0, f64::NAN, 0.0)), DMat3::IDENTITY * f64::INFINITY];
        let scales = [1e-300, 1e-120, 1e120, 1e300].map(|scale| matrices[40] * scale);
        for (k, odd) in broken.into_iter().chain(scales).enumerate() {
            matrices.insert(5 * k, odd);
        }
        let expected: Vec<DMat3> = matrices.iter().map(|s| best_rotation(*s)).collect();
        for size in 1..=LANES {
            for first in 0..size {
                let mut batch = RotationBatch::default();
                for (given, expected) in matrices[first..].chunks(size).zip(expected[first..].chunks(size)) {
                    for (lane, s) in given.iter().enumerate() {
                        batch.set(lane, &s.to_cols_array_2d());
                    }
                    batch.fit(given.len());
                    for (lane, expected) in expected.iter().enumerate() {
                        assert_eq!(batch.get(lane), expected.to_cols_array_2d());
                    }
                }
            }
        }
    }

    /// Compiled for wider registers, the same bits.
    #[test]
    fn wide_registers_change_no_bit() {
        struct Fit<'a>(&'a mut RotationBatch);
        impl pulp::WithSimd for Fit<'_> {
            type Output = ();

            #[inline(always)]
            fn with_simd<S: pulp::Simd>(self, _: S) {
                self.0.fit(LANES);
            }
        }
        for given in families().chunks_exact(LANES) {
            let mut batch = RotationBatch::default();
            for (lane, (s, _)) in given.iter().enumerate() {
                batch.set(lane, &s.to_cols_array_2d());
            }
            pulp::Arch::new().dispatch(Fit(&mut batch));
            for (lane, (s, _)) in given.iter().enumerate() {
                assert_eq!(batch.get(lane), best_rotation(*s).to_cols_array_2d());
            }
        }
    }
}
