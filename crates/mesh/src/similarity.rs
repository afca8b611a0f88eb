use glam::{DMat3, DQuat, DVec3};

/// A rotation, a uniform scale and a translation: `x -> scale * rotation * x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// A unit quaternion.
    pub rotation: DQuat,
    /// Positive; 1 for a rigid motion.
    pub scale: f64,
    /// In units of the model.
    pub translation: DVec3,
}

impl Default for Similarity {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Similarity {
    /// Leaves every point where it is.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// A translation.
    pub fn translation(translation: DVec3) -> Self {
        Self { translation, ..Self::IDENTITY }
    }

    /// A turn by `angle` radians about the line through `pivot` along `axis` (right-hand rule), with a scale about `pivot`.
    ///
    /// A zero axis turns nothing.
    pub fn about(pivot: DVec3, axis: DVec3, angle: f64, scale: f64) -> Self {
        let rotation = axis.try_normalize().map_or(DQuat::IDENTITY, |unit| DQuat::from_axis_angle(unit, angle));
        Self { rotation, scale, translation: pivot - scale * (rotation * pivot) }
    }

    /// Where a point goes.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// The linear part as a matrix.
    pub fn linear(&self) -> DMat3 {
        DMat3::from_quat(self.rotation) * self.scale
    }

    /// Whether every number is finite, the scale is positive and the quaternion has unit length to 1e-6.
    pub fn is_valid(&self) -> bool {
        self.rotation.is_finite()
            && (self.rotation.length() - 1.0).abs() < 1e-6
            && self.scale.is_finite()
            && self.scale > 0.0
            && self.translation.is_finite()
    }
}

/// A similarity that can be carried out by degrees: turn and scale about a pivot, then move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Point that the turn and the scale leave in place.
    pub pivot: DVec3,
    /// Direction of the turn's axis; any length but 0.
    pub axis: DVec3,
    /// Radians, right-hand rule; may exceed a full turn.
    pub angle: f64,
    /// Positive; 1 keeps the size.
    pub scale: f64,
    /// Applied last, in units of the model.
    pub translation: DVec3,
}

impl Motion {
    /// The part of the motion done at `t`: nothing at 0, all of it at 1.
    ///
    /// Angle and translation grow linearly and the scale geometrically, so equal steps are equal motions.
    pub fn at(&self, t: f64) -> Similarity {
        let turned = Similarity::about(self.pivot, self.axis, self.angle * t, self.scale.powf(t));
        Similarity { translation: turned.translation + self.translation * t, ..turned }
    }

    /// The turn done at `t` as a rotation vector: the unit axis times the angle in radians, of any length.
    ///
    /// Its rotation is that of [`Self::at`], which does not tell how many full turns led to it.
    pub fn turn_at(&self, t: f64) -> DVec3 {
        self.axis.normalize_or_zero() * (self.angle * t)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, TAU};

    use super::*;

    fn motion() -> Motion {
        Motion {
            pivot: DVec3::new(1.0, -2.0, 0.5),
            axis: DVec3::new(0.3, 2.0, -1.0),
            angle: 1.9,
            scale: 2.5,
            translation: DVec3::new(0.4, 0.1, -3.0),
        }
    }

    fn some_points() -> impl Iterator<Item = DVec3> {
        (0..50).map(f64::from).map(|t| DVec3::new((0.37 * t).sin(), (0.91 * t).cos(), (1.7 * t).sin()) * 3.0)
    }

    #[test]
    fn the_identity_moves_nothing() {
        assert!(some_points().all(|p| Similarity::IDENTITY.apply(p) == p));
        assert_eq!(Similarity::default(), Similarity::IDENTITY);
        assert!(Similarity::IDENTITY.is_valid());
    }

    /// A quarter turn to the left about a vertical axis takes x to -z (right-hand rule).
    #[test]
    fn turns_follow_the_right_hand_rule_and_keep_the_pivot() {
        let pivot = DVec3::new(2.0, 3.0, 4.0);
        let turn = Similarity::about(pivot, DVec3::Y * 7.0, FRAC_PI_2, 3.0);
        assert!(turn.apply(pivot).distance(pivot) < 1e-14);
        assert!(turn.apply(pivot + DVec3::X).distance(pivot - 3.0 * DVec3::Z) < 1e-14);
        assert_eq!(Similarity::about(pivot, DVec3::ZERO, 1.0, 1.0).rotation, DQuat::IDENTITY);
    }

    /// Distances scale by the scale, angles stay, and the linear part is that of the map.
    #[test]
    fn similarities_scale_every_distance_alike() {
        let map = motion().at(1.0);
        assert!(map.is_valid());
        for (p, q) in some_points().zip(some_points().skip(7)) {
            assert!((map.apply(p).distance(map.apply(q)) - 2.5 * p.distance(q)).abs() < 1e-13);
            assert!((map.linear() * (p - q)).distance(map.apply(p) - map.apply(q)) < 1e-13);
        }
        assert!((map.linear().determinant() - 2.5_f64.powi(3)).abs() < 1e-12);
    }

    #[test]
    fn a_motion_starts_with_nothing_and_ends_with_all() {
        let start = motion().at(0.0);
        assert!(some_points().all(|p| start.apply(p).distance(p) < 1e-14));
        let end = motion().at(1.0);
        assert!(end.apply(motion().pivot).distance(motion().pivot + motion().translation) < 1e-14);
    }

    /// Without translation, motions about one pivot are a one-parameter group: equal steps add up.
    #[test]
    fn equal_steps_are_equal_motions() {
        let motion = Motion { translation: DVec3::ZERO, angle: 3.0 * TAU, ..motion() };
        for (s, t) in [(0.25, 0.5), (0.1, 0.9), (0.7, 0.7)] {
            for p in some_points() {
                let twice = motion.at(s).apply(motion.at(t).apply(p));
                assert!(twice.distance(motion.at(s + t).apply(p)) < 1e-12 * (1.0 + twice.length()));
            }
        }
    }

    #[test]
    fn turns_go_on_where_rotations_repeat() {
        let motion = Motion { angle: 4.0 * TAU, ..motion() };
        for t in [0.0, 0.1, 0.25, 0.7, 1.0] {
            let turn = motion.turn_at(t);
            assert!((turn.length() - 4.0 * TAU * t).abs() < 1e-12);
            assert!((DQuat::from_scaled_axis(turn).dot(motion.at(t).rotation).abs() - 1.0).abs() < 1e-12);
        }
        assert_eq!(Motion { axis: DVec3::ZERO, ..motion }.turn_at(1.0), DVec3::ZERO);
    }

    #[test]
    fn broken_similarities_are_told() {
        let good = Similarity::IDENTITY;
        assert!(!Similarity { scale: 0.0, ..good }.is_valid());
        assert!(!Similarity { scale: f64::INFINITY, ..good }.is_valid());
        assert!(!Similarity { translation: DVec3::NAN, ..good }.is_valid());
        assert!(!Similarity { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), ..good }.is_valid());
    }
}
