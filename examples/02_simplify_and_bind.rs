//! Lesson 2: a control mesh, and a shape bound to it.
//!
//! `cargo run --release --example 02_simplify_and_bind [MODEL]`

use std::error::Error;
use std::path::Path;

use pliant::{Binding, CageSize, Propagation, Prune, Silent, creature, edge_errors, read, simplify, surface_distance};

fn main() -> Result<(), Box<dyn Error>> {
    let shape = match std::env::args().nth(1) {
        Some(path) => read(Path::new(&path))?.mesh,
        None => creature(20_000)?,
    };

    // The cage is a subset of the shape's vertices: `origin` says which.
    let made = simplify(&shape, &CageSize::Fraction(0.05).into(), &Silent)?;
    let distance = surface_distance(&shape.positions, &made.mesh).rms / shape.bounds().diagonal();
    println!(
        "cage: {} of {} vertices, {:.3} % of the diagonal away",
        made.report.reached,
        shape.vertex_count(),
        1e2 * distance
    );
    assert_eq!(made.mesh.positions[0], shape.positions[made.origin[0] as usize]);

    // The same shape bound by three rules. Nothing is deformed, so whatever moves is the binding's own error.
    for prune in [Prune::PAPER, Prune::default(), Prune::Smooth { neighbours: 24 }] {
        let binding = Binding::new(&shape, &made.mesh, &prune.into(), &Silent)?;
        let report = binding.report();
        println!("{prune}: {:.1} weights a vertex, at most {}", report.kept_mean, report.kept_max);
        for propagation in [Propagation::Positions, Propagation::Frames] {
            let rest = binding.apply(&made.mesh.positions, propagation);
            let error = edge_errors(shape.topology(), &shape.positions, &rest).rms_relative;
            println!("  at rest by {propagation}: {:.2} % edge length error", 1e2 * error);
        }
        for warning in report.warnings() {
            println!("  warning: {warning}");
        }
    }
    Ok(())
}
