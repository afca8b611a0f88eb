//! Steps: noted, undone, done again, and given up.

use pliant_mesh::Similarity;

use super::held::on_shape;
use super::refining::Released;
use super::{DocumentStep, Editor, Pose, Update};
use crate::SessionError;
use crate::history::{History, State};

impl Editor {
    /// As [`Self::release`], but one step with the last one if that was released under the same name with the same handles and
    /// region: a drag in several strokes.
    ///
    /// # Errors
    /// As [`Self::release`].
    pub fn release_on(&mut self, name: &str) -> Result<Update, SessionError> {
        let update = self.release_step(name)?;
        let done = self.steps.len() - self.history.redoable();
        if let [.., before, last] = &self.steps[..done]
            && before.is_continued_by(last)
        {
            self.released = None;
            // Undone together; a document replays both.
            if self.history.join_last(self.base.arrays())
                && let Some(last) = self.steps.last_mut()
            {
                last.joined = true;
            }
        }
        self.history.trim();
        Ok(update)
    }

    /// Gives the step up: goals go back to where it began, and so does what is shown.
    pub fn cancel(&mut self) {
        for handle in &mut self.handles {
            handle.goal = Similarity::IDENTITY;
        }
        self.current.copy_from(&self.base);
        if let Some(prepared) = self.prepared.as_mut().filter(|prepared| !prepared.stale) {
            // What goals there were is no longer shown.
            prepared.carrier.aim(&self.handles, &self.base);
        }
    }

    /// Does several things as one: if they fail, all is as it was before, but that the step released last can no longer be refined.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn transaction<T>(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<T, SessionError>,
    ) -> Result<T, SessionError> {
        let shown = Pose { shape: self.positions().to_vec(), cage: self.current.cage.clone() };
        let displaced = self.current.displaced.clone();
        let kept = (self.base.clone(), self.history.clone(), self.steps.clone());
        let input = (self.region.clone(), self.handles.clone(), self.next_id);
        let made = work(self);
        if made.is_err() {
            (self.base, self.history, self.steps) = kept;
            self.current.restore(&shown, displaced);
            (self.region, self.handles, self.next_id) = input;
            (self.prepared, self.released) = (None, None);
        }
        made
    }

    /// Takes back the last step, to the bit; a step under way is given up first, which counts as one. `false` if there is none.
    pub fn undo(&mut self) -> bool {
        if self.is_under_way() {
            self.cancel();
            return true;
        }
        self.travel(History::undo)
    }

    /// Does the step last undone again, to the bit. `false` if there is none, or a step is under way.
    pub fn redo(&mut self) -> bool {
        !self.is_under_way() && self.travel(History::redo)
    }

    fn travel(&mut self, go: impl FnOnce(&mut History, State<'_>) -> bool) -> bool {
        let went = go(&mut self.history, self.base.state());
        if went {
            self.current.copy_from(&self.base);
            self.prepared = None;
            self.released = None;
        }
        went
    }

    /// Whether a handle has left the place where the step began.
    pub(super) fn is_under_way(&self) -> bool {
        let moved = !self.current.displaced.is_empty() || self.current.cage != self.base.cage;
        moved || self.handles.iter().any(|h| h.goal != Similarity::IDENTITY)
    }

    /// The steps, the oldest first; those that are undone come last ([`Document::undone`](super::Document::undone)).
    pub fn steps(&self) -> &[DocumentStep] {
        &self.steps
    }

    /// Steps that can be undone, and redone.
    pub fn undo_depth(&self) -> (usize, usize) {
        (self.history.undoable(), self.history.redoable())
    }

    /// Steps that can no longer be undone because memory for them ran out ([`EditorOptions::history_bytes`](super::EditorOptions::history_bytes)).
    pub fn forgotten_steps(&self) -> usize {
        self.history.dropped()
    }

    /// Notes the step from `base` to what was made of it, and begins the next. `corners` are those of [`on_shape`].
    pub(super) fn note(&mut self, name: &str, made: Pose, corners: &[u32]) {
        let refinable = on_shape(self, corners).ok();
        let done = self.steps.len() - self.redoable_steps();
        self.steps.truncate(done);
        self.steps.push(DocumentStep::new(name, self.region(), &self.handles));
        self.history.append(self.base.arrays(), made.arrays());
        let began = std::mem::replace(&mut self.base, made);
        self.current.copy_from(&self.base);
        for handle in &mut self.handles {
            handle.goal = Similarity::IDENTITY;
        }
        self.released = refinable.map(|held| Released { began, held, refining: None });
    }

    /// Steps of the document that are undone: those that were joined count with the one they joined.
    pub(super) fn redoable_steps(&self) -> usize {
        let (mut left, mut steps) = (self.history.redoable(), 0);
        for step in self.steps.iter().rev() {
            if left == 0 {
                break;
            }
            steps += 1;
            left -= usize::from(!step.joined);
        }
        steps
    }
}
