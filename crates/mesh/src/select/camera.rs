use glam::{DMat4, DVec2, DVec3, DVec4};

use super::Ray;
use crate::MeshError;

/// A camera as a viewer has it: a matrix from the model to clip space, and the size of the viewport.
///
/// Pixels are counted from the top left, x to the right and y down; the pixel in column `i` and row `j` has its middle at
/// `(i + 0.5, j + 0.5)`. Clip space is that of WebGPU, Metal, Direct3D and OpenGL: x to the right, y up (Vulkan's has y down), and
/// in a perspective `w` positive before the camera. Any depth range will do, except that with a parallel projection depth has to
/// grow away from the camera. Near and far planes hide nothing here.
///
/// ```
/// use glam::dcamera::rh::{proj::directx, view};
/// use glam::{DVec2, DVec3};
/// use pliant_mesh::select::ScreenCamera;
///
/// let view = view::look_at_mat4(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y);
/// let lens = directx::perspective(0.8, 4.0 / 3.0, 0.1, 100.0);
/// let camera = ScreenCamera::new(lens * view, DVec2::new(800.0, 600.0))?;
/// assert_eq!(camera.project(DVec3::ZERO), Some(DVec2::new(400.0, 300.0)));
/// # Ok::<(), pliant_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScreenCamera {
    /// Rows of the matrix: clip coordinates x, y, z and w.
    rows: [DVec4; 4],
    size: DVec2,
    /// The eye as a homogeneous point: `w` positive in a perspective, 0 in a parallel projection.
    eye: DVec4,
}

impl ScreenCamera {
    /// A camera with a viewport of `size` pixels (width, height).
    ///
    /// # Errors
    /// A matrix that is not finite or has no inverse, or a size that is not positive.
    pub fn new(view_projection: DMat4, size: DVec2) -> Result<Self, MeshError> {
        let bad = |what, expected: &str, found| Err(MeshError::BadParameter { what, expected: expected.into(), found });
        if !(size.is_finite() && size.min_element() > 0.0) {
            return bad("the viewport's size", "finite and positive", size.to_string());
        }
        let rows = [0, 1, 2, 3].map(|i| view_projection.row(i));
        let determinant = view_projection.determinant();
        if !(determinant.is_finite() && determinant != 0.0) {
            return bad("the camera's matrix", "finite and invertible", view_projection.to_string());
        }
        let eye = across(rows[0], rows[1], rows[3]);
        // A parallel projection has its eye at infinity, on the side that depth grows away from.
        let sign = if eye.w == 0.0 { -rows[2].truncate().dot(eye.truncate()) } else { eye.w };
        let mut eye = eye * sign.signum();
        // The reciprocal of -0 would be on the wrong side.
        eye.w = eye.w.abs();
        Ok(Self { rows, size, eye })
    }

    /// Where a point is seen, in pixels; `None` if it is not before the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let [x, y, _, w] = self.rows.map(|row| row.dot(point.extend(1.0)));
        let seen = 0.5 * DVec2::new(1.0 + x / w, 1.0 - y / w) * self.size;
        (w > 0.0 && seen.is_finite()).then_some(seen)
    }

    /// The ray of all points that are seen at a place of the screen, in pixels.
    ///
    /// It starts at the eye, or with a parallel projection at depth -1, which is on or before the near plane.
    pub fn ray(&self, pixel: DVec2) -> Ray {
        let [x, y, z, w] = self.rows;
        let at = DVec2::new(2.0, -2.0) * pixel / self.size + DVec2::new(-1.0, 1.0);
        // The ray is where the planes of its column and its row meet.
        let (column, row) = (x - w * at.x, y - w * at.y);
        let along = column.truncate().cross(row.truncate());
        let ahead = if self.eye.w > 0.0 { w.truncate() } else { z.truncate() };
        let direction = along * along.dot(ahead).signum();
        let start = if self.eye.w > 0.0 { self.eye } else { across(column, row, z + w) };
        Ray { origin: start.truncate() / start.w, direction }
    }

    /// From a point to the eye: along this direction, and with a perspective ending at the eye at the given multiple of it.
    pub(super) fn to_eye(self, point: DVec3) -> (DVec3, f64) {
        (self.eye.truncate() - point * self.eye.w, self.eye.w.recip())
    }
}

/// The homogeneous point on three planes, up to a factor.
fn across(a: DVec4, b: DVec4, c: DVec4) -> DVec4 {
    let normals = [a.truncate(), b.truncate(), c.truncate()];
    let [p, q, r] = normals;
    let point = q.cross(r) * a.w + r.cross(p) * b.w + p.cross(q) * c.w;
    (-point).extend(p.dot(q.cross(r)))
}

#[cfg(test)]
pub(super) mod tests {
    use glam::dcamera::rh::{proj::directx, proj::opengl, view};

    use super::*;

    /// Cameras of every kind at a place, looking to near the origin.
    pub(crate) fn cameras() -> Vec<(ScreenCamera, DVec3)> {
        let eye = DVec3::new(2.0, 1.5, 4.0);
        let view = view::look_at_mat4(eye, DVec3::new(0.1, 0.2, 0.0), DVec3::Y);
        let aspect = 4.0 / 3.0;
        let lenses = [
            directx::perspective(0.8, aspect, 0.1, 100.0),
            opengl::perspective(0.8, aspect, 0.1, 100.0),
            directx::perspective_infinite_reverse(0.8, aspect, 0.1),
            directx::orthographic(-2.0, 2.0, -1.5, 1.5, 0.1, 100.0),
            opengl::orthographic(-2.0, 2.0, -1.5, 1.5, 0.1, 100.0),
        ];
        let size = DVec2::new(800.0, 600.0);
        lenses.map(|lens| (ScreenCamera::new(lens * view, size).expect("a camera"), eye)).to_vec()
    }

    /// What a ray passes is seen where the ray was made, before the eye, and nowhere behind it.
    #[test]
    fn rays_pass_what_is_seen_at_their_pixel() {
        for (camera, _) in cameras() {
            for pixel in [DVec2::new(400.0, 300.0), DVec2::new(0.5, 599.5), DVec2::new(-90.0, 17.0)] {
                let ray = camera.ray(pixel);
                for t in [0.5, 2.0, 30.0] {
                    let point = ray.origin + ray.direction.normalize() * t;
                    let seen = camera.project(point).expect("before the camera");
                    assert!(seen.distance(pixel) < 1e-9, "{seen} is not {pixel}");
                }
            }
        }
    }

    #[test]
    fn rays_start_at_the_eye_and_lead_away_from_it() {
        for (camera, eye) in cameras() {
            let ray = camera.ray(DVec2::new(123.0, 456.0));
            let point = DVec3::new(0.3, -0.2, 0.1);
            let (back, reach) = camera.to_eye(point);
            if reach.is_finite() {
                assert!(ray.origin.distance(eye) < 1e-12 && (point + back * reach).distance(eye) < 1e-12);
                assert!(camera.project(2.0 * eye).is_none());
            } else {
                assert!(back.normalize().distance((eye - DVec3::new(0.1, 0.2, 0.0)).normalize()) < 1e-12);
            }
            // The scene is near the origin.
            assert!(ray.direction.dot(point - eye) > 0.0 && back.dot(eye - point) > 0.0);
        }
    }

    #[test]
    fn corners_of_the_viewport_are_where_they_should_be() {
        let lens = directx::orthographic(-2.0, 2.0, -1.5, 1.5, 1.0, 10.0);
        let view = view::look_at_mat4(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y);
        let camera = ScreenCamera::new(lens * view, DVec2::new(80.0, 60.0)).expect("a camera");
        for (point, pixel) in [((-2.0, 1.5), (0.0, 0.0)), ((2.0, -1.5), (80.0, 60.0)), ((1.0, 0.0), (60.0, 30.0))] {
            let seen = camera.project(DVec3::new(point.0, point.1, 0.7)).expect("seen");
            assert!(seen.distance(DVec2::from(pixel)) < 1e-12);
        }
    }

    #[test]
    fn bad_cameras_are_refused_and_bad_pixels_make_bad_rays() {
        let size = DVec2::new(80.0, 60.0);
        for matrix in [DMat4::ZERO, DMat4::NAN, DMat4::IDENTITY * f64::INFINITY] {
            assert!(ScreenCamera::new(matrix, size).is_err());
        }
        for size in [DVec2::ZERO, DVec2::new(-1.0, 5.0), DVec2::NAN, DVec2::INFINITY] {
            assert!(ScreenCamera::new(DMat4::IDENTITY, size).is_err());
        }
        for (camera, _) in cameras() {
            assert!(!camera.ray(DVec2::NAN).direction.is_finite());
            assert!(camera.project(DVec3::NAN).is_none());
        }
    }
}
