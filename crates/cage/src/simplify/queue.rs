/// A min-heap of vertices by cost in which costs can be changed; ties go to the lower rank.
///
/// A cost that grows is only written down: the vertex sinks to its place once it reaches the top. Round a collapse most
/// costs grow, several times before their turn comes. Four children to a node: half the levels of a binary heap.
#[derive(Debug)]
pub(super) struct Queue {
    heap: Vec<Entry>,
    /// Place of each vertex in `heap`, or [`OUT`].
    place: Vec<u32>,
    /// What each vertex costs; at least what its entry says.
    cost: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    cost: f64,
    rank: u32,
    vertex: u32,
}

impl Entry {
    fn before(&self, other: &Self) -> bool {
        self.cost < other.cost || (self.cost == other.cost && self.rank < other.rank)
    }
}

const OUT: u32 = u32::MAX;

impl Queue {
    pub(super) fn new(vertex_count: usize) -> Self {
        Self { heap: Vec::new(), place: vec![OUT; vertex_count], cost: vec![0.0; vertex_count] }
    }

    /// Replaces what is in the queue by vertices with their costs (not NaN), in linear time.
    pub(super) fn fill(&mut self, costs: impl Iterator<Item = (u32, f64)>, rank: &[u32]) {
        for entry in self.heap.drain(..) {
            self.place[entry.vertex as usize] = OUT;
        }
        for (vertex, cost) in costs {
            self.cost[vertex as usize] = cost;
            self.place[vertex as usize] = self.heap.len() as u32;
            self.heap.push(Entry { cost, rank: rank[vertex as usize], vertex });
        }
        for at in (0..self.heap.len().div_ceil(4)).rev() {
            self.sink(at, self.heap[at]);
        }
    }

    /// Puts a vertex in, or moves it, to `cost` (not NaN).
    pub(super) fn set(&mut self, vertex: u32, cost: f64, rank: u32) {
        self.cost[vertex as usize] = cost;
        let entry = Entry { cost, rank, vertex };
        let at = self.place[vertex as usize];
        if at == OUT {
            self.heap.push(entry);
            self.rise(self.heap.len() - 1, entry);
        } else if cost < self.heap[at as usize].cost {
            self.rise(at as usize, entry);
        }
    }

    /// The vertex of least cost, taken out.
    pub(super) fn pop(&mut self) -> Option<u32> {
        self.settle();
        let top = self.heap.first()?.vertex;
        self.place[top as usize] = OUT;
        let last = self.heap.pop()?;
        if !self.heap.is_empty() {
            self.sink(0, last);
        }
        Some(top)
    }

    /// The least cost.
    pub(super) fn least(&mut self) -> f64 {
        self.settle();
        self.heap.first().map_or(f64::INFINITY, |top| top.cost)
    }

    /// Brings a vertex to the top that costs what its entry says; entries below say no more than the truth.
    fn settle(&mut self) {
        while let Some(&top) = self.heap.first() {
            let cost = self.cost[top.vertex as usize];
            if cost == top.cost {
                break;
            }
            self.sink(0, Entry { cost, ..top });
        }
    }

    /// Moves the gap at `at` up to where `entry` belongs and puts it there.
    fn rise(&mut self, mut at: usize, entry: Entry) {
        while at > 0 {
            let parent = (at - 1) / 4;
            if !entry.before(&self.heap[parent]) {
                break;
            }
            self.put(at, self.heap[parent]);
            at = parent;
        }
        self.put(at, entry);
    }

    /// Moves the gap at `at` down to where `entry` belongs and puts it there.
    fn sink(&mut self, mut at: usize, entry: Entry) {
        loop {
            let first = 4 * at + 1;
            let Some(&(mut least)) = self.heap.get(first) else { break };
            let mut child = first;
            for (i, other) in self.heap[first..].iter().enumerate().take(4).skip(1) {
                if other.before(&least) {
                    (child, least) = (first + i, *other);
                }
            }
            if !least.before(&entry) {
                break;
            }
            self.put(at, least);
            at = child;
        }
        self.put(at, entry);
    }

    fn put(&mut self, at: usize, entry: Entry) {
        self.heap[at] = entry;
        self.place[entry.vertex as usize] = at as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random sets, changes and pops against a list searched from end to end. Ranks run against the numbers of vertices.
    #[test]
    fn pops_in_order_of_cost_then_rank() {
        let rank: Vec<u32> = (0..100).rev().collect();
        let mut queue = Queue::new(100);
        let mut expected: Vec<Option<f64>> = vec![None; 100];
        let first = |expected: &[Option<f64>]| {
            let known = expected.iter().enumerate().filter_map(|(v, c)| c.map(|c| (c, rank[v], v)));
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
                queue.fill(costs, &rank);
            }
            if random() % 4 == 0 {
                let popped = first(&expected);
                assert_eq!(queue.least(), popped.map_or(f64::INFINITY, |p| p.0));
                assert_eq!(queue.pop(), popped.map(|p| p.2 as u32));
                if let Some((_, _, v)) = popped {
                    expected[v] = None;
                }
            } else {
                let (v, cost) = (random() % 100, (random() % 10) as f64);
                queue.set(v as u32, cost, rank[v]);
                expected[v] = Some(cost);
            }
        }
        let order = std::iter::from_fn(|| {
            let (_, _, v) = first(&expected)?;
            expected[v] = None;
            Some(v as u32)
        });
        let order: Vec<u32> = order.collect();
        assert!(order.len() > 50);
        assert_eq!(std::iter::from_fn(|| queue.pop()).collect::<Vec<_>>(), order);
        assert_eq!(queue.least(), f64::INFINITY);
    }
}
