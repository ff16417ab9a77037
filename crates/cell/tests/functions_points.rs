//! Recordings at points of the geometry, and coordinates in the frame that a program asks for, on the simulated machine.

#[path = "common/functions.rs"]
mod setup;

use cell::sink::Kept;
use cell::{Ended, Operator, World, WorldConfig};
use machine::{MachineParameters, Sample};
use motion::{Limits, Trajectory};
use serde_json::json;
use setup::{around, known, look, of, program};
use trace::record::{Known, Recorder};
use units::{Millimetres, Seconds, Timestamp};

fn run(text: &str) -> Kept {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = Seconds(0.05);
    let config = WorldConfig {
        machine,
        operator: Operator {
            cycle_start_after: Some(100),
            ..Operator::default()
        },
        ..WorldConfig::default()
    };
    let limits = Limits {
        v_max: machine.axes.map(|a| a.v_max),
        a_max: machine.axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    };
    let found = look(text);
    let mut known: Known = known();
    let at = |x: f64| [x, 0.0, 50.0];
    known.points = [
        ("probe".to_owned(), vec![at(12.0), at(15.0), at(15.02), at(19.0)]),
        ("beside".to_owned(), vec![at(12.0), [14.0, 0.2, 50.0], at(16.0)]),
    ]
    .into();
    let recorder = Recorder::new(&machine, Timestamp(0), known, &found);
    let source = Trajectory::new(Box::new(program(text)), config.position, limits);
    let mut kept = Kept::default();
    let world = World::new(config, source).expect("a sound machine");
    let outcome = world.with_functions(&found, recorder, &[]).run(&mut kept);
    assert_eq!(outcome.ended, Ended::Completed);
    kept
}

/// From X10 to X20 with a recording of X that says when.
fn recorded(sampling: &str) -> Kept {
    let start =
        format!("(trace:1 start_sensor_recording its_function_id=r its_sensors=X.POSITION.ACTUAL its_sampling={sampling})");
    run(&around("", &start, "(trace:1 stop_sensor_recording its_function_id=r)"))
}

#[test]
fn points_are_recorded_in_order_where_the_tool_passes_them() {
    let kept = recorded("points:#probe");
    let places: Vec<f64> = kept
        .rows
        .iter()
        .map(|(_, row)| row.value.expect("a position") + 100.0)
        .collect();
    assert_eq!(places.len(), 4, "{places:?}");
    for (place, point) in places.iter().zip([12.0, 15.0, 15.02, 19.0]) {
        // Within the tolerance of 0.05 mm, and the way of a cycle at 10 mm/s.
        assert!((place - point).abs() < 0.061, "{place} {point}");
    }
    let started = of(&kept, "start_sensor_recording")[0];
    assert_eq!(
        (&started.detail["points"], &started.detail["sampling"]),
        (&json!(4), &json!("points:#probe"))
    );
    let ended = of(&kept, "stop_sensor_recording")[0];
    assert_eq!(
        (&ended.detail["samples"], &ended.detail["why"]),
        (&json!(4), &json!("all points"))
    );
    assert_eq!(ended.detail.get("missed_points"), None);
}

#[test]
fn a_point_that_is_not_passed_holds_up_those_behind_it_and_they_are_told_as_missed() {
    let kept = recorded("points:#beside");
    let ended = of(&kept, "stop_sensor_recording")[0];
    assert_eq!(
        (&ended.detail["samples"], &ended.detail["missed_points"], &ended.detail["why"]),
        (&json!(1), &json!(2), &json!("stop"))
    );
    // With room enough it is passed.
    let kept = recorded("points:#beside:0.3mm");
    let ended = of(&kept, "stop_sensor_recording")[0];
    assert_eq!(
        (&ended.detail["samples"], &ended.detail["why"]),
        (&json!(3), &json!("all points"))
    );
}

#[test]
fn every_n_th_cycle_is_counted_from_the_cycle_in_which_it_takes_effect() {
    let kept = recorded("cycle:7");
    let from = of(&kept, "start_sensor_recording")[0].detail["tick"]
        .as_u64()
        .expect("a cycle");
    assert!(
        kept.rows
            .iter()
            .enumerate()
            .all(|(k, (_, row))| row.tick.0 == from + 7 * k as u64)
    );
}

#[test]
fn values_at_points_are_those_of_get_points_and_tell_the_direction() {
    let text = around(
        "",
        "(trace:1 get_interpolated_position_points its_axis=X its_points=#probe with_direction=ON)",
        "",
    );
    let kept = run(&text);
    let of_stream = |name: &str| kept.rows.iter().filter(|(stream, _)| stream == name).collect::<Vec<_>>();
    assert_eq!(of_stream("X.POSITION.COMMANDED").len(), 4);
    for (axis, expected) in [("X", 1.0), ("Y", 0.0), ("Z", 0.0)] {
        let found = of_stream(&format!("PATH.DIRECTION.{axis}"));
        assert_eq!(found.len(), 4);
        assert!(
            found
                .iter()
                .all(|(_, row)| (row.value.expect("it moves") - expected).abs() < 1e-9),
            "{axis}"
        );
    }
}

fn sample_at(kept: &Kept, tick: u64) -> &Sample {
    kept.samples.iter().find(|s| s.tick.0 == tick).expect("a row of the record")
}

#[test]
fn coordinates_are_told_in_the_frame_that_is_asked_for() {
    let text = around(
        "",
        "(trace:1 get_encoder_position)\n(trace:1 get_encoder_position frame=work)\n(trace:1 get_encoder_position frame=tool_tip)\n\
         (trace:1 get_axis_displacement its_axis=X frame=work)\n(trace:1 get_interpolated_position_points its_axis=X frame=work number_of_points=5)",
        "",
    );
    let kept = run(&text);
    let told = of(&kept, "get_encoder_position");
    let values = |k: usize| -> Vec<(String, f64)> {
        let all = told[k].detail["values"].as_array().expect("values");
        let one = |v: &serde_json::Value| {
            (
                v["stream"].as_str().expect("a name").to_owned(),
                v["value"].as_f64().expect("a value"),
            )
        };
        all.iter().map(one).collect()
    };
    let sample = sample_at(&kept, told[0].detail["tick"].as_u64().expect("a cycle"));
    let (machine, work, tip) = (values(0), values(1), values(2));
    for axis in 0..3 {
        assert_eq!(machine[axis].1, sample.actual[axis]);
        // G54 is at -100 in each axis, and no length is in force.
        assert!((work[axis].1 - sample.actual[axis] - 100.0).abs() < 1e-9, "{work:?}");
        assert!((tip[axis].1 - sample.actual[axis]).abs() < 1e-9, "{tip:?}");
    }
    assert_eq!(
        (machine[0].0.as_str(), work[1].0.as_str(), tip[2].0.as_str()),
        ("X.POSITION.ACTUAL", "Y.POSITION.ACTUAL@WORK", "Z.POSITION.ACTUAL@TOOL_TIP")
    );
    let apart = &of(&kept, "get_axis_displacement")[0].detail["values"][0];
    let expected = sample.actual[0] - sample.commanded[0];
    assert!((apart["value"].as_f64().expect("a value") - expected).abs() < 1e-9);
    // Along the path as well, and the record says of which frame it is.
    let started = of(&kept, "get_interpolated_position_points")[0];
    assert_eq!(
        (&started.detail["frame"], &started.detail["streams"][0]["name"]),
        (&json!("work"), &json!("X.POSITION.COMMANDED@WORK"))
    );
    for (stream, row) in &kept.rows {
        assert_eq!(stream, "X.POSITION.COMMANDED@WORK");
        let here = sample_at(&kept, row.tick.0).commanded[0] + 100.0;
        assert!((row.value.expect("a value") - here).abs() < 1e-9);
    }
}

#[test]
fn what_the_conditions_cost_is_recorded_like_any_other_value() {
    let action = |id: u32| {
        format!(
            "(trace:1 start_synchronized_action its_id={id} its_mode_scope=AUTOMATIC its_frequency=WHENEVER its_condition=\"X.LOAD > 1000\" its_actions=\"get_time\")"
        )
    };
    let text = around(
        &format!("{}\n{}", action(1), action(2)),
        "(trace:1 start_sensor_recording its_function_id=r its_sensors=CONTROLLER.WATCH_OPERATIONS,CONTROLLER.WATCH_TIME)",
        "(trace:1 stop_sensor_recording its_function_id=r)",
    );
    let found = look(&text);
    assert_eq!(found.missing, [] as [String; 0]);
    let kept = run(&text);
    let values = |name: &str| {
        let rows = kept.rows.iter().filter(|(stream, _)| stream == name);
        rows.map(|(_, row)| row.value).collect::<Vec<_>>()
    };
    let operations = values("CONTROLLER.WATCH_OPERATIONS");
    assert!(
        operations.len() > 900 && operations.iter().all(|value| *value == Some(2.0)),
        "{:?}",
        &operations[..5]
    );
    // In simulated time nobody measures: the same seed gives the same bytes.
    assert!(values("CONTROLLER.WATCH_TIME").iter().all(Option::is_none));
    let started = of(&kept, "start_sensor_recording")[0];
    assert_eq!(started.detail["streams"][0]["unit"], "COUNT");
}
