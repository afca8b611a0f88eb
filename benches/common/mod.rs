//! What cargo and the user ask of a bench without a harness.
#![allow(dead_code, reason = "each bench takes what it needs")]

use std::error::Error;
use std::path::Path;

use pliant::{TriMesh, creature, read};

/// Arguments of a bench that is to run.
pub(crate) struct Arguments {
    /// Whether times are wanted; otherwise everything only has to work.
    pub(crate) measured: bool,
    /// Numbers among the arguments.
    pub(crate) numbers: Vec<usize>,
    /// Models among them: files of the folder `models`, and generated creatures (`creature:N`).
    pub(crate) models: Vec<String>,
}

/// The arguments for the bench `name`; `None` if it is to run nothing.
///
/// Cargo hands every bench the same arguments: `--bench` when benches are to be measured (else they are only tested), options of
/// other harnesses, which are skipped, and words that choose benches by name.
pub(crate) fn arguments(name: &str) -> Option<Arguments> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let has = |flag: &str| arguments.iter().any(|a| a == flag);
    if has("--list") {
        println!("{name}: benchmark");
        return None;
    }
    let typed = arguments.iter().filter(|a| !a.starts_with('-'));
    let (models, others): (Vec<&String>, Vec<&String>) =
        typed.partition(|a| a.contains('.') || a.starts_with("creature:"));
    let (numbers, words): (Vec<&String>, Vec<&String>) = others.into_iter().partition(|a| a.parse::<usize>().is_ok());
    if models.is_empty() && !words.is_empty() && words.iter().all(|word| !name.contains(word.as_str())) {
        eprintln!("{name} is not among the benches asked for");
        return None;
    }
    let numbers = numbers.iter().filter_map(|n| n.parse().ok()).collect();
    let models = models.into_iter().cloned().collect();
    Some(Arguments { measured: has("--bench") && !has("--test"), numbers, models })
}

/// A model of [`Arguments::models`]; `None`, which is said, if its file was not fetched.
pub(crate) fn model(name: &str) -> Result<Option<TriMesh>, Box<dyn Error>> {
    if let Some(vertices) = name.strip_prefix("creature:") {
        return Ok(Some(creature(vertices.parse()?)?));
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join(name);
    if !path.exists() {
        eprintln!("SKIPPED: {name} (scripts/fetch-models brings it)");
        return Ok(None);
    }
    Ok(Some(read(&path)?.mesh))
}
