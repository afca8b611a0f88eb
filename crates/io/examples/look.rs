//! Draws a mesh file as it is and as a wireframe.
use glam::DVec3;
use pliant_io::picture::*;
use std::path::Path;
use std::time::Instant;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let t = Instant::now();
    let asset = pliant_io::read(Path::new(&args[1])).expect("read");
    eprintln!("read {:?} {:?}", t.elapsed(), asset.report);
    let from = if args.len() > 5 {
        DVec3::new(args[3].parse().unwrap(), args[4].parse().unwrap(), args[5].parse().unwrap())
    } else {
        View::default().from
    };
    let o = PictureOptions { view: View { from, up: DVec3::Y }, ..Default::default() };
    let t = Instant::now();
    let p = render(&asset.mesh, &o).expect("render");
    eprintln!("render {:?}", t.elapsed());
    let t = Instant::now();
    write_png(Path::new(&format!("{}-smooth.png", args[2])), &p).expect("png");
    eprintln!("png {:?}", t.elapsed());
    let w = render(&asset.mesh, &PictureOptions { wireframe: true, ..o.clone() }).expect("render");
    write_png(Path::new(&format!("{}-wire.png", args[2])), &w).expect("png");
    let v: Vec<f64> = asset.mesh.positions.iter().map(|p| p.y).collect();
    let b = asset.mesh.bounds();
    let c = render_values(&asset.mesh, Values { of_vertices: &v, range: (b.min.y, b.max.y) }, &o).expect("render");
    write_png(Path::new(&format!("{}-values.png", args[2])), &c).expect("png");
    let t = trim_alike(&[p, w, c], 10, [255; 3]);
    write_png(Path::new(&format!("{}-strip.png", args[2])), &strip(&t, 10, [255; 3])).expect("png");
    for ext in ["obj", "ply", "glb"] {
        let t = Instant::now();
        pliant_io::write(Path::new(&format!("{}.{ext}", args[2])), &asset.mesh).expect("w");
        eprintln!("{ext} {:?}", t.elapsed());
    }
}
