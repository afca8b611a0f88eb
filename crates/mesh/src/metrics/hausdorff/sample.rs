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
}

impl Samples {
    /// Each distance is exceeded by at most `tolerance` as a share of it.
    pub(super) fn new(own: &Surface, other: &Surface, tolerance: f64) -> Self {
        // In the tree's order points that follow each other are close, whatever the mesh's order: searches start where the last ended.
        let mut vertices = Vec::with_capacity(own.positions.len());
        let mut is_new = vec![true; own.positions.len()];
        for &face in own.tree.order() {
            for v in own.triangles[face as usize] {
                if std::mem::take(&mut is_new[v as usize]) {
                    vertices.push(v);
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
            vertices: search(&vertices, own.positions.len(), &|v| own.positions[v as usize]),
            centroids: search(own.tree.order(), own.triangles.len(), &|f| centroid(own.tree.corners(f))),
        }
    }

    /// Number of samples whose search was cut short.
    pub(super) fn unproven(&self) -> usize {
        self.vertices.iter().chain(&self.centroids).filter(|near| !near.is_proven).count()
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
    /// Below this, handing work to another thread costs more than it saves.
    const ALONE: usize = 1024;
    let bounds = Bounds::of(points);
    let radius = 0.5 * bounds.diagonal();
    let Some(middle) = tree.nearest_within(bounds.centre(), None, PARTS * points.len()) else {
        return;
    };
    let mut face = middle.face;
    if middle.is_proven && 2.0 * radius <= tolerance * (middle.distance - radius) {
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
