//! Every state and every event as a golden file: the diff in review is the documentation of a change.

use expect_test::expect_file;
use machine::state::next_state;
use machine::{Event, FaultCause, HomingStage, State, StopCause, Wait};
use std::fmt::Write;

const STATES: &[State] = &[
    State::Off,
    State::NotHomed,
    State::Homing {
        axis: 2,
        stage: HomingStage::Search,
    },
    State::Homing {
        axis: 2,
        stage: HomingStage::GoHome,
    },
    State::Jogging { axis: 0 },
    State::Ready,
    State::Running,
    State::Waiting(Wait::Commands),
    State::Waiting(Wait::Position),
    State::Waiting(Wait::Spindle),
    State::Waiting(Wait::ToolAway),
    State::Waiting(Wait::Tool),
    State::Waiting(Wait::ToolBack),
    State::Waiting(Wait::Dwell),
    State::WaitingThenHold(Wait::Tool),
    State::Holding,
    State::Held,
    State::Paused,
    State::Resuming,
    State::Stopping(StopCause::Asked),
    State::Stopping(StopCause::Starved),
    State::Stopped(StopCause::Asked),
    State::Stopped(StopCause::Starved),
    State::EmergencyStop,
    State::EmergencyStopReleased,
    State::Fault(FaultCause::Spindle),
];

const EVENTS: &[Event] = &[
    Event::PowerOn,
    Event::PowerOff,
    Event::ReferencesKnown,
    Event::Homing {
        axis: 2,
        stage: HomingStage::Search,
    },
    Event::Homing {
        axis: 1,
        stage: HomingStage::SlowSearch,
    },
    Event::AtHome,
    Event::Jog { axis: 0 },
    Event::Work,
    Event::Wait(Wait::Position),
    Event::Wait(Wait::Spindle),
    Event::WaitOver,
    Event::Pause,
    Event::ProgramEnd,
    Event::Hold,
    Event::CycleStart,
    Event::Restored,
    Event::Stop(StopCause::Asked),
    Event::Stop(StopCause::Starved),
    Event::AtRest,
    Event::EmergencyStop,
    Event::EmergencyStopReleased,
    Event::Fault(FaultCause::Drive),
    Event::Reset,
];

#[test]
fn every_state_meets_every_event() {
    let mut table = String::from("# state x event -> state; what is not listed changes nothing\n");
    for state in STATES {
        writeln!(table, "\n{state:?}").expect("a string takes it");
        for event in EVENTS {
            let next = next_state(*state, *event);
            if next != *state {
                writeln!(table, "  {event:?} -> {next:?}").expect("a string takes it");
            }
        }
    }
    expect_file!["state_table.txt"].assert_eq(&table);
}

#[test]
fn no_event_but_the_right_ones_leads_from_standstill_to_motion() {
    for state in STATES {
        for event in EVENTS {
            let may = matches!(
                (state, event),
                (State::Ready | State::Waiting(Wait::Commands), Event::Work)
                    | (State::Waiting(_), Event::WaitOver)
                    | (State::Resuming, Event::Restored)
                    | (State::Holding, Event::CycleStart)
            );
            let moves = next_state(*state, *event) == State::Running && *state != State::Running;
            assert_eq!(may, moves, "{state:?} {event:?}");
        }
    }
}

#[test]
fn without_homing_nothing_leads_to_a_program_and_only_the_joystick_and_homing_move_anything() {
    use std::collections::BTreeSet;
    // Everything that can be reached from there by any row of events without the references becoming known.
    let mut reached = BTreeSet::from([format!("{:?}", State::NotHomed)]);
    let mut open = vec![State::NotHomed];
    while let Some(state) = open.pop() {
        for event in EVENTS.iter().filter(|e| **e != Event::ReferencesKnown) {
            let next = next_state(state, *event);
            if reached.insert(format!("{next:?}")) {
                open.push(next);
            }
        }
    }
    for state in &reached {
        let may = [
            "NotHomed",
            "Off",
            "Homing",
            "Jogging",
            "Stopp",
            "EmergencyStop",
            "Fault",
            "Resuming",
        ];
        assert!(
            may.iter().any(|word| state.starts_with(word)) || *state == "Held",
            "{state}: {reached:?}"
        );
    }
    assert!(!reached.contains("Running") && !reached.contains("Ready"), "{reached:?}");
}

#[test]
fn after_an_emergency_stop_only_its_release_and_a_reset_lead_on() {
    for event in EVENTS {
        let next = next_state(State::EmergencyStop, *event);
        let may = matches!(event, Event::EmergencyStopReleased | Event::PowerOff);
        assert_eq!(next != State::EmergencyStop, may, "{event:?}");
        let next = next_state(State::EmergencyStopReleased, *event);
        let may = matches!(event, Event::Reset | Event::PowerOff | Event::EmergencyStop);
        assert_eq!(next != State::EmergencyStopReleased, may, "{event:?}");
    }
}
