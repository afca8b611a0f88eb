//! The file system: what is read, what is overwritten, and what is left behind.

mod common;

use std::fs;
use std::path::Path;

use common::{message, same_bits, sphere};
use pliant_io::{can_write, can_write_mesh, read, write, write_atomic};

fn entries(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .expect("the folder is there")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// The extension decides, in upper or lower case; an unknown or missing one is refused with those that would do.
#[test]
fn extensions() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in ["a.obj", "a.PLY", "a.Obj"] {
        let path = folder.path().join(name);
        write(&path, &sphere(1)).expect("written");
        assert!(same_bits(&read(&path).expect("read").mesh, &sphere(1)), "{name}");
    }
    let found = message(read(Path::new("model.fbx")));
    assert_eq!(found, "model.fbx: cannot read \".fbx\" files; use one of: obj, ply, off, stl, glb, gltf");
    let found = message(write(Path::new("model"), &sphere(0)));
    assert_eq!(found, "model: cannot write a file without an extension; use one of: obj, ply, glb");
    assert!(message(can_write_mesh(Path::new("model.stl"))).starts_with("model.stl: cannot write \".stl\" files"));
}

/// Only regular files are opened: a folder, a device and a pipe are refused at once.
#[test]
fn irregular_files() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("folder.obj");
    fs::create_dir(&path).expect("a folder");
    assert!(message(read(&path)).ends_with("folder.obj: is a folder; only regular files are read and written"));
    assert!(message(write(&path, &sphere(0))).contains("is a folder"));
    assert!(message(can_write_mesh(&path)).contains("is a folder"));
    let missing = folder.path().join("missing.obj");
    assert!(message(read(&missing)).contains("missing.obj: cannot open: "));
    #[cfg(unix)]
    {
        let link = folder.path().join("zero.ply");
        std::os::unix::fs::symlink("/dev/zero", &link).expect("a link");
        assert!(message(read(&link)).contains("zero.ply: is not a regular file"));
        assert!(message(write(&link, &sphere(0))).contains("is not a regular file"));
        let circle = folder.path().join("circle.obj");
        std::os::unix::fs::symlink(&circle, &circle).expect("a link");
        assert!(message(read(&circle)).contains("circle.obj: cannot open: "));
    }
}

/// A message about content names the file and the line.
#[test]
fn content_errors_name_the_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("broken.obj");
    fs::write(&path, "v 0 0 0\nv 1 0\n").expect("a file");
    let expected = format!("{}:2: a vertex needs 3 coordinates, this one has 2", path.display());
    assert_eq!(message(read(&path)), expected);
}

/// A save replaces the whole file and leaves nothing beside it; one that fails leaves the old file as it was.
#[test]
fn saves_are_whole() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("mesh.ply");
    fs::write(&path, "old").expect("a file");
    let mut broken = sphere(0);
    broken.positions[0].x = f64::INFINITY;
    assert!(write(&path, &broken).is_err());
    assert_eq!(fs::read(&path).expect("still there"), b"old");
    write(&path, &sphere(1)).expect("written");
    assert!(same_bits(&read(&path).expect("read").mesh, &sphere(1)));
    write_atomic(&path, b"short").expect("written");
    assert_eq!(fs::read(&path).expect("there"), b"short");
    assert_eq!(entries(folder.path()), ["mesh.ply"]);
}

/// Probing leaves nothing behind, and refuses what writing would.
#[test]
fn probing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("report.json");
    can_write(&path, &["json", "csv"]).expect("a free name in a folder of ours");
    can_write(&path, &[]).expect("any extension");
    assert!(entries(folder.path()).is_empty());
    assert!(message(can_write(&path, &["csv"])).contains("cannot write \".json\" files; use one of: csv"));
    let nowhere = folder.path().join("no/such/folder.obj");
    assert!(message(can_write_mesh(&nowhere)).contains("folder.obj: the folder"));
    fs::write(&path, "kept").expect("a file");
    let mut permissions = fs::metadata(&path).expect("there").permissions();
    permissions.set_readonly(true);
    fs::set_permissions(&path, permissions).expect("ours");
    assert!(message(can_write(&path, &[])).ends_with("report.json: is write-protected"));
    assert!(message(write_atomic(&path, b"new")).ends_with("is write-protected"));
    assert_eq!(fs::read(&path).expect("there"), b"kept");
}

/// A new file has ordinary permissions, an old one keeps its own, and a link still leads to the file that was written.
#[cfg(unix)]
#[test]
fn permissions_and_links() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mode = |path: &Path| fs::metadata(path).expect("there").permissions().mode() & 0o777;
    let ordinary = folder.path().join("ordinary");
    fs::write(&ordinary, "").expect("a file");
    let path = folder.path().join("mesh.obj");
    write(&path, &sphere(0)).expect("written");
    assert_eq!(mode(&path), mode(&ordinary));
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).expect("ours");
    let link = folder.path().join("link.obj");
    std::os::unix::fs::symlink(&path, &link).expect("a link");
    write(&link, &sphere(1)).expect("written");
    assert!(fs::symlink_metadata(&link).expect("there").is_symlink());
    assert_eq!(mode(&path), 0o640);
    assert!(same_bits(&read(&path).expect("read").mesh, &sphere(1)));
}
