use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Vertices by cost, the least first, in which costs can be changed; ties go to the lower number.
///
/// Round a collapse most costs grow, several times before their turn comes. So a cost that grows is only written down, and
/// the vertex filed anew once its old entry comes up. Only entries of the lowest costs are in a heap, which is small
/// then; the others lie in buckets, each for costs within a sixteenth of a power of two, without order.
#[derive(Debug)]
pub(super) struct Queue {
    heap: BinaryHeap<Reverse<Entry>>,
    buckets: Vec<Vec<Entry>>,
    /// The bucket that was last poured into the heap, where all lower costs go too.
    poured: usize,
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
        Self { heap: BinaryHeap::new(), buckets, poured: 0, slots: vec![OUT; vertex_count] }
    }

    /// Replaces what is in the queue by vertices with their costs (0 or above).
    pub(super) fn fill(&mut self, costs: impl Iterator<Item = (u32, f64)>) {
        self.heap.clear();
        self.buckets.iter_mut().for_each(Vec::clear);
        self.slots.fill(OUT);
        self.poured = 0;
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
        self.heap.pop();
        self.slots[vertex_of(top) as usize] = OUT;
        Some(vertex_of(top))
    }

    /// The least cost.
    pub(super) fn least(&mut self) -> f64 {
        self.settled().map_or(f64::INFINITY, cost_of)
    }

    /// Brings to the top of the heap an entry that says what its vertex costs; those below say no more than the truth.
    fn settled(&mut self) -> Option<Entry> {
        loop {
            let Some(&Reverse(top)) = self.heap.peek() else {
                self.pour()?;
                continue;
            };
            let Slot { cost, filed } = self.slots[vertex_of(top) as usize];
            if cost_of(top) == filed {
                if cost == filed {
                    return Some(top);
                }
                self.file(vertex_of(top), cost);
            }
            self.heap.pop();
        }
    }

    /// Makes a heap of the next bucket that holds anything.
    fn pour(&mut self) -> Option<()> {
        let next = self.poured + self.buckets[self.poured..].iter().position(|b| !b.is_empty())?;
        self.poured = next;
        let mut entries = std::mem::take(&mut self.buckets[next]);
        entries.retain(|&entry| {
            let Slot { cost, filed } = self.slots[vertex_of(entry) as usize];
            let is_true = cost_of(entry) == filed && cost == filed;
            if cost_of(entry) == filed && !is_true {
                self.file(vertex_of(entry), cost);
            }
            is_true
        });
        self.heap.extend(entries.into_iter().map(Reverse));
        Some(())
    }

    fn file(&mut self, vertex: u32, cost: f64) {
        self.slots[vertex as usize] = Slot { cost, filed: cost };
        let entry = u128::from(cost.to_bits()) << 64 | u128::from(vertex);
        let bucket = bucket_of(cost);
        if bucket <= self.poured {
            self.heap.push(Reverse(entry));
        } else {
            self.buckets[bucket].push(entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                expected = (0..100).map(|v| (v % 3 != 0).then_some((v * 7 % 10) as f64)).collect();
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
                let (v, cost) = (random() % 100, (random() % 10) as f64);
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
}
