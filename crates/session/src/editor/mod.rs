//! An editing session on one shape.

mod aims;
mod carrier;
mod descent;
mod document;
mod grip;
mod handles;
mod held;
mod options;
mod part;
mod prepared;
mod refinement;
mod refining;
mod rows;
mod shown;
mod steps;

use std::ops::Range;
use std::time::{Duration, Instant};

use glam::DVec3;
use pliant_cage::{Binding, SavedCage, Simplified, SimplifyOptions, simplify};
use pliant_mesh::ranges::{differing, widen};
use pliant_mesh::{Progress, TriMesh};

pub use document::{Autosave, Document, DocumentHandle, DocumentStep, Ranges};
pub use grip::{EditorHandle, Grip, SurfacePoint};
pub use options::EditorOptions;
pub use refinement::{RefineReport, Refinement};
pub use shown::Frame;

use crate::history::{History, State};
use crate::{Levels, SessionError};
use aims::differs;
use carrier::{Bound, Posed};
use handles::Movable;
use prepared::Prepared;
use refining::Released;
use shown::Shown;

/// A cage that moves less than this share of its diagonal in a solve stands still.
const STILL: f64 = 1e-6;

/// Solves of a release after which points held by the cage are told anew where its frames want them.
const FRAMES_FOLLOWED: u32 = 5;

/// A shape being edited: handles on it, the cage beneath, and every step so far.
///
/// A step begins with the first handle, moves as handles are dragged, and ends with [`Self::release`]; the next begins where it ended.
/// [`Self::update`] shows the shape as the cage has it, at display rate and from pose to pose. A release solves again from where the
/// step began, however the handles got to their goals, so that a step can be replayed to the same bits.
///
/// ```
/// use glam::DVec3;
/// use pliant_mesh::{Silent, Similarity, VertexSet, shapes};
/// use pliant_session::{Editor, EditorOptions, Grip};
///
/// let bar = shapes::bar(60, 8, 8, DVec3::new(6.0, 0.8, 0.8))?;
/// let along = |v: u32| bar.positions[v as usize].x;
/// let (low, high) = (-2.9, 2.9);
/// let ends = [0, 1].map(|end| {
///     VertexSet::where_true(bar.vertex_count(), |v| if end == 0 { along(v) < low } else { along(v) > high })
/// });
/// let mut editor = Editor::open(bar.clone(), EditorOptions::default(), &Silent)?;
/// let [held, moved] = ends;
/// editor.anchor(Grip::Vertices(held))?;
/// let handle = editor.grab(Grip::Vertices(moved.clone()))?;
/// editor.drag(handle, Similarity::translation(DVec3::Y))?;
/// editor.release("lift the end")?;
/// let v = moved.iter().next().unwrap() as usize;
/// assert_eq!(editor.positions()[v], bar.positions[v] + DVec3::Y);
/// editor.undo();
/// assert_eq!(editor.positions(), bar.positions);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Editor {
    options: EditorOptions,
    simplify_options: SimplifyOptions,
    /// The shape as it was opened.
    rest: TriMesh,
    simplified: Simplified,
    bound: Bound,
    levels: Levels,
    /// Of the shape, for refinements, once they are made.
    shape_levels: Option<Levels>,
    /// Where the current step began.
    base: Pose,
    /// What is shown. If only its single precision is up to date, `prepared` can carry the rest.
    current: Shown,
    region: Option<Movable>,
    handles: Vec<EditorHandle>,
    next_id: u32,
    prepared: Option<Prepared>,
    /// The step released last, if nothing else has been done since.
    released: Option<Released>,
    history: History,
    /// One per step in the history that was not dropped with its memory, and of all before: what a document keeps.
    steps: Vec<DocumentStep>,
}

/// Positions of the shape and of its cage.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Pose {
    pub(crate) shape: Vec<DVec3>,
    pub(crate) cage: Vec<DVec3>,
}

impl Pose {
    fn state(&mut self) -> State<'_> {
        State { shape: &mut self.shape, pose: &mut self.cage }
    }

    fn arrays(&self) -> [&[DVec3]; 2] {
        [&self.shape, &self.cage]
    }
}

/// What an update did.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// Vertices of the shape outside of this range are where they were before, to the bit.
    pub changed: Range<usize>,
    /// Solves done.
    pub solves: u32,
    /// Whether the cage stands still: more time would change nothing to speak of.
    pub still: bool,
    /// Largest distance by which the cage alone missed a hard handle's goal, which the shape meets exactly.
    pub snapped: f64,
    /// Largest distance by which the shape misses a hard handle's goal: rounding, but where points hold so much of a face that they
    /// contradict each other.
    pub missed: f64,
    /// Time taken.
    pub elapsed: Duration,
}

impl Editor {
    /// Makes a cage of the shape and binds it.
    ///
    /// # Errors
    /// As [`simplify`] and [`Simplified::bind`]; cancelling is one of them.
    pub fn open(shape: TriMesh, options: EditorOptions, progress: &dyn Progress) -> Result<Self, SessionError> {
        let simplify_options = SimplifyOptions::from(options.cage);
        let simplified = simplify(&shape, &simplify_options, progress)?;
        let binding = simplified.bind(&shape, &options.bind, progress)?;
        Self::assemble(shape, options, simplify_options, simplified, binding, progress)
    }

    /// Opens the shape with a cage and a binding saved before ([`SavedCage::load`]), which replace those of the options.
    ///
    /// # Errors
    /// [`SessionError::BadGrip`] for a binding to a cage that was not made of this shape; as [`Self::open`].
    pub fn open_saved(
        shape: TriMesh,
        saved: SavedCage,
        options: EditorOptions,
        progress: &dyn Progress,
    ) -> Result<Self, SessionError> {
        let Some((simplify_options, simplified)) = saved.simplified else {
            return Err(SessionError::BadGrip { reason: "the saved cage was not made of this shape".to_owned() });
        };
        // Cage vertices are vertices of the shape.
        let at = |v: &u32| shape.positions.get(*v as usize);
        let fits = simplified.owner.len() == shape.vertex_count()
            && saved.binding.shape_vertex_count() == shape.vertex_count()
            && simplified.origin.iter().map(at).eq(simplified.mesh.positions.iter().map(Some));
        if !fits {
            return Err(SessionError::BadGrip { reason: "the saved cage was made of another shape".to_owned() });
        }
        let options = EditorOptions { bind: saved.options, cage: simplify_options.size, ..options };
        Self::assemble(shape, options, simplify_options, simplified, saved.binding, progress)
    }

    fn assemble(
        shape: TriMesh,
        options: EditorOptions,
        simplify_options: SimplifyOptions,
        simplified: Simplified,
        binding: Binding,
        progress: &dyn Progress,
    ) -> Result<Self, SessionError> {
        let levels = Levels::new(&simplified.mesh, progress)?;
        let base = Pose { shape: shape.positions.clone(), cage: simplified.mesh.positions.clone() };
        let history = History::new(options.history_bytes);
        Ok(Self {
            options,
            simplify_options,
            rest: shape,
            simplified,
            bound: Bound::new(binding),
            levels,
            shape_levels: None,
            current: Shown::new(&base),
            base,
            region: None,
            handles: Vec::new(),
            next_id: 0,
            prepared: None,
            released: None,
            history,
            steps: Vec::new(),
        })
    }

    /// What to save ([`SavedCage::save`]) so that opening the shape again takes no time to speak of.
    pub fn saved_cage(&self) -> SavedCage {
        SavedCage {
            binding: self.bound.binding.clone(),
            options: self.options.bind,
            simplified: Some((self.simplify_options, self.simplified.clone())),
        }
    }

    /// The shape as it was opened.
    pub fn rest(&self) -> &TriMesh {
        &self.rest
    }

    /// Where the shape's vertices are, in double precision.
    ///
    /// Updates write single precision alone ([`Self::display`]). After one, the first call carries the shape along once more, which takes about
    /// twice as long.
    pub fn positions(&self) -> &[DVec3] {
        self.current.shape(|shape| match &self.prepared {
            Some(prepared) => _ = prepared.carrier.write(self.posed(&self.current.cage), shape),
            None => shape.clone_from(&self.base.shape),
        })
    }

    fn posed<'a>(&'a self, cage: &'a [DVec3]) -> Posed<'a> {
        Posed { bound: &self.bound, base: &self.base, cage }
    }

    /// Where the cage's vertices are.
    pub fn cage_positions(&self) -> &[DVec3] {
        &self.current.cage
    }

    /// Positions and normals in single precision, ready for a GPU, and where they have changed since the last call, by whatever it was: updates,
    /// steps undone or refined.
    ///
    /// After an update costs the normals of what may move; after anything else, a pass over the shape. Allocates only on the first call. The
    /// same bits for any number of threads.
    pub fn display(&mut self) -> Frame<'_> {
        let near = self.prepared.as_ref().and_then(|prepared| prepared.carrier.near());
        self.current.frame(self.rest.topology(), near)
    }

    /// Solves for the goals from the pose shown, again and again until the time is up or the cage stands still (once at least, if anything has
    /// left the place where the step began), and shows the result. Methods with a cheaper preview (the implicit one) show that, and all of their result on release.
    ///
    /// # Errors
    /// As [`pliant_deform::Method::prepare`] and a solve of it, and [`SessionError::OutsideRegion`]; then what is shown stays.
    pub fn update(&mut self, budget: Duration) -> Result<Update, SessionError> {
        let begun = Instant::now();
        let mut prepared = self.prepare()?;
        let made = self.solve_and_show(&mut prepared, begun, budget);
        self.prepared = Some(prepared);
        made
    }

    fn solve_and_show(
        &mut self,
        prepared: &mut Prepared,
        begun: Instant,
        budget: Duration,
    ) -> Result<Update, SessionError> {
        if !self.is_under_way() {
            let (changed, elapsed) = (0..0, begun.elapsed());
            return Ok(Update { changed, solves: 0, still: true, snapped: 0.0, missed: 0.0, elapsed });
        }
        prepared.aim(&self.handles)?;
        prepared.start_from(&self.current.cage, &self.base.cage);
        let mut solves = 0;
        let still = loop {
            let moved = prepared.solve(true)?;
            solves += 1;
            if moved <= STILL || !self.options.method.iterates() {
                break true;
            }
            if begun.elapsed() >= budget {
                break false;
            }
        };
        prepared.rows.follow(&self.base.cage, &prepared.pose);
        let posed = Posed { bound: &self.bound, base: &self.base, cage: &prepared.pose };
        let (changed, snapped) = prepared.carrier.show(&mut self.current, posed, &self.handles);
        Ok(Update { changed, solves, still, snapped: snapped.by, missed: snapped.missed, elapsed: begun.elapsed() })
    }

    /// Ends the step: solves once more from where it began, until the cage stands still, and notes it under a name. Handles stay, at rest.
    ///
    /// The result depends on where the step began, the handles and their goals alone.
    ///
    /// # Errors
    /// As [`Self::update`]; then the step goes on.
    pub fn release(&mut self, name: &str) -> Result<Update, SessionError> {
        let update = self.release_step(name)?;
        self.history.trim();
        Ok(update)
    }

    /// As [`Self::release`], with the history still as long as it is.
    fn release_step(&mut self, name: &str) -> Result<Update, SessionError> {
        let begun = Instant::now();
        if self.prepared.as_ref().is_some_and(|prepared| prepared.stale || !prepared.fresh) {
            // A factor changed again and again has other last bits than a new one.
            self.settle();
            self.prepared = None;
        }
        let mut prepared = self.prepare()?;
        match self.solve_from_base(&mut prepared) {
            Ok((solves, still)) => {
                let mut made = Pose { shape: Vec::new(), cage: prepared.pose.clone() };
                prepared.carrier.aim(&self.handles, &self.base);
                let snapped = prepared.carrier.write(self.posed(&prepared.pose), &mut made.shape);
                let mut changed = differing(&self.base.shape, &made.shape, |a, b| differs(*a, *b));
                widen(&mut changed, &self.current.displaced);
                self.note(name, made, prepared.carrier.aims().corners());
                let (snapped, missed) = (snapped.by, snapped.missed);
                Ok(Update { changed, solves, still, snapped, missed, elapsed: begun.elapsed() })
            }
            Err(error) => {
                self.prepared = Some(prepared);
                Err(error)
            }
        }
    }

    /// Brings the pose of what is prepared from where the step began to the goals; how many solves that took, and whether the cage
    /// stands still.
    fn solve_from_base(&self, prepared: &mut Prepared) -> Result<(u32, bool), SessionError> {
        prepared.rows.begin(&self.base.cage);
        prepared.aim(&self.handles)?;
        prepared.pose.copy_from_slice(&self.base.cage);
        let (mut solves, mut still) = (0, false);
        while !still && solves <= self.options.release_solves {
            still = prepared.solve(false)? <= STILL || !self.options.method.iterates();
            solves += 1;
            if prepared.rows.follow_frames() && !still && solves <= FRAMES_FOLLOWED {
                // Where points go on the cage depends on its frames; then they are held to that.
                prepared.rows.follow(&self.base.cage, &prepared.pose);
            }
        }
        Ok((solves, still))
    }

    /// What is prepared for the handles and the region as they are; taken out, to be put back.
    fn prepare(&mut self) -> Result<Prepared, SessionError> {
        if self.handles.is_empty() {
            return Err(SessionError::NothingGrabbed);
        }
        if self.prepared.as_ref().is_some_and(|prepared| prepared.stale) {
            self.settle();
        }
        match self.prepared.take() {
            Some(prepared) if !prepared.stale => Ok(prepared),
            old => Prepared::new(self, old),
        }
    }

    /// Brings all of what is shown up to date, so that it no longer depends on what is prepared.
    fn settle(&mut self) {
        self.positions();
        self.current.unconfine();
    }
}
