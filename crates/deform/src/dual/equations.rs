//! The rows of the least-squares system, and what they are to be equal to.

use glam::{DMat3, DVec3};
use pliant_linalg::{LinalgError, SparseRows};
use pliant_mesh::threads::{CHUNK, for_each_chunk};
use pliant_mesh::{best_rotation, outer};

use super::stencil::{Detail, Stencil, barycentre, dual_neighbours, dual_normal};
use super::{DualLaplacianOptions, Heights};
use crate::patch::{Held, Patch};

/// The rows: first those of stencils, then those of rings, then those of springs.
#[derive(Debug)]
pub(super) struct Equations {
    stencils: Vec<Stencil>,
    rings: Vec<Ring>,
    springs: Vec<Spring>,
    heights: Heights,
    /// Barycentres of the patch's faces at rest.
    rest_dual: Vec<DVec3>,
}

/// The uniform Laplacian of a vertex, `v_i - mean_j v_j`.
#[derive(Debug)]
struct Ring {
    vertex: u32,
    /// Its value at rest.
    rest: DVec3,
    /// What the row is multiplied by: the root of its weight.
    factor: f64,
}

/// A vertex of a soft handle.
#[derive(Debug)]
pub(super) struct Spring {
    pub(super) vertex: u32,
    /// As [`crate::Constraint::Soft`] has it.
    pub(super) weight: f64,
    /// What the row is multiplied by.
    factor: f64,
}

impl Equations {
    /// The rows with an unknown in them, and the matrix `A`: a column for each vertex of `patch`, which has three rings or more.
    pub(super) fn new(options: &DualLaplacianOptions, patch: &Patch) -> Result<(Self, SparseRows), LinalgError> {
        let (topology, rest) = (patch.mesh.topology(), &patch.mesh.positions);
        let rest_dual: Vec<DVec3> = (0..patch.mesh.face_count()).map(|face| barycentre(topology, rest, face)).collect();
        let mut a = SparseRows::new(rest.len());
        let mut stencils = Vec::new();
        // Vertices of faces without a stencil.
        let mut is_border = vec![false; rest.len()];
        let is_unknown = |v: &u32| patch.held[*v as usize].is_unknown();
        let mut row = Vec::new();
        for (face, corners) in topology.triangles().iter().enumerate() {
            let Some(neighbours) = dual_neighbours(topology, face) else {
                corners.iter().for_each(|&v| is_border[v as usize] = true);
                continue;
            };
            let stencil = Stencil::new(face, neighbours, &rest_dual);
            row.clear();
            row.extend(corners.map(|v| (v, 1.0 / 3.0)));
            for (&j, w) in stencil.neighbours.iter().zip(stencil.weights) {
                row.extend(topology.triangles()[j as usize].map(|v| (v, -w / 3.0)));
            }
            if row.iter().any(|(v, _)| is_unknown(v)) {
                a.push_row(merged(&mut row))?;
                stencils.push(stencil);
            }
        }
        let mut rings = Vec::new();
        for (vertex, is_border) in (0u32..).zip(is_border) {
            let neighbours = topology.neighbours(vertex as usize);
            let factor = if is_border { 1.0 } else { options.primal_weight.sqrt() };
            if factor == 0.0 || neighbours.is_empty() || !neighbours.iter().chain([&vertex]).any(is_unknown) {
                continue;
            }
            let share = 1.0 / neighbours.len() as f64;
            let mean = share * neighbours.iter().map(|&j| rest[j as usize]).sum::<DVec3>();
            rings.push(Ring { vertex, rest: rest[vertex as usize] - mean, factor });
            row.clear();
            row.push((vertex, factor));
            row.extend(neighbours.iter().map(|&j| (j, -factor * share)));
            a.push_row(row.iter().copied())?;
        }
        let unit = mean_diagonal(&a, patch).sqrt();
        let mut springs = Vec::new();
        for (vertex, held) in (0u32..).zip(&patch.held) {
            if let Held::Spring { weight, .. } = *held {
                let factor = weight.sqrt() * unit;
                springs.push(Spring { vertex, weight, factor });
                a.push_row([(vertex, factor)])?;
            }
        }
        Ok((Self { stencils, rings, springs, heights: options.heights, rest_dual }, a))
    }

    pub(super) fn springs(&self) -> &[Spring] {
        &self.springs
    }

    /// What the rows are equal to at rest; springs are drawn to 0.
    pub(super) fn at_rest(&self) -> Vec<[f64; 3]> {
        let detail = |stencil: &Stencil| match stencil.detail {
            Detail::Vector(rest) => rest,
            Detail::Height(_) => stencil.difference(&self.rest_dual),
        };
        let stencils = self.stencils.iter().map(detail);
        let rings = self.rings.iter().map(|ring| ring.factor * ring.rest);
        let springs = self.springs.iter().map(|_| DVec3::ZERO);
        stencils.chain(rings).chain(springs).map(DVec3::into).collect()
    }

    /// Draws the springs to their goals.
    pub(super) fn draw_springs(&self, goals: &[DVec3], b: &mut [[f64; 3]]) {
        let first = self.stencils.len() + self.rings.len();
        for (b, spring) in b[first..].iter_mut().zip(&self.springs) {
            *b = (spring.factor * goals[spring.vertex as usize]).into();
        }
    }

    /// Turns the details with `pose` (Eq. 9 and 10); `dual` has a place for each face of the patch.
    ///
    /// Where three dual vertices of `pose` lie on a line, the detail keeps the direction it has in `b`.
    pub(super) fn turn_details(&self, patch: &Patch, pose: &[DVec3], dual: &mut [DVec3], b: &mut [[f64; 3]]) {
        let (topology, rest) = (patch.mesh.topology(), &patch.mesh.positions);
        for_each_chunk(dual, |chunk, dual| {
            for (face, dual) in (chunk * CHUNK..).zip(dual) {
                *dual = barycentre(topology, pose, face);
            }
        });
        let dual = &*dual;
        let (faces, others) = b.split_at_mut(self.stencils.len());
        for_each_chunk(faces, |chunk, b| {
            for (stencil, b) in self.stencils[chunk * CHUNK..].iter().zip(b) {
                let detail = match stencil.detail {
                    Detail::Vector(detail) => {
                        Some(stencil.rotation(topology, (rest, &self.rest_dual), (pose, dual)) * detail)
                    }
                    Detail::Height(height) => dual_normal(stencil.around(dual)).map(|normal| match self.heights {
                        Heights::Kept => height * normal,
                        Heights::Recomputed => stencil.difference(dual).dot(normal) * normal,
                    }),
                };
                if let Some(detail) = detail {
                    *b = detail.into();
                }
            }
        });
        for_each_chunk(&mut others[..self.rings.len()], |chunk, b| {
            for (ring, b) in self.rings[chunk * CHUNK..].iter().zip(b) {
                let i = ring.vertex as usize;
                let s = topology
                    .neighbours(i)
                    .iter()
                    .fold(DMat3::ZERO, |s, &j| s + outer(pose[j as usize] - pose[i], rest[j as usize] - rest[i]));
                *b = (ring.factor * (best_rotation(s) * ring.rest)).into();
            }
        });
    }
}

/// Sorted by column, with equal columns added up.
fn merged(row: &mut Vec<(u32, f64)>) -> impl Iterator<Item = (u32, f64)> + '_ {
    row.sort_by_key(|&(column, _)| column);
    row.chunk_by(|p, q| p.0 == q.0).map(|same| (same[0].0, same.iter().map(|(_, value)| value).sum()))
}

/// The mean diagonal entry of `A^T A` over the unknowns; 1 where there is no row, as any will do then.
fn mean_diagonal(a: &SparseRows, patch: &Patch) -> f64 {
    let entries = a.columns().iter().zip(a.values());
    let unknown = entries.filter(|(v, _)| patch.held[**v as usize].is_unknown());
    let sum: f64 = unknown.map(|(_, value)| value * value).sum();
    if sum > 0.0 { sum / patch.unknown_count() as f64 } else { 1.0 }
}
