//! Variables of the program that functions write: what is in them, and that nothing is where a measurement failed.

mod common;

use common::{Say, look, steps};
use machine::watch::{Firing, FiringKind, Situation};
use machine::{MachineParameters, Sample};
use plan::{FrameChange, RawNcFunction, StepKind};
use std::collections::BTreeMap;
use trace::record::{Known, Recorder};
use units::{Tick, Timestamp, Transform};

const PUT_BY_THE_PROGRAM: &str = "7";

/// A line in a comment or an extended function, with what the program has put into a variable that the line names.
fn with_value<'s>(line: &str, variable: &str) -> Say<'s> {
    Say::Kind(StepKind::NcFunction(RawNcFunction {
        condition: None,
        kind: RawNcFunction::EXTENDED.to_owned(),
        name: String::new(),
        text: line.to_owned(),
        properties: BTreeMap::from([(
            format!("{}{variable}", RawNcFunction::VARIABLE),
            PUT_BY_THE_PROGRAM.to_owned(),
        )]),
    }))
}

/// A recorder behind all the steps, in one cycle.
fn behind(said: &[Say<'_>]) -> Recorder {
    let machine = MachineParameters::small_machining_centre();
    let mut recorder = Recorder::new(&machine, Timestamp(0), Known::default(), &look(said));
    recorder.cycle(&Sample::default(), Situation::default());
    for step in steps(said) {
        recorder.step(&step, Tick(0));
    }
    recorder
}

#[test]
fn a_measurement_that_fails_leaves_no_old_value_behind() {
    let line = |call: &str, variable: &str| format!("trace:1 {call} its_variable={variable}");
    for (variable, written) in [
        ("#100", "#100"),
        ("#100", "#0100"),
        ("SPEED", "SPEED"),
        ("TIME LIMIT", "\"TIME LIMIT\""),
    ] {
        for call in [
            "get_tool_tip_temperature",
            "get_execution_time its_executable=nobody",
            "get_drive_load its_axes=X,Y",
            "read_sensor_value its_sensor=nothing_of_that_name",
            // A slip of the pen in a branch that the look did not take.
            "get_feedrate its_lgo=x",
        ] {
            let text = line(call, written);
            // The line names the variable, so its old value comes along.
            let recorder = behind(&[with_value(&text, variable)]);
            assert_eq!(recorder.lookup(variable), None, "{text}");
            // It was known from before: told by another function, or written by one.
            for before in [
                with_value(&format!("trace:1 log_event its_kind=a its_values={written}"), variable),
                with_value(&line("get_time", written), "other"),
            ] {
                assert!(behind(std::slice::from_ref(&before)).lookup(variable).is_some(), "{text}");
                let along = text.strip_prefix("trace:1 ").expect("a line");
                assert_eq!(
                    behind(&[before, Say::Along(along)]).lookup(variable),
                    None,
                    "{text} along a path"
                );
            }
        }
        let recorder = behind(&[with_value(&line("get_feedrate", written), variable)]);
        assert_eq!(
            recorder.lookup(variable),
            Some(plan::Value::Number(0.0)),
            "what was measured is there"
        );
    }
}

#[test]
fn a_variable_without_a_value_is_not_taken_for_the_machines_of_its_name() {
    let recorder = behind(&[with_value("trace:1 get_tool_tip_temperature its_variable=ws_time", "ws_time")]);
    assert_eq!(recorder.lookup("ws_time"), None);
    assert_eq!(recorder.lookup("trace:ws_time"), Some(plan::Value::Number(0.0)));
}

#[test]
fn until_an_action_writes_its_variable_holds_what_the_program_put_there() {
    let action = "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 1\" \
        its_actions=\"get_tool_tip_temperature its_variable=HEAT\"";
    let mut recorder = behind(&[with_value(action, "HEAT")]);
    assert_eq!(recorder.lookup("HEAT"), Some(plan::Value::Number(7.0)));
    recorder.fired(&firing(1));
    assert_eq!(recorder.lookup("HEAT"), None);
}

#[test]
fn a_fast_action_writes_its_variable_each_time_however_little_is_told() {
    let action = "start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHENEVER its_condition=\"X.LOAD > -1\" \
        its_actions=\"get_interpolated_position its_axis=X frame=machine its_variable=PLACE\",\"get_time its_variable=MOMENT\",\
        \"get_interpolated_position its_axis=X frame=work its_variable=IN_WORK\"";
    let said = [
        Say::Kind(StepKind::Frame(FrameChange {
            name: "G54".to_owned(),
            machine_from_setup: Transform::shift([2.0, 0.0, 0.0]),
            assumed: false,
        })),
        Say::Function(action),
    ];
    let mut recorder = behind(&said);
    for tick in 1..=40 {
        let sample = Sample {
            tick: Tick(tick),
            commanded: [tick as f64, 0.0, 0.0],
            ..Sample::default()
        };
        recorder.cycle(&sample, Situation::default());
        recorder.fired(&firing(tick));
        for (name, value) in [
            ("PLACE", tick as f64),
            ("MOMENT", tick as f64),
            ("IN_WORK", tick as f64 - 2.0),
        ] {
            assert_eq!(
                recorder.lookup(name),
                Some(plan::Value::Number(value)),
                "{name} in cycle {tick}"
            );
        }
    }
    let fired = recorder.take_told().into_iter().filter(|told| told.data["state"] == "fired");
    assert_eq!(fired.count(), 10);
}

fn firing(tick: u64) -> Firing {
    Firing {
        tick: Tick(tick),
        watch: 0,
        kind: FiringKind::Fired,
    }
}
