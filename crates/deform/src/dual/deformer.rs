//! Preparing an edit and solving it.

use std::time::Instant;

use glam::DVec3;
use pliant_linalg::{IterativeLeastSquares, Krylov, LeastSquares, LinalgError, SparseRows};
use pliant_mesh::TriMesh;
use pliant_mesh::threads::among_threads;

use super::equations::Equations;
use super::{DualLaplacianOptions, LinearSolver};
use crate::fit::Fit;
use crate::patch::Patch;
use crate::{DeformError, Deformer, Goals, PrepareReport, Region, SolveReport, StepTimes};

/// So many rings of fixed vertices are looked at: a row reaches from an unknown over two faces, and whether a vertex is at a border
/// shows one ring further out.
pub(super) const RINGS: usize = 3;

/// Where conjugate gradients stop: see [`IterativeLeastSquares::solve`].
const RESIDUAL: f64 = 1e-10;

/// Most iterations of conjugate gradients a solve, per unknown; exact arithmetic needs one.
const MOST_PER_UNKNOWN: u32 = 10;

/// A prepared edit by the dual Laplacian.
///
/// Computes in the rest shape's frame, so results follow any scale and offset of the scene. They are the same, bit for bit, for any number
/// of threads.
pub struct DualLaplacian {
    options: DualLaplacianOptions,
    rest: TriMesh,
    edit: Edit,
}

/// What depends on the region.
struct Edit {
    patch: Patch,
    equations: Equations,
    system: System,
    /// Right-hand sides at rest.
    at_rest: Vec<[f64; 3]>,
    /// Held vertices next to an unknown, which the guess follows.
    rim: Vec<u32>,
    /// Of the rest shape, in the frame.
    diagonal: f64,
    scratch: Scratch,
    times: StepTimes,
}

/// The system of Eq. 8.
enum System {
    Factor(Box<LeastSquares>),
    Iterative(Box<IterativeLeastSquares>),
}

/// Arrays of one solve, kept so that the next one allocates nothing. All in the frame, all but `b` and `dual` with a place for each vertex
/// of the patch.
#[derive(Default)]
struct Scratch {
    pose: Vec<DVec3>,
    /// Where vertices of handles are to be.
    goals: Vec<DVec3>,
    dual: Vec<DVec3>,
    x: Vec<[f64; 3]>,
    b: Vec<[f64; 3]>,
    /// `A x` where the last solve leads, and where the pose is.
    ax: Vec<[f64; 3]>,
    last_ax: Vec<[f64; 3]>,
}

impl DualLaplacian {
    /// Assembles and factors; see [`crate::Method::prepare`].
    ///
    /// # Errors
    /// As [`crate::Method::prepare`].
    pub fn prepare(options: &DualLaplacianOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        options.check()?;
        let edit = Edit::new(options, rest, region)?;
        Ok(Self { options: options.clone(), rest: rest.clone(), edit })
    }
}

impl Deformer for DualLaplacian {
    fn solve(&mut self, goals: &Goals, positions: &mut [DVec3]) -> Result<SolveReport, DeformError> {
        let Self { options, edit, .. } = self;
        edit.read(goals, positions)?;
        let report = among_threads(edit.patch.vertices.len(), || edit.iterate(options));
        let report = report.map_err(|error| DeformError::of_system(error, &edit.patch.vertices))?;
        edit.patch.write(&edit.scratch.pose, goals, positions)?;
        Ok(report)
    }

    fn set_region(&mut self, region: &Region) -> Result<PrepareReport, DeformError> {
        self.edit = Edit::new(&self.options, &self.rest, region)?;
        Ok(self.prepared())
    }

    fn prepared(&self) -> PrepareReport {
        let factor_len = match &self.edit.system {
            System::Factor(system) => system.solve_len(),
            System::Iterative(_) => 0,
        };
        PrepareReport { unknowns: self.edit.patch.unknown_count(), factor_len, ..PrepareReport::default() }
    }

    fn step_times(&self) -> StepTimes {
        self.edit.times
    }
}

impl Edit {
    fn new(options: &DualLaplacianOptions, rest: &TriMesh, region: &Region) -> Result<Self, DeformError> {
        let patch = Patch::new(rest, region, RINGS)?;
        let named = |error| DeformError::of_system(error, &patch.vertices);
        let (equations, a) = Equations::new(options, &patch).map_err(named)?;
        let system = System::new(options.solver, a, |v| patch.held[v].is_unknown()).map_err(named)?;
        let is_unknown = |v: &u32| patch.held[*v as usize].is_unknown();
        let at_rim = |v: &u32| !is_unknown(v) && patch.mesh.topology().neighbours(*v as usize).iter().any(is_unknown);
        let (vertices, rows) = (patch.vertices.len(), system.matrix().row_count());
        let scratch = Scratch {
            pose: vec![DVec3::ZERO; vertices],
            dual: vec![DVec3::ZERO; patch.mesh.face_count()],
            x: vec![[0.0; 3]; vertices],
            ax: vec![[0.0; 3]; rows],
            last_ax: vec![[0.0; 3]; rows],
            ..Scratch::default()
        };
        Ok(Self {
            rim: (0..vertices as u32).filter(at_rim).collect(),
            at_rest: equations.at_rest(),
            diagonal: rest.bounds().diagonal() / patch.frame.energy_unit().sqrt(),
            patch,
            equations,
            system,
            scratch,
            times: StepTimes::default(),
        })
    }

    /// Checks the input and brings pose and goals into the frame.
    fn read(&mut self, goals: &Goals, positions: &[DVec3]) -> Result<(), DeformError> {
        let Self { patch, scratch, .. } = self;
        patch.read(goals, positions, &mut scratch.goals)?;
        for (pose, &v) in scratch.pose.iter_mut().zip(&patch.vertices) {
            *pose = patch.frame.enter(positions[v as usize]);
        }
        Ok(())
    }

    /// The first solve and the iterations after it (Luo et al., section 3.3).
    fn iterate(&mut self, options: &DualLaplacianOptions) -> Result<SolveReport, LinalgError> {
        let mut report = SolveReport::default();
        self.times = StepTimes::default();
        self.scratch.b.clone_from(&self.at_rest);
        self.equations.draw_springs(&self.scratch.goals, &mut self.scratch.b);
        self.follow_constraints();
        self.turn_details();
        let mut is_solved = self.solve(true, &mut report)?;
        self.advance(1.0);
        let mut longest = f64::INFINITY;
        while report.iterations < options.iterations {
            self.turn_details();
            is_solved &= self.solve(false, &mut report)?;
            let moved = self.step(&mut longest);
            report.iterations += 1;
            report.converged = is_solved && options.tolerance.is_some_and(|share| moved <= share * self.diagonal);
            if report.converged {
                break;
            }
        }
        Ok(report)
    }

    /// Moves the whole pose along with what holds it, by the rigid motion that takes that nearest to its goals, and what is held there.
    ///
    /// Normals are thus those of the incoming pose, not of a surface that is torn where handles have jumped, and a motion common to all
    /// constraints is met by the first solve, whatever its angle.
    fn follow_constraints(&mut self) {
        let Self { patch, equations, rim, scratch, .. } = self;
        let Scratch { pose, goals, x, .. } = scratch;
        // A spring counts as one in series with a surface of stiffness 1.
        let springs = equations.springs().iter().map(|spring| (spring.vertex, spring.weight / (1.0 + spring.weight)));
        let held = rim.iter().map(|&v| (v, 1.0)).chain(springs);
        let held = held.map(|(v, grip)| (pose[v as usize], goals[v as usize], grip));
        let motion = Fit::rigid(held);
        if motion != Fit::IDENTITY {
            for position in pose.iter_mut() {
                *position = motion.apply(*position);
            }
        }
        for ((x, held), (pose, goal)) in x.iter_mut().zip(&patch.held).zip(pose.iter().zip(&*goals)) {
            *x = if held.is_unknown() { *pose } else { *goal }.into();
        }
    }

    fn turn_details(&mut self) {
        let Self { patch, equations, scratch, times, .. } = self;
        let start = Instant::now();
        equations.turn_details(patch, &scratch.pose, &mut scratch.dual, &mut scratch.b);
        times.local += start.elapsed();
    }

    /// Solves for where the unknowns are to go; whether the solver met its tolerance. Only the first solve of many has a long way.
    fn solve(&mut self, is_first: bool, report: &mut SolveReport) -> Result<bool, LinalgError> {
        let Self { system, scratch, times, .. } = self;
        let start = Instant::now();
        let is_solved = system.solve(is_first, &scratch.b, &mut scratch.x, report)?;
        std::mem::swap(&mut scratch.ax, &mut scratch.last_ax);
        system.matrix().multiply(&scratch.x, &mut scratch.ax)?;
        times.global += start.elapsed();
        Ok(is_solved)
    }

    /// Goes where the last solve says, or so far that the step is not longer than the last one, `longest`; returns how far the vertex
    /// moves that moves farthest.
    ///
    /// A step is as long as what it changes in the rows, `|A dx|`. A solve projects the details on what `A` can make, which
    /// lengthens no change of them; only the turning of normals can. On ordinary edits it does not, and steps get shorter from
    /// the first to the last; where a surface buckles they would grow for a while. No energy falls all the way: normals are not chosen to
    /// lower one.
    fn step(&mut self, longest: &mut f64) -> f64 {
        let length = distance(&self.scratch.ax, &self.scratch.last_ax);
        if length > *longest {
            self.advance(*longest / length)
        } else {
            *longest = length;
            self.advance(1.0)
        }
    }

    /// Moves the pose by a share of the way to the last solution; returns how far the vertex moves that moves farthest.
    fn advance(&mut self, share: f64) -> f64 {
        let Scratch { pose, x, ax, last_ax, .. } = &mut self.scratch;
        if share < 1.0 {
            for (x, &from) in x.iter_mut().zip(&*pose) {
                *x = from.lerp((*x).into(), share).into();
            }
            for (ax, &from) in ax.iter_mut().zip(&*last_ax) {
                *ax = DVec3::from(from).lerp((*ax).into(), share).into();
            }
        }
        let mut farthest = 0.0f64;
        for (pose, &x) in pose.iter_mut().zip(&*x) {
            let to = DVec3::from(x);
            farthest = farthest.max(pose.distance_squared(to));
            *pose = to;
        }
        farthest.sqrt()
    }
}

impl System {
    fn new(solver: LinearSolver, a: SparseRows, is_free: impl FnMut(usize) -> bool) -> Result<Self, LinalgError> {
        let kind = match solver {
            LinearSolver::Cholesky => return Ok(Self::Factor(Box::new(LeastSquares::new(a, is_free)?))),
            LinearSolver::Pcg => Krylov::ConjugateGradient,
            LinearSolver::Pbcg => Krylov::BiConjugateGradient,
        };
        Ok(Self::Iterative(Box::new(IterativeLeastSquares::new(a, is_free, kind)?)))
    }

    fn matrix(&self) -> &SparseRows {
        match self {
            Self::Factor(system) => system.matrix(),
            Self::Iterative(system) => system.matrix(),
        }
    }

    /// Whether the tolerance was met.
    fn solve(
        &mut self,
        is_first: bool,
        b: &[[f64; 3]],
        x: &mut [[f64; 3]],
        report: &mut SolveReport,
    ) -> Result<bool, LinalgError> {
        match self {
            Self::Factor(system) if is_first => system.solve(b, x).map(|()| true),
            Self::Factor(system) => system.refine(b, x).map(|()| true),
            Self::Iterative(system) => {
                let most = (x.len() as u32).saturating_mul(MOST_PER_UNKNOWN);
                let solved = system.solve(b, x, RESIDUAL, most)?;
                let count = report.solver_iterations.get_or_insert(0);
                *count = count.saturating_add(solved.iterations);
                Ok(solved.converged)
            }
        }
    }
}

fn distance(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| DVec3::from(a).distance_squared(b.into())).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use pliant_mesh::{Similarity, VertexSet, shapes};

    use super::*;
    use crate::Handle;

    /// The lengths of steps as the solves want them, before any is shortened, and as they are taken.
    fn steps(mesh: &TriMesh, angle: f64, count: usize) -> (Vec<f64>, Vec<f64>) {
        let (n, bounds) = (mesh.vertex_count(), mesh.bounds());
        let axis = bounds.size().max_position();
        let along = |v: u32| bounds.to_box(mesh.positions[v as usize])[axis];
        let low = Handle::hard(VertexSet::where_true(n, |v| along(v) <= 0.15));
        let high = Handle::hard(VertexSet::where_true(n, |v| along(v) >= 0.85));
        let region = Region::new(n, &VertexSet::all(n), &[low, high]).expect("both ends have vertices");
        let turn = Similarity::about(bounds.centre(), DVec3::new(0.3, 0.2, 1.0), angle, 1.0);
        let goals = Goals::new(vec![Similarity::IDENTITY, turn]);
        let options = DualLaplacianOptions { iterations: 0, ..DualLaplacianOptions::default() };
        let mut edit = Edit::new(&options, mesh, &region).expect("valid");
        edit.read(&goals, &mesh.positions).expect("valid");
        let mut report = edit.iterate(&options).expect("solvable");
        let (mut wanted, mut taken, mut longest) = (Vec::new(), Vec::new(), f64::INFINITY);
        for _ in 0..count {
            edit.turn_details();
            edit.solve(false, &mut report).expect("solvable");
            wanted.push(distance(&edit.scratch.ax, &edit.scratch.last_ax));
            edit.step(&mut longest);
            taken.push(distance(&edit.scratch.ax, &edit.scratch.last_ax));
        }
        (wanted, taken)
    }

    /// By nature on ordinary edits, and by shortening where a tube is bent until it buckles.
    #[test]
    fn steps_never_lengthen() {
        let tube = shapes::cylinder(0.4, 3.0, 20, 40, 4).expect("valid size");
        let ordinary = [
            shapes::bar(24, 4, 4, DVec3::new(4.0, 0.7, 0.7)).expect("valid size"),
            shapes::bumpy_plane(30, 20, 3.0, 2.0, 0.1, 3).expect("valid size"),
            shapes::cactus(1500).expect("in range"),
            shapes::creature(2000).expect("in range"),
        ];
        // Below that, steps are rounding.
        let floor = 1e-13;
        for (mesh, angle) in ordinary.iter().chain([&tube]).flat_map(|m| [(m, 0.3), (m, 0.6)]) {
            let (wanted, _) = steps(mesh, angle, 60);
            for pair in wanted.windows(2) {
                assert!(pair[1] <= pair[0] || pair[1] < floor, "{angle}: {} -> {}", pair[0], pair[1]);
            }
            assert!(wanted[59] < 0.05 * wanted[0], "{angle}: {wanted:?}");
        }
        for mesh in &ordinary {
            let (wanted, taken) = steps(mesh, 2.0, 60);
            assert!(taken.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-12)), "{taken:?}");
            assert!(wanted[59] < 0.05 * wanted[0], "{wanted:?}");
        }
        let (wanted, taken) = steps(&tube, 2.0, 60);
        assert!(wanted.windows(2).any(|pair| pair[1] > pair[0]), "no longer an example: {wanted:?}");
        assert!(taken.windows(2).all(|pair| pair[1] <= pair[0] * (1.0 + 1e-12)), "{taken:?}");
        assert!(wanted[59] < 0.05 * wanted[0], "{wanted:?}");
    }
}
