//! Records: what the machine reported every servo cycle, in one Parquet file that stands alone.
//!
//! A row is one `machine::Sample`. Readings are kept as scaled 32-bit integers (`value = raw * scale + offset`, unit, scale and offset
//! in the Arrow metadata of the column): with delta encoding and zstd they take a third to a sixth of the space of floating-point
//! columns, and come back bit-equal. The file's own metadata says machine, start, seed, frame, unit, whether a simulator made it, and
//! holds all events of the job, so that it can be read without the data directory it came from.
//!
//! [`Writer`] makes one, [`Reader`] opens one, ours or one that only looks like it, [`extract`] takes a part of one.

mod extract;
mod pages;
mod reader;
pub(crate) mod rows;
pub(crate) mod schema;
pub(crate) mod writer;

pub use extract::extract;
pub(crate) use pages::Pages;
pub(crate) use reader::columns_of;
pub use reader::{Batch, Column, Reader, Row};
pub use rows::SampleRows;
pub use schema::Header;
pub use writer::{ColumnsWriter, Finished, Writer};
