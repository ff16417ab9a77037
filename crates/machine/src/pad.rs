//! The control pad: what a person does at the machine with the hands.

use units::Tick;

/// What the machine is to do: run programs, or follow the joystick on one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Programs.
    #[default]
    Auto,
    /// The joystick moves an axis.
    Jog {
        /// 0 is X.
        axis: u8,
    },
}

/// What a control pad shows in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PadState {
    /// Position of the mode selector. Ignored while machining; its present position applies afterwards.
    pub selector: Mode,
    /// -1 to 1; the axis goes at this part of the jog feed.
    pub joystick: f64,
    /// Jog feed, 0 to 255; 255 is the highest speed of the axis.
    pub feed: u8,
    /// The emergency stop button is pressed.
    pub emergency_stop: bool,
    /// The dead-man button is held. Without it nothing is jogged.
    pub dead_man: bool,
}

impl Default for PadState {
    /// A pad that lies there: automatic, nothing pressed.
    fn default() -> Self {
        PadState {
            selector: Mode::Auto,
            joystick: 0.0,
            feed: 0,
            emergency_stop: false,
            dead_man: false,
        }
    }
}

/// A control pad, looked at once each servo cycle: a simulated one, a gamepad. It must not block.
pub trait ControlPad {
    /// What it shows at the beginning of cycle `now`. `None` when there is no pad, or not any more: whatever was jogged stops.
    fn read(&mut self, now: Tick) -> Option<PadState>;
}

/// No pad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NoPad;

impl ControlPad for NoPad {
    fn read(&mut self, _now: Tick) -> Option<PadState> {
        None
    }
}

/// What a link tells a person once, when it happens; the place of a joystick that came to rest is the cycle's `sample.actual`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Notices {
    /// The emergency stop began (`true`) or ended.
    pub emergency_stop: Option<bool>,
    /// This mode is in force now.
    pub mode: Option<Mode>,
    /// The joystick came to rest, and the axis with it.
    pub joystick_stopped: bool,
    /// The machine is at home.
    pub home_reached: bool,
}

impl Notices {
    /// True when there is nothing to tell.
    pub fn is_empty(&self) -> bool {
        *self == Notices::default()
    }
}
