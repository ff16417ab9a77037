//! The wiring: a *realtime half* that moves the axes and an *office half* that plans, pairs steps with ticks and keeps the log, joined
//! by bounded queues.
//!
//! [`sim::World`] runs both on one thread from one seed; the same seed and start time give the same bytes. In the shell the same two
//! halves run in threads or processes of their own.
//!
//! Read on: [`source`] for where commands come from, [`office`] for the office half, [`events`] for what it writes into the log,
//! [`sink`] for where samples and events go, [`faults`] for what can be planted, [`observe`] for a record as an MTConnect agent would
//! see it, [`sim`] for the world and [`sim::measure`] for the simulated part on the gauge, [`proof`] for generated macros held against
//! the law of sizing.

pub mod events;
pub mod faults;
pub mod link;
pub mod observe;
pub mod office;
pub mod proof;
pub mod restart;
pub mod sim;
pub mod sink;
pub mod source;

pub use faults::{Fault, ShiftedSetup, WorkingstepSelector};
pub use office::{Ended, OfficeHalf, Operator};
pub use restart::{Approach, Restarted};
pub use sim::{Outcome, World, WorldConfig};
pub use sink::{RecordSink, Tee};
pub use source::{CommandSource, Output};
