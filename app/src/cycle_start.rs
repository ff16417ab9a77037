//! The program's hash at cycle start: a file that is another one than it was at its last edit or run here was edited outside.
//!
//! A file can be edited by anything, so this is no lock: it is said, it stands in the log with both hashes and in the report, and the
//! machine file may say that nothing moves then.

use crate::cli::Common;
use crate::failure::Failure;
use crate::people::Acting;
use crate::{clock, shop};
use ledger::{Action, Hash};
use serde_json::Value;
use std::path::Path;
use store::machine_file::EditedOutside;
use store::{DataDirectory, KnownProgram, MachineFile};
use units::Timestamp;

/// A program about to be run or edited.
pub struct Checked<'a> {
    /// Where it is.
    pub path: &'a Path,
    /// Its hash now.
    pub hash: Hash,
    /// For what: `run`, `edit`.
    pub what: &'static str,
    /// What the command line says of the policy.
    pub asked: Option<EditedOutside>,
}

/// Holds a program against what is known of it, and tells the log; gives a sentence for person and report when it was edited outside.
///
/// # Errors
/// It was edited outside and the machine file refuses that, or the disk refuses.
pub fn check(
    program: &Checked<'_>,
    machine: &MachineFile,
    acting: &Acting,
    directory: &mut DataDirectory,
    common: &Common,
    at: Timestamp,
) -> Result<Option<String>, Failure> {
    let Some(known) = directory.known_program(program.path).map_err(shop::failure)? else {
        if program.what == "run" {
            directory
                .keep_known(program.path, program.hash, &acting.name, at)
                .map_err(shop::failure)?;
        }
        return Ok(None);
    };
    let Some(sentence) = difference(program.path, program.hash, &known) else {
        return Ok(None);
    };
    let by_machine = machine.edited_outside;
    let is_refused = program.asked.unwrap_or(by_machine) == EditedOutside::Refuse;
    let mut detail = acting.detail();
    detail.insert("what".to_owned(), program.what.into());
    if is_refused {
        detail.insert("path".to_owned(), program.path.display().to_string().into());
        detail.insert("before_sha256".to_owned(), known.hash.to_string().into());
        detail.insert("sha256".to_owned(), program.hash.to_string().into());
        directory.append(at, "program-refused", detail).map_err(shop::failure)?;
        return Err(Failure::negative(format_args!(
            "error: {sentence}; {} refuses that, nothing was moved or changed. Bring the file back, or let somebody of level {} or better \
             accept it with --edited-outside warn --reason TEXT",
            if by_machine == EditedOutside::Refuse {
                "the machine file"
            } else {
                "--edited-outside"
            },
            Action::AcceptOutsideEdit.needs().map_or(1, ledger::Level::number)
        )));
    }
    if by_machine == EditedOutside::Refuse {
        acting.must(Action::AcceptOutsideEdit, directory, at)?;
        let why = common.reason.as_deref().filter(|why| !why.trim().is_empty());
        let why = why.ok_or_else(|| Failure::usage("to accept an edit made outside needs a reason: give --reason TEXT"))?;
        detail.insert("why".to_owned(), why.into());
    }
    directory
        .keep_changed_outside(program.path, (known.hash, program.hash), detail, at)
        .map_err(shop::failure)?;
    Ok(Some(sentence))
}

/// The sentence about a program that is not what is known of it; `None` when it is.
pub fn difference(path: &Path, hash: Hash, known: &KnownProgram) -> Option<String> {
    (known.hash != hash).then(|| {
        let who = known.event.detail.get("who").and_then(Value::as_str).unwrap_or("somebody");
        let last = match known.event.kind.as_str() {
            "program-edited" => "its last edit",
            "program-changed-outside" => "the last time that an edit made outside was found",
            _ => "its first run here",
        };
        format!(
            "the program {} was edited outside since {last} (event {}, {}, {who}): its SHA-256 was {} and is {}",
            path.file_name()
                .map_or_else(|| path.display().to_string(), |n| n.to_string_lossy().into_owned()),
            known.event.sequence,
            clock::utc(known.event.at()),
            short(known.hash),
            short(hash)
        )
    })
}

fn short(hash: Hash) -> String {
    format!("{}...", &hash.to_string()[..12])
}
