//! The house's disk: the data directory with its lock and its SQLite file, the record files, and the machine file.
//!
//! This is the light part of the shell: it opens files and starts the thread that writes a recording, but opens no socket and asks no
//! clock what time it is; times come from the caller, so that a simulated run writes the same bytes every time. It keeps what `ledger`
//! makes: every row that matters is told by an event of the chain, and [`DataDirectory::verify`] holds the two against each other.
//!
//! Read on: [`DataDirectory`] for the folder, its lock, jobs, events and process values; [`fn@verify`] for the check of everything;
//! [`backup`] for whole copies and the way back; [`ServerNotice`] for whom to talk to; [`segment`] for recordings in the making, where
//! what is acknowledged is on disk; [`record`] for Parquet records of samples and [`Table`] for any others; [`rollup`] for what they come
//! to over an hour or a month; [`DataDirectory::range`] for the rows of a moment; [`Retention`] for what is removed by age;
//! [`trajectory`] for planned set-points; [`machine_file`] for `machine.toml`; [`registers`] for the paths of offsets.

mod agent_recording;
pub mod backup;
mod catalogue;
mod directory;
mod error;
mod events;
pub mod functions;
mod holds;
mod jobs;
mod kept;
pub mod machine_file;
pub mod machine_told;
pub mod observations;
pub mod operators;
mod people_verified;
pub mod programs;
mod range;
pub mod record;
pub mod register_file;
pub mod registers;
mod retention;
mod retention_verified;
pub mod rollup;
mod schema;
pub mod segment;
mod server_notice;
pub mod sizing;
mod sizing_verified;
mod sources;
mod table;
pub mod trajectory;
mod values;
mod variables;
mod verify;
mod wal;
mod whole_file;

pub use agent_recording::{NewRecording, Part, Recorded, part_of};
pub use catalogue::CatalogueRow;
pub use directory::{DataDirectory, data_directory_path};
pub use error::StoreError;
pub use events::Log;
pub use holds::Hold;
pub use jobs::{Ending, Interrupted, Job, JobId, JobState, Left, NewJob};
pub use kept::KeptFile;
pub use machine_file::{Coolant, MachineFile, MachineKind, Nameplate};
pub use operators::{Assignment, KeptOperator};
pub use programs::{KnownProgram, ProgramEdit};
pub use range::{Piece, Range, Rest, RolledUp, Rows};
pub use registers::Register;
pub use retention::{Removal, Retained, Retention};
pub use server_notice::ServerNotice;
pub use sources::{Of, Span};
pub use table::Table;
pub use values::RecoveredValues;
pub use verify::{Finding, Verification, verify};
pub use whole_file::WholeFile;
