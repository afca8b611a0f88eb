//! What the defaults are chosen by: edge errors of many bindings over many models, scenes and cage sizes.
//!
//! `scripts/fetch-models`, then `cargo bench --bench quality` (a quarter of an hour); `cargo bench --bench quality -- man.off` takes the
//! models named. Under `cargo test` it takes one small generated model.
//!
//! Three scenes a model: *small* and *large* bend it by 30 and 110 degrees, *limbs* moves the spot that is nearest in space and
//! farthest along the surface away from its counterpart. Each is solved in one jump of 2 iterations, in one of 8, and until converged
//! in four steps. An error is given as the ratio to that of the same solve without a cage, a thousandth added to both so that an
//! undeformed model counts as no gain; a line has the geometric mean over models and scenes of ratios of the root mean square
//! and of the 99th percentile, the worst ratio, the median and largest of the largest edge errors, and the time of the solve as a
//! ratio to that of the direct one.

mod common;

use std::collections::BTreeMap;
use std::error::Error;

use common::{Arguments, arguments, model};
use pliant::glam::DVec3;
use pliant::{
    Acceleration, ArapEnergy, ArapOptions, BindOptions, CageSize, EdgeWeightKind, Iterations, Method, Propagation,
    Scene, Schedule, Silent, StartFrom, Study, SweepRow, SweepSize, TriMesh, select, simplify, vertex_normals,
};

const MODELS: [&str; 14] = [
    "camel.off",
    "bull.off",
    "knot2.off",
    "lion.off",
    "man.off",
    "bear_bis.off",
    "lion-head.off",
    "cheese.off",
    "blade.off",
    "fandisk_large.off",
    "mannequin-devil.off",
    "ChineseDragon-10kv.off",
    "pig.stl",
    "elephant.off",
];

const BINDINGS: [&str; 11] = [
    "smooth:8",
    "smooth:12",
    "smooth:16",
    "smooth:24",
    "smooth:16+smoothing:0",
    "smooth:16+space",
    "smooth:16+tiny:0",
    "smooth:16+tiny:0.05",
    "local:24",
    "local:24+space+smoothing:0",
    "magnitude:0.03",
];

/// The binding that every method is tried with.
const DEFAULT: &str = "smooth:16";

/// Iterations that acceleration can help with, and as many accelerated ones as take about as long.
const MANY: [u32; 2] = [8, 6];

/// Added to an error (root mean square; five times this to a percentile) before ratios are taken.
const FLOOR: f64 = 1e-3;

fn main() -> Result<(), Box<dyn Error>> {
    let Some(Arguments { measured, models, .. }) = arguments("quality") else { return Ok(()) };
    let mut names: Vec<&str> = models.iter().map(String::as_str).collect();
    let mut sizes = vec![0.01, 0.02, 0.05, 0.1];
    if names.is_empty() && measured {
        names.push("creature:8000");
        names.extend(MODELS);
    } else if names.is_empty() {
        (names, sizes) = (vec!["creature:2000"], vec![0.05]);
    }
    let mut table = Table::default();
    for name in names {
        let Some(shape) = model(name)? else { continue };
        for scene in scenes(&shape)? {
            eprintln!("{name}, {}", scene.name);
            measure(name, &shape, &scene, &sizes, &mut table)?;
        }
    }
    table.print();
    Ok(())
}

/// Small and large bends, and limbs that touch.
fn scenes(shape: &TriMesh) -> Result<Vec<Scene>, Box<dyn Error>> {
    let bend = |name: &str, degrees: f64, shift: f64| {
        let mut scene = Scene::auto(&shape.bounds());
        scene.name = name.to_owned();
        if let Some(motion) = scene.handles.last_mut().and_then(|h| h.motion.as_mut()) {
            motion.translate *= shift;
            if let Some(turn) = &mut motion.rotate {
                turn.degrees = degrees;
            }
        }
        scene
    };
    Ok(vec![bend("small", 30.0, 1.0), bend("large", 110.0, 2.5), limbs(shape)?])
}

/// Holds one spot and moves another that faces it across a gap: of all pairs, the one with the longest way along the surface for
/// its distance.
fn limbs(shape: &TriMesh) -> Result<Scene, Box<dyn Error>> {
    let coarse = simplify(shape, &CageSize::Vertices(shape.vertex_count().min(500)).into(), &Silent)?.mesh;
    let normals = vertex_normals(coarse.topology(), &coarse.positions);
    let (bounds, p) = (shape.bounds(), &coarse.positions);
    let diagonal = bounds.diagonal();
    let mut best = (0.0, 0, 0);
    for a in 0..coarse.vertex_count() {
        for (b, normal) in normals.iter().enumerate().skip(a + 1) {
            let (to, straight) = (p[b] - p[a], p[b].distance(p[a]));
            // Facing each other, and nearer than a fifth of the diagonal.
            if straight > 0.2 * diagonal || normals[a].dot(to) < 0.5 * straight || normal.dot(-to) < 0.5 * straight {
                continue;
            }
            let score = |way: f64| way / (straight + 0.01 * diagonal);
            // The ball around `a` grows while it beats the best pair without reaching `b`.
            let mut way = (best.0 * (straight + 0.01 * diagonal)).max(0.15 * diagonal);
            while way < 4.0 * diagonal && !select::geodesic_ball(coarse.topology(), p, a as u32, way).contains(b as u32)
            {
                best = (score(way), a, b);
                way *= 1.1;
            }
        }
    }
    let (_, a, b) = best;
    let away = (p[a] - p[b]).normalize_or(DVec3::X);
    let axis = away.any_orthonormal_vector();
    let near = |q: DVec3| (q - bounds.min) / bounds.size();
    let spot = |q: DVec3| format!("\"region\":{{\"geodesic\":{{\"near\":{},\"radius\":0.04}}}}", list(near(q)));
    let motion = format!(
        "\"motion\":{{\"translate\":{},\"rotate\":{{\"axis\":{},\"degrees\":20}}}}",
        list(0.08 * away),
        list(axis)
    );
    let json = format!(
        "{{\"name\":\"limbs\",\"handles\":[{{\"name\":\"held\",{}}},{{\"name\":\"moved\",{},{motion}}}]}}",
        spot(p[b]),
        spot(p[a])
    );
    Ok(Scene::parse(json.as_bytes(), "limbs")?)
}

fn list(v: DVec3) -> String {
    format!("[{},{},{}]", v.x, v.y, v.z)
}

/// A binding or a solver, and how often the solver iterates.
type Key = (String, String, String);

#[derive(Default)]
struct Table(BTreeMap<Key, Vec<[f64; 4]>>);

/// What is tried on a schedule beside the default, with the schedule it then has.
fn methods(schedule: Schedule) -> Vec<(&'static str, Method, Schedule)> {
    let arap = ArapOptions::default();
    let with = |name, options| (name, Method::Arap(options), schedule);
    let pose = ("starting from the pose", Method::Arap(arap.clone()), Schedule { start: StartFrom::Pose, ..schedule });
    if schedule.iterations == Iterations::Count(MANY[0]) {
        let accelerated = ArapOptions { acceleration: Acceleration::Anderson { window: 5 }, ..arap };
        let fewer = Schedule { iterations: Iterations::Count(MANY[1]), ..schedule };
        return vec![
            pose,
            with("8 accelerated iterations", accelerated.clone()),
            ("6 accelerated iterations", Method::Arap(accelerated), fewer),
        ];
    }
    vec![
        pose,
        with("spokes", ArapOptions { energy: ArapEnergy::Spokes, ..arap.clone() }),
        with("uniform", ArapOptions { weights: EdgeWeightKind::Uniform, ..arap.clone() }),
        with("uniform, spokes", ArapOptions { weights: EdgeWeightKind::Uniform, energy: ArapEnergy::Spokes, ..arap }),
    ]
}

fn measure(name: &str, shape: &TriMesh, scene: &Scene, sizes: &[f64], table: &mut Table) -> Result<(), Box<dyn Error>> {
    let study = match Study::new(name, shape, scene) {
        Ok(study) => study,
        Err(error) => {
            eprintln!("SKIPPED: {name}, {}: {error}", scene.name);
            return Ok(());
        }
    };
    let schedules = [
        ("2 iterations", Schedule { steps: 1, iterations: Iterations::Count(2), start: StartFrom::Levels }),
        ("8 iterations", Schedule { steps: 1, iterations: Iterations::Count(MANY[0]), start: StartFrom::Levels }),
        ("converged", Schedule { steps: 4, iterations: Iterations::Converged, start: StartFrom::Levels }),
    ];
    let none = study.cage(SweepSize::None, &Silent)?;
    let own = study.bind(&none, BindOptions::default(), &Silent)?;
    let mut direct = Vec::new();
    for (named, schedule) in schedules {
        let solve = |method: &Method, schedule| -> Result<SweepRow, Box<dyn Error>> {
            let dragged = study.drag(&none, method, schedule, &Silent)?;
            Ok(study.carry(&none, &own, &dragged, Propagation::Positions, &Silent).1)
        };
        let usual = solve(&Method::default(), schedule)?;
        // Without a cage there are no coarser ones to start from.
        for (what, method, schedule) in methods(schedule).into_iter().filter(|m| m.2.start == StartFrom::Levels) {
            table.put(named, "none", what.to_owned(), &solve(&method, schedule)?, &usual);
        }
        direct.push(usual);
    }
    for &size in sizes {
        let cage = format!("{:>2.0} %", 1e2 * size);
        let caged = study.cage(SweepSize::Cage(CageSize::Fraction(size)), &Silent)?;
        let mut bound = Vec::new();
        for binding in BINDINGS {
            bound.push((binding, study.bind(&caged, binding.parse::<BindOptions>()?, &Silent)?));
        }
        let usually_bound = bound.iter().find(|b| b.0 == DEFAULT).ok_or("the default is not among the bindings")?;
        for ((named, schedule), direct) in schedules.iter().zip(&direct) {
            let usual = study.drag(&caged, &Method::default(), *schedule, &Silent)?;
            for (binding, bound) in &bound {
                let (_, row) = study.carry(&caged, bound, &usual, Propagation::Frames, &Silent);
                table.put(named, &cage, (*binding).to_owned(), &row, direct);
            }
            for (what, method, schedule) in methods(*schedule) {
                let dragged = study.drag(&caged, &method, schedule, &Silent)?;
                let (_, row) = study.carry(&caged, &usually_bound.1, &dragged, Propagation::Frames, &Silent);
                table.put(named, &cage, format!("{DEFAULT}, {what}"), &row, direct);
            }
        }
    }
    Ok(())
}

impl Table {
    fn put(&mut self, schedule: &str, cage: &str, what: String, row: &SweepRow, direct: &SweepRow) {
        self.0.entry((schedule.to_owned(), cage.to_owned(), what)).or_default().push([
            (row.rms_relative + FLOOR) / (direct.rms_relative + FLOOR),
            (row.edge_p99 + 5.0 * FLOOR) / (direct.edge_p99 + 5.0 * FLOOR),
            row.edge_max,
            row.edit_ms() / direct.edit_ms(),
        ]);
    }

    fn print(&self) {
        println!(
            "| solve | cage | binding | rms, ratio | p99, ratio | worst rms ratio | edge max, median | edge max, largest | solve, ratio of times |"
        );
        println!("|---|---|---|---:|---:|---:|---:|---:|---:|");
        for ((schedule, size, what), values) in &self.0 {
            let mean = |k: usize| (values.iter().map(|v| v[k].ln()).sum::<f64>() / values.len() as f64).exp();
            let mut largest: Vec<f64> = values.iter().map(|v| v[2]).collect();
            largest.sort_by(f64::total_cmp);
            let worst = values.iter().map(|v| v[0]).fold(0.0, f64::max);
            println!(
                "| {schedule} | {size} | {what} | {:.3} | {:.3} | {worst:.2} | {:.2} | {:.2} | {:.3} |",
                mean(0),
                mean(1),
                largest[largest.len() / 2],
                largest[largest.len() - 1],
                mean(3),
            );
        }
    }
}
