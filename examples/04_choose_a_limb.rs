//! Lesson 4: from two clicks on the screen to a region, ready to be edited.
//!
//! `cargo run --release --example 04_choose_a_limb`

use std::error::Error;

use pliant::glam::dcamera::rh::{proj::directx, view};
use pliant::glam::{DVec2, DVec3};
use pliant::select::{self, FillLimit, RayCaster, ScreenCamera, Seen};
use pliant::{Handle, PictureOptions, Region, Values, View, creature, render_values, write_png};

fn main() -> Result<(), Box<dyn Error>> {
    let shape = creature(30_000)?;
    let (topology, positions) = (shape.topology(), &shape.positions);

    // A viewer has a camera: a matrix to clip space, and the size of its window.
    let eye = DVec3::new(2.0, 1.6, 4.0);
    let matrix = directx::perspective(0.6, 4.0 / 3.0, 0.1, 100.0) * view::look_at_mat4(eye, DVec3::Y * 0.9, DVec3::Y);
    let camera = ScreenCamera::new(matrix, DVec2::new(1200.0, 900.0))?;

    // A click is a ray, and of the face it meets first the nearest corner is meant. Here the places are known from the creature's bones:
    // the tip of a finger, and the upper arm.
    let caster = RayCaster::new(&shape);
    let click = |place: DVec3| {
        let pixel = camera.project(place)?;
        println!("a click at {:.0}, {:.0}", pixel.x, pixel.y);
        Some(caster.pick(&camera.ray(pixel))?.vertex(topology))
    };
    let first = click(DVec3::new(0.85, 0.985, 0.245)).ok_or("nothing was clicked")?;
    let last = click(DVec3::new(0.38, 0.91, 0.05)).ok_or("nothing was clicked")?;

    // Water filling: from the first vertex up to the plane across the line between both, at the last one.
    let arm = select::water_fill(topology, positions, first, last, FillLimit::Plane)?;
    println!("{} of {} vertices, closed off by a {:?}", arm.region.len(), positions.len(), arm.closure);
    for curve in &arm.curves {
        println!("cut along {} edges, {:.3} long", curve.edges.len(), curve.length());
    }

    // From the belly to a knee the plane cuts both legs, which the first rule reports; the second cuts only where the last click was.
    let belly = click(DVec3::new(0.15, 0.75, 0.3)).ok_or("nothing was clicked")?;
    let knee = click(DVec3::new(0.24, 0.28, 0.15)).ok_or("nothing was clicked")?;
    for limit in [FillLimit::Plane, FillLimit::NearestCurves] {
        let body = select::water_fill(topology, positions, belly, knee, limit)?;
        println!(
            "body by {limit:?}: {} vertices, {:?}, leaked: {}",
            body.region.len(),
            body.closure,
            body.closure.leaked()
        );
    }

    // A hand to pull with, by a box on the screen; and what may move freely ends two rings before the rest.
    let corner = |x: f64, y: f64| camera.project(DVec3::new(x, y, 0.2)).ok_or("not before the camera");
    let on_screen = [corner(0.66, 1.15)?, corner(1.0, 0.8)?];
    let all_through = select::screen_box(topology, positions, &camera, on_screen, Seen::Through)?;
    let in_sight = select::screen_box(topology, positions, &camera, on_screen, Seen::Unhidden(&caster))?;
    let hand = all_through.intersection(&arm.region);
    let free = select::shrink(topology, &arm.region, 2)?.union(&hand);
    println!("hand: {} vertices, {} of them in sight; free: {}", hand.len(), in_sight.len(), free.len());
    let region = Region::new(positions.len(), &free, &[Handle::hard(hand.clone())])?;
    assert_eq!(region.handles().len(), 1);

    // In colours: the body, the arm, its hand.
    let value = |v: u32| f64::from(u8::from(arm.region.contains(v)) + u8::from(hand.contains(v)));
    let values: Vec<f64> = (0..positions.len() as u32).map(value).collect();
    let options = PictureOptions { view: View { from: eye, up: DVec3::Y }, ..PictureOptions::default() };
    let picture = render_values(&shape, Values { of_vertices: &values, range: (0.0, 2.0) }, &options)?;
    let output = std::env::temp_dir().join("pliant-chosen-arm.png");
    write_png(&output, &picture)?;
    println!("wrote {}", output.display());
    Ok(())
}
