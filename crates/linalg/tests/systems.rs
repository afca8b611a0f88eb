//! Solutions against residuals and a dense elimination; refactoring against fresh factors; culprits by name.

// Elimination reads best with indices.
#![allow(clippy::needless_range_loop)]

use std::sync::Arc;

use pliant_linalg::{Cholesky, LinalgError, Partition, SpdPattern, Triplet};

/// Knuth's 64-bit linear congruential generator: the high bits as a number in [-1, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.next() * 0.5 + 0.5) * n as f64) as usize % n
    }
}

fn dense(n: usize, triplets: &[Triplet]) -> Vec<Vec<f64>> {
    let mut a = vec![vec![0.0; n]; n];
    for t in triplets {
        a[t.row as usize][t.col as usize] += t.value;
        if t.row != t.col {
            a[t.col as usize][t.row as usize] += t.value;
        }
    }
    a
}

/// Gaussian elimination with partial pivoting.
fn dense_solve(mut a: Vec<Vec<f64>>, mut b: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    let n = a.len();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).expect("k < n");
        a.swap(k, pivot);
        b.swap(k, pivot);
        for i in k + 1..n {
            let f = a[i][k] / a[k][k];
            for j in k..n {
                a[i][j] -= f * a[k][j];
            }
            for c in 0..3 {
                b[i][c] -= f * b[k][c];
            }
        }
    }
    for k in (0..n).rev() {
        for c in 0..3 {
            let known: f64 = (k + 1..n).map(|j| a[k][j] * b[j][c]).sum();
            b[k][c] = (b[k][c] - known) / a[k][k];
        }
    }
    b
}

fn random_rhs(n: usize, random: &mut Random) -> Vec<[f64; 3]> {
    (0..n).map(|_| [random.next(), random.next(), random.next()]).collect()
}

/// Largest entry of `A x - b`, over the largest entry of `b`.
fn relative_residual(triplets: &[Triplet], x: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let mut r = b.to_vec();
    for t in triplets {
        let (i, j) = (t.row as usize, t.col as usize);
        for c in 0..3 {
            r[i][c] -= t.value * x[j][c];
            if i != j {
                r[j][c] -= t.value * x[i][c];
            }
        }
    }
    let largest = |v: &[[f64; 3]]| v.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    largest(&r) / largest(b)
}

/// Diagonally dominant, with repeated places, in shuffled order and either triangle.
fn random_spd(n: usize, random: &mut Random) -> Vec<Triplet> {
    let mut triplets = Vec::new();
    for i in 0..n {
        triplets.push(Triplet::new(i as u32, i as u32, 0.1 + random.next().abs()));
        for _ in 0..4 {
            let (j, w) = (random.below(n), random.next());
            if i != j {
                triplets.push(Triplet::new(i as u32, j as u32, w));
                triplets.push(Triplet::new(i as u32, i as u32, w.abs()));
                triplets.push(Triplet::new(j as u32, j as u32, w.abs()));
            }
        }
    }
    for k in (1..triplets.len()).rev() {
        triplets.swap(k, random.below(k + 1));
    }
    triplets
}

/// The graph Laplacian of a side x side grid with diagonals, weights between 0.5 and 1.5.
fn grid_laplacian(side: usize, random: &mut Random) -> Vec<Triplet> {
    let mut triplets = Vec::new();
    let at = |x: usize, y: usize| (y * side + x) as u32;
    for y in 0..side {
        for x in 0..side {
            for (dx, dy) in [(1, 0), (0, 1), (1, 1)] {
                if x + dx < side && y + dy < side {
                    let (a, b, w) = (at(x, y), at(x + dx, y + dy), 1.0 + 0.5 * random.next());
                    triplets.extend([Triplet::new(a, b, -w), Triplet::new(a, a, w), Triplet::new(b, b, w)]);
                }
            }
        }
    }
    triplets
}

/// A Laplacian is singular; a stiff spring to the ground at its first unknown makes it definite.
fn grounded(mut laplacian: Vec<Triplet>) -> Vec<Triplet> {
    laplacian.push(Triplet::new(0, 0, 1.0));
    laplacian
}

fn permuted(triplets: &[Triplet], order: &[u32]) -> Vec<Triplet> {
    triplets.iter().map(|t| Triplet::new(order[t.row as usize], order[t.col as usize], t.value)).collect()
}

fn shuffle(n: usize, random: &mut Random) -> Vec<u32> {
    let mut order: Vec<u32> = (0..n as u32).collect();
    for k in (1..n).rev() {
        order.swap(k, random.below(k + 1));
    }
    order
}

#[test]
fn small_systems_agree_with_dense_elimination() {
    let mut random = Random(1);
    for n in [1, 2, 3, 10, 60, 150] {
        let triplets = random_spd(n, &mut random);
        let b = random_rhs(n, &mut random);
        let mut x = b.clone();
        Cholesky::of_triplets(n, &triplets).expect("positive definite").solve_in_place(&mut x).expect("solvable");
        let reference = dense_solve(dense(n, &triplets), b.clone());
        let off = x.iter().flatten().zip(reference.iter().flatten()).fold(0.0f64, |m, (p, q)| m.max((p - q).abs()));
        let size = reference.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
        // Condition numbers here are below 1e4.
        assert!(off <= 1e-11 * size, "{n} unknowns: off by {off:e} of {size}");
    }
}

#[test]
fn residuals_are_at_rounding_level_in_any_numbering() {
    let mut random = Random(2);
    // 20 x 20 is solved entry by entry, 90 x 90 by dense blocks inside faer.
    for side in [2, 5, 20, 90] {
        let n = side * side;
        let natural = grounded(grid_laplacian(side, &mut random));
        let shuffled = permuted(&natural, &shuffle(n, &mut random));
        for triplets in [natural, shuffled] {
            let b = random_rhs(n, &mut random);
            let mut x = b.clone();
            Cholesky::of_triplets(n, &triplets).expect("positive definite").solve_in_place(&mut x).expect("solvable");
            let residual = relative_residual(&triplets, &x, &b);
            assert!(residual <= 1e-10, "{side} x {side}: residual {residual:e}");
        }
    }
}

#[test]
fn refactoring_equals_a_fresh_factor_bit_for_bit() {
    let mut random = Random(3);
    for side in [6, 80] {
        let n = side * side;
        let first = grounded(grid_laplacian(side, &mut random));
        let second = grounded(grid_laplacian(side, &mut random));
        let pattern = Arc::new(SpdPattern::new(n, &first).expect("valid"));
        let values = |t: &[Triplet]| t.iter().map(|t| t.value).collect::<Vec<_>>();
        let mut kept = Cholesky::new(Arc::clone(&pattern), values(&first)).expect("positive definite");
        let b = random_rhs(n, &mut random);
        kept.solve_in_place(&mut b.clone()).expect("solvable");
        kept.refactor(values(&second)).expect("positive definite");
        let (mut x, mut y) = (b.clone(), b.clone());
        kept.solve_in_place(&mut x).expect("solvable");
        Cholesky::of_triplets(n, &second).expect("positive definite").solve_in_place(&mut y).expect("solvable");
        assert!(x == y, "{side} x {side}");
    }
}

#[test]
fn the_culprit_of_an_indefinite_matrix_is_named() {
    let mut random = Random(4);
    for side in [3, 80] {
        let n = side * side;
        for bad in [0, 1, n / 2, n - 1, n] {
            // The grid's unknowns make room for one that stands alone and has no positive diagonal.
            let order: Vec<u32> = (0..n).map(|i| (i + usize::from(i >= bad)) as u32).collect();
            let mut triplets = permuted(&grounded(grid_laplacian(side, &mut random)), &order);
            for value in [None, Some(0.0), Some(-1.0), Some(1e-30 - 1e-30)] {
                triplets.extend(value.map(|v| Triplet::new(bad as u32, bad as u32, v)));
                let error = Cholesky::of_triplets(n + 1, &triplets).expect_err("not definite");
                assert_eq!(error, LinalgError::NotPositiveDefinite { unknown: bad }, "{side} x {side}, {value:?}");
            }
        }
    }
}

/// Rounding hides the zero pivot of an ungrounded Laplacian; it is found nevertheless, in the right component.
#[test]
fn a_component_without_ground_is_named() {
    for side in [2, 3, 8, 30, 80] {
        for seed in 0..5 {
            let mut random = Random(seed);
            let n = side * side;
            let mut triplets = grounded(grid_laplacian(side, &mut random));
            let floating = grid_laplacian(side, &mut random);
            triplets.extend(permuted(&floating, &(n as u32..2 * n as u32).collect::<Vec<_>>()));
            match Cholesky::of_triplets(2 * n, &triplets) {
                Err(LinalgError::NotPositiveDefinite { unknown }) => assert!(unknown >= n, "{side} x {side}"),
                other => panic!("{side} x {side}, seed {seed}: {other:?}"),
            }
        }
    }
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let triplets = [Triplet::new(0, 0, 1.0), Triplet::new(1, 1, 1.0), Triplet::new(0, 1, 0.5)];
    let mut cholesky = Cholesky::of_triplets(2, &triplets).expect("positive definite");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let error = cholesky.refactor([1.0, bad, 0.5]).expect_err("not finite");
        assert_eq!(error, LinalgError::EntryNotFinite { entry: 1 });
        // No factor is left, and it is said again.
        assert_eq!(cholesky.solve_in_place(&mut [[1.0; 3]; 2]), Err(error));
        cholesky.refactor([1.0, 1.0, 0.5]).expect("positive definite");
        let error = cholesky.solve_in_place(&mut [[0.0; 3], [0.0, bad, 0.0]]).expect_err("not finite");
        assert!(matches!(error, LinalgError::SolutionNotFinite { .. }));
    }
    // Finite entries whose sum overflows.
    let twice = [Triplet::new(0, 0, f64::MAX), Triplet::new(0, 0, f64::MAX)];
    assert!(Cholesky::of_triplets(1, &twice).is_err());
}

#[test]
fn sizes_that_do_not_fit_are_refused() {
    let error = SpdPattern::new(2, &[Triplet::new(0, 0, 1.0), Triplet::new(1, 2, 1.0)]).expect_err("outside");
    assert_eq!(error, LinalgError::IndexOutOfRange { entry: 1, row: 1, col: 2, unknowns: 2 });
    assert!(matches!(SpdPattern::new(usize::MAX, &[]), Err(LinalgError::TooLarge { .. })));
    let mut cholesky = Cholesky::of_triplets(1, &[Triplet::new(0, 0, 1.0)]).expect("positive definite");
    let error = cholesky.solve_in_place(&mut [[1.0; 3]; 2]).expect_err("too many rows");
    assert_eq!(error, LinalgError::WrongCount { what: "right-hand side rows", expected: 1, found: 2 });
    let error = cholesky.refactor([1.0, 2.0]).expect_err("too many values");
    assert_eq!(error, LinalgError::WrongCount { what: "values", expected: 1, found: 2 });
}

#[test]
fn an_empty_system_is_solved() {
    let mut cholesky = Cholesky::of_triplets(0, &[]).expect("nothing to factor");
    cholesky.solve_in_place(&mut []).expect("nothing to solve");
    cholesky.refactor([]).expect("nothing to factor");
    assert_eq!(cholesky.pattern().factor_len(), 0);
    let partition = Partition::new(3, |_| false).expect("small");
    assert_eq!(partition.free_block(&[Triplet::new(0, 1, 1.0)]), Ok(Vec::new()));
    assert!(partition.coupling(&[Triplet::new(0, 1, 1.0)]).expect("valid").is_empty());
}

/// Fixing unknowns at the values of a known solution gives back the rest of that solution.
#[test]
fn eliminating_fixed_unknowns_keeps_the_solution() {
    let mut random = Random(5);
    let (side, n) = (12, 144);
    let triplets = grounded(grid_laplacian(side, &mut random));
    let b = random_rhs(n, &mut random);
    let mut x = b.clone();
    Cholesky::of_triplets(n, &triplets).expect("positive definite").solve_in_place(&mut x).expect("solvable");

    let partition = Partition::new(n, |i| i % 3 != 0).expect("small");
    assert_eq!(partition.free().len() + partition.fixed().len(), n);
    for full in 0..n {
        let (free, fixed) = (partition.free_index(full), partition.fixed_index(full));
        assert_eq!(
            free.map(|i| partition.free()[i] as usize).or(fixed.map(|i| partition.fixed()[i] as usize)),
            Some(full)
        );
        assert_ne!(free.is_some(), fixed.is_some());
    }
    let pick = |of: &[u32], v: &[[f64; 3]]| of.iter().map(|&i| v[i as usize]).collect::<Vec<_>>();
    let mut rhs = pick(partition.free(), &b);
    let coupling = partition.coupling(&triplets).expect("valid");
    coupling.subtract_from(&mut rhs, &pick(partition.fixed(), &x)).expect("fitting sizes");
    assert!(coupling.subtract_from(&mut rhs, &[]).is_err());
    let block = partition.free_block(&triplets).expect("valid");
    let mut factor = Cholesky::of_triplets(partition.free().len(), &block).expect("positive definite");
    factor.solve_in_place(&mut rhs).expect("solvable");
    for (found, expected) in rhs.iter().flatten().zip(pick(partition.free(), &x).iter().flatten()) {
        assert!((found - expected).abs() <= 1e-10 * expected.abs().max(1.0), "{found} instead of {expected}");
    }
}

/// The block of the free unknowns, cut out by values alone, is the matrix that has only that block; and what is left out takes no part,
/// however singular it is.
#[test]
fn blocks_are_refactored_in_the_pattern_of_the_whole() {
    let mut random = Random(6);
    // Entry by entry and by dense blocks inside faer.
    for side in [1, 2, 9, 30, 90] {
        let n = side * side;
        let whole = grid_laplacian(side, &mut random);
        let pattern = Arc::new(SpdPattern::new(n, &whole).expect("valid"));
        let values = || whole.iter().map(|t| t.value);
        let mut kept = Cholesky::of_block(Arc::clone(&pattern), values(), |i| i > 0).expect("grounded");
        for leave_out in [0.001, 0.1, 0.5, 0.9, 1.0] {
            // The first is always left out, which grounds the rest.
            let is_free: Vec<bool> = (0..n).map(|i| i > 0 && random.next().abs() >= leave_out).collect();
            kept.refactor_block(values(), |i| is_free[i]).expect("grounded");
            let b = random_rhs(n, &mut random);
            let mut x = b.clone();
            kept.solve_in_place(&mut x).expect("solvable");

            let mut fresh = Cholesky::of_block(Arc::clone(&pattern), values(), |i| is_free[i]).expect("grounded");
            let mut again = b.clone();
            fresh.solve_in_place(&mut again).expect("solvable");
            assert!(x == again, "{side} x {side}, {leave_out}");
            assert_eq!(kept.solve_len(), fresh.solve_len());

            let partition = Partition::new(n, |i| is_free[i]).expect("small");
            let block = partition.free_block(&whole).expect("valid");
            let mut rhs: Vec<[f64; 3]> = partition.free().iter().map(|&i| b[i as usize]).collect();
            let mut alone = Cholesky::of_triplets(rhs.len(), &block).expect("grounded");
            alone.solve_in_place(&mut rhs).expect("solvable");
            let size = rhs.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
            for i in 0..n {
                match partition.free_index(i) {
                    // Condition numbers are below 1e5.
                    Some(k) => assert!((0..3).all(|c| (x[i][c] - rhs[k][c]).abs() <= 1e-11 * size), "{side}: {i}"),
                    None => assert_eq!(x[i], b[i]),
                }
            }
        }
        // Everything free: nothing grounds it, in the one order of elimination as in any.
        if side > 1 {
            assert!(matches!(kept.refactor(values()), Err(LinalgError::NotPositiveDefinite { .. })));
            assert!(kept.solve_in_place(&mut random_rhs(n, &mut random)).is_err());
        }
    }
}

#[test]
fn columns_are_triplets_in_order() {
    let mut random = Random(7);
    let (side, n) = (40, 1600);
    let triplets = grounded(grid_laplacian(side, &mut random));
    let mut columns = vec![Vec::new(); n];
    let mut sums = std::collections::BTreeMap::new();
    for t in &triplets {
        *sums.entry((t.row.max(t.col), t.row.min(t.col))).or_insert(0.0) += t.value;
    }
    for &(col, row) in sums.keys() {
        columns[col as usize].push(row);
    }
    let mut col_ptr = vec![0];
    col_ptr.extend(columns.iter().scan(0, |end, column| {
        *end += column.len() as u32;
        Some(*end)
    }));
    let row_idx = columns.concat();
    let pattern = Arc::new(SpdPattern::of_columns(col_ptr.clone(), row_idx.clone()).expect("valid"));
    let mut x = random_rhs(n, &mut random);
    let mut y = x.clone();
    let mut factor = Cholesky::new(pattern, sums.values().copied()).expect("positive definite");
    factor.solve_in_place(&mut x).expect("solvable");
    Cholesky::of_triplets(n, &triplets).expect("positive definite").solve_in_place(&mut y).expect("solvable");
    assert!(x == y);
    let error = factor.refactor(sums.values().copied().skip(1)).expect_err("too few values");
    assert!(matches!(error, LinalgError::WrongCount { what: "values", .. }));

    let refused = |col_ptr: &[u32], row_idx: &[u32]| match SpdPattern::of_columns(col_ptr.to_vec(), row_idx.to_vec()) {
        Err(LinalgError::BadColumn { col }) => col,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(&[0, 1, 2], &[0, 0]), 1);
    assert_eq!(refused(&[0, 1, 3], &[0, 1, 1]), 1);
    assert_eq!(refused(&[0, 1, 3], &[0, 1, 0]), 1);
    assert_eq!(refused(&[0, 1, 9], &[0, 0, 1]), 1);
    assert_eq!(refused(&[1, 1], &[0]), 0);
    assert_eq!(refused(&[0, 2, 1], &[0, 1]), 0);
    assert_eq!(refused(&[0, 1, 2], &[0, 1, 1]), 2);
    assert_eq!(refused(&[], &[0]), 0);
    assert_eq!(SpdPattern::of_columns(vec![0], vec![]).expect("empty").unknowns(), 0);
    assert_eq!(SpdPattern::of_columns(vec![], vec![]).expect("empty").unknowns(), 0);
}
