//! The report of a comparison of methods: a table for each case, and one of their own for the methods of Fu et al.

use std::fmt::Write as _;
use std::time::Duration;

use pliant_deform::ImplicitReport;
use serde::{Deserialize, Serialize};

use super::columns::Cell;
use super::table::{csv, in_markdown, write_padded};
use super::{Detail, SweepReport};
use crate::stages::milliseconds;

/// Methods on one case or several.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Comparison {
    /// A shape and a scene each, with one row for each method.
    pub cases: Vec<SweepReport>,
    /// What implicit Laplacian editing counts and times, for each of its rows.
    pub implicit: Vec<ImplicitRow>,
}

/// A line of Table 1 of Fu, Au and Tai (2006); times in milliseconds, those of solving of the last solve.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ImplicitRow {
    /// The shape.
    pub model: String,
    /// Name of the scene.
    pub scene: String,
    /// The method with its options.
    pub method: String,
    /// Vertices solved for, of the cage where there is one.
    pub free_vertices: usize,
    /// Vertices without a well-conditioned ring (section 3.3).
    pub degenerate_vertices: usize,
    /// Assembling and factoring Eq. 7.
    pub factor_first_ms: f64,
    /// Solving Eq. 7.
    pub solve_first_ms: f64,
    /// Assembling and factoring Eq. 9 and 10, which share a matrix.
    pub factor_second_ms: f64,
    /// Solving Eq. 9 or 10.
    pub solve_second_ms: f64,
    /// Rotations and scales of all gradients, the paper's column SVD.
    pub svd_ms: f64,
}

impl ImplicitRow {
    /// The line of one solve.
    pub(crate) fn new(model: &str, scene: &str, method: &str, report: &ImplicitReport) -> Self {
        let ms = |time: Duration| milliseconds(time);
        Self {
            model: model.to_owned(),
            scene: scene.to_owned(),
            method: method.to_owned(),
            free_vertices: report.free_vertices,
            degenerate_vertices: report.degenerate_vertices,
            factor_first_ms: ms(report.factor_first),
            solve_first_ms: ms(report.solve_first),
            factor_second_ms: ms(report.factor_second),
            solve_second_ms: ms(report.solve_second),
            svd_ms: ms(report.svd),
        }
    }
}

impl Comparison {
    /// Indented JSON, `{"cases": [..], "implicit": [..]}`, ending with a line break; each case is as [`SweepReport::to_json`] writes it.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("every key is a string and no value can fail") + "\n"
    }

    /// The rows of all cases under one header, as [`SweepReport::to_csv`] writes them.
    pub fn to_csv(&self) -> String {
        csv(self.cases.iter().flat_map(|case| &case.rows))
    }

    /// Markdown: a heading and a table for each case, then the table of implicit Laplacian editing if there are lines for it.
    pub fn to_markdown(&self, detail: Detail) -> String {
        let mut out = String::new();
        for case in &self.cases {
            let _ = writeln!(out, "## {}\n\n{}", in_markdown(&case.subject()), case.to_markdown(detail));
        }
        if !self.implicit.is_empty() {
            out.push_str("## Implicit Laplacian editing, the columns of its paper's Table 1\n\n");
            self.write_implicit(&mut out);
        }
        out
    }

    fn write_implicit(&self, out: &mut String) {
        const HEADINGS: [&str; 10] = [
            "model",
            "scene",
            "method",
            "free vertices",
            "degenerate vertices",
            "factor Eq. 7 (ms)",
            "solve Eq. 7 (ms)",
            "factor Eq. 9/10 (ms)",
            "solve Eq. 9/10 (ms)",
            "SVD (ms)",
        ];
        let mut lines = vec![HEADINGS.map(str::to_owned).to_vec()];
        for row in &self.implicit {
            let names = [&row.model, &row.scene, &row.method].map(|name| in_markdown(name));
            let counts = [row.free_vertices, row.degenerate_vertices].map(|n| Cell::Count(n).rounded());
            let times =
                [row.factor_first_ms, row.solve_first_ms, row.factor_second_ms, row.solve_second_ms, row.svd_ms];
            let times = times.map(|time| Cell::Time(time).rounded());
            lines.push(names.into_iter().chain(counts).chain(times).collect());
        }
        let numeric: Vec<bool> = (0..HEADINGS.len()).map(|k| k >= 3).collect();
        write_padded(out, &lines, &numeric);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ModelInfo, SweepRow};

    /// Two cases, the second with a line of Table 1; a name that Markdown would read as the end of a cell.
    fn comparison() -> Comparison {
        let case = |name: &str, methods: &[&str]| {
            let mut report = SweepReport::new(vec![ModelInfo { name: name.to_owned(), ..ModelInfo::default() }]);
            let row = |method: &&str| SweepRow {
                model: name.to_owned(),
                scene: "scene".to_owned(),
                method: (*method).to_owned(),
                ..SweepRow::default()
            };
            report.rows = methods.iter().map(row).collect();
            report
        };
        let report = ImplicitReport {
            free_vertices: 48_027,
            degenerate_vertices: 61,
            factor_first: Duration::from_micros(4_813_000),
            solve_first: Duration::from_micros(188_000),
            factor_second: Duration::from_micros(875_000),
            solve_second: Duration::from_micros(78_000),
            svd: Duration::from_micros(985_000),
        };
        Comparison {
            cases: vec![case("a|b", &["arap", "dual"]), case("c", &["implicit"])],
            implicit: vec![ImplicitRow::new("c", "scene", "implicit", &report)],
        }
    }

    #[test]
    fn all_cases_stand_in_every_form() {
        let comparison = comparison();
        let json = comparison.to_json();
        assert_eq!(serde_json::from_str::<Comparison>(&json).expect("JSON"), comparison);
        // A header and three rows.
        assert_eq!(comparison.to_csv().matches("\r\n").count(), 4);
        let text = comparison.to_markdown(Detail::Main);
        assert!(text.contains("## a\\|b, scene scene") && text.contains("## c, scene scene"), "{text}");
    }

    /// The paper's line for the Armadillo, in its own order of columns.
    #[test]
    fn the_implicit_table_has_the_papers_columns() {
        let text = comparison().to_markdown(Detail::Main);
        let last = text.lines().last().expect("a table");
        let cells: Vec<&str> = last.trim_matches('|').split('|').map(str::trim).collect();
        assert_eq!(cells, ["c", "scene", "implicit", "48027", "61", "4813", "188", "875", "78.0", "985"]);
        let none = Comparison { implicit: Vec::new(), ..comparison() };
        assert!(!none.to_markdown(Detail::Full).contains("Eq. 7"));
    }
}
