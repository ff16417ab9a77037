//! Conditions of synchronized actions over the link: what they do and what is recorded of them is what it is without a link.

#[path = "common/functions.rs"]
mod setup;

use cell::link::channel::Damage;
use cell::link::world::{LinkFault, LinkedConfig, LinkedWorld};
use cell::sink::Kept;
use cell::{Ended, World, WorldConfig};
use machine::{MachineParameters, Phase};
use motion::{Limits, Trajectory};
use serde_json::Value;
use setup::{around, known, look, of, program};
use trace::record::Recorder;
use trace::survey::Found;
use units::{Millimetres, Seconds, Tick, Timestamp, ToolNumber};

fn machine() -> MachineParameters {
    MachineParameters {
        tool_change: Seconds(0.05),
        ..MachineParameters::small_machining_centre()
    }
}

fn source(text: &str) -> Trajectory<'_> {
    let limits = Limits {
        v_max: machine().axes.map(|a| a.v_max),
        a_max: machine().axes.map(|a| a.a_max),
        j_max: None,
        tolerance: Millimetres(0.01),
    };
    Trajectory::new(Box::new(program(text)), LinkedConfig::default().position, limits)
}

const DIAMETERS: [(ToolNumber, Millimetres); 1] = [(ToolNumber(1), Millimetres(10.0))];

fn direct(text: &str, found: &Found) -> (Ended, Kept) {
    let config = WorldConfig {
        machine: machine(),
        operator: LinkedConfig::default().operator,
        ..WorldConfig::default()
    };
    let mut kept = Kept::default();
    let recorder = Recorder::new(&machine(), Timestamp(0), known(), found);
    let world = World::new(config, source(text)).expect("a sound machine");
    let outcome = world.with_functions(found, recorder, &DIAMETERS).run(&mut kept);
    (outcome.ended, kept)
}

/// Over a link; `found` is what is loaded before, the rest when it comes.
fn linked(config: LinkedConfig, text: &str, found: &Found) -> (Ended, Kept) {
    let config = LinkedConfig {
        machine: machine(),
        ..config
    };
    let functions = || {
        let recorder = Recorder::new(&machine(), Timestamp(0), known(), found);
        (found.clone(), recorder, DIAMETERS.to_vec())
    };
    let mut world = LinkedWorld::new(config, || source(text)).with_functions(functions);
    let mut kept = Kept::default();
    loop {
        if let Some(ended) = world.advance(&mut kept, &mut |_| {}) {
            return (ended, kept);
        }
        let status = (world.sender().map(|s| s.status()), world.follower().status());
        assert!(world.now().0 < 60_000, "does not end: {status:?}");
    }
}

/// Details of events without what a hash or the beginning of a run makes different.
fn told(kept: &Kept) -> Vec<(String, Value)> {
    let event = |e: &ledger::Event| (e.kind.clone(), Value::Object(e.detail.clone().into_iter().collect()));
    kept.events.iter().filter(|e| e.kind != "job-started").map(event).collect()
}

fn action(id: u32, frequency: &str, condition: &str, actions: &str) -> String {
    format!(
        "(trace:1 start_synchronized_action its_id={id} its_mode_scope=AUTOMATIC its_frequency={frequency} its_condition=\"{condition}\" its_actions={actions})"
    )
}

/// Conditions of every frequency, on signals, tools and alarms, one of which holds the feed.
fn watched() -> String {
    let before = [
        action(1, "EVERY", "ws_time >= 0 s and X.LOAD > 0.5 %", "\"get_time\""),
        action(
            2,
            "WHEN",
            "prog_time > 1 s and X.AXIS_FEEDRATE.ACTUAL > 5",
            "\"set_alarm its_alarm_id=7 its_text=x its_reaction=feed_hold\",\"get_encoder_position\"",
        ),
        action(3, "WHENEVER", "alarm[7]", "\"read_sensor_value its_sensor=S1.CUTTING_SPEED\""),
        action(
            4,
            "FROM",
            "prog_time >= 1.2 s",
            "\"read_sensor_value its_sensor=X.POSITION.ACTUAL\"",
        ),
    ];
    around(&before.join("\n"), "(trace:1 stop_synchronized_action its_id=4)", "")
}

#[test]
fn on_a_wire_without_delay_the_run_is_that_without_a_link_bit_by_bit() {
    let text = watched();
    let found = look(&text);
    assert_eq!(
        (
            found.conditions.len(),
            found
                .diagnostics
                .iter()
                .filter(|d| d.severity == plan::Severity::Error)
                .count()
        ),
        (4, 0)
    );
    let (ended, without) = direct(&text, &found);
    assert_eq!(ended, Ended::Completed);
    assert!(without.samples.iter().any(|s| s.phase == Phase::Paused), "it was held");
    let (ended, with) = linked(LinkedConfig::default(), &text, &found);
    assert_eq!(ended, Ended::Completed);
    assert!(with.samples == without.samples, "another record");
    assert_eq!(told(&with), told(&without));
    assert_eq!(with.rows.len(), without.rows.len());
    let bits = |kept: &Kept| -> Vec<_> {
        kept.rows
            .iter()
            .map(|(name, r)| (name.clone(), r.tick, r.value.map(f64::to_bits)))
            .collect()
    };
    assert!(
        bits(&with) == bits(&without) && with.rows.len() > 100,
        "{} rows",
        with.rows.len()
    );
}

#[test]
fn nothing_is_lost_or_doubled_by_cuts_stalls_and_damage() {
    let text = watched();
    let found = look(&text);
    let (_, without) = direct(&text, &found);
    let fired = |kept: &Kept| -> Vec<(Value, Value)> {
        let is = |e: &&ledger::Event| e.kind == "trace" && e.detail["function"] == "stop_synchronized_action";
        let ended = kept.events.iter().filter(is);
        ended.map(|e| (e.detail["id"].clone(), e.detail["fired"].clone())).collect()
    };
    let alarms = |kept: &Kept| of(kept, "set_alarm").iter().filter(|e| e.detail["state"] == "effect").count();
    assert_eq!((fired(&without).len(), alarms(&without)), (4, 1));
    let cut = |at: u64, ticks: u64, noticed: bool| LinkFault::Cut {
        at: Tick(at),
        ticks,
        noticed,
    };
    for faults in [
        // While conditions are loaded, while they begin, while one holds the feed, and while all of them fire.
        vec![cut(1, 200, true)],
        vec![cut(2, 700, false)],
        vec![cut(3, 30, true), cut(40, 30, true)],
        vec![cut(1_100, 100, true), cut(1_350, 100, true), cut(1_500, 60, true)],
        vec![LinkFault::Stall {
            at: Tick(1_200),
            ticks: 150,
        }],
        vec![LinkFault::Damaged {
            at: Tick(2),
            to_machine: true,
            damage: Damage::Bit,
        }],
        vec![LinkFault::Damaged {
            at: Tick(1_450),
            to_machine: false,
            damage: Damage::Missing,
        }],
        vec![LinkFault::Damaged {
            at: Tick(1_450),
            to_machine: false,
            damage: Damage::Twice,
        }],
    ] {
        for delay in [(0, 0), (2, 7)] {
            let config = LinkedConfig {
                faults: faults.clone(),
                delay,
                batch: 10,
                ..LinkedConfig::default()
            };
            let (ended, kept) = linked(config, &text, &found);
            assert_eq!(ended, Ended::Completed, "{faults:?} {delay:?}");
            assert_eq!(alarms(&kept), 1, "{faults:?} {delay:?}");
            let counted = fired(&kept);
            // WHEN fires once. WHENEVER and FROM fire in each cycle, and a row is there for each.
            assert_eq!(counted.len(), 4, "{faults:?} {delay:?}");
            let count = |id: &str| {
                counted
                    .iter()
                    .find(|(found, _)| found == id)
                    .and_then(|(_, n)| n.as_u64())
                    .expect("a count")
            };
            assert_eq!(count("2"), 1, "{faults:?} {delay:?}");
            let rows = |stream: &str| {
                kept.rows
                    .iter()
                    .filter(|(name, _)| name == stream)
                    .map(|(_, row)| row.tick.0)
                    .collect::<Vec<_>>()
            };
            for (id, stream) in [("3", "S1.CUTTING_SPEED"), ("4", "X.POSITION.ACTUAL")] {
                let ticks = rows(stream);
                // Whether the cycle of the stop itself counts depends on which of the two the record hears of first.
                assert!(
                    ticks.len() as u64 - count(id) <= 1,
                    "{faults:?} {delay:?}: {} {}",
                    ticks.len(),
                    count(id)
                );
                assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]), "{faults:?} {delay:?}");
            }
            let gaps = |kept: &Kept| {
                let of = kept.rows.iter().filter(|(name, _)| name == "X.POSITION.ACTUAL");
                let ticks: Vec<u64> = of.map(|(_, row)| row.tick.0).collect();
                ticks.windows(2).filter(|pair| pair[1] != pair[0] + 1).count()
            };
            assert_eq!(gaps(&kept), gaps(&without), "{faults:?} {delay:?}");
        }
    }
}

#[test]
fn a_stop_far_from_the_path_and_a_sender_that_is_started_again_keep_the_conditions() {
    let text = watched();
    let found = look(&text);
    for at in [300, 900, 1_250, 1_700, 2_000] {
        for fault in [
            LinkFault::SenderKilled {
                at: Tick(at),
                ticks: 400,
            },
            LinkFault::ControllerRestarted {
                at: Tick(at),
                ticks: 300,
                orderly: true,
            },
            LinkFault::ControllerRestarted {
                at: Tick(at),
                ticks: 300,
                orderly: false,
            },
        ] {
            let config = LinkedConfig {
                faults: vec![fault],
                restarts: 3,
                batch: 10,
                ..LinkedConfig::default()
            };
            let (ended, kept) = linked(config, &text, &found);
            assert_eq!(ended, Ended::Completed, "{fault:?}");
            // What fired and was not taken before the sender was killed is lost to its record, and told.
            // A reset ends them in the log, so their stop is told as one of what has ended; the machine starts them again.
            let is = |e: &&ledger::Event| {
                e.detail.get("error").is_some_and(|code| code != "T-01") && !e.detail.contains_key("lost_firings")
            };
            let errors: Vec<_> = kept.events.iter().filter(is).collect();
            assert!(errors.is_empty(), "{fault:?}: {errors:#?}");
            let rows = kept.rows.iter().filter(|(name, _)| name == "X.POSITION.ACTUAL").count();
            assert!(rows > 0, "{fault:?}: the conditions are gone");
        }
    }
}

#[test]
fn more_conditions_than_are_under_way_at_once_are_loaded_and_one_that_comes_late_as_well() {
    let many: Vec<String> = (1..=100)
        .map(|id| {
            action(
                id,
                "WHEN",
                &format!("prog_time > {} s", 0.5 + f64::from(id) / 200.0),
                "\"get_time\"",
            )
        })
        .collect();
    let text = around(&many.join("\n"), &action(200, "EVERY", "X.LOAD > -1000", "\"get_time\""), "");
    let found = look(&text);
    assert_eq!(found.conditions.len(), 101);
    let fired = |kept: &Kept| {
        let all = of(kept, "start_synchronized_action");
        all.iter()
            .filter(|e| e.detail.get("state").is_some_and(|state| state == "fired"))
            .map(|e| e.detail["id"].to_string())
            .collect::<Vec<_>>()
    };
    for delay in [(0, 0), (3, 9)] {
        let config = LinkedConfig {
            delay,
            batch: 10,
            ..LinkedConfig::default()
        };
        let (ended, kept) = linked(config.clone(), &text, &found);
        assert_eq!(
            (ended, fired(&kept).len()),
            (Ended::Completed, 101),
            "{delay:?} {:#?}",
            kept.events
                .iter()
                .filter(|e| e.detail.contains_key("error"))
                .take(2)
                .collect::<Vec<_>>()
        );
        // Nothing was seen beforehand: each is loaded when it comes.
        let (ended, kept) = linked(config, &text, &Found::default());
        assert_eq!(
            (ended, fired(&kept).len()),
            (Ended::Completed, 101),
            "{delay:?} {:#?}",
            kept.events
                .iter()
                .filter(|e| e.detail.contains_key("error"))
                .take(2)
                .collect::<Vec<_>>()
        );
    }
}

#[test]
fn another_plan_has_its_own_conditions_and_those_of_all_modes_act_on() {
    use machine::link::{Follower, LoadPart, Loaded, UrgentOrder};
    use machine::watch::{AlarmOrder, Frequency, Operation, Reaction, Relation, ResetBy, WatchOrder, signal};
    use machine::{Command, Plant, Quality, RealtimeHalf, Request};
    use units::StepId;
    let parameters = machine();
    let plant = Plant::new(&parameters, LinkedConfig::default().position, 1);
    let mut half = Box::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated));
    let mut follower = Box::new(Follower::new());
    half.request(Request::PowerOn);
    let mut now = Tick(0);
    let session = |session, same_plan| UrgentOrder::NewSession { session, same_plan };
    let load = |follower: &mut Follower, half: &mut RealtimeHalf<Plant>, number, all_modes, alarm, above: f64| {
        let x = signal("X.POSITION.ACTUAL").expect("a signal");
        for part in [
            LoadPart::Watch {
                frequency: Frequency::Whenever,
                all_modes,
            },
            LoadPart::Operation(Operation::Compare(x, Relation::Greater, above)),
            LoadPart::Alarm(AlarmOrder::Set {
                alarm,
                reaction: Reaction::None,
                reset_by: ResetBy::Acknowledge,
            }),
            LoadPart::Whole { number },
        ] {
            follower.take_urgent(UrgentOrder::Load(part), half);
        }
        follower.status().loads.answer(number)
    };
    let mut cycles = |half: &mut RealtimeHalf<Plant>, count: u64| {
        let mut fired = Vec::new();
        for _ in 0..count {
            half.tick(now);
            now = Tick(now.0 + 1);
            while let Some(report) = half.report() {
                while let Some(firing) = half.firing(report.sample.tick) {
                    fired.push(firing.watch);
                }
            }
        }
        fired
    };
    let start = |half: &mut RealtimeHalf<Plant>, number| {
        let order = WatchOrder::Start(number);
        half.push(Command::Watch { order, step: StepId(1) }).expect("a place");
    };
    follower.take_urgent(session(1, false), &mut half);
    cycles(&mut half, 5);
    assert_eq!(load(&mut follower, &mut half, 0, false, 1, -10.0), Some(Loaded::Watch(0)));
    assert_eq!(load(&mut follower, &mut half, 1, true, 2, -20.0), Some(Loaded::Watch(1)));
    assert_eq!(load(&mut follower, &mut half, 2, true, 3, -30.0), Some(Loaded::Watch(2)));
    // What comes a second time is not loaded twice.
    assert_eq!(load(&mut follower, &mut half, 2, true, 3, -30.0), Some(Loaded::Watch(2)));
    assert_eq!((half.watches().loaded(), follower.status().loads.decided), (3, 3));
    start(&mut half, 0);
    start(&mut half, 2);
    let fired = cycles(&mut half, 3);
    assert!(fired.contains(&0) && fired.contains(&2) && !fired.contains(&1), "{fired:?}");
    // The same plan again: the same answers, and nothing is loaded.
    follower.take_urgent(session(2, true), &mut half);
    assert_eq!(follower.status().loads.decided, 0);
    assert_eq!(load(&mut follower, &mut half, 0, false, 1, -10.0), Some(Loaded::Watch(0)));
    assert_eq!((half.watches().loaded(), half.watches().running()), (3, 2));
    // Another plan: the one of all modes that runs acts on, unheard; numbers begin with 0.
    follower.take_urgent(session(3, false), &mut half);
    assert_eq!((half.watches().loaded(), half.watches().running()), (0, 1));
    half.request(Request::CycleStart);
    assert!(!half.watches().alarm(3));
    assert!(cycles(&mut half, 2).is_empty());
    assert!(half.watches().alarm(3) && !half.watches().alarm(1));
    assert_eq!(load(&mut follower, &mut half, 0, false, 4, -40.0), Some(Loaded::Watch(0)));
    start(&mut half, 0);
    let fired = cycles(&mut half, 3);
    assert!(!fired.is_empty() && fired.iter().all(|watch| *watch == 0), "{fired:?}");
    assert!(half.watches().alarm(4));
    // Without power nothing goes on.
    half.request(Request::PowerOff);
    assert_eq!(half.watches().running(), 0);
}
