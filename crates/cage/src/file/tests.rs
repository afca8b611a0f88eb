//! Files that are broken or forged: whatever they hold, reading ends in an error that says what is wrong.

use glam::DVec3;
use pliant_mesh::{Silent, TriMesh, shapes};

use super::header::{self, Header};
use super::{BindingFault, RowFault, SavedCage, payload};
use crate::{BindOptions, CageSize, Prune, SimplifyOptions, simplify};

/// A sphere of 42 vertices with a cage of 12, and what a file of it holds.
fn small() -> (TriMesh, SavedCage) {
    let shape = shapes::icosphere(1);
    let simplify_options: SimplifyOptions = CageSize::Vertices(12).into();
    let simplified = simplify(&shape, &simplify_options, &Silent).expect("valid");
    let options = BindOptions { smoothing: 3, ..Prune::Smooth { neighbours: 4 }.into() };
    let binding = simplified.bind(&shape, &options, &Silent).expect("valid");
    (shape, SavedCage { binding, options, simplified: Some((simplify_options, simplified)) })
}

fn fault(bytes: &[u8], shape: &TriMesh) -> BindingFault {
    SavedCage::from_bytes(bytes, shape).expect_err("a broken file")
}

/// The file with another payload, and the checksum that goes with it.
fn forged(file: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let (header, payload) = Header::read(file).expect("whole");
    let mut payload = payload.to_vec();
    change(&mut payload);
    header.file(&payload)
}

/// Where the parts of a payload stand.
struct Places {
    /// The number of cage vertices, then the number of faces.
    counts: usize,
    positions: usize,
    triangles: usize,
    /// The number of entries.
    entries: usize,
    lengths: usize,
    indices: usize,
    weights: usize,
    /// The number of entries of smoothing rows.
    smoothing: usize,
    owners: usize,
    origins: usize,
}

impl Places {
    fn of(saved: &SavedCage, payload: &[u8]) -> Self {
        let (cage, rows) = (saved.binding.cage.len(), &saved.binding.rows);
        // Two kinds and a flag, three numbers; the fields of the report.
        let counts = 3 * 4 + 3 * 8 + 14 * 8;
        let positions = counts + 2 * 8;
        let triangles = positions + 24 * cage;
        let entries = triangles + 12 * saved.binding.cage_topology.triangles().len();
        let lengths = entries + 8;
        let indices = lengths + 4 * rows.len();
        let weights = indices + 4 * rows.indices.len();
        let smoothing = weights + 4 * rows.indices.len();
        let owners = payload.len() - 4 * rows.len();
        let origins = owners - 4 * cage;
        Self { counts, positions, triangles, entries, lengths, indices, weights, smoothing, owners, origins }
    }
}

/// A file with `bytes` at a place of its payload, and the checksum that goes with them.
fn with(file: &[u8], place: usize, bytes: &[u8]) -> Vec<u8> {
    forged(file, |payload| payload[place..place + bytes.len()].copy_from_slice(bytes))
}

#[test]
fn every_flipped_bit_is_noticed() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    SavedCage::from_bytes(&file, &shape).expect("whole");
    for byte in 0..file.len() {
        for bit in 0..8 {
            let mut flipped = file.clone();
            flipped[byte] ^= 1 << bit;
            let found = fault(&flipped, &shape);
            let expected = match byte {
                0..8 => matches!(found, BindingFault::NotABinding),
                8..12 => matches!(found, BindingFault::ByteOrder { .. }),
                12..16 => matches!(found, BindingFault::Version { supported: 1, .. }),
                60..68 => matches!(found, BindingFault::Truncated { .. } | BindingFault::Trailing { .. }),
                _ => matches!(found, BindingFault::Checksum { .. }),
            };
            assert!(expected, "byte {byte}, bit {bit}: {found}");
        }
    }
}

#[test]
fn every_other_length_is_refused() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    let (length, header) = (file.len() as u64, header::LENGTH as u64);
    assert_eq!(fault(&[], &shape), BindingFault::Empty);
    for found in 1..length {
        let at_least = found < header;
        let expected = if at_least { header } else { length };
        let cut = fault(&file[..found as usize], &shape);
        assert_eq!(cut, BindingFault::Truncated { found, expected, at_least });
    }
    let cut = fault(&file[..100], &shape).to_string();
    assert_eq!(cut, format!("truncated: 100 of {length} bytes"));
    for extra in [1, 1 << 20] {
        let mut longer = file.clone();
        longer.resize(file.len() + extra, 0);
        assert_eq!(fault(&longer, &shape), BindingFault::Trailing { expected: length, extra: extra as u64 });
    }
}

/// Versions are told apart before anything that another version may have changed.
#[test]
fn other_versions_are_named() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    for version in [0u32, 2, u32::MAX] {
        let mut other = file.clone();
        other[12..16].copy_from_slice(&version.to_le_bytes());
        let expected = format!("this is version {version} of binding files, version 1 is read");
        assert_eq!(fault(&other, &shape).to_string(), expected);
    }
    let mut swapped = file.clone();
    swapped[8..12].reverse();
    assert!(fault(&swapped, &shape).to_string().contains("the byte order mark is 0x01020304, not 0x04030201"));
    let (header, payload) = Header::read(&file).expect("whole");
    let flagged = Header { flags: header.flags | 4, ..header }.file(payload);
    assert_eq!(fault(&flagged, &shape), BindingFault::Flags { found: 7, known: 3 });
}

/// Counts up to the largest, alone and as products that overflow: no room is made for them.
#[test]
fn counts_are_held_against_what_is_left() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    let places = Places::of(&saved, &file[header::LENGTH..]);
    for place in [places.counts, places.counts + 8, places.entries, places.smoothing] {
        for count in [u64::from(u32::MAX), 1 << 32, 1 << 63, u64::MAX, u64::MAX / 24 + 1] {
            let found = fault(&with(&file, place, &count.to_le_bytes()), &shape);
            let entries = place == places.entries || place == places.smoothing;
            match &found {
                BindingFault::Count { count: named, .. } => assert_eq!(*named, count),
                BindingFault::Value { .. } => assert!(entries && count > u64::from(u32::MAX), "{found}"),
                other => panic!("{place}, {count}: {other}"),
            }
        }
    }
    // One less than there are moves all that follows.
    for place in [places.counts, places.counts + 8, places.entries, places.smoothing] {
        let mut count = [0; 8];
        count.copy_from_slice(&file[header::LENGTH + place..][..8]);
        let less = u64::from_le_bytes(count) - 1;
        fault(&with(&file, place, &less.to_le_bytes()), &shape);
    }
    let longer = forged(&file, |payload| payload.extend([0; 3]));
    assert_eq!(fault(&longer, &shape), BindingFault::Unread { extra: 3 });
    let shorter = forged(&file, |payload| payload.truncate(payload.len() - 1));
    assert!(matches!(fault(&shorter, &shape), BindingFault::Count { what: "owners", count: 42, left: 167, .. }));
}

#[test]
fn broken_rows_are_named() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    let places = Places::of(&saved, &file[header::LENGTH..]);
    let rows = &saved.binding.rows;
    // A row of three entries or more, so that some come after the leading one.
    let row = (0..rows.len()).find(|&i| rows.row(i).0.len() >= 3).expect("most rows are longer");
    let first = rows.offsets[row] as usize;
    let (indices, weights) = rows.row(row);
    let expect =
        |place: usize, bytes: &[u8], what: &str, expected: RowFault| match fault(&with(&file, place, bytes), &shape) {
            BindingFault::Row { row: found, fault, .. } => assert_eq!((found, fault), (row, expected), "{what}"),
            other => panic!("{what}: {other}"),
        };
    let index = |entry: usize| places.indices + 4 * (first + entry);
    for vertex in [12, u32::MAX] {
        let expected = RowFault::Vertex { vertex, vertices: 12 };
        expect(index(1), &vertex.to_le_bytes(), "a vertex that is not there", expected);
    }
    expect(index(0), &indices[1].to_le_bytes(), "the leading vertex twice", RowFault::Order);
    expect(index(1), &indices[2].to_le_bytes(), "another vertex twice", RowFault::Order);
    let weight = |entry: usize| places.weights + 4 * (first + entry);
    for wrong in [f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        expect(weight(1), &wrong.to_le_bytes(), "too large", RowFault::Weight { weight: wrong });
    }
    match fault(&with(&file, weight(1), &f32::NAN.to_le_bytes()), &shape) {
        BindingFault::Row { row: found, fault: RowFault::Weight { weight }, .. } => {
            assert!(found == row && weight.is_nan());
        }
        other => panic!("{other}"),
    }
    let off = weights[0] + 2e-6;
    let sum = weights[1..].iter().fold(f64::from(off), |sum, w| sum + f64::from(*w));
    match fault(&with(&file, weight(0), &off.to_le_bytes()), &shape) {
        BindingFault::Row { row: found, fault: RowFault::Sum { sum: s }, .. } => {
            assert!(found == row && (s - sum).abs() < 1e-12);
        }
        other => panic!("{other}"),
    }
    let swapped = [weights[1].to_le_bytes(), weights[0].to_le_bytes()].concat();
    expect(weight(0), &swapped, "a smaller weight leads", RowFault::Order);
    let length = |row: usize| places.lengths + 4 * row;
    expect(length(row), &0u32.to_le_bytes(), "no entries", RowFault::Empty);
    let entries = rows.indices.len() as u64;
    for long in [entries as u32 + 1, u32::MAX] {
        let end = u64::from(rows.offsets[row]) + u64::from(long);
        expect(length(row), &long.to_le_bytes(), "past the end", RowFault::PastEnd { end, entries });
    }
    let last = rows.len() - 1;
    let short = rows.offsets[last + 1] - rows.offsets[last] - 1;
    let short = fault(&with(&file, length(last), &short.to_le_bytes()), &shape);
    assert_eq!(short, BindingFault::Entries { what: "row", expected: entries, found: entries - 1 });
    let named = fault(&with(&file, places.smoothing + 8 + 4 * 5, &0u32.to_le_bytes()), &shape);
    assert_eq!(named.to_string(), "smoothing row 5: no entries");
}

#[test]
fn broken_cages_and_origins_are_named() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    let places = Places::of(&saved, &file[header::LENGTH..]);
    let message = |place: usize, bytes: &[u8]| fault(&with(&file, place, bytes), &shape).to_string();
    let nan = message(places.positions + 24 * 3, &f64::NAN.to_le_bytes());
    assert_eq!(nan, "the cage: vertex 3 has a coordinate that is not a finite number");
    let range = message(places.triangles + 12 * 2 + 8, &12u32.to_le_bytes());
    assert_eq!(range, "the cage: face 2 names vertex 12, but there are 12 vertices (numbered from 0)");
    let twice = with(&file, places.triangles, &[7, 0, 0, 0, 7, 0, 0, 0]);
    assert!(fault(&twice, &shape).to_string().starts_with("the cage: face 0 has vertex 7 at two"));
    let (_, simplified) = saved.simplified.as_ref().expect("made so");
    let (origin, owner) = (&simplified.origin, &simplified.owner);
    for wrong in [42, u32::MAX, origin[0], origin[2]] {
        let expected = format!("cage vertex 1 cannot come from shape vertex {wrong}");
        assert_eq!(message(places.origins + 4, &wrong.to_le_bytes()), expected);
    }
    let moved = message(places.positions + 24, &123.0f64.to_le_bytes());
    assert_eq!(moved, format!("cage vertex 1 cannot come from shape vertex {}", origin[1]));
    let free = owner.iter().zip(0..).find(|(_, v)| !origin.contains(v)).expect("not in the cage").1;
    let stray = message(places.owners + 4 * free as usize, &12u32.to_le_bytes());
    assert_eq!(stray, format!("shape vertex {free} cannot belong to cage vertex 12"));
    let stolen = message(places.owners + 4 * origin[1] as usize, &0u32.to_le_bytes());
    assert_eq!(stolen, format!("shape vertex {} cannot belong to cage vertex 0", origin[1]));
    for (place, what) in [(0, "rule cannot be 9"), (12, "support cannot be 9"), (16, "exact cannot be 9")] {
        assert_eq!(message(place, &9u32.to_le_bytes()), what);
    }
    assert_eq!(message(4, &0u64.to_le_bytes()), "the number of neighbours (1 or more) cannot be 0");
    assert!(message(28, &1.5f64.to_le_bytes()).starts_with("tiny (a share"));
    assert_eq!(message(36, &41u64.to_le_bytes()), "the report's number of rows cannot be 41");
    assert_eq!(message(44, &f64::NAN.to_le_bytes()), "a number of the report cannot be NaN");
}

/// Some thousand files with a right checksum over wrong bytes: each is refused or read whole, none panics or makes room for more than
/// there is.
#[test]
fn forged_files_never_panic() {
    let (shape, saved) = small();
    let file = saved.to_bytes().expect("sound");
    let length = file.len() - header::LENGTH;
    let mut state = 1u64;
    // Knuth's linear congruence, its better half.
    let mut random = |below: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 33) as usize) % below
    };
    let pose: Vec<DVec3> = saved.binding.cage.iter().map(|p| *p * 1.5).collect();
    let (mut refused, mut read) = (0, 0);
    for k in 0..6000 {
        let (place, value, size) = (random(length - 8), random(256) as u8, [1, 2, 4, 8][random(4)]);
        let bytes = [[0; 8], [0xff; 8], [value; 8], [0, 0, 0, 0x80, 0, 0, 0, 0x80]][random(4)];
        let changed = forged(&file, |payload| {
            payload[place..place + size].copy_from_slice(&bytes[..size]);
            if k % 3 == 0 {
                payload.drain(place..place + size);
            }
        });
        match SavedCage::from_bytes(&changed, &shape) {
            Err(_) => refused += 1,
            Ok(other) => {
                read += 1;
                // Sound rows of finite weights: whatever else was changed, a pose is carried.
                let carried = other.binding.apply(&pose, crate::Propagation::Frames);
                assert!(carried.iter().all(|p| p.is_finite()));
                payload::write(&other).expect("what is read can be written");
            }
        }
    }
    assert!(refused > 4000 && read > 100, "{refused} refused, {read} read");
}

/// What one cage was made with does not go into the file of another.
#[test]
fn cages_that_do_not_belong_together_are_not_written() {
    let (_, mut saved) = small();
    let (_, simplified) = saved.simplified.as_mut().expect("made so");
    simplified.mesh.positions[4].x += 1e-9;
    assert_eq!(saved.to_bytes(), Err(BindingFault::Unmatched));
}
