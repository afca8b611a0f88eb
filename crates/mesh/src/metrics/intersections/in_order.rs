use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Does `jobs` jobs in parallel and hands their results to `merge` in order, until it says that this is enough by returning `false`.
///
/// Jobs are started in order too, and none once `merge` has had enough; those that run then are told by the flag, and their results are
/// dropped. So what `merge` is given is the same for any number of threads, and little is done in vain.
pub(super) fn in_order<R: Send>(
    jobs: usize,
    work: impl Fn(usize, &AtomicBool) -> R + Sync,
    merge: impl FnMut(usize, R) -> bool + Send,
) {
    let (started, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
    let merging = Mutex::new((0, BTreeMap::new(), merge));
    let worker = |_| {
        while !is_over.load(Ordering::Relaxed) {
            let job = started.fetch_add(1, Ordering::Relaxed);
            if job >= jobs {
                break;
            }
            let result = work(job, &is_over);
            let mut guard = merging.lock().unwrap_or_else(PoisonError::into_inner);
            let (next, waiting, merge) = &mut *guard;
            waiting.insert(job, result);
            while !is_over.load(Ordering::Relaxed)
                && let Some(result) = waiting.remove(next)
            {
                if !merge(*next, result) {
                    is_over.store(true, Ordering::Relaxed);
                }
                *next += 1;
            }
        }
    };
    (0..rayon::current_num_threads()).into_par_iter().with_max_len(1).for_each(worker);
}
