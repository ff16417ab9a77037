//! Going through kept lines again: the passes of loops and subprograms, where nothing is read and nothing is taken apart.

use super::{GcodeProgram, Kind};
use crate::acting::{Act, act};
use crate::fault::{Outcome, Site};
use crate::interpreter::Flow;
use std::rc::Rc;

impl GcodeProgram {
    /// Executes kept lines one behind the other until one says something, or the next one has to be read.
    pub(super) fn go_through_kept(&mut self, first: u32) {
        let mut index = first;
        // A line that waited is executed once more; what stands in its comments was taken before.
        let mut waited = std::mem::take(&mut self.waits);
        loop {
            let kept = self.kept.get(index);
            self.here = kept.here;
            self.interpreter.origin = kept.origin;
            let site = Site {
                text: &kept.text,
                number: kept.here.number,
            };
            let result = match kept.line.kind {
                Kind::Blank => {
                    self.block.comment = kept.line.comment;
                    self.interpreter.comment_line(&self.block, kept.line.function, site);
                    Ok(Act::Flow(Flow::NextBlock))
                }
                _ => {
                    if let Some((number, _)) = kept.line.program {
                        if !self.at_start {
                            return self.end_of_text(Some(kept.here.number)); // the next program of the file
                        }
                        self.interpreter.program_number = number;
                    }
                    self.at_start = false;
                    if !waited {
                        self.interpreter.take_functions(&kept.line, site);
                    }
                    let result = act(&mut self.interpreter, &mut self.block, &kept.line, site, &mut self.stack);
                    self.count_block();
                    result
                }
            };
            match result {
                Ok(Act::Flow(Flow::NextBlock)) => {
                    self.interpreter.forget_answers();
                    self.go_on();
                }
                // Loops go on without a look at the text, unless there is a fault to tell.
                Ok(Act::Do { enters, label, at }) => {
                    self.interpreter.forget_answers();
                    if let Err(fault) = self.begin_loop(enters, label, at) {
                        self.follow_kept(index, Err(fault));
                    }
                }
                Ok(Act::EndDo { label, at }) => {
                    self.interpreter.forget_answers();
                    if let Err(fault) = self.end_loop(label, at) {
                        self.follow_kept(index, Err(fault));
                    }
                }
                other => self.follow_kept(index, other),
            }
            waited = false;
            match self.next_kept {
                Some(next) if self.interpreter.has_said_nothing() && self.alarm.is_none() && !self.ended => index = next,
                _ => return,
            }
        }
    }

    fn follow_kept(&mut self, index: u32, result: Outcome<Act>) {
        // What comes now may change where the line is kept: it holds on to its text.
        let kept = Rc::clone(self.kept.get(index));
        let site = Site {
            text: &kept.text,
            number: kept.here.number,
        };
        self.follow(result, site);
    }
}
