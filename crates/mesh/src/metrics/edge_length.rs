use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::largest;
use crate::Topology;

/// How much edges changed length between a rest pose and another pose; all are fractions (0.05 is 5 %).
///
/// Edges of length 0 at rest have no relative error: they are left out and counted. An edge whose length in the pose is not a number makes
/// the means and the largest error NaN.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EdgeErrors {
    /// `sqrt(mean ((l' - l) / l)^2)`: the headline.
    pub rms_relative: f64,
    /// `sqrt(sum (l' - l)^2 / sum l^2)`: its sibling, in which long edges count for more.
    pub relative_rms: f64,
    /// Half of all edges have a relative error `|l' - l| / l` up to this.
    pub median: f64,
    /// 95 % of them.
    pub p95: f64,
    /// 99 % of them.
    pub p99: f64,
    /// The largest relative error.
    pub max: f64,
    /// Edges that were left out because their rest length is 0.
    pub degenerate: usize,
}

/// Edge length errors of `pose` against `rest`, both one position per vertex of `topology`.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn edge_errors(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> EdgeErrors {
    let mut relative = Vec::with_capacity(topology.edges().len());
    let (mut difference, mut total) = (0.0, 0.0);
    for &[a, b] in topology.edges() {
        let (a, b) = (a as usize, b as usize);
        let (before, after) = (rest[a].distance(rest[b]), pose[a].distance(pose[b]));
        if before > 0.0 {
            relative.push(((after - before) / before).abs());
            difference += (after - before).powi(2);
            total += before * before;
        }
    }
    let degenerate = topology.edges().len() - relative.len();
    if relative.is_empty() {
        return EdgeErrors { degenerate, ..EdgeErrors::default() };
    }
    let mean_square = relative.iter().map(|r| r * r).sum::<f64>() / relative.len() as f64;
    relative.sort_unstable_by(f64::total_cmp);
    // The smallest value that at least this share of the edges do not exceed.
    let quantile = |share: f64| relative[((share * relative.len() as f64).ceil() as usize).max(1) - 1];
    EdgeErrors {
        rms_relative: mean_square.sqrt(),
        relative_rms: (difference / total).sqrt(),
        median: quantile(0.5),
        p95: quantile(0.95),
        p99: quantile(0.99),
        max: quantile(1.0),
        degenerate,
    }
}

/// The largest `l' / l` over the edges whose ends are alike: both inside one handle, or neither at a handle's border.
///
/// `label` gives each vertex its part (handle, fixed or free). An edge between two parts spans a border, where the
/// scene itself may ask for any stretch, so it is left out. 0 for a mesh without such edges, NaN if one has no length in the pose.
pub fn largest_free_stretch(topology: &Topology, rest: &[DVec3], pose: &[DVec3], label: impl Fn(u32) -> u32) -> f64 {
    let alike = topology.edges().iter().filter(|[a, b]| label(*a) == label(*b)).map(|edge| edge.map(|v| v as usize));
    largest(alike.filter_map(|[a, b]| {
        let before = rest[a].distance(rest[b]);
        (before > 0.0).then(|| pose[a].distance(pose[b]) / before)
    }))
}

/// At each vertex, the mean relative length error `|l' - l| / l` of the edges there, a fraction; 0 where there is none with a rest length.
///
/// # Panics
/// If a slice is shorter than the number of vertices.
pub fn edge_errors_at_vertices(topology: &Topology, rest: &[DVec3], pose: &[DVec3]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0u32); topology.vertex_count()];
    for edge in topology.edges() {
        let [a, b] = edge.map(|v| v as usize);
        let before = rest[a].distance(rest[b]);
        if before > 0.0 {
            let error = ((pose[a].distance(pose[b]) - before) / before).abs();
            for v in [a, b] {
                sums[v] = (sums[v].0 + error, sums[v].1 + 1);
            }
        }
    }
    sums.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes;

    #[test]
    fn scaling_by_a_factor_is_an_error_of_that_factor_in_every_figure() {
        let mesh = shapes::icosphere(2);
        let doubled: Vec<DVec3> = mesh.positions.iter().map(|p| 1.25 * *p).collect();
        let errors = edge_errors(mesh.topology(), &mesh.positions, &doubled);
        for figure in [errors.rms_relative, errors.relative_rms, errors.median, errors.p99, errors.max] {
            assert!((figure - 0.25).abs() < 1e-12, "{errors:?}");
        }
        assert_eq!(edge_errors(mesh.topology(), &mesh.positions, &mesh.positions), EdgeErrors::default());
    }

    /// Two edges of lengths 1 and 3 that both grow by 0.3: relative errors 0.3 and 0.1.
    #[test]
    fn the_two_definitions_differ_where_lengths_do() {
        let rest = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 3.0, 0.0)];
        let pose = vec![DVec3::new(-0.3, 0.0, 0.0), DVec3::X, DVec3::new(1.0, 3.3, 0.0)];
        let topology = Topology::new(3, vec![[0, 1, 2]]).expect("one face");
        let errors = edge_errors(&topology, &rest, &pose);
        let hypotenuse = (1.3_f64.hypot(3.3) - 10.0_f64.sqrt(), 10.0_f64.sqrt());
        let third = hypotenuse.0 / hypotenuse.1;
        let rms = ((0.09 + 0.01 + third * third) / 3.0).sqrt();
        let relative = ((0.09 + 0.09 + hypotenuse.0.powi(2)) / 20.0).sqrt();
        assert!((errors.rms_relative - rms).abs() < 1e-12 && (errors.relative_rms - relative).abs() < 1e-12);
        // Each vertex has the mean of its two edges.
        let found = edge_errors_at_vertices(&topology, &rest, &pose);
        for (found, expected) in found.iter().zip([0.3 + third, 0.3 + 0.1, third + 0.1]) {
            assert!((found - expected / 2.0).abs() < 1e-12, "{found}");
        }
    }

    #[test]
    fn a_pose_that_is_not_finite_has_no_number_for_an_error() {
        let mesh = shapes::icosphere(1);
        let mut pose = mesh.positions.clone();
        pose[3].x = f64::NAN;
        let errors = edge_errors(mesh.topology(), &mesh.positions, &pose);
        assert!([errors.rms_relative, errors.relative_rms, errors.max].iter().all(|figure| figure.is_nan()));
        assert_eq!((errors.median, errors.degenerate), (0.0, 0));
        assert!(largest_free_stretch(mesh.topology(), &mesh.positions, &pose, |_| 0).is_nan());
        assert_eq!(largest_free_stretch(mesh.topology(), &mesh.positions, &pose, |v| u32::from(v == 3)), 1.0);
    }
}
