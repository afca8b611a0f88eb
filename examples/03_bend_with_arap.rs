//! Lesson 3: a cylinder held at one end and bent at the other, through a cage and directly.
//!
//! `cargo run --release --example 03_bend_with_arap`

use std::error::Error;
use std::time::Instant;

use pliant::glam::DVec3;
use pliant::{
    Binding, CageSize, Goals, Handle, Method, Motion, Propagation, Propagator, Prune, Region, Silent, Similarity,
    TriMesh, VertexSet, edge_errors, shapes, simplify, write,
};

/// Bottom and top of an upright mesh, as handles.
fn ends(mesh: &TriMesh) -> Result<Region, Box<dyn Error>> {
    let bounds = mesh.bounds();
    let height = |v: u32| bounds.to_box(mesh.positions[v as usize]).y;
    let n = mesh.vertex_count();
    let bottom = Handle::hard(VertexSet::where_true(n, |v| height(v) < 0.1));
    let top = Handle::hard(VertexSet::where_true(n, |v| height(v) > 0.9));
    Ok(Region::new(n, &VertexSet::all(n), &[bottom, top])?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let upright = shapes::cylinder(0.5, 5.0, 160, 240, 12)?;
    let motion = Motion {
        pivot: upright.bounds().centre(),
        axis: DVec3::Z,
        angle: 1.2,
        scale: 1.0,
        translation: DVec3::new(-0.5, -0.5, 0.0),
    };

    // Once per mesh: cage and binding. Once per choice of handles: assembly and factorisation.
    let cage = simplify(&upright, &CageSize::Fraction(0.05).into(), &Silent)?.mesh;
    let binding = Binding::new(&upright, &cage, &Prune::default().into(), &Silent)?;
    let mut deformer = Method::default().prepare(&cage, &ends(&cage)?)?;

    // Many times: a drag in 20 steps. The last pose is the start of the next.
    let (mut cage_pose, mut pose) = (cage.positions.clone(), upright.positions.clone());
    let mut propagator = Propagator::new(Propagation::Frames);
    let start = Instant::now();
    for step in 1..=20 {
        let goals = Goals::new(vec![Similarity::IDENTITY, motion.at(f64::from(step) / 20.0)]);
        deformer.solve(&goals, &mut cage_pose)?;
        propagator.apply(&binding, &cage_pose, &mut pose);
    }
    let through_cage = start.elapsed() / 20;

    // The same without a cage.
    let mut deformer = Method::default().prepare(&upright, &ends(&upright)?)?;
    let mut direct = upright.positions.clone();
    let start = Instant::now();
    for step in 1..=20 {
        deformer.solve(&Goals::new(vec![Similarity::IDENTITY, motion.at(f64::from(step) / 20.0)]), &mut direct)?;
    }
    let directly = start.elapsed() / 20;

    let error = |pose: &[DVec3]| 1e2 * edge_errors(upright.topology(), &upright.positions, pose).rms_relative;
    println!("{} vertices, cage of {}", upright.vertex_count(), cage.vertex_count());
    println!("through the cage: {through_cage:.1?} a step, {:.2} % edge length error", error(&pose));
    println!("directly:         {directly:.1?} a step, {:.2} % edge length error", error(&direct));
    let output = std::env::temp_dir().join("pliant-bent-cylinder.glb");
    write(&output, &upright.with_positions(pose)?)?;
    println!("wrote {}", output.display());
    Ok(())
}
