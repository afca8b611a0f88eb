use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use pliant_mesh::{Progress, Topology, TriMesh};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::prune::Prune;
use crate::rows::{RowFacts, RowMaker, Scratch};
use crate::{BindReport, CageError};

/// Settings of [`Binding::new`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BindOptions {
    /// Which weights are kept. Default: [`Prune::Local`] with 24 neighbours.
    pub prune: Prune,
    /// Whether [`Prune::Magnitude`] looks at every cage face for every shape vertex, to make its cuts without error bounds. Default: no.
    #[serde(default)]
    pub exact: bool,
}

impl From<Prune> for BindOptions {
    fn from(prune: Prune) -> Self {
        Self { prune, ..Self::default() }
    }
}

/// How a shape follows its cage: one sparse row of weights per shape vertex, made once at rest.
///
/// Rows hold at least one entry and sum to 1 up to f32 rounding. The entry of largest weight comes first, the others increase by
/// cage vertex.
#[derive(Debug, Clone)]
pub struct Binding {
    pub(crate) shape: Vec<DVec3>,
    pub(crate) cage: Vec<DVec3>,
    pub(crate) cage_topology: Arc<Topology>,
    /// Row `i` is entries `offsets[i]..offsets[i + 1]`.
    pub(crate) offsets: Vec<u32>,
    pub(crate) indices: Vec<u32>,
    pub(crate) weights: Vec<f32>,
    report: BindReport,
}

/// Rows that one task makes: enough to hide the cost of a task, few enough to share out evenly.
const CHUNK: usize = 512;

impl Binding {
    /// Binds `shape` to `cage`, both at rest, in parallel.
    ///
    /// The cage may be any triangle mesh with a face; it need not enclose the shape nor be closed, though open cages
    /// lose the linear precision of mean value coordinates ([`BindReport::cage_open_edges`]).
    /// [`Prune::Local`] costs about 15 us a shape vertex; [`Prune::None`] and [`Prune::Magnitude`] look at every cage face for
    /// every shape vertex (about 60 ns each).
    ///
    /// # Errors
    /// A cage without faces, a prune rule out of range, more weights than 32-bit offsets can number, or
    /// [`CageError::Cancelled`].
    pub fn new(
        shape: &TriMesh,
        cage: &TriMesh,
        options: &BindOptions,
        progress: &dyn Progress,
    ) -> Result<Self, CageError> {
        options.prune.check()?;
        if cage.face_count() == 0 {
            return Err(CageError::NoFaces);
        }
        if options.prune == Prune::None {
            check_entries(shape.vertex_count().saturating_mul(cage.vertex_count()))?;
        }
        let maker = RowMaker::new(cage, options);
        let done = AtomicUsize::new(0);
        let total = shape.vertex_count();
        let chunks: Vec<Chunk> = shape
            .positions
            .par_chunks(CHUNK)
            .map_init(
                || maker.scratch(),
                |scratch, points| {
                    if progress.is_cancelled() {
                        return Err(CageError::Cancelled { what: "binding" });
                    }
                    let chunk = Chunk::make(&maker, points, scratch);
                    let before = done.fetch_add(points.len(), Ordering::Relaxed);
                    // About a hundred reports in all.
                    let hundredth = (total / 100).max(1);
                    if before / hundredth != (before + points.len()) / hundredth {
                        progress.advance(before + points.len(), total);
                    }
                    Ok(chunk)
                },
            )
            .collect::<Result<_, _>>()?;
        Self::assemble(shape, cage, &chunks)
    }

    /// Binds a shape to itself: "no cage", exactly.
    pub fn identity(shape: &TriMesh) -> Self {
        let n = shape.vertex_count() as u32;
        let mut binding = Self {
            shape: shape.positions.clone(),
            cage: shape.positions.clone(),
            cage_topology: shape.shared_topology(),
            offsets: (0..=n).collect(),
            indices: (0..n).collect(),
            weights: vec![1.0; n as usize],
            report: BindReport::default(),
        };
        binding.report = BindReport::of(&binding, &[]);
        binding
    }

    fn assemble(shape: &TriMesh, cage: &TriMesh, chunks: &[Chunk]) -> Result<Self, CageError> {
        let entries: usize = chunks.iter().map(|c| c.indices.len()).sum();
        check_entries(entries)?;
        let mut offsets = Vec::with_capacity(shape.vertex_count() + 1);
        offsets.push(0);
        let (mut indices, mut weights) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        let mut facts = Vec::with_capacity(shape.vertex_count());
        for chunk in chunks {
            let start = indices.len() as u32;
            offsets.extend(chunk.ends.iter().map(|end| start + end));
            indices.extend_from_slice(&chunk.indices);
            weights.extend_from_slice(&chunk.weights);
            facts.extend_from_slice(&chunk.facts);
        }
        let mut binding = Self {
            shape: shape.positions.clone(),
            cage: cage.positions.clone(),
            cage_topology: cage.shared_topology(),
            offsets,
            indices,
            weights,
            report: BindReport::default(),
        };
        binding.report = BindReport::of(&binding, &facts);
        Ok(binding)
    }

    /// What the rows look like.
    pub fn report(&self) -> &BindReport {
        &self.report
    }

    /// Number of shape vertices: one row each.
    pub fn shape_vertex_count(&self) -> usize {
        self.shape.len()
    }

    /// Number of cage vertices.
    pub fn cage_vertex_count(&self) -> usize {
        self.cage.len()
    }

    /// Cage vertices and weights of a shape vertex's row, the largest weight first.
    pub fn row(&self, shape_vertex: usize) -> (&[u32], &[f32]) {
        let range = self.offsets[shape_vertex] as usize..self.offsets[shape_vertex + 1] as usize;
        (&self.indices[range.clone()], &self.weights[range])
    }
}

fn check_entries(entries: usize) -> Result<(), CageError> {
    if u32::try_from(entries).is_ok() { Ok(()) } else { Err(CageError::TooManyEntries { entries }) }
}

/// Rows of consecutive shape vertices.
struct Chunk {
    /// End of each row within this chunk.
    ends: Vec<u32>,
    indices: Vec<u32>,
    weights: Vec<f32>,
    facts: Vec<RowFacts>,
}

impl Chunk {
    fn make(maker: &RowMaker<'_>, points: &[DVec3], scratch: &mut Scratch) -> Self {
        let mut chunk = Self { ends: Vec::new(), indices: Vec::new(), weights: Vec::new(), facts: Vec::new() };
        for &point in points {
            chunk.facts.push(maker.make(point, scratch));
            // The largest first (the lowest vertex on a tie): propagation takes it as what the others add up to 1 with.
            let mut first = 0;
            for (at, entry) in scratch.row.iter().enumerate() {
                if entry.1 > scratch.row[first].1 {
                    first = at;
                }
            }
            let leading = scratch.row[first];
            let others = scratch.row.iter().enumerate().filter(|(at, _)| *at != first).map(|(_, e)| *e);
            for (j, weight) in std::iter::once(leading).chain(others) {
                // A weight that vanishes in f32 moves nothing.
                if weight as f32 != 0.0 {
                    chunk.indices.push(j);
                    chunk.weights.push(weight as f32);
                }
            }
            chunk.ends.push(chunk.indices.len() as u32);
        }
        chunk
    }
}
