//! Every state and every event as a golden file: the diff in review is the documentation of a change.

use expect_test::expect_file;
use machine::state::next_state;
use machine::{Event, FaultCause, State, StopCause, Wait};
use std::fmt::Write;

const STATES: &[State] = &[
    State::Off,
    State::Ready,
    State::Running,
    State::Waiting(Wait::Commands),
    State::Waiting(Wait::Position),
    State::Waiting(Wait::Spindle),
    State::Waiting(Wait::Tool),
    State::Waiting(Wait::Dwell),
    State::WaitingThenHold(Wait::Tool),
    State::Holding,
    State::Held,
    State::Paused,
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
    Event::Work,
    Event::Wait(Wait::Position),
    Event::Wait(Wait::Spindle),
    Event::WaitOver,
    Event::Pause,
    Event::ProgramEnd,
    Event::Hold,
    Event::CycleStart,
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
                    | (
                        State::Held | State::Paused | State::Holding | State::Stopped(StopCause::Starved),
                        Event::CycleStart
                    )
            );
            let moves = next_state(*state, *event) == State::Running && *state != State::Running;
            assert_eq!(may, moves, "{state:?} {event:?}");
        }
    }
}
