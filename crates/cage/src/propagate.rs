use std::fmt;
use std::str::FromStr;

use glam::{DMat3, DVec3};
use pliant_mesh::{Bounds, FrameFit, Frames};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::CageError;
use crate::binding::Binding;

/// How a shape vertex follows its cage vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Propagation {
    /// `x' = sum_j c_j y'_j` (Borosan et al. 2010, Eq. 5). Pruned rows move the shape a little even at rest.
    Positions,
    /// `x' = sum_j c_j (y'_j + M_j (x - y_j))` with the frame `M_j` of each cage vertex ([`Frames`]). Rest gives rest exactly,
    /// and any rigid motion of the cage is one of the shape. The default.
    #[default]
    Frames,
}

impl fmt::Display for Propagation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Positions => "positions",
            Self::Frames => "frames",
        })
    }
}

impl FromStr for Propagation {
    type Err = CageError;

    fn from_str(text: &str) -> Result<Self, CageError> {
        match text {
            "positions" => Ok(Self::Positions),
            "frames" => Ok(Self::Frames),
            _ => Err(CageError::BadOption { what: "propagation (positions or frames)", found: text.to_owned() }),
        }
    }
}

/// Carries poses of a cage to its shape, keeping the memory it needs from one to the next.
#[derive(Debug, Clone, Default)]
pub struct Propagator {
    propagation: Propagation,
    fit: FrameFit,
    frames: Frames,
    moves: Vec<Move>,
}

/// What a cage vertex does to a point `x` (relative to a centre): moves it by `linear x + offset`.
#[derive(Debug, Clone, Copy, Default)]
struct Move {
    linear: DMat3,
    offset: DVec3,
}

impl Propagator {
    /// Propagation by positions, or by frames that turn.
    pub fn new(propagation: Propagation) -> Self {
        Self { propagation, ..Self::default() }
    }

    /// Frames that also scale ([`FrameFit::Similarity`]), for edits whose handles do.
    pub fn with_fit(self, fit: FrameFit) -> Self {
        Self { fit, ..self }
    }

    /// Writes the shape's vertices for a pose of the cage.
    ///
    /// `cage_pose` has one position per cage vertex, `shape` one per shape vertex. In parallel; allocates only on the first
    /// call. Linear in the number of kept weights.
    ///
    /// # Panics
    /// If a slice has another length than the binding says.
    pub fn apply(&mut self, binding: &Binding, cage_pose: &[DVec3], shape: &mut [DVec3]) {
        assert_eq!(cage_pose.len(), binding.cage_vertex_count());
        assert_eq!(shape.len(), binding.shape_vertex_count());
        match self.propagation {
            Propagation::Positions => for_each_row(binding, shape, |_, indices, weights| {
                // Written with differences, so that a row sums to 1 exactly whatever its rounding: far from the origin
                // f32 weights would otherwise lose digits.
                let first = cage_pose[indices[0] as usize];
                indices[1..]
                    .iter()
                    .zip(&weights[1..])
                    .fold(first, |p, (&j, &c)| p + f64::from(c) * (cage_pose[j as usize] - first))
            }),
            Propagation::Frames => self.apply_frames(binding, cage_pose, shape),
        }
    }

    fn apply_frames(&mut self, binding: &Binding, pose: &[DVec3], shape: &mut [DVec3]) {
        self.frames.fit(&binding.cage_topology, &binding.cage, pose, self.fit);
        let centre = Bounds::of(&binding.cage).centre();
        self.moves.resize(pose.len(), Move::default());
        for (j, step) in self.moves.iter_mut().enumerate() {
            // y' + M (x - y) = x + (M - 1) (x - y) + (y' - y): at rest nothing is added, not even rounding.
            let linear = self.frames.matrices[j] - DMat3::IDENTITY;
            let offset = (pose[j] - binding.cage[j]) - linear * (binding.cage[j] - centre);
            *step = Move { linear, offset };
        }
        let moves = &self.moves;
        for_each_row(binding, shape, |x, indices, weights| {
            if let [j] = *indices
                && x == binding.cage[j as usize]
            {
                // A cage vertex itself: exactly where the cage has it.
                return pose[j as usize];
            }
            let from_centre = x - centre;
            let moved = |j: u32| moves[j as usize].linear * from_centre + moves[j as usize].offset;
            // The first weight is what the others leave of 1, so rows sum to 1 exactly.
            let first = moved(indices[0]);
            let step =
                indices[1..].iter().zip(&weights[1..]).fold(first, |d, (&j, &c)| d + f64::from(c) * (moved(j) - first));
            x + step
        });
    }
}

/// Sets every shape vertex to what `follow` makes of its rest position and row.
fn for_each_row(binding: &Binding, shape: &mut [DVec3], follow: impl Fn(DVec3, &[u32], &[f32]) -> DVec3 + Sync) {
    shape.par_iter_mut().enumerate().with_min_len(1024).for_each(|(i, position)| {
        let (indices, weights) = binding.row(i);
        *position = follow(binding.shape[i], indices, weights);
    });
}

impl Binding {
    /// The shape for a pose of the cage, with a propagator of its own: the one-off door to [`Propagator::apply`].
    ///
    /// # Panics
    /// If `cage_pose` has not one position per cage vertex.
    pub fn apply(&self, cage_pose: &[DVec3], propagation: Propagation) -> Vec<DVec3> {
        let mut shape = vec![DVec3::ZERO; self.shape_vertex_count()];
        Propagator::new(propagation).apply(self, cage_pose, &mut shape);
        shape
    }
}
