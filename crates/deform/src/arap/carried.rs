//! Rotations to start from that are carried over the region from the turns of the handles.

use glam::{DMat3, DQuat, DVec3};
use pliant_linalg::{Cholesky, LinalgError};

use super::cells::{Cells, NONE};
use super::roles::Roles;
use super::rows::Draws;
use super::steps::{Columns, Row, move_unknowns, point, row};
use crate::Goals;
use crate::fit::Fit;
use crate::goals::shortest_turn;

/// Interpolates the rotation vectors of the handles by harmonic functions (Zayer et al. 2005, section 3.1).
///
/// The equations are those of the global step without rest edges, so its factor is used; a soft handle draws the rotation
/// vectors of its vertices as it draws their positions, and rows hold those of their points as they hold their positions. What is fixed counts as one more handle.
pub(crate) struct Carried {
    /// Rotation vector of each slot that is fitted.
    turns: Vec<Row>,
    /// Rotation vectors that springs and rows draw to.
    draws: Draws,
    /// Handle of each held slot that has a rotation, [`NONE`] for one that is fixed.
    handles: Vec<u32>,
}

impl Carried {
    pub(crate) fn new(cells: &Cells, roles: &Roles) -> Self {
        let mut handles = vec![NONE; roles.rim];
        for led in &roles.led {
            if let Some(handle) = handles.get_mut(led.held as usize) {
                *handle = led.handle;
            }
        }
        let turns = vec![Row::default(); cells.vertices.len()];
        Self { turns, draws: Draws::new(cells, roles), handles }
    }

    /// Notes the turns of what is held: the handles' own, and for what is fixed the shortest that takes it from rest to `pose`.
    pub(crate) fn read(&mut self, roles: &Roles, goals: &Goals, rest: &[DVec3], pose: &[Row]) {
        let rim = || roles.held[..roles.rim].iter().map(|&slot| slot as usize).zip(&self.handles);
        let fixed = rim().filter(|(_, handle)| **handle == NONE);
        let fixed = Fit::rigid(fixed.map(|(slot, _)| (rest[slot], point(pose[slot]), 1.0)));
        let fixed = shortest_turn(DQuat::from_mat3(&fixed.rotation));
        for &slot in roles.unknowns.as_slice() {
            self.turns[slot as usize] = Row::default();
        }
        for (slot, &handle) in rim() {
            self.turns[slot] = row(if handle == NONE { fixed } else { goals.turn(handle as usize) });
        }
        for (draw, spring) in self.draws.springs.iter_mut().zip(&roles.springs) {
            *draw = row(goals.turn(spring.handle as usize));
        }
        self.draws.read_turns(&roles.rows, |handle| goals.turn(handle as usize));
    }

    /// Writes the interpolated rotation of each fitted cell; `rhs` is scratch, one per slot of the region.
    pub(crate) fn rotate(
        &mut self,
        cells: &Cells,
        roles: &Roles,
        factor: &mut Cholesky,
        rotations: &mut [Columns],
        rhs: &mut [[f64; 3]],
    ) -> Result<(), LinalgError> {
        rotations.fill(Columns::default());
        move_unknowns(cells, roles, factor, rotations, &mut self.draws, &mut self.turns, rhs)?;
        for &slot in roles.fitted.as_slice() {
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(point(self.turns[slot as usize])));
            rotations[slot as usize] = [turn.x_axis, turn.y_axis, turn.z_axis].map(row);
        }
        Ok(())
    }
}
