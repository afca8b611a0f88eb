use std::sync::atomic::{AtomicBool, Ordering};

/// Told how far a long computation has come, and asked whether it should go on; shared by the threads that do it.
///
/// Reported about a hundred times in all, never per vertex. `done` counts up to `total` but may arrive out of order.
pub trait Progress: Sync {
    /// `done` of `total` units are finished.
    fn advance(&self, done: usize, total: usize);

    /// Whether the computation should stop. It is asked at least as often as it reports, and ends with an error that says so.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Reports to nobody.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn advance(&self, _done: usize, _total: usize) {}
}

impl<F: Fn(usize, usize) + Sync> Progress for F {
    fn advance(&self, done: usize, total: usize) {
        self(done, total);
    }
}

/// Reports to another, and stops the computation once a flag is set (by another thread, a signal, a button).
#[derive(Clone, Copy)]
pub struct Cancellable<'a> {
    progress: &'a dyn Progress,
    cancel: &'a AtomicBool,
}

impl<'a> Cancellable<'a> {
    /// Reports to `progress` until `cancel` is set.
    pub fn new(progress: &'a dyn Progress, cancel: &'a AtomicBool) -> Self {
        Self { progress, cancel }
    }
}

impl Progress for Cancellable<'_> {
    fn advance(&self, done: usize, total: usize) {
        self.progress.advance(done, total);
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed) || self.progress.is_cancelled()
    }
}
