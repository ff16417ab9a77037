//! What a control is to the post-processor. A control is one file and one line in [`crate::CONTROLS`].

use crate::functions::{Log, Reading};
use crate::grade::Verdict;
use crate::sheet::{Paper, Refusal, Sheet};
use crate::statement::Statement;
use plan::Expression;

/// A family of controls.
pub trait Control: Sync {
    /// Its name on the command line.
    fn name(&self) -> &'static str;

    /// What it is, for people.
    fn about(&self) -> &'static str;

    /// Ending of its program files.
    fn ending(&self) -> &'static str;

    /// How its programs look.
    fn paper(&self) -> Paper;

    /// Writes one statement.
    ///
    /// # Errors
    /// It cannot be said on this control.
    fn write(&self, statement: &Statement<'_>, sheet: &mut Sheet<'_>) -> Result<(), Refusal>;

    /// What a program reads a sensor or a predefined value by, between blocks.
    fn reading(&self, sensor: &str) -> Reading;

    /// Writes a line into the program's log.
    fn log(&self, log: &Log, sheet: &mut Sheet<'_>) -> Result<(), Refusal>;

    /// A value into a variable of the program: the text of a variable by its number.
    fn variable(&self, number: u32) -> Result<String, Refusal>;

    /// `variable = value`, both as the control writes them.
    fn assignment(&self, variable: &str, value: &str) -> String;

    /// A condition or value as the control writes it.
    ///
    /// # Errors
    /// A name that this control cannot read, or an operation that it does not have.
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<String, Refusal>;

    /// What this control has of its own for a function; `None` leaves it to what plain variables and the log can do.
    fn function(&self, function: &trace::Function, sheet: &mut Sheet<'_>) -> Option<Verdict>;
}
