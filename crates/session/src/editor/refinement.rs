//! From what the cage says to what the shape itself would.

use std::time::{Duration, Instant};

use pliant_deform::{ArapOptions, DeformError, Method, RefineOptions, RefineStep, Refiner};
use pliant_mesh::metrics::edge_errors;

use super::{Editor, Pose};
use crate::SessionError;

/// A step that lowers the energy by less than this share of it ends a refinement.
const SETTLED: f64 = 1e-6;

/// The last released step, ready to be refined.
pub(super) struct Refining {
    refiner: Refiner,
    /// Steps since it began.
    pub(super) steps: u32,
}

/// How far a refinement has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefineReport {
    /// Steps since the release.
    pub steps: u32,
    /// Energy of the shape, in world units; see [`Refinement::energy`].
    pub energy: f64,
    /// Root mean square of relative edge length changes from where the step of the session began.
    pub rms_relative: f64,
    /// Time that the last step took.
    pub elapsed: Duration,
}

/// What a refinement did.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Steps done in this call.
    pub steps: u32,
    /// Energy of the shape before and after, in world units ([`pliant_deform::arap::Arap::energy`]).
    pub energy: [f64; 2],
    /// Root mean square of relative edge length changes from where the step began to the refined shape.
    pub rms_relative: f64,
    /// Whether more steps would change nothing to speak of.
    pub settled: bool,
    /// Time taken, preparation included.
    pub elapsed: Duration,
}

impl Editor {
    /// Takes the step released last towards the converged as-rigid-as-possible solution on the shape itself, until the time is up or
    /// nothing is to be gained; one step of it at least. Call it again when idle. Handles stay on their goals, and nothing moves
    /// outside the region.
    ///
    /// The step is still one step to undo, and a document replays its refinement to the same bits.
    ///
    /// # Errors
    /// [`SessionError::NothingToRefine`] if nothing was released since the last undo, redo or change of handles; as [`Refiner::prepare`] and
    /// [`Refiner::step`]. Then the shape is as it was.
    pub fn refine(&mut self, budget: Duration) -> Result<Refinement, SessionError> {
        let begun = Instant::now();
        self.refine_while(|_, _| begun.elapsed() < budget)
    }

    /// As [`Self::refine`], telling energy and edge error after each step, for as long as `goes_on` says so.
    ///
    /// # Errors
    /// As [`Self::refine`].
    pub fn refine_with(&mut self, mut goes_on: impl FnMut(&RefineReport) -> bool) -> Result<Refinement, SessionError> {
        let (topology, mut pose) = (self.rest.shared_topology(), self.base.shape.clone());
        let Some(released) = &self.released else { return Err(SessionError::NothingToRefine) };
        let began = released.began.shape.clone();
        self.refine_while(|refiner, step| {
            // What cannot be written ends the refinement with its error.
            let written = refiner.positions(&mut pose).is_ok();
            let rms_relative = edge_errors(&topology, &began, &pose).rms_relative;
            written
                && goes_on(&RefineReport {
                    steps: step.iteration,
                    energy: step.energy,
                    rms_relative,
                    elapsed: step.elapsed,
                })
        })
    }

    /// So many steps, or until nothing is to be gained.
    pub(super) fn refine_steps(&mut self, steps: u32) -> Result<Refinement, SessionError> {
        self.refine_while(|_, step| step.iteration < steps)
    }

    fn refine_while(
        &mut self,
        mut goes_on: impl FnMut(&Refiner, &RefineStep) -> bool,
    ) -> Result<Refinement, SessionError> {
        let begun = Instant::now();
        let Some(released) = &mut self.released else { return Err(SessionError::NothingToRefine) };
        let mut refined = self.base.clone();
        let (mut steps, mut settled) = (0, false);
        let energy = (|| -> Result<[f64; 2], DeformError> {
            let continued = released.refining.is_some();
            let refining = match &mut released.refining {
                Some(refining) => refining,
                empty => {
                    let rest = self.rest.with_positions(released.began.shape.clone())?;
                    let refiner = Refiner::prepare(&rest, &released.region, &options(&self.options.method))?;
                    empty.insert(Refining { refiner, steps: 0 })
                }
            };
            let first =
                if continued { released.energy } else { refining.refiner.begin(&released.goals, &refined.shape)? };
            let mut last = first;
            loop {
                let step = refining.refiner.step()?;
                steps += 1;
                refining.steps += 1;
                last = step.energy.min(last);
                settled = step.settled || step.relative_change < SETTLED;
                if settled || !goes_on(&refining.refiner, &step) {
                    break;
                }
            }
            refining.refiner.positions(&mut refined.shape)?;
            Ok([first, last])
        })();
        let energy = match energy {
            Ok(energy) => energy,
            Err(error) => {
                released.refining = None;
                return Err(error.into());
            }
        };
        released.energy = energy[1];
        let rms_relative = edge_errors(self.rest.topology(), &released.began.shape, &refined.shape).rms_relative;
        let in_all = released.refining.as_ref().map_or(0, |refining| refining.steps);
        if let Some(step) = self.steps.last_mut() {
            step.refined = in_all;
        }
        self.history.amend(self.base.arrays(), refined.arrays());
        self.base = refined;
        self.current.copy_from(&self.base);
        Ok(Refinement { steps, energy, rms_relative, settled, elapsed: begun.elapsed() })
    }
}

/// The weights and the energy of the method that made the preview, or the default ones of a method without.
fn options(method: &Method) -> RefineOptions {
    match method {
        Method::Arap(ArapOptions { weights, energy, .. }) => {
            RefineOptions { weights: *weights, energy: *energy, ..RefineOptions::default() }
        }
        _ => RefineOptions::default(),
    }
}

/// A step that was released, as far as refining it needs.
pub(super) struct Released {
    /// Where it began.
    pub(super) began: Pose,
    pub(super) region: pliant_deform::Region,
    pub(super) goals: pliant_deform::Goals,
    pub(super) refining: Option<Refining>,
    /// After the last refinement.
    pub(super) energy: f64,
}
