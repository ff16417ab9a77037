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
            Next::Alarm(alarm) => {
                found.push(format!("alarm {} {}", alarm.diagnostic.code, alarm.diagnostic.line));
                break;
            }
        }
        assert!(found.len() < 10_000, "{:?}", &found[..20]);
    }
    let ours = |d: &&plan::Diagnostic| matches!(d.code, "variable-kept" | "loop-assumed" | "T-06");
    found.extend(
        program
            .diagnostics()
            .iter()
            .filter(ours)
            .map(|d| format!("{} {}", d.code, d.line)),
    );
    assert_eq!(found, expected);
}

#[test]
fn a_line_that_uses_what_a_function_wrote_waits_for_the_machine() {
    let text = "O1\nG21 G54\n#100=1.\n(trace:1 get_spindle_speed its_variable=#100)\nG0 X5.\nIF [#100 GT 400] GOTO 9\nX6.\nN9 X#100\nM30";
    let function = "get_spindle_speed variable #100=1";
    let question = "Number(\"#100\")";
    asks(text, Answer::Number(Some(500.0)), &[function, "x5", question, "x500"]);
    asks(text, Answer::Number(Some(7.0)), &[function, "x5", question, "x6", "x7"]);
    // There is no machine yet: it keeps what it held. One that has no value makes nobody go on with that.
    asks(text, Answer::NotAsked, &[function, "x5", question, "x6", "x1"]);
    asks(text, Answer::Unknown, &[function, "x5", question, "alarm no-answer 6"]);
    asks(text, Answer::Number(None), &[function, "x5", question, "alarm no-answer 6"]);
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
    for variable in ["#5041", "#0", "#<_size>", "#99999999999"] {
        let function = format!("trace:1 get_feedrate its_variable={variable}");
        let text = format!("O1\nG21 G54\n({function})\nM30");
        let told = format!("3 extended function: {function}");
        check("fanuc-mill", &text, &[&told], &["T-06 3:1"]);
    }
}

/// An action with id A1 that goes on writing a variable.
fn action(variable: &str) -> String {
    format!(
        "(trace:1 start_synchronized_action its_id=A1 its_mode_scope=AUTOMATIC its_frequency=NONE)\n\
         (trace:+ its_actions=\"get_drive_load its_axis=X its_variable={variable}\")"
    )
}

#[test]
fn a_line_that_assigns_to_what_an_action_writes_is_refused() {
    let starts = "start_synchronized_action variable #100=0";
    for line in ["#100=0", "IF [1 EQ 1] THEN #100=0", "#[99+1]=0"] {
        let text = format!("O1\nG21 G54\n#100=0\n{}\nG0 X5.\n{line}\nM30", action("#100"));
        let expected = [starts, "x5", "alarm T-06 7"];
        asks(&text, Answer::Number(Some(1.0)), &expected);
    }
}

#[test]
fn what_a_stopped_action_wrote_last_is_asked_for_once_and_may_be_assigned_to() {
    let (starts, stops, question) = ("start_synchronized_action", "stop_synchronized_action", "Number(\"#100\")");
    let text = |lines: &str| {
        let action = action("#100");
        format!("O1\nG21 G54\n{action}\nG0 X5.\n(trace:1 stop_synchronized_action its_id=a1)\n{lines}\nM30")
    };
    let answer = Answer::Number(Some(2.0));
    asks(
        &text("X#100\nX[#100+1.]"),
        answer,
        &[starts, "x5", stops, question, "x2", "x3"],
    );
    asks(&text("#100=7.\nX#100"), answer, &[starts, "x5", stops, "x7"]);
}

#[test]
fn a_function_that_reads_what_an_action_writes_leaves_it_to_the_action() {
    let text = format!(
        "O1\nG21 G54\n{}\n(trace:1 get_feedrate its_variable=#100)\nG0 X#100\nX[#100+1.]\nM30",
        action("#100")
    );
    let question = "Number(\"#100\")";
    let told = ["start_synchronized_action", "get_feedrate", question, "x2", question, "x3"];
    asks(&text, Answer::Number(Some(2.0)), &told);
}

#[test]
fn an_action_that_writes_a_local_is_refused() {
    let text = format!("O1\nG21 G54\n{}\nG65 P9000 Z-5.\nM30\nO9000\nG0 X#26\nM99", action("#26"));
    asks(
        &text,
        Answer::Number(Some(40.0)),
        &["start_synchronized_action", "x-5", "T-06 3"],
    );
}

#[test]
fn what_a_function_writes_into_a_local_is_the_callers() {
    let question = "Number(\"#26\")";
    for lines in [
        "(trace:1 get_feedrate its_variable=#26)\nG65 P9000 Z-5.",
        "G65 P9000 Z-5. (trace:1 get_feedrate its_variable=#26)",
    ] {
        let text = format!("O1\nG21 G54\n{lines}\nG0 X#26\nM30\nO9000\nG0 X#26\nM99");
        asks(&text, Answer::Number(Some(40.0)), &["get_feedrate", question, "x-5", "x40"]);
    }
    // Before the return of the macro it is the macro's.
    let text = "O1\nG21 G54\n#26=1.\nG65 P9000 Z-5.\nG0 X#26\nM30\nO9000\nG0 X#26\n(trace:1 get_feedrate its_variable=#26)\nM99";
    asks(
        text,
        Answer::Number(Some(40.0)),
        &["x-5", "get_feedrate variable #26=-5", question, "x1"],
    );
}

#[test]
fn a_loop_that_only_the_machine_ends_is_left_by_a_check() {
    let loops = [
        "WHILE [#100 LT 5] DO1\nG4 X0.1\nEND1",
        "N5 IF [#100 GE 5] GOTO 6\nG4 X0.1\nGOTO 5\nN6",
        "N5 G4 X0.1\nIF [#100 LT 5] GOTO 5",
        "WHILE [#1000 EQ 0] DO1\nG4 X0.1\nEND1",
        // Something else changes in every pass.
        "WHILE [#100 LT 5] DO1\n#1=#1+1\nG4 X0.1\nEND1",
        "N5 G4 X0.1\nIF [#100 GE 5] GOTO 6\nM99 P5\nN6",
        "WHILE [1 EQ 1] DO2\nWHILE [#100 LT 5] DO1\nG4 X0.1\nEND1\nEND2",
    ];
    for text in loops {
        let text = format!("O1\nG21 G54\n{}\n{text}\nG0 X9.\nM30", action("#100"));
        let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
        let (mut moves, mut asked, mut reply) = (0, 0, None);
        loop {
            match program.next(reply.take()) {
                Next::Step(step) => moves += usize::from(matches!(step.kind, StepKind::Move(_))),
                Next::Ask(_) => {
                    asked += 1;
                    reply = Some(Answer::NotAsked);
                }
                Next::End => break,
                Next::Alarm(alarm) => panic!("{text}: {}", alarm.diagnostic),
            }
        }
        let warned = program.diagnostics().iter().filter(|d| d.code == "loop-assumed").count();
        assert_eq!((moves, warned), (1, 1), "{text}");
        assert!(asked < 20_000, "{text}: asked {asked} times");
    }
}

#[test]
fn a_loop_that_the_machine_ends_goes_round_until_it_does() {
    for condition in ["#100 LT 500", "#1000 LT 500"] {
        let text = format!(
            "O1\nG21 G54\n{}\nWHILE [{condition}] DO1\nG4 X0.1\nEND1\nG0 X9.\nM30",
            action("#100")
        );
        let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
        let (mut asked, mut reply) = (0.0, None);
        loop {
            match program.next(reply.take()) {
                Next::Step(_) => {}
                Next::Ask(_) => {
                    asked += 1.0;
                    // The same value for a long time.
                    reply = Some(Answer::Number(Some(if asked < 1000.0 { 0.0 } else { 500.0 })));
                }
                Next::End => break,
                Next::Alarm(alarm) => panic!("{}", alarm.diagnostic),
            }
        }
        assert_eq!(asked, 1000.0);
    }
}

#[test]
fn a_loop_that_counts_goes_round_as_often_as_it_says_although_values_are_assumed() {
    let text = format!(
        "O1\nG21 G54\n#100=3.\n{}\nWHILE [#1 LT 500] DO1\nG0 X[#1+#100]\n#1=#1+1\nEND1\nM30",
        action("#100")
    );
    let mut expected = vec!["start_synchronized_action variable #100=3".to_owned()];
    for pass in 0..500 {
        expected.extend(["Number(\"#100\")".to_owned(), format!("x{}", pass + 3)]);
    }
    asks(
        &text,
        Answer::NotAsked,
        &expected.iter().map(String::as_str).collect::<Vec<_>>(),
    );
}

#[test]
fn a_function_behind_a_macro_statement_or_another_comment_is_done_and_said() {
    let time = |line: u32| format!("{line} extended function: trace:1 get_time");
    for (statement, column) in [
        ("#1=0 (trace:1 get_time)", 7),
        ("#1=0 (w;y) (trace:1 get_time) ; more", 13),
        ("#1= (trace:1 get_time) 0", 6),
        ("#3003=[1 (trace:1 get_time)]", 11),
        ("G4 P[1 (trace:1 get_time) +2]", 9),
        ("IF [1 EQ 1] GOTO 9 (trace:1 get_time)", 21),
        ("IF [1 EQ 2] THEN #1=1 (why) (trace:1 get_time)", 30),
        ("G4 P1 (why) (trace:1 get_time)", 14),
    ] {
        let text = format!("O1\nG21 G54\n{statement}\nN9 G0 X1.\nM30");
        check(
            "fanuc-mill",
            &text,
            &[&time(3), "4 move"],
            &[&format!("trace-block 3:{column}")],
        );
    }
    let text = "O1\nG21 G54\nPOPEN\nDPRNT[A(TRACE:1 B] (trace:1 get_time)\nG0 X1.\nM30";
    check(
        "fanuc-mill",
        text,
        &[&time(4), "4 print: A(TRACE:1B\n", "5 move"],
        &["trace-block 4:21"],
    );
    // In every pass.
    let text = "O1\nG21 G54\n#1=0\nWHILE [#1 LT 3] DO1\n#1=#1+1 (trace:1 get_time)\nEND1\nM30";
    check("fanuc-mill", text, &[&time(5), &time(5), &time(5)], &["trace-block 5:10"]);
    // A comment before it takes nothing from a block of its own.
    check("fanuc-mill", "O1\nG21\n(why) (trace:1 get_time)\nM30", &[&time(3)], &[]);
}

#[test]
fn a_function_in_a_block_that_asks_is_told_once_in_every_pass() {
    let text = "O1\nG21 G54\n#1=0\nWHILE [#1 LT 5] DO1\n#1=#1+1\nG4 P[#5041+100.] (trace:1 get_time)\nEND1\nM30";
    let one = ["get_time", "Number(\"X.POSITION.ACTUAL\")"];
    asks(text, Answer::Number(Some(0.0)), &one.repeat(5));
}

#[test]
fn what_is_kept_is_asked_for_wherever_the_program_ends() {
    let question = "Number(\"#500\")";
    let program = |end: &str| format!("O1\nG21 G54\n(trace:1 get_feedrate its_variable=#500)\nG0 X1.\n{end}");
    let answer = Answer::Number(Some(2.5));
    for end in ["M30", "M2", "", "%", "M99", "O2\nM30"] {
        asks(&program(end), answer, &["get_feedrate", "x1", question, "Some(2.5)"]);
    }
    for end in ["#3000=5(STOP)", "IF [1 EQ 1] THEN #3000=5(STOP)"] {
        asks(
            &program(end),
            answer,
            &["get_feedrate", "x1", question, "Some(2.5)", "alarm macro-alarm 5"],
        );
        // Its own alarm comes all the same.
        let told = ["get_feedrate", "x1", question, "alarm macro-alarm 5", "variable-kept 5"];
        asks(&program(end), Answer::Unknown, &told);
    }
    for (end, line) in [("M30", 5), ("M99", 5), ("%", 5)] {
        let told = [
            "get_feedrate",
            "x1",
            question,
            &format!("alarm no-answer {line}"),
            "variable-kept 5",
        ];
        asks(&program(end), Answer::Unknown, &told);
    }
    // Nobody can be asked behind another alarm.
    asks(
        &program("G99999"),
        answer,
        &["get_feedrate", "x1", "alarm unknown-g 5", "variable-kept 5"],
    );
}

#[test]
fn an_action_that_was_never_done_keeps_no_program_from_its_end() {
    for end in ["M30", "", "M99"] {
        let text = format!("O1\nG21 G54\n{}\nG0 X1.\n{end}", action("#500"));
        let question = "Number(\"#500\")";
        let line = if end.is_empty() { 5 } else { 6 };
        let kept = format!("variable-kept {line}");
        asks(&text, Answer::Unknown, &["start_synchronized_action", "x1", question, &kept]);
        asks(
            &text,
            Answer::Number(Some(4.0)),
            &["start_synchronized_action", "x1", question, "Some(4.0)"],
        );
    }
}

#[test]
fn what_no_machine_knows_and_no_line_uses_stops_nothing() {
    // By the value of another variable only what is found is asked for.
    let text = |index: u32| format!("O1\nG21 G54\n#101=4.\n#1={index}\n{}\nG0 X#[#1]\nM30", action("#100"));
    let (starts, question) = ("start_synchronized_action", "Number(\"#100\")");
    asks(&text(101), Answer::Unknown, &[starts, "x4"]);
    asks(&text(100), Answer::Unknown, &[starts, question, "alarm no-answer 7"]);
    asks(&text(100), Answer::Number(Some(6.0)), &[starts, question, "x6"]);
}

#[test]
fn a_contour_is_cut_only_with_what_is_known() {
    let run = |block: &str, answer: Answer| {
        let text = format!(
            "O1\nG21 G54 G98\n{}\nG0 X50. Z2.\nG71 U1. R1.\nG71 P10 Q20 U0 W0 F100.\nN10 G0 X20.\n{block}\nN20 X50.\nM30",
            action("#100")
        );
        let mut program = open_with(text.as_bytes(), "fanuc-lathe", lathe_tables(), Options::default()).expect("opens");
        let mut reply = None;
        loop {
            match program.next(reply.take()) {
                Next::Step(_) => {}
                Next::Ask(_) => reply = Some(answer),
                Next::End => return None,
                Next::Alarm(alarm) => return Some((alarm.diagnostic.code, alarm.diagnostic.line)),
            }
        }
    };
    assert_eq!(run("G1 Z-10.", Answer::Unknown), None);
    assert_eq!(run("G1 Z#100", Answer::Number(Some(-10.0))), None);
    for block in ["G1 Z#100", "G1 Z#[99+1]"] {
        assert_eq!(run(block, Answer::Unknown), Some(("no-answer", 9)), "{block}");
    }
    assert_eq!(run("G1 Z#5042", Answer::Number(Some(-10.0))), Some(("no-answer", 9)));
}

#[test]
fn a_check_goes_once_through_a_program_that_begins_anew() {
    let text = format!("O1\nG21 G54\n{}\nG0 X#100\nX1.\nM99", action("#100"));
    asks(
        &text,
        Answer::NotAsked,
        &["start_synchronized_action", "Number(\"#100\")", "x1"],
    );
}

#[test]
fn a_program_in_inches_is_warned_of_lengths_that_it_gets_in_millimetres() {
    let of = |units: &str, function: &str| -> Vec<String> {
        let text = format!("O1\n{units} G54\nG0 X1.\n{function}\nX2.\nM30");
        let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
        let _ = run(&mut program);
        let inches = program.diagnostics().iter().filter(|d| d.code == "trace-inches");
        inches.map(|d| format!("{}:{}", d.line, d.column)).collect()
    };
    let reads = "(trace:1 get_encoder_position its_axis=X its_variable=#100)";
    assert_eq!(of("G20", reads), ["4:2"]);
    assert_eq!(of("G21", reads), Vec::<String>::new());
    assert_eq!(of("G20", "(trace:1 get_time its_variable=#100)"), Vec::<String>::new());
    assert_eq!(of("G20", "(trace:1 log_tool_data)"), Vec::<String>::new());
    let continued = "(trace:1 get_encoder_position its_axis=X)\n(trace:+ its_variable=#100)";
    assert_eq!(of("G20", continued), ["5:2"], "once, where it is named");
}

#[test]
fn an_action_takes_with_it_what_its_variable_holds_until_it_is_done() {
    let action = "(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.LOAD > 5 %\")\n\
                  (trace:+ its_actions=\"get_drive_load its_axis=X its_variable=#100\")";
    let text = format!("O1\nG21 G54\n#100=7.\n#101=8.\n{action}\nG0 X1.\nM30");
    let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
    let (steps, _) = run(&mut program);
    let function = steps.iter().find_map(|step| match &step.kind {
        StepKind::NcFunction(function) => Some(function),
        _ => None,
    });
    let properties: Vec<(&str, &str)> = function
        .expect("the action")
        .properties
        .iter()
        .map(|(k, v)| (k.as_str(), v.as_str()))
        .collect();
    assert_eq!(properties, [("variable #100", "7")]);
}
