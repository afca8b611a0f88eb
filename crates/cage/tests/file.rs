//! Binding files: what is read is what was written, for the shape it was made for and no other.

mod common;

use std::fs;
use std::path::Path;

use common::{Pair, horseshoe, moved, pairs};
use glam::{DVec3, Vec3};
use pliant_cage::{
    BindOptions, Binding, BindingFault, BindingFileError, CageSize, Fingerprint, Propagation, Propagator, Prune,
    SavedCage, SimplifyOptions, Support, simplify,
};
use pliant_mesh::{Silent, TriMesh, shapes};

/// Every rule, and every other option in one of them.
fn rules() -> Vec<BindOptions> {
    vec![
        Prune::None.into(),
        Prune::PAPER.into(),
        Prune::Local { neighbours: 24 }.into(),
        BindOptions::default(),
        BindOptions { support: Support::Space, smoothing: 0, tiny: 0.0, ..BindOptions::default() },
        BindOptions { support: Support::Rings, ..Prune::Smooth { neighbours: 6 }.into() },
        BindOptions { smoothing: 5, exact: true, ..Prune::PAPER.into() },
    ]
}

fn made(shape: &TriMesh, size: CageSize, options: BindOptions) -> SavedCage {
    let simplify_options: SimplifyOptions = size.into();
    let simplified = simplify(shape, &simplify_options, &Silent).expect("valid");
    let binding = simplified.bind(shape, &options, &Silent).expect("valid");
    SavedCage { binding, options, simplified: Some((simplify_options, simplified)) }
}

fn small() -> (TriMesh, SavedCage) {
    let shape = shapes::icosphere(2);
    let saved = made(&shape, CageSize::Fraction(0.2), BindOptions::default());
    (shape, saved)
}

fn bits(points: &[DVec3]) -> Vec<[u64; 3]> {
    points.iter().map(|p| p.to_array().map(f64::to_bits)).collect()
}

/// All that can be asked of both is the same to the bit, poses in both precisions among it.
fn assert_same(a: &SavedCage, b: &SavedCage, cage: &TriMesh, name: &str) {
    assert_eq!(a.options, b.options, "{name}");
    assert_eq!(a.binding.report(), b.binding.report(), "{name}");
    assert_eq!(a.binding.propagated_bytes(), b.binding.propagated_bytes(), "{name}");
    for i in 0..a.binding.shape_vertex_count() {
        assert_eq!(a.binding.row(i), b.binding.row(i), "{name}, row {i}");
    }
    for j in 0..cage.vertex_count() as u32 {
        assert_eq!(a.binding.smoothing_row(j), b.binding.smoothing_row(j), "{name}, cage vertex {j}");
    }
    match (&a.simplified, &b.simplified) {
        (None, None) => {}
        (Some((options, a)), Some((others, b))) => {
            assert_eq!(options, others, "{name}");
            assert_eq!(bits(&a.mesh.positions), bits(&b.mesh.positions), "{name}");
            assert_eq!(a.mesh.triangles(), b.mesh.triangles(), "{name}");
            assert_eq!((&a.origin, &a.owner, a.report), (&b.origin, &b.owner, b.report), "{name}");
        }
        _ => panic!("{name}: one of them has no origins"),
    }
    let size = cage.bounds().diagonal();
    let bend = |p: &DVec3| *p + 0.2 * size * DVec3::new(0.0, (3.0 * p.x / size).sin(), (2.0 * p.y / size).cos());
    let pose: Vec<DVec3> = cage.positions.iter().map(bend).collect();
    for propagation in [Propagation::Positions, Propagation::Frames] {
        let [x, y] = [a, b].map(|saved| bits(&saved.binding.apply(&pose, propagation)));
        assert!(x == y, "{name}, {propagation}");
        let [x, y] = [a, b].map(|saved| {
            let mut buffers = [vec![Vec3::ZERO; saved.binding.shape_vertex_count()], vec![Vec3::ZERO; 0]];
            buffers[1] = buffers[0].clone();
            let [positions, normals] = &mut buffers;
            Propagator::new(propagation).apply_f32(&saved.binding, &pose, positions, Some(normals));
            buffers.map(|buffer| buffer.iter().map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>())
        });
        assert!(x == y, "{name}, {propagation}, f32");
    }
}

/// Writes, reads, compares, and writes what was read: the same bytes.
fn assert_round_trip(saved: &SavedCage, shape: &TriMesh, cage: &TriMesh, name: &str) {
    let bytes = saved.to_bytes().expect("sound");
    let again = SavedCage::from_bytes(&bytes, shape).expect("whole");
    assert_same(saved, &again, cage, name);
    assert!(again.to_bytes().expect("sound") == bytes, "{name}: other bytes");
    again.require_cage(cage).expect("the same cage");
}

#[test]
fn every_rule_comes_back_with_its_bits() {
    let stray = with_stray();
    let cage = simplify(&stray, &CageSize::Fraction(0.1).into(), &Silent).expect("valid");
    for Pair { name, shape, cage } in pairs().into_iter().chain([Pair { name: "stray vertices", shape: stray, cage }]) {
        for options in rules() {
            let binding = cage.bind(&shape, &options, &Silent).expect("valid");
            let simplified = Some((CageSize::Fraction(0.1).into(), cage.clone()));
            let saved = SavedCage { binding, options, simplified };
            assert_round_trip(&saved, &shape, &cage.mesh, &format!("{name}, {options}"));
        }
    }
    let shape = shapes::icosphere(2);
    for size in [CageSize::Vertices(0), CageSize::Error(0.01), CageSize::Fraction(1.0)] {
        let saved = made(&shape, size, BindOptions::default());
        let cage = saved.simplified.as_ref().expect("made so").1.mesh.clone();
        assert_round_trip(&saved, &shape, &cage, &format!("{size:?}"));
    }
}

/// A sphere and two vertices that no face uses: no cage vertex owns these.
fn with_stray() -> TriMesh {
    let sphere = shapes::icosphere(2);
    let mut positions = sphere.positions.clone();
    positions.extend([DVec3::splat(2.0), DVec3::new(-0.0, 3.0, 0.0)]);
    TriMesh::new(positions, sphere.triangles().to_vec()).expect("valid")
}

/// A binding without simplification: a shape bound to itself, and one bound to a cage from elsewhere.
#[test]
fn bindings_without_origins_come_back_too() {
    let (shape, options) = (horseshoe(), BindOptions::default());
    let itself = SavedCage { binding: Binding::identity(&shape), options, simplified: None };
    assert_round_trip(&itself, &shape, &shape, "itself");
    let cage = moved(&simplify(&shape, &CageSize::Vertices(60).into(), &Silent).expect("valid").mesh, |p| p * 1.1);
    let binding = Binding::new(&shape, &cage, &options, &Silent).expect("valid");
    assert_round_trip(&SavedCage { binding, options, simplified: None }, &shape, &cage, "elsewhere");
}

/// As many threads as there are make the same bytes, and so does one.
#[test]
fn bytes_do_not_depend_on_threads() {
    let (shape, saved) = small();
    let bytes = saved.to_bytes().expect("sound");
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let again = pool.install(|| SavedCage::from_bytes(&bytes, &shape).expect("whole").to_bytes().expect("sound"));
        assert!(again == bytes, "{threads} threads");
    }
}

/// Whether `other` is refused as another mesh, and as one that differs by less than single precision tells.
fn refused(bytes: &[u8], shape: &TriMesh, other: &TriMesh) -> Option<bool> {
    match SavedCage::from_bytes(bytes, other) {
        Ok(_) => None,
        Err(fault @ BindingFault::OtherMesh { rounds_alike, .. }) => {
            let text = fault.to_string();
            for mesh in [shape, other] {
                assert!(text.contains(&Fingerprint::of(mesh).to_string()), "{text}");
            }
            assert_eq!(text.contains("single precision"), rounds_alike);
            Some(rounds_alike)
        }
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn other_meshes_are_refused() {
    let (shape, saved) = small();
    let bytes = saved.to_bytes().expect("sound");
    let (positions, triangles) = (&shape.positions, shape.triangles());
    let mesh = |positions: Vec<DVec3>, triangles: Vec<[u32; 3]>| TriMesh::new(positions, triangles).expect("valid");
    let mut meshes = vec![
        ("other size", shapes::icosphere(1)),
        ("other places", moved(&shape, |p| p * 2.0)),
        ("mirrored", moved(&shape, |p| p * DVec3::new(-1.0, 1.0, 1.0))),
    ];
    let n = positions.len() as u32;
    let reversed = triangles.iter().map(|t| t.map(|v| n - 1 - v)).collect();
    meshes.push(("vertices in another order", mesh(positions.iter().rev().copied().collect(), reversed)));
    let mut changed = triangles.to_vec();
    changed.swap(3, 4);
    meshes.push(("faces in another order", mesh(positions.clone(), changed)));
    let mut changed = triangles.to_vec();
    changed[5].swap(0, 1);
    meshes.push(("a face turned over", mesh(positions.clone(), changed)));
    let mut changed = triangles.to_vec();
    changed[6].rotate_left(1);
    meshes.push(("a face that starts elsewhere", mesh(positions.clone(), changed)));
    meshes.push(("a face less", mesh(positions.clone(), triangles[1..].to_vec())));
    let mut changed = positions.clone();
    changed.push(DVec3::ZERO);
    meshes.push(("a vertex more", mesh(changed, triangles.to_vec())));
    for (name, other) in meshes {
        assert_eq!(refused(&bytes, &shape, &other), Some(false), "{name}");
    }
}

/// By one unit in the last place: of an f64, which no f32 shows, and of an f32. Only the sign of zero makes no other mesh.
#[test]
fn a_vertex_moved_by_the_least_there_is_makes_another_mesh() {
    // Both precisions hold it, with a vertex at a coordinate of 0.
    let shape = moved(&shapes::icosphere(2), |p| p.as_vec3().as_dvec3());
    let bytes = made(&shape, CageSize::Fraction(0.2), BindOptions::default()).to_bytes().expect("sound");
    let mut zeros = 0;
    for v in 0..shape.vertex_count() {
        for axis in 0..3 {
            let x = shape.positions[v][axis];
            let with = |x: f64| {
                let mut other = shape.clone();
                other.positions[v][axis] = x;
                refused(&bytes, &shape, &other)
            };
            assert_eq!(with(x.next_up()), Some(true), "vertex {v}");
            assert_eq!(with(x.next_down()), Some(true), "vertex {v}");
            assert_eq!(with(f64::from((x as f32).next_up())), Some(false), "vertex {v}");
            if x == 0.0 {
                zeros += 1;
                assert_eq!(with(-x), None, "vertex {v}");
            }
        }
    }
    assert!(zeros > 0);
    let rounded = moved(&shapes::icosphere(2), |p| p * (1.0 / 3.0));
    let bytes = made(&rounded, CageSize::Fraction(0.2), BindOptions::default()).to_bytes().expect("sound");
    let single = moved(&rounded, |p| p.as_vec3().as_dvec3());
    assert_eq!(refused(&bytes, &rounded, &single), Some(true), "the same mesh in single precision");
}

#[test]
fn another_cage_is_refused() {
    let (shape, saved) = small();
    let cage = saved.simplified.as_ref().expect("made so").1.mesh.clone();
    let found = saved.require_cage(&moved(&cage, |p| p * 1.01)).expect_err("another cage").to_string();
    assert!(found.starts_with("the binding was made for another cage: "), "{found}");
    assert!(saved.require_cage(&shape).is_err());
    saved.require_cage(&cage).expect("its own");
}

/// The message of what is expected to fail.
fn message<T>(result: Result<T, BindingFileError>) -> String {
    result.err().expect("this fails").to_string()
}

#[test]
fn files_are_whole_and_name_themselves() {
    let (shape, saved) = small();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sphere.pliant");
    let entries = || fs::read_dir(folder.path()).expect("ours").count();
    saved.save(&path).expect("written");
    let again = SavedCage::load(&path, &shape).expect("read");
    again.save(&path).expect("written over");
    assert_eq!(fs::read(&path).expect("there"), saved.to_bytes().expect("sound"));
    assert_eq!(entries(), 1);
    let name = path.display().to_string();
    let other = message(SavedCage::load(&path, &shapes::icosphere(1)));
    assert!(other.starts_with(&format!("{name}: the binding was made for another shape: 162 vertices, 320 faces, ")));
    // A binding that cannot be written leaves the old file.
    let mut broken = again;
    broken.simplified.as_mut().expect("made so").1.owner.pop();
    assert_eq!(message(broken.save(&path)), format!("{name}: the simplified mesh is not the cage of the binding"));
    SavedCage::load(&path, &shape).expect("the old one");
    let bytes = fs::read(&path).expect("there");
    fs::write(&path, &bytes[..1000]).expect("ours");
    assert_eq!(message(SavedCage::load(&path, &shape)), format!("{name}: truncated: 1000 of {} bytes", bytes.len()));
    fs::write(&path, "").expect("ours");
    assert_eq!(message(SavedCage::load(&path, &shape)), format!("{name}: the file is empty"));
    fs::write(&path, "OFF\n0 0 0\n").expect("ours");
    assert_eq!(message(SavedCage::load(&path, &shape)), format!("{name}: this is not a binding file"));
    assert_eq!(entries(), 1);
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let (shape, saved) = small();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let load = |path: &Path| message(SavedCage::load(path, &shape));
    let missing = folder.path().join("missing.pliant");
    assert!(load(&missing).contains("missing.pliant: cannot open: "));
    assert!(load(folder.path()).ends_with("is a folder; only regular files are read and written"));
    assert!(message(saved.save(folder.path())).contains("is a folder"));
    let nowhere = folder.path().join("no/such.pliant");
    assert!(message(saved.save(&nowhere)).contains("such.pliant: the folder"));
    #[cfg(unix)]
    {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let pipe = folder.path().join("pipe.pliant");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("every Unix has it").success());
        for path in [pipe.as_path(), "/dev/zero".as_ref()] {
            assert!(load(path).ends_with("is not a regular file; only regular files are read and written"));
        }
        let circle = folder.path().join("circle.pliant");
        symlink(&circle, &circle).expect("a link");
        assert!(load(&circle).contains("circle.pliant: cannot open: "));
        let closed = folder.path().join("closed.pliant");
        saved.save(&closed).expect("written");
        fs::set_permissions(&closed, fs::Permissions::from_mode(0o000)).expect("ours");
        // Nothing is closed to the superuser.
        if fs::File::open(&closed).is_err() {
            assert!(load(&closed).contains("closed.pliant: cannot open: "));
        }
        assert!(message(saved.save(&closed)).ends_with("is write-protected"));
    }
    // A hole that takes no room on the disk: refused by its length.
    let hole = folder.path().join("hole.pliant");
    fs::File::create(&hole).and_then(|file| file.set_len(SavedCage::MOST_BYTES + 1)).expect("a file with a hole");
    assert!(load(&hole).ends_with("has 4294967297 bytes, more than the 4294967296 that are read"));
}
