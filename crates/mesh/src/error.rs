use thiserror::Error;

/// What is wrong with a mesh, naming the vertex, edge or face at fault.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Vertex and face numbers are 32 bits wide.
    #[error("{count} {what} are more than this library can number ({})", u32::MAX / 4)]
    TooMany {
        /// "vertices" or "faces".
        what: &'static str,
        /// How many there are.
        count: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {vertices} vertices (numbered from 0)")]
    IndexOutOfRange {
        /// The face, numbered from 0.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A face has the same vertex at two corners.
    #[error("face {face} has vertex {vertex} at two of its corners")]
    RepeatedVertex {
        /// The face, numbered from 0.
        face: usize,
        /// The repeated vertex.
        vertex: u32,
    },
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex} has a coordinate that is not a finite number")]
    NotFinite {
        /// The vertex, numbered from 0.
        vertex: usize,
    },
    /// A position array does not fit the connectivity.
    #[error("{found} positions given for a mesh of {expected} vertices")]
    PositionCount {
        /// Vertices of the connectivity.
        expected: usize,
        /// Positions given.
        found: usize,
    },
    /// An edge has more than two faces.
    #[error("the mesh is not manifold: edge {a}-{b} has {faces} faces")]
    NonManifoldEdge {
        /// Smaller end.
        a: u32,
        /// Larger end.
        b: u32,
        /// How many faces share it.
        faces: usize,
    },
    /// The faces around a vertex form more than one fan.
    #[error("the mesh is not manifold: the faces around vertex {vertex} form {fans} separate fans")]
    NonManifoldVertex {
        /// The vertex.
        vertex: u32,
        /// Number of fans.
        fans: usize,
    },
    /// Two faces run through their shared edge in the same direction.
    #[error("faces {} and {} have opposite orientations across edge {a}-{b}", faces[0], faces[1])]
    InconsistentOrientation {
        /// Smaller end.
        a: u32,
        /// Larger end.
        b: u32,
        /// The two faces.
        faces: [u32; 2],
    },
    /// An edge has only one face.
    #[error("the mesh is not closed: edge {a}-{b} has one face ({open} such edges)")]
    OpenEdge {
        /// Smaller end.
        a: u32,
        /// Larger end.
        b: u32,
        /// How many edges are like it.
        open: usize,
    },
    /// A generator or selection was asked for something it cannot make.
    #[error("{what} must be {expected}, not {found}")]
    BadParameter {
        /// The parameter's name.
        what: &'static str,
        /// The values it takes.
        expected: String,
        /// The value given.
        found: String,
    },
}
