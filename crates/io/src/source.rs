use std::fs::{self, File, FileType};
use std::io::Read;
use std::path::Path;

use crate::IoError;

/// All bytes of a regular file.
///
/// Anything else is refused before it is opened, since opening a pipe may wait for ever and a device may have no end.
pub(crate) fn read_regular(path: &Path) -> Result<Vec<u8>, IoError> {
    let system = |action, source| IoError::System { path: path.to_owned(), action, source };
    let before = fs::metadata(path).map_err(|e| system("open", e))?;
    refuse_irregular(path, before.file_type())?;
    let mut file = File::open(path).map_err(|e| system("open", e))?;
    // What was opened may be another file than what was looked at.
    let opened = file.metadata().map_err(|e| system("read", e))?;
    refuse_irregular(path, opened.file_type())?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| system("read", e))?;
    Ok(bytes)
}

/// An error unless the type is that of a regular file.
pub(crate) fn refuse_irregular(path: &Path, kind: FileType) -> Result<(), IoError> {
    if kind.is_file() {
        return Ok(());
    }
    let what = if kind.is_dir() { "is a folder" } else { "is not a regular file" };
    Err(IoError::Refused { path: path.to_owned(), reason: format!("{what}; only regular files are read and written") })
}
