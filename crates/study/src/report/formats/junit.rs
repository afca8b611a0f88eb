//! JUnit XML, as CI systems show it.
//!
//! Written to what the schemas of Jenkins' xUnit plugin (`junit-10.xsd`) and of Maven Surefire (`surefire-test-report.xsd`, which knows
//! single suites) both allow: a case has no properties there and no other time than plain seconds, so figures stand in its output.

use std::fmt::Write as _;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::{on_one_line, row_names};
use crate::report::columns::COLUMNS;
use crate::report::{Failure, FailureKind, SweepReport, SweepRow};

type Sink = Writer<Vec<u8>>;
type Written = std::io::Result<()>;

/// Columns that stand elsewhere in a case.
const NOT_IN_OUTPUT: [&str; 5] = ["model", "scene", "failure", "failure_kind", "warnings"];

/// Rows of one model and scene.
struct Suite<'r> {
    model: &'r str,
    /// None for a model that was refused.
    scene: Option<&'r str>,
    cases: Vec<Case<'r>>,
}

struct Case<'r> {
    name: String,
    seconds: f64,
    outcome: Outcome<'r>,
    /// A line per figure.
    output: String,
    /// A line per warning.
    warnings: String,
}

enum Outcome<'r> {
    Passed,
    /// The edit was made and cannot be used.
    Failure(&'r str),
    /// What was asked for cannot be done, or Pliant is at fault: the kind and the reason.
    Error(&'static str, &'r str),
}

impl SweepReport {
    /// JUnit XML: a suite per model and scene, a case per row, named by its setting.
    ///
    /// A row whose computation failed ([`FailureKind::Numeric`]) is a `failure`. One that was refused ([`FailureKind::Input`]) is an `error`,
    /// as is, in a suite of its own, a model that was refused: `skipped` would leave a pipeline green that did not do what was asked. The
    /// time of a case, in seconds, is that of all its stages: cage, binding, preparation, every step of the drag, propagation, refinement;
    /// stages that rows share count in each. Every figure that the row has is a line `name=value` of its `system-out`, as
    /// [`SweepReport::to_csv`] writes it, warnings are its `system-err`, and the suite's properties tell model, version and machine.
    pub fn to_junit(&self) -> String {
        let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
        self.write_junit(&mut xml, &self.suites()).expect("a vector takes all that is written");
        let mut text = String::from_utf8(xml.into_inner()).expect("made of strings");
        text.push('\n');
        text
    }

    fn suites(&self) -> Vec<Suite<'_>> {
        let mut suites: Vec<(&str, &str, Vec<&SweepRow>)> = Vec::new();
        for row in &self.rows {
            match suites.iter_mut().find(|(model, scene, _)| (*model, *scene) == (&row.model, &row.scene)) {
                Some((.., rows)) => rows.push(row),
                None => suites.push((&row.model, &row.scene, vec![row])),
            }
        }
        let of_rows = suites.into_iter().map(|(model, scene, rows)| {
            let names = row_names(rows.iter().copied(), usize::MAX, |row| row.key().setting());
            let cases = names.into_iter().zip(rows).map(|(name, row)| Case::of_row(name, row)).collect();
            Suite { model, scene: Some(scene), cases }
        });
        let refused = self.refused.iter().map(|refusal| {
            let (name, outcome) = ("read".to_owned(), Outcome::Error(FailureKind::Input.name(), &refusal.reason));
            Suite {
                model: &refusal.model,
                scene: None,
                cases: vec![Case { name, seconds: 0.0, outcome, output: String::new(), warnings: String::new() }],
            }
        });
        of_rows.chain(refused).collect()
    }

    fn write_junit(&self, xml: &mut Sink, suites: &[Suite<'_>]) -> Written {
        xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        let cases = || suites.iter().flat_map(|suite| &suite.cases);
        let counts = Counts::of(cases());
        let root = xml.create_element("testsuites").with_attributes([
            ("name", "pliant sweep"),
            ("tests", counts.tests.as_str()),
            ("failures", counts.failures.as_str()),
            ("errors", counts.errors.as_str()),
            ("time", counts.time.as_str()),
        ]);
        if suites.is_empty() {
            return root.write_empty().map(drop);
        }
        root.write_inner_content(|xml| suites.iter().try_for_each(|suite| self.write_suite(xml, suite))).map(drop)
    }

    fn write_suite(&self, xml: &mut Sink, suite: &Suite<'_>) -> Written {
        let counts = Counts::of(suite.cases.iter());
        let name = match suite.scene {
            Some(scene) => format!("{}, scene {scene}", suite.model),
            None => suite.model.to_owned(),
        };
        let element = xml.create_element("testsuite").with_attributes([
            ("name", on_one_line(&name).as_str()),
            ("tests", counts.tests.as_str()),
            ("failures", counts.failures.as_str()),
            ("errors", counts.errors.as_str()),
            ("skipped", "0"),
            ("time", counts.time.as_str()),
        ]);
        // Consumers take what stands before the last dot for a package.
        let parts = [Some(suite.model), suite.scene].into_iter().flatten();
        let class = parts.map(|part| on_one_line(part).replace('.', "_")).collect::<Vec<_>>().join(".");
        element
            .write_inner_content(|xml| {
                self.write_properties(xml, suite.model)?;
                suite.cases.iter().try_for_each(|case| case.write(xml, &class))
            })
            .map(drop)
    }

    fn write_properties(&self, xml: &mut Sink, model: &str) -> Written {
        let mut properties = vec![
            ("schema", on_one_line(&self.schema)),
            ("version", on_one_line(&self.version)),
            ("model", on_one_line(model)),
        ];
        if let Some(info) = self.models.iter().find(|info| info.name == model) {
            properties.push(("vertices", info.vertices.to_string()));
            properties.push(("faces", info.faces.to_string()));
        }
        if let Some(machine) = &self.machine {
            properties.extend(machine.cpu.as_deref().map(|cpu| ("cpu", on_one_line(cpu))));
            properties.push(("threads", machine.threads.to_string()));
        }
        let write = |xml: &mut Sink| {
            properties.iter().try_for_each(|(name, value)| {
                let property = xml.create_element("property");
                property.with_attributes([("name", *name), ("value", value.as_str())]).write_empty().map(drop)
            })
        };
        xml.create_element("properties").write_inner_content(write).map(drop)
    }
}

impl<'r> Case<'r> {
    fn of_row(name: String, row: &'r SweepRow) -> Self {
        let outcome = match &row.failure {
            None => Outcome::Passed,
            Some(Failure { kind: FailureKind::Numeric, reason }) => Outcome::Failure(reason),
            Some(Failure { kind, reason }) => Outcome::Error(kind.name(), reason),
        };
        let mut output = String::new();
        for column in COLUMNS.iter().filter(|column| !NOT_IN_OUTPUT.contains(&column.key)) {
            let value = (column.cell)(row).exact();
            if !value.is_empty() {
                let _ = writeln!(output, "{}={}", column.key, on_one_line(&value));
            }
        }
        let warnings = row.warnings.iter().map(|warning| on_one_line(warning) + "\n").collect();
        Self { name, seconds: seconds(row), outcome, output, warnings }
    }

    fn write(&self, xml: &mut Sink, class: &str) -> Written {
        let time = in_seconds(self.seconds);
        let case = xml.create_element("testcase").with_attributes([
            ("name", self.name.as_str()),
            ("classname", class),
            ("time", time.as_str()),
        ]);
        let outcome = match self.outcome {
            Outcome::Passed => None,
            Outcome::Failure(reason) => Some(("failure", "numeric", reason)),
            Outcome::Error(kind, reason) => Some(("error", kind, reason)),
        };
        case.write_inner_content(|xml| {
            if let Some((element, kind, reason)) = outcome {
                let reason = on_one_line(reason);
                let element = xml.create_element(element);
                element
                    .with_attributes([("message", reason.as_str()), ("type", kind)])
                    .write_text_content(BytesText::new(&reason))?;
            }
            for (element, text) in [("system-out", &self.output), ("system-err", &self.warnings)] {
                if !text.is_empty() {
                    xml.create_element(element).write_text_content(BytesText::new(text))?;
                }
            }
            Ok(())
        })
        .map(drop)
    }
}

/// Attributes of a suite or of all.
struct Counts {
    tests: String,
    failures: String,
    errors: String,
    time: String,
}

impl Counts {
    fn of<'c>(cases: impl Iterator<Item = &'c Case<'c>>) -> Self {
        let (mut tests, mut failures, mut errors, mut seconds) = (0, 0, 0, 0.0);
        for case in cases {
            tests += 1;
            failures += usize::from(matches!(case.outcome, Outcome::Failure(_)));
            errors += usize::from(matches!(case.outcome, Outcome::Error(..)));
            seconds += case.seconds;
        }
        let [tests, failures, errors] = [tests, failures, errors].map(|n: usize| n.to_string());
        Self { tests, failures, errors, time: in_seconds(seconds) }
    }
}

/// Seconds with the three decimals that Surefire allows, without an exponent.
fn in_seconds(seconds: f64) -> String {
    format!("{seconds:.3}")
}

/// All stages of a row, the drag as often as it has steps: a drag that runs until it converges is timed as a whole.
fn seconds(row: &SweepRow) -> f64 {
    let times = &row.times;
    let drags = if row.iterations.is_some() || row.linear { row.steps.max(1) as f64 } else { 1.0 };
    let once = [times.simplify_ms, times.bind_ms, times.prepare_ms, times.propagate_ms, times.refine_ms];
    let stages = once.map(|time| (time, 1.0)).into_iter().chain([(times.drag_ms, drags)]);
    let ms = stages.filter_map(|(time, often)| Some(time?.median * often));
    1e-3 * ms.filter(|ms| ms.is_finite() && *ms >= 0.0).fold(0.0, |all, ms| all + ms)
}
