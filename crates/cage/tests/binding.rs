//! What every binding promises: rest gives rest, rigid motions of the cage are rigid motions of the shape, the same bits
//! on every run and for any number of threads.

use glam::DVec3;
use pliant_cage::{BindOptions, Binding, CageSize, Propagation, Propagator, Prune, Support, simplify};
use pliant_mesh::{FrameFit, Silent, Similarity, TriMesh, shapes};

const RULES: [Prune; 5] = [
    Prune::None,
    Prune::PAPER,
    Prune::Local { neighbours: 24 },
    Prune::Local { neighbours: 1 },
    Prune::Smooth { neighbours: 8 },
];

/// Shapes with their cages: closed, open, with several components, tiny.
fn pairs() -> Vec<(&'static str, TriMesh, TriMesh)> {
    let open = shapes::plane_grid(24, 24, 2.0, 2.0).expect("valid");
    let wavy = open
        .with_positions(open.positions.iter().map(|p| DVec3::new(p.x, p.y, 0.2 * (3.0 * p.x).sin())).collect())
        .expect("finite");
    let sphere = shapes::icosphere(3);
    let tiny = sphere.with_positions(sphere.positions.iter().map(|p| *p * 1e-7).collect()).expect("finite");
    [
        ("sphere", sphere),
        ("torus", shapes::torus(1.0, 0.3, 40, 20).expect("valid")),
        ("wavy sheet", wavy),
        ("creature", shapes::creature(2000).expect("valid")),
        ("tiny sphere", tiny),
    ]
    .into_iter()
    .map(|(name, shape)| {
        let cage = simplify(&shape, &CageSize::Fraction(0.1).into(), &Silent).expect("valid").mesh;
        (name, shape, cage)
    })
    .collect()
}

fn bind(shape: &TriMesh, cage: &TriMesh, prune: Prune) -> Binding {
    Binding::new(shape, cage, &prune.into(), &Silent).expect("valid")
}

fn largest_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
    a.iter().zip(b).map(|(p, q)| p.distance(*q)).fold(0.0, f64::max)
}

#[test]
fn frames_map_rest_to_rest_exactly() {
    for (name, shape, cage) in pairs() {
        for prune in RULES {
            let pose = bind(&shape, &cage, prune).apply(&cage.positions, Propagation::Frames);
            assert!(pose == shape.positions, "{name}, {prune}");
        }
    }
}

/// Frames reproduce every rigid motion, and with the similarity fit every similarity, even far away.
#[test]
fn frames_reproduce_common_motions_of_the_cage() {
    for (name, shape, cage) in pairs() {
        let diagonal = shape.bounds().diagonal();
        let pivot = shape.bounds().from_box(DVec3::new(2.0, -1.0, 0.5));
        for (angle, scale, fit) in [
            (2.0, 1.0, FrameFit::Rotation),
            (3.1, 1.0, FrameFit::Similarity),
            (0.4, 1.7, FrameFit::Similarity),
            (0.0, 0.2, FrameFit::Similarity),
        ] {
            let motion = Similarity::about(pivot, DVec3::new(1.0, 2.0, -0.5), angle, scale);
            let cage_pose: Vec<DVec3> = cage.positions.iter().map(|p| motion.apply(*p)).collect();
            let expected: Vec<DVec3> = shape.positions.iter().map(|p| motion.apply(*p)).collect();
            for prune in RULES {
                let binding = bind(&shape, &cage, prune);
                let mut pose = shape.positions.clone();
                Propagator::new(Propagation::Frames).with_fit(fit).apply(&binding, &cage_pose, &mut pose);
                // Rows sum to 1 exactly; what is left is rounding of the frames, grown by the largest row of the paper's rule.
                let error = largest_distance(&pose, &expected) / diagonal;
                assert!(error < 1e-9, "{name}, {prune}, scale {scale}: {error:e}");
            }
        }
    }
}

/// With nothing dropped and a closed cage, positions reproduce even affine maps: linear precision.
#[test]
fn whole_rows_reproduce_affine_maps() {
    let linear =
        glam::DMat3::from_cols(DVec3::new(1.0, 0.2, 0.0), DVec3::new(-0.3, 0.8, 0.1), DVec3::new(0.0, 0.4, 1.5));
    for (name, shape, cage) in pairs().into_iter().filter(|(_, _, cage)| cage.topology().is_closed()) {
        let binding = bind(&shape, &cage, Prune::None);
        assert!(binding.report().linear_precision_error < 1e-9, "{name}");
        let map = |p: &DVec3| linear * *p + DVec3::ONE * shape.bounds().diagonal();
        let cage_pose: Vec<DVec3> = cage.positions.iter().map(map).collect();
        let expected: Vec<DVec3> = shape.positions.iter().map(map).collect();
        let error =
            largest_distance(&binding.apply(&cage_pose, Propagation::Positions), &expected) / shape.bounds().diagonal();
        // f32 weights: 6e-8 each, a few hundred of them.
        assert!(error < 1e-5, "{name}: {error:e}");
    }
}

#[test]
fn rows_sum_to_one_and_lead_with_their_largest_weight() {
    for (name, shape, cage) in pairs() {
        for prune in RULES {
            let binding = bind(&shape, &cage, prune);
            for i in 0..shape.vertex_count() {
                let (indices, weights) = binding.row(i);
                assert!(!indices.is_empty() && indices.len() == weights.len(), "{name}, {prune}");
                let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
                assert!((sum - 1.0).abs() < 1e-5, "{name}, {prune}, row {i}: {sum}");
                assert!(weights[1..].iter().all(|w| *w <= weights[0]), "{name}, {prune}, row {i}");
                assert!(indices[1..].windows(2).all(|w| w[0] < w[1]), "{name}, {prune}, row {i}");
            }
            if let Prune::Local { neighbours } | Prune::Smooth { neighbours } = prune {
                // Along the surface there may be more, trusted in part only.
                let options = BindOptions { support: Support::Space, ..prune.into() };
                let in_space = Binding::new(&shape, &cage, &options, &Silent).expect("valid");
                assert!(in_space.report().kept_max <= neighbours);
                assert_eq!(binding.report().negative_share, 0.0);
            }
        }
    }
}

/// Cage vertices are shape vertices, and by coordinates follow themselves alone: bit for bit where the cage is.
#[test]
fn cage_vertices_follow_the_cage_exactly() {
    let shape = shapes::torus(1.0, 0.3, 40, 20).expect("valid");
    let made = simplify(&shape, &CageSize::Fraction(0.1).into(), &Silent).expect("valid");
    let pose: Vec<DVec3> = made.mesh.positions.iter().map(|p| DVec3::new(p.x * 1.1, p.y + p.x * p.x, p.z)).collect();
    for prune in [Prune::None, Prune::PAPER] {
        for propagation in [Propagation::Frames, Propagation::Positions] {
            let moved = bind(&shape, &made.mesh, prune).apply(&pose, propagation);
            for (j, &v) in made.origin.iter().enumerate() {
                assert!(moved[v as usize] == pose[j], "{prune}, {propagation}, cage vertex {j}");
            }
        }
    }
    let identity = Binding::identity(&shape);
    let pose: Vec<DVec3> = shape.positions.iter().map(|p| *p * 1.3 + DVec3::Y).collect();
    for propagation in [Propagation::Frames, Propagation::Positions] {
        assert!(identity.apply(&pose, propagation) == pose);
    }
}

/// The paper's rule: what is dropped from a row sums to at most 3 % of its magnitude, and no more could be.
#[test]
fn magnitude_rule_drops_what_it_says() {
    let shape = shapes::icosphere(3);
    let cage = simplify(&shape, &CageSize::Fraction(0.15).into(), &Silent).expect("valid").mesh;
    let coordinates = pliant_cage::MeanValue::new(&cage);
    let binding = bind(&shape, &cage, Prune::PAPER);
    let mut row = vec![0.0; cage.vertex_count()];
    for (i, x) in shape.positions.iter().enumerate() {
        assert!(coordinates.coordinates(*x, &mut row));
        let total: f64 = row.iter().map(|c| c.abs()).sum();
        let (kept, weights) = binding.row(i);
        let kept_magnitude: f64 = kept.iter().map(|&j| row[j as usize].abs()).sum();
        let dropped = total - kept_magnitude;
        let smallest = kept.iter().map(|&j| row[j as usize].abs()).fold(f64::INFINITY, f64::min);
        assert!(dropped <= 0.03 * total + 1e-12 && dropped + smallest > 0.03 * total - 1e-12, "row {i}");
        let kept_sum: f64 = kept.iter().map(|&j| row[j as usize]).sum();
        for (&j, &w) in kept.iter().zip(weights) {
            assert!((f64::from(w) - row[j as usize] / kept_sum).abs() < 1e-6, "row {i}");
        }
    }
}

/// The local rule against its definition, from whole rows: a blend of the faded positive part of the coordinates and of
/// distance weights, half of each wherever the nearest vertices hold the coordinates and none is close by.
#[test]
fn local_rows_blend_coordinates_and_distance_weights() {
    for (name, shape, cage) in pairs().into_iter().filter(|(_, _, cage)| cage.topology().is_closed()) {
        let coordinates = pliant_cage::MeanValue::new(&cage);
        let neighbours = 12;
        let options = BindOptions { support: Support::Space, ..Prune::Local { neighbours }.into() };
        let binding = Binding::new(&shape, &cage, &options, &Silent).expect("valid");
        let mut whole = vec![0.0; cage.vertex_count()];
        let mut half = 0;
        for (i, x) in shape.positions.iter().enumerate() {
            assert!(coordinates.coordinates(*x, &mut whole));
            let mut near: Vec<(f64, usize)> =
                cage.positions.iter().enumerate().map(|(j, y)| (y.distance(*x), j)).collect();
            near.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
            let beyond = near[neighbours].0;
            let normalised = |weight: &dyn Fn(f64, usize) -> f64| {
                let mut row = vec![0.0; cage.vertex_count()];
                for &(distance, j) in &near[..neighbours] {
                    row[j] = weight(1.0 - distance / beyond, j);
                }
                let sum: f64 = row.iter().sum();
                row.iter().map(|w| if sum > 0.0 { w / sum } else { 0.0 }).collect::<Vec<f64>>()
            };
            let (local, smooth) = (normalised(&|far, j| whole[j].max(0.0) * far), normalised(&|far, _| far * far));
            let mut made = vec![0.0; cage.vertex_count()];
            let (indices, weights) = binding.row(i);
            for (&j, &w) in indices.iter().zip(weights) {
                made[j as usize] = f64::from(w);
            }
            // The share of coordinates that explains the row best, by least squares.
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            let along: Vec<f64> = local.iter().zip(&smooth).map(|(l, s)| l - s).collect();
            let rest: Vec<f64> = made.iter().zip(&smooth).map(|(m, s)| m - s).collect();
            let square = dot(&along, &along);
            let share = if square > 1e-12 { dot(&rest, &along) / square } else { 0.5 };
            let off = rest.iter().zip(&along).map(|(r, a)| (r - share * a).abs()).fold(0.0, f64::max);
            // What is less than 1/200 of the largest weight is dropped, a few entries, and the others grow by as much.
            assert!(off < 6e-3 && share > -6e-3 && share < 0.55, "{name}, row {i}: {off:e} off at share {share}");
            half += usize::from(share > 0.494);
        }
        assert!(3 * half > shape.vertex_count(), "{name}: {half} rows are half coordinates");
    }
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let shape = shapes::creature(5000).expect("valid");
    let cage = simplify(&shape, &CageSize::Fraction(0.05).into(), &Silent).expect("valid").mesh;
    let pose: Vec<DVec3> = cage.positions.iter().map(|p| DVec3::new(p.x, p.y + 0.3 * p.x * p.x, p.z)).collect();
    for prune in [Prune::PAPER, Prune::default(), Prune::Smooth { neighbours: 24 }] {
        let made: Vec<Vec<DVec3>> = [1, 2, 4]
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                pool.install(|| bind(&shape, &cage, prune).apply(&pose, Propagation::Frames))
            })
            .into();
        assert!(made[0] == made[1] && made[0] == made[2], "{prune}");
    }
}

/// An open cage loses linear precision, says so, and still maps rest to rest by frames.
#[test]
fn open_cages_are_reported() {
    let (_, shape, cage) = pairs().swap_remove(2);
    let binding = bind(&shape, &cage, Prune::PAPER);
    assert!(binding.report().cage_open_edges > 0);
    assert!(binding.report().warnings().iter().any(|w| w.contains("open")), "{:?}", binding.report());
}

/// Two sheets that all but touch, facing away from each other, folded over: coordinates nearly cancel between them.
#[test]
fn unsafe_rows_are_counted_with_advice() {
    // A closed cage turned over itself: its inner half has the opposite orientation, so the normaliser vanishes in places.
    let outer = shapes::icosphere(1);
    let n = outer.vertex_count() as u32;
    let mut positions = outer.positions.clone();
    positions.extend(outer.positions.iter().map(|p| *p * 0.98));
    let mut triangles = outer.triangles().to_vec();
    triangles.extend(outer.triangles().iter().map(|&[a, b, c]| [a + n, c + n, b + n]));
    let cage = TriMesh::new(positions, triangles).expect("valid");
    let shape = shapes::icosphere(3);
    let shape = shape.with_positions(shape.positions.iter().map(|p| *p * 1.6).collect()).expect("finite");
    let report = bind(&shape, &cage, Prune::PAPER).report().clone();
    assert!(report.unsafe_rows > 0 && report.largest_magnitude > 3.0, "{report:?}");
    assert!(report.warnings().iter().any(|w| w.contains("smooth:16")), "{:?}", report.warnings());
    let safe = bind(&shape, &cage, Prune::default()).report().clone();
    assert_eq!(safe.unsafe_rows, 0);
    assert!(safe.largest_magnitude < 1.0 + 1e-5);
}

#[test]
fn bad_options_are_refused() {
    let cage = shapes::icosphere(1);
    for prune in
        [Prune::Magnitude(-0.1), Prune::Magnitude(1.0), Prune::Magnitude(f64::NAN), Prune::Local { neighbours: 0 }]
    {
        assert!(Binding::new(&cage, &cage, &prune.into(), &Silent).is_err(), "{prune}");
    }
    let points = TriMesh::new(vec![DVec3::ZERO; 3], Vec::new()).expect("points are a mesh");
    assert!(Binding::new(&cage, &points, &Prune::default().into(), &Silent).is_err());
}

/// A cage of few vertices, and one on which all vertices are equally near (the middle of a regular cage).
#[test]
fn few_or_equally_near_cage_vertices_do() {
    let tetrahedron = TriMesh::new(
        vec![
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(-1.0, -1.0, 1.0),
        ],
        vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
    )
    .expect("valid");
    let middle = TriMesh::new(vec![DVec3::ZERO, DVec3::X * 0.1, DVec3::Y * 0.1], vec![[0, 1, 2]]).expect("valid");
    for prune in [
        Prune::default(),
        Prune::Local { neighbours: 2 },
        Prune::Smooth { neighbours: 3 },
        Prune::Smooth { neighbours: 900 },
    ] {
        let binding = bind(&middle, &tetrahedron, prune);
        let pose = binding.apply(&tetrahedron.positions, Propagation::Frames);
        assert!(pose == middle.positions, "{prune}");
        assert_eq!(binding.report().replaced_rows, 0, "{prune}");
    }
}

/// Told to stop, both stages stop with an error that says so.
#[test]
fn long_stages_can_be_cancelled() {
    use pliant_cage::CageError;
    use pliant_mesh::Cancellable;
    use std::sync::atomic::{AtomicBool, Ordering};

    let shape = shapes::icosphere(4);
    let made = simplify(&shape, &CageSize::Fraction(0.1).into(), &Silent).expect("valid");
    let cancel = AtomicBool::new(false);
    // From within the first report, as a button would.
    let press = |_: usize, _: usize| cancel.store(true, Ordering::Relaxed);
    let progress = Cancellable::new(&press, &cancel);
    let simplified = simplify(&shape, &CageSize::Fraction(0.1).into(), &progress);
    assert_eq!(simplified.err(), Some(CageError::Cancelled { what: "simplification" }));
    for prune in [Prune::default(), Prune::PAPER] {
        let bound = Binding::new(&shape, &made.mesh, &prune.into(), &progress);
        assert_eq!(bound.err(), Some(CageError::Cancelled { what: "binding" }));
    }
}
