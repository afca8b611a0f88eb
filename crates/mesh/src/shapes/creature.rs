//! The house model: a small friendly dragon, standing with its arms stretched out.
//!
//! y is up, it looks towards +z, and its left is at +x. About 1.8 wide, 1.9 high and 1.75 deep. Its main bones, as they
//! are blended (rows are curves through further points, see `body`):
//!
//! | bone | of each | from | radius | to | radius |
//! |---|---|---|---|---|---|
//! | torso | 1 | (0, 1.22, 0.05) | 0.125 | (0, 0.44, -0.30) | 0.185 |
//! | belly | 1 | (0, 0.64, 0.05) | 0.275 | ball | |
//! | tail | 1 | (0, 0.44, -0.30) | 0.185 | (0.25, 0.54, -1.14) | 0.066 |
//! | skull | 1 | (0, 1.47, 0.10) | 0.225 | ball | |
//! | muzzle | 1 | (0, 1.41, 0.26) | 0.155 | (0, 1.39, 0.42) | 0.125 |
//! | cheek | 2 | (0.10, 1.37, 0.20) | 0.12 | ball | |
//! | eye | 2 | (0.135, 1.53, 0.225) | 0.085 | ball | |
//! | horn | 2 | (0.10, 1.62, 0.02) | 0.078 | (0.165, 1.81, -0.08) | 0.055 |
//! | arm | 2 | (0.08, 1.00, 0) | 0.12 | (0.72, 0.97, 0.18) | 0.08 |
//! | finger | 6 | (0.75, 0.97, 0.20) | 0.064 | (0.85, 0.985, 0.245) | 0.056 |
//! | leg | 2 | (0.15, 0.58, -0.04) | 0.18 | (0.245, 0.11, -0.01) | 0.10 |
//! | foot | 2 | (0.25, 0.09, 0) | 0.095 | (0.27, 0.08, 0.17) | 0.085 |
//! | toe | 6 | (0.275, 0.06, 0.21) | 0.06 | (0.285, 0.056, 0.31) | 0.054 |
//! | spike | 10 | down the back, 0.06 to 0.11 high | 0.065 | | 0.036 |

use glam::DVec3;

use super::bones::{Body, Bone, Limb, Sample, curve};
use super::even::even_mesh;
use super::relief::{bump, noise, rise, scales, wave};
use crate::{MeshError, TriMesh};

/// The creature: an organic closed model of genus 0 with head, arms, legs and tail, and a skin of scales, folds and bumps.
///
/// It has `vertices` vertices within 2 %, evenly spread; the same pose, and the same bounding box to 1 %, at every size. The
/// relief on its body is about 1 % of the bounding box's diagonal from lowest to highest; patterns too fine for a
/// coarse mesh fade out. Vertices near in number are mostly near in space. Costs a few microseconds per vertex.
///
/// # Errors
/// Fewer than 2,000 or more than 1,000,000 vertices.
///
/// ```
/// let mesh = pliant_mesh::shapes::creature(3000)?;
/// assert!(mesh.vertex_count().abs_diff(3000) <= 60);
/// assert_eq!(mesh.topology().euler_characteristic(), 2);
/// # Ok::<(), pliant_mesh::MeshError>(())
/// ```
pub fn creature(vertices: usize) -> Result<TriMesh, MeshError> {
    super::check_vertices(vertices, 2000, 1_000_000)?;
    even_mesh(&body(), AREA, vertices, &skin)
}

/// Area of the body without its relief.
const AREA: f64 = 4.95;

/// Middle line and radii of the back, from the skull to the end of the tail.
const BACK: [([f64; 3], f64); 9] = [
    ([0.0, 1.47, 0.08], 0.215),
    ([0.0, 1.22, 0.05], 0.125),
    ([0.0, 0.98, 0.00], 0.185),
    ([0.0, 0.66, -0.05], 0.265),
    ([0.0, 0.44, -0.30], 0.185),
    ([0.0, 0.31, -0.56], 0.135),
    ([0.05, 0.28, -0.80], 0.105),
    ([0.15, 0.36, -1.02], 0.082),
    ([0.25, 0.54, -1.14], 0.066),
];

fn body() -> Body {
    let bone = |width, relief, a, ra, b, rb| Limb::new(width, relief, vec![Bone::new(a, ra, b, rb)]);
    let ball = |width, relief, c, r| bone(width, relief, c, r, c, r);
    let row = |width, relief, points: &[([f64; 3], f64)]| Limb::new(width, relief, curve(points));
    // Blend width and share of the relief, then the bones.
    let mut limbs = vec![
        // Torso and belly, tail.
        row(0.1, 1.0, &BACK[1..5]),
        ball(0.12, 1.0, [0.0, 0.64, 0.05], 0.275),
        row(0.1, 1.0, &BACK[4..]),
        // Skull and muzzle.
        ball(0.1, 0.3, [0.0, 1.47, 0.10], 0.225),
        bone(0.09, 0.3, [0.0, 1.41, 0.26], 0.155, [0.0, 1.39, 0.42], 0.125),
    ];
    for side in [1.0, -1.0] {
        let at = |x: f64, y: f64, z: f64| [side * x, y, z];
        // Cheek, eye, horn.
        limbs.push(ball(0.08, 0.3, at(0.10, 1.37, 0.20), 0.12));
        limbs.push(ball(0.025, 0.0, at(0.135, 1.53, 0.225), 0.085));
        limbs.push(row(
            0.06,
            0.1,
            &[(at(0.10, 1.62, 0.02), 0.078), (at(0.155, 1.72, -0.03), 0.066), (at(0.165, 1.81, -0.08), 0.055)],
        ));
        // Arm and three fingers.
        limbs.push(row(
            0.10,
            0.7,
            &[
                (at(0.08, 1.00, 0.00), 0.12),
                (at(0.27, 0.95, 0.02), 0.095),
                (at(0.45, 0.885, 0.06), 0.078),
                (at(0.60, 0.91, 0.13), 0.072),
                (at(0.72, 0.97, 0.18), 0.080),
            ],
        ));
        limbs.push(bone(0.06, 0.5, at(0.73, 1.00, 0.18), 0.062, at(0.785, 1.08, 0.20), 0.052));
        limbs.push(bone(0.06, 0.5, at(0.75, 0.97, 0.20), 0.064, at(0.85, 0.985, 0.245), 0.056));
        limbs.push(bone(0.06, 0.5, at(0.73, 0.94, 0.19), 0.062, at(0.77, 0.855, 0.23), 0.054));
        // Leg, foot and three toes.
        limbs.push(row(
            0.12,
            0.9,
            &[
                (at(0.15, 0.58, -0.04), 0.18),
                (at(0.20, 0.44, 0.02), 0.165),
                (at(0.235, 0.28, 0.04), 0.115),
                (at(0.245, 0.11, -0.01), 0.10),
            ],
        ));
        limbs.push(bone(0.05, 0.8, at(0.25, 0.09, 0.0), 0.095, at(0.27, 0.08, 0.17), 0.085));
        limbs.push(bone(0.05, 0.5, at(0.22, 0.06, 0.19), 0.06, at(0.185, 0.056, 0.275), 0.052));
        limbs.push(bone(0.05, 0.5, at(0.275, 0.06, 0.21), 0.06, at(0.285, 0.056, 0.31), 0.054));
        limbs.push(bone(0.05, 0.5, at(0.33, 0.06, 0.18), 0.06, at(0.385, 0.056, 0.255), 0.052));
    }
    limbs.extend(spikes());
    Body::new(limbs)
}

/// A row of blunt spikes down the back and the tail.
fn spikes() -> Vec<Limb> {
    let middle = curve(&BACK);
    (8..45_u32)
        .step_by(4)
        .map(|i| {
            let [(a, radius), (b, _)] = middle[i as usize].ends();
            let back = DVec3::X.cross(b - a).normalize();
            // Highest between the shoulders and the hips.
            let height = 0.05 + 0.06 * bump((f64::from(i) - 18.0) / 26.0);
            let (base, tip) = (a + back * (0.8 * radius), a + back * (radius + height - 0.035));
            Limb::new(0.07, 0.0, vec![Bone::new(base.to_array(), 0.065, tip.to_array(), 0.036)])
        })
        .collect()
}

/// Height of the skin over the body at a point of its surface, for a mesh with edges about `edge` long.
fn skin(p: DVec3, sample: &Sample, edge: f64) -> f64 {
    // A pattern fades where the mesh has too few vertices for it.
    let shown = |width: f64| rise(0.7, 2.2, width / edge);
    let features = face(p) * shown(0.025);
    // Thin parts keep a thin skin, so that it never folds over itself.
    let thick = sample.relief * rise(0.03, 0.12, sample.radius);
    if thick == 0.0 {
        return -features;
    }
    let to_front = sample.gradient.z;
    let belly = rise(0.45, 0.75, to_front) * rise(0.36, 0.46, p.y) * rise(1.30, 1.15, p.y) * rise(0.2, 0.13, p.x.abs());
    let soft = 0.006 * noise(p * 3.0 + 7.3);
    let plates = 0.014 * scales(p / 0.125) * shown(0.05) + 0.003 * scales(p / 0.055) * shown(0.02) - 0.0085;
    let bands = 0.008 * wave((p.y + 0.5 * p.x * p.x) / 0.095) * shown(0.045);
    thick * (soft + (1.0 - belly) * plates + belly * bands) - features
}

/// Depth of the smile, the nostrils and the pupils.
fn face(p: DVec3) -> f64 {
    let side = DVec3::new(p.x.abs(), p.y, p.z);
    let line = 1.362 + 0.9 * p.x * p.x + 0.22 * (0.42 - p.z).max(0.0);
    let mouth = bump((p.y - line) / 0.022) * rise(0.18, 0.26, p.z) * rise(1.30, 1.33, p.y);
    let nostril = bump(side.distance(DVec3::new(0.05, 1.455, 0.525)) / 0.032);
    let pupil = bump(side.distance(DVec3::new(0.172, 1.538, 0.304)) / 0.045);
    0.014 * mouth + 0.014 * nostril + 0.012 * pupil
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Bounds;
    use crate::shapes::even::turned_faces;
    use crate::shapes::tests::*;

    /// Closed, one piece, genus 0, of the wanted size, in the same box, and without folded faces.
    #[test]
    fn every_size_is_the_same_creature() {
        let reference = creature(30_000).expect("in range").bounds();
        let same = |b: &Bounds| {
            let off = (b.min - reference.min).abs().max((b.max - reference.max).abs()).max_element();
            off / reference.diagonal()
        };
        for vertices in [2000, 2345, 3000, 5000, 10_000, 100_000] {
            let mesh = creature(vertices).expect("in range");
            assert_closed(&mesh, 2);
            assert_count(&mesh, vertices);
            assert!(same(&mesh.bounds()) < 0.01, "{vertices}: {}", same(&mesh.bounds()));
            let below = (0..mesh.face_count())
                .filter(|&f| (0..3).any(|k| angle(mesh.corners(f), k) < 15.0_f64.to_radians()))
                .count();
            assert!(below * 200 <= mesh.face_count(), "{vertices}: {below} faces have an angle below 15 degrees");
            assert_eq!(turned_faces(&body(), &mesh), 0, "{vertices}: faces that look into the body");
        }
    }

    #[test]
    fn relief_is_about_one_percent_and_stays_on_the_thick_parts() {
        let smooth = even_mesh(&body(), AREA, 30_000, &|_, _, _| 0.0).expect("in range");
        let area = surface_area(&smooth);
        assert!((area / AREA - 1.0).abs() < 0.02, "{area}");
        let body = body();
        let mut heights = Vec::new();
        for &p in &smooth.positions {
            let sample = body.sample(p);
            // A hundredth of an edge.
            assert!(sample.distance.abs() < 1.5e-4, "{p} is {} off the body", sample.distance);
            let height = skin(p, &sample, 0.001);
            if sample.radius < 0.05 || sample.relief == 0.0 {
                // Only the pupils, which are dents, lie outside.
                assert!((-0.013..0.006).contains(&height), "{p}: {height}");
            }
            heights.push(height);
        }
        let (low, high) = heights.iter().fold((0.0_f64, 0.0_f64), |(l, h), x| (l.min(*x), h.max(*x)));
        let share = (high - low) / smooth.bounds().diagonal();
        assert!((0.007..0.013).contains(&share), "{share}");
    }

    #[test]
    fn any_number_of_threads_makes_the_same_bits() {
        let bits = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
            let mesh = pool.install(|| creature(5000)).expect("in range");
            let positions: Vec<_> = mesh.positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect();
            (positions, mesh.triangles().to_vec())
        };
        let one = bits(1);
        assert!(one == bits(2) && one == bits(4));
    }

    #[test]
    fn sizes_out_of_range_are_refused() {
        for vertices in [0, 1999, 1_000_001, usize::MAX] {
            assert!(matches!(creature(vertices), Err(MeshError::BadParameter { what: "vertices", .. })));
        }
    }
}
