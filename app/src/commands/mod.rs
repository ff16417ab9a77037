//! One file for each command of the contract.

pub mod backup;
pub mod check;
pub mod compare;
pub mod controller;
pub mod convert;
pub mod demo;
pub mod edit;
pub mod hold;
pub mod inspect;
pub mod live;
pub mod machine;
pub mod macro_run;
pub mod offset;
pub mod operator;
pub mod plan;
pub mod post;
pub mod rebuild;
pub mod record;
pub mod registers;
pub mod run;
pub mod size;
pub mod tool;
pub mod trace;

use crate::failure::{Exit, Failure};
use crate::shop;
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use units::Millimetres;

/// How a command that did its work ends.
pub type Done = Result<Exit, Failure>;

/// An answer, and what was said about the data directory on the way.
#[derive(Serialize)]
struct WithNotices<'a, A: Serialize> {
    #[serde(flatten)]
    answer: &'a A,
    #[serde(skip_serializing_if = "Option::is_none")]
    notices: Option<Vec<String>>,
}

/// Prints the one JSON object of a command.
pub fn print_json(answer: &impl Serialize) -> Result<(), Failure> {
    let notices = shop::notices();
    let text = serde_json::to_string_pretty(&WithNotices { answer, notices })
        .map_err(|e| Failure::machine(format_args!("the answer is no JSON: {e}")))?;
    crate::say(&text);
    Ok(())
}

/// Ctrl-C, and what a system says to a service that shall end. A second Ctrl-C ends at once, as if there were no first one.
///
/// # Errors
/// The system refuses.
pub fn stopped_by_signals() -> Result<Arc<AtomicBool>, Failure> {
    use signal_hook::consts::{SIGINT, SIGTERM};
    use signal_hook::flag;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        flag::register_conditional_default(signal, Arc::clone(&stop))
            .and_then(|_| flag::register(signal, Arc::clone(&stop)))
            .map_err(|e| Failure::machine(format_args!("Ctrl-C cannot be listened for: {e}")))?;
    }
    Ok(stop)
}

/// The tolerance that the person gives.
///
/// # Errors
/// It is not a length above 0.
pub fn tolerance(given: Option<f64>) -> Result<Option<Millimetres>, Failure> {
    match given {
        Some(t) if t > 0.0 && t.is_finite() => Ok(Some(Millimetres(t))),
        Some(t) => Err(Failure::usage(format_args!(
            "--tolerance {t}: a length above 0 mm was expected"
        ))),
        None => Ok(None),
    }
}
