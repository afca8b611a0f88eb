//! Exact weights of many faces, four at a time.

use glam::DVec3;

use super::lanes::Lanes;
use crate::mean_value::{FaceWeights, MeanValue, is_plain};

/// Faces looked at together.
const WIDTH: usize = 4;

type Four = Lanes<f64, WIDTH>;
type Vectors = [Four; 3];

/// Corners of four faces from a point.
#[derive(Clone, Copy)]
struct Batch {
    corners: [Vectors; 3],
}

/// Calls `add` with each face and the unnormalised weights of its corners; if the point lies on one of them, returns that
/// face and its barycentric coordinates instead.
#[inline(always)]
pub(super) fn weigh_faces(
    cage: &MeanValue,
    x: DVec3,
    faces: &[u32],
    mut add: impl FnMut(u32, [f64; 3]),
) -> Option<(u32, [f64; 3])> {
    let mut batch = Batch { corners: [[Four::all(1.0); 3]; 3] };
    let (mut members, mut filled) = ([0; WIDTH], 0);
    for &face in faces {
        let v = cage.corners(face as usize).map(|p| p - x);
        if !is_plain(&v, cage.normals()[face as usize]) {
            match cage.face_weights(x, face as usize) {
                FaceWeights::On(barycentric) => return Some((face, barycentric)),
                FaceWeights::Weights(weights) => add(face, weights),
            }
            continue;
        }
        members[filled] = face;
        for (corner, p) in batch.corners.iter_mut().zip(v) {
            corner[0].0[filled] = p.x;
            corner[1].0[filled] = p.y;
            corner[2].0[filled] = p.z;
        }
        filled += 1;
        if filled == WIDTH {
            let weights = batch.weights();
            for k in 0..WIDTH {
                add(members[k], weights.map(|w| w.0[k]));
            }
            filled = 0;
        }
    }
    // Lanes left over hold older faces; what they give is not used.
    if filled > 0 {
        let weights = batch.weights();
        for k in 0..filled {
            add(members[k], weights.map(|w| w.0[k]));
        }
    }
    None
}

impl Batch {
    /// `w_k = (n_k . m) / (n_k . v_k)` as for a single face.
    #[inline(always)]
    fn weights(&self) -> [Four; 3] {
        let v = &self.corners;
        let zero = Four::all(0.0);
        let crosses = [cross(&v[1], &v[2]), cross(&v[2], &v[0]), cross(&v[0], &v[1])];
        let dots = [dot(&v[1], &v[2]), dot(&v[2], &v[0]), dot(&v[0], &v[1])];
        let mut mean = [zero; 3];
        for (c, d) in crosses.iter().zip(dots) {
            let sine = dot(c, c).sqrt();
            let half = Four::all(0.5) * angle(sine, d) / sine;
            let half = sine.choose(zero, |a, b| a > b, half, zero);
            for (m, c) in mean.iter_mut().zip(c) {
                *m = *m + half * *c;
            }
        }
        let determinant = dot(&v[0], &crosses[0]);
        crosses.map(|c| determinant.choose(zero, |a, b| a == b, zero, dot(&c, &mean) / determinant))
    }
}

#[inline(always)]
fn cross(a: &Vectors, b: &Vectors) -> Vectors {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[inline(always)]
fn dot(a: &Vectors, b: &Vectors) -> Four {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `atan2(sine, cosine)` for `sine > 0`, up to 4e-16 of it: the rational approximation of the Cephes library (Moshier 1984, `atan`)
/// without branches.
#[inline(always)]
fn angle(sine: Four, cosine: Four) -> Four {
    const P: [f64; 5] = [
        -8.750_608_600_031_904_122_785e-1,
        -1.615_753_718_733_365_076_637e1,
        -7.500_855_792_314_704_667_340e1,
        -1.228_866_684_490_136_173_410e2,
        -6.485_021_904_942_025_371_773e1,
    ];
    const Q: [f64; 5] = [
        2.485_846_490_142_306_297_962e1,
        1.650_270_098_316_988_542_046e2,
        4.328_810_604_912_902_668_951e2,
        4.853_903_996_359_136_964_868e2,
        1.945_506_571_482_613_964_425e2,
    ];
    let less = |a: f64, b: f64| a < b;
    let all = Four::all;
    let size = cosine.abs();
    let small = sine.choose(size, less, sine, size);
    let large = sine.choose(size, less, size, sine);
    // Beyond 0.66 the tangent of the difference to an eighth turn is used.
    let steep = all(0.66) * large;
    let up = steep.choose(small, less, small - large, small);
    let down = steep.choose(small, less, small + large, large);
    let base = steep.choose(small, less, all(std::f64::consts::FRAC_PI_4), all(0.0));
    let t = up / down;
    let z = t * t;
    let p = P.into_iter().fold(all(0.0), |sum, c| sum * z + all(c)) * z;
    let q = Q.into_iter().fold(all(1.0), |sum, c| sum * z + all(c));
    let eighth = base + (t + t * (p / q));
    let quarter = size.choose(sine, less, all(std::f64::consts::FRAC_PI_2) - eighth, eighth);
    cosine.choose(all(0.0), less, all(std::f64::consts::PI) - quarter, quarter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_atan2() {
        let one = |sine, cosine| angle(Four::all(sine), Four::all(cosine)).0[0];
        for i in 1..20_000 {
            let turn = f64::from(i) / 20_000.0 * std::f64::consts::PI;
            for size in [1e-9, 1.0, 3e7] {
                let (sine, cosine) = (size * turn.sin(), size * turn.cos());
                let error = (one(sine, cosine) - sine.atan2(cosine)).abs();
                assert!(error <= 4e-16 * turn.max(1e-300) + 2e-16 * turn, "{turn}: {error:e}");
            }
        }
        for tiny in [1e-300, 1e-30, 1e-12] {
            assert!((one(tiny, 1.0) - tiny).abs() <= 4e-16 * tiny);
            assert!((one(1.0, tiny) - std::f64::consts::FRAC_PI_2).abs() <= 1e-12);
            assert!((one(tiny, -1.0) - std::f64::consts::PI).abs() <= 1e-12);
        }
    }
}
