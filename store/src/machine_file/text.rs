//! The text of a machine file as serde reads it, and the checks that make it a machine.

use super::model::{AxisTables, CardText, Tables, Values};
use super::*;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Text {
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
pub(super) type Refusal = (usize, String);

impl Text {
    pub(super) fn checked(mut self) -> Result<MachineFile, Refusal> {
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
