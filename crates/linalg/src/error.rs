use thiserror::Error;

/// Why a system could not be built or solved, naming the entry or the unknown.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LinalgError {
    /// The system does not fit 32-bit indices or the memory there is.
    #[error("a system with {unknowns} unknowns and {entries} entries is too large")]
    TooLarge {
        /// Unknowns.
        unknowns: usize,
        /// Entries given.
        entries: usize,
    },
    /// An entry lies outside the matrix.
    #[error("entry {entry} is at ({row}, {col}), but there are {unknowns} unknowns (numbered from 0)")]
    IndexOutOfRange {
        /// Position of the entry in the list given.
        entry: usize,
        /// Its row.
        row: u32,
        /// Its column.
        col: u32,
        /// Unknowns.
        unknowns: usize,
    },
    /// A column of an upper triangle is not what it should be.
    #[error("column {col}: its rows must increase and end with {col}, and columns must follow each other")]
    BadColumn {
        /// The column; the number of columns if there are entries behind the last.
        col: usize,
    },
    /// Values or right-hand sides of the wrong number.
    #[error("{found} {what} given where {expected} are needed")]
    WrongCount {
        /// "values" or "right-hand side rows".
        what: &'static str,
        /// How many are needed.
        expected: usize,
        /// How many were given.
        found: usize,
    },
    /// A matrix entry is infinite or not a number.
    #[error("matrix entry {entry} is not a finite number")]
    EntryNotFinite {
        /// Position of the entry in the list given.
        entry: usize,
    },
    /// The matrix is not positive definite, or so nearly singular that nothing is left of a pivot but rounding.
    #[error("the matrix is not positive definite: no pivot is left at unknown {unknown}")]
    NotPositiveDefinite {
        /// The unknown at which the factorisation stopped, in the numbering of the matrix given.
        unknown: usize,
    },
    /// A solution came out infinite or not a number: the right-hand side was, or an intermediate result overflowed.
    #[error("the solution at unknown {unknown} is not a finite number")]
    SolutionNotFinite {
        /// The first such unknown.
        unknown: usize,
    },
}
