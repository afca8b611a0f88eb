//! The house model: a small friendly dragon.

use glam::DVec3;

use super::bones::{Body, Bone, Limb, Sample, curve};
use super::even::even_mesh;
use super::relief::{bump, noise, rise, scales, wave};
use crate::{MeshError, TriMesh};

/// The creature.
pub fn creature(vertices: usize) -> Result<TriMesh, MeshError> {
    even_mesh(&body(), AREA, vertices, &skin)
}

/// Area of the body without its relief.
const AREA: f64 = 5.2;

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
    ([0.25, 0.54, -1.14], 0.062),
];

fn body() -> Body {
    let bone = |width, relief, a, ra, b, rb| Limb::new(width, relief, vec![Bone::new(a, ra, b, rb)]);
    let ball = |width, relief, c, r| bone(width, relief, c, r, c, r);
    let mut limbs = vec![
        // Torso and belly, tail.
        Limb::new(0.1, 1.0, curve(&BACK[1..5])),
        ball(0.12, 1.0, [0.0, 0.64, 0.05], 0.275),
        Limb::new(0.1, 1.0, curve(&BACK[4..])),
        // Skull and muzzle.
        ball(0.1, 0.3, [0.0, 1.47, 0.10], 0.225),
        bone(0.09, 0.3, [0.0, 1.41, 0.26], 0.155, [0.0, 1.39, 0.42], 0.125),
    ];
    for side in [1.0, -1.0] {
        let at = |x: f64, y: f64, z: f64| [side * x, y, z];
        // Cheek, eye, horn.
        limbs.push(ball(0.08, 0.3, at(0.10, 1.37, 0.20), 0.12));
        limbs.push(ball(0.025, 0.0, at(0.135, 1.53, 0.225), 0.085));
        limbs.push(Limb::new(0.06, 0.1, curve(&[
            (at(0.10, 1.62, 0.02), 0.070),
            (at(0.155, 1.73, -0.03), 0.056),
            (at(0.165, 1.83, -0.09), 0.044),
        ])));
        // Arm and three fingers.
        limbs.push(Limb::new(0.10, 0.7, curve(&[
            (at(0.08, 1.00, 0.00), 0.12),
            (at(0.27, 0.95, 0.02), 0.095),
            (at(0.45, 0.885, 0.06), 0.078),
            (at(0.60, 0.91, 0.13), 0.072),
            (at(0.72, 0.97, 0.18), 0.080),
        ])));
        limbs.push(bone(0.03, 0.5, at(0.73, 1.00, 0.18), 0.055, at(0.79, 1.09, 0.20), 0.044));
        limbs.push(bone(0.03, 0.5, at(0.75, 0.97, 0.20), 0.055, at(0.86, 0.99, 0.25), 0.044));
        limbs.push(bone(0.03, 0.5, at(0.73, 0.94, 0.20), 0.055, at(0.80, 0.88, 0.27), 0.044));
        // Leg, foot and three toes.
        limbs.push(Limb::new(0.12, 0.9, curve(&[
            (at(0.15, 0.58, -0.04), 0.18),
            (at(0.20, 0.44, 0.02), 0.165),
            (at(0.235, 0.28, 0.04), 0.115),
            (at(0.245, 0.11, -0.01), 0.10),
        ])));
        limbs.push(bone(0.05, 0.8, at(0.25, 0.09, 0.0), 0.095, at(0.27, 0.08, 0.17), 0.085));
        limbs.push(bone(0.04, 0.5, at(0.22, 0.06, 0.19), 0.062, at(0.195, 0.055, 0.28), 0.052));
        limbs.push(bone(0.04, 0.5, at(0.275, 0.06, 0.21), 0.062, at(0.285, 0.055, 0.31), 0.052));
        limbs.push(bone(0.04, 0.5, at(0.33, 0.06, 0.18), 0.062, at(0.37, 0.055, 0.26), 0.052));
    }
    limbs.extend(spikes());
    Body::new(limbs)
}

/// A row of blunt spikes down the back and the tail.
fn spikes() -> Vec<Limb> {
    let middle = curve(&BACK);
    (10..44)
        .step_by(3)
        .map(|i| {
            let [(a, radius), (b, _)] = middle[i].ends();
            let back = DVec3::X.cross(b - a).normalize();
            // Highest between the shoulders and the hips.
            let height = 0.045 + 0.055 * bump((f64::from(i as u32) - 18.0) / 26.0);
            let (base, tip) = (a + back * (0.8 * radius), a + back * (radius + height - 0.035));
            Limb::new(0.05, 0.0, vec![Bone::new(base.to_array(), 0.06, tip.to_array(), 0.035)])
        })
        .collect()
}

/// Height of the skin over the body at a point of its surface, for a mesh with edges about `edge` long.
fn skin(p: DVec3, sample: &Sample, edge: f64) -> f64 {
    // A pattern fades where the mesh has too few vertices for it.
    let shown = |width: f64| rise(0.7, 2.2, width / edge);
    let thick = sample.relief * rise(0.03, 0.12, sample.radius);
    let front = sample.gradient.z;
    let belly = rise(0.45, 0.75, front) * rise(0.36, 0.46, p.y) * rise(1.30, 1.15, p.y) * rise(0.2, 0.13, p.x.abs());
    let soft = 0.006 * noise(p * 3.0 + 7.3);
    let large = 0.015 * scales(p / 0.13) * shown(0.05);
    let small = 0.0035 * scales(p / 0.055) * shown(0.02);
    let bands = 0.008 * wave((p.y + 0.5 * p.x * p.x) / 0.095) * shown(0.045);
    thick * (soft + (1.0 - belly) * (large + small - 0.009) + belly * bands) + face(p, sample) * shown(0.025)
}

/// Smile, nostrils and pupils.
fn face(p: DVec3, sample: &Sample) -> f64 {
    let side = DVec3::new(p.x.abs(), p.y, p.z);
    let line = 1.362 + 0.9 * p.x * p.x + 0.22 * (0.42 - p.z).max(0.0);
    let mouth = bump((p.y - line) / 0.022) * rise(0.18, 0.26, p.z) * rise(1.30, 1.33, p.y);
    let nostril = bump(side.distance(DVec3::new(0.05, 1.455, 0.525)) / 0.032);
    let pupil = bump(side.distance(DVec3::new(0.172, 1.538, 0.304)) / 0.045);
    let _ = sample;
    -0.014 * mouth - 0.014 * nostril - 0.012 * pupil
}
