//! Eight groups of cage vertices side by side, looked at from a point in one go.

use pulp::Simd;

use super::moments::Moments;
use crate::lanes::Singles;

/// Groups in a pack; a multiple of the lanes of every register.
pub(super) const WIDTH: usize = 8;

/// One number for each group of a pack.
pub(super) type Eight = [f32; WIDTH];

/// Eight [`Moments`], turned to structure of arrays. Empty places have no weight and lie far away.
#[derive(Debug, Clone)]
#[repr(align(32))]
pub(super) struct Pack {
    centre: [Eight; 3],
    dipole: [Eight; 3],
    trace: Eight,
    first: [Eight; 6],
    vector: [Eight; 3],
    second: [Eight; 10],
    area: Eight,
    cube: Eight,
    radius: Eight,
    largest: Eight,
    heights: [Eight; 10],
    axis: [Eight; 3],
    cosine: Eight,
    sine: Eight,
    offset: Eight,
}

/// Eight vertices as bare dipoles: a third of a pack's memory, enough far away.
#[derive(Debug, Clone)]
#[repr(align(32))]
pub(super) struct Dipoles {
    centre: [Eight; 3],
    dipole: [Eight; 3],
    area: Eight,
    /// Bounds of the terms of degree 1 and of those of degree 2 and more.
    first: Eight,
    square: Eight,
    radius: Eight,
}

/// What a pack gives to a point.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Look {
    /// Sum of each group's weights: of vertices with its sign, of groups its magnitude.
    pub(super) weight: Eight,
    /// How far it may be from the sum of the group's magnitudes; huge close by.
    pub(super) error: Eight,
    /// No single weight of the group is larger in magnitude.
    pub(super) largest: Eight,
}

/// Where empty places are.
const NOWHERE: f32 = 1e3;

/// Error of a group too close for its terms.
const HUGE: f32 = 1e30;

/// Least share of the distance to a group's centre that must lie outside the group.
const CLOSE: f32 = 0.2;

/// Share of the rigorous remainder that is taken for the error. The bound has every part of a group on the same side of its
/// centre, as far away as the direction that is worst; this share is as much as any group of the families tested reaches.
const REMAINDER: f32 = 0.4;

/// Rounding of single precision: of sums, products and far points relative to a group's dipoles, and of positions in a frame of
/// unit diagonal relative to the distance.
const ROUNDING: f32 = 2e-6;
const POSITION_ROUNDING: f32 = 2.5e-7;

/// Added to squared distances, so that nothing is divided by 0 at a centre.
const TINY: f32 = 1e-12;

/// Rounded up, with what positions lose in single precision.
fn length_up(length: f64) -> f32 {
    (length * 1.000_001 + 1e-7) as f32
}

fn set(lanes: &mut [Eight], group: usize, values: &[f64]) {
    for (lane, value) in lanes.iter_mut().zip(values) {
        lane[group] = *value as f32;
    }
}

impl Pack {
    pub(super) fn new(groups: &[Moments]) -> Self {
        let mut pack = Self {
            centre: [[NOWHERE; WIDTH]; 3],
            dipole: Default::default(),
            trace: Default::default(),
            first: Default::default(),
            vector: Default::default(),
            second: Default::default(),
            area: Default::default(),
            cube: Default::default(),
            radius: Default::default(),
            largest: Default::default(),
            heights: Default::default(),
            axis: Default::default(),
            cosine: Default::default(),
            sine: Default::default(),
            offset: Default::default(),
        };
        for (k, m) in groups.iter().enumerate().take(WIDTH) {
            set(&mut pack.centre, k, &m.centre.to_array());
            set(&mut pack.dipole, k, &m.dipole.to_array());
            set(&mut pack.first, k, &m.first);
            set(&mut pack.vector, k, &m.vector.to_array());
            set(&mut pack.second, k, &m.second);
            set(&mut pack.heights, k, &m.heights);
            set(&mut pack.axis, k, &m.axis.to_array());
            pack.trace[k] = m.trace as f32;
            pack.area[k] = m.area as f32;
            pack.cube[k] = m.cube as f32;
            pack.radius[k] = length_up(m.radius);
            pack.offset[k] = length_up(m.offset);
            pack.largest[k] = m.largest as f32;
            pack.cosine[k] = m.angle.cos() as f32;
            pack.sine[k] = m.angle.sin() as f32;
        }
        pack
    }

    /// The weights that single vertices give to `x`, and their errors.
    #[inline(always)]
    pub(super) fn look_at_vertices<S: Simd>(&self, simd: S, x: [f32; 3], look: &mut Look) {
        for at in 0..WIDTH / Singles::<S>::COUNT {
            let (u, s) = direction(simd, three(simd, &self.centre, at), x);
            let [_, highest] = self.heights(simd, at, u, s);
            self.weight(simd, at, u, s).store(&mut look.weight, at);
            self.error(simd, at, s, highest).store(&mut look.error, at);
        }
    }

    /// The same for groups of vertices, whose weights may have different signs.
    #[inline(always)]
    pub(super) fn look_at_groups<S: Simd>(&self, simd: S, x: [f32; 3], look: &mut Look) {
        for at in 0..WIDTH / Singles::<S>::COUNT {
            let all = |number| Singles::all(simd, number);
            let load = |lanes: &Eight| Singles::load(simd, lanes, at);
            let (u, s) = direction(simd, three(simd, &self.centre, at), x);
            let [lowest, highest] = self.heights(simd, at, u, s);
            let close = all(1.0) - s * load(&self.radius);
            let square = close * close;
            let gain = close.if_below(all(CLOSE), all(HUGE), s * s * s / (square * square));
            let weight = self.weight(simd, at, u, s).abs();
            // Where some lie on the other side, their weights are missing twice; and the sum of magnitudes is at most what the mean
            // square of the heights allows (Cauchy and Schwarz).
            let other_side = (all(0.0) - lowest).max(all(0.0)).min(highest);
            let area = load(&self.area);
            let twice = all(2.0) * area * gain * other_side;
            let allowed = (area * self.square_heights(simd, at, u, s)).max(all(0.0)).sqrt() * gain - weight;
            let mixed = twice.min(allowed.max(all(0.0)));
            weight.store(&mut look.weight, at);
            (self.error(simd, at, s, highest) + mixed).store(&mut look.error, at);
            (load(&self.largest) * gain * highest).store(&mut look.largest, at);
        }
    }

    /// Sum over a group of area times squared height, in squared distances from the point to the centre.
    #[inline(always)]
    fn square_heights<S: Simd>(&self, simd: S, at: usize, [x, y, z]: [Singles<S>; 3], s: Singles<S>) -> Singles<S> {
        let h = |k: usize| Singles::load(simd, &self.heights[k], at);
        let square = (h(0) * x * x + h(1) * y * y + h(2) * z * z) + (h(3) * x * y + h(4) * x * z + h(5) * y * z);
        square
            + s * (h(6) * x + h(7) * y + h(8) * z + s * h(9))
            + Singles::all(simd, 1e-6) * Singles::load(simd, &self.area, at)
    }

    /// Heights of the point over the planes of a group's faces lie between these, in distances from the point to its centre; turned so
    /// that most are positive.
    #[inline(always)]
    fn heights<S: Simd>(&self, simd: S, at: usize, u: [Singles<S>; 3], s: Singles<S>) -> [Singles<S>; 2] {
        let load = |lanes: &Eight| Singles::load(simd, lanes, at);
        let (zero, one) = (Singles::all(simd, 0.0), Singles::all(simd, 1.0));
        let (cosine, sine) = (load(&self.cosine), load(&self.sine));
        let axis = three(simd, &self.axis, at);
        let along = (u[0] * axis[0] + u[1] * axis[1] + u[2] * axis[2]).abs();
        let across = (one - along * along).max(zero).sqrt();
        let (near, far) = (along * cosine, across * sine);
        // Within the cone a normal may point right at the point; without a cone, anywhere.
        let most = along.if_below(cosine, near + far, one);
        let least = zero.if_below(cosine, near - far, zero - one);
        let most = zero.if_below(cosine, most, one);
        let offset = s * load(&self.offset) + Singles::all(simd, 1e-6);
        [least - offset, most + offset]
    }

    #[inline(always)]
    fn weight<S: Simd>(&self, simd: S, at: usize, [x, y, z]: [Singles<S>; 3], s: Singles<S>) -> Singles<S> {
        let load = |lanes: &Eight| Singles::load(simd, lanes, at);
        let (xx, yy, zz, xy, xz, yz) = (x * x, y * y, z * z, x * y, x * z, y * z);
        let (d, v) = (three(simd, &self.dipole, at), three(simd, &self.vector, at));
        let first = |k: usize| load(&self.first[k]);
        let second = |k: usize| load(&self.second[k]);
        let dipole = d[0] * x + d[1] * y + d[2] * z;
        let linear = (load(&self.trace) + first(0) * xx + first(1) * yy)
            + (first(2) * zz + first(3) * xy)
            + (first(4) * xz + first(5) * yz);
        let square = x * (v[0] + second(0) * xx + second(3) * xy + second(4) * xz)
            + y * (v[1] + second(1) * yy + second(5) * xy + second(6) * yz)
            + z * (v[2] + second(2) * zz + second(7) * xz + (second(8) * yz + second(9) * xy));
        s * s * s * (dipole + s * (linear + s * square))
    }

    /// The terms of degree 3 and more in `d`.
    ///
    /// For a dipole of unit size and any direction they are at most `10 |d|^3 s^6 / (1 - |d| s)^3`: the worst is along the line of
    /// sight, where `1 / (r + d)^3` is expanded. But `N . (r + d)` is the same all over a face, so they are also those of
    /// `1 / |r + d|^4` times that height: at most `20 |d|^3 s^6 / (1 - |d| s)^4` times the sine of sight.
    #[inline(always)]
    fn error<S: Simd>(&self, simd: S, at: usize, s: Singles<S>, highest: Singles<S>) -> Singles<S> {
        let all = |number| Singles::all(simd, number);
        let load = |lanes: &Eight| Singles::load(simd, lanes, at);
        let s3 = s * s * s;
        let close = all(1.0) - s * load(&self.radius);
        let square = close * close;
        let share = (highest + highest).min(all(1.0));
        let remainder = all(10.0 * REMAINDER) * share * load(&self.cube) * s3 * s3 / (square * square);
        let rounding = load(&self.area) * s3 * (all(ROUNDING) + all(POSITION_ROUNDING) * s);
        close.if_below(all(CLOSE), all(HUGE), remainder + rounding)
    }
}

impl Dipoles {
    pub(super) fn new(groups: &[Moments]) -> Self {
        let mut dipoles = Self {
            centre: [[NOWHERE; WIDTH]; 3],
            dipole: Default::default(),
            area: Default::default(),
            first: Default::default(),
            square: Default::default(),
            radius: Default::default(),
        };
        for (k, m) in groups.iter().enumerate().take(WIDTH) {
            set(&mut dipoles.centre, k, &m.centre.to_array());
            set(&mut dipoles.dipole, k, &m.dipole.to_array());
            dipoles.area[k] = m.area as f32;
            // Of a unit vector's squares, the largest in sum; of its products, half the sum.
            let [xx, yy, zz, xy, xz, yz] = m.first.map(f64::abs);
            dipoles.first[k] = (m.trace.abs() + xx.max(yy).max(zz) + 0.5 * (xy + xz + yz)) as f32;
            dipoles.square[k] = m.square as f32;
            dipoles.radius[k] = length_up(m.radius);
        }
        dipoles
    }

    /// The weights that the vertices give to `x`, and their errors.
    #[inline(always)]
    pub(super) fn look<S: Simd>(&self, simd: S, x: [f32; 3], look: &mut Look) {
        for at in 0..WIDTH / Singles::<S>::COUNT {
            let all = |number| Singles::all(simd, number);
            let load = |lanes: &Eight| Singles::load(simd, lanes, at);
            let (u, s) = direction(simd, three(simd, &self.centre, at), x);
            let d = three(simd, &self.dipole, at);
            let s3 = s * s * s;
            let close = all(1.0) - s * load(&self.radius);
            // As for a pack, with terms from degree 2 on: at most 6 |d|^2 s^5 / (1 - |d| s)^3.
            let remainder = s * load(&self.first) + all(6.0) * s * s * load(&self.square) / (close * close * close);
            let rounding = load(&self.area) * (all(ROUNDING) + all(POSITION_ROUNDING) * s);
            (s3 * (d[0] * u[0] + d[1] * u[1] + d[2] * u[2])).store(&mut look.weight, at);
            close.if_below(all(CLOSE), all(HUGE), s3 * (remainder + rounding)).store(&mut look.error, at);
        }
    }
}

/// Three components' lanes.
#[inline(always)]
fn three<S: Simd>(simd: S, lanes: &[Eight; 3], at: usize) -> [Singles<S>; 3] {
    [Singles::load(simd, &lanes[0], at), Singles::load(simd, &lanes[1], at), Singles::load(simd, &lanes[2], at)]
}

/// Unit vectors from a point to centres, and the inverses of the distances.
#[inline(always)]
fn direction<S: Simd>(simd: S, centre: [Singles<S>; 3], x: [f32; 3]) -> ([Singles<S>; 3], Singles<S>) {
    let all = |number| Singles::all(simd, number);
    let r = [centre[0] - all(x[0]), centre[1] - all(x[1]), centre[2] - all(x[2])];
    let s = all(1.0) / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + all(TINY)).sqrt();
    ([r[0] * s, r[1] * s, r[2] * s], s)
}
