use super::header::{Element, Encoding, Header, Kind};
use super::size;
use crate::error::Fault;
use crate::text::{Lines, any_number, words};

/// The values after the header, one by one. Every type of PLY fits an `f64` exactly.
pub(super) struct Values<'a> {
    source: Source<'a>,
    /// Words left over at the ends of lines.
    unread_words: usize,
}

enum Source<'a> {
    Text { lines: Lines<'a>, words: Vec<&'a [u8]>, used: usize, line: usize },
    Binary { bytes: &'a [u8], at: usize, little: bool },
}

impl<'a> Values<'a> {
    pub(super) fn new(bytes: &'a [u8], header: &Header) -> Self {
        let source = match header.encoding {
            Encoding::Text => Source::Text {
                lines: Lines::numbered_after(&bytes[header.length..], header.lines),
                words: Vec::new(),
                used: 0,
                line: header.lines,
            },
            encoding => Source::Binary { bytes, at: header.length, little: encoding == Encoding::LittleEndian },
        };
        Self { source, unread_words: 0 }
    }

    /// An error at the current place.
    pub(super) fn fault(&self, reason: String) -> Fault {
        match &self.source {
            Source::Text { line, .. } => Fault::line(*line, reason),
            Source::Binary { at, .. } => Fault::byte(*at, reason),
        }
    }

    /// In a text file, goes to the next line that is not blank: each row of an element has its own.
    pub(super) fn begin_row(&mut self, element: &Element, row: usize) -> Result<(), Fault> {
        let Source::Text { lines, words: row_words, used, line } = &mut self.source else { return Ok(()) };
        row_words.clear();
        *used = 0;
        for (number, content) in lines {
            *line = number;
            row_words.extend(words(content));
            if !row_words.is_empty() {
                return Ok(());
            }
        }
        let reason = format!("the file ends at {} {row} of the {} declared", element.name, element.count);
        Err(Fault::line(*line, reason))
    }

    pub(super) fn end_row(&mut self) {
        if let Source::Text { words, used, .. } = &self.source {
            self.unread_words += words.len() - used;
        }
    }

    /// The next value.
    pub(super) fn next(&mut self, kind: Kind) -> Result<f64, Fault> {
        match &mut self.source {
            Source::Text { words, used, line, .. } => {
                let word = words.get(*used).ok_or_else(|| Fault::line(*line, "the line has too few values"))?;
                *used += 1;
                any_number(word).map_err(|reason| Fault::line(*line, reason))
            }
            Source::Binary { bytes, at, little } => {
                let end = *at + size(kind);
                let Some(raw) = bytes.get(*at..end) else {
                    return Err(Fault::byte(*at, "truncated: the file ends inside an element"));
                };
                *at = end;
                Ok(decode(raw, kind, *little))
            }
        }
    }

    /// The number of values in a list, which the rest of the file (or line) has room for.
    pub(super) fn count(&mut self, count_kind: Kind, value_kind: Kind) -> Result<usize, Fault> {
        let value = self.next(count_kind)?;
        let room = match &self.source {
            Source::Text { words, used, .. } => words.len() - used,
            Source::Binary { bytes, at, .. } => (bytes.len() - at) / size(value_kind),
        };
        if value >= 0.0 && value.fract() == 0.0 && value <= room as f64 {
            Ok(value as usize)
        } else {
            Err(self.fault(format!("a list declares {value} values where at most {room} can follow")))
        }
    }

    pub(super) fn unread_words(&self) -> usize {
        self.unread_words
    }

    /// Bytes after the last value read; in a text file, those of the lines after the last row.
    pub(super) fn bytes_left(&self) -> usize {
        match &self.source {
            Source::Text { lines, .. } => lines.rest().trim_ascii().len(),
            Source::Binary { bytes, at, .. } => bytes.len() - at,
        }
    }
}

/// A value from exactly as many bytes as its type has.
fn decode(raw: &[u8], kind: Kind, little: bool) -> f64 {
    let mut le = [0; 8];
    for (i, target) in le[..raw.len()].iter_mut().enumerate() {
        *target = raw[if little { i } else { raw.len() - 1 - i }];
    }
    let low4 = [le[0], le[1], le[2], le[3]];
    match kind {
        Kind::I8 => f64::from(le[0] as i8),
        Kind::U8 => f64::from(le[0]),
        Kind::I16 => f64::from(i16::from_le_bytes([le[0], le[1]])),
        Kind::U16 => f64::from(u16::from_le_bytes([le[0], le[1]])),
        Kind::I32 => f64::from(i32::from_le_bytes(low4)),
        Kind::U32 => f64::from(u32::from_le_bytes(low4)),
        Kind::F32 => f64::from(f32::from_le_bytes(low4)),
        Kind::F64 => f64::from_le_bytes(le),
    }
}
