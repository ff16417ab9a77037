//! The realtime half of the machine: takes one [`Command`] stream, gives one [`Sample`] every servo cycle of 1 ms.
//!
//! `no_std` without `alloc`: `Vec`, `String` and `format!` do not compile in here, queues are bounded and full is an answer. Positions
//! are gauge-point axis positions in the machine frame, mm.
//!
//! Read on: [`command`] for what comes in, [`sample`] for what goes out and what a record's columns are.

#![no_std]

pub mod command;
pub mod sample;

pub use command::{Command, CoolantOutlets, SetPoint, SpindleCommand};
pub use sample::{CHANNELS, Channel, Phase, Quality, Sample};
