//! The house's disk: the data directory with its lock and its SQLite file, the record files, and the machine file.
//!
//! This is the light part of the shell: it opens files and starts the thread that writes a recording, but opens no socket and asks no
//! clock what time it is; times come from the caller, so that a simulated run writes the same bytes every time. It keeps what `ledger`
//! makes: every row that matters is told by an event of the chain, and [`DataDirectory::verify`] holds the two against each other.
//!
//! Read on: [`DataDirectory`] for the folder, its lock, jobs, events and process values; [`segment`] for recordings in the making, where
//! what is acknowledged is on disk; [`record`] for Parquet records of samples and [`Table`] for any others; [`trajectory`] for planned
//! set-points; [`machine_file`] for `machine.toml`; [`registers`] for the paths of offsets.
//!
//! Not here yet: retention, roll-ups.

mod catalogue;
mod directory;
mod error;
mod events;
mod jobs;
pub mod machine_file;
pub mod observations;
pub mod record;
pub mod registers;
mod schema;
pub mod segment;
mod table;
pub mod trajectory;
mod verify;
mod whole_file;

pub use catalogue::CatalogueRow;
pub use directory::{DataDirectory, data_directory_path};
pub use error::StoreError;
pub use events::Log;
pub use jobs::{Ending, Interrupted, Job, JobId, JobState, Left, NewJob};
pub use machine_file::{MachineFile, MachineKind};
pub use registers::Register;
pub use table::Table;
pub use verify::Finding;
