//! ARAP, densely and simply.

use glam::{DMat3, DVec3};
use pliant_deform::arap::{ArapEnergy, ArapOptions, EdgeWeightKind};
use pliant_deform::{Constraint, Goals, Region, Role};
use pliant_mesh::TriMesh;

/// Constraint, vertices with weights, and target of a point.
type PointRow = (Constraint, Vec<(usize, f64)>, DVec3);

/// Everything below is written from the energies alone: cells as lists of weighted edges, a dense matrix, elimination
/// without pivoting, and rotations from singular vectors.
pub(crate) struct Dense<'a> {
    mesh: &'a TriMesh,
    region: &'a Region,
    cells: Vec<Vec<(usize, usize, f64)>>,
    /// Stiffness of a soft handle's vertices relative to the mean diagonal entry of the Laplacian of the unknowns.
    soft: f64,
}

impl<'a> Dense<'a> {
    pub(crate) fn new(mesh: &'a TriMesh, region: &'a Region, options: &ArapOptions) -> Self {
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
        let mean = (0..n).map(|i| self.laplacian_diagonal(unknowns[i]) / multiplicity).sum::<f64>() / n as f64;
        for (constraint, entries, target) in self.rows(goals) {
            let known: DVec3 = entries.iter().filter(|e| row(e.0).is_none()).map(|&(v, c)| c * pose[v]).sum();
            let mine: Vec<(usize, f64)> = entries.iter().filter_map(|&(v, c)| Some((row(v)?, c))).collect();
            match constraint {
                Constraint::Hard => {
                    // One more unknown, the multiplier, and one more equation.
                    let last = a.len();
                    a.iter_mut().for_each(|row| row.push(0.0));
                    a.push(vec![0.0; last + 1]);
                    b.push(target - known);
                    for &(i, c) in &mine {
                        a[i][last] = c;
                        a[last][i] = c;
                    }
                }
                Constraint::Soft(weight) => {
                    let squares: f64 = mine.iter().map(|(_, c)| c * c).sum();
                    let k = multiplicity * weight * mean / squares.max(1.0);
                    for &(i, c) in &mine {
                        b[i] += k * c * (target - known);
                        mine.iter().for_each(|&(j, d)| a[i][j] += k * c * d);
                    }
                }
            }
        }
        eliminate(&mut a, &mut b);
        for (&v, &x) in unknowns.iter().zip(&b) {
            pose[v] = x;
        }
    }

    /// The points of all handles, in order.
    fn rows(&self, goals: &Goals) -> Vec<PointRow> {
        let mut all = Vec::new();
        for (handle, goal) in self.region.handles().iter().zip(&goals.transforms) {
            for row in handle.rows.iter() {
                let row: Vec<(usize, f64)> = row.iter().map(|&(v, c)| (v as usize, c)).collect();
                let rest: DVec3 = row.iter().map(|&(v, c)| c * self.mesh.positions[v]).sum();
                let target = goals.points.get(all.len()).copied().unwrap_or(goal.apply(rest));
                all.push((handle.constraint, row, target));
            }
        }
        all
    }

    /// Before springs and rows.
    fn laplacian_diagonal(&self, v: usize) -> f64 {
        let at = |&&(p, q, _): &&(usize, usize, f64)| p == v || q == v;
        self.cells.iter().flatten().filter(at).map(|(.., w)| w).sum()
    }

    pub(crate) fn solve(&self, options: &ArapOptions, goals: &Goals, pose: &mut [DVec3]) {
        let m = Self::multiplicity(options);
        let mut rotations = self.rotations(pose);
        // All constraints near unknowns, as in the library.
        let near = |v: usize| {
            let around = self.mesh.topology().neighbours(v);
            self.is_unknown(v) && self.goal(v, goals).is_some()
                || !self.is_unknown(v) && around.iter().any(|&w| self.is_unknown(w as usize))
        };
        let grip = |v: usize| if self.is_unknown(v) { self.soft / (1.0 + self.soft) } else { 1.0 };
        let mut points: Vec<(DVec3, DVec3, f64)> = (0..pose.len())
            .filter(|&v| near(v))
            .map(|v| (pose[v], self.goal(v, goals).unwrap_or(pose[v]), grip(v)))
            .collect();
        for (constraint, row, target) in self.rows(goals) {
            let grip = if let Constraint::Soft(w) = constraint { w / (1.0 + w) } else { 1.0 };
            points.push((row.iter().map(|&(v, c)| c * pose[v]).sum(), target, grip));
        }
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

/// Gauss, with the largest pivot of each column.
fn eliminate(a: &mut [Vec<f64>], b: &mut [DVec3]) {
    let n = b.len();
    for k in 0..n {
        let best = (k..n).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs())).unwrap_or(k);
        a.swap(k, best);
        b.swap(k, best);
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
