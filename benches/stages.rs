//! The stages of an edit, each by itself, on the creature with default options unless named otherwise.
//!
//! `cargo bench --bench stages` runs all (about a minute on two cores), `cargo bench --bench stages -- apply` those whose
//! name contains `apply`. Under `cargo test` each runs once, on small meshes.
//!
//! Times depend on the machine and on what else it does. What means something are ratios within one run: two sizes of
//! one stage (is it linear?), two rules of one pair, a propagation and the copy beside it (how far from the
//! memory's limit?). Each group says what limits its hot loop.

use std::error::Error;
use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, Throughput};
use pliant::glam::{DVec3, Vec3};
use pliant::{
    BindOptions, CageSize, Deformer, FrameFit, Frames, Goals, Handle, Method, Propagation, Propagator, Prune, Region,
    ResolvedScene, Scene, Silent, Simplified, Support, TriMesh, VertexSet, creature, simplify,
};
use rayon::prelude::*;

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_millis(1500))
        .configure_from_args();
    let models = Models::new(if is_measured() { 1 } else { 10 })?;
    simplify_stage(&mut criterion, &models)?;
    bind_stage(&mut criterion, &models)?;
    prepare_stage(&mut criterion, &models)?;
    solve_stage(&mut criterion, &models)?;
    apply_stage(&mut criterion, &models)?;
    criterion.final_summary();
    Ok(())
}

/// Whether cargo wants times, by the same rule as criterion's: otherwise everything only has to work.
fn is_measured() -> bool {
    let has = |flag: &str| std::env::args().any(|a| a == flag);
    has("--bench") && !has("--test")
}

/// The meshes that stages share. Names in reports are the sizes of a measured run.
struct Models {
    shape_20k: TriMesh,
    shape_25k: TriMesh,
    shape_100k: TriMesh,
    /// 5 % of the largest shape.
    cage_5k: Simplified,
    /// A pair small enough for rules that look at every cage face for every vertex: 5,000 and 250 vertices.
    small: (TriMesh, Simplified),
}

impl Models {
    /// All meshes, with a `share`-th of their vertices.
    fn new(share: usize) -> Result<Self, Box<dyn Error>> {
        let shape_100k = creature(100_000 / share)?;
        let small = creature((5_000 / share).max(2_000))?;
        let cage = |shape: &TriMesh| simplify(shape, &CageSize::Fraction(0.05).into(), &Silent);
        Ok(Self {
            shape_20k: creature(20_000 / share)?,
            shape_25k: creature(25_000 / share)?,
            cage_5k: cage(&shape_100k)?,
            small: (small.clone(), cage(&small)?),
            shape_100k,
        })
    }
}

/// Simplification to 5 %, in collapses a second.
///
/// Sequential but for the start: quadrics, fans and first costs, a fifth of the time, are parallel over vertices. A collapse
/// evaluates some 15 quadrics (30 flops each), judges four faces and rewrites six fans, a few thousand instructions on some
/// fifty scattered lines of the cache. What limits it is the latency of the cache or memory that the 400 bytes a vertex fit
/// in, though lines are read ahead for 32 vertices at a time; so a collapse takes longer as shapes outgrow each level.
fn simplify_stage(criterion: &mut Criterion, models: &Models) -> Outcome {
    let mut group = criterion.benchmark_group("simplify");
    for (name, shape) in [("25K to 5 %", &models.shape_25k), ("100K to 5 %", &models.shape_100k)] {
        let options = CageSize::Fraction(0.05).into();
        group.throughput(Throughput::Elements((shape.vertex_count() as f64 * 0.95) as u64));
        group.bench_function(name, |b| b.iter(|| simplify(shape, &options, &Silent).expect("the shape has faces")));
    }
    group.finish();
    Ok(())
}

/// Binding, in rows a second.
///
/// Parallel over cage vertices and rows. The default rule, `smooth`, first finds for each cage vertex which others are near in
/// space but far along the surface, and the nearest 24 over which its motion is averaged; both chase scattered vertices, bound by
/// latency, and are most of its time at this size of cage. `+space` leaves the way along the surface out. `local:24` adds to each row
/// a search for the nearest face and the mean value weights of some 60 faces, three arctangents each: bound by
/// arithmetic. `magnitude` weighs near faces likewise and far ones by clusters, through a tree; `+exact` does every face of
/// the cage, though with only one arctangent an edge, so its ratio to the others on one pair grows with the cage.
fn bind_stage(criterion: &mut Criterion, models: &Models) -> Outcome {
    let mut group = criterion.benchmark_group("bind");
    let default = BindOptions::default();
    let space = BindOptions { support: Support::Space, ..default };
    let (local, paper) = (Prune::Local { neighbours: 24 }.into(), Prune::PAPER.into());
    let exact = BindOptions { exact: true, ..paper };
    let large = (&models.shape_100k, &models.cage_5k);
    let small = (&models.small.0, &models.small.1);
    let pairs = [
        ("100K to 5K", large, &[default, space, local, paper][..]),
        ("5K to 250", small, &[default, local, paper, exact][..]),
    ];
    for (name, (shape, cage), rules) in pairs {
        group.throughput(Throughput::Elements(shape.vertex_count() as u64));
        for options in rules {
            group.bench_function(BenchmarkId::new(options.to_string(), name), |b| {
                b.iter(|| cage.bind(shape, options, &Silent).expect("the cage has faces"));
            });
        }
    }
    group.finish();
    Ok(())
}

/// Assembly and factorisation, in unknowns a second: for a new region of interest, and for other handles in the same one.
///
/// Sequential. The first finds weights, cells, a fill-reducing order and a symbolic factor, which chase scattered indices, bound by
/// latency; both make the numbers of the factor, bound by arithmetic, whose flops grow faster than the unknowns (`n^1.5`
/// on a surface at best). All run over the whole region of interest, handles included. So other handles should take less than half
/// of a new region for the cage, and a growing share as meshes do.
fn prepare_stage(criterion: &mut Criterion, models: &Models) -> Outcome {
    let mut group = criterion.benchmark_group("prepare");
    for (name, mesh) in [("5K cage", &models.cage_5k.mesh), ("20K shape", &models.shape_20k)] {
        let (_, region) = edit(mesh)?;
        let method = Method::default();
        let mut deformer = method.prepare(mesh, &region)?;
        group.throughput(Throughput::Elements(deformer.prepared().unknowns as u64));
        group.bench_function(BenchmarkId::new("region", name), |b| {
            b.iter(|| method.prepare(mesh, &region).expect("prepared before"));
        });
        let fewer = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &region.handles()[1..])?;
        let mut regions = [&fewer, &region];
        group.bench_function(BenchmarkId::new("handles", name), |b| {
            b.iter(|| {
                deformer.set_region(regions[0]).expect("a part of a region that was prepared before");
                regions.swap(0, 1);
            });
        });
    }
    group.finish();
    Ok(())
}

/// One step of a drag, two iterations from the last pose, in unknowns a second.
///
/// A solve does three local and three global steps, as the initial guess takes one of each. A local step is bound by
/// arithmetic, a few hundred flops a cell, eight cells at a time; the right-hand side of a global step by fetching neighbours. Both are
/// shared among threads, for the cage with a gain of a fifth, as waking a thread takes a good part of what it saves. The rest of a
/// global step is sequential and reads the factor twice, 8 to 12 bytes a number; it has some 19 numbers an unknown for the cage and 44 for
/// the shape, which outgrow the near cache. So unknowns a second fall from the one to the other.
fn solve_stage(criterion: &mut Criterion, models: &Models) -> Outcome {
    let mut group = criterion.benchmark_group("solve");
    for (name, mesh) in [("5K cage", &models.cage_5k.mesh), ("25K direct", &models.shape_25k)] {
        let mut drag = Drag::new(mesh)?;
        group.throughput(Throughput::Elements(drag.deformer.prepared().unknowns as u64));
        group.bench_function(name, |b| b.iter(|| drag.step()));
    }
    group.finish();
    Ok(())
}

/// Propagation to single precision, in bytes a second, and a parallel copy of as many bytes.
///
/// The bytes are what has to move once: indices and weights of the rows, the shape's positions at rest, and those written. The copy
/// reads half as many and writes the other half. What belongs to the 5,000 cage vertices stays in a near cache and is not
/// counted. The ratio of throughputs says how far a propagation is from the limit that no program passes: the memory's, or that of
/// a last cache that holds these 9 MB, which is several times as high. Nothing else runs between repeats of either, so each finds
/// its arrays in caches that a solve would have used meanwhile: `scaling` times both after solves.
///
/// Neither way comes near it. Positions do 8 flops a weight on the 16 bytes of a place. Frames do 32 on the 64 of a motion, at
/// the same pace whether or not the motions fit in the nearest cache, so they are bound by instructions; and for each cage vertex
/// they first fit a rotation, which is timed alone, and average some 24 motions.
fn apply_stage(criterion: &mut Criterion, models: &Models) -> Outcome {
    let (shape, cage) = (&models.shape_100k, &models.cage_5k);
    let binding = cage.bind(shape, &BindOptions::default(), &Silent)?;
    let mut drag = Drag::new(&cage.mesh)?;
    drag.step();
    let mut group = criterion.benchmark_group("apply 100K rows");
    group.throughput(Throughput::Bytes(binding.propagated_bytes() as u64));
    let mut positions = vec![Vec3::ZERO; shape.vertex_count()];
    for propagation in [Propagation::Positions, Propagation::Frames] {
        let mut propagator = Propagator::new(propagation);
        group.bench_function(propagation.to_string(), |b| {
            b.iter(|| propagator.apply_f32(&binding, &drag.pose, black_box(&mut positions), None));
        });
    }
    copy(&mut group, "plain copy", binding.propagated_bytes());
    let mut frames = Frames::default();
    group.throughput(Throughput::Elements(cage.mesh.vertex_count() as u64));
    group.bench_function("frames, fitting 5K only", |b| {
        b.iter(|| frames.fit(cage.mesh.topology(), &cage.mesh.positions, black_box(&drag.pose), FrameFit::Rotation));
    });
    group.finish();
    Ok(())
}

/// Moves `bytes` in all: half of them read, half written, by all threads.
fn copy(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, bytes: usize) {
    const CHUNK: usize = 1 << 15;
    let from = vec![1.0; bytes / 2 / size_of::<f64>()];
    let mut to = vec![0.0; from.len()];
    group.bench_function(name, |b| {
        b.iter(|| {
            let chunks = to.par_chunks_mut(CHUNK).zip(black_box(&from).par_chunks(CHUNK));
            chunks.for_each(|(to, from)| to.copy_from_slice(from));
            black_box(&mut to);
        });
    });
}

/// The creature's scene on a mesh of it, of any size.
fn edit(mesh: &TriMesh) -> Result<(ResolvedScene, Region), Box<dyn Error>> {
    let scene = Scene::builtin("creature")?.resolve(mesh)?;
    let handles: Vec<Handle> = scene.handles.iter().map(|h| Handle::hard(h.vertices.clone())).collect();
    let region = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &handles)?;
    Ok((scene, region))
}

/// Handles in the middle of a drag of 20 steps, going back and forth by one step.
struct Drag {
    deformer: Box<dyn Deformer>,
    goals: [Goals; 2],
    pose: Vec<DVec3>,
}

impl Drag {
    fn new(mesh: &TriMesh) -> Result<Self, Box<dyn Error>> {
        let (scene, region) = edit(mesh)?;
        let goals = |step: u32| Goals::new(scene.goals(f64::from(step) / 20.0));
        let mut deformer = Method::default().prepare(mesh, &region)?;
        let mut pose = mesh.positions.clone();
        for step in 1..=10 {
            deformer.solve(&goals(step), &mut pose)?;
        }
        Ok(Self { deformer, goals: [goals(11), goals(10)], pose })
    }

    fn step(&mut self) {
        self.deformer.solve(&self.goals[0], &mut self.pose).expect("solved before");
        self.goals.swap(0, 1);
    }
}
