//! Sparse symmetric positive definite systems and sparse least squares in f64, for three right-hand sides at a time.
//!
//! A system has three lifetimes, and each is paid for only when its inputs change:
//!
//! 1. the *pattern* (which unknowns are coupled): [`SpdPattern`], an ordering and a symbolic factor;
//! 2. the *values*, and which unknowns are free: [`Cholesky::of_block`], then [`Cholesky::refactor_block`] in the same memory;
//! 3. the *right-hand sides*: [`Cholesky::solve_in_place`], which allocates nothing.
//!
//! [`Partition`] takes known unknowns out of a system: it cuts a full matrix, given as [`Triplet`]s, into the block of
//! the free unknowns and their coupling to the fixed ones.
//!
//! [`SparseRows`] hold a matrix of any shape, and [`LeastSquares`] or, without a factor, [`IterativeLeastSquares`] solve with it in the
//! least-squares sense.
//!
//! [`Multigrid`] is an approximate inverse for matrices like a mesh's Laplacian, where a factor takes too long or too much memory.
//!
//! This crate knows numbers only: no mesh, no vertex. faer is used here and nowhere else.

mod cholesky;
mod error;
mod iterative;
mod least_squares;
mod multigrid;
mod normal;
mod panels;
mod partition;
mod pattern;
mod rows;

pub use cholesky::Cholesky;
pub use error::LinalgError;
pub use iterative::{IterativeLeastSquares, IterativeReport, Krylov};
pub use least_squares::LeastSquares;
pub use multigrid::Multigrid;
pub use partition::{Coupling, Partition};
pub use pattern::SpdPattern;
pub use rows::SparseRows;

/// One entry of a symmetric matrix.
///
/// An entry off the diagonal stands for both `(row, col)` and `(col, row)` and is given once, in either triangle.
/// Entries at the same place are added up in the order given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triplet {
    /// Row, from 0.
    pub row: u32,
    /// Column, from 0.
    pub col: u32,
    /// What is added there.
    pub value: f64,
}

impl Triplet {
    /// The entry `value` at `(row, col)`.
    pub fn new(row: u32, col: u32, value: f64) -> Self {
        Self { row, col, value }
    }
}
