//! What an edit prepares for a region, and what it reads and writes.

use std::sync::Arc;

use glam::DVec3;
use pliant_linalg::Cholesky;

use super::anderson::Anderson;
use super::carried::Carried;
use super::cells::{Cells, Term};
use super::roles::Roles;
use super::rows::{Draws, Places};
use super::shape::Shape;
use super::smooth::Smoother;
use super::steps::{Columns, ENERGY_CHUNK, Row, point, row};
use super::{Acceleration, ArapOptions, Start};
use crate::fit::Fit;
use crate::frame::{Frame, check_pose};
use crate::{DeformError, Goals, Region, StepTimes};

/// What depends on the region.
pub(crate) struct Edit {
    pub(crate) region: Region,
    pub(crate) cells: Cells,
    /// Of the matrix.
    pub(crate) places: Places,
    pub(crate) roles: Roles,
    pub(crate) factor: Cholesky,
    /// If iterations are accelerated.
    pub(crate) anderson: Option<Anderson>,
    /// If they start from the turns of the handles.
    pub(crate) carried: Option<Carried>,
    /// If rotations are smoothed.
    pub(crate) smoother: Option<Smoother>,
    /// Edges of the energy; only if it has been asked for.
    pub(crate) terms: Option<Vec<Term>>,
    /// In the frame, by slot.
    pub(crate) rest: Vec<DVec3>,
    pub(crate) scratch: Scratch,
    pub(crate) times: StepTimes,
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame.
#[derive(Default)]
pub(crate) struct Scratch {
    /// By slot; only of those that equations look at.
    pub(crate) pose: Vec<Row>,
    /// By cell; only of those that are fitted.
    pub(crate) rotations: Vec<Columns>,
    /// By slot of the region.
    pub(crate) rhs: Vec<[f64; 3]>,
    /// Where those held are to be.
    pub(crate) goals: Vec<Row>,
    /// Goals of what is drawn.
    pub(crate) draws: Draws,
    /// The motion that each piece follows at first.
    pub(crate) follow: Vec<Option<Fit>>,
    /// Goals of those led, in world units.
    pub(crate) landed: Vec<DVec3>,
    /// Of [`ENERGY_CHUNK`] terms each.
    pub(crate) energy: Vec<f64>,
}

impl Edit {
    pub(crate) fn new(options: &ArapOptions, shape: &Shape, region: &Region) -> Result<Self, DeformError> {
        region.require_constrained(shape.topology())?;
        let roi: Vec<u32> = region.roi().collect();
        let cells = Cells::new(shape, &roi);
        let roles = Roles::new(shape, &cells, region);
        let (places, factor) = Places::new(&cells, region)
            .and_then(|(places, pattern)| {
                let free = |slot: usize| roles.unknowns.contains(slot);
                let values = places.values(&cells, &roles.rows, &roles.diagonal);
                Ok((places, Cholesky::of_block(Arc::new(pattern), values, free)?))
            })
            .map_err(|error| DeformError::of_system(error, &cells.vertices))?;
        let rest = cells.vertices.iter().map(|&v| shape.inner[v as usize]).collect();
        let mut scratch = Scratch {
            pose: vec![Row::default(); cells.vertices.len()],
            rotations: vec![Columns::default(); cells.cells],
            rhs: vec![[0.0; 3]; cells.roi],
            ..Scratch::default()
        };
        scratch.fit(&cells, &roles);
        let anderson = anderson(options, &roles);
        let is_accelerated = anderson.is_some();
        let smoother = smoother(shape, &cells, &roles);
        let region = region.clone();
        let times = StepTimes::default();
        let carried = carried(options, &cells, &roles);
        let mut edit = Self {
            region,
            cells,
            places,
            roles,
            factor,
            anderson,
            carried,
            smoother,
            terms: None,
            rest,
            scratch,
            times,
        };
        if options.tolerance.is_some() || is_accelerated {
            edit.prepare_energy(shape);
        }
        Ok(edit)
    }

    /// Whether a region has the same region of interest, and points that are sums of the same vertices.
    pub(crate) fn has_same_pattern(&self, region: &Region) -> bool {
        fn rows(region: &Region) -> impl Iterator<Item = impl Iterator<Item = u32>> {
            region.rows().map(|(.., row)| row.iter().map(|&(vertex, _)| vertex))
        }
        let same_rows = self.region.row_count() == region.row_count()
            && rows(&self.region).zip(rows(region)).all(|(mine, other)| mine.eq(other));
        same_rows && region.roi().eq(self.cells.vertices[..self.cells.roi].iter().copied())
    }

    /// Takes over the roles of a region with the same pattern, or changes nothing.
    pub(crate) fn set_roles(
        &mut self,
        options: &ArapOptions,
        shape: &Shape,
        region: &Region,
    ) -> Result<(), DeformError> {
        let Self { cells, places, factor, .. } = self;
        let mut refactor = |roles: &Roles| {
            let values = places.values(cells, &roles.rows, &roles.diagonal);
            factor.refactor_block(values, |slot| roles.unknowns.contains(slot))
        };
        region.require_constrained(shape.topology())?;
        let roles = Roles::new(shape, cells, region);
        if let Err(error) = refactor(&roles) {
            // The old numbers once more: they made a factor before. If not, every solve will say so.
            let _ = refactor(&self.roles);
            return Err(DeformError::of_system(error, &self.cells.vertices));
        }
        self.scratch.fit(cells, &roles);
        self.anderson = anderson(options, &roles);
        self.carried = carried(options, cells, &roles);
        self.smoother = smoother(shape, cells, &roles);
        self.roles = roles;
        self.region = region.clone();
        Ok(())
    }

    /// Makes ready for [`Self::current_energy`].
    pub(crate) fn prepare_energy(&mut self, shape: &Shape) {
        let terms = self.terms.get_or_insert_with(|| self.cells.terms(shape));
        self.scratch.energy.resize(terms.len().div_ceil(ENERGY_CHUNK), 0.0);
    }

    /// Checks the input and brings pose and goals into the frame.
    pub(crate) fn read(&mut self, shape: &Shape, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        goals.check(&self.region)?;
        check_pose(self.region.vertex_count(), positions)?;
        let Self { cells, roles, scratch, .. } = self;
        let frame = &shape.frame;
        let enter = |slot: u32| row(frame.enter(positions[cells.vertices[slot as usize] as usize]));
        for &slot in roles.unknowns.as_slice() {
            scratch.pose[slot as usize] = enter(slot);
        }
        for (&slot, goal) in roles.held.iter().zip(&mut scratch.goals) {
            *goal = enter(slot);
            scratch.pose[slot as usize] = *goal;
        }
        for (led, landed) in roles.led.iter().zip(&mut scratch.landed) {
            *landed = goals.apply(led.handle, led.rest);
            let inner = frame.enter_goal(*landed, led.handle, led.vertex)?;
            if let Some(goal) = scratch.goals.get_mut(led.held as usize) {
                *goal = row(inner);
            }
        }
        for (spring, draw) in roles.springs.iter().zip(&mut scratch.draws.springs) {
            let vertex = cells.vertices[spring.slot as usize];
            let goal = goals.apply(spring.handle, spring.rest);
            *draw = row(frame.enter_goal(goal, spring.handle, vertex)?);
        }
        scratch.draws.read(frame, &self.region, &shape.rest.positions, goals, positions)?;
        if let Some(carried) = &mut self.carried {
            carried.read(roles, goals, &self.rest, &scratch.pose);
        }
        Ok(())
    }

    /// Writes the solution, or nothing if it cannot be written in world units.
    pub(crate) fn write(&self, frame: &Frame, positions: &mut [DVec3]) -> Result<(), DeformError> {
        let Self { cells, roles, scratch, .. } = self;
        let solved = roles
            .unknowns
            .as_slice()
            .iter()
            .map(|&slot| (cells.vertices[slot as usize], frame.leave(point(scratch.pose[slot as usize]))));
        for (vertex, position) in solved.clone() {
            if !position.is_finite() {
                return Err(DeformError::ResultNotFinite { vertex });
            }
        }
        for (vertex, position) in solved {
            positions[vertex as usize] = position;
        }
        for (led, &landed) in roles.led.iter().zip(&scratch.landed) {
            positions[led.vertex as usize] = landed;
        }
        Ok(())
    }
}

impl Scratch {
    /// As many places as there are held, drawn and led.
    fn fit(&mut self, cells: &Cells, roles: &Roles) {
        self.goals.resize(roles.held.len(), Row::default());
        self.landed.resize(roles.led.len(), DVec3::ZERO);
        self.draws = Draws::new(cells, roles);
        self.follow.resize(roles.pieces.iter().max().map_or(0, |&last| last as usize + 1), None);
    }
}

fn smoother(shape: &Shape, cells: &Cells, roles: &Roles) -> Option<Smoother> {
    (shape.smoothing > 0.0).then(|| Smoother::new(cells, roles))
}

fn carried(options: &ArapOptions, cells: &Cells, roles: &Roles) -> Option<Carried> {
    (options.start == Start::Propagated).then(|| Carried::new(cells, roles))
}

fn anderson(options: &ArapOptions, roles: &Roles) -> Option<Anderson> {
    match options.acceleration {
        Acceleration::None => None,
        Acceleration::Anderson { window } => Some(Anderson::new(window as usize, roles.unknowns.as_slice().len())),
    }
}
