//! The `pliant` command: what the user typed becomes settings, settings become one library call, its result is printed.

mod args;
mod bench;
mod cage;
mod compare;
mod console;
mod demo;
mod edit;
mod info;
mod model;
mod sweep;

use std::process::ExitCode;

use clap::Parser;

use args::{Arguments, Command};

fn main() -> ExitCode {
    // clap ends the process itself on wrong use (code 2), --help and --version.
    let arguments = Arguments::parse();
    let result = match arguments.command {
        Command::Demo(options) => demo::run(&options),
        Command::Info(options) => info::run(&options),
        Command::Cage(options) => cage::run(&options),
        Command::Edit(options) => edit::run(&options),
        Command::Sweep(options) => sweep::run(&options),
        Command::Compare(options) => compare::run(&options),
        Command::Bench(options) => bench::run(&options),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            console::complain(&message(&error));
            ExitCode::FAILURE
        }
    }
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
