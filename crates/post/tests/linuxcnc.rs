//! What is posted for LinuxCNC is what `rs274`, LinuxCNC's own interpreter, makes of it (Debian's package linuxcnc-uspace): the end
//! points of all moves are those that our interpreter reads from the same text. Without `rs274` these tests say so and pass.

mod common;

use common::*;
use plan::{Path, Speed, StepKind};
use std::collections::BTreeMap;
use std::process::Command;
use std::sync::{Mutex, PoisonError};

type End = (bool, [f64; 3]);

/// Canonical calls of `rs274`: end points in the program's coordinates, and whether it ran to the end.
fn of_linuxcnc(program: &str) -> Option<Vec<End>> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("program.ngc");
    // Its tool table and machine positions are another machine's: the words that need them are taken out.
    let program: String = program
        .lines()
        .filter(|line| !line.starts_with("G43") && !line.starts_with("G53") && !line.contains("G10 ") && !line.ends_with(" M6"))
        .map(|line| format!("{line}\n"))
        .collect();
    #[expect(clippy::disallowed_methods, reason = "a test gives a file to another program")]
    std::fs::write(&file, &program).expect("it can be written");
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let output = match Command::new("rs274").arg("-g").arg(&file).current_dir(folder.path()).output() {
        Ok(output) => output,
        Err(why) => {
            println!("skipped: rs274 of linuxcnc-uspace: {why}");
            return None;
        }
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let trouble = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        text.contains("PROGRAM_END"),
        "rs274 did not come to the end: {trouble}\n{program}"
    );
    let mut ends = Vec::new();
    let mut at = [f64::NAN; 3];
    let mut plane = [0, 1, 2];
    for line in text.lines() {
        let Some((call, rest)) = line.split_once('(') else { continue };
        let call = call.split_whitespace().last().unwrap_or_default();
        let numbers: Vec<f64> = rest
            .trim_end_matches(')')
            .split(',')
            .filter_map(|n| n.trim().parse().ok())
            .collect();
        match call {
            "SELECT_PLANE" => {
                plane = match rest {
                    r if r.contains("XZ") => [2, 0, 1],
                    r if r.contains("YZ") => [1, 2, 0],
                    _ => [0, 1, 2],
                };
            }
            "STRAIGHT_TRAVERSE" | "STRAIGHT_FEED" => {
                at = [numbers[0], numbers[1], numbers[2]];
                ends.push((call == "STRAIGHT_TRAVERSE", at));
            }
            "ARC_FEED" => {
                (at[plane[0]], at[plane[1]], at[plane[2]]) = (numbers[0], numbers[1], numbers[5]);
                ends.push((false, at));
            }
            _ => {}
        }
    }
    Some(ends)
}

fn of_ours(program: &str) -> Vec<End> {
    let mut stream = gcode(program, "rs274", machine(false), BTreeMap::new());
    let mut ends = Vec::new();
    let mut reply = None;
    loop {
        use plan::ProgramStream;
        match stream.next(reply.take()) {
            plan::Next::Step(step) => {
                if let StepKind::Move(go) = step.kind {
                    let rapid = go.speed == Speed::Rapid;
                    assert!(!matches!(go.path, Path::Spline(_)));
                    ends.push((rapid, go.path.end().xyz));
                }
            }
            plan::Next::Ask(_) => reply = Some(plan::Answer::Truth(false)),
            plan::Next::End => return ends,
            plan::Next::Alarm(alarm) => panic!("{alarm}\n{program}"),
        }
    }
}

/// The cutting moves of both are the same; rapids behind machine positions depend on the machine.
#[track_caller]
fn check(program: &str) {
    let cuts = |ends: Vec<End>| -> Vec<[f64; 3]> { ends.into_iter().filter(|end| !end.0).map(|end| end.1).collect() };
    let ours = cuts(of_ours(program));
    let Some(theirs) = of_linuxcnc(program) else { return };
    let theirs = cuts(theirs);
    assert!(!ours.is_empty());
    assert_eq!(ours.len(), theirs.len(), "{program}");
    for (k, (a, b)) in ours.iter().zip(&theirs).enumerate() {
        let near = a.iter().zip(b).all(|(p, q)| (p - q).abs() < 2e-4);
        assert!(near, "cut {k}: ours {a:?}, theirs {b:?}\n{program}");
    }
}

#[test]
fn programs_of_the_corpus_run_in_linuxcnc() {
    for text in [PLATE, FLANGE] {
        let (program, _) = post_gcode(text, "fanuc-mill", "linuxcnc").unwrap_or_else(|e| panic!("{e}"));
        // Ours does not know the tool table of LinuxCNC.
        let program: String = program
            .lines()
            .filter(|line| !line.starts_with("G10 L1 "))
            .map(|line| format!("{line}\n"))
            .collect();
        check(&program);
        let wanted = deeds(&mut gcode(text, "fanuc-mill", machine(false), BTreeMap::new()));
        let found = deeds(&mut gcode(&program, "rs274", machine(false), BTreeMap::new()));
        if let Err(difference) = compare(&wanted, &found, 1e-4) {
            panic!("{difference}\n{program}");
        }
    }
    let (program, _) = post_step_nc("bracket.stpnc", BRACKET.as_bytes(), "linuxcnc").unwrap_or_else(|e| panic!("{e}"));
    check(&program);
}

#[test]
fn functions_and_branches_are_read_by_linuxcnc() {
    for definition in trace::FUNCTIONS {
        let control = post::by_name("linuxcnc").expect("a control");
        let (_, text) = post::table::posted(definition, control).unwrap_or_else(|e| panic!("{e}"));
        // A move, so that something is made; `M66` reads inputs that a machine has.
        let text = text.replace("M2\n", "G1 F100 X1\nM2\n");
        if let Some(ends) = of_linuxcnc(&text) {
            assert_eq!(ends.len(), 1, "{}", definition.name);
        }
    }
    let (program, _) = post_step_nc("flow.stp", FLOW.as_bytes(), "linuxcnc").unwrap_or_else(|e| panic!("{e}"));
    of_linuxcnc(&program);
}

#[test]
fn the_trace_sample_runs_in_linuxcnc() {
    if let Some(bytes) = sample("stepnc/ap238/plate_trace_functions_e3.stpnc") {
        let (program, _) = post_step_nc("plate_trace_functions_e3.stpnc", &bytes, "linuxcnc").unwrap_or_else(|e| panic!("{e}"));
        check(&program);
    }
}
