//! From turned frames to positions.

use glam::DVec3;
use pliant_linalg::{LeastSquares, LinalgError, SparseRows};
use pliant_mesh::TriMesh;

use super::frames::{DiscreteFrames, Tangent};
use super::laplacian::Laplacian;
use super::orientation::{Turn, spring_weights};
use crate::patch::Held;

/// The Laplacian system (Yuan, Eq. 19): least squares over a row for each vertex that is unknown or next to one, and one for each vertex of
/// a soft handle.
pub(super) struct LaplacianEquations {
    frames: DiscreteFrames,
    /// Vertex of each row, and its Laplacian coordinate in the frame there.
    rows: Vec<(u32, DVec3)>,
    /// Vertices of soft handles with the root of their weight.
    springs: Vec<(u32, f64)>,
    system: LeastSquares,
    rhs: Vec<[f64; 3]>,
}

impl LaplacianEquations {
    pub(super) fn new(
        mesh: &TriMesh,
        held: &[Held],
        laplacian: &Laplacian,
        tangent: Tangent,
    ) -> Result<Self, LinalgError> {
        // Step I of section 4.2.
        let frames = DiscreteFrames::of(mesh, tangent);
        let is_unknown = |v: usize| held[v].is_unknown();
        // Step II (Eq. 14). A row without an unknown says nothing.
        let mut rows = Vec::new();
        let mut matrix = SparseRows::new(held.len());
        let mut diagonal = vec![0.0; held.len()];
        for i in 0..held.len() {
            let neighbours = mesh.topology().neighbours(i);
            if neighbours.is_empty() || !(is_unknown(i) || neighbours.iter().any(|&j| is_unknown(j as usize))) {
                continue;
            }
            let row = laplacian.row(mesh, i);
            for (j, value) in row.clone() {
                diagonal[j as usize] += value * value;
            }
            matrix.push_row(row)?;
            rows.push((i as u32, frames.local(i, laplacian.apply(mesh, i))));
        }
        let mut springs = Vec::new();
        for (k, weight) in (0..).zip(spring_weights(held, &diagonal)).filter(|(_, weight)| *weight > 0.0) {
            let root = weight.sqrt();
            matrix.push_row([(k, root)])?;
            springs.push((k, root));
        }
        let rhs = vec![[0.0; 3]; matrix.row_count()];
        let system = LeastSquares::new(matrix, is_unknown)?;
        Ok(Self { frames, rows, springs, system, rhs })
    }

    /// Numbers stored for solving.
    pub(super) fn solve_len(&self) -> usize {
        self.system.solve_len()
    }

    /// Steps IV and V of section 4.2: local coordinates to global ones, and the positions that have these. `goals` are read at springs,
    /// and `x` where nothing is unknown.
    pub(super) fn solve(&mut self, turns: &[Turn], goals: &[DVec3], x: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        let Self { frames, rows, springs, system, rhs } = self;
        let (laplacian, soft) = rhs.split_at_mut(rows.len());
        for (b, &(i, local)) in laplacian.iter_mut().zip(&*rows) {
            let turned = turns[i as usize].map() * frames.columns(i as usize);
            // `sum_k local_k f_k`. Eq. 18 prints the dot product of Eq. 14 once more, which would be the transpose.
            *b = (turned * local).to_array();
        }
        for (b, &(k, root)) in soft.iter_mut().zip(&*springs) {
            *b = (root * goals[k as usize]).to_array();
        }
        system.solve(rhs, x)
    }
}
