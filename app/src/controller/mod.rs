//! The machine side as a process of its own.

pub mod realtime;
