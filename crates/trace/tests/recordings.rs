//! What recordings take and what records say, seen over made-up cycles.

mod common;

use common::{Say, look, steps};
use machine::watch::Situation;
use machine::{MachineParameters, Sample};
use plan::{RawNcFunction, StepKind};
use serde_json::json;
use std::collections::BTreeMap;
use trace::record::{Known, Recorder, Row, Told};
use units::{StepId, Tick, Timestamp};

/// All steps in the first cycle, then a cycle for each place along X; gives rows and records.
fn over(said: &[Say<'_>], places: &[f64]) -> (Vec<Row>, Vec<Told>) {
    let machine = MachineParameters::small_machining_centre();
    let mut recorder = Recorder::new(&machine, Timestamp(0), Known::default(), &look(said));
    let mut steps = steps(said).into_iter();
    for (tick, x) in places.iter().enumerate() {
        let sample = Sample {
            tick: Tick(tick as u64),
            step: StepId(1),
            commanded: [*x, 0.0, 0.0],
            actual: [*x, 0.0, 0.0],
            ..Sample::default()
        };
        recorder.cycle(&sample, Situation::default());
        for step in steps.by_ref() {
            recorder.step(&step, Tick(tick as u64));
        }
        recorder.take_samples();
    }
    recorder.finish(Tick(places.len() as u64));
    (recorder.take_rows(), recorder.take_told())
}

#[track_caller]
fn sampled_at(sampling: &str, places: &[f64], expected: &[u64]) {
    let line = format!("start_sensor_recording its_function_id=1 its_sensors=X.POSITION.ACTUAL its_sampling={sampling}");
    let (rows, _) = over(&[Say::Function(&line)], places);
    let ticks: Vec<u64> = rows.iter().map(|row| row.tick.0).collect();
    assert_eq!(ticks, expected, "{sampling}");
}

#[test]
fn a_distance_is_sampled_in_the_first_cycle_at_or_behind_each_of_its_multiples() {
    sampled_at("distance:1mm", &[0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.0, 3.5], &[0, 3, 5, 7]);
}

#[test]
fn a_move_of_several_steps_in_a_cycle_leaves_no_samples_for_the_standstill_behind_it() {
    // 500 mm/s are 0.5 mm in a cycle.
    sampled_at("distance:0.1mm", &[0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.05, 1.11], &[0, 1, 2, 7]);
    sampled_at("distance:1e-30mm", &[0.0, 1.0, 1.0, 1.0, 1.5], &[0, 1, 4]);
}

#[test]
fn every_record_of_a_function_says_the_log_that_it_asked_for() {
    let said = [
        Say::Function("start_sensor_recording its_function_id=1 its_sensors=X.LOAD its_log=loads"),
        Say::Function("set_edit_access_level its_level=3 its_log=levels"),
        Say::Function("start_tool_logging its_function_id=2 its_log=tools"),
        Say::Function("get_time"),
    ];
    let (_, told) = over(&said, &[0.0]);
    let logs: Vec<_> = told.iter().take(4).map(|t| t.data.get("log").cloned()).collect();
    assert_eq!(
        logs,
        [Some(json!("loads")), Some(json!("levels")), Some(json!("tools")), None]
    );
}

#[test]
fn an_event_holds_what_the_program_has_put_into_its_variables() {
    let event = |values: &str| {
        let known = (format!("{}#1", RawNcFunction::VARIABLE), "4.5".to_owned());
        Say::Kind(StepKind::NcFunction(RawNcFunction {
            condition: None,
            kind: RawNcFunction::EXTENDED.to_owned(),
            name: "log_event".to_owned(),
            text: format!("trace:1 log_event its_kind=pass its_values={values}"),
            properties: BTreeMap::from([known]),
        }))
    };
    let (_, told) = over(&[event("#1,#2")], &[0.0]);
    assert_eq!(told[0].data["values"], json!({ "#1": 4.5, "#2": "unavailable" }));
}

#[test]
fn a_motor_is_that_of_an_axis_a_spindle_or_all_of_a_channel() {
    let said = [
        Say::Function("get_motor_current its_spindle=s1"),
        Say::Function("get_motor_power its_axis=Y"),
        Say::Function("get_motor_power its_channel=1"),
    ];
    let (_, told) = over(&said, &[0.0]);
    let streams: Vec<_> = told.iter().take(3).map(|t| t.data["values"][0]["stream"].clone()).collect();
    assert_eq!(streams, ["S1.AMPERAGE", "Y.WATTAGE", "PATH.WATTAGE"]);
}

#[test]
fn a_stream_that_is_named_twice_is_recorded_once() {
    let said = [
        Say::Function("start_sensor_recording its_function_id=1 its_sensors=drive_load,LOAD,load its_axes=X,y,x,Y max_samples=2"),
        Say::Function("read_sensor_value its_sensor=drive_load its_axes=X,X its_variable=V"),
        Say::Function("get_motor_power its_axes=Z,z"),
    ];
    let (rows, told) = over(&said, &[0.0, 0.0, 0.0]);
    assert_eq!(rows.len(), 4, "two streams, two samples each: {rows:?}");
    assert!(look(&said).diagnostics.iter().all(|found| found.code != "T-06"));
    let values = |at: usize| told[at].data["values"].as_array().map(Vec::len);
    assert_eq!((values(1), values(2)), (Some(1), Some(1)), "{told:?}");
}
