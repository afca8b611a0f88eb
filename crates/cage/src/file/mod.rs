//! A cage and its binding as a file: a header, then plain little-endian arrays.

mod bytes;
mod error;
mod fingerprint;
mod header;
mod payload;
mod rows;
#[cfg(test)]
mod tests;

use std::path::Path;

use pliant_files::{read_regular, write_atomic};
use pliant_mesh::TriMesh;

pub use error::{BindingFault, BindingFileError, RowFault};
pub use fingerprint::Fingerprint;

use crate::{BindOptions, Binding, Simplified, SimplifyOptions};
use header::Header;

/// A cage with its binding as a file keeps them: whoever opens the same shape again neither simplifies nor binds.
///
/// All comes back with the bits it had: the cage and where it comes from, rows, smoothing rows, options, reports; so every pose
/// propagates to the same bits, too. The shape is not in the file. It is recognised by its [`Fingerprint`] when the file is read, and
/// another one is refused.
///
/// A file keeps what was made, not the way it was made: a later version of this library that reads it may itself make other rows.
///
/// ```
/// use pliant_cage::{BindOptions, SavedCage, SimplifyOptions, simplify};
/// use pliant_mesh::{Silent, shapes};
///
/// let shape = shapes::icosphere(3);
/// let (simplify_options, options) = (SimplifyOptions::default(), BindOptions::default());
/// let simplified = simplify(&shape, &simplify_options, &Silent)?;
/// let binding = simplified.bind(&shape, &options, &Silent)?;
/// let saved = SavedCage { binding, options, simplified: Some((simplify_options, simplified)) };
/// let bytes = saved.to_bytes()?;
///
/// let again = SavedCage::from_bytes(&bytes, &shape)?;
/// assert_eq!(again.binding.row(7), saved.binding.row(7));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SavedCage {
    /// The binding, which knows its cage.
    pub binding: Binding,
    /// What the binding was made with: whoever wants another one has to bind anew.
    pub options: BindOptions,
    /// How the cage was made of the shape, and what with; `None` for a cage that comes from elsewhere.
    pub simplified: Option<(SimplifyOptions, Simplified)>,
}

impl SavedCage {
    /// Extension of binding files, without the dot.
    pub const EXTENSION: &'static str = "pliant";

    /// Binding files of more bytes (4 GiB) are neither written nor read.
    pub const MOST_BYTES: u64 = 1 << 32;

    /// The bytes of a file. 100,000 rows of 14 entries take 12 MB.
    ///
    /// # Errors
    /// A simplified mesh that is not the binding's cage, or a binding too large for a file.
    pub fn to_bytes(&self) -> Result<Vec<u8>, BindingFault> {
        let (flags, payload) = payload::write(self)?;
        let (positions, triangles) = (&self.binding.shape, self.binding.shape_topology.triangles());
        let header = Header {
            flags,
            shape: Fingerprint::exact(positions, triangles),
            rounded: Fingerprint::rounded(positions, triangles).hash,
        };
        let file = header.file(&payload);
        match file.len() as u64 {
            length if length > Self::MOST_BYTES => {
                Err(BindingFault::Value { what: "the length of a binding file (4 GiB)", found: length.to_string() })
            }
            _ => Ok(file),
        }
    }

    /// The cage and binding of a file's bytes, which were made for `shape`.
    ///
    /// The checksum comes before all else that the file says of its content; no more room is made than the bytes that are there
    /// fill; every row is checked. Linear in the number of bytes: 100,000 rows of 14 entries take
    /// some 15 ms of one thread, most of it to lay the rows out as propagation reads them.
    ///
    /// # Errors
    /// Bytes that are no such file or not whole, a file of another version or another shape, and, as files may be forged,
    /// whatever else keeps what they hold from being a cage and its binding.
    pub fn from_bytes(bytes: &[u8], shape: &TriMesh) -> Result<Self, BindingFault> {
        let (header, payload) = Header::read(bytes)?;
        let (found, expected) = (Fingerprint::of(shape), header.shape);
        if found != expected {
            let rounded = Fingerprint::rounded(&shape.positions, shape.triangles());
            let rounds_alike = rounded == Fingerprint { hash: header.rounded, ..expected };
            return Err(BindingFault::OtherMesh { what: "shape", expected, found, rounds_alike });
        }
        payload::read(payload, header.flags, shape)
    }

    /// Refuses a mesh that is not this cage: for a cage that a file of its own holds as well.
    ///
    /// # Errors
    /// [`BindingFault::OtherMesh`].
    pub fn require_cage(&self, cage: &TriMesh) -> Result<(), BindingFault> {
        let (positions, triangles) = (&self.binding.cage, self.binding.cage_topology.triangles());
        let (expected, found) = (Fingerprint::exact(positions, triangles), Fingerprint::of(cage));
        if found == expected {
            return Ok(());
        }
        let rounds_alike =
            Fingerprint::rounded(positions, triangles) == Fingerprint::rounded(&cage.positions, cage.triangles());
        Err(BindingFault::OtherMesh { what: "cage", expected, found, rounds_alike })
    }

    /// Writes a file, whole or not at all: whatever happens, the path holds the old file or the new one.
    ///
    /// # Errors
    /// As [`Self::to_bytes`], and what keeps the file from being written; the old one stays then.
    pub fn save(&self, path: &Path) -> Result<(), BindingFileError> {
        let bytes = self.to_bytes().map_err(|fault| BindingFileError::Content { path: path.to_owned(), fault })?;
        Ok(write_atomic(path, &bytes)?)
    }

    /// Reads a file that was made for `shape`; only regular files are read.
    ///
    /// # Errors
    /// As [`Self::from_bytes`], and what keeps the file from being read.
    pub fn load(path: &Path, shape: &TriMesh) -> Result<Self, BindingFileError> {
        let bytes = read_regular(path, Self::MOST_BYTES)?;
        Self::from_bytes(&bytes, shape).map_err(|fault| BindingFileError::Content { path: path.to_owned(), fault })
    }
}
