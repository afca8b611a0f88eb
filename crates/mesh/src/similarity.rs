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
}
