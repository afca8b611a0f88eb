//! Text of others inside HTML and inside scripts.

use std::fmt::{self, Write};

use askama::filters::{Escaper, Html};
use serde::Serialize;

/// Writes text so that HTML shows it as it stands. Control characters, which HTML does not allow, and those that turn the direction of
/// whatever follows become U+FFFD.
#[derive(Debug, Clone, Copy)]
pub(in crate::report) struct Plain;

impl Escaper for Plain {
    fn write_escaped_str<W: Write>(&self, mut to: W, text: &str) -> fmt::Result {
        let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        let forbidden =
            |c: char| (c.is_control() && c != '\n' && c != '\t') || matches!(c, '\u{fffe}' | '\u{ffff}') || turns(c);
        for (k, part) in text.split(forbidden).enumerate() {
            if k > 0 {
                to.write_char(char::REPLACEMENT_CHARACTER)?;
            }
            Html.write_escaped_str(&mut to, part)?;
        }
        Ok(())
    }
}

/// JSON for an element `<script type="application/json">`: no text in it can end the element or begin a comment.
pub(super) fn json(value: &impl Serialize) -> String {
    // Outside of strings JSON has no such letter.
    serde_json::to_string(value).expect("every key is a string and no value can fail").replace('<', "\\u003c")
}
