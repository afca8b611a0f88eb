//! Every stage of an edit against the sizes of shape and cage and the number of threads: what grows how, in one run.
//!
//! `cargo bench --bench scaling` takes creatures of 25,000 to 1,000,000 vertices through cages of 1, 2, 5 and 10 %, with 1 and
//! with 2 threads, in some five minutes on two cores; `cargo bench --bench scaling -- 100000` takes other sizes. Under
//! `cargo test` it takes a tiny one. It prints two tables of times and one of their ratios, in Markdown.
//!
//! Times are medians of few repeats, at default options (`pliant bench` makes more, for one pair, on any mesh). Those of
//! different runs should not be compared, nor those of a busy machine, where two threads may be no faster than one: read
//! ratios. Memory is left to `pliant bench`: a process that has timed other pairs keeps some of theirs.

mod common;

use std::error::Error;
use std::time::{Duration, Instant};

use pliant::{CageSize, Scene, Silent, Study, SweepSize, Timing, TimingPlan, count, creature, time_stages};

const SIZES: [usize; 4] = [25_000, 100_000, 400_000, 1_000_000];
const CAGES: [f64; 4] = [0.01, 0.02, 0.05, 0.1];
const SIZE_IN_TESTS: usize = 2_000;
const CAGE_IN_TESTS: f64 = 0.05;

/// Pairs of shape vertices and cage vertices up to which the 3 % rule is also made exactly: some six seconds on two threads.
const EXACT_PAIRS: f64 = 1e8;

/// Vertices up to which drags without a cage are timed too.
const DIRECT_VERTICES: usize = 150_000;

/// Times of one pair with 1 and with 2 threads.
type Pair = [Timing; 2];

fn main() -> Result<(), Box<dyn Error>> {
    let Some(arguments) = common::arguments("scaling") else { return Ok(()) };
    let (sizes, cages, plan) = if arguments.measured {
        let plan = TimingPlan { repeats: 3, drags: 300, patience: Duration::from_secs(1), ..TimingPlan::default() };
        (&SIZES[..], &CAGES[..], plan)
    } else {
        (&[SIZE_IN_TESTS][..], &[CAGE_IN_TESTS][..], TimingPlan { repeats: 1, drags: 2, ..TimingPlan::default() })
    };
    let sizes = if arguments.numbers.is_empty() { sizes } else { &arguments.numbers };
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pools = [pool(1)?, pool(2)?];
    let mut pairs: Vec<Pair> = Vec::new();
    for &size in sizes {
        let start = Instant::now();
        let shape = creature(size)?;
        let made_ms = 1e3 * start.elapsed().as_secs_f64();
        let study = Study::new(format!("creature:{size}"), &shape, &Scene::builtin("creature")?)?;
        for (i, &share) in cages.iter().enumerate() {
            let one = TimingPlan { cage: SweepSize::Cage(CageSize::Fraction(share)), ..plan.clone() };
            let two = TimingPlan {
                exact: share * (size as f64).powi(2) <= EXACT_PAIRS,
                // Once a size: it does not depend on the cage.
                direct: i == 0 && size <= DIRECT_VERTICES,
                ..one.clone()
            };
            let time = |pool: &rayon::ThreadPool, plan: &TimingPlan| {
                pool.install(|| time_stages(&study, plan, made_ms, &Silent))
            };
            pairs.push([time(&pools[0], &one)?, time(&pools[1], &two)?]);
            eprintln!("{} vertices, {:.0} %: {:.1?}", count(size), 1e2 * share, start.elapsed());
        }
    }
    print(&pairs);
    Ok(())
}

fn print(pairs: &[Pair]) {
    let Some([first, _]) = pairs.first() else { return };
    let cpus = std::thread::available_parallelism().map_or(1, usize::from);
    let cpu = first.cpu.as_deref().unwrap_or("unnamed");
    let iterations = first.iterations.unwrap_or(0);
    println!("{cpus} processors, {cpu}. The creature, bound by {}, {iterations} iterations a drag.", first.prune);
    println!(
        "\nOnce an edit, in ms. `refactor` is a change of handles; `first drag` has all from the shape on; `3 %` and `exact` are the \
         paper's rule, the fast way and every cage face for every vertex, by 2 threads.\n"
    );
    table(&["vertices", "cage", "threads", "simplify", "bind", "3 %", "exact", "prepare", "refactor", "first drag"]);
    for t in pairs.iter().flatten() {
        row(&[
            count(t.vertices),
            count(t.cage_vertices),
            t.threads.to_string(),
            digits(t.simplify_ms),
            digits(t.bind_ms),
            or_blank(t.bind_magnitude_ms),
            or_blank(t.bind_exact_ms),
            digits(t.prepare_ms),
            digits(t.refactor_ms),
            digits(t.first_drag_ms - t.read_ms),
        ]);
    }
    println!(
        "\nOnce a frame, in ms. A drag is `local` and `global` steps of a solve from the last pose, and `propagation` by frames to single \
         precision, whose bytes move at `GB/s`; `copy` is how fast a plain copy moves as many, each right after a solve. 99 % of \
         the drags take no longer than `p99`. `ns/weight` is of propagation.\n"
    );
    table(&[
        "vertices",
        "cage",
        "threads",
        "drag",
        "p99",
        "local",
        "global",
        "propagation",
        "ns/weight",
        "GB/s",
        "copy GB/s",
        "drags/s",
    ]);
    for t in pairs.iter().flatten() {
        row(&[
            count(t.vertices),
            count(t.cage_vertices),
            t.threads.to_string(),
            digits(t.drag_ms_median),
            digits(t.drag_ms_p99),
            digits(t.local_ms),
            digits(t.solve_ms),
            digits(t.propagate_ms),
            format!("{:.2}", 1e6 * t.propagate_ms / (t.kept_mean * t.vertices as f64)),
            format!("{:.1}", t.gigabytes_a_second(t.propagate_ms)),
            format!("{:.1}", t.gigabytes_a_second(t.copy_ms)),
            format!("{:.0}", 1e3 / t.drag_ms_median),
        ]);
    }
    print_ratios(pairs);
}

/// Of one pair each, in one line.
fn print_ratios(pairs: &[Pair]) {
    println!(
        "\nRatios. First, 1 thread over 2. `exact` is over the fast way of the same rule, and `direct`, a drag without a cage, over one \
         with it, by 2 threads. `of copy` is the speed of propagation as a share of the copy's, by 1 and by 2.\n"
    );
    table(&[
        "vertices",
        "cage",
        "simplify",
        "bind",
        "drag",
        "propagation",
        "exact",
        "direct",
        "of copy, 1",
        "of copy, 2",
    ]);
    for [one, two] in pairs {
        let times = |ratio: f64| format!("{ratio:.2}");
        let share = |t: &Timing| format!("{:.0} %", 1e2 * t.copy_ms / t.propagate_ms);
        let exact = two.bind_exact_ms.zip(two.bind_magnitude_ms).map(|(exact, fast)| exact / fast);
        // Measured with the first cage of a size.
        let direct = pairs.iter().find(|[_, t]| t.vertices == two.vertices).and_then(|[_, t]| t.direct_drag_ms);
        row(&[
            count(two.vertices),
            count(two.cage_vertices),
            times(one.simplify_ms / two.simplify_ms),
            times(one.bind_ms / two.bind_ms),
            times(one.drag_ms_median / two.drag_ms_median),
            times(one.propagate_ms / two.propagate_ms),
            or_blank(exact),
            or_blank(direct.map(|direct| direct / two.drag_ms_median)),
            share(one),
            share(two),
        ]);
    }
}

fn table(columns: &[&str]) {
    println!("| {} |\n|{}", columns.join(" | "), "---:|".repeat(columns.len()));
}

fn row(cells: &[String]) {
    println!("| {} |", cells.join(" | "));
}

/// Three digits or more.
fn digits(x: f64) -> String {
    match x {
        10_000.0.. => count(x.round() as usize),
        100.0.. => format!("{x:.0}"),
        10.0.. => format!("{x:.1}"),
        1.0.. => format!("{x:.2}"),
        _ => format!("{x:.3}"),
    }
}

fn or_blank(x: Option<f64>) -> String {
    x.map_or(String::new(), digits)
}
