//! What is in a program, as plain data: the tree that `toolmark inspect --json` prints. The field names are the command's contract.
//!
//! Every reader fills the same types, so that a tree of STEP-NC and one of G-code are shown and looked through by the same code. Lengths
//! are in mm, times in s, speeds in mm/s and spindle speeds in revolutions per minute, whatever the program is written in.

use crate::{Diagnostic, Severity};
use serde::Serialize;

/// A whole program.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Inspection {
    /// `step-nc`, `iso-14649` or `gcode`.
    pub kind: &'static str,
    /// The name in FILE_SCHEMA, or the family of controls that G-code is read as.
    pub schema: String,
    /// Unit that the program is written in: `mm`, `inch`, `mixed`, `other` or `none`.
    pub units: &'static str,
    /// Counts over the plans; over the twins when the file has no plan.
    pub summary: Summary,
    /// The main workplans of all projects, plans and twins; of G-code the program.
    pub tree: Vec<Node>,
    /// The tools that the program describes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tools: Vec<ToolEntry>,
    /// Sizes, distances and geometric tolerances that the program states.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dimensions: Vec<DimensionEntry>,
    /// What was found wrong, odd or assumed, one entry a kind.
    pub problems: Vec<Problem>,
}

/// Counts of a program. What is executed twice counts twice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    /// Workingsteps that are enabled, their parents included.
    pub workingsteps_enabled: u64,
    /// Workingsteps that are not; G-code has none.
    pub workingsteps_disabled: u64,
    /// Toolpaths of the enabled ones, dwells included.
    pub toolpaths: u64,
    /// Rapid ones among them.
    pub rapids: u64,
    /// Dwells among them.
    pub dwells: u64,
    /// Tools; some writers repeat a tool for each operation, which counts once.
    pub tools: u64,
    /// Functions of the control in the tree whose meaning is not the motion's.
    pub nc_functions: u64,
}

/// A part of a program.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Node {
    /// Its instance in a STEP file, or the line of the block that began it; 0 for the whole of a text.
    pub id: u64,
    /// `program`, `workplan`, `workingstep`, `operation`, `selective`, `parallel`, `non-sequential`, `if`, `while`, `assignment`,
    /// `nc-function`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its name.
    pub name: String,
    /// False when it or a parent is disabled.
    pub enabled: bool,
    /// The tool of its operation or function, or the one in the spindle when its first toolpath begins.
    pub tool: Option<ToolName>,
    /// What is below it, in order.
    pub children: Vec<Node>,
    /// Its toolpaths, in order.
    pub toolpaths: Vec<PathEntry>,
    /// The project, on the main workplan of one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub project: Option<String>,
    /// True when it tells what happened.
    #[serde(skip_serializing_if = "is_false")]
    pub twin: bool,
    /// The planned executable of a twin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin_of: Option<u64>,
    /// Where the planned executable is, when it is in another file: `plan.stpnc#main`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin_of_uri: Option<String>,
    /// The operation of a workingstep.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub operation: Option<OperationEntry>,
    /// The function, of a function.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub function: Option<FunctionEntry>,
    /// The set-up that begins here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub setup: Option<String>,
    /// The condition of an `if` or `while`, or what an assignment assigns, as a person reads it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub condition: Option<String>,
    /// The features that a workingstep makes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub features: Vec<FeatureEntry>,
    /// People, machines, dates, approvals, placements: what else the program says of it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<NamedValue>,
    /// How long it takes as planned on a machine, s; nothing when nobody planned it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// How a tool is called.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum ToolName {
    /// Its number.
    Number(u32),
    /// Its name, when there is no number in it.
    Name(String),
}

/// A tool as the program describes it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ToolEntry {
    /// Its instance.
    pub id: u64,
    /// Its number, or its name.
    pub tool: ToolName,
    /// Its identifier in the file.
    pub name: String,
    /// `endmill`, `twist drill` ...
    #[serde(rename = "type")]
    pub kind: String,
    /// Dimensions and whatever else is said.
    pub values: Vec<NamedValue>,
}

/// A size, a distance or a geometric tolerance.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DimensionEntry {
    /// Its instance.
    pub id: u64,
    /// `diameter`, `linear distance`, `flatness tolerance` ...
    #[serde(rename = "type")]
    pub kind: String,
    /// What it is of: the names of the shape aspects.
    pub of: Vec<String>,
    /// The nominal value, mm; a geometric tolerance has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nominal_mm: Option<f64>,
    /// Signed deviation of the smallest good size, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower_mm: Option<f64>,
    /// Signed deviation of the largest good size, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper_mm: Option<f64>,
    /// A fit by its name (`H7`), where the program gives no numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<String>,
    /// How wide the zone of a geometric tolerance is, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance_mm: Option<f64>,
}

/// An operation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OperationEntry {
    /// Its instance.
    pub id: u64,
    /// The entity.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Its variant.
    pub variant: String,
    /// Depths, allowances, planes, strategies.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<NamedValue>,
}

/// A feature of the workpiece.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FeatureEntry {
    /// Its instance.
    pub id: u64,
    /// Its entity names, joined by blanks.
    #[serde(rename = "type")]
    pub kind: String,
    /// Its name.
    pub name: String,
    /// Its dimensions.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<NamedValue>,
}

/// A function of the control.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FunctionEntry {
    /// The kind.
    pub kind: String,
    /// Its text.
    pub text: String,
}

/// A toolpath: one of the file, or, where a program has none of its own, a run of moves of one kind, or a dwell.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PathEntry {
    /// Its instance, or the line of its first block.
    pub id: u64,
    /// `rapid`, `feed` or `dwell`.
    pub kind: &'static str,
    /// Its name; G-code has none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The feed, a constant multiplier included, the highest of a run; nothing on rapid paths and dwells, and where it is no speed.
    pub feed_mm_s: Option<f64>,
    /// The feed for each revolution, where it is given so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feed_mm_rev: Option<f64>,
    /// Spindle speed; 0 when it stands, nothing when the program does not say or gives a surface speed.
    pub spindle_rpm: Option<f64>,
    /// The surface speed, where it is given so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_speed_mm_s: Option<f64>,
    /// `cw`, `ccw` or `stopped`.
    pub spindle_direction: Option<&'static str>,
    /// Length of the curve; nothing when it cannot be read. Moves of machine axes (G28, G53) have none here.
    pub length_mm: Option<f64>,
    /// How long a dwell takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dwell_s: Option<f64>,
    /// `approach`, `lift`, `contact` ...
    #[serde(skip_serializing_if = "String::is_empty")]
    pub trajectory: String,
    /// How far the machine may leave the path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub maximum_deviation_mm: Option<f64>,
    /// How long it takes as planned on a machine, s; nothing when nobody planned it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// One kind of problem.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// The kind.
    pub code: &'static str,
    /// `remark`, `warning` or `error`.
    pub severity: Severity,
    /// What was found, and what to do.
    pub message: String,
    /// First place; 0 when unknown.
    pub line: u32,
    /// First place; 0 when unknown.
    pub column: u32,
    /// How often.
    pub count: u32,
}

impl From<&Diagnostic> for Problem {
    fn from(diagnostic: &Diagnostic) -> Self {
        let mut message = diagnostic.message.clone();
        if let Some(id) = diagnostic.entity {
            message = format!("#{id}: {message}");
        }
        if !diagnostic.remedy.is_empty() {
            message = format!("{message}; {}", diagnostic.remedy);
        }
        Problem {
            code: diagnostic.code,
            severity: diagnostic.severity,
            message,
            line: diagnostic.line,
            column: diagnostic.column,
            count: diagnostic.count,
        }
    }
}

impl std::fmt::Display for ToolName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ToolName::Number(number) => write!(f, "T{number}"),
            ToolName::Name(name) => write!(f, "tool '{name}'"),
        }
    }
}

fn is_false(value: &bool) -> bool {
    !value
}

/// A value with the file's name for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedValue {
    /// What the file calls it: `effective cutting diameter`, `retract plane`.
    pub name: String,
    /// Its value.
    #[serde(flatten)]
    pub value: Quantity,
    /// The smallest good value, in the unit of the value, where the program gives one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lower_limit: Option<f64>,
    /// The largest good value, in the unit of the value, where the program gives one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub upper_limit: Option<f64>,
}

/// What a named value is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Quantity {
    /// A number with a unit.
    Measure {
        /// The number, in `unit`.
        value: f64,
        /// `mm`, `s`, `deg`, `mm/s`, `rev/min`, `mm/rev`, `rev`, `mm2`, `mm3`, or empty for counts, ratios and what has another unit.
        unit: &'static str,
    },
    /// A place, mm, in the frame of what it belongs to.
    Place {
        /// X, Y and Z, mm.
        place_mm: [f64; 3],
    },
    /// A word or a sentence.
    Text {
        /// It.
        text: String,
    },
}

impl NamedValue {
    /// A text with its name.
    pub fn text(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self::new(name, Quantity::Text { text: text.into() })
    }

    /// A number with its name; for the units see [`Quantity::Measure`].
    pub fn measure(name: impl Into<String>, value: f64, unit: &'static str) -> Self {
        Self::new(name, Quantity::Measure { value, unit })
    }

    /// A value with its name and without limits.
    pub fn new(name: impl Into<String>, value: Quantity) -> Self {
        Self {
            name: name.into(),
            value,
            lower_limit: None,
            upper_limit: None,
        }
    }

    /// The unit, when it is a number: one of [`Quantity::Measure`].
    pub fn unit(&self) -> Option<&'static str> {
        match self.value {
            Quantity::Measure { unit, .. } => Some(unit),
            _ => None,
        }
    }

    /// The number, when it is one; in the unit of [`Quantity::Measure`].
    pub fn number(&self) -> Option<f64> {
        match self.value {
            Quantity::Measure { value, .. } => Some(value),
            _ => None,
        }
    }
}

impl std::fmt::Display for NamedValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ", self.name)?;
        match &self.value {
            Quantity::Measure { value, unit } => {
                write!(f, "{}", short(*value))?;
                if !unit.is_empty() {
                    write!(f, " {unit}")?;
                }
            }
            Quantity::Place { place_mm: [x, y, z] } => write!(f, "({} {} {})", short(*x), short(*y), short(*z))?,
            Quantity::Text { text } => write!(f, "{text}")?,
        }
        match (self.lower_limit, self.upper_limit) {
            (None, None) => Ok(()),
            (lower, upper) => {
                let say = |limit: Option<f64>| limit.map_or("..".to_owned(), |limit| short(limit).to_string());
                write!(f, " [{} to {}]", say(lower), say(upper))
            }
        }
    }
}

/// A number for people: a ten-thousandth is enough.
fn short(number: f64) -> f64 {
    let rounded = (number * 1e4).round() / 1e4;
    if rounded.is_finite() && rounded != 0.0 {
        rounded
    } else {
        number
    }
}
