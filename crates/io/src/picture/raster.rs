use glam::DVec3;
use rayon::prelude::*;

use super::PictureOptions;

/// No face.
pub(super) const EMPTY: u32 = u32::MAX;

/// The nearest face at each sample.
pub(super) struct Samples {
    /// Samples across.
    pub(super) width: usize,
    /// Face at each sample, row after row from the top, or [`EMPTY`].
    pub(super) faces: Vec<u32>,
    /// Height towards the camera, in samples; minus infinity where there is no face.
    pub(super) heights: Vec<f32>,
}

/// Sample rows that are drawn together: one task each.
const BAND: usize = 32;

impl Samples {
    /// Draws `triangles` whose vertices are at `projected` (column, row, height).
    ///
    /// Each band of rows draws its faces in order, so the result does not depend on the number of threads.
    pub(super) fn draw(triangles: &[[u32; 3]], projected: &[DVec3], options: &PictureOptions) -> Self {
        let width = (options.width * options.supersampling) as usize;
        let height = (options.height * options.supersampling) as usize;
        let mut bands: Vec<Vec<u32>> = vec![Vec::new(); height.div_ceil(BAND)];
        for (face, triangle) in triangles.iter().enumerate() {
            let rows = triangle.map(|v| projected[v as usize].y);
            if let Some((first, last)) = sample_range(rows, height) {
                for band in &mut bands[first / BAND..=last / BAND] {
                    // Fits: a mesh has fewer than 2^32 faces.
                    band.push(face as u32);
                }
            }
        }
        let mut faces = vec![EMPTY; width * height];
        let mut heights = vec![f32::NEG_INFINITY; width * height];
        let strips = faces.par_chunks_mut(BAND * width).zip(heights.par_chunks_mut(BAND * width));
        strips.zip(&bands).enumerate().for_each(|(i, ((faces, heights), band))| {
            for &face in band {
                let corners = triangles[face as usize].map(|v| projected[v as usize]);
                draw_face(corners, face, i * BAND, width, faces, heights);
            }
        });
        Self { width, faces, heights }
    }
}

/// First and last sample whose centre lies between the smallest and largest of three coordinates.
fn sample_range(values: [f64; 3], count: usize) -> Option<(usize, usize)> {
    let low = values[0].min(values[1]).min(values[2]);
    let high = values[0].max(values[1]).max(values[2]);
    let first = (low - 0.5).ceil().max(0.0);
    let last = (high - 0.5).floor().min(count as f64 - 1.0);
    (first <= last).then_some((first as usize, last as usize))
}

/// Draws a face into rows from `first_row` on. Where two faces have the same height, the earlier one stays.
fn draw_face(corners: [DVec3; 3], face: u32, first_row: usize, width: usize, faces: &mut [u32], heights: &mut [f32]) {
    let Some(plane) = Barycentric::new(corners) else { return };
    let rows = faces.len() / width;
    let Some((left, right)) = sample_range(corners.map(|c| c.x), width) else { return };
    let Some((top, bottom)) = sample_range(corners.map(|c| c.y - first_row as f64), rows) else { return };
    for row in top..=bottom {
        let y = (first_row + row) as f64 + 0.5;
        for column in left..=right {
            let weights = plane.at(column as f64 + 0.5, y);
            if weights.min_element() < 0.0 {
                continue;
            }
            let height = weights.dot(DVec3::new(corners[0].z, corners[1].z, corners[2].z)) as f32;
            let sample = row * width + column;
            if height > heights[sample] {
                heights[sample] = height;
                faces[sample] = face;
            }
        }
    }
}

/// Barycentric coordinates over a projected triangle: linear in column and row.
pub(super) struct Barycentric {
    origin: DVec3,
    per_column: DVec3,
    per_row: DVec3,
}

impl Barycentric {
    /// None if the triangle is seen from its edge.
    pub(super) fn new([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
        let inverse = area.recip();
        if !inverse.is_finite() {
            return None;
        }
        let per_column = DVec3::new(b.y - c.y, c.y - a.y, a.y - b.y) * inverse;
        let per_row = DVec3::new(c.x - b.x, a.x - c.x, b.x - a.x) * inverse;
        // 1, 0, 0 at the first corner.
        let origin = DVec3::X - per_column * a.x - per_row * a.y;
        Some(Self { origin, per_column, per_row })
    }

    pub(super) fn at(&self, column: f64, row: f64) -> DVec3 {
        self.origin + self.per_column * column + self.per_row * row
    }

    /// Distance from each edge (opposite to corner 0, 1, 2), in samples.
    pub(super) fn edge_distances(&self, weights: DVec3) -> DVec3 {
        let slope = |k: usize| self.per_column[k].hypot(self.per_row[k]);
        weights / DVec3::new(slope(0), slope(1), slope(2))
    }
}
