//! The rigid motion that a set of points has made.

use glam::{DMat3, DVec3};
use pliant_mesh::{best_rotation, outer};

/// The rigid motion `(Q, t)`, `x -> Q x + t`, that best takes points to their goals in the weighted least-squares
/// sense.
///
/// `points` yields position, goal and weight.
pub(crate) fn fit_rigid(points: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> (DMat3, DVec3) {
    let sums =
        points.clone().fold((DVec3::ZERO, DVec3::ZERO, 0.0), |(x, y, n), (p, q, w)| (x + w * p, y + w * q, n + w));
    let (from, to, total) = sums;
    if total == 0.0 {
        return (DMat3::IDENTITY, DVec3::ZERO);
    }
    let (from, to) = (from / total, to / total);
    let s = points.fold(DMat3::ZERO, |s, (p, q, w)| s + outer(q - to, w * (p - from)));
    let rotation = best_rotation(s);
    (rotation, to - rotation * from)
}
