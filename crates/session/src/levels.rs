//! Coarser and coarser meshes above a mesh.

use std::sync::Arc;

use glam::DVec3;
use pliant_cage::{BindOptions, Binding, CageError, CageSize, Propagator, simplify};
use pliant_deform::{Region, Role};
use pliant_mesh::{Progress, TriMesh};

use crate::transfer::carry_region;

/// Each level has this share of the vertices of the one below.
const COARSENING: f64 = 0.25;

/// A level above a cage with fewer vertices is not worth making.
const SMALLEST: usize = 60;

/// Coarser and coarser meshes above a mesh (a cage, or a large shape), each bound to the next coarser one.
///
/// Alternating local and global steps spread a rotation a few rings an iteration, so what takes hundreds of iterations on a cage takes
/// a few on one with a sixteenth of its vertices, for a sixteenth of the time each.
#[derive(Debug, Clone, Default)]
pub struct Levels {
    /// Finest first.
    pub(crate) levels: Vec<Arc<Level>>,
}

/// One coarser mesh.
#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) mesh: TriMesh,
    /// Of each vertex, its number in the next finer mesh.
    origin: Vec<u32>,
    /// Of the next finer mesh to this one.
    binding: Binding,
}

impl Levels {
    /// Levels above a cage, down to a few hundred vertices; none above one that has no more.
    ///
    /// Takes about a tenth of the time that the cage itself took.
    ///
    /// # Errors
    /// As [`simplify`] and [`pliant_cage::Simplified::bind`].
    pub fn new(cage: &TriMesh, progress: &dyn Progress) -> Result<Self, CageError> {
        Self::down_to(SMALLEST, cage, &BindOptions::default(), progress)
    }

    /// Levels above any mesh, none with fewer than `smallest` vertices, each bound to the next as `options` say.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn down_to(
        smallest: usize,
        mesh: &TriMesh,
        options: &BindOptions,
        progress: &dyn Progress,
    ) -> Result<Self, CageError> {
        let mut levels: Vec<Arc<Level>> = Vec::new();
        loop {
            let finer = levels.last().map_or(mesh, |level| &level.mesh);
            let size = (COARSENING * finer.vertex_count() as f64) as usize;
            if size < smallest {
                return Ok(Self { levels });
            }
            let made = simplify(finer, &CageSize::Vertices(size).into(), progress)?;
            // A mesh that cannot be made much coarser is no help.
            if made.report.reached > finer.vertex_count() / 2 {
                return Ok(Self { levels });
            }
            let binding = made.bind(finer, options, progress)?;
            levels.push(Arc::new(Level { mesh: made.mesh, origin: made.origin, binding }));
        }
    }

    /// Vertices of each level, finest first.
    pub fn sizes(&self) -> impl Iterator<Item = usize> + '_ {
        self.levels.iter().map(|level| level.mesh.vertex_count())
    }
}

impl Level {
    /// Of a pose of the next finer mesh, what this one has.
    pub(crate) fn part_of<'a>(&'a self, finer: &'a [DVec3]) -> impl Iterator<Item = DVec3> + 'a {
        self.origin.iter().map(|&v| finer[v as usize])
    }

    /// A region of the next finer mesh on this one, with the rest positions of both; `None` if nothing of it is left.
    pub(crate) fn region(&self, region: &Region, finer_rest: &[DVec3], rest: &[DVec3]) -> Option<Region> {
        let carried = carry_region(region, &self.origin, finer_rest, rest).ok()?;
        Some(carried.region.without_unconstrained(self.mesh.topology()).0)
    }

    /// Carries a motion of this mesh to a pose of the next finer one by frames, as an increment: what the pose had of its own stays.
    /// `after` comes in as the pose `before`, too; what the finer mesh's `region` has fixed keeps its bits.
    pub(crate) fn carry(
        &self,
        propagator: &mut Propagator,
        [from, to]: [&[DVec3]; 2],
        region: &Region,
        before: &[DVec3],
        after: &mut [DVec3],
    ) {
        propagator.carry(&self.binding, from, to, after);
        for ((after, before), role) in after.iter_mut().zip(before).zip(region.roles()) {
            if *role == Role::Fixed {
                *after = *before;
            }
        }
    }
}
