//! Tool calls, with the words that a program has for them, and the workingsteps that they begin.

use super::*;
use crate::line::Line;
use plan::RawNcFunction;
use plan::comment::Comment;

impl Interpreter {
    pub(super) fn set_tool(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(t) = block.take(b'T') else { return Ok(()) };
        if self.profile.turning {
            let value = Self::whole(t, 'T', 9999)?;
            self.trace.tool = Some(value);
            let (station, offset) = (value / 100, value % 100);
            if station != 0 && self.tool != Some(station) {
                let words = self.tool_words(block, site);
                self.put_tool(station, words, t.at, site)?;
            }
            return self.select_turning_offset(offset, t.at, site);
        }
        let number = Self::whole(t, 'T', 99_999_999)?;
        self.trace.tool = Some(number);
        let words = self.tool_words(block, site);
        self.preselected = Some((number, words));
        Ok(())
    }

    pub(super) fn change_tool(&mut self, at: usize, block: &Block, site: Site<'_>) -> Outcome<()> {
        let Some((number, mut words)) = self.preselected.clone() else {
            return Err(Fault::new(
                at,
                0,
                "no-tool",
                "M6 without a tool: no T word came before",
                "write T and the tool's number before M6",
            ));
        };
        if words.is_empty() {
            words = self.tool_words(block, site);
        }
        self.put_tool(number, words, at, site)
    }

    pub(super) fn put_tool(&mut self, number: u32, words: String, at: usize, site: Site<'_>) -> Outcome<()> {
        let entry = self.tables.tools.get(&ToolNumber(number)).cloned();
        if entry.is_none() && number != 0 {
            self.missing("missing-tool", site, at, &format!("tool {number}"), "a tool of that number")?;
        }
        let entry = entry.unwrap_or_default();
        // A tool is never changed with the spindle turning, whatever the program says.
        if !self.profile.turning {
            self.turning = Turning::Stopped;
            self.say_spindle();
        }
        let name = if words.is_empty() { entry.name } else { words };
        self.begin_workingstep(step_name(number, &name));
        self.comments.clear();
        self.tool = Some(number);
        self.emit(StepKind::Tool(ToolCall {
            number: ToolNumber(number),
            name,
            diameter: entry.diameter,
        }));
        Ok(())
    }

    /// The program's words for a tool: the comment of this block, or the first of the comment lines right before.
    pub(super) fn tool_words(&self, block: &Block, site: Site<'_>) -> String {
        match block.comment {
            Some((start, end)) => characters(&site.text[start..end]).trim().to_owned(),
            None => self.comments.first().cloned().unwrap_or_default(),
        }
    }

    /// Takes note of a line that holds only a comment, or nothing.
    pub(crate) fn comment_line(&mut self, block: &Block, function: Option<usize>, site: Site<'_>) {
        const MOST: usize = 8;
        let Some((start, end)) = block.comment else {
            self.tell_function();
            return;
        };
        match function {
            Some(function) if self.take_function(function, site, true) => {
                if function == start {
                    return;
                }
            }
            _ => self.tell_function(),
        }
        if self.show_message(block, site) {
            return;
        }
        let bytes = &site.text[start..end];
        if self.comments_closed {
            self.comments.clear();
            self.comments_closed = false;
        }
        if self.comments.len() < MOST {
            let text = characters(&bytes[..bytes.len().min(200)]);
            let text = text.trim();
            if !text.is_empty() {
                self.comments.push(text.to_owned());
            }
        }
    }

    /// Tells the operator what a `(MSG,...)` comment says; false when the block has none.
    pub(crate) fn show_message(&mut self, block: &Block, site: Site<'_>) -> bool {
        let Some((start, end)) = block.comment.filter(|_| self.profile.message_comments) else {
            return false;
        };
        let bytes = &site.text[start..end];
        let is_message = bytes.get(..4).is_some_and(|b| b.eq_ignore_ascii_case(b"MSG,"));
        if is_message {
            self.emit(StepKind::Message(characters(&bytes[4..]).trim().to_owned()));
        }
        is_message
    }

    /// Takes the functions out of the comments of a line that holds words, before the words are done. A block that holds no more than its
    /// sequence number is the function's own.
    pub(crate) fn take_functions(&mut self, line: &Line, site: Site<'_>) {
        let own_block = line.statement.is_none() && line.program.is_none() && line.words.iter().all(|word| word.letter == b'N');
        if own_block
            && let Some(start) = line.function
            && self.take_function(start, site, true)
        {
            return;
        }
        self.tell_function();
        if let Some(start) = line.function
            && self.take_function(start, site, false)
        {
            self.tell_function();
        }
    }

    /// Takes functions of the traceability vocabulary out of the comments of a line; `start` is behind the bracket of the first one of
    /// them. False when none says anything. What goes on in the next line is waited for: [`Interpreter::tell_function`].
    fn take_function(&mut self, start: usize, site: Site<'_>, own_block: bool) -> bool {
        let mut any = false;
        for comment in site.text[start - 1..].split(|b| *b == b'(').skip(1) {
            let inner = comment.split(|b| *b == b')').next().unwrap_or_default();
            let at = inner.as_ptr() as usize - site.text.as_ptr() as usize;
            match plan::comment::read(&characters(inner)) {
                Comment::Other => {}
                Comment::Begins(line) => {
                    self.tell_function();
                    any = true;
                    let running = self.modal_running > 0;
                    if self.cycle.is_some() || running {
                        self.note(Severity::Error, "T-12", site, at, || {
                            (
                                format!(
                                    "a function stands inside a {}",
                                    if running { "modal call's body" } else { "canned cycle" }
                                ),
                                "move it before the cycle, or behind its end".to_owned(),
                            )
                        });
                        continue;
                    }
                    if !own_block {
                        self.note(Severity::Warning, "trace-block", site, at, || {
                            (
                                "a function stands in a block with words or a macro statement; it takes effect before the block"
                                    .to_owned(),
                                "give it a block of its own".to_owned(),
                            )
                        });
                    }
                    self.say_of_inches(&line, "", site, at);
                    self.function = Some((self.origin, line));
                }
                Comment::GoesOn(more) => {
                    any = true;
                    match self.function.take() {
                        Some((origin, line)) => {
                            let whole = plan::comment::joined(&line, &more);
                            self.say_of_inches(&whole, &line, site, at);
                            self.function = Some((origin, whole));
                        }
                        None => self.note(Severity::Warning, "trace-continuation", site, at, || {
                            (
                                "(trace:+ goes on with a function that did not begin".to_owned(),
                                "put it right behind the (trace:1 ...) that it belongs to".to_owned(),
                            )
                        }),
                    }
                }
            }
        }
        any
    }

    /// What a function writes is in the units of records, and the program may count in others. `before`: what of the line was looked at.
    fn say_of_inches(&mut self, line: &str, before: &str, site: Site<'_>, at: usize) {
        let is_of_time = |name: &str| {
            ["get_time", "get_execution_time"]
                .iter()
                .any(|t| name.eq_ignore_ascii_case(t))
        };
        let writes = |line: &str| !plan::written::written(line).is_empty();
        if !self.inches || !writes(line) || writes(before) || line.split_whitespace().nth(1).is_some_and(is_of_time) {
            return;
        }
        self.note(Severity::Warning, "trace-inches", site, at, || {
            (
                "its_variable gets lengths in mm and speeds in mm/s, and the program counts inches here".to_owned(),
                "divide by 25.4 where it is used".to_owned(),
            )
        });
    }

    /// Says the function that was read: nothing that follows belongs to it.
    pub(crate) fn tell_function(&mut self) {
        if let Some((origin, text)) = self.function.take() {
            let name = text.split_whitespace().nth(1).unwrap_or_default().to_owned();
            let properties = self.present_values(&text);
            self.await_written(&text, origin);
            self.tell_behind(
                origin,
                StepKind::NcFunction(RawNcFunction {
                    kind: RawNcFunction::EXTENDED.to_owned(),
                    name,
                    text,
                    condition: None,
                    properties,
                }),
            );
        }
    }

    /// A line that is no comment was met: the next comment line begins a new run.
    pub(crate) fn close_comments(&mut self) {
        self.comments_closed = true;
    }

    /// The tip moves: comments before it are no longer about the next tool.
    pub(crate) fn forget_comments(&mut self) {
        if !self.comments.is_empty() {
            self.comments.clear();
        }
    }

    pub(crate) fn begin_workingstep(&mut self, name: String) {
        if self.workingstep_open {
            self.emit(StepKind::End(Level::Workingstep));
        }
        self.workingstep_open = true;
        self.emit(StepKind::Begin(Marker {
            level: Level::Workingstep,
            name,
            entity: None,
            maximum_deviation: None,
            derived: true,
        }));
    }

    /// Moves before the first tool call are a workingstep too, named after the program.
    pub(crate) fn ensure_workingstep(&mut self) {
        if !self.workingstep_open {
            self.begin_workingstep(self.program_name.clone());
        }
    }
}

/// `T1 3" FACE MILL`; a comment that begins with the tool's number is name enough.
fn step_name(number: u32, words: &str) -> String {
    let call = format!("T{number}");
    match words.strip_prefix(&call) {
        Some(rest) if !rest.starts_with(|c: char| c.is_ascii_digit()) => words.to_owned(),
        _ if words.is_empty() => call,
        _ => format!("{call} {words}"),
    }
}
