//! From handles on the shape to what holds the cage.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use pliant_deform::{Constraint, DeformError, Goals, Handle, Method, PointRows, Region, Role};
use pliant_mesh::VertexSet;

use super::rows::{Corners, RowMaker, RowPoint};
use super::{Editor, EditorHandle, Grip};
use crate::SessionError;

/// A handle with more vertices than this, none of them on the cage, is held by so many of them.
const MOST_ROWS: usize = 64;

/// With more rows than this share of the cage's free vertices, the cage meets them in least squares: exactly it could only by
/// overshooting between them.
const MANY: f64 = 0.1;

/// How heavily many rows weigh.
const WEIGHT_OF_MANY: f64 = 10.0;

/// What the cage is held by.
pub(crate) struct Held {
    /// `None` if nothing of the cage is free, or no handle has anything to do with it.
    pub(crate) region: Option<Region>,
    /// Places of the editor's handles that are among the region's, in their order.
    pub(crate) known: Vec<usize>,
    /// In the order of the region's rows.
    pub(crate) rows: Vec<RowPoint>,
    /// Whether the rows are so many, or so near each other, that the cage meets them in least squares only.
    pub(crate) many: bool,
}

/// The handles on the cage: cage vertices that come from a handle's vertices are led by it, and a handle without one holds the cage by
/// the rows of its points, so that these go where the handle does. For a method that takes no rows, the cage vertex that the middle of the handle
/// went into stands in for it, or else the nearest of its ring that no other handle has; the rest of the way the shape goes alone.
pub(crate) fn on_cage(editor: &Editor) -> Result<Held, SessionError> {
    let origin = &editor.simplified.origin;
    let n = origin.len();
    let free = VertexSet::where_true(n, |j| editor.may_move(origin[j as usize]));
    let mut led = led(editor, &free);
    let takes_rows = matches!(editor.options.method, Method::Arap(_));
    let mut maker = RowMaker::new(&editor.bound.binding);
    let mut taken: HashSet<u32> = led.iter().flatten().copied().collect();
    let (mut known, mut handles, mut rows) = (Vec::new(), Vec::new(), Vec::new());
    for (at, handle) in editor.handles.iter().enumerate() {
        let mut own = PointRows::new();
        if led[at].is_empty() && takes_rows {
            for of in points(editor, handle) {
                let point = maker.make(at, of);
                // A point that follows nothing that may move is only set on the shape.
                if point.row.iter().any(|(j, _)| free.contains(*j)) {
                    own.push(point.row.iter().copied());
                    rows.push(point);
                }
            }
        } else if led[at].is_empty() {
            let stand_in = stand_ins(editor, handle).into_iter().find(|j| free.contains(*j) && !taken.contains(j));
            led[at].extend(stand_in);
            taken.extend(stand_in);
        }
        if !(led[at].is_empty() && own.is_empty()) {
            known.push(at);
            let vertices = led[at].iter().copied().collect();
            handles.push(Handle { vertices, rows: own, constraint: handle.constraint });
        }
    }
    if free.is_empty() || handles.is_empty() {
        return Ok(Held { region: None, known: Vec::new(), rows: Vec::new(), many: false });
    }
    let many = rows.len() as f64 > MANY * free.len() as f64 || share_corners(&rows);
    if many {
        for handle in handles.iter_mut().filter(|h| !h.rows.is_empty() && h.constraint == Constraint::Hard) {
            handle.constraint = Constraint::Soft(WEIGHT_OF_MANY);
        }
    }
    let region = Region::new(n, &free, &handles).map_err(|error| named(error, |at| editor.handles[known[at]].id))?;
    let (region, _) = region.without_unconstrained(editor.simplified.mesh.topology());
    Ok(Held { region: Some(region), known, rows, many })
}

/// Whether two handles hold points that share a corner: so near each other that the cage could meet both only by overshooting around them.
fn share_corners(rows: &[RowPoint]) -> bool {
    let mut holders = HashMap::new();
    let corners = rows.iter().flat_map(|row| row.of.vertices.map(|v| (v, row.handle)));
    corners.into_iter().any(|(v, handle)| *holders.entry(v).or_insert(handle) != handle)
}

/// For each handle, the free cage vertices that come from its vertices.
fn led(editor: &Editor, free: &VertexSet) -> Vec<Vec<u32>> {
    let mut owners = vec![u32::MAX; editor.rest.vertex_count()];
    for (at, handle) in (0..).zip(&editor.handles) {
        for v in handle.grip.vertices().into_iter().flat_map(VertexSet::iter) {
            owners[v as usize] = at;
        }
    }
    let mut led = vec![Vec::new(); editor.handles.len()];
    for j in free.iter() {
        if let Some(led) = led.get_mut(owners[editor.simplified.origin[j as usize] as usize] as usize) {
            led.push(j);
        }
    }
    led
}

/// An error of a region or a solve, its handle by the number it has in the editor.
pub(crate) fn named(error: DeformError, id: impl Fn(usize) -> u32) -> DeformError {
    match error {
        DeformError::Handle { handle, fault } => DeformError::Handle { handle: id(handle) as usize, fault },
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
        Grip::Point(point) => vec![point.on(editor.rest.triangles())],
    }
}

/// The cage vertex that the middle of a handle went into, and its ring, nearest first.
fn stand_ins(editor: &Editor, handle: &EditorHandle) -> Vec<u32> {
    let (shape, cage) = (&editor.base.shape, &editor.base.cage);
    let points: Vec<u32> = match &handle.grip {
        Grip::Vertices(set) => set.as_slice().to_vec(),
        Grip::Point(point) => point.on(editor.rest.triangles()).vertices.to_vec(),
    };
    let middle = match &handle.grip {
        Grip::Vertices(_) => points.iter().map(|&v| shape[v as usize]).sum::<DVec3>() / points.len() as f64,
        Grip::Point(point) => point.on(editor.rest.triangles()).place(shape),
    };
    let distance = |p: DVec3| p.distance_squared(middle);
    let nearest = |a: &u32, b: &u32| distance(shape[*a as usize]).total_cmp(&distance(shape[*b as usize]));
    let owner = points.into_iter().min_by(nearest).map(|v| editor.simplified.owner[v as usize]);
    // A vertex without faces went into none.
    let Some(owner) = owner.filter(|j| (*j as usize) < cage.len()) else { return Vec::new() };
    let mut ring = editor.simplified.mesh.topology().neighbours(owner as usize).to_vec();
    ring.sort_by(|a, b| distance(cage[*a as usize]).total_cmp(&distance(cage[*b as usize])));
    std::iter::once(owner).chain(ring).collect()
}

/// What a refinement of the shape works with.
pub(crate) struct OnShape {
    /// The corners of points within faces are fixed in it: they stay where they were set.
    pub(crate) region: Region,
    pub(crate) goals: Goals,
    /// The same for coarser levels, if they are to be gone through: a vertex stands for a point.
    pub(crate) on_levels: Option<(Region, Goals)>,
}

/// The region and the goals that a refinement of the shape works with. The `corners` of points within faces stay where they were set.
pub(crate) fn on_shape(editor: &Editor, corners: &[u32]) -> Result<OnShape, SessionError> {
    let n = editor.rest.vertex_count();
    let corners: VertexSet = corners.iter().copied().collect();
    let may_move = VertexSet::where_true(n, |v| editor.may_move(v));
    let held = editor.handles.iter().filter_map(|handle| Some((handle, handle.grip.vertices()?.clone()))).collect();
    let (region, goals) = constrained(editor, &may_move.difference(&corners), held)?;
    let free = region.roles().iter().filter(|role| **role == Role::Free).count();
    let on_levels = editor.options.levels_from.is_some_and(|least| free >= least);
    let on_levels = on_levels.then(|| constrained(editor, &may_move, whole(editor)).ok()).flatten();
    Ok(OnShape { region, goals, on_levels })
}

/// Handles that hold vertices of a region of interest, and their goals.
fn constrained(
    editor: &Editor,
    roi: &VertexSet,
    held: Vec<(&EditorHandle, VertexSet)>,
) -> Result<(Region, Goals), DeformError> {
    // Looked up by vertex: thousands of handles are not to walk the region each.
    let mut inside = vec![false; editor.rest.vertex_count()];
    roi.iter().for_each(|v| inside[v as usize] = true);
    let (mut handles, mut goals) = (Vec::new(), Vec::new());
    for (handle, vertices) in held {
        let vertices: VertexSet = vertices.iter().filter(|v| inside[*v as usize]).collect();
        if !vertices.is_empty() {
            handles.push(Handle { vertices, rows: PointRows::new(), constraint: handle.constraint });
            goals.push(handle.goal);
        }
    }
    let region = Region::new(editor.rest.vertex_count(), roi, &handles)?;
    let (region, _) = region.without_unconstrained(editor.rest.topology());
    Ok((region, Goals::new(goals)))
}

/// The handles as vertices of the shape. A point stands for a corner of its face that no other handle has, if there is one.
fn whole(editor: &Editor) -> Vec<(&EditorHandle, VertexSet)> {
    let mut taken: HashSet<u32> =
        editor.handles.iter().filter_map(|handle| handle.grip.vertices()).flat_map(VertexSet::iter).collect();
    let mut held = Vec::new();
    for handle in &editor.handles {
        match &handle.grip {
            Grip::Vertices(set) => held.push((handle, set.clone())),
            Grip::Point(point) => {
                let corner = point.on(editor.rest.triangles()).vertices.into_iter().find(|v| taken.insert(*v));
                held.extend(corner.map(|v| (handle, VertexSet::from_iter([v]))));
            }
        }
    }
    held
}
