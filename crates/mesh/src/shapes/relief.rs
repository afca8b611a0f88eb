//! Skin: smooth functions of space from sums, products and roots alone, so that they have the same bits everywhere.

use glam::{DVec3, IVec3};

/// 0 below `low`, 1 above `high`, and a smooth rise between.
pub(super) fn rise(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A smooth bump: 1 at 0, 0 from 1 on.
pub(super) fn bump(x: f64) -> f64 {
    let t = (1.0 - x * x).max(0.0);
    t * t
}

/// A smooth wave of period 1 between -1 and 1: two parabolas for each period, made smooth by [`rise`].
pub(super) fn wave(x: f64) -> f64 {
    let t = 2.0 * (x - x.floor()) - 1.0;
    2.0 * rise(0.0, 1.0, t.abs()) - 1.0
}

/// Value noise between -1 and 1 that varies over about 1 unit; twice continuously differentiable.
pub(super) fn noise(p: DVec3) -> f64 {
    let floor = p.floor();
    let cell = floor.as_ivec3();
    let t = p - floor;
    let t = t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let lerp = |a: f64, b: f64, t: f64| a + t * (b - a);
    let at = |x, y, z| 2.0 * random(cell + IVec3::new(x, y, z)).x - 1.0;
    let row = |y, z| lerp(at(0, y, z), at(1, y, z), t.x);
    let sheet = |z| lerp(row(0, z), row(1, z), t.y);
    lerp(sheet(0), sheet(1), t.z)
}

/// Scales about 1 unit wide: 0 in the grooves between them, rising to 1 on their tops.
///
/// They are the cells of a Voronoi diagram of one random point in each unit cube; the height depends on the distance to
/// the nearest cell wall.
pub(super) fn scales(p: DVec3) -> f64 {
    /// Distance from a wall at which the top is reached.
    const SLOPE: f64 = 0.24;
    let cell = p.floor().as_ivec3();
    let mut points = [DVec3::ZERO; 27];
    let mut nearest = (f64::INFINITY, DVec3::ZERO);
    for (k, point) in points.iter_mut().enumerate() {
        let k = k as i32;
        let c = cell + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
        // Points stay away from the sides of their cubes, so that the 27 cubes hold all that matter.
        let jitter = random(c);
        *point = c.as_dvec3() + DVec3::splat(0.2) + 0.6 * jitter;
        let square = p.distance_squared(*point);
        if square < nearest.0 {
            nearest = (square, *point);
        }
    }
    let to_wall = points.iter().filter(|&&q| q != nearest.1).map(|&q| {
        // Walls are midway between two points and across the line through them.
        (0.5 * (q + nearest.1) - p).dot((q - nearest.1).normalize())
    });
    rise(0.0, SLOPE, to_wall.fold(f64::INFINITY, f64::min))
}

/// Three numbers from 0 to 1 for each cell, without pattern (the finaliser of SplitMix64).
fn random(cell: IVec3) -> DVec3 {
    let mut h = 0_u64;
    for x in cell.to_array() {
        h = (h ^ u64::from(x as u32)).wrapping_add(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        h ^= h >> 31;
    }
    let part = |shift: u32| ((h >> shift) & 0x1f_ffff) as f64 / f64::from(1 << 21);
    DVec3::new(part(0), part(21), part(42))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some_points() -> impl Iterator<Item = DVec3> {
        (0..5000).map(f64::from).map(|t| DVec3::new((0.37 * t).sin(), (0.91 * t).cos(), (1.7 * t).sin()) * 5.0)
    }

    /// Ranges as documented, no jumps (also across cell walls), and values that are used, not hugged at the middle.
    #[test]
    fn skin_functions_are_continuous_and_fill_their_ranges() {
        let step = 1e-6;
        for (function, low, high, steepest) in [(noise as fn(DVec3) -> f64, -1.0, 1.0, 7.0), (scales, 0.0, 1.0, 7.0)] {
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for p in some_points() {
                let value = function(p);
                assert!((low..=high).contains(&value));
                (least, most) = (least.min(value), most.max(value));
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    assert!((function(p + step * axis) - value).abs() <= steepest * step, "{p}");
                }
            }
            let third = (high - low) / 3.0;
            assert!(least < low + third && most > high - third, "{least} {most}");
        }
    }

    #[test]
    fn profiles_have_their_ends_and_period() {
        assert_eq!((rise(1.0, 2.0, 0.5), rise(1.0, 2.0, 1.5), rise(1.0, 2.0, 3.0)), (0.0, 0.5, 1.0));
        assert_eq!((bump(0.0), bump(1.0), bump(-2.0)), (1.0, 0.0, 0.0));
        for k in -20..20 {
            let x = f64::from(k) / 8.0;
            assert_eq!(wave(x), wave(x + 1.0));
            assert!(wave(x).abs() <= 1.0);
        }
        assert_eq!((wave(0.0), wave(0.5)), (1.0, -1.0));
    }
}
