//! A look at SQLite's write-ahead log before SQLite opens it.
//!
//! SQLite takes the first frame with a wrong checksum for the end of the log and drops what follows without a word: right after a power
//! loss, where nothing behind it was acknowledged, but a changed byte in the middle would take acknowledged changes with it. So the log
//! is read first, and frames that are lost are told. Format: sqlite.org/fileformat2.html section 4.

use crate::StoreError;
use std::path::Path;

const HEADER: usize = 32;
const FRAME_HEADER: usize = 24;

/// What is wrong with a write-ahead log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    /// In words.
    pub text: String,
    /// Nothing of the log stands behind it: a process that was killed while it wrote leaves a log so.
    pub at_the_end: bool,
}

/// What is wrong with the write-ahead log of the database at `database`; `None` when every frame of it is whole, or there is none.
pub(crate) fn problem(database: &Path) -> Result<Option<Problem>, StoreError> {
    let path = crate::directory::beside(database, "-wal");
    match std::fs::read(&path) {
        Ok(bytes) => Ok(problem_in(&bytes)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StoreError::io("read", &path)(e)),
    }
}

fn problem_in(bytes: &[u8]) -> Option<Problem> {
    let in_the_head = |text: &str| {
        Some(Problem {
            text: text.to_owned(),
            at_the_end: false,
        })
    };
    if bytes.is_empty() {
        return None;
    }
    let Some(header) = bytes.get(..HEADER) else {
        return in_the_head("it is cut within its head");
    };
    let magic = word(header, 0);
    let big = match magic {
        0x377f_0682 => false,
        0x377f_0683 => true,
        _ => return in_the_head("its head was changed"),
    };
    let page = word(header, 8) as usize;
    let mut sum = checksum((0, 0), &header[..24], big);
    if sum != (word(header, 24), word(header, 28)) || !page.is_power_of_two() || page < 512 {
        return in_the_head("its head was changed");
    }
    let salt = &header[16..24];
    let frames: Vec<&[u8]> = bytes[HEADER..].chunks(FRAME_HEADER + page).collect();
    for (n, frame) in frames.iter().enumerate() {
        let whole = frame.len() == FRAME_HEADER + page;
        let follows = whole && {
            let next = checksum(checksum(sum, &frame[..8], big), &frame[FRAME_HEADER..], big);
            let good = next == (word(frame, 16), word(frame, 20));
            sum = if good { next } else { sum };
            good
        };
        let ours = frame.get(8..16) == Some(salt);
        if follows && ours {
            continue;
        }
        // Frames of an earlier round stand behind the end of this one, under another salt: they carry nothing any more.
        let later = frames[n + 1..].iter().any(|f| f.get(8..16) == Some(salt));
        return (follows || ours || later).then(|| {
            let end = if later {
                ""
            } else {
                "; after a power loss or a killed process this can be the last change, which was not acknowledged"
            };
            let text = format!(
                "frame {} of {} is not what was written: the changes in it and behind it are lost{end}",
                n + 1,
                frames.len()
            );
            Problem {
                text,
                at_the_end: !later,
            }
        });
    }
    None
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

/// SQLite's own sum over pairs of words; the byte order stands in the log's head.
fn checksum((mut a, mut b): (u32, u32), bytes: &[u8], big: bool) -> (u32, u32) {
    let read = |w: &[u8]| {
        let w = w.try_into().expect("four bytes");
        if big { u32::from_be_bytes(w) } else { u32::from_le_bytes(w) }
    };
    for pair in bytes.chunks_exact(8) {
        a = a.wrapping_add(read(&pair[..4])).wrapping_add(b);
        b = b.wrapping_add(read(&pair[4..])).wrapping_add(a);
    }
    (a, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rusqlite::Connection;

    /// The log of a database that is still open, as a kill leaves it.
    fn a_log() -> (tempfile::TempDir, Vec<u8>, u64) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.sqlite");
        let connection = Connection::open(&path).expect("made");
        connection.pragma_update(None, "journal_mode", "WAL").expect("set");
        connection.execute_batch("CREATE TABLE t (x)").expect("made");
        for n in 0..20 {
            connection.execute("INSERT INTO t VALUES (?1)", [n]).expect("put in");
        }
        let bytes = std::fs::read(folder.path().join("x.sqlite-wal")).expect("there");
        let page = 4096;
        let frames = (bytes.len() as u64 - HEADER as u64) / (FRAME_HEADER as u64 + page);
        (folder, bytes, frames)
    }

    #[test]
    fn a_whole_log_has_no_problem_and_any_changed_byte_of_it_is_one() {
        let (_folder, bytes, frames) = a_log();
        assert!(frames >= 20);
        assert_eq!(problem_in(&bytes), None);
        assert_eq!(problem_in(&[]), None);
        for at in (0..bytes.len()).step_by(97).chain(bytes.len() - 5000..bytes.len()) {
            let mut changed = bytes.clone();
            changed[at] ^= 0x10;
            assert!(problem_in(&changed).is_some(), "byte {at} of {}", bytes.len());
        }
        let cut = problem_in(&bytes[..bytes.len() - 100]).expect("cut");
        assert!(
            cut.at_the_end && cut.text.contains(&format!("frame {frames} of {frames}")),
            "{cut:?}"
        );
        let mut early = bytes.clone();
        early[HEADER + FRAME_HEADER + 7] ^= 0x10;
        assert!(
            !problem_in(&early).expect("changed").at_the_end,
            "twenty frames stand behind it"
        );
    }

    #[test]
    fn frames_of_an_earlier_round_behind_the_end_are_no_problem() {
        let (folder, ..) = a_log();
        let path = folder.path().join("y.sqlite");
        let connection = Connection::open(&path).expect("made");
        connection.pragma_update(None, "journal_mode", "WAL").expect("set");
        connection.execute_batch("CREATE TABLE t (x)").expect("made");
        for n in 0..20 {
            connection.execute("INSERT INTO t VALUES (?1)", [n]).expect("put in");
        }
        connection
            .query_row("PRAGMA wal_checkpoint(RESTART)", [], |_| Ok(()))
            .expect("checkpointed");
        connection
            .execute("INSERT INTO t VALUES (99)", [])
            .expect("the next round begins at the front");
        let bytes = std::fs::read(folder.path().join("y.sqlite-wal")).expect("there");
        assert!(bytes.len() > 10 * 4096, "old frames stand behind");
        assert_eq!(problem_in(&bytes), None);
    }
}
