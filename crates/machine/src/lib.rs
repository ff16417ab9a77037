//! The realtime half of the machine: takes one [`Command`] stream, gives one [`Sample`] every servo cycle of 1 ms.
//!
//! `no_std` without `alloc`: `Vec`, `String` and `format!` do not compile in here, queues are bounded and full is an answer. Positions
//! are gauge-point axis positions in the machine frame, mm.
//!
//! Read on: [`command`] for what comes in, [`sample`] for what goes out and what a record's columns are, [`state`] for the table of
//! states, [`controller`] for stopping on the path and supervision, [`drive`] for the border to real and simulated drives, [`plant`] for
//! the simulated ones, [`watch`] for conditions of programs, [`realtime`] for all of it in one cycle, [`link`] for what comes and goes
//! over a wire.

#![no_std]

pub mod command;
pub mod controller;
pub mod drive;
mod follow;
pub mod link;
pub mod overrides;
pub mod pad;
pub mod parameters;
pub mod plant;
pub mod realtime;
pub mod registers;
pub mod ring;
pub mod sample;
pub mod servo;
mod spindle_angle;
pub mod state;
pub mod watch;

pub use command::{Command, CoolantOutlets, SetPoint, SpindleCommand, Tie};
pub use controller::{Controller, Counters, QUEUE, Request};
pub use drive::{AxisOrder, CyclicDrive, DriveMode, DriveOrders, Feedback};
pub use overrides::Overrides;
pub use pad::{ControlPad, Mode, NoPad, Notices, PadState};
pub use parameters::{
    AxisParameters, CuttingParameters, HomingParameters, MachineParameters, Mechanics, ParameterError, PositionLaw, ServoGains,
    SpindleParameters,
};
pub use plant::Plant;
pub use realtime::{RealtimeHalf, Report};
pub use registers::{RegisterCard, Registers};
pub use ring::Ring;
pub use sample::{CHANNELS, Channel, Phase, Quality, Sample};
pub use state::{Event, FaultCause, HomingStage, State, StopCause, Wait};
pub use watch::{WatchOrder, Watches};
