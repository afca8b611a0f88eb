//! The `pliant` command: what the user typed becomes settings, settings become one library call, its result is printed.

mod args;
mod bench;
mod cage;
mod check;
mod compare;
mod console;
mod demo;
mod edit;
mod exit;
mod info;
mod model;
mod sweep;

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};
use exit::Ending;

fn main() -> ExitCode {
    // clap ends the process itself on wrong use (code 2), --help and --version.
    let arguments = Arguments::parse();
    std::panic::set_hook(Box::new(|panic| console::complain(&report_of(panic))));
    ended(|| run(arguments.command)).into()
}

fn run(command: Command) -> anyhow::Result<Ending> {
    let done = |()| Ending::Done;
    match command {
        Command::Demo(options) => demo::run(&options).map(done),
        Command::Info(options) => info::run(&options).map(done),
        Command::Cage(options) => cage::run(&options).map(done),
        Command::Edit(options) => edit::run(&options).map(done),
        Command::Sweep(options) => sweep::run(&options),
        Command::Check(options) => check::run(&options),
        Command::Compare(options) => compare::run(&options).map(done),
        Command::Bench(options) => bench::run(&options).map(done),
    }
}

/// How a call ends; an error is told, a panic was.
fn ended(call: impl FnOnce() -> anyhow::Result<Ending>) -> Ending {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(ending)) => ending,
        Ok(Err(error)) if is_broken_pipe(&error) => Ending::Done,
        Ok(Err(error)) => {
            console::complain(&message(&error));
            Ending::of(&error)
        }
        Err(_) => Ending::Internal,
    }
}

/// What is said of a panic, and how to report it.
fn report_of(panic: &PanicHookInfo<'_>) -> String {
    let payload = panic.payload();
    let said = payload.downcast_ref::<String>().map(String::as_str).or_else(|| payload.downcast_ref::<&str>().copied());
    let said = said.unwrap_or("no more is known");
    let place = panic.location().map_or(String::new(), |place| format!(" at {place}"));
    format!(
        "pliant: internal error{place}: {said}\n\
         This is a fault of Pliant, not of what it was given. Please report it: these lines, the command that was typed, \
         the version ({}), and the input if it may be passed on.",
        env!("CARGO_PKG_VERSION")
    )
}

/// The error and its causes, each said once: many of the library's messages end with their cause already.
fn message(error: &anyhow::Error) -> String {
    error.chain().skip(1).fold(format!("pliant: {error}"), |text, cause| {
        let cause = cause.to_string();
        if text.contains(&cause) { text } else { format!("{text}: {cause}") }
    })
}

/// Whether the reader of our output has gone (`pliant ... | head`), which is no fault of ours.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_ends_in_70_and_says_how_to_report_it() {
        let ending = std::thread::spawn(|| {
            std::panic::set_hook(Box::new(|panic| {
                let said = report_of(panic);
                for words in ["main.rs", "nothing is left", "Please report", env!("CARGO_PKG_VERSION")] {
                    assert!(said.contains(words), "{words}: {said}");
                }
            }));
            ended(|| panic!("nothing is left of {}", "it"))
        });
        assert_eq!(ending.join().expect("caught"), Ending::Internal);
        assert_eq!(Ending::Internal as u8, 70);
        assert_eq!(ended(|| Ok(Ending::Regression)), Ending::Regression);
        assert_eq!(ended(|| Err(exit::Misuse("no".to_owned()).into())), Ending::Misuse);
        let pipe = std::io::Error::from(std::io::ErrorKind::BrokenPipe);
        assert_eq!(ended(|| Err(anyhow::Error::from(pipe).context("written"))), Ending::Done);
    }
}
