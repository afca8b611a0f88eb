use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::arap::MAX_ITERATIONS;
use crate::{DeformError, text};

/// What becomes of the heights of dual vertices while normals are taken anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DualHeights {
    /// They stay those of the rest shape, as in the text of Luo et al. and in Au et al. (2006).
    #[default]
    Kept,
    /// They are measured along the new normal, as Luo et al. print Eq. 10. Nothing holds them to those at rest but the first solve: on bent
    /// tubes they change two to three times as much.
    Recomputed,
}

/// How the normal equations are solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LinearSolver {
    /// By a Cholesky factor that is kept for all iterations and solves.
    ///
    /// A departure from Luo et al., who iterate: their matrix is constant, so that a factor pays from the second solve on.
    #[default]
    Cholesky,
    /// By preconditioned conjugate gradients, starting from the last positions.
    Pcg,
    /// By preconditioned bi-conjugate gradients, as Luo et al. do: the iterates of [`Self::Pcg`] at twice the cost.
    Pbcg,
}

/// Options of deformation by the dual Laplacian.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DualLaplacianOptions {
    /// Default: kept.
    pub heights: DualHeights,
    /// Default: Cholesky.
    pub solver: LinearSolver,
    /// Most iterations after the first solve, at most [`MAX_ITERATIONS`]; an iteration takes new normals and solves. Default: 50. With 0
    /// the normals are those of the incoming pose, moved along with what is held.
    pub iterations: u32,
    /// If given, iterations stop as soon as one has moved no vertex by more than this share of the rest shape's diagonal; a number of 0 or
    /// more. Default: 1e-4, a tenth of a pixel on a screen.
    pub tolerance: Option<f64>,
    /// Weight of the row that keeps the uniform Laplacian of a vertex, against 1 for that of a face; a number of 0 or more. Default: 0.01.
    /// With 0 these rows are only at borders, as nothing else determines those, and the rest is the system of Luo et al., which
    /// may be singular or nearly so.
    pub primal_weight: f64,
}

impl Default for DualLaplacianOptions {
    fn default() -> Self {
        Self {
            heights: DualHeights::default(),
            solver: LinearSolver::default(),
            iterations: 50,
            tolerance: Some(1e-4),
            primal_weight: 0.01,
        }
    }
}

impl DualLaplacianOptions {
    /// As Luo et al.: bi-conjugate gradients, and no rows for vertices but at borders.
    pub fn faithful() -> Self {
        Self { solver: LinearSolver::Pbcg, primal_weight: 0.0, ..Self::default() }
    }

    pub(super) fn check(&self) -> Result<(), DeformError> {
        if self.iterations > MAX_ITERATIONS {
            let (expected, found) = ("at most 1000000", self.iterations.to_string());
            return Err(DeformError::BadOption { option: "iterations", expected, found });
        }
        let numbers = [("tolerance", self.tolerance.unwrap_or(0.0)), ("primal weight", self.primal_weight)];
        match numbers.into_iter().find(|(_, x)| !(*x >= 0.0 && x.is_finite())) {
            Some((option, x)) => {
                Err(DeformError::BadOption { option, expected: "a number of 0 or more", found: x.to_string() })
            }
            None => Ok(()),
        }
    }
}

/// The tokens that differ from the default, joined by `+`: `recomputed-heights+pbcg`.
impl fmt::Display for DualLaplacianOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { heights, solver, iterations, tolerance, primal_weight } = self;
        let default = Self::default();
        text::join(
            f,
            [
                text::word(*heights == DualHeights::Recomputed, "recomputed-heights"),
                match solver {
                    LinearSolver::Cholesky => None,
                    LinearSolver::Pcg => Some("pcg".to_owned()),
                    LinearSolver::Pbcg => Some("pbcg".to_owned()),
                },
                (*iterations != default.iterations).then(|| format!("iterations={iterations}")),
                match tolerance {
                    None => Some("no-tolerance".to_owned()),
                    Some(x) => (*tolerance != default.tolerance).then(|| format!("tolerance={x:e}")),
                },
                (*primal_weight != default.primal_weight).then(|| format!("primal-weight={primal_weight:e}")),
            ],
        )
    }
}

/// Reads what `Display` writes; the defaults may be named too. Numbers are checked when the method is prepared.
impl FromStr for DualLaplacianOptions {
    type Err = DeformError;

    fn from_str(text: &str) -> Result<Self, DeformError> {
        let mut options = Self::default();
        for token in text::tokens(text) {
            match token {
                "kept-heights" => options.heights = DualHeights::Kept,
                "recomputed-heights" => options.heights = DualHeights::Recomputed,
                "cholesky" => options.solver = LinearSolver::Cholesky,
                "pcg" => options.solver = LinearSolver::Pcg,
                "pbcg" => options.solver = LinearSolver::Pbcg,
                "no-tolerance" => options.tolerance = None,
                _ => {
                    if let Some(iterations) = text::number(token, "iterations") {
                        options.iterations = iterations;
                    } else if let Some(tolerance) = text::number(token, "tolerance") {
                        options.tolerance = Some(tolerance);
                    } else if let Some(weight) = text::number(token, "primal-weight") {
                        options.primal_weight = weight;
                    } else {
                        return Err(text::unknown(token, TOKENS));
                    }
                }
            }
        }
        Ok(options)
    }
}

/// What the text form may have.
const TOKENS: &str =
    "kept-heights, recomputed-heights, cholesky, pcg, pbcg, iterations=N, no-tolerance, tolerance=X or primal-weight=X";
