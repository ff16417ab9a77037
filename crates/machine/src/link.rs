//! The set-point link: what goes over the wire between a planner and the machine, as bytes, without an allocator.
//!
//! Two links, one default:
//!
//! - the **link** of binary frames ([`frame`]) with messages ([`message`]) of the machine's own types, every bit of a number as it is
//!   ([`item`], [`wire`]): a run through it is the same run. In front of the machine stands the [`Follower`].
//! - the **published text protocol** ([`text`]), for CAM systems that speak it.
//!
//! Sessions, leases, resuming and the simulated wire are in `cell::link`; sockets are the shell's. What was decided, and why:
//! `docs/decisions/0011-links.md`.

pub mod asking;
pub mod crc;
pub mod follower;
pub mod frame;
pub mod item;
pub mod loading;
pub mod message;
pub mod text;
pub mod wire;

pub use asking::{Asked, Lives};
pub use follower::{Follower, Order, UrgentOrder};
pub use frame::{FRAME, Frame, FrameError, FrameFault, FrameReader, Header, Kind, VERSION, write_frame};
pub use loading::{LoadPart, Loaded, Loads};
pub use message::{Entry, LimitsHash, Name, PlanId, Refusal, Status, Urgent};
pub use wire::{Reader, Wire, WireError, Writer};
