use glam::DVec3;
use rayon::prelude::*;

use super::closest_on_triangle;
use crate::Bounds;

/// Faces of a mesh, to be asked for the one nearest to a point.
///
/// A tree of boxes, split across the longest side into halves of equal number down to single faces.
pub struct FaceTree {
    /// Corners of each face.
    corners: Vec<[DVec3; 3]>,
    /// Faces from left to right.
    order: Vec<u32>,
    /// Boxes of both halves of each split; a split of `n` faces is followed by the `n / 2 - 1` splits of its left half, then
    /// by those of its right half.
    splits: Vec<[Bounds; 2]>,
    /// Largest coordinate: what rounding is measured by.
    size: f64,
}

/// A face that is near a point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Nearest {
    pub(super) face: u32,
    pub(super) distance: f64,
    /// Whether no other is nearer, nor one of a lower number as near.
    pub(super) is_proven: bool,
}

/// Some faces from left to right: where their splits and they themselves start, and how many they are.
#[derive(Clone, Copy)]
struct Part {
    split: usize,
    first: usize,
    count: usize,
}

impl Part {
    fn halves(self) -> [Self; 2] {
        let Self { split, first, count } = self;
        let left = count / 2;
        [
            Self { split: split + 1, first, count: left },
            Self { split: split + left, first: first + left, count: count - left },
        ]
    }
}

/// Parts put off at a time: at most one for each time that the number of faces, below 2^32, can be halved.
const DEPTH: usize = 33;

/// Rounding of a distance, as a share of the coordinates it is computed from: a few units in the last place.
const ROUNDING: f64 = 1e-15;

impl FaceTree {
    /// A tree of the faces of `triangles`, whose corners are `positions`; `O(n log n)`, parallel.
    ///
    /// # Panics
    /// If a face names a vertex that has no position.
    pub fn new(positions: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let corners: Vec<[DVec3; 3]> = triangles.par_iter().map(|t| t.map(|v| positions[v as usize])).collect();
        let middle = |(face, corners): (usize, &[DVec3; 3])| (corners.iter().sum(), face as u32);
        let mut middles: Vec<(DVec3, u32)> = corners.par_iter().enumerate().map(middle).collect();
        let empty = Bounds { min: DVec3::ZERO, max: DVec3::ZERO };
        let mut splits = vec![[empty; 2]; corners.len().saturating_sub(1)];
        let all = arrange(&corners, &mut middles, &mut splits);
        let order = middles.into_iter().map(|(_, face)| face).collect();
        Self { corners, order, splits, size: all.min.abs().max(all.max.abs()).max_element() }
    }

    /// The nearest face and its distance: the one of lowest number where several are equally near, `None` without faces.
    /// `O(log n)`.
    pub fn nearest(&self, point: DVec3) -> Option<(u32, f64)> {
        self.nearest_from(point, None)
    }

    /// [`Self::nearest`], the sooner the nearer the face `start` is, such as that found for a point close by.
    ///
    /// # Panics
    /// If there is no such face.
    pub fn nearest_from(&self, point: DVec3, start: Option<u32>) -> Option<(u32, f64)> {
        self.nearest_within(point, start, usize::MAX).map(|found| (found.face, found.distance))
    }

    /// [`Self::nearest_from`], but with the nearest face so far once `parts` of the tree were looked at.
    pub(super) fn nearest_within(&self, point: DVec3, start: Option<u32>, parts: usize) -> Option<Nearest> {
        let start = start.or(self.order.first().copied())?;
        let rounding = ROUNDING * (self.size + point.abs().max_element());
        // Beyond this, squared, no box holds a face that is as near.
        let limit = |square: f64| (square.sqrt() + rounding).powi(2);
        let mut best = (self.square(point, start), start);
        let mut most = limit(best.0);
        let mut later = [(0.0, Part { split: 0, first: 0, count: 0 }); DEPTH];
        let (mut put_off, mut left) = (0, parts);
        let mut next = Some((0.0, Part { split: 0, first: 0, count: self.order.len() }));
        while let Some((away, part)) = next
            && left > 0
        {
            next = None;
            left -= 1;
            if away <= most && part.count == 1 {
                let face = self.order[part.first];
                let square = self.square(point, face);
                if square < best.0 || (square == best.0 && face < best.1) {
                    best = (square, face);
                    most = limit(square);
                }
            } else if away <= most {
                let [left, right] = part.halves();
                let [l, r] = self.splits[part.split].map(|half| square_to_box(point, half));
                let (near, far) = if l <= r { ((l, left), (r, right)) } else { ((r, right), (l, left)) };
                if far.0 <= most {
                    later[put_off] = far;
                    put_off += 1;
                }
                next = Some(near);
            }
            if next.is_none() && put_off > 0 {
                put_off -= 1;
                next = Some(later[put_off]);
            }
        }
        Some(Nearest { face: best.1, distance: best.0.sqrt(), is_proven: next.is_none() })
    }

    /// What rounding may add to a distance between the faces and a point among them.
    pub(super) fn rounding(&self) -> f64 {
        ROUNDING * self.size
    }

    /// Faces from left to right: neighbours in the tree, and so about in space.
    pub(super) fn order(&self) -> &[u32] {
        &self.order
    }

    /// Corners of a face.
    pub(super) fn corners(&self, face: u32) -> [DVec3; 3] {
        self.corners[face as usize]
    }

    /// Calls `look` with every face right of `place` whose box meets, or touches, that of the face there; returns how many boxes
    /// it was compared with.
    pub(super) fn for_each_meeting(&self, place: usize, mut look: impl FnMut(u32)) -> u64 {
        let own = Bounds::of(&self.corners[self.order[place] as usize]);
        let is_right = |part: &Part| part.first + part.count > place + 1;
        let all = Part { split: 0, first: 0, count: self.order.len() };
        let mut later = [all; DEPTH];
        let (mut put_off, mut compared) = (usize::from(is_right(&all)), 0);
        while put_off > 0 {
            put_off -= 1;
            let part = later[put_off];
            if part.count == 1 {
                look(self.order[part.first]);
                continue;
            }
            let [left, right] = part.halves();
            let [near, far] = self.splits[part.split];
            for (half, around) in [(right, far), (left, near)] {
                if is_right(&half) {
                    compared += 1;
                    if own.min.cmple(around.max).all() && around.min.cmple(own.max).all() {
                        later[put_off] = half;
                        put_off += 1;
                    }
                }
            }
        }
        compared
    }

    fn square(&self, point: DVec3, face: u32) -> f64 {
        point.distance_squared(closest_on_triangle(point, self.corners[face as usize]))
    }
}

fn square_to_box(point: DVec3, Bounds { min, max }: Bounds) -> f64 {
    (min - point).max(point - max).max(DVec3::ZERO).length_squared()
}

/// Sorts faces, each with three times its middle, from left to right, fills in their splits, and returns the box round all.
fn arrange(corners: &[[DVec3; 3]], faces: &mut [(DVec3, u32)], splits: &mut [[Bounds; 2]]) -> Bounds {
    /// Below this, handing work to another thread costs more than it saves.
    const ALONE: usize = 4096;
    if faces.len() <= 1 {
        return faces.first().map_or(Bounds::of(&[]), |(_, f)| Bounds::of(&corners[*f as usize]));
    }
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (middle, _) in faces.iter() {
        (low, high) = (low.min(*middle), high.max(*middle));
    }
    let axis = (high - low).max_position();
    let half = faces.len() / 2;
    faces.select_nth_unstable_by(half, |(p, f), (q, g)| p[axis].total_cmp(&q[axis]).then(f.cmp(g)));
    let (left, right) = faces.split_at_mut(half);
    let (own, below) = splits.split_at_mut(1);
    let (left_splits, right_splits) = below.split_at_mut(half - 1);
    let mut left = || arrange(corners, left, left_splits);
    let mut right = || arrange(corners, right, right_splits);
    let (left, right) = if half < ALONE { (left(), right()) } else { rayon::join(left, right) };
    own[0] = [left, right];
    Bounds { min: left.min.min(right.min), max: left.max.max(right.max) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TriMesh, shapes};

    /// Round, flat with many ties, thin needles, faces of very different size that overlap, faces without area, one face, far away.
    fn meshes() -> Vec<(&'static str, TriMesh)> {
        let moved = |mesh: &TriMesh, to: &dyn Fn(DVec3) -> DVec3| {
            mesh.with_positions(mesh.positions.iter().map(|p| to(*p)).collect()).expect("finite")
        };
        let sphere = shapes::icosphere(3);
        let one = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).expect("valid");
        vec![
            ("needles", moved(&sphere, &|p| p * DVec3::new(1.0, 1e-3, 50.0))),
            ("grid", shapes::plane_grid(12, 12, 2.0, 2.0).expect("valid")),
            ("uneven", moved(&sphere, &|p| p * (p.x * 3.0).exp())),
            ("without area", moved(&sphere, &|p| if p.z > 0.3 { DVec3::Z } else { p })),
            ("tiny", moved(&sphere, &|p| p * 1e-6)),
            ("huge", moved(&sphere, &|p| p * 1e6)),
            ("far away", moved(&sphere, &|p| p + DVec3::splat(1e5))),
            ("one face", one),
            ("sphere", sphere),
        ]
    }

    /// The same face and the same distance as by looking at every face, the lowest on ties, wherever the search starts: at
    /// corners and middles of edges and faces, where several are equally near, a little off them, and far away.
    #[test]
    fn the_nearest_face_is_that_of_all_faces() {
        for (name, mesh) in meshes() {
            let tree = FaceTree::new(&mesh.positions, mesh.triangles());
            let bounds = mesh.bounds();
            let faces = mesh.face_count() as u32;
            let (mut points, mut ties) = (vec![bounds.centre()], 0);
            for f in (0..mesh.face_count()).step_by(1 + mesh.face_count() / 60) {
                let [a, b, c] = mesh.corners(f);
                for spot in [a, 0.5 * (a + b), (a + b + c) / 3.0, 0.3 * b + 0.7 * c] {
                    let t = points.len() as f64;
                    let off = DVec3::new(t.sin(), (1.7 * t).cos(), (2.9 * t).sin()) * bounds.diagonal();
                    points.extend([0.0, 1e-15, 1e-8, 1e-3, 0.1, 3.0].map(|share| spot + share * off));
                }
            }
            for (i, &point) in points.iter().enumerate() {
                let square = |f: u32| point.distance_squared(closest_on_triangle(point, mesh.corners(f as usize)));
                let least = (0..faces).map(square).fold(f64::INFINITY, f64::min);
                let first = (0..faces).find(|&f| square(f) == least).expect("a face");
                ties += usize::from((first + 1..faces).any(|f| square(f) == least));
                let expected = Some((first, least.sqrt()));
                assert_eq!(tree.nearest(point), expected, "{name}, point {i}");
                for start in [first, faces - 1, i as u32 % faces] {
                    assert_eq!(tree.nearest_from(point, Some(start)), expected, "{name}, point {i} from {start}");
                    for parts in [0, 1, 5, 30, 200] {
                        let found = tree.nearest_within(point, Some(start), parts).expect("a face");
                        assert!(
                            !found.is_proven || (found.face, found.distance) == (first, least.sqrt()),
                            "{name}, {found:?}"
                        );
                        assert_eq!(found.distance, square(found.face).sqrt(), "{name}, point {i}");
                    }
                }
            }
            assert!(ties > 20 || faces == 1, "{name}: {ties} points have several nearest faces");
        }
        assert_eq!(FaceTree::new(&[], &[]).nearest(DVec3::ZERO), None);
    }
}
