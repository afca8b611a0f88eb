//! ARAP against an independent dense implementation, and its energy against finite differences.

mod common;

use common::{bar, distance, pyramid, sheet, torus, variants};
use glam::{DMat3, DVec3};
use pliant_deform::arap::{Arap, ArapEnergy, ArapOptions, EdgeWeightKind};
use pliant_deform::{Constraint, Deformer, Goals, Handle, PointRows, Region, Role};
use pliant_mesh::{Similarity, TriMesh, VertexSet};

/// Everything below is written from the energies alone: cells as lists of weighted edges, a dense matrix, elimination
/// without pivoting, and rotations from singular vectors.
struct Dense<'a> {
    mesh: &'a TriMesh,
    region: &'a Region,
    cells: Vec<Vec<(usize, usize, f64)>>,
    /// Stiffness of a soft handle's vertices relative to the mean diagonal entry of the Laplacian of the unknowns.
    soft: f64,
}

impl<'a> Dense<'a> {
    fn new(mesh: &'a TriMesh, region: &'a Region, options: &ArapOptions) -> Self {
        let triangles = mesh.triangles();
        let cotangent = |t: &[u32; 3], k: usize| {
            let [a, b, c] = [0, 1, 2].map(|m| mesh.positions[t[(k + m) % 3] as usize]);
            let (u, v) = (b - a, c - a);
            // Through the angle: another formula than the library's.
            0.5 / u.angle_between(v).tan()
        };
        let half = |t: &[u32; 3], k: usize| match options.weights {
            EdgeWeightKind::Uniform => 1.0,
            EdgeWeightKind::Cotangent => cotangent(t, k),
        };
        let cells = (0..mesh.vertex_count())
            .map(|i| {
                let mut cell = Vec::new();
                for t in triangles.iter().filter(|t| t.contains(&(i as u32))) {
                    for k in 0..3 {
                        let (p, q) = (t[(k + 1) % 3] as usize, t[(k + 2) % 3] as usize);
                        match options.energy {
                            ArapEnergy::SpokesAndRims => cell.push((p, q, half(t, k))),
                            ArapEnergy::Spokes if p == i || q == i => cell.push((p, q, half(t, k))),
                            ArapEnergy::Spokes => {}
                        }
                    }
                }
                if options.energy == ArapEnergy::Spokes && options.weights == EdgeWeightKind::Uniform {
                    // An edge counts once, not once per face.
                    cell.iter_mut().for_each(|e| *e = (e.0.min(e.1), e.0.max(e.1), 1.0));
                    cell.sort_by_key(|e| (e.0, e.1));
                    cell.dedup();
                }
                cell
            })
            .collect();
        let soft = region.handles().iter().find_map(|h| match h.constraint {
            Constraint::Soft(w) => Some(w),
            Constraint::Hard => None,
        });
        Self { mesh, region, cells, soft: soft.unwrap_or(0.0) }
    }

    fn multiplicity(options: &ArapOptions) -> f64 {
        if options.energy == ArapEnergy::Spokes { 2.0 } else { 3.0 }
    }

    fn is_unknown(&self, v: usize) -> bool {
        match self.region.roles()[v] {
            Role::Free => true,
            Role::Fixed => false,
            Role::Handle(h) => self.region.handles()[h as usize].constraint != Constraint::Hard,
        }
    }

    fn goal(&self, v: usize, goals: &Goals) -> Option<DVec3> {
        match self.region.roles()[v] {
            Role::Handle(h) => Some(goals.transforms[h as usize].apply(self.mesh.positions[v])),
            Role::Free | Role::Fixed => None,
        }
    }

    fn rotations(&self, pose: &[DVec3]) -> Vec<DMat3> {
        let rest = &self.mesh.positions;
        self.cells
            .iter()
            .map(|cell| {
                let mut s = DMat3::ZERO;
                for &(p, q, w) in cell {
                    let (e, d) = (w * (rest[p] - rest[q]), pose[p] - pose[q]);
                    s += DMat3::from_cols(d * e.x, d * e.y, d * e.z);
                }
                polar(s)
            })
            .collect()
    }

    /// The minimum over unknown positions of the energy with rotations held: its derivative, edge by edge, set to zero.
    fn global(&self, rotations: &[DMat3], goals: &Goals, pose: &mut [DVec3], multiplicity: f64) {
        let rest = &self.mesh.positions;
        let unknowns: Vec<usize> = (0..pose.len()).filter(|&v| self.is_unknown(v)).collect();
        for v in (0..pose.len()).filter(|&v| !self.is_unknown(v)) {
            pose[v] = self.goal(v, goals).unwrap_or(pose[v]);
        }
        let row = |v: usize| unknowns.iter().position(|&u| u == v);
        let n = unknowns.len();
        let (mut a, mut b) = (vec![vec![0.0; n]; n], vec![DVec3::ZERO; n]);
        for (cell, &rotation) in self.cells.iter().zip(rotations) {
            for &(p, q, w) in cell {
                for (p, q) in [(p, q), (q, p)] {
                    let Some(i) = row(p) else { continue };
                    a[i][i] += w;
                    b[i] += w * (rotation * (rest[p] - rest[q]));
                    match row(q) {
                        Some(j) => a[i][j] -= w,
                        None => b[i] += w * pose[q],
                    }
                }
            }
        }
        let stiffness = self.soft * (0..n).map(|i| a[i][i] / multiplicity).sum::<f64>() / n as f64;
        for (i, &v) in unknowns.iter().enumerate() {
            if let Some(goal) = self.goal(v, goals) {
                a[i][i] += multiplicity * stiffness;
                b[i] += multiplicity * stiffness * goal;
            }
        }
        for k in 0..n {
            for i in k + 1..n {
                let f = a[i][k] / a[k][k];
                let upper = a[k].clone();
                a[i].iter_mut().zip(upper).for_each(|(x, y)| *x -= f * y);
                let known = b[k];
                b[i] -= f * known;
            }
        }
        for k in (0..n).rev() {
            let known: DVec3 = (k + 1..n).map(|j| a[k][j] * b[j]).sum();
            b[k] = (b[k] - known) / a[k][k];
            pose[unknowns[k]] = b[k];
        }
    }

    fn solve(&self, options: &ArapOptions, goals: &Goals, pose: &mut [DVec3]) {
        let m = Self::multiplicity(options);
        let mut rotations = self.rotations(pose);
        // All constraints near unknowns, as in the library.
        let near = |v: usize| {
            let around = self.mesh.topology().neighbours(v);
            self.is_unknown(v) && self.goal(v, goals).is_some()
                || !self.is_unknown(v) && around.iter().any(|&w| self.is_unknown(w as usize))
        };
        let grip = |v: usize| if self.is_unknown(v) { self.soft / (1.0 + self.soft) } else { 1.0 };
        let points: Vec<(DVec3, DVec3, f64)> = (0..pose.len())
            .filter(|&v| near(v))
            .map(|v| (pose[v], self.goal(v, goals).unwrap_or(pose[v]), grip(v)))
            .collect();
        let total: f64 = points.iter().map(|p| p.2).sum();
        let from = points.iter().map(|p| p.2 * p.0).sum::<DVec3>() / total;
        let to = points.iter().map(|p| p.2 * p.1).sum::<DVec3>() / total;
        let mut s = DMat3::ZERO;
        for (x, y, w) in points {
            let (x, y) = (x - from, w * (y - to));
            s += DMat3::from_cols(y * x.x, y * x.y, y * x.z);
        }
        let common = polar(s);
        rotations.iter_mut().for_each(|r| *r = common * *r);
        self.global(&rotations, goals, pose, m);
        for _ in 0..options.iterations {
            let rotations = self.rotations(pose);
            self.global(&rotations, goals, pose, m);
        }
    }
}

/// Kabsch's best proper rotation: right singular vectors by Jacobi rotations of `s^T s`, left ones from them, the
/// third by cross products.
fn polar(s: DMat3) -> DMat3 {
    let (mut a, mut v) = (s.transpose() * s, DMat3::IDENTITY);
    for sweep in 0..60 {
        let (p, q) = [(0, 1), (0, 2), (1, 2)][sweep % 3];
        let angle = 0.5 * (2.0 * a.col(p)[q]).atan2(a.col(p)[p] - a.col(q)[q]);
        let mut turn = DMat3::IDENTITY;
        turn.col_mut(p)[p] = angle.cos();
        turn.col_mut(q)[q] = angle.cos();
        turn.col_mut(p)[q] = angle.sin();
        turn.col_mut(q)[p] = -angle.sin();
        a = turn.transpose() * a * turn;
        v *= turn;
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a.col(j)[j].total_cmp(&a.col(i)[i]));
    let (v1, v2) = (v.col(order[0]), v.col(order[1]));
    let u1 = (s * v1).normalize();
    let u2 = s * v2;
    let u2 = (u2 - u1 * u1.dot(u2)).normalize();
    DMat3::from_cols(u1, u2, u1.cross(u2)) * DMat3::from_cols(v1, v2, v1.cross(v2)).transpose()
}

fn five_iterations() -> impl Iterator<Item = ArapOptions> {
    variants().into_iter().map(|options| ArapOptions { iterations: 5, ..options })
}

fn handles(mesh: &TriMesh, second: Constraint) -> Vec<Handle> {
    let ends = [0.0..=0.1, 0.85..=1.0].map(|range| common::along_x(mesh, range));
    let [first, last] = ends;
    vec![Handle::hard(first), Handle { vertices: last, rows: PointRows::new(), constraint: second }]
}

fn bend(mesh: &TriMesh) -> Goals {
    let tip = mesh.bounds().from_box(DVec3::new(0.9, 0.5, 0.5));
    let mut turn = Similarity::about(tip, DVec3::new(0.2, 1.0, 0.4), 0.6, 1.1);
    turn.translation += DVec3::new(-0.2, 0.1, 0.3);
    Goals::new(vec![Similarity::IDENTITY, turn])
}

/// A sphere of octahedral symmetry drawn out and dented, without obtuse cotangent sums: nothing is clamped.
fn acute_ball() -> TriMesh {
    let (rings, around) = (6, 8);
    let mut positions = vec![DVec3::Z * 1.1];
    for j in 1..rings {
        for i in 0..around {
            let theta = std::f64::consts::PI * j as f64 / rings as f64;
            let phi = std::f64::consts::TAU * (i as f64 + 0.5 * j as f64) / around as f64;
            let r = 1.0 + 0.05 * (3.0 * phi + theta).sin();
            positions.push(r * DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()));
        }
    }
    positions.push(DVec3::Z * -1.1);
    let at = |j: usize, i: usize| (1 + (j - 1) * around + i % around) as u32;
    let last = positions.len() as u32 - 1;
    let mut triangles = Vec::new();
    for i in 0..around {
        triangles.extend([[0, at(1, i), at(1, i + 1)], [last, at(rings - 1, i + 1), at(rings - 1, i)]]);
        for j in 1..rings - 1 {
            triangles.extend([[at(j, i), at(j + 1, i), at(j, i + 1)], [at(j, i + 1), at(j + 1, i), at(j + 1, i + 1)]]);
        }
    }
    TriMesh::new(positions, triangles).expect("valid")
}

#[test]
fn agrees_with_the_dense_reference() {
    let mesh = acute_ball();
    let n = mesh.vertex_count();
    for second in [Constraint::Hard, Constraint::Soft(0.7)] {
        for options in five_iterations() {
            let region = Region::new(n, &VertexSet::all(n), &handles(&mesh, second)).expect("valid");
            let dense = Dense::new(&mesh, &region, &options);
            let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
            assert_eq!(arap.prepared().clamped_weights, 0);
            let (mut pose, mut reference) = (mesh.positions.clone(), mesh.positions.clone());
            // From rest, and from the last pose.
            for goals in [bend(&mesh), region.identity_goals(), bend(&mesh)] {
                arap.solve(&goals, &mut pose).expect("solvable");
                dense.solve(&options, &goals, &mut reference);
                let off = distance(&pose, &reference);
                assert!(off < 1e-9, "{options:?}, {second:?}: off by {off:e}");
            }
        }
    }
}

#[test]
fn agrees_with_the_dense_reference_in_a_region() {
    let mesh = acute_ball();
    let n = mesh.vertex_count();
    let roi = common::along_x(&mesh, 0.3..=1.0);
    for options in five_iterations() {
        let tip = Handle::hard(common::along_x(&mesh, 0.9..=1.0));
        let region = Region::new(n, &roi, &[tip]).expect("valid");
        let goals = Goals::new(vec![Similarity::about(DVec3::X, DVec3::Z, 0.5, 1.0)]);
        let (mut pose, mut reference) = (mesh.positions.clone(), mesh.positions.clone());
        Arap::prepare(&options, &mesh, &region).expect("valid").solve(&goals, &mut pose).expect("solvable");
        Dense::new(&mesh, &region, &options).solve(&options, &goals, &mut reference);
        let off = distance(&pose, &reference);
        assert!(off < 1e-9, "{options:?}: off by {off:e}");
    }
}

/// Global and local step lower one and the same energy: where they come to rest, its numerical derivative vanishes.
#[test]
fn the_gradient_vanishes_at_convergence() {
    for (name, mesh) in [("pyramid", pyramid()), ("sheet", sheet(8, 4)), ("torus", torus(12, 6)), ("bar", bar(2))] {
        for options in five_iterations() {
            for second in [Constraint::Hard, Constraint::Soft(0.3)] {
                let options = ArapOptions { iterations: 20_000, tolerance: Some(1e-16), ..options.clone() };
                let n = mesh.vertex_count();
                let region = Region::new(n, &VertexSet::all(n), &handles(&mesh, second)).expect("valid");
                let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
                // A small bend, so that the minimum is not nearly flat.
                let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::X, DVec3::Y, 0.2, 1.0)]);
                let mut pose = mesh.positions.clone();
                arap.solve(&goals, &mut pose).expect("solvable");
                let step = 1e-5;
                let energy_scale = arap.energy(&goals, &mesh.positions.iter().map(|p| 2.0 * *p).collect::<Vec<_>>());
                let energy_scale = energy_scale.expect("valid");
                for v in (0..n).filter(|&v| region.roles()[v] == Role::Free).step_by(7) {
                    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                        let mut at = |t: f64| {
                            let mut moved = pose.clone();
                            moved[v] += t * axis;
                            arap.energy(&goals, &moved).expect("valid")
                        };
                        let slope = (at(step) - at(-step)) / (2.0 * step);
                        // Iterations stop when the energy is flat to 16 digits, so the gradient to about 8.
                        assert!(slope.abs() < 1e-6 * energy_scale, "{name}, {options:?}: {slope:e} at {v}");
                    }
                }
            }
        }
    }
}
