//! The first system: `E_L + E_R` under constraints (Eq. 7).

use std::sync::Arc;

use glam::{DMat3, DVec3};
use pliant_linalg::{Cholesky, LinalgError, SpdPattern};
use pliant_mesh::outer;

use super::ImplicitConstraints;
use super::matrix::Matrix;
use super::plan::{Hold, Lists, Plan, coherence};
use super::rows::LaplacianRows;
use super::stencils::{NONE, Stencils};
use crate::patch::{Held, Patch};

/// Weight of a pair of gradients in `E_R`: its sum (Eq. 6) meets each pair from both ends.
pub(super) const PAIR: f64 = 2.0;

/// Weight of the rows that hold a gradient, in sums of the weights of the pairs that a gradient is in.
///
/// The text has gradient constraints hard, but a gradient is nine equations between the neighbours of a vertex, and those of neighbouring
/// vertices share unknowns: round a rim they contradict each other as soon as what holds the surface has not moved by a
/// similarity, so elimination or Lagrange multipliers would have no solution to find. Heavy rows are met where they can be and balanced
/// where not. What a weight alone leaves is taken away by the multipliers of [`Energy::minimise`].
const HEAVY: f64 = 1e5;

/// Share of the weight that gradients of handles have where positions alone are to count: little enough not to be seen, and enough to
/// decide what positions leave open (the gradient across a plane, the turn about a single point).
const FAINT: f64 = 1e-4;

/// Solutions with the factor: one by the method of multipliers and refinement after another, each on the residual of the last.
const STEPS: usize = 2;

/// Largest error of a solution that is known, in diagonals of the rest shape.
const MOST_WRONG: f64 = 1e-6;

/// The energy of the displaced surface as a quadratic function of its points, with the factor of its matrix.
pub(super) struct Energy {
    pub(super) stencils: Stencils,
    /// Which unknown each point is, or [`NONE`].
    unknown: Vec<u32>,
    /// Of each gradient, those with a larger number that it is compared with.
    pairs: Lists,
    /// Of each gradient, the vertices with a given one that it is compared with.
    pulls: Lists,
    /// Weight of each of those.
    pull: f64,
    rows: Vec<Row>,
    /// Gradients that rows hold to that of their vertex.
    ties: Vec<Tie>,
    /// Points drawn to the place of their vertex, with a weight.
    springs: Vec<(u32, f64)>,
    factor: Cholesky,
    scratch: Scratch,
}

/// A row of `E_L`: `r (D(v~) - M D(v))`, of displaced points.
pub(super) struct Row {
    pub(super) vertex: u32,
    /// Number of its gradient, or [`NONE`] where it is given.
    pub(super) gradient: u32,
    /// `r D(v)`.
    pub(super) rest: DVec3,
}

struct Tie {
    gradient: u32,
    vertex: u32,
    weight: f64,
    /// Whether its multiplier is sought: not for those of soft handles.
    is_hard: bool,
}

#[derive(Default)]
struct Scratch {
    /// By point.
    points: Vec<DVec3>,
    /// Half the derivative of the energy, by point.
    slope: Vec<DVec3>,
    /// By gradient.
    gradients: Vec<DMat3>,
    /// Half the derivative by gradient.
    forces: Vec<DMat3>,
    /// Weighted sums of the given gradients that each is compared with.
    pulls: Vec<DMat3>,
    /// By tie: the gradient it is to have.
    asked: Vec<DMat3>,
    /// The same, shifted by a multiplier.
    targets: Vec<DMat3>,
    /// By unknown.
    step: Vec<[f64; 3]>,
}

impl Energy {
    /// Assembles and factors.
    ///
    /// # Errors
    /// [`LinalgError::NotPositiveDefinite`] with the number of a vertex of the patch, [`LinalgError::TooLarge`].
    pub(super) fn new(patch: &Patch, plan: &Plan, laplacian: &LaplacianRows) -> Result<Self, LinalgError> {
        let stencils = Stencils::new(&patch.mesh, &plan.need);
        let (pairs, pulls) = coherence(patch, plan, &stencils)?;
        let pull = PAIR * if plan.constraints == ImplicitConstraints::Positions { FAINT } else { 1.0 };
        let total = 2.0 * PAIR * pairs.items.len() as f64 + PAIR * pulls.items.len() as f64;
        let typical = (total / stencils.len().max(1) as f64).max(PAIR);
        let mut count = 0;
        let mut unknown = vec![NONE; stencils.points.len()];
        for (unknown, &base) in unknown.iter_mut().zip(&stencils.base) {
            if plan.is_unknown[base as usize] {
                *unknown = count;
                count += 1;
            }
        }
        let rows = rows(plan, &stencils, laplacian);
        let ties = ties(patch, plan, &stencils, typical);
        let own = own_weights(&stencils, &pairs, &pulls, pull, &ties);
        let mut matrix = Matrix::new(&stencils, laplacian, &unknown, &pairs, &rows, own);
        matrix.assemble(count as usize)?;
        let springs = if plan.draws_positions() { matrix.add_springs(patch) } else { Vec::new() };
        let (columns, row_idx, values) = matrix.into_parts();
        let factor = SpdPattern::of_columns(columns, row_idx)
            .and_then(|pattern| Cholesky::new(Arc::new(pattern), values))
            .map_err(|error| named(error, &unknown, &stencils))?;
        let scratch = Scratch {
            points: stencils.points.clone(),
            slope: vec![DVec3::ZERO; stencils.points.len()],
            gradients: vec![DMat3::ZERO; stencils.len()],
            forces: vec![DMat3::ZERO; stencils.len()],
            pulls: vec![DMat3::ZERO; stencils.len()],
            asked: vec![DMat3::ZERO; ties.len()],
            targets: vec![DMat3::ZERO; ties.len()],
            step: vec![[0.0; 3]; count as usize],
        };
        let mut energy = Self { stencils, unknown, pairs, pulls, pull, rows, ties, springs, factor, scratch };
        energy.check(patch, laplacian)?;
        Ok(energy)
    }

    /// Refuses equations so near to singular that the factor has no digits to give, which its pivots need not tell: their answer is known
    /// where everything held is scaled by 2, since an affine map of the surface has no energy.
    fn check(&mut self, patch: &Patch, laplacian: &LaplacianRows) -> Result<(), LinalgError> {
        let places: Vec<DVec3> = patch.mesh.positions.iter().map(|p| 2.0 * *p).collect();
        let gradients = vec![DMat3::IDENTITY * 2.0; places.len()];
        let hold = Hold { places, gradients };
        let mut solution = hold.places.clone();
        self.minimise(laplacian, &hold, &mut solution)?;
        // Written so that NaN is wrong.
        let is_right = |v: &usize| solution[*v].distance(hold.places[*v]) < MOST_WRONG;
        match (0..solution.len()).find(|v| !is_right(v)) {
            Some(unknown) => Err(LinalgError::NotPositiveDefinite { unknown }),
            None => Ok(()),
        }
    }

    /// Numbers stored for solving.
    pub(super) fn solve_len(&self) -> usize {
        self.factor.solve_len()
    }

    /// Gradients of the last minimum, by number.
    pub(super) fn gradients(&self) -> &[DMat3] {
        &self.scratch.gradients
    }

    /// Minimises, and writes where the vertices are, pulled back from where they were displaced to (section 3.3):
    /// `v~ = M (v - v') + v~'`; those that are given are left.
    ///
    /// Each step goes to the minimum from where the last one led, so the second mends the rounding of the first: normal equations
    /// square the condition number, differences of gradients do not. Between steps the multipliers of the heavy rows are set
    /// (augmented Lagrangian): what a weight alone leaves of a gradient constraint shrinks by about [`HEAVY`] each time, where it can
    /// be met at all.
    pub(super) fn minimise(
        &mut self,
        laplacian: &LaplacianRows,
        hold: &Hold,
        solution: &mut [DVec3],
    ) -> Result<(), LinalgError> {
        self.start(hold);
        for step in 0..STEPS {
            self.evaluate();
            if step > 0 {
                self.set_multipliers();
            }
            self.differentiate(laplacian, hold);
            let Self { stencils, unknown, factor, scratch, .. } = self;
            for (&unknown, slope) in unknown.iter().zip(&scratch.slope) {
                if unknown != NONE {
                    scratch.step[unknown as usize] = slope.to_array();
                }
            }
            factor.solve_in_place(&mut scratch.step).map_err(|error| named(error, unknown, stencils))?;
            for (&unknown, point) in unknown.iter().zip(&mut scratch.points) {
                if unknown != NONE {
                    *point -= DVec3::from_array(scratch.step[unknown as usize]);
                }
            }
        }
        self.evaluate();
        let Self { stencils, unknown, scratch, .. } = self;
        for (v, solution) in solution.iter_mut().enumerate() {
            if unknown[v] != NONE {
                let offset = stencils.offset[v];
                *solution = scratch.points[v];
                if offset != DVec3::ZERO {
                    *solution -= scratch.gradients[stencils.gradient[v] as usize] * offset;
                }
            }
        }
        Ok(())
    }

    /// Sets the points that are given, the others to rest, and what gradients are drawn to.
    fn start(&mut self, hold: &Hold) {
        let Self { stencils, unknown, pulls, pull, ties, scratch, .. } = self;
        for (k, point) in scratch.points.iter_mut().enumerate() {
            let base = stencils.base[k] as usize;
            *point = stencils.points[k];
            if unknown[k] == NONE {
                // A vertex that is held is displaced as its gradient says.
                *point = hold.places[base] + turned(&hold.gradients[base], stencils.offset[k]);
            }
        }
        for (g, sum) in scratch.pulls.iter_mut().enumerate() {
            *sum = pulls.get(g).iter().fold(DMat3::ZERO, |sum, &v| sum + hold.gradients[v as usize]) * *pull;
        }
        for (tie, asked) in ties.iter().zip(&mut scratch.asked) {
            let v = tie.vertex as usize;
            let linear = hold.gradients[v];
            *asked = linear;
            if unknown[v] == NONE {
                // Neighbours that are given stay where they are: asked for is the gradient of a ring whose unknown points are where this
                // vertex would take them. That is its own gradient where those given were taken along, and one that can be reached
                // where not.
                let at = scratch.points[v];
                *asked = stencils.terms(tie.gradient as usize).fold(DMat3::ZERO, |sum, (k, p)| {
                    let rest = stencils.points[k] - stencils.points[v];
                    sum + outer(if unknown[k] == NONE { scratch.points[k] - at } else { linear * rest }, p)
                });
            }
        }
        scratch.targets.copy_from_slice(&scratch.asked);
    }

    /// Gradients of the points.
    fn evaluate(&mut self) {
        let Scratch { points, gradients, .. } = &mut self.scratch;
        for (g, gradient) in gradients.iter_mut().enumerate() {
            *gradient = self.stencils.evaluate(g, points);
        }
    }

    /// Shifts what hard ties aim at by what they missed.
    fn set_multipliers(&mut self) {
        let Scratch { gradients, asked, targets, .. } = &mut self.scratch;
        for ((tie, asked), target) in self.ties.iter().zip(asked).zip(targets).filter(|((tie, _), _)| tie.is_hard) {
            *target += *asked - gradients[tie.gradient as usize];
        }
    }

    /// Half the derivative of the energy, at the points whose gradients were evaluated.
    fn differentiate(&mut self, laplacian: &LaplacianRows, hold: &Hold) {
        let Self { stencils, pairs, pulls, pull, rows, ties, springs, scratch, .. } = self;
        let Scratch { points, slope, gradients, forces, pulls: sums, targets, .. } = scratch;
        for (g, force) in forces.iter_mut().enumerate() {
            *force = gradients[g] * (*pull * pulls.get(g).len() as f64) - sums[g];
        }
        // Eq. 6.
        for g in 0..forces.len() {
            let mut own = DMat3::ZERO;
            for &other in pairs.get(g) {
                let force = (gradients[g] - gradients[other as usize]) * PAIR;
                own += force;
                forces[other as usize] -= force;
            }
            forces[g] += own;
        }
        for (tie, target) in ties.iter().zip(targets) {
            let g = tie.gradient as usize;
            forces[g] += (gradients[g] - *target) * tie.weight;
        }
        slope.fill(DVec3::ZERO);
        // Eq. 5.
        for row in rows {
            let v = row.vertex as usize;
            let gradient = if row.gradient == NONE { &hold.gradients[v] } else { &gradients[row.gradient as usize] };
            let missed = laplacian.apply(v, points) - *gradient * row.rest;
            for (k, value) in laplacian.row(v) {
                slope[k as usize] += value * missed;
            }
            if row.gradient != NONE {
                forces[row.gradient as usize] -= outer(missed, row.rest);
            }
        }
        for &(k, weight) in &*springs {
            let base = stencils.base[k as usize] as usize;
            let goal = hold.places[base] + turned(&hold.gradients[base], stencils.offset[k as usize]);
            slope[k as usize] += weight * (points[k as usize] - goal);
        }
        for (g, force) in forces.iter().enumerate() {
            for (k, p) in stencils.terms(g) {
                slope[k] += *force * p;
            }
        }
    }
}

/// The vertex of the patch behind an unknown that an error names.
fn named(error: LinalgError, unknown: &[u32], stencils: &Stencils) -> LinalgError {
    let vertex =
        |at: usize| unknown.iter().position(|u| *u as usize == at).map_or(at, |point| stencils.base[point] as usize);
    match error {
        LinalgError::NotPositiveDefinite { unknown } => LinalgError::NotPositiveDefinite { unknown: vertex(unknown) },
        LinalgError::SolutionNotFinite { unknown } => LinalgError::SolutionNotFinite { unknown: vertex(unknown) },
        error => error,
    }
}

/// An offset taken along; exactly nothing where there is none.
fn turned(gradient: &DMat3, offset: DVec3) -> DVec3 {
    if offset == DVec3::ZERO { offset } else { *gradient * offset }
}

/// Rows of unknown vertices and of their neighbours, which have no gradient to go by only if positions alone hold them and their ring is flat.
fn rows(plan: &Plan, stencils: &Stencils, laplacian: &LaplacianRows) -> Vec<Row> {
    (0..plan.need.len())
        .filter(|&v| plan.has_row[v] && (plan.is_given[v] || stencils.gradient[v] != NONE))
        .map(|v| Row {
            vertex: v as u32,
            gradient: if plan.is_given[v] { NONE } else { stencils.gradient[v] },
            rest: laplacian.apply(v, &stencils.points),
        })
        .collect()
}

/// Gradients that are held: given ones whose ring has an unknown in it (elsewhere nothing is left to constrain), and those of soft handles.
fn ties(patch: &Patch, plan: &Plan, stencils: &Stencils, typical: f64) -> Vec<Tie> {
    let mut ties = Vec::new();
    for v in 0..plan.need.len() {
        let gradient = stencils.gradient[v];
        let weight = match patch.held[v] {
            Held::Spring { weight, .. } if plan.constraints == ImplicitConstraints::Positions => {
                weight.min(HEAVY) * FAINT
            }
            Held::Spring { weight, .. } => weight.min(HEAVY),
            Held::Led { .. } | Held::Fixed if plan.is_given[v] => HEAVY,
            _ => continue,
        };
        if gradient != NONE {
            let is_hard = plan.is_given[v];
            ties.push(Tie { gradient, vertex: v as u32, weight: weight * typical, is_hard });
        }
    }
    ties
}

/// Sum of the weights of the terms each gradient is in.
fn own_weights(stencils: &Stencils, pairs: &Lists, pulls: &Lists, pull: f64, ties: &[Tie]) -> Vec<f64> {
    let mut own = vec![0.0; stencils.len()];
    for g in 0..own.len() {
        own[g] += PAIR * pairs.get(g).len() as f64 + pull * pulls.get(g).len() as f64;
        for &other in pairs.get(g) {
            own[other as usize] += PAIR;
        }
    }
    for tie in ties {
        own[tie.gradient as usize] += tie.weight;
    }
    own
}
