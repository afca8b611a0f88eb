use super::size;
use crate::error::Fault;
use crate::text::{Lines, quoted, whole, words};

/// Type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    /// By either of the names in use.
    fn named(word: &[u8]) -> Result<Self, String> {
        Ok(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return Err(format!("{} is not a type of PLY", quoted(word))),
        })
    }
}

#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    /// Type of the value, or of each value of a list.
    pub(super) kind: Kind,
    /// Type of the number of values before a list; none for a single value.
    pub(super) list_count: Option<Kind>,
}

impl Property {
    /// Bytes in a binary file, with an empty list.
    pub(super) fn smallest_size(&self) -> usize {
        size(self.list_count.unwrap_or(self.kind))
    }
}

#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    /// Rows declared.
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
    /// Line of its declaration.
    pub(super) line: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Text,
    LittleEndian,
    BigEndian,
}

#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Bytes up to the first value.
    pub(super) length: usize,
    /// Lines up to the first value.
    pub(super) lines: usize,
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, Fault> {
        let mut lines = Lines::new(bytes);
        match lines.next() {
            Some((_, magic)) if magic.trim_ascii_end() == b"ply" => {}
            _ => return Err(Fault::line(1, "a PLY file starts with the line \"ply\"")),
        }
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        while let Some((line, content)) = lines.next() {
            let at = |reason: String| Fault::line(line, reason);
            let words: Vec<&[u8]> = words(content).collect();
            match words.as_slice() {
                [] | [b"comment" | b"obj_info", ..] => {}
                [b"format", name, b"1.0"] => encoding = Some(encoding_named(name).map_err(at)?),
                [b"element", name, count] => {
                    let name = String::from_utf8_lossy(name).into_owned();
                    if elements.iter().any(|e| e.name == name) {
                        return Err(at(format!("element \"{name}\" is declared a second time")));
                    }
                    let count = whole(count).map_err(at)?;
                    elements.push(Element { name, count, properties: Vec::new(), line });
                }
                [b"property", rest @ ..] => {
                    let element = elements.last_mut().ok_or_else(|| at("a property before any element".to_owned()))?;
                    element.properties.push(property(rest, content).map_err(at)?);
                }
                [b"end_header"] => {
                    let encoding = encoding.ok_or_else(|| at("the header has no \"format\" line".to_owned()))?;
                    let length = bytes.len() - values_start(bytes, lines.rest()).len();
                    return Ok(Self { encoding, elements, length, lines: lines.number() });
                }
                _ => return Err(at(format!("{} is not a line of a PLY 1.0 header", quoted(content)))),
            }
        }
        Err(Fault::line(lines.number(), "the file ends before \"end_header\""))
    }
}

fn encoding_named(name: &[u8]) -> Result<Encoding, String> {
    Ok(match name {
        b"ascii" => Encoding::Text,
        b"binary_little_endian" => Encoding::LittleEndian,
        b"binary_big_endian" => Encoding::BigEndian,
        _ => return Err(format!("{} is not an encoding of PLY", quoted(name))),
    })
}

fn property(words: &[&[u8]], line: &[u8]) -> Result<Property, String> {
    let name = |n: &[u8]| String::from_utf8_lossy(n).into_owned();
    match words {
        [b"list", count, kind, n] => {
            Ok(Property { name: name(n), kind: Kind::named(kind)?, list_count: Some(Kind::named(count)?) })
        }
        [kind, n] => Ok(Property { name: name(n), kind: Kind::named(kind)?, list_count: None }),
        _ => Err(format!("{} is neither \"property type name\" nor \"property list type type name\"", quoted(line))),
    }
}

/// What follows the header.
///
/// Where lines end in a lone `\r`, a first value that happens to be the byte `\n` is not part of the line's end: the
/// ends are those of the first line.
fn values_start<'a>(bytes: &'a [u8], rest: &'a [u8]) -> &'a [u8] {
    let first_end = bytes.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(bytes.len());
    let lone_return = bytes[first_end..].starts_with(b"\r") && !bytes[first_end..].starts_with(b"\r\n");
    let rest_at = bytes.len() - rest.len();
    let swallowed = bytes[..rest_at].ends_with(b"\r\n");
    if lone_return && swallowed { &bytes[rest_at - 1..] } else { rest }
}
