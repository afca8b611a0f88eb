//! What every binding file starts with.
//!
//! | bytes | what |
//! |---|---|
//! | 0..8 | [`MAGIC`] |
//! | 8..12 | [`ORDER`] |
//! | 12..16 | [`VERSION`] |
//! | 16..20 | flags: [`SIMPLIFIED`], [`SMOOTHED`] |
//! | 20..60 | the shape: vertices and faces (u32 each), its fingerprint's hash (u128), and that of the shape rounded to f32 (u128) |
//! | 60..68 | length of what follows the header |
//! | 68..76 | XXH3 of all bytes but these eight |

use std::hash::Hasher;

use twox_hash::XxHash3_64;

use super::{BindingFault, Fingerprint};

/// Not text, and broken by whatever changes the ends of lines or strips the eighth bit.
pub(super) const MAGIC: [u8; 8] = *b"\x89PLIANT\n";

/// Says that numbers are little endian.
pub(super) const ORDER: u32 = 0x0403_0201;

/// The version that is written, and the only one that is read.
pub(super) const VERSION: u32 = 1;

/// A flag: the cage was made by simplification, which is told about.
pub(super) const SIMPLIFIED: u32 = 1;

/// A flag: there are smoothing rows.
pub(super) const SMOOTHED: u32 = 2;

pub(super) const LENGTH: usize = 76;

/// Where the checksum stands; it ends the header.
const CHECKSUM: usize = LENGTH - 8;

/// The header's meaning, but for what is the same in all files.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Header {
    pub(super) flags: u32,
    pub(super) shape: Fingerprint,
    /// Hash of [`Fingerprint::rounded`].
    pub(super) rounded: u128,
}

impl Header {
    /// A file of what is to follow the header.
    pub(super) fn file(&self, payload: &[u8]) -> Vec<u8> {
        let mut file = Vec::with_capacity(LENGTH + payload.len());
        file.extend_from_slice(&MAGIC);
        for number in [ORDER, VERSION, self.flags, self.shape.vertices, self.shape.faces] {
            file.extend_from_slice(&number.to_le_bytes());
        }
        for hash in [self.shape.hash, self.rounded] {
            file.extend_from_slice(&hash.to_le_bytes());
        }
        file.extend_from_slice(&(payload.len() as u64).to_le_bytes());
        let sum = checksum(&file, payload);
        file.extend_from_slice(&sum.to_le_bytes());
        file.extend_from_slice(payload);
        file
    }

    /// The header of a file and what follows it, undamaged.
    pub(super) fn read(file: &[u8]) -> Result<(Self, &[u8]), BindingFault> {
        if file.is_empty() {
            return Err(BindingFault::Empty);
        }
        if !file.starts_with(&MAGIC[..MAGIC.len().min(file.len())]) {
            return Err(BindingFault::NotABinding);
        }
        let found = file.len() as u64;
        let Some((header, payload)) = file.split_at_checked(LENGTH) else {
            return Err(BindingFault::Truncated { found, expected: LENGTH as u64, at_least: true });
        };
        // Before the checksum, which another version may compute in another way.
        match u32_at(header, 8) {
            ORDER => {}
            found => return Err(BindingFault::ByteOrder { found }),
        }
        match u32_at(header, 12) {
            VERSION => {}
            found => return Err(BindingFault::Version { found, supported: VERSION }),
        }
        let expected = u64_at(header, 60).saturating_add(LENGTH as u64);
        if found < expected {
            return Err(BindingFault::Truncated { found, expected, at_least: false });
        }
        if found > expected {
            return Err(BindingFault::Trailing { expected, extra: found - expected });
        }
        let (expected, found) = (u64_at(header, CHECKSUM), checksum(&header[..CHECKSUM], payload));
        if expected != found {
            return Err(BindingFault::Checksum { expected, found });
        }
        let flags = u32_at(header, 16);
        if flags & !(SIMPLIFIED | SMOOTHED) != 0 {
            return Err(BindingFault::Flags { found: flags, known: SIMPLIFIED | SMOOTHED });
        }
        let (vertices, faces) = (u32_at(header, 20), u32_at(header, 24));
        let shape = Fingerprint { vertices, faces, hash: u128_at(header, 28) };
        Ok((Self { flags, shape, rounded: u128_at(header, 44) }, payload))
    }
}

fn checksum(header: &[u8], payload: &[u8]) -> u64 {
    let mut hasher = XxHash3_64::new();
    hasher.write(header);
    hasher.write(payload);
    hasher.finish()
}

fn at<const N: usize>(header: &[u8], start: usize) -> [u8; N] {
    std::array::from_fn(|k| header[start + k])
}

fn u32_at(header: &[u8], start: usize) -> u32 {
    u32::from_le_bytes(at(header, start))
}

fn u64_at(header: &[u8], start: usize) -> u64 {
    u64::from_le_bytes(at(header, start))
}

fn u128_at(header: &[u8], start: usize) -> u128 {
    u128::from_le_bytes(at(header, start))
}
