//! Lines, words and numbers of text files whose names may be in any encoding: everything works on bytes.

/// Lines numbered from 1, without their ends (`\n`, `\r\n` or a lone `\r`).
pub(crate) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    /// The lines of `text`, after a UTF-8 byte-order mark if it starts with one.
    pub(crate) fn new(text: &'a [u8]) -> Self {
        Self::numbered_after(text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text), 0)
    }

    /// The lines of `text`, the first of which has the number after `number`.
    pub(crate) fn numbered_after(text: &'a [u8], number: usize) -> Self {
        Self { rest: text, number }
    }

    /// What has not been read yet.
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Number of the last line returned.
    pub(crate) fn number(&self) -> usize {
        self.number
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        let end_length = if rest.starts_with(b"\r\n") { 2 } else { rest.len().min(1) };
        self.rest = &rest[end_length..];
        self.number += 1;
        Some((self.number, line))
    }
}

/// The part of a line before a `#`.
pub(crate) fn without_comment(line: &[u8]) -> &[u8] {
    line.iter().position(|&b| b == b'#').map_or(line, |at| &line[..at])
}

/// Words separated by spaces and tabs.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty())
}

/// A word as a finite number.
pub(crate) fn number(word: &[u8]) -> Result<f64, String> {
    let value = any_number(word)?;
    if value.is_finite() { Ok(value) } else { Err(format!("{} is not a finite number", quoted(word))) }
}

/// A word as a number, which may be infinite or NaN.
pub(crate) fn any_number(word: &[u8]) -> Result<f64, String> {
    let value = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
    value.ok_or_else(|| format!("{} is not a number", quoted(word)))
}

/// The next three words as coordinates.
pub(crate) fn coordinates<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Result<[f64; 3], String> {
    let mut point = [0.0; 3];
    for (i, coordinate) in point.iter_mut().enumerate() {
        let word = words.next().ok_or_else(|| format!("a vertex needs 3 coordinates, this one has {i}"))?;
        *coordinate = number(word)?;
    }
    Ok(point)
}

/// A word as a count or index.
pub(crate) fn whole(word: &[u8]) -> Result<usize, String> {
    let value = std::str::from_utf8(word).ok().and_then(|w| w.parse().ok());
    value.ok_or_else(|| format!("{} is not a whole number from 0 up", quoted(word)))
}

/// A word for a message: in quotes, cut short if long.
pub(crate) fn quoted(word: &[u8]) -> String {
    const SHOWN: usize = 40;
    let (shown, dots) = if word.len() > SHOWN { (&word[..SHOWN], "...") } else { (word, "") };
    format!("{:?}{dots}", String::from_utf8_lossy(shown))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The three kinds of line end give the same lines, a missing last end too.
    #[test]
    fn every_line_end() {
        for text in ["a\n\nb c\n", "a\r\n\r\nb c\r\n", "a\r\rb c", "\u{feff}a\n\nb c"] {
            let lines: Vec<_> = Lines::new(text.as_bytes()).collect();
            assert_eq!(lines, [(1, &b"a"[..]), (2, b""), (3, b"b c")], "{text:?}");
        }
    }
}
