//! Meshes from files and to files, and pictures of them.
//!
//! [`read`] takes OBJ, PLY, OFF, STL, glTF and GLB to an [`Asset`]: one welded, triangulated
//! [`TriMesh`](pliant_mesh::TriMesh), the map from the file's vertices to its own, and a report of all that was changed or
//! left out. [`write()`] makes OBJ, PLY and GLB. [`picture`] draws a mesh to a PNG without a display.
//!
//! Files are not trusted: whatever one holds, reading it ends in a mesh or in an [`IoError`] that names the file and the
//! line, byte or part at fault, in time and memory bounded by its size. Files are written whole or not at all.
//!
//! This crate knows no cage, no solver and no edit.

mod asset;
mod error;
mod format;
mod gltf;
mod obj;
mod off;
pub mod picture;
mod ply;
mod soup;
mod stl;
mod text;
mod write;

pub use asset::{Asset, ReadReport, read, read_bytes};
pub use error::{IoError, Place};
pub use format::{Format, can_write, can_write_mesh};
pub use pliant_files::{FileError, write_atomic};
pub use write::{write, write_bytes};
