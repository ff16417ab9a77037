//! Going to a called program and coming back, and where programs are found.

use super::*;

impl GcodeProgram {
    /// True when one more call of this kind would be too deep.
    pub(super) fn check_depth(&self, is_macro: bool, at: usize) -> Outcome<()> {
        let macros = self.frames.iter().filter(|f| f.saved.is_some()).count();
        let rules = &self.interpreter.macros;
        let (depth, deepest, what) = match is_macro {
            true => (macros, rules.deepest_macro, "macros"),
            false => (self.frames.len() - macros, rules.deepest_subprogram, "subprograms"),
        };
        if depth < usize::from(deepest) {
            return Ok(());
        }
        Err(Fault::new(
            at,
            77,
            "call-depth",
            format!("{what} are nested more than {deepest} deep"),
            "call it from a shallower level",
        ))
    }

    /// M97 of Haas: blocks of this program as a subprogram.
    pub(super) fn call_blocks(&mut self, number: u32, times: u32, at: usize) -> Outcome<()> {
        self.check_depth(false, at)?;
        let Some(place) = self.find_block(number, self.here.after) else {
            return Err(Fault::new(
                at,
                78,
                "no-such-block",
                format!("M97 P{number}: there is no block N{number} in {}", self.program_shown()),
                "write it at the head of the first block of the local subprogram",
            ));
        };
        if times == 0 {
            self.go_on();
            return Ok(());
        }
        let program = self.interpreter.program_number;
        let call = ProgramCall {
            times,
            ..ProgramCall::subprogram(program, at)
        };
        self.enter(call, self.current, place, self.body);
        Ok(())
    }

    /// Goes to a program: of this file, of the main file, or one that the resolver finds.
    pub(super) fn call(&mut self, call: ProgramCall) -> Outcome<()> {
        if call.times == 0 {
            self.go_on();
            return Ok(());
        }
        self.check_depth(call.locals.is_some(), call.at)?;
        let mut found = None;
        for file in [self.current, 0] {
            if let Some(body) = self.program_in(file, call.program) {
                found = Some((file, body));
                break;
            }
        }
        let (file, body) = match found {
            Some(found) => found,
            None => self.open_program(call.program, call.at)?,
        };
        self.enter(call, file, body, body);
        Ok(())
    }

    /// Enters a program of a file at its first block to be executed. Jumps stay in the program that begins at `body`.
    pub(super) fn enter(&mut self, call: ProgramCall, file: usize, first: Place, body: Place) {
        let saved = call
            .locals
            .as_ref()
            .map(|locals| Box::new(self.interpreter.memory.enter(locals)));
        self.frames.push(Frame {
            return_file: self.current,
            return_to: match call.interrupts {
                true => self.here.place,
                false => self.here.after,
            },
            caller_body: self.body,
            caller: self.interpreter.program_number,
            keep_until: self.keep_until,
            body: first,
            times_left: call.times,
            saved,
            arguments: call.locals,
            modal: call.modal,
            in_code_call: self.interpreter.in_code_call,
            interrupted: call.interrupts.then(|| self.interpreter.modal_codes()),
            loops: self.loops.len(),
        });
        self.interpreter.in_code_call |= call.by_code;
        self.interpreter.modal_running += usize::from(call.modal.is_some());
        // A program called a second time is gone through again.
        self.keep_until = match self.called.insert((file, first.offset)) {
            true => 0,
            false => u64::MAX,
        };
        self.current = file;
        self.body = body;
        self.at_start = true;
        self.go_to(first);
    }

    /// M99, M99 P.
    pub(super) fn come_back(&mut self, to: Option<u32>, at: usize, site: Site<'_>) -> Outcome<()> {
        let Some(mut frame) = self.frames.pop() else {
            return self.begin_anew(to, at, site);
        };
        self.loops.truncate(frame.loops);
        if let Some(modal) = frame.modal {
            // The locals of a modal call are set once, in its G66 block.
            let mut locals = [0.0; crate::macro_b::LOCALS];
            locals.copy_from_slice(&self.interpreter.memory.values()[..crate::macro_b::LOCALS]);
            if let Some(call) = self.interpreter.modal.get_mut(modal).filter(|c| !c.every_block) {
                *call.locals = locals;
                frame.arguments = Some(Box::new(locals));
            }
        }
        frame.times_left -= 1;
        if frame.times_left > 0 && to.is_none() {
            if let Some(arguments) = &frame.arguments {
                self.interpreter.memory.enter(arguments);
            }
            self.at_start = true;
            self.keep_until = u64::MAX;
            let body = frame.body;
            self.frames.push(frame);
            self.go_to(body);
            return Ok(());
        }
        if let Some(saved) = &frame.saved {
            self.interpreter.memory.enter(saved);
        }
        self.interpreter.modal_running -= usize::from(frame.modal.is_some());
        if let Some(codes) = frame.interrupted.take() {
            self.interpreter.interruption_is_over(to.is_none().then_some(codes));
        }
        self.interpreter.in_code_call = frame.in_code_call;
        self.interpreter.program_number = frame.caller;
        self.current = frame.return_file;
        self.body = frame.caller_body;
        self.keep_until = frame.keep_until;
        self.at_start = false;
        match to {
            None => {
                self.go_to(frame.return_to);
                Ok(())
            }
            Some(number) => match self
                .targets
                .block(&mut self.files, self.current, self.body, frame.return_to, number)
            {
                Some(place) => {
                    self.leave_loops(place);
                    if place < frame.return_to {
                        self.keep_until = self.keep_until.max(frame.return_to.offset);
                        self.repetition.jumps_back += 1;
                    }
                    self.go_to(place);
                    Ok(())
                }
                None => Err(Fault::new(
                    at,
                    78,
                    "no-such-block",
                    format!("M99 P{number}: there is no block N{number} in {}", self.program_shown()),
                    "write the sequence number at the head of a block of the caller",
                )),
            },
        }
    }

    /// M99 in the main program: from its start again, or from a block.
    pub(super) fn begin_anew(&mut self, to: Option<u32>, at: usize, site: Site<'_>) -> Outcome<()> {
        let changes = self.interpreter.memory.changes;
        if to.is_none() && changes == self.repetition.pass {
            self.interpreter.note(Severity::Warning, "endless-program", site, at, || {
                (
                    "M99 in the main program: it begins anew for ever; one pass is done".to_owned(),
                    "end it with M30 where it shall stop".to_owned(),
                )
            });
            self.end_program();
            return Ok(());
        }
        match to {
            None => {
                self.repetition.pass = changes;
                self.loops.clear();
                if !self.jumps_to(self.start) {
                    self.end_program();
                    return Ok(());
                }
                self.at_start = true;
                self.go_to(self.start);
                Ok(())
            }
            Some(number) => {
                let Some(place) = self.find_block(number, self.here.after) else {
                    return Err(Fault::new(
                        at,
                        78,
                        "no-such-block",
                        format!("M99 P{number}: there is no block N{number} in {}", self.program_shown()),
                        "write it at the head of the block to go to",
                    ));
                };
                if !self.jumps_to(place) {
                    self.go_to(self.here.after);
                    return Ok(());
                }
                self.leave_loops(place);
                self.go_to(place);
                Ok(())
            }
        }
    }

    /// Where program `number` begins in a file. Looks through the file once.
    pub(super) fn program_in(&mut self, file: usize, number: u32) -> Option<Place> {
        let file = &mut self.files[file];
        if file.programs.is_none() {
            let mut programs = BTreeMap::new();
            file.lines.seek(0, 0);
            loop {
                let (offset, lines) = file.lines.position();
                let Ok(Some(line)) = file.lines.next() else { break };
                if let Some(found) = program_number(file.lines.bytes(line)) {
                    programs.entry(found).or_insert(Place { offset, lines });
                }
            }
            file.programs = Some(programs);
        }
        file.programs.as_ref()?.get(&number).copied()
    }

    pub(super) fn open_program(&mut self, number: u32, at: usize) -> Outcome<(usize, Place)> {
        let name = match self.interpreter.program_names.get(&number) {
            Some(name) => name.clone(),
            None => format!("O{number:04}"),
        };
        if let Some(known) = self.files.iter().position(|f| f.name == name) {
            return Ok((known, self.body_of(known, number)));
        }
        let source = match self.resolver.open(&name) {
            Some(source) if self.files.len() < MOST_FILES => source,
            _ => {
                return Err(Fault::new(
                    at,
                    78,
                    "no-such-program",
                    format!("there is no program {name}"),
                    "put it into this file, or beside it",
                ));
            }
        };
        self.files.push(File {
            name,
            lines: Lines::new(source),
            programs: None,
        });
        let file = self.files.len() - 1;
        Ok((file, self.body_of(file, number)))
    }

    /// Where a program begins that has a file of its own: at its O line, else behind the first `%`. A search for blocks that began at
    /// the `%` would end at the O line.
    pub(super) fn body_of(&mut self, file: usize, number: u32) -> Place {
        if let Some(place) = self.program_in(file, number) {
            return place;
        }
        let lines = &mut self.files[file].lines;
        lines.seek(0, 0);
        // A file that cannot be read alarms at its first line.
        leader(lines).map_or_else(|_| Place::default(), |(offset, lines)| Place { offset, lines })
    }
}
