//! The set-point link over a network: sockets and certificates for both sides, the driving side of `toolmark run`, and
//! who only asks.
//!
//! What is said over it is in `machine::link` and `cell::link`; the controller's side is [`crate::controller`].

pub mod address;
pub mod asking;
pub mod certificates;
pub mod driven;
pub mod driving;
pub mod own_count;
pub mod remote;
pub mod socket;
pub mod text_run;
