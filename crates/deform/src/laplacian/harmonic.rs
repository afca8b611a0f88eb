//! Values of the handles carried over the region by harmonic fields.

use std::sync::Arc;

use pliant_linalg::{Cholesky, LinalgError, SpdPattern};

use super::rows::springs;
use crate::operators::{EdgeWeightKind, edge_weights};
use crate::patch::Patch;

/// Interpolates three numbers per vertex between what is held.
///
/// The field of a handle is 1 on its vertices, 0 on all others that are held and harmonic in between (Zayer et al. 2005, section 3.1); the
/// value of a vertex is the mean of those of the handles, weighted by their fields. That is the harmonic function with the handles' values
/// where these are, so it is solved for directly: nothing is stored per handle and vertex. Weights are positive, so fields are
/// between 0 and 1 and sum up to 1. A soft handle draws the values of its vertices as it draws their positions.
pub(super) struct Harmonic {
    factor: Cholesky,
    /// Vertex of the patch of each unknown.
    unknowns: Vec<u32>,
    /// Row `k` is `entries[offsets[k]..offsets[k + 1]]`: held neighbours of unknown `k` with their weights.
    offsets: Vec<u32>,
    entries: Vec<(u32, f64)>,
    /// Unknown, its vertex, and the stiffness that draws it to the handle's value.
    springs: Vec<(u32, u32, f64)>,
    rhs: Vec<[f64; 3]>,
}

impl Harmonic {
    pub(super) fn new(patch: &Patch, kind: EdgeWeightKind) -> Result<Self, LinalgError> {
        const HELD: u32 = u32::MAX;
        let topology = patch.mesh.topology();
        let weights = edge_weights(&patch.mesh, kind).values;
        let unknowns: Vec<u32> = (0..).zip(&patch.held).filter(|(_, held)| held.is_unknown()).map(|(v, _)| v).collect();
        let mut number = vec![HELD; patch.held.len()];
        for (k, &v) in (0..).zip(&unknowns) {
            number[v as usize] = k;
        }
        let mut diagonal = vec![0.0; patch.held.len()];
        for (&[a, b], w) in topology.edges().iter().zip(&weights) {
            diagonal[a as usize] += w;
            diagonal[b as usize] += w;
        }
        let mut stiffness = vec![0.0; unknowns.len()];
        let mut drawn = Vec::new();
        for (v, root) in springs(patch, &diagonal) {
            let k = number[v as usize];
            stiffness[k as usize] = root * root;
            drawn.push((k, v, root * root));
        }
        let (mut col_ptr, mut row_idx, mut values) = (vec![0], Vec::new(), Vec::new());
        let (mut offsets, mut entries) = (vec![0], Vec::new());
        for (k, &v) in (0..).zip(&unknowns) {
            let ring = topology.neighbours(v as usize).iter().zip(topology.neighbour_edges(v as usize));
            for (&j, &e) in ring {
                let (other, weight) = (number[j as usize], weights[e as usize]);
                if other == HELD {
                    entries.push((j, weight));
                } else if other < k {
                    row_idx.push(other);
                    values.push(-weight);
                }
            }
            row_idx.push(k);
            values.push(diagonal[v as usize] + stiffness[k as usize]);
            col_ptr.push(row_idx.len() as u32);
            offsets.push(entries.len() as u32);
        }
        let pattern = Arc::new(SpdPattern::of_columns(col_ptr, row_idx)?);
        let factor = Cholesky::new(pattern, values)?;
        let rhs = vec![[0.0; 3]; unknowns.len()];
        Ok(Self { factor, unknowns, offsets, entries, springs: drawn, rhs })
    }

    /// Numbers stored for solving.
    pub(super) fn solve_len(&self) -> usize {
        self.factor.solve_len()
    }

    /// Replaces the values of the unknowns by those interpolated between the others' and what `values` has for the vertices of soft
    /// handles; one entry per vertex of the patch.
    pub(super) fn interpolate(&mut self, values: &mut [[f64; 3]]) -> Result<(), LinalgError> {
        let Self { factor, unknowns, offsets, entries, springs, rhs } = self;
        let add = |sum: &mut [f64; 3], factor: f64, x: [f64; 3]| (0..3).for_each(|c| sum[c] += factor * x[c]);
        for (rhs, ends) in rhs.iter_mut().zip(offsets.windows(2)) {
            *rhs = [0.0; 3];
            for &(vertex, weight) in &entries[ends[0] as usize..ends[1] as usize] {
                add(rhs, weight, values[vertex as usize]);
            }
        }
        for &(k, vertex, stiffness) in &*springs {
            add(&mut rhs[k as usize], stiffness, values[vertex as usize]);
        }
        factor.solve_in_place(rhs)?;
        for (&vertex, value) in unknowns.iter().zip(&*rhs) {
            values[vertex as usize] = *value;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{VertexSet, shapes};

    use super::*;
    use crate::patch::Held;
    use crate::{Handle, Region};

    /// The fields of two handles, one of them soft, and of what is fixed, in the three columns: between 0 and 1, of sum 1, and on a
    /// flat grid between its ends linear.
    #[test]
    fn fields_are_between_nought_and_one_and_sum_up_to_one() {
        let flat = shapes::plane_grid(12, 4, 3.0, 1.0).expect("valid size");
        let sphere = shapes::icosphere(3);
        for (mesh, is_flat) in [(&flat, true), (&sphere, false)] {
            let (n, bounds) = (mesh.vertex_count(), mesh.bounds());
            let at = |v: u32| bounds.to_box(mesh.positions[v as usize]).x;
            let end = |low: f64, high: f64| VertexSet::where_true(n, |v| (low..=high).contains(&at(v)));
            let roi = VertexSet::where_true(n, |v| is_flat || at(v) < 0.8);
            for soft in [false, true] {
                let second = end(0.55, if is_flat { 1.0 } else { 0.7 });
                let second = if soft { Handle::soft(second, 3.0) } else { Handle::hard(second) };
                let region = Region::new(n, &roi, &[Handle::hard(end(0.0, 0.05)), second]).expect("valid");
                let patch = Patch::new(mesh, &region, 2).expect("valid");
                for kind in [EdgeWeightKind::Uniform, EdgeWeightKind::Cotangent] {
                    let mut harmonic = Harmonic::new(&patch, kind).expect("held");
                    let own = |held: &Held| match held.handle() {
                        Some(handle) => std::array::from_fn(|c| f64::from(u8::from(c == handle as usize))),
                        None => [0.0, 0.0, 1.0],
                    };
                    let mut values: Vec<[f64; 3]> = patch.held.iter().map(own).collect();
                    harmonic.interpolate(&mut values).expect("solvable");
                    let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
                    for (k, value) in values.iter().enumerate() {
                        assert!(close(value.iter().sum(), 1.0), "{value:?}");
                        assert!(value.iter().all(|x| (-1e-12..=1.0 + 1e-12).contains(x)), "{value:?}");
                        let x = at(patch.vertices[k]);
                        // Up to the column of vertices at 7/12, where the second handle begins. The diagonals of the squares have
                        // a thousandth of a weight instead of none.
                        if is_flat && !soft && kind == EdgeWeightKind::Cotangent && x < 0.58 {
                            assert!((value[1] - x * 12.0 / 7.0).abs() < 1e-3, "{x}: {value:?}");
                        }
                    }
                }
            }
        }
    }
}
