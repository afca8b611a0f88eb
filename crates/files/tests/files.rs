//! What is read: regular files, and no more of them than is asked for.

use std::fs;

use pliant_files::{FileError, probe, read_regular, write_atomic};

fn message<T>(result: Result<T, FileError>) -> String {
    result.err().expect("this fails").to_string()
}

#[test]
fn a_file_of_just_the_most_bytes_is_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("file");
    probe(&path).expect("a free name in a folder of ours");
    write_atomic(&path, b"12345").expect("written");
    assert_eq!(read_regular(&path, 5).expect("read"), b"12345");
    assert!(message(read_regular(&path, 4)).ends_with("file: has 5 bytes, more than the 4 that are read"));
    write_atomic(&path, b"").expect("written");
    assert_eq!(read_regular(&path, 0).expect("read"), b"");
}

/// Opening a pipe that nobody writes to would wait for ever; a device may never end.
#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused_at_once() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("a command of every Unix");
    assert!(made.success());
    for path in [pipe.as_path(), "/dev/zero".as_ref(), folder.path()] {
        let refusals = [message(read_regular(path, u64::MAX)), message(write_atomic(path, b"x")), message(probe(path))];
        for refusal in refusals {
            assert!(refusal.ends_with("only regular files are read and written"), "{refusal}");
        }
        let writing = |result: Result<(), FileError>| result.err().map(|error| error.is_writing());
        assert_eq!(writing(read_regular(path, u64::MAX).map(drop)), Some(false));
        assert_eq!(writing(write_atomic(path, b"x")), Some(true));
    }
    assert_eq!(fs::read_dir(folder.path()).expect("ours").count(), 1, "nothing but the pipe");
}

/// Files that the system makes up as they are read have a length of 0, and content.
#[cfg(target_os = "linux")]
#[test]
fn a_length_of_0_is_not_believed() {
    let content = read_regular("/proc/self/status".as_ref(), 1 << 20).expect("read");
    assert!(!content.is_empty());
    assert!(message(read_regular("/proc/self/status".as_ref(), 4)).contains("more than the 4"));
}
