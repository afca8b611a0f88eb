//! Generated shapes by name and number of vertices.

use glam::DVec3;

use super::{bar, bumpy_plane, cactus, check_vertices, creature, cylinder};
use crate::{MeshError, TriMesh};

/// The shapes that [`by_name`] makes.
pub const NAMES: [&str; 5] = ["bar", "cactus", "creature", "cylinder", "plane"];

/// The shape of a name in [`NAMES`], with about `vertices` vertices.
///
/// - `bar`: 6 by 1 by 1, along x, of squares with 1/n sides;
/// - `cactus`, `creature`: see [`cactus`] and [`creature`];
/// - `cylinder`: of radius 0.3 and height 4, along y, its quads nearly square;
/// - `plane`: 3 by 2, in x and y, with 6 by 6 bumps 0.08 high.
///
/// The number is met within 2 % from 2,000 vertices on, within 20 % below; that of a bar within a tenth and a third, as its squares go
/// evenly into its sides.
///
/// # Errors
/// There is no such name; fewer vertices than the shape can have (40; those of the cactus and the creature are their own), or more than
/// 1,000,000.
pub fn by_name(name: &str, vertices: usize) -> Result<TriMesh, MeshError> {
    match name {
        "cactus" => return cactus(vertices),
        "creature" => return creature(vertices),
        "bar" | "cylinder" | "plane" => check_vertices(vertices, 40, 1_000_000)?,
        _ => {
            let expected = format!("one of {}", NAMES.join(", "));
            return Err(MeshError::BadParameter { what: "shape", expected, found: name.to_owned() });
        }
    }
    let n = vertices as f64;
    match name {
        // 26 k^2 + 2 vertices.
        "bar" => {
            let k = ((n - 2.0) / 26.0).sqrt().round().max(1.0) as u32;
            bar(6 * k, k, k, DVec3::new(6.0, 1.0, 1.0))
        }
        "cylinder" => {
            // A cap has `around / (2 pi)` rings, and the wall `around * 4 / (0.6 pi)`.
            let around = (n / 2.44).sqrt().round().max(4.0);
            let rings = (around / std::f64::consts::TAU).round().max(1.0);
            // The rest of the vertices are the wall's.
            let along = ((n - 2.0) / around + 1.0 - 2.0 * rings).round().max(1.0);
            cylinder(0.3, 4.0, around as u32, along as u32, rings as u32)
        }
        _ => {
            let rows = (n / 1.5).sqrt().round().max(2.0);
            let columns = (n / rows).round();
            bumpy_plane(columns as u32 - 1, rows as u32 - 1, 3.0, 2.0, 0.08, 6)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_about_the_vertices_asked_for() {
        for name in ["bar", "cylinder", "plane"] {
            for (vertices, most) in [(40, 0.35), (500, 0.2), (2000, 0.1), (7777, 0.1), (40_000, 0.05)] {
                let most = if name == "bar" || vertices < 2000 { most } else { 0.02 };
                let mesh = by_name(name, vertices).expect("in range");
                let off = mesh.vertex_count() as f64 / vertices as f64 - 1.0;
                assert!(off.abs() < most, "{name}:{vertices} has {}", mesh.vertex_count());
                mesh.topology().require_manifold().expect("manifold");
            }
        }
        assert_eq!(by_name("cactus", 600).expect("in range").positions, cactus(600).expect("in range").positions);
        for name in NAMES {
            assert!(by_name(name, 2000).is_ok() && by_name(name, 1).is_err() && by_name(name, 2_000_000).is_err());
        }
        let error = by_name("teapot", 2000).expect_err("unknown").to_string();
        assert!(error.contains("teapot") && error.contains("cylinder"), "{error}");
    }
}
