//! What the paper shows in its figures, as numbers: lengths and volumes kept, features scaled or not, planes that stay planes.

mod common;

use common::{along_x, distance};
use glam::DVec3;
use pliant_deform::implicit::{FeatureSize, Implicit, ImplicitOptions, ImplicitStage};
use pliant_deform::{Deformer, EdgeWeightKind, Goals, Handle, Region};
use pliant_mesh::metrics::edge_errors;
use pliant_mesh::{Similarity, TriMesh, VertexSet, shapes};

fn along(mesh: &TriMesh) -> TriMesh {
    mesh.with_positions(mesh.positions.iter().map(|p| DVec3::new(p.y, p.z, p.x)).collect()).expect("finite")
}

/// Six times as long as wide, along x.
fn bars() -> Vec<(&'static str, TriMesh)> {
    vec![
        ("bar", shapes::bar(36, 6, 6, DVec3::new(6.0, 1.0, 1.0)).expect("valid")),
        ("cylinder", along(&shapes::cylinder(0.5, 6.0, 20, 40, 3).expect("valid"))),
    ]
}

fn edge_error(mesh: &TriMesh, pose: &[DVec3]) -> f64 {
    edge_errors(mesh.topology(), &mesh.positions, pose).rms_relative
}

fn volume(mesh: &TriMesh, pose: &[DVec3]) -> f64 {
    mesh.with_positions(pose.to_vec()).expect("finite").signed_volume() / mesh.signed_volume()
}

fn solved(options: &ImplicitOptions, mesh: &TriMesh, goals: &Goals) -> Vec<DVec3> {
    let ends = [0.0..=0.1, 0.9..=1.0].map(|range| Handle::hard(along_x(mesh, range)));
    let region = Region::new(mesh.vertex_count(), &VertexSet::all(mesh.vertex_count()), &ends).expect("valid");
    let mut pose = mesh.positions.clone();
    Implicit::prepare(options, mesh, &region).expect("valid").solve(goals, &mut pose).expect("solvable");
    pose
}

/// The far end is turned by `angle` about z to where an arc of the free length leads.
fn arc(mesh: &TriMesh, angle: f64) -> Goals {
    let from = mesh.bounds().from_box(DVec3::new(0.1, 0.5, 0.5));
    let to = mesh.bounds().from_box(DVec3::new(0.9, 0.5, 0.5));
    let radius = (to - from).length() / angle;
    let end = from + radius * DVec3::new(angle.sin(), 1.0 - angle.cos(), 0.0);
    let turn = Similarity::about(to, DVec3::Z, angle, 1.0);
    Goals::new(vec![Similarity::IDENTITY, Similarity { translation: turn.translation + end - to, ..turn }])
}

fn preview() -> ImplicitOptions {
    ImplicitOptions { stage: ImplicitStage::Preview, ..ImplicitOptions::default() }
}

/// Fig. 6 and 5: a bar bent as a whole. An ideal arc changes lengths in the mean by some `angle / 8 / sqrt(2)` on its inner and
/// outer sides; the first system alone shears and shrinks, which the second takes away.
#[test]
fn bars_bend_without_collapsing() {
    for (name, mesh) in bars() {
        for angle in [0.5, 1.0, 1.6, 2.2] {
            let goals = arc(&mesh, angle);
            let pose = solved(&ImplicitOptions::default(), &mesh, &goals);
            let (error, share) = (edge_error(&mesh, &pose), volume(&mesh, &pose));
            assert!(error < 0.06 * angle, "{name}, {angle}: {error}");
            assert!((0.88..1.06).contains(&share), "{name}, {angle}: {share}");
            let sheared = solved(&preview(), &mesh, &goals);
            if angle > 1.0 {
                let (bad, shrunk) = (edge_error(&mesh, &sheared), volume(&mesh, &sheared));
                assert!(bad > 1.1 * error, "{name}, {angle}: {bad} {error}");
                assert!(shrunk < 0.91 * share, "{name}, {angle}: {shrunk} {share}");
            }
        }
    }
}

#[test]
fn bars_twist_without_collapsing() {
    for (name, mesh) in bars() {
        let middle = mesh.bounds().centre();
        let goals =
            |angle: f64| Goals::new(vec![Similarity::IDENTITY, Similarity::about(middle, DVec3::X, angle, 1.0)]);
        for angle in [0.8, 1.6, 2.4] {
            let pose = solved(&ImplicitOptions::default(), &mesh, &goals(angle));
            let (error, share) = (edge_error(&mesh, &pose), volume(&mesh, &pose));
            assert!(error < 0.06 * angle && share > 0.8, "{name}, {angle}: {error} {share}");
            let (bad, shrunk) = {
                let pose = solved(&preview(), &mesh, &goals(angle));
                (edge_error(&mesh, &pose), volume(&mesh, &pose))
            };
            assert!(bad > 1.3 * error && shrunk < share, "{name}, {angle}: {bad} {shrunk}");
        }
    }
}

/// Fig. 7: rotations follow from translations. The cross-section in the middle of a bar with a lifted end leans with the bar.
///
/// In the first system coordinates do not know each other, so that a lift moves nothing sideways and cross-sections stay upright: its
/// gradients are shears, `1` over `tan slope`, whose rotations are some half of the slope. The second system turns them by that.
#[test]
fn a_lifted_end_turns_what_is_between() {
    let (_, mesh) = bars().remove(0);
    let lift = Goals::new(vec![Similarity::IDENTITY, Similarity::translation(DVec3::Y * 3.0)]);
    let slope_and_lean = |pose: &[DVec3]| {
        let line = |x: f64, y: f64| -> DVec3 {
            let near = |v: &usize| (mesh.positions[*v] - DVec3::new(x, y, 0.0)).truncate().length() < 1e-6;
            let all: Vec<DVec3> = (0..pose.len()).filter(near).map(|v| pose[v]).collect();
            all.iter().sum::<DVec3>() / all.len() as f64
        };
        let up = line(0.0, 0.5) - line(0.0, -0.5);
        let forward = line(0.5, 0.5) + line(0.5, -0.5) - line(-0.5, 0.5) - line(-0.5, -0.5);
        (forward.y.atan2(forward.x), (-up.x).atan2(up.y))
    };
    let (slope, lean) = slope_and_lean(&solved(&preview(), &mesh, &lift));
    // Held parallel at both ends, the middle is steeper than the line between them.
    assert!(slope > 0.6 && lean.abs() < 1e-6, "{slope} {lean}");
    let pose = solved(&ImplicitOptions::default(), &mesh, &lift);
    let (slope, lean) = slope_and_lean(&pose);
    assert!(slope > 0.6 && lean > 0.45 * slope && lean < slope, "{slope} {lean}");
    assert!(edge_error(&mesh, &pose) < 0.16, "{}", edge_error(&mesh, &pose));
}

/// Section 4, Fig. 9: features keep their size (Eq. 9) or take that of their surroundings (Eq. 10).
#[test]
fn features_are_kept_or_scaled() {
    let mesh = shapes::bumpy_plane(60, 20, 6.0, 2.0, 0.12, 6).expect("valid size");
    let scale = Similarity::about(DVec3::ZERO, DVec3::Z, 0.0, 2.0);
    let goals = Goals::new(vec![scale; 2]);
    let with = |features: FeatureSize, goals: &Goals| {
        solved(&ImplicitOptions { features, ..ImplicitOptions::default() }, &mesh, goals)
    };
    let height = |pose: &[DVec3]| {
        // Of the bumps in the middle over the dips beside them.
        let z = |p: &&DVec3| p.x.abs() < 1.5 && p.y.abs() < 1.0;
        let all: Vec<f64> = pose.iter().filter(z).map(|p| p.z).collect();
        all.iter().copied().fold(f64::MIN, f64::max) - all.iter().copied().fold(f64::MAX, f64::min)
    };
    let rest = height(&mesh.positions);
    let [keep, scaled] = [FeatureSize::Keep, FeatureSize::Scale].map(|features| with(features, &goals));
    assert!((height(&scaled) / rest - 2.0).abs() < 0.2, "{}", height(&scaled) / rest);
    assert!(distance(&scaled, &mesh.positions.iter().map(|p| *p * 2.0).collect::<Vec<_>>()) < 1e-10);
    assert!(height(&keep) < 0.75 * height(&scaled), "{} {}", height(&keep), height(&scaled));
    // By default as the goals have it.
    assert!(with(FeatureSize::Auto, &goals) == scaled);
    let rigid = arc(&mesh, 0.8);
    assert!(with(FeatureSize::Auto, &rigid) == with(FeatureSize::Keep, &rigid));
    assert!(with(FeatureSize::Auto, &rigid) != with(FeatureSize::Scale, &rigid));
}

/// More rings suppress deformation in detail (section 4, footnote): lengths are kept a little better, by a few percent in all.
#[test]
fn more_rings_smooth_a_little() {
    let (_, mesh) = bars().remove(1);
    let twist = Similarity::about(mesh.bounds().centre(), DVec3::X, 1.6, 1.0);
    for goals in [arc(&mesh, 1.6), Goals::new(vec![Similarity::IDENTITY, twist])] {
        let error = |rings: u32| {
            let options = ImplicitOptions { rings, ..ImplicitOptions::default() };
            edge_error(&mesh, &solved(&options, &mesh, &goals))
        };
        let errors = [1, 2, 3, 5].map(error);
        assert!(errors.is_sorted_by(|a, b| a > b) && errors[3] > 0.9 * errors[0], "{errors:?}");
    }
}

/// A plane, of which every vertex is degenerate, stays one in the plane and deforms as a sheet does that is not quite flat, up to the two
/// errors of section 3.3, which are less with cotangent weights.
#[test]
fn a_plane_deforms_like_a_sheet_that_is_nearly_flat() {
    let plane = shapes::plane_grid(24, 10, 4.0, 1.6).expect("valid size");
    // Shallow enough to be degenerate nowhere, but for a few.
    let sheet = shapes::bumpy_plane(24, 10, 4.0, 1.6, 0.04, 5).expect("valid size");
    let inner =
        Goals::new(vec![Similarity::IDENTITY, Similarity::about(DVec3::new(2.0, 0.0, 0.0), DVec3::Z, 0.5, 1.0)]);
    for weights in [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform] {
        for stage in [ImplicitStage::Preview, ImplicitStage::Full] {
            let options = ImplicitOptions { weights, stage, ..ImplicitOptions::default() };
            let pose = solved(&options, &plane, &inner);
            let off = pose.iter().map(|p| p.z.abs()).fold(0.0, f64::max);
            // Coordinates are apart in the first system. Displacements favour one side of the plane, and gradients of displaced
            // vertices lean where these are crowded, which the second system follows (the first error of section 3.3).
            let most = if stage == ImplicitStage::Preview { 1e-12 } else { 0.01 * plane.bounds().diagonal() };
            assert!(off < most, "{options}: {off:e}");
            assert!(distance(&pose, &plane.positions) > 0.3);
        }
    }
    let turn = Similarity::about(DVec3::new(1.6, 0.0, 0.0), DVec3::Y, -0.9, 1.0);
    let goals = Goals::new(vec![
        Similarity::IDENTITY,
        Similarity { translation: turn.translation + DVec3::new(-0.3, 0.0, 0.8), ..turn },
    ]);
    for stage in [ImplicitStage::Preview, ImplicitStage::Full] {
        let off = |weights: EdgeWeightKind| {
            let options = ImplicitOptions { weights, stage, ..ImplicitOptions::default() };
            let [flat, bumpy] = [&plane, &sheet].map(|mesh| solved(&options, mesh, &goals));
            let bumps = distance(&plane.positions, &sheet.positions);
            assert!(bumps > 0.03, "{bumps}");
            distance(&flat, &bumpy) / plane.bounds().diagonal()
        };
        let [cotangent, uniform] = [EdgeWeightKind::Cotangent, EdgeWeightKind::Uniform].map(off);
        assert!(cotangent < 0.05 && uniform < 0.08, "{stage:?}: {cotangent} {uniform}");
    }
}

/// A second edit continues the first: what is fixed now stands where the first left it, and its rings say how it is turned.
#[test]
fn an_edit_goes_on_from_what_another_left() {
    let (_, mesh) = bars().remove(0);
    let n = mesh.vertex_count();
    let ends = [0.0..=0.1, 0.8..=1.0].map(|range| Handle::hard(along_x(&mesh, range)));
    let region = Region::new(n, &VertexSet::all(n), &ends).expect("valid");
    let mut pose = mesh.positions.clone();
    let mut implicit = Implicit::prepare(&ImplicitOptions::default(), &mesh, &region).expect("valid");
    implicit.solve(&arc(&mesh, 1.2), &mut pose).expect("solvable");
    let before = pose.clone();
    // The tip alone is free: it is held by vertices that were moved rigidly, and so was the tip, so nothing changes.
    let region = Region::new(n, &along_x(&mesh, 0.95..=1.0), &[]).expect("valid");
    let mut implicit = Implicit::prepare(&ImplicitOptions::default(), &mesh, &region).expect("valid");
    implicit.solve(&Goals::default(), &mut pose).expect("solvable");
    assert!(distance(&pose, &before) < 1e-9, "{:e}", distance(&pose, &before));
    // A band in the bent middle is filled in again from its sides; it comes back to where it was but for a hundredth of the bar.
    let region = Region::new(n, &along_x(&mesh, 0.42..=0.58), &[]).expect("valid");
    let mut implicit = Implicit::prepare(&ImplicitOptions::default(), &mesh, &region).expect("valid");
    implicit.solve(&Goals::default(), &mut pose).expect("solvable");
    assert!(distance(&pose, &before) > 1e-6 && distance(&pose, &before) < 0.06, "{}", distance(&pose, &before));
}

/// Limits (section 6): a turn beyond pi is reached the other way round, so that one of 3/2 pi is one of -pi/2.
#[test]
fn turns_beyond_pi_are_taken_the_shorter_way() {
    let (_, mesh) = bars().remove(1);
    let middle = mesh.bounds().centre();
    let twist = |angle: f64| {
        let goals = Goals::new(vec![Similarity::IDENTITY, Similarity::about(middle, DVec3::X, angle, 1.0)]);
        solved(&ImplicitOptions::default(), &mesh, &goals)
    };
    let (far, near) = (twist(1.5 * std::f64::consts::PI), twist(-0.5 * std::f64::consts::PI));
    assert!(distance(&far, &near) < 1e-10);
}
