//! What goes over the link comes out bit by bit, whatever the numbers are.

use machine::link::loading::Loads;
use machine::link::message::{BLOCK, LoadHead, LoadWhat, TAIL};
use machine::link::{Entry, FRAME, FrameReader, Header, Kind, Loaded, Reader, Wire, Writer, write_frame};
use machine::pad::{Mode, Notices};
use machine::watch::{
    AlarmOrder, BadCondition, Firing, FiringKind, Frequency, LoadError, Operation, Reaction, Relation, ResetBy,
};
use machine::{
    AxisOrder, Command, CoolantOutlets, Counters, DriveMode, DriveOrders, FaultCause, Overrides, Phase, Quality, Report, Request,
    Sample, SetPoint, SpindleCommand, State, StopCause, Wait,
};
use units::{Millimetres, Rpm, StepId, Tick, ToolNumber, WorkingstepId};

/// Writes, reads, and writes again: the bytes are the same, and all of them were read. Gives how many.
#[track_caller]
fn check<T: Wire>(item: &T) -> usize {
    let (mut first, mut second) = ([0; 1024], [0; 1024]);
    let mut writer = Writer::new(&mut first);
    item.write(&mut writer);
    let length = writer.finish().expect("it fits");
    let mut reader = Reader::new(&first[..length]);
    let read = T::read(&mut reader).expect("it was written so");
    assert_eq!(reader.end(), Ok(()));
    let mut writer = Writer::new(&mut second);
    read.write(&mut writer);
    assert_eq!((writer.finish(), &first[..length]), (Some(length), &second[..length]));
    // One byte less is an error, not another item.
    for end in 0..length {
        assert!(
            T::read(&mut Reader::new(&first[..end])).is_err(),
            "read from {end} of {length} bytes"
        );
    }
    length
}

/// Numbers that a text would lose.
const NUMBERS: [f64; 6] = [0.1 + 0.2, -0.0, f64::MIN_POSITIVE / 3.0, f64::NAN, f64::INFINITY, -1.0e300];

fn set_point() -> SetPoint {
    let [a, b, c, d, e, f] = NUMBERS;
    SetPoint {
        position: [a, b, c],
        velocity: [d, e, f],
        acceleration: [f, a, d],
        step: StepId(u32::MAX),
        path_length: c,
        path_speed: b,
        rapid: true,
        planned_override: 1.2,
        tie: Some(machine::Tie {
            lead: 1.25,
            revolutions: 13.3,
            start: Some(0.25),
        }),
    }
}

#[test]
fn every_command_and_request_comes_out_as_it_went_in() {
    let step = StepId(7);
    let outlets = CoolantOutlets {
        mist: true,
        ..CoolantOutlets::default()
    };
    let commands = [
        Command::SetPoint(set_point()),
        Command::Spindle {
            spindle: SpindleCommand::Counterclockwise(Rpm(NUMBERS[0])),
            step,
        },
        Command::SpindleSpeed(Rpm(1.0)),
        Command::Coolant { outlets, step },
        Command::ToolLength { length: 34.4, step },
        Command::Tool {
            tool: ToolNumber(12),
            step,
        },
        Command::Dwell { cycles: 9, step },
        Command::Workingstep {
            workingstep: WorkingstepId(3),
            step,
        },
        Command::Pause { step },
        Command::End { step },
    ];
    let lengths = commands.map(|command| check(&Entry { command, done: u64::MAX }));
    let longest = lengths.iter().max().copied().unwrap_or(0);
    assert!((BLOCK + TAIL) * longest + 100 < FRAME, "{longest} bytes for an entry");
    for request in [
        Request::PowerOn,
        Request::CycleStart,
        Request::Hold,
        Request::Stop,
        Request::Override(Overrides {
            feed: 80,
            rapid: 25,
            spindle: 110,
        }),
        Request::Mode(Mode::Jog { axis: 2 }),
        Request::JogSpindle(SpindleCommand::Clockwise(Rpm(NUMBERS[3]))),
    ] {
        check(&request);
    }
}

#[test]
fn conditions_their_answers_and_firings_come_out_as_they_went_in() {
    for number in NUMBERS {
        for relation in [
            Relation::Less,
            Relation::LessOrEqual,
            Relation::Greater,
            Relation::GreaterOrEqual,
            Relation::Equal,
            Relation::NotEqual,
        ] {
            check(&Operation::Compare(255, relation, number));
            check(&Operation::Relate(relation));
        }
        check(&Operation::Constant(number));
        let (tool, diameter) = (ToolNumber(u32::MAX), Millimetres(number));
        let what = LoadWhat::Tool { tool, diameter };
        check(&LoadHead { number: u32::MAX, what });
    }
    for operation in [
        Operation::Signal(7),
        Operation::Truth(true),
        Operation::Alarm(999),
        Operation::Add,
        Operation::Subtract,
        Operation::Multiply,
        Operation::Divide,
        Operation::Negate,
        Operation::Not,
        Operation::And,
        Operation::Or,
        Operation::Xor,
    ] {
        check(&operation);
    }
    for frequency in [
        Frequency::NoKeyword,
        Frequency::Whenever,
        Frequency::FromFirst,
        Frequency::WhenOnce,
        Frequency::EveryEdge,
    ] {
        let what = LoadWhat::Watch {
            frequency,
            all_modes: true,
            operations: 128,
            alarms: 4,
        };
        check(&LoadHead { number: 0, what });
    }
    check(&AlarmOrder::Set {
        alarm: 999,
        reaction: Reaction::StopAfterOperation,
        reset_by: ResetBy::Reset,
    });
    let mut loads = Loads::default();
    for (place, why) in loads.last.iter_mut().zip([
        LoadError::Condition(BadCondition::TooLong),
        LoadError::Condition(BadCondition::TooDeep),
        LoadError::Condition(BadCondition::Operands { at: 127 }),
        LoadError::Condition(BadCondition::Number { at: 1 }),
        LoadError::Condition(BadCondition::Result),
        LoadError::Full,
        LoadError::Frequency,
        LoadError::Alarms,
    ]) {
        *place = Loaded::Refused(why);
    }
    (loads.decided, loads.last[14], loads.last[15]) = (u32::MAX, Loaded::Watch(u16::MAX), Loaded::NoPlaceForTool);
    check(&loads);
    check(&Firing {
        tick: Tick(u64::MAX),
        watch: 4095,
        kind: FiringKind::Ended,
    });
}

#[test]
fn a_report_comes_out_as_it_went_in() {
    let [a, b, c, d, e, f] = NUMBERS;
    let mut report = Report {
        sample: Sample {
            tick: Tick(u64::MAX),
            step: StepId(1),
            workingstep: WorkingstepId(2),
            tool: ToolNumber(3),
            phase: Phase::Running,
            quality: Quality::Simulated,
            commanded: [a, b, c],
            actual: [d, e, f],
            velocity: [b, d, a],
            load: [c, c, c],
            current: [f, a, b],
            path_speed: d,
            spindle_speed: e,
            spindle_load: f,
            overrides: Overrides {
                feed: 199,
                rapid: 1,
                spindle: 51,
            },
            spindle_angle: 271.3,
            thread_error: 0.0025,
        },
        state: State::Off,
        counters: Counters {
            accepted: u64::MAX,
            completed: 1,
            spindle_limited: 12,
            ..Counters::default()
        },
        idle: true,
        orders: DriveOrders {
            mode: DriveMode::Follow,
            axes: [AxisOrder {
                position: a,
                velocity: b,
                planned: c,
                torque: d,
            }; 3],
            spindle: SpindleCommand::Clockwise(Rpm(f)),
            coolant: CoolantOutlets::default(),
            path_speed: e,
        },
        overrides: Overrides::default(),
        watches: machine::watch::WatchCost {
            operations: 7,
            nanoseconds: u32::MAX,
        },
        notices: Notices {
            emergency_stop: Some(true),
            mode: Some(Mode::Jog { axis: 1 }),
            joystick_stopped: true,
            home_reached: false,
        },
    };
    for state in [
        State::Ready,
        State::Waiting(Wait::Tool),
        State::WaitingThenHold(Wait::Dwell),
        State::Stopping(StopCause::SoftLimit { axis: 2 }),
        State::Fault(FaultCause::Encoder { axis: 1 }),
        State::Stopped(StopCause::Late { cycles: 6, tolerated: 5 }),
        State::Fault(FaultCause::Away {
            cycles: u32::MAX,
            tolerated: 500,
        }),
    ] {
        report.state = state;
        let length = check(&report);
        assert!((380..450).contains(&length), "{length} bytes for a report");
    }
}

#[test]
fn any_split_and_any_flipped_bit_is_seen() {
    let header = Header {
        kind: Kind::Urgent,
        session: 3,
        sequence: 1,
        acknowledged: 9,
    };
    let mut frame = [0; 256];
    let length = write_frame(&mut frame, &header, |to| Request::Stop.write(to)).expect("it fits");
    let frame = &frame[..length];
    let mut reader = Box::new(FrameReader::new());
    let twice = [frame, frame].concat();
    for split in 1..twice.len() {
        let mut found = 0;
        *reader = FrameReader::new();
        for piece in twice.chunks(split) {
            let mut rest = piece;
            while let Some(came) = reader.feed(&mut rest).expect("sound frames") {
                assert_eq!((came.header, came.payload), (header, &[5u8][..]));
                found += 1;
            }
        }
        assert_eq!(found, 2, "pieces of {split}");
    }
    for bit in 0..length * 8 {
        let mut damaged = frame.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        *reader = FrameReader::new();
        let mut rest = &damaged[..];
        // A longer length waits for bytes that never come: the silence tells.
        let read = reader.feed(&mut rest);
        assert!(!matches!(read, Ok(Some(_))), "bit {bit} was not seen");
    }
}
