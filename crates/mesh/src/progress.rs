/// Told how far a long computation has come; shared by the threads that do it.
///
/// Reported about a hundred times in all, never per vertex. `done` counts up to `total` but may arrive out of order.
pub trait Progress: Sync {
    /// `done` of `total` units are finished.
    fn advance(&self, done: usize, total: usize);
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
