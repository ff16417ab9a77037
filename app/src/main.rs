//! `toolmark`: the program. Reads the command line, does the command, and turns what happened into words and an exit code.
//!
//! Everything that opens files, reads the clock or talks to a person is in here; what a program means and what a machine does is not.

mod cli;
mod clock;
mod commands;
mod controller;
mod course;
mod cycle_start;
mod execution;
mod failure;
mod files;
mod foreseen;
mod functions;
mod link;
mod live;
mod net;
mod overriding;
mod people;
mod planned_time;
mod printed;
mod program;
mod progress;
mod recorder;
mod recording;
mod report;
mod shop;
mod survey;
mod taking_up;

use clap::Parser;
use cli::{Cli, Command};
use failure::{Exit, OUR_FAULT};
use std::io::Write;
use std::process::ExitCode;

fn main() -> ExitCode {
    // A panic is a fault of ours: it says so, and ends with its own code.
    let ended = std::panic::catch_unwind(|| {
        let cli = match Cli::try_parse() {
            Ok(cli) => with_the_machine_file(cli),
            Err(error) => {
                let _ = error.print();
                if !error.use_stderr() {
                    return Exit::Good as u8;
                }
                if wants_json() {
                    print_failure(Exit::Usage as u8, error.to_string().trim_end());
                }
                return Exit::Usage as u8;
            }
        };
        run(&cli)
    });
    ExitCode::from(ended.unwrap_or_else(|_| {
        let message = "this is a fault of toolmark, not of your input: please report it with the lines above";
        eprintln!("{message}");
        if wants_json() {
            print_failure(OUR_FAULT, message);
        }
        OUR_FAULT
    }))
}

fn run(cli: &Cli) -> u8 {
    let common = &cli.common;
    let done = match &cli.command {
        Command::Demo(args) => commands::demo::demo(args, common),
        Command::Run(args) => commands::run::run(args, common),
        Command::Check(args) => commands::check::check(args, common),
        Command::Convert(args) => commands::convert::convert(args, common),
        Command::Edit(args) => commands::edit::edit(args, common),
        Command::Inspect(args) => commands::inspect::inspect(args, common),
        Command::Macro(cli::MacroCommand::Run(args)) => commands::macro_run::macro_run(args, common),
        Command::Plan(args) => commands::plan::plan(args, common),
        Command::Post(args) => commands::post::post(args, common),
        Command::Record(args) => commands::record::record(args, common),
        Command::Rebuild(args) => commands::rebuild::rebuild(args, common),
        Command::Compare(args) => commands::compare::compare(args, common),
        Command::Trace(args) => commands::trace::trace(args, common),
        Command::Backup(args) => commands::backup::backup(args, common),
        Command::Restore(args) => commands::backup::restore(args, common),
        Command::Controller(args) => commands::controller::controller(args, common),
        Command::Live(args) => commands::live::live(args, common),
        Command::Hold(args) => commands::hold::hold(args, common),
        Command::Size(command) => commands::size::size(command, common),
        Command::Operator(command) => commands::operator::operator(command, common),
        Command::Tool(command) => commands::tool::tool(command, common),
        Command::Offset(command) => commands::offset::offset(command, common),
        Command::Machine(command) => commands::machine::machine(command, common),
    };
    match done {
        Ok(exit) => exit as u8,
        Err(failure) => {
            if common.json {
                print_failure(failure.exit as u8, &failure.message);
            }
            eprintln!("{}", failure.message);
            failure.exit as u8
        }
    }
}

/// Without `--machine` the machine file of the data directory counts, where there is one. The demo has machines of its own.
fn with_the_machine_file(mut cli: Cli) -> Cli {
    let is_given = std::env::args_os()
        .take_while(|word| word != "--")
        .any(|word| word.to_str().is_some_and(|w| w == "--machine" || w.starts_with("--machine=")));
    let has_its_own = matches!(
        cli.command,
        Command::Demo(_) | Command::Machine(commands::machine::MachineCommand::Init(_))
    );
    if !is_given
        && !has_its_own
        && let Some(file) = commands::machine::of_the_data_directory(&cli.common)
    {
        cli.common.machine = file;
    }
    cli
}

/// True when the answer is read by a program, even if the rest of the command line makes no sense.
fn wants_json() -> bool {
    std::env::args_os()
        .take_while(|word| word != "--")
        .any(|word| word == "--json")
}

/// The JSON answer of a command that did not end well.
fn print_failure(exit: u8, message: &str) {
    let mut answer = serde_json::json!({ "error": { "exit": exit, "message": message } });
    if let Some(notices) = shop::notices() {
        answer["notices"] = notices.into();
    }
    say(&answer.to_string());
}

/// A line for the person, or for the program that reads ours. A reader that went away ends us quietly, as it ends any filter.
fn say(line: &str) {
    let mut out = std::io::stdout().lock();
    if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
        std::process::exit(Exit::Good as i32);
    }
}
