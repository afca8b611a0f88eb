use super::*;

/// The Laplacian of a grid of `n` by `n` with uneven positive weights, held along one side.
fn grid(n: usize) -> SparseRows {
    let weight = |a: usize, b: usize| 0.2 + ((a * 31 + b * 17) % 11) as f64 * 0.2;
    let mut rows = SparseRows::new(n * n);
    for i in 0..n * n {
        let (x, y) = (i % n, i / n);
        let mut row = vec![(i as u32, if y == 0 { 1.0 } else { 0.0 })];
        let mut join = |j: usize| {
            let w = weight(i.min(j), i.max(j));
            row[0].1 += w;
            row.push((j as u32, -w));
        };
        for j in
            [(x > 0).then(|| i - 1), (x + 1 < n).then_some(i + 1), (y > 0).then(|| i - n), (y + 1 < n).then_some(i + n)]
        {
            j.into_iter().for_each(&mut join);
        }
        rows.push_row(row).expect("within");
    }
    rows
}

fn noise(n: usize, seed: u32) -> Vec<[f32; 4]> {
    let mut state = seed;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / 8_388_608.0 - 1.0
    };
    (0..n).map(|_| [next(), next(), next(), 0.0]).collect()
}

fn dot(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

fn times(matrix: &SparseRows, x: &[[f32; 4]]) -> Vec<[f32; 4]> {
    let x: Vec<[f64; 3]> = x.iter().map(|&[a, b, c, _]| [a.into(), b.into(), c.into()]).collect();
    let mut y = vec![[0.0; 3]; x.len()];
    matrix.multiply(&x, &mut y).expect("square");
    y.iter().map(|&[a, b, c]| [a as f32, b as f32, c as f32, 0.0]).collect()
}

/// Preconditioned conjugate gradients need no more iterations for a larger grid; a condition number below 4 gains a digit in 2.1.
#[test]
fn the_cycle_is_a_good_preconditioner_at_any_size() {
    for n in [10, 40, 120] {
        let matrix = grid(n);
        let mut multigrid = Multigrid::new(&matrix).expect("definite");
        let sizes: Vec<usize> = multigrid.sizes().collect();
        assert!(sizes.windows(2).all(|s| 3 * s[1] < s[0]), "{sizes:?}");
        let mut r = noise(n * n, 7);
        let norm = |r: &[[f32; 4]]| dot(r, r).sqrt();
        let first = norm(&r);
        let mut z = r.clone();
        multigrid.apply(&r, &mut z).expect("finite");
        let (mut p, mut rz) = (z.clone(), dot(&r, &z));
        for _ in 0..12 {
            let ap = times(&matrix, &p);
            let alpha = (rz / dot(&p, &ap)) as f32;
            r.iter_mut().flatten().zip(ap.iter().flatten()).for_each(|(r, ap)| *r -= alpha * ap);
            multigrid.apply(&r, &mut z).expect("finite");
            let next = dot(&r, &z);
            let beta = (next / rz) as f32;
            rz = next;
            p.iter_mut().flatten().zip(z.iter().flatten()).for_each(|(p, z)| *p = z + beta * *p);
        }
        assert!(norm(&r) < 1e-4 * first, "{n}: {:e}", norm(&r) / first);
    }
}

/// Symmetric to f32 rounding, positive, and never more than the inverse: `z . A z <= r . z`, so a full step along `z` lowers the energy.
#[test]
fn the_cycle_is_symmetric_positive_and_below_the_inverse() {
    let matrix = grid(60);
    let mut multigrid = Multigrid::new(&matrix).expect("definite");
    let n = matrix.row_count();
    let mut of = |r: &[[f32; 4]]| {
        let mut z = vec![[0.0; 4]; n];
        multigrid.apply(r, &mut z).expect("finite");
        z
    };
    for seed in 0..5 {
        let (a, b) = (noise(n, 2 * seed), noise(n, 2 * seed + 1));
        let (ma, mb) = (of(&a), of(&b));
        let (left, right, size) = (dot(&a, &mb), dot(&ma, &b), (dot(&a, &ma) * dot(&b, &mb)).sqrt());
        assert!(size > 0.0 && (left - right).abs() < 1e-5 * size, "{left} {right} {size}");
        assert!(dot(&ma, &times(&matrix, &ma)) <= (1.0 + 1e-5) * dot(&a, &ma));
    }
}

#[test]
fn what_cannot_be_set_up_is_refused() {
    let mut rows = SparseRows::new(2);
    rows.push_row([(0, 1.0)]).expect("within");
    assert!(matches!(Multigrid::new(&rows), Err(LinalgError::WrongCount { .. })));
    rows.push_row([(1, f64::NAN)]).expect("within");
    assert_eq!(Multigrid::new(&rows).err(), Some(LinalgError::EntryNotFinite { entry: 1 }));
    let mut large = grid(30);
    let range = large.row_range(17);
    large.values_mut()[range.start] = 0.0;
    assert_eq!(Multigrid::new(&large).err(), Some(LinalgError::NotPositiveDefinite { unknown: 17 }));
    let mut none = Multigrid::new(&SparseRows::new(0)).expect("nothing to do");
    assert_eq!(none.apply(&[], &mut []), Ok(()));
    assert!(none.apply(&[[0.0; 4]], &mut []).is_err());
}

/// Unknowns without couplings cannot be put together, and need not be.
#[test]
fn a_diagonal_is_inverted() {
    let n = 30_000;
    let mut rows = SparseRows::new(n);
    for i in 0..n as u32 {
        rows.push_row([(i, 1.0 + f64::from(i % 7))]).expect("within");
    }
    let (r, mut z) = (noise(n, 3), vec![[0.0; 4]; n]);
    Multigrid::new(&rows).expect("definite").apply(&r, &mut z).expect("finite");
    for (i, (r, z)) in r.iter().zip(&z).enumerate() {
        let d = 1.0 + (i % 7) as f32;
        assert!(r.iter().zip(z).all(|(r, z)| (r - d * z).abs() <= 1e-6));
    }
}

/// Products against sums over all triples.
#[test]
fn a_galerkin_product_is_what_it_says() {
    let a = grid(4);
    let mut p = SparseRows::new(5);
    for i in 0..16u32 {
        p.push_row([(i % 5, 0.5 + f64::from(i)), ((i * 3 + 1) % 5, 1.0)]).expect("within");
    }
    let entry = |m: &SparseRows, i: usize, j: usize| -> f64 {
        let (columns, values) = m.row(i);
        columns.iter().zip(values).filter(|(c, _)| **c as usize == j).map(|(_, v)| v).sum()
    };
    let coarse = a.galerkin(&p).expect("fits");
    for i in 0..5 {
        for j in 0..5 {
            let all = (0..16).flat_map(|k| (0..16).map(move |l| (k, l)));
            let expected: f64 = all.map(|(k, l)| entry(&p, k, i) * entry(&a, k, l) * entry(&p, l, j)).sum();
            assert!((entry(&coarse, i, j) - expected).abs() < 1e-10 * (1.0 + expected.abs()));
        }
    }
    assert!(p.galerkin(&a).is_err());
}

/// Made in parallel, rows are those pushed one by one; the first column that does not exist is named as there.
#[test]
fn rows_made_in_parallel_are_those_pushed() {
    let entries = |i: usize| (0..i % 5).map(move |k| (((i * 7 + k * 13) % 97) as u32, i as f64 + 0.5 * k as f64));
    let mut pushed = SparseRows::new(97);
    for i in 0..3000 {
        pushed.push_row(entries(i)).expect("columns below 97");
    }
    let made = SparseRows::of_rows(97, 3000, |i, row| row.extend(entries(i))).expect("columns below 97");
    assert_eq!(made, pushed);
    let mut narrow = SparseRows::new(90);
    let expected = (0..3000).find_map(|i| narrow.push_row(entries(i)).err()).expect("columns up to 96");
    let found = SparseRows::of_rows(90, 3000, |i, row| row.extend(entries(i))).expect_err("columns up to 96");
    assert_eq!(found, expected);
}
