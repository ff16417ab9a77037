//! What goes over the link of the machine's own types, each in one place: commands and requests towards it, reports from it.

use super::wire::{wire_enum, wire_struct};
use crate::controller::{Counters, Request};
use crate::drive::{AxisOrder, DriveMode, DriveOrders};
use crate::overrides::Overrides;
use crate::pad::{Mode, Notices};
use crate::realtime::Report;
use crate::sample::{Phase, Quality, Sample};
use crate::state::{FaultCause, HomingStage, State, StopCause, Wait};
use crate::watch::{
    AlarmOrder, BadCondition, Firing, FiringKind, Frequency, Living, LoadError, Operation, Reaction, Relation, ResetBy,
    WatchCost, WatchOrder,
};
use crate::{Command, CoolantOutlets, SetPoint, SpindleCommand, Tie};

wire_struct!(SetPoint {
    position,
    velocity,
    acceleration,
    step,
    path_length,
    path_speed,
    rapid,
    planned_override,
    tie,
});
wire_struct!(Tie {
    lead,
    revolutions,
    start,
});
wire_enum!(Command {
    1 = SetPoint(set_point),
    2 = Spindle { spindle, step },
    3 = SpindleSpeed(speed),
    4 = Coolant { outlets, step },
    5 = Tool { tool, step },
    6 = Dwell { cycles, step },
    7 = Workingstep { workingstep, step },
    8 = Pause { step },
    9 = End { step },
    10 = ToolLength { length, step },
    11 = Watch { order, step },
});
wire_enum!(WatchOrder {
    1 = Start(watch),
    2 = Stop(watch),
    3 = Alarm(order),
    4 = OperationBegins,
    5 = OperationEnds,
    6 = TakeUp { watch, fired },
    7 = OperationUnderWay,
});
wire_enum!(AlarmOrder {
    1 = Set { alarm, reaction, reset_by },
    2 = Clear { alarm },
});
wire_enum!(Reaction {
    0 = None,
    1 = StopAfterOperation,
    2 = FeedHold,
    3 = StopNow,
});
wire_enum!(ResetBy {
    0 = Function,
    1 = Acknowledge,
    2 = Reset,
});
wire_enum!(Frequency {
    0 = NoKeyword,
    1 = Whenever,
    2 = FromFirst,
    3 = WhenOnce,
    4 = EveryEdge,
});
wire_enum!(Operation {
    1 = Signal(signal),
    2 = Constant(number),
    3 = Truth(truth),
    4 = Alarm(alarm),
    5 = Compare(signal, relation, number),
    6 = Relate(relation),
    7 = Add,
    8 = Subtract,
    9 = Multiply,
    10 = Divide,
    11 = Negate,
    12 = Not,
    13 = And,
    14 = Or,
    15 = Xor,
});
wire_enum!(Relation {
    0 = Less,
    1 = LessOrEqual,
    2 = Greater,
    3 = GreaterOrEqual,
    4 = Equal,
    5 = NotEqual,
});
wire_enum!(LoadError {
    1 = Condition(bad),
    2 = Full,
    3 = Frequency,
    4 = Alarms,
});
wire_enum!(BadCondition {
    1 = TooLong,
    2 = TooDeep,
    3 = Operands { at },
    4 = Number { at },
    5 = Result,
});
wire_struct!(Firing { tick, watch, kind });
wire_enum!(FiringKind {
    0 = Unknown,
    1 = Fired,
    2 = Ended,
});
wire_struct!(Living {
    mark,
    all_modes,
    since,
    fired
});
wire_struct!(WatchCost { operations, nanoseconds });
wire_enum!(SpindleCommand {
    0 = Stop,
    1 = Clockwise(speed),
    2 = Counterclockwise(speed),
});
wire_struct!(CoolantOutlets { flood, mist, through });
wire_enum!(Request {
    1 = PowerOn,
    2 = PowerOff,
    3 = CycleStart,
    4 = Hold,
    5 = Stop,
    6 = Reset,
    7 = Override(overrides),
    8 = Home,
    9 = Mode(mode),
    10 = JogFeed(feed),
    11 = JogSpindle(spindle),
    12 = BeginMachining,
    13 = StopSpindle,
});
wire_struct!(Overrides { feed, rapid, spindle });

wire_struct!(Report {
    sample,
    state,
    counters,
    idle,
    orders,
    overrides,
    notices,
    watches,
});
wire_struct!(Notices {
    emergency_stop,
    mode,
    joystick_stopped,
    home_reached,
});
wire_enum!(Mode {
    0 = Auto,
    1 = Jog { axis },
});
wire_struct!(Sample {
    tick,
    step,
    workingstep,
    tool,
    phase,
    quality,
    commanded,
    actual,
    velocity,
    load,
    current,
    path_speed,
    spindle_speed,
    spindle_load,
    overrides,
    spindle_angle,
    thread_error,
});
wire_enum!(Phase {
    0 = Ready,
    1 = Running,
    2 = Waiting,
    3 = Paused,
    4 = Stopped,
    5 = EmergencyStop,
    6 = Fault,
    7 = Jogging,
    8 = Homing,
});
wire_enum!(Quality {
    0 = Good,
    1 = Simulated,
    2 = Stale,
    3 = Unavailable,
});
wire_enum!(State {
    0 = Off,
    1 = Ready,
    2 = Running,
    3 = Waiting(wait),
    4 = WaitingThenHold(wait),
    5 = Holding,
    6 = Held,
    7 = Paused,
    8 = Stopping(cause),
    9 = Stopped(cause),
    10 = EmergencyStop,
    11 = EmergencyStopReleased,
    12 = Fault(cause),
    13 = NotHomed,
    14 = Homing { axis, stage },
    15 = Jogging { axis },
    16 = Resuming,
});
wire_enum!(HomingStage {
    0 = Search,
    1 = BackOff,
    2 = SlowSearch,
    3 = GoHome,
});
wire_enum!(Wait {
    0 = Commands,
    1 = Position,
    2 = Spindle,
    3 = Tool,
    4 = Dwell,
    5 = ToolAway,
    6 = ToolBack,
});
wire_enum!(StopCause {
    0 = Asked,
    1 = Starved,
    2 = SoftLimit { axis },
    3 = Jump { axis },
    4 = SwitchInMotion,
    5 = Late { cycles, tolerated },
    6 = OffPath,
    7 = ThreadTooShort,
});
wire_enum!(FaultCause {
    0 = FollowingError { axis },
    1 = Encoder { axis },
    2 = Spindle,
    3 = Drive,
    4 = Homing { axis },
    5 = SpindleIndex,
    6 = SpindleAngle,
    7 = SpindleLost,
    8 = Away { cycles, tolerated },
});
wire_struct!(Counters {
    accepted,
    completed,
    discarded,
    late_ticks,
    late_gaps,
    starved_ticks,
    starvations,
    off_path_stops,
    bridged_readings,
    following_warnings,
    in_position_time_outs,
    spindle_limited,
});
wire_struct!(DriveOrders {
    mode,
    axes,
    spindle,
    coolant,
    path_speed,
});
wire_struct!(AxisOrder {
    position,
    velocity,
    planned,
    torque,
});
wire_enum!(DriveMode {
    0 = Off,
    1 = Follow,
    2 = QuickStop,
});
