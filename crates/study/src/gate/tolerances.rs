//! How far figures may move before it counts.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::str::FromStr;

use pliant_files::read_regular;
use serde::{Deserialize, Serialize};

use super::GateError;
use super::figures::{FIGURES, Group};

/// By how much a figure may be worse than it was: by a share of what it was, and by so much more in its own unit. As text `1%`,
/// `1%+0.001`, `0+2`, or `off` for a figure that is not compared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "String")]
pub struct Tolerance {
    /// Share of the old figure, as 0.01 for 1 %; infinite for a figure that is not compared.
    pub relative: f64,
    /// In the figure's unit: a fraction for errors (0.01 for 1 %), milliseconds, bytes.
    pub absolute: f64,
}

impl Tolerance {
    /// Of a figure that is not compared.
    pub const OFF: Self = Self { relative: f64::INFINITY, absolute: 0.0 };

    /// Whether the figure is not compared.
    pub fn is_off(self) -> bool {
        self.relative == f64::INFINITY
    }

    /// The most that a figure may be that was `old`.
    pub(super) fn most(self, old: f64) -> f64 {
        old + self.relative * old + self.absolute
    }
}

impl fmt::Display for Tolerance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_off() {
            return f.write_str("off");
        }
        write!(f, "{}", self.relative)?;
        if self.absolute > 0.0 { write!(f, "+{}", self.absolute) } else { Ok(()) }
    }
}

impl FromStr for Tolerance {
    type Err = GateError;

    fn from_str(text: &str) -> Result<Self, GateError> {
        let bad = || GateError::BadTolerance { found: text.to_owned() };
        if text == "off" {
            return Ok(Self::OFF);
        }
        // A plus after an e belongs to an exponent.
        let plus = text.char_indices().find(|&(at, c)| c == '+' && !text[..at].ends_with(['e', 'E']));
        let (relative, absolute) = plus.map_or((text, "0"), |(at, _)| (&text[..at], &text[at + 1..]));
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0);
        let relative = match relative.trim().strip_suffix('%') {
            Some(percent) => number(percent).map(|percent| percent / 100.0),
            None => number(relative),
        };
        Ok(Self { relative: relative.ok_or_else(bad)?, absolute: number(absolute).ok_or_else(bad)? })
    }
}

/// A tolerance in a file: text, or a number where a share is meant.
#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Number(f64),
    Text(String),
}

impl TryFrom<Written> for Tolerance {
    type Error = GateError;

    fn try_from(written: Written) -> Result<Self, GateError> {
        match written {
            Written::Number(share) => share.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<Tolerance> for String {
    fn from(tolerance: Tolerance) -> Self {
        tolerance.to_string()
    }
}

/// How far each figure may move. In TOML:
///
/// ```
/// let text = "times = \"off\"\n[figures]\nrms_relative = \"1%\"\nflipped_faces = \"0+2\"\n";
/// let tolerances = pliant_study::Tolerances::parse(text, "tolerances.toml")?;
/// assert_eq!(tolerances.figures["rms_relative"].relative, 0.01);
/// # Ok::<(), pliant_study::GateError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerances {
    /// Of errors. Default: a millionth, and 1e-9 beside it for those that are nothing but rounding. On one machine they are the
    /// same to the last bit; another processor or system library rounds a few of the operations in them otherwise, which moved none by more
    /// than 5e-12 of itself on shapes without symmetries.
    pub errors: Tolerance,
    /// Of distances to the converged pose. Default: 1 %, and 1e-6 of the diagonal. Where thousands of steps end hangs on the last bits of the
    /// first: sums in another order moved distances by up to 0.1 % of themselves, and no other figure.
    pub distances: Tolerance,
    /// Of numbers of faces and rows. Default: none.
    pub counts: Tolerance,
    /// Of times, as multiples of what a loop takes ([`crate::calibrate`]). Default: 50 % and 0.05 ms, where caches and clocks have the last word.
    pub times: Tolerance,
    /// Of memory. Default: 30 %, and 32 MB, as what was freed may or may not have gone back to the system.
    pub memory: Tolerance,
    /// Of single figures, by their names in reports, in place of the above.
    pub figures: BTreeMap<String, Tolerance>,
}

impl Default for Tolerances {
    fn default() -> Self {
        let tolerance = |relative, absolute| Tolerance { relative, absolute };
        Self {
            errors: tolerance(1e-6, 1e-9),
            distances: tolerance(0.01, 1e-6),
            counts: tolerance(0.0, 0.0),
            times: tolerance(0.5, 0.05),
            memory: tolerance(0.3, 32e6),
            figures: BTreeMap::new(),
        }
    }
}

/// No file of tolerances needs more.
const MAX_BYTES: u64 = 1 << 20;

impl Tolerances {
    /// Reads TOML; `file` names the text's origin in errors.
    ///
    /// # Errors
    /// Names file, line and what is not understood.
    pub fn parse(text: &str, file: &str) -> Result<Self, GateError> {
        let bad = |message: String| GateError::File { file: file.to_owned(), message };
        let read: Self = toml::from_str(text).map_err(|error| bad(error.to_string().trim_end().to_owned()))?;
        read.figures.keys().try_for_each(|name| known(name)).map_err(|error| bad(error.to_string()))?;
        Ok(read)
    }

    /// Reads a TOML file of at most 1 MiB.
    ///
    /// # Errors
    /// As [`Self::parse`]; the file cannot be read or is too large.
    pub fn read(path: &Path) -> Result<Self, GateError> {
        let file = path.display().to_string();
        let text = String::from_utf8(read_regular(path, MAX_BYTES)?)
            .map_err(|_| GateError::File { file: file.clone(), message: "not UTF-8 text".to_owned() })?;
        Self::parse(&text, &file)
    }

    /// Sets the tolerance of a figure, or of all `errors`, `distances`, `counts`, `times` or of `memory`.
    ///
    /// # Errors
    /// There is no such figure.
    pub fn set(&mut self, name: &str, tolerance: Tolerance) -> Result<(), GateError> {
        match name {
            "errors" => self.errors = tolerance,
            "distances" => self.distances = tolerance,
            "counts" => self.counts = tolerance,
            "times" => self.times = tolerance,
            "memory" => self.memory = tolerance,
            _ => {
                known(name)?;
                self.figures.insert(name.to_owned(), tolerance);
            }
        }
        Ok(())
    }

    /// Compares neither times nor memory.
    pub fn leave_out_times(&mut self) {
        (self.times, self.memory) = (Tolerance::OFF, Tolerance::OFF);
        let takes =
            |name: &str| FIGURES.iter().any(|f| f.name == name && matches!(f.group, Group::Time | Group::Memory));
        self.figures.retain(|name, _| !takes(name));
    }

    pub(super) fn of(&self, name: &str, group: Group) -> Tolerance {
        let of_group = match group {
            Group::Error | Group::Neutral => self.errors,
            Group::Distance => self.distances,
            Group::Count => self.counts,
            Group::Time => self.times,
            Group::Memory => self.memory,
        };
        self.figures.get(name).copied().unwrap_or(of_group)
    }

    /// Whether some time is compared.
    pub fn compare_times(&self) -> bool {
        FIGURES.iter().any(|figure| figure.group == Group::Time && !self.of(figure.name, figure.group).is_off())
    }
}

fn known(name: &str) -> Result<(), GateError> {
    if FIGURES.iter().any(|figure| figure.name == name) {
        return Ok(());
    }
    let known = FIGURES.iter().map(|figure| figure.name).collect::<Vec<_>>().join(", ");
    Err(GateError::NoSuchFigure { found: name.to_owned(), known })
}
