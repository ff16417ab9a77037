//! The one error type of this crate: what happened to which file, and what the person can do.

use crate::{Hold, JobId, Log};
use ledger::operator::AssignError;
use ledger::{Broken, ChangeError};
use std::path::{Path, PathBuf};
use thiserror::Error;
use units::Tick;

/// Why the disk did not do what was asked.
#[derive(Debug, Error)]
pub enum StoreError {
    /// The operating system refused.
    #[error("cannot {doing} {}: {source}", path.display())]
    Io {
        /// What was tried: `create`, `sync` ...
        doing: &'static str,
        /// On which file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Another process works in the data directory.
    #[error(
        "data directory {} is in use by {holder}{}{}: end it, talk to it, or give another directory with --data",
        path.display(), pid.map(|p| format!(" (process {p})")).unwrap_or_default(),
        address.as_ref().map(|a| format!(", which answers at {a}")).unwrap_or_default()
    )]
    Locked {
        /// The data directory.
        path: PathBuf,
        /// Who holds it, in the holder's own words.
        holder: String,
        /// Its process number, when it could be read.
        pid: Option<u32>,
        /// Where it can be talked to, when it serves.
        address: Option<String>,
    },
    /// There is nothing to read.
    #[error(
        "{} holds no toolmark.sqlite: it is neither a data directory nor a backup of one; run a program first, or give --data DIR",
        .0.display()
    )]
    NoDirectory(PathBuf),
    /// Something would write into a directory that is only read.
    #[error("{} was opened to be read, nothing in it can be changed", .0.display())]
    OnlyRead(PathBuf),
    /// Somebody wants to work in a backup.
    #[error("{} is a backup and stays as it is: look into it with toolmark trace, or bring it back with toolmark restore", .0.display())]
    IsBackup(PathBuf),
    /// A backup that did not come to its end.
    #[error("{} is a backup that did not come to its end, so it is not whole: run toolmark backup to it once more", .0.display())]
    HalfBackup(PathBuf),
    /// A restore that did not come to its end.
    #[error("a restore into {} did not come to its end, so it is not whole: empty the folder and restore again", .0.display())]
    HalfRestore(PathBuf),
    /// A folder that cannot take a backup or a restore.
    #[error("{}: {what}", path.display())]
    BadPlace {
        /// The folder.
        path: PathBuf,
        /// Why, and what to do.
        what: String,
    },
    /// A backup that is not what was written.
    #[error("the backup {} is not whole, nothing was restored: {}", path.display(), problems.join("; "))]
    NotWhole {
        /// The backup.
        path: PathBuf,
        /// What is missing or changed.
        problems: Vec<String>,
    },
    /// There is no place to look for a data directory.
    #[error("no data directory: neither --data, TOOLMARK_DATA, XDG_DATA_HOME nor HOME is set; give --data DIR")]
    NoPlace,
    /// SQLite refused.
    #[error("database {}: {source}", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// What SQLite says.
        source: rusqlite::Error,
    },
    /// The database was written by a newer program.
    #[error(
        "database {} has schema {found}, this program knows up to {known}: use the newer toolmark that wrote it, or another --data",
        path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its schema.
        found: i64,
        /// The newest that is known here.
        known: i64,
    },
    /// A SQLite file of somebody else stands at our place.
    #[error("{} is a SQLite file, but not of toolmark: give another --data", path.display())]
    NotOurs {
        /// The file.
        path: PathBuf,
    },
    /// A path cannot be written as text.
    #[error("{} is not valid Unicode and cannot be catalogued: rename it", .0.display())]
    NotUnicode(PathBuf),
    /// A process value was not changed.
    #[error(transparent)]
    Change(#[from] ChangeError),
    /// A chain of events is broken.
    #[error("{log}: {broken}")]
    Broken {
        /// Which chain.
        log: Log,
        /// Where.
        broken: Broken,
    },
    /// An event in the database cannot be read back.
    #[error("{log}: event {sequence} is not readable: {what}")]
    BadEvent {
        /// Which chain.
        log: Log,
        /// Which event.
        sequence: i64,
        /// Why.
        what: String,
    },
    /// No such job.
    #[error("there is no job {0}")]
    NoSuchJob(JobId),
    /// The job is over.
    #[error("job {0} is over already")]
    JobIsOver(JobId),
    /// The job is on hold.
    #[error("job {} is on hold already, by {}: {}", .0.job, .0.who, .0.why)]
    HeldAlready(Hold),
    /// The job is not on hold.
    #[error("job {0} is not on hold")]
    NotHeld(JobId),
    /// A hold or a release without a person or a reason.
    #[error("a hold needs who asks for it and why: give --reason TEXT")]
    NobodyStandsBehind,
    /// An operator may not be made or changed so.
    #[error(transparent)]
    Assign(Box<AssignError>),
    /// A row that cannot stand in a record.
    #[error("record {}: a row of tick {} after one of tick {}: ticks must rise", path.display(), found.0, last.0)]
    OutOfOrder {
        /// The record.
        path: PathBuf,
        /// The last row's tick.
        last: Tick,
        /// The tick that came.
        found: Tick,
    },
    /// A number that the record's column cannot hold.
    #[error("record {}: {column} {value} does not fit into its column", path.display())]
    TooLarge {
        /// The record.
        path: PathBuf,
        /// Which column.
        column: &'static str,
        /// The number.
        value: u64,
    },
    /// A Parquet file that is cut or changed.
    #[error("{} is damaged or cut ({what}): take it from a backup, or record again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        what: String,
    },
    /// A roll-up that is cut or changed.
    #[error("roll-up {} is damaged or cut ({what}): it is made anew from its record when that is still there", path.display())]
    DamagedRollup {
        /// The file.
        path: PathBuf,
        /// What the reader found.
        what: String,
    },
    /// No record that was asked for has such a channel.
    #[error("no record has a channel {name}: there are {}", known.join(", "))]
    NoSuchChannel {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// A whole Parquet file that is not a record of ours.
    #[error("{} is not a toolmark record: {what}", path.display())]
    NotARecord {
        /// The file.
        path: PathBuf,
        /// What is missing.
        what: String,
    },
    /// A file could not be written as Parquet.
    #[error("cannot write {}: {what}", path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// A machine file says something that cannot be.
    #[error("{0}")]
    MachineFile(Box<plan::Diagnostic>),
    /// A register holds something that cannot be.
    #[error("register {path} = {value}: {what}")]
    BadRegister {
        /// Which register.
        path: String,
        /// What it holds.
        value: f64,
        /// What is wrong with it.
        what: String,
    },
}

impl StoreError {
    /// The process exit code of the command contract: 4 for lock and disk, 3 for an input that is not readable.
    pub fn exit_code(&self) -> u8 {
        use StoreError::*;
        match self {
            // What is made is output: a folder that is missing there is no unreadable input.
            Io { doing: "read", .. } => 3,
            Io {
                doing: "open", source, ..
            } if source.kind() == std::io::ErrorKind::NotFound => 3,
            Io { .. } | Locked { .. } | Database { .. } | Unwritable { .. } => 4,
            Newer { .. } | NotOurs { .. } | Broken { .. } | BadEvent { .. } => 3,
            Damaged { .. } | DamagedRollup { .. } | NotARecord { .. } | MachineFile(_) | BadRegister { .. } => 3,
            NoPlace | NoSuchChannel { .. } | NotUnicode(_) | NoSuchJob(_) | JobIsOver(_) => 2,
            HeldAlready(_) | NotHeld(_) | NobodyStandsBehind => 2,
            NoDirectory(_) | HalfBackup(_) | HalfRestore(_) | NotWhole { .. } => 3,
            IsBackup(_) | BadPlace { .. } => 2,
            Assign(error) if matches!(**error, AssignError::FirstIsHighest | AssignError::LooksTheSame(_)) => 2,
            Change(_) | Assign(_) => 1,
            OutOfOrder { .. } | TooLarge { .. } | OnlyRead(_) => 70,
        }
    }

    /// For `map_err`: an I/O error with what was tried on which file.
    pub(crate) fn io(doing: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> StoreError {
        let path = path.to_owned();
        move |source| StoreError::Io { doing, path, source }
    }
}
