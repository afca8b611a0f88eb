use std::fmt;
use std::str::FromStr;

use glam::{DMat3, DVec3, Vec3};
use pliant_mesh::{FrameFit, Frames, NormalBuffer};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::CageError;
use crate::binding::Binding;
use crate::packed::{Finish, Lanes, Move, Real, left_of_one};
use crate::sparse::Rows;

/// How a shape vertex follows its cage vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Propagation {
    /// `x' = sum_j c_j y'_j` (Borosan et al. 2010, Eq. 5). Pruned rows move the shape a little even at rest.
    Positions,
    /// `x' = sum_j c_j (y'_j + M_j (x - y_j))` with the frame `M_j` of each cage vertex ([`Frames`]), these affine motions averaged on
    /// the cage first ([`BindOptions::smoothing`](crate::BindOptions::smoothing)). Rest gives rest exactly, and any rigid motion of
    /// the cage is one of the shape. The default.
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
    double: Motions<f64>,
    single: Motions<f32>,
    /// Points before they are carried.
    before: Vec<DVec3>,
    normals: NormalBuffer,
}

/// What the cage's vertices do, in the order of their ranks.
#[derive(Debug, Clone, Default)]
struct Motions<T> {
    moves: Vec<Move<T>>,
    smoothed: Vec<Move<T>>,
    positions: Vec<[T; 4]>,
}

/// Cage vertices that one task averages or converts.
const GRAIN: usize = 512;

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
        let packed = &binding.packed;
        match self.propagation {
            Propagation::Positions => {
                self.double.place(&packed.by_rank, cage_pose, DVec3::ZERO);
                packed.sum(&self.double.positions, shape, &Place(DVec3::ZERO));
            }
            Propagation::Frames => self.follow(binding, &binding.cage, cage_pose, &binding.shape, shape),
        }
    }

    /// Carries points of the shape along as the cage goes from one pose to another, by frames, whatever the propagation.
    ///
    /// `from` and `to` have one position per cage vertex, `points` one per shape vertex: where they are with the cage at `from`. A rigid
    /// motion of the cage moves them by it, and where the cage stays as it is they keep their bits. [`Self::apply`] by frames is
    /// this from rest. In parallel; allocates only on the first call. Linear in the number of kept weights.
    ///
    /// # Panics
    /// If a slice has another length than the binding says.
    pub fn carry(&mut self, binding: &Binding, from: &[DVec3], to: &[DVec3], points: &mut [DVec3]) {
        assert_eq!(from.len(), binding.cage_vertex_count());
        assert_eq!(to.len(), binding.cage_vertex_count());
        assert_eq!(points.len(), binding.shape_vertex_count());
        let mut before = std::mem::take(&mut self.before);
        before.clear();
        before.extend_from_slice(points);
        self.follow(binding, from, to, &before, points);
        self.before = before;
    }

    /// As [`Self::carry`], in single precision: writes to `after` where the points `before` go.
    ///
    /// Where the cage stays as it is, points keep their bits; elsewhere they differ from those of [`Self::carry`] by rounding, see
    /// [`Self::apply_f32`].
    ///
    /// # Panics
    /// If a slice has another length than the binding says.
    pub fn carry_f32(&mut self, binding: &Binding, from: &[DVec3], to: &[DVec3], before: &[Vec3], after: &mut [Vec3]) {
        assert_eq!(from.len(), binding.cage_vertex_count());
        assert_eq!(to.len(), binding.cage_vertex_count());
        assert_eq!(before.len(), binding.shape_vertex_count());
        assert_eq!(after.len(), binding.shape_vertex_count());
        self.frames.fit(&binding.cage_topology, from, to, self.fit);
        let moves = self.single.follow(binding, from, to, &self.frames.matrices);
        let centre = binding.packed.centre.as_vec3();
        binding.packed.sum(moves, after, &SingleFrom { centre, before });
    }

    /// Writes to `after` where the points `before` go as the cage goes from `from` to `to`.
    fn follow(&mut self, binding: &Binding, from: &[DVec3], to: &[DVec3], before: &[DVec3], after: &mut [DVec3]) {
        self.frames.fit(&binding.cage_topology, from, to, self.fit);
        let moves = self.double.follow(binding, from, to, &self.frames.matrices);
        binding.packed.sum(moves, after, &Double { binding, before, from, to });
    }

    /// Writes the shape's vertices for a pose of the cage in single precision, straight into buffers that leave for a GPU, and its
    /// normals if a buffer is given.
    ///
    /// `cage_pose` has one position per cage vertex; `positions` and `normals` one entry per shape vertex, in the shape's units and
    /// in its order. Positions differ from those of [`Self::apply`] by rounding: some 1e-7 of the largest coordinate and of the
    /// motion. At rest, propagation by frames gives the rest positions rounded to f32. Normals are unit length, of the new
    /// positions, the faces weighted by area; zero where there are none.
    ///
    /// In parallel; allocates only on the first call. Costs about 0.7 ns a kept weight and 70 ns a cage vertex on one thread: bound
    /// by arithmetic where rows fit the last cache. Normals take half as long again or more.
    ///
    /// # Panics
    /// If a slice has another length than the binding says.
    pub fn apply_f32(
        &mut self,
        binding: &Binding,
        cage_pose: &[DVec3],
        positions: &mut [Vec3],
        normals: Option<&mut [Vec3]>,
    ) {
        assert_eq!(cage_pose.len(), binding.cage_vertex_count());
        assert_eq!(positions.len(), binding.shape_vertex_count());
        let packed = &binding.packed;
        // Exact: the centre was rounded to f32.
        let centre = packed.centre.as_vec3();
        match self.propagation {
            Propagation::Positions => {
                self.single.place(&packed.by_rank, cage_pose, packed.centre);
                packed.sum(&self.single.positions, positions, &Place(centre));
            }
            Propagation::Frames => {
                self.frames.fit(&binding.cage_topology, &binding.cage, cage_pose, self.fit);
                let moves = self.single.follow(binding, &binding.cage, cage_pose, &self.frames.matrices);
                packed.sum(moves, positions, &Single { centre });
            }
        }
        if let Some(normals) = normals {
            self.normals.compute(&binding.shape_topology, positions, normals);
        }
    }
}

/// Positions propagation: the sum is the place, relative to a centre.
struct Place<V>(V);

impl Finish<f64, 4> for Place<DVec3> {
    type Point = DVec3;
    const EXACT: bool = true;

    #[inline(always)]
    fn finish(&self, _: usize, _: Vec3, _: usize, _: usize, p: &[f64; 4]) -> DVec3 {
        self.0 + DVec3::new(p[0], p[1], p[2])
    }
}

impl Finish<f32, 4> for Place<Vec3> {
    type Point = Vec3;
    const EXACT: bool = false;

    #[inline(always)]
    fn finish(&self, _: usize, _: Vec3, _: usize, _: usize, p: &[f32; 4]) -> Vec3 {
        self.0 + Vec3::new(p[0], p[1], p[2])
    }
}

/// Frames propagation in double precision: the sum is a motion of the exact position before.
struct Double<'a> {
    binding: &'a Binding,
    before: &'a [DVec3],
    from: &'a [DVec3],
    to: &'a [DVec3],
}

impl Finish<f64, 16> for Double<'_> {
    type Point = DVec3;
    const EXACT: bool = true;

    #[inline(always)]
    fn finish(&self, i: usize, _: Vec3, leading: usize, length: usize, sum: &[f64; 16]) -> DVec3 {
        let Binding { packed, smoothing, .. } = self.binding;
        let before = self.before[i];
        if length == 1 && smoothing.is_none() {
            // A cage vertex itself: exactly where the cage has it.
            let j = packed.by_rank[leading] as usize;
            if before == self.from[j] {
                return self.to[j];
            }
        }
        let [x, y, z, _] = step(sum, (before - packed.centre).to_array());
        before + DVec3::new(x, y, z)
    }
}

/// Frames propagation in single precision.
struct Single {
    centre: Vec3,
}

/// The same from any position before.
struct SingleFrom<'a> {
    centre: Vec3,
    before: &'a [Vec3],
}

impl Finish<f32, 16> for SingleFrom<'_> {
    type Point = Vec3;
    const EXACT: bool = false;

    #[inline(always)]
    fn finish(&self, i: usize, _: Vec3, leading: usize, length: usize, sum: &[f32; 16]) -> Vec3 {
        Single { centre: self.centre }.finish(i, self.before[i], leading, length, sum)
    }
}

impl Finish<f32, 16> for Single {
    type Point = Vec3;
    const EXACT: bool = false;

    #[inline(always)]
    fn finish(&self, _: usize, rest: Vec3, _: usize, _: usize, sum: &[f32; 16]) -> Vec3 {
        let [x, y, z, _] = step(sum, (rest - self.centre).to_array());
        rest + Vec3::new(x, y, z)
    }
}

/// By how much a motion moves the point `x` from the centre.
#[inline(always)]
fn step<T: Real>(m: &[T; 16], x: [T; 3]) -> [T; 4] {
    std::array::from_fn(|k| m[k] * x[0] + m[4 + k] * x[1] + m[8 + k] * x[2] + m[12 + k])
}

impl<T: Real> Motions<T> {
    /// Positions relative to a centre.
    fn place(&mut self, by_rank: &[u32], pose: &[DVec3], centre: DVec3) {
        self.positions.clear();
        self.positions.extend(by_rank.iter().map(|&j| {
            let [x, y, z] = (pose[j as usize] - centre).to_array().map(T::rounded);
            [x, y, z, T::default()]
        }));
    }

    /// Motions from one pose to another with their frames, averaged if the binding says so.
    fn follow(&mut self, binding: &Binding, from: &[DVec3], to: &[DVec3], frames: &[DMat3]) -> &[Move<T>] {
        let (centre, by_rank) = (binding.packed.centre, &binding.packed.by_rank);
        self.moves.resize(to.len(), Move::default());
        self.moves.par_iter_mut().zip(by_rank).with_min_len(GRAIN).for_each(|(step, &j)| {
            let j = j as usize;
            // y' + M (x - y) = x + (M - 1) (x - y) + (y' - y): at rest nothing is added, not even rounding.
            let linear = frames[j] - DMat3::IDENTITY;
            let offset = (to[j] - from[j]) - linear * (from[j] - centre);
            let columns = [linear.x_axis, linear.y_axis, linear.z_axis, offset];
            let lane = |k: usize| if k % 4 < 3 { T::rounded(columns[k / 4][k % 4]) } else { T::default() };
            step.0 = std::array::from_fn(lane);
        });
        match &binding.smoothing {
            None => &self.moves,
            Some(rows) => {
                self.smoothed.resize(to.len(), Move::default());
                average(rows, &self.moves, &mut self.smoothed);
                &self.smoothed
            }
        }
    }
}

/// `smoothed[r] = sum_k w_k moves[k]` over row `r`, the leading weight being what the others leave of 1.
fn average<T: Real>(rows: &Rows, moves: &[Move<T>], smoothed: &mut [Move<T>]) {
    let arch = pulp::Arch::new();
    smoothed.par_chunks_mut(GRAIN).enumerate().for_each(|(chunk, smoothed)| {
        arch.dispatch(Average { rows, first: chunk * GRAIN, moves, smoothed });
    });
}

/// The work on one stretch of rows, compiled for the widest vectors there are.
struct Average<'a, T> {
    rows: &'a Rows,
    first: usize,
    moves: &'a [Move<T>],
    smoothed: &'a mut [Move<T>],
}

impl<T: Real> WithSimd for Average<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (at, to) in self.smoothed.iter_mut().enumerate() {
            let (indices, weights) = self.rows.row(self.first + at);
            to.0 = Move::sum(simd, self.moves, (indices, weights), left_of_one(&weights[1..]));
        }
    }
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
