//! The motion that best takes points to their goals.

use glam::{DMat3, DVec3};
use pliant_mesh::{best_rotation, best_scale, outer};

/// Points whose mean squared distance from their mean is below this share of that from the origin are one point, but for
/// rounding of the mean.
const ONE_POINT: f64 = 1e-28;

/// A similarity `x -> scale * rotation * x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Fit {
    /// Proper.
    pub(crate) rotation: DMat3,
    /// Positive.
    pub(crate) scale: f64,
    pub(crate) translation: DVec3,
}

impl Fit {
    pub(crate) const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// The rigid motion that best takes points to their goals in the weighted least-squares sense.
    ///
    /// `points` yields position, goal and weight. Points that are at their goals are not moved, to the bit.
    pub(crate) fn rigid(points: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> Self {
        Self::new(points, false)
    }

    /// The similarity that does (Umeyama 1991).
    pub(crate) fn similarity(points: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> Self {
        Self::new(points, true)
    }

    fn new(points: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone, scales: bool) -> Self {
        if points.clone().all(|(position, goal, _)| position == goal) {
            return Self::IDENTITY;
        }
        let sums =
            points.clone().fold((DVec3::ZERO, DVec3::ZERO, 0.0), |(x, y, n), (p, q, w)| (x + w * p, y + w * q, n + w));
        let (from, to, total) = sums;
        if total == 0.0 {
            return Self::IDENTITY;
        }
        let (from, to) = (from / total, to / total);
        let (s, rest, squares) = points.fold((DMat3::ZERO, 0.0, 0.0), |(s, rest, squares), (p, q, w)| {
            let off = p - from;
            (s + outer(q - to, w * off), rest + w * off.length_squared(), squares + w * p.length_squared())
        });
        if rest <= ONE_POINT * squares {
            return Self { translation: to - from, ..Self::IDENTITY };
        }
        let rotation = best_rotation(s);
        let scale = if scales { best_scale(rotation, s, rest) } else { 1.0 };
        Self { rotation, scale, translation: to - scale * (rotation * from) }
    }

    pub(crate) fn apply(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }
}

#[cfg(test)]
mod tests {
    use pliant_mesh::Similarity;

    use super::*;

    #[test]
    fn a_similarity_is_found_again() {
        let points = (0..30).map(f64::from).map(|t| DVec3::new((0.37 * t).sin(), (0.91 * t).cos(), (1.7 * t).sin()));
        for (angle, scale) in [(0.0, 1.0), (1.0, 3.0), (3.1, 0.2), (-2.0, 1.0)] {
            let motion = Similarity::about(DVec3::ONE, DVec3::new(1.0, 2.0, -1.0), angle, scale);
            let pairs = points.clone().map(|p| (p, motion.apply(p), 1.0 + p.x * p.x));
            let fit = Fit::similarity(pairs.clone());
            let off = |fit: Fit| pairs.clone().map(|(p, q, _)| fit.apply(p).distance(q)).fold(0.0, f64::max);
            assert!(off(fit) < 1e-13 && (fit.scale - scale).abs() < 1e-13);
            assert!(scale != 1.0 || off(Fit::rigid(pairs.clone())) < 1e-13);
        }
        assert_eq!(Fit::similarity(std::iter::empty()), Fit::IDENTITY);
        // One point can only be moved.
        let moved = Fit { translation: DVec3::Y, ..Fit::IDENTITY };
        for weight in [2.0, 0.1 / 1.1] {
            let at = DVec3::new(0.1, 0.7, -0.3);
            let fit = Fit::similarity(std::iter::once((at, at + DVec3::Y, weight)));
            assert!(fit.rotation == moved.rotation && fit.scale == 1.0 && fit.translation.distance(DVec3::Y) < 1e-15);
        }
    }
}
