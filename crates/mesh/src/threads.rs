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

/// Calls `work(i, row)` for each row of a list, in any order: row `i` is `offsets[i]..offsets[i + 1]` of `list`, and the first begins with it.
pub fn for_each_row<T: Send>(offsets: &[u32], list: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    rows(offsets, 0, list, &work);
}

/// The rows between `offsets`, of which `first` is the number of the first.
fn rows<T: Send>(offsets: &[u32], first: usize, list: &mut [T], work: &(impl Fn(usize, &mut [T]) + Sync)) {
    let count = offsets.len().saturating_sub(1);
    if !is_shared(count) {
        let mut rest = list;
        for (k, ends) in offsets.windows(2).enumerate() {
            let row;
            (row, rest) = rest.split_at_mut((ends[1] - ends[0]) as usize);
            work(first + k, row);
        }
        return;
    }
    let half = count / 2;
    let (low, high) = list.split_at_mut((offsets[half] - offsets[0]) as usize);
    rayon::join(|| rows(&offsets[..=half], first, low, work), || rows(&offsets[half..], first + half, high, work));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of 0 to 6 items, few and many, whatever the first offset.
    #[test]
    fn every_row_is_given_once() {
        for count in [0u32, 1, 10, 20_000] {
            let mut offsets = vec![7];
            offsets.extend((0..count).scan(7, |end, i| {
                *end += i % 7;
                Some(*end)
            }));
            let mut list = vec![0; (offsets[count as usize] - 7) as usize];
            for_each_row(&offsets, &mut list, |i, row| {
                assert_eq!(row.len(), i % 7);
                row.iter_mut().for_each(|x| *x += i);
            });
            let expected = (0..count as usize).flat_map(|i| std::iter::repeat_n(i, i % 7));
            assert!(list.into_iter().eq(expected));
        }
        for_each_row(&[], &mut [0; 0], |_, _| panic!("there is no row"));
    }
}
