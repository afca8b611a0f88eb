//! Bodies as smooth unions of tapered bones: signed distances with a known Lipschitz bound.

use glam::DVec3;

use crate::Bounds;

/// A ball that moves from `a` to `b` while its radius goes from `ra` to `rb`: a tapered capsule, or one ball if `a == b`.
///
/// Its distance is exact: the axis point whose ball is nearest has a closed form.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bone {
    a: DVec3,
    axis: DVec3,
    length: f64,
    ra: f64,
    /// Radius lost per unit of length: the sine of the cone's half angle.
    slope: f64,
    /// The tangent of that angle.
    tangent: f64,
    /// Width over which it blends with the bone before it in its limb; 0 if it does not.
    joint: f64,
}

impl Bone {
    /// The ends must be farther apart than their radii differ (neither ball holds the other), unless they are one point.
    pub(super) fn new(a: [f64; 3], ra: f64, b: [f64; 3], rb: f64) -> Self {
        let (a, b) = (DVec3::from_array(a), DVec3::from_array(b));
        let length = a.distance(b);
        if length == 0.0 {
            return Self { a, axis: DVec3::X, length, ra, slope: 0.0, tangent: 0.0, joint: 0.0 };
        }
        let slope = (ra - rb) / length;
        debug_assert!(slope.abs() < 1.0, "one end of the bone swallows the other");
        Self { a, axis: (b - a) / length, length, ra, slope, tangent: slope / (1.0 - slope * slope).sqrt(), joint: 0.0 }
    }

    /// Centre and radius of the ball nearest to `p`, and the distance to that ball.
    fn nearest_ball(&self, p: DVec3) -> (DVec3, f64, f64) {
        let from_a = p - self.a;
        let along = from_a.dot(self.axis);
        let across = (from_a - along * self.axis).length();
        let at = (along - self.tangent * across).clamp(0.0, self.length);
        let centre = self.a + at * self.axis;
        let radius = self.ra - self.slope * at;
        (centre, radius, p.distance(centre) - radius)
    }

    /// Centres and radii of the first and the last ball.
    pub(super) fn ends(&self) -> [(DVec3, f64); 2] {
        [(self.a, self.ra), (self.a + self.length * self.axis, self.ra - self.slope * self.length)]
    }
}

/// A row of bones along the Catmull-Rom spline through points with radii, bent by a few degrees at each.
pub(super) fn curve(points: &[([f64; 3], f64)]) -> Vec<Bone> {
    const PIECES: u32 = 6;
    let at = |i: usize| (DVec3::from_array(points[i].0), points[i].1);
    let last = points.len() - 1;
    let mut bones = Vec::new();
    for i in 0..last {
        let ((p0, r0), (p1, r1), (p2, r2), (p3, r3)) =
            (at(i.saturating_sub(1)), at(i), at(i + 1), at((i + 2).min(last)));
        let point = |t: f64| {
            let (b0, b1, b2, b3) = (
                -0.5 * t + t * t - 0.5 * t * t * t,
                1.0 - 2.5 * t * t + 1.5 * t * t * t,
                0.5 * t + 2.0 * t * t - 1.5 * t * t * t,
                -0.5 * t * t + 0.5 * t * t * t,
            );
            (p0 * b0 + p1 * b1 + p2 * b2 + p3 * b3, r0 * b0 + r1 * b1 + r2 * b2 + r3 * b3)
        };
        for k in 0..PIECES {
            let ((a, ra), (b, rb)) =
                (point(f64::from(k) / f64::from(PIECES)), point(f64::from(k + 1) / f64::from(PIECES)));
            bones.push(Bone::new(a.to_array(), ra, b.to_array(), rb));
        }
    }
    bones
}

/// A row of bones that blends as one with the limbs before it.
///
/// Each bone blends with the next just enough to round off the crease between them, and the nearest such pair counts:
/// so the distance does not depend on order, and far bones can be left out.
#[derive(Debug, Clone)]
pub(super) struct Limb {
    bones: Vec<Bone>,
    /// Width over which it blends with the limbs before it, in units of the model.
    width: f64,
    /// Share of the relief that its skin carries, 0 to 1.
    relief: f64,
    /// A ball that holds it.
    centre: DVec3,
    radius: f64,
}

impl Limb {
    /// A limb of at least one bone; the width is positive. Bones are joined where one begins at the end of the last.
    pub(super) fn new(width: f64, relief: f64, mut bones: Vec<Bone>) -> Self {
        for i in 1..bones.len() {
            let ([_, (end, radius)], [(start, _), _]) = (bones[i - 1].ends(), bones[i].ends());
            if start.distance(end) < 1e-9 {
                // By the middle of a bone its neighbour has fallen behind by `length^2 / (8 radius)`; so far the blend goes.
                bones[i].joint = 0.2 * bones[i - 1].length * bones[i].length / radius;
            }
        }
        let ends: Vec<(DVec3, f64)> = bones.iter().flat_map(Bone::ends).collect();
        let centre = Bounds::of(&ends.iter().map(|e| e.0).collect::<Vec<_>>()).centre();
        let reach = ends.iter().map(|(p, r)| p.distance(centre) + r).fold(0.0, f64::max);
        let swell = bones.iter().map(|bone| bone.joint / 6.0).fold(0.0, f64::max);
        Self { bones, width, relief, centre, radius: reach + swell }
    }

    /// The limb without the bones that never count where distances differ from those at `centre` by `slack / 2` at most.
    fn near(&self, centre: DVec3, slack: f64) -> Self {
        let swell = self.bones.iter().map(|bone| bone.joint / 6.0).fold(0.0, f64::max);
        let reach = self.distance(centre) + slack;
        let counts: Vec<bool> = self.bones.iter().map(|bone| bone.nearest_ball(centre).2 <= reach + swell).collect();
        let mut bones = Vec::new();
        let mut last = None;
        for (i, bone) in self.bones.iter().enumerate() {
            // A pair is as near as the nearer of its bones, so the other one stays with it.
            if counts[i.saturating_sub(1)..(i + 2).min(counts.len())].contains(&true) {
                let joined = last.is_some_and(|l| l + 1 == i);
                bones.push(Bone { joint: if joined { bone.joint } else { 0.0 }, ..*bone });
                last = Some(i);
            }
        }
        Self { bones, ..*self }
    }

    fn distance(&self, p: DVec3) -> f64 {
        let (mut least, mut before) = (f64::INFINITY, f64::INFINITY);
        for bone in &self.bones {
            let distance = bone.nearest_ball(p).2;
            least = least.min(blend(before, distance, bone.joint).0);
            before = distance;
        }
        least
    }

    fn sample(&self, p: DVec3) -> Sample {
        // The nearest pair: its balls (centre, radius), the share of the second and their distance.
        let mut nearest = ([(DVec3::ZERO, 0.0); 2], 0.0, f64::INFINITY);
        let mut before = (DVec3::ZERO, 0.0, f64::INFINITY);
        for bone in &self.bones {
            let ball = bone.nearest_ball(p);
            let (distance, share) = blend(before.2, ball.2, bone.joint);
            if distance < nearest.2 {
                nearest = ([(before.0, before.1), (ball.0, ball.1)], share, distance);
            }
            before = ball;
        }
        let ([a, b], share, distance) = nearest;
        let sample = |(centre, radius): (DVec3, f64)| Sample {
            distance,
            gradient: (p - centre).normalize_or_zero(),
            radius,
            relief: self.relief,
        };
        if share == 0.0 { sample(a) } else { sample(a).mixed(sample(b), share, distance) }
    }
}

/// What a body is like at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    /// Signed distance, negative inside; a lower bound of the true one where bones blend.
    pub(super) distance: f64,
    /// Its gradient, never longer than 1.
    pub(super) gradient: DVec3,
    /// Radius of the bones there.
    pub(super) radius: f64,
    /// Share of the relief that the skin carries.
    pub(super) relief: f64,
}

impl Sample {
    const NOTHING: Self = Self { distance: f64::INFINITY, gradient: DVec3::ZERO, radius: 0.0, relief: 0.0 };

    fn blended(self, other: Self, width: f64) -> Self {
        let (distance, share) = blend(self.distance, other.distance, width);
        self.mixed(other, share, distance)
    }

    /// A share of `other` in all but the distance.
    fn mixed(self, other: Self, share: f64, distance: f64) -> Self {
        if share == 0.0 || share == 1.0 {
            // Not mixed even with a factor of 0, so that leaving out what does not count changes no bit.
            return Self { distance, ..if share == 0.0 { self } else { other } };
        }
        let mix = |a: f64, b: f64| a + share * (b - a);
        Self {
            distance,
            gradient: self.gradient + share * (other.gradient - self.gradient),
            radius: mix(self.radius, other.radius),
            relief: mix(self.relief, other.relief),
        }
    }
}

/// Smooth minimum of two distances, and the share of the second one in its gradient.
///
/// Cubic in the overlap, so twice continuously differentiable; exactly the minimum where the two differ by `width` or
/// more, and always for a width of 0. The gradient is a convex combination, so the result is no steeper than its parts.
fn blend(a: f64, b: f64, width: f64) -> (f64, f64) {
    let overlap = 1.0 - (a - b).abs() / width;
    // Not a number where both are equal and the width is 0.
    if overlap.is_nan() || overlap <= 0.0 {
        return if b < a { (b, 1.0) } else { (a, 0.0) };
    }
    let lesser = 0.5 * overlap * overlap;
    (a.min(b) - overlap * overlap * overlap * width / 6.0, if b < a { 1.0 - lesser } else { lesser })
}

/// A smooth union of limbs.
///
/// Its distance function has Lipschitz constant 1: where it is `d`, nothing within `|d|` has the other sign.
#[derive(Debug, Clone)]
pub(super) struct Body {
    limbs: Vec<Limb>,
}

impl Body {
    pub(super) fn new(limbs: Vec<Limb>) -> Self {
        Self { limbs }
    }

    /// The same body for points at most `radius` from `centre`, without the bones that do not count there: faster, and
    /// equal to the bit.
    pub(super) fn near(&self, centre: DVec3, radius: f64) -> Self {
        // Distances have slope 1, so they differ by `radius` at most; the rest is for rounding.
        let slack = 2.0 * radius * (1.0 + 1e-9) + 1e-9;
        let mut limbs = Vec::new();
        let mut before = f64::INFINITY;
        for (bound, limb) in self.limbs_near(centre) {
            let far = before + limb.width + slack;
            if bound >= far {
                continue;
            }
            let distance = limb.distance(centre);
            if distance >= far {
                // It stays farther than all before it by more than it blends.
                continue;
            }
            if before >= distance + limb.width + slack {
                // It stays nearer than all before it by more than it blends.
                limbs.clear();
                before = f64::INFINITY;
            }
            limbs.push(limb.near(centre, slack));
            before = blend(before, distance, limb.width).0;
        }
        Self { limbs }
    }

    /// Signed distance, negative inside.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        let mut distance = f64::INFINITY;
        for limb in self.limbs_near(p) {
            // A limb too far to blend changes nothing, so leaving it out gives the same bits.
            if limb.0 < distance + limb.1.width {
                distance = blend(distance, limb.1.distance(p), limb.1.width).0;
            }
        }
        distance
    }

    /// Distance, gradient and skin; the distance has the same bits as [`Self::distance`].
    pub(super) fn sample(&self, p: DVec3) -> Sample {
        let mut sample = Sample::NOTHING;
        for limb in self.limbs_near(p) {
            if limb.0 < sample.distance + limb.1.width {
                sample = sample.blended(limb.1.sample(p), limb.1.width);
            }
        }
        sample
    }

    /// Every limb with a lower bound of its distance.
    fn limbs_near(&self, p: DVec3) -> impl Iterator<Item = (f64, &Limb)> {
        self.limbs.iter().map(move |limb| (p.distance(limb.centre) - limb.radius, limb))
    }

    /// A box that holds the body.
    pub(super) fn bounds(&self) -> Bounds {
        let balls = self.limbs.iter().map(|l| (l.centre, l.radius + l.width / 6.0));
        let corners: Vec<DVec3> = balls.flat_map(|(c, r)| [c - DVec3::splat(r), c + DVec3::splat(r)]).collect();
        Bounds::of(&corners)
    }

    /// One Newton step from `p` to the surface, along the gradient.
    pub(super) fn projected(&self, p: DVec3) -> DVec3 {
        let sample = self.sample(p);
        // Where bones pull apart the gradient shrinks; a step of more than twice the distance is not trusted.
        p - sample.gradient * (sample.distance / sample.gradient.length_squared().max(0.25))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body() -> Body {
        let core = vec![Bone::new([0.0, 0.0, 0.0], 0.4, [0.0, 1.0, 0.0], 0.25)];
        let arm = vec![
            Bone::new([0.2, 0.9, 0.0], 0.15, [0.9, 0.8, 0.1], 0.1),
            Bone::new([0.9, 0.8, 0.1], 0.1, [1.2, 1.1, 0.2], 0.05),
        ];
        let tail = curve(&[
            ([0.0, 0.1, -0.2], 0.2),
            ([0.0, 0.0, -0.7], 0.12),
            ([0.1, 0.4, -0.9], 0.1),
            ([0.5, 0.5, -0.8], 0.06),
        ]);
        let hand = Bone::new([1.3, 1.2, 0.2], 0.1, [1.3, 1.2, 0.2], 0.1);
        Body::new(vec![
            Limb::new(0.1, 1.0, core),
            Limb::new(0.12, 0.5, arm),
            Limb::new(0.05, 0.0, vec![hand]),
            Limb::new(0.1, 0.3, tail),
        ])
    }

    fn some_points() -> impl Iterator<Item = DVec3> {
        (0..4000).map(f64::from).map(|t| DVec3::new((0.37 * t).sin(), (0.91 * t).cos(), (1.7 * t).sin()) * 1.6)
    }

    /// A cone's flank touches its end balls, so its distance is the least over a fine row of balls.
    #[test]
    fn the_distance_to_a_bone_is_that_to_its_nearest_ball() {
        let (a, b, ra, rb) = ([0.1, -0.2, 0.3], [0.8, 0.4, 0.1], 0.3, 0.1);
        let bone = Bone::new(a, ra, b, rb);
        let n = 2000;
        for p in some_points().take(300) {
            let least = (0..=n)
                .map(|k| f64::from(k) / f64::from(n))
                .map(|t| p.distance(DVec3::from(a).lerp(b.into(), t)) - (ra + t * (rb - ra)))
                .fold(f64::INFINITY, f64::min);
            let found = bone.nearest_ball(p).2;
            // The row misses the best ball by half a spacing, where the distance is flat: an error of second order.
            assert!(found <= least + 1e-12 && found > least - 1e-6, "{found} {least}");
        }
    }

    #[test]
    fn gradients_agree_with_differences_and_are_at_most_one() {
        let (body, step) = (body(), 1e-5);
        for p in some_points() {
            let sample = body.sample(p);
            assert_eq!(sample.distance.to_bits(), body.distance(p).to_bits());
            assert!(sample.gradient.length() <= 1.0 + 1e-12);
            let slope = |axis: DVec3| (body.distance(p + step * axis) - body.distance(p - step * axis)) / (2.0 * step);
            let difference = DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
            // On a bone's own axis, deep inside, the distance has a crease.
            if sample.distance > -0.1 {
                assert!(difference.distance(sample.gradient) < 1e-3, "{p}: {difference} {}", sample.gradient);
            }
        }
    }

    #[test]
    fn leaving_out_what_does_not_count_changes_no_bit() {
        let body = body();
        for centre in some_points().step_by(20) {
            let near = body.near(centre, 0.2);
            for offset in some_points().take(50) {
                let p = centre + 0.07 * offset;
                let all = body.limbs.iter().fold(f64::INFINITY, |d, limb| blend(d, limb.distance(p), limb.width).0);
                assert_eq!(all.to_bits(), body.distance(p).to_bits());
                assert_eq!(all.to_bits(), near.distance(p).to_bits());
                assert_eq!(body.sample(p), near.sample(p));
            }
        }
        assert!(body.near(DVec3::new(1.3, 1.2, 0.2), 0.05).limbs.len() == 1);
    }

    #[test]
    fn projection_ends_on_the_surface() {
        let body = body();
        for p in some_points().filter(|p| body.distance(*p).abs() < 0.05) {
            let on = (0..4).fold(p, |p, _| body.projected(p));
            assert!(body.distance(on).abs() < 1e-9, "{p}: {}", body.distance(on));
            assert!(on.distance(p) < 0.1);
        }
    }
}
