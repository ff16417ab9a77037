//! Conditions of a path that planning needs and the standard does not name: they stand in its `other functions`, see [`crate::write`].

use super::*;
use crate::model::{MachineFunctions, Toolpath};
use crate::write::{EXACT_STOP, TOOL_OFFSET};

impl Walker<'_> {
    /// The offset that the machine's table has under a number.
    pub(super) fn offset_of(&mut self, entity: u64, number: ToolNumber, kind: &str) -> Result<ToolOffset, Fault> {
        let program = self.program;
        let entry = self.options.tables.tools.get(&number);
        Ok(match (entry, self.options.tables.missing) {
            (Some(entry), _) => ToolOffset {
                number: number.0,
                geometry: entry.geometry.0,
                wear: entry.wear.0,
                assumed: false,
            },
            (None, Missing::Assume) => {
                let message = format!("tool {number} is not in the tool table: its length is assumed to be 0");
                let fault = Fault::new(entity, "tool-table", message, "enter the tool with its length");
                program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
                ToolOffset {
                    number: number.0,
                    assumed: true,
                    ..ToolOffset::NONE
                }
            }
            (None, Missing::Fail) => {
                let message = format!("tool {number} ({kind}) is not in the tool table");
                return Err(Fault::new(entity, "tool-table", message, "enter the tool with its length"));
            }
        })
    }

    /// Says the tool offset of a path when it is another one than before: its tool's own, or the one that it asks for.
    pub(super) fn offset_for(&mut self, path: u64, functions: Option<&MachineFunctions>) -> Result<(), Fault> {
        let condition = functions.and_then(|functions| functions.others.get(TOOL_OFFSET));
        let offset = match condition.map(|mode| (mode.as_str(), mode.parse::<u32>())) {
            None => self.run.own_offset,
            Some(("off", _)) => ToolOffset::NONE,
            Some((_, Ok(number))) => self.offset_of(path, ToolNumber(number), "an offset of its own")?,
            Some((mode, Err(_))) => {
                return Err(Fault::new(
                    path,
                    "tool-offset",
                    format!("'{mode}' is no tool offset"),
                    "write 'off' or the offset's number",
                ));
            }
        };
        if offset != self.run.offset {
            self.run.offset = offset;
            self.say(path, StepKind::ToolOffset(offset));
        }
        Ok(())
    }
}

/// How closely a path is followed.
pub(super) fn path_mode(toolpath: &Toolpath, functions: Option<&MachineFunctions>) -> PathMode {
    let condition = functions.and_then(|functions| functions.others.get(EXACT_STOP));
    match condition.map(String::as_str) {
        Some("on") => PathMode::ExactStop,
        // Half of what the path allows is the planner's to round corners with, the other half is left to the servo.
        _ => PathMode::Tolerance(toolpath.maximum_deviation.map(|most| most * 0.5)),
    }
}

/// True when an operation says itself which tool offset it runs with: it was made from a program that calls no tool.
pub(super) fn runs_without_tool(functions: Option<&MachineFunctions>) -> bool {
    functions.is_some_and(|functions| functions.others.contains_key(TOOL_OFFSET))
}

/// The conditions that are somebody else's.
pub(super) fn others(functions: Option<&MachineFunctions>) -> BTreeMap<String, String> {
    let mut others = functions.map(|functions| functions.others.clone()).unwrap_or_default();
    others.retain(|name, _| name != TOOL_OFFSET && name != EXACT_STOP);
    others
}
