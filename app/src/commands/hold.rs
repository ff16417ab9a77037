//! `toolmark hold`: a job whose records stay whatever their age, and its release.

use super::trace::job_named;
use super::{Done, print_json};
use crate::cli::{Common, HoldArgs};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::{clock, say, shop};
use ledger::Action;
use serde_json::json;

/// Runs the command.
///
/// # Errors
/// There is no such job, it is on hold already or not on hold, `--reason` is missing, or the data directory is in use.
pub fn hold(args: &HoldArgs, common: &Common) -> Done {
    let why = common.reason.as_deref().filter(|why| !why.trim().is_empty());
    let why = why.ok_or_else(|| Failure::usage("a hold and its release need a reason: give --reason TEXT"))?;
    let at = clock::start_time(common.start.as_deref())?;
    let mut directory = shop::data_directory(common)?;
    let acting = Acting::of(&directory, common)?;
    let action = if args.release { Action::Release } else { Action::Hold };
    acting.must(action, &mut directory, at)?;
    let who = acting.name;
    let job = job_named(&directory, &args.job)?.id;
    if args.release {
        directory.release_job(job, &who, why, at).map_err(shop::failure)?;
    } else {
        directory.hold_job(job, &who, why, at).map_err(shop::failure)?;
    }
    let gone = (directory.removals().map_err(shop::failure)?.into_iter())
        .filter(|removal| removal.record.job == job)
        .count();
    if common.json {
        print_json(&json!({
            "job": job.0,
            "held": !args.release,
            "who": who,
            "why": why,
            "at": clock::utc(at),
            "records_removed_before": gone,
        }))?;
    } else if args.release {
        say(&format!("job {job} is released: its records age as all others do"));
    } else {
        say(&format!("job {job} is on hold: its records stay until it is released"));
        if gone > 0 {
            say(&format!(
                "warning: the rows of {gone} of its records were removed by age before; what they came to is kept"
            ));
        }
    }
    Ok(Exit::Good)
}
