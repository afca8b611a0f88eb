//! Implicit Laplacian editing: what the paper proves, and what it shows.

mod common;

use common::{along_x, bar, distance, pyramid, sheet, torus};
use glam::DVec3;
use pliant_deform::implicit::{FeatureSize, Implicit, ImplicitConstraints, ImplicitOptions, Stage};
use pliant_deform::{Deformer, EdgeWeightKind, Goals, Handle, Region};
use pliant_mesh::{Similarity, TriMesh, VertexSet, shapes};

fn stretched(mesh: &TriMesh, by: DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| *p * by).collect()).expect("finite")
}

fn meshes() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("pyramid", pyramid()),
        ("wavy sheet", sheet(16, 8)),
        ("torus", torus(24, 10)),
        ("bar with flat sides", bar(4)),
        ("plane", shapes::plane_grid(12, 9, 3.0, 2.0).expect("valid")),
        ("needles", stretched(&bar(3), DVec3::new(60.0, 1.0, 1.0))),
        ("planar needles", stretched(&shapes::plane_grid(9, 9, 1.0, 1.0).expect("valid"), DVec3::new(300.0, 1.0, 1.0))),
    ]
}

fn variants() -> Vec<ImplicitOptions> {
    let mut all = Vec::new();
    for weights in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
        for rings in [1, 2, 3] {
            all.push(ImplicitOptions { weights, rings, ..ImplicitOptions::default() });
        }
    }
    all
}

fn similarity(mesh: &TriMesh) -> Similarity {
    let size = mesh.bounds().diagonal();
    let mut map = Similarity::about(mesh.bounds().centre(), DVec3::new(1.0, 2.0, -1.0), 2.5, 1.7);
    map.translation += size * DVec3::new(0.3, -1.0, 0.5);
    map
}

#[test]
fn explore() {
    for (name, mesh) in meshes() {
        let n = mesh.vertex_count();
        let image: Vec<DVec3> = mesh.positions.iter().map(|p| similarity(&mesh).apply(*p)).collect();
        let size = mesh.bounds().diagonal();
        for options in variants() {
            let one = Region::new(n, &VertexSet::all(n), &[Handle::hard(VertexSet::from_iter([0]))]).expect("valid");
            let ends = [0.0..=0.12, 0.88..=1.0].map(|range| Handle::hard(along_x(&mesh, range)));
            let two = Region::new(n, &VertexSet::all(n), &ends).expect("valid");
            let soft = Region::new(n, &VertexSet::all(n), &ends.map(|h| Handle::soft(h.vertices, 1.0))).expect("valid");
            let mut line = String::new();
            let mut degenerate = 0;
            for region in [&one, &two, &soft] {
                for constraints in [ImplicitConstraints::Both, ImplicitConstraints::Positions] {
                    let options = ImplicitOptions { constraints, ..options.clone() };
                    match Implicit::prepare(&options, &mesh, region) {
                        Ok(mut implicit) => {
                            let mut pose = mesh.positions.clone();
                            let k = region.handles().len();
                            implicit.solve(&Goals::identity(k), &mut pose).expect("ok");
                            let rest = distance(&pose, &mesh.positions) / size;
                            let goals = Goals::new(vec![similarity(&mesh); k]);
                            implicit.solve_preview(&goals, &mut pose).expect("ok");
                            let first = distance(&pose, &image) / size;
                            implicit.solve(&goals, &mut pose).expect("ok");
                            let full = distance(&pose, &image) / size;
                            degenerate = implicit.report().degenerate_vertices;
                            line += &format!(" | {rest:.0e} {first:.0e} {full:.0e}");
                        }
                        Err(error) => line += &format!(" | {error}"),
                    }
                }
            }
            println!("{name:20} {n} {degenerate} {options} {line}");
        }
    }
}
