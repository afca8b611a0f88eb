//! The cactus of the deformation literature: a stem with two bent arms.

use super::bones::{Body, Limb, curve};
use super::even::even_mesh;
use crate::{MeshError, TriMesh};

/// Area of the surface.
const AREA: f64 = 5.5;

/// A smooth cactus: a round stem 2.2 high with two arms that bend upwards, one on each side and at different heights.
///
/// Closed, of one component and genus 0, with `vertices` vertices within 2 %, evenly spread. Its foot is near the
/// origin.
///
/// # Errors
/// Fewer than 500 or more than 1,000,000 vertices.
pub fn cactus(vertices: usize) -> Result<TriMesh, MeshError> {
    super::check_vertices(vertices, 500, 1_000_000)?;
    even_mesh(&body(), AREA, vertices, &|_, _, _| 0.0)
}

fn body() -> Body {
    Body::new(vec![
        Limb::new(0.1, 0.0, curve(&[([0.0, 0.25, 0.0], 0.27), ([0.0, 1.1, 0.0], 0.26), ([0.0, 1.95, 0.0], 0.24)])),
        Limb::new(
            0.15,
            0.0,
            curve(&[
                ([0.0, 0.85, 0.0], 0.17),
                ([0.45, 0.85, 0.0], 0.165),
                ([0.66, 1.0, 0.0], 0.165),
                ([0.7, 1.5, 0.0], 0.15),
            ]),
        ),
        Limb::new(
            0.15,
            0.0,
            curve(&[
                ([0.0, 1.15, 0.0], 0.16),
                ([-0.4, 1.15, 0.0], 0.155),
                ([-0.6, 1.3, 0.0], 0.155),
                ([-0.63, 1.75, 0.0], 0.14),
            ]),
        ),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::tests::*;

    #[test]
    fn cacti_are_closed_even_and_of_the_wanted_size() {
        for vertices in [500, 1000, 5000, 20_000] {
            let mesh = cactus(vertices).expect("in range");
            assert_closed(&mesh, 2);
            assert_count(&mesh, vertices);
            assert!(
                smallest_angle(&mesh) > 10.0_f64.to_radians(),
                "{vertices}: {}",
                smallest_angle(&mesh).to_degrees()
            );
        }
        let area = surface_area(&cactus(20_000).expect("in range"));
        assert!((area / AREA - 1.0).abs() < 0.02, "{area}");
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for vertices in [0, 499, 1_000_001, usize::MAX] {
            assert!(matches!(cactus(vertices), Err(MeshError::BadParameter { what: "vertices", .. })));
        }
    }
}
