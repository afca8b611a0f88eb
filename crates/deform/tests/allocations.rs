//! A drag allocates nothing.

mod common;

use allocation_counter::measure;
use common::{along_x, sheet, torus};
use glam::DVec3;
use pliant_deform::arap::{Acceleration, Arap, ArapEnergy, ArapOptions, Start};
use pliant_deform::dual::DualLaplacian;
use pliant_deform::laplacian::{Details, Laplacian, LaplacianOptions};
use pliant_deform::rotation_invariant::RotationInvariant;
use pliant_deform::{
    Constraint, Deformer, DualLaplacianOptions, GlobalSolver, Goals, Handle, LinearSolver, PointRows, RefineOptions,
    Refiner, Region, RotationInvariantOptions,
};
use pliant_mesh::{FrameFit, Frames, Similarity, TriMesh, VertexSet};

fn region(mesh: &TriMesh, soft: bool) -> Region {
    let tip = along_x(mesh, 0.9..=1.0);
    let tip = if soft { Handle::soft(tip, 1.0) } else { Handle::hard(tip) };
    let n = mesh.vertex_count();
    Region::new(n, &VertexSet::all(n), &[Handle::hard(along_x(mesh, 0.0..=0.1)), tip]).expect("valid")
}

fn goals(step: u32) -> Goals {
    let lift = Similarity::translation(DVec3::new(0.0, 0.01 * f64::from(step), 0.02 * f64::from(step)));
    Goals::new(vec![Similarity::IDENTITY, lift])
}

/// Small and large, each way of counting cells, with and without a stop rule, and after a change of handles.
#[test]
fn solving_allocates_nothing_from_the_second_time_on() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    for mesh in [sheet(16, 8), torus(90, 40)] {
        for energy in [ArapEnergy::Spokes, ArapEnergy::SpokesAndRims] {
            for (iterations, tolerance, acceleration, smoothness, start) in [
                (2, None, Acceleration::None, 0.0, Start::Pose),
                (2, Some(1e-6), Acceleration::None, 0.0, Start::Propagated),
                (12, None, Acceleration::Anderson { window: 5 }, 0.0, Start::Pose),
                (4, None, Acceleration::Anderson { window: 5 }, 0.01, Start::Pose),
            ] {
                let basis = ArapOptions { energy, iterations, ..ArapOptions::default() };
                let options = ArapOptions { smoothness, tolerance, acceleration, start, ..basis };
                let mut arap = Arap::prepare(&options, &mesh, &region(&mesh, false)).expect("valid");
                let mut pose = mesh.positions.clone();
                for soft in [false, true] {
                    arap.set_region(&region(&mesh, soft)).expect("valid");
                    let all: Vec<Goals> = (0..6).map(goals).collect();
                    arap.solve(&all[0], &mut pose).expect("solvable");
                    let info = pool.install(|| {
                        measure(|| {
                            for goals in &all {
                                arap.solve(goals, &mut pose).expect("solvable");
                            }
                        })
                    });
                    assert_eq!(info.count_total, 0, "{options:?}, soft {soft}");
                }
            }
        }
        let mut frames = Frames::default();
        frames.fit(mesh.topology(), &mesh.positions, &mesh.positions, FrameFit::Similarity);
        let pose: Vec<DVec3> = mesh.positions.iter().map(|p| DVec3::new(p.y, p.z, p.x) * 1.1 + *p).collect();
        let fit = || measure(|| frames.fit(mesh.topology(), &mesh.positions, &pose, FrameFit::Similarity));
        assert_eq!(pool.install(fit).count_total, 0);
    }
}

#[test]
fn rotation_invariant_coordinates_allocate_nothing_from_the_second_time_on() {
    for mesh in [sheet(16, 8), torus(40, 20)] {
        for soft in [false, true] {
            let options = RotationInvariantOptions { coupling: 2, ..RotationInvariantOptions::default() };
            let mut deformer = RotationInvariant::prepare(&options, &mesh, &region(&mesh, soft)).expect("valid");
            let mut pose = mesh.positions.clone();
            let swell = Similarity::about(DVec3::ZERO, DVec3::Y, 0.5, 1.5);
            let all = [goals(0), goals(3), Goals::new(vec![Similarity::IDENTITY, swell])];
            deformer.solve(&all[0], &mut pose).expect("solvable");
            let info = measure(|| {
                for goals in &all {
                    deformer.solve(goals, &mut pose).expect("solvable");
                }
            });
            assert_eq!(info.count_total, 0, "soft {soft}");
        }
    }
}

#[test]
fn laplacian_solves_allocate_nothing_from_the_second_time_on() {
    let mesh = sheet(16, 8);
    for details in [Details::Plain, Details::TwoStep, Details::Similarity, Details::Propagated] {
        let options = LaplacianOptions { details, ..LaplacianOptions::default() };
        for soft in [false, true] {
            let mut laplacian = Laplacian::prepare(&options, &mesh, &region(&mesh, soft)).expect("valid");
            let mut pose = mesh.positions.clone();
            let grown = Similarity::about(DVec3::ONE, DVec3::Z, 0.5, 1.1);
            let all = [goals(1), goals(2), Goals::new(vec![Similarity::IDENTITY, grown])];
            laplacian.solve(&all[0], &mut pose).expect("solvable");
            let info = measure(|| {
                for goals in &all {
                    laplacian.solve(goals, &mut pose).expect("solvable");
                }
            });
            assert_eq!(info.count_total, 0, "{options}, soft {soft}");
        }
    }
}

/// Points hard and soft, whose targets the caller writes into the same goals.
#[test]
fn points_allocate_nothing_from_the_second_time_on() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    let mesh = torus(60, 24);
    let rows: PointRows = mesh.triangles().iter().step_by(9).map(|t| t.map(|v| (v, 1.0 / 3.0))).collect();
    for (constraint, start) in
        [(Constraint::Hard, Start::Pose), (Constraint::Soft(2.0), Start::Pose), (Constraint::Hard, Start::Propagated)]
    {
        let options = ArapOptions {
            iterations: 4,
            start,
            acceleration: Acceleration::Anderson { window: 3 },
            ..ArapOptions::default()
        };
        let handle = Handle::of_points(rows.clone(), constraint);
        let region = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &[handle]).expect("valid");
        let centroids = rows.iter().map(|row| row.iter().map(|&(v, c)| c * mesh.positions[v as usize]).sum());
        let mut goals = Goals::with_points(vec![Similarity::IDENTITY], centroids.collect());
        let mut arap = Arap::prepare(&options, &mesh, &region).expect("valid");
        let mut pose = mesh.positions.clone();
        arap.solve(&goals, &mut pose).expect("solvable");
        let drag = || {
            measure(|| {
                for step in 0..4 {
                    goals.points.iter_mut().for_each(|p| p.z += 0.01 * p.x * f64::from(step));
                    arap.solve(&goals, &mut pose).expect("solvable");
                }
            })
        };
        assert_eq!(pool.install(drag).count_total, 0, "{constraint:?}");
    }
}

/// With several threads the calling one enters the pool once a solve. The queue it enters by is a chain of blocks of a few dozen places
/// each, and a new block is allocated now and then.
#[test]
fn entering_the_pool_of_threads_allocates_rarely() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build_global();
    // Another test may have made it already.
    drop(pool);
    let mesh = torus(90, 40);
    let mut arap = Arap::prepare(&ArapOptions::default(), &mesh, &region(&mesh, false)).expect("valid");
    let mut pose = mesh.positions.clone();
    let all: Vec<Goals> = (0..100).map(|step| goals(step % 7)).collect();
    arap.solve(&all[0], &mut pose).expect("solvable");
    let info = measure(|| {
        for goals in &all {
            arap.solve(goals, &mut pose).expect("solvable");
        }
    });
    assert!(info.count_total <= 10, "{info:?}");
}

/// By each solver, from the second time on.
#[test]
fn the_dual_laplacian_allocates_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    for mesh in [sheet(16, 8), torus(60, 24)] {
        for solver in [LinearSolver::Cholesky, LinearSolver::Pcg, LinearSolver::Pbcg] {
            let options = DualLaplacianOptions { solver, iterations: 3, ..DualLaplacianOptions::default() };
            let mut dual = DualLaplacian::prepare(&options, &mesh, &region(&mesh, true)).expect("valid");
            let mut pose = mesh.positions.clone();
            let all: Vec<Goals> = (0..3).map(goals).collect();
            dual.solve(&all[0], &mut pose).expect("solvable");
            let info = pool.install(|| {
                measure(|| {
                    for goals in &all {
                        dual.solve(goals, &mut pose).expect("solvable");
                    }
                })
            });
            assert_eq!(info.count_total, 0, "{options:?}");
        }
    }
}

/// Steps of either kind, with either solver.
#[test]
fn refinement_steps_allocate_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    for mesh in [sheet(16, 8), torus(90, 40)] {
        for solver in [GlobalSolver::Factor, GlobalSolver::Multigrid] {
            let options = RefineOptions { solver, ..RefineOptions::default() };
            let mut refiner = Refiner::prepare(&mesh, &region(&mesh, true), &options).expect("valid");
            refiner.set_subspace(2, |v| if v % 2 == 0 { (&[0], &[1.0]) } else { (&[1], &[1.0]) }).expect("valid");
            refiner.begin(&goals(3), &mesh.positions).expect("valid");
            let mut pose = mesh.positions.clone();
            refiner.step().expect("finite");
            let next = goals(4);
            let info = pool.install(|| {
                measure(|| {
                    refiner.begin(&next, &pose).expect("valid");
                    for _ in 0..12 {
                        refiner.step().expect("finite");
                        refiner.subspace_step().expect("finite");
                    }
                    refiner.positions(&mut pose).expect("finite");
                })
            });
            assert_eq!(info.count_total, 0, "{solver:?}");
        }
    }
}
