//! What a control is to the post-processor. A control is one file and one line in [`crate::CONTROLS`].

use crate::functions::{Item, Reading};
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

    /// The axes square to the planes in which it has arcs.
    fn arc_planes(&self) -> &'static [usize] {
        &[0, 1, 2]
    }

    /// What it calls the n-th work offset, from 1.
    fn work_name(&self, number: u32) -> String;

    /// The variable of a program with this number, from 0.
    ///
    /// # Errors
    /// There are not so many.
    fn variable(&self, number: u32) -> Result<String, Refusal>;

    /// `variable = value`, both as the control writes them.
    fn assignment(&self, variable: &str, value: &str) -> String {
        format!("{variable}={value}")
    }

    /// A condition as the control writes it, between blocks; for assignments too.
    ///
    /// # Errors
    /// A name that this control cannot read, or an operation that it does not have.
    fn expression(&self, expression: &Expression, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal>;

    /// How its programs come by a stream (`X.LOAD`) or a predefined value (`trace:ws_time`).
    fn reading(&self, stream: &str, turning: bool) -> Reading;

    /// What makes the control wait for the motion before it reads this value.
    fn before_reading(&self, _text: &str) -> Option<&'static str> {
        None
    }

    /// Sets a timer to zero: of the workingstep, the operation, the program.
    fn start_timer(&self, timer: usize) -> Vec<String>;

    /// Writes a line into the program's log, and before it what its values need; gives whether its words are known from a manual.
    ///
    /// # Errors
    /// The control cannot write this.
    fn log(&self, items: &[Item], sheet: &mut Sheet<'_>) -> Result<bool, Refusal>;

    /// What its tool table tells of a tool, the one in the spindle when `None`.
    fn tool_data(&self, tool: Option<u32>) -> Option<Vec<(&'static str, Reading)>>;

    /// What records beside it.
    fn recorder(&self) -> &'static str;

    /// Values of sensors are looked at between blocks where a recording is asked for.
    fn polls(&self) -> bool {
        false
    }

    /// Conditions are checked between blocks where a synchronized action is asked for.
    fn checks(&self) -> bool {
        true
    }

    /// What this control has of its own for a function, written at once; `None` leaves it to what plain variables and the log can do.
    ///
    /// # Errors
    /// It has something and this line does not fit on it.
    fn function(&self, function: &trace::Function, sheet: &mut Sheet<'_>) -> Result<Option<Verdict>, Refusal>;
}

/// The number of a work offset by the name that G-code has for it: `G54` is 1, `G54.1 P1` is 7.
pub fn work_number(name: &str) -> Option<u32> {
    if let Some(more) = name.strip_prefix("G54.1 P") {
        return more.parse::<u32>().ok().map(|p| p.saturating_add(6));
    }
    let number: u32 = name.strip_prefix('G')?.parse().ok()?;
    (54..=59).contains(&number).then(|| number - 53)
}
