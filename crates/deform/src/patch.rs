//! The part of a mesh that an edit looks at.

use glam::DVec3;
use pliant_mesh::TriMesh;

use crate::frame::{Frame, check_count, check_pose};
use crate::{Constraint, DeformError, Goals, Region, Role};

/// Soft weights beyond these act as these: rounding leaves no difference.
pub(crate) const SOFT_RANGE: [f64; 2] = [1e-10, 1e12];

/// A soft handle's weight within the range that makes a difference.
pub(crate) fn soft_weight(weight: f64) -> f64 {
    weight.clamp(SOFT_RANGE[0], SOFT_RANGE[1])
}

/// What holds a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Held {
    /// Nothing: it is solved for.
    Unknown,
    /// It is solved for and drawn to its goal by a soft handle.
    Spring {
        /// The handle.
        handle: u32,
        /// As [`Constraint::Soft`] has it, within the range that makes a difference.
        weight: f64,
    },
    /// A hard handle, which takes it to its goal.
    Led {
        /// The handle.
        handle: u32,
    },
    /// It is outside the region of interest.
    Fixed,
}

impl Held {
    /// Whether its position is an unknown of the equations.
    pub(crate) fn is_unknown(self) -> bool {
        matches!(self, Self::Unknown | Self::Spring { .. })
    }

    /// The handle it belongs to.
    pub(crate) fn handle(self) -> Option<u32> {
        match self {
            Self::Spring { handle, .. } | Self::Led { handle } => Some(handle),
            Self::Unknown | Self::Fixed => None,
        }
    }
}

/// The region of interest with some rings of fixed vertices round it, as a mesh of its own, in the frame of the whole
/// rest shape. Vertices are numbered anew, increasing with their numbers in the whole mesh.
#[derive(Debug, Clone)]
pub(crate) struct Patch {
    pub(crate) frame: Frame,
    /// At rest, in the frame.
    pub(crate) mesh: TriMesh,
    /// Number in the whole mesh of each vertex, increasing.
    pub(crate) vertices: Vec<u32>,
    /// One per vertex.
    pub(crate) held: Vec<Held>,
    region: Region,
    /// Vertices with a goal, by handle, so that of several bad goals the first is named; and their rest positions in world
    /// units.
    goals: Vec<(u32, DVec3)>,
}

impl Patch {
    /// The part of `rest` within `rings` rings of the region of interest, with the triangles that have all their corners there.
    ///
    /// # Errors
    /// [`DeformError::WrongCount`] for a region of another mesh, [`DeformError::Mesh`] for a rest shape that is not finite,
    /// [`DeformError::Unconstrained`], [`DeformError::PointsNotTaken`].
    pub(crate) fn new(rest: &TriMesh, region: &Region, rings: usize) -> Result<Self, DeformError> {
        check_count("vertices of the region", rest.vertex_count(), region.vertex_count())?;
        check_pose(rest.vertex_count(), &rest.positions)?;
        if let Some((handle, ..)) = region.rows().next() {
            return Err(DeformError::PointsNotTaken { handle: handle as usize });
        }
        region.require_constrained(rest.topology())?;
        let frame = Frame::of(rest);
        let vertices = within_rings(rest, region, rings);
        const NONE: u32 = u32::MAX;
        let mut local = vec![NONE; rest.vertex_count()];
        for (k, &v) in (0..).zip(&vertices) {
            local[v as usize] = k;
        }
        let triangles = rest.triangles().iter().map(|t| t.map(|v| local[v as usize]));
        let triangles = triangles.filter(|t| !t.contains(&NONE)).collect();
        let positions = vertices.iter().map(|&v| frame.enter(rest.positions[v as usize])).collect();
        let mesh = TriMesh::new(positions, triangles)?;
        let held: Vec<Held> = vertices.iter().map(|&v| held(region, v as usize)).collect();
        let mut goals: Vec<(u32, DVec3)> = (0..held.len() as u32)
            .filter(|&k| held[k as usize].handle().is_some())
            .map(|k| (k, rest.positions[vertices[k as usize] as usize]))
            .collect();
        goals.sort_by_key(|&(k, _)| held[k as usize].handle());
        Ok(Self { frame, mesh, vertices, held, region: region.clone(), goals })
    }

    /// How many vertices are solved for.
    pub(crate) fn unknown_count(&self) -> usize {
        self.held.iter().filter(|held| held.is_unknown()).count()
    }

    /// Checks the input, and writes for each vertex of the patch, in the frame, its goal if it has one, hard or soft, and its place in
    /// the incoming pose if not. Allocates only on the first call.
    pub(crate) fn read(&self, goals: &Goals, positions: &[DVec3], out: &mut Vec<DVec3>) -> Result<(), DeformError> {
        goals.check(&self.region)?;
        check_pose(self.region.vertex_count(), positions)?;
        out.clear();
        out.extend(self.vertices.iter().map(|&v| self.frame.enter(positions[v as usize])));
        for (k, handle, goal) in self.goals(goals) {
            out[k] = self.frame.enter_goal(goal, handle, self.vertices[k])?;
        }
        Ok(())
    }

    /// Writes a solution, one point in the frame per vertex of the patch, to the whole mesh: the unknowns from `solution`, and the
    /// vertices of hard handles exactly where their goal takes them. Nothing is written on an error.
    ///
    /// # Errors
    /// [`DeformError::ResultNotFinite`].
    pub(crate) fn write(&self, solution: &[DVec3], goals: &Goals, positions: &mut [DVec3]) -> Result<(), DeformError> {
        let unknowns = || {
            let all = self.vertices.iter().zip(&self.held).zip(solution);
            all.filter(|((_, held), _)| held.is_unknown()).map(|((&v, _), &p)| (v, self.frame.leave(p)))
        };
        if let Some((vertex, _)) = unknowns().find(|(_, position)| !position.is_finite()) {
            return Err(DeformError::ResultNotFinite { vertex });
        }
        for (vertex, position) in unknowns() {
            positions[vertex as usize] = position;
        }
        for (k, _, goal) in self.goals(goals).filter(|&(k, ..)| !self.held[k].is_unknown()) {
            positions[self.vertices[k] as usize] = goal;
        }
        Ok(())
    }

    /// Vertices that have a goal, with their handle and the goal in world units, handle by handle.
    fn goals<'a>(&'a self, goals: &'a Goals) -> impl Iterator<Item = (usize, u32, DVec3)> + 'a {
        self.goals.iter().filter_map(move |&(k, rest)| {
            let handle = self.held[k as usize].handle()?;
            Some((k as usize, handle, goals.apply(handle, rest)))
        })
    }
}

fn held(region: &Region, vertex: usize) -> Held {
    match region.roles()[vertex] {
        Role::Fixed => Held::Fixed,
        Role::Free => Held::Unknown,
        Role::Handle(handle) => match region.handles()[handle as usize].constraint {
            Constraint::Hard => Held::Led { handle },
            Constraint::Soft(weight) => Held::Spring { handle, weight: soft_weight(weight) },
        },
    }
}

/// The region of interest and what is at most `rings` edges away from it, increasing.
fn within_rings(rest: &TriMesh, region: &Region, rings: usize) -> Vec<u32> {
    let mut vertices: Vec<u32> = region.roi().collect();
    let mut is_in = vec![false; rest.vertex_count()];
    for &v in &vertices {
        is_in[v as usize] = true;
    }
    let mut inner = 0;
    for _ in 0..rings {
        let end = vertices.len();
        for k in inner..end {
            for &w in rest.topology().neighbours(vertices[k] as usize) {
                if !std::mem::replace(&mut is_in[w as usize], true) {
                    vertices.push(w);
                }
            }
        }
        inner = end;
    }
    vertices.sort_unstable();
    vertices
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{Similarity, VertexSet, shapes};

    use super::*;
    use crate::Handle;

    /// A sheet of 9 by 7 vertices; a band of it is the region, with a hard and a soft handle in it.
    fn sheet() -> (TriMesh, Region) {
        let mesh = shapes::bumpy_plane(8, 6, 4.0, 3.0, 0.2, 1).expect("valid size");
        let shift = DVec3::new(10.0, -20.0, 5.0);
        let mesh = mesh.with_positions(mesh.positions.iter().map(|p| *p * 100.0 + shift).collect()).expect("finite");
        let bounds = mesh.bounds();
        let n = mesh.vertex_count();
        let at = |v: u32| bounds.to_box(mesh.positions[v as usize]).x;
        let band = VertexSet::where_true(n, |v| (0.3..0.7).contains(&at(v)));
        let (first, second) = (band.as_slice()[0], band.as_slice()[band.len() - 1]);
        let handles = [Handle::soft(VertexSet::from_iter([second]), 1e30), Handle::hard(VertexSet::from_iter([first]))];
        let region = Region::new(n, &band, &handles).expect("valid");
        (mesh, region)
    }

    #[test]
    fn a_patch_has_the_region_and_its_rings() {
        let (mesh, region) = sheet();
        let mut last = 0;
        for rings in 0..4 {
            let patch = Patch::new(&mesh, &region, rings).expect("valid");
            assert!(patch.vertices.is_sorted() && patch.vertices.len() > last);
            last = patch.vertices.len();
            assert_eq!(patch.unknown_count(), region.roi().count() - 1);
            assert_eq!(
                patch.held.len() - patch.held.iter().filter(|h| **h == Held::Fixed).count(),
                region.roi().count()
            );
            // One ring keeps every neighbour and every face of the region.
            for (k, &v) in patch.vertices.iter().enumerate() {
                let position = patch.frame.leave(patch.mesh.positions[k]);
                assert!(position.distance(mesh.positions[v as usize]) < 1e-12 * mesh.bounds().diagonal());
                if rings > 0 && patch.held[k] != Held::Fixed {
                    let local = patch.mesh.topology().neighbours(k).iter().map(|&j| patch.vertices[j as usize]);
                    assert!(local.eq(mesh.topology().neighbours(v as usize).iter().copied()));
                    let faces = mesh.topology().vertex_faces(v as usize).len();
                    assert_eq!(patch.mesh.topology().vertex_faces(k).len(), faces);
                }
            }
        }
    }

    #[test]
    fn what_is_read_and_written_follows_the_roles() {
        let (mesh, region) = sheet();
        let patch = Patch::new(&mesh, &region, 1).expect("valid");
        let goals = Goals::new(vec![
            Similarity::about(mesh.positions[0], DVec3::X, 1.0, 2.0),
            Similarity::about(mesh.positions[3], DVec3::Y, -2.0, 0.7),
        ]);
        let pose: Vec<DVec3> = mesh.positions.iter().map(|p| *p + DVec3::ONE).collect();
        let mut inner = Vec::new();
        patch.read(&goals, &pose, &mut inner).expect("valid");
        let solution: Vec<DVec3> = inner.iter().map(|p| *p * 2.0).collect();
        let mut written = pose.clone();
        patch.write(&solution, &goals, &mut written).expect("finite");
        for (k, &v) in patch.vertices.iter().enumerate() {
            let (v, held) = (v as usize, patch.held[k]);
            let goal = held.handle().map(|h| goals.transforms[h as usize].apply(mesh.positions[v]));
            let expected = patch.frame.enter(goal.unwrap_or(pose[v]));
            assert_eq!(inner[k], expected);
            match held {
                Held::Fixed => assert_eq!(written[v], pose[v]),
                Held::Led { .. } => assert_eq!(Some(written[v]), goal),
                Held::Unknown | Held::Spring { .. } => assert_eq!(written[v], patch.frame.leave(solution[k])),
            }
            if let Held::Spring { weight, .. } = held {
                assert_eq!(weight, SOFT_RANGE[1]);
            }
        }
        let untouched = (0..pose.len()).filter(|v| !patch.vertices.contains(&(*v as u32)));
        assert!(untouched.into_iter().all(|v| written[v] == pose[v]));
    }

    #[test]
    fn bad_input_is_refused_and_nothing_is_written() {
        let (mesh, region) = sheet();
        let patch = Patch::new(&mesh, &region, 1).expect("valid");
        let (goals, mut out) = (region.identity_goals(), Vec::new());
        let far = Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::splat(1e200))]);
        let error = patch.read(&far, &mesh.positions, &mut out).expect_err("too far");
        assert!(matches!(error, DeformError::Handle { handle: 1, .. }), "{error}");
        assert!(patch.read(&goals, &mesh.positions[1..], &mut out).is_err());
        let mut pose = mesh.positions.clone();
        pose[0].x = f64::NAN;
        assert!(patch.read(&goals, &pose, &mut out).is_err());
        let free = patch.held.iter().position(|held| *held == Held::Unknown).expect("there is one");
        let mut solution = patch.mesh.positions.clone();
        solution[free].z = f64::INFINITY;
        let mut written = mesh.positions.clone();
        let error = patch.write(&solution, &goals, &mut written).expect_err("not finite");
        assert_eq!(error, DeformError::ResultNotFinite { vertex: patch.vertices[free] });
        assert_eq!(written, mesh.positions);
    }
}
