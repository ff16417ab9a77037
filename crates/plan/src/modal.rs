//! What is in force at a point of a program: what has to be restored before a run can be taken up there.

use crate::{CoolantState, FrameChange, Level, Marker, PathMode, SpindleState, Step, StepKind, ToolCall, ToolOffset};
use units::{Point, Setup, StepId};

/// The state that steps leave behind.
#[derive(Clone, Debug, PartialEq)]
pub struct Modal {
    /// The last step followed.
    pub step: StepId,
    /// The tool in the spindle, when the program called one.
    pub tool: Option<ToolCall>,
    /// The tool offset in force.
    pub tool_offset: ToolOffset,
    /// What the spindle does.
    pub spindle: SpindleState,
    /// Which coolant outlets are open.
    pub coolant: CoolantState,
    /// The frame in force; `None` until the program says one.
    pub frame: Option<FrameChange>,
    /// How closely paths are followed.
    pub path_mode: PathMode,
    /// Where the tip is, when the last move was one in the set-up.
    pub tip: Option<Point<Setup>>,
    /// The open parts of the structure, outer first.
    pub open: Vec<Marker>,
}

impl Default for Modal {
    fn default() -> Self {
        Modal {
            step: StepId::NONE,
            tool: None,
            tool_offset: ToolOffset::NONE,
            spindle: SpindleState::Stopped,
            coolant: CoolantState::default(),
            frame: None,
            path_mode: PathMode::Tolerance(None),
            tip: None,
            open: Vec::new(),
        }
    }
}

impl Modal {
    /// Takes in what `step` leaves behind.
    pub fn follow(&mut self, step: &Step) {
        self.step = step.id;
        match &step.kind {
            StepKind::Move(m) => self.tip = Some(m.path.end()),
            StepKind::MachineMove(_) => self.tip = None,
            StepKind::Tool(tool) => self.tool = Some(tool.clone()),
            StepKind::ToolOffset(offset) => self.tool_offset = *offset,
            StepKind::Spindle(spindle) => self.spindle = *spindle,
            StepKind::Coolant(coolant) => self.coolant = *coolant,
            StepKind::Frame(frame) => {
                self.frame = Some(frame.clone());
                self.tip = None;
            }
            StepKind::PathMode(mode) => self.path_mode = *mode,
            StepKind::Begin(marker) => self.open.push(marker.clone()),
            StepKind::End(level) => {
                if let Some(at) = self.open.iter().rposition(|m| m.level == *level) {
                    self.open.truncate(at);
                }
            }
            StepKind::Dwell(_) | StepKind::Message(_) | StepKind::Stop(_) | StepKind::Register(_) | StepKind::NcFunction(_) => {}
        }
    }

    /// The innermost open part of a level.
    pub fn within(&self, level: Level) -> Option<&Marker> {
        self.open.iter().rev().find(|m| m.level == level)
    }
}
