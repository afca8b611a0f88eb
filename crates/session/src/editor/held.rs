//! From handles on the shape to what holds the cage and what is set on the shape.

use glam::DVec3;
use pliant_deform::{Constraint, DeformError, Goals, Handle, Method, PointRows, Region, Role};
use pliant_mesh::VertexSet;

use super::{Editor, EditorHandle, Grip, Pose};
use crate::{NoRoom, SessionError, carry_region};

/// A handle with more vertices than this, none of them on the cage, is held by so many of them.
const MOST_ROWS: usize = 64;

/// With more rows than this share of the cage's free vertices, the cage meets them in least squares: exactly it could only by
/// overshooting between them.
const MANY: f64 = 0.1;

/// How heavily many rows weigh.
const WEIGHT_OF_MANY: f64 = 10.0;

/// What the cage is held by.
pub(crate) struct Held {
    /// `None` if nothing of the cage is free.
    pub(crate) region: Option<Region>,
    /// Places of the editor's handles that are among the region's, in their order.
    pub(crate) known: Vec<usize>,
    /// In the order of the region's rows.
    pub(crate) rows: Vec<RowPoint>,
    /// Whether the rows are so many that the cage meets them in least squares only.
    pub(crate) many: bool,
}

/// A point of the shape that the cage is held by.
pub(crate) struct RowPoint {
    /// Place of its handle.
    pub(crate) handle: usize,
    pub(crate) of: Corners,
    /// The cage vertices it follows, and their weights.
    row: Vec<(u32, f64)>,
    pub(crate) goal: DVec3,
    /// From where the row puts it to where the shape has it: what frames add to positions.
    pub(crate) offset: DVec3,
}

/// A point of the shape by the corners of a face, or one vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corners {
    vertices: [u32; 3],
    weights: [f64; 3],
}

impl Corners {
    fn vertex(vertex: u32) -> Self {
        Self { vertices: [vertex; 3], weights: [1.0, 0.0, 0.0] }
    }

    pub(crate) fn place(&self, positions: &[DVec3]) -> DVec3 {
        if self.weights[0] == 1.0 {
            return positions[self.vertices[0] as usize];
        }
        (0..3).map(|k| self.weights[k] * positions[self.vertices[k] as usize]).sum()
    }
}

impl RowPoint {
    /// As before anything was shown: with the cage where the step began.
    pub(crate) fn begin(&mut self, base: &Pose) {
        self.offset = self.of.place(&base.shape) - self.on_cage(&base.cage);
        self.goal = self.of.place(&base.shape);
    }

    pub(crate) fn on_cage(&self, cage: &[DVec3]) -> DVec3 {
        self.row.iter().map(|&(j, weight)| weight * cage[j as usize]).sum()
    }
}

/// What is set on the shape.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Target {
    /// A vertex goes to the goal of itself.
    Vertex(u32),
    /// A corner of a point's face moves by what the point misses its goal by, over the weight of the corners that move.
    Corner { vertex: u32, of: Corners, weight: f64, goal: DVec3 },
}

impl Target {
    fn vertex(&self) -> u32 {
        match self {
            Self::Vertex(vertex) | Self::Corner { vertex, .. } => *vertex,
        }
    }
}

/// The handles on the cage: cage vertices that come from a handle's vertices are led by it, and a handle without one holds the cage by
/// the rows of its points, so that these go where the handle does.
pub(crate) fn on_cage(editor: &Editor, roi: &VertexSet) -> Result<Held, SessionError> {
    let origin = &editor.simplified.origin;
    let n = origin.len();
    let led = |at: usize| match vertices(&editor.handles[at]) {
        Some(set) => VertexSet::where_true(n, |j| set.contains(origin[j as usize])),
        None => VertexSet::default(),
    };
    let free = VertexSet::where_true(n, |j| roi.contains(origin[j as usize]));
    let takes_rows = matches!(editor.options.method, Method::Arap(_));
    let (mut known, mut handles, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for (at, handle) in editor.handles.iter().enumerate() {
        let led = led(at);
        let mut own = PointRows::new();
        if led.is_empty() && takes_rows {
            for of in points(editor, handle) {
                let row = row(editor, &of);
                // A point that follows nothing that may move is only set on the shape.
                if row.iter().any(|(j, _)| free.contains(*j)) {
                    own.push(row.iter().copied());
                    rows.push(RowPoint { handle: at, of, row, goal: DVec3::ZERO, offset: DVec3::ZERO });
                }
            }
        }
        if !(led.is_empty() && own.is_empty()) {
            known.push(at);
            handles.push(Handle { vertices: led, rows: own, constraint: handle.constraint });
        }
    }
    if !takes_rows && known.len() < editor.handles.len() {
        return stood_in(editor, roi);
    }
    if free.is_empty() || handles.is_empty() {
        return Ok(Held { region: None, known: Vec::new(), rows: Vec::new(), many: false });
    }
    let many = rows.len() as f64 > MANY * free.len() as f64;
    if many {
        for handle in handles.iter_mut().filter(|h| !h.rows.is_empty() && h.constraint == Constraint::Hard) {
            handle.constraint = Constraint::Soft(WEIGHT_OF_MANY);
        }
    }
    let region = Region::new(n, &free, &handles).map_err(|error| in_the_editors_order(error, &known))?;
    let (region, _) = region.without_unconstrained(editor.simplified.mesh.topology());
    Ok(Held { region: Some(region), known, rows, many })
}

/// For methods that take no rows: the nearest free cage vertex stands for a handle that has none.
fn stood_in(editor: &Editor, roi: &VertexSet) -> Result<Held, SessionError> {
    let base = &editor.base;
    let region = Region::new(editor.rest.vertex_count(), roi, &whole(editor)?)?;
    let carried =
        carry_region(&region, &editor.simplified.origin, &base.shape, &base.cage).map_err(|error| match error {
            NoRoom::Handle(at) => {
                SessionError::NoRoom { handle: editor.handles[at].id, vertices: editor.simplified.mesh.vertex_count() }
            }
            NoRoom::Region(error) => error.into(),
        })?;
    let (region, _) = carried.region.without_unconstrained(editor.simplified.mesh.topology());
    Ok(Held { region: Some(region), known: (0..editor.handles.len()).collect(), rows: Vec::new(), many: false })
}

fn in_the_editors_order(error: DeformError, known: &[usize]) -> DeformError {
    match error {
        DeformError::Handle { handle, fault } => DeformError::Handle { handle: known[handle], fault },
        other => other,
    }
}

/// Points that stand for a handle: its vertices, or as many of them as it takes, evenly; or its point.
fn points(editor: &Editor, handle: &EditorHandle) -> Vec<Corners> {
    match &handle.grip {
        Grip::Vertices(set) => {
            let step = set.len().div_ceil(MOST_ROWS).max(1);
            set.iter().step_by(step).map(Corners::vertex).collect()
        }
        Grip::Point(point) => {
            vec![Corners { vertices: editor.rest.triangles()[point.face as usize], weights: point.barycentric }]
        }
    }
}

/// The row of a point in the cage's positions: those of its corners, each averaged on the cage as propagation by frames does.
fn row(editor: &Editor, of: &Corners) -> Vec<(u32, f64)> {
    let binding = &editor.binding;
    let mut sums = std::collections::BTreeMap::new();
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
    sums.into_iter().map(|(k, weight)| (k, weight / sum)).collect()
}

/// The handles as vertices of the shape. A point stands for a corner of its face that no other handle has.
fn whole(editor: &Editor) -> Result<Vec<Handle>, SessionError> {
    let mut taken: VertexSet = editor.handles.iter().filter_map(vertices).flat_map(VertexSet::iter).collect();
    let one = |handle: &EditorHandle| {
        let vertices = match &handle.grip {
            Grip::Vertices(set) => set.clone(),
            Grip::Point(point) => {
                let corner = point.corners(editor.rest.triangles()).into_iter().find(|v| !taken.contains(*v));
                let reason = || format!("other handles hold all corners of face {}", point.face);
                let corner = corner.ok_or_else(|| SessionError::BadGrip { reason: reason() })?;
                taken = taken.union(&VertexSet::from_iter([corner]));
                VertexSet::from_iter([corner])
            }
        };
        Ok(Handle { vertices, rows: PointRows::new(), constraint: handle.constraint })
    };
    editor.handles.iter().map(one).collect()
}

/// The vertices of a handle that holds vertices.
fn vertices(handle: &EditorHandle) -> Option<&VertexSet> {
    match &handle.grip {
        Grip::Vertices(set) => Some(set),
        Grip::Point(_) => None,
    }
}

/// What hard handles set on the shape: each vertex once, those of vertex handles first.
pub(crate) fn targets(editor: &Editor) -> (Vec<u32>, Vec<(usize, Target)>) {
    let hard = || editor.handles.iter().enumerate().filter(|(_, h)| h.constraint == Constraint::Hard);
    let mut owners: Vec<(usize, Target)> = hard()
        .filter_map(|(at, handle)| Some((at, vertices(handle)?)))
        .flat_map(|(at, set)| set.iter().map(move |v| (at, Target::Vertex(v))))
        .collect();
    let mut sources: Vec<u32> = owners.iter().map(|(_, target)| target.vertex()).collect();
    let mut taken: VertexSet = sources.iter().copied().collect();
    for (at, handle) in hard() {
        let Grip::Point(point) = &handle.grip else { continue };
        let of = Corners { vertices: editor.rest.triangles()[point.face as usize], weights: point.barycentric };
        let free: Vec<usize> = (0..3).filter(|&k| !taken.contains(of.vertices[k])).collect();
        let weight: f64 = free.iter().map(|&k| of.weights[k]).sum();
        // With next to no weight left the point is held by its neighbours' handles.
        if weight < 1e-3 {
            continue;
        }
        for k in free {
            owners.push((at, Target::Corner { vertex: of.vertices[k], of, weight, goal: DVec3::ZERO }));
            sources.push(of.vertices[k]);
        }
        taken = sources.iter().copied().collect();
    }
    (sources, owners)
}

/// What a refinement of the shape works with.
pub(crate) struct OnShape {
    /// The corners of points within faces are fixed in it: they stay where they were set.
    pub(crate) region: Region,
    pub(crate) goals: Goals,
    /// The same for coarser levels, if they are to be gone through: a vertex stands for a point.
    pub(crate) on_levels: Option<(Region, Goals)>,
}

/// The region and the goals of a refinement; it goes through levels if the region has at least `levels_from` free vertices.
pub(crate) fn on_shape(editor: &Editor, levels_from: Option<usize>) -> Result<OnShape, SessionError> {
    let n = editor.rest.vertex_count();
    let constrained = |roi: &VertexSet, handles: &[Handle]| -> Result<Region, DeformError> {
        Ok(Region::new(n, roi, handles)?.without_unconstrained(editor.rest.topology()).0)
    };
    let set: VertexSet =
        targets(editor).1.iter().filter(|(_, t)| matches!(t, Target::Corner { .. })).map(|(_, t)| t.vertex()).collect();
    let all = editor.region.clone().unwrap_or_else(|| VertexSet::all(n));
    let held: Vec<&EditorHandle> = editor.handles.iter().filter(|h| vertices(h).is_some()).collect();
    let handles: Vec<Handle> = held
        .iter()
        .filter_map(|h| {
            Some(Handle { vertices: vertices(h)?.clone(), rows: PointRows::new(), constraint: h.constraint })
        })
        .collect();
    let region = constrained(&all.difference(&set), &handles)?;
    let goals = |handles: &mut dyn Iterator<Item = &EditorHandle>| Goals::new(handles.map(|h| h.goal).collect());
    let free = region.roles().iter().filter(|role| **role == Role::Free).count();
    let on_levels = levels_from.is_some_and(|least| free >= least).then(|| {
        let region = constrained(&all, &whole(editor).ok()?).ok()?;
        Some((region, goals(&mut editor.handles.iter())))
    });
    Ok(OnShape { region, goals: goals(&mut held.into_iter()), on_levels: on_levels.flatten() })
}
