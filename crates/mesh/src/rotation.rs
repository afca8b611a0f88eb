use glam::{DMat3, DQuat, DVec3};

/// A share of the matrix's size below which its best rotation counts as ambiguous and is settled by [`jacobi`].
const AMBIGUOUS: f64 = 1e-5;

/// The proper rotation `R` (determinant +1) that maximises `trace(R^T * s)`.
///
/// For `s = sum w e' e^T` this is the rotation that best takes the vectors `e` to `e'` in the least-squares sense
/// (Sorkine and Alexa 2007, Eq. 5-6, with the transpose of their covariance). Where several rotations are equally good (vectors
/// on one line or none at all, a reflection without a preferred plane) the one nearest to the identity is taken, so
/// the result is always finite and the same on every run.
///
/// Costs about 0.1 us. The unit quaternion of `R` is the eigenvector of the largest eigenvalue of a symmetric 4 x 4
/// matrix (Horn 1987): found by Newton's method on its characteristic polynomial, or by Jacobi rotations where that is
/// ill-conditioned.
pub fn best_rotation(s: DMat3) -> DMat3 {
    let size = s.x_axis.length_squared() + s.y_axis.length_squared() + s.z_axis.length_squared();
    if !(size > 0.0 && size.is_finite()) {
        return DMat3::IDENTITY;
    }
    let k = horn_matrix(s * size.sqrt().recip());
    let q = newton(&k).unwrap_or_else(|| jacobi(k));
    DMat3::from_quat(q)
}

/// The uniform scale that, after the best rotation `r`, takes vectors of summed weighted square length
/// `rest` to those whose covariance with them is `s`: `trace(r^T s) / rest` (Umeyama 1991, Eq. 42).
///
/// Never below `1e-6`; 1 where `rest` is 0.
pub fn best_scale(r: DMat3, s: DMat3, rest: f64) -> f64 {
    let trace = r.x_axis.dot(s.x_axis) + r.y_axis.dot(s.y_axis) + r.z_axis.dot(s.z_axis);
    if rest > 0.0 { (trace / rest).max(1e-6) } else { 1.0 }
}

/// Horn's matrix: `q^T K q = trace(R(q)^T s)` for a unit quaternion `q = (x, y, z, w)`.
fn horn_matrix(s: DMat3) -> [[f64; 4]; 4] {
    // Entry (i, j) of s is column j, component i.
    let (xx, yx, zx) = (s.x_axis.x, s.x_axis.y, s.x_axis.z);
    let (xy, yy, zy) = (s.y_axis.x, s.y_axis.y, s.y_axis.z);
    let (xz, yz, zz) = (s.z_axis.x, s.z_axis.y, s.z_axis.z);
    [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
}

/// Largest eigenvalue from above, then its eigenvector as a column of the adjugate of `K - lambda`.
///
/// `None` where the largest eigenvalue is (nearly) double, so that the adjugate (nearly) vanishes.
fn newton(k: &[[f64; 4]; 4]) -> Option<DQuat> {
    // Characteristic polynomial x^4 + c2 x^2 + c1 x + c0 (the trace is 0), from power sums of the eigenvalues.
    let k2 = square(k);
    let p2 = k2[0][0] + k2[1][1] + k2[2][2] + k2[3][3];
    let p3: f64 = (0..4).map(|i| (0..4).map(|j| k2[i][j] * k[i][j]).sum::<f64>()).sum();
    let p4: f64 = (0..4).map(|i| (0..4).map(|j| k2[i][j] * k2[i][j]).sum::<f64>()).sum();
    let c2 = -0.5 * p2;
    let c1 = -p3 / 3.0;
    let c0 = 0.125 * p2 * p2 - 0.25 * p4;
    // With a Frobenius norm of 1 the largest eigenvalue is at most sqrt(3): right of every root Newton falls monotonically.
    let mut x = 3.0_f64.sqrt();
    for _ in 0..50 {
        let value = ((x * x + c2) * x + c1) * x + c0;
        let slope = (4.0 * x * x + 2.0 * c2) * x + c1;
        if slope <= 0.0 {
            return None;
        }
        let step = value / slope;
        x -= step;
        if step.abs() <= 1e-15 {
            break;
        }
    }
    let mut m = *k;
    for (i, row) in m.iter_mut().enumerate() {
        row[i] -= x;
    }
    let (column, length_squared) = largest_adjugate_column(&m);
    (length_squared > AMBIGUOUS * AMBIGUOUS)
        .then(|| DQuat::from_array(column.map(|c| c / length_squared.sqrt())).normalize())
}

fn square(k: &[[f64; 4]; 4]) -> [[f64; 4]; 4] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|l| k[i][l] * k[l][j]).sum()))
}

/// The longest column of the adjugate of a symmetric matrix, and its squared length.
fn largest_adjugate_column(m: &[[f64; 4]; 4]) -> ([f64; 4], f64) {
    // 2 x 2 minors of the lower and of the upper two rows, by their columns.
    let minor = |r: usize, a: usize, b: usize| m[r][a] * m[r + 1][b] - m[r][b] * m[r + 1][a];
    let low = [minor(2, 0, 1), minor(2, 0, 2), minor(2, 0, 3), minor(2, 1, 2), minor(2, 1, 3), minor(2, 2, 3)];
    let high = [minor(0, 0, 1), minor(0, 0, 2), minor(0, 0, 3), minor(0, 1, 2), minor(0, 1, 3), minor(0, 2, 3)];
    // Determinants of 3 x 3 minors that leave out row i (taken from rows r) and column j.
    let expand = |row: usize, minors: &[f64; 6]| {
        let [m01, m02, m03, m12, m13, m23] = *minors;
        let r = m[row];
        [
            r[1] * m23 - r[2] * m13 + r[3] * m12,
            -(r[0] * m23 - r[2] * m03 + r[3] * m02),
            r[0] * m13 - r[1] * m03 + r[3] * m01,
            -(r[0] * m12 - r[1] * m02 + r[2] * m01),
        ]
    };
    let columns = [expand(1, &low), expand(0, &low), expand(3, &high), expand(2, &high)];
    let mut best = ([0.0; 4], -1.0);
    for column in columns {
        let length_squared: f64 = column.iter().map(|c| c * c).sum();
        if length_squared > best.1 {
            best = (column, length_squared);
        }
    }
    best
}

/// Eigen-decomposition by cyclic Jacobi rotations: the identity quaternion projected onto the space of the largest
/// eigenvalue, that is the best rotation nearest to the identity.
fn jacobi(mut k: [[f64; 4]; 4]) -> DQuat {
    let mut vectors = [[0.0; 4]; 4];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _sweep in 0..30 {
        let off: f64 = (0..4).flat_map(|p| (p + 1..4).map(move |q| (p, q))).map(|(p, q)| k[p][q] * k[p][q]).sum();
        if off < 1e-32 {
            break;
        }
        for p in 0..3 {
            for q in p + 1..4 {
                rotate(&mut k, &mut vectors, p, q);
            }
        }
    }
    let largest = (0..4).map(|i| k[i][i]).fold(f64::NEG_INFINITY, f64::max);
    let mut projected = [0.0; 4];
    let mut any = [0.0; 4];
    for i in (0..4).filter(|&i| largest - k[i][i] <= 1e-9) {
        for c in 0..4 {
            // Column i is the eigenvector; its component 3 is its product with the identity quaternion (0, 0, 0, 1).
            projected[c] += vectors[3][i] * vectors[c][i];
            any[c] = vectors[c][i];
        }
    }
    let length_squared: f64 = projected.iter().map(|c| c * c).sum();
    // Perpendicular to the identity: all candidates are half turns, none nearer than another.
    let q = if length_squared > 1e-20 { projected } else { any };
    DQuat::from_array(q).normalize()
}

/// One Jacobi rotation that makes entry (p, q) vanish.
fn rotate(k: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], p: usize, q: usize) {
    if k[p][q] == 0.0 {
        return;
    }
    let theta = (k[q][q] - k[p][p]) / (2.0 * k[p][q]);
    let t = if theta >= 0.0 { 1.0 } else { -1.0 } / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = (t * t + 1.0).sqrt().recip();
    let s = t * c;
    for row in k.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    let (kp, kq) = (k[p], k[q]);
    for i in 0..4 {
        k[p][i] = c * kp[i] - s * kq[i];
        k[q][i] = s * kp[i] + c * kq[i];
    }
    for row in vectors.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
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
}
