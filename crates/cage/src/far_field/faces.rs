//! Exact weights of many faces at once.

use glam::DVec3;
use pulp::Simd;

use super::lanes::Doubles;
use crate::mean_value::{EDGE_ON, FaceWeights, MeanValue, ON_FACE};

/// Faces are padded to a multiple of this, which is one of every register's lanes.
const WIDTH: usize = 8;

/// Corners and normals of faces from a point, as structure of arrays, and what they give to their corners.
#[derive(Debug, Default)]
pub(super) struct Faces {
    /// x, y, z of the corners, one after the other, and of the normal.
    coordinates: [Vec<f64>; 12],
    weights: [Vec<f64>; 3],
    /// How much too flat the face is seen for the plain formula: above 0, it needs a closer look.
    flat: Vec<f64>,
}

impl Faces {
    /// Calls `add` with each face and the unnormalised weights of its corners; if the point lies on one of them, returns
    /// that face and its barycentric coordinates instead.
    #[inline(always)]
    pub(super) fn weigh<S: Simd>(
        &mut self,
        simd: S,
        cage: &MeanValue,
        x: DVec3,
        faces: &[u32],
        mut add: impl FnMut(u32, [f64; 3]),
    ) -> Option<(u32, [f64; 3])> {
        let padded = faces.len().next_multiple_of(WIDTH);
        if self.flat.len() < padded {
            self.coordinates.iter_mut().for_each(|lanes| lanes.resize(padded, 1.0));
            self.weights.iter_mut().for_each(|lanes| lanes.resize(padded, 0.0));
            self.flat.resize(padded, 0.0);
        }
        let [ax, ay, az, bx, by, bz, cx, cy, cz, nx, ny, nz] = self.coordinates.each_mut().map(|l| &mut l[..padded]);
        for (k, &face) in faces.iter().enumerate() {
            let [a, b, c] = cage.corners(face as usize);
            let n = cage.normals()[face as usize];
            (ax[k], ay[k], az[k]) = (a.x - x.x, a.y - x.y, a.z - x.z);
            (bx[k], by[k], bz[k]) = (b.x - x.x, b.y - x.y, b.z - x.z);
            (cx[k], cy[k], cz[k]) = (c.x - x.x, c.y - x.y, c.z - x.z);
            (nx[k], ny[k], nz[k]) = (n.x, n.y, n.z);
        }
        for at in 0..padded / Doubles::<S>::COUNT {
            self.weigh_register(simd, at);
        }
        for (k, &face) in faces.iter().enumerate() {
            if self.flat[k] < 0.0 {
                add(face, [self.weights[0][k], self.weights[1][k], self.weights[2][k]]);
                continue;
            }
            match cage.face_weights(x, face as usize) {
                FaceWeights::On(barycentric) => return Some((face, barycentric)),
                FaceWeights::Weights(weights) => add(face, weights),
            }
        }
        None
    }

    /// `w_k = (n_k . m) / (n_k . v_k)` as for a single face; lanes beyond the last face hold older ones.
    #[inline(always)]
    fn weigh_register<S: Simd>(&mut self, simd: S, at: usize) {
        let all = |number| Doubles::all(simd, number);
        let load = |k: usize| Doubles::load(simd, &self.coordinates[k][..], at);
        let three = |k: usize| [load(k), load(k + 1), load(k + 2)];
        let (v, normal) = ([three(0), three(3), three(6)], three(9));
        let zero = all(0.0);
        let nearest = dot(&v[0], &v[0]).min(dot(&v[1], &v[1])).min(dot(&v[2], &v[2])).sqrt();
        let height = dot(&v[0], &normal).abs();
        ((all(EDGE_ON) * nearest).max(all(ON_FACE)) - height).store(&mut self.flat, at);
        let crosses = [cross(&v[1], &v[2]), cross(&v[2], &v[0]), cross(&v[0], &v[1])];
        let dots = [dot(&v[1], &v[2]), dot(&v[2], &v[0]), dot(&v[0], &v[1])];
        let mut mean = [zero; 3];
        for (cross, cosine) in crosses.iter().zip(dots) {
            let sine = dot(cross, cross).sqrt();
            let half = all(0.5) * angle(simd, sine, cosine) / sine;
            let half = zero.if_below(sine, half, zero);
            mean = [mean[0] + half * cross[0], mean[1] + half * cross[1], mean[2] + half * cross[2]];
        }
        let determinant = dot(&v[0], &crosses[0]);
        for (cross, weights) in crosses.iter().zip(&mut self.weights) {
            let weight = dot(cross, &mean) / determinant;
            zero.if_below(determinant.abs(), weight, zero).store(weights, at);
        }
    }
}

#[inline(always)]
fn cross<S: Simd>(a: &[Doubles<S>; 3], b: &[Doubles<S>; 3]) -> [Doubles<S>; 3] {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[inline(always)]
fn dot<S: Simd>(a: &[Doubles<S>; 3], b: &[Doubles<S>; 3]) -> Doubles<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `atan2(sine, cosine)` for `sine > 0`, up to 4e-16 of it: the rational approximation of the Cephes library (Moshier 1984, `atan`)
/// without branches.
#[inline(always)]
fn angle<S: Simd>(simd: S, sine: Doubles<S>, cosine: Doubles<S>) -> Doubles<S> {
    const P: [f64; 5] = [
        -0.875_060_860_003_190_4,
        -16.157_537_187_333_652,
        -75.008_557_923_147_05,
        -122.886_668_449_013_61,
        -64.850_219_049_420_25,
    ];
    const Q: [f64; 5] = [
        24.858_464_901_423_062,
        165.027_009_831_698_85,
        432.881_060_491_290_27,
        485.390_399_635_913_7,
        194.550_657_148_261_4,
    ];
    let all = |number| Doubles::all(simd, number);
    let size = cosine.abs();
    let (small, large) = (sine.min(size), sine.max(size));
    // Beyond 0.66 the tangent of the difference to an eighth turn is used.
    let steep = all(0.66) * large;
    let up = steep.if_below(small, small - large, small);
    let down = steep.if_below(small, small + large, large);
    let base = steep.if_below(small, all(std::f64::consts::FRAC_PI_4), all(0.0));
    let t = up / down;
    let z = t * t;
    let (mut p, mut q) = (all(P[0]), z + all(Q[0]));
    for k in 1..5 {
        p = p * z + all(P[k]);
        q = q * z + all(Q[k]);
    }
    let eighth = base + (t + t * (z * p / q));
    let quarter = size.if_below(sine, all(std::f64::consts::FRAC_PI_2) - eighth, eighth);
    cosine.if_below(all(0.0), all(std::f64::consts::PI) - quarter, quarter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_atan2() {
        let one = |sine: f64, cosine: f64| {
            let mut result = [0.0];
            let lanes = |number| Doubles::all(pulp::Scalar, number);
            angle(pulp::Scalar, lanes(sine), lanes(cosine)).store(&mut result, 0);
            result[0]
        };
        for i in 1..20_000 {
            let turn = f64::from(i) / 20_000.0 * std::f64::consts::PI;
            for size in [1e-9, 1.0, 3e7] {
                let (sine, cosine) = (size * turn.sin(), size * turn.cos());
                let error = (one(sine, cosine) - sine.atan2(cosine)).abs();
                assert!(error <= 4e-16 * turn, "{turn}: {error:e}");
            }
        }
        for tiny in [1e-300, 1e-30, 1e-12] {
            assert!((one(tiny, 1.0) - tiny).abs() <= 4e-16 * tiny);
            assert!((one(1.0, tiny) - 1.0_f64.atan2(tiny)).abs() <= 1e-15);
            assert!((one(tiny, -1.0) - tiny.atan2(-1.0)).abs() <= 2e-15);
        }
    }
}
