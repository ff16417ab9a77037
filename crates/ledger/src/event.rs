//! Events and the chain that ties each to the one before.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt;
use thiserror::Error;
use units::Timestamp;

/// A SHA-256 hash; prints as 64 hexadecimal digits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Hash(pub [u8; 32]);

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|b| write!(f, "{b:02x}"))
    }
}
impl Hash {
    /// Reads 64 hexadecimal digits; `None` for anything else.
    pub fn parse(text: &str) -> Option<Hash> {
        let digits = text.as_bytes();
        if digits.len() != 64 {
            return None;
        }
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(digits.chunks(2)) {
            let nibble = |d: u8| char::from(d).to_digit(16);
            *byte = (nibble(pair[0])? * 16 + nibble(pair[1])?) as u8;
        }
        Some(Hash(hash))
    }
    /// The hash of some bytes: of a program, of a record file.
    pub fn of(bytes: &[u8]) -> Hash {
        Hash(Sha256::digest(bytes).into())
    }
}

/// The hash of bytes that come in pieces: a file read through a window.
#[derive(Clone, Debug, Default)]
pub struct Hashing(Sha256);

impl Hashing {
    /// The next piece.
    pub fn update(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }
    /// The hash of all pieces.
    pub fn finish(self) -> Hash {
        Hash(self.0.finalize().into())
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Its number in the chain, from 1.
    pub sequence: u64,
    /// When, nanoseconds UTC.
    pub at_ns: i64,
    /// What kind of thing: `job-started`, `frame`, `change` ...
    pub kind: String,
    /// Its data by name.
    pub detail: BTreeMap<String, Value>,
    /// Hash of the event before; zeros for the first.
    pub previous: String,
    /// Hash of this event, over everything above.
    pub hash: String,
}

impl Event {
    /// When it happened.
    pub fn at(&self) -> Timestamp {
        Timestamp(self.at_ns)
    }

    /// Length-prefixed fields, so that no two events hash the same bytes.
    fn compute_hash(&self) -> Hash {
        let mut hasher = Sha256::new();
        let mut field = |bytes: &[u8]| {
            hasher.update((bytes.len() as u64).to_le_bytes());
            hasher.update(bytes);
        };
        field(&self.sequence.to_le_bytes());
        field(&self.at_ns.to_le_bytes());
        field(self.kind.as_bytes());
        for (name, value) in &self.detail {
            field(name.as_bytes());
            field(value.to_string().as_bytes());
        }
        field(self.previous.as_bytes());
        Hash(hasher.finalize().into())
    }
}

/// The end of a chain: enough to make the next event.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Chain {
    /// Sequence of the last event; 0 for an empty chain.
    pub sequence: u64,
    /// Hash of the last event; zeros for an empty chain.
    pub hash: Hash,
}

impl Chain {
    /// Makes the next event and moves on to it.
    pub fn append(&mut self, at: Timestamp, kind: &str, detail: BTreeMap<String, Value>) -> Event {
        let mut event = Event {
            sequence: self.sequence + 1,
            at_ns: at.0,
            kind: kind.to_owned(),
            detail,
            previous: self.hash.to_string(),
            hash: String::new(),
        };
        let hash = event.compute_hash();
        event.hash = hash.to_string();
        *self = Chain {
            sequence: event.sequence,
            hash,
        };
        event
    }

    /// Checks that `event` is whole and comes next, and moves on to it: for chains too long to be held in memory.
    ///
    /// # Errors
    /// What is wrong with it; the chain stays where it was.
    pub fn follow(&mut self, event: &Event) -> Result<(), Broken> {
        if event.sequence != self.sequence + 1 {
            return Err(Broken::Sequence {
                expected: self.sequence + 1,
                found: event.sequence,
            });
        }
        if event.previous != self.hash.to_string() {
            return Err(Broken::Link(event.sequence));
        }
        let hash = event.compute_hash();
        if event.hash != hash.to_string() {
            return Err(Broken::Content(event.sequence));
        }
        *self = Chain {
            sequence: event.sequence,
            hash,
        };
        Ok(())
    }
}

/// Where a chain is broken.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Broken {
    /// A number is missing or comes twice.
    #[error("event {found} stands where event {expected} is due: one was removed, put in or moved")]
    Sequence {
        /// The number that is due.
        expected: u64,
        /// The number that stands there.
        found: u64,
    },
    /// The event before is not the one this was chained to.
    #[error("event {0} does not follow the event before it: that one was changed")]
    Link(u64),
    /// Its own content was changed.
    #[error("event {0} was changed after it was written")]
    Content(u64),
}

/// Checks a whole chain from its first event and gives its end.
///
/// # Errors
/// The first place at which it is broken.
pub fn verify<'a>(events: impl IntoIterator<Item = &'a Event>) -> Result<Chain, Broken> {
    let mut end = Chain::default();
    events.into_iter().try_for_each(|event| end.follow(event))?;
    Ok(end)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three() -> Vec<Event> {
        let mut chain = Chain::default();
        (0..3)
            .map(|k| chain.append(Timestamp(k), "test", BTreeMap::from([("n".into(), k.into())])))
            .collect()
    }

    #[test]
    fn a_whole_chain_verifies_to_its_last_event() {
        let events = three();
        assert_eq!(verify(&events).expect("untouched").hash.to_string(), events[2].hash);
    }

    #[test]
    fn any_change_is_found_and_named() {
        let mut changed = three();
        changed[1].detail.insert("n".into(), 7.into());
        assert_eq!(verify(&changed), Err(Broken::Content(2)));
        let mut removed = three();
        removed.remove(1);
        assert_eq!(verify(&removed), Err(Broken::Sequence { expected: 2, found: 3 }));
        let mut rehashed = three();
        rehashed[0].detail.insert("n".into(), 7.into());
        rehashed[0].hash = rehashed[0].compute_hash().to_string();
        assert_eq!(verify(&rehashed), Err(Broken::Link(2)));
    }
}
