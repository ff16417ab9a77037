//! Segments: recordings in the making. What is acknowledged is on disk.
//!
//! A [`Writer`] appends frames with a checksum to one file; [`read`] gives back everything up to the first byte that is not as it was
//! written, and says what is lost. A [`Recorder`] does it off a sampling thread: a bounded ring, one write and one sync each 100 ms, the
//! number of acknowledged rows for everybody to see. [`Layout`] says what columns there are.
//!
//! A segment lives as long as its recording. [`merge`] turns closed ones into Parquet; [`crate::DataDirectory::recover`] does so with
//! what a killed process left.

pub(crate) mod compact;
pub mod disk;
pub mod frame;
mod gap;
mod health;
mod latency;
mod layout;
mod parts;
mod reader;
mod recorder;
mod recovery;
mod rows;
pub mod trouble;
mod writer;

pub(crate) use compact::paths;
pub use compact::{Merged, discard, merge};
pub use disk::{Disk, DiskFile, RealDisk};
pub use gap::{Cause, Gap};
pub use health::{Condition, Health, Notice, Watch};
pub use latency::Latencies;
pub use layout::{Column, Holds, Layout};
pub use reader::{Lost, Recovered, cut, read};
pub use recorder::{Ended, Offered, Pace, Recorder, Settings};
pub use recovery::Recovery;
pub use rows::{Reading, ReadingRows, Rows};
pub(crate) use writer::{FIRST_ROW, time_of, unwritable};
pub use writer::{Options, Writer};
