use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::source::refuse_irregular;
use crate::{FileError, WRITE};

/// Writes a file so that at any moment, even after a power cut, it is either the old one or the new one, complete.
///
/// The bytes go to a temporary file in the same folder, which is synchronised with the disk and then takes the path's
/// place. A link is followed: the file it leads to is replaced, not the link. An existing file's permissions are kept.
///
/// # Errors
/// The path is a folder, device or write-protected file, or the system's answer; the temporary file is removed then.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let target = Target::of(path)?;
    let system = |action, source| FileError::System { path: path.to_owned(), action, source };
    let mut temporary = target.temporary().map_err(|e| system(WRITE, e))?;
    temporary.write_all(bytes).map_err(|e| system(WRITE, e))?;
    if let Some(permissions) = target.permissions {
        temporary.as_file().set_permissions(permissions).map_err(|e| system(WRITE, e))?;
    }
    temporary.as_file().sync_all().map_err(|e| system(WRITE, e))?;
    temporary.persist(&target.path).map_err(|e| system(WRITE, e.error))?;
    // The new name lives in the folder, which has to reach the disk as well. Some systems cannot synchronise a folder;
    // the file itself is safe by now.
    if let Ok(folder) = File::open(&target.folder) {
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Whether a file could be written: for use before a long computation whose result should go there.
///
/// Checks that the path is free or a regular file that may be replaced, and that its folder takes a new file (by making one and
/// removing it).
///
/// # Errors
/// What [`write_atomic`] would say.
pub fn probe(path: &Path) -> Result<(), FileError> {
    let probe = Target::of(path)?.temporary();
    probe.map(drop).map_err(|source| FileError::System { path: path.to_owned(), action: WRITE, source })
}

/// Where a file will stand.
struct Target {
    path: PathBuf,
    folder: PathBuf,
    /// Those of the file there now.
    permissions: Option<fs::Permissions>,
}

impl Target {
    fn of(path: &Path) -> Result<Self, FileError> {
        let system = |source| FileError::System { path: path.to_owned(), action: WRITE, source };
        let refused = |reason: String| FileError::Refused { path: path.to_owned(), action: WRITE, reason };
        let (target, permissions) = match fs::metadata(path) {
            Ok(there) => {
                refuse_irregular(path, WRITE, there.file_type())?;
                if there.permissions().readonly() {
                    return Err(refused("is write-protected".to_owned()));
                }
                (path.canonicalize().map_err(system)?, Some(there.permissions()))
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => (path.to_owned(), None),
            Err(e) => return Err(system(e)),
        };
        if target.file_name().is_none() {
            return Err(refused("is not the name of a file".to_owned()));
        }
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        if !folder.is_dir() {
            return Err(refused(format!("the folder {} does not exist", folder.display())));
        }
        Ok(Self { path: target, folder, permissions })
    }

    /// A new file beside the target, removed when dropped.
    fn temporary(&self) -> io::Result<tempfile::NamedTempFile> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".pliant-").suffix(".tmp");
        // A temporary file is private unless told otherwise; this one is to become an ordinary file.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        builder.tempfile_in(&self.folder)
    }
}
