//! Exact weights of the vertices round a point, over many faces at once.

use glam::DVec3;
use pliant_mesh::Topology;
use pulp::Simd;

use crate::lanes::Doubles;
use crate::mean_value::{EDGE_ON, FaceWeights, MeanValue, ON_FACE};

/// Faces are padded to a multiple of this, which is one of every register's lanes.
const WIDTH: usize = 8;

/// A cage and the point, in the normal frame, that looks at it.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub(crate) cage: &'a MeanValue,
    pub(crate) topology: &'a Topology,
    pub(crate) x: DVec3,
}

/// Some cage vertices with all faces round them, and what these give to a point; memory kept from point to point.
#[derive(Debug, Default)]
pub(crate) struct Patch {
    /// Faces looked at from the current point, and what they give.
    faces: Vec<u32>,
    terms: Terms,
    /// What the faces give to all other vertices, then to each of the patch's.
    sums: Vec<f64>,
    /// Faces already listed, marked with the current stamp.
    seen: Vec<u32>,
    stamp: u32,
    /// Where each cage vertex stands in `sums`.
    slot: Vec<u32>,
}

impl Patch {
    /// Turns to another point.
    pub(crate) fn clear(&mut self) {
        self.faces.clear();
        if self.stamp == u32::MAX {
            self.seen.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
    }

    /// Sums the unnormalised weights that the faces round `vertices`, and one more, give, together with those looked at before from the
    /// same point, which are not computed again. If the point lies on one of these faces, its barycentric
    /// coordinates are all that counts, and the face is returned with them.
    #[inline(always)]
    pub(crate) fn weigh<S: Simd>(
        &mut self,
        simd: S,
        view: View<'_>,
        vertices: impl Iterator<Item = u32> + Clone,
        more: Option<u32>,
    ) -> Option<(u32, [f64; 3])> {
        let known = self.faces.len();
        self.gather(view.topology, vertices.clone(), more);
        let Self { faces, terms, sums, slot, .. } = self;
        let triangles = view.topology.triangles();
        let on = terms.weigh(simd, view, faces, known);
        if let Some((face, barycentric)) = on {
            for (v, value) in triangles[face as usize].into_iter().zip(barycentric) {
                sums[slot[v as usize] as usize] += value;
            }
        } else {
            let [first, second, third] = terms.weights.each_ref().map(|w| &w[..faces.len()]);
            for (k, &face) in faces.iter().enumerate() {
                let [a, b, c] = triangles[face as usize].map(|v| slot[v as usize] as usize);
                sums[a] += first[k];
                sums[b] += second[k];
                sums[c] += third[k];
            }
        }
        for v in vertices {
            slot[v as usize] = 0;
        }
        on
    }

    /// The sums of the vertices, in their order.
    pub(crate) fn weights(&self) -> &[f64] {
        &self.sums[1..]
    }

    /// [`Self::weights`], and the sum of what the faces give to all other vertices.
    pub(crate) fn weights_mut(&mut self) -> (&mut [f64], f64) {
        let others = self.sums[0];
        (&mut self.sums[1..], others)
    }

    /// Lists the faces that are new, each once, and gives the vertices their slots.
    #[inline(always)]
    fn gather(&mut self, topology: &Topology, vertices: impl Iterator<Item = u32>, more: Option<u32>) {
        let Self { faces, sums, seen, stamp, slot, .. } = self;
        seen.resize(topology.triangles().len(), 0);
        slot.resize(topology.vertex_count(), 0);
        sums.clear();
        sums.push(0.0);
        if let Some(face) = more.filter(|&face| seen[face as usize] != *stamp) {
            seen[face as usize] = *stamp;
            faces.push(face);
        }
        for v in vertices {
            slot[v as usize] = sums.len() as u32;
            sums.push(0.0);
            let round = topology.vertex_faces(v as usize);
            // Without a branch: whether a face has been seen cannot be foreseen.
            let mut count = faces.len();
            faces.resize(count + round.len(), 0);
            for &f in round {
                faces[count] = f;
                count += usize::from(seen[f as usize] != *stamp);
                seen[f as usize] = *stamp;
            }
            faces.truncate(count);
        }
    }
}

/// Corners and normals of faces from a point, as structure of arrays, and what they give to their corners.
#[derive(Debug, Default)]
struct Terms {
    /// x, y, z of the corners, one after the other, and of the normal.
    coordinates: [Vec<f64>; 12],
    weights: [Vec<f64>; 3],
    /// How much too flat the face is seen for the plain formula, squared: from 0 on, it needs a closer look.
    flat: Vec<f64>,
}

impl Terms {
    /// Fills in the unnormalised weights that `faces` give to their corners, those of the first `known` ones being there; if the point
    /// lies on one of the others, returns that face and its barycentric coordinates instead.
    #[inline(always)]
    fn weigh<S: Simd>(
        &mut self,
        simd: S,
        View { cage, x, .. }: View<'_>,
        faces: &[u32],
        known: usize,
    ) -> Option<(u32, [f64; 3])> {
        let (start, padded) = (known / WIDTH * WIDTH, faces.len().next_multiple_of(WIDTH));
        if self.flat.len() < padded {
            self.coordinates.iter_mut().for_each(|lanes| lanes.resize(padded, 1.0));
            self.weights.iter_mut().for_each(|lanes| lanes.resize(padded, 0.0));
            self.flat.resize(padded, 0.0);
        }
        let [ax, ay, az, bx, by, bz, cx, cy, cz, nx, ny, nz] = self.coordinates.each_mut().map(|l| &mut l[..padded]);
        for (k, &face) in faces.iter().enumerate().skip(start) {
            let [a, b, c] = cage.corners(face as usize);
            let n = cage.normals()[face as usize];
            (ax[k], ay[k], az[k]) = (a.x - x.x, a.y - x.y, a.z - x.z);
            (bx[k], by[k], bz[k]) = (b.x - x.x, b.y - x.y, b.z - x.z);
            (cx[k], cy[k], cz[k]) = (c.x - x.x, c.y - x.y, c.z - x.z);
            (nx[k], ny[k], nz[k]) = (n.x, n.y, n.z);
        }
        for at in start / Doubles::<S>::COUNT..padded / Doubles::<S>::COUNT {
            self.weigh_register(simd, at);
        }
        for (k, &face) in faces.iter().enumerate().skip(start) {
            if self.flat[k] < 0.0 {
                continue;
            }
            match cage.face_weights(x, face as usize) {
                FaceWeights::On(barycentric) => return Some((face, barycentric)),
                FaceWeights::Weights(weights) => {
                    for (lanes, weight) in self.weights.iter_mut().zip(weights) {
                        lanes[k] = weight;
                    }
                }
            }
        }
        None
    }

    /// `w_k = (n_k . m) / (n_k . v_k)` as for a single face; lanes beyond the last face hold older ones.
    #[inline(always)]
    fn weigh_register<S: Simd>(&mut self, simd: S, at: usize) {
        let all = |number| Doubles::all(simd, number);
        let lanes = &self.coordinates;
        let v = [three(simd, lanes, 0, at), three(simd, lanes, 3, at), three(simd, lanes, 6, at)];
        let normal = three(simd, lanes, 9, at);
        let zero = all(0.0);
        let nearest = dot(&v[0], &v[0]).min(dot(&v[1], &v[1])).min(dot(&v[2], &v[2]));
        let height = dot(&v[0], &normal);
        let least = (all(EDGE_ON * EDGE_ON) * nearest).max(all(ON_FACE * ON_FACE));
        (least - height * height).store(&mut self.flat, at);
        let crosses = [cross(&v[1], &v[2]), cross(&v[2], &v[0]), cross(&v[0], &v[1])];
        let dots = [dot(&v[1], &v[2]), dot(&v[2], &v[0]), dot(&v[0], &v[1])];
        let mut mean = [zero; 3];
        for (cross, cosine) in crosses.iter().zip(dots) {
            let sine = dot(cross, cross).sqrt();
            let half = zero.if_below(sine, all(0.5) * angle_by_sine(simd, sine, cosine), zero);
            mean = [mean[0] + half * cross[0], mean[1] + half * cross[1], mean[2] + half * cross[2]];
        }
        let determinant = dot(&v[0], &crosses[0]);
        let inverse = zero.if_below(determinant.abs(), all(1.0) / determinant, zero);
        for (cross, weights) in crosses.iter().zip(&mut self.weights) {
            (dot(cross, &mean) * inverse).store(weights, at);
        }
    }
}

/// Three components' lanes, from `first` on.
#[inline(always)]
fn three<S: Simd>(simd: S, coordinates: &[Vec<f64>; 12], first: usize, at: usize) -> [Doubles<S>; 3] {
    let [x, y, z] = [&coordinates[first], &coordinates[first + 1], &coordinates[first + 2]];
    [Doubles::load(simd, x, at), Doubles::load(simd, y, at), Doubles::load(simd, z, at)]
}

#[inline(always)]
fn cross<S: Simd>(a: &[Doubles<S>; 3], b: &[Doubles<S>; 3]) -> [Doubles<S>; 3] {
    [a[1] * b[2] - b[1] * a[2], a[2] * b[0] - b[2] * a[0], a[0] * b[1] - b[0] * a[1]]
}

#[inline(always)]
fn dot<S: Simd>(a: &[Doubles<S>; 3], b: &[Doubles<S>; 3]) -> Doubles<S> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `atan2(sine, cosine) / sine` for `sine > 0`, up to 1e-15 of it: the rational approximation of the Cephes library
/// (Moshier 1984, `atan`) without branches, and with its last division put off to that by the sine.
#[inline(always)]
fn angle_by_sine<S: Simd>(simd: S, sine: Doubles<S>, cosine: Doubles<S>) -> Doubles<S> {
    const P: [f64; 5] = [
        -0.875_060_860_003_190_4,
        -16.157_537_187_333_652,
        -75.008_557_923_147_05,
        -122.886_668_449_013_61,
        -64.850_219_049_420_25,
    ];
    const Q: [f64; 5] = [
        24.858_464_901_423_062,
        165.027_009_831_698_85,
        432.881_060_491_290_27,
        485.390_399_635_913_7,
        194.550_657_148_261_4,
    ];
    let all = |number| Doubles::all(simd, number);
    let size = cosine.abs();
    let (small, large) = (sine.min(size), sine.max(size));
    // Beyond 0.66 the tangent of the difference to an eighth turn is used.
    let steep = all(0.66) * large;
    let up = steep.if_below(small, small - large, small);
    let down = steep.if_below(small, small + large, large);
    let base = steep.if_below(small, all(std::f64::consts::FRAC_PI_4), all(0.0));
    let t = up / down;
    let z = t * t;
    let (mut p, mut q) = (all(P[0]), z + all(Q[0]));
    for k in 1..5 {
        p = p * z + all(P[k]);
        q = q * z + all(Q[k]);
    }
    // From here on, q times the angle: from the nearer axis, from the first one, and from its positive end.
    let turn = |share: f64| all(share * std::f64::consts::PI) * q;
    let eighth = base * q + t * (q + z * p);
    let quarter = size.if_below(sine, turn(0.5) - eighth, eighth);
    cosine.if_below(all(0.0), turn(1.0) - quarter, quarter) / (q * sine)
}

#[cfg(test)]
mod tests {
    use pliant_mesh::metrics::closest_on_triangle;
    use pulp::{Arch, WithSimd};

    use super::*;
    use crate::families::{families, points};

    struct Weigh<'a> {
        patch: &'a mut Patch,
        view: View<'a>,
        vertices: &'a [u32],
        more: u32,
    }

    impl WithSimd for Weigh<'_> {
        type Output = Option<(u32, [f64; 3])>;

        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            // Some vertices first: what is known of their faces counts, and changes nothing.
            self.patch.clear();
            let some = self.vertices.len() / 3;
            let on = self.patch.weigh(simd, self.view, self.vertices[..some].iter().copied(), None);
            on.or_else(|| self.patch.weigh(simd, self.view, self.vertices.iter().copied(), Some(self.more)))
        }
    }

    /// The same sums face by face; `None` on a face. Last, the sum of all magnitudes.
    fn face_by_face(view: View<'_>, vertices: &[u32], more: u32) -> Option<(Vec<f64>, f64, f64)> {
        let View { cage, topology, x } = view;
        let (mut weights, mut others, mut size) = (vec![0.0; vertices.len()], 0.0, 0.0);
        for (f, corners) in (0..).zip(topology.triangles()) {
            if f != more && !corners.iter().any(|v| vertices.contains(v)) {
                continue;
            }
            let FaceWeights::Weights(values) = cage.face_weights(x, f as usize) else { return None };
            for (v, value) in corners.iter().zip(values) {
                match vertices.iter().position(|w| w == v) {
                    Some(at) => weights[at] += value,
                    None => others += value,
                }
                size += value.abs();
            }
        }
        Some((weights, others, size))
    }

    /// With vector registers and without, the same bits; face by face, the same sums to 1e-9 of the sum of magnitudes.
    ///
    /// Of the mean vector, a face far away or seen edge-on leaves a small part of terms that cancel: eight diagonals off
    /// a sheet, 3e-10 of the sum is rounding, in both ways. Near a cage it is 1e-11 at most.
    #[test]
    fn patches_sum_to_what_single_faces_do() {
        let (mut wide, mut narrow) = (Patch::default(), Patch::default());
        let mut on_faces = 0;
        for (name, shape, cage) in families() {
            let coordinates = MeanValue::new(&cage);
            for point in points(&shape, &cage) {
                let view = View { cage: &coordinates, topology: cage.topology(), x: coordinates.to_frame(point) };
                let away = |v: u32| coordinates.positions()[v as usize].distance(view.x);
                let mut vertices: Vec<u32> = (0..cage.vertex_count() as u32).collect();
                vertices.sort_by(|&v, &w| away(v).total_cmp(&away(w)));
                vertices.truncate(24);
                let from = |f: usize| closest_on_triangle(view.x, coordinates.corners(f)).distance(view.x);
                let nearest = (0..cage.face_count()).min_by(|&f, &g| from(f).total_cmp(&from(g))).expect("a face");
                let more = nearest as u32;
                let on = Arch::new().dispatch(Weigh { patch: &mut wide, view, vertices: &vertices, more });
                let same = Weigh { patch: &mut narrow, view, vertices: &vertices, more }.with_simd(pulp::Scalar);
                assert!(on == same && wide.sums == narrow.sums, "{name} at {point}");
                let Some((weights, others, size)) = face_by_face(view, &vertices, more) else {
                    // On an edge, any of its faces will do.
                    let (face, barycentric) = on.expect("on a face");
                    assert!(FaceWeights::On(barycentric) == coordinates.face_weights(view.x, face as usize));
                    let total = wide.weights().iter().sum::<f64>() + wide.weights_mut().1;
                    assert!((total - 1.0).abs() < 1e-12, "{name} at {point}: {total}");
                    on_faces += 1;
                    continue;
                };
                assert!(on.is_none(), "{name} at {point}");
                let (made, made_others) = wide.weights_mut();
                let off =
                    made.iter().zip(&weights).map(|(a, b)| (a - b).abs()).fold((made_others - others).abs(), f64::max);
                assert!(off <= 1e-9 * size, "{name} at {point}: {:e}", off / size);
            }
        }
        assert!(on_faces > 50);
    }

    #[test]
    fn angles_are_those_of_atan2() {
        let one = |sine: f64, cosine: f64| {
            let mut result = [0.0];
            let lanes = |number| Doubles::all(pulp::Scalar, number);
            angle_by_sine(pulp::Scalar, lanes(sine), lanes(cosine)).store(&mut result, 0);
            result[0] * sine
        };
        for i in 1..20_000 {
            let turn = f64::from(i) / 20_000.0 * std::f64::consts::PI;
            for size in [1e-9, 1.0, 3e7] {
                let (sine, cosine) = (size * turn.sin(), size * turn.cos());
                let error = (one(sine, cosine) - sine.atan2(cosine)).abs();
                assert!(error <= 1e-15 * turn, "{turn}: {error:e}");
            }
        }
        for tiny in [1e-300, 1e-30, 1e-12] {
            assert!((one(tiny, 1.0) - tiny).abs() <= 1e-15 * tiny);
            assert!((one(1.0, tiny) - 1.0_f64.atan2(tiny)).abs() <= 2e-15);
            assert!((one(tiny, -1.0) - tiny.atan2(-1.0)).abs() <= 4e-15);
        }
    }
}
