//! What cargo and the user ask of a bench without a harness.

/// Arguments of a bench that is to run.
pub(crate) struct Arguments {
    /// Whether times are wanted; otherwise everything only has to work.
    pub(crate) measured: bool,
    /// Numbers among the arguments.
    pub(crate) numbers: Vec<usize>,
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
    let (numbers, words): (Vec<&String>, Vec<&String>) =
        arguments.iter().filter(|a| !a.starts_with('-')).partition(|a| a.parse::<usize>().is_ok());
    if !words.is_empty() && words.iter().all(|word| !name.contains(word.as_str())) {
        eprintln!("{name} is not among the benches asked for");
        return None;
    }
    let numbers = numbers.iter().filter_map(|n| n.parse().ok()).collect();
    Some(Arguments { measured: has("--bench") && !has("--test"), numbers })
}
