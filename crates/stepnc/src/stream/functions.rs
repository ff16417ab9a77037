//! NC functions: stops, messages, marks, tool and pallet calls, and the lines of others, with the present values of the variables that they name.

use super::*;

impl Walker<'_> {
    pub(super) fn function(&mut self, executable: &Executable, function: &Function) -> Outcome {
        let (program, id) = (self.program, executable.id);
        match function.kind.as_str() {
            "display message" => self.say(id, StepKind::Message(function.text.clone())),
            "program stop" => self.say(id, StepKind::Stop(StopKind::Program)),
            "optional stop" if self.run.structured => self.say(id, StepKind::Stop(StopKind::Optional)),
            "optional stop" => {
                self.run.pending = Some(Pending::OptionalStop(id));
                return Ok(Some(Question::OptionalStop));
            }
            "load tool" => {
                let tool = program.tool_of(id).ok_or_else(|| {
                    Fault::new(
                        id,
                        "no-tool",
                        format!(
                            "'{}' loads a tool and no MACHINING_TOOL names it as its user",
                            executable.name
                        ),
                        "add it to the users of the tool",
                    )
                })?;
                self.change_tool(id, tool)?;
            }
            "unload tool" => {
                self.lift(id);
                self.rest();
                self.run.tool = Some(ToolNumber(0));
                self.run.offset = ToolOffset::NONE;
                self.run.own_offset = ToolOffset::NONE;
                self.say(
                    id,
                    StepKind::Tool(ToolCall {
                        number: ToolNumber(0),
                        name: String::new(),
                        diameter: None,
                    }),
                );
                self.say(id, StepKind::ToolOffset(ToolOffset::NONE));
            }
            _ => {
                let properties = self.properties_of(function);
                self.forget_written(&function.text);
                self.say(
                    id,
                    StepKind::NcFunction(RawNcFunction {
                        kind: function.kind.clone(),
                        name: executable.name.clone(),
                        text: function.text.clone(),
                        condition: function.condition.clone(),
                        properties,
                    }),
                );
            }
        }
        Ok(None)
    }

    /// From here on only the machine knows what the function writes: a condition asks for it.
    pub(super) fn forget_written(&mut self, line: &str) {
        for variable in plan::written::written(line) {
            self.run.variables.remove(&variable.name);
        }
    }

    /// Its properties, and the present values of the variables that its line may name: a condition is made of them when it is started. A
    /// program that is told with both ways of its branches has no present.
    fn properties_of(&self, function: &Function) -> BTreeMap<String, String> {
        let mut all = function.properties.clone();
        if plan::line::is_line(&function.text) && !self.run.structured {
            let typed = function.condition.as_ref().and_then(|condition| condition.as_ref().ok());
            let named = self
                .run
                .variables
                .iter()
                .filter(|(name, _)| function.text.contains(name.as_str()) || typed.is_some_and(|typed| names(typed, name)));
            all.extend(named.map(|(name, value)| (format!("{}{name}", RawNcFunction::VARIABLE), value.to_string())));
        }
        all
    }
}
