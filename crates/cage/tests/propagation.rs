//! Single precision straight into the caller's buffers, against double precision.

mod common;

use common::{Pair, moved, pairs};
use glam::{DVec3, Vec3};
use pliant_cage::{BindOptions, Binding, Propagation, Propagator, Prune};
use pliant_mesh::{FrameFit, NormalBuffer, Silent, Similarity, TriMesh, VertexSet, vertex_normals};

fn bindings(shape: &TriMesh, pair: &Pair) -> Vec<(String, Binding)> {
    ["smooth:12", "smooth:8+smoothing:0", "local:24", "magnitude:0.03", "none"]
        .map(|text| {
            let options: BindOptions = text.parse().expect("options");
            (text.to_owned(), pair.cage.bind(shape, &options, &Silent).expect("valid"))
        })
        .into_iter()
        .chain([("identity".to_owned(), Binding::identity(&pair.cage.mesh))])
        .collect()
}

/// A bend of the cage, larger than any drag's step.
fn bent(cage: &TriMesh) -> Vec<DVec3> {
    let (centre, scale) = cage.bounds().normal_frame();
    let bend = |p: &DVec3| {
        let q = (*p - centre) * scale;
        let turned = glam::DQuat::from_rotation_z(2.0 * q.y) * q + DVec3::X * (0.3 * q.z * q.z);
        turned / scale + centre
    };
    cage.positions.iter().map(bend).collect()
}

#[test]
fn single_precision_is_double_precision_to_rounding() {
    for pair in pairs() {
        let pose = bent(&pair.cage.mesh);
        for (rule, binding) in bindings(&pair.shape, &pair) {
            let n = binding.shape_vertex_count();
            for propagation in [Propagation::Frames, Propagation::Positions] {
                let mut propagator = Propagator::new(propagation);
                let (mut single, mut double) = (vec![Vec3::NAN; n], vec![DVec3::NAN; n]);
                propagator.apply_f32(&binding, &pose, &mut single, None);
                propagator.apply(&binding, &pose, &mut double);
                let off = single.iter().zip(&double).map(|(s, d)| s.as_dvec3().distance(*d)).fold(0.0, f64::max);
                // A dozen roundings of 6e-8 each, of numbers up to the size of the shape, grown by the largest row.
                let bound = 2e-6 * pair.shape.bounds().diagonal() * binding.report().largest_magnitude;
                assert!(off < bound, "{}, {rule}, {propagation}: {off:e} of {bound:e}", pair.name);
            }
        }
    }
}

/// With nothing deformed, frames leave every vertex at its rest position, to the bit.
#[test]
fn rest_gives_rest_rounded() {
    for pair in pairs() {
        for (rule, binding) in bindings(&pair.shape, &pair).into_iter().filter(|b| b.0 != "identity") {
            let mut positions = vec![Vec3::NAN; pair.shape.vertex_count()];
            Propagator::new(Propagation::Frames).apply_f32(&binding, &pair.cage.mesh.positions, &mut positions, None);
            let rest = pair.shape.positions.iter().map(|p| p.as_vec3());
            assert!(positions.iter().copied().eq(rest), "{}, {rule}", pair.name);
        }
    }
}

/// Averaging the cage's motions changes no motion that all of them share.
#[test]
fn smoothed_frames_reproduce_similarities() {
    for pair in pairs() {
        let diagonal = pair.shape.bounds().diagonal();
        let motion = Similarity::about(pair.shape.bounds().min, DVec3::new(0.3, 1.0, 2.0), 1.9, 1.4);
        let pose: Vec<DVec3> = pair.cage.mesh.positions.iter().map(|p| motion.apply(*p)).collect();
        for smoothing in [0, 1, 6, 24, 999] {
            let options = BindOptions { smoothing, ..Prune::Smooth { neighbours: 12 }.into() };
            let binding = pair.cage.bind(&pair.shape, &options, &Silent).expect("valid");
            let mut made = vec![DVec3::NAN; pair.shape.vertex_count()];
            Propagator::new(Propagation::Frames).with_fit(FrameFit::Similarity).apply(&binding, &pose, &mut made);
            for (p, x) in made.iter().zip(&pair.shape.positions) {
                assert!(p.distance(motion.apply(*x)) < 1e-9 * diagonal, "{}, smoothing {smoothing}", pair.name);
            }
        }
    }
}

/// `Propagation::Frames` moves a vertex by what its row and the smoothing rows make of the cage's motions.
#[test]
fn smoothing_is_what_its_rows_say() {
    for pair in pairs() {
        let (shape, cage) = (&pair.shape, &pair.cage.mesh);
        let binding = pair.cage.bind(shape, &BindOptions::default(), &Silent).expect("valid");
        let pose = bent(cage);
        let made = binding.apply(&pose, Propagation::Frames);
        let mut frames = pliant_mesh::Frames::default();
        frames.fit(cage.topology(), &cage.positions, &pose, FrameFit::Rotation);
        for (i, x) in shape.positions.iter().enumerate() {
            let (mut sum, mut total) = (DVec3::ZERO, 0.0);
            for (&j, &w) in binding.row(i).0.iter().zip(binding.row(i).1) {
                let (indices, weights) = binding.smoothing_row(j);
                for (k, v) in indices.into_iter().map(|k| k as usize).zip(weights) {
                    let weight = f64::from(w) * f64::from(v);
                    sum += weight * (pose[k] + frames.matrices[k] * (*x - cage.positions[k]));
                    total += weight;
                }
            }
            // f32 rows sum to 1 up to 1e-7, which the sum here feels and propagation does not.
            let off = made[i].distance(sum / total) / shape.bounds().diagonal();
            assert!(off < 1e-6, "{}, vertex {i}: {off:e}", pair.name);
        }
    }
}

#[test]
fn normals_are_those_of_the_positions_written() {
    for pair in pairs() {
        let (shape, pose) = (&pair.shape, bent(&pair.cage.mesh));
        let binding = pair.cage.bind(shape, &BindOptions::default(), &Silent).expect("valid");
        let n = shape.vertex_count();
        for propagation in [Propagation::Frames, Propagation::Positions] {
            let (mut positions, mut normals) = (vec![Vec3::NAN; n], vec![Vec3::NAN; n]);
            Propagator::new(propagation).apply_f32(&binding, &pose, &mut positions, Some(&mut normals));
            let exact: Vec<DVec3> = positions.iter().map(|p| p.as_dvec3()).collect();
            let expected = vertex_normals(shape.topology(), &exact);
            // Edges are a hundredth of the size of the coordinates whose f32 differences they are, needles less.
            let off = normals.iter().zip(&expected).map(|(n, e)| n.as_dvec3().distance(*e)).fold(0.0, f64::max);
            assert!(off < 1e-3, "{}, {propagation}: {off:e}", pair.name);
        }
    }
    let lone = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z], vec![[0, 1, 2]]).expect("valid");
    let mut normals = vec![Vec3::NAN; 4];
    let positions: Vec<Vec3> = lone.positions.iter().map(|p| p.as_vec3()).collect();
    NormalBuffer::default().compute(lone.topology(), &positions, &mut normals);
    assert_eq!(normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::ZERO]);
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let pairs = pairs();
    let pair = pairs.iter().find(|p| p.name == "creature").expect("there is one");
    let pose = bent(&pair.cage.mesh);
    let made = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let binding = pair.cage.bind(&pair.shape, &BindOptions::default(), &Silent).expect("valid");
            let n = pair.shape.vertex_count();
            let (mut positions, mut normals) = (vec![Vec3::NAN; n], vec![Vec3::NAN; n]);
            Propagator::new(Propagation::Frames).apply_f32(&binding, &pose, &mut positions, Some(&mut normals));
            (positions, normals)
        })
    };
    assert!(made(1) == made(2) && made(1) == made(4));
}

/// More cage vertices than indices of two bytes can number.
#[test]
fn large_cages_have_wide_indices() {
    let cage = pliant_mesh::shapes::plane_grid(300, 230, 3.0, 2.3).expect("valid");
    assert!(cage.vertex_count() > 1 << 16);
    let shape = moved(&pliant_mesh::shapes::plane_grid(40, 30, 2.9, 2.2).expect("valid"), |p| p + DVec3::Z * 1e-3);
    let binding = Binding::new(&shape, &cage, &BindOptions::default(), &Silent).expect("valid");
    let turn = Similarity::about(DVec3::ONE, DVec3::new(1.0, 2.0, 3.0), 1.0, 1.0);
    let pose: Vec<DVec3> = cage.positions.iter().map(|p| turn.apply(*p)).collect();
    for (p, x) in binding.apply(&pose, Propagation::Frames).iter().zip(&shape.positions) {
        assert!(p.distance(turn.apply(*x)) < 1e-9);
    }
}

/// Points carried from any pose stay where the cage stays, follow its rigid motions, and from rest go where `apply` puts them.
#[test]
fn points_are_carried_from_any_pose() {
    for pair in pairs() {
        let diagonal = pair.shape.bounds().diagonal();
        let from = bent(&pair.cage.mesh);
        let motion = Similarity::about(pair.shape.bounds().min, DVec3::new(0.3, 1.0, 2.0), 1.9, 1.0);
        let to: Vec<DVec3> = from.iter().map(|p| motion.apply(*p)).collect();
        for (rule, binding) in bindings(&pair.shape, &pair).into_iter().filter(|b| b.0 != "identity") {
            let mut propagator = Propagator::new(Propagation::Frames);
            let start: Vec<DVec3> = pair.shape.positions.iter().map(|p| *p + 0.01 * diagonal * DVec3::Y).collect();
            let mut points = start.clone();
            propagator.carry(&binding, &from, &from, &mut points);
            assert!(points == start, "{}, {rule}", pair.name);
            propagator.carry(&binding, &from, &to, &mut points);
            for (p, x) in points.iter().zip(&start) {
                // Rotations of rings that a bend has squeezed are found to fewer digits.
                assert!(p.distance(motion.apply(*x)) < 1e-8 * diagonal, "{}, {rule}", pair.name);
            }
            let rounded: Vec<Vec3> = start.iter().map(|p| p.as_vec3()).collect();
            let mut single = vec![Vec3::NAN; start.len()];
            propagator.carry_f32(&binding, &from, &from, &rounded, &mut single);
            assert!(single == rounded, "{}, {rule}", pair.name);
            propagator.carry_f32(&binding, &from, &to, &rounded, &mut single);
            let off = single.iter().zip(&points).map(|(s, p)| s.as_dvec3().distance(*p)).fold(0.0, f64::max);
            // As from rest; the points and where they go are a few times as far from the centre.
            let bound = 5e-6 * diagonal * binding.report().largest_magnitude;
            assert!(off < bound, "{}, {rule}: {off:e} of {bound:e}", pair.name);
            let (mut carried, mut applied) = (pair.shape.positions.clone(), start);
            propagator.carry(&binding, &pair.cage.mesh.positions, &from, &mut carried);
            propagator.apply(&binding, &from, &mut applied);
            assert!(carried == applied, "{}, {rule}", pair.name);
        }
    }
}

/// A part of the shape is carried as it is within the whole, to the bit.
#[test]
fn parts_are_carried_as_the_whole_is() {
    for pair in pairs() {
        let pose = bent(&pair.cage.mesh);
        let some = VertexSet::where_true(pair.shape.vertex_count(), |v| v % 3 == 1);
        for (rule, binding) in bindings(&pair.shape, &pair).into_iter().filter(|b| b.0 != "identity") {
            let mut whole = pair.shape.positions.clone();
            Propagator::new(Propagation::Frames).carry(&binding, &pair.cage.mesh.positions, &pose, &mut whole);
            let mut part: Vec<DVec3> = some.iter().map(|v| pair.shape.positions[v as usize]).collect();
            let mut propagator = Propagator::new(Propagation::Frames);
            propagator.carry(&binding.part(&some), &pair.cage.mesh.positions, &pose, &mut part);
            assert!(some.iter().map(|v| whole[v as usize]).eq(part), "{}, {rule}", pair.name);
        }
    }
}

/// Who moves when one cage vertex does lies within its reach, the ends of which move by the default rule.
#[test]
fn nobody_moves_out_of_reach() {
    for pair in pairs() {
        let (cage, shape) = (&pair.cage.mesh.positions, &pair.shape.positions);
        let step = 0.05 * pair.shape.bounds().diagonal();
        for (rule, binding) in bindings(&pair.shape, &pair).into_iter().filter(|b| b.0 != "identity") {
            let reach = binding.reach();
            let (mut propagator, mut points) = (Propagator::new(Propagation::Frames), shape.clone());
            let (mut tried, mut tight) = (0, 0);
            for j in (0..cage.len()).step_by(1 + cage.len() / 8) {
                let mut pose = cage.clone();
                pose[j] += DVec3::new(0.7, -1.0, 0.4) * step;
                points.copy_from_slice(shape);
                propagator.carry(&binding, cage, &pose, &mut points);
                let moved = |i: &usize| points[*i] != shape[*i];
                let ends = [(0..points.len()).find(moved), (0..points.len()).rev().find(moved)];
                let [Some(first), Some(last)] = ends else { panic!("{}, {rule}: {j} moves nothing", pair.name) };
                assert!(reach[j].start <= first && last < reach[j].end, "{}, {rule}, cage vertex {j}", pair.name);
                tried += 1;
                tight += usize::from(reach[j] == (first..last + 1));
            }
            // Entries that pruning leaves next to nothing move their vertices by less than rounding.
            assert!(rule != "smooth:12" || 10 * tight >= 8 * tried, "{}: {tight} of {tried}", pair.name);
        }
    }
}
