//! Sharing out short loops: over the vertices of a cage they take tens of microseconds, hardly more than waking a thread.

use rayon::prelude::*;

/// Items a thread is given at a time, some ten microseconds of work for a local step.
pub const CHUNK: usize = 512;

/// Items from which on more than one thread is used.
const SHARED_FROM: usize = 4 * CHUNK;

fn is_shared(items: usize) -> bool {
    items >= SHARED_FROM && rayon::current_num_threads() > 1
}

/// Runs loops over `items` items: within the pool of threads if there is enough to share, and else where it is called.
///
/// A loop started outside the pool sends its caller to sleep and wakes a thread of the pool; this does so once for all loops within.
pub fn among_threads<R: Send>(items: usize, loops: impl FnOnce() -> R + Send) -> R {
    if is_shared(items) { rayon::scope(|_| loops()) } else { loops() }
}

/// Calls `work(chunk, items)` for each [`CHUNK`] of `items`, in any order.
pub fn for_each_chunk<T: Send>(items: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    if is_shared(items.len()) {
        items.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, items)| work(chunk, items));
    } else {
        items.chunks_mut(CHUNK).enumerate().for_each(|(chunk, items)| work(chunk, items));
    }
}
