//! Roll-ups: what a record comes to, in buckets of some hundred rows and of sixteen times as many, and so on.
//!
//! A roll-up is a small file of its own for each record file. It answers what a curve looks like over an hour or a month, and what a
//! workingstep's loads were, without reading the rows, and it is kept when the rows are removed by age. It can be made again from the
//! record at any time by [`build`], and gives the same bytes then.
//!
//! A bucket of the finest level has [`BUCKET`] rows or fewer: one ends where time is missing and where the workingstep changes, so that
//! both stay sharp for ever. Everything is in raw numbers of the record (`value = raw * scale + offset`), so that nothing is rounded.
//!
//! Read on: [`build`] makes one, [`Rollup`] opens one; [`crate::DataDirectory::envelope`] and
//! [`crate::DataDirectory::workingstep_statistics`] are what they are for.

mod build;
mod envelope;
mod file;
mod numbers;
mod statistics;
mod walk;

pub(crate) use build::of_segment;
pub use build::{Built, build};
pub(crate) use envelope::known_channel;
pub use envelope::{Envelope, Pixel};
pub use file::Rollup;
pub(crate) use file::Summary;
pub use statistics::{ChannelStatistics, WorkingstepStatistics};

/// Most rows of a bucket of the finest level.
pub const BUCKET: usize = 256;
/// Buckets of a level that make one of the next coarser level.
pub const FAN: usize = 16;
