//! Least squares by the normal equations, factored and iterated, against a dense orthogonal factorisation.

// Elimination reads best with indices.
#![allow(clippy::needless_range_loop)]

use pliant_linalg::{IterativeLeastSquares, Krylov, LeastSquares, LinalgError, SparseRows};

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

    fn rows(&mut self, n: usize) -> Vec<[f64; 3]> {
        (0..n).map(|_| [self.next(), self.next(), self.next()]).collect()
    }
}

/// Every column is touched; some rows are empty and some name a column twice.
fn random_rows(rows: usize, columns: usize, random: &mut Random) -> SparseRows {
    let mut a = SparseRows::new(columns);
    for row in 0..rows {
        let mut entries: Vec<(u32, f64)> =
            (0..random.below(5)).map(|_| (random.below(columns) as u32, random.next())).collect();
        if row < columns {
            entries.push((row as u32, 1.0 + random.next().abs()));
        }
        a.push_row(entries).expect("in range");
    }
    a
}

fn dense(a: &SparseRows) -> Vec<Vec<f64>> {
    (0..a.row_count())
        .map(|row| {
            let mut dense = vec![0.0; a.column_count()];
            let (columns, values) = a.row(row);
            for (&col, &value) in columns.iter().zip(values) {
                dense[col as usize] += value;
            }
            dense
        })
        .collect()
}

/// Least squares over the free columns by Householder reflections; the others are read from `x`.
fn dense_least_squares(a: &SparseRows, b: &[[f64; 3]], is_free: &[bool], x: &mut [[f64; 3]]) {
    let full = dense(a);
    let free: Vec<usize> = (0..a.column_count()).filter(|&c| is_free[c]).collect();
    let mut m: Vec<Vec<f64>> = full
        .iter()
        .zip(b)
        .map(|(row, b)| {
            let mut out: Vec<f64> = free.iter().map(|&c| row[c]).collect();
            for k in 0..3 {
                let known: f64 = (0..row.len()).filter(|&c| !is_free[c]).map(|c| row[c] * x[c][k]).sum();
                out.push(b[k] - known);
            }
            out
        })
        .collect();
    let n = free.len();
    for k in 0..n {
        let norm = (k..m.len()).map(|i| m[i][k] * m[i][k]).sum::<f64>().sqrt();
        let mut v: Vec<f64> = (k..m.len()).map(|i| m[i][k]).collect();
        v[0] += norm.copysign(v[0]);
        let vv: f64 = v.iter().map(|v| v * v).sum();
        for j in k..n + 3 {
            let f = 2.0 * (k..m.len()).map(|i| v[i - k] * m[i][j]).sum::<f64>() / vv;
            for i in k..m.len() {
                m[i][j] -= f * v[i - k];
            }
        }
    }
    for k in (0..n).rev() {
        for c in 0..3 {
            let known: f64 = (k + 1..n).map(|j| m[k][j] * x[free[j]][c]).sum();
            x[free[k]][c] = (m[k][n + c] - known) / m[k][k];
        }
    }
}

fn off(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |m, (p, q)| m.max((p - q).abs()))
}

/// `-1, 2, -1` rows squared in effect: the condition number of `A` grows as `n^2`, that of `A^T A` as `n^4`.
fn second_differences(n: usize) -> SparseRows {
    let mut a = SparseRows::new(n);
    for i in 1..n as u32 - 1 {
        a.push_row([(i - 1, -1.0), (i, 2.0), (i + 1, -1.0)]).expect("in range");
    }
    a
}

#[test]
fn small_systems_agree_with_dense_reflections() {
    let mut random = Random(3);
    for (rows, columns) in [(1, 1), (3, 2), (9, 6), (40, 25), (150, 90)] {
        for keep in [0.0, 0.3] {
            let a = random_rows(rows, columns, &mut random);
            let is_free: Vec<bool> = (0..columns).map(|_| random.next().abs() >= keep).collect();
            let (b, given) = (random.rows(rows), random.rows(columns));
            let mut expected = given.clone();
            dense_least_squares(&a, &b, &is_free, &mut expected);
            let mut x = given.clone();
            LeastSquares::new(a.clone(), |c| is_free[c]).expect("full rank").solve(&b, &mut x).expect("solvable");
            let size = expected.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
            // Condition numbers of A are below 1e3 here.
            assert!(off(&x, &expected) <= 1e-11 * size, "{rows} x {columns}: {:e}", off(&x, &expected));
            for kind in [Krylov::ConjugateGradient, Krylov::BiConjugateGradient] {
                let mut y = given.clone();
                let mut solver = IterativeLeastSquares::new(a.clone(), |c| is_free[c], kind).expect("touched");
                let report = solver.solve(&b, &mut y, 1e-13, 10_000).expect("solvable");
                assert!(report.converged, "{kind:?}: {report:?}");
                assert!(off(&y, &expected) <= 1e-8 * size, "{kind:?}: {:e}", off(&y, &expected));
            }
            // Given columns keep their bits.
            assert!((0..columns).all(|c| is_free[c] || x[c] == given[c]));
        }
    }
}

/// Where `A x = b` can be met, refinement gives what the condition of `A` allows, not that of `A^T A`.
#[test]
fn badly_conditioned_systems_are_refined() {
    for n in [100, 1000, 4000] {
        // A parabola, known at both ends.
        let exact: Vec<[f64; 3]> = (0..n).map(|i| [(i as f64 / n as f64).powi(2), i as f64 / n as f64, 1.0]).collect();
        let a = second_differences(n);
        let mut b = vec![[0.0; 3]; a.row_count()];
        a.multiply(&exact, &mut b).expect("fits");
        let mut x = vec![[f64::NAN; 3]; n];
        (x[0], x[n - 1]) = (exact[0], exact[n - 1]);
        let mut solver = LeastSquares::new(a, |c| c > 0 && c < n - 1).expect("grounded");
        solver.solve(&b, &mut x).expect("solvable");
        // The condition number of A is 4 n^2 / pi^2; rounding of b alone costs that many times 1e-16 of its terms.
        let bound = 1e-15 * (n * n) as f64;
        assert!(off(&x, &exact) <= bound, "{n}: {:e} above {bound:e}", off(&x, &exact));
    }
}

/// From nearby, one step is as good as a solve; from anywhere it leaves a small share of the way.
#[test]
fn refining_is_one_step() {
    let mut random = Random(8);
    let a = random_rows(120, 70, &mut random);
    let b = random.rows(120);
    let mut solver = LeastSquares::new(a, |c| c != 3).expect("full rank");
    let mut exact = vec![[0.25; 3]; 70];
    solver.solve(&b, &mut exact).expect("solvable");
    let size = exact.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
    for far in [1e-6, 1.0, 1e6] {
        let mut x = exact.clone();
        for (c, x) in x.iter_mut().enumerate().filter(|(c, _)| *c != 3) {
            *x = x.map(|x| x + far * (c as f64).sin());
        }
        solver.refine(&b, &mut x).expect("solvable");
        // Condition numbers of the normal equations are below 1e6.
        assert!(off(&x, &exact) <= 1e-12 * size + 1e-10 * far, "{far}: {:e}", off(&x, &exact));
    }
    assert!(matches!(solver.refine(&b[1..], &mut exact), Err(LinalgError::WrongCount { .. })));
}

/// A soft constraint is one more row: a stiff one meets its goal, a loose one leaves it where the other rows want it.
#[test]
fn a_soft_constraint_is_a_row() {
    let n = 20;
    for (stiffness, share) in [(1e6f64, 1.0), (1.0, 0.5), (1e-6, 0.0)] {
        let mut a = SparseRows::new(n);
        a.push_row([(7, stiffness.sqrt())]).expect("in range");
        a.push_row([(7, 1.0)]).expect("in range");
        for c in 0..n as u32 - 1 {
            a.push_row([(c, 1.0), (c + 1, -1.0)]).expect("in range");
        }
        let mut b = vec![[0.0; 3]; a.row_count()];
        b[0] = [stiffness.sqrt(); 3];
        let mut x = vec![[0.0; 3]; n];
        LeastSquares::new(a, |_| true).expect("held").solve(&b, &mut x).expect("solvable");
        // All move as one, to the balance of the two springs.
        assert!(x.iter().flatten().all(|x| (x - stiffness / (1.0 + stiffness)).abs() < 1e-12), "{x:?}");
        assert!((x[0][0] - share).abs() < 2e-6);
    }
}

#[test]
fn products_are_those_of_the_dense_matrix() {
    let mut random = Random(11);
    let a = random_rows(30, 20, &mut random);
    let full = dense(&a);
    let (x, y) = (random.rows(20), random.rows(30));
    let (mut ax, mut aty) = (vec![[9.0; 3]; 30], vec![[9.0; 3]; 20]);
    a.multiply(&x, &mut ax).expect("fits");
    a.transpose_multiply(&y, &mut aty).expect("fits");
    for k in 0..3 {
        for i in 0..30 {
            let expected: f64 = (0..20).map(|j| full[i][j] * x[j][k]).sum();
            assert!((ax[i][k] - expected).abs() < 1e-14);
        }
        for j in 0..20 {
            let expected: f64 = (0..30).map(|i| full[i][j] * y[i][k]).sum();
            assert!((aty[j][k] - expected).abs() < 1e-14);
        }
    }
    assert!(matches!(a.multiply(&x[1..], &mut ax), Err(LinalgError::WrongCount { expected: 20, found: 19, .. })));
    assert!(matches!(a.transpose_multiply(&y, &mut ax), Err(LinalgError::WrongCount { expected: 20, found: 30, .. })));
    assert_eq!([a.row_count(), a.column_count()], [30, 20]);
}

#[test]
fn other_values_give_the_bits_of_a_fresh_solver() {
    let mut random = Random(5);
    let a = random_rows(60, 30, &mut random);
    let b = random.rows(60);
    let mut kept = LeastSquares::new(a.clone(), |c| c != 4).expect("full rank");
    let mut other = a.clone();
    for value in other.values_mut() {
        *value *= 1.0 + 0.1 * random.next();
    }
    kept.set_values(|values| values.copy_from_slice(other.values())).expect("full rank");
    assert_eq!(kept.matrix(), &other);
    let (mut x, mut y) = (vec![[0.5; 3]; 30], vec![[0.5; 3]; 30]);
    kept.solve(&b, &mut x).expect("solvable");
    LeastSquares::new(other, |c| c != 4).expect("full rank").solve(&b, &mut y).expect("solvable");
    assert!(x == y);
    // What the free columns held before does not matter.
    let mut z = vec![[f64::NAN; 3]; 30];
    z[4] = [0.5; 3];
    kept.solve(&b, &mut z).expect("solvable");
    assert!(x == z);
    // A failed change leaves nothing to solve with, until the next one.
    let failed = kept.set_values(|values| values.fill(0.0)).expect_err("all zero");
    assert_eq!(failed, LinalgError::NotPositiveDefinite { unknown: 0 });
    assert_eq!(kept.solve(&b, &mut z), Err(failed));
    kept.set_values(|values| values.copy_from_slice(a.values())).expect("full rank");
    kept.solve(&b, &mut z).expect("solvable");
}

#[test]
fn culprits_are_named() {
    let mut a = SparseRows::new(4);
    let refused = a.push_row([(0, 1.0), (4, 1.0)]);
    assert_eq!(refused, Err(LinalgError::IndexOutOfRange { entry: 1, row: 0, col: 4, unknowns: 4 }));
    assert_eq!(a.row_count(), 0);
    a.push_row([(0, 1.0), (1, -1.0)]).expect("in range");
    a.push_row([(1, 1.0), (3, -1.0)]).expect("in range");
    a.push_row([]).expect("empty");
    let error = |a: &SparseRows, free: &dyn Fn(usize) -> bool| LeastSquares::new(a.clone(), free).expect_err("refused");
    // Column 2 is in no row.
    assert_eq!(error(&a, &|_| true), LinalgError::NotPositiveDefinite { unknown: 2 });
    let iterated = IterativeLeastSquares::new(a.clone(), |_| true, Krylov::ConjugateGradient).expect_err("refused");
    assert_eq!(iterated, LinalgError::NotPositiveDefinite { unknown: 2 });
    // The three others are touched, but free to move together.
    match error(&a, &|c| c != 2) {
        LinalgError::NotPositiveDefinite { unknown } => assert!(unknown != 2 && unknown < 4, "{unknown}"),
        other => panic!("{other}"),
    }
    let mut solver = LeastSquares::new(a.clone(), |c| c != 2 && c != 0).expect("grounded");
    let mut x = vec![[1.0; 3]; 4];
    assert!(matches!(solver.solve(&[[0.0; 3]; 2], &mut x), Err(LinalgError::WrongCount { expected: 3, .. })));
    assert!(matches!(solver.solve(&[[0.0; 3]; 3], &mut x[1..]), Err(LinalgError::WrongCount { expected: 4, .. })));
    let bad = [[0.0, f64::INFINITY, 0.0], [0.0; 3], [0.0; 3]];
    assert!(matches!(solver.solve(&bad, &mut x), Err(LinalgError::SolutionNotFinite { unknown: 1 | 3 })));
    let mut iterative =
        IterativeLeastSquares::new(a.clone(), |c| c != 2 && c != 0, Krylov::BiConjugateGradient).expect("touched");
    assert!(matches!(iterative.solve(&bad, &mut x, 1e-9, 50), Err(LinalgError::SolutionNotFinite { .. })));
    a.values_mut()[2] = f64::NAN;
    assert_eq!(error(&a, &|c| c != 2), LinalgError::EntryNotFinite { entry: 2 });
    // Nothing to solve for is no fault.
    let mut x = vec![[1.0; 3]; 4];
    let given = |_: usize| false;
    a.values_mut()[2] = 1.0;
    LeastSquares::new(a.clone(), given).expect("empty").solve(&[[0.0; 3]; 3], &mut x).expect("empty");
    assert_eq!(x, vec![[1.0; 3]; 4]);
}

/// On a symmetric matrix both iterations are the same but for rounding; few iterations mean few digits; a good guess saves them.
#[test]
fn iterations_are_counted() {
    let n = 60;
    let a = second_differences(n);
    let b = Random(2).rows(a.row_count());
    let is_free = |c: usize| c > 1 && c < n - 2;
    let solve = |kind, x: &mut Vec<[f64; 3]>, tolerance, most| {
        let mut solver = IterativeLeastSquares::new(a.clone(), is_free, kind).expect("touched");
        solver.solve(&b, x, tolerance, most).expect("solvable")
    };
    let mut exact = vec![[0.0; 3]; n];
    LeastSquares::new(a.clone(), is_free).expect("grounded").solve(&b, &mut exact).expect("solvable");
    let kinds = [Krylov::ConjugateGradient, Krylov::BiConjugateGradient];
    let early = kinds.map(|kind| {
        let mut x = vec![[0.0; 3]; n];
        let report = solve(kind, &mut x, 1e-12, 10);
        assert!(!report.converged && report.iterations == 10, "{report:?}");
        x
    });
    let size = exact.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!(off(&early[0], &early[1]) <= 1e-10 * size);
    assert!(off(&early[0], &exact) > 1e-3 * size);
    for kind in kinds {
        let mut x = vec![[0.0; 3]; n];
        let cold = solve(kind, &mut x, 1e-12, 10_000);
        assert!(cold.converged && cold.iterations >= 30, "{cold:?}");
        // The condition number of the normal equations is about n^4 / 500 = 3e4.
        assert!(off(&x, &exact) <= 1e-7 * size, "{:e}", off(&x, &exact));
        let warm = solve(kind, &mut x, 1e-9, 10_000);
        assert!(warm.converged && warm.iterations == 0, "{warm:?}");
    }
}
