//! Macro programs for a real control, from a job: the two published methods with their mistakes put right.
//!
//! - [`Method::TWord`]: a set-up program fills a table of named variables; every T word calls O9000, which hands the T value to a worker
//!   with local variables of its own and then indexes the turret, once.
//! - [`Method::G65`]: the worker is called before the turret index of an existing program; sizes are typed into a secondary offset.
//!
//! What both keep, and why: vacant is looked for before 0, because vacant is not EQ 0. The entry is taken and cleared before the offset is
//! written, so that no power loss applies it twice; a mark says when that was interrupted. The window comes from the job, the change is
//! limited and in whole steps of the register, with the dimension's own sign and factor. The offset number is the last two digits of the T
//! word. The set-up writes its job's number last, and a program of another job stops.
//!
//! Sizes that move one register by their mean wait for each other: the register moves when all of them are entered, once. On a mill a T
//! word names a tool; the registers are the wear of H and D.
//!
//! What is not generated is refused: a register that the control has no variable for, two registers that are one on the control, or a
//! window that holds 0, which is the control's word for nothing entered. Read on: [`t_word`] and [`call`] for the programs, [`layout`] for their variables, [`insert`] for changing a
//! program. That they do what [`crate::enter`] does is proven in `cell::proof`.

pub mod call;
pub mod insert;
pub mod layout;
pub mod t_word;

use crate::control::Control;
use crate::{Dimension, Job, Role, Unit};
use layout::Layout;
use std::fmt::Write;
use thiserror::Error;
use units::{MM_PER_INCH, Millimetres};

/// How the sizes get to the offsets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Named variables, and a macro that every T word calls.
    TWord,
    /// A macro that is called before the turret index.
    G65,
}

/// Alarm of a size at or below the window.
pub const TOO_SMALL: u32 = 100;
/// Alarm of a size at or above the window.
pub const TOO_BIG: u32 = 101;
/// Alarm of a change beyond the largest single step.
pub const STEP_TOO_LARGE: u32 = 102;
/// Alarm of a program that is not of the job whose set-up was run.
pub const ANOTHER_JOB: u32 = 103;
/// Alarm after a power loss in the middle of an entry.
pub const INTERRUPTED: u32 = 104;
/// Alarm of a control in the other unit.
pub const WRONG_UNIT: u32 = 105;

/// Number of the worker of [`Method::TWord`], and of the macro that the T word calls.
pub const T_WORD_WORKER: u32 = 9010;
/// O9000 is fixed by the control (parameter 6001.5).
pub const T_WORD_MACRO: u32 = 9000;
/// Number of the worker of [`Method::G65`], as published.
pub const G65_WORKER: u32 = 8002;

/// Programs for a control, and what a person and a proof have to know of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Generated {
    /// How they work.
    pub method: Method,
    /// The set-up program.
    pub setup: MacroProgram,
    /// The macros, loaded once for all jobs.
    pub macros: Vec<MacroProgram>,
    /// The variables they use.
    pub layout: Layout,
    /// The dimensions that they size, in the order of their numbers.
    pub dimensions: Vec<Dimension>,
    /// The unit of the control.
    pub unit: Unit,
    /// The job's number.
    pub job: u32,
}

/// A program with its number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MacroProgram {
    /// O number.
    pub number: u32,
    /// Text, without the `%` at either end.
    pub text: String,
}

impl MacroProgram {
    /// Its name as a file: `O0200.nc`.
    pub fn file_name(&self) -> String {
        format!("O{:04}.nc", self.number)
    }
    /// Its text as a file, between `%`.
    pub fn file(&self) -> String {
        format!("%\n{}%\n", self.text)
    }
}

/// How the set-up program ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetupEnd {
    /// It is run by hand.
    M30,
    /// It is called by another program; run by hand it would go round for ever.
    M99,
}

/// Why no programs can be made.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum GenerateError {
    /// Nothing to size.
    #[error("job {0:?} has no dimension that controls an offset: there is nothing to generate")]
    Nothing(String),
    /// One dimension cannot be done on this control.
    #[error("dimension {name:?}: {what}")]
    Dimension {
        /// Which.
        name: String,
        /// Why, and what to do.
        what: String,
    },
    /// Not enough variables.
    #[error(
        "{control} has {have} variables for sizing (#{first} to #{last}), room for {most} dimensions; {dimensions} take {need}: give the \
         profile a larger range if the control has one, or split the job"
    )]
    NoRoom {
        /// Which control.
        control: String,
        /// How many it has.
        have: u32,
        /// The first.
        first: u32,
        /// The last.
        last: u32,
        /// How many dimensions.
        dimensions: usize,
        /// How many there is room for, ten at most.
        most: u32,
        /// How many they take.
        need: u32,
    },
    /// The program to be changed does not fit.
    #[error("{0}")]
    Program(String),
}

/// Makes the programs of a job for a control.
///
/// # Errors
/// A dimension cannot be done there, or the control has too few variables.
pub fn generate(job: &Job, control: &Control, method: Method, end: SetupEnd) -> Result<Generated, GenerateError> {
    let dimensions = in_groups(&job.dimensions);
    if dimensions.is_empty() {
        return Err(GenerateError::Nothing(job.name.clone()));
    }
    for (index, dimension) in dimensions.iter().enumerate() {
        possible(index, &dimensions, control, method).map_err(|what| GenerateError::Dimension {
            name: dimension.name.clone(),
            what,
        })?;
    }
    let mut layout = Layout::new(&dimensions, control)?;
    if method == Method::G65 {
        layout.names = call::names(&layout, dimensions.len());
    }
    let (setup, macros) = match method {
        Method::TWord => (
            t_word::setup(job, &dimensions, &layout, control, end),
            t_word::macros(&layout, control),
        ),
        Method::G65 => (
            call::setup(job, &dimensions, &layout, control, end),
            vec![call::worker(&layout, control)],
        ),
    };
    Ok(Generated {
        method,
        setup,
        macros,
        layout,
        dimensions,
        unit: job.unit,
        job: job.number,
    })
}

/// The dimensions that move registers; those that share one stand together.
fn in_groups(all: &[Dimension]) -> Vec<Dimension> {
    let mut ordered: Vec<Dimension> = Vec::new();
    for dimension in all.iter().filter(|d| d.role != Role::Watch) {
        let behind = ordered.iter().rposition(|d| d.register == dimension.register);
        ordered.insert(behind.map_or(ordered.len(), |at| at + 1), dimension.clone());
    }
    ordered
}

/// Largest offset that a control of three digits before the point takes: 999.999 mm, 99.9999 inch.
fn largest_entry(unit: Unit) -> Millimetres {
    match unit {
        Unit::Mm => Millimetres(999.999),
        Unit::Inch => Unit::Inch.length(99.9999),
    }
}

fn possible(index: usize, all: &[Dimension], control: &Control, method: Method) -> Result<(), String> {
    let dimension = &all[index];
    let Some(register) = control.register_of(dimension) else {
        return Err(format!(
            "{} knows no variable for {} that a macro may write",
            control.name, dimension.column
        ));
    };
    if dimension.window.0.0 <= 0.0 && dimension.window.1.0 >= 0.0 {
        return Err("its entry window holds 0, which is the control's word for nothing entered".to_owned());
    }
    if dimension.increment != all[0].increment {
        return Err(format!("its finest step is not that of {:?}: a control has one", all[0].name));
    }
    // On a lathe the offset is the last two digits of the T word.
    let last = if control.mill {
        control.offsets
    } else {
        control.offsets.min(99)
    };
    if dimension.offset > last {
        return Err(format!("{} has offsets 1 to {last}, not {}", control.name, dimension.offset));
    }
    if control.mill && dimension.tool.0 == 0 {
        return Err("there is no tool 0 that a T word could call".to_owned());
    }
    for other in &all[..index] {
        let same = other.register == dimension.register;
        if !same && control.register_of(other) == Some(register) {
            return Err(format!(
                "{} keeps {} and {} of offset {} in one place, #{register}, which {:?} moves too: give it another offset number",
                control.name, dimension.column, other.column, dimension.offset, other.name
            ));
        }
        if same && (other.largest_step != dimension.largest_step || control.called_by(other) != control.called_by(dimension)) {
            return Err(format!(
                "it moves {} by a mean with {:?}: both need the same tool and the same largest_step",
                dimension.register, other.name
            ));
        }
    }
    if method == Method::TWord {
        return Ok(());
    }
    let secondary = call::entry_offset(all, index, control);
    let place = call::entry_variable(all, index, control);
    let taken =
        |k: usize| control.register_of(&all[k]) == Some(place) || k < index && call::entry_variable(all, k, control) == place;
    if secondary > control.offsets || (0..all.len()).any(taken) {
        return Err(format!(
            "its sizes would be typed into offset {secondary}, which {} does not have or this job uses: set `secondary` in the \
             control's profile",
            control.name
        ));
    }
    if dimension.window.1 > largest_entry(dimension.unit) || dimension.window.0 < -largest_entry(dimension.unit) {
        return Err(format!(
            "its sizes would be typed into an offset, which holds {} at most: use the method t-word",
            dimension.unit.words(largest_entry(dimension.unit))
        ));
    }
    Ok(())
}

/// Whole steps of the register in one unit of the control: 1000 for 0.001 mm, 10000 for 0.0001 in.
pub fn steps_per_unit(dimension: &Dimension) -> f64 {
    libm::round(1e6 / in_unit(dimension.unit, dimension.increment)) / 1e6
}

/// The largest single step of a dimension in whole steps of its register.
pub fn largest_steps(dimension: &Dimension) -> f64 {
    libm::floor(dimension.largest_step / dimension.increment + 1e-6)
}

/// A length in the control's unit, without the dust of the conversion.
pub fn in_unit(unit: Unit, length: Millimetres) -> f64 {
    let number = match unit {
        Unit::Mm => length.0,
        Unit::Inch => length.0 / MM_PER_INCH,
    };
    libm::round(number * 1e8) / 1e8
}

/// A number as controls take it: always with a point, because without one it would count least increments; at most eight digits behind.
pub fn number(value: f64) -> String {
    let text = format!("{value:.8}");
    let text = text.trim_end_matches('0');
    if text == "-0." { "0.".to_owned() } else { text.to_owned() }
}

/// Text for a comment: what a control shows, and no bracket that would end it.
pub fn comment(text: &str) -> String {
    let shown = text.chars().map(|c| match c.to_ascii_uppercase() {
        c if c.is_ascii_alphanumeric() || " +-/.,=#".contains(c) => c,
        _ => ' ',
    });
    shown.collect::<String>().trim().to_owned()
}

/// The lines that stop a control that is in the other unit.
fn unit_check(out: &mut String, wanted: &str, jump: u32) {
    let _ = writeln!(out, "IF[#4006EQ{wanted}]GOTO{jump}");
    let _ = writeln!(out, "#3000={WRONG_UNIT}(CONTROL IS IN THE OTHER UNIT)");
}

/// G20 or G21, as #4006 tells it.
pub fn unit_code(unit: Unit) -> u32 {
    match unit {
        Unit::Inch => 20,
        Unit::Mm => 21,
    }
}

/// The line that a DPRNT device gets for each entry that was used.
fn printed(job: &str, dimension: &str, called: &str, size: &str, from: &str, by: &str, count: &str) -> String {
    format!("DPRNT[SIZE*JOB{job}[40]*DIM{dimension}[20]*{called}[20]*IS{size}[35]*FROM{from}[35]*BY{by}[35]*N{count}[50]]")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::tests::{PUBLISHED, lathe};

    fn published() -> Job {
        Job::parse(PUBLISHED, "job.toml", &lathe()).expect("good")
    }

    #[track_caller]
    fn check_refused(change: impl Fn(&mut Job, &mut Control), method: Method, expected: &str) {
        let (mut job, mut control) = (published(), Control::built_in()[0].clone());
        generate(&job, &control, method, SetupEnd::M30).expect("good before the change");
        change(&mut job, &mut control);
        let refused = generate(&job, &control, method, SetupEnd::M30)
            .expect_err(expected)
            .to_string();
        assert!(refused.contains(expected), "{refused}");
    }

    #[test]
    fn what_a_control_cannot_do_is_refused() {
        use Method::{G65, TWord};
        check_refused(|j, _| j.dimensions[0].role = Role::Watch, TWord, "nothing to generate");
        check_refused(
            |j, c| {
                j.dimensions[0].column = crate::Column::CutterRadius;
                c.wear_radius = None;
            },
            TWord,
            "no variable for wear of the radius",
        );
        check_refused(
            |j, c| {
                let mut length = j.dimensions[0].clone();
                length.column = crate::Column::Wear(units::Axis::Z);
                length.register = "mill/tool/5/wear/z_mm".into();
                j.dimensions[0].column = crate::Column::CutterRadius;
                j.dimensions.push(length);
                *c = Control::find("fanuc-mill-a").expect("built in");
            },
            TWord,
            "in one place, #2005",
        );
        check_refused(
            |j, _| {
                let mut other = j.dimensions[0].clone();
                (other.name, other.role, other.largest_step) = ("DIM B".into(), Role::Mean, Millimetres(9.0));
                j.dimensions[0].role = Role::Mean;
                j.dimensions.push(other);
            },
            TWord,
            "same largest_step",
        );
        check_refused(
            |j, _| j.dimensions[0].window.1 = crate::Unit::Inch.length(120.0),
            G65,
            "use the method t-word",
        );
        check_refused(|j, _| j.dimensions[0].window.0 = Millimetres(-1.0), TWord, "holds 0");
        check_refused(|j, _| j.dimensions[0].offset = 65, TWord, "offsets 1 to 64, not 65");
        check_refused(|j, _| j.dimensions[0].offset = 45, G65, "typed into offset 65");
        check_refused(
            |_, c| c.kept = [500, 510],
            TWord,
            "has 11 variables for sizing (#500 to #510), room for 0 dimensions; 1 take 14",
        );
    }

    #[test]
    fn macros_that_were_loaded_once_serve_every_job_of_a_control() {
        let (one, mut two) = (published(), published());
        let mut second = two.dimensions[0].clone();
        (second.name, second.offset, second.column) = ("DIM B".into(), 7, crate::Column::Wear(units::Axis::Z));
        second.register = "lathe/tool/7/wear/z_mm".into();
        two.dimensions.push(second);
        let control = Control::built_in()[0].clone();
        for method in [Method::TWord, Method::G65] {
            let macros = |job: &Job| generate(job, &control, method, SetupEnd::M30).expect("possible").macros;
            assert_eq!(macros(&one), macros(&two));
        }
    }

    #[test]
    fn numbers_carry_a_point_and_comments_no_bracket() {
        assert_eq!(number(5.0), "5.");
        assert_eq!(number(3.2342), "3.2342");
        assert_eq!(number(-0.0), "0.");
        assert_eq!(comment("dim (a) ø20"), "DIM  A   20");
        assert_eq!(steps_per_unit(&published().dimensions[0]), 10_000.0);
        assert_eq!(largest_steps(&published().dimensions[0]), 50.0);
    }
}
