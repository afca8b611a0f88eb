//! The way down the tree: what is far is summed, what is not is listed.

#![allow(clippy::needless_range_loop, reason = "lanes of several packs of numbers go side by side")]

use glam::DVec3;
use pulp::Simd;

use super::FarField;
use super::pack::{Dipoles, Eight, Look, Pack, WIDTH};

/// What a descent finds, and memory kept from one to the next.
#[derive(Debug, Default)]
pub(super) struct Descent {
    /// Vertices too near for Taylor terms.
    pub(super) near: Vec<u32>,
    /// Far vertices whose weights are not small.
    pub(super) listed: Vec<(u32, f64)>,
    open: Vec<u32>,
    opened: Vec<u32>,
}

/// Vertices that are neither near nor listed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rest {
    /// Sum of their weights' magnitudes.
    pub(super) magnitude: f64,
    /// How far that, with the magnitudes of what is listed, may be from the truth.
    pub(super) error: f64,
}

/// What a descent may overlook. All are weights before scaling.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Largest weight that needs no listing.
    pub(super) weight: f32,
    /// Largest error of a listed weight.
    pub(super) kept: f32,
    /// Largest errors of a group, of a small vertex, and of a dipole.
    group: f32,
    vertex: f32,
    dipole: f32,
}

/// The error of a sum of magnitudes is taken for this share of the sum of all errors, where they have the same sign, and this share
/// of their root sum of squares, where they have either. Groups are off one way only, by vertices of the other sign,
/// but by a small part of their bounds. The tests hold this against sums over all faces; the worst comes to 0.8 of it.
const GROUP_BIAS: f64 = 0.2;
const VERTEX_BIAS: f64 = 0.3;
const SPREAD: f64 = 0.7;

/// Rounding of sums in single precision, relative to the sum.
const SUM_ROUNDING: f64 = 4e-6;

impl Limits {
    /// For a row of about this magnitude; `None` if squares of its errors are no numbers of single precision.
    ///
    /// Measured on bodies with cages of 5 %: smaller ones make more vertices near, larger ones more cuts unsure.
    pub(super) fn of(size: f64, share: f64) -> Option<Self> {
        if !(1e-10..1e15).contains(&size) {
            return None;
        }
        // A smaller budget takes smaller errors.
        let size = size * (share / 0.03).min(1.0);
        let times = |limit: f64| (limit * size) as f32;
        Some(Self {
            weight: times(5e-4),
            kept: times(1e-5),
            group: times(1e-5),
            vertex: times(2e-5),
            dipole: times(6e-6),
        })
    }

    /// With all errors smaller by a factor.
    pub(super) fn finer(self, factor: f64) -> Self {
        let times = |limit: f32| (factor * f64::from(limit)) as f32;
        Self {
            kept: times(self.kept),
            group: times(self.group),
            vertex: times(self.vertex),
            dipole: times(self.dipole),
            ..self
        }
    }

    /// With vertices listed from a smaller weight on.
    pub(super) fn below(self, weight: f64) -> Self {
        Self { weight: weight as f32, ..self }
    }
}

impl Descent {
    #[inline(always)]
    pub(super) fn sum<S: Simd>(&mut self, simd: S, field: &FarField, x: DVec3, limits: Limits) -> Rest {
        let x = x.as_vec3().to_array();
        let (mut groups, mut vertices) = (Sums::default(), Sums::default());
        self.open.clear();
        self.open.push(0);
        for level in field.levels.iter().skip(1).rev() {
            self.open_groups(simd, x, level, limits, &mut groups);
            std::mem::swap(&mut self.open, &mut self.opened);
        }
        self.open_dipoles(simd, x, &field.dipoles, limits, &mut groups);
        self.open_vertices(simd, x, field, limits, &mut vertices);
        let magnitude = total(&groups.weight) + total(&vertices.weight);
        let error = groups.spread(GROUP_BIAS) + vertices.spread(VERTEX_BIAS);
        Rest { magnitude, error: error + SUM_ROUNDING * magnitude }
    }

    /// Adds the groups of the open packs that are far; opens the others, which are packs of the level below.
    #[inline(always)]
    fn open_groups<S: Simd>(&mut self, simd: S, x: [f32; 3], level: &[Pack], limits: Limits, sums: &mut Sums) {
        self.opened.clear();
        self.opened.resize(self.open.len() * WIDTH, 0);
        let mut count = 0;
        let mut look = Look::default();
        for &at in &self.open {
            level[at as usize].look_at_groups(simd, x, &mut look);
            let mut far = [false; WIDTH];
            for k in 0..WIDTH {
                far[k] = (look.error[k] <= limits.group) & (look.largest[k] <= limits.weight);
            }
            sums.add(&look, &far);
            for k in 0..WIDTH {
                // Without a branch, here and below: which way it goes cannot be foreseen.
                self.opened[count] = at * WIDTH as u32 + k as u32;
                count += usize::from(!far[k]);
            }
        }
        self.opened.truncate(count);
    }

    /// Adds the packs whose vertices all are small and far enough to be dipoles; opens the others.
    #[inline(always)]
    fn open_dipoles<S: Simd>(&mut self, simd: S, x: [f32; 3], dipoles: &[Dipoles], limits: Limits, sums: &mut Sums) {
        self.opened.clear();
        self.opened.resize(self.open.len(), 0);
        let mut count = 0;
        let mut look = Look::default();
        for &at in &self.open {
            dipoles[at as usize].look(simd, x, &mut look);
            let mut far = true;
            for k in 0..WIDTH {
                let small = look.weight[k].abs() + look.error[k] < limits.weight;
                far &= (look.error[k] <= limits.dipole) & small;
            }
            sums.add(&look, &[far; WIDTH]);
            self.opened[count] = at;
            count += usize::from(!far);
        }
        self.opened.truncate(count);
    }

    /// Adds the vertices of the opened packs that are far and small, lists the other far ones and the near ones. The
    /// errors of listed weights count too.
    #[inline(always)]
    fn open_vertices<S: Simd>(&mut self, simd: S, x: [f32; 3], field: &FarField, limits: Limits, sums: &mut Sums) {
        let Self { near, listed, opened, .. } = self;
        near.clear();
        near.resize(opened.len() * WIDTH, 0);
        listed.clear();
        listed.resize(opened.len() * WIDTH, (0, 0.0));
        let (mut near_count, mut listed_count) = (0, 0);
        let mut look = Look::default();
        for &at in opened.iter() {
            field.levels[0][at as usize].look_at_vertices(simd, x, &mut look);
            let (mut small, mut large) = ([false; WIDTH], [false; WIDTH]);
            for k in 0..WIDTH {
                let below = look.weight[k].abs() + look.error[k] < limits.weight;
                small[k] = (look.error[k] <= limits.vertex) & below;
                large[k] = (look.error[k] <= limits.kept) & !small[k];
            }
            sums.add(&look, &small);
            sums.add_errors(&look, &large);
            let vertices = &field.order[at as usize * WIDTH..][..WIDTH];
            for k in 0..WIDTH {
                near[near_count] = vertices[k];
                near_count += usize::from(!(small[k] | large[k]));
                listed[listed_count] = (vertices[k], f64::from(look.weight[k]));
                listed_count += usize::from(large[k]);
            }
        }
        near.truncate(near_count);
        listed.truncate(listed_count);
    }
}

/// Sums lane by lane.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    weight: Eight,
    error: Eight,
    /// Of squared errors.
    square: Eight,
}

impl Sums {
    /// Adds the marked lanes.
    #[inline(always)]
    fn add(&mut self, look: &Look, marked: &[bool; WIDTH]) {
        for k in 0..WIDTH {
            self.weight[k] += if marked[k] { look.weight[k].abs() } else { 0.0 };
        }
        self.add_errors(look, marked);
    }

    #[inline(always)]
    fn add_errors(&mut self, look: &Look, marked: &[bool; WIDTH]) {
        for k in 0..WIDTH {
            let error = if marked[k] { look.error[k] } else { 0.0 };
            self.error[k] += error;
            self.square[k] += error * error;
        }
    }

    /// Error of the sum of weights.
    fn spread(&self, bias: f64) -> f64 {
        bias * total(&self.error) + SPREAD * total(&self.square).sqrt()
    }
}

fn total(lanes: &Eight) -> f64 {
    lanes.iter().map(|&lane| f64::from(lane)).sum()
}
