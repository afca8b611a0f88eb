//! How fast this machine is, just now, at the kind of work that stages consist of.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::hint::black_box;
use std::time::Instant;

use glam::{DMat3, DVec3, Vec3Swizzles};
use rayon::prelude::*;

use crate::report::Calibration;
use crate::stages::milliseconds;

/// Runs a fixed loop once, about 70 milliseconds on a core of 2020, on the threads of the current pool.
///
/// It is made of five kinds of work that stages consist of, by turns: sparse sums of vectors (propagation, residuals), small rotations
/// (local steps) and a pass over more memory than a core's own caches hold on all threads; a sparse triangular solve (global steps) and a queue
/// (simplification) on one. It calls nothing of Pliant, so that what makes Pliant slower does not make it slower too, and does the same on
/// every call. Run it between the stages that are timed, several times.
pub fn calibrate() -> Calibration {
    let mut work = Work::new();
    let mut parts = [const { Vec::new() }; PARTS];
    // The first turn is not counted: memory is new to the caches and to the system.
    for turn in 0..=TURNS {
        for (kind, times) in parts.iter_mut().enumerate() {
            let start = Instant::now();
            work.part(kind);
            if turn > 0 {
                times.push(milliseconds(start.elapsed()));
            }
        }
    }
    let shortest = |times: &Vec<f64>| times.iter().copied().fold(f64::INFINITY, f64::min);
    Calibration {
        quiet_ms: TURNS as f64 * parts.iter().map(shortest).sum::<f64>(),
        taken_ms: parts.iter().flatten().sum(),
    }
}

/// Kinds of work.
const PARTS: usize = 5;

/// How often each is done.
const TURNS: usize = 40;

/// Vectors that are gathered from: as many as a large cage has vertices.
const VALUES: usize = 8192;

/// Rows of weighted sums.
const ROWS: usize = 20_000;

/// Entries of a row, of sums and of the triangular system.
const ENTRIES: usize = 16;

/// Rotations that are found.
const ROTATIONS: usize = 10_000;

/// Keys in the queue.
const KEYS: usize = 6_000;

/// Numbers in each of the arrays that are passed over: 2 MB.
const LONG: usize = 1 << 18;

/// What the loop works on.
struct Work {
    values: Vec<DVec3>,
    indices: Vec<[u32; ENTRIES]>,
    weights: Vec<[f32; ENTRIES]>,
    moved: Vec<DVec3>,
    rotations: Vec<DMat3>,
    keys: Vec<u32>,
    long: [Vec<f64>; 3],
}

impl Work {
    fn new() -> Self {
        let mut random = Random(1);
        let values = (0..VALUES).map(|_| DVec3::new(random.unit(), random.unit(), random.unit())).collect();
        // As with vertices near each other in space, a row's indices are not far from those of the row before.
        let near = |row: usize, random: &mut Random| ((row * VALUES / ROWS + random.below(256)) % VALUES) as u32;
        Self {
            values,
            indices: (0..ROWS).map(|row| std::array::from_fn(|_| near(row, &mut random))).collect(),
            weights: (0..ROWS).map(|_| std::array::from_fn(|_| random.unit() as f32 / ENTRIES as f32)).collect(),
            moved: vec![DVec3::ZERO; ROWS],
            rotations: vec![DMat3::ZERO; ROTATIONS],
            keys: (0..KEYS).map(|_| random.next()).collect(),
            long: [vec![1.0; LONG], vec![2.0; LONG], vec![0.0; LONG]],
        }
    }

    /// A fraction of a millisecond of one kind.
    fn part(&mut self, kind: usize) {
        match kind {
            0 => (0..2).for_each(|_| self.sums()),
            1 => self.rotate(),
            2 => self.solve(),
            3 => self.queue(),
            _ => (0..3).for_each(|_| self.pass()),
        }
    }

    /// Each row's weighted sum.
    fn sums(&mut self) {
        let Self { values, indices, weights, moved, .. } = self;
        moved.par_iter_mut().with_min_len(1024).enumerate().for_each(|(row, sum)| {
            let entries = indices[row].iter().zip(&weights[row]);
            *sum = entries.map(|(&j, &w)| values[j as usize] * f64::from(w)).sum();
        });
        black_box(&self.moved);
    }

    /// The rotations next to matrices made of each sum, by Newton's iteration for the polar decomposition (Higham 1986, Computing the
    /// Polar Decomposition, with applications).
    fn rotate(&mut self) {
        let turn = |(v, nearest): (&DVec3, &mut DMat3)| {
            let mut m = DMat3::from_cols(DVec3::X + 0.1 * *v, DVec3::Y - 0.2 * v.yzx(), DVec3::Z + 0.3 * v.zxy());
            for _ in 0..6 {
                m = (m + m.inverse().transpose()) * 0.5;
            }
            *nearest = m;
        };
        self.moved[..ROTATIONS].par_iter().zip(&mut self.rotations).with_min_len(1024).for_each(turn);
        black_box(&self.rotations);
    }

    /// Forward substitution, each unknown after those it depends on.
    fn solve(&self) {
        let mut solution = self.values.clone();
        for row in 1..VALUES {
            let entries = self.indices[row].iter().zip(&self.weights[row]);
            let earlier = |j: u32| solution[row - 1 - j as usize % row.min(512)];
            let sum: DVec3 = entries.map(|(&j, &w)| earlier(j) * f64::from(w)).sum();
            solution[row] = 0.5 * (solution[row] - sum);
        }
        black_box(solution);
    }

    /// Takes the smallest key out and puts another in, as a simplifier does with its edges.
    fn queue(&self) {
        let mut queue: BinaryHeap<Reverse<u32>> = self.keys.iter().map(|key| Reverse(*key)).collect();
        for key in &self.keys {
            if let Some(Reverse(smallest)) = queue.pop() {
                queue.push(Reverse(smallest / 2 + key / 2));
            }
        }
        black_box(queue);
    }

    /// Reads two long arrays and writes one.
    fn pass(&mut self) {
        let [a, b, sum] = &mut self.long;
        let add = |((sum, a), b): ((&mut f64, &f64), &f64)| *sum = 0.5 * *sum + a * b;
        sum.par_iter_mut().with_min_len(1 << 14).zip(&*a).zip(&*b).for_each(add);
        black_box(&self.long);
    }
}

/// Numbers without a pattern that caches and branch predictors could learn: xorshift (Marsaglia 2003, Xorshift RNGs).
struct Random(u32);

impl Random {
    fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }

    fn below(&mut self, limit: u32) -> usize {
        (self.next() % limit) as usize
    }

    /// From 0 to 1.
    fn unit(&mut self) -> f64 {
        f64::from(self.next()) / f64::from(u32::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every kind of work comes to the same, so that it is the same work, on any number of threads.
    #[test]
    fn the_loop_does_the_same_each_time() {
        let result = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| {
                let mut work = Work::new();
                (0..PARTS).for_each(|kind| work.part(kind));
                (work.moved, work.rotations, work.long)
            })
        };
        let (moved, rotations, long) = result(1);
        assert!((moved, rotations.clone(), long) == result(3));
        // Newton's iteration has come to rotations: the work is of the kind it says.
        let off =
            |m: &DMat3| (*m * m.transpose() - DMat3::IDENTITY).to_cols_array().iter().fold(0.0, |a, x| x.abs().max(a));
        assert!(rotations.iter().map(off).fold(0.0, f64::max) < 1e-9);
    }

    #[test]
    fn the_parts_are_never_longer_than_the_whole() {
        let run = calibrate();
        assert!(run.quiet_ms > 0.0 && run.quiet_ms <= run.taken_ms * (1.0 + 1e-12), "{run:?}");
    }

    #[test]
    fn runs_are_pooled_by_shortest_and_middle() {
        let runs = [(5.0, 9.0), (6.0, 7.0), (4.0, 30.0)].map(|(quiet_ms, taken_ms)| Calibration { quiet_ms, taken_ms });
        assert_eq!(Calibration::of(&runs), Some(Calibration { quiet_ms: 4.0, taken_ms: 9.0 }));
        assert_eq!(Calibration::of(&[]), None);
        assert_eq!(runs[2].load(), 7.5);
    }
}
