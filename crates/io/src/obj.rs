//! Wavefront OBJ.
//!
//! Read by our own lines because tobj 4 splits a mesh at every `o`, `g` and `usemtl`, renumbers vertices and drops unused
//! ones, merges vertices after rounding to f32, opens and may panic on material files, refuses names that are not UTF-8,
//! and gives no line numbers.

use std::borrow::Cow;

use glam::DVec3;

use crate::error::Fault;
use crate::soup::Soup;
use crate::text::{Lines, coordinates, quoted, without_comment, words};

pub(crate) fn read(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    let mut lines = Lines::new(bytes);
    let mut corners = Vec::new();
    // Faces may come before the vertices they name, so the largest index is checked at the end.
    let mut largest = (0, 0);
    while let Some((line, content)) = next_statement(&mut lines) {
        let at = |reason: String| Fault::line(line, reason);
        let mut words = words(&content);
        let Some(keyword) = words.next() else { continue };
        match keyword {
            b"v" => {
                let point = coordinates(&mut words).map_err(at)?;
                soup.vertex(DVec3::from_array(point)).map_err(at)?;
                match words.count() {
                    0 => {}
                    // The fourth number is a weight that only rational curves use; it does not divide the position.
                    1 => soup.drop("vertex weights (w)", 1),
                    _ => soup.drop("vertex colours", 1),
                }
            }
            b"f" | b"fo" => {
                corners.clear();
                for word in words {
                    let index = vertex_index(word, soup.positions.len()).map_err(at)?;
                    largest = largest.max((index, line));
                    corners.push(index);
                }
                soup.polygon(&corners);
            }
            _ => soup.drop(statement_name(keyword), 1),
        }
    }
    let (index, line) = largest;
    if line > 0 && index as usize >= soup.positions.len() {
        let reason =
            format!("the face names vertex {}, but the file has {}", u64::from(index) + 1, soup.positions.len());
        return Err(Fault::line(line, reason));
    }
    Ok(())
}

/// The next line without its comment, joined with those that a `\` at its end continues; and the first one's number.
fn next_statement<'a>(lines: &mut Lines<'a>) -> Option<(usize, Cow<'a, [u8]>)> {
    let (number, line) = lines.next()?;
    // A comment is cut first, so that a path ending in `\` in a comment does not swallow the next line.
    let Some(start) = without_comment(line).strip_suffix(b"\\") else {
        return Some((number, Cow::Borrowed(without_comment(line))));
    };
    let mut joined = start.to_vec();
    for (_, line) in lines {
        joined.push(b' ');
        let content = without_comment(line);
        match content.strip_suffix(b"\\") {
            Some(part) => joined.extend_from_slice(part),
            None => {
                joined.extend_from_slice(content);
                break;
            }
        }
    }
    Some((number, Cow::Owned(joined)))
}

/// Vertex number from 0 of a face corner: `v`, `v/t`, `v//n` or `v/t/n`, from 1 up or, negative, back from the last vertex.
fn vertex_index(word: &[u8], vertices: usize) -> Result<u32, String> {
    let digits = word.split(|&b| b == b'/').next().unwrap_or(word);
    let parsed: Option<i64> = std::str::from_utf8(digits).ok().and_then(|d| d.parse().ok());
    let number = parsed.ok_or_else(|| format!("{} is not a face corner (v, v/t, v//n or v/t/n)", quoted(word)))?;
    let index = match number {
        0 => return Err("a face names vertex 0, but vertices are numbered from 1".to_owned()),
        1.. => number - 1,
        // Cannot overflow: the sum of a count and a negative number.
        _ => vertices as i64 + number,
    };
    if index < 0 {
        return Err(format!("the face names vertex {number}, but only {vertices} vertices come before it"));
    }
    u32::try_from(index).map_err(|_| format!("the face names vertex {number}, which is more than 32 bits can number"))
}

/// What a skipped statement is called in the report.
fn statement_name(keyword: &[u8]) -> &'static str {
    match keyword {
        b"vn" => "normals",
        b"vt" => "texture coordinates",
        b"l" => "lines",
        b"p" => "points",
        b"o" | b"g" => "object and group names",
        b"s" => "smoothing groups",
        b"mtllib" | b"usemtl" | b"usemap" | b"maplib" => "material statements",
        b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf" | b"parm" | b"trim" | b"hole"
        | b"scrv" | b"sp" | b"end" | b"con" => "free-form statements",
        _ => "unknown statements",
    }
}
