//! Segments: recordings in the making. What is acknowledged is on disk.
//!
//! A [`Writer`] appends frames with a checksum to one file; [`read`] gives back everything up to the first byte that is not as it was
//! written, and says what is lost. A recorder does it off a sampling thread: a bounded ring, one write and one sync each 100 ms, the
//! number of acknowledged rows for everybody to see. [`Layout`] says what columns there are.
//!
//! A segment lives as long as its recording. Compaction turns closed ones into Parquet; recovery does so with
//! what a killed process left.

pub mod disk;
pub mod frame;
mod gap;
mod latency;
mod layout;
mod reader;
mod rows;
pub mod trouble;
mod writer;

pub use disk::{Disk, DiskFile, RealDisk};
pub use gap::{Cause, Gap};
pub use layout::{Column, Holds, Layout};
pub use reader::{Lost, Recovered, cut, read};
pub use latency::Latencies;
pub use rows::{Reading, ReadingRows, Rows};
pub(crate) use writer::{time_of, unwritable};
pub use writer::{Options, Writer};
