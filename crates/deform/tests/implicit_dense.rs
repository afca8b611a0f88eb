//! Implicit Laplacian editing against the paper's formulas with full matrices: every row written out, constraints as rows that outweigh
//! all others, orthogonal factorisation instead of normal equations.

mod common;

use common::{along_x, distance};
use glam::{DMat3, DVec3};
use pliant_deform::implicit::{FeatureSize, Implicit, ImplicitConstraints, ImplicitOptions};
use pliant_deform::{Deformer, EdgeWeightKind, Goals, Handle, Region, Role};
use pliant_mesh::{EdgeWeights, Similarity, TriMesh, VertexSet, best_rotation, mixed_voronoi_areas, shapes};

/// Rows `a x = b` of one coordinate each, for three coordinates.
#[derive(Default)]
struct Rows {
    a: Vec<Vec<f64>>,
    b: Vec<DVec3>,
}

impl Rows {
    fn push(&mut self, weight: f64, row: &[f64], b: DVec3) {
        self.a.push(row.iter().map(|value| value * weight).collect());
        self.b.push(b * weight);
    }

    /// Least squares over the unknown columns by Householder reflections; heavy rows have to come first.
    fn solve(&self, unknown: &[usize], known: &[DVec3]) -> Vec<DVec3> {
        let mut a: Vec<Vec<f64>> = self.a.iter().map(|row| unknown.iter().map(|&k| row[k]).collect()).collect();
        let rest = |row: &Vec<f64>| -> DVec3 {
            (0..known.len()).filter(|k| !unknown.contains(k)).map(|k| row[k] * known[k]).sum()
        };
        let mut b: Vec<DVec3> = self.a.iter().zip(&self.b).map(|(row, b)| *b - rest(row)).collect();
        let (m, n) = (a.len(), unknown.len());
        for k in 0..n {
            let norm = (k..m).map(|i| a[i][k] * a[i][k]).sum::<f64>().sqrt();
            let head = if a[k][k] > 0.0 { -norm } else { norm };
            let mut v: Vec<f64> = (k..m).map(|i| a[i][k]).collect();
            v[0] -= head;
            let square: f64 = v.iter().map(|x| x * x).sum();
            (k..n).for_each(|j| {
                let share = 2.0 * (k..m).map(|i| v[i - k] * a[i][j]).sum::<f64>() / square;
                (k..m).for_each(|i| a[i][j] -= share * v[i - k]);
            });
            let share = 2.0 / square * (k..m).map(|i| v[i - k] * b[i]).sum::<DVec3>();
            (k..m).for_each(|i| b[i] -= share * v[i - k]);
        }
        let mut solution = known.to_vec();
        for k in (0..n).rev() {
            let later: DVec3 = (k + 1..n).map(|j| a[k][j] * solution[unknown[j]]).sum();
            solution[unknown[k]] = (b[k] - later) / a[k][k];
        }
        solution
    }
}

/// The maps of Eq. 4, three rows of `n` numbers per vertex: what the formula makes of the points `e_k`.
fn gradient_rows(mesh: &TriMesh) -> Vec<[Vec<f64>; 3]> {
    let n = mesh.vertex_count();
    (0..n)
        .map(|i| {
            let ring: Vec<usize> = mesh.topology().neighbours(i).iter().map(|&j| j as usize).collect();
            let centre = ring.iter().map(|&j| mesh.positions[j]).sum::<DVec3>() / ring.len() as f64;
            let stencil: Vec<usize> = std::iter::once(i).chain(ring.iter().copied()).collect();
            let arms: Vec<DVec3> = stencil.iter().map(|&k| mesh.positions[k] - centre).collect();
            let scatter = arms.iter().fold(DMat3::ZERO, |sum, v| sum + DMat3::from_cols(*v * v.x, *v * v.y, *v * v.z));
            let mut rows = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
            for k in stencil.iter().copied() {
                let mean = if k == i { 0.0 } else { 1.0 / ring.len() as f64 };
                let image = stencil.iter().map(|&s| f64::from(u8::from(s == k)) - mean);
                let sum: DVec3 = image.zip(&arms).map(|(x, v)| x * *v).sum();
                let row = scatter.inverse() * sum;
                (0..3).for_each(|b| rows[b][k] = row[b]);
            }
            rows
        })
        .collect()
}

/// Laplacian coordinates times the root of the area, or over it for uniform weights.
fn laplacian_rows(mesh: &TriMesh, kind: EdgeWeightKind) -> Vec<Vec<f64>> {
    let (n, topology) = (mesh.vertex_count(), mesh.topology());
    let (weights, areas) = (EdgeWeights::cotangent(mesh), mixed_voronoi_areas(mesh));
    (0..n)
        .map(|i| {
            let mut row = vec![0.0; n];
            for (&j, &e) in topology.neighbours(i).iter().zip(topology.neighbour_edges(i)) {
                let weight = match kind {
                    EdgeWeightKind::Cotangent => 2.0 * weights.values[e as usize] / areas[i] * areas[i].sqrt(),
                    EdgeWeightKind::Uniform => 1.0 / topology.neighbours(i).len() as f64 / areas[i].sqrt(),
                };
                row[i] += weight;
                row[j as usize] -= weight;
            }
            row
        })
        .collect()
}

fn times(row: &[f64], points: &[DVec3]) -> DVec3 {
    row.iter().zip(points).map(|(a, p)| *a * *p).sum()
}

/// The gradient, of which row `b` of the map makes column `b`.
fn evaluate(rows: &[Vec<f64>; 3], points: &[DVec3]) -> DMat3 {
    DMat3::from_cols(times(&rows[0], points), times(&rows[1], points), times(&rows[2], points))
}

fn within_rings(mesh: &TriMesh, i: usize, rings: u32) -> Vec<usize> {
    let mut found = vec![i];
    for _ in 0..rings {
        for v in found.clone() {
            for &j in mesh.topology().neighbours(v) {
                if !found.contains(&(j as usize)) {
                    found.push(j as usize);
                }
            }
        }
    }
    found.split_off(1)
}

/// Both systems, at hard handles and fixed vertices at rest: the solutions of Eq. 7 and of Eq. 9 or 10.
fn reference(mesh: &TriMesh, options: &ImplicitOptions, region: &Region, goals: &Goals) -> [Vec<DVec3>; 2] {
    let (gradients, laplacian) = (gradient_rows(mesh), laplacian_rows(mesh, options.weights));
    let n = mesh.vertex_count();
    let goal = |v: usize| match region.roles()[v] {
        Role::Handle(h) => Some(goals.transforms[h as usize]),
        Role::Fixed => Some(Similarity::IDENTITY),
        Role::Free => None,
    };
    let unknown: Vec<usize> = (0..n).filter(|&v| goal(v).is_none()).collect();
    let known: Vec<DVec3> = (0..n).map(|v| goal(v).map_or(DVec3::ZERO, |g| g.apply(mesh.positions[v]))).collect();
    let touches = |v: usize| mesh.topology().neighbours(v).iter().any(|&j| goal(j as usize).is_none());
    let mut first = Rows::default();
    for v in (0..n).filter(|&v| touches(v)) {
        if let Some(goal) = goal(v) {
            (0..3).for_each(|b| first.push(1e5, &gradients[v][b], goal.linear().col(b)));
        }
    }
    let combine = |terms: &[(f64, &[f64])]| -> Vec<f64> {
        (0..n).map(|k| terms.iter().map(|(factor, row)| factor * row[k]).sum()).collect()
    };
    for v in (0..n).filter(|&v| goal(v).is_none() || touches(v)) {
        let delta = times(&laplacian[v], &mesh.positions);
        match goal(v) {
            Some(goal) => first.push(1.0, &laplacian[v], goal.linear() * delta),
            None => {
                let [x, y, z] = &gradients[v];
                let row = combine(&[(1.0, &laplacian[v]), (-delta.x, x), (-delta.y, y), (-delta.z, z)]);
                first.push(1.0, &row, DVec3::ZERO);
            }
        }
    }
    for &v in &unknown {
        for j in within_rings(mesh, v, options.rings) {
            (0..3).for_each(|b| match goal(j) {
                // From this end only: what is given has no row of its own. Each pair counts twice.
                Some(goal) => first.push(2.0_f64.sqrt(), &gradients[v][b], goal.linear().col(b)),
                None => first.push(1.0, &combine(&[(1.0, &gradients[v][b]), (-1.0, &gradients[j][b])]), DVec3::ZERO),
            });
        }
    }
    let solution = first.solve(&unknown, &known);
    let mut second = Rows::default();
    for v in (0..n).filter(|&v| goal(v).is_none() || touches(v)) {
        let gradient = goal(v).map_or_else(|| evaluate(&gradients[v], &solution), |goal| goal.linear());
        let squares: f64 = gradient.to_cols_array().iter().map(|x| x * x).sum();
        let scale = if options.features == FeatureSize::Scale { (squares / 3.0).sqrt() } else { 1.0 };
        second.push(1.0, &laplacian[v], best_rotation(gradient) * times(&laplacian[v], &mesh.positions) * scale);
    }
    let pose = second.solve(&unknown, &known);
    [solution, pose]
}

/// A closed surface of acute triangles without a flat ring.
fn acute_ball() -> TriMesh {
    let ball = shapes::icosphere(2);
    let bump = |p: DVec3| p * (1.0 + 0.1 * (3.0 * p.x).sin() * (2.0 * p.y).cos());
    ball.with_positions(ball.positions.iter().map(|p| bump(*p)).collect()).expect("finite")
}

fn goals() -> Goals {
    let turn = Similarity::about(DVec3::new(0.6, 0.1, 0.0), DVec3::new(0.4, -0.3, 1.0), 0.7, 1.2);
    Goals::new(vec![Similarity::IDENTITY, Similarity { translation: turn.translation + DVec3::X * 0.2, ..turn }])
}

#[test]
fn agrees_with_the_dense_reference() {
    let ball = acute_ball();
    let n = ball.vertex_count();
    let (low, high) = (along_x(&ball, 0.0..=0.2), along_x(&ball, 0.8..=1.0));
    let whole = Region::new(n, &VertexSet::all(n), &[low.clone(), high.clone()].map(Handle::hard)).expect("valid");
    let roi = VertexSet::where_true(n, |v| !low.contains(v));
    let part = Region::new(n, &roi, &[Handle::hard(high)]).expect("valid");
    for weights in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
        for rings in [1, 2] {
            for features in [FeatureSize::Keep, FeatureSize::Scale] {
                let options = ImplicitOptions { weights, rings, features, ..ImplicitOptions::default() };
                for (region, goals) in [(&whole, goals()), (&part, Goals::new(goals().transforms[1..].to_vec()))] {
                    let expected = reference(&ball, &options, region, &goals);
                    let mut implicit = Implicit::prepare(&options, &ball, region).expect("valid");
                    let mut poses = [ball.positions.clone(), ball.positions.clone()];
                    implicit.solve_preview(&goals, &mut poses[0]).expect("solvable");
                    implicit.solve(&goals, &mut poses[1]).expect("solvable");
                    assert!(distance(&expected[0], &ball.positions) > 0.1, "nothing moved");
                    assert!(distance(&expected[0], &expected[1]) > 1e-3, "nothing to tell the systems apart");
                    for (stage, (pose, expected)) in poses.iter().zip(&expected).enumerate() {
                        let off = distance(pose, expected);
                        // What the gradient constraints are missed by, on either side.
                        assert!(off < 1e-6, "{options}, system {}: {off:e}", stage + 1);
                    }
                }
            }
        }
    }
}

/// Positions alone leave gradients at the handles free but for a weight of 1e-4: the limit of many positions.
#[test]
fn positions_alone_leave_gradients_free() {
    let ball = acute_ball();
    let n = ball.vertex_count();
    let handles = [along_x(&ball, 0.0..=0.2), along_x(&ball, 0.8..=1.0)].map(Handle::hard);
    let region = Region::new(n, &VertexSet::all(n), &handles).expect("valid");
    let energy = |constraints: ImplicitConstraints| {
        let options = ImplicitOptions { constraints, ..ImplicitOptions::default() };
        let mut pose = ball.positions.clone();
        Implicit::prepare(&options, &ball, &region)
            .expect("valid")
            .solve_preview(&goals(), &mut pose)
            .expect("solvable");
        // E_L + E_R over all vertices and pairs, of which gradients at handles are a part only if they are free.
        let (gradients, laplacian) = (gradient_rows(&ball), laplacian_rows(&ball, options.weights));
        let at: Vec<DMat3> = gradients.iter().map(|rows| evaluate(rows, &pose)).collect();
        let norm = |m: DMat3| m.to_cols_array().iter().map(|x| x * x).sum::<f64>();
        let is_free = |v: usize| region.roles()[v] == Role::Free;
        let touches = |v: usize| ball.topology().neighbours(v).iter().any(|&j| is_free(j as usize));
        let laplace = (0..n)
            .filter(|&v| is_free(v) || touches(v))
            .map(|v| (times(&laplacian[v], &pose) - at[v] * times(&laplacian[v], &ball.positions)).length_squared());
        let pairs = (0..n).flat_map(|v| within_rings(&ball, v, 2).into_iter().map(move |j| (v, j)));
        let pairs = pairs.filter(|&(v, j)| is_free(v) || is_free(j));
        laplace.sum::<f64>() + pairs.map(|(v, j)| norm(at[v] - at[j])).sum::<f64>()
    };
    let (free, held) = (energy(ImplicitConstraints::Positions), energy(ImplicitConstraints::Both));
    assert!(free < 0.98 * held, "{free} {held}");
}
