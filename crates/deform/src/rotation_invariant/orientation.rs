//! From the orientations of what is held to those of all frames.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use pliant_linalg::{Cholesky, LinalgError, SpdPattern};
use pliant_mesh::{TriMesh, best_rotation};

use crate::patch::Held;

/// How a frame has turned and grown: frame vectors `f` of the rest shape have become `linear * f`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turn {
    pub(super) linear: DMat3,
    /// Of the size. Only where frames are made orthonormal again; else it is in `linear`.
    pub(super) log_scale: f64,
}

impl Turn {
    pub(super) const IDENTITY: Self = Self { linear: DMat3::IDENTITY, log_scale: 0.0 };

    /// Both parts together.
    pub(super) fn map(&self) -> DMat3 {
        if self.log_scale == 0.0 { self.linear } else { self.linear * self.log_scale.exp() }
    }
}

/// The frame equations (Yuan, Eq. 15): minimises `sum w_ij |F_j - T_ij F_i|^2 + sum alpha_k |F_k - R_k|^2` over the frames that are
/// not held, each edge once.
///
/// Rest frames `E` are orthonormal and `T_ij = E_j E_i^T`. With `F_i = E_i M_i^T`, where `M_i` is what has become of the vectors of frame
/// `i`, the terms are `w_ij |M_j - M_i|^2`, as rotations keep norms. So in `M` the equations are those of a Laplacian with one
/// row per vertex, the same for all nine entries, where in `F` they have three rows per vertex and a 3 x 3 block per edge. The solution is
/// the same.
///
/// (Eq. 17 prints one row per vertex, the sum over its edges of `T_ij F_i - F_j`. Least squares over these is another energy, in which
/// errors of edges cancel; Eq. 15, as Lipman et al. have it, has a row per edge.)
pub(super) struct FrameEquations {
    /// Positive, one per edge.
    weights: Vec<f64>,
    /// `alpha_k`, 0 for what no soft handle draws.
    springs: Vec<f64>,
    factor: Cholesky,
    rhs: Vec<[f64; 3]>,
}

impl FrameEquations {
    pub(super) fn new(mesh: &TriMesh, held: &[Held], weights: Vec<f64>) -> Result<Self, LinalgError> {
        let topology = mesh.topology();
        let mut diagonal = vec![0.0; held.len()];
        for (ends, w) in topology.edges().iter().zip(&weights) {
            for &v in ends {
                diagonal[v as usize] += w;
            }
        }
        let springs = spring_weights(held, &diagonal);
        // The upper triangle by columns, as edges come: those to lower neighbours, then the diagonal.
        let (mut offsets, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
        for (j, (diagonal, spring)) in diagonal.iter().zip(&springs).enumerate() {
            let lower = topology.neighbours(j).iter().zip(topology.neighbour_edges(j));
            for (&i, &edge) in lower.take_while(|(i, _)| (**i as usize) < j) {
                rows.push(i);
                values.push(-weights[edge as usize]);
            }
            rows.push(j as u32);
            values.push(diagonal + spring);
            offsets.push(rows.len() as u32);
        }
        let pattern = Arc::new(SpdPattern::of_columns(offsets, rows)?);
        let factor = Cholesky::of_block(pattern, values, |i| held[i].is_unknown())?;
        Ok(Self { weights, springs, factor, rhs: vec![[0.0; 3]; held.len()] })
    }

    /// Numbers stored for solving.
    pub(super) fn solve_len(&self) -> usize {
        self.factor.solve_len()
    }

    /// Replaces the turns of frames that are not held, given those that are and, at springs, what they are drawn to.
    ///
    /// The scale is carried by its logarithm, with the same equations, so that it stays positive and grows by equal factors.
    pub(super) fn solve(&mut self, mesh: &TriMesh, held: &[Held], turns: &mut [Turn]) -> Result<(), LinalgError> {
        let scales = turns.iter().any(|turn| turn.log_scale != 0.0);
        for part in 0..3 + usize::from(scales) {
            let value = |i: usize| match part {
                3 => DVec3::new(turns[i].log_scale, 0.0, 0.0),
                column => turns[i].linear.col(column),
            };
            self.solve_for(mesh, held, value, |_, _| DVec3::ZERO)?;
            let unknowns = turns.iter_mut().zip(&self.rhs).zip(held).filter(|(_, held)| held.is_unknown());
            for ((turn, x), _) in unknowns {
                match part {
                    3 => turn.log_scale = x[0],
                    // What springs draw this column to has been read.
                    column => *turn.linear.col_mut(column) = DVec3::from_array(*x),
                }
            }
        }
        Ok(())
    }

    /// The positions whose edges are those of the rest shape, turned with the frames at both ends: minimises the sum of `w_ij |x_j - x_i -
    /// F_i c_ij|^2` over edges and ends (Lipman et al. 2005), `c_ij` being the rest edge in frame `i`, so that `F_i c_ij = M_i (p_j -
    /// p_i)`. The matrix is that of the frames. `goals` are read at springs, and `x` where nothing is unknown.
    pub(super) fn solve_positions(
        &mut self,
        mesh: &TriMesh,
        held: &[Held],
        turns: &[Turn],
        goals: &[DVec3],
        x: &mut [[f64; 3]],
    ) -> Result<(), LinalgError> {
        let (topology, p) = (mesh.topology(), &mesh.positions);
        self.solve_for(
            mesh,
            held,
            |i| goals[i],
            |i, weights| {
                let at = turns[i].map();
                let ring = topology.neighbours(i).iter().zip(topology.neighbour_edges(i));
                let turned = ring.map(|(&j, &edge)| {
                    let j = j as usize;
                    0.5 * weights[edge as usize] * ((at + turns[j].map()) * (p[i] - p[j]))
                });
                turned.sum()
            },
        )?;
        for ((x, solution), _) in x.iter_mut().zip(&self.rhs).zip(held).filter(|(_, held)| held.is_unknown()) {
            *x = *solution;
        }
        Ok(())
    }

    /// Leaves in `rhs` the solution of `sum_j w_ij (x_i - x_j) + alpha_i x_i = load_i + alpha_i value_i` for the unknowns, with `value_j`
    /// for those that are held; `load` is given the weights of the edges.
    fn solve_for(
        &mut self,
        mesh: &TriMesh,
        held: &[Held],
        value: impl Fn(usize) -> DVec3,
        load: impl Fn(usize, &[f64]) -> DVec3,
    ) -> Result<(), LinalgError> {
        let topology = mesh.topology();
        for (i, rhs) in self.rhs.iter_mut().enumerate().filter(|(i, _)| held[*i].is_unknown()) {
            let mut sum = load(i, &self.weights);
            if self.springs[i] > 0.0 {
                sum += self.springs[i] * value(i);
            }
            for (&j, &edge) in topology.neighbours(i).iter().zip(topology.neighbour_edges(i)) {
                if !held[j as usize].is_unknown() {
                    sum += self.weights[edge as usize] * value(j as usize);
                }
            }
            *rhs = sum.to_array();
        }
        self.factor.solve_in_place(&mut self.rhs)
    }
}

/// The nearest proper rotations instead of the matrices that are not held (Lipman et al. 2005; Yuan leaves them as they are).
///
/// Of two rotations nearly half a turn apart the mean is nearly singular; the nearest rotation is found all the same, but may be any
/// about their common axis.
pub(super) fn make_orthonormal(held: &[Held], turns: &mut [Turn]) {
    for (turn, _) in turns.iter_mut().zip(held).filter(|(_, held)| held.is_unknown()) {
        turn.linear = best_rotation(turn.linear);
    }
}

/// The weight of each soft handle's vertex, relative to the mean diagonal entry of the unknowns; 0 for all others.
pub(super) fn spring_weights(held: &[Held], diagonal: &[f64]) -> Vec<f64> {
    let unknowns = || held.iter().zip(diagonal).filter(|(held, _)| held.is_unknown()).map(|(_, d)| *d);
    let sum: f64 = unknowns().sum();
    // A matrix of lone vertices is zero; any scale will do.
    let mean = if sum > 0.0 { sum / unknowns().count() as f64 } else { 1.0 };
    let spring = |held: &Held| match held {
        Held::Spring { weight, .. } => weight * mean,
        _ => 0.0,
    };
    held.iter().map(spring).collect()
}
