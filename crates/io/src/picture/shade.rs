use glam::{DVec3, Vec3};
use pliant_mesh::{TriMesh, face_area_vector, vertex_normals};
use rayon::prelude::*;

use super::camera::Camera;
use super::colour::{colour_map, from_linear, to_linear};
use super::raster::{Barycentric, EMPTY, Samples};
use super::{Picture, PictureOptions, Values};

/// Half the width of a wireframe's lines, in pixels.
const HALF_LINE: f64 = 0.65;

/// Everything about the mesh that colours a sample.
pub(super) struct Surface<'a> {
    triangles: &'a [[u32; 3]],
    projected: &'a [DVec3],
    /// Along the camera's axes; per vertex, or per face in a wireframe.
    normals: Vec<Vec3>,
    flat: bool,
    colour: Vec3,
    values: Option<Values<'a>>,
    /// Half the width of lines, in samples; none without lines.
    half_line: Option<f64>,
}

impl<'a> Surface<'a> {
    pub(super) fn new(
        mesh: &'a TriMesh,
        camera: &Camera,
        projected: &'a [DVec3],
        options: &PictureOptions,
        values: Option<Values<'a>>,
    ) -> Self {
        let turned = |n: DVec3| camera.turn(n).as_vec3();
        let normals = if options.wireframe {
            (0..mesh.face_count()).map(|f| turned(face_area_vector(mesh.corners(f)).normalize_or_zero())).collect()
        } else {
            vertex_normals(mesh.topology(), &mesh.positions).into_iter().map(turned).collect()
        };
        let half_line = options
            .wireframe
            .then(|| line_width(mesh, projected, f64::from(options.supersampling)) * f64::from(options.supersampling));
        Self {
            triangles: mesh.triangles(),
            projected,
            normals,
            flat: options.wireframe,
            colour: to_linear(options.colour),
            values,
            half_line,
        }
    }
}

/// Half the width of lines in pixels: narrower where edges are so short that lines would cover the faces.
fn line_width(mesh: &TriMesh, projected: &[DVec3], supersampling: f64) -> f64 {
    let mut lengths: Vec<f64> = mesh
        .topology()
        .edges()
        .iter()
        .map(|&[a, b]| (projected[a as usize] - projected[b as usize]).truncate().length() / supersampling)
        .collect();
    let middle = lengths.len() / 2;
    if lengths.is_empty() {
        return HALF_LINE;
    }
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    HALF_LINE.min(0.1 * *median)
}

/// A face that is being coloured, sample after sample.
struct Face {
    index: u32,
    plane: Barycentric,
    /// Seen from its inner side.
    inner: bool,
}

impl Surface<'_> {
    fn face(&self, index: u32) -> Option<Face> {
        let corners = self.triangles[index as usize].map(|v| self.projected[v as usize]);
        // Rows grow downwards, so a face that is counter-clockwise to the viewer has a negative area here.
        let area = (corners[1] - corners[0]).truncate().perp_dot((corners[2] - corners[0]).truncate());
        Barycentric::new(corners).map(|plane| Face { index, plane, inner: area > 0.0 })
    }

    fn weights(face: &Face, column: usize, row: usize) -> DVec3 {
        face.plane.at(column as f64 + 0.5, row as f64 + 0.5)
    }

    /// Unit normal towards the viewer at a sample, along the camera's axes.
    pub(super) fn normal(&self, face: u32, column: usize, row: usize) -> Vec3 {
        self.face(face).map_or(Vec3::Z, |f| self.normal_at(&f, Self::weights(&f, column, row)))
    }

    fn normal_at(&self, face: &Face, weights: DVec3) -> Vec3 {
        let normal = if self.flat {
            self.normals[face.index as usize]
        } else {
            let [a, b, c] = self.triangles[face.index as usize].map(|v| self.normals[v as usize]);
            let w = weights.as_vec3();
            a * w.x + b * w.y + c * w.z
        };
        let facing = if face.inner { -normal } else { normal };
        // Near an outline the mean of the corners' normals may point away from the viewer.
        Vec3::new(facing.x, facing.y, facing.z.max(0.02)).normalize_or(Vec3::Z)
    }

    /// Light from a sample.
    fn light(&self, face: &Face, column: usize, row: usize, open: f32) -> Vec3 {
        let weights = Self::weights(face, column, row);
        let own = self.values.map_or(self.colour, |values| {
            let [a, b, c] = self.triangles[face.index as usize].map(|v| values.of_vertices[v as usize]);
            let (low, high) = values.range;
            to_linear(colour_map((DVec3::new(a, b, c).dot(weights) - low) / (high - low)))
        });
        let colour = if face.inner { own * INNER_TINT } else { own };
        let light = lit(colour, self.normal_at(face, weights), open);
        match self.half_line {
            Some(half) if face.plane.edge_distances(weights).min_element() < half => light * LINE_SHADE,
            _ => light,
        }
    }
}

/// Inner sides of faces are darker and bluish, so that a hole or an inside-out mesh is seen as one.
const INNER_TINT: Vec3 = Vec3::new(0.35, 0.45, 0.6);

/// Share of the face's light that a line on it keeps.
const LINE_SHADE: f32 = 0.1;

/// Light from a matt surface with a slight sheen; the normal is along right, up and towards the viewer.
fn lit(colour: Vec3, normal: Vec3, open: f32) -> Vec3 {
    // From the upper left and little in front, so that it grazes what faces the viewer and relief casts shades.
    const KEY: Vec3 = Vec3::new(-0.620_1, 0.620_1, 0.480_6);
    const KEY_LIGHT: Vec3 = Vec3::new(1.20, 1.15, 1.07);
    const FILL: Vec3 = Vec3::new(0.889_5, -0.202_2, 0.409_7);
    const FILL_LIGHT: Vec3 = Vec3::new(0.24, 0.27, 0.32);
    const SKY: Vec3 = Vec3::new(0.17, 0.185, 0.21);
    const GROUND: Vec3 = Vec3::new(0.07, 0.065, 0.06);
    let key = normal.dot(KEY).max(0.0);
    let fill = normal.dot(FILL).max(0.0);
    let around = GROUND.lerp(SKY, 0.5 + 0.5 * normal.y);
    let rim = (1.0 - normal.z).powi(3) * (0.6 + 0.4 * normal.y);
    let half = (KEY + Vec3::Z).normalize();
    let sheen = normal.dot(half).max(0.0).powi(30);
    // Hollows lose the light from around, and a part of the key light, as if by small shadows.
    let shadow = 0.35 + 0.65 * open;
    let matt = colour * (KEY_LIGHT * (key * shadow) + FILL_LIGHT * (fill * open) + around * open);
    matt + Vec3::splat(0.07 * sheen * shadow + 0.12 * rim * open)
}

/// Colours every sample and takes the mean over each pixel.
pub(super) fn resolve(samples: &Samples, surface: &Surface<'_>, openness: &[f32], options: &PictureOptions) -> Picture {
    let fine = options.supersampling as usize;
    let width = options.width as usize;
    let background = to_linear(options.background);
    let mut picture = Picture::filled(options.width, options.height, options.background);
    picture.rgb.par_chunks_mut(3 * width).enumerate().for_each(|(row, pixels)| {
        // Neighbouring samples mostly lie on one face.
        let mut last: Option<Face> = None;
        for (column, pixel) in pixels.chunks_exact_mut(3).enumerate() {
            let open = openness[row * width + column];
            let mut sum = Vec3::ZERO;
            let mut covered = false;
            for y in row * fine..(row + 1) * fine {
                for x in column * fine..(column + 1) * fine {
                    let face = samples.faces[y * samples.width + x];
                    if face != EMPTY && last.as_ref().is_none_or(|f| f.index != face) {
                        last = surface.face(face);
                    }
                    sum += match &last {
                        Some(on) if on.index == face => {
                            covered = true;
                            surface.light(on, x, y, open)
                        }
                        _ => background,
                    };
                }
            }
            if covered {
                pixel.copy_from_slice(&from_linear(sum / (fine * fine) as f32));
            }
        }
    });
    picture
}
