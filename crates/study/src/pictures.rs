//! Pictures of edited shapes, coloured by what they are judged by: how much edges changed length.

use glam::DVec3;
use pliant_io::picture::{Picture, PictureOptions, Values, View, render_values};
use pliant_mesh::metrics::edge_errors_at_vertices;
use pliant_mesh::{Bounds, TriMesh};

use crate::StudyError;
use crate::pipeline::Study;
use crate::report::PICTURE_WORST;

/// Size of [`draw_pose`]'s pictures in pixels.
const WIDTH: u32 = 360;
const HEIGHT: u32 = 300;

/// A pose of a shape as a small PNG of 360 x 300 pixels, coloured by the mean relative length error of the edges at each vertex from 0
/// (violet) to [`PICTURE_WORST`] (yellow).
///
/// `rest` and `pose` are the same vertices; `framing` is the box that the picture shows, `view` where it is seen from. Equal arguments give
/// equal bytes, some 20 to 30 kB, in about a third of a second for 20,000 vertices.
///
/// # Errors
/// [`coloured`]'s.
pub fn draw_pose(rest: &TriMesh, pose: &[DVec3], framing: Bounds, view: View) -> Result<Vec<u8>, StudyError> {
    let options =
        PictureOptions { width: WIDTH, height: HEIGHT, view, framing: Some(framing), ..PictureOptions::default() };
    Ok(coloured(rest, pose, &options)?.to_small_png()?)
}

/// A pose of a shape, coloured as [`draw_pose`] does; `options` say the rest.
///
/// # Errors
/// There are not as many positions as vertices, one is not finite, or [`render_values`] refuses.
pub fn coloured(rest: &TriMesh, pose: &[DVec3], options: &PictureOptions) -> Result<Picture, StudyError> {
    let posed = rest.with_positions(pose.to_vec()).map_err(StudyError::Pose)?;
    let errors = edge_errors_at_vertices(rest.topology(), &rest.positions, pose);
    let values = Values { of_vertices: &errors, range: (0.0, PICTURE_WORST) };
    Ok(render_values(&posed, values, options)?)
}

/// Where a shape is best seen from, by its box at rest: from the front; something flat that lies in the plane z = 0, from low above its
/// side, so that what is lifted from it shows.
pub fn usual_view(rest: &Bounds) -> View {
    let size = rest.size();
    if size.z < 0.3 * size.x.min(size.y) {
        View { from: DVec3::new(0.5, -1.0, 0.45), up: DVec3::Z }
    } else {
        View::default()
    }
}

impl Study<'_> {
    /// What pictures of all rows show: the box of the shape at rest and of its handles at their goals. It depends on nothing else, so that
    /// pictures made in different places can be laid side by side.
    pub fn framing(&self) -> Bounds {
        let rest = self.shape.bounds();
        let at_goals = self.scene.handles.iter().zip(self.scene.goals(1.0));
        let moved = at_goals.flat_map(|(handle, goal)| {
            handle.vertices.iter().map(move |v| goal.apply(self.shape.positions[v as usize]))
        });
        Bounds::of(&[rest.min, rest.max].into_iter().chain(moved.filter(|p| p.is_finite())).collect::<Vec<_>>())
    }
}
