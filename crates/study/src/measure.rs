//! From a pose of the control mesh to the shape, and what there is to say of it.

use std::time::Instant;

use glam::DVec3;
use pliant_cage::{Propagation, Propagator};
use pliant_deform::Method;
use pliant_mesh::TriMesh;
use pliant_mesh::metrics::{
    HausdorffOptions, IntersectionOptions, area_change, edge_errors, flipped_faces, hausdorff, largest_free_stretch,
    rms_distance, self_intersections, surface_distance, volume_change,
};

use crate::SweepRow;
use crate::pipeline::{Bound, Caged, Dragged, Study, count, median, percentile};
use crate::report::{RowTimes, Spread};
use crate::settings::{Schedule, Setting, SweepSize};
use crate::stages::{Stages, milliseconds};

impl Study<'_> {
    /// Carries a pose of the control mesh to the shape, and measures it. Where a decimated mesh was deformed in place of the shape, the pose
    /// is that of its vertices.
    pub fn carry(
        &self,
        caged: &Caged,
        bound: &Bound,
        dragged: &Dragged,
        propagation: Propagation,
        stages: &dyn Stages,
    ) -> (Vec<DVec3>, SweepRow) {
        let decimated = matches!(caged.size, SweepSize::Decimated(_) | SweepSize::EqualTime(_));
        let mut row = self.row(caged, bound, &dragged.method, dragged.schedule, propagation);
        row.warnings.extend(dragged.warnings.iter().cloned());
        row.times.prepare_ms = Spread::of(&dragged.prepare_ms);
        row.times.drag_ms = Spread::of(&dragged.drag_ms);
        row.times.drag_p95_ms = percentile(&dragged.drag_ms, 95);
        let cage_errors = edge_errors(caged.mesh.topology(), &caged.mesh.positions, &dragged.pose);
        row.cage_rms_relative = cage_errors.rms_relative;
        let pose = if bound.options.is_none() {
            dragged.pose.clone()
        } else {
            row.warnings.extend(bound.binding.report().warnings());
            self.propagate(caged, bound, dragged, propagation, &mut row, stages)
        };
        // A decimated mesh is judged by its own edges: the shape's are lost.
        let rest = if decimated { &caged.mesh } else { self.shape };
        let labels: Vec<u32> = match &caged.simplified {
            Some(made) if decimated => made.origin.iter().map(|&v| self.labels[v as usize]).collect(),
            _ => self.labels.clone(),
        };
        let row = self.judge(rest, &labels, &pose, row);
        let row = self.compare_with_converged(caged, decimated, &pose, row);
        (pose, row)
    }

    /// Takes the motion of the control mesh to the shape; adds what that says of the binding at rest, and times.
    fn propagate(
        &self,
        caged: &Caged,
        bound: &Bound,
        dragged: &Dragged,
        propagation: Propagation,
        row: &mut SweepRow,
        stages: &dyn Stages,
    ) -> Vec<DVec3> {
        let topology = self.shape.topology();
        let mut propagator = Propagator::new(propagation).with_fit(self.frame_fit());
        let mut pose = self.shape.positions.clone();
        propagator.apply(&bound.binding, &caged.mesh.positions, &mut pose);
        row.rest_rms_relative = edge_errors(topology, &self.shape.positions, &pose).rms_relative;
        let moved = pose.iter().zip(&self.shape.positions).map(|(p, x)| p.distance(*x));
        row.rest_error_max = moved.fold(0.0, f64::max) * self.scale();
        if row.rest_rms_relative > POP {
            row.warnings.push(format!(
                "with nothing deformed, propagation by {propagation} under {} already changes edge lengths by {:.0} % \
                 (root mean square); propagation by frames changes none",
                row.prune,
                1e2 * row.rest_rms_relative
            ));
        }
        stages.begin("propagate");
        let mut times = Vec::new();
        for _ in 0..PROPAGATIONS_TIMED.max(self.repeats) {
            let start = Instant::now();
            propagator.apply(&bound.binding, &dragged.pose, &mut pose);
            times.push(milliseconds(start.elapsed()));
        }
        row.times.propagate_ms = Spread::of(&times);
        let time = std::time::Duration::from_secs_f64(median(&times) / 1e3);
        stages.end("propagate", time, &format!("{} vertices by {propagation}", count(pose.len())));
        pose
    }

    /// Fills in what a pose of the shape, or of the decimated mesh, says by itself.
    fn judge(&self, rest: &TriMesh, labels: &[u32], pose: &[DVec3], row: SweepRow) -> SweepRow {
        let topology = rest.topology();
        let errors = edge_errors(topology, &rest.positions, pose);
        let goals = self.scene.goals(1.0);
        let missed = labels.iter().enumerate().filter(|(_, label)| **label > 0).map(|(v, &label)| {
            goals.get(label as usize - 1).map_or(0.0, |goal| pose[v].distance(goal.apply(rest.positions[v])))
        });
        let crossings = self_intersections(topology, pose, &IntersectionOptions::default());
        let mut warnings = row.warnings;
        if !crossings.complete {
            warnings.push("faces pass through each other in so many places that they were not all counted".to_owned());
        }
        SweepRow {
            warnings,
            intersecting_faces: Some(crossings.pairs() as usize),
            area_change: Some(area_change(topology, &rest.positions, pose)).filter(|change| change.is_finite()),
            volume_change: volume_change(topology, &rest.positions, pose),
            flipped_faces: Some(flipped_faces(topology, &rest.positions, pose)),
            max_free_stretch: largest_free_stretch(topology, &rest.positions, pose, |v| labels[v as usize]),
            handle_error_max: missed.fold(0.0, f64::max) * self.scale(),
            ..row
        }
        .with_edge_errors(&errors)
    }

    /// Fills in the distances to the converged pose, if that is known.
    fn compare_with_converged(&self, caged: &Caged, decimated: bool, pose: &[DVec3], row: SweepRow) -> SweepRow {
        let Some(converged) = &self.converged else { return row };
        let (distance, hausdorff) = match &caged.simplified {
            Some(made) if decimated => {
                let places: Vec<DVec3> = made.origin.iter().map(|&v| converged[v as usize]).collect();
                (rms_distance(pose, &places), self.hausdorff_between(&caged.mesh, pose, converged))
            }
            _ => {
                let apart = hausdorff(self.shape.topology(), pose, converged, &HausdorffOptions::default());
                (rms_distance(pose, converged), Some(apart.max()))
            }
        };
        SweepRow {
            distance_to_converged: Some(distance * self.scale()),
            hausdorff_to_converged: hausdorff.map(|distance| distance * self.scale()),
            ..row
        }
    }

    /// The larger distance of a vertex of either to the surface of the other, of a decimated mesh and the shape: they have no topology
    /// in common.
    fn hausdorff_between(&self, decimated: &TriMesh, pose: &[DVec3], converged: &[DVec3]) -> Option<f64> {
        let [posed, shape] = [(decimated, pose), (self.shape, converged)].map(|(mesh, pose)| {
            // A pose that is not finite is no surface.
            mesh.with_positions(pose.to_vec()).ok()
        });
        let (posed, shape) = (posed?, shape?);
        let there = surface_distance(pose, &shape).max;
        Some(there.max(surface_distance(converged, &posed).max))
    }

    /// 1 over the diagonal of the shape's bounding box.
    pub(crate) fn scale(&self) -> f64 {
        self.shape.bounds().normal_frame().1
    }

    /// A row of what was asked, with the cage and the binding, before anything is deformed.
    pub(crate) fn row(
        &self,
        caged: &Caged,
        bound: &Bound,
        method: &Method,
        schedule: Schedule,
        propagation: Propagation,
    ) -> SweepRow {
        let (size, method, bind) = (caged.size, method.clone(), bound.options.unwrap_or_default());
        let setting = Setting { size, method, schedule, propagation, bind };
        let report = bound.binding.report();
        SweepRow {
            cage_vertices: caged.mesh.vertex_count(),
            kept_mean: report.kept_mean,
            kept_max: report.kept_max,
            negative_share: report.negative_share,
            unsafe_rows: report.unsafe_rows,
            warnings: caged.warnings.clone(),
            times: RowTimes {
                repeats: self.repeats,
                simplify_ms: Spread::of(&caged.simplify_ms),
                bind_ms: Spread::of(&bound.bind_ms),
                ..RowTimes::default()
            },
            ..setting.row(&self.model, self.shape.vertex_count(), &self.scene.name)
        }
    }
}

/// Edge length error at rest from which a row carries a warning: more than the paper's own tables show.
const POP: f64 = 0.1;

/// Propagations timed per row; the median is reported.
const PROPAGATIONS_TIMED: usize = 5;
