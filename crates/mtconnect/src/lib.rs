//! MTConnect, sans-io: bytes in, observations and positions out: the reading of recordings, and the client that makes them.
//!
//! A recording comes in three forms: an MTConnectStreams document (any version, prefixed or not), an SHDR log (what an adapter sends to
//! its agent), and the plain text form of one row a position. All three become a [`Track`]: places over time, in millimetres, with
//! what is missing marked as [`Gap`]s. Nothing is interpolated and nothing is dropped in silence: what was left out is in the
//! diagnostics, with line and column.
//!
//! Read on: [`client`] for recording an agent, [`recording`] for the one entry that tells the forms apart, [`streams`] for the XML, [`track`] for how observations become
//! places, [`text`] for the plain form (reading and writing), [`shdr`] for adapter logs.

mod candidate;
pub mod client;
pub mod instant;
mod place;
pub mod recording;
pub mod shdr;
pub mod streams;
pub mod text;
pub mod track;

pub use recording::{Form, ReadOptions, Reading, of_observations, read};
pub use streams::{Category, Header, Observation, Source, Streams, Value, read_streams};
pub use text::TextWriter;
pub use track::{Gap, GapCause, LengthUnit, StatedFrame, Track, TrackPoint};
