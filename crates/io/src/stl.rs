//! STL, text and binary.
//!
//! Read by our own lines because stl_io 0.11 takes every file that starts with "solid " for text, which many binary
//! files do, refuses an unnamed `solid`, and gives no line numbers.

use glam::DVec3;

use crate::error::Fault;
use crate::soup::Soup;
use crate::text::{Lines, coordinates, quoted, words};

/// 80 bytes of free text and the number of triangles.
const HEADER: usize = 84;
/// Normal, three corners (f32, little endian) and two bytes of attributes.
const RECORD: usize = 50;

pub(crate) fn read(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    // Length first: the text of a binary file's header may say "solid" too.
    let exact = declared_triangles(bytes).is_some_and(|n| HEADER as u64 + n * RECORD as u64 == bytes.len() as u64);
    if !exact && is_text(bytes) { read_text(bytes, soup) } else { read_binary(bytes, soup) }
}

fn declared_triangles(bytes: &[u8]) -> Option<u64> {
    bytes.get(80..HEADER).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))
}

fn is_text(bytes: &[u8]) -> bool {
    let start = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes).trim_ascii_start();
    start.get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid"))
}

fn read_binary(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    let Some(declared) = declared_triangles(bytes) else {
        return Err(Fault::file(format!("{} bytes are neither text STL nor the header of a binary one", bytes.len())));
    };
    let body = &bytes[HEADER..];
    if declared * RECORD as u64 > body.len() as u64 {
        let needed = HEADER as u64 + declared * RECORD as u64;
        return Err(Fault::file(format!(
            "truncated: {} of the {needed} bytes that {declared} triangles take",
            bytes.len()
        )));
    }
    let records = body.chunks_exact(RECORD).take(declared as usize);
    soup.positions.reserve(3 * records.len());
    soup.triangles.reserve(records.len());
    for (i, record) in records.enumerate() {
        for corner in record[12..48].chunks_exact(12) {
            let at = |k: usize| f64::from(f32::from_le_bytes([corner[k], corner[k + 1], corner[k + 2], corner[k + 3]]));
            let point = DVec3::new(at(0), at(4), at(8));
            soup.vertex(point).map_err(|reason| Fault::byte(HEADER + i * RECORD, format!("triangle {i}: {reason}")))?;
        }
        add_last_corners(soup, 3);
        soup.drop("facet attributes", usize::from(record[48..] != [0, 0]));
    }
    // Fits: the product was compared with the length above.
    soup.drop("bytes after the last triangle", body.len() - declared as usize * RECORD);
    Ok(())
}

fn read_text(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    let mut corners: Option<usize> = None;
    let mut open_solid = false;
    let mut last_line = 1;
    for (line, content) in Lines::new(bytes) {
        let at = |reason: String| Fault::line(line, reason);
        let mut words = words(content);
        let Some(keyword) = words.next() else { continue };
        last_line = line;
        match (keyword.to_ascii_lowercase().as_slice(), corners) {
            (b"solid", None) => open_solid = true,
            (b"endsolid", None) => open_solid = false,
            // The normal is not read: it follows from the corners, and is often left at zero.
            (b"facet", None) => corners = Some(0),
            (b"outer" | b"endloop", Some(_)) => {}
            (b"vertex", Some(count)) => {
                let point = coordinates(&mut words).map_err(at)?;
                soup.vertex(DVec3::from_array(point)).map_err(at)?;
                corners = Some(count + 1);
            }
            (b"endfacet", Some(count)) => {
                add_last_corners(soup, count);
                corners = None;
            }
            _ => return Err(at(format!("{} is not expected here", quoted(keyword)))),
        }
    }
    if corners.is_some() || open_solid {
        return Err(Fault::line(last_line, "the file ends inside a solid (no \"endsolid\")"));
    }
    Ok(())
}

/// The last `count` vertices as one face.
fn add_last_corners(soup: &mut Soup, count: usize) {
    // Fits: `Soup::vertex` numbers vertices in 32 bits.
    let end = soup.positions.len() as u32;
    let corners: Vec<u32> = (end - count as u32..end).collect();
    soup.polygon(&corners);
}
