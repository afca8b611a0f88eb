//! Anderson acceleration of the two steps.
//!
//! - Anderson. *Iterative Procedures for Nonlinear Integral Equations.* J. ACM 12, 1965.
//! - Peng, Deng, Zhang, Geng, Qin, Liu. *Anderson Acceleration for Geometry Optimization and Physics Simulation.* SIGGRAPH
//!   2018: as a fixed point of local and global step together, safeguarded by the energy (Alg. 1).

use super::steps::Row;

/// Share of a squared length below which what is left of a difference after the ones before it counts as rounding.
const DEPENDENT: f64 = 1e-12;

/// The last steps `f = G(x) - x` of the map `G`, a local and a global step, and where they led, as differences from one to the next.
pub(crate) struct Anderson {
    window: usize,
    /// Of steps, of where they led: by place in the window, then by unknown.
    steps: Vec<Vec<Row>>,
    ends: Vec<Vec<Row>>,
    /// Inner products of the differences of steps.
    gram: Vec<Vec<f64>>,
    /// The last step and its end, which is also where to go if what comes after it is worse.
    step: Vec<Row>,
    end: Vec<Row>,
    /// Differences known, and the place for the next one.
    known: usize,
    next: usize,
    has_step: bool,
    /// Scratch: a triangular factor of the Gram matrix, and the coefficients.
    triangle: Vec<Vec<f64>>,
    mix: Vec<f64>,
}

impl Anderson {
    pub(crate) fn new(window: usize, unknowns: usize) -> Self {
        let columns = || vec![vec![Row::default(); unknowns]; window];
        let square = || vec![vec![0.0; window]; window];
        Self {
            window,
            steps: columns(),
            ends: columns(),
            gram: square(),
            step: vec![Row::default(); unknowns],
            end: vec![Row::default(); unknowns],
            known: 0,
            next: 0,
            has_step: false,
            triangle: square(),
            mix: vec![0.0; window],
        }
    }

    /// Forgets all steps: what comes is another map, or far from where they were.
    pub(crate) fn forget(&mut self) {
        (self.known, self.next, self.has_step) = (0, 0, false);
    }

    /// Whether the last step was mixed.
    pub(crate) fn has_mixed(&self) -> bool {
        self.known > 0
    }

    /// Where the last plain step ended.
    pub(crate) fn end(&self) -> &[Row] {
        &self.end
    }

    /// Notes a step and where it led, by unknown.
    pub(crate) fn note(&mut self, moves: impl Iterator<Item = (Row, Row)>) {
        if !self.has_step {
            for ((step, end), (new_step, new_end)) in self.step.iter_mut().zip(&mut self.end).zip(moves) {
                (*step, *end) = (new_step, new_end);
            }
            self.has_step = true;
            return;
        }
        let at = self.next;
        let last = self.step.iter_mut().zip(&mut self.end);
        let differences = self.steps[at].iter_mut().zip(&mut self.ends[at]);
        for (((step, end), (step_difference, end_difference)), (new_step, new_end)) in last.zip(differences).zip(moves)
        {
            *step_difference = std::array::from_fn(|l| new_step[l] - step[l]);
            *end_difference = std::array::from_fn(|l| new_end[l] - end[l]);
            (*step, *end) = (new_step, new_end);
        }
        self.known = (self.known + 1).min(self.window);
        self.next = (at + 1) % self.window;
        for other in 0..self.known {
            let product = dot(&self.steps[at], &self.steps[other]);
            self.gram[at][other] = product;
            self.gram[other][at] = product;
        }
    }

    /// Finds the mix of known differences that, taken off the last step, leaves the least of it; whether there is any.
    ///
    /// Normal equations, as the unknowns are few: differences that depend on those before them but for rounding are left out.
    pub(crate) fn mix(&mut self) -> bool {
        let known = self.known;
        // Latest first, so that what is left out is oldest.
        let window = self.window;
        let next = self.next;
        let place = |age: usize| (next + window - 1 - age) % window;
        for i in 0..known {
            let mut value = dot(&self.steps[place(i)], &self.step);
            let mut pivot = self.gram[place(i)][place(i)];
            let length = pivot;
            for j in 0..i {
                let mut entry = self.gram[place(i)][place(j)];
                for k in 0..j {
                    entry -= self.triangle[i][k] * self.triangle[j][k];
                }
                // A row that is left out has an infinite diagonal.
                entry /= self.triangle[j][j];
                self.triangle[i][j] = entry;
                pivot -= entry * entry;
                value -= entry * self.mix[j];
            }
            let kept = pivot > DEPENDENT * length;
            self.triangle[i][i] = if kept { pivot.sqrt() } else { f64::INFINITY };
            self.mix[i] = value / self.triangle[i][i];
        }
        for i in (0..known).rev() {
            let later: f64 = (i + 1..known).map(|j| self.triangle[j][i] * self.mix[j]).sum();
            self.mix[i] = (self.mix[i] - later) / self.triangle[i][i];
        }
        known > 0 && self.mix[..known].iter().all(|m| m.is_finite())
    }

    /// Where the mixed step leads, by unknown: `G(x)` less the mix of differences of ends.
    pub(crate) fn mixed(&self, unknown: usize) -> Row {
        let mut position = self.end[unknown];
        for (age, &mix) in self.mix[..self.known].iter().enumerate() {
            let difference = self.ends[(self.next + self.window - 1 - age) % self.window][unknown];
            for (position, difference) in position.iter_mut().zip(difference) {
                *position -= mix * difference;
            }
        }
        position
    }
}

/// In a fixed order, four sums at a time.
fn dot(a: &[Row], b: &[Row]) -> f64 {
    let mut sums = Row::default();
    for (a, b) in a.iter().zip(b) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}
