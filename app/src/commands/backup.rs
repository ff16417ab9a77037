//! `toolmark backup` and `toolmark restore`: a whole copy of the data directory, and the way back.

use super::{Done, print_json};
use crate::cli::{BackupArgs, Common, RestoreArgs};
use crate::failure::Exit;
use crate::progress::Progress;
use crate::{clock, say, shop};
use serde_json::json;

/// Runs `backup`.
///
/// # Errors
/// The data directory is held by another process, the destination cannot be one, or the disk refuses.
pub fn backup(args: &BackupArgs, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let mut progress = Progress::new("backup");
    let done = directory
        .backup(&args.dest, at, &shop::operator(common), |file| {
            progress.at(|| file.to_owned())
        })
        .map_err(shop::failure)?;
    drop(progress);
    let manifest = &done.manifest;
    let bytes: u64 = manifest.files.iter().map(|f| f.bytes).sum();
    if common.json {
        print_json(&json!({
            "dest": args.dest,
            "files": manifest.files.len(),
            "bytes": bytes,
            "copied": done.copied,
            "copied_bytes": done.copied_bytes,
            "unchanged": done.unchanged,
            "left_over": done.left_over,
            "problems": manifest.problems,
            "last_event": manifest.last_event,
            "last_event_sha256": manifest.last_event_sha256,
            "manifest_sha256": manifest.manifest_sha256,
        }))?;
    } else {
        say(&format!(
            "backup {}: {} files, {}; {} written now ({}), {} were there already",
            args.dest.display(),
            manifest.files.len(),
            size(bytes),
            done.copied,
            size(done.copied_bytes),
            done.unchanged
        ));
        for path in &done.left_over {
            say(&format!(
                " left over from an earlier backup, no longer in the data directory: {path}"
            ));
        }
        for problem in &manifest.problems {
            say(&format!(" NOT WHOLE: {problem}"));
        }
        say(&format!(
            " the log ends with event {}, SHA-256 {}",
            manifest.last_event, manifest.last_event_sha256
        ));
    }
    Ok(if manifest.problems.is_empty() {
        Exit::Good
    } else {
        Exit::Negative
    })
}

/// Runs `restore`.
///
/// # Errors
/// The backup is not whole, the data directory is not empty, or the disk refuses.
pub fn restore(args: &RestoreArgs, common: &Common) -> Done {
    let at = clock::start_time(common.start.as_deref())?;
    let to = shop::data_path(common)?;
    let mut progress = Progress::new("restore");
    let done = store::backup::restore(&args.source, &to, at, &shop::operator(common), |file| {
        progress.at(|| file.to_owned());
    })
    .map_err(shop::failure)?;
    drop(progress);
    let manifest = &done.manifest;
    if common.json {
        print_json(&json!({
            "source": args.source,
            "data": to,
            "files": manifest.files.len(),
            "bytes": done.bytes,
            "made": clock::utc(units::Timestamp(manifest.at_ns)),
            "made_by": manifest.who,
            "was_missing": manifest.problems,
            "findings": done.findings,
            "verified": done.findings.is_empty(),
        }))?;
    } else {
        say(&format!(
            "restored {}: {} files, {}, as they were at {}",
            to.display(),
            manifest.files.len(),
            size(done.bytes),
            clock::local(units::Timestamp(manifest.at_ns))
        ));
        for problem in &manifest.problems {
            say(&format!(" was not whole when the backup was made: {problem}"));
        }
        for finding in &done.findings {
            say(&format!(" CHANGED  {finding}"));
        }
        if done.findings.is_empty() {
            say(" verified: every row and every file is as it was written");
        }
    }
    Ok(if done.findings.is_empty() {
        Exit::Good
    } else {
        Exit::Negative
    })
}

/// A number of bytes for people.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..10_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}
