use std::collections::{BTreeMap, HashMap};

use roxmltree::{Document, Node};
use serde_json::Value;

use super::super::{Calibration, Failure, FailureKind, Machine, ModelInfo, NO_CAGE, Refusal, RowTimes, Spread};
use super::*;

/// What HTML, scripts, XML, templates and Plotly would read as their own.
const HOSTILE: &str =
    "a</script><script>alert(1)</script><!--<script> \"'&amp; <b>b</b> \u{0}\u{1}\r\n{{ 7 }} \u{202e}x \u{e9}\u{2028}";

/// How [`HOSTILE`] is to be read: what HTML does not allow and what turns the direction of text is replaced.
const SHOWN: &str = "a</script><script>alert(1)</script><!--<script> \"'&amp; <b>b</b> \u{fffd}\u{fffd}\u{fffd}\n{{ 7 }} \u{fffd}x \u{e9}\u{2028}";

/// The smallest PNG, of one pixel, with `k` in a comment of its end, in base64; read by nobody here.
fn picture(k: usize) -> String {
    format!("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJ{k:08}AAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==")
}

fn row(method: &str, cage: &str, vertices: usize, iterations: Option<usize>, error: f64) -> SweepRow {
    let direct = cage == NO_CAGE || cage.starts_with("decimated:");
    let or_none = |text: &str| if direct { NO_CAGE } else { text }.to_owned();
    SweepRow {
        model: "shape.obj".to_owned(),
        vertices: 20_000,
        scene: "bend".to_owned(),
        cage_asked: cage.to_owned(),
        cage_vertices: vertices,
        method: method.to_owned(),
        propagation: or_none("frames"),
        prune: or_none("smooth:16"),
        start: or_none("levels"),
        steps: 5,
        iterations,
        rms_relative: error,
        relative_rms: 0.9 * error,
        edge_p95: 2.0 * error,
        edge_max: 9.0 * error,
        volume_change: Some(-0.3 * error),
        flipped_faces: Some(vertices % 7),
        kept_mean: 16.0,
        times: RowTimes {
            repeats: 3,
            drag_ms: Spread::of(&[1e-3 * vertices as f64, 2e-3 * vertices as f64]),
            propagate_ms: (!direct).then(|| Spread::of(&[0.7])).flatten(),
            peak_memory_bytes: Some(52_000_000 + vertices as u64),
            ..RowTimes::default()
        },
        ..SweepRow::default()
    }
}

/// Two methods on three cages, a decimated mesh and without a cage; the second method has no picture without a cage, the last row failed.
fn sample() -> SweepReport {
    let model = ModelInfo { name: "shape.obj".to_owned(), vertices: 20_000, diagonal: 1.7, ..ModelInfo::default() };
    let mut report = SweepReport::new(vec![model]);
    report.machine = Some(Machine {
        cpu: Some("a processor".to_owned()),
        threads: 2,
        calibration: Calibration::of(&[Calibration { quiet_ms: 3.0, taken_ms: 3.0 }]),
    });
    for (method, factor) in [("arap", 1.0), ("dual", 1.5)] {
        for (cage, vertices) in [("5%", 1000), ("200", 200), ("20%", 4000), ("decimated:5%", 1000), (NO_CAGE, 20_000)] {
            let error = factor * (0.02 + 1.0 / vertices as f64);
            report.rows.push(row(method, cage, vertices, Some(2), error));
        }
    }
    report.rows[0].published = Some(0.0321);
    report.rows[0].published_ms = Some(5.5);
    let failure = Failure { kind: FailureKind::Numeric, reason: "it came to nothing".to_owned() };
    report.rows.push(row("arap", "50", 50, Some(2), 0.0).failed(failure));
    report.refused.push(Refusal { model: "broken.obj".to_owned(), reason: "it is no mesh".to_owned() });
    for (k, row) in report.rows.iter_mut().enumerate() {
        row.id = format!("{k:032x}");
        if row.failure.is_none() && (row.method.as_str(), row.cage_asked.as_str()) != ("dual", NO_CAGE) {
            report.pictures.insert(row.id.clone(), picture(k));
        }
    }
    report
}

/// [`sample`] with every text of others hostile.
fn hostile() -> SweepReport {
    let mut report = sample();
    let nasty = |text: &mut String| *text = format!("{HOSTILE}{text}");
    report.version = HOSTILE.to_owned();
    report.notes.push(HOSTILE.to_owned());
    report.models[0].name = HOSTILE.to_owned();
    report.models[0].notes.push(HOSTILE.to_owned());
    report.refused[0] = Refusal { model: HOSTILE.to_owned(), reason: HOSTILE.to_owned() };
    report.machine = Some(Machine { cpu: Some(HOSTILE.to_owned()), ..Machine::default() });
    for row in &mut report.rows {
        [&mut row.model, &mut row.scene, &mut row.method, &mut row.prune, &mut row.start].into_iter().for_each(nasty);
        row.warnings.push(HOSTILE.to_owned());
        if let Some(failure) = &mut row.failure {
            failure.reason = HOSTILE.to_owned();
        }
    }
    report.knees = report.find_knees("error:3%".parse().expect("a target"));
    let id = report.rows[1].id.clone();
    report.pictures.insert(id, "iVBORw0KGgo\" onerror=\"alert(1)".to_owned());
    report
}

/// A page taken apart: the document without its scripts, and the scripts by their ids, those without one by their order.
struct Parts {
    document: String,
    scripts: BTreeMap<String, String>,
}

impl Parts {
    fn of(html: &str) -> Self {
        let (mut document, mut scripts) = (String::new(), BTreeMap::new());
        let mut rest = html.strip_prefix("<!doctype html>").expect("HTML");
        // As a browser does: a script ends where it is first said to.
        while let Some(at) = rest.find("<script") {
            let open = at + rest[at..].find('>').expect("a tag ends") + 1;
            let end = open + rest[open..].find("</script").expect("a script ends");
            let id = rest[at..open].split("id=\"").nth(1).and_then(|id| id.split('"').next());
            scripts.insert(id.map_or(scripts.len().to_string(), str::to_owned), rest[open..end].to_owned());
            document.push_str(&rest[..at]);
            rest = &rest[end + "</script>".len()..];
        }
        document.push_str(rest);
        Self { document, scripts }
    }

    fn json(&self, id: &str) -> Value {
        serde_json::from_str(&self.scripts[id]).expect("JSON")
    }
}

fn elements<'d>(document: &'d Document<'d>, tag: &'static str) -> impl Iterator<Item = Node<'d, 'd>> {
    document.descendants().filter(move |node| node.has_tag_name(tag))
}

fn by_id<'d>(document: &'d Document<'d>, id: &str) -> Node<'d, 'd> {
    document.descendants().find(|node| node.attribute("id") == Some(id)).unwrap_or_else(|| panic!("{id} is there"))
}

fn text(node: Node<'_, '_>) -> String {
    node.descendants().filter_map(|node| node.is_text().then(|| node.text()).flatten()).collect()
}

/// Texts of the cells of a table's rows, the header first.
fn cells(table: Node<'_, '_>) -> Vec<Vec<String>> {
    let of_row = |row: Node<'_, '_>| row.children().filter(Node::is_element).map(text).collect();
    table.descendants().filter(|node| node.has_tag_name("tr")).map(of_row).collect()
}

#[test]
fn the_json_in_the_page_is_the_report() {
    let mut odd = sample();
    for (k, row) in odd.rows.iter_mut().enumerate() {
        row.rms_relative = [f64::NAN, f64::INFINITY, -0.0, 1e300, 5e-324][k % 5];
    }
    for report in [sample(), hostile(), odd] {
        let parts = Parts::of(&report.to_html());
        let json = &parts.scripts["report"];
        assert!(!json.contains('<'));
        let again = SweepReport::read_json(json, "page").expect("a report");
        assert_eq!(again.to_json(), SweepReport { pictures: BTreeMap::new(), ..report }.to_json());
    }
}

#[test]
fn whatever_it_is_given_the_page_is_well_formed_and_shows_it_as_text() {
    let report = hostile();
    let parts = Parts::of(&report.to_html());
    // JSON twice, Plotly.js and the page's own script, and nothing that came from a name.
    assert_eq!(parts.scripts.keys().map(String::as_str).collect::<Vec<_>>(), ["2", "3", "report", "view"]);
    let document = Document::parse(&parts.document).expect("well-formed");
    assert_eq!(elements(&document, "b").filter(|node| text(*node) == "b").count(), 0);
    let handlers = |node: Node<'_, '_>| node.attributes().any(|attribute| attribute.name().starts_with("on"));
    assert!(!document.descendants().any(handlers));
    let table = cells(by_id(&document, "rows"));
    let column = table[0].iter().position(|heading| heading == "model").expect("a column");
    assert!(table[1..].iter().all(|line| line[column] == format!("{SHOWN}shape.obj")));
    let heading = text(elements(&document, "h1").next().expect("a heading"));
    assert!(heading.starts_with(SHOWN), "{heading}");
    let failures = cells(by_id(&document, "failures"));
    assert_eq!((&failures[1][1], &failures[1][3], &failures[2][3]), (&SHOWN.into(), &SHOWN.into(), &SHOWN.into()));
    // The picture that is none is left out, and said to be.
    assert!(!document.descendants().any(|node| node.attribute("id") == Some("picture-2")));
    assert!(text(by_id(&document, "remarks")).contains("row 2: the picture is no PNG"));
    // No rows, nothing but failures, one row.
    let mut failed = sample();
    failed.rows.drain(..10);
    let one = SweepReport { rows: sample().rows[..1].to_vec(), ..SweepReport::default() };
    for (report, scripts) in [(SweepReport::default(), 0), (failed, 4), (one, 4)] {
        let parts = Parts::of(&report.to_html());
        Document::parse(&parts.document).expect("well-formed");
        assert_eq!(parts.scripts.len(), scripts);
    }
}

/// Every address in the page is data in it or a place in it, and the page itself forbids all others.
#[test]
fn nothing_is_fetched() {
    let parts = Parts::of(&sample().to_html());
    let document = Document::parse(&parts.document).expect("well-formed");
    let mut addresses = 0;
    for node in document.descendants() {
        for attribute in
            node.attributes().filter(|attribute| matches!(attribute.name(), "src" | "href" | "data" | "action"))
        {
            let address = attribute.value();
            addresses += 1;
            let target = address.strip_prefix('#').map(|id| by_id(&document, id));
            assert!(target.is_some() || address.starts_with("data:"), "{address}");
        }
    }
    assert!(addresses > 30, "{addresses}");
    let policy =
        elements(&document, "meta").find(|meta| meta.attribute("http-equiv") == Some("Content-Security-Policy"));
    assert!(
        policy.and_then(|meta| meta.attribute("content")).is_some_and(|text| text.starts_with("default-src 'none';"))
    );
    let css = text(elements(&document, "style").next().expect("a style"));
    assert!(!css.contains("url(") && !css.contains("@import"));
}

#[test]
fn the_table_has_every_row_with_its_figures() {
    let report = sample();
    let parts = Parts::of(&report.to_html());
    let document = Document::parse(&parts.document).expect("well-formed");
    let table = cells(by_id(&document, "rows"));
    assert_eq!(table.len(), report.rows.len() + 1);
    let column = |heading: &str| table[0].iter().position(|other| other == heading).expect("a column");
    for (row, line) in report.rows.iter().zip(&table[1..]) {
        assert_eq!(line.len(), table[0].len());
        assert_eq!(line[column("cage asked")], row.cage_asked);
        let error = if row.failure.is_some() { "-".to_owned() } else { format!("{:.2}", 100.0 * row.rms_relative) };
        assert_eq!(line[column("RMS relative (%)")], error);
    }
    // What is the same in all rows is said once, and a column without any value is not there.
    let common = text(by_id(&document, "table"));
    assert!(common.contains("All rows: model: shape.obj; vertices: 20000; scene: bend; steps: 5"), "{common}");
    assert!(!table[0].iter().any(|heading| heading == "refined RMS (%)"));
    let failures = cells(by_id(&document, "failures"));
    assert_eq!(failures[1], ["-", "broken.obj", "refused", "it is no mesh"]);
    assert_eq!(
        (failures[2][0].as_str(), failures[2][2].as_str(), failures[2][3].as_str()),
        ("11", "numeric", "it came to nothing")
    );
    let facts = text(elements(&document, "header").next().expect("a header"));
    assert!(
        facts.contains("11 rows") && facts.contains("1 without figures") && facts.contains("a processor, 2 threads")
    );
}

/// A figure as the page's script finds it is what the table says, as rounded as that is.
#[test]
fn plotted_figures_are_those_of_the_table() {
    let report = sample();
    let parts = Parts::of(&report.to_html());
    let document = Document::parse(&parts.document).expect("well-formed");
    let (rows, view) = (&parts.json("report")["rows"], parts.json("view"));
    let header = by_id(&document, "rows").descendants().filter(|node| node.has_tag_name("th"));
    let keys: Vec<&str> = header.filter_map(|node| node.attribute("data-key")).collect();
    let table = cells(by_id(&document, "rows"));
    let mut compared = 0;
    for figure in view["figures"].as_array().expect("figures") {
        let (key, factor) = (figure["key"].as_str().expect("a key"), figure["factor"].as_f64().expect("a factor"));
        let column = keys.iter().position(|other| *other == key).expect("a column of its own");
        assert_eq!(figure["heading"], table[0][column]);
        for (k, line) in table[1..].iter().enumerate() {
            let row = &rows[k];
            let found = if key == "edit_ms" { &view["edit_ms"][k] } else { row.get(key).unwrap_or(&row["times"][key]) };
            let found = found.get("median").unwrap_or(found);
            // Counts of rows that failed are in JSON, which cannot do without them.
            let (Some(found), Ok(said)) = (found.as_f64(), line[column].parse::<f64>()) else { continue };
            assert!((found * factor - said).abs() <= 0.5 + 5e-3 * said.abs().min(1.0), "{key}: {found} {said}");
            assert!(said.abs() >= 9.99 || (found * factor - said).abs() <= 5.1e-3, "{key}: {found} {said}");
            compared += 1;
        }
    }
    assert!(compared > 100, "{compared}");
    assert_eq!(view["figures"][0]["key"], "rms_relative");
}

/// A row with figures is in one line, those of a line differ in size alone, and a line's points stand by size.
#[test]
fn lines_hold_every_row_once() {
    let mut report = sample();
    report.rows[2].scene = "another".to_owned();
    let view = Parts::of(&report.to_html()).json("view");
    let cases = view["cases"].as_array().expect("cases");
    assert_eq!(
        cases.iter().map(|case| &case["label"]).collect::<Vec<_>>(),
        ["shape.obj, scene bend", "shape.obj, scene another"]
    );
    assert_eq!((&cases[0]["failed"], &cases[1]["failed"]), (&1.into(), &0.into()));
    let mut seen = HashMap::new();
    for line in cases.iter().flat_map(|case| case["lines"].as_array().expect("lines")) {
        let rows: Vec<usize> =
            line["rows"].as_array().expect("rows").iter().map(|k| k.as_u64().expect("a row") as usize).collect();
        let first = &report.rows[rows[0]];
        for &k in &rows {
            let row = &report.rows[k];
            *seen.entry(k).or_insert(0) += 1;
            assert_eq!(
                (&row.method, &row.propagation, row.is_decimated()),
                (&first.method, &first.propagation, first.is_decimated())
            );
            assert_eq!(line["direct"], row.is_direct());
        }
        assert!(rows.is_sorted_by_key(|&k| report.rows[k].cage_vertices));
    }
    assert!((0..10).all(|k| seen.get(&k) == Some(&1)) && seen.len() == 10);
}

/// Each picture is in the page once, with its numbers, in a group with the one of the same edit without a cage, or with one that is said to be another.
#[test]
fn pictures_stand_beside_those_without_a_cage() {
    let report = sample();
    let html = report.to_html();
    let parts = Parts::of(&html);
    let document = Document::parse(&parts.document).expect("well-formed");
    let beside = parts.json("view")["beside"].clone();
    for (k, row) in report.rows.iter().enumerate() {
        let Some(picture) = report.pictures.get(&row.id) else { continue };
        assert_eq!(html.matches(picture.as_str()).count(), 1);
        let figure = by_id(&document, &format!("picture-{}", k + 1));
        let image = figure.descendants().find(|node| node.has_tag_name("img")).expect("an image");
        let error = format!("RMS {:.2} %", 100.0 * row.rms_relative);
        assert!(text(figure).contains(&error) && image.attribute("alt").is_some_and(|alt| alt.contains(&error)));
        let group = figure.ancestors().find(|node| node.attribute("class") == Some("group")).expect("a group");
        let reference =
            group.descendants().find(|node| node.attribute("class") == Some("reference")).expect("a reference");
        // Row 5 is arap without a cage; dual has none, so that arap's stands in for it.
        if row.method == "arap" {
            assert!(
                text(reference).contains("no cage")
                    && reference.descendants().any(|node| node.attribute("id") == Some("picture-5"))
            );
        } else {
            assert!(
                text(reference).contains("no cage, arap, 5 steps of 2 iterations: picture of row 5"),
                "{}",
                text(reference)
            );
        }
        assert_eq!(beside[k], if row.is_direct() { Value::Null } else { 4.into() });
    }
    assert_eq!(elements(&document, "img").count(), report.pictures.len());
    assert!(elements(&document, "img").all(|image| image.attribute("loading") == Some("lazy")));
}

/// A thousand rows take a few kilobytes each beside their pictures, and Plotly.js is there once.
#[test]
fn many_rows_do_not_blow_the_page_up() {
    let one = sample();
    let mut many = one.clone();
    many.rows = (0..1000)
        .map(|k| SweepRow { id: format!("{k:032x}"), scene: format!("scene {}", k % 9), ..one.rows[k % 10].clone() })
        .collect();
    many.pictures.clear();
    let (small, large) = (SweepReport { pictures: BTreeMap::new(), ..one }.to_html().len(), many.to_html().len());
    assert!(large - small < 1000 * 4000, "{small} {large}");
    let plotly = plotly_source();
    assert!(plotly.contains("plotly.js v") && !plotly.contains("</script") && !plotly.contains("<script "));
    assert_eq!(many.to_html().matches("plotly.js v").count(), plotly.matches("plotly.js v").count());
    assert!(small < plotly.len() + 100_000, "{small}");
}

#[test]
fn the_same_report_gives_the_same_page() {
    assert!(hostile().to_html() == hostile().to_html());
}

#[test]
fn rows_in_words() {
    assert_eq!(in_words(&[3]), "row 3");
    assert_eq!(in_words(&[3, 5, 8]), "rows 3, 5 and 8");
    let many: Vec<usize> = (1..=20).collect();
    assert_eq!(in_words(&many), "rows 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12 and 8 more");
}
