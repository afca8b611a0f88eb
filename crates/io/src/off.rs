//! Geomview OFF, text: `OFF`, and `COFF`, `NOFF`, `STOFF` and their mixtures, whose extra numbers follow the position.

use glam::DVec3;

use crate::error::Fault;
use crate::soup::Soup;
use crate::text::{Lines, coordinates, quoted, whole, without_comment, words};

pub(crate) fn read(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    let mut lines = Lines::new(bytes);
    let (vertices, faces) = counts(&mut lines)?;
    // Each vertex and face takes a line of at least two bytes, so no count can ask for more than the file holds.
    let left = lines.rest().len();
    if vertices.saturating_add(faces) > left {
        let reason = format!("{vertices} vertices and {faces} faces are declared, but only {left} bytes follow");
        return Err(Fault::line(lines.number(), reason));
    }
    soup.positions.reserve(vertices);
    soup.triangles.reserve(faces);
    for i in 0..vertices {
        let (line, content) = next_content(&mut lines).ok_or_else(|| missing(&lines, "vertex", i, vertices))?;
        let at = |reason: String| Fault::line(line, reason);
        let mut words = words(content);
        let point = coordinates(&mut words).map_err(at)?;
        soup.vertex(DVec3::from_array(point)).map_err(at)?;
        soup.drop("vertices' colours, normals or texture coordinates", usize::from(words.next().is_some()));
    }
    let mut corners = Vec::new();
    for i in 0..faces {
        let (line, content) = next_content(&mut lines).ok_or_else(|| missing(&lines, "face", i, faces))?;
        let at = |reason: String| Fault::line(line, reason);
        let mut words = words(content);
        let size = words.next().map_or(Ok(0), whole).map_err(at)?;
        corners.clear();
        for corner in 0..size {
            let word = words.next().ok_or_else(|| at(format!("a face of {size} corners has only {corner}")))?;
            let index = whole(word).map_err(at)?;
            if index >= vertices {
                return Err(at(format!("the face names vertex {index}, but there are {vertices} (numbered from 0)")));
            }
            // Fits: `Soup::vertex` has numbered all vertices in 32 bits.
            corners.push(index as u32);
        }
        soup.polygon(&corners);
        soup.drop("face colours", usize::from(words.next().is_some()));
    }
    let mut rest = 0;
    while next_content(&mut lines).is_some() {
        rest += 1;
    }
    soup.drop("lines after the last face", rest);
    Ok(())
}

/// Numbers of vertices and faces. The keyword is optional, and the counts may share its line, even without a space.
fn counts(lines: &mut Lines<'_>) -> Result<(usize, usize), Fault> {
    let (mut line, mut content) = next_content(lines).ok_or_else(|| Fault::file("the file is empty"))?;
    let letters = content.iter().position(|b| !b.is_ascii_alphabetic()).unwrap_or(content.len());
    let keyword = &content[..letters];
    let prefix = keyword.strip_suffix(b"OFF").or_else(|| keyword.strip_suffix(b"off"));
    match prefix {
        Some(b"" | b"C" | b"N" | b"CN" | b"ST" | b"STC" | b"STN" | b"STCN" | b"NC") => {
            content = &content[letters..];
            if content.trim_ascii_start().starts_with(b"BINARY") {
                return Err(Fault::line(line, "binary OFF is not supported; convert the file to text OFF or to PLY"));
            }
        }
        // A number: the keyword is left out.
        None if keyword.is_empty() => {}
        _ => {
            let reason = format!("{} is not the start of an OFF file with three coordinates a vertex", quoted(content));
            return Err(Fault::line(line, reason));
        }
    }
    if content.trim_ascii().is_empty() {
        (line, content) = next_content(lines).ok_or_else(|| Fault::line(line, "the file ends before the counts"))?;
    }
    let at = |reason: String| Fault::line(line, reason);
    // The third number, of edges, is often missing or wrong, and nobody needs it.
    let numbers = words(content).take(2).map(whole).collect::<Result<Vec<_>, _>>().map_err(at)?;
    match numbers[..] {
        [vertices, faces] => Ok((vertices, faces)),
        _ => Err(at("the numbers of vertices and faces are expected here".to_owned())),
    }
}

/// The next line that has more than a comment, trimmed.
fn next_content<'a>(lines: &mut Lines<'a>) -> Option<(usize, &'a [u8])> {
    lines.map(|(number, line)| (number, without_comment(line).trim_ascii())).find(|(_, content)| !content.is_empty())
}

fn missing(lines: &Lines<'_>, what: &str, found: usize, declared: usize) -> Fault {
    Fault::line(lines.number(), format!("the file ends at {what} {found} of the {declared} declared"))
}
