//! Conditions cycle by cycle: frequencies, scopes, unknown sensors, alarms and their reactions.

use machine::watch::{
    AlarmOrder, FIRINGS, FiringKind, Frequency, LoadError, Mode, NO_SENSOR, Operation, RESERVED, Reaction, Readings, Relation,
    ResetBy, Situation, Watch, WatchOrder, signal,
};
use machine::{MachineParameters, Phase, Sample, Watches};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use units::{Tick, WorkingstepId};

type Few = Watches<64, 512>;

/// A machine whose only moving part is the load of X.
struct Bench {
    watches: Box<Few>,
    readings: Readings,
    machine: MachineParameters,
    now: u64,
}

impl Bench {
    fn new() -> Self {
        Bench {
            watches: Box::new(Watches::new()),
            readings: Readings::new(),
            machine: MachineParameters::small_machining_centre(),
            now: 0,
        }
    }

    /// One cycle with a load; gives the reaction and which watches fired.
    fn cycle(&mut self, load: f64, mode: Mode) -> (Reaction, Vec<u16>) {
        self.now += 1;
        let sample = Sample {
            tick: Tick(self.now),
            load: [load, 0.0, 0.0],
            workingstep: WorkingstepId(1),
            phase: Phase::Running,
            ..Sample::default()
        };
        self.readings.take(&sample, &self.machine, Situation::default());
        let verdict = self.watches.cycle(Tick(self.now), &self.readings, mode);
        let mut fired = vec![];
        while let Some(firing) = self.watches.firing() {
            assert_eq!(firing.tick, Tick(self.now));
            if firing.kind == FiringKind::Fired {
                fired.push(firing.watch);
            }
        }
        (verdict.reaction, fired)
    }
}

fn over(percent: f64) -> Vec<Operation> {
    vec![Operation::Compare(
        signal("X.LOAD").expect("a signal"),
        Relation::Greater,
        percent,
    )]
}

fn watch(frequency: Frequency, condition: &[Operation]) -> Watch<'_> {
    Watch {
        frequency,
        all_modes: false,
        condition,
        alarms: &[],
    }
}

/// `1` for each cycle in which the watch fires.
#[track_caller]
fn check(frequency: Frequency, loads: &[f64], expected: &str) {
    let mut bench = Bench::new();
    let condition = if frequency == Frequency::NoKeyword {
        vec![]
    } else {
        over(50.0)
    };
    let number = bench.watches.load(&watch(frequency, &condition)).expect("room");
    bench.watches.obey(WatchOrder::Start(number));
    let fired: String = loads
        .iter()
        .map(|load| {
            if bench.cycle(*load, Mode::Automatic).1.is_empty() {
                '0'
            } else {
                '1'
            }
        })
        .collect();
    assert_eq!(fired, expected, "{frequency:?}");
}

#[test]
fn frequencies_fire_as_their_table_says() {
    let loads = [0.0, 80.0, 80.0, 0.0, 80.0]; // false, true, true, false, true
    check(Frequency::Whenever, &loads, "01101");
    check(Frequency::FromFirst, &loads, "01111");
    check(Frequency::WhenOnce, &loads, "01000");
    check(Frequency::EveryEdge, &loads, "01001");
    check(Frequency::NoKeyword, &loads, "11111");
    // True at the start fires: the cycle before the start counts as false.
    check(Frequency::EveryEdge, &[80.0, 80.0], "10");
}

#[test]
fn what_is_not_known_fulfils_nothing_and_every_keeps_what_was_before() {
    let unknown = f64::NAN;
    check(Frequency::Whenever, &[80.0, unknown, 80.0], "101");
    check(Frequency::FromFirst, &[unknown, 80.0, unknown], "011");
    check(Frequency::WhenOnce, &[unknown, 80.0, 80.0], "010");
    // True, unknown, true is one edge; false, unknown, true as well.
    check(Frequency::EveryEdge, &[80.0, unknown, 80.0], "100");
    check(Frequency::EveryEdge, &[0.0, unknown, 80.0], "001");
}

/// Cycles before a reset, and those after it on the same machine; then those on a machine that was started again, which is told whether the
/// watch had fired.
#[track_caller]
fn check_taken_up(frequency: Frequency, before: (&[f64], &str), after: (&[f64], &str), anew: [&str; 2]) {
    let cycles = |bench: &mut Bench, loads: &[f64]| -> String {
        let fired = loads.iter().map(|load| bench.cycle(*load, Mode::Automatic).1.len());
        fired.map(|count| char::from(b'0' + count as u8)).collect()
    };
    let mut bench = Bench::new();
    let number = bench.watches.load(&watch(frequency, &over(50.0))).expect("room");
    bench.watches.obey(WatchOrder::Start(number));
    assert_eq!(cycles(&mut bench, before.0), before.1, "{frequency:?}");
    bench.watches.reset();
    assert_eq!(cycles(&mut bench, &[80.0]), "0", "{frequency:?} after a reset");
    // Whoever asks may not have heard of what it did; asking twice changes nothing.
    for fired in [false, true] {
        bench.watches.obey(WatchOrder::TakeUp { watch: number, fired });
    }
    assert_eq!(cycles(&mut bench, after.0), after.1, "{frequency:?} taken up");
    for (fired, expected) in [false, true].into_iter().zip(anew) {
        let mut bench = Bench::new();
        assert_eq!(bench.watches.load(&watch(frequency, &over(50.0))), Ok(number));
        bench.watches.obey(WatchOrder::TakeUp { watch: number, fired });
        assert_eq!(
            cycles(&mut bench, after.0),
            expected,
            "{frequency:?} started again, fired {fired}"
        );
        assert_eq!(bench.watches.counters().refused_orders, 0);
    }
}

#[test]
fn what_is_taken_up_again_goes_on_with_what_is_known_of_it() {
    let loads = (&[80.0, 80.0][..], &[80.0, 0.0, 80.0][..]);
    check_taken_up(Frequency::WhenOnce, (loads.0, "10"), (loads.1, "000"), ["100", "000"]);
    check_taken_up(Frequency::FromFirst, (loads.0, "11"), (loads.1, "111"), ["111", "111"]);
    check_taken_up(Frequency::Whenever, (loads.0, "11"), (loads.1, "101"), ["101", "101"]);
    check_taken_up(Frequency::EveryEdge, (loads.0, "10"), (loads.1, "001"), ["101", "001"]);
    // Nothing had fired: nothing is passed over.
    check_taken_up(
        Frequency::WhenOnce,
        (&[0.0], "0"),
        (&[0.0, 80.0, 80.0], "010"),
        ["010", "000"],
    );
    check_taken_up(
        Frequency::FromFirst,
        (&[0.0], "0"),
        (&[0.0, 80.0, 0.0], "011"),
        ["011", "111"],
    );
    check_taken_up(
        Frequency::EveryEdge,
        (&[80.0, 0.0], "10"),
        (&[80.0, 80.0], "10"),
        ["10", "00"],
    );
}

#[test]
fn an_outage_of_a_sensor_is_told_once() {
    let mut bench = Bench::new();
    let condition = [Operation::Compare(NO_SENSOR, Relation::Less, 1.0)];
    let number = bench.watches.load(&watch(Frequency::Whenever, &condition)).expect("room");
    let seen = bench.watches.load(&watch(Frequency::Whenever, &over(50.0))).expect("room");
    bench.watches.obey(WatchOrder::Start(number));
    bench.watches.obey(WatchOrder::Start(seen));
    let mut unknown = vec![];
    for (cycle, load) in [0.0, f64::NAN, f64::NAN, 0.0, f64::NAN].into_iter().enumerate() {
        let sample = Sample {
            tick: Tick(cycle as u64),
            load: [load, 0.0, 0.0],
            ..Sample::default()
        };
        bench.readings.take(&sample, &bench.machine, Situation::default());
        bench.watches.cycle(sample.tick, &bench.readings, Mode::Automatic);
        while let Some(firing) = bench.watches.firing() {
            assert_eq!(firing.kind, FiringKind::Unknown);
            unknown.push((cycle, firing.watch));
        }
    }
    assert_eq!(unknown, [(0, number), (1, seen), (4, seen)]);
}

#[test]
fn automatic_ends_with_the_program_and_is_not_checked_in_other_modes() {
    let mut bench = Bench::new();
    let condition = over(50.0);
    let automatic = bench.watches.load(&watch(Frequency::Whenever, &condition)).expect("room");
    let everywhere = Watch {
        all_modes: true,
        ..watch(Frequency::Whenever, &condition)
    };
    let everywhere = bench.watches.load(&everywhere).expect("room");
    bench.watches.obey(WatchOrder::Start(automatic));
    bench.watches.obey(WatchOrder::Start(everywhere));
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [automatic, everywhere]);
    assert_eq!(bench.cycle(80.0, Mode::Jog).1, [everywhere]);
    assert_eq!(bench.cycle(80.0, Mode::ManualDataInput).1, [everywhere]);
    bench.watches.program_ends();
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [everywhere]);
    bench.watches.reset();
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [everywhere]);
    bench.watches.obey(WatchOrder::Stop(everywhere));
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [] as [u16; 0]);
    // And the one that ended can be started anew, with nothing left of before.
    bench.watches.obey(WatchOrder::Start(automatic));
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [automatic]);
    assert_eq!(bench.watches.counters().refused_orders, 0);
}

#[test]
fn watches_are_evaluated_in_the_order_of_their_start_and_see_each_others_alarms() {
    let mut bench = Bench::new();
    let set = AlarmOrder::Set {
        alarm: 7,
        reaction: Reaction::None,
        reset_by: ResetBy::Function,
    };
    let condition = over(50.0);
    let setter = Watch {
        alarms: &[set],
        ..watch(Frequency::Whenever, &condition)
    };
    let setter = bench.watches.load(&setter).expect("room");
    let follower = [Operation::Alarm(7)];
    let follower = bench.watches.load(&watch(Frequency::Whenever, &follower)).expect("room");
    bench.watches.obey(WatchOrder::Start(follower));
    bench.watches.obey(WatchOrder::Start(setter));
    // The follower stands before: it sees the alarm a cycle later.
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [setter]);
    assert_eq!(bench.cycle(0.0, Mode::Automatic).1, [follower]);
    bench.watches.obey(WatchOrder::Alarm(AlarmOrder::Clear { alarm: 7 }));
    assert_eq!(bench.cycle(0.0, Mode::Automatic).1, [] as [u16; 0]);
    bench.watches.obey(WatchOrder::Stop(follower));
    bench.watches.obey(WatchOrder::Start(follower));
    assert_eq!(bench.cycle(80.0, Mode::Automatic).1, [setter, follower]);
}

#[test]
fn an_alarm_reacts_when_it_is_set_and_not_while_it_is_active() {
    for (reaction, expected) in [
        (Reaction::None, Reaction::None),
        (Reaction::FeedHold, Reaction::FeedHold),
        (Reaction::StopNow, Reaction::StopNow),
        (Reaction::StopAfterOperation, Reaction::None),
    ] {
        let mut bench = Bench::new();
        let set = AlarmOrder::Set {
            alarm: 999,
            reaction,
            reset_by: ResetBy::Acknowledge,
        };
        let condition = over(50.0);
        let number = bench.watches.load(&Watch {
            alarms: &[set],
            ..watch(Frequency::Whenever, &condition)
        });
        bench.watches.obey(WatchOrder::Start(number.expect("room")));
        assert_eq!(bench.cycle(80.0, Mode::Automatic).0, expected);
        assert_eq!(bench.cycle(80.0, Mode::Automatic).0, Reaction::None);
        assert!(bench.watches.alarm(999));
        let at_the_end = bench.watches.obey(WatchOrder::OperationEnds);
        assert_eq!(at_the_end == Reaction::FeedHold, reaction == Reaction::StopAfterOperation);
        assert_eq!(bench.watches.obey(WatchOrder::OperationEnds), Reaction::None);
        // Cycle start ends it; it is set and reacts anew.
        bench.watches.acknowledge();
        assert!(!bench.watches.alarm(999));
        assert_eq!(bench.cycle(80.0, Mode::Automatic).0, expected);
    }
}

#[test]
fn an_alarm_ends_by_what_it_says() {
    for (reset_by, after_cycle_start, after_reset) in [
        (ResetBy::Function, true, true),
        (ResetBy::Acknowledge, false, false),
        (ResetBy::Reset, true, false),
    ] {
        let mut watches = Box::new(Few::new());
        watches.obey(WatchOrder::Alarm(AlarmOrder::Set {
            alarm: 1,
            reaction: Reaction::None,
            reset_by,
        }));
        watches.acknowledge();
        assert_eq!(watches.alarm(1), after_cycle_start, "{reset_by:?}");
        watches.reset();
        assert_eq!(watches.alarm(1), after_reset, "{reset_by:?}");
        watches.obey(WatchOrder::Alarm(AlarmOrder::Clear { alarm: 1 }));
        assert!(!watches.alarm(1));
    }
}

#[test]
fn what_has_no_place_is_refused_whole_and_what_is_loaded_works_on() {
    let mut watches = Box::new(Watches::<2, 3>::new());
    assert_eq!(watches.load(&watch(Frequency::Whenever, &[])), Err(LoadError::Frequency));
    assert_eq!(
        watches.load(&watch(Frequency::NoKeyword, &over(1.0))),
        Err(LoadError::Frequency)
    );
    assert_eq!(watches.load(&watch(Frequency::Whenever, &over(1.0))), Ok(0));
    let mut three = over(1.0);
    three.extend(over(2.0));
    three.push(Operation::And);
    assert_eq!(watches.load(&watch(Frequency::Whenever, &three)), Err(LoadError::Full));
    assert_eq!(watches.load(&watch(Frequency::EveryEdge, &over(3.0))), Ok(1));
    assert_eq!(watches.load(&watch(Frequency::NoKeyword, &[])), Err(LoadError::Full));
    let many = [AlarmOrder::Clear { alarm: 1 }; 5];
    let refused = Watch {
        alarms: &many,
        ..watch(Frequency::NoKeyword, &[])
    };
    assert_eq!(watches.load(&refused), Err(LoadError::Alarms));
    let none = [AlarmOrder::Clear { alarm: 0 }];
    let refused = Watch {
        alarms: &none,
        ..watch(Frequency::NoKeyword, &[])
    };
    assert_eq!(watches.load(&refused), Err(LoadError::Alarms));
    watches.obey(WatchOrder::Start(0));
    watches.obey(WatchOrder::Start(0));
    watches.obey(WatchOrder::Start(2));
    watches.obey(WatchOrder::Stop(1));
    assert_eq!(watches.counters().refused_orders, 3);
    assert_eq!(watches.running(), 1);
}

#[test]
fn without_room_for_all_firings_those_that_are_only_recorded_go_first_and_are_counted() {
    let mut watches = Box::new(Few::new());
    let set = [AlarmOrder::Clear { alarm: 1 }];
    let records = watches.load(&watch(Frequency::NoKeyword, &[])).expect("room");
    let alarms = Watch {
        alarms: &set,
        ..watch(Frequency::NoKeyword, &[])
    };
    let alarms = watches.load(&alarms).expect("room");
    watches.obey(WatchOrder::Start(records));
    let readings = Readings::new();
    let cycles = FIRINGS as u64 + 100;
    for tick in 0..cycles {
        watches.cycle(Tick(tick), &readings, Mode::Automatic);
    }
    assert_eq!(watches.counters().lost_firings, cycles - (FIRINGS - RESERVED) as u64);
    watches.obey(WatchOrder::Stop(records));
    watches.obey(WatchOrder::Start(alarms));
    let before = watches.counters().lost_firings;
    for tick in 0..RESERVED as u64 {
        watches.cycle(Tick(tick), &readings, Mode::Automatic);
    }
    assert_eq!(watches.counters().lost_firings, before);
    watches.cycle(Tick(0), &readings, Mode::Automatic);
    assert_eq!(watches.counters().lost_firings, before + 1);
}

#[test]
fn what_lives_keeps_its_mark_its_count_and_its_beginning_when_places_change_with_a_program() {
    let mut bench = Bench::new();
    let all_modes = |condition| Watch {
        all_modes: true,
        ..watch(Frequency::Whenever, condition)
    };
    let conditions = [over(10.0), over(20.0), over(30.0), over(40.0)];
    for (n, condition) in conditions.iter().enumerate() {
        let number = bench.watches.load(&all_modes(condition)).expect("room");
        bench.watches.mark(number, 100 + n as u32);
    }
    bench.cycle(0.0, Mode::Automatic);
    // Not the first, and not in the order of their places.
    for number in [3, 1, 2] {
        bench.watches.obey(WatchOrder::Start(number));
        bench.cycle(25.0, Mode::Jog);
    }
    let living = |watches: &Few| {
        let mut at = 0;
        let mut found = Vec::new();
        while at < watches.places() {
            let (living, next) = watches.living(at, 2);
            found.extend(living.map(|l| (l.mark, l.since.0, l.fired)));
            at = next;
        }
        found
    };
    // 20 % is passed by the second from its start on.
    assert_eq!(living(&bench.watches), [(101, 2, 2), (102, 3, 0), (103, 1, 0)]);
    bench.watches.new_program();
    bench.cycle(35.0, Mode::Automatic);
    assert_eq!(living(&bench.watches), [(101, 2, 3), (102, 3, 1), (103, 1, 0)]);
    // A mark of the new program is not one of those before; nobody has the mark 0.
    let number = bench.watches.load(&all_modes(&conditions[0])).expect("room");
    bench.watches.obey(WatchOrder::Start(number));
    assert_eq!(living(&bench.watches)[3], (0, 5, 0));
    assert_eq!(bench.watches.end(0), None);
    bench.watches.mark(number, 104);
    bench.watches.mark(number + 1, 105);
    assert_eq!(bench.watches.end(102).map(|l| (l.mark, l.fired)), Some((102, 1)));
    assert_eq!(bench.watches.end(102), None);
    assert_eq!(bench.cycle(50.0, Mode::Automatic).1, [0], "only that of the program is told");
    assert_eq!(living(&bench.watches), [(101, 2, 4), (103, 1, 1), (104, 5, 1)]);
    // The next program has its places, and what was ended has none.
    bench.watches.end(101);
    bench.watches.new_program();
    assert_eq!((bench.watches.running(), bench.watches.places()), (2, 2));
    assert_eq!(living(&bench.watches), [(103, 1, 1), (104, 5, 1)]);
    bench.watches.power_off();
    assert_eq!(living(&bench.watches), []);
}

#[test]
fn the_end_by_hand_is_told_even_where_firings_find_no_place() {
    let mut bench = Bench::new();
    let always = Watch {
        all_modes: true,
        ..watch(Frequency::NoKeyword, &[])
    };
    let number = bench.watches.load(&always).expect("room");
    bench.watches.mark(number, 1);
    bench.watches.obey(WatchOrder::Start(number));
    for tick in 0..FIRINGS as u64 {
        bench.watches.cycle(Tick(tick), &bench.readings, Mode::Automatic);
    }
    assert_eq!(bench.watches.counters().lost_firings, RESERVED as u64);
    assert!(bench.watches.end(1).is_some());
    let last = std::iter::from_fn(|| bench.watches.firing()).last().expect("firings");
    assert_eq!((last.kind, last.tick), (FiringKind::Ended, Tick(FIRINGS as u64 - 1)));
}

/// What decided a condition last time is looked at first the next time: that may not be seen from outside.
#[test]
fn comparisons_that_all_have_to_hold_fire_in_every_cycle_as_the_same_condition_written_otherwise() {
    let relations = [
        Relation::Less,
        Relation::LessOrEqual,
        Relation::Greater,
        Relation::GreaterOrEqual,
        Relation::Equal,
        Relation::NotEqual,
    ];
    let kinds = [
        Frequency::Whenever,
        Frequency::FromFirst,
        Frequency::WhenOnce,
        Frequency::EveryEdge,
    ];
    let loads = ["X.LOAD", "Y.LOAD", "Z.LOAD"].map(|name| signal(name).expect("a signal"));
    let mut dice = ChaCha8Rng::seed_from_u64(7);
    let mut up_to = |n: u64| dice.next_u64() % n;
    for _ in 0..50 {
        let mut bench = Bench::new();
        for pair in 0..32 {
            let mut condition = vec![];
            for k in 0..1 + up_to(3) {
                let relation = relations[up_to(6) as usize];
                condition.push(Operation::Compare(loads[up_to(3) as usize], relation, up_to(3) as f64));
                if k > 0 {
                    condition.push(Operation::And);
                }
            }
            let otherwise = [&condition[..], &[Operation::Not, Operation::Not]].concat();
            for condition in [condition, otherwise] {
                let number = bench.watches.load(&watch(kinds[pair % 4], &condition)).expect("room");
                bench.watches.obey(WatchOrder::Start(number));
            }
        }
        let mut values = [0.0; 3];
        let (mut fired, mut unknown) = (0, 0);
        for tick in 0..200 {
            // Mostly they stay, one of them changes.
            values[up_to(3) as usize] = [0.0, 1.0, 2.0, f64::NAN][up_to(4) as usize];
            if up_to(4) == 0 {
                let (pair, fired, order) = (2 * up_to(32) as u16, up_to(2) == 0, up_to(3));
                for watch in [pair, pair + 1] {
                    bench.watches.obey(match order {
                        0 => WatchOrder::Start(watch),
                        1 => WatchOrder::Stop(watch),
                        _ => WatchOrder::TakeUp { watch, fired },
                    });
                }
            }
            let sample = Sample {
                tick: Tick(tick),
                load: values,
                ..Sample::default()
            };
            bench.readings.take(&sample, &bench.machine, Situation::default());
            bench.watches.cycle(Tick(tick), &bench.readings, Mode::Automatic);
            let mut told = [vec![], vec![]];
            while let Some(firing) = bench.watches.firing() {
                told[usize::from(firing.watch % 2)].push((firing.watch / 2, firing.kind));
                fired += usize::from(firing.kind == FiringKind::Fired);
                unknown += usize::from(firing.kind == FiringKind::Unknown);
            }
            assert_eq!(told[0], told[1], "cycle {tick}, {values:?}");
        }
        assert!(
            fired > 100 && unknown > 10,
            "{fired} firings and {unknown} outages are no test"
        );
    }
}
