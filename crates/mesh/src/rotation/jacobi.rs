//! Best rotations by a robust but slow way: for the few matrices whose best rotation is ambiguous or nearly so.

use glam::{DMat3, DQuat};

/// The best rotation of any matrix, by [`jacobi`].
#[cold]
#[inline(never)]
pub(super) fn settle(s: DMat3) -> DMat3 {
    let largest = s.to_cols_array().into_iter().fold(0.0, |m: f64, entry| m.max(entry.abs()));
    // NaN entries pass the maximum, so the sum is looked at as well.
    if !(largest > 0.0 && s.to_cols_array().into_iter().sum::<f64>().is_finite() && largest.is_finite()) {
        return DMat3::IDENTITY;
    }
    // Twice, as squares of very small or large entries leave the range of numbers.
    let s = DMat3::from_cols_array(&s.to_cols_array().map(|entry| entry / largest));
    let size = s.x_axis.length_squared() + s.y_axis.length_squared() + s.z_axis.length_squared();
    DMat3::from_quat(jacobi(horn_matrix(s * size.sqrt().recip())))
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
