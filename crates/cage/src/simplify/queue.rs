/// A binary min-heap of vertices by cost in which costs can be changed; ties go to the lower vertex number.
#[derive(Debug)]
pub(super) struct Queue {
    heap: Vec<u32>,
    /// Place of each vertex in `heap`, or [`OUT`].
    place: Vec<u32>,
    cost: Vec<f64>,
}

const OUT: u32 = u32::MAX;

impl Queue {
    pub(super) fn new(vertex_count: usize) -> Self {
        Self { heap: Vec::with_capacity(vertex_count), place: vec![OUT; vertex_count], cost: vec![0.0; vertex_count] }
    }

    /// Puts a vertex in, or moves it, to `cost` (not NaN).
    pub(super) fn set(&mut self, vertex: u32, cost: f64) {
        let v = vertex as usize;
        if self.place[v] == OUT {
            self.cost[v] = cost;
            self.place[v] = self.heap.len() as u32;
            self.heap.push(vertex);
            self.rise(self.heap.len() - 1);
        } else {
            let fell = cost > self.cost[v];
            self.cost[v] = cost;
            let at = self.place[v] as usize;
            if fell {
                self.sink(at);
            } else {
                self.rise(at);
            }
        }
    }

    pub(super) fn remove(&mut self, vertex: u32) {
        let at = self.place[vertex as usize];
        if at == OUT {
            return;
        }
        let at = at as usize;
        self.place[vertex as usize] = OUT;
        let last = self.heap.len() - 1;
        self.heap.swap_remove(at);
        if at < last {
            self.place[self.heap[at] as usize] = at as u32;
            self.sink(at);
            self.rise(at);
        }
    }

    /// The vertex of least cost, taken out.
    pub(super) fn pop(&mut self) -> Option<(u32, f64)> {
        let &vertex = self.heap.first()?;
        self.remove(vertex);
        Some((vertex, self.cost[vertex as usize]))
    }

    /// The least cost.
    pub(super) fn least(&self) -> f64 {
        self.heap.first().map_or(f64::INFINITY, |&v| self.cost[v as usize])
    }

    fn before(&self, a: u32, b: u32) -> bool {
        let (ca, cb) = (self.cost[a as usize], self.cost[b as usize]);
        ca < cb || (ca == cb && a < b)
    }

    fn rise(&mut self, mut at: usize) {
        while at > 0 {
            let parent = (at - 1) / 2;
            if !self.before(self.heap[at], self.heap[parent]) {
                break;
            }
            self.swap(at, parent);
            at = parent;
        }
    }

    fn sink(&mut self, mut at: usize) {
        loop {
            let left = 2 * at + 1;
            let Some(&l) = self.heap.get(left) else { break };
            let child = match self.heap.get(left + 1) {
                Some(&r) if self.before(r, l) => left + 1,
                _ => left,
            };
            if !self.before(self.heap[child], self.heap[at]) {
                break;
            }
            self.swap(at, child);
            at = child;
        }
    }

    fn swap(&mut self, a: usize, b: usize) {
        self.heap.swap(a, b);
        self.place[self.heap[a] as usize] = a as u32;
        self.place[self.heap[b] as usize] = b as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random sets, changes and removals against a sorted list.
    #[test]
    fn pops_in_order_of_cost_then_number() {
        let mut queue = Queue::new(100);
        let mut expected = vec![None; 100];
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        for _ in 0..2000 {
            let v = random() % 100;
            if random() % 4 == 0 {
                queue.remove(v as u32);
                expected[v] = None;
            } else {
                let cost = (random() % 10) as f64;
                queue.set(v as u32, cost);
                expected[v] = Some(cost);
            }
        }
        let mut order: Vec<(f64, u32)> =
            expected.iter().enumerate().filter_map(|(v, c)| c.map(|c| (c, v as u32))).collect();
        order.sort_by(|a, b| a.partial_cmp(b).expect("no NaN"));
        let popped: Vec<(f64, u32)> = std::iter::from_fn(|| queue.pop().map(|(v, c)| (c, v))).collect();
        assert_eq!(popped, order);
        assert_eq!(queue.least(), f64::INFINITY);
    }
}
