//! The cells of the energy, laid out flat for the local and the global step.

use glam::DVec3;
use pliant_linalg::{LinalgError, SpdPattern};
use pliant_mesh::threads::for_each_row;
use rayon::prelude::*;

use super::shape::Shape;

/// No slot.
pub(crate) const NONE: u32 = u32::MAX;

/// One edge of the energy and the cells that count it.
pub(crate) struct Term {
    pub(crate) ends: [u32; 2],
    /// Slots of cells, [`NONE`] for a cell that is left out.
    pub(crate) cells: [u32; 3],
    pub(crate) weight: f64,
}

/// What a neighbour's cell contributes to the equation of a vertex: the rest vector that the neighbour's rotation is applied to, and the weight
/// of the edge between the two in the matrix.
pub(crate) type Pull = [f64; 4];

/// The part of the mesh that an edit of a region of interest can reach, renumbered: *slots* `0..roi` are the region, whatever
/// the roles of its vertices; slots `..cells` have a rotation (they are in the region or next to it), and the remaining ones are only
/// looked at by those cells.
///
/// The energy of the cell of `i` is a sum over its edges `w |(p'_p - p'_q) - R_i (p_p - p_q)|^2`. For both energies
/// the best `R_i` comes from `S_i = sum_j (p'_j - p'_i) c_ij^T` over the neighbours `j`, where `c_ij = sum_q w (p_j -
/// p_q)` runs over the cell's edges at `j`; and setting the derivative with respect to `p'_j` to zero gives the row
/// `(L p')_j = sum_i R_i c_ij / m` over the cells `i` that contain `j`, `m` being the multiplicity. Spokes alone make
/// this Sorkine and Alexa's (2007) Eq. 5 and 8, since there `c_ij = w_ij (p_j - p_i)`.
pub(crate) struct Cells {
    /// Mesh vertex of each slot; increasing within the three ranges.
    pub(crate) vertices: Vec<u32>,
    pub(crate) roi: usize,
    pub(crate) cells: usize,
    /// Row `i` of the lists below is `offsets[i]..offsets[i + 1]`.
    offsets: Vec<u32>,
    /// Slots next to each cell's, by increasing vertex.
    neighbours: Vec<u32>,
    /// `c_ij` for the neighbours `j` of each cell `i`.
    covariance: Vec<[f64; 3]>,
    /// `c_ij / m` for the neighbours `i` of each vertex `j` of the region, and the weight.
    pulls: Vec<Pull>,
    /// `c_jj / m` for each vertex of the region.
    own_pull: Vec<[f64; 3]>,
    /// What the difference of rotations to each neighbour counts, see [`Shape::smoothing`]; empty if it does not.
    smoothing: Vec<f64>,
}

impl Cells {
    /// `roi` are mesh vertices, increasing.
    pub(crate) fn new(shape: &Shape, roi: &[u32]) -> Self {
        let (vertices, slot, cells) = number(shape, roi);
        let mut layout = Self {
            vertices,
            roi: roi.len(),
            cells,
            offsets: vec![0],
            neighbours: Vec::new(),
            covariance: Vec::new(),
            pulls: Vec::new(),
            own_pull: Vec::new(),
            smoothing: Vec::new(),
        };
        layout.fill_neighbours(shape, &slot);
        layout.fill_smoothing(shape);
        layout.fill_covariance(shape);
        layout.fill_pulls(shape);
        layout
    }

    /// Slots next to the slot of a cell.
    #[inline(always)]
    pub(crate) fn neighbours(&self, cell: usize) -> &[u32] {
        &self.neighbours[self.row(cell)]
    }

    /// `c_ij`, parallel to [`Self::neighbours`].
    #[inline(always)]
    pub(crate) fn covariance(&self, cell: usize) -> &[[f64; 3]] {
        &self.covariance[self.row(cell)]
    }

    /// Parallel to [`Self::neighbours`], for a slot of the region; and its own rest vector.
    #[inline(always)]
    pub(crate) fn pulls(&self, slot: usize) -> (&[Pull], [f64; 3]) {
        (&self.pulls[self.row(slot)], self.own_pull[slot])
    }

    /// Parallel to [`Self::neighbours`]; empty if rotations are not smoothed.
    #[inline(always)]
    pub(crate) fn smoothing(&self, cell: usize) -> &[f64] {
        self.smoothing.get(self.row(cell)).unwrap_or_default()
    }

    #[inline(always)]
    fn row(&self, cell: usize) -> std::ops::Range<usize> {
        self.offsets[cell] as usize..self.offsets[cell + 1] as usize
    }

    fn fill_neighbours(&mut self, shape: &Shape, slot: &[u32]) {
        let topology = shape.topology();
        let vertices = &self.vertices[..self.cells];
        let mut end = 0;
        self.offsets.extend(vertices.iter().map(|&v| {
            end += topology.neighbours(v as usize).len() as u32;
            end
        }));
        self.neighbours = vec![0; end as usize];
        for_each_row(&self.offsets, &mut self.neighbours, |cell, slots| {
            let ring = topology.neighbours(vertices[cell] as usize);
            slots.iter_mut().zip(ring).for_each(|(to, &v)| *to = slot[v as usize]);
        });
    }

    fn fill_smoothing(&mut self, shape: &Shape) {
        if shape.smoothing > 0.0 {
            let edges = self.vertices[..self.cells].iter().flat_map(|&v| shape.topology().neighbour_edges(v as usize));
            self.smoothing = edges.map(|&e| shape.smoothing * shape.edges[e as usize]).collect();
        }
    }

    /// Each spoke is the only edge of its cell at its outer end, so everything follows from its rest vector.
    fn spokes(&self, shape: &Shape, cell: usize, sums: &mut [[f64; 3]]) {
        let topology = shape.topology();
        let v = self.vertices[cell] as usize;
        let centre = shape.inner[v];
        for ((sum, &j), &e) in sums.iter_mut().zip(topology.neighbours(v)).zip(topology.neighbour_edges(v)) {
            *sum = (shape.edges[e as usize] * (shape.inner[j as usize] - centre)).to_array();
        }
    }

    fn spokes_and_rims(&self, shape: &Shape, faces: &[[f64; 3]], cell: usize, sums: &mut [[f64; 3]]) {
        let topology = shape.topology();
        let v = self.vertices[cell] as usize;
        let ring = topology.neighbours(v);
        for &face in topology.vertex_faces(v) {
            let (t, weights) = (topology.triangles()[face as usize], faces[face as usize]);
            let Some(k) = t.iter().position(|&corner| corner as usize == v) else { continue };
            // Opposite to the centre, opposite to `p`, and opposite to `q`.
            let [centre, p, q] = [0, 1, 2].map(|turn| (k + turn) % 3);
            let [x, y, z] = [centre, p, q].map(|corner| shape.inner[t[corner] as usize]);
            let [rim, at_q, at_p] = [weights[centre] * (y - z), weights[p] * (z - x), weights[q] * (y - x)];
            // What is summed at the centre is never needed: it multiplies p'_i - p'_i.
            for (end, pull) in [(p, rim + at_p), (q, at_q - rim)] {
                if let Ok(at) = ring.binary_search(&t[end]) {
                    sums[at] = (DVec3::from(sums[at]) + pull).to_array();
                }
            }
        }
    }

    fn fill_covariance(&mut self, shape: &Shape) {
        let mut covariance = vec![[0.0; 3]; self.neighbours.len()];
        for_each_row(&self.offsets, &mut covariance, |cell, sums| match &shape.faces {
            None => self.spokes(shape, cell, sums),
            Some(faces) => self.spokes_and_rims(shape, &faces.values, cell, sums),
        });
        self.covariance = covariance;
    }

    /// Gathers for each vertex of the region what the cells next to it have for it.
    fn fill_pulls(&mut self, shape: &Shape) {
        let topology = shape.topology();
        let m = shape.multiplicity();
        let mut pulls = vec![Pull::default(); self.offsets[self.roi] as usize];
        for_each_row(&self.offsets[..=self.roi], &mut pulls, |slot, pulls| {
            let j = self.vertices[slot];
            let edges = topology.neighbour_edges(j as usize);
            for ((pull, &cell), &e) in pulls.iter_mut().zip(self.neighbours(slot)).zip(edges) {
                let ring = topology.neighbours(self.vertices[cell as usize] as usize);
                // Neighbourhood is symmetric, so the vertex is in its neighbour's ring.
                let back = self.offsets[cell as usize] as usize + ring.partition_point(|&v| v < j);
                let [x, y, z] = self.covariance[back].map(|c| c / m);
                *pull = [x, y, z, shape.edges[e as usize]];
            }
        });
        let own = |slot: usize| {
            let outward: DVec3 = self.covariance(slot).iter().map(|&c| DVec3::from(c)).sum();
            (-outward / m).to_array()
        };
        self.own_pull = (0..self.roi).into_par_iter().map(own).collect();
        self.pulls = pulls;
    }

    /// The sum of the weights at a slot of the region: its diagonal entry in the Laplacian.
    pub(crate) fn diagonal(&self, slot: usize) -> f64 {
        self.pulls(slot).0.iter().map(|[.., weight]| weight).sum()
    }

    /// Numbers connected pieces of the slots, from 0, without those that are left out ([`NONE`]).
    pub(crate) fn pieces(&self, is_out: impl Fn(usize) -> bool) -> Vec<u32> {
        let mut piece = vec![NONE; self.vertices.len()];
        let (mut next, mut stack) = (0, Vec::new());
        for seed in 0..piece.len() {
            if piece[seed] != NONE || is_out(seed) {
                continue;
            }
            piece[seed] = next;
            stack.push(seed);
            while let Some(slot) = stack.pop() {
                // All others are next to a cell, from which they are reached.
                for &other in if slot < self.cells { self.neighbours(slot) } else { &[] } {
                    if piece[other as usize] == NONE && !is_out(other as usize) {
                        piece[other as usize] = next;
                        stack.push(other as usize);
                    }
                }
            }
            next += 1;
        }
        piece
    }

    /// Order and symbolic factor of the Laplacian of the region, whatever its roles.
    pub(crate) fn pattern(&self) -> Result<SpdPattern, LinalgError> {
        let mut col_ptr = vec![0];
        let mut row_idx = Vec::with_capacity(self.roi + self.offsets[self.roi] as usize / 2);
        for slot in 0..self.roi as u32 {
            // Slots of the region increase with their vertices, so these do.
            row_idx.extend(self.neighbours(slot as usize).iter().filter(|&&other| other < slot));
            row_idx.push(slot);
            col_ptr.push(row_idx.len() as u32);
        }
        SpdPattern::of_columns(col_ptr, row_idx)
    }

    /// The entries of the Laplacian in the order of [`Self::pattern`]; `diagonal` has the diagonal ones.
    pub(crate) fn laplacian<'a>(&'a self, diagonal: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        (0..self.roi as u32).zip(diagonal).flat_map(|(slot, &diagonal)| {
            let row = self.neighbours(slot as usize).iter().zip(self.pulls(slot as usize).0);
            let before = row.filter(move |&(&other, _)| other < slot).map(|(_, [.., weight])| -weight);
            before.chain(std::iter::once(diagonal))
        })
    }

    /// The edges of the energy that cells count.
    pub(crate) fn terms(&self, shape: &Shape) -> Vec<Term> {
        let mut terms = Vec::new();
        self.for_each_term(shape, |term| terms.push(term));
        terms
    }

    /// Calls `each` with the edges of the energy that cells count.
    pub(crate) fn for_each_term(&self, shape: &Shape, mut each: impl FnMut(Term)) {
        let topology = shape.topology();
        let mut slot = vec![NONE; topology.vertex_count()];
        for (s, &v) in (0..).zip(&self.vertices) {
            slot[v as usize] = s;
        }
        let cell_of = |v: u32| if slot[v as usize] < self.cells as u32 { slot[v as usize] } else { NONE };
        let mut add = |p: u32, q: u32, weight: f64, cells: [u32; 3]| {
            if cells.iter().any(|&c| c != NONE) {
                // Next to a cell, so both have slots.
                each(Term { ends: [slot[p as usize], slot[q as usize]], cells, weight });
            }
        };
        match &shape.faces {
            None => {
                for (&[p, q], &w) in topology.edges().iter().zip(&shape.edges) {
                    add(p, q, w, [cell_of(p), cell_of(q), NONE]);
                }
            }
            Some(faces) => {
                for (t, weights) in topology.triangles().iter().zip(&faces.values) {
                    for (k, &w) in weights.iter().enumerate() {
                        add(t[(k + 1) % 3], t[(k + 2) % 3], w, t.map(cell_of));
                    }
                }
            }
        }
    }
}

/// Vertices by slot, slots by vertex ([`NONE`] where there is none), and the number of cells.
fn number(shape: &Shape, roi: &[u32]) -> (Vec<u32>, Vec<u32>, usize) {
    let topology = shape.topology();
    let mut slot = vec![NONE; topology.vertex_count()];
    let mut vertices = roi.to_vec();
    for (k, &v) in roi.iter().enumerate() {
        slot[v as usize] = k as u32;
    }
    // One ring more twice: first to the other cells, then to what those look at.
    let mut cells = 0;
    for _ in 0..2 {
        let inner = std::mem::replace(&mut cells, vertices.len());
        let mut ring = Vec::new();
        for &v in &vertices[inner..] {
            for &w in topology.neighbours(v as usize) {
                if slot[w as usize] == NONE {
                    slot[w as usize] = 0;
                    ring.push(w);
                }
            }
        }
        ring.sort_unstable();
        for v in ring {
            slot[v as usize] = vertices.len() as u32;
            vertices.push(v);
        }
    }
    (vertices, slot, cells)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use pliant_mesh::{TriMesh, shapes};

    use super::*;
    use crate::arap::{ArapEnergy, ArapOptions};
    use crate::operators::laplacian;

    fn shapes() -> Vec<TriMesh> {
        let bar = shapes::bar(5, 2, 2, DVec3::new(3.0, 1.0, 1.0)).expect("valid size");
        vec![shapes::icosphere(2), bar, shapes::bumpy_plane(9, 7, 1.0, 1.0, 0.2, 1).expect("valid size")]
    }

    fn laid_out(mesh: &TriMesh, energy: ArapEnergy, roi: &[u32]) -> (Shape, Cells) {
        let shape = Shape::new(&ArapOptions { energy, ..ArapOptions::default() }, mesh).expect("finite");
        let cells = Cells::new(&shape, roi);
        (shape, cells)
    }

    /// Column by column the same entries as edge by edge.
    #[test]
    fn the_matrix_of_the_region_is_a_block_of_the_laplacian() {
        for mesh in shapes() {
            let n = mesh.vertex_count() as u32;
            for roi in [(0..n).collect::<Vec<u32>>(), (0..n).filter(|v| v % 5 != 1).collect()] {
                for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
                    let (shape, cells) = laid_out(&mesh, energy, &roi);
                    let diagonal: Vec<f64> = (0..roi.len()).map(|slot| cells.diagonal(slot)).collect();
                    let mut block = BTreeMap::new();
                    for t in laplacian(shape.topology(), &shape.edges) {
                        let slots = [t.row, t.col].map(|v| roi.binary_search(&v).ok());
                        if let [Some(row), Some(col)] = slots {
                            *block.entry((row.max(col), row.min(col))).or_insert(0.0) += t.value;
                        }
                    }
                    let values: Vec<f64> = cells.laplacian(&diagonal).collect();
                    assert_eq!(values.len(), block.len());
                    for (value, (place, expected)) in values.iter().zip(&block) {
                        assert!((value - expected).abs() <= 1e-14 * expected.abs(), "{place:?}: {value} {expected}");
                    }
                    assert_eq!(cells.pattern().expect("small").unknowns(), roi.len());
                }
            }
        }
    }

    /// At rest, with all rotations the identity, nothing pulls: `L p = sum c_ij / m`. And a covariance is that of the rest edges.
    #[test]
    fn rest_is_in_equilibrium() {
        for mesh in shapes() {
            let roi: Vec<u32> = (0..mesh.vertex_count() as u32).collect();
            for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
                let (shape, cells) = laid_out(&mesh, energy, &roi);
                let at = |slot: u32| shape.inner[cells.vertices[slot as usize] as usize];
                for slot in 0..cells.roi {
                    let (pulls, own) = cells.pulls(slot);
                    let mut residual = DVec3::from(own);
                    for (&other, &[x, y, z, weight]) in cells.neighbours(slot).iter().zip(pulls) {
                        residual += DVec3::new(x, y, z) - weight * (at(slot as u32) - at(other));
                    }
                    assert!(residual.length() <= 1e-14 * cells.diagonal(slot), "{energy:?}: {residual}");
                    // trace S = sum w |e|^2 over the edges of the cell, so it is positive.
                    let edges = cells.neighbours(slot).iter().zip(cells.covariance(slot));
                    let trace: f64 = edges.map(|(&j, c)| (at(j) - at(slot as u32)).dot(DVec3::from(*c))).sum();
                    assert!(trace > 0.0);
                }
            }
        }
    }
}
