use crate::normal::NormalEquations;
use crate::{LinalgError, SparseRows};

/// Which iteration solves the normal equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Krylov {
    /// Preconditioned conjugate gradients.
    ConjugateGradient,
    /// Preconditioned bi-conjugate gradients, with the residual itself as the first shadow residual.
    ///
    /// On a symmetric matrix the shadow sequence equals the other, so that the iterates are those of
    /// [`Self::ConjugateGradient`] at twice the products; here for comparison with what has been published with it.
    BiConjugateGradient,
}

/// What an iterative solve came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IterativeReport {
    /// Iterations done, of the right-hand side that took most.
    pub iterations: u32,
    /// Whether the tolerance was met for all right-hand sides.
    pub converged: bool,
}

/// Minimises `|A x - b|^2` over the free columns of `A`, the others given, without a factor: see
/// [`LeastSquares`](crate::LeastSquares) for the problem.
///
/// The preconditioner is the diagonal of the normal equations; these are never formed, but applied as `A_f^T (A_f p)`. The number of
/// iterations grows with `cond(A)`.
#[derive(Debug)]
pub struct IterativeLeastSquares {
    normal: NormalEquations,
    kind: Krylov,
    /// Of the diagonal of the normal equations.
    inverse: Vec<f64>,
    residual: Vec<[f64; 3]>,
    main: Sequence,
    /// Only of [`Krylov::BiConjugateGradient`].
    shadow: Sequence,
}

/// Residual `r` and direction `p` of the normal equations, and `N p`.
#[derive(Debug, Default)]
struct Sequence {
    r: Vec<[f64; 3]>,
    p: Vec<[f64; 3]>,
    np: Vec<[f64; 3]>,
}

impl IterativeLeastSquares {
    /// Makes ready for solving.
    ///
    /// # Errors
    /// [`LinalgError::EntryNotFinite`]; [`LinalgError::NotPositiveDefinite`] with the first free column that no row touches;
    /// [`LinalgError::TooLarge`].
    pub fn new(a: SparseRows, is_free: impl FnMut(usize) -> bool, kind: Krylov) -> Result<Self, LinalgError> {
        let normal = NormalEquations::new(a, is_free)?;
        normal.check_values()?;
        let unknowns = normal.unknowns();
        let inverse = (0..unknowns).map(|k| 1.0 / normal.diagonal(k)).collect();
        let residual = vec![[0.0; 3]; normal.a.row_count()];
        let shadow = match kind {
            Krylov::ConjugateGradient => Sequence::default(),
            Krylov::BiConjugateGradient => Sequence::new(unknowns),
        };
        Ok(Self { normal, kind, inverse, residual, main: Sequence::new(unknowns), shadow })
    }

    /// The matrix.
    pub fn matrix(&self) -> &SparseRows {
        &self.normal.a
    }

    /// Solves: `b` has a row per row of the matrix; of `x`, with a row per column, the free ones are the first guess and are replaced by
    /// the solution. Allocates nothing.
    ///
    /// A right-hand side is done when its residual `r` of the normal equations, in the norm `sqrt(r^T D^-1 r)` with their diagonal
    /// `D`, is at most `tolerance` times that for `x_f = 0`, or after `most` iterations.
    ///
    /// # Errors
    /// [`LinalgError::WrongCount`]; [`LinalgError::SolutionNotFinite`] with its column (then the free rows of `x` are spoilt).
    pub fn solve(
        &mut self,
        b: &[[f64; 3]],
        x: &mut [[f64; 3]],
        tolerance: f64,
        most: u32,
    ) -> Result<IterativeReport, LinalgError> {
        self.normal.check_counts(b, x)?;
        let goal = self.start(b, x).map(|norm| tolerance * norm);
        let mut rz = self.preconditioned();
        let mut report = IterativeReport { iterations: 0, converged: false };
        let reached = |rz: [f64; 3]| -> [bool; 3] { std::array::from_fn(|c| rz[c].abs().sqrt() <= goal[c]) };
        loop {
            if let Some(unknown) = self.first_spoilt(rz) {
                return Err(LinalgError::SolutionNotFinite { unknown });
            }
            let done = reached(rz);
            report.converged = done == [true; 3];
            if report.converged || report.iterations == most {
                break;
            }
            self.apply();
            let curvature = dot(self.partner(), &self.main.np);
            // A right-hand side that is done, or whose direction is spent, waits for the others.
            let open: [bool; 3] = std::array::from_fn(|c| !done[c] && rz[c] != 0.0 && curvature[c] != 0.0);
            if open == [false; 3] {
                break;
            }
            let alpha = std::array::from_fn(|c| if open[c] { rz[c] / curvature[c] } else { 0.0 });
            self.normal.advance(x, alpha, &self.main.p);
            self.main.lower(alpha);
            self.shadow.lower(alpha);
            let next = self.preconditioned();
            let beta = std::array::from_fn(|c| if open[c] { next[c] / rz[c] } else { 0.0 });
            self.main.turn(beta, &self.inverse);
            self.shadow.turn(beta, &self.inverse);
            rz = next;
            report.iterations += 1;
        }
        Ok(report)
    }

    /// The column whose residual is not finite, if `r~^T D^-1 r` tells that there is such a one.
    fn first_spoilt(&self, rz: [f64; 3]) -> Option<usize> {
        let is_finite = |r: &[f64; 3]| r.iter().all(|r| r.is_finite());
        // Of finite residuals that overflow when squared, the first is named.
        let first = || self.main.r.iter().position(|r| !is_finite(r)).unwrap_or(0);
        (!is_finite(&rz)).then(|| self.normal.column(first()))
    }

    /// Sets up residuals and first directions; returns the norms of the residual for `x_f = 0`.
    fn start(&mut self, b: &[[f64; 3]], x: &mut [[f64; 3]]) -> [f64; 3] {
        let Self { normal, inverse, residual, main, shadow, .. } = self;
        // Of the plain right-hand side: `A x` less what the first guess adds to it.
        normal.residual(b, x, residual);
        normal.gather(residual, &mut main.r);
        normal.read(x, &mut main.p);
        normal.multiply(&main.p, residual);
        normal.gather(residual, &mut main.np);
        let mut norms = [0.0; 3];
        for ((r, np), inverse) in main.r.iter().zip(&main.np).zip(inverse.iter()) {
            for c in 0..3 {
                norms[c] += inverse * (r[c] + np[c]).powi(2);
            }
        }
        main.turn([0.0; 3], inverse);
        if !shadow.r.is_empty() {
            shadow.r.copy_from_slice(&main.r);
            shadow.turn([0.0; 3], inverse);
        }
        norms.map(f64::sqrt)
    }

    /// `r~^T D^-1 r`.
    fn preconditioned(&self) -> [f64; 3] {
        let other = if self.kind == Krylov::ConjugateGradient { &self.main.r } else { &self.shadow.r };
        let mut sum = [0.0; 3];
        for ((r, other), inverse) in self.main.r.iter().zip(other).zip(&self.inverse) {
            for c in 0..3 {
                sum[c] += inverse * r[c] * other[c];
            }
        }
        sum
    }

    /// The direction that the image of the other one is measured against.
    fn partner(&self) -> &[[f64; 3]] {
        if self.kind == Krylov::ConjugateGradient { &self.main.p } else { &self.shadow.p }
    }

    /// `N p`, and `N^T p~` of the shadow.
    fn apply(&mut self) {
        let Self { normal, residual, main, shadow, kind, .. } = self;
        let sequences = [Some(main), (*kind == Krylov::BiConjugateGradient).then_some(shadow)];
        for sequence in sequences.into_iter().flatten() {
            normal.multiply(&sequence.p, residual);
            normal.gather(residual, &mut sequence.np);
        }
    }
}

impl Sequence {
    fn new(unknowns: usize) -> Self {
        let rows = || vec![[0.0; 3]; unknowns];
        Self { r: rows(), p: rows(), np: rows() }
    }

    /// `r -= alpha N p`.
    fn lower(&mut self, alpha: [f64; 3]) {
        for (r, np) in self.r.iter_mut().zip(&self.np) {
            for c in 0..3 {
                r[c] -= alpha[c] * np[c];
            }
        }
    }

    /// `p = D^-1 r + beta p`.
    fn turn(&mut self, beta: [f64; 3], inverse: &[f64]) {
        for ((p, r), inverse) in self.p.iter_mut().zip(&self.r).zip(inverse) {
            for c in 0..3 {
                p[c] = inverse * r[c] + beta[c] * p[c];
            }
        }
    }
}

fn dot(a: &[[f64; 3]], b: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for (a, b) in a.iter().zip(b) {
        for c in 0..3 {
            sum[c] += a[c] * b[c];
        }
    }
    sum
}
