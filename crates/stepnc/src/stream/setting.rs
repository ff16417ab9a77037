//! Tools, spindle speeds and feeds: what a program sets before it cuts.

use super::*;
use std::collections::BTreeSet;

impl Walker<'_> {
    /// Stops spindle and coolant where they run.
    pub(super) fn rest(&mut self) {
        if self.run.spindle != Some(SpindleState::Stopped) {
            self.run.spindle = Some(SpindleState::Stopped);
            self.say(0, StepKind::Spindle(SpindleState::Stopped));
        }
        if self.run.coolant != Some(CoolantState::default()) {
            self.run.coolant = Some(CoolantState::default());
            self.say(0, StepKind::Coolant(CoolantState::default()));
        }
    }

    pub(super) fn tool_for(&mut self, operation: &Operation) -> Result<(), Fault> {
        let program = self.program;
        match program.tool_of(operation.id) {
            Some(tool) => self.change_tool(operation.id, tool),
            None if operation.is_rapid_movement() => Ok(()),
            None if self.run.tool.is_some_and(|tool| tool != ToolNumber(0)) => {
                let message = format!("operation '{}' names no tool: the one in the spindle is used", operation.name);
                let fault = Fault::new(operation.id, "no-tool", message, "add the operation to the users of its tool");
                program.note(&mut self.run.diagnostics, Severity::Warning, &fault);
                Ok(())
            }
            // It says itself that there is none: it was made from a program without a tool.
            None if super::conditions::runs_without_tool(operation.functions.and_then(|id| program.functions(id))) => Ok(()),
            None => Err(Fault::new(
                operation.id,
                "no-tool",
                format!("operation '{}' has no tool", operation.name),
                "add the operation to the users of a MACHINING_TOOL, or load a tool before",
            )),
        }
    }

    /// A number for a tool that the file only names: the next free one in the order of the file, where something may be assumed.
    fn assumed_number(&mut self, tool: &Tool) -> Result<ToolNumber, Fault> {
        let program = self.program;
        let nameless = |message: String| {
            Fault::new(
                tool.id,
                "tool-number",
                message,
                "give the number in its identifier or as its tool position",
            )
        };
        let is = format!("tool '{}' ({}) has no number", tool.name, tool.kind);
        if self.options.tables.missing == Missing::Fail {
            return Err(nameless(is));
        }
        let mut taken: BTreeSet<u32> = program.tools().iter().filter_map(|tool| Some(tool.number?.0)).collect();
        let mut names: Vec<&str> = Vec::new();
        for other in program.tools().iter().filter(|other| other.number.is_none()) {
            if !names.contains(&other.name.as_str()) {
                names.push(&other.name);
            }
        }
        let mut number = 0;
        for name in names {
            number = (1..).find(|free| !taken.contains(free)).unwrap_or(u32::MAX);
            taken.insert(number);
            if name == tool.name {
                break;
            }
        }
        program.note(
            &mut self.run.diagnostics,
            Severity::Warning,
            &nameless(format!("{is}: T{number} is assumed")),
        );
        Ok(ToolNumber(number))
    }

    pub(super) fn change_tool(&mut self, entity: u64, tool: &Tool) -> Result<(), Fault> {
        let number = match tool.number {
            Some(number) => number,
            None => self.assumed_number(tool)?,
        };
        if self.run.tool == Some(number) {
            return Ok(());
        }
        let offset = self.offset_of(tool.id, number, &tool.kind)?;
        self.lift(entity);
        self.rest();
        self.run.tool = Some(number);
        self.run.offset = offset;
        self.run.own_offset = offset;
        self.say(
            entity,
            StepKind::Tool(ToolCall {
                number,
                name: tool.kind.clone(),
                diameter: tool.diameter,
            }),
        );
        self.say(entity, StepKind::ToolOffset(offset));
        Ok(())
    }
}

pub(super) fn spindle_state(
    path: u64,
    setting: SpindleSetting,
    tool: Option<&Tool>,
    operation: &Operation,
    spindle_limit: Rpm,
) -> Result<SpindleState, Fault> {
    let turning = |clockwise: bool, mode: SpindleMode| match clockwise {
        true => SpindleState::Clockwise(mode),
        false => SpindleState::Counterclockwise(mode),
    };
    match setting {
        SpindleSetting::Stopped => Ok(SpindleState::Stopped),
        SpindleSetting::Revolutions { speed, clockwise } => Ok(turning(clockwise, SpindleMode::Revolutions(speed))),
        SpindleSetting::Surface { speed, limit, clockwise } if operation.turns() || tool.is_some_and(turns) => {
            let limit = limit.unwrap_or(spindle_limit);
            Ok(turning(clockwise, SpindleMode::Surface { speed, limit }))
        }
        SpindleSetting::Surface { speed, limit, clockwise } => {
            // Milling: the edge turns with the tool, so its diameter makes revolutions of it.
            let diameter = tool
                .and_then(|tool| tool.diameter)
                .filter(|diameter| diameter.0 > 0.0)
                .ok_or_else(|| {
                    Fault::new(
                        path,
                        "surface-speed",
                        "a cutting speed needs the cutting diameter of the tool, which is not in the file",
                        "give the tool its effective cutting diameter, or the spindle speed in revolutions",
                    )
                })?;
            let revolutions = Rpm(speed.0 / (std::f64::consts::PI * diameter.0) * 60.0);
            let revolutions = limit.map_or(revolutions, |limit| revolutions.min(limit));
            Ok(turning(clockwise, SpindleMode::Revolutions(revolutions)))
        }
    }
}

pub(super) fn feed(path: u64, toolpath: &Toolpath, feed: Option<FeedSetting>, tool: Option<&Tool>) -> Result<Feed, Fault> {
    let feed = match feed {
        Some(FeedSetting::PerTime(speed)) => Feed::PerTime(speed),
        Some(FeedSetting::PerRevolution(length)) => Feed::PerRevolution(length),
        Some(FeedSetting::PerTooth(length)) => {
            let teeth = tool.and_then(|tool| tool.teeth).ok_or_else(|| {
                Fault::new(
                    path,
                    "feed-per-tooth",
                    "a feed per tooth needs the number of teeth of the tool, which is not in the file",
                    "give the tool its number of effective teeth",
                )
            })?;
            Feed::PerRevolution(length * teeth)
        }
        None => {
            return Err(Fault::new(
                path,
                "no-feed",
                format!("toolpath '{}' cuts and its technology has no feed", toolpath.name),
                "give the technology of the path or of its operation a feed, or mark the path as rapid",
            ));
        }
    };
    let size = match feed {
        Feed::PerTime(speed) => speed.0,
        Feed::PerRevolution(length) | Feed::Thread(plan::Thread { advance: length, .. }) => length.0,
        Feed::WholeMove(time) => time.0,
    };
    if size <= 0.0 {
        return Err(Fault::new(
            path,
            "no-feed",
            format!("toolpath '{}' cuts with a feed of 0", toolpath.name),
            "give its technology a feed, or mark the path as rapid",
        ));
    }
    Ok(feed)
}

/// Is it a turning tool?
fn turns(tool: &Tool) -> bool {
    tool.kind.contains("turning")
}
