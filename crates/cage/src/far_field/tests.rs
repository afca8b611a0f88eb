//! The tree against sums over every face: single groups, whole descents, and rows.

use pliant_mesh::TriMesh;

use super::*;
use crate::families::{families, points};
use crate::mean_value::FaceWeights;

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

/// A cage with its coordinates and tree, and points with the unscaled weights of all its vertices.
struct Prepared {
    name: &'static str,
    cage: TriMesh,
    coordinates: MeanValue,
    field: FarField,
    /// Points in the normal frame; weights are `None` on a face.
    points: Vec<(DVec3, Option<Vec<f64>>)>,
}

fn prepared() -> Vec<Prepared> {
    families()
        .into_iter()
        .map(|(name, shape, cage)| {
            let coordinates = MeanValue::new(&cage);
            let field = FarField::new(&coordinates, cage.topology());
            let points = points(&shape, &cage)
                .into_iter()
                .map(|p| coordinates.to_frame(p))
                .map(|x| (x, all_weights(&coordinates, cage.topology(), x)))
                .collect();
            Prepared { name, cage, coordinates, field, points }
        })
        .collect()
}

impl Prepared {
    /// Points off the cage, with all weights and the sum of their magnitudes.
    fn weighed(&self) -> impl Iterator<Item = (DVec3, &[f64], f64)> {
        let weighed = self.points.iter().filter_map(|(x, all)| Some((*x, all.as_deref()?)));
        weighed.map(|(x, all)| (x, all, all.iter().map(|w| w.abs()).sum()))
    }
}

/// Rounding of the sums over faces that all is measured against, in shares of a row's magnitude.
const EXACT: f64 = 1e-11;

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
    for prepared in prepared() {
        let Prepared { name, ref cage, ref field, .. } = prepared;
        for (x, all, total) in prepared.weighed() {
            let mut size = 1;
            for (level, packs) in field.levels.iter().enumerate() {
                for (at, pack) in packs.iter().enumerate() {
                    let look = field.arch.dispatch(LookAt { pack, groups: level > 0, x });
                    for k in 0..WIDTH {
                        let start = ((at * WIDTH + k) * size).min(cage.vertex_count());
                        let group = &field.order[start..(start + size).min(cage.vertex_count())];
                        let [weight, error, largest] = [look.weight[k], look.error[k], look.largest[k]].map(f64::from);
                        // Groups that would never be accepted say nothing.
                        if group.is_empty() || error > 1e-3 * total {
                            continue;
                        }
                        let magnitudes = group.iter().map(|v| all[*v as usize].abs());
                        let off = (weight.abs() - magnitudes.clone().sum::<f64>()).abs();
                        assert!(off <= error + EXACT * total, "{name}, level {level}: off by {off:e}, not {error:e}");
                        let found = magnitudes.fold(0.0, f64::max);
                        let bounded = level == 0 || found <= largest * 1.000_01 + EXACT * total;
                        assert!(bounded, "{name}, level {level}: {found:e} above {largest:e}");
                    }
                }
                size *= WIDTH;
            }
        }
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

/// The sum of all magnitudes is off by less than a descent says, and so is what it lists.
#[test]
fn descents_keep_their_bounds() {
    let mut descent = Descent::default();
    for prepared in prepared() {
        let (name, field) = (prepared.name, &prepared.field);
        for (x, all, total) in prepared.weighed() {
            let limits = Limits::of(total, 0.03).expect("a size");
            for limits in [limits, limits.finer(0.3), limits.finer(0.01)] {
                let rest = field.arch.dispatch(Sum { field, x, limits, descent: &mut descent });
                let near: f64 = descent.near.iter().map(|v| all[*v as usize].abs()).sum();
                let off = (near + magnitude(&descent.listed) + rest.magnitude - total).abs();
                let said = rest.error;
                assert!(off <= said + EXACT * total, "{name} at {x}: off by {off:e}, not {said:e}");
                for (v, w) in &descent.listed {
                    let off = (w - all[*v as usize]).abs();
                    let bound = f64::from(limits.kept) + EXACT * total;
                    assert!(off <= bound, "{name} at {x}: vertex {v} off by {off:e}, not {bound:e}");
                }
            }
        }
    }
}

/// Rows against the definition: what is dropped is the smallest, sums to the share and no more could be, all within
/// 1e-4 of the row's magnitude; and kept weights, scaled, are within 1e-4 of the exact ones.
#[test]
fn rows_are_those_of_the_exact_rule() {
    for prepared in prepared() {
        let Prepared { name, ref cage, ref coordinates, ref field, .. } = prepared;
        let (mut scratch, mut row) = (Scratch::default(), Vec::new());
        for share in [0.03, 0.3] {
            let (mut made, mut same, mut asked) = (0, 0, 0);
            for (x, all, total) in prepared.weighed() {
                let view = View { cage: coordinates, topology: cage.topology(), x };
                asked += 1;
                if !field.row(view, nearest_face(cage, coordinates, x), share, &mut scratch, &mut row) {
                    continue;
                }
                made += 1;
                let mut kept = vec![false; all.len()];
                row.iter().for_each(|e| kept[e.0 as usize] = true);
                let (mut dropped, mut largest, mut smallest, mut sum) = (0.0, 0.0_f64, f64::INFINITY, 0.0);
                for (w, kept) in all.iter().zip(&kept) {
                    if *kept {
                        smallest = smallest.min(w.abs());
                        sum += w;
                    } else {
                        dropped += w.abs();
                        largest = largest.max(w.abs());
                    }
                }
                let tie = 1e-4 * total;
                assert!(largest <= smallest + tie, "{name} at {x}: dropped {largest:e}, kept {smallest:e}");
                let budget = share * total;
                assert!(dropped <= budget + tie, "{name} at {x}: dropped {dropped:e} of {budget:e}");
                assert!(dropped + smallest >= budget - tie, "{name} at {x}: {smallest:e} might be dropped");
                let row_sum: f64 = row.iter().map(|e| e.1).sum();
                for (v, w) in &row {
                    let off = (w / row_sum - all[*v as usize] / sum).abs();
                    assert!(off <= 1e-4, "{name} at {x}: vertex {v} off by {off:e}");
                }
                let mut exact: Vec<(u32, f64)> = (0..).zip(all.iter().copied()).collect();
                drop_smallest(&mut exact, share);
                same += usize::from(exact.len() == row.len() && exact.iter().all(|e| kept[e.0 as usize]));
            }
            // The tree is not just left to the exact path, and hardly any cut is another one.
            assert!(10 * made >= 8 * asked, "{name}: {made} of {asked} rows made");
            assert!(100 * same >= 95 * made, "{name}: {same} of {made} rows have the exact cut");
        }
    }
}

/// On a face, at a cage vertex, on an edge: the limit, as exact as without the tree.
#[test]
fn rows_on_the_cage_are_barycentric() {
    for prepared in prepared() {
        let Prepared { name, ref cage, ref coordinates, ref field, .. } = prepared;
        let (mut scratch, mut row, mut all) = (Scratch::default(), Vec::new(), vec![0.0; cage.vertex_count()]);
        let on_faces = prepared.points.iter().filter(|p| p.1.is_none());
        let mut count = 0;
        for (x, _) in on_faces {
            let view = View { cage: coordinates, topology: cage.topology(), x: *x };
            assert!(field.row(view, nearest_face(cage, coordinates, *x), 0.0, &mut scratch, &mut row), "{name} at {x}");
            all.fill(0.0);
            let on = (0..cage.face_count()).find_map(|f| match coordinates.face_weights(*x, f) {
                FaceWeights::On(barycentric) => Some((f, barycentric)),
                FaceWeights::Weights(_) => None,
            });
            let (face, barycentric) = on.expect("on a face");
            cage.triangles()[face].into_iter().zip(barycentric).for_each(|(v, w)| all[v as usize] = w);
            let sum: f64 = row.iter().map(|e| e.1).sum();
            assert!(row.len() <= 3 && (sum - 1.0).abs() < 1e-12, "{name} at {x}: {row:?}");
            for (v, w) in &row {
                assert!((w - all[*v as usize]).abs() < 1e-6, "{name} at {x}: {w} for {}", all[*v as usize]);
            }
            count += 1;
        }
        assert!(count > 0, "{name}: no point on the cage");
    }
}

/// The same bits with and without vector registers.
#[test]
fn registers_change_no_bit() {
    for prepared in prepared().iter().step_by(3) {
        let Prepared { name, cage, coordinates, field, .. } = prepared;
        let (mut scratch, mut wide, mut narrow) = (Scratch::default(), Vec::new(), Vec::new());
        for (x, ..) in prepared.weighed() {
            let view = View { cage: coordinates, topology: cage.topology(), x };
            let nearest = nearest_face(cage, coordinates, x);
            let with = field.row(view, nearest, 0.03, &mut scratch, &mut wide);
            let row = &mut narrow;
            let maker = MakeRow { field, view, nearest, share: 0.03, scratch: &mut scratch, row };
            let without = maker.with_simd(pulp::Scalar);
            assert!(with == without && wide == narrow, "{name} at {x}");
        }
    }
}

fn nearest_face(cage: &TriMesh, coordinates: &MeanValue, x: DVec3) -> usize {
    let distance = |f: usize| pliant_mesh::metrics::closest_on_triangle(x, coordinates.corners(f)).distance(x);
    (0..cage.face_count()).min_by(|&f, &g| distance(f).total_cmp(&distance(g))).expect("a face")
}
