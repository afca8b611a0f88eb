//! An editing session on one shape.

mod descent;
mod document;
mod grip;
mod held;
mod options;
mod prepared;
mod refinement;
mod refining;
mod steps;

use std::ops::Range;
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use pliant_cage::{Binding, SavedCage, Simplified, SimplifyOptions, simplify};
use pliant_deform::{Constraint, Method};
use pliant_mesh::{NormalBuffer, Progress, Similarity, TriMesh, VertexSet};

pub use document::{Autosave, Document, DocumentHandle, DocumentStep, Ranges};
pub use grip::{EditorHandle, Grip, SurfacePoint};
pub use options::EditorOptions;
pub use refinement::{RefineReport, Refinement};

use crate::history::{History, State};
use crate::{Levels, SessionError};
use prepared::Prepared;
use refining::Released;

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
    binding: Binding,
    levels: Levels,
    /// Of the shape, for refinements, once they are made.
    shape_levels: Option<Levels>,
    /// Where the current step began.
    base: Pose,
    /// What is shown.
    current: Pose,
    region: Option<VertexSet>,
    handles: Vec<EditorHandle>,
    next_id: u32,
    prepared: Option<Prepared>,
    /// The step released last, if nothing else has been done since.
    released: Option<Released>,
    history: History,
    /// One per step in the history that was not dropped with its memory, and of all before: what a document keeps.
    steps: Vec<DocumentStep>,
    display: Display,
}

/// Positions of the shape and of its cage.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Pose {
    pub(crate) shape: Vec<DVec3>,
    pub(crate) cage: Vec<DVec3>,
}

impl Pose {
    fn copy_from(&mut self, other: &Self) {
        self.shape.copy_from_slice(&other.shape);
        self.cage.copy_from_slice(&other.cage);
    }

    fn state(&mut self) -> State<'_> {
        State { shape: &mut self.shape, pose: &mut self.cage }
    }

    fn arrays(&self) -> [&[DVec3]; 2] {
        [&self.shape, &self.cage]
    }
}

/// What leaves for a GPU.
#[derive(Default)]
struct Display {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    buffer: NormalBuffer,
}

/// What an update did.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// Vertices of the shape outside of this range are where they were.
    pub changed: Range<usize>,
    /// Solves done.
    pub solves: u32,
    /// Whether the cage stands still: more time would change nothing to speak of.
    pub still: bool,
    /// Largest distance by which the cage alone missed a hard handle's goal, which the shape meets exactly.
    pub snapped: f64,
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
    /// [`SessionError::BadGrip`] for a binding to a cage that was not made of the shape; as [`Self::open`].
    pub fn open_saved(
        shape: TriMesh,
        saved: SavedCage,
        options: EditorOptions,
        progress: &dyn Progress,
    ) -> Result<Self, SessionError> {
        let Some((simplify_options, simplified)) = saved.simplified else {
            return Err(SessionError::BadGrip { reason: "the saved cage was not made of this shape".to_owned() });
        };
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
            binding,
            levels,
            shape_levels: None,
            current: base.clone(),
            base,
            region: None,
            handles: Vec::new(),
            next_id: 0,
            prepared: None,
            released: None,
            history,
            steps: Vec::new(),
            display: Display::default(),
        })
    }

    /// What to save ([`SavedCage::save`]) so that opening the shape again takes no time to speak of.
    pub fn saved_cage(&self) -> SavedCage {
        SavedCage {
            binding: self.binding.clone(),
            options: self.options.bind,
            simplified: Some((self.simplify_options, self.simplified.clone())),
        }
    }

    /// The shape as it was opened.
    pub fn rest(&self) -> &TriMesh {
        &self.rest
    }

    /// Where the shape's vertices are.
    pub fn positions(&self) -> &[DVec3] {
        &self.current.shape
    }

    /// Where the cage's vertices are.
    pub fn cage_positions(&self) -> &[DVec3] {
        &self.current.cage
    }

    /// Positions and normals in single precision, ready for a GPU. Costs a pass over the shape; allocates only on the first call.
    pub fn display(&mut self) -> (&[Vec3], &[Vec3]) {
        let Display { positions, normals, buffer } = &mut self.display;
        positions.clear();
        positions.extend(self.current.shape.iter().map(|p| p.as_vec3()));
        normals.resize(positions.len(), Vec3::ZERO);
        buffer.compute(self.rest.topology(), positions, normals);
        (positions, normals)
    }

    /// The handles, in the order they were added.
    pub fn handles(&self) -> &[EditorHandle] {
        &self.handles
    }

    /// The vertices that may move; `None` is all.
    pub fn region(&self) -> Option<&VertexSet> {
        self.region.as_ref()
    }

    /// Says which vertices may move: all others keep their bits. `None` is all.
    ///
    /// # Errors
    /// [`SessionError::BadGrip`] if it is empty or names a vertex that does not exist.
    pub fn set_region(&mut self, region: Option<VertexSet>) -> Result<(), SessionError> {
        if let Some(region) = &region {
            Grip::Vertices(region.clone()).check(&self.rest)?;
        }
        self.region = region;
        self.change();
        Ok(())
    }

    /// Adds a handle that meets its goals exactly; returns its number.
    ///
    /// # Errors
    /// [`SessionError::BadGrip`].
    pub fn grab(&mut self, grip: Grip) -> Result<u32, SessionError> {
        self.add_handle(grip, Constraint::Hard)
    }

    /// Adds a handle that stays where it is. It is a handle like others and can be dragged, too.
    ///
    /// # Errors
    /// As [`Self::grab`].
    pub fn anchor(&mut self, grip: Grip) -> Result<u32, SessionError> {
        self.grab(grip)
    }

    /// Adds a handle that is drawn to its goals with a weight, or held to them.
    ///
    /// # Errors
    /// As [`Self::grab`].
    pub fn add_handle(&mut self, grip: Grip, constraint: Constraint) -> Result<u32, SessionError> {
        grip.check(&self.rest)?;
        let id = self.next_id;
        self.next_id += 1;
        self.handles.push(EditorHandle { id, grip, constraint, goal: Similarity::IDENTITY });
        self.change();
        Ok(id)
    }

    /// Takes a handle away.
    ///
    /// # Errors
    /// [`SessionError::NoHandle`].
    pub fn remove_handle(&mut self, handle: u32) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        self.handles.remove(at);
        self.change();
        Ok(())
    }

    /// Sets the goal of a handle, as a motion from where the step began. The newest goal counts; nothing is solved before
    /// [`Self::update`] or [`Self::release`].
    ///
    /// # Errors
    /// [`SessionError::NoHandle`], or [`SessionError::BadGrip`] for a motion that is no similarity.
    pub fn drag(&mut self, handle: u32, goal: Similarity) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        if !goal.is_valid() {
            return Err(SessionError::BadGrip { reason: format!("its goal is no similarity: {goal:?}") });
        }
        self.handles[at].goal = goal;
        Ok(())
    }

    /// Sets the goal of a handle so that its middle goes to a point, without turning.
    ///
    /// # Errors
    /// As [`Self::drag`].
    pub fn drag_to(&mut self, handle: u32, point: DVec3) -> Result<(), SessionError> {
        let at = self.place(handle)?;
        let middle = match &self.handles[at].grip {
            Grip::Vertices(vertices) => {
                vertices.iter().map(|v| self.base.shape[v as usize]).sum::<DVec3>() / vertices.len() as f64
            }
            Grip::Point(on) => on.place(self.rest.triangles(), &self.base.shape),
        };
        self.drag(handle, Similarity::translation(point - middle))
    }

    /// Solves for the goals from the pose shown, again and again until the time is up or the cage stands still (once at least), and shows
    /// the result. Methods with a cheaper preview (the implicit one) show that, and all of their result on release.
    ///
    /// # Errors
    /// As [`Method::prepare`] and a solve of it; then what is shown stays.
    pub fn update(&mut self, budget: Duration) -> Result<Update, SessionError> {
        let begun = Instant::now();
        let mut prepared = self.prepare()?;
        let made = (|| {
            let mut solves = 0;
            prepared.set_goals(&self.handles, &self.base, false);
            prepared.pose.copy_from_slice(&self.current.cage);
            let still = loop {
                let moved = prepared.solve(true)?;
                solves += 1;
                if moved <= STILL || !self.iterates() {
                    break true;
                }
                if begun.elapsed() >= budget {
                    break false;
                }
            };
            let snapped = prepared.show(&self.binding, &self.base, &mut self.current);
            let changed = prepared.changed.clone();
            Ok(Update { changed, solves, still, snapped, elapsed: begun.elapsed() })
        })();
        self.prepared = Some(prepared);
        made
    }

    /// Ends the step: solves once more from where it began, until the cage stands still, and notes it under a name. Handles stay, at rest.
    ///
    /// The result depends on where the step began, the handles and their goals alone.
    ///
    /// # Errors
    /// As [`Self::update`]; then the step goes on.
    pub fn release(&mut self, name: &str) -> Result<Update, SessionError> {
        let begun = Instant::now();
        let mut prepared = self.prepare()?;
        if !prepared.fresh {
            // A factor changed again and again has other last bits than a new one.
            prepared = Prepared::new(self, None)?;
        }
        let made = (|| {
            prepared.set_goals(&self.handles, &self.base, true);
            prepared.pose.copy_from_slice(&self.base.cage);
            let (mut solves, mut still) = (0, false);
            let mut shown = if prepared.follows() { self.base.clone() } else { Pose::default() };
            while !still && solves <= self.options.release_solves {
                still = prepared.solve(false)? <= STILL || !self.iterates();
                solves += 1;
                if prepared.follows() && !still && solves <= FRAMES_FOLLOWED {
                    // Where points go on the cage depends on its frames, which the shape shown tells; then they are held to that.
                    prepared.show(&self.binding, &self.base, &mut shown);
                }
            }
            prepared.unclean = true;
            let snapped = prepared.show(&self.binding, &self.base, &mut self.current);
            let changed = prepared.changed.clone();
            Ok(Update { changed, solves, still, snapped, elapsed: begun.elapsed() })
        })();
        if made.is_ok() {
            let refinable = held::on_shape(self, self.options.levels_from).ok();
            self.released = refinable.map(|held| Released { began: self.base.clone(), held, refining: None });
            self.note(name);
        }
        self.prepared = made.is_err().then_some(prepared);
        made
    }

    fn iterates(&self) -> bool {
        matches!(self.options.method, Method::Arap(_) | Method::DualLaplacian(_))
    }

    fn place(&self, handle: u32) -> Result<usize, SessionError> {
        self.handles.iter().position(|h| h.id == handle).ok_or(SessionError::NoHandle { handle })
    }

    /// The handles or the region are others now.
    fn change(&mut self) {
        self.released = None;
        if let Some(prepared) = &mut self.prepared {
            prepared.stale = true;
        }
    }

    /// What is prepared for the handles and the region as they are; taken out, to be put back.
    fn prepare(&mut self) -> Result<Prepared, SessionError> {
        if self.handles.is_empty() {
            return Err(SessionError::NothingGrabbed);
        }
        match self.prepared.take() {
            Some(prepared) if !prepared.stale => Ok(prepared),
            old => Prepared::new(self, old),
        }
    }
}
