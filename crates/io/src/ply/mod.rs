//! Stanford PLY, text and binary of either byte order.
//!
//! Read by our own lines because ply-rs-bw 4 refuses numbers such as `.5` and `1.` and comments that are not UTF-8, lets
//! a repeated element replace the first, and loops to the declared count over an element without properties.

mod header;
mod values;

use glam::DVec3;

use crate::error::Fault;
use crate::soup::Soup;
use header::{Element, Encoding, Header, Kind, Property};
use values::Values;

pub(crate) fn read(bytes: &[u8], soup: &mut Soup) -> Result<(), Fault> {
    let header = Header::read(bytes)?;
    check_sizes(&header, bytes.len())?;
    let vertices = header.elements.iter().find(|e| e.name == "vertex").map_or(0, |e| e.count);
    let mut values = Values::new(bytes, &header);
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => read_vertices(&mut values, element, soup)?,
            "face" => read_polygons(&mut values, element, vertices, soup)?,
            "tristrips" => read_strips(&mut values, element, vertices, soup)?,
            _ => {
                read_rows(&mut values, element, None, |_, _| Ok(()))?;
                soup.drop(&format!("elements \"{}\"", element.name), element.count);
            }
        }
    }
    soup.drop("words after the last value of a line", values.unread_words());
    soup.drop("bytes after the last element", values.bytes_left());
    Ok(())
}

/// Refuses counts that the file cannot hold, before anything is allocated for them.
fn check_sizes(header: &Header, file_length: usize) -> Result<(), Fault> {
    let mut left = file_length - header.length;
    for element in &header.elements {
        let smallest_row: usize = match header.encoding {
            Encoding::Text => usize::from(!element.properties.is_empty()),
            _ => element.properties.iter().map(Property::smallest_size).sum(),
        };
        let needed = element.count.saturating_mul(smallest_row);
        if needed > left {
            let reason = format!(
                "truncated: {} elements \"{}\" take at least {needed} bytes, but {left} are left",
                element.count, element.name
            );
            return Err(Fault::line(element.line, reason));
        }
        left -= needed;
    }
    Ok(())
}

/// Reads every row of an element; `wanted` is the property whose list goes to `take` (with the row's number).
///
/// Scalars go to `take` as well when there is no list wanted: as a row of all scalar properties.
fn read_rows(
    values: &mut Values<'_>,
    element: &Element,
    wanted: Option<usize>,
    mut take: impl FnMut(usize, &[f64]) -> Result<(), String>,
) -> Result<(), Fault> {
    // Rows without content may be declared in any number.
    if element.properties.is_empty() {
        return Ok(());
    }
    let mut row = Vec::new();
    for i in 0..element.count {
        values.begin_row(element, i)?;
        row.clear();
        for (k, property) in element.properties.iter().enumerate() {
            let count = match property.list_count {
                None => 1,
                Some(kind) => values.count(kind, property.kind)?,
            };
            let keep = wanted.map_or(property.list_count.is_none(), |w| w == k);
            for _ in 0..count {
                let value = values.next(property.kind)?;
                if keep {
                    row.push(value);
                }
            }
        }
        take(i, &row).map_err(|reason| values.fault(format!("{} {i}: {reason}", element.name)))?;
        values.end_row();
    }
    Ok(())
}

fn read_vertices(values: &mut Values<'_>, element: &Element, soup: &mut Soup) -> Result<(), Fault> {
    let scalars: Vec<&Property> = element.properties.iter().filter(|p| p.list_count.is_none()).collect();
    let mut places = [0; 3];
    for (place, name) in places.iter_mut().zip(["x", "y", "z"]) {
        *place = scalars
            .iter()
            .position(|p| p.name == name)
            .ok_or_else(|| Fault::line(element.line, format!("the vertices have no property \"{name}\"")))?;
    }
    // `check_sizes` has found room for this many.
    soup.positions.reserve(element.count);
    read_rows(values, element, None, |_, row| soup.vertex(DVec3::from_array(places.map(|p| row[p]))))?;
    for property in &element.properties {
        if !["x", "y", "z"].contains(&property.name.as_str()) {
            soup.drop(&format!("vertex property \"{}\"", property.name), element.count);
        }
    }
    Ok(())
}

/// The list of vertex numbers of a face or strip, under either of its usual names.
fn index_list(element: &Element) -> Result<usize, Fault> {
    let is_list =
        |p: &Property| p.list_count.is_some() && ["vertex_indices", "vertex_index"].contains(&p.name.as_str());
    element.properties.iter().position(is_list).ok_or_else(|| {
        Fault::line(element.line, format!("element \"{}\" has no list \"vertex_indices\"", element.name))
    })
}

fn drop_others(element: &Element, list: usize, soup: &mut Soup) {
    for (k, property) in element.properties.iter().enumerate() {
        if k != list {
            soup.drop(&format!("{} property \"{}\"", element.name, property.name), element.count);
        }
    }
}

fn vertex_number(value: f64, vertices: usize) -> Result<u32, String> {
    if value >= 0.0 && value < vertices as f64 && value.fract() == 0.0 {
        Ok(value as u32)
    } else {
        Err(format!("names vertex {value}, but there are {vertices} (numbered from 0)"))
    }
}

fn read_polygons(values: &mut Values<'_>, element: &Element, vertices: usize, soup: &mut Soup) -> Result<(), Fault> {
    if element.count == 0 {
        return Ok(());
    }
    let list = index_list(element)?;
    let mut corners = Vec::new();
    soup.triangles.reserve(element.count);
    read_rows(values, element, Some(list), |_, row| {
        corners.clear();
        for &value in row {
            corners.push(vertex_number(value, vertices)?);
        }
        soup.polygon(&corners);
        Ok(())
    })?;
    drop_others(element, list, soup);
    Ok(())
}

/// Triangle strips, ended by -1 in the list of indices, as the large Georgia Tech models have them.
fn read_strips(values: &mut Values<'_>, element: &Element, vertices: usize, soup: &mut Soup) -> Result<(), Fault> {
    if element.count == 0 {
        return Ok(());
    }
    let list = index_list(element)?;
    let mut corners = Vec::new();
    read_rows(values, element, Some(list), |_, row| {
        for strip in row.split(|&v| v == -1.0) {
            corners.clear();
            for &value in strip {
                corners.push(vertex_number(value, vertices)?);
            }
            soup.strip(&corners);
        }
        Ok(())
    })?;
    drop_others(element, list, soup);
    Ok(())
}

/// Bytes that a value takes in a binary file.
const fn size(kind: Kind) -> usize {
    match kind {
        Kind::I8 | Kind::U8 => 1,
        Kind::I16 | Kind::U16 => 2,
        Kind::I32 | Kind::U32 | Kind::F32 => 4,
        Kind::F64 => 8,
    }
}
