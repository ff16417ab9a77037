//! The machine file: `machine.toml`, the one description of a machine for run, controller and server.
//!
//! Every quantity has its unit in the key; a key that nobody knows is an error with line and column, because a misspelt limit is a
//! limit that is not there. What changes while the machine works (offsets, tools) is only begun here: what is in force stands in the
//! data directory, see [`crate::registers`].
//!
//! Two machines are built in, `sim-mill` and `sim-lathe`; their texts are in `store/machines/` and are the examples to copy from.
//!
//! Not here yet, because nothing reads them yet: sensors.

mod model;
mod text;

pub use model::Model;

use crate::{Retention, StoreError};
use plan::Diagnostic;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
use text::{Refusal, Text};
use toml::Spanned;
use units::{Axis, Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Rpm, Seconds, ToolNumber};

/// A machine as its file describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineFile {
    /// Its name: in records, in the paths of its registers.
    pub name: String,
    /// What it is.
    pub kind: MachineKind,
    /// What stands on its nameplate.
    pub nameplate: Nameplate,
    /// The coolant that the shop says is in it.
    pub coolant: Coolant,
    /// What G-code it reads; `None` when each program shows it by its own look.
    pub control: Option<Control>,
    /// Parameters of the control that decide how its programs are read, by number, or number and bit: `6001.5`, T calls O9000.
    pub control_parameters: BTreeMap<String, f64>,
    /// Who moves its axes.
    pub driver: Driver,
    /// Its axes, by [`Axis::index`]; a lathe may have no Y.
    pub axes: [Option<AxisFile>; 3],
    /// Its spindle.
    pub spindle: SpindleFile,
    /// How long a tool change takes.
    pub tool_change: Seconds,
    /// Tools on the first day.
    pub tools: BTreeMap<ToolNumber, InitialTool>,
    /// Work offsets on the first day, mm along X, Y, Z in the machine frame, by name. X in diameters where the axis counts so.
    pub work_offsets: BTreeMap<String, [f64; 3]>,
    /// How long its records are kept.
    pub retention: Retention,
    /// How its controller is reached.
    pub link: LinkFile,
    /// Servo cycles that may be lost in a row before its controller makes a controlled stop.
    pub late_ticks_allowed: u32,
    /// Servo cycles in a row that may come late on simulated drives, which wait for them; beyond it [`MachineFile::late_ticks_allowed`] holds.
    pub late_ticks_made_up: u32,
    /// What happens at cycle start with a program that was edited outside.
    pub edited_outside: EditedOutside,
    /// What it says of loops, drives, references, spindle and cut.
    pub model: Model,
}

/// What stands on a machine's nameplate.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Nameplate {
    /// Who made it.
    pub brand: Option<String>,
    /// Its model; without it the machine's name.
    pub model: Option<String>,
    /// Its serial number.
    pub serial_number: Option<String>,
}

/// What the shop declares of a coolant; nothing of it is measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coolant {
    /// What it is called.
    pub product: Option<String>,
    /// Emulsion, oil.
    pub kind: Option<String>,
    /// Share of concentrate, %.
    pub concentration_percent: Option<f64>,
    /// pH.
    pub ph: Option<f64>,
    /// Batch.
    pub batch: Option<String>,
    /// When it was filled, as somebody wrote it down.
    pub filled: Option<String>,
}

/// Ports and certificates of the set-point link. The certificates of a controller and of a computer that drives one are named alike.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinkFile {
    /// Port on which the controller listens.
    pub port: Option<u16>,
    /// Port on which the driving side listens for the reports of the text link.
    pub report_port: Option<u16>,
    /// Who this side is, PEM.
    pub certificate: Option<PathBuf>,
    /// The key to it, PEM.
    pub key: Option<PathBuf>,
    /// Whose signature the other side's certificate has to bear, PEM.
    pub authority: Option<PathBuf>,
}

/// What happens at cycle start with a program that is another one than was known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EditedOutside {
    /// It is said and recorded, and the program runs.
    #[default]
    Warn,
    /// It is said and recorded, and nothing moves.
    Refuse,
}

/// What kind of machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MachineKind {
    /// The tool turns.
    Mill,
    /// The part turns.
    Lathe,
}

/// What a machine's G-code means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Control {
    /// Fanuc, machining centre.
    FanucMill,
    /// Fanuc, lathe, G-code system A.
    FanucLathe,
    /// NIST RS274, as LinuxCNC reads it.
    Rs274,
}

impl Control {
    /// The word of `--dialect`.
    pub fn word(self) -> &'static str {
        match self {
            Control::FanucMill => "fanuc-mill",
            Control::FanucLathe => "fanuc-lathe",
            Control::Rs274 => "rs274",
        }
    }
}

/// Who moves the axes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Driver {
    /// The built-in simulator.
    Sim,
    /// A motion card, whose registers are this file. The machine is real.
    Card(PathBuf),
}

/// One axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisFile {
    /// Lower end of travel, machine frame; X of a lathe as a radius.
    pub travel_min: Millimetres,
    /// Upper end of travel.
    pub travel_max: Millimetres,
    /// The end at which its reference is; the position there is 0.
    pub home: HomeEnd,
    /// Its largest speed.
    pub v_max: MmPerSec,
    /// Its largest acceleration.
    pub a_max: MmPerSec2,
    /// Its largest jerk.
    pub j_max: MmPerSec3,
    /// Encoder pulses in a millimetre.
    pub pulses_per_mm: f64,
    /// True when program text and offsets of this axis count diameters.
    pub diameter: bool,
}

/// An end of travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HomeEnd {
    /// The lower one.
    Min,
    /// The upper one.
    Max,
}

/// The spindle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpindleFile {
    /// Its largest speed.
    pub max: Rpm,
    /// How fast it gets there, rev/min each second.
    pub acceleration_rpm_s: f64,
}

/// A tool on the first day.
#[derive(Clone, Debug, PartialEq)]
pub struct InitialTool {
    /// Words for people.
    pub name: String,
    /// Cutting diameter.
    pub diameter: Option<Millimetres>,
    /// Radius register of compensation: a mill's D, a turning tool's nose radius.
    pub radius: Option<Millimetres>,
    /// Where the imaginary tip of a turning tool lies, 0 to 9 as the controls number it.
    pub tip_direction: Option<u8>,
    /// From tip to gauge point along X, Y, Z, mm. X in diameters where the axis counts so.
    pub geometry: [f64; 3],
}

/// The machines that need no file: their names and texts.
pub const BUILT_IN: &[(&str, &str)] = &[
    ("sim-mill", include_str!("../machines/sim-mill.toml")),
    ("sim-lathe", include_str!("../machines/sim-lathe.toml")),
];

impl MachineFile {
    /// The built-in machine of a kind: what `--machine sim` gives.
    pub fn simulated(kind: MachineKind) -> MachineFile {
        let (name, text) = BUILT_IN[match kind {
            MachineKind::Mill => 0,
            MachineKind::Lathe => 1,
        }];
        Self::parse(text, name).expect("the built-in machines are read in a test")
    }

    /// A machine by what `--machine` says: the name of a built-in one, or a path.
    ///
    /// # Errors
    /// As [`MachineFile::open`].
    pub fn find(name: &str) -> Result<MachineFile, StoreError> {
        match BUILT_IN.iter().find(|(built_in, _)| *built_in == name) {
            Some((name, text)) => Self::parse(text, name),
            None => Self::open(Path::new(name)),
        }
    }

    /// Reads a machine file.
    ///
    /// # Errors
    /// It cannot be read, is no UTF-8, or [`MachineFile::parse`] refuses it.
    pub fn open(path: &Path) -> Result<MachineFile, StoreError> {
        let text = std::fs::read_to_string(path).map_err(StoreError::io("read", path))?;
        let mut machine = Self::parse(&text, &path.display().to_string())?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let link = &mut machine.link;
        for file in [&mut link.certificate, &mut link.key, &mut link.authority]
            .into_iter()
            .flatten()
        {
            *file = folder.join(&file);
        }
        if let Driver::Card(registers) = &mut machine.driver {
            *registers = folder.join(&registers);
        }
        Ok(machine)
    }

    /// Reads the text of a machine file; `file` is its name in messages.
    ///
    /// # Errors
    /// With line and column: the text is no TOML, a key is unknown, missing or of the wrong type, or a value cannot be.
    pub fn parse(text: &str, file: &str) -> Result<MachineFile, StoreError> {
        let refuse = |at: Option<usize>, message: &str| {
            let mut found = Diagnostic::error("machine-file", message.trim().replace('\n', ", ")).in_file(file);
            if let Some(at) = at {
                let (line, column) = place(text, at);
                found = found.at_line(line, column);
            }
            StoreError::MachineFile(Box::new(found))
        };
        let read: Text = toml::from_str(text).map_err(|e| refuse(e.span().map(|s| s.start), e.message()))?;
        let machine = read.checked().map_err(|(at, message)| refuse(Some(at), &message))?;
        if let Some((name, message)) = machine.contradiction() {
            // Each number could be by itself: the place is that of the last key of this kind.
            let keys = crate::machine_told::values(text);
            let there = keys
                .iter()
                .rev()
                .find(|told| told.key.rsplit('.').next().is_some_and(|key| key.contains(name)));
            let mut found = Diagnostic::error("machine-file", message).in_file(file);
            if let Some(told) = there {
                found = found.at_line(told.line, told.column);
            }
            return Err(StoreError::MachineFile(Box::new(found)));
        }
        Ok(machine)
    }

    /// An axis; `None` when the machine has none of that name.
    pub fn axis(&self, axis: Axis) -> Option<&AxisFile> {
        self.axes[axis.index()].as_ref()
    }

    /// True when offsets of this axis count diameters.
    pub fn counts_diameters(&self, axis: Axis) -> bool {
        self.axis(axis).is_some_and(|a| a.diameter)
    }
}

/// Line and column, from 1, in characters.
pub(crate) fn place(text: &str, at: usize) -> (u32, u32) {
    let before = text.get(..at).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    (line as u32, column as u32)
}

#[cfg(test)]
mod tests;
