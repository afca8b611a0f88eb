//! Lesson 1: a mesh from a file, what it is, and back to a file.
//!
//! `cargo run --release --example 01_read_and_write [MODEL]`

use std::error::Error;
use std::path::Path;

use pliant::{read, shapes, write};

fn main() -> Result<(), Box<dyn Error>> {
    // Without a file to read, make one.
    let folder = std::env::temp_dir().join("pliant-examples");
    std::fs::create_dir_all(&folder)?;
    let path = match std::env::args().nth(1) {
        Some(path) => path.into(),
        None => {
            let path = folder.join("torus.ply");
            write(&path, &shapes::torus(1.0, 0.35, 96, 40)?)?;
            path
        }
    };

    // Reading welds and triangulates; the report says what was changed on the way.
    let asset = read(Path::new(&path))?;
    let (mesh, topology) = (&asset.mesh, asset.mesh.topology());
    println!("{}: {} vertices, {} faces", path.display(), mesh.vertex_count(), mesh.face_count());
    println!("repairs: {:?}", asset.report.clean);

    // Any triangles make a mesh; what needs more asks for it, and the error names the place.
    match topology.require_manifold().and_then(|()| topology.require_closed()) {
        Ok(()) => println!("closed and manifold, Euler characteristic {}", topology.euler_characteristic()),
        Err(why) => println!("{why}"),
    }

    // Positions are the only state: the same connectivity, other positions.
    let raised = mesh.with_positions(mesh.positions.iter().map(|p| *p + mesh.bounds().size()).collect())?;
    let output = folder.join("moved.glb");
    write(&output, &raised)?;
    println!("wrote {}", output.display());
    Ok(())
}
