use std::fs::{self, File, FileType};
use std::io::Read;
use std::path::Path;

use crate::{FileError, READ};

/// All bytes of a regular file of at most `most` bytes.
///
/// Anything else is refused before it is opened, since opening a pipe may wait for ever and a device may have no end.
///
/// # Errors
/// The path leads to no regular file or to one that is too large, or the system's answer.
pub fn read_regular(path: &Path, most: u64) -> Result<Vec<u8>, FileError> {
    let system = |action, source| FileError::System { path: path.to_owned(), action, source };
    let before = fs::metadata(path).map_err(|e| system("open", e))?;
    refuse_irregular(path, READ, before.file_type())?;
    let file = File::open(path).map_err(|e| system("open", e))?;
    // What was opened may be another file than what was looked at.
    let opened = file.metadata().map_err(|e| system(READ, e))?;
    refuse_irregular(path, READ, opened.file_type())?;
    let refuse_length = |length: u64| match length > most {
        true => Err(FileError::Refused {
            path: path.to_owned(),
            action: READ,
            reason: format!("has {length} bytes, more than the {most} that are read"),
        }),
        false => Ok(()),
    };
    refuse_length(opened.len())?;
    let mut bytes = Vec::new();
    // The length only says how much room to make: the file may grow, and files of the system's own state have length 0.
    let room = usize::try_from(opened.len()).ok().and_then(|length| bytes.try_reserve_exact(length).ok());
    if room.is_none() {
        return Err(system(READ, std::io::ErrorKind::OutOfMemory.into()));
    }
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| system(READ, e))?;
    refuse_length(bytes.len() as u64)?;
    Ok(bytes)
}

/// An error unless the type is that of a regular file.
pub(crate) fn refuse_irregular(path: &Path, action: &'static str, kind: FileType) -> Result<(), FileError> {
    if kind.is_file() {
        return Ok(());
    }
    let what = if kind.is_dir() { "is a folder" } else { "is not a regular file" };
    Err(FileError::Refused {
        path: path.to_owned(),
        action,
        reason: format!("{what}; only regular files are read and written"),
    })
}
