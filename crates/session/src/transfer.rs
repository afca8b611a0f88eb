//! Handles of a mesh on a coarser one.

use glam::DVec3;
use pliant_deform::{DeformError, Handle, PointRows, Region, Role};
use pliant_mesh::VertexSet;

/// A region on a coarser mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Carried {
    /// Its handles are those of the finer mesh, in their order.
    pub region: Region,
    /// Handles of which no vertex is one of the coarser mesh, those of points among them: each holds the free vertex nearest to its middle
    /// instead.
    pub stand_ins: Vec<usize>,
}

/// Why a region cannot be carried over.
#[derive(Debug, Clone, PartialEq)]
pub enum NoRoom {
    /// The coarser mesh has no free vertex left for this handle, or the handle has points that are no vertices, which are not carried over.
    Handle(usize),
    /// What the coarser mesh has of the region is none.
    Region(DeformError),
}

/// The region on a coarser mesh whose vertices are a subset of the finer one's: each vertex has the role of the one it came from.
///
/// `origin` has, for each vertex of the coarser mesh, its number in the finer one. `fine` and `coarse` are rest positions.
///
/// # Errors
/// [`NoRoom`]. Linear in the vertices, and in those of the coarser mesh for each stand-in.
pub fn carry_region(region: &Region, origin: &[u32], fine: &[DVec3], coarse: &[DVec3]) -> Result<Carried, NoRoom> {
    let mut roles: Vec<Role> = origin.iter().map(|&v| region.roles()[v as usize]).collect();
    let mut stand_ins = Vec::new();
    let mut held = vec![false; region.handles().len()];
    for role in &roles {
        if let Role::Handle(handle) = role {
            held[*handle as usize] = true;
        }
    }
    for (number, handle) in region.handles().iter().enumerate().filter(|(number, _)| !held[*number]) {
        let vertices = handle.vertices.iter().map(|v| fine[v as usize]);
        let points = handle.rows.iter().map(|row| row.iter().map(|&(v, weight)| weight * fine[v as usize]).sum());
        let (sum, count) = vertices.chain(points).fold((DVec3::ZERO, 0), |(sum, n): (DVec3, u32), p| (sum + p, n + 1));
        let middle = sum / f64::from(count.max(1));
        let free = (0..roles.len()).filter(|&j| roles[j] == Role::Free);
        let nearest = free.min_by(|&a, &b| {
            let distance = |j: usize| coarse[j].distance_squared(middle);
            distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
        });
        // There are never more handles than vertices, which have 32-bit numbers.
        roles[nearest.ok_or(NoRoom::Handle(number))?] = Role::Handle(number as u32);
        stand_ins.push(number);
    }
    let with = |wanted: Role| VertexSet::where_true(roles.len(), |j| roles[j as usize] == wanted);
    let handles: Vec<Handle> = (0..)
        .zip(region.handles())
        .map(|(number, handle)| Handle {
            vertices: with(Role::Handle(number)),
            rows: PointRows::new(),
            constraint: handle.constraint,
        })
        .collect();
    let roi = VertexSet::where_true(roles.len(), |j| roles[j as usize] != Role::Fixed);
    let region = Region::new(roles.len(), &roi, &handles).map_err(NoRoom::Region)?;
    Ok(Carried { region, stand_ins })
}
