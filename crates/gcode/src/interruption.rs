//! Interruption macros: M96 P arms one, M97 takes it away; between, the signal UINT calls it.
//!
//! While one is armed the machine is asked for the signal before each block of words, so reading ahead stops there: that is what a macro
//! which may come at any moment costs. The call comes between two blocks (type II of the controls). Type I, which gives up the rest of a
//! move, is read as type II, with a warning.

use crate::block::Block;
use crate::calls::ProgramCall;
use crate::evaluate::Stack;
use crate::fault::{Outcome, Site};
use crate::interpreter::Interpreter;
use crate::line::Line;
use crate::macro_b::Locals;
use crate::profile::{FeedMode, Motion, Plane};
use plan::Severity;

/// What the machine is asked for.
pub(crate) const SIGNAL: &str = "PMC.INPUT.UINT";

/// The interruption macro in force.
#[derive(Clone, Debug, Default)]
pub(crate) struct Interruption {
    armed: Option<Armed>,
    /// It is running: it is not interrupted itself.
    pub running: bool,
    /// The signal was on when it was asked for last.
    was_on: bool,
}

#[derive(Clone, Debug)]
struct Armed {
    program: u32,
    times: u32,
    locals: Box<Locals>,
}

/// Modal codes that come back with M99 (but not with M99 P).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Codes {
    motion: Motion,
    plane: Plane,
    incremental: bool,
    feed_mode: FeedMode,
    feed: Option<f64>,
    return_to_r: bool,
}

impl Interpreter {
    /// M96 and M97; false when the block has neither.
    pub(crate) fn arms(&mut self, block: &Block, line: &Line, stack: &mut Stack) -> Outcome<bool> {
        let (codes, count) = block.m_codes();
        let [arm, take_away] = self.settings.interruption_codes;
        let found = codes[..count].iter().find(|m| m.code == arm || m.code == take_away);
        let Some(code) = found.copied().filter(|m| m.code != 97 || !self.macros.local_subprograms) else {
            return Ok(false);
        };
        if code.code == take_away {
            self.interruption.armed = None;
            return Ok(true);
        }
        let given = self.given_words(line, stack)?;
        let (locals, program, times) = self.arguments(&given, Some((b'M', code.at)), code.at, true)?;
        let Some(program) = program else {
            return Err(crate::fault::Fault::new(
                code.at,
                76,
                "word-missing",
                format!("M{arm} without P"),
                format!("write the number of the macro: M{arm} P9100"),
            ));
        };
        self.interruption.armed = Some(Armed { program, times, locals });
        Ok(true)
    }

    /// Before a block: the macro that interrupts here.
    pub(crate) fn interrupted(&mut self, site: Site<'_>) -> Outcome<Option<Box<ProgramCall>>> {
        if self.interruption.running || self.interruption.armed.is_none() {
            return Ok(None);
        }
        let on = self.asked_for(SIGNAL).map_err(|r| r.at(0))? != 0.0;
        let was_on = std::mem::replace(&mut self.interruption.was_on, on);
        let comes = on && (self.settings.interrupts_by_state || !was_on);
        let Some(armed) = self.interruption.armed.clone().filter(|_| comes) else {
            return Ok(None);
        };
        if !self.settings.interrupts_behind_block {
            self.note(Severity::Warning, "interruption-type", site, 0, || {
                (
                    "an interruption of type I gives up the rest of a move on the control; here the move is finished first"
                        .to_owned(),
                    "set parameter 6003.4 (MIN) for type II, on the control too".to_owned(),
                )
            });
        }
        self.interruption.running = true;
        Ok(Some(Box::new(ProgramCall {
            times: armed.times,
            locals: (!self.settings.interruption_shares_locals).then_some(armed.locals),
            interrupts: true,
            ..ProgramCall::subprogram(armed.program, 0)
        })))
    }

    /// The modal codes that an interruption gives back.
    pub(crate) fn modal_codes(&self) -> Codes {
        Codes {
            motion: self.motion,
            plane: self.plane,
            incremental: self.incremental,
            feed_mode: self.feed_mode,
            feed: self.feed,
            return_to_r: self.return_to_r,
        }
    }

    /// The interruption is over; `codes` are what comes back.
    pub(crate) fn interruption_is_over(&mut self, codes: Option<Codes>) {
        self.interruption.running = false;
        if let Some(codes) = codes {
            self.motion = codes.motion;
            self.plane = codes.plane;
            self.incremental = codes.incremental;
            self.feed_mode = codes.feed_mode;
            self.feed = codes.feed;
            self.return_to_r = codes.return_to_r;
        }
    }
}
