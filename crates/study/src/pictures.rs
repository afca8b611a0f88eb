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
/// `rest` and `pose` are the same vertices; `framing` is what the picture has to hold ([`Study::framing`]), `view` where it is seen from.
/// Equal arguments give equal bytes, some 20 kB, in less than a tenth of a second for 20,000 vertices.
///
/// # Errors
/// [`coloured`]'s.
pub fn draw_pose(rest: &TriMesh, pose: &[DVec3], framing: &[DVec3], view: View) -> Result<Vec<u8>, StudyError> {
    let options =
        PictureOptions { width: WIDTH, height: HEIGHT, view, framing: framing.to_vec(), ..PictureOptions::default() };
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
    /// What pictures of all rows have to hold: the shape at rest and its handles at their goals. It depends on nothing else, so that pictures
    /// made in different places can be laid side by side.
    pub fn framing(&self) -> Vec<DVec3> {
        let rest = &self.shape.positions;
        let at_goals = self.scene.handles.iter().zip(self.scene.goals(1.0));
        let moved =
            at_goals.flat_map(|(handle, goal)| handle.vertices.iter().map(move |v| goal.apply(rest[v as usize])));
        rest.iter().copied().chain(moved).filter(|point| point.is_finite()).collect()
    }
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{Silent, shapes};

    use super::*;
    use crate::{Scene, SweepPlan, SweepSize};

    /// Pixels of a PNG that are not white, and their mean red plus green, which rises from violet to yellow.
    fn surface(png: &[u8]) -> (usize, f64) {
        let mut decoder = png::Decoder::new(std::io::Cursor::new(png));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().expect("a PNG");
        let mut rgb = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut rgb).expect("an image");
        assert_eq!((info.width, info.height), (WIDTH, HEIGHT));
        let drawn: Vec<&[u8]> = rgb.chunks_exact(3).filter(|pixel| *pixel != [255; 3]).collect();
        let light: f64 = drawn.iter().map(|pixel| f64::from(pixel[0]) + f64::from(pixel[1])).sum();
        (drawn.len(), light / drawn.len().max(1) as f64)
    }

    /// Stretched by a half along one axis, edges change length by a third and more on the average: the picture is yellow where it was violet.
    #[test]
    fn colours_say_how_much_edges_changed() {
        let shape = shapes::icosphere(4);
        let stretched: Vec<DVec3> = shape.positions.iter().map(|p| *p * DVec3::new(1.5, 1.5, 1.0)).collect();
        let draw = |pose: &[DVec3]| draw_pose(&shape, pose, &stretched, View::default()).expect("a picture");
        let (at_rest, posed) = (surface(&draw(&shape.positions)), surface(&draw(&stretched)));
        assert!(posed.1 > 2.0 * at_rest.1, "{} {}", at_rest.1, posed.1);
        // One camera for both: what is larger covers more.
        assert!(posed.0 as f64 > 1.2 * at_rest.0 as f64);
        // An ellipse framed tightly covers pi/4 of its box, whose longer side is 92 % of the picture's.
        let least = 0.7 * (0.92 * f64::from(HEIGHT)).powi(2) * std::f64::consts::FRAC_PI_4;
        assert!(posed.0 as f64 > least, "{} of {least}", posed.0);
    }

    #[test]
    fn equal_poses_give_equal_bytes() {
        let shape = shapes::creature(3000).expect("a shape");
        let scene = Scene::builtin("creature").expect("a scene");
        let study = Study::new("creature", &shape, &scene).expect("it fits");
        let draw = || draw_pose(&shape, &shape.positions, &study.framing(), usual_view(&shape.bounds()));
        let bytes = draw().expect("a picture");
        assert!(bytes.len() < 40_000, "{} bytes", bytes.len());
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        assert!(one.install(draw).expect("a picture") == bytes);
    }

    /// Handles at their goals are inside, whatever the rows are.
    #[test]
    fn the_framing_holds_rest_and_goals() {
        let shape = shapes::by_name("bar", 500).expect("a shape");
        let scene = Scene::builtin("bar-twist-135").expect("a scene");
        let study = Study::new("bar", &shape, &scene).expect("it fits");
        let framing = Bounds::of(&study.framing());
        let setting = SweepPlan { sizes: vec![SweepSize::None], ..SweepPlan::default() }.settings().remove(0);
        let pose = crate::RowMaker::new(&study).make(&setting, &Silent).pose.expect("a pose");
        let handles = study.scene.handles.iter().flat_map(|handle| handle.vertices.iter());
        let shown = handles.map(|v| pose[v as usize]).chain(shape.positions.iter().copied());
        for point in shown {
            let off = point.clamp(framing.min, framing.max).distance(point);
            assert!(off <= 1e-9 * framing.diagonal(), "{point} is {off} outside");
        }
    }

    #[test]
    fn what_is_no_pose_is_refused() {
        let shape = shapes::icosphere(1);
        let draw = |pose: &[DVec3]| draw_pose(&shape, pose, &[], View::default());
        let mut broken = shape.positions.clone();
        broken[3].y = f64::NAN;
        assert!(matches!(draw(&broken), Err(StudyError::Pose(_))));
        assert!(matches!(draw(&broken[1..]), Err(StudyError::Pose(_))));
        let nowhere = View { from: DVec3::ZERO, up: DVec3::Y };
        assert!(matches!(draw_pose(&shape, &shape.positions, &[], nowhere), Err(StudyError::Picture(_))));
        let far = [DVec3::splat(-1e308), DVec3::splat(1e308)];
        assert!(draw_pose(&shape, &shape.positions, &far, View::default()).is_ok());
    }
}
