//! Functions of a program on the simulated machine: recordings, conditions with their actions, alarms with their reactions.

#[path = "common/functions.rs"]
mod setup;

use cell::sink::Kept;
use cell::{Ended, Operator, Outcome, World, WorldConfig};
use machine::{MachineParameters, Phase};
use motion::{Limits, Trajectory};
use serde_json::{Value, json};
use setup::{around, known, look, of, program};
use trace::record::Recorder;
use trace::survey::Found;
use units::{Millimetres, Seconds, Timestamp, ToolNumber};

fn run_as(text: &str, operator: Operator) -> (Outcome, Kept) {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = Seconds(0.05);
    let config = WorldConfig {
        machine,
        operator,
        ..WorldConfig::default()
    };
    let limits = Limits {
        v_max: machine.axes.map(|a| a.v_max),
        a_max: machine.axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    };
    let found = look(text);
    let recorder = Recorder::new(&machine, Timestamp(0), known(), &found);
    let source = Trajectory::new(Box::new(program(text)), config.position, limits);
    let mut kept = Kept::default();
    let world = World::new(config, source).expect("a sound machine");
    let diameters = [(ToolNumber(1), Millimetres(10.0))];
    let outcome = world.with_functions(&found, recorder, &diameters).run(&mut kept);
    (outcome, kept)
}

fn run(text: &str) -> (Outcome, Kept) {
    let operator = Operator {
        cycle_start_after: Some(100),
        ..Operator::default()
    };
    run_as(text, operator)
}

#[test]
fn a_recording_has_a_row_for_each_stream_in_each_cycle_that_is_due() {
    let text = around(
        "",
        "(trace:1 start_sensor_recording its_function_id=1 its_sensors=LOAD its_axes=X,Y its_sampling=4)",
        "(trace:1 stop_sensor_recording its_function_id=1)",
    );
    let (outcome, kept) = run(&text);
    assert_eq!(outcome.ended, Ended::Completed);
    let started = of(&kept, "start_sensor_recording")[0];
    let ended = of(&kept, "stop_sensor_recording")[0];
    let (from, to) = (
        started.detail["tick"].as_u64().unwrap(),
        ended.detail["to_cycle"].as_u64().unwrap(),
    );
    assert_eq!(ended.detail["why"], "stop");
    let x: Vec<_> = kept.rows.iter().filter(|(name, _)| name == "X.LOAD").collect();
    assert_eq!(x.len() * 2, kept.rows.len());
    assert_eq!(
        x[0].1.tick.0, from,
        "the first sample is in the cycle in which it takes effect"
    );
    assert!(x.windows(2).all(|w| w[1].1.tick - w[0].1.tick == 4));
    assert!(to - x.last().unwrap().1.tick.0 <= 4, "{to}");
    // 10 mm at 10 mm/s, and the path never came to rest for the functions.
    assert!((990..1400).contains(&(to - from)), "{from} {to}");
    for (_, row) in &x {
        let sample = kept.samples.iter().find(|s| s.tick == row.tick).expect("a row of the record");
        assert_eq!(row.value, Some(sample.load[0]));
    }
}

#[test]
fn functions_between_blocks_do_not_stop_the_path() {
    let with = around(
        "",
        "(trace:1 get_time)\n(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHENEVER its_condition=\"X.LOAD > 1000\" its_actions=\"get_time\")",
        "",
    );
    let (a, _) = run(&with);
    let (b, _) = run(&around("", "", ""));
    assert_eq!((a.ended, a.time), (Ended::Completed, b.time));
}

#[test]
fn every_sampling_takes_what_it_says() {
    let recording = |sampling: &str, more: &str| {
        let text = around(
            "",
            &format!(
                "(trace:1 start_sensor_recording its_function_id=r its_sensors=X.POSITION.ACTUAL its_sampling={sampling} {more})"
            ),
            "(trace:1 stop_sensor_recording its_function_id=r)",
        );
        let (outcome, kept) = run(&text);
        assert_eq!(outcome.ended, Ended::Completed);
        let end = of(&kept, "stop_sensor_recording")[0].detail.clone();
        (kept, end)
    };
    let (kept, _) = recording("time:20ms", "");
    assert!(kept.rows.windows(2).all(|w| w[1].1.tick - w[0].1.tick == 20));
    let (kept, _) = recording("time:20.4ms", "");
    assert_eq!(of(&kept, "start_sensor_recording")[0].detail["rounded_to_s"], 0.02);

    let (kept, _) = recording("distance:0.5mm", "");
    assert_eq!(kept.rows.len(), 21, "from 10 to 20 mm in steps of half a millimetre");
    for (k, (_, row)) in kept.rows.iter().enumerate() {
        let here = row.value.expect("a position") + 100.0;
        assert!((here - 10.0 - 0.5 * k as f64).abs() < 0.05, "{k}: {here}");
    }

    let (kept, end) = recording("count:7", "");
    assert_eq!((kept.rows.len(), end["samples"].as_u64()), (7, Some(7)));
    let gaps: Vec<u64> = kept.rows.windows(2).map(|w| w[1].1.tick - w[0].1.tick).collect();
    let (low, high) = (gaps.iter().min().unwrap(), gaps.iter().max().unwrap());
    assert!(high - low <= high / 4, "{gaps:?}");

    let (kept, end) = recording("1", "max_samples=5");
    assert_eq!((kept.rows.len(), end["why"].as_str()), (5, Some("max_samples")));

    let average = |statistic: &str| {
        let (kept, _) = recording("10", &format!("its_statistic={statistic}"));
        let ticks: Vec<u64> = kept.rows.iter().map(|(_, r)| r.tick.0).collect();
        let window = |k: usize| {
            let of_window = |s: &&machine::Sample| s.tick.0 > ticks[k - 1] && s.tick.0 <= ticks[k];
            kept.samples
                .iter()
                .filter(of_window)
                .map(|s| s.actual[0])
                .collect::<Vec<f64>>()
        };
        let (name, row) = &kept.rows[5];
        (name.clone(), row.value.expect("a value"), window(5))
    };
    let (name, value, window) = average("avg");
    assert_eq!((name.as_str(), window.len()), ("X.POSITION.ACTUAL.AVERAGE", 10));
    assert!((value - window.iter().sum::<f64>() / 10.0).abs() < 1e-12);
    let (_, value, window) = average("max");
    assert_eq!(value, window.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    let (_, value, window) = average("min");
    assert_eq!(value, window.iter().copied().fold(f64::INFINITY, f64::min));
    let (_, value, window) = average("rms");
    assert!((value - (window.iter().map(|v| v * v).sum::<f64>() / 10.0).sqrt()).abs() < 1e-9);
}

#[test]
fn a_sensor_that_the_machine_has_not_is_recorded_as_unavailable_and_said_before() {
    let text = around(
        "(trace:1 start_sensor_recording its_function_id=1 its_sensors=coolant_pressure its_sampling=100)",
        "(trace:1 get_tool_tip_temperature)",
        "(trace:1 stop_sensor_recording its_function_id=1)",
    );
    let found = look(&text);
    assert_eq!(found.missing, ["COOLANT.PRESSURE", "TOOL.TEMPERATURE"]);
    let (_, kept) = run(&text);
    assert!(!kept.rows.is_empty() && kept.rows.iter().all(|(_, row)| row.value.is_none()));
    let value = &of(&kept, "get_tool_tip_temperature")[0].detail["values"][0];
    assert_eq!((&value["quality"], value.get("value")), (&json!("unavailable"), None));
}

#[test]
fn a_condition_on_the_path_deviation_holds_the_feed_and_both_cycles_are_recorded() {
    let text = around(
        "(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"path_deviation > 0.0005 mm and prog_time > 1 s and X.AXIS_FEEDRATE.ACTUAL > 5\" its_actions=\"set_alarm its_alarm_id=7 its_text=\"\"off the path\"\" its_reaction=feed_hold\",\"get_encoder_position\")",
        "",
        "",
    );
    let (outcome, kept) = run(&text);
    assert_eq!(outcome.ended, Ended::Completed, "cycle start goes on");
    let fired = of(&kept, "start_synchronized_action");
    let fired = fired.iter().find(|e| e.detail["state"] == "fired").expect("it fires");
    let condition = fired.detail["cycle_of_condition"].as_u64().unwrap();
    let before = kept.samples.iter().find(|s| s.tick.0 == condition).expect("its cycle");
    let deviation = (0..3)
        .map(|k| (before.actual[k] - before.commanded[k]) * (before.actual[k] - before.commanded[k]))
        .sum::<f64>()
        .sqrt();
    assert!(deviation > 0.0005, "{deviation}");
    let effect = of(&kept, "set_alarm");
    let effect = effect.iter().find(|e| e.detail["state"] == "effect").expect("an effect");
    assert_eq!(effect.detail["cycle_of_condition"].as_u64(), Some(condition));
    assert!(effect.detail["cycle_of_effect"].as_u64().unwrap() - condition <= 1);
    assert!(kept.samples.iter().any(|s| s.phase == Phase::Paused), "it came to rest");
    let hold = kept.events.iter().find(|e| e.kind == "hold").expect("a hold");
    assert!(hold.detail["tick"].as_u64().unwrap() - condition <= 1);
    // The operator's cycle start ends the alarm.
    assert!(
        of(&kept, "set_alarm")
            .iter()
            .any(|e| e.detail["state"] == "cleared" && e.detail["why"] == "cycle start")
    );
}

#[test]
fn reactions_stop_now_where_the_operation_ends_or_not_at_all() {
    let reacting = |reaction: &str| {
        let text = around(
            "",
            &format!("(trace:1 set_alarm its_alarm_id=3 its_text=x its_reaction={reaction})"),
            "T2 M6\nM3 S1000\nG0 X30.",
        );
        run_as(&text, Operator::default())
    };
    let (outcome, kept) = reacting("none");
    assert_eq!(outcome.ended, Ended::Completed);
    assert_eq!(of(&kept, "set_alarm").len(), 1);
    let (outcome, _) = reacting("stop_now");
    assert_eq!(outcome.ended, Ended::Stopped(machine::StopCause::Asked));
    let (outcome, kept) = reacting("feed_hold");
    assert_eq!(outcome.ended, Ended::Waiting);
    let rest = kept.samples.last().unwrap();
    assert!(
        (-90.0..-85.0).contains(&rest.actual[0]),
        "on the path, in the cut: {:?}",
        rest.actual
    );
    let (outcome, kept) = reacting("stop_after_operation");
    assert_eq!(outcome.ended, Ended::Waiting);
    let rest = kept.samples.last().unwrap();
    assert!(
        (rest.actual[0] + 80.0).abs() < 0.05,
        "where the operation ended: {:?}",
        rest.actual
    );
}

#[test]
fn an_alarm_that_is_active_is_not_set_again_and_is_told_at_most_once_a_second() {
    let text = around(
        "(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHENEVER its_condition=\"prog_time >= 0.5 s\" its_actions=\"set_alarm its_alarm_id=7 its_text=x\",\"read_sensor_value its_sensor=X.LOAD\")",
        "",
        "(trace:1 clear_alarm its_alarm_id=7)\n(trace:1 clear_alarm its_alarm_id=8)",
    );
    let (outcome, kept) = run(&text);
    let cycles = outcome.ticks.0 - 500;
    let fired: Vec<_> = of(&kept, "start_synchronized_action")
        .into_iter()
        .filter(|e| e.detail["state"] == "fired")
        .collect();
    let seconds = cycles / 1000 + 1;
    // It is set at first, and once more behind its clearing: that is told whatever is held back.
    let sets = fired.iter().filter(|e| e.detail["actions"][0]["state"] == "set").count();
    assert_eq!(sets, 2);
    let rest = (fired.len() - sets) as u64;
    assert!(rest <= 10 * seconds, "{rest} in {seconds} s");
    let told: u64 = fired.iter().filter_map(|e| e.detail.get("not_told")?.as_u64()).sum::<u64>() + fired.len() as u64;
    let ended = of(&kept, "stop_synchronized_action");
    let left = ended[0].detail.get("not_told").and_then(Value::as_u64).unwrap_or(0);
    assert_eq!(
        Some(told + left),
        ended[0].detail["fired"].as_u64(),
        "all of them are told or counted"
    );
    // The samples are there at full rate.
    assert_eq!(kept.rows.len() as u64, told + left);
    let cleared = of(&kept, "clear_alarm");
    assert_eq!(cleared[0].detail["state"], "cleared");
    assert_eq!(cleared[1].detail["error"], "T-03");
}

#[test]
fn tool_logging_sees_every_change_while_it_is_on() {
    let text = "O1\nG21 G54\n(trace:1 start_tool_logging its_function_id=T)\nT1 M6\nT2 M6\nT3 M6\n\
                (trace:1 stop_tool_logging its_function_id=T)\nT1 M6\nG0 X1.\nM30\n";
    let (_, kept) = run(text);
    let tools: Vec<_> = of(&kept, "start_tool_logging")
        .iter()
        .filter_map(|e| e.detail.get("tool_number")?.as_u64())
        .collect();
    assert_eq!(tools, [1, 2, 3]);
    let off = of(&kept, "stop_tool_logging")[0];
    assert_eq!(
        (off.detail["state"].as_str(), off.detail["records"].as_u64()),
        (Some("off"), Some(3))
    );
}

#[test]
fn the_second_start_and_the_stop_without_start_are_told_and_change_nothing() {
    let text = around(
        "(trace:1 start_tool_logging its_function_id=T)\n(trace:1 start_tool_logging its_function_id=t)",
        "(trace:1 stop_sensor_recording its_function_id=9)\n(trace:1 stop_synchronized_action its_id=9)",
        "",
    );
    let (outcome, kept) = run(&text);
    assert_eq!(outcome.ended, Ended::Completed);
    let errors: Vec<&str> = kept.events.iter().filter_map(|e| e.detail.get("error")?.as_str()).collect();
    assert_eq!(errors, ["T-02", "T-01", "T-01"]);
}

#[test]
fn an_id_that_is_used_again_means_the_action_that_was_started_last() {
    let action = |what: &str| {
        format!("(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_actions=\"log_event its_kind={what}\")")
    };
    let stop = "(trace:1 stop_synchronized_action its_id=1)";
    let text = around(
        &format!("{}\n{stop}", action("a")),
        &format!("{}\n{stop}", action("b")),
        &action("a"),
    );
    let (outcome, kept) = run(&text);
    assert_eq!(outcome.ended, Ended::Completed);
    let states: Vec<String> = kept
        .events
        .iter()
        .filter(|e| e.kind == "trace" && e.detail.contains_key("id"))
        .filter(|e| e.detail["state"] != "fired")
        .map(|e| format!("{} {}", e.detail["state"].as_str().unwrap(), e.detail["run"]))
        .collect();
    assert_eq!(
        states,
        ["started 1", "ended 1", "started 2", "ended 2", "started 3", "ended 3"]
    );
    let last = of(&kept, "stop_synchronized_action");
    assert_eq!(last[2].detail["why"], "program end");
}

#[test]
fn a_condition_that_was_not_seen_beforehand_is_loaded_when_it_comes() {
    let action = "(trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=EVERY its_condition=\"ws_time > 0.2 s\" its_actions=\"get_time\")";
    let text = around(action, "", "");
    let machine = MachineParameters::small_machining_centre();
    let config = WorldConfig::default();
    let limits = Limits {
        v_max: machine.axes.map(|a| a.v_max),
        a_max: machine.axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    };
    let nothing = Found::default();
    let recorder = Recorder::new(&machine, Timestamp(0), known(), &nothing);
    let source = Trajectory::new(Box::new(program(&text)), config.position, limits);
    let mut kept = Kept::default();
    let world = World::new(config, source).expect("a sound machine");
    world.with_functions(&nothing, recorder, &[]).run(&mut kept);
    let fired: Vec<_> = of(&kept, "start_synchronized_action")
        .into_iter()
        .filter(|e| e.detail["state"] == "fired")
        .collect();
    assert_eq!(fired.len(), 1, "{:#?}", of(&kept, "start_synchronized_action"));
}

#[test]
fn the_same_seed_gives_the_same_rows_and_records() {
    let text = around(
        "(trace:1 start_sensor_recording its_function_id=1 its_sensors=X.LOAD,S1.CUTTING_SPEED its_sampling=7)",
        "(trace:1 get_time)",
        "",
    );
    let (a, _) = run(&text);
    let (b, _) = run(&text);
    assert_eq!((a.digest, a.chain), (b.digest, b.chain));
}
