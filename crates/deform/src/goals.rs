use glam::DVec3;
use pliant_mesh::Similarity;

use crate::error::HandleFault;
use crate::{DeformError, Region};

/// Where the handles are to go: one similarity per handle, in the order of the region's handles.
///
/// Each is applied to the **rest** positions of its handle's vertices, so goals are absolute: the identity brings a
/// handle back to rest from wherever it was dragged.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Goals {
    /// One per handle.
    pub transforms: Vec<Similarity>,
}

impl Goals {
    /// The goals with these transforms.
    pub fn new(transforms: Vec<Similarity>) -> Self {
        Self { transforms }
    }

    /// Goals that leave `handles` handles at rest.
    pub fn identity(handles: usize) -> Self {
        Self { transforms: vec![Similarity::IDENTITY; handles] }
    }

    /// Whether there is one usable transform for each handle of `region`.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`], or [`DeformError::Handle`] with [`HandleFault::Goal`] for the first handle whose
    /// goal is not finite, has a scale that is not positive or a rotation that is not a unit quaternion.
    pub fn check(&self, region: &Region) -> Result<(), DeformError> {
        let (expected, found) = (region.handles().len(), self.transforms.len());
        if expected != found {
            return Err(DeformError::WrongCount { what: "goals", expected, found });
        }
        for (handle, transform) in self.transforms.iter().enumerate() {
            if let Some(reason) = fault(transform) {
                return Err(DeformError::handle(handle, HandleFault::Goal { reason }));
            }
        }
        Ok(())
    }

    /// Where a vertex of a handle goes from its rest position.
    pub(crate) fn apply(&self, handle: u32, rest: DVec3) -> DVec3 {
        self.transforms[handle as usize].apply(rest)
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

#[cfg(test)]
mod tests {
    use glam::DQuat;
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
}
