//! Ranges of numbers that hold all that changes.

use std::ops::Range;

/// Makes a range hold another one, too.
pub fn widen(range: &mut Range<usize>, other: &Range<usize>) {
    if other.start >= other.end {
        return;
    }
    if range.start >= range.end {
        *range = other.clone();
    } else {
        *range = range.start.min(other.start)..range.end.max(other.end);
    }
}

/// From the first place where two arrays differ to behind the last; empty at 0 where none does.
pub fn differing<A, B>(a: &[A], b: &[B], differs: impl Fn(&A, &B) -> bool) -> Range<usize> {
    let at = |i: &usize| differs(&a[*i], &b[*i]);
    let n = a.len().min(b.len());
    match (0..n).find(at) {
        Some(first) => first..(first..n).rev().find(at).map_or(first, |last| last + 1),
        None => 0..0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_what_differs_and_no_more() {
        let differ = |a: &[u8], b: &[u8]| differing(a, b, |a, b| a != b);
        assert_eq!(differ(&[1, 2, 3], &[1, 2, 3]), 0..0);
        assert_eq!(differ(&[1, 2, 3, 4], &[1, 0, 3, 0]), 1..4);
        assert_eq!(differ(&[1, 2, 3], &[1, 2, 0]), 2..3);
        let mut range = 0..0;
        for (other, expected) in [(7..7, 0..0), (3..5, 3..5), (0..0, 3..5), (8..9, 3..9), (1..4, 1..9)] {
            widen(&mut range, &other);
            assert_eq!(range, expected);
        }
    }
}
