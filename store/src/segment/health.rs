//! How a recording stands, for everybody to see while it runs.

use super::gap::{Cause, Gap};
use super::latency::Latencies;
use serde::Serialize;
use std::fmt;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What the disk does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[repr(u8)]
pub enum Condition {
    /// Rows are acknowledged.
    #[default]
    Good = 0,
    /// Nothing is acknowledged: the disk is full. It goes on by itself when there is room again.
    DiskFull = 1,
    /// Nothing is acknowledged: the disk refuses for another reason. It is tried again and again.
    DiskFailing = 2,
}

/// How a recording stands.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Health {
    /// What the disk does.
    pub condition: Condition,
    /// What the disk said, while it refuses.
    pub what: Option<String>,
    /// Rows that are on the medium.
    pub acknowledged: u64,
    /// Tick or sequence of the last of them.
    pub last: Option<u64>,
    /// Rows that were lost, each in a gap that the recording tells of.
    pub missed: u64,
    /// Number of gaps.
    pub gaps: u64,
    /// Bytes that the disk still takes, while it is full.
    pub free_bytes: Option<u64>,
}

impl fmt::Display for Health {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.condition {
            Condition::Good => write!(f, "recording, {} rows on disk", self.acknowledged)?,
            Condition::DiskFull => {
                write!(f, "NOT RECORDING since row {}: the disk is full", self.acknowledged)?;
                if let Some(free) = self.free_bytes {
                    write!(f, " ({free} bytes free)")?;
                }
                f.write_str("; make room, and it goes on by itself")?;
            }
            Condition::DiskFailing => write!(
                f,
                "NOT RECORDING since row {}: {}",
                self.acknowledged,
                self.what.as_deref().unwrap_or("the disk refuses")
            )?,
        }
        if self.gaps > 0 {
            write!(f, "; {} rows lost in {} gaps", self.missed, self.gaps)?;
        }
        Ok(())
    }
}

/// Something that a person, and the log of the data directory, must be told about a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// Rows are not acknowledged any more.
    Stopped(Health),
    /// They are again.
    Resumed(Health),
    /// Rows were lost.
    Gap(Gap),
    /// A closed segment could not be compacted on the way; nothing is lost, and the end of the recording tries again.
    NotCompacted(String),
}

impl Notice {
    /// The kind of its event.
    pub fn kind(&self) -> &'static str {
        match self {
            Notice::Stopped(_) => "recording-stopped",
            Notice::Resumed(_) => "recording-resumed",
            Notice::Gap(_) => "recording-gap",
            Notice::NotCompacted(_) => "segment-not-compacted",
        }
    }

    /// The detail of its event.
    pub fn detail(&self) -> std::collections::BTreeMap<String, serde_json::Value> {
        let value = match self {
            Notice::Stopped(health) | Notice::Resumed(health) => serde_json::to_value(health),
            Notice::Gap(gap) => serde_json::to_value(gap),
            Notice::NotCompacted(what) => Ok(serde_json::json!({ "what": what })),
        };
        match value {
            Ok(serde_json::Value::Object(map)) => map.into_iter().collect(),
            other => unreachable!("a struct is always a JSON object, and not {other:?}"),
        }
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Notice::Stopped(health) => health.fmt(f),
            Notice::Resumed(health) => write!(f, "recording again: {health}"),
            Notice::Gap(gap) => gap.fmt(f),
            Notice::NotCompacted(what) => write!(f, "a closed segment was not compacted, it is tried again at the end: {what}"),
        }
    }
}

/// A look at a recording from any thread. Looking never holds the sampling up.
#[derive(Clone, Default)]
pub struct Watch {
    shared: Arc<Shared>,
}

/// What the writing thread tells. The numbers are read by the sampling thread too, which must not wait for a lock.
#[derive(Default)]
struct Shared {
    condition: AtomicU8,
    acknowledged: AtomicU64,
    told: Mutex<Told>,
}

#[derive(Default)]
struct Told {
    health: Health,
    latencies: Latencies,
    notices: Vec<Notice>,
}

impl Watch {
    /// Rows that are on the medium.
    pub fn acknowledged(&self) -> u64 {
        self.shared.acknowledged.load(SeqCst)
    }

    /// How the recording stands.
    pub fn health(&self) -> Health {
        self.told().health.clone()
    }

    /// How long rows waited for their acknowledgement.
    pub fn latencies(&self) -> Latencies {
        self.told().latencies.clone()
    }

    /// What is to be told and was not taken yet, in order.
    pub fn take_notices(&self) -> Vec<Notice> {
        std::mem::take(&mut self.told().notices)
    }

    /// What a row that is lost now is lost by.
    pub(super) fn cause(&self) -> Cause {
        match self.shared.condition.load(SeqCst) {
            0 => Cause::RingFull,
            1 => Cause::DiskFull,
            _ => Cause::DiskFailed,
        }
    }

    pub(super) fn acknowledge(&self, rows: u64, last: Option<u64>, waits: impl Iterator<Item = (u64, u64)>) {
        let mut told = self.told();
        told.health.acknowledged = rows;
        told.health.last = last.or(told.health.last);
        waits.for_each(|(us, times)| told.latencies.add(us, times));
        self.shared.acknowledged.store(rows, SeqCst);
        if told.health.condition != Condition::Good {
            told.health.condition = Condition::Good;
            told.health.what = None;
            told.health.free_bytes = None;
            let notice = Notice::Resumed(told.health.clone());
            told.notices.push(notice);
        }
        self.shared.condition.store(Condition::Good as u8, SeqCst);
    }

    pub(super) fn refuse(&self, condition: Condition, what: String, free_bytes: Option<u64>) {
        let mut told = self.told();
        let before = std::mem::replace(&mut told.health.condition, condition);
        told.health.what = Some(what);
        told.health.free_bytes = free_bytes;
        if before != condition {
            let notice = Notice::Stopped(told.health.clone());
            told.notices.push(notice);
        }
        self.shared.condition.store(condition as u8, SeqCst);
    }

    pub(super) fn gap(&self, gap: &Gap) {
        let mut told = self.told();
        told.health.gaps += 1;
        told.health.missed += gap.count;
        told.notices.push(Notice::Gap(gap.clone()));
    }

    pub(super) fn not_compacted(&self, error: &crate::StoreError) {
        self.told().notices.push(Notice::NotCompacted(error.to_string()));
    }

    fn told(&self) -> MutexGuard<'_, Told> {
        // Numbers and texts: whatever thread panicked, they are as good as before.
        self.shared.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
