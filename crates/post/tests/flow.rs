//! Branches and loops stay branches and loops on every control, and what a G-code macro would decide at the machine is refused.

mod common;

use common::*;
use expect_test::expect_file;
use gcode::interpretation::{Setup, interpret};
use post::CONTROLS;

#[test]
fn both_ways_of_a_branch_and_the_body_of_a_loop_are_written_on_every_control() {
    for control in CONTROLS {
        let (text, _) = post_step_nc("flow.stp", FLOW.as_bytes(), control.name()).unwrap_or_else(|e| panic!("{e}"));
        expect_file![format!("golden/flow.{}.txt", control.name())].assert_eq(&text.replace('\r', ""));
    }
}

/// The ends of feed moves, X and Y.
fn cuts(text: &str, size: f64) -> Vec<[f64; 2]> {
    let mut setup = Setup::default();
    // `SIZE` is a variable that the program does not set: the second one in the order of their first use.
    let variable = text
        .lines()
        .find_map(|line| line.strip_prefix("(VARIABLE #")?.strip_suffix(" IS SIZE)"))
        .and_then(|number| number.parse::<u32>().ok())
        .expect("the head names it");
    setup.vars.insert(variable, Some(size));
    let found = interpret(text, &setup);
    assert_eq!(found.alarm, None, "{:?}\n{text}", found.fault);
    let rows = found.path.iter().filter(|row| row[0] == 1.0);
    rows.map(|row| [row[1], row[2]]).collect()
}

#[test]
fn a_branch_posted_for_a_fanuc_goes_the_way_that_the_variable_says() {
    let (text, _) = post_step_nc("flow.stp", FLOW.as_bytes(), "fanuc").unwrap_or_else(|e| panic!("{e}"));
    // SIZE > LIMIT, and LIMIT was set to 2: the tool T2 roughs again; else the finish goes on from where it is. The loop runs once.
    assert_eq!(cuts(&text, 3.0), [[30.0, 40.0], [6.0, 6.0], [2.0, 1.0], [0.0, 0.0]]);
    assert_eq!(cuts(&text, 1.0), [[30.0, 40.0], [50.0, 40.0], [2.0, 1.0], [0.0, 0.0]]);
}

#[track_caller]
fn refused(program: &str, expected: &str) {
    for control in ["fanuc", "siemens-840d", "heidenhain", "haas", "linuxcnc"] {
        let error = post_gcode(program, "fanuc-mill", control).expect_err("it is refused");
        assert!(error.contains(expected), "{error}");
    }
}

const HEAD: &str = "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X5. Y6.\nG43 H1 Z10.\n";

#[test]
fn branches_of_macros_are_refused_and_not_decided_in_silence() {
    refused(
        &format!("{HEAD}IF[#500GT2]GOTO9\nG1 Z0 F100.\nN9 M30\n"),
        "test.nc: line 7: IF",
    );
    refused(
        &format!("{HEAD}#1=0\nWHILE[#1LT3]DO1\nG1 X#1 F100.\n#1=#1+1\nEND1\nM30\n"),
        "line 8: WHILE",
    );
    refused(&format!("{HEAD}/G1 Z0 F100.\nM30\n"), "line 7: a block-skip switch");
    refused(&format!("{HEAD}#100=#5041\nG1 X#100 F100.\nM30\n"), "asks the machine for");
    refused(&format!("{HEAD}G31 Z-5. F50.\nM30\n"), "probes");
    let (text, _) = post_gcode_with(
        &format!("{HEAD}#1=0\nWHILE[#1LT3]DO1\nG1 X#1 F100.\n#1=#1+1\nEND1\nM30\n"),
        "fanuc-mill",
        "fanuc",
        true,
    )
    .unwrap_or_else(|e| panic!("{e}"));
    assert!(text.contains("G1 X0. F100.\nX1.\nX2.\n"), "{text}");
}

#[test]
fn what_depends_on_the_machine_is_refused() {
    // Incremental behind a reference point; a place that is set; a variable that the control keeps.
    refused("O1\nG21 G90 G54\nT1 M6\nG91 G28 Z0\nG0 X5.\nM30\n", "stands elsewhere");
    refused(&format!("{HEAD}G1 X#501 F100.\nM30\n"), "keeps other values");
    refused(
        "O1\nG21 G90 G54\nT1 M6\nG92 X0 Y0 Z0\nG1 X5. F100.\nG54 G1 X7.\nM30\n",
        "stands elsewhere",
    );
}

#[test]
fn a_coordinate_between_two_increments_does_not_depend_on_the_machine() {
    // Four decimals go to three: frames that are taken in and out round the last bits either way.
    let program = "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X5.0005 Y6.0015\nG43 H1 Z10.0005\nG52 X0.1 Y0.1\nG1 X1.2345 F100.\nY2.3455\nG3 X3.2345 I1.\nG52 X0 Y0\nG0 Z50.\nM30\n";
    for control in CONTROLS {
        post_gcode(program, "fanuc-mill", control.name()).unwrap_or_else(|e| panic!("{e}"));
    }
}

#[test]
fn what_a_function_would_read_is_posted_as_it_is_without_a_machine() {
    let text = "O1\nG21 G90 G54\nT1 M6\n#100=2.\n(trace:1 get_feedrate its_variable=#100)\nG0 X#100\nM30";
    let (posted, _) = post_gcode_with(text, "fanuc-mill", "fanuc", true).expect("it is posted");
    assert!(posted.lines().any(|line| line.contains("X2.")), "{posted}");
    let refused = post_gcode_with(text, "fanuc-mill", "fanuc", false).expect_err("the machine would be asked");
    assert!(refused.contains("#100"), "{refused}");
}
