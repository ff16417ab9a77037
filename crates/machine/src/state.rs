//! The states of the controller, and the one table in which they change.

use crate::Phase;
use core::fmt;

/// What the controller is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Drives without power.
    #[default]
    Off,
    /// Drives hold, and where the axes are is not known: nothing but a slow jog and homing.
    NotHomed,
    /// Looking for the references, or on the way home.
    Homing {
        /// 0 is X.
        axis: u8,
        /// How far it is.
        stage: HomingStage,
    },
    /// The joystick moves an axis.
    Jogging {
        /// 0 is X.
        axis: u8,
    },
    /// Drives hold; no program.
    Ready,
    /// Axes follow the program.
    Running,
    /// The program waits at rest.
    Waiting(Wait),
    /// The same, and a hold was asked: it takes effect when the wait is over.
    WaitingThenHold(Wait),
    /// A hold was asked: slowing down on the path.
    Holding,
    /// At rest on the path; cycle start goes on.
    Held,
    /// The program asked to stop; cycle start goes on.
    Paused,
    /// Cycle start was given: spindle and coolant come back before the path goes on.
    Resuming,
    /// Slowing down on the path for good.
    Stopping(StopCause),
    /// At rest after a controlled stop.
    Stopped(StopCause),
    /// The emergency stop button is pressed. The hardware stops the machine; we only show it.
    EmergencyStop,
    /// The button is out again; reset makes the machine ready.
    EmergencyStopReleased,
    /// The machine cannot follow or cannot see: the drives stop by themselves.
    Fault(FaultCause),
}

/// How far an axis is with its reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingStage {
    /// Towards the switch.
    Search,
    /// Off the switch again.
    BackOff,
    /// Slowly onto the switch and on to the index pulse.
    SlowSearch,
    /// To the home position.
    GoHome,
}

/// What a program waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// The next command; the queue is empty and the axes are at rest.
    Commands,
    /// The axes to be in position where the path is at rest.
    Position,
    /// The spindle to be at speed.
    Spindle,
    /// The axes to be where tools are changed.
    ToolAway,
    /// The tool changer.
    Tool,
    /// The axes to be back, by the difference of the tools' lengths higher or lower.
    ToolBack,
    /// A dwell to be over.
    Dwell,
}

/// Why the machine makes a controlled stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopCause {
    /// Somebody asked.
    Asked,
    /// Set-points did not come in time. Cycle start goes on when they do.
    Starved,
    /// A set-point lies outside the travel of an axis.
    SoftLimit {
        /// 0 is X.
        axis: u8,
    },
    /// A set-point is not a number, lies further from the one before than the axis can go in a cycle, or disagrees with its own speed.
    Jump {
        /// 0 is X.
        axis: u8,
    },
    /// A switching command that needs rest came while the path was still moving.
    SwitchInMotion,
    /// More servo cycles in a row were lost than allowed.
    Late {
        /// So many.
        cycles: u32,
        /// So many would have been tolerated.
        tolerated: u32,
    },
    /// The path ended in motion; the machine braked beside it.
    OffPath,
    /// A thread is so short that its lead is never reached, or that the spindle could not be turned round before its end; or its lead or
    /// spindle speed is no number that could be one.
    ThreadTooShort,
}

impl StopCause {
    /// True when cycle start may go on from here: the path is intact.
    pub fn can_go_on(self) -> bool {
        self == StopCause::Starved
    }

    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            StopCause::Asked => "stop was asked",
            StopCause::Starved => "set-points did not come in time",
            StopCause::SoftLimit { .. } => "a set-point lies outside the travel",
            StopCause::Jump { .. } => "a set-point does not follow from the one before",
            StopCause::SwitchInMotion => "a switching command came before the path was at rest",
            StopCause::Late { .. } => "the controller was away for too many servo cycles at once",
            StopCause::OffPath => "the path ended in motion",
            StopCause::ThreadTooShort => "a thread is too short for its spindle speed: begin farther away, or turn slower",
        }
    }
}

/// Why the machine is in fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultCause {
    /// An axis is too far from where it shall be.
    FollowingError {
        /// 0 is X.
        axis: u8,
    },
    /// An encoder's readings are not possible, several times in a row.
    Encoder {
        /// 0 is X.
        axis: u8,
    },
    /// The spindle did not come to speed.
    Spindle,
    /// A drive reports a fault.
    Drive,
    /// More servo cycles in a row were lost than allowed, and drives without orders stopped by themselves.
    Away {
        /// So many.
        cycles: u32,
        /// So many would have been tolerated.
        tolerated: u32,
    },
    /// The reference of an axis was not found in time.
    Homing {
        /// 0 is X.
        axis: u8,
    },
    /// The spindle turned and its index pulse did not come, or came elsewhere than before.
    SpindleIndex,
    /// A thread needs the spindle's encoder, and nothing comes from it.
    SpindleAngle,
    /// The spindle came nearly to a standstill in a thread.
    SpindleLost,
}

impl FaultCause {
    /// In words.
    pub fn text(self) -> &'static str {
        match self {
            FaultCause::FollowingError { .. } => "following error too large",
            FaultCause::Encoder { .. } => "encoder readings are not possible",
            FaultCause::Spindle => "the spindle did not come to speed",
            FaultCause::Drive => "a drive reports a fault",
            FaultCause::Away { .. } => "the controller was away, and the drives stopped by themselves",
            FaultCause::Homing { .. } => "the reference of an axis was not found in time",
            FaultCause::SpindleIndex => "the index pulse of the spindle's encoder is missing or moves",
            FaultCause::SpindleAngle => "a thread needs the spindle's encoder, and nothing comes from it",
            FaultCause::SpindleLost => "the spindle was lost in a thread: it came nearly to a standstill",
        }
    }
}

impl fmt::Display for StopCause {
    /// The text, with what a person needs to know besides.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            StopCause::Late { cycles, tolerated } => away(f, cycles, tolerated, ""),
            _ => f.write_str(self.text()),
        }
    }
}

impl fmt::Display for FaultCause {
    /// The text, with what a person needs to know besides.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            FaultCause::Away { cycles, tolerated } => away(f, cycles, tolerated, ", and the drives stopped by themselves"),
            _ => f.write_str(self.text()),
        }
    }
}

fn away(f: &mut fmt::Formatter<'_>, cycles: u32, tolerated: u32, and: &str) -> fmt::Result {
    write!(
        f,
        "the controller was away for {cycles} servo cycles at once; {tolerated} are tolerated{and} (see what kept its computer busy or \
         asleep, give the controller realtime rights, look at the part, then take the job up again)"
    )
}

/// What can happen to the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Power on.
    PowerOn,
    /// Power off.
    PowerOff,
    /// Where all axes are is known.
    ReferencesKnown,
    /// Homing begins, or goes on.
    Homing {
        /// 0 is X.
        axis: u8,
        /// How far it is.
        stage: HomingStage,
    },
    /// The machine is at home.
    AtHome,
    /// The joystick is out of its middle.
    Jog {
        /// 0 is X.
        axis: u8,
    },
    /// A command is there.
    Work,
    /// A wait begins.
    Wait(Wait),
    /// It is over.
    WaitOver,
    /// The program says stop.
    Pause,
    /// The program is over.
    ProgramEnd,
    /// Somebody asks to hold.
    Hold,
    /// Somebody asks to go on.
    CycleStart,
    /// Spindle and coolant are as they were.
    Restored,
    /// A controlled stop is needed.
    Stop(StopCause),
    /// The axes came to rest.
    AtRest,
    /// The button was pressed.
    EmergencyStop,
    /// The button is out again.
    EmergencyStopReleased,
    /// The machine cannot go on by itself.
    Fault(FaultCause),
    /// Somebody acknowledges.
    Reset,
}

/// The whole behaviour: which state follows. What is not listed changes nothing.
pub fn next_state(state: State, event: Event) -> State {
    use State::*;
    match (state, event) {
        // Without power nothing happens, and power can always go.
        (_, Event::PowerOff) => Off,
        (Off, Event::PowerOn) => NotHomed,
        (Off, _) => Off,

        // The emergency stop beats everything; only its release and then a reset lead out of it.
        (_, Event::EmergencyStop) => EmergencyStop,
        (EmergencyStop, Event::EmergencyStopReleased) => EmergencyStopReleased,
        (EmergencyStop, _) => EmergencyStop,
        (EmergencyStopReleased, Event::Reset) => NotHomed,
        (EmergencyStopReleased, _) => EmergencyStopReleased,

        // A fault beats everything else; the first one is kept.
        (Fault(_), Event::Reset) => NotHomed,
        (Fault(cause), _) => Fault(cause),
        (_, Event::Fault(cause)) => Fault(cause),

        // A controlled stop: the first cause is kept, and it ends at rest.
        (Stopping(cause), Event::AtRest) => Stopped(cause),
        (Stopping(cause), _) => Stopping(cause),
        (Stopped(_), Event::Reset) => NotHomed,
        (Stopped(cause), Event::CycleStart) if cause.can_go_on() => Resuming,
        (Stopped(_), Event::Stop(StopCause::Asked)) => Stopped(StopCause::Asked),
        (Stopped(cause), _) => Stopped(cause),
        (Ready | NotHomed, Event::Stop(_)) => state,
        // Only a program can go on after a stop.
        (Homing { .. } | Jogging { .. }, Event::Stop(cause)) if cause.can_go_on() => state,
        (_, Event::Stop(cause)) => Stopping(cause),

        // By hand. What needs references asks for them anew: not homed, and in the same cycle ready if they are known.
        (NotHomed, Event::ReferencesKnown) => Ready,
        (NotHomed | Ready | Homing { .. }, Event::Homing { axis, stage }) => Homing { axis, stage },
        (Homing { .. }, Event::AtHome) => NotHomed,
        (Homing { .. } | Jogging { .. }, Event::Hold) => Stopping(StopCause::Asked),
        (NotHomed | Ready, Event::Jog { axis }) => Jogging { axis },
        (Jogging { .. }, Event::AtRest) => NotHomed,

        // Hold and go on.
        (Running, Event::Hold) => Holding,
        (Waiting(Wait::Commands), Event::Hold) => Held,
        (Waiting(wait), Event::Hold) => WaitingThenHold(wait),
        (WaitingThenHold(wait), Event::CycleStart) => Waiting(wait),
        (WaitingThenHold(_), Event::WaitOver) => Held,
        (Holding, Event::AtRest) => Held,
        (Holding, Event::CycleStart) => Running,
        (Held | Paused, Event::CycleStart) => Resuming,
        (Resuming, Event::Restored) => Running,
        (Resuming, Event::Hold) => Held,

        // The program.
        (Ready, Event::Work) => Running,
        (Waiting(Wait::Commands), Event::Work) => Running,
        (Running | Waiting(_), Event::Wait(wait)) => Waiting(wait),
        (WaitingThenHold(_), Event::Wait(wait)) => WaitingThenHold(wait),
        (Waiting(_), Event::WaitOver) => Running,
        (Running, Event::Pause) => Paused,
        (Running | Waiting(_), Event::ProgramEnd) => Ready,
        (state, _) => state,
    }
}

impl State {
    /// The column of the record.
    pub fn phase(self) -> Phase {
        match self {
            State::Off | State::NotHomed | State::Ready => Phase::Ready,
            State::Homing { .. } => Phase::Homing,
            State::Jogging { .. } => Phase::Jogging,
            State::Running | State::Holding => Phase::Running,
            State::Waiting(_) | State::WaitingThenHold(_) | State::Resuming => Phase::Waiting,
            State::Held | State::Paused => Phase::Paused,
            State::Stopping(_) | State::Stopped(_) => Phase::Stopped,
            State::EmergencyStop | State::EmergencyStopReleased => Phase::EmergencyStop,
            State::Fault(_) => Phase::Fault,
        }
    }

    /// True when only a person leads out of it: the program will not go on by itself.
    pub fn needs_a_person(self) -> bool {
        matches!(
            self,
            State::Off
                | State::NotHomed
                | State::Held
                | State::Paused
                | State::Stopped(_)
                | State::EmergencyStop
                | State::EmergencyStopReleased
                | State::Fault(_)
        )
    }
}
