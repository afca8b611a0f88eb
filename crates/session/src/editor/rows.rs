//! Points of the shape that the cage is held by.

use std::collections::BTreeMap;

use glam::DVec3;
use pliant_cage::{Binding, Propagator};
use pliant_mesh::VertexSet;

use super::part::Part;
use super::{EditorHandle, Pose};

/// A point of the shape by the corners of a face, or one vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corners {
    pub(crate) vertices: [u32; 3],
    pub(crate) weights: [f64; 3],
}

impl Corners {
    pub(crate) fn vertex(vertex: u32) -> Self {
        Self { vertices: [vertex; 3], weights: [1.0, 0.0, 0.0] }
    }

    pub(crate) fn place(&self, positions: &[DVec3]) -> DVec3 {
        if self.weights[0] == 1.0 {
            return positions[self.vertices[0] as usize];
        }
        (0..3).map(|k| self.weights[k] * positions[self.vertices[k] as usize]).sum()
    }
}

/// A point of the shape that the cage is held by.
pub(crate) struct RowPoint {
    /// Place of its handle.
    pub(crate) handle: usize,
    pub(crate) of: Corners,
    /// The cage vertices it follows, and their weights.
    pub(crate) row: Vec<(u32, f64)>,
    goal: DVec3,
    /// From where the row puts it to where the shape has it: what frames add to positions.
    offset: DVec3,
}

impl RowPoint {
    /// A point that follows the cage as its corners do, each averaged on the cage as propagation by frames does.
    pub(crate) fn new(handle: usize, of: Corners, binding: &Binding) -> Self {
        let mut sums = BTreeMap::new();
        for (&v, &share) in of.vertices.iter().zip(&of.weights).filter(|(_, share)| **share != 0.0) {
            let (indices, weights) = binding.row(v as usize);
            for (&j, &weight) in indices.iter().zip(weights) {
                let (averaged, shares) = binding.smoothing_row(j);
                for (k, part) in averaged.into_iter().zip(shares) {
                    *sums.entry(k).or_insert(0.0) += share * f64::from(weight) * f64::from(part);
                }
            }
        }
        // Rows are kept in single precision and sum to 1 up to its rounding.
        let sum: f64 = sums.values().sum();
        let row = sums.into_iter().map(|(k, weight)| (k, weight / sum)).collect();
        Self { handle, of, row, goal: DVec3::ZERO, offset: DVec3::ZERO }
    }

    fn on_cage(&self, cage: &[DVec3]) -> DVec3 {
        self.row.iter().map(|&(j, weight)| weight * cage[j as usize]).sum()
    }
}

/// The points of the shape that the cage is held by, in the order of the region's rows.
pub(crate) struct Rows {
    /// Their corners are numbered as they lie in `before`.
    points: Vec<RowPoint>,
    /// Where the corners are when the step begins.
    before: Vec<DVec3>,
    /// The corners by themselves, if targets follow the frames of the cage.
    part: Option<Part>,
    propagator: Propagator,
    after: Vec<DVec3>,
}

impl Rows {
    /// Rows whose targets follow the frames of the cage or not; `shares` are those of [`Part::new`].
    pub(crate) fn new(mut points: Vec<RowPoint>, follow: bool, binding: &Binding, base: &Pose, shares: &[f64]) -> Self {
        let corners: VertexSet = points.iter().flat_map(|point| point.of.vertices).collect();
        for v in points.iter_mut().flat_map(|point| &mut point.of.vertices) {
            *v = corners.as_slice().partition_point(|c| c < v) as u32;
        }
        let before = corners.iter().map(|v| base.shape[v as usize]).collect();
        let part = (follow && !points.is_empty()).then(|| Part::new(binding, corners, shares));
        Self { points, before, part, propagator: Propagator::default(), after: Vec::new() }
    }

    /// Whether targets depend on the pose of the cage.
    pub(crate) fn follow_frames(&self) -> bool {
        self.part.is_some()
    }

    /// As before anything was solved: with the cage where the step began.
    pub(crate) fn begin(&mut self, cage: &[DVec3]) {
        for point in &mut self.points {
            point.offset = point.of.place(&self.before) - point.on_cage(cage);
        }
    }

    /// Takes over the goals of the handles.
    pub(crate) fn aim(&mut self, handles: &[EditorHandle]) {
        for point in &mut self.points {
            point.goal = handles[point.handle].goal.apply(point.of.place(&self.before));
        }
    }

    /// Looks at what frames add to positions when the cage has gone from one pose to another.
    pub(crate) fn follow(&mut self, from: &[DVec3], to: &[DVec3]) {
        let Self { points, before, part: Some(part), propagator, after } = self else { return };
        part.carry(propagator, from, to, before, after);
        for point in points {
            point.offset = point.of.place(after) - point.on_cage(to);
        }
    }

    /// Where the cage is to have each row, so that the shape has the point on its goal.
    pub(crate) fn targets(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.points.iter().map(|point| point.goal - point.offset)
    }
}
