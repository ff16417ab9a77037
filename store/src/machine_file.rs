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

pub use model::Model;

use crate::{Retention, StoreError};
use model::{AxisTables, CardText, Tables, Values};
use plan::Diagnostic;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::num::NonZeroU16;
use std::path::{Path, PathBuf};
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

// -- the text, as serde reads it

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: Spanned<String>,
    kind: Spanned<MachineKind>,
    #[serde(default)]
    nameplate: Nameplate,
    #[serde(default)]
    coolant: CoolantText,
    control: Option<Control>,
    #[serde(default)]
    control_parameters: BTreeMap<Spanned<String>, Finite>,
    driver: Spanned<DriverText>,
    tool_change_s: NotNegative,
    axes: AxesText,
    spindle: SpindleText,
    #[serde(default)]
    work_offsets: BTreeMap<Spanned<String>, OffsetText>,
    #[serde(default)]
    tools: Vec<ToolText>,
    #[serde(default)]
    store: StoreText,
    #[serde(default)]
    link: LinkText,
    late_ticks_allowed: Option<Spanned<u32>>,
    #[serde(default, rename = "loop")]
    of_loop: Values,
    #[serde(default)]
    cutting: Values,
    #[serde(default)]
    tool_changer: Values,
    card: Option<Spanned<CardText>>,
    late_ticks_made_up: Option<Spanned<u32>>,
    #[serde(default)]
    programs: ProgramsText,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum DriverText {
    Sim,
    Card,
}

/// What a machine without a word of it allows.
const LATE_TICKS: u32 = 5;
/// A tenth of a second without control is no control.
const MOST_LATE_TICKS: u32 = 100;
/// What simulated drives wait for when nothing is said: a computer without realtime rights that compiles something is away for tens of
/// milliseconds, and the set-points on their way bridge 200 to 500.
const LATE_TICKS_MADE_UP: u32 = 500;
/// Who was away for longer was suspended, and a person should know.
const MOST_MADE_UP: u32 = 1000;

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct LinkText {
    port: Option<NonZeroU16>,
    report_port: Option<NonZeroU16>,
    certificate: Option<PathBuf>,
    key: Option<PathBuf>,
    authority: Option<PathBuf>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct CoolantText {
    product: Option<String>,
    kind: Option<String>,
    concentration_percent: Option<Share>,
    ph: Option<NotNegative>,
    batch: Option<String>,
    filled: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ProgramsText {
    #[serde(default)]
    edited_outside: EditedOutside,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoreText {
    raw_days: Option<Positive>,
    quota_bytes: Option<Bytes>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AxesText {
    x: Spanned<AxisText>,
    y: Option<Spanned<AxisText>>,
    z: Spanned<AxisText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AxisText {
    travel_min_mm: Finite,
    travel_max_mm: Finite,
    home: HomeEnd,
    v_max_mm_s: Positive,
    a_max_mm_s2: Positive,
    j_max_mm_s3: Positive,
    pulses_per_mm: Positive,
    #[serde(default)]
    diameter: bool,
    #[serde(default)]
    homing: Values,
    #[serde(default)]
    servo: Values,
    #[serde(default)]
    mechanics: Values,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpindleText {
    max_rpm: Positive,
    acceleration_rpm_s: Positive,
    #[serde(default)]
    drive: Values,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OffsetText {
    x_mm: Finite,
    #[serde(default)]
    y_mm: Finite,
    z_mm: Finite,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ToolText {
    number: Spanned<u32>,
    #[serde(default)]
    name: String,
    diameter_mm: Option<Positive>,
    radius_mm: Option<NotNegative>,
    tip_direction: Option<Spanned<u8>>,
    #[serde(default)]
    geometry_x_mm: Finite,
    #[serde(default)]
    geometry_y_mm: Finite,
    #[serde(default)]
    geometry_z_mm: Finite,
}

macro_rules! checked_number {
    ($(#[$doc:meta])* $name:ident, $is:expr, $message:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Default, Deserialize)]
        #[serde(try_from = "f64")]
        struct $name(f64);
        impl TryFrom<f64> for $name {
            type Error = String;
            fn try_from(number: f64) -> Result<Self, String> {
                let is: fn(f64) -> bool = $is;
                if is(number) { Ok($name(number)) } else { Err(format!("{number} cannot be: {}", $message)) }
            }
        }
    };
}
checked_number!(/// TOML knows `nan` and `inf`.
    Finite, f64::is_finite, "a finite number is needed");
checked_number!(/// A limit of 0 would be a machine that cannot move.
    Positive, |n| n.is_finite() && n > 0.0, "a finite number above 0 is needed");
checked_number!(/// A share of the whole.
    Share, |n| (0.0..=100.0).contains(&n), "0 to 100 is needed");
checked_number!(/// A duration.
    NotNegative, |n| n.is_finite() && n >= 0.0, "a finite number, 0 or more, is needed");

/// An amount of disk.
#[derive(Clone, Copy, Deserialize)]
#[serde(try_from = "i64")]
struct Bytes(u64);
impl TryFrom<i64> for Bytes {
    type Error = String;
    fn try_from(number: i64) -> Result<Self, String> {
        let bytes = u64::try_from(number).ok().filter(|n| *n > 0);
        bytes
            .map(Bytes)
            .ok_or_else(|| format!("{number} cannot be: a whole number above 0 is needed"))
    }
}

/// A refusal and where in the text.
type Refusal = (usize, String);

impl Text {
    fn checked(mut self) -> Result<MachineFile, Refusal> {
        let of_axis = |axis: Option<&mut AxisText>| axis.map_or_else(AxisTables::default, AxisText::tables);
        let model = Model::read(Tables {
            axes: [
                of_axis(Some(self.axes.x.get_mut())),
                of_axis(self.axes.y.as_mut().map(Spanned::get_mut)),
                of_axis(Some(self.axes.z.get_mut())),
            ],
            of_loop: self.of_loop,
            spindle_drive: self.spindle.drive,
            cutting: self.cutting,
            tool_changer: self.tool_changer,
        })?;
        let name_at = self.name.span().start;
        let name = self.name.into_inner();
        if name.is_empty() || name.chars().any(|c| c == '/' || c.is_control()) {
            return Err((
                name_at,
                format!("the name {name:?} must have letters, and no `/`: it is part of register paths"),
            ));
        }
        if let Some(late) = self
            .late_ticks_allowed
            .as_ref()
            .filter(|late| *late.get_ref() > MOST_LATE_TICKS)
        {
            return Err((late.span().start, format!("late_ticks_allowed is 0 to {MOST_LATE_TICKS}")));
        }
        if let Some(late) = self.late_ticks_made_up.as_ref().filter(|late| *late.get_ref() > MOST_MADE_UP) {
            return Err((late.span().start, format!("late_ticks_made_up is 0 to {MOST_MADE_UP}")));
        }
        let kind = *self.kind.get_ref();
        if kind == MachineKind::Mill && self.axes.y.is_none() {
            return Err((self.kind.span().start, "a mill needs [axes.y]".to_owned()));
        }
        let mut tools = BTreeMap::new();
        for tool in self.tools {
            let number = *tool.number.get_ref();
            if number == 0 {
                return Err((
                    tool.number.span().start,
                    "tool 0 is the empty spindle; number tools from 1".to_owned(),
                ));
            }
            if let Some(direction) = tool.tip_direction.as_ref().filter(|d| *d.get_ref() > 9) {
                return Err((direction.span().start, "a tip direction is 0 to 9".to_owned()));
            }
            let entry = InitialTool {
                name: tool.name,
                diameter: tool.diameter_mm.map(|d| Millimetres(d.0)),
                radius: tool.radius_mm.map(|r| Millimetres(r.0)),
                tip_direction: tool.tip_direction.map(Spanned::into_inner),
                geometry: [tool.geometry_x_mm.0, tool.geometry_y_mm.0, tool.geometry_z_mm.0],
            };
            if tools.insert(ToolNumber(number), entry).is_some() {
                return Err((tool.number.span().start, format!("tool {number} is there already")));
            }
        }
        let driver = match (self.driver.get_ref(), self.card) {
            (DriverText::Sim, None) => Driver::Sim,
            (DriverText::Card, Some(card)) => Driver::Card(card.into_inner().registers),
            (DriverText::Sim, Some(card)) => {
                let message = "[card] is for driver = \"card\"; driver = \"sim\" is the simulator, which has none";
                return Err((card.span().start, message.to_owned()));
            }
            (DriverText::Card, None) => {
                let message = "driver = \"card\" needs [card] with registers = \"...\", the file of its registers";
                return Err((self.driver.span().start, message.to_owned()));
            }
        };
        let mut work_offsets = BTreeMap::new();
        for (name, offset) in self.work_offsets {
            if name.get_ref().is_empty() {
                return Err((name.span().start, "a work offset needs a name: G54".to_owned()));
            }
            work_offsets.insert(name.into_inner(), [offset.x_mm.0, offset.y_mm.0, offset.z_mm.0]);
        }
        let mut control_parameters = BTreeMap::new();
        for (key, value) in self.control_parameters {
            let (number, bit) = key.get_ref().split_once('.').unwrap_or((key.get_ref(), "0"));
            let digits = |text: &str, most: usize| (1..=most).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit());
            if !digits(number, 5) || !matches!(bit.as_bytes(), [b'0'..=b'7']) {
                return Err((
                    key.span().start,
                    format!(
                        "control parameter {:?}: a number such as \"6050\", or number and bit such as \"6001.5\", is needed",
                        key.get_ref()
                    ),
                ));
            }
            if key.get_ref().contains('.') && value.0 != 0.0 && value.0 != 1.0 {
                return Err((
                    key.span().start,
                    format!("bit {} holds 0 or 1, not {}", key.get_ref(), value.0),
                ));
            }
            control_parameters.insert(key.into_inner(), value.0);
        }
        Ok(MachineFile {
            name,
            kind,
            nameplate: self.nameplate,
            coolant: Coolant {
                product: self.coolant.product,
                kind: self.coolant.kind,
                concentration_percent: self.coolant.concentration_percent.map(|share| share.0),
                ph: self.coolant.ph.map(|ph| ph.0),
                batch: self.coolant.batch,
                filled: self.coolant.filled,
            },
            control: self.control,
            control_parameters,
            driver,
            axes: [
                Some(checked_axis(Axis::X, self.axes.x)?),
                self.axes.y.map(|y| checked_axis(Axis::Y, y)).transpose()?,
                Some(checked_axis(Axis::Z, self.axes.z)?),
            ],
            spindle: SpindleFile {
                max: Rpm(self.spindle.max_rpm.0),
                acceleration_rpm_s: self.spindle.acceleration_rpm_s.0,
            },
            tool_change: Seconds(self.tool_change_s.0),
            tools,
            work_offsets,
            edited_outside: self.programs.edited_outside,
            retention: Retention {
                raw_days: self.store.raw_days.map_or(Retention::default().raw_days, |days| days.0),
                quota_bytes: self.store.quota_bytes.map(|bytes| bytes.0),
            },
            link: LinkFile {
                port: self.link.port.map(NonZeroU16::get),
                report_port: self.link.report_port.map(NonZeroU16::get),
                certificate: self.link.certificate,
                key: self.link.key,
                authority: self.link.authority,
            },
            late_ticks_allowed: self.late_ticks_allowed.map_or(LATE_TICKS, Spanned::into_inner),
            model,
            late_ticks_made_up: self.late_ticks_made_up.map_or(LATE_TICKS_MADE_UP, Spanned::into_inner),
        })
    }
}

impl AxisText {
    fn tables(&mut self) -> AxisTables {
        AxisTables {
            homing: std::mem::take(&mut self.homing),
            servo: std::mem::take(&mut self.servo),
            mechanics: std::mem::take(&mut self.mechanics),
        }
    }
}

fn checked_axis(axis: Axis, text: Spanned<AxisText>) -> Result<AxisFile, Refusal> {
    let at = text.span().start;
    let text = text.into_inner();
    let (low, high) = (text.travel_min_mm.0, text.travel_max_mm.0);
    if low >= high {
        return Err((
            at,
            format!("axis {axis}: travel_min_mm {low} must be below travel_max_mm {high}"),
        ));
    }
    if low > 0.0 || high < 0.0 {
        return Err((
            at,
            format!("axis {axis}: travel {low} to {high} mm does not reach 0, which is home"),
        ));
    }
    if text.diameter && axis != Axis::X {
        return Err((at, format!("axis {axis} cannot count diameters, only X can")));
    }
    Ok(AxisFile {
        travel_min: Millimetres(low),
        travel_max: Millimetres(high),
        home: text.home,
        v_max: MmPerSec(text.v_max_mm_s.0),
        a_max: MmPerSec2(text.a_max_mm_s2.0),
        j_max: MmPerSec3(text.j_max_mm_s3.0),
        pulses_per_mm: text.pulses_per_mm.0,
        diameter: text.diameter,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_machines_are_what_the_references_say() {
        let mill = MachineFile::simulated(MachineKind::Mill);
        let x = mill.axis(Axis::X).expect("a mill has X");
        assert_eq!(
            (x.v_max, x.a_max, x.j_max),
            (MmPerSec(500.0), MmPerSec2(3000.0), MmPerSec3(50_000.0))
        );
        assert_eq!(
            (mill.name.as_str(), mill.kind, mill.control),
            ("sim-mill", MachineKind::Mill, None)
        );
        let lathe = MachineFile::simulated(MachineKind::Lathe);
        assert_eq!((lathe.kind, lathe.control), (MachineKind::Lathe, Some(Control::FanucLathe)));
        assert!(lathe.axis(Axis::Y).is_none() && lathe.counts_diameters(Axis::X) && !lathe.counts_diameters(Axis::Z));
        for (name, _) in BUILT_IN {
            assert_eq!(MachineFile::find(name).expect("built in").name, *name);
        }
    }

    #[track_caller]
    fn check_refused(change: (&str, &str), expected: &str) {
        let text = BUILT_IN[0].1.replacen(change.0, change.1, 1);
        assert_ne!(text, BUILT_IN[0].1, "{change:?} changes nothing");
        let refused = MachineFile::parse(&text, "m.toml").expect_err(expected).to_string();
        assert!(refused.starts_with(&format!("error: m.toml:{expected}")), "{refused}");
    }

    #[test]
    fn what_cannot_be_is_refused_with_line_and_column() {
        check_refused(
            ("v_max_mm_s = 500.0", "v_max = 500.0"),
            "14:1: unknown field `v_max`, expected one of `travel_min_mm`",
        );
        check_refused(
            ("v_max_mm_s = 500.0", "v_max_mm_s = 0"),
            "14:14: 0 cannot be: a finite number above 0",
        );
        check_refused(("v_max_mm_s = 500.0", "v_max_mm_s = nan"), "14:14: NaN cannot be");
        check_refused(
            ("v_max_mm_s = 500.0", "v_max_mm_s = \"fast\""),
            "14:14: invalid type: string \"fast\", expected f64",
        );
        check_refused(("v_max_mm_s = 500.0", ""), "10:1: missing field `v_max_mm_s`");
        check_refused(
            ("kind = \"mill\"", "kind = \"saw\""),
            "3:8: unknown variant `saw`, expected `mill` or `lathe`",
        );
        check_refused(("kind = \"mill\"", "kind = mill"), "3:8: ");
        check_refused(
            ("travel_max_mm = 600.0", "travel_max_mm = -1000.0"),
            "10:1: axis X: travel_min_mm -1000 must be below",
        );
        check_refused(
            ("travel_max_mm = 600.0", "travel_max_mm = -10.0"),
            "10:1: axis X: travel -1000 to -10 mm does not reach 0",
        );
        check_refused(("[axes.y]", "[axes.w]"), "19:7: unknown field `w`");
        check_refused(
            ("raw_days = 90", "raw_days = 0"),
            "98:12: 0 cannot be: a finite number above 0",
        );
        check_refused(("raw_days = 90", "raw_dais = 90"), "98:1: unknown field `raw_dais`");
        check_refused(
            ("# quota_bytes = 500_000_000_000", "quota_bytes = 1.5"),
            "99:15: invalid type",
        );
        check_refused(
            ("edited_outside = \"warn\"", "edited_outside = \"maybe\""),
            "103:18: unknown variant `maybe`, expected `warn` or `refuse`",
        );
        check_refused(("number = 2", "number = 1"), "55:10: tool 1 is there already");
        check_refused(("name = \"sim-mill\"", "name = \"a/b\""), "2:8: the name \"a/b\"");
        check_refused(
            ("kind = \"mill\"", "kind = \"mill\"\nlate_ticks_allowed = 101"),
            "4:22: late_ticks_allowed is 0 to 100",
        );
        check_refused(
            ("kind = \"mill\"", "kind = \"mill\"\nlate_ticks_made_up = 1001"),
            "4:22: late_ticks_made_up is 0 to 1000",
        );
        check_refused(("[store]", "[link]\nport = 0\n[store]"), "98:8: ");
        check_refused(
            ("driver = \"sim\"", "driver = \"magic\""),
            "4:10: unknown variant `magic`, expected `sim` or `card`",
        );
        check_refused(
            ("driver = \"sim\"", "driver = \"card\""),
            "4:10: driver = \"card\" needs [card]",
        );
        check_refused(
            ("[store]", "[card]\nregisters = \"r\"\n[store]"),
            "97:1: [card] is for driver = \"card\"",
        );
    }

    #[test]
    fn the_registers_of_a_card_are_found_beside_the_machine_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("mill.toml");
        let text = BUILT_IN[0].1.replace("driver = \"sim\"", "driver = \"card\"");
        std::fs::write(&path, format!("{text}\n[card]\nregisters = \"mill.registers\"\n")).expect("written");
        let machine = MachineFile::open(&path).expect("a machine");
        assert_eq!(machine.driver, Driver::Card(folder.path().join("mill.registers")));
    }

    proptest::proptest! {
        /// Whatever a slip of the editor does to a good file: read, or refused with a place; never a panic.
        #[test]
        fn a_damaged_file_is_read_or_refused(at in 0.0..1.0_f64, length in 0usize..40, put in ".{0,6}") {
            let text = BUILT_IN[1].1;
            let from = (at * text.len() as f64) as usize;
            let to = (from + length).min(text.len());
            let damaged = format!("{}{put}{}", &text[..from], &text[to..]);
            if let Err(refused) = MachineFile::parse(&damaged, "m.toml") {
                proptest::prop_assert!(refused.to_string().starts_with("error: m.toml:"), "{refused}");
            }
        }
    }
}
