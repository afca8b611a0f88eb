use std::fmt;
use std::ops::Range;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use pliant_mesh::ranges::widen;
use pliant_mesh::{Progress, Topology, TriMesh, VertexSet};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::packed::Packed;
use crate::prune::Prune;
use crate::rows::{RowFacts, RowMaker, Scratch};
use crate::sparse::{Chunk, Rows, check_entries};
use crate::support::Support;
use crate::{BindReport, CageError, Simplified};

/// Settings of [`Binding::new`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BindOptions {
    /// Which weights are kept. Default: [`Prune::Smooth`] with 16 neighbours.
    pub prune: Prune,
    /// Where [`Prune::Local`] and [`Prune::Smooth`] look for nearest cage vertices. Default: [`Support::Surface`].
    pub support: Support,
    /// Number of nearest cage vertices over which the motion of each cage vertex is averaged before
    /// [`Propagation::Frames`](crate::Propagation::Frames) carries it to the shape, by the weights of [`Prune::Smooth`]; 0 for
    /// none. Default: 24.
    ///
    /// Averaging on the cage acts like longer rows, at a cost that does not grow with the shape. It evens out the frames of a solve that
    /// has not converged, and the folds of coarse cages. Rest and rigid motions stay exact.
    pub smoothing: usize,
    /// Entries of [`Prune::Local`] and [`Prune::Smooth`] below this share of their row's largest are dropped, as each costs time in
    /// every drag; at least 0, below 1. Default: 0.005.
    pub tiny: f64,
    /// Every cage face for every shape vertex. Only [`Prune::Magnitude`] has a faster way, which sums far vertices in groups: its
    /// weights are within 1e-4 of the exact ones, its cuts within 1e-4 of the row's magnitude. Default: off.
    pub exact: bool,
}

impl Default for BindOptions {
    fn default() -> Self {
        Self { prune: Prune::default(), support: Support::default(), smoothing: 24, tiny: 5e-3, exact: false }
    }
}

/// A rule with the settings that go with it: the paper's rules as the paper has them, without smoothing.
impl From<Prune> for BindOptions {
    fn from(prune: Prune) -> Self {
        match prune {
            Prune::None | Prune::Magnitude(_) => Self { prune, smoothing: 0, ..Self::default() },
            Prune::Local { .. } | Prune::Smooth { .. } => Self { prune, ..Self::default() },
        }
    }
}

/// The rule, and what differs from the settings that go with it: `smooth:16`, `local:24+space`, `magnitude:0.03+smoothing:24`.
impl fmt::Display for BindOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let usual = Self::from(self.prune);
        write!(f, "{}", self.prune)?;
        if self.support != usual.support {
            write!(f, "+{}", self.support)?;
        }
        if self.smoothing != usual.smoothing {
            write!(f, "+smoothing:{}", self.smoothing)?;
        }
        if self.tiny != usual.tiny {
            write!(f, "+tiny:{}", self.tiny)?;
        }
        if self.exact {
            f.write_str("+exact")?;
        }
        Ok(())
    }
}

impl BindOptions {
    /// # Errors
    /// [`CageError::BadOption`] for a number out of range.
    pub(crate) fn check(&self) -> Result<(), CageError> {
        self.prune.check()?;
        if (0.0..1.0).contains(&self.tiny) { Ok(()) } else { Err(bad_tiny(self.tiny.to_string())) }
    }
}

fn bad_tiny(found: String) -> CageError {
    CageError::BadOption { what: "tiny (a share of the largest entry, at least 0 and below 1)", found }
}

/// Reads a prune rule and, each after a `+`, `surface`, `space`, `rings`, `smoothing:NEIGHBOURS`, `tiny:SHARE` or `exact`.
impl FromStr for BindOptions {
    type Err = CageError;

    fn from_str(text: &str) -> Result<Self, CageError> {
        let mut words = text.split('+');
        let mut options = Self::from(words.next().unwrap_or_default().parse::<Prune>()?);
        for word in words {
            match word.split_once(':') {
                Some(("smoothing", number)) => {
                    options.smoothing = number.parse().map_err(|_| CageError::BadOption {
                        what: "smoothing (a number of cage vertices, 0 for none)",
                        found: number.to_owned(),
                    })?;
                }
                Some(("tiny", share)) => {
                    options.tiny = share.parse().map_err(|_| bad_tiny(share.to_owned()))?;
                    options.check()?;
                }
                _ if word == "exact" => options.exact = true,
                _ => options.support = word.parse()?,
            }
        }
        Ok(options)
    }
}

/// How a shape follows its cage: one sparse row of weights per shape vertex, made once at rest.
///
/// Rows hold at least one entry and sum to 1 up to f32 rounding. The entry of largest weight comes first, the others increase by
/// cage vertex.
#[derive(Debug, Clone)]
pub struct Binding {
    pub(crate) shape: Vec<DVec3>,
    pub(crate) shape_topology: Arc<Topology>,
    pub(crate) cage: Vec<DVec3>,
    pub(crate) cage_topology: Arc<Topology>,
    pub(crate) rows: Rows,
    /// The same rows as propagation reads them.
    pub(crate) packed: Packed,
    /// How the cage's motion is averaged on the cage: rows and indices by rank.
    pub(crate) smoothing: Option<Rows>,
    report: BindReport,
}

/// Rows that one task makes: enough to hide the cost of a task, few enough to share out evenly.
const CHUNK: usize = 512;

impl Binding {
    /// Binds `shape` to `cage`, both at rest, in parallel.
    ///
    /// The cage may be any triangle mesh with a face; it need not enclose the shape nor be closed, though open cages
    /// lose the linear precision of mean value coordinates ([`BindReport::cage_open_edges`]).
    /// A shape vertex lies where on the cage's surface its nearest cage vertex does; [`Simplified::bind`] knows better.
    /// [`Prune::Smooth`] costs about 1 us a shape vertex and 30 us a cage vertex, [`Prune::Local`] 3 us a shape vertex more, and
    /// [`Prune::Magnitude`] 10 us on a cage near the shape; far from it, where rows keep hundreds of weights, several times
    /// that. [`Prune::None`] and [`BindOptions::exact`] look at every cage face for every shape vertex (about 60 ns each).
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
        Self::with_owners(shape, cage, None, options, progress)
    }

    fn with_owners(
        shape: &TriMesh,
        cage: &TriMesh,
        owners: Option<&[u32]>,
        options: &BindOptions,
        progress: &dyn Progress,
    ) -> Result<Self, CageError> {
        options.check()?;
        if cage.face_count() == 0 {
            return Err(CageError::NoFaces);
        }
        if options.prune == Prune::None {
            check_entries(shape.vertex_count().saturating_mul(cage.vertex_count()))?;
        }
        let maker = RowMaker::new(&shape.positions, owners, cage, options);
        let smoothing = options.smoothing;
        let (rows, facts) = make_rows(&maker.order(), |i, scratch| maker.make(i, scratch), progress)?;
        let average = |j, scratch: &mut Scratch| {
            maker.smooth_cage(j, smoothing, scratch);
            RowFacts::default()
        };
        let all: Vec<u32> = (0..cage.vertex_count() as u32).collect();
        let smoothing = match smoothing {
            0 => None,
            _ => Some(make_rows(&all, average, &Quiet(progress))?.0),
        };
        Ok(Self::assemble(shape, cage, rows, smoothing, facts))
    }

    /// Binds a shape to itself: "no cage", exactly.
    pub fn identity(shape: &TriMesh) -> Self {
        let rows = Rows::identity(shape.vertex_count() as u32);
        Self::assemble(shape, shape, rows, None, RowFacts::default())
    }

    fn assemble(shape: &TriMesh, cage: &TriMesh, rows: Rows, smoothing: Option<Rows>, facts: RowFacts) -> Self {
        let mut binding = Self::of_rows(shape, cage, rows, smoothing, BindReport::default());
        binding.report = BindReport::of(&binding, facts);
        binding
    }

    /// A binding of sound rows, both kinds numbered as the meshes are, that look as the report says.
    pub(crate) fn of_rows(
        shape: &TriMesh,
        cage: &TriMesh,
        rows: Rows,
        smoothing: Option<Rows>,
        report: BindReport,
    ) -> Self {
        let packed = Packed::new(&rows, &shape.positions, &cage.positions);
        Self {
            smoothing: smoothing.map(|rows| rows.renumbered(&packed.by_rank, &packed.rank)),
            packed,
            shape: shape.positions.clone(),
            shape_topology: shape.shared_topology(),
            cage: cage.positions.clone(),
            cage_topology: cage.shared_topology(),
            rows,
            report,
        }
    }

    /// The binding of some of the shape's vertices alone, in their order: what an edit of a part of the shape has to carry. It knows no
    /// faces, so that its normals are zero. Costs as much as a few propagations of the part.
    ///
    /// # Panics
    /// If one of `vertices` is not a vertex of the shape.
    pub fn part(&self, vertices: &VertexSet) -> Self {
        let all: Vec<u32> = (0..self.cage.len() as u32).collect();
        let rows = self.rows.renumbered(vertices.as_slice(), &all);
        let shape: Vec<DVec3> = vertices.iter().map(|v| self.shape[v as usize]).collect();
        // Fewer vertices than a mesh that exists can be numbered.
        let bare = Topology::new(shape.len(), Vec::new()).expect("a part has no more vertices than the shape");
        let mut part = Self {
            packed: Packed::new(&rows, &shape, &self.cage),
            smoothing: self.smoothing.clone(),
            shape_topology: Arc::new(bare),
            shape,
            cage: self.cage.clone(),
            cage_topology: Arc::clone(&self.cage_topology),
            rows,
            report: BindReport::default(),
        };
        part.report = BindReport::of(&part, RowFacts::default());
        part
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
        self.rows.row(shape_vertex)
    }

    /// Cage vertices whose motion is averaged into that of a cage vertex, and their weights, the largest first: nothing but the vertex
    /// itself without [`BindOptions::smoothing`].
    ///
    /// [`Propagation::Frames`](crate::Propagation::Frames) moves shape vertex `i` by the sum of `w * v` times the motion of `k`,
    /// over the entries `(j, w)` of [`Self::row`] and, for each, the entries `(k, v)` of this.
    pub fn smoothing_row(&self, cage_vertex: u32) -> (Vec<u32>, Vec<f32>) {
        match &self.smoothing {
            Some(rows) => {
                let (ranks, weights) = rows.row(self.packed.rank[cage_vertex as usize] as usize);
                (ranks.iter().map(|&r| self.packed.by_rank[r as usize]).collect(), weights.to_vec())
            }
            None => (vec![cage_vertex], vec![1.0]),
        }
    }

    /// For each cage vertex the shape vertices, first to last, outside of which nobody moves by frames when it does: those that follow it or a
    /// vertex of its ring, whose frame it turns. Linear in the number of kept weights.
    ///
    /// ```
    /// use pliant_cage::{BindOptions, Binding};
    /// use pliant_mesh::{Silent, shapes};
    ///
    /// let (shape, cage) = (shapes::icosphere(3), shapes::icosphere(1));
    /// let binding = Binding::new(&shape, &cage, &BindOptions::default(), &Silent)?;
    /// let reach = binding.reach();
    /// assert!(reach.iter().all(|range| range.start < range.end && range.end <= shape.vertex_count()));
    /// # Ok::<(), pliant_cage::CageError>(())
    /// ```
    pub fn reach(&self) -> Vec<Range<usize>> {
        let n = self.cage.len();
        let mut own = vec![0..0; n];
        for i in 0..self.shape.len() {
            for &j in self.rows.row(i).0 {
                widen(&mut own[j as usize], &(i..i + 1));
            }
        }
        let mut averaged = own;
        if let Some(rows) = &self.smoothing {
            let by_rank = &self.packed.by_rank;
            let own = std::mem::replace(&mut averaged, vec![0..0; n]);
            for (rank, &j) in by_rank.iter().enumerate() {
                for &k in rows.row(rank).0 {
                    widen(&mut averaged[by_rank[k as usize] as usize], &own[j as usize]);
                }
            }
        }
        let mut reach = averaged.clone();
        for (j, reach) in reach.iter_mut().enumerate() {
            for &k in self.cage_topology.neighbours(j) {
                widen(reach, &averaged[k as usize]);
            }
        }
        reach
    }

    /// Bytes that propagation by frames or positions to f32 reads and writes per call, in the shape's arrays: rows, rest positions, and
    /// the positions written. What belongs to the cage stays in a near cache and is not counted.
    pub fn propagated_bytes(&self) -> usize {
        self.packed.bytes()
    }
}

impl Simplified {
    /// Binds the shape that this cage was made of to it; see [`Binding::new`].
    ///
    /// Where on the surface a shape vertex lies is known from the vertex it was collapsed into ([`Simplified::owner`]), so a limb
    /// that touches another never follows it.
    ///
    /// # Errors
    /// As [`Binding::new`], and [`CageError::OtherShape`] if `shape` has not as many vertices as the one simplified.
    pub fn bind(&self, shape: &TriMesh, options: &BindOptions, progress: &dyn Progress) -> Result<Binding, CageError> {
        let (expected, found) = (self.owner.len(), shape.vertex_count());
        if expected != found {
            return Err(CageError::OtherShape { expected, found });
        }
        Binding::with_owners(shape, &self.mesh, Some(&self.owner), options, progress)
    }
}

/// Asks whether to stop, and reports nothing.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn advance(&self, _done: usize, _total: usize) {}

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Makes a row for each point of `order`, in parallel, and returns them in the order of the points.
fn make_rows(
    order: &[u32],
    make: impl Fn(u32, &mut Scratch) -> RowFacts + Sync,
    progress: &dyn Progress,
) -> Result<(Rows, RowFacts), CageError> {
    let done = AtomicUsize::new(0);
    let total = order.len();
    let chunks: Vec<Chunk> = order
        .par_chunks(CHUNK)
        .map_init(Scratch::default, |scratch, points| {
            if progress.is_cancelled() {
                return Err(CageError::Cancelled { what: "binding" });
            }
            let chunk = Chunk::of(points, scratch, &make);
            let before = done.fetch_add(points.len(), Ordering::Relaxed);
            // About a hundred reports in all.
            let hundredth = (total / 100).max(1);
            if before / hundredth != (before + points.len()) / hundredth {
                progress.advance(before + points.len(), total);
            }
            Ok(chunk)
        })
        .collect::<Result<_, _>>()?;
    let facts = chunks.iter().fold(RowFacts::default(), |facts, chunk| facts.and(chunk.facts));
    Ok((Rows::gather(order, CHUNK, &chunks)?, facts))
}
