//! What moved, as JUnit XML.

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};

use super::{Change, GateReport};
use crate::report::on_one_line;

type Written = std::io::Result<()>;

impl GateReport {
    /// JUnit XML: one suite with a case for each row of the baseline, which has a `failure` where something is worse, and an `error` where the
    /// row has no figures any more. What else moved is the case's `system-out`.
    pub fn to_junit(&self) -> String {
        let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
        self.write_junit(&mut xml).expect("a vector takes all that is written");
        String::from_utf8(xml.into_inner()).expect("made of strings") + "\n"
    }

    fn write_junit(&self, xml: &mut Writer<Vec<u8>>) -> Written {
        xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        let cases: Vec<Vec<&Change>> = (0..self.rows.len())
            .map(|at| self.changes.iter().filter(|change| change.at == Some(at)).collect())
            .collect();
        let errors = cases.iter().filter(|changes| is_error(changes)).count();
        let failures = cases.iter().filter(|changes| worse(changes).next().is_some()).count() - errors;
        let [tests, failures, errors] = [self.rows.len(), failures, errors].map(|n| n.to_string());
        let counts = [
            ("name", "pliant check"),
            ("tests", tests.as_str()),
            ("failures", failures.as_str()),
            ("errors", errors.as_str()),
        ];
        let suite = |xml: &mut Writer<Vec<u8>>| {
            for (row, changes) in self.rows.iter().zip(&cases) {
                write_case(xml, row, changes)?;
            }
            let lines: Vec<String> = self.notes.iter().map(|note| on_one_line(note)).chain([self.summary()]).collect();
            write_text(xml, "system-out", &lines.join("\n"))
        };
        let suites = |xml: &mut Writer<Vec<u8>>| {
            xml.create_element("testsuite").with_attributes(counts).write_inner_content(suite).map(drop)
        };
        xml.create_element("testsuites").with_attributes(counts).write_inner_content(suites).map(drop)
    }
}

fn worse<'c>(changes: &'c [&Change]) -> impl Iterator<Item = &'c Change> {
    changes.iter().copied().filter(|change| change.kind.is_regression())
}

fn is_error(changes: &[&Change]) -> bool {
    changes.iter().any(|change| change.failure.is_some())
}

fn write_case(xml: &mut Writer<Vec<u8>>, row: &str, changes: &[&Change]) -> Written {
    let row = on_one_line(row);
    let case = xml.create_element("testcase").with_attributes([("name", row.as_str()), ("classname", "pliant.check")]);
    if changes.is_empty() {
        return case.write_empty().map(drop);
    }
    let content = |xml: &mut Writer<Vec<u8>>| {
        let said: Vec<String> = worse(changes).map(|change| on_one_line(&change.said())).collect();
        if let Some(first) = said.first() {
            let element = xml.create_element(if is_error(changes) { "error" } else { "failure" });
            let element = element.with_attributes([("message", first.as_str()), ("type", "regression")]);
            element.write_text_content(BytesText::new(&said.join("\n")))?;
        }
        let others = changes.iter().filter(|change| !change.kind.is_regression());
        let others: Vec<String> =
            others.map(|change| on_one_line(&format!("{}: {}", change.kind.word(), change.said()))).collect();
        if others.is_empty() { Ok(()) } else { write_text(xml, "system-out", &others.join("\n")) }
    };
    case.write_inner_content(content).map(drop)
}

fn write_text(xml: &mut Writer<Vec<u8>>, element: &str, text: &str) -> Written {
    xml.create_element(element).write_text_content(BytesText::new(text)).map(drop)
}
