//! A program with its control flow kept: what a stream decides on its way, said as structure.
//!
//! A [`crate::ProgramStream`] asks the machine and goes one way. Who writes the program down for another control needs both ways: the
//! parts of a [`StructuredProgram`] tell each branch and each loop body once, in the order of the program.

use crate::{Alarm, Diagnostic, Expression, FileId, Origin, Step};

/// One part of a program.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// A step, numbered as it is told, from 1.
    Step(Step),
    /// A border of the control flow, or an assignment to a variable of the program.
    Flow(Origin, Flow),
}

/// What happens to the order of the parts.
#[derive(Clone, Debug, PartialEq)]
pub enum Flow {
    /// The parts up to [`Flow::Otherwise`] or [`Flow::EndIf`] when this holds.
    If(Expression),
    /// The parts up to [`Flow::EndIf`] when it does not.
    Otherwise,
    /// Both ways meet. What differs between their ends is said again by the steps that follow.
    EndIf,
    /// The parts up to [`Flow::EndWhile`] again and again, as long as this holds.
    While(Expression),
    /// The end of the loop's body.
    EndWhile,
    /// A variable of the program gets a value.
    Assign {
        /// Its name.
        variable: String,
        /// The value, with the names of other variables and of sensors.
        value: Expression,
    },
    /// Where the tool is depends on the way that was taken, or a tool is changed: it goes out of the way first. The link that follows
    /// says where to; its first piece begins nowhere in particular.
    Retract,
}

/// A program that tells its parts.
pub trait StructuredProgram {
    /// The next part; `None` behind the last one.
    ///
    /// # Errors
    /// The program cannot be told to its end.
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>>;

    /// What was found wrong, odd or assumed up to here.
    fn diagnostics(&self) -> &[Diagnostic];

    /// The name of a file that an [`Origin`] speaks of.
    fn file_name(&self, file: FileId) -> &str;
}
