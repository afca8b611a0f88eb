//! The system in which the transformations of the coordinates are unknowns themselves.

use glam::{DMat3, DVec3};
use pliant_linalg::{LeastSquares, LinalgError, SparseRows};
use pliant_mesh::outer;

use super::rows::{Rows, springs};
use crate::patch::Patch;

/// Weight of the rows that ask for unchanged coordinates.
///
/// Where what is held lies on one line or in one point, turn or size would be open without them, and the matrix singular. They
/// count a ten-millionth of the others, and do not take part in what is exact: the shape has been moved by the similarity that fits the
/// constraints before, and is at rest as far as they see.
const KEEP: f64 = 3e-4;

/// The factored system of all coordinates of all vertices: column `3 v + c` is coordinate `c` of vertex `v` of the patch.
///
/// Minimises `|L(v'_i) - T_i delta_i|^2` over the rows `i`, with `T_i` as [`blocks`] has it (Sorkine et al. 2004, Eq. 5 and 10). There are
/// three rows for each vertex of a soft handle, then six for each row of the Laplacian: one per coordinate, and the same with unchanged
/// coordinates and the weight [`KEEP`]. All right-hand sides but those of soft handles are 0.
pub(super) fn factored(rows: &Rows, patch: &Patch, coordinates: &[DVec3]) -> Result<LeastSquares, LinalgError> {
    let is_free = |column: usize| patch.held[column / 3].is_unknown();
    LeastSquares::new(matrix(rows, patch, coordinates, KEEP)?, is_free).map_err(|error| match error {
        LinalgError::NotPositiveDefinite { unknown } => LinalgError::NotPositiveDefinite { unknown: unknown / 3 },
        other => other,
    })
}

fn matrix(rows: &Rows, patch: &Patch, coordinates: &[DVec3], keep: f64) -> Result<SparseRows, LinalgError> {
    let mut laplacian = SparseRows::new(3 * patch.held.len());
    let mut diagonal = vec![0.0; patch.held.len()];
    for (row, (&centre, &delta)) in rows.centres.iter().zip(coordinates).enumerate() {
        let blocks = blocks(rows, patch, row, centre, delta);
        for (v, block) in &blocks {
            diagonal[*v as usize] += block.to_cols_array().iter().map(|x| x * x).sum::<f64>() / 3.0;
        }
        for c in 0..3 {
            let entries =
                blocks.iter().flat_map(|(v, block)| (0..3).map(move |d| (3 * v + d, block.col(d as usize)[c])));
            laplacian.push_row(entries)?;
        }
        let weights = rows.weights(row);
        let ring = patch.mesh.topology().neighbours(centre as usize).iter().zip(weights);
        let ring = ring.map(|(&j, w)| (j, -w)).chain([(centre, weights.iter().sum::<f64>())]);
        for c in 0..3 {
            laplacian.push_row(ring.clone().map(|(j, w)| (3 * j + c, keep * w)))?;
        }
    }
    let mut all = SparseRows::new(3 * patch.held.len());
    for (v, root) in springs(patch, &diagonal) {
        for c in 0..3 {
            all.push_row([(3 * v + c, root)])?;
        }
    }
    for row in 0..laplacian.row_count() {
        let (columns, values) = laplacian.row(row);
        all.push_row(columns.iter().copied().zip(values.iter().copied()))?;
    }
    Ok(all)
}

/// `L(v')_i - T_i delta_i` as a matrix per vertex of the star of `centre`, the centre last.
///
/// `T_i = s + h x` is the best such map, in the least-squares sense, from the star at rest to the new one, up to translation. With
/// `p_j` the star's rest positions from their mean: `s = sum p_j . v'_j / sum |p_j|^2` and `h = J^-1 sum p_j x v'_j`, where
/// `J = sum (|p_j|^2 - p_j p_j^T)`; the pseudo-inverse of Sorkine et al.'s Eq. 9, in which the unknowns do not mix.
fn blocks(rows: &Rows, patch: &Patch, row: usize, centre: u32, delta: DVec3) -> Vec<(u32, DMat3)> {
    let ring = patch.mesh.topology().neighbours(centre as usize);
    let star = || ring.iter().chain(std::iter::once(&centre)).map(|&v| patch.mesh.positions[v as usize]);
    let mean = star().sum::<DVec3>() / (ring.len() + 1) as f64;
    let squares: f64 = star().map(|p| (p - mean).length_squared()).sum();
    let products = star().fold(DMat3::ZERO, |sum, p| sum + outer(p - mean, p - mean));
    // Singular for a star on one line, whose turn about that line is open: the smallest turn is taken.
    let inertia = DMat3::from_diagonal(DVec3::splat(squares * (1.0 + 1e-12))) - products;
    let inverse = if squares > 0.0 { inertia.inverse() } else { DMat3::ZERO };
    let turned = cross(delta) * inverse;
    let weights = rows.weights(row);
    let own = [weights.iter().sum::<f64>()];
    let laplacian = weights.iter().map(|w| -w).chain(own);
    ring.iter()
        .chain(std::iter::once(&centre))
        .zip(star())
        .zip(laplacian)
        .map(|((&v, p), weight)| {
            let p = p - mean;
            let scaled = if squares > 0.0 { outer(delta, p / squares) } else { DMat3::ZERO };
            // h x delta = -delta x h.
            (v, DMat3::from_diagonal(DVec3::splat(weight)) - scaled + turned * cross(p))
        })
        .collect()
}

/// The matrix of `x -> v x x`.
fn cross(v: DVec3) -> DMat3 {
    DMat3::from_cols(DVec3::new(0.0, v.z, -v.y), DVec3::new(-v.z, 0.0, v.x), DVec3::new(v.y, -v.x, 0.0))
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{VertexSet, shapes};

    use super::*;
    use crate::operators::EdgeWeightKind;
    use crate::{Handle, Region};

    /// `s + h x` of the rest shape, moved anywhere, satisfies every row: these are the maps that the coordinates follow exactly.
    #[test]
    fn linearised_similarities_satisfy_every_row() {
        for mesh in [shapes::icosphere(2), shapes::bumpy_plane(9, 7, 1.0, 1.0, 0.2, 1).expect("valid size")] {
            let n = mesh.vertex_count();
            let region = Region::new(n, &VertexSet::all(n), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
            let patch = Patch::new(&mesh, &region, 2).expect("valid");
            for kind in [EdgeWeightKind::Uniform, EdgeWeightKind::Cotangent] {
                let rows = Rows::new(&patch, kind);
                let coordinates = rows.coordinates(&patch.mesh, &patch.mesh.positions);
                let matrix = matrix(&rows, &patch, &coordinates, 0.0).expect("small");
                for (s, h) in [(1.0, DVec3::ZERO), (-0.3, DVec3::ZERO), (2.0, DVec3::new(0.4, -3.0, 1.0))] {
                    let moved = patch.mesh.positions.iter().map(|p| s * *p + h.cross(*p) + DVec3::new(1.0, 2.0, -0.5));
                    let x: Vec<[f64; 3]> = moved.flat_map(|p| p.to_array()).map(|x| [x, 0.0, 0.0]).collect();
                    let mut out = vec![[0.0; 3]; matrix.row_count()];
                    matrix.multiply(&x, &mut out).expect("fits");
                    let largest = out.iter().map(|row| row[0].abs()).fold(0.0, f64::max);
                    let scale = matrix.values().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                    // The inertia is off by 1e-12 of itself.
                    assert!(largest < 1e-12 * scale.max(1.0) * (1.0 + h.length()), "{s} {h}: {largest:e}");
                }
            }
        }
    }
}
