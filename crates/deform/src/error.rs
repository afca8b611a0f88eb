use pliant_linalg::LinalgError;
use pliant_mesh::MeshError;
use thiserror::Error;

/// Why a region, a goal or a solve was refused. Handles are numbered from 0 in the order given.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DeformError {
    /// The region of interest has no vertex.
    #[error("the region of interest is empty")]
    EmptyRegion,
    /// The region of interest names a vertex that does not exist.
    #[error("the region of interest has vertex {vertex}, but there are {vertices} vertices (numbered from 0)")]
    VertexOutOfRange {
        /// The vertex named.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A handle cannot be used.
    #[error("handle {handle} {fault}")]
    Handle {
        /// The handle.
        handle: usize,
        /// What is wrong with it.
        fault: HandleFault,
    },
    /// Every vertex is free: nothing says where the shape should be.
    #[error(
        "nothing is held: every vertex is free, so the shape could be anywhere (add a handle or leave vertices out of the region of interest)"
    )]
    NoConstraint,
    /// Some vertices of the region are free, and no path along edges within the region joins them to anything held.
    #[error(
        "vertex {vertex} and {} more of the region of interest are joined to nothing held, so they could be anywhere (add a handle on their part or leave it out of the region)", count - 1
    )]
    Unconstrained {
        /// The first of them.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
    /// Something has not one entry per vertex or handle.
    #[error("{found} {what} given where {expected} are needed")]
    WrongCount {
        /// "positions", "goals", "turns", "points", "cage vertices" or "vertices of the region".
        what: &'static str,
        /// How many are needed.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// An option has a value it cannot take.
    #[error("{option} must be {expected}, not {found}")]
    BadOption {
        /// The option's name.
        option: &'static str,
        /// The values it takes.
        expected: &'static str,
        /// The value given.
        found: String,
    },
    /// A handle has points that are no vertices, and the method only takes vertices.
    #[error(
        "handle {handle} holds points that are no vertices, which only as-rigid-as-possible deformation (arap) takes"
    )]
    PointsNotTaken {
        /// The first such handle.
        handle: usize,
    },
    /// A mesh or pose is not usable.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The system of a vertex could not be solved, though the vertex is connected to something held.
    #[error(
        "the equations break down at vertex {vertex}: its surroundings are too degenerate (needles or folded triangles)"
    )]
    Singular {
        /// The vertex.
        vertex: u32,
    },
    /// The equations of a subspace could not be solved.
    #[error(
        "the equations of the cage's subspace break down at cage vertex {column}: its weights are not finite or too uneven"
    )]
    DegenerateSubspace {
        /// The cage vertex.
        column: usize,
    },
    /// The result is not finite or too large to compute with.
    #[error("the result at vertex {vertex} is not a finite number; the pose was left as it was")]
    ResultNotFinite {
        /// The vertex.
        vertex: u32,
    },
    /// The system does not fit in memory.
    #[error("the equations are too large: {0}")]
    TooLarge(LinalgError),
}

/// What is wrong with a handle.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum HandleFault {
    /// It has no vertex and no point.
    #[error("has no vertex and no point")]
    Empty,
    /// It names a vertex that does not exist.
    #[error("has vertex {vertex}, but there are {vertices} vertices (numbered from 0)")]
    VertexOutOfRange {
        /// The vertex named.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// It has a vertex that is not in the region of interest.
    #[error("has vertex {vertex}, which is outside the region of interest")]
    OutsideRegion {
        /// The vertex.
        vertex: u32,
    },
    /// It shares a vertex with an earlier handle.
    #[error("and handle {other} both have vertex {vertex}")]
    Overlap {
        /// The earlier handle.
        other: usize,
        /// The shared vertex.
        vertex: u32,
    },
    /// Its weight is not a positive number.
    #[error("has weight {weight}: a soft handle's weight is a number above 0")]
    Weight {
        /// The weight.
        weight: f64,
    },
    /// A point's row names a vertex that does not exist.
    #[error("has point {row} with vertex {vertex}, but there are {vertices} vertices (numbered from 0)")]
    RowVertexOutOfRange {
        /// The point, from 0 within the handle.
        row: usize,
        /// The vertex named.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A point's row has a weight that is infinite or not a number.
    #[error("has point {row} with a weight that is not a finite number")]
    RowNotFinite {
        /// The point, from 0 within the handle.
        row: usize,
    },
    /// The weights of a point's row do not sum to 1 within 1e-6, or only by cancelling each other.
    #[error(
        "has point {row} whose weights sum to {sum} (they must sum to 1 within 1e-6, and their magnitudes to at most 1e6)"
    )]
    RowSum {
        /// The point, from 0 within the handle.
        row: usize,
        /// The sum.
        sum: f64,
    },
    /// A point's row has fixed vertices only, so nothing can move the point.
    #[error("has point {row}, all of whose vertices are outside the region of interest")]
    RowOutsideRegion {
        /// The point, from 0 within the handle.
        row: usize,
    },
    /// The target of a point is not a finite number or too far away to compute with.
    #[error(
        "has point {row} with a target that is not finite or too far away to compute with (over 1e100 times the size of the shape)"
    )]
    Target {
        /// The point, from 0 within the handle.
        row: usize,
    },
    /// Its goal is not a similarity: a number is not finite, the scale is not positive, or the rotation is not a unit
    /// quaternion.
    #[error("has a goal that is no similarity: {reason}")]
    Goal {
        /// Which of its numbers is at fault.
        reason: &'static str,
    },
    /// Its goal is too far away to compute with.
    #[error("takes vertex {vertex} too far away to compute with (over 1e100 times the size of the shape)")]
    TooFar {
        /// The vertex.
        vertex: u32,
    },
}

impl DeformError {
    /// The fault of a handle.
    pub(crate) fn handle(handle: usize, fault: HandleFault) -> Self {
        Self::Handle { handle, fault }
    }

    /// Whether the input was fit to compute with and the computation led to nothing.
    pub fn is_numeric(&self) -> bool {
        matches!(
            self,
            Self::Singular { .. } | Self::DegenerateSubspace { .. } | Self::ResultNotFinite { .. } | Self::TooLarge(_)
        )
    }

    /// What an error of the equations means; `vertices` has the vertex of each unknown.
    pub(crate) fn of_system(error: LinalgError, vertices: &[u32]) -> Self {
        let vertex = |unknown: usize| vertices.get(unknown).copied().unwrap_or(u32::MAX);
        match error {
            LinalgError::SolutionNotFinite { unknown } => Self::ResultNotFinite { vertex: vertex(unknown) },
            LinalgError::NotPositiveDefinite { unknown } => Self::Singular { vertex: vertex(unknown) },
            other => Self::TooLarge(other),
        }
    }
}
