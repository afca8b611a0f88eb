//! The promises on real meshes. `scripts/fetch-models` brings them; without them these tests say that they were skipped.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use pliant::glam::DVec3;
use pliant::{Binding, CageSize, Prune, Scene, Silent, SweepPlan, TriMesh, read, simplify, sweep, vertex_normals};

/// Fetched models of at most `most` vertices: path and mesh.
fn models(most: usize) -> Vec<(PathBuf, TriMesh)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let mut paths: Vec<PathBuf> = match std::fs::read_dir(&folder) {
        Ok(entries) => entries.filter_map(|e| e.ok().map(|e| e.path())).collect(),
        Err(_) => Vec::new(),
    };
    if paths.is_empty() {
        println!("SKIPPED: no models; scripts/fetch-models brings them");
    }
    paths.sort();
    // The size of the file keeps the largest from being read where they are not wanted: at least 20 bytes a vertex.
    paths.retain(|p| p.metadata().is_ok_and(|m| m.len() < 150 * most as u64));
    let open = |p: PathBuf| {
        let mesh = read(&p).unwrap_or_else(|e| panic!("{e}")).mesh;
        (p, mesh)
    };
    paths.into_iter().map(open).filter(|(_, mesh)| mesh.vertex_count() <= most).collect()
}

/// Cages of 5 % and 1 %: manifold wherever the model is, same Euler characteristic, subset and owner maps right, no face turned over.
#[test]
fn cages_keep_what_the_models_are() {
    for (path, shape) in models(500_000) {
        let name = path.display();
        let before = shape.topology();
        let normals = vertex_normals(before, &shape.positions);
        let own: HashSet<[u32; 3]> = shape.triangles().iter().copied().collect();
        for share in [0.05, 0.01] {
            let made =
                simplify(&shape, &CageSize::Fraction(share).into(), &Silent).unwrap_or_else(|e| panic!("{name}: {e}"));
            let after = made.mesh.topology();
            assert_eq!(after.euler_characteristic(), before.euler_characteristic(), "{name}");
            assert!(after.is_manifold() || !before.is_manifold(), "{name}");
            assert_eq!(after.non_manifold_edge_count(), before.non_manifold_edge_count(), "{name}");
            assert_eq!(made.report.flipped_faces, 0, "{name}");
            for (j, &v) in made.origin.iter().enumerate() {
                assert!(made.mesh.positions[j] == shape.positions[v as usize], "{name}");
                assert_eq!(made.owner[v as usize] as usize, j, "{name}");
            }
            // A face may look inward only if it is the model's own, folded there already.
            for (face, triangle) in made.mesh.triangles().iter().enumerate() {
                let [a, b, c] = made.mesh.corners(face);
                let corners = triangle.map(|j| made.origin[j as usize]);
                let outward: DVec3 = corners.iter().map(|&v| normals[v as usize]).sum();
                let inward = (b - a).cross(c - a).dot(outward) < 0.0;
                assert!(!inward || own.contains(&corners), "{name}: face {face} of the cage is turned over");
            }
            let wanted = (share * shape.vertex_count() as f64).round() as usize;
            assert!(made.report.reached == wanted || !made.report.warnings().is_empty(), "{name}");
        }
    }
}

/// At a 5 % cage, with default options, no model comes apart.
#[test]
fn no_model_blows_up() {
    for (path, shape) in models(30_000) {
        let name = path.display();
        if shape.vertex_count() < 2000 {
            // A cage of fewer than a hundred vertices promises nothing.
            continue;
        }
        let scene = Scene::auto(&shape.bounds());
        let plan = SweepPlan {
            sizes: vec!["5%".parse().expect("a size"), "none".parse().expect("a size")],
            ..SweepPlan::default()
        };
        let report = sweep("model", &shape, &scene, &plan, &Silent).unwrap_or_else(|e| panic!("{name}: {e}"));
        let [cage, direct] = &report.rows[..] else { panic!("two rows") };
        assert!(
            cage.rms_relative < 2.0 * direct.rms_relative,
            "{name}: {} for {}",
            cage.rms_relative,
            direct.rms_relative
        );
        assert!(cage.max_free_stretch < 5.0, "{name}: {}", cage.max_free_stretch);
        assert_eq!(cage.rest_error_max, 0.0, "{name}");
    }
}

/// The paper's rule breaks down on the thin parts of this model, and the binding says so and what to use instead.
#[test]
fn the_papers_rule_warns_where_it_breaks_down() {
    for (_, shape) in models(30_000).into_iter().filter(|(path, _)| path.ends_with("man.off")) {
        let cage = simplify(&shape, &CageSize::Fraction(0.05).into(), &Silent).expect("valid").mesh;
        let report = Binding::new(&shape, &cage, &Prune::PAPER.into(), &Silent).expect("valid").report().clone();
        assert!(report.unsafe_rows > 0, "{report:?}");
        assert!(report.warnings().iter().any(|w| w.contains("smooth:16")), "{:?}", report.warnings());
    }
}
