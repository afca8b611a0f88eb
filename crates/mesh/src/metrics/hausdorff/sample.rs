use glam::DVec3;
use rayon::prelude::*;

use super::Surface;
use crate::metrics::closest_on_triangle;
use crate::metrics::face_tree::{FaceTree, Nearest};
use crate::{Bounds, face_area_vector};

/// The distances of a surface's vertices and of its faces' centroids to another surface.
pub(super) struct Samples {
    /// Of vertices; 0 for those without faces.
    pub(super) vertices: Vec<Nearest>,
    pub(super) centroids: Vec<Nearest>,
    /// The vertices with faces.
    used: Vec<u32>,
}

impl Samples {
    /// Each distance is exceeded by at most `tolerance` as a share of it.
    pub(super) fn new(own: &Surface, other: &Surface, tolerance: f64) -> Self {
        // In the tree's order points that follow each other are close, whatever the mesh's order: searches start where the last ended.
        let mut used = Vec::with_capacity(own.positions.len());
        let mut is_new = vec![true; own.positions.len()];
        for &face in own.tree.order() {
            for v in own.triangles[face as usize] {
                if std::mem::take(&mut is_new[v as usize]) {
                    used.push(v);
                }
            }
        }
        let search = |numbers: &[u32], count: usize, point: &(dyn Fn(u32) -> DVec3 + Sync)| {
            let points: Vec<DVec3> = numbers.par_iter().map(|i| point(*i)).collect();
            let mut found = vec![Nearest::default(); points.len()];
            search_all(&points, &mut found, &other.tree, tolerance);
            let mut near = vec![Nearest { is_proven: true, ..Nearest::default() }; count];
            for (i, found) in numbers.iter().zip(found) {
                near[*i as usize] = found;
            }
            near
        };
        Self {
            vertices: search(&used, own.positions.len(), &|v| own.positions[v as usize]),
            centroids: search(own.tree.order(), own.triangles.len(), &|f| centroid(own.tree.corners(f))),
            used,
        }
    }

    /// Number of samples whose search was cut short.
    pub(super) fn unproven(&self) -> usize {
        self.vertices.iter().chain(&self.centroids).filter(|near| !near.is_proven).count()
    }

    /// The exact distance of one of the farthest samples, the farthest of those that are; `None` without faces.
    pub(super) fn max(&self, own: &Surface, other: &FaceTree) -> Option<f64> {
        /// Samples to search for again: some may have been spared their search, or had it cut short.
        const FARTHEST: usize = 64;
        let vertices = self.used.iter().map(|v| (self.vertices[*v as usize], own.positions[*v as usize]));
        let centroids = self.centroids.iter().enumerate().map(|(face, near)| (*near, centroid(own.corners(face))));
        let mut all: Vec<(Nearest, DVec3)> = vertices.chain(centroids).collect();
        if all.len() > FARTHEST {
            all.select_nth_unstable_by(FARTHEST, |(p, _), (q, _)| q.distance.total_cmp(&p.distance));
            all.truncate(FARTHEST);
        }
        let exact = |(near, point): (Nearest, DVec3)| Some(other.nearest_from(point, Some(near.face))?.1);
        all.into_par_iter().filter_map(exact).reduce_with(f64::max)
    }

    /// The samples at the corners of a face.
    pub(super) fn corners(&self, triangle: [u32; 3]) -> [Nearest; 3] {
        triangle.map(|v| self.vertices[v as usize])
    }

    /// Mean and root mean square over the area of the surface.
    pub(super) fn means(&self, own: &Surface) -> (f64, f64) {
        let areas = || (0..own.triangles.len()).map(|face| face_area_vector(own.corners(face)).length());
        let total: f64 = areas().sum();
        let (mut sum, mut squares, mut weights) = (0.0, 0.0, 0.0);
        for ((face, centre), area) in own.triangles.iter().zip(&self.centroids).zip(areas()) {
            let weight = if total > 0.0 { area / total } else { 1.0 };
            let integral = |of: &dyn Fn(f64) -> f64| {
                self.corners(*face).iter().map(|near| of(near.distance)).sum::<f64>() / 12.0
                    + 0.75 * of(centre.distance)
            };
            sum += weight * integral(&|d| d);
            squares += weight * integral(&|d| d * d);
            weights += weight;
        }
        if weights > 0.0 { (sum / weights, (squares / weights).sqrt()) } else { (0.0, 0.0) }
    }
}

pub(super) fn centroid([a, b, c]: [DVec3; 3]) -> DVec3 {
    (a + b + c) / 3.0
}

/// Parts of a tree that a search looks at for each point it serves, many times more than one without ties needs.
pub(super) const PARTS: usize = 2048;

/// Finds a near face for each point, by one search for all where they are close together as compared to how far off they are.
fn search_all(points: &[DVec3], found: &mut [Nearest], tree: &FaceTree, tolerance: f64) {
    /// What points are divided into; no more of them are looked at one by one.
    const GROUPS: usize = 16;
    /// Parts of the tree to find some face near the middle.
    const GLANCE: usize = 64;
    /// Below this, handing work to another thread costs more than it saves.
    const ALONE: usize = 1024;
    let bounds = Bounds::of(points);
    let radius = 0.5 * bounds.diagonal();
    let serves_all = |middle: Nearest| 2.0 * radius <= tolerance * (middle.distance - radius);
    // A glance mostly tells that a face is too near for that.
    let Some(glance) = tree.nearest_within(bounds.centre(), None, GLANCE) else {
        return;
    };
    let middle = if serves_all(glance) {
        tree.nearest_within(bounds.centre(), Some(glance.face), PARTS * points.len()).unwrap_or(glance)
    } else {
        glance
    };
    let mut face = middle.face;
    if middle.is_proven && serves_all(middle) {
        // No point is nearer to any face than the middle is, less the radius, and none farther from this one than that plus the radius.
        for (point, found) in points.iter().zip(found) {
            *found = Nearest {
                face,
                distance: point.distance(closest_on_triangle(*point, tree.corners(face))),
                is_proven: true,
            };
        }
    } else if points.len() <= GROUPS {
        for (point, found) in points.iter().zip(found) {
            if let Some(nearest) = tree.nearest_within(*point, Some(face), PARTS) {
                *found = nearest;
                face = nearest.face;
            }
        }
    } else {
        let size = points.len().div_ceil(GROUPS);
        if points.len() > ALONE {
            let groups = points.par_chunks(size).zip(found.par_chunks_mut(size));
            groups.for_each(|(points, found)| search_all(points, found, tree, tolerance));
        } else {
            let groups = points.chunks(size).zip(found.chunks_mut(size));
            groups.for_each(|(points, found)| search_all(points, found, tree, tolerance));
        }
    }
}
