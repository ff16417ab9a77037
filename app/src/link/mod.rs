//! The set-point link over a network: sockets and certificates for both sides, and the driving side of `toolmark run`.
//!
//! What is said over it is in `machine::link` and `cell::link`; the controller's side is [`crate::controller`].

pub mod address;
pub mod certificates;
pub mod driven;
pub mod driving;
pub mod own_count;
pub mod remote;
pub mod socket;
pub mod text_run;
