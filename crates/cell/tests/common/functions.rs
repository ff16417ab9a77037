//! Programs with functions, and what a shop knows for them.

use cell::sink::Kept;
use gcode::{GcodeProgram, Options, profile::by_name};
use ledger::Event;
use plan::{Answer, MemorySource, Missing, Next, NoOtherFiles, ProgramStream, Tables, ToolEntry};
use serde_json::{Value, json};
use trace::record::Known;
use trace::survey::{Found, Survey};
use units::{ToolNumber, Transform};

pub fn program(text: &str) -> GcodeProgram {
    let mut tables = Tables {
        missing: Missing::Fail,
        ..Tables::empty()
    };
    for number in 1..=3 {
        tables.tools.insert(ToolNumber(number), ToolEntry::default());
    }
    tables
        .work_offsets
        .insert("G54".to_owned(), Transform::shift([-100.0, -100.0, -100.0]));
    let source = Box::new(MemorySource(text.as_bytes().to_vec()));
    let profile = by_name("fanuc-mill").expect("a profile");
    GcodeProgram::open(source, "test.nc", profile, Box::new(NoOtherFiles), tables, Options::default()).expect("opens")
}

pub fn look(text: &str) -> Found {
    let mut survey = Survey::new("test.nc");
    let mut stream = program(text);
    let mut answer = None;
    loop {
        match stream.next(answer.take()) {
            Next::Step(step) => survey.step(&step),
            Next::Ask(_) => answer = Some(Answer::Unknown),
            Next::End => return survey.finish(),
            Next::Alarm(alarm) => panic!("{alarm}"),
        }
    }
}

pub fn known() -> Known {
    let object = |value: Value| value.as_object().cloned().expect("an object");
    Known {
        machine: object(json!({ "model": "sim", "serial_number": "1" })),
        operator: object(json!({ "name": "Ada", "role": "operator", "level": 6 })),
        tools: (1..=3)
            .map(|n| (n, object(json!({ "diameter_mm": 10.0 * f64::from(n), "length_mm": 50.0 }))))
            .collect(),
        ..Known::default()
    }
}

/// The records of one function.
pub fn of<'k>(kept: &'k Kept, function: &str) -> Vec<&'k Event> {
    let is = |event: &&Event| event.kind == "trace" && event.detail["function"] == function;
    kept.events.iter().filter(is).collect()
}

/// A program around some functions: a tool, a spindle, a straight cut of a second.
pub fn around(before: &str, within: &str, after: &str) -> String {
    format!("O1\nG21 G90 G54\n{before}\nT1 M6\nM3 S2000\nG0 X0 Y0 Z50.\nG1 X10. F600.\n{within}\nX20.\n{after}\nM30\n")
}
