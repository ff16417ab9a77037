//! One file for each command of the contract.

pub mod check;
pub mod compare;
pub mod demo;
pub mod inspect;
pub mod macro_run;
pub mod plan;
pub mod rebuild;
pub mod run;

use crate::failure::{Exit, Failure};
use serde::Serialize;
use units::Millimetres;

/// How a command that did its work ends.
pub type Done = Result<Exit, Failure>;

/// Prints the one JSON object of a command.
pub fn print_json(answer: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(answer).map_err(|e| Failure::machine(format_args!("the answer is no JSON: {e}")))?;
    crate::say(&text);
    Ok(())
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
