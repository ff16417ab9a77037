//! Every code of the table of errors that is found before a program runs, with its place; what comes while it runs is in `scopes.rs` and
//! in the tests of the machine and the cell.

mod common;

use common::{Say, look};
use machine::watch::{Operation, Relation};
use plan::expression::Operator;
use plan::{Expression, Level};

/// Severity, code and line of each finding.
#[track_caller]
fn check(said: &[Say<'_>], expected: &[&str]) {
    let found = look(said).with_geometry(|name| name == "probe");
    let shown: Vec<String> = found
        .diagnostics
        .iter()
        .map(|d| format!("{:?} {} {}", d.severity, d.code, d.line).to_lowercase())
        .collect();
    assert_eq!(shown, expected, "{:#?}", found.diagnostics);
}

const START: &str = "start_sensor_recording its_function_id=1 its_sensors=X.LOAD";
const STOP: &str = "stop_sensor_recording its_function_id=1";

#[test]
fn t_01_is_an_error_where_nothing_was_started_and_a_warning_where_it_is_over_already() {
    check(&[Say::Function(STOP)], &["error t-01 1"]);
    check(
        &[Say::Function(START), Say::Function(STOP), Say::Function(STOP)],
        &["warning t-01 3"],
    );
    // Another kind of function with the same name was never this one's start.
    check(
        &[
            Say::Function("start_tool_logging its_function_id=1"),
            Say::Function(STOP),
            Say::Function("stop_tool_logging its_function_id=1"),
        ],
        &["error t-01 2"],
    );
    check(&[Say::Function("stop_synchronized_action its_id=9")], &["error t-01 1"]);
    check(
        &[Say::Function("log_nc_events its_function_id=E its_state=OFF")],
        &["error t-01 1"],
    );
    check(
        &[Say::Function("log_operator_data its_function_id=P its_state=OFF")],
        &["error t-01 1"],
    );
}

#[test]
fn t_02_is_a_second_start_whatever_the_case_of_its_name() {
    check(
        &[
            Say::Function("start_tool_logging its_function_id=T"),
            Say::Function("start_tool_logging its_function_id=t"),
            Say::Function("stop_tool_logging its_function_id=T"),
        ],
        &["error t-02 2"],
    );
    // After its stop a name is free.
    check(
        &[
            Say::Function(START),
            Say::Function(STOP),
            Say::Function(START),
            Say::Function(STOP),
        ],
        &[],
    );
    // Nested and overlapping ones of other names are allowed.
    check(
        &[
            Say::Function(START),
            Say::Function("start_sensor_recording its_function_id=2 its_sensors=X.LOAD"),
            Say::Function(STOP),
            Say::Function("stop_sensor_recording its_function_id=2"),
        ],
        &[],
    );
}

/// What is said of the ids, and what to do about it.
#[track_caller]
fn said(lines: &[&str], expected: &[&str]) {
    let said: Vec<Say<'_>> = lines.iter().map(|line| Say::Function(line)).collect();
    let found = look(&said).diagnostics.into_iter().filter(|d| d.code != "T-04");
    let shown: Vec<String> = found.map(|d| format!("{} {}: {}", d.code, d.message, d.remedy)).collect();
    assert_eq!(shown, expected);
}

#[test]
fn an_id_is_unique_among_all_kinds_of_functions_that_are_active() {
    let action = "start_synchronized_action its_id=R1 its_mode_scope=ALL its_actions=get_time";
    let recording = "start_sensor_recording its_function_id=r1 its_sensors=X.LOAD";
    said(
        &[recording, action],
        &["T-02 synchronized action R1 is started while R1 is active as a sensor recording: stop it first, or give another id"],
    );
    said(
        &[action, "log_nc_events its_function_id=R1 its_state=ON"],
        &["T-02 event logging R1 is started while R1 is active as a synchronized action: stop it first, or give another id"],
    );
    said(
        &[
            "log_operator_data its_function_id=R1 its_state=ON",
            "start_tool_logging its_function_id=R1",
        ],
        &["T-02 tool logging R1 is started while R1 is active as operator logging: stop it first, or give another id"],
    );
    // One behind the other is allowed, also of two kinds.
    said(&[recording, "stop_sensor_recording its_function_id=R1", action], &[]);
}

#[test]
fn a_stop_of_an_id_that_is_active_as_another_kind_is_t_01_that_says_so() {
    let recording = "start_sensor_recording its_function_id=R1 its_sensors=X.LOAD";
    said(
        &[recording, "stop_synchronized_action its_id=r1"],
        &[
            "T-01 synchronized action r1 is stopped, and r1 is active as a sensor recording: write stop_sensor_recording, or give the id of a synchronized action",
        ],
    );
    said(
        &[
            "log_nc_events its_function_id=E its_state=ON",
            "stop_tool_logging its_function_id=E",
        ],
        &[
            "T-01 tool logging E is stopped, and E is active as event logging: write log_nc_events ... its_state=OFF, or give the id of tool logging",
        ],
    );
}

#[test]
fn an_id_along_a_path_is_taken_until_the_path_ends() {
    let along = "start_sensor_recording its_function_id=1 its_sensors=X.LOAD";
    let action = "start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_actions=get_time";
    check(
        &[
            Say::Begin(Level::Toolpath, "first"),
            Say::Along(along),
            Say::Along(action),
            Say::End(Level::Toolpath),
            Say::Begin(Level::Toolpath, "second"),
            Say::Along(action),
            Say::End(Level::Toolpath),
            Say::Function("start_tool_logging its_function_id=1"),
        ],
        &["error t-02 3", "remark t-04 0"],
    );
}

#[test]
fn t_04_says_what_ends_a_start_that_has_no_stop() {
    check(&[Say::Function(START)], &["remark t-04 0"]);
    check(
        &[
            Say::Begin(Level::Workplan, "main"),
            Say::Function(START),
            Say::End(Level::Workplan),
            // It is over: its stop is none any more.
            Say::Function(STOP),
        ],
        &["remark t-04 3", "warning t-01 4"],
    );
}

#[test]
fn t_05_is_a_warning_and_an_error_where_the_sensor_is_required() {
    check(&[Say::Function("get_tool_tip_temperature")], &["warning t-05 0"]);
    check(
        &[Say::Function("get_tool_tip_temperature required=ON")],
        &["error t-05-required 1", "warning t-05 0"],
    );
    check(&[Say::Function("read_sensor_value its_sensor=humidity")], &["error t-05 1"]);
    // The second measuring system is one that this machine has not.
    check(
        &[Say::Function("get_encoder_position its_axis=X its_encoder=2")],
        &["warning t-05 0"],
    );
    check(&[Say::Function("get_encoder_position its_axis=X its_encoder=1")], &[]);
}

#[test]
fn t_06_is_what_makes_no_sense_conditions_units_variables_and_geometry() {
    let action = |rest: &str| format!("start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC {rest} its_actions=get_time");
    for rest in [
        "its_frequency=WHEN its_condition=\"humidity > 3\"",
        "its_frequency=WHEN its_condition=\"ws_time > 3 mm\"",
        "its_frequency=WHEN its_condition=\"X.LOAD\"",
        "its_frequency=WHEN its_condition=\"TIME_LIMIT > 3\"",
        "its_frequency=WHEN",
        "its_condition=\"X.LOAD > 3\"",
    ] {
        let line = action(rest);
        check(&[Say::Function(&line)], &["error t-06 1", "remark t-04 0"]);
    }
    // The whole line is not read: what it starts is not known.
    let line = action("its_frequency=WHEN its_condition=\"X.LOAD > #100\"");
    check(&[Say::Function(&line)], &["error t-06 1"]);
    check(&[Say::Function("get_drive_load its_variable=load")], &["error t-06 1"]);
    check(&[Say::Function("get_drive_load its_axis=X its_variable=load")], &[]);
    let at = |name: &str| format!("get_drive_load_points its_axis=X its_points=#{name}");
    check(&[Say::Function(&at("probe"))], &[]);
    check(&[Say::Function(&at("prob"))], &["error t-06 1"]);
    let at = |name: &str| format!("start_sensor_recording its_function_id=1 its_sensors=X.LOAD its_sampling=points:#{name}");
    check(&[Say::Function(&at("prob")), Say::Function(STOP)], &["error t-06 1"]);
}

#[test]
fn t_06_is_a_typed_condition_that_says_something_else_than_its_line() {
    let line = "start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"ws_time > 1 h\" its_actions=get_time";
    let over = |seconds: f64| {
        let time = Box::new(Expression::Name("trace:ws_time".to_owned()));
        let limit = Box::new(Expression::Number(seconds, None));
        Some(Ok(Expression::Binary(Operator::Greater, time, limit)))
    };
    let stop = Say::Function("stop_synchronized_action its_id=1");
    check(&[Say::Typed(line, over(3600.0)), stop], &[]);
    let stop = Say::Function("stop_synchronized_action its_id=1");
    check(&[Say::Typed(line, over(1800.0)), stop], &["error t-06 1", "error t-01 2"]);
    let found = look(&[Say::Typed(line, over(1800.0))]);
    let text = found.diagnostics[0].to_string();
    assert!(
        text.contains("\"ws_time > 1 h\"") && text.contains("\"trace:ws_time > 1800\""),
        "{text}"
    );
    assert!(found.conditions.is_empty(), "neither of them is loaded");
    // Where there is only the typed one, it is what is loaded.
    let without = line.replace(" its_condition=\"ws_time > 1 h\"", "");
    let found = look(&[Say::Typed(&without, over(1800.0))]);
    let signal = machine::watch::signal("trace:ws_time").expect("a signal");
    assert_eq!(
        found.conditions[0].1.operations,
        [Operation::Compare(signal, Relation::Greater, 1800.0)]
    );
    check(
        &[Say::Typed(&without, Some(Err("#7 holds no number".to_owned())))],
        &["error t-06 1"],
    );
    check(&[Say::Typed("get_time", over(1.0))], &["warning t-06-condition 1"]);
}

#[test]
fn t_07_is_found_wherever_a_variable_of_the_machine_is_written() {
    check(&[Say::Function("get_time its_variable=trace:ws_time")], &["error t-07 1"]);
    check(
        &[Say::Function("get_drive_load its_axis=X its_variable=SENSOR:X.LOAD")],
        &["error t-07 1"],
    );
    check(&[Say::Along("get_time its_variable=trace:mode")], &["error t-07 1"]);
    check(
        &[
            Say::Function(
                "start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_actions=\"get_drive_load its_axis=X its_variable=sensor:X.LOAD\"",
            ),
            Say::Function("stop_synchronized_action its_id=1"),
        ],
        &["error t-07 1"],
    );
    // Without the prefix it is the program's own, and one that is easily mistaken.
    check(&[Say::Function("get_time its_variable=ws_time")], &["warning t-07-name 1"]);
    check(&[Say::Function("get_time its_variable=begin")], &[]);
}

#[test]
fn t_08_is_an_action_that_may_be_none() {
    let action = |what: &str| format!("start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_actions=\"{what}\"");
    for what in [
        "start_tool_logging its_function_id=1",
        "set_edit_access_level its_level=3",
        "paint_part",
        "start_synchronized_action its_id=2 its_mode_scope=ALL its_actions=get_time",
    ] {
        check(&[Say::Function(&action(what))], &["error t-08 1", "remark t-04 0"]);
    }
}

#[test]
fn t_09_is_more_conditions_than_the_cycle_takes_with_what_they_come_to() {
    let most = machine::watch::CONDITIONS;
    let lines: Vec<String> = (0..=most)
        .map(|k| {
            format!(
                "start_synchronized_action its_id=a{k} its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.LOAD > {k}\" its_actions=get_time"
            )
        })
        .collect();
    let said: Vec<Say<'_>> = lines.iter().map(|line| Say::Function(line)).collect();
    let found = look(&said);
    let error = found.diagnostics.iter().find(|d| d.code == "T-09").expect("too many");
    assert_eq!((error.line, found.conditions.len()), (most as u32 + 1, most));
    let expected = format!("{} with {} operations", most + 1, most + 1);
    assert!(error.message.contains(&expected), "{error}");
    assert!(look(&said[..most]).diagnostics.iter().all(|d| d.code != "T-09"));
}

#[test]
fn t_09_is_more_values_spread_evenly_than_are_kept_in_memory() {
    let at = |count: u32| format!("start_sensor_recording its_function_id=1 its_sensors=X.LOAD its_sampling=count:{count}");
    check(&[Say::Function(&at(100_000)), Say::Function(STOP)], &[]);
    check(&[Say::Function(&at(4_294_967_295)), Say::Function(STOP)], &["error t-09 1"]);
    check(
        &[Say::Function("get_drive_load_points number_of_points=2147483647")],
        &["error t-09 1"],
    );
}

#[test]
fn t_12_is_a_function_between_two_paths_of_an_operation() {
    check(
        &[
            Say::Begin(Level::Workingstep, "ws"),
            Say::Begin(Level::Operation, "op"),
            Say::Function("get_time"),
            Say::Along("get_time"),
            Say::End(Level::Operation),
            Say::Function("get_time"),
            Say::End(Level::Workingstep),
        ],
        &["error t-12 3"],
    );
}

#[test]
fn a_frame_that_has_no_such_coordinate_is_refused_with_the_reason() {
    check(&[Say::Function("get_encoder_position its_axis=X frame=work")], &[]);
    check(
        &[Say::Function("get_encoder_position its_axis=A frame=work")],
        &["error t-05 1"],
    );
    let found = look(&[Say::Function("get_encoder_position_points its_axis=A frame=tool_tip")]);
    assert!(
        found.diagnostics[0]
            .message
            .contains("A has no coordinate in the frame tool_tip"),
        "{:?}",
        found.diagnostics
    );
}

#[test]
fn a_kind_that_no_event_of_the_control_has_is_said() {
    let said = "log_nc_events its_function_id=e its_state=ON its_kinds=hold,Cycle-Start,spindel";
    let off = "log_nc_events its_function_id=e its_state=OFF";
    check(&[Say::Function(said), Say::Function(off)], &["warning trace-events 1"]);
}
