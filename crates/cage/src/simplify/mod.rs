//! Control meshes by quadric error simplification (Garland and Heckbert, Surface Simplification Using Quadric Error
//! Metrics, SIGGRAPH 1997), with half-edge collapses only: cage vertices are a subset of the shape's vertices, as
//! Borosan et al. 2010, Section 3, have them.

mod collapse;
mod fans;
mod greedy;
mod quadric;
mod queue;

use pliant_mesh::{Progress, TriMesh};
use serde::{Deserialize, Serialize};

use crate::CageError;
use greedy::Simplifier;

/// How large a cage is to be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CageSize {
    /// Number of vertices. What cannot be reached ends as near above it as possible: a closed surface of genus 0
    /// never goes below a tetrahedron, so 0 asks for the smallest cage there is.
    Vertices(usize),
    /// Share of the shape's vertices, above 0 and at most 1.
    Fraction(f64),
    /// Largest estimated distance from the shape (root mean square over the planes a vertex stands for), as a share of
    /// the bounding-box diagonal.
    Error(f64),
}

/// Settings of [`simplify`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SimplifyOptions {
    /// Size of the cage. Default: 5 % of the shape's vertices.
    pub size: CageSize,
    /// Weight of the planes that hold the boundary in place, relative to those of faces of the same size. Default: 10.
    pub boundary_weight: f64,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self { size: CageSize::Fraction(0.05), boundary_weight: 10.0 }
    }
}

impl From<CageSize> for SimplifyOptions {
    fn from(size: CageSize) -> Self {
        Self { size, ..Self::default() }
    }
}

/// A control mesh and where it comes from.
#[derive(Debug, Clone)]
pub struct Simplified {
    /// The control mesh; its vertices keep the order they have in the shape.
    pub mesh: TriMesh,
    /// Shape vertex of each cage vertex, increasing.
    pub origin: Vec<u32>,
    /// Cage vertex that each shape vertex was collapsed into, by way of others or not; a cage vertex owns itself
    /// (`owner[origin[j]] == j`). [`Simplified::NO_OWNER`] for a shape vertex without faces, which no cage holds.
    ///
    /// What a cage vertex owns is connected along edges of the shape, so the owners divide each component into patches.
    pub owner: Vec<u32>,
    /// What was asked for and what came of it.
    pub report: SimplifyReport,
}

impl Simplified {
    /// Stands in [`Simplified::owner`] for a shape vertex without faces.
    pub const NO_OWNER: u32 = u32::MAX;
}

/// How a simplification went.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct SimplifyReport {
    /// Vertices asked for; `None` when a distance was asked for.
    pub asked: Option<usize>,
    /// Vertices of the cage.
    pub reached: usize,
    /// Largest estimated distance of a collapse, as a share of the shape's diagonal (see [`CageSize::Error`]).
    pub estimated_error: f64,
    /// Shape vertices kept because the surface is not manifold there.
    pub locked: usize,
    /// Shape vertices without faces, which no cage can hold.
    pub unused: usize,
    /// Faces of the cage, not of the shape, that look away from the shape's normals at their corners. 0 but for the smallest
    /// cages (see [`simplify`]).
    pub flipped_faces: usize,
}

impl SimplifyReport {
    /// What a user should know about the cage; empty if it is as asked for and without flaws.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(asked) = self.asked.filter(|&asked| self.reached > asked) {
            warnings.push(format!(
                "a cage of {asked} vertices was asked for and {} reached: what is left cannot be collapsed without changing the topology, turning faces over or flattening them",
                self.reached
            ));
        }
        if let Some(asked) = self.asked.filter(|&asked| self.reached < asked) {
            warnings.push(format!("a cage of {asked} vertices was asked for, but the shape has only {}", self.reached));
        }
        if self.locked > 0 {
            warnings.push(format!("{} vertices at non-manifold places were kept as they are", self.locked));
        }
        if self.unused > 0 {
            warnings.push(format!("{} vertices without faces are not part of the cage", self.unused));
        }
        if self.flipped_faces > 0 {
            warnings.push(format!("{} faces of the cage look away from the shape's surface", self.flipped_faces));
        }
        warnings
    }
}

/// Builds a control mesh of `shape` by collapsing its vertices into neighbours, cheapest first.
///
/// Keeps what the shape is: manifold where it was manifold, the same Euler characteristic, boundaries, components. Vertices
/// at non-manifold places stay. Works on open shapes and on several components. Ties are broken by vertex
/// number, so the result is the same on every run and for any number of threads. `O(n log n)`; about 2 us a collapse, which are
/// made one after the other, and some 400 bytes a vertex.
///
/// No face is turned over to reach a size: the cage then stays larger, as the report says. Only when no more than four
/// vertices per component are asked for, the smallest cage there is, does the last stretch give up normals to get there:
/// a closed component of genus 0 ends as a tetrahedron, an open one as a triangle.
///
/// # Errors
/// A fraction that is not above 0 and at most 1, a negative or non-finite distance or boundary weight, a shape without faces, or
/// [`CageError::Cancelled`].
pub fn simplify(shape: &TriMesh, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Simplified, CageError> {
    let (asked, max_error) = resolve(shape, options)?;
    let mut simplifier = Simplifier::new(shape, options.boundary_weight, max_error);
    simplifier.run(asked, progress)?;
    simplifier.finish(shape, asked)
}

/// Number of vertices asked for and the largest distance allowed.
fn resolve(shape: &TriMesh, options: &SimplifyOptions) -> Result<(Option<usize>, f64), CageError> {
    if shape.face_count() == 0 {
        return Err(CageError::NoFaces);
    }
    if !(options.boundary_weight >= 0.0 && options.boundary_weight.is_finite()) {
        return Err(CageError::BadOption { what: "boundary weight", found: options.boundary_weight.to_string() });
    }
    match options.size {
        CageSize::Vertices(n) => Ok((Some(n), f64::INFINITY)),
        CageSize::Fraction(f) if f > 0.0 && f <= 1.0 => {
            Ok((Some((f * shape.vertex_count() as f64).round() as usize), f64::INFINITY))
        }
        CageSize::Fraction(f) => {
            Err(CageError::BadOption { what: "cage size (a share above 0 and at most 1)", found: f.to_string() })
        }
        CageSize::Error(e) if e >= 0.0 && e.is_finite() => Ok((None, e)),
        CageSize::Error(e) => {
            Err(CageError::BadOption { what: "cage error (a share of the diagonal, 0 or above)", found: e.to_string() })
        }
    }
}
