//! The two sides of the set-point link, sans-io: bytes and time are arguments, and what is to be written is asked for.
//!
//! **Sender** ([`LinkSender`]), beside the office half, for one plan:
//!
//! ```text
//! on connect          sender.connected(now)
//! on bytes            sender.receive(now, bytes)?            an error: close the connection, connect again
//! on close            sender.disconnected(now)
//! every ms or so      office.refill(|command| sender.push(command))
//!                     sender.output(now, &mut bytes)?        write them; an error: close the connection
//!                     office.machine_begun_anew(sender.begun_anew(), ..)
//!                     while let Some(report) = sender.report() {
//!                         while let Some(firing) = sender.firing(report.sample.tick) { office.fired(firing) }
//!                         office.receive(&report, ..) -> sender.request(request)
//!                     }
//!                     office.firings_lost(sender.lost_firings())
//! conditions          sender.load(load)                      before the program, and what office.to_load() says while it runs
//!                     sender.loaded()                        each one's number, or why it is refused, in order
//! ```
//!
//! **Receiver** ([`LinkReceiver`]), the receiving and sending tasks of the controller:
//!
//! ```text
//! on accept           receiver.connected(connection, now)    connection: any number that is not in use
//! on bytes            receiver.receive(connection, now, bytes)
//! on close            receiver.disconnected(connection, now)
//! every ms or so      receiver.output(connection, now, &mut bytes)     write them; false: write what there is and close
//!                     receiver.reads(connection)             false: leave its bytes in the socket for now
//! towards realtime    receiver.urgent() and receiver.order() into two bounded queues; give_back(order) when there is no place
//! from realtime       receiver.fired(firing)                 what fired, before the report of its cycle
//!                     receiver.reported(report, status)      once a tick, both from the realtime thread
//!                     receiver.lives(now, told)              what lives in the machine, when somebody has asked
//! ```
//!
//! **Realtime thread**, each tick: urgent orders into [`machine::link::Follower::take_urgent`], orders into
//! [`machine::link::Follower::take`] (one that comes back is kept, and tried again the next tick before any other), then
//! `half.tick(now)`, [`machine::link::Follower::after_tick`], and every report with [`machine::link::Follower::status`] to the sending
//! task, as [`machine::link::Follower::translated`] gives it, and a few of [`machine::link::Follower::lives`].
//!
//! **Who asks** what lives in the machine, or ends it, and does not drive: [`LinkAsker`], one question on a connection of its own, at any time.
//!
//! **Text protocol** ([`TextSender`], [`TextReceiver`]) in the same manner. Its realtime side is the machine's own queue: each
//! [`TextOrder::Command`] into `half.push`, one that comes back is the next again; [`TextOrder::request`] of the others and each
//! request of [`TextReceiver::urgent`] into `half.request`; reports into [`TextReceiver::reported`]. There are no reports from the machine but a few lines
//! ([`machine::link::text::Told`]), so whoever wants a record keeps it at the controller.
//!
//! [`scaled`] makes stop tails and the way back onto the path; [`channel`] and [`world`] are the simulated wire and its faults.

pub mod asking;
pub mod channel;
pub mod error;
pub mod loads;
pub mod receiver;
pub mod scaled;
pub mod sender;
pub mod stock;
pub mod text_receiver;
pub mod text_sender;
mod wire;
pub mod words;
pub mod world;

pub use asking::{Answer, LinkAsker, Lived};
pub use error::LinkError;
pub use loads::{Load, number_of};
pub use receiver::{Connection, LinkReceiver, MachineCard, Notice, ReceiverCounts};
pub use sender::{LinkSender, SenderStatus};
pub use text_receiver::{TextNotice, TextOrder, TextReceiver};
pub use text_sender::{Losses, TextRefusal, TextSender};
