//! Eight groups of cage vertices side by side, looked at from a point in one go.
//!
//! Loops run over fixed arrays of eight so that the compiler turns them into vector instructions where the caller is
//! compiled for them. Sums and products are never fused: the same bits on every machine.

use super::lanes::Lanes;
use super::moments::Moments;

/// Groups in a pack.
pub(super) const WIDTH: usize = 8;

type Eight = Lanes<f32, WIDTH>;

/// Eight [`Moments`], turned to structure of arrays; empty places are all zero.
#[derive(Debug, Clone, Default)]
pub(super) struct Pack {
    centre: [Eight; 3],
    dipole: [Eight; 3],
    trace: Eight,
    first: [Eight; 6],
    vector: [Eight; 3],
    second: [Eight; 10],
    area: Eight,
    third: Eight,
    radius: Eight,
    largest: Eight,
    axis: [Eight; 3],
    cosine: Eight,
    sine: Eight,
    offset: Eight,
}

/// What a pack gives to a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// Sum of each group's weights.
    pub(super) weight: Eight,
    /// How far its magnitude may be from the sum of the group's magnitudes; infinite or NaN close by.
    pub(super) error: Eight,
    /// No single weight of the group is larger.
    pub(super) largest: Eight,
}

/// Share of the rigorous remainder that is taken for the error. The bound sets every normal along the line of sight and every
/// part of a group on the same side of its centre. On smooth and folded cages alike, errors of groups stay below
/// 0.1 of it, and those of different groups cancel (see the tests).
const REMAINDER: f32 = 0.25;

/// Rounding of single precision: of sums and products relative to a group's dipoles, and of positions in a frame of unit
/// diagonal relative to the distance.
const ROUNDING: f32 = 1e-6;
const POSITION_ROUNDING: f32 = 2.5e-7;

impl Pack {
    pub(super) fn new(groups: &[Moments]) -> Self {
        let mut pack = Self::default();
        for (k, m) in groups.iter().enumerate().take(WIDTH) {
            let set = |lanes: &mut [Eight], values: &[f64]| {
                for (lane, value) in lanes.iter_mut().zip(values) {
                    lane.0[k] = *value as f32;
                }
            };
            set(&mut pack.centre, &m.centre.to_array());
            set(&mut pack.dipole, &m.dipole.to_array());
            set(&mut pack.first, &m.first);
            set(&mut pack.vector, &m.vector.to_array());
            set(&mut pack.second, &m.second);
            set(&mut pack.axis, &m.axis.to_array());
            pack.trace.0[k] = m.trace as f32;
            pack.area.0[k] = m.area as f32;
            pack.third.0[k] = m.third as f32;
            // Rounded up, with what positions lose in single precision.
            pack.radius.0[k] = (m.radius * 1.000_001 + 1e-7) as f32;
            pack.offset.0[k] = (m.offset * 1.000_001 + 1e-7) as f32;
            pack.largest.0[k] = m.largest as f32;
            pack.cosine.0[k] = m.angle.cos() as f32;
            pack.sine.0[k] = m.angle.sin() as f32;
        }
        pack
    }

    /// The weights that single vertices give to `x`, and their errors: [`Look::largest`] is not filled.
    #[inline(always)]
    pub(super) fn look_at_vertices(&self, x: [f32; 3]) -> Look {
        let (u, s) = self.direction(x);
        let [_, highest] = self.heights(u, s);
        Look { weight: self.weight(u, s), error: self.error(s, highest), largest: Eight::all(0.0) }
    }

    /// The same for groups of vertices, whose weights may have different signs.
    #[inline(always)]
    pub(super) fn look_at_groups(&self, x: [f32; 3]) -> Look {
        let (zero, one) = (Eight::all(0.0), Eight::all(1.0));
        let (u, s) = self.direction(x);
        let [lowest, highest] = self.heights(u, s);
        let square = one - s * self.radius;
        let square = square * square;
        let gain = s * s * s / (square * square);
        // Where some lie on the other side, their weights are missing twice.
        let other_side = (zero - lowest).with(zero, f32::max).with(highest, f32::min);
        let mixed = Eight::all(2.0) * self.area * gain * other_side;
        Look {
            weight: self.weight(u, s),
            error: self.error(s, highest) + mixed,
            largest: self.largest * gain * highest,
        }
    }

    /// Heights of the point over the planes of a group's faces lie between these, in distances from the point to its centre; turned so
    /// that most are positive.
    #[inline(always)]
    fn heights(&self, u: [Eight; 3], s: Eight) -> [Eight; 2] {
        let (zero, one) = (Eight::all(0.0), Eight::all(1.0));
        let along = (u[0] * self.axis[0] + u[1] * self.axis[1] + u[2] * self.axis[2]).abs();
        let across = (one - along * along).with(zero, f32::max).sqrt();
        let least = along * self.cosine - across * self.sine;
        let most = along * self.cosine + across * self.sine;
        let below = |a, b| a < b;
        // Within the cone a normal may point right at the point; without a cone, anywhere.
        let most = along.choose(self.cosine, below, most, one);
        let least = zero.choose(self.cosine, below, least, zero - one);
        let most = zero.choose(self.cosine, below, most, one);
        let offset = s * self.offset + Eight::all(1e-6);
        [least - offset, most + offset]
    }

    /// Unit vector from the point to a group's centre, and the inverse of the distance.
    #[inline(always)]
    fn direction(&self, x: [f32; 3]) -> ([Eight; 3], Eight) {
        let [a, b, c] = self.centre;
        let r = [a - Eight::all(x[0]), b - Eight::all(x[1]), c - Eight::all(x[2])];
        let s = Eight::all(1.0) / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
        ([r[0] * s, r[1] * s, r[2] * s], s)
    }

    #[inline(always)]
    fn weight(&self, [x, y, z]: [Eight; 3], s: Eight) -> Eight {
        let (xx, yy, zz, xy, xz, yz) = (x * x, y * y, z * z, x * y, x * z, y * z);
        let (v, f, c) = (&self.vector, &self.first, &self.second);
        let dipole = self.dipole[0] * x + self.dipole[1] * y + self.dipole[2] * z;
        let first = (self.trace + f[0] * xx + f[1] * yy) + (f[2] * zz + f[3] * xy) + (f[4] * xz + f[5] * yz);
        let second = x * (v[0] + c[0] * xx + c[3] * xy + c[4] * xz)
            + y * (v[1] + c[1] * yy + c[5] * xy + c[6] * yz)
            + z * (v[2] + c[2] * zz + c[7] * xz + (c[8] * yz + c[9] * xy));
        s * s * s * (dipole + s * (first + s * second))
    }

    /// The terms of degree 3 and more in `d`.
    ///
    /// For a dipole of unit size and any direction they are at most `10 |d|^3 s^6 / (1 - |d| s)^3`: the worst is along the line of
    /// sight, where `1 / (r + d)^3` is expanded. But `N . (r + d)` is the same all over a face, so they are also those of
    /// `1 / |r + d|^4` times that height: at most `20 |d|^3 s^6 / (1 - |d| s)^4` times the sine of sight.
    #[inline(always)]
    fn error(&self, s: Eight, highest: Eight) -> Eight {
        let one = Eight::all(1.0);
        let cube = s * s * s;
        let close = one - s * self.radius;
        let square = close * close;
        let share = (highest + highest).with(one, f32::min);
        let remainder = Eight::all(10.0 * REMAINDER) * share * self.third * cube * cube / (square * square);
        let rounding = self.area * cube * (Eight::all(ROUNDING) + Eight::all(POSITION_ROUNDING) * s);
        close.choose(Eight::all(0.2), |a, b| a > b, remainder + rounding, Eight::all(f32::INFINITY))
    }
}
