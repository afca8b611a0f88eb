//! Preparing an edit and solving it.

use glam::DVec3;
use pliant_linalg::LinalgError;
use pliant_mesh::TriMesh;
use pliant_mesh::threads::among_threads;

use super::ArapOptions;
use super::edit::Edit;
use super::shape::Shape;
use crate::frame::check_count;
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport, StepTimes};

/// Energy, per unit of weight and with a diagonal of 1, that is nothing but rounding.
const ROUNDING_ENERGY: f64 = 1e-29;

/// A prepared as-rigid-as-possible edit.
///
/// Computes in the rest shape's frame, centred and scaled by a power of two to a diagonal between 1/2 and 1, so
/// results follow any scale and offset of the scene. They are the same, bit for bit, for any number of threads.
///
/// What is prepared has three lifetimes: that of the rest shape (weights), of the region of interest (cells, order and symbolic
/// factor) and of the roles in it (who is solved for, the numbers of the factor).
pub struct Arap {
    options: ArapOptions,
    shape: Shape,
    edit: Edit,
}

impl Arap {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &ArapOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        check_count("vertices of the region", rest.vertex_count(), region.vertex_count())?;
        let shape = Shape::new(options, rest)?;
        let edit = Edit::new(options, &shape, region)?;
        Ok(Self { options: options.clone(), shape, edit })
    }

    /// The energy of a pose, with the best rotation of each cell, in world units (of weight times squared length).
    ///
    /// It is the sum, over the cells of free vertices and their neighbours, of `w |e' - R e|^2` (Borosan et al. 2010,
    /// Eq. 1), and over the vertices and points of soft handles of `m k |p' - goal|^2`, with `k` the handle's weight times the
    /// mean diagonal entry of the matrix and `m` the number of cells that count an edge (2 for spokes, 3 for spokes
    /// and rims). Hard handles are taken where the pose has them. With smooth rotations, `alpha A w |R - R'|^2` is added for each of those
    /// cells and each neighbour that is one, and the rotations are as good as local steps alone make them.
    ///
    /// # Errors
    /// As [`Deformer::solve`].
    pub fn energy(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<f64, DeformError> {
        self.edit.prepare_energy(&self.shape);
        self.edit.read(&self.shape, goals, positions)?;
        Ok(self.edit.settled_energy(self.shape.multiplicity()) * self.shape.frame.energy_unit())
    }

    /// Guess and iterations. The local step of iteration `k + 1` also tells the energy after iteration `k`.
    fn iterate(&mut self) -> Result<SolveReport, LinalgError> {
        let Self { options, shape, edit } = self;
        let mut report = SolveReport::default();
        edit.times = StepTimes::default();
        edit.guess()?;
        let rounding = ROUNDING_ENERGY * edit.terms.iter().flatten().map(|t| t.weight.abs()).sum::<f64>();
        let unit = shape.frame.energy_unit();
        let mut last = f64::INFINITY;
        loop {
            let at_end = report.iterations == options.iterations;
            if at_end && options.tolerance.is_none() {
                return Ok(report);
            }
            edit.fit_rotations();
            if options.tolerance.is_some() || edit.anderson.is_some() {
                let now = edit.safe_energy(last, shape.multiplicity());
                if let Some(tolerance) = options.tolerance {
                    report.energy_before.get_or_insert(now * unit);
                    report.energy_after = Some(now * unit);
                    report.converged = last - now <= tolerance * last && last.is_finite() || now <= rounding;
                    if report.converged || at_end {
                        return Ok(report);
                    }
                }
                last = now;
            }
            edit.global_step()?;
            report.iterations += 1;
            // The last step is not accelerated, as nobody would look at its energy.
            if report.iterations < options.iterations {
                edit.accelerate();
            }
        }
    }
}

impl Deformer for Arap {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        self.edit.read(&self.shape, goals, positions)?;
        let report = among_threads(self.edit.cells.roi, || self.iterate());
        let mut report = report.map_err(|error| DeformError::of_system(error, &self.edit.cells.vertices))?;
        report.unmet = self.edit.unmet().map(|unmet| unmet * self.shape.frame.length_unit());
        self.edit.write(&self.shape.frame, positions)?;
        Ok(report)
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        check_count("vertices of the region", self.edit.region.vertex_count(), region.vertex_count())?;
        if self.edit.has_same_pattern(region) {
            self.edit.set_roles(&self.options, &self.shape, region)?;
        } else {
            self.edit = Edit::new(&self.options, &self.shape, region)?;
        }
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        PrepareReport {
            unknowns: self.edit.roles.unknowns.as_slice().len(),
            clamped_weights: self.shape.clamped,
            factor_len: self.edit.factor.solve_len(),
        }
    }

    fn step_times(&self) -> StepTimes {
        self.edit.times
    }
}

#[cfg(test)]
mod tests;
