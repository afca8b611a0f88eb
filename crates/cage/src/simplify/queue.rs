use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Vertices by cost, the least first, in which costs can be changed; ties go to the lower number.
///
/// Round a collapse most costs grow, several times before their turn comes. So a cost that grows is only written down, and
/// the vertex filed anew once its old entry comes up. Entries lie without order in buckets, each for costs within a
/// sixteenth of a power of two; a bucket is sorted when its turn comes. What is filed after that goes to a heap, which
/// stays small. That it knows who comes next is what a plain heap would not do.
#[derive(Debug)]
pub(super) struct Queue {
    buckets: Vec<Vec<Entry>>,
    /// The bucket that was opened last, and what is left of it, the least cost at the end.
    opened: usize,
    open: Vec<Entry>,
    /// Of those, how many were not yet announced by [`Self::announce`].
    unannounced: usize,
    /// Entries filed since then that belong there or before.
    late: BinaryHeap<Reverse<Entry>>,
    slots: Vec<Slot>,
}

/// Bits of the cost, which is not negative, then the vertex. One comparison orders by all.
type Entry = u128;

/// What a vertex costs, and what its entry says, which is no more; NaN if it is not in the queue.
///
/// A cost that falls leaves the old entry behind, which is known by saying something else, or the same once more.
#[derive(Debug, Clone, Copy)]
struct Slot {
    cost: f64,
    filed: f64,
}

const OUT: Slot = Slot { cost: f64::NAN, filed: f64::NAN };

fn vertex_of(entry: Entry) -> u32 {
    entry as u32
}

fn cost_of(entry: Entry) -> f64 {
    f64::from_bits((entry >> 64) as u64)
}

/// Exponent and four more bits of a number that is not negative: grows with it.
fn bucket_of(cost: f64) -> usize {
    (cost.to_bits() >> 48) as usize
}

impl Queue {
    /// An empty queue.
    pub(super) fn new(vertex_count: usize) -> Self {
        let buckets = vec![Vec::new(); bucket_of(f64::INFINITY) + 1];
        Self {
            buckets,
            opened: 0,
            open: Vec::new(),
            unannounced: 0,
            late: BinaryHeap::new(),
            slots: vec![OUT; vertex_count],
        }
    }

    /// Replaces what is in the queue by vertices with their costs (0 or above).
    pub(super) fn fill(&mut self, costs: impl Iterator<Item = (u32, f64)>) {
        self.open.clear();
        self.unannounced = 0;
        self.late.clear();
        self.buckets.iter_mut().for_each(Vec::clear);
        self.slots.fill(OUT);
        self.opened = 0;
        costs.for_each(|(vertex, cost)| self.file(vertex, cost));
    }

    /// Puts a vertex in, or moves it, to `cost` (0 or above).
    pub(super) fn set(&mut self, vertex: u32, cost: f64) {
        let slot = &mut self.slots[vertex as usize];
        if cost >= slot.filed {
            slot.cost = cost;
        } else {
            self.file(vertex, cost);
        }
    }

    /// The vertex of least cost, taken out.
    pub(super) fn pop(&mut self) -> Option<u32> {
        let top = self.settled()?;
        self.take();
        self.slots[vertex_of(top) as usize] = OUT;
        Some(vertex_of(top))
    }

    /// The least cost.
    pub(super) fn least(&mut self) -> f64 {
        self.settled().map_or(f64::INFINITY, cost_of)
    }

    /// Names up to `most` vertices whose turn comes next, if those named before have had theirs. A guess: costs may change,
    /// and vertices filed late are left out.
    pub(super) fn announce(&mut self, most: usize, coming: &mut Vec<u32>) {
        coming.clear();
        if self.open.len() <= self.unannounced {
            self.unannounced = self.open.len().saturating_sub(most);
            coming.extend(self.open[self.unannounced..].iter().map(|&entry| vertex_of(entry)));
        }
    }

    /// Reads what is known of a vertex (see `Simplifier::read_ahead`).
    #[inline]
    pub(super) fn touch(&self, vertex: u32) -> u64 {
        self.slots[vertex as usize].cost.to_bits()
    }

    /// The least entry, brought to say what its vertex costs; the others say no more than that.
    fn settled(&mut self) -> Option<Entry> {
        loop {
            let top = match (self.open.last(), self.late.peek()) {
                (Some(&a), Some(&Reverse(b))) => a.min(b),
                (Some(&a), None) => a,
                (None, Some(&Reverse(b))) => b,
                (None, None) => {
                    self.open_next()?;
                    continue;
                }
            };
            if self.is_true(top) {
                return Some(top);
            }
            self.take();
        }
    }

    /// Whether an entry says what its vertex costs. One that says less than that is about to go, and filed anew.
    fn is_true(&mut self, entry: Entry) -> bool {
        let Slot { cost, filed } = self.slots[vertex_of(entry) as usize];
        let is_current = cost_of(entry) == filed;
        if is_current && cost > filed {
            self.file(vertex_of(entry), cost);
        }
        is_current && cost == filed
    }

    /// Removes the least entry.
    fn take(&mut self) {
        match (self.open.last(), self.late.peek()) {
            (Some(a), Some(Reverse(b))) if b < a => drop(self.late.pop()),
            (Some(_), _) => drop(self.open.pop()),
            _ => drop(self.late.pop()),
        }
    }

    /// Opens the next bucket that holds anything.
    fn open_next(&mut self) -> Option<()> {
        self.opened += self.buckets[self.opened..].iter().position(|b| !b.is_empty())?;
        let mut entries = std::mem::take(&mut self.buckets[self.opened]);
        entries.retain(|&entry| self.is_true(entry));
        entries.sort_unstable_by(|a, b| b.cmp(a));
        self.unannounced = entries.len();
        self.open = entries;
        Some(())
    }

    /// Files a vertex at what it costs.
    fn file(&mut self, vertex: u32, cost: f64) {
        // Makes a negative zero positive: its bits would come last.
        let cost = cost + 0.0;
        self.slots[vertex as usize] = Slot { cost, filed: cost };
        let entry = u128::from(cost.to_bits()) << 64 | u128::from(vertex);
        let bucket = bucket_of(cost);
        if bucket <= self.opened {
            self.late.push(Reverse(entry));
        } else {
            self.buckets[bucket].push(entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Some in one bucket, some at its ends, some far apart.
    const COSTS: [f64; 10] = [-0.0, 1e-310, 1e-20, 1.0, 1.01, 1.03, 1.0624, 1.0625, 7.0, f64::INFINITY];

    /// Random sets, changes and pops against a list searched from end to end.
    #[test]
    fn pops_in_order_of_cost_then_number() {
        let mut queue = Queue::new(100);
        let mut expected: Vec<Option<f64>> = vec![None; 100];
        let first = |expected: &[Option<f64>]| {
            let known = expected.iter().enumerate().filter_map(|(v, c)| c.map(|c| (c, v)));
            known.min_by(|a, b| a.partial_cmp(b).expect("no NaN"))
        };
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        for round in 0..4000 {
            if round % 1000 == 0 {
                expected = (0..100).map(|v| (v % 3 != 0).then_some(COSTS[v * 7 % 10])).collect();
                let costs = expected.iter().enumerate().filter_map(|(v, c)| c.map(|c| (v as u32, c)));
                queue.fill(costs);
            }
            if random() % 4 == 0 {
                let popped = first(&expected);
                assert_eq!(queue.least(), popped.map_or(f64::INFINITY, |p| p.0));
                assert_eq!(queue.pop(), popped.map(|p| p.1 as u32));
                if let Some((_, v)) = popped {
                    expected[v] = None;
                }
            } else {
                let (v, cost) = (random() % 100, COSTS[random() % 10]);
                queue.set(v as u32, cost);
                expected[v] = Some(cost);
            }
        }
        let order = std::iter::from_fn(|| {
            let (_, v) = first(&expected)?;
            expected[v] = None;
            Some(v as u32)
        });
        let order: Vec<u32> = order.collect();
        assert!(order.len() > 50);
        assert_eq!(std::iter::from_fn(|| queue.pop()).collect::<Vec<_>>(), order);
        assert_eq!(queue.least(), f64::INFINITY);
    }

    /// Without changes, those announced are those that come, each once.
    #[test]
    fn announces_who_comes_next() {
        let cost = |v: u32| 1.0 + f64::from(v * 37 % 100) * 1e-4;
        let mut queue = Queue::new(100);
        queue.fill((0..100).map(|v| (v, cost(v))));
        let (mut announced, mut popped, mut coming): (Vec<u32>, Vec<u32>, Vec<u32>) = Default::default();
        while let Some(v) = queue.pop() {
            popped.push(v);
            queue.announce(16, &mut coming);
            announced.extend(coming.iter().rev());
        }
        assert!(popped.windows(2).all(|w| cost(w[0]) < cost(w[1])) && popped.len() == 100);
        // The first comes before anything is open.
        assert_eq!(announced, popped[1..]);
    }
}
