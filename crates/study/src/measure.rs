//! From a pose of the control mesh to the shape, and what there is to say of it.

use std::time::Instant;

use glam::DVec3;
use pliant_cage::{Propagation, Propagator};
use pliant_deform::Method;
use pliant_mesh::metrics::{edge_errors, flipped_faces, largest_free_stretch, rms_distance, volume_change};

use crate::SweepRow;
use crate::pipeline::{Bound, Caged, Dragged, Study, count, median};
use crate::report::NO_CAGE;
use crate::settings::Schedule;
use crate::stages::{Stages, milliseconds};

impl Study<'_> {
    /// Carries a pose of the control mesh to the shape, and measures it.
    pub fn carry(
        &self,
        caged: &Caged,
        bound: &Bound,
        dragged: &Dragged,
        propagation: Propagation,
        stages: &dyn Stages,
    ) -> (Vec<DVec3>, SweepRow) {
        let mut propagator = Propagator::new(propagation).with_fit(self.frame_fit());
        let mut pose = self.shape.positions.clone();
        propagator.apply(&bound.binding, &caged.mesh.positions, &mut pose);
        let topology = self.shape.topology();
        let rest = edge_errors(topology, &self.shape.positions, &pose);
        let (_, scale) = self.shape.bounds().normal_frame();
        let moved = pose.iter().zip(&self.shape.positions).map(|(p, x)| p.distance(*x) * scale);
        let rest_error_max = moved.fold(0.0, f64::max);

        let mut times = Vec::new();
        let direct = bound.options.is_none();
        if direct {
            pose.copy_from_slice(&dragged.pose);
            times.push(0.0);
        } else {
            stages.begin("propagate");
            for _ in 0..PROPAGATIONS_TIMED {
                let start = Instant::now();
                propagator.apply(&bound.binding, &dragged.pose, &mut pose);
                times.push(milliseconds(start.elapsed()));
            }
            let time = std::time::Duration::from_secs_f64(median(times.clone()) / 1e3);
            stages.end("propagate", time, &format!("{} vertices by {propagation}", count(pose.len())));
        }
        let errors = edge_errors(topology, &self.shape.positions, &pose);
        let cage_errors = edge_errors(caged.mesh.topology(), &caged.mesh.positions, &dragged.pose);
        let report = bound.binding.report();
        let goals = self.scene.goals(1.0);
        let missed = self.scene.handles.iter().zip(&goals).flat_map(|(handle, goal)| {
            handle.vertices.iter().map(|v| v as usize).map(|v| pose[v].distance(goal.apply(self.shape.positions[v])))
        });
        let handle_error_max = missed.fold(0.0, f64::max) * scale;
        let mut warnings: Vec<String> = caged.warnings.iter().chain(&dragged.warnings).cloned().collect();
        warnings.extend(report.warnings());
        if rest.rms_relative > POP {
            warnings.push(format!(
                "with nothing deformed, propagation by {propagation} under {} already changes edge lengths by {:.0} % \
                 (root mean square); propagation by frames changes none",
                bound.options.map_or(NO_CAGE.to_owned(), |p| p.to_string()),
                1e2 * rest.rms_relative
            ));
        }
        let row = SweepRow {
            volume_change: volume_change(topology, &self.shape.positions, &pose),
            flipped_faces: Some(flipped_faces(topology, &self.shape.positions, &pose)),
            distance_to_converged: self.converged.as_ref().map(|converged| rms_distance(&pose, converged) * scale),
            max_free_stretch: largest_free_stretch(topology, &self.shape.positions, &pose, |v| self.labels[v as usize]),
            cage_rms_relative: cage_errors.rms_relative,
            rest_rms_relative: rest.rms_relative,
            rest_error_max,
            handle_error_max,
            prepare_ms: dragged.prepare_ms,
            drag_ms: dragged.drag_ms,
            propagate_ms: median(times),
            warnings,
            ..self.row(caged, bound, &dragged.method, dragged.schedule, propagation)
        };
        (pose, row.with_edge_errors(&errors))
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
        let report = bound.binding.report();
        let or_none = |text: String| if bound.options.is_none() { NO_CAGE.to_owned() } else { text };
        SweepRow {
            model: self.model.clone(),
            vertices: self.shape.vertex_count(),
            scene: self.scene.name.clone(),
            cage_asked: caged.size.to_string(),
            cage_vertices: caged.mesh.vertex_count(),
            // Iterations are the schedule's, which rows tell apart.
            method: method.with_default_iterations().to_string(),
            propagation: or_none(propagation.to_string()),
            prune: or_none(bound.options.map_or_else(String::new, |options| options.to_string())),
            steps: schedule.steps,
            start: or_none(schedule.start.to_string()),
            iterations: schedule.count(method).map(|n| n as usize),
            linear: !method.iterates(),
            kept_mean: report.kept_mean,
            kept_max: report.kept_max,
            negative_share: report.negative_share,
            unsafe_rows: report.unsafe_rows,
            simplify_ms: caged.simplify_ms,
            bind_ms: bound.bind_ms,
            warnings: caged.warnings.clone(),
            ..SweepRow::default()
        }
    }
}

/// Edge length error at rest from which a row carries a warning: more than the paper's own tables show.
const POP: f64 = 0.1;

/// Propagations timed per row; the median is reported.
const PROPAGATIONS_TIMED: usize = 5;
