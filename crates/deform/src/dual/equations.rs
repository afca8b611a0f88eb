//! The rows of the least-squares system, and what they are to be equal to.

use glam::{DMat3, DVec3};
use pliant_linalg::{LinalgError, SparseRows};
use pliant_mesh::threads::{CHUNK, for_each_chunk};
use pliant_mesh::{best_rotation, outer};

use super::stencil::{Detail, Stencil, barycentre, dual_neighbours, dual_normal};
use super::{DualHeights, DualLaplacianOptions};
use crate::patch::{Held, Patch};

/// The rows: first those of stencils, then those of rings, then those of springs.
#[derive(Debug)]
pub(super) struct Equations {
    stencils: Vec<Stencil>,
    rings: Vec<Ring>,
    springs: Vec<Spring>,
    heights: DualHeights,
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
                        DualHeights::Kept => height * normal,
                        DualHeights::Recomputed => stencil.difference(dual).dot(normal) * normal,
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
fn merged(row: &mut [(u32, f64)]) -> impl Iterator<Item = (u32, f64)> + '_ {
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

#[cfg(test)]
mod tests {
    use pliant_linalg::LeastSquares;
    use pliant_mesh::{TriMesh, VertexSet, shapes};

    use super::*;
    use crate::Region;
    use crate::dual::deformer::RINGS;

    /// The system with everything free but one vertex.
    fn held_at_one(mesh: &TriMesh, primal_weight: f64) -> (Patch, Equations, SparseRows) {
        let n = mesh.vertex_count();
        let region = Region::new(n, &VertexSet::where_true(n, |v| v != 0), &[]).expect("one is fixed");
        let patch = Patch::new(mesh, &region, RINGS).expect("connected");
        let options = DualLaplacianOptions { primal_weight, ..DualLaplacianOptions::default() };
        let (equations, a) = Equations::new(&options, &patch).expect("small");
        (patch, equations, a)
    }

    fn solve(patch: &Patch, equations: &Equations, a: SparseRows) -> Result<Vec<DVec3>, LinalgError> {
        let mut x = vec![[0.0; 3]; patch.vertices.len()];
        x[0] = patch.mesh.positions[0].into();
        LeastSquares::new(a, |v| v != 0)?.solve(&equations.at_rest(), &mut x)?;
        Ok(x.into_iter().map(DVec3::from).collect())
    }

    /// Luo et al., section 2: "given the original dual Laplacian coordinates and one fixed primal vertex, we can get the rest of the
    /// vertex positions without error". The icosphere's twelve vertices of valence 5 keep it from being coloured with three colours.
    #[test]
    fn one_fixed_vertex_gives_back_the_mesh_and_its_dual() {
        let closed = [shapes::icosphere(2), shapes::icosphere(4), shapes::cactus(1500).expect("in range")];
        let open = shapes::bumpy_plane(20, 12, 2.0, 1.0, 0.2, 3).expect("valid size");
        for (mesh, primal_weight) in closed.iter().map(|mesh| (mesh, 0.0)).chain([(&open, 0.01), (&closed[2], 0.01)]) {
            let (patch, equations, a) = held_at_one(mesh, primal_weight);
            assert_eq!(primal_weight == 0.0, equations.rings.is_empty());
            let solution = solve(&patch, &equations, a).expect("full rank");
            let off = solution.iter().zip(&patch.mesh.positions).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max);
            // The condition number of A is about the number of vertices, some thousand.
            assert!(off < 1e-11, "{}: {off:e}", mesh.vertex_count());
            for (face, rest) in equations.rest_dual.iter().enumerate() {
                assert!(barycentre(patch.mesh.topology(), &solution, face).distance(*rest) < 1e-11);
            }
        }
    }

    /// Three vectors of sum 0, one a colour, move no barycentre: `D` has not the rank that Luo et al. give it, and with it `A`.
    #[test]
    fn a_mesh_of_three_colours_needs_the_rows_of_its_vertices() {
        // All valences of a torus of 6 x 3 quads, each cut along the same diagonal, are 6; colours are `(i - j) mod 3`.
        let torus = shapes::torus(1.0, 0.4, 6, 3).expect("valid size");
        let colour = coloured(&torus).expect("has three colours");
        let (patch, equations, a) = held_at_one(&torus, 0.0);
        let pattern: Vec<[f64; 3]> =
            colour.iter().map(|&c| [[1.0, 2.0, 0.0], [0.0, -3.0, 1.0], [-1.0, 1.0, -1.0]][c]).collect();
        let mut product = vec![[1.0; 3]; a.row_count()];
        a.multiply(&pattern, &mut product).expect("fits");
        assert!(product.iter().flatten().all(|x| x.abs() < 1e-14));
        let error = solve(&patch, &equations, a).expect_err("singular");
        assert!(matches!(error, LinalgError::NotPositiveDefinite { .. }), "{error}");
        let (patch, equations, a) = held_at_one(&torus, 0.01);
        let solution = solve(&patch, &equations, a).expect("full rank");
        assert!(solution.iter().zip(&patch.mesh.positions).all(|(p, q)| p.distance(*q) < 1e-12));
        assert_eq!(coloured(&shapes::icosphere(1)), None);
    }

    /// Three colours such that no face has one twice, if there are.
    fn coloured(mesh: &TriMesh) -> Option<Vec<usize>> {
        let mut colour = vec![usize::MAX; mesh.vertex_count()];
        for (k, &v) in mesh.triangles()[0].iter().enumerate() {
            colour[v as usize] = k;
        }
        for _ in 0..mesh.face_count() {
            for t in mesh.triangles() {
                for k in 0..3 {
                    let [a, b, c] = [0, 1, 2].map(|i| t[(k + i) % 3] as usize);
                    if colour[a].max(colour[b]) < 3 && colour[a] != colour[b] {
                        let third = 3 - colour[a] - colour[b];
                        if colour[c] < 3 && colour[c] != third {
                            return None;
                        }
                        colour[c] = third;
                    }
                }
            }
        }
        Some(colour)
    }

    /// Right-hand sides that no positions meet, by elimination of the full normal equations.
    #[test]
    fn the_sparse_solution_is_the_dense_one() {
        let mesh = shapes::bumpy_plane(7, 5, 2.0, 1.0, 0.3, 2).expect("valid size");
        let (patch, equations, a) = held_at_one(&mesh, 0.01);
        let n = patch.vertices.len();
        let mut b = equations.at_rest();
        for (k, b) in b.iter_mut().enumerate() {
            *b = (DVec3::from(*b) + 0.1 * DVec3::new((k as f64).sin(), (2.0 * k as f64).cos(), (3.0 * k as f64).sin()))
                .into();
        }
        let mut x = vec![[0.0; 3]; n];
        x[0] = patch.mesh.positions[0].into();
        LeastSquares::new(a.clone(), |v| v != 0).expect("full rank").solve(&b, &mut x).expect("solvable");
        // Rows `[N | A^T b]`, with that of the held vertex replaced by its value.
        let mut dense = vec![vec![0.0; n + 3]; n];
        for (row, b) in b.iter().enumerate() {
            let (columns, values) = a.row(row);
            for (&i, p) in columns.iter().zip(values) {
                for (&j, q) in columns.iter().zip(values) {
                    dense[i as usize][j as usize] += p * q;
                }
                (0..3).for_each(|c| dense[i as usize][n + c] += p * b[c]);
            }
        }
        dense[0] = (0..n + 3).map(|j| if j < n { f64::from(j == 0) } else { x[0][j - n] }).collect();
        for k in 0..n {
            let pivot = (k..n).max_by(|&i, &j| dense[i][k].abs().total_cmp(&dense[j][k].abs())).expect("k < n");
            dense.swap(k, pivot);
            let row = dense[k].clone();
            for other in (0..n).filter(|&other| other != k) {
                let factor = dense[other][k] / row[k];
                dense[other].iter_mut().zip(&row).for_each(|(x, y)| *x -= factor * y);
            }
        }
        let size = x.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        for (k, x) in x.iter().enumerate() {
            // The condition number of the normal equations is below 1e6.
            assert!((0..3).all(|c| (dense[k][n + c] / dense[k][k] - x[c]).abs() < 1e-9 * size), "{k}");
        }
    }

    /// The rows do to any positions what their definitions say, and so do their right-hand sides at rest.
    #[test]
    fn rows_are_what_they_are_defined_to_be() {
        let mesh = shapes::bumpy_plane(8, 6, 2.0, 1.0, 0.3, 2).expect("valid size");
        let (patch, equations, a) = held_at_one(&mesh, 0.25);
        let pose: Vec<DVec3> = (0..mesh.vertex_count() as u32)
            .map(|v| DVec3::new((1.3 * f64::from(v)).sin(), (0.7 * f64::from(v)).cos(), (2.1 * f64::from(v)).sin()))
            .collect();
        let topology = patch.mesh.topology();
        let x: Vec<[f64; 3]> = pose.iter().map(|&p| p.into()).collect();
        let mut ax = vec![[0.0; 3]; a.row_count()];
        a.multiply(&x, &mut ax).expect("fits");
        let dual: Vec<DVec3> = (0..mesh.face_count()).map(|f| barycentre(topology, &pose, f)).collect();
        for (stencil, ax) in equations.stencils.iter().zip(&ax) {
            assert!(stencil.difference(&dual).distance(DVec3::from(*ax)) < 1e-13 * 20.0);
        }
        let borders = topology.boundary_vertices();
        for (ring, ax) in equations.rings.iter().zip(&ax[equations.stencils.len()..]) {
            let around = topology.neighbours(ring.vertex as usize);
            let mean = around.iter().map(|&j| pose[j as usize]).sum::<DVec3>() / around.len() as f64;
            // The border's faces have no stencil, nor their third corners a full set of them.
            let on_border_face = topology.vertex_faces(ring.vertex as usize).iter();
            let mut on_border_face = on_border_face.flat_map(|&f| topology.triangles()[f as usize]);
            let factor = if on_border_face.any(|v| borders[v as usize]) { None } else { Some(0.5) };
            assert!(factor.is_none_or(|factor| ring.factor == factor));
            assert!(borders[ring.vertex as usize] <= (ring.factor == 1.0));
            let expected = ring.factor * (pose[ring.vertex as usize] - mean);
            assert!(expected.distance(DVec3::from(*ax)) < 1e-13);
        }
        // At rest both sides agree.
        let rest: Vec<[f64; 3]> = patch.mesh.positions.iter().map(|&p| p.into()).collect();
        a.multiply(&rest, &mut ax).expect("fits");
        assert!(ax.iter().zip(equations.at_rest()).all(|(p, q)| DVec3::from(*p).distance(q.into()) < 1e-14));
        assert_eq!(equations.rings.len(), mesh.vertex_count());
    }
}
