//! Which block is executed next: jumps, loops, calls and returns.

use crate::acting::Act;
use crate::calls::ProgramCall;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::Flow;
use crate::interruption::Codes;
use crate::listing::{File, LoopEnd, Place, is_named, program_number};
use crate::macro_b::Locals;
use crate::program::{GcodeProgram, leader};
use crate::text::Lines;
use plan::Severity;
use std::collections::BTreeMap;

/// A program that was called and has not returned.
pub(crate) struct Frame {
    /// Where the caller goes on.
    return_file: usize,
    return_to: Place,
    /// Where the caller's program begins.
    caller_body: Place,
    /// The caller's number.
    caller: u32,
    /// The caller's lines up to this byte are kept.
    keep_until: u64,
    body: Place,
    times_left: u32,
    /// The caller's locals, when this is a macro.
    pub saved: Option<Box<Locals>>,
    /// What the macro was called with.
    arguments: Option<Box<Locals>>,
    modal: Option<usize>,
    /// Whether codes that call programs were plain in the caller.
    in_code_call: bool,
    /// Modal codes as they were before an interruption.
    interrupted: Option<Codes>,
    /// Loops that belong to callers.
    loops: usize,
}

/// A loop whose body is being gone through.
pub(crate) struct Loop {
    label: u8,
    start: Place,
    end: LoopEnd,
    start_kept: Option<u32>,
}

/// What tells an endless loop: a jump back that finds all as it was at an earlier one, with no variable changed between.
#[derive(Default)]
pub(crate) struct Repetition {
    jumps_back: u64,
    changes: u64,
    /// What jumps back are held against. It is taken anew after twice as many jumps each time (Brent's way of finding a cycle), so that
    /// a round of any length is found and a jump costs one comparison.
    held: Option<Fingerprint>,
    /// Jumps since it was taken, and after how many the next one is.
    since: u64,
    holds_for: u64,
    /// `changes` when the main program began its present pass.
    pass: u64,
}

/// All that decides what comes next, but for the variables: two equal ones with no change between them are an endless loop.
struct Fingerprint {
    target: (usize, u64),
    frames: Vec<(u64, u32)>,
    loops: usize,
    state: [f64; 12],
}

/// Files a program may be made of.
const MOST_FILES: usize = 256;

impl GcodeProgram {
    /// Does what a line wants done behind it. `site` is the line's text, for columns.
    pub(crate) fn follow(&mut self, result: Outcome<Act>, site: Site<'_>) {
        let done = match result {
            Ok(act) => {
                self.interpreter.forget_answers();
                match act {
                    Act::Flow(Flow::NextBlock) => {
                        self.go_on();
                        Ok(())
                    }
                    Act::Flow(Flow::End) => {
                        self.ended = true;
                        Ok(())
                    }
                    Act::Flow(Flow::Contour(request)) => self.read_contour(*request),
                    Act::Flow(Flow::Call { program, times, at }) => self.call(ProgramCall {
                        times,
                        ..ProgramCall::subprogram(program, at)
                    }),
                    Act::Flow(Flow::LocalCall { block, times, at }) => self.call_blocks(block, times, at),
                    Act::Flow(Flow::Return { to, at }) => self.come_back(to, at, site),
                    Act::Call(call) => self.call(*call),
                    Act::Goto { at, .. } | Act::Do { at, .. } | Act::EndDo { at, .. } if self.comes_by_line() => Err(Fault::new(
                        at,
                        123,
                        "macro-by-line",
                        "a branch or a loop in a program that is read from a line (DNC): it cannot go back",
                        "put it into a subprogram in the control's memory, and call that",
                    )),
                    Act::Goto { number, at } => self.jump(number, at),
                    Act::Do { enters, label, at } => self.begin_loop(enters, label, at),
                    Act::EndDo { label, at } => self.end_loop(label, at),
                }
            }
            Err(fault) => Err(fault),
        };
        if let Err(fault) = done {
            match fault.ask {
                // The kept line is executed again when the answer is there.
                Some(question) => self.wait_for(question),
                None => self.alarm = Some(fault.into_alarm(&self.files[self.current].name, site)),
            }
        }
    }

    /// To the block behind this one.
    #[inline]
    pub(crate) fn go_on(&mut self) {
        let Some(index) = self.here.kept else { return }; // the text goes on by itself
        let kept = self.kept.get(index);
        if kept.next.get().is_none() {
            kept.next.set(self.kept.find(self.current, self.here.after.offset));
        }
        self.next_kept = kept.next.get();
        if self.next_kept.is_none() {
            self.seek(self.current, self.here.after);
        }
    }

    fn seek(&mut self, file: usize, place: Place) {
        self.files[file].lines.seek(place.offset, place.lines);
    }

    /// To a block of the current file; gives its kept line.
    pub(crate) fn go_to(&mut self, place: Place) -> Option<u32> {
        self.next_kept = self.kept.find(self.current, place.offset);
        if self.next_kept.is_none() {
            self.seek(self.current, place);
        }
        self.next_kept
    }

    /// Before a jump to `place`: lines that are gone through again are kept, and endless loops are found out.
    #[inline]
    fn jumps_to(&mut self, place: Place) {
        if place > self.here.place {
            return;
        }
        self.keep_until = self.keep_until.max(self.here.after.offset);
        self.repetition.jumps_back += 1;
        if self.repetition.jumps_back > self.interpreter.options.most_jumps_back {
            let most = self.interpreter.options.most_jumps_back;
            self.endless(format!("{most} jumps back: the program does not come to an end"));
        }
        let changes = self.interpreter.memory.changes;
        if changes != self.repetition.changes {
            self.repetition.changes = changes;
            self.repetition.held = None;
            return;
        }
        self.look_for_repetition(place);
    }

    /// No variable has changed since the last jump back: the state decides.
    fn look_for_repetition(&mut self, place: Place) {
        let target = (self.current, place.offset);
        let frames = self.frames.iter().map(|f| (f.return_to.offset, f.times_left));
        let loops = self.loops.len();
        let state = self.interpreter.fingerprint();
        let repetition = &mut self.repetition;
        match &repetition.held {
            Some(held)
                if held.target == target
                    && held.loops == loops
                    && held.state == state
                    && held.frames.iter().copied().eq(frames.clone()) =>
            {
                return self.endless(format!(
                    "the program goes round for ever from line {}: nothing changes from one pass to the next",
                    place.lines + 1
                ));
            }
            Some(_) => {
                repetition.since += 1;
                if repetition.since < repetition.holds_for {
                    return;
                }
                repetition.holds_for *= 2;
            }
            None => repetition.holds_for = 1,
        }
        repetition.since = 0;
        repetition.held = Some(Fingerprint {
            target,
            frames: frames.collect(),
            loops,
            state,
        });
    }

    // ---- jumps and loops

    fn find_block(&mut self, number: u32, after: Place) -> Option<Place> {
        let found = self.targets.block(&mut self.files, self.current, self.body, after, number);
        // Looking for it may have moved the window.
        if self.next_kept.is_none() && found.is_none() {
            self.seek(self.current, self.here.after);
        }
        found
    }

    /// GOTO: from the next block to the program's end, then from its start.
    pub(crate) fn jump(&mut self, number: u32, at: usize) -> Outcome<()> {
        if let Some(index) = self.here.kept
            && let Some((n, target)) = self.kept.get(index).jump.get()
            && n == number
        {
            let place = self.kept.get(target).here.place;
            self.leave_loops(place);
            self.jumps_to(place);
            self.next_kept = Some(target);
            return Ok(());
        }
        let Some(place) = self.find_block(number, self.here.after) else {
            return Err(Fault::new(
                at,
                128,
                "goto-number",
                format!("there is no block N{number} in {}", self.program_shown()),
                "write it at the head of the block to go to",
            ));
        };
        self.leave_loops(place);
        self.jumps_to(place);
        let target = self.go_to(place);
        if let (Some(index), Some(target)) = (self.here.kept, target) {
            self.kept.get(index).jump.set(Some((number, target)));
        }
        Ok(())
    }

    fn program_shown(&self) -> String {
        match self.interpreter.program_number {
            0 => "this program".to_owned(),
            n if is_named(n) => "this program".to_owned(),
            n => format!("O{n:04}"),
        }
    }

    fn first_loop(&self) -> usize {
        self.frames.last().map_or(0, |f| f.loops)
    }

    /// Loops that do not hold `place` are over.
    fn leave_loops(&mut self, place: Place) {
        let first = self.first_loop();
        while self.loops.len() > first {
            let last = &self.loops[self.loops.len() - 1];
            if (last.start..=last.end.end).contains(&place) {
                return;
            }
            self.loops.pop();
        }
    }

    #[inline]
    pub(crate) fn begin_loop(&mut self, enters: bool, label: u8, at: usize) -> Outcome<()> {
        let first = self.first_loop();
        let again = self.loops.len() > first && self.loops[self.loops.len() - 1].start == self.here.place;
        if again {
            if enters {
                self.go_on();
            } else if let Some(over) = self.loops.pop() {
                self.go_to(over.end.after);
            }
            return Ok(());
        }
        self.enter_loop(enters, label, at)
    }

    /// DO, met from outside its loop.
    fn enter_loop(&mut self, enters: bool, label: u8, at: usize) -> Outcome<()> {
        let first = self.first_loop();
        if self.loops[first..].iter().any(|l| l.label == label) {
            return Err(Fault::new(
                at,
                124,
                "loop-pairs",
                format!("DO{label} begins inside another loop of the number {label}"),
                "give loops that lie one in the other different numbers",
            ));
        }
        let around = (self.here.place, self.here.after);
        let found = self
            .targets
            .loop_end(&mut self.files, self.current, around, (label, at), &self.reading);
        let end = found?;
        if !enters {
            self.go_to(end.after);
            return Ok(());
        }
        self.loops.push(Loop {
            label,
            start: self.here.place,
            end,
            start_kept: self.here.kept,
        });
        match self.here.kept {
            Some(_) => self.go_on(),
            None => self.seek(self.current, self.here.after), // looking for END moved the window
        }
        Ok(())
    }

    #[inline]
    pub(crate) fn end_loop(&mut self, label: u8, at: usize) -> Outcome<()> {
        let first = self.first_loop();
        let open = match self.loops.last() {
            Some(open) if self.loops.len() > first && open.label == label => open,
            _ => {
                return Err(Fault::new(
                    at,
                    124,
                    "loop-pairs",
                    format!("END{label} without a DO{label} that was gone through"),
                    "do not jump into a loop; loops lie one in the other",
                ));
            }
        };
        let (start, kept) = (open.start, open.start_kept);
        self.jumps_to(start);
        match kept {
            Some(index) => self.next_kept = Some(index),
            None => {
                let kept = self.go_to(start);
                if let Some(open) = self.loops.last_mut() {
                    open.start_kept = kept;
                }
            }
        }
        Ok(())
    }

    // ---- calls

    /// True in a main program that the control does not hold in its memory.
    fn comes_by_line(&self) -> bool {
        self.interpreter.options.by_line && self.frames.is_empty()
    }

    /// True when one more call of this kind would be too deep.
    fn check_depth(&self, is_macro: bool, at: usize) -> Outcome<()> {
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
    fn call_blocks(&mut self, number: u32, times: u32, at: usize) -> Outcome<()> {
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
    fn call(&mut self, call: ProgramCall) -> Outcome<()> {
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
    fn enter(&mut self, call: ProgramCall, file: usize, first: Place, body: Place) {
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
    fn come_back(&mut self, to: Option<u32>, at: usize, site: Site<'_>) -> Outcome<()> {
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
    fn begin_anew(&mut self, to: Option<u32>, at: usize, site: Site<'_>) -> Outcome<()> {
        let changes = self.interpreter.memory.changes;
        if to.is_none() && changes == self.repetition.pass {
            self.interpreter.note(Severity::Warning, "endless-program", site, at, || {
                (
                    "M99 in the main program: it begins anew for ever; one pass is done".to_owned(),
                    "end it with M30 where it shall stop".to_owned(),
                )
            });
            self.interpreter.finish();
            self.ended = true;
            return Ok(());
        }
        match to {
            None => {
                self.repetition.pass = changes;
                self.loops.clear();
                self.jumps_to(self.start);
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
                self.leave_loops(place);
                self.jumps_to(place);
                self.go_to(place);
                Ok(())
            }
        }
    }

    /// Where program `number` begins in a file. Looks through the file once.
    fn program_in(&mut self, file: usize, number: u32) -> Option<Place> {
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

    fn open_program(&mut self, number: u32, at: usize) -> Outcome<(usize, Place)> {
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
    fn body_of(&mut self, file: usize, number: u32) -> Place {
        if let Some(place) = self.program_in(file, number) {
            return place;
        }
        let lines = &mut self.files[file].lines;
        lines.seek(0, 0);
        // A file that cannot be read alarms at its first line.
        leader(lines).map_or_else(|_| Place::default(), |(offset, lines)| Place { offset, lines })
    }
}
