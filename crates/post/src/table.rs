//! The manual's table: the example of every function, posted to every control.

use crate::control::Control;
use crate::grade::Row;
use crate::posting::{Options, post};
use plan::flow::{Part, StructuredProgram};
use plan::{Alarm, Diagnostic, FileId, Level, Marker, Origin, Place, RawNcFunction, Step, StepKind};
use trace::{Definition, FUNCTIONS};
use units::StepId;

/// A program of nothing but one line, with what has to stand before it.
struct Lines {
    parts: std::vec::IntoIter<StepKind>,
    step: u32,
}

impl StructuredProgram for Lines {
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>> {
        let Some(kind) = self.parts.next() else { return Ok(None) };
        self.step += 1;
        Ok(Some(Part::Step(Step {
            id: StepId(self.step),
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            kind,
        })))
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "example"
    }
}

/// Function lines inside a workingstep of a program.
pub fn program_of(lines: &[&str]) -> Box<dyn StructuredProgram> {
    let begin = |level, name: &str| {
        StepKind::Begin(Marker {
            level,
            name: name.to_owned(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        })
    };
    let mut parts = vec![begin(Level::Program, "example"), begin(Level::Workingstep, "WS 1")];
    parts.extend(lines.iter().map(|line| {
        StepKind::NcFunction(RawNcFunction {
            kind: "extended function".to_owned(),
            name: String::new(),
            text: (*line).to_owned(),
            condition: None,
            properties: Default::default(),
        })
    }));
    parts.push(StepKind::End(Level::Workingstep));
    parts.push(StepKind::End(Level::Program));
    Box::new(Lines {
        parts: parts.into_iter(),
        step: 0,
    })
}

/// The example of a function with the start that its stop belongs to.
pub fn example(definition: &Definition) -> Vec<&'static str> {
    let start = match definition.name {
        "stop_tool_logging" => Some("start_tool_logging"),
        "stop_sensor_recording" => Some("start_sensor_recording"),
        "stop_synchronized_action" => Some("start_synchronized_action"),
        _ => None,
    };
    let start = start.and_then(trace::functions::find).map(|start| start.example);
    start.into_iter().chain([definition.example]).collect()
}

/// How a control does a function's example: its grade and its text.
///
/// # Errors
/// The example cannot be posted at all.
pub fn posted(definition: &Definition, control: &dyn Control) -> Result<(Row, String), Box<Diagnostic>> {
    let lines = example(definition);
    let mut text = String::new();
    let options = Options {
        source: "example".to_owned(),
        ..Options::default()
    };
    let found = post(control, &mut |_| Ok(program_of(&lines)), &options, &mut |line| {
        text.push_str(line)
    })?;
    let row = found.functions.into_iter().find(|row| row.name == definition.name);
    row.map(|row| (row, text)).ok_or_else(|| {
        Box::new(Diagnostic::error(
            "no-grade",
            format!("{} was posted without a grade", definition.name),
        ))
    })
}

/// The table as the manual shows it: a row for each function, a column for each control, then the reasons.
///
/// # Errors
/// An example cannot be posted.
pub fn markdown(controls: &[&dyn Control]) -> Result<String, Box<Diagnostic>> {
    let mut table = String::from("| function |");
    for control in controls {
        table += &format!(" {} |", control.name());
    }
    table += "\n| --- |";
    table += &" --- |".repeat(controls.len());
    table += "\n";
    let mut reasons = String::new();
    for definition in FUNCTIONS {
        table += &format!("| `{}` |", definition.name);
        reasons += &format!("\n**`{}`**", definition.name);
        for control in controls {
            let (row, _) = posted(definition, *control)?;
            let mark = if row.verified { "" } else { " *" };
            table += &format!(" {}{mark} |", row.grade);
            reasons += &format!("\n- {}: {}{mark}: {}", control.name(), row.grade, row.reason);
        }
        table += "\n";
        reasons += "\n";
    }
    Ok(format!("{table}{reasons}"))
}
