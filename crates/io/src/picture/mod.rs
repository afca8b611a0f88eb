//! Pictures of meshes, drawn in software: no display, no graphics driver, the same bits everywhere.
//!
//! ```
//! use pliant_io::picture::{PictureOptions, render};
//! # use pliant_mesh::TriMesh;
//! # use glam::DVec3;
//! # let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
//! # let mesh = TriMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])?;
//! let options = PictureOptions { width: 320, height: 240, wireframe: true, ..PictureOptions::default() };
//! let picture = render(&mesh, &options)?;
//! assert_eq!(picture.rgb.len(), 320 * 240 * 3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod camera;
mod colour;
mod occlusion;
mod png_file;
mod raster;
mod shade;
mod sheet;
mod strip;
mod text;
mod view;

use std::fmt;
use std::path::Path;

use glam::DVec3;
use pliant_mesh::TriMesh;
use thiserror::Error;

use crate::{FileError, IoError, write_atomic};
pub use colour::colour_map;
pub use sheet::{SheetCell, SheetRow, contact_sheet};
pub use strip::{strip, trim_alike};
pub use view::View;

/// What to draw a mesh like.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureOptions {
    /// Pixels across. Default: 1200.
    pub width: u32,
    /// Pixels down. Default: 900.
    pub height: u32,
    /// Where the camera stands. Default: [`View::default`].
    pub view: View,
    /// Draw edges as dark lines over flat faces, as suits a cage; otherwise faces are smooth. Default: false.
    pub wireframe: bool,
    /// Colour of the surface, sRGB. Default: clay.
    pub colour: [u8; 3],
    /// Colour where there is no surface, sRGB. Default: white.
    pub background: [u8; 3],
    /// Samples along each side of a pixel, 1 to 8; 2 or 3 make smooth outlines. Default: 3.
    pub supersampling: u32,
    /// Points that the picture has to hold, with as little round them as can be. Pictures of the same size, view and framing share one
    /// camera, so what stayed in place is in the same pixels. Default: none, for the mesh's own.
    pub framing: Vec<DVec3>,
}

impl Default for PictureOptions {
    fn default() -> Self {
        Self {
            width: 1200,
            height: 900,
            view: View::default(),
            wireframe: false,
            colour: [214, 173, 140],
            background: [255, 255, 255],
            supersampling: 3,
            framing: Vec::new(),
        }
    }
}

/// An image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Red, green and blue (sRGB) of each pixel, row after row from the top left.
    pub rgb: Vec<u8>,
}

/// Why a picture could not be drawn.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum PictureError {
    /// An option has a value that cannot be drawn with.
    #[error("a picture's {what} must be {expected}, not {found}")]
    BadOption {
        /// The option.
        what: &'static str,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// One value per vertex is needed.
    #[error("{found} values given for a mesh of {expected} vertices")]
    ValueCount {
        /// Vertices of the mesh.
        expected: usize,
        /// Values given.
        found: usize,
    },
}

impl PictureError {
    fn bad(what: &'static str, expected: impl Into<String>, found: impl fmt::Display) -> Self {
        Self::BadOption { what, expected: expected.into(), found: found.to_string() }
    }
}

/// Values that colour a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Values<'a> {
    /// One number per vertex; one that is NaN is drawn grey.
    pub of_vertices: &'a [f64],
    /// The numbers at the ends of the colour map; those beyond get the colour of the end.
    pub range: (f64, f64),
}

/// Draws a mesh: parallel projection, hidden surfaces by depth, a key light from the upper left, a soft fill, a rim, and
/// darker hollows, so that relief of a hundredth of the size shows. Both sides of a face are drawn, inner sides bluish.
///
/// Time grows with faces and samples: about half a second of processor time for 100,000 vertices at the default size,
/// shared by all threads.
///
/// # Errors
/// A size of 0 or of more than 2^28 samples in all, a supersampling that is not 1 to 8, a view without direction,
/// or a framing that is not finite.
pub fn render(mesh: &TriMesh, options: &PictureOptions) -> Result<Picture, PictureError> {
    draw(mesh, options, None)
}

/// Draws a mesh in the colours of numbers at its vertices, from dark violet (lowest) over green to yellow
/// ([`colour_map`]), in place of [`PictureOptions::colour`].
///
/// # Errors
/// As [`render`]; also another number of values than of vertices, or an empty range.
pub fn render_values(mesh: &TriMesh, values: Values<'_>, options: &PictureOptions) -> Result<Picture, PictureError> {
    if values.of_vertices.len() != mesh.vertex_count() {
        return Err(PictureError::ValueCount { expected: mesh.vertex_count(), found: values.of_vertices.len() });
    }
    let (low, high) = values.range;
    if !(low < high && (high - low).is_finite()) {
        return Err(PictureError::bad("range", "finite and increasing", format!("{low} to {high}")));
    }
    draw(mesh, options, Some(values))
}

/// Most samples that a picture may have: 2 GiB of working memory.
const MAX_SAMPLES: u64 = 1 << 28;

fn draw(mesh: &TriMesh, options: &PictureOptions, values: Option<Values<'_>>) -> Result<Picture, PictureError> {
    let [width, height, fine] = [options.width, options.height, options.supersampling].map(u64::from);
    if !(1..=8).contains(&fine) {
        return Err(PictureError::bad("supersampling", "1 to 8", fine));
    }
    let samples = width.saturating_mul(height).saturating_mul(fine * fine);
    if samples == 0 || samples > MAX_SAMPLES {
        let expected = format!("1 to {MAX_SAMPLES} samples (width x height x supersampling squared)");
        return Err(PictureError::bad("size", expected, format!("{width} x {height} x {fine} x {fine}")));
    }
    let camera = camera::Camera::new(mesh, options)?;
    let projected: Vec<DVec3> = mesh.positions.iter().map(|&p| camera.project(p)).collect();
    let samples = raster::Samples::draw(mesh.triangles(), &projected, options);
    let surface = shade::Surface::new(mesh, &camera, &projected, options, values);
    let openness = occlusion::openness(&samples, &surface, options);
    Ok(shade::resolve(&samples, &surface, &openness, options))
}

impl Picture {
    /// A picture of one colour.
    pub fn filled(width: u32, height: u32, colour: [u8; 3]) -> Self {
        let rgb = colour.repeat(width as usize * height as usize);
        Self { width, height, rgb }
    }

    /// Colour of the pixel in a column and row, counted from the top left.
    ///
    /// # Panics
    /// Outside the picture.
    pub fn pixel(&self, column: u32, row: u32) -> [u8; 3] {
        let start = 3 * (row as usize * self.width as usize + column as usize);
        [self.rgb[start], self.rgb[start + 1], self.rgb[start + 2]]
    }
}

/// Writes a picture as a PNG file, complete or not at all.
///
/// # Errors
/// Another extension than png, a picture that is no picture ([`Picture::to_png`]), or the system's answer.
pub fn write_png(path: &Path, picture: &Picture) -> Result<(), IoError> {
    crate::format::check_extension(path, &["png"], "write")?;
    let bytes = picture.to_png().map_err(|e| FileError::Refused {
        path: path.to_owned(),
        action: "write",
        reason: e.to_string(),
    })?;
    Ok(write_atomic(path, &bytes)?)
}
