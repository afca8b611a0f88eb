//! Meshes of a body with a wanted number of vertices and even triangles.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::bones::{Body, Sample};
use super::implicit::Cut;
use super::lattice::Lattice;
use crate::{Bounds, MeshError, Topology, TriMesh, face_area_vector};

/// Vertices of the first, cheap lattice from which the area is learnt.
const TRIAL: f64 = 20_000.0;
/// Relative miss of the wanted count that ends the search for a lattice.
const CLOSE: f64 = 0.015;
/// The same for the finished mesh.
const CLOSE_ENOUGH: f64 = 0.018;
/// Lattices whose mesh is looked at before giving up.
const ATTEMPTS: u32 = 8;
/// Up to so many vertices a fold at a thin part is worth another lattice; finer meshes have none.
const COARSE: usize = 20_000;
/// Vertices times square of the lattice step, per area.
const PER_SQUARE: f64 = 1.77;
/// Extent in edges of the groups of vertices that share a part of the body while they are moved.
const RUN_SIZE: f64 = 6.0;
const SMOOTHING_ROUNDS: usize = 5;

/// Height over the surface at a point of it, for a mesh with edges about as long as the last argument.
pub(super) type Relief = dyn Fn(DVec3, &Sample, f64) -> f64 + Sync;

/// A closed mesh of one component and genus 0 on the surface of `body`, with `vertices` vertices within 2 %.
///
/// `area` is the surface's area, a guess that saves trials if it is good. Time is linear in the count.
///
/// # Errors
/// No lattice resolves the body as one piece without handles: it has thinner parts than such a mesh can show.
pub(super) fn even_mesh(body: &Body, area: f64, vertices: usize, relief: &Relief) -> Result<TriMesh, MeshError> {
    let mut best: Option<(usize, f64, TriMesh)> = None;
    let mut wanted = vertices as f64;
    for attempt in 0..ATTEMPTS {
        // How thin parts come out depends a little on where the lattice lies.
        let shift = DVec3::new(0.37, 0.59, 0.83) * (f64::from(attempt) * 0.618).fract();
        let mesh = fitting_cut(body, area, wanted, shift)?.mesh()?;
        let topology = mesh.topology();
        if topology.euler_characteristic() != 2 || topology.components().1 != 1 {
            continue;
        }
        let found = mesh.vertex_count() as f64;
        // Some nodes were taken apart, which the cut did not foresee.
        wanted *= vertices as f64 / found;
        // A small miss is as good as none.
        let miss = ((found / vertices as f64 - 1.0).abs() - CLOSE_ENOUGH).max(0.0);
        if best.as_ref().is_some_and(|(_, least, _)| miss > *least) {
            continue;
        }
        // Two triangles of equal sides for each vertex.
        let edge = (area / (0.75_f64.sqrt() * vertices as f64)).sqrt();
        let (mesh, turned) = finished(body, &mesh, edge, relief, vertices <= COARSE)?;
        if best.as_ref().is_none_or(|(fewest, least, _)| (miss, turned) < (*least, *fewest)) {
            best = Some((turned, miss, mesh));
        }
        if miss == 0.0 && turned == 0 {
            break;
        }
    }
    best.map(|(_, _, mesh)| mesh).ok_or_else(|| MeshError::BadParameter {
        what: "vertices",
        expected: "enough to show the shape as one piece without holes".to_owned(),
        found: vertices.to_string(),
    })
}

/// The mesh smoothed, on the surface, and raised by the relief; and how many of its faces look into the body, if asked.
fn finished(
    body: &Body,
    mesh: &TriMesh,
    edge: f64,
    relief: &Relief,
    count_turned: bool,
) -> Result<(TriMesh, usize), MeshError> {
    let starts = compact_runs(&mesh.positions, RUN_SIZE * edge);
    let parts: Vec<Part> =
        starts.par_windows(2).map(|run| Part::new(body, &mesh.positions, edge, run[0]..run[1])).collect();
    let positions = smoothed(&parts, mesh.topology(), &mesh.positions);
    let mesh = mesh.with_positions(raised(&parts, &positions, edge, relief))?;
    let turned = if count_turned { turned_faces(body, &mesh) } else { 0 };
    Ok((mesh, turned))
}

/// Number of faces whose normals point against the gradient of the body's distance at their middles.
pub(super) fn turned_faces(body: &Body, mesh: &TriMesh) -> usize {
    let outward = |f: usize| body.sample(mesh.corners(f).iter().sum::<DVec3>() / 3.0).gradient;
    (0..mesh.face_count()).into_par_iter().filter(|&f| face_area_vector(mesh.corners(f)).dot(outward(f)) <= 0.0).count()
}

/// The cut whose number of vertices is nearest to the wanted one among a few tried.
///
/// The count is the area over the square of the step, times a factor that hardly changes: each trial tells it anew.
fn fitting_cut(body: &Body, area: f64, vertices: f64, shift: DVec3) -> Result<Cut<'_>, MeshError> {
    let mut per_square = PER_SQUARE * area;
    let mut best: Option<(f64, Cut)> = None;
    let trials = (vertices > 10.0 * TRIAL).then_some(TRIAL).into_iter().chain([vertices; 6]);
    for wanted in trials {
        let step = (per_square / wanted).sqrt();
        let cut = Cut::new(body, Lattice::new(body, step, shift)?);
        let found = cut.vertex_count() as f64;
        per_square = found.max(1.0) * step * step;
        let miss = (found / vertices - 1.0).abs();
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, cut));
        }
        if miss < CLOSE {
            break;
        }
    }
    Ok(best.expect("at least one cut was made").1)
}

/// Moves vertices along the surface towards the middle of their neighbours, and onto it.
fn smoothed(parts: &[Part], topology: &Topology, positions: &[DVec3]) -> Vec<DVec3> {
    let mut positions = moved(parts, |part, v| part.projected(positions[v], 1));
    for _ in 0..SMOOTHING_ROUNDS {
        positions = moved(parts, |part, v| {
            let ring = topology.neighbours(v);
            let middle = ring.iter().map(|&w| positions[w as usize]).sum::<DVec3>() / ring.len() as f64;
            // The projection takes back the part of the move that leaves the surface.
            part.projected(positions[v].lerp(middle, 0.7), 1)
        });
    }
    moved(parts, |part, v| part.projected(positions[v], 2))
}

/// Every point moved along the normal by the relief there.
fn raised(parts: &[Part], positions: &[DVec3], edge: f64, relief: &Relief) -> Vec<DVec3> {
    moved(parts, |part, v| {
        let p = positions[v];
        let sample = part.at(p).sample(p);
        p + relief(p, &sample, edge) * sample.gradient.normalize_or_zero()
    })
}

/// A run of vertices near each other, and the part of the body near them.
struct Part<'a> {
    vertices: Range<usize>,
    whole: &'a Body,
    part: Body,
    centre: DVec3,
    radius: f64,
}

impl<'a> Part<'a> {
    /// The part within a few edges of the vertices of a run.
    fn new(body: &'a Body, positions: &[DVec3], edge: f64, vertices: Range<usize>) -> Self {
        let bounds = Bounds::of(&positions[vertices.clone()]);
        let (centre, radius) = (bounds.centre(), 0.5 * bounds.diagonal() + 2.0 * edge);
        Self { vertices, whole: body, part: body.near(centre, radius), centre, radius }
    }

    /// What to ask about `p`: equal to the whole body to the bit, and faster in the ball.
    fn at(&self, p: DVec3) -> &Body {
        if p.distance(self.centre) <= self.radius { &self.part } else { self.whole }
    }

    fn projected(&self, p: DVec3, steps: usize) -> DVec3 {
        (0..steps).fold(p, |p, _| self.at(p).projected(p))
    }
}

/// The positions that `step` gives each vertex, the parts worked on in parallel.
fn moved(parts: &[Part], step: impl Fn(&Part, usize) -> DVec3 + Sync) -> Vec<DVec3> {
    parts.par_iter().flat_map_iter(|part| part.vertices.clone().map(|v| step(part, v)).collect::<Vec<_>>()).collect()
}

/// Borders of runs of points whose boxes have diagonals of at most `size`.
fn compact_runs(positions: &[DVec3], size: f64) -> Vec<usize> {
    let mut starts = vec![0];
    let Some(&first) = positions.first() else { return starts };
    let mut bounds = Bounds { min: first, max: first };
    for (v, &p) in positions.iter().enumerate() {
        let grown = Bounds { min: bounds.min.min(p), max: bounds.max.max(p) };
        bounds = if grown.diagonal() <= size {
            grown
        } else {
            starts.push(v);
            Bounds { min: p, max: p }
        };
    }
    starts.push(positions.len());
    starts
}
