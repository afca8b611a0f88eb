use std::path::PathBuf;

use pliant_files::FileError;
use pliant_mesh::MeshError;
use thiserror::Error;

use super::Fingerprint;
use crate::CageError;

/// Why a binding file could not be written or read; every message starts with its path.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BindingFileError {
    /// The file itself could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// What it holds, or was to hold, is at fault.
    #[error("{}: {fault}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: BindingFault,
    },
}

/// What is wrong with the content of a binding file.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum BindingFault {
    /// There is nothing at all.
    #[error("the file is empty")]
    Empty,
    /// It starts with other bytes than binding files do.
    #[error("this is not a binding file")]
    NotABinding,
    /// Its numbers have their bytes in another order.
    #[error(
        "the byte order mark is {found:#010x}, not {:#010x}: binding files are little endian",
        super::header::ORDER
    )]
    ByteOrder {
        /// The mark.
        found: u32,
    },
    /// It is of another version.
    #[error("this is version {found} of binding files, version {supported} is read")]
    Version {
        /// The file's version.
        found: u32,
        /// The only one supported.
        supported: u32,
    },
    /// It uses parts of the format that are not known.
    #[error("the flags are {found:#x}, of which {known:#x} are known")]
    Flags {
        /// The file's flags.
        found: u32,
        /// The known ones.
        known: u32,
    },
    /// It ends early.
    #[error("truncated: {found} of {}{expected} bytes", if *.at_least { "at least " } else { "" })]
    Truncated {
        /// Bytes there are.
        found: u64,
        /// Bytes there should be.
        expected: u64,
        /// Whether the end is missing of what would say how many.
        at_least: bool,
    },
    /// It goes on after its end.
    #[error("trailing bytes: {extra} after the {expected} that the file says it has")]
    Trailing {
        /// Bytes there should be.
        expected: u64,
        /// Bytes beyond.
        extra: u64,
    },
    /// It was changed since it was written.
    #[error("damaged: the checksum is {found:016x}, the file says {expected:016x}")]
    Checksum {
        /// What the file says.
        expected: u64,
        /// What its content gives.
        found: u64,
    },
    /// It belongs to another mesh.
    #[error(
        "the binding was made for another {what}: {expected}; this one has {found}{}",
        if *.rounds_alike { " (in single precision they are the same: it was read from a file of another precision)" } else { "" }
    )]
    OtherMesh {
        /// "shape" or "cage".
        what: &'static str,
        /// Of the mesh the binding was made for.
        expected: Fingerprint,
        /// Of the mesh given.
        found: Fingerprint,
        /// Whether the two differ by no more than what rounding to single precision takes away.
        rounds_alike: bool,
    },
    /// A part says that it is longer than what is left of the file.
    #[error("{what}: {count} times {size} bytes declared, {left} bytes left")]
    Count {
        /// The part.
        what: &'static str,
        /// How many values it says there are.
        count: u64,
        /// Bytes of each.
        size: u64,
        /// Bytes left.
        left: u64,
    },
    /// Bytes are left over within the part that the checksum covers.
    #[error("trailing bytes: {extra} that belong to nothing")]
    Unread {
        /// How many.
        extra: u64,
    },
    /// A number is out of its range.
    #[error("{what} cannot be {found}")]
    Value {
        /// The number.
        what: &'static str,
        /// What it is.
        found: String,
    },
    /// A row of weights is broken.
    #[error("{what} {row}: {fault}")]
    Row {
        /// "row" of a shape vertex or "smoothing row" of a cage vertex.
        what: &'static str,
        /// The vertex, numbered from 0.
        row: usize,
        /// What is wrong with it.
        fault: RowFault,
    },
    /// Rows do not take up all their entries.
    #[error("{what}s have {found} entries together, {expected} are declared")]
    Entries {
        /// As in [`BindingFault::Row`].
        what: &'static str,
        /// Entries declared.
        expected: u64,
        /// The sum of the rows' lengths.
        found: u64,
    },
    /// A cage vertex does not lie on the shape vertex it is said to come from.
    #[error("cage vertex {cage_vertex} cannot come from shape vertex {shape_vertex}")]
    Origin {
        /// The cage vertex.
        cage_vertex: usize,
        /// Where it is said to come from.
        shape_vertex: u32,
    },
    /// A shape vertex is owned by no cage vertex, or one that comes from it by another.
    #[error("shape vertex {shape_vertex} cannot belong to cage vertex {owner}")]
    Owner {
        /// The shape vertex.
        shape_vertex: usize,
        /// The owner it is said to have.
        owner: u32,
    },
    /// A cage was to be saved with the binding of another one.
    #[error("the simplified mesh is not the cage of the binding")]
    Unmatched,
    /// The options are out of range.
    #[error(transparent)]
    Options(#[from] CageError),
    /// The cage is no mesh.
    #[error("the cage: {0}")]
    Cage(#[from] MeshError),
}

/// What is wrong with a row of weights.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum RowFault {
    /// It has no entry.
    #[error("no entries")]
    Empty,
    /// It goes on after the last entry of all.
    #[error("ends at entry {end} of {entries}")]
    PastEnd {
        /// Where it ends.
        end: u64,
        /// How many entries there are.
        entries: u64,
    },
    /// An entry names a vertex that the cage does not have.
    #[error("names cage vertex {vertex}, but there are {vertices}")]
    Vertex {
        /// The vertex named.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// The first entry is not the largest, or the others do not increase by vertex and leave the first out.
    #[error("entries out of order")]
    Order,
    /// A weight is no number, infinite, or far beyond what rows can hold.
    #[error("a weight of {weight}")]
    Weight {
        /// The weight.
        weight: f32,
    },
    /// Weights do not sum to 1.
    #[error("weights sum to {sum}, not 1")]
    Sum {
        /// Their sum.
        sum: f64,
    },
}
