//! Options as text: tokens joined by `+`, those that differ from the default.

use std::fmt;
use std::str::FromStr;

use crate::DeformError;

/// The tokens of a text; none in an empty one.
pub(crate) fn tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split('+').filter(move |_| !text.is_empty())
}

/// Writes those of `tokens` that are there.
pub(crate) fn join(f: &mut fmt::Formatter<'_>, tokens: impl IntoIterator<Item = Option<String>>) -> fmt::Result {
    for (k, token) in tokens.into_iter().flatten().enumerate() {
        if k > 0 {
            f.write_str("+")?;
        }
        f.write_str(&token)?;
    }
    Ok(())
}

/// A token `word`, if `is_set`.
pub(crate) fn word(is_set: bool, word: &str) -> Option<String> {
    is_set.then(|| word.to_owned())
}

/// The number of a token `name=number`, if it is one.
pub(crate) fn number<T: FromStr>(token: &str, name: &str) -> Option<T> {
    token.strip_prefix(name)?.strip_prefix('=')?.parse().ok()
}

/// Refuses a token; `expected` lists the valid ones.
pub(crate) fn unknown(token: &str, expected: &'static str) -> DeformError {
    DeformError::BadOption { option: "each option of the method", expected, found: format!("'{token}'") }
}
