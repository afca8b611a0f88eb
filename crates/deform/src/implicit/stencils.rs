//! Deformation gradients as linear maps of positions, and the vertices whose rings are too flat to have one.

use glam::{DMat3, DVec3};
use pliant_mesh::{TriMesh, outer, vertex_normals};

/// A vertex is degenerate if the condition number of `V_i V_i^T` is above this (section 3.3).
const LARGEST_CONDITION: f64 = 2.0e5;

/// `s_disp` of Eq. 8: how far a degenerate vertex is displaced, in mean lengths of its edges.
const DISPLACEMENT: f64 = 0.2;

/// A displacement that leaves the condition number above [`LARGEST_CONDITION`] is kept if it lowers it by this: what is left then is that
/// the ring is long and narrow, and without it the ring would be as good as flat.
const CURE: f64 = 1e-4;

/// Condition number that doubles can still compute with. Above [`LARGEST_CONDITION`], rings are flat, or so long and narrow that they
/// only look it.
const WORST_CONDITION: f64 = 1e10;

/// Traversals of the vertex list, at most: one that is displaced may flatten a ring again that an earlier one was to cure.
const MOST_PASSES: usize = 4;

/// Whether a vertex has a gradient.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Need {
    /// It is not asked for.
    None,
    /// If its ring has one; it is not to be displaced for that.
    IfSound,
    /// In any case, but the vertex is not to be displaced, as nobody could say where to.
    InPlace,
    /// In any case.
    Always,
}

/// No gradient.
pub(super) const NONE: u32 = u32::MAX;

/// The gradients `M = sum_k x_k p_k^T` of some vertices, over points `x` that deform: first the vertices of the mesh, displaced or not, then
/// points that are added to single rings.
pub(super) struct Stencils {
    /// The points at rest.
    pub(super) points: Vec<DVec3>,
    /// Vertex that each point is, was displaced from or was added for.
    pub(super) base: Vec<u32>,
    /// From the base to the point, at rest; zero unless the point was displaced or added.
    pub(super) offset: Vec<DVec3>,
    /// Number of the gradient of each vertex, or [`NONE`].
    pub(super) gradient: Vec<u32>,
    /// How many vertices are degenerate: those displaced, and those whose rings were added to.
    pub(super) degenerate: usize,
    /// Of gradient `g`: `ranges[g]..ranges[g + 1]` of the lists below.
    ranges: Vec<usize>,
    /// Points `k`.
    columns: Vec<u32>,
    /// Coefficients `p_k`.
    coefficients: Vec<DVec3>,
}

impl Stencils {
    /// The gradients of the vertices that need one.
    ///
    /// Costs a small constant per vertex and neighbour.
    pub(super) fn new(mesh: &TriMesh, need: &[Need]) -> Self {
        let mut rings = Rings::new(mesh, need);
        rings.displace();
        rings.complete();
        let mut stencils = Self {
            points: rings.points.clone(),
            base: (0..need.len() as u32).collect(),
            offset: Vec::new(),
            gradient: vec![NONE; need.len()],
            degenerate: rings.degenerate,
            ranges: vec![0],
            columns: Vec::new(),
            coefficients: Vec::new(),
        };
        for (i, need) in need.iter().enumerate() {
            if *need == Need::None || *need == Need::IfSound && rings.condition(i) > LARGEST_CONDITION {
                continue;
            }
            stencils.gradient[i] = stencils.len() as u32;
            let first_added = stencils.points.len() as u32;
            stencils.points.extend(&rings.added[i]);
            stencils.base.extend(rings.added[i].iter().map(|_| i as u32));
            let ring = mesh.topology().neighbours(i).iter().copied();
            let columns = std::iter::once(i as u32).chain(ring).chain(first_added..stencils.points.len() as u32);
            stencils.columns.extend(columns);
            stencils.coefficients.extend(coefficients(rings.stencil(i)));
            stencils.ranges.push(stencils.columns.len());
        }
        let at = |&v: &u32| mesh.positions[v as usize];
        stencils.offset = stencils.points.iter().zip(&stencils.base).map(|(p, base)| *p - at(base)).collect();
        stencils
    }

    /// Number of gradients.
    pub(super) fn len(&self) -> usize {
        self.ranges.len() - 1
    }

    /// Points and coefficients of a gradient, the vertex itself first.
    pub(super) fn terms(&self, gradient: usize) -> impl Iterator<Item = (usize, DVec3)> + Clone {
        let range = self.ranges[gradient]..self.ranges[gradient + 1];
        self.columns[range.clone()].iter().map(|&k| k as usize).zip(self.coefficients[range].iter().copied())
    }

    /// The gradient of some points (Eq. 4): each row of the matrix depends on one coordinate only.
    pub(super) fn evaluate(&self, gradient: usize, points: &[DVec3]) -> DMat3 {
        // Coefficients add up to 0, so differences to the vertex do as well, and keep digits.
        let mut terms = self.terms(gradient);
        let at = terms.next().map_or(DVec3::ZERO, |(k, _)| points[k]);
        terms.fold(DMat3::ZERO, |sum, (k, p)| sum + outer(points[k] - at, p))
    }
}

/// The rings while they are being made sound.
struct Rings<'a> {
    mesh: &'a TriMesh,
    need: &'a [Need],
    normals: Vec<DVec3>,
    is_boundary: Vec<bool>,
    /// Vertices, displaced or not.
    points: Vec<DVec3>,
    /// Points added to each vertex's ring.
    added: Vec<Vec<DVec3>>,
    degenerate: usize,
    /// Where all points of a ring coincide, this is taken for its size: the mean length of edges.
    spacing: f64,
}

impl<'a> Rings<'a> {
    fn new(mesh: &'a TriMesh, need: &'a [Need]) -> Self {
        let topology = mesh.topology();
        let lengths =
            topology.edges().iter().map(|e| mesh.positions[e[0] as usize].distance(mesh.positions[e[1] as usize]));
        let mean = lengths.sum::<f64>() / topology.edges().len().max(1) as f64;
        Self {
            mesh,
            need,
            normals: vertex_normals(topology, &mesh.positions),
            is_boundary: topology.boundary_vertices(),
            points: mesh.positions.clone(),
            added: vec![Vec::new(); need.len()],
            degenerate: 0,
            spacing: if mean > 0.0 { mean } else { 1.0 },
        }
    }

    fn is_needed(&self, i: usize) -> bool {
        matches!(self.need[i], Need::InPlace | Need::Always)
    }

    /// Displaces degenerate vertices, one after the other as the paper's count of them implies (Table 1: 5,852 of 24,480 on a bar with flat
    /// sides): a vertex displaced cures its neighbours too, and a plane displaced as a whole would still be a plane.
    fn displace(&mut self) {
        for _ in 0..MOST_PASSES {
            let before = self.degenerate;
            for i in 0..self.need.len() {
                if self.is_needed(i) && self.condition(i) > LARGEST_CONDITION {
                    self.cure(i);
                }
            }
            if self.degenerate == before {
                break;
            }
        }
    }

    /// Makes a degenerate ring span space by the rules of section 3.3, if they can.
    fn cure(&mut self, i: usize) {
        let ring = self.mesh.topology().neighbours(i);
        if ring.len() < 3 {
            // "Insert a new vertex at the midpoint of its opposite edge": of three neighbours on one line the new one is then the one that
            // is not on the boundary, and displaced. It is an unknown of this ring alone.
            if self.added[i].is_empty() && !ring.is_empty() {
                let middle = ring.iter().map(|&j| self.mesh.positions[j as usize]).sum::<DVec3>() / ring.len() as f64;
                let point = middle + self.displacement(i);
                self.added[i].push(point);
                self.degenerate += 1;
            }
        } else if self.is_boundary[i] && self.is_ring_straight(i) {
            let _ = ring.iter().any(|&j| !self.is_boundary[j as usize] && self.try_displacing(j as usize, i));
        } else {
            self.try_displacing(i, i);
        }
    }

    /// Displaces `v` if that makes the ring of `i` span space.
    fn try_displacing(&mut self, v: usize, i: usize) -> bool {
        let home = self.mesh.positions[v];
        if self.need[v] != Need::Always || self.points[v] != home {
            return false;
        }
        let before = self.condition(i);
        self.points[v] = home + self.displacement(v);
        let after = self.condition(i);
        let is_cured = after <= LARGEST_CONDITION || after <= CURE * before;
        if is_cured {
            self.degenerate += 1;
        } else {
            self.points[v] = home;
        }
        is_cured
    }

    /// Eq. 8, from the vertex; zero if it has no normal.
    fn displacement(&self, v: usize) -> DVec3 {
        let ring = self.mesh.topology().neighbours(v);
        let at = self.mesh.positions[v];
        let lengths: f64 = ring.iter().map(|&j| self.mesh.positions[j as usize].distance(at)).sum();
        DISPLACEMENT * lengths / ring.len().max(1) as f64 * self.normals[v]
    }

    /// Adds points to rings that are still flat (folded fans, coincident vertices, neighbours all on one line inside the surface, which the
    /// paper does not treat): one along each direction they do not span. Such a point is an unknown of its ring alone, so
    /// that the gradient along that direction is whatever those of the neighbours are.
    fn complete(&mut self) {
        for i in 0..self.need.len() {
            let worst = if self.need[i] == Need::InPlace { LARGEST_CONDITION } else { WORST_CONDITION };
            if !self.is_needed(i) || self.condition(i) <= worst {
                continue;
            }
            let scatter = Scatter::of(self.stencil(i));
            let size = if scatter.size > 0.0 { scatter.size } else { self.spacing };
            let (values, axes) = eigen(scatter.matrix);
            for k in 0..3 {
                if values[k] * worst <= values[0] {
                    self.added[i].push(scatter.centre + DISPLACEMENT * size * axes.col(k));
                }
            }
            self.degenerate += 1;
        }
    }

    /// The vertex, its neighbours and the points added to them.
    fn stencil(&self, i: usize) -> impl Iterator<Item = DVec3> + Clone {
        let ring = self.mesh.topology().neighbours(i).iter().map(|&j| self.points[j as usize]);
        std::iter::once(self.points[i]).chain(ring).chain(self.added[i].iter().copied())
    }

    /// Condition number of `V_i V_i^T`; infinite if it is singular.
    fn condition(&self, i: usize) -> f64 {
        let values = eigen(Scatter::of(self.stencil(i)).matrix).0;
        if values[2] > 0.0 { values[0] / values[2] } else { f64::INFINITY }
    }

    /// Whether the neighbours, without the vertex, are on one line.
    fn is_ring_straight(&self, i: usize) -> bool {
        let ring = self.stencil(i).skip(1);
        let centre = ring.clone().sum::<DVec3>() / ring.clone().count() as f64;
        let scatter = Scatter::of(std::iter::once(centre).chain(ring));
        let values = eigen(scatter.matrix).0;
        values[1] * LARGEST_CONDITION <= values[0]
    }
}

/// `V_i V_i^T` (Eq. 3).
struct Scatter {
    /// The ring's centroid `v_i0`.
    centre: DVec3,
    /// Mean distance from the vertex to its ring.
    size: f64,
    /// In units of the size.
    matrix: DMat3,
}

impl Scatter {
    /// Of the vertex, which comes first, and its ring.
    fn of(stencil: impl Iterator<Item = DVec3> + Clone) -> Self {
        let ring = stencil.clone().skip(1);
        let at = stencil.clone().next().unwrap_or(DVec3::ZERO);
        let count = ring.clone().count().max(1) as f64;
        let centre = at + ring.clone().map(|p| p - at).sum::<DVec3>() / count;
        let size = ring.map(|p| p.distance(at)).sum::<f64>() / count;
        let unit = if size > 0.0 { 1.0 / size } else { 0.0 };
        let arm = |p: DVec3| (p - centre) * unit;
        let matrix = stencil.fold(DMat3::ZERO, |sum, p| sum + outer(arm(p), arm(p)));
        Self { centre, size, matrix }
    }
}

/// Coefficients `p_k` with `M = sum_k x_k p_k^T = V~ V^T (V V^T)^-1` (Eq. 4), where both are relative to their ring's centroid.
fn coefficients(stencil: impl Iterator<Item = DVec3> + Clone) -> impl Iterator<Item = DVec3> {
    let scatter = Scatter::of(stencil.clone());
    let inverse = scatter.matrix.inverse() * (1.0 / scatter.size);
    let arm = move |p: DVec3| (p - scatter.centre) / scatter.size;
    let at = stencil.clone().next().unwrap_or(scatter.centre);
    let ring = (stencil.clone().count() - 1) as f64;
    // The sum over the stencil of v_k - v_i0 is v_i - v_i0, so that much of the centroid is subtracted.
    let share = inverse * arm(at) / ring;
    let raw =
        stencil.clone().enumerate().map(move |(k, p)| inverse * arm(p) - if k == 0 { DVec3::ZERO } else { share });
    // The inverse of a narrow ring is rough, and its gradient at rest not quite the identity; this makes it so to rounding.
    let at_rest = stencil.zip(raw.clone()).fold(DMat3::ZERO, |sum, (x, p)| sum + outer(x - at, p));
    let repair = at_rest.inverse().transpose();
    raw.map(move |p| repair * p)
}

/// Eigenvalues of a symmetric matrix, largest first, and unit eigenvectors in the same order, by Jacobi rotations; off by rounding of the
/// largest.
fn eigen(matrix: DMat3) -> ([f64; 3], DMat3) {
    let mut a = matrix.to_cols_array_2d();
    let mut axes = DMat3::IDENTITY.to_cols_array_2d();
    // Converges quadratically: six sweeps are ample.
    for _ in 0..6 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] == 0.0 {
                continue;
            }
            let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = t * c;
            for row in &mut a {
                (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
            }
            for k in 0..3 {
                (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
                (axes[p][k], axes[q][k]) = (c * axes[p][k] - s * axes[q][k], s * axes[p][k] + c * axes[q][k]);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
    (order.map(|k| a[k][k].max(0.0)), DMat3::from_cols_array_2d(&order.map(|k| axes[k])))
}

#[cfg(test)]
mod tests;
