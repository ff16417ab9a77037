//! A control pad that does what a script says.

use machine::{ControlPad, PadState};
use std::collections::VecDeque;
use units::Tick;

/// Shows each state of its script from its tick on; before the first there is no pad.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScriptedPad {
    script: VecDeque<(Tick, PadState)>,
    shown: Option<PadState>,
}

impl ScriptedPad {
    /// A pad for a script in order of ticks.
    pub fn new(script: impl IntoIterator<Item = (Tick, PadState)>) -> Self {
        ScriptedPad {
            script: script.into_iter().collect(),
            shown: None,
        }
    }

    /// Shows a state from now on, whatever the script said.
    pub fn show(&mut self, state: Option<PadState>) {
        self.script.clear();
        self.shown = state;
    }
}

impl ControlPad for ScriptedPad {
    fn read(&mut self, now: Tick) -> Option<PadState> {
        while let Some((at, state)) = self.script.front()
            && *at <= now
        {
            self.shown = Some(*state);
            self.script.pop_front();
        }
        self.shown
    }
}
