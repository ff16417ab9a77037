//! What ends with what: recordings with their workplan or path, actions with the program or never, levels with their workplan; and what
//! goes wrong while a program runs.

mod common;

use common::{Say, look, steps};
use machine::watch::{Firing, FiringKind, Situation, WatchOrder};
use machine::{MachineParameters, Sample, State};
use plan::Level;
use serde_json::{Value, json};
use trace::record::{Known, Order, Recorder, Told};
use units::{StepId, Tick, Timestamp};

/// Ten cycles for each step, its own at the end of the first; gives what was told, `function state why` each, with its cycle.
fn run(said: &[Say<'_>], known: Known) -> (Recorder, Vec<Told>) {
    let machine = MachineParameters::small_machining_centre();
    let found = look(said);
    let mut recorder = Recorder::new(&machine, Timestamp(0), known, &found);
    let mut told = Vec::new();
    let mut tick = 0;
    for step in steps(said) {
        for cycle in 0..10 {
            let sample = Sample {
                tick: Tick(tick),
                step: StepId(step.id.0),
                ..Sample::default()
            };
            recorder.cycle(&sample, Situation::default());
            if cycle == 0 {
                recorder.step(&step, Tick(tick));
            }
            recorder.state(State::Running, Tick(tick), false);
            recorder.take_samples();
            tick += 1;
        }
        told.extend(recorder.take_told());
    }
    (recorder, told)
}

fn words(told: &[Told]) -> Vec<String> {
    let text = |told: &Told, key: &str| told.data.get(key).and_then(Value::as_str).unwrap_or("-").to_owned();
    told.iter()
        .map(|t| format!("{} {} {} {}", t.tick.0, text(t, "function"), text(t, "state"), text(t, "why")))
        .collect()
}

const START: &str = "start_sensor_recording its_function_id=1 its_sensors=X.LOAD";

#[test]
fn a_recording_ends_with_the_workplan_that_it_began_in_and_not_with_one_inside() {
    let said = [
        Say::Begin(Level::Workplan, "main"),
        Say::Function(START),
        Say::Begin(Level::Workplan, "inner"),
        Say::Function("start_sensor_recording its_function_id=2 its_sensors=Y.LOAD"),
        Say::End(Level::Workplan),
        Say::End(Level::Workplan),
    ];
    let (_, told) = run(&said, Known::default());
    assert_eq!(
        words(&told),
        [
            "10 start_sensor_recording started -",
            "30 start_sensor_recording started -",
            "40 stop_sensor_recording ended end of the workplan",
            "50 stop_sensor_recording ended end of the workplan",
        ]
    );
}

#[test]
fn a_recording_along_a_path_ends_with_it_and_a_stop_of_another_run_is_t_01() {
    let said = [
        Say::Begin(Level::Toolpath, "first"),
        Say::Along(START),
        Say::End(Level::Toolpath),
        Say::Function("stop_sensor_recording its_function_id=1"),
        Say::Begin(Level::Toolpath, "second"),
        Say::Along(START),
        Say::End(Level::Toolpath),
    ];
    let (_, told) = run(&said, Known::default());
    assert_eq!(
        words(&told),
        [
            "10 start_sensor_recording started -",
            "20 stop_sensor_recording ended end of the path",
            "30 stop_sensor_recording - sensor recording 1 is stopped and is not active",
            "50 start_sensor_recording started -",
            "60 stop_sensor_recording ended end of the path",
        ]
    );
    assert_eq!(told[2].data["error"], "T-01");
    assert_eq!((&told[0].data["run"], &told[3].data["run"]), (&json!(1), &json!(2)));
}

#[test]
fn automatic_ends_with_the_program_and_all_modes_with_a_simulated_machine() {
    let action = |id: u32, scope: &str| {
        format!(
            "start_synchronized_action its_id={id} its_mode_scope={scope} its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time"
        )
    };
    let (a, b) = (action(1, "AUTOMATIC"), action(2, "ALL"));
    let (mut recorder, _) = run(&[Say::Function(&a), Say::Function(&b)], Known::default());
    recorder.state(State::Ready, Tick(100), true);
    assert_eq!(
        words(&recorder.take_told()),
        ["100 stop_synchronized_action ended program end"]
    );
    recorder.fired(&Firing {
        tick: Tick(110),
        watch: 1,
        kind: FiringKind::Fired,
    });
    assert_eq!(words(&recorder.take_told()), ["110 start_synchronized_action fired -"]);
    recorder.finish(Tick(120));
    assert_eq!(
        words(&recorder.take_told()),
        ["120 stop_synchronized_action ended the machine was simulated for this run and ended with it"]
    );
}

#[test]
fn all_modes_goes_on_in_a_machine_that_goes_on_and_one_that_was_ended_by_hand_does_not() {
    let action = |id: u32| {
        format!(
            "start_synchronized_action its_id={id} its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time"
        )
    };
    let (a, b) = (action(1), action(2));
    let (recorder, _) = run(&[Say::Function(&a), Say::Function(&b)], Known::default());
    let mut recorder = recorder.on_a_machine_that_goes_on();
    recorder.take_told();
    recorder.fired(&Firing {
        tick: Tick(100),
        watch: 0,
        kind: FiringKind::Ended,
    });
    // The program's own stop comes too late for it.
    recorder.state(State::Ready, Tick(110), true);
    recorder.finish(Tick(120));
    let told = recorder.take_told();
    assert_eq!(
        words(&told),
        [
            "100 stop_synchronized_action ended by hand, from the list of what lives in the machine",
            "120 start_synchronized_action goes on it is in all modes, and the machine goes on",
        ]
    );
    assert_eq!((&told[0].data["id"], &told[1].data["id"]), (&json!("1"), &json!("2")));
}

#[test]
fn an_outage_is_one_t_05_and_lost_firings_and_cycles_are_t_09_and_t_10() {
    let action = "start_synchronized_action its_id=2 its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time";
    let (mut recorder, _) = run(&[Say::Function(action), Say::Function(START)], Known::default());
    recorder.fired(&Firing {
        tick: Tick(30),
        watch: 0,
        kind: FiringKind::Unknown,
    });
    recorder.lost_firings(7, Tick(31));
    recorder.lost(3, Tick(32));
    recorder.finish(Tick(40));
    let told = recorder.take_told();
    let errors: Vec<&str> = told.iter().filter_map(|t| t.data.get("error")?.as_str()).collect();
    assert_eq!(errors, ["T-05", "T-09", "T-10"]);
    assert_eq!(
        (&told[1].data["lost_firings"], &told[2].data["lost_cycles"]),
        (&json!(7), &json!(3))
    );
    let ended = told
        .iter()
        .find(|t| t.data["function"] == "stop_sensor_recording")
        .expect("ended");
    assert_eq!(ended.data["lost_cycles"], 3, "the recording says its gap too");
}

/// What the log tells of firings, as `cycle: fired count, held back since the last: states of what they did`.
fn check_firings(does: &str, cycles: impl Iterator<Item = u64>, expected: &[&str]) {
    let action = format!("start_synchronized_action its_id=1 its_mode_scope=ALL {does}");
    let (mut recorder, _) = run(&[Say::Function(&action)], Known::default());
    for cycle in cycles {
        recorder.fired(&Firing {
            tick: Tick(cycle),
            watch: 0,
            kind: FiringKind::Fired,
        });
    }
    recorder.finish(Tick(100_000));
    let told = recorder.take_told().into_iter().map(|told| {
        let data = &told.data;
        let results = data.get("actions").and_then(Value::as_array).cloned().unwrap_or_default();
        let states: Vec<String> = results
            .iter()
            .map(|result| match (&result["state"], &result["repeated"]) {
                (Value::String(state), Value::Number(times)) => format!("{state} {times}"),
                (Value::String(state), _) => state.clone(),
                _ => result["function"].as_str().unwrap_or("-").to_owned(),
            })
            .collect();
        let held_back = data.get("not_told").and_then(Value::as_u64).unwrap_or(0);
        format!("{}: {}, {held_back}: {}", told.tick.0, data["fired"], states.join(" "))
    });
    assert_eq!(told.collect::<Vec<_>>(), expected);
}

#[test]
fn ten_firings_are_told_in_a_second_whatever_the_frequency_and_the_others_are_counted() {
    for often in ["EVERY", "WHENEVER", "FROM"] {
        let does = format!("its_frequency={often} its_condition=\"X.LOAD > 1\" its_actions=get_time");
        let mut expected: Vec<String> = (0..10).map(|n| format!("{}: {}, 0: get_time", 100 + 2 * n, n + 1)).collect();
        expected.push("1100: 501, 490: get_time".to_owned());
        expected.push("100000: 501, 0: ".to_owned());
        let expected: Vec<&str> = expected.iter().map(String::as_str).collect();
        check_firings(&does, (100..=1100).step_by(2), &expected);
    }
}

#[test]
fn an_alarm_that_is_set_again_and_again_is_told_when_it_is_set_and_then_once_in_a_second() {
    check_firings(
        "its_frequency=EVERY its_condition=\"X.LOAD > 1\" its_actions=\"set_alarm its_alarm_id=3 its_text=high\",get_time",
        [0, 400, 800, 1200, 1600, 2000, 2400].into_iter().map(|n| 100 + n),
        &[
            "100: 1, 0: set get_time",
            "500: 2, 0: get_time",
            "900: 3, 0: get_time",
            "1300: 4, 0: repeated 3 get_time",
            "1700: 5, 0: get_time",
            "2100: 6, 0: get_time",
            "2500: 7, 0: repeated 6 get_time",
            "100000: 7, 0: ",
        ],
    );
}

#[test]
fn an_alarm_that_is_cleared_and_set_is_told_each_time_however_much_is_held_back() {
    let mut expected = vec!["100: 1, 0: get_time clear_alarm set".to_owned()];
    expected.extend((2..=10).map(|n| format!("{}: {n}, 0: get_time cleared set", 98 + 2 * n)));
    expected.extend((11..=14).map(|n| format!("{}: {n}, 0: cleared set", 98 + 2 * n)));
    expected.push("100000: 14, 0: ".to_owned());
    let expected: Vec<&str> = expected.iter().map(String::as_str).collect();
    check_firings(
        "its_frequency=EVERY its_condition=\"X.LOAD > 1\" \
         its_actions=get_time,\"clear_alarm its_alarm_id=3\",\"set_alarm its_alarm_id=3 its_text=high\"",
        (0..14).map(|n| 100 + 2 * n),
        &expected,
    );
}

#[test]
fn what_the_machine_owns_is_not_written_while_it_runs_either() {
    let said = [
        Say::Function("get_time its_variable=trace:ws_time"),
        Say::Function("get_time its_variable=moment"),
        Say::Function("log_event its_kind=see its_values=moment"),
    ];
    let (recorder, told) = run(&said, Known::default());
    assert!(told[2].data["values"]["moment"].is_number(), "{:?}", told[2]);
    assert_eq!(recorder.lookup("trace:ws_time"), Some(plan::Value::Number(0.0)));
}

#[test]
fn a_record_of_the_machine_begins_every_job() {
    let known = Known {
        machine: json!({ "model": "sim", "serial_number": "7" })
            .as_object()
            .cloned()
            .expect("an object"),
        ..Known::default()
    };
    let (_, told) = run(&[Say::Function("get_time")], known);
    assert_eq!(
        (&told[0].data["function"], &told[0].data["serial_number"], told[0].tick),
        (&json!("log_nc_machine_data"), &json!("7"), Tick(0))
    );
    assert_eq!(told[0].data[trace::record::BY_ITSELF], "job start");
    assert_eq!(told.len(), 2);
}

#[test]
fn a_level_that_is_set_for_its_workplan_is_over_with_it() {
    let said = [
        Say::Begin(Level::Workplan, "main"),
        Say::Function("set_edit_access_level its_level=3"),
        Say::Begin(Level::Workplan, "inner"),
        Say::Function("set_edit_access_level its_level=2 its_scope=workplan"),
        Say::End(Level::Workplan),
        Say::Function("set_edit_access_level its_level=4"),
    ];
    let (_, told) = run(&said, Known::default());
    let olds: Vec<Option<&Value>> = told.iter().map(|t| t.data.get("old")).collect();
    assert_eq!(
        olds,
        [Some(&json!(10)), Some(&json!(3)), Some(&json!(3))],
        "the outer level returns"
    );
}

#[test]
fn an_id_of_another_kind_is_refused_by_the_machine_and_by_the_record_alike() {
    let action = "start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time";
    // The recording is full after two samples, which the reader ahead cannot know.
    let said = [
        Say::Function("start_sensor_recording its_function_id=1 its_sensors=X.LOAD max_samples=2"),
        Say::Function(action),
        Say::Function("stop_synchronized_action its_id=1"),
        Say::Function("stop_sensor_recording its_function_id=1"),
        Say::Function(action),
        Say::Function("start_tool_logging its_function_id=1"),
        Say::Function("stop_synchronized_action its_id=1"),
        Say::Function("start_tool_logging its_function_id=1"),
    ];
    let (mut recorder, told) = run(&said, Known::default());
    let text = |told: &Told, key: &str| told.data.get(key).and_then(Value::as_str).unwrap_or("-").to_owned();
    let shown: Vec<String> = told
        .iter()
        .map(|t| format!("{} {} {} {}", t.tick.0, text(t, "error"), text(t, "state"), text(t, "why")))
        .collect();
    assert_eq!(
        shown,
        [
            "0 - started -",
            "1 - ended max_samples",
            "10 T-02 - synchronized action 1 is started while 1 is active as a sensor recording",
            "20 T-01 - synchronized action 1 is stopped, and 1 is active as a sensor recording",
            "30 T-01 - -",
            "40 - started -",
            "50 T-02 - tool logging 1 is started while 1 is active as a synchronized action",
            "60 - ended stop",
            "70 - on -",
        ]
    );
    let orders: Vec<_> = steps(&said).iter().map(|step| recorder.orders(step).len()).collect();
    assert_eq!(
        orders,
        [0, 0, 0, 0, 1, 0, 1, 0],
        "the machine is told of what the record has as started"
    );
}

#[test]
fn an_action_along_a_path_ends_with_it() {
    let action = "start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time";
    let said = [
        Say::Begin(Level::Toolpath, "first"),
        Say::Along(action),
        Say::End(Level::Toolpath),
        Say::Begin(Level::Toolpath, "second"),
        Say::Along(action),
        Say::End(Level::Toolpath),
    ];
    let (mut recorder, told) = run(&said, Known::default());
    assert_eq!(
        words(&told),
        [
            "10 start_synchronized_action started -",
            "20 stop_synchronized_action ended end of the path",
            "40 start_synchronized_action started -",
            "50 stop_synchronized_action ended end of the path",
        ]
    );
    let orders: Vec<_> = steps(&said).iter().flat_map(|step| recorder.orders(step)).collect();
    let (start, stop) = (Order::Say(WatchOrder::Start(0)), Order::Say(WatchOrder::Stop(0)));
    assert_eq!(orders, [start.clone(), stop.clone(), start, stop]);
}

#[test]
fn a_condition_that_was_not_looked_at_before_and_is_none_is_told_and_starts_nothing() {
    let line = "start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"X.LOAD > 1\" its_actions=get_time";
    let other = plan::Expression::Truth(true);
    // In a branch that the look did not take.
    let machine = MachineParameters::small_machining_centre();
    let mut recorder = Recorder::new(&machine, Timestamp(0), Known::default(), &look(&[]));
    for step in steps(&[Say::Typed(line, Some(Ok(other)))]) {
        assert_eq!(recorder.orders(&step), []);
        recorder.cycle(&Sample::default(), Situation::default());
        recorder.step(&step, Tick(0));
    }
    let told = recorder.take_told();
    assert_eq!(told[0].data["error"], "T-06");
    assert!(
        told[0].data["why"]
            .as_str()
            .is_some_and(|why| why.contains("X.LOAD > 1") && why.contains("true")),
        "{:?}",
        told[0]
    );
}
