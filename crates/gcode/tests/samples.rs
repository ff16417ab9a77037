//! Real programs and the worked cases of Custom Macro B; skipped with a message where the samples are absent.

mod common;

use common::{mill_tables, open_with, run, sample};
use expect_test::{Expect, expect};
use gcode::inspect::inspect;
use gcode::{GcodeProgram, Options, Value, detect};
use plan::{Level, MemorySource, Missing, Move, ProgramStream, Speed, Step, StepKind, Tables};

/// Counts, names and findings of a program read to its end with empty tables.
fn summary(text: &[u8]) -> String {
    let found = detect(&mut MemorySource(text.to_vec())).expect("memory can be read");
    let mut program = open_with(text, found.profile.name, Tables::empty(), Options::default()).expect("it opens");
    let (steps, alarm) = run(&mut program);
    let count = |wanted: fn(&StepKind) -> bool| steps.iter().filter(|s| wanted(&s.kind)).count();
    let mut out = format!(
        "{} because {}\nsteps {} moves {} rapids {} machine moves {} tools {} frames {}\n",
        found.profile.name,
        found.because,
        steps.len(),
        count(|k| matches!(k, StepKind::Move(_))),
        count(|k| matches!(k, StepKind::Move(Move { speed: Speed::Rapid, .. }))),
        count(|k| matches!(k, StepKind::MachineMove(_))),
        count(|k| matches!(k, StepKind::Tool(_))),
        count(|k| matches!(k, StepKind::Frame(_))),
    );
    for step in &steps {
        if let StepKind::Begin(marker) = &step.kind {
            out += &format!("{:?} {}\n", marker.level, marker.name);
        }
    }
    check_structure(&steps);
    for d in program.diagnostics() {
        out += &format!("{d}\n");
    }
    if let Some(alarm) = alarm {
        out += &format!("{alarm}\n");
    }
    let tree = inspect(&mut program, found.profile.name, GcodeProgram::in_inches);
    out += &format!("{}\n", serde_json::to_string(&tree.summary).expect("it is plain data"));
    out
}

/// Moves join where nothing changed the frame in between, and what begins ends.
fn check_structure(steps: &[Step]) {
    let mut open: Vec<Level> = Vec::new();
    let mut tip = None;
    for step in steps {
        match &step.kind {
            StepKind::Begin(marker) => open.push(marker.level),
            StepKind::End(level) => assert_eq!(open.pop(), Some(*level), "{}", step.id),
            StepKind::Move(m) => {
                assert!(m.path.is_sound(), "{}", step.id);
                if let Some(tip) = tip {
                    assert!(
                        m.path.start().distance(tip) < 1e-6,
                        "{}: {:?} after {tip:?}",
                        step.id,
                        m.path.start()
                    );
                }
                tip = Some(m.path.end());
            }
            StepKind::Frame(_) | StepKind::ToolOffset(_) | StepKind::MachineMove(_) => tip = None,
            _ => {}
        }
    }
    assert!(open.is_empty(), "everything that begins ends");
}

#[track_caller]
fn check(path: &str, expected: Expect) {
    if let Some(text) = sample(path) {
        expected.assert_eq(&summary(&text));
    }
}

#[test]
fn nist_827_op1_is_read_to_its_end() {
    check(
        "mtconnect/nist-sms/827-9999-904-OP1.NC",
        expect![[r#"
            fanuc-mill because no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill
            steps 1155 moves 1020 rapids 223 machine moves 13 tools 11 frames 2
            Program O1001 PROGRAM NAME 827-9999-904, OP1
            Workingstep T1 3" FACE MILL
            Workingstep T2 1/2" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T3 1/4" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T4 1/4" DIA. X .032" RADIUS 2 FLUTE STUBBY BULLNOSE E.M.
            Workingstep T5 1/4" 2 FLUTE E.M. WITH .020" X 45° CHAMFERS
            Workingstep T6 1/4" X 90° SPOT DRILL
            Workingstep T7 #30 DRILL
            Workingstep T8 5/16" X 90° SPOT DRILL
            Workingstep T9 LET. B DRILL
            Workingstep T10 .2505" REAMER
            Workingstep T11 9/32" DRILL
            warning: test.nc:20:17: tool 1 is not in the tables: a tool of that number is assumed (11 times); enter it before cutting
            warning: test.nc:25:10: tool length H1 is not in the tables: length 0 is assumed (11 times); enter it before cutting
            remark: test.nc:26:6: G8 (look-ahead mode) is accepted and changes nothing here (22 times)
            warning: test.nc:616:6: tool radius D3 is not in the tables: radius 0 is assumed (21 times); enter it before cutting
            remark: test.nc:616:6: cutter compensation with radius 0: the programmed path is the path (21 times)
            {"workingsteps_enabled":11,"workingsteps_disabled":0,"toolpaths":182,"rapids":97,"dwells":0,"tools":11,"nc_functions":0}
        "#]],
    );
}

#[test]
fn nist_827_op2_is_read_to_its_end() {
    check(
        "mtconnect/nist-sms/827-9999-904-OP2.NC",
        expect![[r#"
            fanuc-mill because no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill
            steps 2185 moves 2049 rapids 267 machine moves 13 tools 11 frames 2
            Program O1002 PROGRAM NAME 827-9999-904, OP2
            Workingstep T1 3" FACE MILL
            Workingstep T2 1/2" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T3 1/4" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T12 3/16" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T13 1/4" X 45° CHAMFER MILL
            Workingstep T5 1/4" 2 FLUTE E.M. WITH .020" X 45° CHAMFERS
            Workingstep T14 1/4" X .093" CORNER ROUNDING E.M.
            Workingstep T6 1/4" X 90° SPOT DRILL
            Workingstep T15 3/16" DRILL
            Workingstep T16 #25 DRILL
            Workingstep T3 1/4" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            warning: test.nc:20:17: tool 1 is not in the tables: a tool of that number is assumed (11 times); enter it before cutting
            warning: test.nc:25:10: tool length H1 is not in the tables: length 0 is assumed (11 times); enter it before cutting
            remark: test.nc:26:6: G8 (look-ahead mode) is accepted and changes nothing here (22 times)
            warning: test.nc:662:6: tool radius D3 is not in the tables: radius 0 is assumed (56 times); enter it before cutting
            remark: test.nc:662:6: cutter compensation with radius 0: the programmed path is the path (56 times)
            {"workingsteps_enabled":11,"workingsteps_disabled":0,"toolpaths":222,"rapids":117,"dwells":0,"tools":10,"nc_functions":0}
        "#]],
    );
}

#[test]
fn nist_827_fixture_is_read_to_its_end() {
    check(
        "mtconnect/nist-sms/827-9999-904-FIXT.NC",
        expect![[r#"
            fanuc-mill because no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill
            steps 421 moves 320 rapids 131 machine moves 9 tools 7 frames 2
            Program O1003 PROGRAM NAME 827-9999-904, FIXT
            Workingstep T3 1/4" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T17 1/8" DIA. 2 FLUTE STUBBY FULLERTON E.M.
            Workingstep T8 5/16" X 90° SPOT DRILL
            Workingstep T9 LET. B DRILL
            Workingstep T18 .2495" REAMER
            Workingstep T19 5.75MM DRILL
            Workingstep T20 1/4"-20 ROLL FORM TAP
            warning: test.nc:20:17: tool 3 is not in the tables: a tool of that number is assumed (7 times); enter it before cutting
            warning: test.nc:25:10: tool length H3 is not in the tables: length 0 is assumed (7 times); enter it before cutting
            remark: test.nc:26:6: G8 (look-ahead mode) is accepted and changes nothing here (14 times)
            warning: test.nc:29:6: tool radius D3 is not in the tables: radius 0 is assumed (10 times); enter it before cutting
            remark: test.nc:29:6: cutter compensation with radius 0: the programmed path is the path (10 times)
            {"workingsteps_enabled":7,"workingsteps_disabled":0,"toolpaths":116,"rapids":62,"dwells":0,"tools":7,"nc_functions":0}
        "#]],
    );
}

#[test]
fn nist_cover_is_read_to_its_end() {
    check(
        "mtconnect/nist-sms/mtc-cover/NIST_MTC_CRADA_COVER_REV-A.NC",
        expect![[r#"
        fanuc-mill because no sign of a lathe or of RS274 outweighs the Y words, G43 or M6 of a mill
        steps 1467 moves 1455 rapids 53 machine moves 1 tools 1 frames 2
        Program O0000 NIST_MTC_CRADA_COVER_REV-A
        Workingstep T23| 1/8 SPOTDRILL|H0
        warning: test.nc:6:8: tool 23 is not in the tables: a tool of that number is assumed; enter it before cutting
        warning: test.nc:7:10: work offset G54 is not in the tables: the machine's zero is assumed (2 times); enter it before cutting
        {"workingsteps_enabled":1,"workingsteps_disabled":0,"toolpaths":35,"rapids":18,"dwells":0,"tools":1,"nc_functions":0}
    "#]],
    );
}

#[test]
fn g10_of_the_nist_program_sets_the_work_offset_that_the_tables_lack() {
    let Some(text) = sample("mtconnect/nist-sms/827-9999-904-OP1.NC") else {
        return;
    };
    let tables = Tables {
        missing: Missing::Fail,
        ..mill_tables()
    };
    let mut program = open_with(&text, "fanuc-mill", tables, Options::default()).expect("it opens");
    let (steps, _) = run(&mut program);
    let assumed = steps.iter().any(|s| matches!(&s.kind, StepKind::Frame(f) if f.assumed));
    assert!(!assumed, "G10 L2 P#501 gives all three axes");
    assert_eq!(program.variable(501), Value::Number(1.0));
    assert_eq!(program.variable(502), Value::Vacant);
}
