//! Preparing an edit and solving it.

use glam::{DMat3, DVec3};
use pliant_linalg::LinalgError;
use pliant_mesh::{TriMesh, best_rotation, best_scale, outer};

use super::laplacian::Laplacian;
use super::orientation::{FrameEquations, Turn, make_orthonormal};
use super::positions::LaplacianEquations;
use super::rim::Rim;
use super::{Reconstruction, RotationInvariantOptions};
use crate::patch::Patch;
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport};

/// A prepared edit by rotation-invariant coordinates.
///
/// Computes in the rest shape's frame, centred and scaled to a diagonal between 1/2 and 1, so results follow any scale and offset of the
/// scene. The result does not depend on where the incoming pose has the vertices of the region. Rigid motions and similarities
/// common to all that is held are reproduced to rounding.
///
/// Prepared at the cost of one or two sparse factorisations; another region, even one of the same vertices, is prepared afresh. A solve reads
/// the factor of the frames three times (four where a goal scales) and that of positions once or twice.
pub struct RotationInvariant {
    options: RotationInvariantOptions,
    rest: TriMesh,
    edit: Edit,
}

/// What depends on the region.
struct Edit {
    patch: Patch,
    rim: Rim,
    laplacian: Laplacian,
    frame_equations: FrameEquations,
    /// None where positions are rebuilt from edges: these have the matrix of the frames.
    laplacian_equations: Option<LaplacianEquations>,
    scratch: Scratch,
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame, by vertex of the patch.
#[derive(Default)]
struct Scratch {
    /// Goals, and the pose where there is none; then the solution.
    pose: Vec<DVec3>,
    turns: Vec<Turn>,
    solution: Vec<[f64; 3]>,
}

impl RotationInvariant {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &RotationInvariantOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        let edit = Edit::new(options, rest, region)?;
        Ok(Self { options: options.clone(), rest: rest.clone(), edit })
    }
}

impl Deformer for RotationInvariant {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        let Self { options, edit, .. } = self;
        edit.patch.read(goals, positions, &mut edit.scratch.pose)?;
        edit.hold_frames(goals, options.orthonormal);
        let solved = edit.run(options);
        solved.map_err(|error| DeformError::of_system(error, &edit.patch.vertices))?;
        edit.patch.write(&edit.scratch.pose, goals, positions)?;
        Ok(SolveReport { iterations: options.coupling, ..SolveReport::default() })
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        self.edit = Edit::new(&self.options, &self.rest, region)?;
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        PrepareReport {
            unknowns: self.edit.patch.unknown_count(),
            clamped_weights: self.edit.laplacian.clamped,
            factor_len: self.edit.frame_equations.solve_len()
                + self.edit.laplacian_equations.as_ref().map_or(0, LaplacianEquations::solve_len),
        }
    }
}

impl Edit {
    fn new(options: &RotationInvariantOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        // The rows of fixed vertices next to unknown ones have neighbours a ring farther out.
        let patch = Patch::new(rest, region, 2)?;
        let (mesh, held) = (&patch.mesh, &patch.held);
        let laplacian = Laplacian::new(mesh, options.weights);
        let name = |error| DeformError::of_system(error, &patch.vertices);
        let frame_equations = FrameEquations::new(mesh, held, laplacian.weights.clone()).map_err(name)?;
        let laplacian_equations = match options.reconstruction {
            Reconstruction::Edges => None,
            Reconstruction::Laplacian => {
                Some(LaplacianEquations::new(mesh, held, &laplacian, options.tangent).map_err(name)?)
            }
        };
        let rim = Rim::new(&patch);
        let scratch = Scratch {
            turns: vec![Turn::IDENTITY; held.len()],
            solution: vec![[0.0; 3]; held.len()],
            ..Scratch::default()
        };
        Ok(Self { patch, rim, laplacian, frame_equations, laplacian_equations, scratch })
    }

    /// What the frames of handles and of the rim are held to (Eq. 20).
    fn hold_frames(&mut self, goals: &Goals, orthonormal: bool) {
        let Self { patch, rim, scratch, .. } = self;
        let Scratch { pose, turns, .. } = scratch;
        rim.read(&patch.mesh, pose, turns);
        for (turn, held) in turns.iter_mut().zip(&patch.held) {
            if let Some(handle) = held.handle() {
                let goal = &goals.transforms[handle as usize];
                *turn = Turn { linear: DMat3::from_quat(goal.rotation.normalize()), log_scale: goal.scale.ln() };
            }
            if !orthonormal {
                *turn = Turn { linear: turn.map(), log_scale: 0.0 };
            }
        }
    }

    /// Step III of section 4.2, then positions.
    fn run(&mut self, options: &RotationInvariantOptions) -> Result<(), LinalgError> {
        let Self { patch, frame_equations, scratch, .. } = self;
        let Scratch { pose, turns, solution, .. } = scratch;
        for (x, p) in solution.iter_mut().zip(&*pose) {
            *x = p.to_array();
        }
        frame_equations.solve(&patch.mesh, &patch.held, turns)?;
        if options.orthonormal {
            make_orthonormal(&patch.held, turns);
        }
        self.solve_positions()?;
        for _ in 0..options.coupling {
            self.refit_turns(options.orthonormal);
            self.solve_positions()?;
        }
        let Scratch { pose, solution, .. } = &mut self.scratch;
        for (p, x) in pose.iter_mut().zip(solution) {
            *p = DVec3::from_array(*x);
        }
        Ok(())
    }

    /// The positions that go with the turns.
    fn solve_positions(&mut self) -> Result<(), LinalgError> {
        let Self { patch, frame_equations, laplacian_equations, scratch, .. } = self;
        let Scratch { pose, turns, solution } = scratch;
        match laplacian_equations {
            Some(equations) => equations.solve(turns, pose, solution),
            None => frame_equations.solve_positions(&patch.mesh, &patch.held, turns, pose, solution),
        }
    }

    /// The best rotation of the ring of each vertex that is not held, from rest to the solution (Eq. 22), and without `orthonormal` the
    /// best scale.
    fn refit_turns(&mut self, orthonormal: bool) {
        let Self { patch, laplacian, scratch, .. } = self;
        let Scratch { turns, solution, .. } = scratch;
        let (mesh, topology) = (&patch.mesh, patch.mesh.topology());
        let at = |v: u32| DVec3::from_array(solution[v as usize]);
        for (i, turn) in turns.iter_mut().enumerate().filter(|(i, _)| patch.held[*i].is_unknown()) {
            let (mut covariance, mut squares) = (DMat3::ZERO, 0.0);
            for (&j, &edge) in topology.neighbours(i).iter().zip(topology.neighbour_edges(i)) {
                let rest = mesh.positions[j as usize] - mesh.positions[i];
                let weight = laplacian.weights[edge as usize];
                covariance += outer(at(j) - at(i as u32), rest) * weight;
                squares += weight * rest.length_squared();
            }
            turn.linear = best_rotation(covariance);
            if !orthonormal {
                turn.log_scale = best_scale(turn.linear, covariance, squares).ln();
            }
        }
    }
}
