//! What a handle holds on the shape.

use pliant_deform::Constraint;
use pliant_mesh::{Similarity, TriMesh, VertexSet};
use serde::{Deserialize, Serialize};

use super::rows::Corners;
use crate::SessionError;

/// A point of the surface: a face, and weights of its corners that sum to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfacePoint {
    /// The face.
    pub face: u32,
    /// Weights of its three corners, each 0 to 1.
    pub barycentric: [f64; 3],
}

impl SurfacePoint {
    /// By the corners of its face.
    pub(crate) fn on(&self, triangles: &[[u32; 3]]) -> Corners {
        Corners { vertices: triangles[self.face as usize], weights: self.barycentric }
    }
}

/// What a handle holds: vertices of the shape (one, or a whole region), or a point inside a face.
#[derive(Debug, Clone, PartialEq)]
pub enum Grip {
    /// These vertices.
    Vertices(VertexSet),
    /// A point of the surface.
    Point(SurfacePoint),
}

impl Grip {
    /// One vertex.
    pub fn vertex(vertex: u32) -> Self {
        Self::Vertices(VertexSet::from_iter([vertex]))
    }

    /// The vertices it holds, if it is no point.
    pub(crate) fn vertices(&self) -> Option<&VertexSet> {
        match self {
            Self::Vertices(vertices) => Some(vertices),
            Self::Point(_) => None,
        }
    }

    pub(crate) fn check(&self, mesh: &TriMesh) -> Result<(), SessionError> {
        let refuse = |reason: String| Err(SessionError::BadGrip { reason });
        match self {
            Self::Vertices(vertices) => match vertices.iter().last() {
                None => refuse("it holds no vertex".to_owned()),
                Some(last) if last as usize >= mesh.vertex_count() => {
                    refuse(format!("there is no vertex {last}, the shape has {}", mesh.vertex_count()))
                }
                Some(_) => Ok(()),
            },
            Self::Point(point) => {
                if point.face as usize >= mesh.face_count() {
                    return refuse(format!("there is no face {}, the shape has {}", point.face, mesh.face_count()));
                }
                let weights = point.barycentric;
                let sum: f64 = weights.iter().sum();
                // Written so that NaN is refused.
                if weights.iter().all(|w| (-1e-9..=1.0 + 1e-9).contains(w)) && (sum - 1.0).abs() <= 1e-9 {
                    Ok(())
                } else {
                    refuse(format!("weights {weights:?} are not those of a point in a face"))
                }
            }
        }
    }
}

/// A handle of an editor.
#[derive(Debug, Clone, PartialEq)]
pub struct EditorHandle {
    /// Its number: handles are numbered as they are added, and a number is not used again.
    pub id: u32,
    /// What it holds.
    pub grip: Grip,
    /// How.
    pub constraint: Constraint,
    /// Where it takes what it holds, from where that was when the step began. The identity for an anchor.
    pub goal: Similarity,
}
