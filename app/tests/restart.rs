//! Every reader of programs can be taken up at any of its steps: what comes then is what came the first time, and what is in force there
//! is known.

use plan::{Answer, Modal, Next, NoOtherFiles, ProgramStream, Step, Tables, restart_at};
use std::sync::Arc;
use units::StepId;

const BRACKET: &[u8] = include_bytes!("../../corpus/bracket.stpnc");
const PLATE: &[u8] = include_bytes!("../../corpus/plate.nc");
const SHAFT: &[u8] = include_bytes!("../../corpus/shaft.nc");

fn gcode(bytes: &[u8], profile: &str) -> Box<dyn ProgramStream> {
    let profile = gcode::profile::by_name(profile).expect("a known profile");
    let source = Box::new(plan::MemorySource(bytes.to_vec()));
    let options = gcode::Options::default();
    Box::new(
        gcode::GcodeProgram::open(
            source,
            "program.nc",
            profile,
            Box::new(NoOtherFiles),
            Tables::empty(),
            options,
        )
        .expect("a program"),
    )
}

fn step_nc() -> Box<dyn ProgramStream> {
    let program = stepnc::Program::read("bracket.stpnc", BRACKET.to_vec()).expect("a program");
    Box::new(stepnc::StepNcStream::new(Arc::new(program), stepnc::StreamOptions::default()))
}

/// All steps from here to the end, optional stops answered with no.
fn rest(stream: &mut dyn ProgramStream) -> Vec<Step> {
    let mut steps = vec![];
    let mut answer = None;
    loop {
        match stream.next(answer.take()) {
            Next::Step(step) => steps.push(step),
            Next::Ask(_) => answer = Some(Answer::Truth(false)),
            Next::End => return steps,
            Next::Alarm(alarm) => panic!("{alarm}"),
        }
    }
}

#[track_caller]
fn check(mut stream: Box<dyn ProgramStream>) {
    let all = rest(&mut *stream);
    assert!(all.len() > 50, "a program worth the name");
    let numbers: Vec<u32> = all.iter().map(|s| s.id.0).collect();
    assert_eq!(
        numbers,
        (1..=all.len() as u32).collect::<Vec<_>>(),
        "steps are numbered from 1 without gaps"
    );
    let mut modal = Modal::default();
    for (k, step) in all.iter().enumerate() {
        if k % 7 == 0 || k + 1 == all.len() {
            let there = restart_at(&mut *stream, step.id, &mut |_| Answer::Truth(false)).expect("the step exists");
            assert_eq!(there, modal, "what is in force before {}", step.id);
            assert_eq!(rest(&mut *stream), all[k..], "from {} on", step.id);
        }
        modal.follow(step);
    }
    let beyond = StepId(all.len() as u32 + 2);
    let error = restart_at(&mut *stream, beyond, &mut |_| Answer::Truth(false)).expect_err("it does not exist");
    assert!(error.to_string().contains("does not exist"), "{error}");
}

#[test]
fn a_step_nc_program_is_taken_up_at_any_step() {
    check(step_nc());
}

#[test]
fn a_milling_program_is_taken_up_at_any_step() {
    check(gcode(PLATE, "fanuc-mill"));
}

#[test]
fn a_turning_program_is_taken_up_at_any_step() {
    check(gcode(SHAFT, "fanuc-lathe"));
}
