//! The cells of the energy, laid out flat for the local and the global step.

use glam::DVec3;
use pliant_mesh::Topology;

use crate::operators::FaceWeights;

/// No cell.
pub(super) const NONE: u32 = u32::MAX;

/// Which edges belong to the cell of a vertex, and their weights.
pub(super) enum CellEdges {
    /// The edges at the vertex; one weight per edge of the mesh.
    Spokes(Vec<f64>),
    /// The edges of the faces round the vertex, each once per face.
    SpokesAndRims(FaceWeights),
}

impl CellEdges {
    /// In how many cells each share of an edge's weight is counted: both ends, or the three corners of a face.
    pub(super) fn multiplicity(&self) -> f64 {
        match self {
            Self::Spokes(_) => 2.0,
            Self::SpokesAndRims(_) => 3.0,
        }
    }

    /// The edges `(p, q, weight)` of the cell of vertex `i`.
    fn for_each(&self, topology: &Topology, i: usize, mut edge: impl FnMut(u32, u32, f64)) {
        match self {
            Self::Spokes(weights) => {
                for (&j, &e) in topology.neighbours(i).iter().zip(topology.neighbour_edges(i)) {
                    edge(i as u32, j, weights[e as usize]);
                }
            }
            Self::SpokesAndRims(faces) => {
                for &face in topology.vertex_faces(i) {
                    let t = topology.triangles()[face as usize];
                    for (k, &w) in faces.values[face as usize].iter().enumerate() {
                        edge(t[(k + 1) % 3], t[(k + 2) % 3], w);
                    }
                }
            }
        }
    }
}

/// One edge of the energy and the cells that count it.
pub(super) struct Term {
    pub(super) ends: [u32; 2],
    /// Slots of cells, [`NONE`] for a cell that is left out.
    pub(super) cells: [u32; 3],
    pub(super) weight: f64,
}

/// What a neighbour's cell contributes to the equation of an unknown.
#[derive(Clone, Copy)]
pub(super) struct Pull {
    /// Rest vector that the neighbour's rotation is applied to.
    pub(super) rest: DVec3,
    /// Weight of the edge between the two in the matrix.
    pub(super) weight: f64,
}

/// The part of the mesh that an edit can reach, renumbered: *slots* `0..unknowns` are solved for, slots `..cells` have
/// a rotation (they are unknown or next to one), and the remaining ones are only looked at by those cells.
///
/// The energy of the cell of `i` is a sum over its edges `w |(p'_p - p'_q) - R_i (p_p - p_q)|^2`. For both energies
/// the best `R_i` comes from `S_i = sum_j (p'_j - p'_i) c_ij^T` over the neighbours `j`, where `c_ij = sum_q w (p_j -
/// p_q)` runs over the cell's edges at `j`; and setting the derivative with respect to `p'_j` to zero gives the row
/// `(L p')_j = sum_i R_i c_ij / m` over the cells `i` that contain `j`, `m` being the multiplicity. Spokes alone make
/// this Sorkine and Alexa's (2007) Eq. 5 and 8, since there `c_ij = w_ij (p_j - p_i)`.
pub(super) struct Cells {
    /// Mesh vertex of each slot; increasing within the three ranges.
    pub(super) vertices: Vec<u32>,
    pub(super) unknowns: usize,
    pub(super) cells: usize,
    /// Row `i` of the lists below is `offsets[i]..offsets[i + 1]`.
    pub(super) offsets: Vec<u32>,
    /// Slots next to each cell's.
    pub(super) neighbours: Vec<u32>,
    /// `c_ij` for the neighbours `j` of each cell `i`.
    pub(super) covariance: Vec<DVec3>,
    /// `c_ij / m` for the neighbours `i` of each unknown `j`, and the weight.
    pub(super) pulls: Vec<Pull>,
    /// `c_jj / m` for each unknown.
    pub(super) own_pull: Vec<DVec3>,
    pub(super) terms: Vec<Term>,
}

impl Cells {
    /// `unknowns` are mesh vertices, increasing; `matrix` has the weight of each edge in the Laplacian.
    pub(super) fn new(
        topology: &Topology,
        rest: &[DVec3],
        edges: &CellEdges,
        matrix: &[f64],
        unknowns: &[u32],
    ) -> Self {
        let (vertices, slot, cells) = number(topology, unknowns);
        let mut layout = Self {
            vertices,
            unknowns: unknowns.len(),
            cells,
            offsets: vec![0],
            neighbours: Vec::new(),
            covariance: Vec::new(),
            pulls: Vec::new(),
            own_pull: Vec::new(),
            terms: Vec::new(),
        };
        layout.fill_cells(topology, rest, edges, &slot);
        layout.fill_pulls(topology, edges.multiplicity(), matrix);
        layout.fill_terms(topology, edges, &slot);
        layout
    }

    pub(super) fn row(&self, cell: usize) -> std::ops::Range<usize> {
        self.offsets[cell] as usize..self.offsets[cell + 1] as usize
    }

    fn fill_cells(&mut self, topology: &Topology, rest: &[DVec3], edges: &CellEdges, slot: &[u32]) {
        for cell in 0..self.cells {
            let i = self.vertices[cell] as usize;
            let ring = topology.neighbours(i);
            let start = self.neighbours.len();
            self.neighbours.extend(ring.iter().map(|&j| slot[j as usize]));
            self.covariance.resize(self.neighbours.len(), DVec3::ZERO);
            let sums = &mut self.covariance[start..];
            edges.for_each(topology, i, |p, q, w| {
                let pull = w * (rest[p as usize] - rest[q as usize]);
                // The centre's own sum is never needed here: it multiplies p'_i - p'_i.
                if let Ok(at) = ring.binary_search(&p) {
                    sums[at] += pull;
                }
                if let Ok(at) = ring.binary_search(&q) {
                    sums[at] -= pull;
                }
            });
            self.offsets.push(self.neighbours.len() as u32);
        }
    }

    fn fill_pulls(&mut self, topology: &Topology, multiplicity: f64, matrix: &[f64]) {
        for unknown in 0..self.unknowns {
            let j = self.vertices[unknown];
            let mut own = DVec3::ZERO;
            for (entry, &e) in self.row(unknown).zip(topology.neighbour_edges(j as usize)) {
                own -= self.covariance[entry];
                let cell = self.neighbours[entry] as usize;
                let ring = topology.neighbours(self.vertices[cell] as usize);
                // Neighbourhood is symmetric, so the unknown is in its neighbour's ring.
                let back = self.offsets[cell] as usize + ring.partition_point(|&v| v < j);
                let rest = self.covariance[back] / multiplicity;
                self.pulls.push(Pull { rest, weight: matrix[e as usize] });
            }
            self.own_pull.push(own / multiplicity);
        }
    }

    fn fill_terms(&mut self, topology: &Topology, edges: &CellEdges, slot: &[u32]) {
        let cells = self.cells as u32;
        let cell_of = |v: u32| if slot[v as usize] < cells { slot[v as usize] } else { NONE };
        let mut add = |p: u32, q: u32, weight: f64, counted_by: [u32; 3]| {
            if counted_by.iter().any(|&c| c != NONE) {
                // Next to a cell, so both have slots.
                let ends = [slot[p as usize], slot[q as usize]];
                self.terms.push(Term { ends, cells: counted_by, weight });
            }
        };
        match edges {
            CellEdges::Spokes(weights) => {
                for (&[p, q], &w) in topology.edges().iter().zip(weights) {
                    add(p, q, w, [cell_of(p), cell_of(q), NONE]);
                }
            }
            CellEdges::SpokesAndRims(faces) => {
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
fn number(topology: &Topology, unknowns: &[u32]) -> (Vec<u32>, Vec<u32>, usize) {
    let mut slot = vec![NONE; topology.vertex_count()];
    let mut vertices = unknowns.to_vec();
    for (k, &v) in unknowns.iter().enumerate() {
        slot[v as usize] = k as u32;
    }
    // One ring more twice: first to the other cells, then to what those look at.
    let mut cells = 0;
    for _ in 0..2 {
        cells = vertices.len();
        let mut ring = Vec::new();
        for &v in &vertices {
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
