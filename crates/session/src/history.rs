//! Steps that can be undone.

use std::sync::Arc;

use glam::DVec3;
use pliant_mesh::ranges::differing;

/// The two position arrays that an edit changes.
pub(crate) struct State<'a> {
    pub(crate) shape: &'a mut [DVec3],
    pub(crate) pose: &'a mut [DVec3],
}

/// What one step changed: where the other state (before it, or once undone, after it) differs.
#[derive(Debug, Clone)]
struct Entry {
    shape: Stretch,
    pose: Stretch,
}

/// Consecutive positions.
#[derive(Debug, Clone)]
struct Stretch {
    first: usize,
    positions: Vec<DVec3>,
}

impl Stretch {
    /// What `before` has where it differs from `after`, from the first such place to the last.
    fn of(before: &[DVec3], after: &[DVec3]) -> Self {
        let range = differing(before, after, |a, b| a.to_array().map(f64::to_bits) != b.to_array().map(f64::to_bits));
        Self { first: range.start, positions: before[range].to_vec() }
    }

    fn swap(&mut self, positions: &mut [DVec3]) {
        positions[self.first..][..self.positions.len()].swap_with_slice(&mut self.positions);
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.positions[..])
    }

    /// What the earlier of two steps would hold if they were one; `after` is the state after both.
    fn joined(&self, later: &Self, after: &[DVec3]) -> Self {
        if later.positions.is_empty() {
            return self.clone();
        }
        if self.positions.is_empty() {
            return later.clone();
        }
        let first = self.first.min(later.first);
        let end = (self.first + self.positions.len()).max(later.first + later.positions.len());
        let mut positions = after[first..end].to_vec();
        positions[later.first - first..][..later.positions.len()].copy_from_slice(&later.positions);
        positions[self.first - first..][..self.positions.len()].copy_from_slice(&self.positions);
        Self { first, positions }
    }
}

/// Steps done and undone. Undoing swaps arrays, so that any number of undos and redos gives back the very bits.
#[derive(Debug, Clone)]
pub(crate) struct History {
    /// Shared with copies of the history, which are cheap.
    entries: Vec<Arc<Entry>>,
    /// How many of them are done.
    done: usize,
    budget: usize,
    /// Steps too old to be undone, dropped for the budget.
    dropped: usize,
}

impl History {
    pub(crate) fn new(budget: usize) -> Self {
        Self { entries: Vec::new(), done: 0, budget, dropped: 0 }
    }

    /// Steps that can be undone.
    pub(crate) fn undoable(&self) -> usize {
        self.done
    }

    /// Steps that can be redone.
    pub(crate) fn redoable(&self) -> usize {
        self.entries.len() - self.done
    }

    pub(crate) fn dropped(&self) -> usize {
        self.dropped
    }

    pub(crate) fn bytes(&self) -> usize {
        self.entries.iter().map(|e| e.shape.bytes() + e.pose.bytes()).sum()
    }

    /// Notes a step from `before` to `after`, each a shape and a pose; what was undone is forgotten. The oldest steps go where memory
    /// runs out, but never this one.
    #[cfg(test)]
    fn push(&mut self, before: [&[DVec3]; 2], after: [&[DVec3]; 2]) {
        self.append(before, after);
        self.trim();
    }

    /// Makes what goes from `before`, the state after the last step, to `after` part of that step.
    pub(crate) fn amend(&mut self, before: [&[DVec3]; 2], after: [&[DVec3]; 2]) {
        self.append(before, after);
        self.join_last(after);
        self.trim();
    }

    /// Notes a step from `before` to `after`, each a shape and a pose; what was undone is forgotten.
    pub(crate) fn append(&mut self, before: [&[DVec3]; 2], after: [&[DVec3]; 2]) {
        self.entries.truncate(self.done);
        let [shape, pose] = [0, 1].map(|k| Stretch::of(before[k], after[k]));
        self.entries.push(Arc::new(Entry { shape, pose }));
        self.done += 1;
    }

    /// Drops the oldest steps where memory runs out, but never the last one.
    pub(crate) fn trim(&mut self) {
        let mut bytes = self.bytes();
        let mut oldest = 0;
        while bytes > self.budget && oldest + 1 < self.entries.len() {
            bytes -= self.entries[oldest].shape.bytes() + self.entries[oldest].pose.bytes();
            oldest += 1;
        }
        self.entries.drain(..oldest);
        self.done -= oldest;
        self.dropped += oldest;
    }

    /// Makes one step of the last two; `now` is the state after them. `false` if there are not two.
    pub(crate) fn join_last(&mut self, now: [&[DVec3]; 2]) -> bool {
        if self.redoable() > 0 || self.done < 2 {
            return false;
        }
        let (Some(later), Some(earlier)) = (self.entries.pop(), self.entries.last_mut()) else { return false };
        let earlier = Arc::make_mut(earlier);
        earlier.shape = earlier.shape.joined(&later.shape, now[0]);
        earlier.pose = earlier.pose.joined(&later.pose, now[1]);
        self.done -= 1;
        true
    }

    /// Whether there was a step to undo.
    pub(crate) fn undo(&mut self, mut state: State<'_>) -> bool {
        let Some(last) = self.done.checked_sub(1) else { return false };
        Arc::make_mut(&mut self.entries[last]).swap(&mut state);
        self.done = last;
        true
    }

    /// Whether there was a step to redo.
    pub(crate) fn redo(&mut self, mut state: State<'_>) -> bool {
        let Some(next) = self.entries.get_mut(self.done) else { return false };
        Arc::make_mut(next).swap(&mut state);
        self.done += 1;
        true
    }
}

impl Entry {
    fn swap(&mut self, state: &mut State<'_>) {
        self.shape.swap(state.shape);
        self.pose.swap(state.pose);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions with some of them moved: deterministic, and different for each `seed`.
    fn moved(from: &[DVec3], seed: usize) -> Vec<DVec3> {
        let mut to = from.to_vec();
        let (first, count) = (seed * 7 % from.len(), 1 + seed * 3 % 5);
        for p in to.iter_mut().skip(first).take(count) {
            *p += DVec3::new(seed as f64, 0.1, -0.3);
        }
        to
    }

    #[test]
    fn any_walk_gives_back_the_bits() {
        let mut states = vec![(vec![DVec3::ZERO; 20], vec![DVec3::ONE; 6])];
        let mut history = History::new(usize::MAX);
        let (mut shape, mut pose) = states[0].clone();
        let mut at = 0;
        let mut random = 1u64;
        for step in 1..1000 {
            random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            match (random >> 33) % 4 {
                0 => {
                    let undone = history.undo(State { shape: &mut shape, pose: &mut pose });
                    assert_eq!(undone, at > 0);
                    at -= usize::from(undone);
                }
                1 => {
                    let redone = history.redo(State { shape: &mut shape, pose: &mut pose });
                    assert_eq!(redone, at + 1 < states.len());
                    at += usize::from(redone);
                }
                kind => {
                    let next = (moved(&shape, step), moved(&pose, step));
                    history.push([&shape, &pose], [&next.0, &next.1]);
                    states.truncate(at + 1);
                    if kind == 3 && at > 0 && history.join_last([&next.0, &next.1]) {
                        states.truncate(at);
                        at -= 1;
                    }
                    states.push(next.clone());
                    (shape, pose) = next;
                    at += 1;
                }
            }
            assert!(shape == states[at].0 && pose == states[at].1, "step {step}");
            assert_eq!((history.undoable(), history.redoable()), (at, states.len() - 1 - at));
        }
    }

    #[test]
    fn the_oldest_go_where_memory_runs_out() {
        let (mut shape, pose) = (vec![DVec3::ZERO; 100], vec![DVec3::ZERO; 4]);
        let mut history = History::new(5 * 100 * size_of::<DVec3>());
        for step in 0..20 {
            let next: Vec<DVec3> = shape.iter().map(|p| *p + DVec3::X * (1.0 + f64::from(step))).collect();
            history.push([&shape, &pose], [&next, &pose]);
            shape = next;
        }
        assert_eq!((history.undoable(), history.dropped()), (5, 15));
        assert!(history.bytes() <= 5 * 100 * size_of::<DVec3>());
        // The last step always stays.
        let mut tight = History::new(0);
        tight.push([&shape, &pose], [&vec![DVec3::ONE; 100], &pose]);
        assert_eq!(tight.undoable(), 1);
        // What is amended stays one step with it, however little memory there is.
        let (mut end, mut still) = (vec![2.0 * DVec3::ONE; 100], pose.clone());
        tight.amend([&vec![DVec3::ONE; 100], &pose], [&end, &pose]);
        assert_eq!((tight.undoable(), tight.dropped()), (1, 0));
        assert!(tight.undo(State { shape: &mut end, pose: &mut still }) && end == shape);
    }
}
