use std::f32::consts::TAU;

use glam::Vec3;
use rayon::prelude::*;

use super::PictureOptions;
use super::raster::{EMPTY, Samples};
use super::shade::Surface;

/// Directions and distances at which a pixel looks for neighbours that stand higher.
const TAPS: usize = 16;

/// Ways in which the pattern of neighbours is turned: one for each pixel of a block of 4 x 4.
const TURNS: usize = 16;

/// Farthest neighbours of the fine and the coarse pass, as shares of the picture's diagonal: one finds relief, the other
/// limbs and folds.
const REACHES: [f32; 2] = [0.008, 0.045];

/// How much of the light from all around reaches each pixel: 1 where nothing stands higher, less in hollows.
///
/// Ambient obscurance from the drawn depth (after McGuire et al., "The Alchemy Screen-Space Ambient Obscurance Algorithm",
/// HPG 2011): the mean, over neighbours, of how high each stands above the pixel's tangent plane. Neighbours are taken
/// on a spiral that is turned by one of 16 angles per pixel, and the pattern that leaves is blurred away.
pub(super) fn openness(samples: &Samples, surface: &Surface<'_>, options: &PictureOptions) -> Vec<f32> {
    let pixels = Pixels::new(samples, surface, options);
    let diagonal = (pixels.width as f32).hypot(pixels.height as f32);
    let reaches = REACHES.map(|share| (share * diagonal).max(2.0));
    let offsets = reaches.map(spirals);
    let mut open = vec![1.0; pixels.points.len()];
    open.par_chunks_mut(pixels.width).enumerate().for_each(|(row, open)| {
        for (column, open) in open.iter_mut().enumerate() {
            let i = row * pixels.width + column;
            if pixels.normals[i] != Vec3::ZERO {
                let [fine, coarse] = [0, 1].map(|k| pixels.obscurance(column, row, reaches[k], &offsets[k]));
                *open = (1.0 - 1.3 * fine).max(0.0) * (1.0 - 1.6 * coarse).max(0.0);
            }
        }
    });
    pixels.blur(&open)
}

/// Columns and rows to the neighbours within `reach`, for each turn.
fn spirals(reach: f32) -> [[(isize, isize); TAPS]; TURNS] {
    std::array::from_fn(|turn| {
        std::array::from_fn(|tap| {
            let radius = reach * (tap as f32 + 0.5) / TAPS as f32;
            // The golden angle spreads the directions evenly for any number of taps.
            let angle = turn as f32 * (TAU / TURNS as f32) + tap as f32 * 2.399_963;
            ((radius * angle.cos()).round() as isize, (radius * angle.sin()).round() as isize)
        })
    })
}

/// The surface at the middle of each pixel: one sample of each.
struct Pixels {
    width: usize,
    height: usize,
    /// Right, down and towards the camera, in pixels.
    points: Vec<Vec3>,
    /// Right, up and towards the camera; zero where there is no surface.
    normals: Vec<Vec3>,
}

impl Pixels {
    fn new(samples: &Samples, surface: &Surface<'_>, options: &PictureOptions) -> Self {
        let (width, height) = (options.width as usize, options.height as usize);
        let fine = options.supersampling as usize;
        let (points, normals) = (0..width * height)
            .into_par_iter()
            .map(|i| {
                let (column, row) = (i % width, i / width);
                let (x, y) = (column * fine + fine / 2, row * fine + fine / 2);
                let sample = y * samples.width + x;
                match samples.faces[sample] {
                    EMPTY => (Vec3::ZERO, Vec3::ZERO),
                    face => {
                        let point = Vec3::new(x as f32, y as f32, samples.heights[sample]) / fine as f32;
                        (point, surface.normal(face, x, y))
                    }
                }
            })
            .unzip();
        Self { width, height, points, normals }
    }

    fn obscurance(&self, column: usize, row: usize, reach: f32, offsets: &[[(isize, isize); TAPS]; TURNS]) -> f32 {
        let i = row * self.width + column;
        let (here, normal) = (self.points[i], self.normals[i]);
        let mut sum = 0.0;
        for (right, down) in offsets[(column % 4) * 4 + row % 4] {
            let x = column.checked_add_signed(right).filter(|&x| x < self.width);
            let y = row.checked_add_signed(down).filter(|&y| y < self.height);
            let (Some(x), Some(y)) = (x, y) else { continue };
            let j = y * self.width + x;
            if j == i || self.normals[j] == Vec3::ZERO {
                continue;
            }
            let away = self.points[j] - here;
            // Rows grow downwards, normals point up.
            let height = away.x * normal.x - away.y * normal.y + away.z * normal.z;
            let distance = away.length();
            // Twice the reach and beyond, nothing counts: a limb in front does not darken the body far behind it.
            let near = (1.0 - distance / (2.0 * reach)).max(0.0);
            sum += (height / distance - 0.03).max(0.0) * near;
        }
        2.0 * sum / TAPS as f32
    }

    /// Mean over a neighbourhood of 4 x 4, the period of the taps' turns, on the same part of the surface.
    fn blur(&self, open: &[f32]) -> Vec<f32> {
        let mut blurred = vec![1.0; open.len()];
        blurred.par_chunks_mut(self.width).enumerate().for_each(|(row, blurred)| {
            for (column, blurred) in blurred.iter_mut().enumerate() {
                let i = row * self.width + column;
                if self.normals[i] == Vec3::ZERO {
                    continue;
                }
                let (mut sum, mut count) = (0.0, 0.0);
                for y in row.saturating_sub(2)..(row + 2).min(self.height) {
                    for x in column.saturating_sub(2)..(column + 2).min(self.width) {
                        let j = y * self.width + x;
                        let same = (self.points[j].z - self.points[i].z).abs() < 8.0;
                        if same && self.normals[j].dot(self.normals[i]) > 0.5 {
                            sum += open[j];
                            count += 1.0;
                        }
                    }
                }
                // The pixel itself is always among them.
                *blurred = sum / count;
            }
        });
        blurred
    }
}
