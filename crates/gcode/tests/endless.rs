//! Programs without an end are found out when nothing changes any more, and no other program is taken for one.

use gcode::{Interpretation, Setup, interpret};
use std::fmt::Write as _;

fn interpreted(program: &str) -> Interpretation {
    let setup = Setup {
        most_blocks_at_rest: Some(10_000),
        ..Setup::default()
    };
    interpret(program, &setup)
}

#[track_caller]
fn check_goes_round(program: &str) {
    let fault = interpreted(program).fault.expect("it is endless");
    assert_eq!(fault.code, "endless-program");
    assert!(fault.text.contains("goes round for ever"), "{}", fault.text);
}

#[test]
fn a_loop_in_which_nothing_changes_is_found_out() {
    check_goes_round("O1\nWHILE[1EQ1]DO1\nEND1\nM30\n");
    check_goes_round("O1\n#1=5\nN1#1=5\nGOTO1\n");
    check_goes_round("O1\nN1 G90 G0 X1.\nX2.\nGOTO1\n");
}

#[test]
fn a_round_of_many_jumps_is_found_out() {
    let mut program = String::from("O1\nGOTO100\nN1 GOTO100\n");
    for n in 2..=100 {
        let _ = writeln!(program, "N{n} GOTO{}", n - 1);
    }
    check_goes_round(&program);
}

#[test]
fn loops_in_a_loop_in_which_nothing_changes_are_found_out() {
    check_goes_round("O1\nG91 G1 F100.\nN1 X1.\nX-1.\nN2 IF[#1EQ1]GOTO2\nN3 GOTO1\n");
    check_goes_round("O1\nN1 M98 P2\nGOTO1\nM30\nO2\nG0 X1.\nM99\n");
}

#[test]
fn a_loop_that_moves_on_or_counts_comes_to_its_end() {
    for program in [
        "O1\n#1=0\nWHILE[#1LT500]DO1\n#1=#1+1\nEND1\nM30\n",
        "O1\nG91 G1 F100.\nWHILE[#5001LT300]DO1\nX1.\nEND1\nM30\n",
        "O1\n#1=0\nN1#1=#1+1\nIF[#1LT500]GOTO1\nM30\n",
    ] {
        let done = interpreted(program);
        assert_eq!(done.fault, None, "{program}");
    }
}

#[test]
fn a_kept_variable_written_in_every_pass_ends_with_its_last_value() {
    let done = interpreted("O1\nWHILE[#500LT500]DO1\n#500=#500+1\n#501=#500*2\n#500=#500\nEND1\nM30\n");
    assert_eq!(
        (done.vars.get(&500), done.vars.get(&501)),
        (Some(&Some(500.0)), Some(&Some(1000.0)))
    );
}
