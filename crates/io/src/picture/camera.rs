use glam::DVec3;
use pliant_mesh::{Bounds, TriMesh};

use super::{PictureError, PictureOptions};

/// Share of the picture's width and height left free on each side.
const MARGIN: f64 = 0.04;

/// Parallel projection to samples.
pub(super) struct Camera {
    /// Unit vectors, right-handed: right and up in the picture, and from the mesh to the camera.
    pub(super) right: DVec3,
    pub(super) up: DVec3,
    pub(super) towards: DVec3,
    /// Point shown in the middle.
    middle: DVec3,
    /// Samples per unit of length.
    scale: f64,
    /// The middle, in samples.
    centre: [f64; 2],
}

impl Camera {
    pub(super) fn new(mesh: &TriMesh, options: &PictureOptions) -> Result<Self, PictureError> {
        let towards = options.view.from.try_normalize().ok_or_else(|| {
            PictureError::bad("view", "seen from a direction that is finite and not zero", options.view.from)
        })?;
        let right = sideways(options.view.up, towards);
        let up = towards.cross(right);
        let size = [options.width, options.height].map(|n| f64::from(n) * f64::from(options.supersampling));
        let points = if options.framing.is_empty() { &mesh.positions } else { &options.framing };
        if let Some(point) = options.framing.iter().find(|point| !point.is_finite()) {
            return Err(PictureError::bad("framing", "finite", point));
        }
        // The box of all points along the camera's own axes; taken round one of them, so that a mesh far from the
        // origin loses no digits.
        let anchor = points.first().copied().unwrap_or_default();
        let along: Vec<DVec3> = points.iter().map(|&p| axes(p - anchor, right, up, towards)).collect();
        let seen = Bounds::of(&along);
        let centre = seen.centre();
        let middle = anchor + right * centre.x + up * centre.y + towards * centre.z;
        let extent = seen.size();
        let scale = (size[0] / extent.x).min(size[1] / extent.y) * (1.0 - 2.0 * MARGIN);
        // A single point, or a line seen from its end, has no extent: any scale shows it.
        let scale = if scale.is_finite() { scale } else { 1.0 };
        Ok(Self { right, up, towards, middle, scale, centre: size.map(|n| 0.5 * n) })
    }

    /// Column and row (in samples, from the top left) and height towards the camera, in the same unit.
    pub(super) fn project(&self, point: DVec3) -> DVec3 {
        let seen = axes(point - self.middle, self.right, self.up, self.towards) * self.scale;
        DVec3::new(self.centre[0] + seen.x, self.centre[1] - seen.y, seen.z)
    }

    /// A direction along the camera's axes: right, up, towards the camera.
    pub(super) fn turn(&self, direction: DVec3) -> DVec3 {
        axes(direction, self.right, self.up, self.towards)
    }
}

fn axes(v: DVec3, right: DVec3, up: DVec3, towards: DVec3) -> DVec3 {
    DVec3::new(v.dot(right), v.dot(up), v.dot(towards))
}

/// Unit vector to the right, across the direction of sight and `up`, or across the best axis if `up` is along it.
fn sideways(up: DVec3, towards: DVec3) -> DVec3 {
    let candidates = [up.normalize_or_zero(), DVec3::Z, DVec3::X];
    let across = candidates.iter().map(|u| u.cross(towards)).find(|r| r.length() > 1e-6);
    across.map_or(towards.any_orthonormal_vector(), DVec3::normalize)
}
