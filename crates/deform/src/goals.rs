use glam::{DQuat, DVec3};
use pliant_mesh::Similarity;

use crate::error::HandleFault;
use crate::points;
use crate::{DeformError, Region};

/// Where the handles are to go: one similarity per handle, in the order of the region's handles.
///
/// Each is applied to the **rest** positions of its handle's vertices, so goals are absolute: the identity brings a
/// handle back to rest from wherever it was dragged. Its points ([`Handle::rows`](crate::Handle::rows)) go where they are told to one by
/// one, or where the similarity takes their rest positions.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Goals {
    /// One per handle.
    pub transforms: Vec<Similarity>,
    /// Rotation vectors, one per handle or none at all.
    turns: Vec<DVec3>,
    /// Where the sums `sum_j c_j v_j` of the handles' rows are to be, in world units: handle by handle, in the order of their rows; or none
    /// at all, and each goes where the transform of its handle takes it from rest.
    pub points: Vec<DVec3>,
}

/// How far the rotation of a turn may be from that of its transform, as `1 - |p . q|` of the quaternions: some 0.003 degrees.
const SAME_ROTATION: f64 = 1e-9;

impl Goals {
    /// The goals with these transforms.
    pub fn new(transforms: Vec<Similarity>) -> Self {
        Self { transforms, ..Self::default() }
    }

    /// The goals with these transforms, reached by these turns.
    ///
    /// A rotation does not tell how it was come by: a turn by 400 degrees is the same map as one by 40. `turns` has a
    /// rotation vector for each handle, the axis times the angle in radians by the right-hand rule, of any length (`4 pi` for two full
    /// turns), whose rotation is that of the transform. Methods that carry rotations over the region follow it, and the others
    /// do not look at it. [`Self::new`] takes the shortest turns.
    pub fn with_turns(transforms: Vec<Similarity>, turns: Vec<DVec3>) -> Self {
        Self { transforms, turns, ..Self::default() }
    }

    /// The goals with these transforms for vertices and these targets for rows, see [`Self::points`].
    ///
    /// Where a shape follows its control mesh by positions and frames, `x' = sum_j c_j (y'_j + M_j (x - y_j))`, its point `x` reaches `goal` with
    /// the target `goal - sum_j c_j M_j (x - y_j)`.
    pub fn with_points(transforms: Vec<Similarity>, points: Vec<DVec3>) -> Self {
        Self { transforms, points, ..Self::default() }
    }

    /// Takes over the transforms and turns of `other`, in the memory there is, and no points.
    pub fn copy_transforms(&mut self, other: &Self) {
        self.transforms.clone_from(&other.transforms);
        self.turns.clone_from(&other.turns);
        self.points.clear();
    }

    /// Goals that leave `handles` handles at rest.
    pub fn identity(handles: usize) -> Self {
        Self::new(vec![Similarity::IDENTITY; handles])
    }

    /// Whether there is one usable transform for each handle of `region`, and as many targets as rows or none.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`], [`DeformError::Handle`] with [`HandleFault::Target`] for the first target that is not finite, or [`DeformError::Handle`] with [`HandleFault::Goal`] for the first handle whose
    /// goal is not finite, has a scale that is not positive, a rotation that is not a unit quaternion or a turn with another rotation.
    pub fn check(&self, region: &Region) -> Result<(), DeformError> {
        let (expected, found) = (region.handles().len(), self.transforms.len());
        if expected != found {
            return Err(DeformError::WrongCount { what: "goals", expected, found });
        }
        if !self.turns.is_empty() && self.turns.len() != expected {
            return Err(DeformError::WrongCount { what: "turns", expected, found: self.turns.len() });
        }
        if !self.points.is_empty() && self.points.len() != region.row_count() {
            return Err(DeformError::WrongCount {
                what: "points",
                expected: region.row_count(),
                found: self.points.len(),
            });
        }
        if let Some(((handle, _, row, _), _)) = region.rows().zip(&self.points).find(|(_, point)| !point.is_finite()) {
            return Err(DeformError::handle(handle as usize, HandleFault::Target { row }));
        }
        for (handle, transform) in self.transforms.iter().enumerate() {
            let turn = self.turns.get(handle);
            if let Some(reason) = fault(transform).or_else(|| turn_fault(transform, *turn?)) {
                return Err(DeformError::handle(handle, HandleFault::Goal { reason }));
            }
        }
        Ok(())
    }

    /// The turn of a handle as a rotation vector, the axis times the angle in radians; the shortest one where none was given.
    pub fn turn(&self, handle: usize) -> DVec3 {
        match self.turns.get(handle) {
            Some(&turn) => turn,
            None => shortest_turn(self.transforms[handle].rotation),
        }
    }

    /// Where a vertex of a handle goes from its rest position.
    pub(crate) fn apply(&self, handle: u32, rest: DVec3) -> DVec3 {
        self.transforms[handle as usize].apply(rest)
    }

    /// Where a point goes: number `number` of all, with this row in `handle`.
    pub(crate) fn target(&self, number: usize, handle: u32, row: &[(u32, f64)], rest: &[DVec3]) -> DVec3 {
        match self.points.get(number) {
            Some(&point) => point,
            None => points::combine(row, |vertex| self.apply(handle, rest[vertex as usize])),
        }
    }
}

fn fault(transform: &Similarity) -> Option<&'static str> {
    if transform.is_valid() {
        None
    } else if !transform.translation.is_finite() {
        Some("its translation is not finite")
    } else if !transform.scale.is_finite() {
        Some("its scale is not finite")
    } else if transform.scale <= 0.0 {
        Some("its scale is not above 0")
    } else {
        Some("its rotation is not a unit quaternion")
    }
}

fn turn_fault(transform: &Similarity, turn: DVec3) -> Option<&'static str> {
    let overlap = DQuat::from_scaled_axis(turn).dot(transform.rotation) / transform.rotation.length();
    // Written so that NaN is at fault.
    let same = 1.0 - overlap.abs() <= SAME_ROTATION;
    (!same).then_some("its turn has another rotation than its transform")
}

/// The rotation vector of at most half a turn; of two half turns the one that the quaternion says.
pub(crate) fn shortest_turn(rotation: DQuat) -> DVec3 {
    let q = if rotation.w < 0.0 { -rotation } else { rotation };
    let sine = q.xyz().length();
    // The angle is 2 atan(sine / w); for small ones 2 sine / w.
    let factor = if sine > 1e-9 { 2.0 * sine.atan2(q.w) / sine } else { 2.0 };
    q.xyz() * factor
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use pliant_mesh::VertexSet;

    use super::*;
    use crate::Handle;

    #[test]
    fn bad_goals_name_handle_and_reason() {
        let handles: Vec<Handle> = (0..2).map(|v| Handle::hard(VertexSet::from_iter([v]))).collect();
        let region = Region::new(3, &VertexSet::all(3), &handles).expect("valid");
        assert_eq!(region.identity_goals().check(&region), Ok(()));
        let wrong = DeformError::WrongCount { what: "goals", expected: 2, found: 1 };
        assert_eq!(Goals::identity(1).check(&region), Err(wrong));
        let id = Similarity::IDENTITY;
        for (bad, word) in [
            (Similarity { translation: DVec3::new(0.0, f64::NAN, 0.0), ..id }, "translation"),
            (Similarity { translation: DVec3::INFINITY, ..id }, "translation"),
            (Similarity { scale: 0.0, ..id }, "scale"),
            (Similarity { scale: -1.0, ..id }, "scale"),
            (Similarity { scale: f64::NAN, ..id }, "scale"),
            (Similarity { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..id }, "rotation"),
            (Similarity { rotation: DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), ..id }, "rotation"),
        ] {
            let error = Goals::new(vec![id, bad]).check(&region).expect_err("not a similarity").to_string();
            assert!(error.contains("handle 1") && error.contains(word), "{error}");
        }
    }
    #[test]
    fn turns_agree_with_their_transforms() {
        let region = Region::new(2, &VertexSet::all(2), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
        let axis = DVec3::new(2.0, -1.0, 2.0) / 3.0;
        for angle in [0.0, 1e-12, 0.5, PI - 1e-9, PI, 4.0, -5.0, 2.0 * TAU, 100.0] {
            let transform = Similarity::about(DVec3::ONE, axis, angle, 2.0);
            let goals = Goals::with_turns(vec![transform], vec![axis * angle]);
            assert_eq!(goals.check(&region), Ok(()));
            assert_eq!(goals.turn(0), axis * angle);
            let shortest = Goals::new(vec![transform]).turn(0);
            assert!(shortest.length() <= PI + 1e-12);
            let same = DQuat::from_scaled_axis(shortest).dot(transform.rotation).abs();
            assert!((same - 1.0).abs() < 1e-14);
            // The difference is a number of full turns about the same axis.
            let rounds = (axis * angle - shortest).length() / TAU;
            assert!((rounds - rounds.round()).abs() < 1e-9 || (shortest.length() - PI).abs() < 1e-6);
        }
        let turned = Similarity::about(DVec3::ONE, axis, 1.0, 1.0);
        for wrong in
            [DVec3::ZERO, axis * 1.02, axis * (1.0 + PI), -axis, DVec3::NAN, axis * f64::INFINITY, axis * 1e300]
        {
            let error = Goals::with_turns(vec![turned], vec![wrong]).check(&region).expect_err("another rotation");
            assert!(error.to_string().contains("turn"), "{wrong}: {error}");
        }
        let error = Goals::with_turns(vec![turned], vec![axis; 3]).check(&region);
        assert_eq!(error, Err(DeformError::WrongCount { what: "turns", expected: 1, found: 3 }));
    }
}
