//! The house's disk: the data directory with its lock and its SQLite file, the record files, and the machine file.
//!
//! This is the light part of the shell: it opens files, but no socket and no clock; times come from the caller, so that a simulated run
//! writes the same bytes every time. It keeps what `ledger` makes and invents no events of its own hand: every row that matters is
//! told by an event of the chain, and [`DataDirectory::verify`] holds the two against each other.
//!
//! Read on: [`DataDirectory`] for the folder, its lock, jobs, events and process values; [`record`] for Parquet records of samples;
//! [`trajectory`] for planned set-points; [`machine_file`] for `machine.toml`; [`registers`] for the paths of offsets.
//!
//! Not here yet: append-only segments with group commit, retention, roll-ups. A record is written to its Parquet file directly, and
//! what a crash leaves of it is an unfinished `.tmp` file that nothing refers to.

mod catalogue;
mod directory;
mod error;
mod events;
mod jobs;
pub mod machine_file;
pub mod record;
pub mod registers;
mod schema;
pub mod trajectory;
mod variables;
mod verify;
mod whole_file;

pub use catalogue::CatalogueRow;
pub use directory::{DataDirectory, data_directory_path};
pub use error::StoreError;
pub use events::Log;
pub use jobs::{Ending, Interrupted, Job, JobId, JobState, NewJob};
pub use machine_file::{MachineFile, MachineKind};
pub use registers::Register;
pub use verify::Finding;
