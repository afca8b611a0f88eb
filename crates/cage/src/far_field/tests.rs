//! The tree against sums over every face: single groups, whole descents, and rows.

use std::collections::BTreeMap;

use pliant_mesh::{Silent, TriMesh, shapes};

use super::*;
use crate::mean_value::FaceWeights;
use crate::{BindOptions, Binding, CageSize, Prune, simplify};

fn moved(mesh: &TriMesh, by: impl Fn(DVec3) -> DVec3) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| by(*p)).collect()).expect("finite")
}

/// Two meshes as one, the second after the first.
fn joined(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let shift = a.vertex_count() as u32;
    let positions = a.positions.iter().chain(&b.positions).copied().collect();
    let faces = a.triangles().iter().copied().chain(b.triangles().iter().map(|t| t.map(|v| v + shift))).collect();
    TriMesh::new(positions, faces).expect("valid")
}

/// Shapes with cages: round, with a hole, limbs, open, in two parts, a thin plate folded over itself, needles, coplanar faces,
/// tiny and huge.
fn families() -> Vec<(&'static str, TriMesh, TriMesh)> {
    let creature = shapes::creature(4000).expect("valid");
    let torus = shapes::torus(1.0, 0.3, 60, 30).expect("valid");
    let sphere = shapes::icosphere(4);
    let sheet = shapes::bumpy_plane(60, 60, 2.0, 2.0, 0.1, 7).expect("valid");
    let plate = shapes::bar(60, 30, 1, DVec3::new(2.0, 1.0, 0.01)).expect("valid");
    let folded = moved(&plate, |p| {
        // Rolled up by one and a half turns.
        let (angle, radius) = (4.7 * p.x, 0.2 + 0.02 * p.x + p.z);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), p.y)
    });
    let apart = joined(&sphere, &moved(&sphere, |p| 0.7 * p + DVec3::new(2.0, 0.1, 0.0)));
    let needles = moved(&torus, |p| p * DVec3::new(1.0, 30.0, 1.0));
    vec![
        ("tiny creature", moved(&creature, |p| 1e-6 * p), 0.15),
        ("creature", creature, 0.15),
        ("huge torus", moved(&torus, |p| 1e6 * p), 0.3),
        ("sphere", sphere, 0.2),
        ("open sheet", sheet, 0.2),
        ("two spheres", apart, 0.1),
        ("folded plate", folded, 0.2),
        ("needles", needles, 0.3),
    ]
    .into_iter()
    .map(|(name, shape, share)| {
        let cage = simplify(&shape, &CageSize::Fraction(share).into(), &Silent).expect("valid").mesh;
        (name, shape, cage)
    })
    .collect()
}

/// Points of a shape, and on, close to, and far from its cage.
fn points(shape: &TriMesh, cage: &TriMesh) -> Vec<DVec3> {
    let mut points: Vec<DVec3> = shape.positions.iter().step_by(shape.vertex_count() / 60).copied().collect();
    points.extend(cage.positions.iter().step_by(cage.vertex_count() / 6));
    for (k, f) in (0..cage.face_count()).step_by(cage.face_count() / 12).enumerate() {
        let [a, b, c] = cage.corners(f);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let diagonal = cage.bounds().diagonal();
        let spot = [(a + b + c) / 3.0, 0.5 * (a + b), 0.02 * a + 0.98 * c][k % 3];
        points.extend([0.0, 1e-12, 1e-8, -1e-5, 1e-3, -0.02, 0.1].map(|h| spot + normal * (h * diagonal)));
    }
    let bounds = cage.bounds();
    points.extend([0.5, 1.6, -3.0, 8.0].map(|t| bounds.from_box(DVec3::new(t, 0.4 * t, 0.5))));
    points
}

/// Unscaled weights of all cage vertices; `None` on a face.
fn all_weights(cage: &MeanValue, topology: &Topology, x: DVec3) -> Option<Vec<f64>> {
    let mut all = vec![0.0; topology.vertex_count()];
    for (f, corners) in topology.triangles().iter().enumerate() {
        match cage.face_weights(x, f) {
            FaceWeights::On(_) => return None,
            FaceWeights::Weights(values) => {
                for (v, value) in corners.iter().zip(values) {
                    all[*v as usize] += value;
                }
            }
        }
    }
    Some(all)
}

/// Prepared coordinates and tree of each family, and its points with all their weights.
fn prepared() -> Vec<(&'static str, TriMesh, MeanValue, FarField, Vec<(DVec3, Vec<f64>)>)> {
    families()
        .into_iter()
        .map(|(name, shape, cage)| {
            let coordinates = MeanValue::new(&cage);
            let field = FarField::new(&coordinates, cage.topology());
            let weighed = points(&shape, &cage)
                .into_iter()
                .map(|p| coordinates.to_frame(p))
                .filter_map(|x| Some((x, all_weights(&coordinates, cage.topology(), x)?)))
                .collect();
            (name, cage, coordinates, field, weighed)
        })
        .collect()
}

struct LookAt<'a> {
    pack: &'a Pack,
    groups: bool,
    x: DVec3,
}

impl WithSimd for LookAt<'_> {
    type Output = pack::Look;

    fn with_simd<S: Simd>(self, simd: S) -> pack::Look {
        let mut look = pack::Look::default();
        let x = self.x.as_vec3().to_array();
        if self.groups {
            self.pack.look_at_groups(simd, x, &mut look);
        } else {
            self.pack.look_at_vertices(simd, x, &mut look);
        }
        look
    }
}

/// A group is off by no more than it says, and none of its vertices has a larger weight than it says.
#[test]
fn groups_keep_their_bounds() {
    for (name, cage, _, field, weighed) in prepared() {
        let mut worst = 0.0_f64;
        for (x, weights) in &weighed {
            let total: f64 = weights.iter().map(|w| w.abs()).sum();
            let mut size = 1;
            for (level, packs) in field.levels.iter().enumerate() {
                for (at, pack) in packs.iter().enumerate() {
                    let look = field.arch.dispatch(LookAt { pack, groups: level > 0, x: *x });
                    for k in 0..WIDTH {
                        let start = ((at * WIDTH + k) * size).min(cage.vertex_count());
                        let group = &field.order[start..(start + size).min(cage.vertex_count())];
                        // Groups that would never be accepted say nothing.
                        if group.is_empty() || f64::from(look.error[k]) > 1e-3 * total {
                            continue;
                        }
                        let magnitudes = group.iter().map(|v| weights[*v as usize].abs());
                        let largest = magnitudes.clone().fold(0.0, f64::max);
                        let error = (f64::from(look.weight[k]).abs() - magnitudes.sum::<f64>()).abs();
                        // Sums over all faces round too.
                        let rounding = 1e-11 * total;
                        worst = worst.max((error - rounding) / f64::from(look.error[k]));
                        if level > 0 {
                            assert!(largest <= f64::from(look.largest[k]) * 1.00001 + rounding, "{name}, level {level}");
                        }
                    }
                }
                size *= WIDTH;
            }
        }
        eprintln!("{name}: groups {worst:.3}");
    }
}

struct Sum<'a> {
    field: &'a FarField,
    x: DVec3,
    limits: Limits,
    descent: &'a mut Descent,
}

impl WithSimd for Sum<'_> {
    type Output = Rest;

    fn with_simd<S: Simd>(self, simd: S) -> Rest {
        self.descent.sum(simd, self.field, self.x, self.limits)
    }
}

/// The sum of all magnitudes is off by less than a third of what a descent says, and what it lists is right.
#[test]
fn descents_keep_their_bounds() {
    let mut descent = Descent::default();
    for (name, _, _, field, weighed) in prepared() {
        let mut worst = 0.0_f64; let mut sum = 0.0; let mut actual = 0.0_f64; let mut claimed=0.0;
        for (x, weights) in &weighed {
            let total: f64 = weights.iter().map(|w| w.abs()).sum();
            let limits = Limits::of(total, 0.03).expect("a size");
            for limits in [limits, limits.finer()] {
                let rest = field.arch.dispatch(Sum { field: &field, x: *x, limits, descent: &mut descent });
                let near: f64 = descent.near.iter().map(|v| weights[*v as usize].abs()).sum();
                let listed: f64 = descent.listed.iter().map(|e| e.1.abs()).sum();
                let error = ((near + listed + rest.magnitude) - total).abs();
                let ratio = (error - 1e-11 * total) / rest.error; sum += ratio.max(0.0); actual = actual.max(error/total); claimed += rest.error/total;
                worst = worst.max(ratio);
                for (v, w) in &descent.listed {
                    let off = (w - weights[*v as usize]).abs();
                    assert!(off <= f64::from(limits.kept) + 1e-11 * total, "{name}: vertex {v} off by {off:e}");
                }
            }
        }
        eprintln!("{name}: descents worst {worst:.3} mean {:.4} actual {actual:.2e} claimed {:.2e}", sum / (2*weighed.len()) as f64, claimed/(2*weighed.len()) as f64);
    }
}
