//! `toolmark trace verify`: nothing was changed, or what was, by name.

use crate::cli::Common;
use crate::commands::backup::size;
use crate::commands::{Done, print_json};
use crate::failure::Exit;
use crate::progress::Progress;
use crate::{say, shop};
use serde::Serialize;
use std::path::Path;
use store::Verification;

#[derive(Serialize)]
struct Answer<'a> {
    data: &'a Path,
    verified: bool,
    #[serde(flatten)]
    found: &'a Verification,
}

/// Runs the command.
///
/// # Errors
/// There is no data directory, a process works in it, or it cannot be read at all.
pub fn verify(root: &Path, common: &Common) -> Done {
    let mut progress = Progress::new("verify");
    let found = store::verify(root, |file| progress.at(|| file.to_owned())).map_err(shop::failure)?;
    drop(progress);
    // Said after the check: a database that is too damaged to be opened has no jobs to speak of.
    if found.findings.is_empty() {
        shop::read_data(root)?;
    }
    let verified = found.findings.is_empty();
    if common.json {
        print_json(&Answer {
            data: root,
            verified,
            found: &found,
        })?;
    } else {
        found.findings.iter().for_each(|f| say(&format!(" CHANGED  {f}")));
        found.remarks.iter().for_each(|r| say(&format!(" remark   {r}")));
        say(&format!(
            "{}: {} events, {} jobs, {} process values, {} records and {} files of {} looked at",
            if verified {
                "verified, nothing was changed".to_owned()
            } else {
                format!("NOT VERIFIED, {} findings", found.findings.len())
            },
            found.events,
            found.jobs,
            found.values,
            found.records,
            found.files,
            size(found.bytes)
        ));
        if verified {
            say(&format!(
                "the log ends with event {}, SHA-256 {}; written down elsewhere it proves that nothing was cut off",
                found.last_event, found.last_event_sha256
            ));
        }
    }
    Ok(if verified { Exit::Good } else { Exit::Negative })
}
