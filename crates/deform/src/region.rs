use pliant_mesh::{Topology, VertexSet};
use serde::{Deserialize, Serialize};

use crate::error::HandleFault;
use crate::points::{PointRows, RowFault};
use crate::{DeformError, Goals};

/// How a handle's vertices are held to their goals.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Constraint {
    /// Exactly: vertices are taken out of the equations, points are conditions on them.
    ///
    /// Where points cannot all be where they should (more of them than their vertices can follow, or the same point twice), they are met
    /// in the least-squares sense, see [`SolveReport::unmet`](crate::SolveReport::unmet).
    #[default]
    Hard,
    /// In the least-squares sense, with a weight in (0, inf) relative to the mean diagonal entry of the method's
    /// matrix, which makes it independent of the mesh's scale and of the kind of edge weights.
    ///
    /// Weights beyond `1e-10..1e12`, for points `1e-10..1e6`, act as those bounds: rounding leaves no difference.
    Soft(f64),
}

/// Vertices, points between them or both, that are moved together by one goal.
///
/// A handle that stays where it is has the identity as its goal; that is an anchor.
#[derive(Debug, Clone, PartialEq)]
pub struct Handle {
    /// Its vertices, all within the region of interest.
    pub vertices: VertexSet,
    /// Its points that are no vertices, each with a vertex in the region of interest. They may have vertices in common with each other
    /// and with other handles, and the vertices stay what they are without them.
    pub rows: PointRows,
    /// How they are held.
    pub constraint: Constraint,
}

impl Handle {
    /// A handle whose vertices land exactly on their goals.
    pub fn hard(vertices: VertexSet) -> Self {
        Self { vertices, rows: PointRows::new(), constraint: Constraint::Hard }
    }

    /// A handle whose vertices are drawn to their goals with a weight (see [`Constraint::Soft`]).
    pub fn soft(vertices: VertexSet, weight: f64) -> Self {
        Self { vertices, rows: PointRows::new(), constraint: Constraint::Soft(weight) }
    }

    /// A handle of points alone.
    pub fn of_points(rows: PointRows, constraint: Constraint) -> Self {
        Self { vertices: VertexSet::from_iter([]), rows, constraint }
    }
}

/// What becomes of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It stays where the pose has it, bit for bit.
    Fixed,
    /// It is solved for.
    Free,
    /// It belongs to the handle of this number.
    Handle(u32),
}

/// The region of interest of an edit and its handles: one [`Role`] per vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    roles: Vec<Role>,
    handles: Vec<Handle>,
}

impl Region {
    /// The region in which the vertices of `roi` take part, those in a handle are led by it, and all others are fixed.
    ///
    /// # Errors
    /// [`DeformError::Handle`] for a handle that is empty, leaves the region or the mesh, shares a vertex with another,
    /// has a weight that is not a positive number or a point that is no mean of vertices or has fixed ones only;
    /// [`DeformError::EmptyRegion`], [`DeformError::VertexOutOfRange`];
    /// [`DeformError::NoConstraint`] if every vertex of the mesh would be free and no point held.
    pub fn new(vertex_count: usize, roi: &VertexSet, handles: &[Handle]) -> Result<Self, DeformError> {
        if roi.is_empty() {
            return Err(DeformError::EmptyRegion);
        }
        let mut roles = vec![Role::Fixed; vertex_count];
        for vertex in roi.iter() {
            *roles
                .get_mut(vertex as usize)
                .ok_or(DeformError::VertexOutOfRange { vertex, vertices: vertex_count })? = Role::Free;
        }
        for (number, handle) in handles.iter().enumerate() {
            claim(&mut roles, number, handle).map_err(|fault| DeformError::handle(number, fault))?;
        }
        for (number, handle) in handles.iter().enumerate() {
            check_rows(&roles, &handle.rows).map_err(|fault| DeformError::handle(number, fault))?;
        }
        if roles.iter().all(|role| *role == Role::Free) && handles.iter().all(|handle| handle.rows.is_empty()) {
            return Err(DeformError::NoConstraint);
        }
        Ok(Self { roles, handles: handles.to_vec() })
    }

    /// One role per vertex.
    pub fn roles(&self) -> &[Role] {
        &self.roles
    }

    /// The handles, in the order given.
    pub fn handles(&self) -> &[Handle] {
        &self.handles
    }

    /// Number of vertices of the mesh.
    pub fn vertex_count(&self) -> usize {
        self.roles.len()
    }

    /// The points of all handles, handle by handle: handle, constraint, and number and entries of the row within it.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (u32, Constraint, usize, &[(u32, f64)])> + Clone + '_ {
        (0..).zip(&self.handles).flat_map(|(number, handle)| {
            handle.rows.iter().enumerate().map(move |(row, entries)| (number, handle.constraint, row, entries))
        })
    }

    /// Number of points of all handles.
    pub fn row_count(&self) -> usize {
        self.handles.iter().map(|handle| handle.rows.len()).sum()
    }

    /// Whether a vertex is solved for: free or in a soft handle.
    pub(crate) fn is_unknown(&self, vertex: usize) -> bool {
        match self.constraint(vertex) {
            Some(constraint) => constraint != Constraint::Hard,
            None => self.roles[vertex] == Role::Free,
        }
    }

    /// How a vertex's handle holds it, if it has one.
    pub(crate) fn constraint(&self, vertex: usize) -> Option<Constraint> {
        match self.roles[vertex] {
            Role::Handle(handle) => Some(self.handles[handle as usize].constraint),
            Role::Fixed | Role::Free => None,
        }
    }

    /// The region of interest, increasing.
    pub(crate) fn roi(&self) -> impl Iterator<Item = u32> + '_ {
        (0..).zip(&self.roles).filter(|(_, role)| **role != Role::Fixed).map(|(vertex, _)| vertex)
    }

    /// The region without the free vertices that no path along edges within the region joins to anything held, and
    /// how many those are.
    ///
    /// Nothing says where they should be, and no method is prepared for a region that has them
    /// ([`DeformError::Unconstrained`]). In the region returned they are fixed: they stay where the pose has them. Costs one walk over
    /// the edges. A region of another mesh is returned as it is, for a method to refuse.
    #[must_use]
    pub fn without_unconstrained(&self, topology: &Topology) -> (Self, usize) {
        if topology.vertex_count() != self.vertex_count() {
            return (self.clone(), 0);
        }
        let unconstrained = self.unconstrained(topology);
        let mut region = self.clone();
        for &vertex in &unconstrained {
            region.roles[vertex as usize] = Role::Fixed;
        }
        (region, unconstrained.len())
    }

    /// Refuses a region with vertices that nothing holds; `topology` has as many vertices as the region.
    pub(crate) fn require_constrained(&self, topology: &Topology) -> Result<(), DeformError> {
        let unconstrained = self.unconstrained(topology);
        match unconstrained.first() {
            Some(&vertex) => Err(DeformError::Unconstrained { vertex, count: unconstrained.len() }),
            None => Ok(()),
        }
    }

    /// Free vertices that no path along edges within the region joins to anything held, increasing.
    ///
    /// Weights of edges are positive, so a vertex is held if and only if edges between unknowns lead from it to a soft
    /// handle, to a vertex of a point or to a neighbour that is not solved for.
    fn unconstrained(&self, topology: &Topology) -> Vec<u32> {
        let mut reached = self.anchored(topology);
        for &(vertex, _) in self.rows().flat_map(|(.., row)| row) {
            reached[vertex as usize] = true;
        }
        reach(topology, &mut reached);
        (0..).zip(&reached).filter(|(_, reached)| !**reached).map(|(v, _)| v).collect()
    }

    /// Vertices that are not solved for, next to such a one, or in a soft handle.
    pub(crate) fn anchored(&self, topology: &Topology) -> Vec<bool> {
        let is_soft = |v: usize| matches!(self.constraint(v), Some(Constraint::Soft(_)));
        let is_held = |v: usize| !self.is_unknown(v) || is_soft(v);
        let near = |v: usize| topology.neighbours(v).iter().any(|&w| !self.is_unknown(w as usize));
        (0..self.vertex_count()).map(|v| is_held(v) || near(v)).collect()
    }

    /// Goals that leave every handle where it is.
    pub fn identity_goals(&self) -> Goals {
        Goals::identity(self.handles.len())
    }
}

/// Adds to the vertices that are reached all that edges lead to from them.
pub(crate) fn reach(topology: &Topology, reached: &mut [bool]) {
    let mut stack: Vec<u32> = (0..).zip(&*reached).filter(|(_, reached)| **reached).map(|(v, _)| v).collect();
    while let Some(v) = stack.pop() {
        for &w in topology.neighbours(v as usize) {
            if !std::mem::replace(&mut reached[w as usize], true) {
                stack.push(w);
            }
        }
    }
}

/// Refuses rows that are no means of vertices, or of fixed ones only.
fn check_rows(roles: &[Role], rows: &PointRows) -> Result<(), HandleFault> {
    let vertices = roles.len();
    match rows.fault(vertices) {
        Some((row, RowFault::VertexOutOfRange(vertex))) => {
            return Err(HandleFault::RowVertexOutOfRange { row, vertex, vertices });
        }
        Some((row, RowFault::NotFinite)) => return Err(HandleFault::RowNotFinite { row }),
        Some((row, RowFault::Sum(sum))) => return Err(HandleFault::RowSum { row, sum }),
        None => {}
    }
    let is_fixed = |row: &[(u32, f64)]| row.iter().all(|&(vertex, _)| roles[vertex as usize] == Role::Fixed);
    match rows.iter().position(is_fixed) {
        Some(row) => Err(HandleFault::RowOutsideRegion { row }),
        None => Ok(()),
    }
}

/// Gives a handle its vertices.
fn claim(roles: &mut [Role], number: usize, handle: &Handle) -> Result<(), HandleFault> {
    if let Constraint::Soft(weight) = handle.constraint
        && !(weight > 0.0 && weight.is_finite())
    {
        return Err(HandleFault::Weight { weight });
    }
    if handle.vertices.is_empty() && handle.rows.is_empty() {
        return Err(HandleFault::Empty);
    }
    let vertices = roles.len();
    for vertex in handle.vertices.iter() {
        let role = roles.get_mut(vertex as usize).ok_or(HandleFault::VertexOutOfRange { vertex, vertices })?;
        match *role {
            // There are never more handles than vertices, which have 32-bit numbers.
            Role::Free => *role = Role::Handle(number as u32),
            Role::Fixed => return Err(HandleFault::OutsideRegion { vertex }),
            Role::Handle(other) => return Err(HandleFault::Overlap { other: other as usize, vertex }),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(vertices: &[u32]) -> VertexSet {
        vertices.iter().copied().collect()
    }

    #[test]
    fn roles_follow_region_and_handles() {
        let handles = [Handle::hard(set(&[1])), Handle::soft(set(&[3]), 2.0)];
        let region = Region::new(5, &set(&[1, 2, 3]), &handles).expect("valid");
        let expected = [Role::Fixed, Role::Handle(0), Role::Free, Role::Handle(1), Role::Fixed];
        assert_eq!(region.roles(), expected);
        assert_eq!(region.constraint(3), Some(Constraint::Soft(2.0)));
        assert_eq!(region.constraint(2), None);
    }

    #[test]
    fn every_fault_names_its_handle() {
        let first = Handle::hard(set(&[1]));
        let fault = |handle: Handle| match Region::new(5, &set(&[1, 2, 3]), &[first.clone(), handle]) {
            Err(DeformError::Handle { handle: 1, fault }) => fault,
            other => panic!("{other:?}"),
        };
        assert_eq!(fault(Handle::hard(set(&[]))), HandleFault::Empty);
        assert_eq!(fault(Handle::hard(set(&[2, 9]))), HandleFault::VertexOutOfRange { vertex: 9, vertices: 5 });
        assert_eq!(fault(Handle::hard(set(&[2, 4]))), HandleFault::OutsideRegion { vertex: 4 });
        assert_eq!(fault(Handle::hard(set(&[1, 2]))), HandleFault::Overlap { other: 0, vertex: 1 });
        for weight in [0.0, -1.0, f64::INFINITY] {
            assert_eq!(fault(Handle::soft(set(&[2]), weight)), HandleFault::Weight { weight });
        }
        assert!(matches!(fault(Handle::soft(set(&[2]), f64::NAN)), HandleFault::Weight { .. }));
    }

    /// Two triangles and a vertex without faces, of which only the second triangle is held.
    #[test]
    fn what_nothing_holds_is_named_and_can_be_left_out() {
        let topology = Topology::new(7, vec![[0, 1, 2], [3, 4, 5]]).expect("valid");
        for (roi, handles) in [
            (set(&[0, 1, 2, 3, 4, 5, 6]), vec![Handle::hard(set(&[4]))]),
            (set(&[0, 1, 2, 3, 4, 5, 6]), vec![Handle::soft(set(&[5]), 1.0)]),
            (set(&[0, 1, 2, 3, 4, 6]), vec![]),
        ] {
            let region = Region::new(7, &roi, &handles).expect("valid");
            let error = region.require_constrained(&topology);
            assert_eq!(error, Err(DeformError::Unconstrained { vertex: 0, count: 4 }));
            let (held, left_out) = region.without_unconstrained(&topology);
            assert_eq!((left_out, held.handles()), (4, region.handles()));
            assert_eq!(held.require_constrained(&topology), Ok(()));
            for v in 0..7 {
                let expected = if [0, 1, 2, 6].contains(&v) { Role::Fixed } else { region.roles()[v] };
                assert_eq!(held.roles()[v], expected);
            }
            assert_eq!(held.without_unconstrained(&topology), (held.clone(), 0));
        }
    }

    #[test]
    fn a_region_must_exist_and_be_held() {
        assert_eq!(Region::new(3, &set(&[]), &[]), Err(DeformError::EmptyRegion));
        let error = Region::new(3, &set(&[0, 7]), &[]);
        assert_eq!(error, Err(DeformError::VertexOutOfRange { vertex: 7, vertices: 3 }));
        assert_eq!(Region::new(3, &set(&[0, 1, 2]), &[]), Err(DeformError::NoConstraint));
        // Without a handle, but with a rim to hold on to.
        assert!(Region::new(3, &set(&[0, 1]), &[]).is_ok());
    }
}
