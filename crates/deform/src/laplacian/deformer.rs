//! Preparing an edit and solving it.

use glam::{DMat3, DQuat, DVec3};
use pliant_linalg::{LeastSquares, LinalgError};
use pliant_mesh::{TriMesh, best_rotation, outer};

use super::coupled;
use super::harmonic::Harmonic;
use super::rows::Rows;
use super::{Details, LaplacianOptions};
use crate::fit::Fit;
use crate::frame::check_count;
use crate::goals::shortest_turn;
use crate::patch::{Held, Patch};
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport};

/// A prepared Laplacian edit.
///
/// Computes in the rest shape's centred unit frame, and solves for the displacement from the rest shape, moved as [`Details`] says: where nothing is to
/// be done there is nothing to solve for, and nothing is lost in rounding.
pub struct Laplacian {
    options: LaplacianOptions,
    rest: TriMesh,
    edit: Edit,
}

/// What depends on the region.
struct Edit {
    patch: Patch,
    rows: Rows,
    /// Laplacian coordinates at rest, one per row.
    coordinates: Vec<DVec3>,
    /// Of each vertex on its own, or with all coordinates coupled for [`Details::Similarity`].
    system: LeastSquares,
    /// For [`Details::Propagated`].
    harmonic: Option<Harmonic>,
    scratch: Scratch,
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame.
#[derive(Default)]
struct Scratch {
    /// Per vertex of the patch: where it is held or drawn to, and in the end the solution.
    pose: Vec<DVec3>,
    /// The pose as it was read.
    goals: Vec<DVec3>,
    /// Per row: the transformation of its coordinates.
    transforms: Vec<DMat3>,
    /// Right-hand sides and unknowns of the system.
    rhs: Vec<[f64; 3]>,
    unknowns: Vec<[f64; 3]>,
    /// Per vertex: rotation vectors, and logarithms of scales in the first column.
    turns: Vec<[f64; 3]>,
    scales: Vec<[f64; 3]>,
}

impl Laplacian {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &LaplacianOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        let edit = Edit::new(options, rest, region)?;
        Ok(Self { options: options.clone(), rest: rest.clone(), edit })
    }
}

impl Deformer for Laplacian {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        let edit = &mut self.edit;
        edit.patch.read(goals, positions, &mut edit.scratch.pose)?;
        let solved = match self.options.details {
            Details::Plain => edit.solve_plain(),
            Details::TwoStep => edit.solve_two_step(),
            Details::Similarity => edit.solve_coupled(),
            Details::Propagated => edit.solve_propagated(goals),
        };
        solved.map_err(|error| DeformError::of_system(error, &edit.patch.vertices))?;
        edit.patch.write(&edit.scratch.pose, goals, positions)?;
        Ok(SolveReport { converged: true, ..SolveReport::default() })
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        check_count("vertices of the region", self.rest.vertex_count(), region.vertex_count())?;
        self.edit = Edit::new(&self.options, &self.rest, region)?;
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        let Edit { patch, rows, system, harmonic, .. } = &self.edit;
        PrepareReport {
            unknowns: patch.unknown_count(),
            clamped_weights: rows.clamped,
            factor_len: system.solve_len() + harmonic.as_ref().map_or(0, Harmonic::solve_len),
        }
    }
}

impl Edit {
    fn new(options: &LaplacianOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        // The second ring is seen from the rows of the first.
        let patch = Patch::new(rest, region, 2)?;
        let rows = Rows::new(&patch, options.weights);
        let coordinates = rows.coordinates(&patch.mesh, &patch.mesh.positions);
        let system = match options.details {
            Details::Similarity => coupled::factored(&rows, &patch, &coordinates),
            Details::Plain | Details::TwoStep | Details::Propagated => {
                rows.matrix(&patch).and_then(|matrix| LeastSquares::new(matrix, |v| patch.held[v].is_unknown()))
            }
        };
        let harmonic = match options.details {
            Details::Propagated => Harmonic::new(&patch, options.weights).map(Some),
            Details::Plain | Details::TwoStep | Details::Similarity => Ok(None),
        };
        let named = |error| DeformError::of_system(error, &patch.vertices);
        let (system, harmonic) = (system.map_err(named)?, harmonic.map_err(named)?);
        let (vertices, columns) = (patch.held.len(), system.matrix().column_count());
        let scratch = Scratch {
            pose: Vec::with_capacity(vertices),
            goals: Vec::with_capacity(vertices),
            transforms: vec![DMat3::IDENTITY; rows.centres.len()],
            rhs: vec![[0.0; 3]; system.matrix().row_count()],
            unknowns: vec![[0.0; 3]; columns],
            turns: vec![[0.0; 3]; if harmonic.is_some() { vertices } else { 0 }],
            scales: vec![[0.0; 3]; if harmonic.is_some() { vertices } else { 0 }],
        };
        Ok(Self { patch, rows, coordinates, system, harmonic, scratch })
    }

    fn solve_plain(&mut self) -> Result<(), LinalgError> {
        self.scratch.transforms.fill(DMat3::IDENTITY);
        self.solve_rows(Fit::IDENTITY)
    }

    fn solve_two_step(&mut self) -> Result<(), LinalgError> {
        let reference = Fit::rigid(self.constraints());
        let Scratch { pose, goals, transforms, .. } = &mut self.scratch;
        goals.clone_from(pose);
        transforms.fill(reference.rotation);
        self.solve_rows(reference)?;
        self.estimate_rotations();
        // The first solution is where soft handles had their goals.
        self.scratch.pose.clone_from(&self.scratch.goals);
        self.solve_rows(reference)
    }

    fn solve_propagated(&mut self, goals: &Goals) -> Result<(), LinalgError> {
        self.carry(goals)?;
        let reference = Fit::rigid(self.constraints());
        self.solve_rows(reference)
    }

    /// What is held: where it is at rest, where it should be, and how far it counts. A soft handle counts as if it were in series with a
    /// surface of stiffness 1.
    fn constraints(&self) -> impl Iterator<Item = (DVec3, DVec3, f64)> + Clone {
        let Self { patch, scratch, .. } = self;
        let all = patch.held.iter().zip(&patch.mesh.positions).zip(&scratch.pose);
        all.filter_map(|((held, &rest), &goal)| match *held {
            Held::Unknown => None,
            Held::Spring { weight, .. } => Some((rest, goal, weight / (1.0 + weight))),
            Held::Led { .. } | Held::Fixed => Some((rest, goal, 1.0)),
        })
    }

    /// Solves for the displacement from the rest shape moved by `reference`, with the transformations there are.
    ///
    /// `A (v' - reference) = T delta - A reference`, where `A reference` is `reference.rotation * delta`, up to its scale, which is 1.
    fn solve_rows(&mut self, reference: Fit) -> Result<(), LinalgError> {
        let Self { patch, coordinates, system, scratch, .. } = self;
        let Scratch { pose, transforms, rhs, unknowns, .. } = scratch;
        let rest = &patch.mesh.positions;
        for ((rhs, transform), &delta) in rhs.iter_mut().zip(transforms).zip(&*coordinates) {
            *rhs = ((*transform - reference.rotation) * delta).to_array();
        }
        for ((unknown, pose), rest) in unknowns.iter_mut().zip(&*pose).zip(rest) {
            *unknown = (*pose - reference.apply(*rest)).to_array();
        }
        // The rows of soft handles are the last ones, by increasing vertex.
        let drawn = patch.held.iter().zip(&*unknowns).filter(|(held, _)| matches!(held, Held::Spring { .. }));
        for (row, (_, goal)) in (coordinates.len()..).zip(drawn) {
            let root = system.matrix().row(row).1[0];
            rhs[row] = goal.map(|x| root * x);
        }
        system.solve(rhs, unknowns)?;
        for (((pose, held), unknown), rest) in pose.iter_mut().zip(&patch.held).zip(&*unknowns).zip(rest) {
            if held.is_unknown() {
                *pose = reference.apply(*rest) + DVec3::from(*unknown);
            }
        }
        Ok(())
    }

    /// The rotation of each row: the one that best takes the edges at its centre from rest to the current pose.
    fn estimate_rotations(&mut self) {
        let Self { patch, rows, scratch, .. } = self;
        let (rest, pose) = (&patch.mesh.positions, &scratch.pose);
        for (row, (transform, &v)) in scratch.transforms.iter_mut().zip(&rows.centres).enumerate() {
            let v = v as usize;
            let ring = patch.mesh.topology().neighbours(v).iter().zip(rows.weights(row));
            let covariance = ring.fold(DMat3::ZERO, |sum, (&j, &w)| {
                sum + outer(pose[j as usize] - pose[v], w * (rest[j as usize] - rest[v]))
            });
            *transform = best_rotation(covariance);
        }
    }

    /// The transformation of each row: turns and scales of the handles, interpolated.
    fn carry(&mut self, goals: &Goals) -> Result<(), LinalgError> {
        let Self { patch, rows, harmonic, scratch, .. } = self;
        let Some(harmonic) = harmonic else { return Ok(()) };
        let Scratch { pose, transforms, turns, scales, .. } = scratch;
        let fixed = fixed_motion(patch, pose);
        let fixed_turn = shortest_turn(DQuat::from_mat3(&fixed.rotation));
        let mut is_scaled = false;
        for ((turn, scale), held) in turns.iter_mut().zip(&mut *scales).zip(&patch.held) {
            let (own, by) = match held.handle() {
                Some(handle) => (goals.turn(handle as usize), goals.transforms[handle as usize].scale),
                None => (fixed_turn, fixed.scale),
            };
            *turn = own.to_array();
            *scale = [by.ln(), 0.0, 0.0];
            is_scaled |= by != 1.0;
        }
        harmonic.interpolate(turns)?;
        if is_scaled {
            harmonic.interpolate(scales)?;
        } else {
            scales.fill([0.0; 3]);
        }
        for (transform, &v) in transforms.iter_mut().zip(&rows.centres) {
            let turn = DQuat::from_scaled_axis(DVec3::from(turns[v as usize]));
            *transform = DMat3::from_quat(turn) * scales[v as usize][0].exp();
        }
        Ok(())
    }

    /// Solves the coupled system, in the frame of the rest shape moved by the similarity that fits the constraints.
    fn solve_coupled(&mut self) -> Result<(), LinalgError> {
        let reference = Fit::similarity(self.constraints());
        let back = reference.rotation.transpose();
        let Self { patch, system, scratch, .. } = self;
        let Scratch { pose, rhs, unknowns, .. } = scratch;
        let rest = &patch.mesh.positions;
        for (v, (pose, rest)) in pose.iter().zip(rest).enumerate() {
            let off = back * (*pose - reference.apply(*rest));
            for (unknown, x) in unknowns[3 * v..3 * v + 3].iter_mut().zip(off.to_array()) {
                *unknown = [x, 0.0, 0.0];
            }
        }
        // The rows of soft handles are the first ones, by increasing vertex.
        let is_drawn = |v: &usize| matches!(patch.held[*v], Held::Spring { .. });
        let drawn = (0..patch.held.len()).filter(is_drawn).flat_map(|v| 3 * v..3 * v + 3);
        for (row, column) in drawn.enumerate() {
            rhs[row] = unknowns[column].map(|x| system.matrix().row(row).1[0] * x);
        }
        system.solve(rhs, unknowns).map_err(|error| match error {
            LinalgError::SolutionNotFinite { unknown } => LinalgError::SolutionNotFinite { unknown: unknown / 3 },
            other => other,
        })?;
        for (v, (pose, rest)) in pose.iter_mut().zip(rest).enumerate().filter(|(v, _)| patch.held[*v].is_unknown()) {
            let off = DVec3::new(unknowns[3 * v][0], unknowns[3 * v + 1][0], unknowns[3 * v + 2][0]);
            *pose = reference.apply(*rest) + reference.rotation * off;
        }
        Ok(())
    }
}

/// The similarity that best takes the fixed vertices of a patch from rest to where the pose has them.
fn fixed_motion(patch: &Patch, pose: &[DVec3]) -> Fit {
    let all = patch.held.iter().zip(&patch.mesh.positions).zip(pose);
    let fixed = all.filter(|((held, _), _)| **held == Held::Fixed).map(|((_, &rest), &at)| (rest, at, 1.0));
    Fit::similarity(fixed)
}
