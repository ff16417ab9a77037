//! Functions of the traceability vocabulary in comments: each a step of its own, in its place.

mod common;

use common::{lathe_tables, mill_tables, open_with, run};
use gcode::Options;
use plan::{Answer, Next, Place, ProgramStream, Step, StepKind};

fn told(steps: &[Step]) -> Vec<String> {
    let line = |step: &Step| match step.origin.place {
        Place::Text { line, .. } => line,
        _ => 0,
    };
    let word = |step: &Step| match &step.kind {
        StepKind::Move(_) => Some(format!("{} move", line(step))),
        StepKind::NcFunction(function) => Some(format!("{} {}: {}", line(step), function.kind, function.text)),
        _ => None,
    };
    steps.iter().filter_map(word).collect()
}

#[track_caller]
fn check(dialect: &str, text: &str, expected: &[&str], remarks: &[&str]) {
    let tables = if dialect == "fanuc-lathe" {
        lathe_tables()
    } else {
        mill_tables()
    };
    let mut program = open_with(text.as_bytes(), dialect, tables, Options::default()).expect("opens");
    let (steps, alarm) = run(&mut program);
    let ours = |code: &str| code.starts_with("trace") || code.starts_with("T-");
    let mut found: Vec<String> = program
        .diagnostics()
        .iter()
        .filter(|d| ours(d.code))
        .map(|d| format!("{} {}:{}", d.code, d.line, d.column))
        .collect();
    found.extend(alarm.map(|alarm| format!("alarm {} {}", alarm.diagnostic.code, alarm.diagnostic.line)));
    assert_eq!(told(&steps), expected);
    assert_eq!(found, remarks);
}

#[test]
fn a_function_is_a_step_between_the_blocks_it_stands_between() {
    check(
        "fanuc-mill",
        "O1\nG21 G54\nG0 X1.\n(trace:1 get_time its_label=\"x %28y%29\")\nX2.\n(an ordinary comment)\n(TRACE:1 LOG_TOOL_DATA)\nM30",
        &[
            "3 move",
            "4 extended function: trace:1 get_time its_label=\"x (y)\"",
            "5 move",
            "7 extended function: TRACE:1 LOG_TOOL_DATA",
        ],
        &[],
    );
}

#[test]
fn a_function_goes_on_in_the_comments_that_follow_it() {
    check(
        "fanuc-mill",
        "O1\nG21 G54\n(trace:1 log_event)\n(trace:+ its_kind=a) (trace:+ its_text=b)\n(trace:1 get_time)\nG0 X1.\n(trace:+ alone)\nM30",
        &[
            "3 extended function: trace:1 log_event its_kind=a its_text=b",
            "5 extended function: trace:1 get_time",
            "6 move",
        ],
        &["trace-continuation 7:2"],
    );
}

#[test]
fn the_end_of_the_text_ends_a_function_too() {
    check(
        "fanuc-mill",
        "O1\nG21\n(trace:1 get_time)",
        &["3 extended function: trace:1 get_time"],
        &[],
    );
}

#[test]
fn loops_say_their_functions_in_every_pass() {
    check(
        "fanuc-mill",
        "O1\nG21 G54\n#1=0\nWHILE[#1 LT 3]DO1\n(trace:1 get_time)\n(trace:+ label=a)\n#1=#1+1\nEND1\nM30",
        &[
            "5 extended function: trace:1 get_time label=a",
            "5 extended function: trace:1 get_time label=a",
            "5 extended function: trace:1 get_time label=a",
        ],
        &[],
    );
}

#[test]
fn in_a_block_with_words_it_is_done_before_the_block_and_said() {
    check(
        "fanuc-mill",
        "O1\nG21 G54\nG0 X1. (trace:1 get_time)\nM30",
        &["3 extended function: trace:1 get_time", "3 move"],
        &["trace-block 3:9"],
    );
}

#[test]
fn inside_a_cycle_a_modal_call_or_a_contour_it_is_refused() {
    check(
        "fanuc-mill",
        "O1\nG21 G54 G90\nM3 S1000\nG0 X0 Y0 Z5.\nG81 X1. Z-1. R1. F100.\n(trace:1 get_time)\nG80\n(trace:1 log_tool_data)\nM30",
        &[
            "4 move",
            "5 move",
            "5 move",
            "5 move",
            "5 move",
            "8 extended function: trace:1 log_tool_data",
        ],
        &["T-12 6:2"],
    );
    check(
        "fanuc-lathe",
        "O1\nG21 G54 G98\nG0 X50. Z2.\nG71 U1. R1.\nG71 P10 Q20 U0 W0 F100.\nN10 G0 X20.\n(trace:1 get_time)\nG1 Z-10.\nN20 X50.\nM30",
        &["3 move"],
        &["alarm T-12 7"],
    );
    check(
        "fanuc-mill",
        "O1\nG21 G54\nG66 P2\nG0 X1.\nG67\nM30\nO2\n(trace:1 get_time)\nM99",
        &["4 move"],
        &["T-12 8:2"],
    );
}

#[test]
fn behind_a_move_that_is_held_for_a_corner_it_is_told_behind_the_move() {
    check(
        "fanuc-lathe",
        "O1\nG21 G98\nG0 X50. Z0\nG1 Z-10. C1. F100.\n(trace:1 get_time)\nX60.\nM30",
        &[
            "3 move",
            "4 move",
            "5 extended function: trace:1 get_time",
            "4 move",
            "6 move",
        ],
        &[],
    );
}

#[test]
fn a_block_with_no_more_than_its_sequence_number_is_the_functions_own() {
    check(
        "fanuc-mill",
        "O1\nN10 G21 G54\nN20 G0 X1.\nN30 (trace:1 start_sensor_recording its_function_id=1)\nN40 (trace:+ its_sensors=X.LOAD)\n\
         N50 X2.\nN60 M30",
        &[
            "3 move",
            "4 extended function: trace:1 start_sensor_recording its_function_id=1 its_sensors=X.LOAD",
            "6 move",
        ],
        &[],
    );
    check(
        "fanuc-mill",
        "O1\nG21 G54\nWHILE [#1 LT 2] DO1\nN1 (trace:1 get_time)\nN2 (trace:+ its_label=pass)\nX#1\n#1=#1+1\nEND1\nM30",
        &[
            "4 extended function: trace:1 get_time its_label=pass",
            "4 extended function: trace:1 get_time its_label=pass",
            "6 move",
        ],
        &[],
    );
}

#[test]
fn a_contour_refuses_a_function_behind_a_number_or_words_too() {
    for line in ["N15 (trace:1 get_time)", "G1 Z-1. (trace:1 get_time)"] {
        let text = format!(
            "O1\nG21 G54 G98\nG0 X50. Z2.\nG71 U1. R1.\nG71 P10 Q20 U0 W0 F100.\nN10 G0 X20.\n{line}\nG1 Z-10.\nN20 X50.\nM30"
        );
        check("fanuc-lathe", &text, &["3 move"], &["alarm T-12 7"]);
    }
}

/// Moves (where they go along X), functions and questions, in order; every question is answered with `answer`.
#[track_caller]
fn asks(text: &str, answer: Answer, expected: &[&str]) {
    let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
    let (mut found, mut reply) = (Vec::new(), None);
    loop {
        match program.next(reply.take()) {
            Next::Step(Step { kind, .. }) => match kind {
                StepKind::Move(moved) => found.push(format!("x{}", moved.path.end().xyz[0])),
                StepKind::NcFunction(function) => {
                    let values = function.properties.iter().map(|(name, value)| format!(" {name}={value}"));
                    found.push(format!("{}{}", function.name, values.collect::<String>()));
                }
                StepKind::Register(change) => found.push(format!("{:?}", change.after)),
                _ => {}
            },
            Next::Ask(question) => {
                found.push(format!("{question:?}"));
                reply = Some(answer);
            }
            Next::End => break,
            Next::Alarm(alarm) => panic!("{}", alarm.diagnostic),
        }
    }
    assert_eq!(found, expected);
}

#[test]
fn a_line_that_uses_what_a_function_wrote_waits_for_the_machine() {
    let text = "O1\nG21 G54\n#100=1.\n(trace:1 get_spindle_speed its_variable=#100)\nG0 X5.\nIF [#100 GT 400] GOTO 9\nX6.\nN9 X#100\nM30";
    let function = "get_spindle_speed variable #100=1";
    let question = "Number(\"#100\")";
    asks(text, Answer::Number(Some(500.0)), &[function, "x5", question, "x500"]);
    asks(text, Answer::Number(Some(7.0)), &[function, "x5", question, "x6", "x7"]);
    // Nobody knows: it keeps what it held.
    asks(text, Answer::Unknown, &[function, "x5", question, "x6", "x1"]);
}

#[test]
fn nobody_waits_for_what_no_line_uses_or_the_program_writes_itself() {
    let written = "O1\nG21 G54\n(trace:1 get_feedrate its_variable=#100)\n#101=3.\nG0 X#101\n#100=8.\nX#100\nM30";
    asks(written, Answer::Unknown, &["get_feedrate", "x3", "x8"]);
    let kept = "O1\nG21 G54\n(trace:1 get_feedrate its_variable=#500)\nG0 X1.\nM30";
    // What is kept is asked for at the end, where nothing waits for it any more.
    let answer = Answer::Number(Some(2.5));
    asks(kept, answer, &["get_feedrate", "x1", "Number(\"#500\")", "Some(2.5)"]);
}

#[test]
fn what_an_action_writes_is_asked_for_at_every_use() {
    let text = "O1\nG21 G54\n(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=NONE)\n\
                (trace:+ its_actions=\"get_feedrate its_variable=#100\")\nG0 X#100\nX[#100+#100]\nM30";
    let question = "Number(\"#100\")";
    let answer = Answer::Number(Some(2.0));
    asks(text, answer, &["start_synchronized_action", question, "x2", question, "x4"]);
}

#[test]
fn a_function_that_names_variables_is_told_with_their_present_values() {
    let text = "O1\nG21 G54\n#1=4.\n#2=#0\n(trace:1 log_event its_kind=a its_values=#1,#2)\n#1=5.\nM30";
    asks(text, Answer::Unknown, &["log_event variable #1=4"]);
}

#[test]
fn a_function_that_writes_a_system_variable_is_refused() {
    check(
        "fanuc-mill",
        "O1\nG21 G54\n(trace:1 get_feedrate its_variable=#5041)\nM30",
        &["3 extended function: trace:1 get_feedrate its_variable=#5041"],
        &["T-06 3:1"],
    );
}
