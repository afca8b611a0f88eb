use super::*;
use crate::report::tests::sweep;
use crate::report::{Failure, NO_CAGE};

/// Rows of one series with these cage sizes and errors.
fn series(points: &[(usize, f64)]) -> Vec<SweepRow> {
    let row = |&(cage_vertices, rms_relative): &(usize, f64)| SweepRow {
        model: "m".to_owned(),
        vertices: 100_000,
        scene: "s".to_owned(),
        cage_asked: cage_vertices.to_string(),
        cage_vertices,
        method: "arap".to_owned(),
        propagation: "frames".to_owned(),
        prune: "local:24".to_owned(),
        start: "pose".to_owned(),
        steps: 20,
        iterations: Some(2),
        rms_relative,
        ..SweepRow::default()
    };
    points.iter().map(row).collect()
}

/// A row without a cage as those of a series are made.
fn no_cage(error: f64) -> SweepRow {
    let none = || NO_CAGE.to_owned();
    let [row] = &series(&[(100_000, error)])[..] else { unreachable!("one point is one row") };
    SweepRow { cage_asked: none(), propagation: none(), prune: none(), start: none(), ..row.clone() }
}

fn knee_of(rows: Vec<SweepRow>, target: KneeTarget) -> Knee {
    let report = SweepReport { rows, ..SweepReport::default() };
    let mut knees = report.find_knees(target);
    assert_eq!(knees.len(), 1);
    knees.remove(0)
}

fn found(rows: Vec<SweepRow>, target: KneeTarget) -> Option<usize> {
    knee_of(rows, target).found.map(|size| size.cage_vertices)
}

/// Curves of random sizes and errors that mostly fall, with some errors that are not finite, in no order.
fn random_points(random: &mut fastrand::Rng) -> Vec<(usize, f64)> {
    let mut points: Vec<(usize, f64)> = (0..random.usize(1..12))
        .map(|_| {
            let size = random.usize(10..50_000);
            let error = match random.usize(0..12) {
                0 => f64::INFINITY,
                1 => f64::NAN,
                _ => random.f64() / (size as f64).sqrt(),
            };
            (size, error)
        })
        .collect();
    points.sort_unstable_by_key(|(size, _)| *size);
    points.dedup_by_key(|(size, _)| *size);
    random.shuffle(&mut points);
    points
}

/// A size is the answer if it and all larger ones are within, and no smaller one is like that; a looser target never asks for more.
#[test]
fn from_the_size_found_on_every_error_is_within() {
    let mut random = fastrand::Rng::with_seed(1);
    let (mut some, mut none, mut odd) = (0, 0, 0);
    for _ in 0..2000 {
        let points = random_points(&mut random);
        let limit = 0.3 * random.f64().powi(4);
        let knee = knee_of(series(&points), KneeTarget::Error(limit));
        let holds_from = |size: usize| points.iter().filter(|p| p.0 >= size).all(|p| p.1 <= limit);
        let answer = knee.found.as_ref().map(|size| size.cage_vertices);
        assert_eq!(answer, points.iter().map(|p| p.0).filter(|&size| holds_from(size)).min());
        let first = points.iter().filter(|p| p.1 <= limit).map(|p| p.0).min();
        assert_eq!(knee.first_within.map(|size| size.cage_vertices), first.filter(|_| first != answer));
        assert_eq!(knee.reason.is_empty(), answer.is_some());
        let looser = found(series(&points), KneeTarget::Error(1.5 * limit));
        assert!(answer.is_none_or(|size| looser.is_some_and(|other| other <= size)));
        // The same said of the error without a cage.
        let mut rows = series(&points);
        rows.insert(random.usize(0..=rows.len()), no_cage(limit / 1.25));
        let beside = knee_of(rows, KneeTarget::NoCage(0.25));
        assert_eq!(beside.no_cage_error, Some(limit / 1.25));
        // (limit / 1.25) * 1.25 may be off by one bit, which no random error meets.
        assert_eq!(beside.found.map(|size| size.cage_vertices), answer);
        *(if answer.is_some() { &mut some } else { &mut none }) += 1;
        odd += usize::from(answer.is_some() && first != answer);
    }
    assert!(some > 200 && none > 200 && odd > 50, "{some} {none} {odd}");
}

#[test]
fn rows_without_figures_count_by_whose_fault_it_is() {
    let points = [(100, 0.2), (200, 0.05), (400, 0.04), (800, 0.03)];
    let target = KneeTarget::Error(0.06);
    let failed = |at: usize, kind| {
        let mut rows = series(&points);
        // As a row stands that was never made.
        let row = SweepRow { cage_vertices: 0, ..rows[at].clone() };
        rows[at] = row.failed(Failure { kind, reason: "because".to_owned() });
        rows
    };
    assert_eq!(found(series(&points), target), Some(200));
    // A solve that blows up at 400 makes 200 no size to rely on; a refusal says nothing.
    assert_eq!(found(failed(2, FailureKind::Numeric), target), Some(800));
    assert_eq!(found(failed(2, FailureKind::Input), target), Some(200));
    assert_eq!(found(failed(3, FailureKind::Numeric), target), None);
    let knee = knee_of(failed(3, FailureKind::Numeric), target);
    assert_eq!(
        knee.to_string(),
        "frames, local:24: none; the largest cage does not meet it, though a smaller one does"
    );
    // 0.4 % of 100,000 is the 400 above; of a size that cannot be told nothing is known.
    let mut rows = failed(2, FailureKind::Numeric);
    "0.4%".clone_into(&mut rows[2].cage_asked);
    assert_eq!(found(rows.clone(), target), Some(800));
    "error:0.01".clone_into(&mut rows[2].cage_asked);
    assert_eq!(found(rows, target), Some(200));
    // Of two rows of one size the worse counts.
    let mut rows = series(&points);
    rows.push(series(&[(200, 0.07)]).remove(0));
    assert_eq!(found(rows, target), Some(400));
    assert_eq!(knee_of(series(&points), KneeTarget::Error(0.01)).reason, "no cage meets 1.00 %");
    // No target is met by what is not finite.
    for limit in [f64::INFINITY, f64::NAN] {
        assert_eq!(found(series(&[(100, f64::INFINITY)]), KneeTarget::Error(limit)), None);
    }
}

#[test]
fn only_the_same_method_and_schedule_without_a_cage_is_compared_with() {
    let points = [(100, 0.2), (200, 0.05), (400, 0.04)];
    let with =
        |direct: SweepRow| knee_of(series(&points).into_iter().chain([direct]).collect(), KneeTarget::NoCage(0.5));
    assert_eq!(with(no_cage(0.04)).found.map(|size| size.cage_vertices), Some(200));
    for other in [
        SweepRow { iterations: None, ..no_cage(0.04) },
        SweepRow { steps: 1, ..no_cage(0.04) },
        SweepRow { method: "implicit".to_owned(), ..no_cage(0.04) },
        SweepRow { scene: "other".to_owned(), ..no_cage(0.04) },
        SweepRow { model: "other".to_owned(), ..no_cage(0.04) },
        no_cage(f64::NAN),
        no_cage(0.04).failed(Failure { kind: FailureKind::Numeric, reason: String::new() }),
    ] {
        let knee = with(other);
        assert_eq!((knee.found, knee.no_cage_error), (None, None));
        assert_eq!(knee.reason, "no row without a cage has the same method and schedule and an error");
    }
}

#[test]
fn series_are_cages_that_differ_in_size_alone() {
    // Both propagations, prune rules and schedules; the rows without a cage are none.
    let mut report = sweep(43_243);
    let names = |report: &SweepReport| -> Vec<String> {
        report.find_knees(KneeTarget::Bend).into_iter().map(|knee| knee.series).collect()
    };
    assert_eq!(names(&report).len(), 8);
    assert_eq!(names(&report)[0], "positions, magnitude:0.03, 20 steps of 2 iterations");
    for asked in ["decimated:3000", "equal-time:5%"] {
        let none = || NO_CAGE.to_owned();
        let cage_asked = asked.to_owned();
        report.rows.push(SweepRow {
            cage_asked,
            propagation: none(),
            prune: none(),
            start: none(),
            ..report.rows[0].clone()
        });
    }
    assert_eq!(names(&report).len(), 8);
    report.rows.push(SweepRow { start: "levels".to_owned(), ..report.rows[0].clone() });
    assert_eq!(
        names(&report).last().map(String::as_str),
        Some("positions, magnitude:0.03, from levels, 20 steps of 2 iterations")
    );
    assert!(SweepReport::default().find_knees(KneeTarget::Bend).is_empty());
}

/// Sizes whose logarithms are evenly spaced over three decades, with an error for each place from 0 to 1.
fn curve(points: usize, error: impl Fn(f64) -> f64) -> Vec<SweepRow> {
    let place = |k: usize| k as f64 / (points - 1) as f64;
    let point = |k: usize| ((100.0 * 1000_f64.powf(place(k))).round() as usize, error(place(k)));
    series(&(0..points).map(point).collect::<Vec<_>>())
}

/// Figure 2 of the paper: `y = -1 / (x + 0.1) + 5` over ten places has its knee at 0.22, the third. Turned over it is a curve of errors.
#[test]
fn the_papers_example_bends_where_the_paper_says() {
    let rows = curve(10, |x| 1.0 / (x + 0.1));
    assert_eq!(found(rows.clone(), KneeTarget::Bend), Some(rows[2].cage_vertices));
}

/// Two straight lines bend where they meet, wherever that is, whatever the units of either axis and in whatever order the rows stand.
#[test]
fn a_bent_line_bends_at_its_corner() {
    let mut random = fastrand::Rng::with_seed(2);
    for points in 5..20_usize {
        for corner in 1..points - 1 {
            let at = corner as f64 / (points - 1) as f64;
            // The height of the corner, below the straight line by twice the mean step where there is room for it.
            let low = 1.0 - at - 2.0 / (points - 1) as f64;
            if low <= 0.0 {
                continue;
            }
            let scale = random.f64() + 0.001;
            let error = |x: f64| if x < at { 1.0 - (1.0 - low) * x / at } else { low * (1.0 - x) / (1.0 - at) };
            let mut rows = curve(points, |x| scale * (1.0 + error(x)));
            let expected = Some(rows[corner].cage_vertices);
            random.shuffle(&mut rows);
            assert_eq!(found(rows.clone(), KneeTarget::Bend), expected, "{corner} of {points}");
            // A factor of all sizes moves a logarithm as a whole.
            rows.iter_mut().for_each(|row| row.cage_vertices *= 7);
            assert_eq!(found(rows, KneeTarget::Bend), expected.map(|size| 7 * size));
        }
    }
}

#[test]
fn what_does_not_bend_has_no_knee_and_says_why() {
    let reason = |rows: Vec<SweepRow>| {
        let knee = knee_of(rows, KneeTarget::Bend);
        assert_eq!(knee.found, None);
        knee.reason
    };
    for points in 3..30 {
        // A straight line, and one that falls ever faster.
        for power in [1, 3] {
            let straight = reason(curve(points, |x| 2.0 - x.powi(power)));
            assert_eq!(straight, "the curve does not bend enough for its number of sizes");
        }
        assert_eq!(reason(curve(points, |x| 1.0 + x)), "the error does not fall with size");
        assert_eq!(reason(curve(points, |_| 0.1)), "the error does not fall with size");
    }
    let few = "fewer than three sizes have an error";
    assert_eq!(reason(curve(2, |x| 1.0 - x)), few);
    assert_eq!(reason(curve(9, |x| if x > 0.2 { f64::INFINITY } else { 1.0 })), few);
}

/// Of two corners the sharper is the knee; a size that blew up is passed over.
#[test]
fn the_sharpest_of_several_knees_is_told() {
    let errors = [1.0, 0.6, 0.59, 0.58, 0.57, 0.56, 0.55, 0.1, 0.09, 0.08, 0.07];
    let mut rows = curve(errors.len(), |x| errors[(x * 10.0).round() as usize]);
    assert_eq!(found(rows.clone(), KneeTarget::Bend), Some(rows[1].cage_vertices));
    rows[3].rms_relative = f64::INFINITY;
    assert_eq!(found(rows.clone(), KneeTarget::Bend), Some(rows[1].cage_vertices));
}

#[test]
fn targets_are_read_as_they_are_written() {
    for (text, target) in [
        ("error:5%", KneeTarget::Error(0.05)),
        ("error:7%", KneeTarget::Error(0.07)),
        ("error:0.5%", KneeTarget::Error(0.005)),
        ("no-cage:10%", KneeTarget::NoCage(0.1)),
        ("no-cage:0%", KneeTarget::NoCage(0.0)),
        ("bend", KneeTarget::Bend),
    ] {
        assert_eq!(text.parse::<KneeTarget>().expect("a target"), target);
        assert_eq!(target.to_string(), text);
    }
    assert_eq!("error:0.05".parse::<KneeTarget>().expect("a fraction"), KneeTarget::Error(0.05));
    for text in ["", "5%", "error:", "error:-1%", "error:NaN", "no-cage:inf", "bend:1", "error:5%%"] {
        let error = text.parse::<KneeTarget>().expect_err("no target").to_string();
        assert!(
            error.starts_with(&format!("`{text}` is not what cage sizes are searched for: use error:5%")),
            "{error}"
        );
    }
}

#[test]
fn what_is_found_is_said_in_every_form() {
    let mut rows = series(&[(100, 0.2), (200, 0.05), (400, 0.06), (800, 0.03)]);
    rows.push(no_cage(0.05));
    let report = SweepReport { rows, ..SweepReport::default() };
    let knees = report.find_knees(KneeTarget::NoCage(0.1));
    assert_eq!(
        knees[0].to_string(),
        "frames, local:24: 800 (800 vertices), RMS relative 3.00 %; a cage of 200 vertices meets it too, but not every larger one"
    );
    let table = Knee::table(&knees);
    let cells: Vec<&str> = table.lines().last().expect("a line").split('|').map(str::trim).collect();
    assert_eq!(
        cells[1..7],
        [
            "frames, local:24",
            "800",
            "800",
            "3.00",
            "5.00",
            "a cage of 200 vertices meets it too, but not every larger one"
        ]
    );
    assert!(table.lines().all(|line| line.matches('|').count() == 7));
    let none = Knee::table(&report.find_knees(KneeTarget::Error(0.01)));
    assert!(none.ends_with("| no cage meets 1.00 % |\n") && !none.contains("no cage (%)"), "{none}");
    let json = serde_json::to_string(&knees).expect("JSON");
    assert_eq!(serde_json::from_str::<Vec<Knee>>(&json).expect("JSON"), knees);
    assert!(json.contains("\"target\":{\"no_cage\":0.1}"), "{json}");
}
