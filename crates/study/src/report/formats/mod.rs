//! The forms that a report is written in for other programs, and their names.

mod dashboards;
mod jsonl;
mod junit;
#[cfg(feature = "parquet")]
mod parquet;
mod summary;
#[cfg(test)]
mod tests;

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use super::{Detail, SweepReport, SweepRow};

pub use summary::SUMMARY_BYTES;

/// A form of a report. Read and written by its name: [`Self::ALL`] in the order here is `json`, `csv`, `jsonl`, `md`, `summary`, `svg`, `relative`, `html`,
/// `junit`, `github-benchmark`, `bencher`, `parquet`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum ReportFormat {
    /// [`SweepReport::to_json`]: everything; the one form that is read back.
    Json,
    /// [`SweepReport::to_csv`].
    Csv,
    /// [`SweepReport::to_jsonl`].
    Jsonl,
    /// [`SweepReport::to_markdown`] with every column.
    Markdown,
    /// [`SweepReport::to_summary`] within [`SUMMARY_BYTES`].
    Summary,
    /// [`SweepReport::to_svg`].
    Svg,
    /// [`SweepReport::to_relative_svg`].
    Relative,
    /// [`SweepReport::to_html`].
    Html,
    /// [`SweepReport::to_junit`].
    Junit,
    /// [`SweepReport::to_github_benchmark`].
    GithubBenchmark,
    /// [`SweepReport::to_bencher`].
    Bencher,
    /// `SweepReport::to_parquet`, which is there with the cargo feature `parquet`.
    Parquet,
}

/// Why a report cannot be written in a form.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FormatError {
    /// No form has this name.
    #[error("`{found}` is no form of a report: use {}", ReportFormat::names())]
    Unknown {
        /// What was given.
        found: String,
    },
    /// Pliant was built without it.
    #[error("this build of Pliant does not write {format}: build it with `--features {format}`")]
    NotBuilt {
        /// The form, named as the feature is.
        format: ReportFormat,
    },
    /// The rows do not make a Parquet file.
    #[cfg(feature = "parquet")]
    #[error("Parquet: {0}")]
    Parquet(#[from] ::parquet::errors::ParquetError),
}

impl ReportFormat {
    /// Every form.
    pub const ALL: [Self; 12] = [
        Self::Json,
        Self::Csv,
        Self::Jsonl,
        Self::Markdown,
        Self::Summary,
        Self::Svg,
        Self::Relative,
        Self::Html,
        Self::Junit,
        Self::GithubBenchmark,
        Self::Bencher,
        Self::Parquet,
    ];

    /// Its name, and what is added behind a dot to a prefix that several forms share. No two are the same.
    const fn name_and_extension(self) -> (&'static str, &'static str) {
        match self {
            Self::Json => ("json", "json"),
            Self::Csv => ("csv", "csv"),
            Self::Jsonl => ("jsonl", "jsonl"),
            Self::Markdown => ("md", "md"),
            Self::Summary => ("summary", "summary.md"),
            Self::Svg => ("svg", "svg"),
            Self::Relative => ("relative", "relative.svg"),
            Self::Html => ("html", "html"),
            Self::Junit => ("junit", "junit.xml"),
            Self::GithubBenchmark => ("github-benchmark", "github-benchmark.json"),
            Self::Bencher => ("bencher", "bencher.json"),
            Self::Parquet => ("parquet", "parquet"),
        }
    }

    /// Its name: `junit`, `github-benchmark`.
    pub const fn name(self) -> &'static str {
        self.name_and_extension().0
    }

    /// The end of its files' names, without the first dot: `junit.xml`, `github-benchmark.json`. No two forms share one.
    pub const fn extension(self) -> &'static str {
        self.name_and_extension().1
    }

    /// Whether this build writes it.
    pub const fn is_built(self) -> bool {
        !matches!(self, Self::Parquet) || cfg!(feature = "parquet")
    }

    fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl fmt::Display for ReportFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Reads a name, also of a form that this build does not write.
impl FromStr for ReportFormat {
    type Err = FormatError;

    fn from_str(text: &str) -> Result<Self, FormatError> {
        let found = Self::ALL.into_iter().find(|format| format.name() == text);
        found.ok_or_else(|| FormatError::Unknown { found: text.to_owned() })
    }
}

impl SweepReport {
    /// The report in a form: UTF-8 text, but for Parquet.
    ///
    /// # Errors
    /// [`FormatError::NotBuilt`] where [`ReportFormat::is_built`] says so.
    pub fn to_bytes(&self, format: ReportFormat) -> Result<Vec<u8>, FormatError> {
        let text = match format {
            ReportFormat::Json => self.to_json(),
            ReportFormat::Csv => self.to_csv(),
            ReportFormat::Jsonl => self.to_jsonl(),
            ReportFormat::Markdown => self.to_markdown(Detail::Full),
            ReportFormat::Summary => self.to_summary(SUMMARY_BYTES),
            ReportFormat::Svg => self.to_svg(),
            ReportFormat::Relative => self.to_relative_svg(),
            ReportFormat::Html => self.to_html(),
            ReportFormat::Junit => self.to_junit(),
            ReportFormat::GithubBenchmark => self.to_github_benchmark(),
            ReportFormat::Bencher => self.to_bencher(),
            #[cfg(feature = "parquet")]
            ReportFormat::Parquet => return self.to_parquet(),
            #[cfg(not(feature = "parquet"))]
            ReportFormat::Parquet => return Err(FormatError::NotBuilt { format }),
        };
        Ok(text.into_bytes())
    }
}

/// A name per row, on one line, at most `longest` bytes long, and never the same twice: forms that know rows by name would lose one.
fn row_names<'r>(
    rows: impl Iterator<Item = &'r SweepRow>,
    longest: usize,
    name: impl Fn(&SweepRow) -> String,
) -> Vec<String> {
    let mut taken = HashSet::new();
    // Where counting goes on for a name that was there before.
    let mut numbers = HashMap::new();
    rows.map(|row| {
        let name = on_one_line(&name(row));
        let mut unique = cut(&name, longest);
        let number = numbers.entry(unique.clone()).or_insert(1_usize);
        while !taken.insert(unique.clone()) {
            *number += 1;
            let suffix = format!(" ({number})");
            unique = cut(&name, longest.saturating_sub(suffix.len())) + &suffix;
        }
        unique
    })
    .collect()
}

/// Text without control characters, breaks of lines and space round it.
pub(crate) fn on_one_line(text: &str) -> String {
    let breaks = |c: char| c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{fffe}' | '\u{ffff}');
    text.replace(breaks, " ").trim().to_owned()
}

/// At most `longest` bytes of a text, from 3; a cut shows.
fn cut(text: &str, longest: usize) -> String {
    const DOTS: &str = "\u{2026}";
    if text.len() <= longest {
        return text.to_owned();
    }
    let mut end = longest.saturating_sub(DOTS.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}{DOTS}", text[..end].trim_end())
}
