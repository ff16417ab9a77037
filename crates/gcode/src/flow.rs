//! Which block is executed next: jumps, loops, calls and returns.

mod calling;

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
    /// Jumps back with values between that were assumed because there is no machine to ask.
    assumed: u32,
}

/// All that decides what comes next, but for the variables: two equal ones with no change between them are an endless loop.
struct Fingerprint {
    target: (usize, u64),
    frames: Vec<(u64, u32)>,
    loops: usize,
    state: [f64; 12],
    /// How often a value was assumed before. It is no part of the state: what was assumed since tells why nothing changes.
    assumptions: u64,
}

/// Jumps back after which a loop is left in which values are assumed: counted loops are shorter, and one that waits for the machine to
/// change something may go round for ever.
const MOST_ASSUMED_JUMPS: u32 = 10_000;

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

    /// Before a jump to `place`: lines that are gone through again are kept, and endless loops are found out. False when the program goes
    /// on behind this line instead, because only the machine could end the loop and there is none.
    #[inline]
    fn jumps_to(&mut self, place: Place) -> bool {
        if place > self.here.place {
            return true;
        }
        self.keep_until = self.keep_until.max(self.here.after.offset);
        self.repetition.jumps_back += 1;
        if self.repetition.jumps_back > self.interpreter.options.most_jumps_back {
            let most = self.interpreter.options.most_jumps_back;
            self.endless(format!("{most} jumps back: the program does not come to an end"));
        }
        if std::mem::take(&mut self.interpreter.assumed_since_jump) {
            self.repetition.assumed = self.repetition.assumed.saturating_add(1);
            if self.repetition.assumed > MOST_ASSUMED_JUMPS {
                self.note_assumed_loop();
                return false;
            }
        }
        let changes = self.interpreter.memory.changes;
        if changes != self.repetition.changes {
            self.repetition.changes = changes;
            self.repetition.held = None;
            return true;
        }
        self.look_for_repetition(place)
    }

    fn note_assumed_loop(&mut self) {
        let site = Site {
            text: b"",
            number: self.here.number,
        };
        self.interpreter.note(Severity::Warning, "loop-assumed", site, 0, || {
            (
                "only the machine ends this loop: a check cannot know how often it goes round, and goes on behind it".to_owned(),
                "look at what the program does when the loop ends".to_owned(),
            )
        });
    }

    /// No variable has changed since the last jump back: the state decides. False when the loop is left.
    fn look_for_repetition(&mut self, place: Place) -> bool {
        let target = (self.current, place.offset);
        let frames = self.frames.iter().map(|f| (f.return_to.offset, f.times_left));
        let loops = self.loops_around(place);
        let state = self.interpreter.fingerprint();
        let assumptions = self.interpreter.assumptions;
        let repetition = &mut self.repetition;
        match &repetition.held {
            Some(held)
                if held.target == target
                    && held.loops == loops
                    && held.state == state
                    && held.frames.iter().copied().eq(frames.clone()) =>
            {
                if held.assumptions != assumptions {
                    repetition.held = None;
                    self.note_assumed_loop();
                    return false;
                }
                self.endless(format!(
                    "the program goes round for ever from line {}: nothing changes from one pass to the next",
                    place.lines + 1
                ));
                return true;
            }
            Some(_) => {
                repetition.since += 1;
                if repetition.since < repetition.holds_for {
                    return true;
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
            assumptions,
        });
        true
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
            match self.jumps_to(place) {
                true => {
                    self.leave_loops(place);
                    self.next_kept = Some(target);
                }
                false => self.go_on(),
            }
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
        if !self.jumps_to(place) {
            self.go_to(self.here.after);
            return Ok(());
        }
        self.leave_loops(place);
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
        self.loops.truncate(self.loops_around(place));
    }

    /// How many of the loops go on at `place`.
    fn loops_around(&self, place: Place) -> usize {
        let first = self.first_loop();
        let holds = |open: &Loop| (open.start..=open.end.end).contains(&place);
        self.loops[first..]
            .iter()
            .rposition(holds)
            .map_or(first, |last| first + last + 1)
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
        let (start, kept, behind) = (open.start, open.start_kept, open.end.after);
        if !self.jumps_to(start) {
            self.loops.pop();
            self.go_to(behind);
            return Ok(());
        }
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

    /// True in a main program that the control does not hold in its memory.
    fn comes_by_line(&self) -> bool {
        self.interpreter.options.by_line && self.frames.is_empty()
    }
}
