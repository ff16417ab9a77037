//! What statements do.

use super::statement::Statement;
use super::{AptProgram, Circle, Fault, Feed, cycle, marker};
use plan::{
    Arc, CoolantState, FrameChange, Level, MachineMove, Move, Path, RawNcFunction, Severity, Speed, SpindleMode, SpindleState,
    StepKind, StopKind, ToolCall, ToolOffset,
};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use units::{MM_PER_INCH, Millimetres, MmPerSec, Point, Radians, Rpm, Seconds, Setup, ToolNumber, Transform, Vector};

/// The statements that are known, for telling such a file from G-code.
pub(crate) const MAJORS: [&str; 32] = [
    "TOOL PATH",
    "END-OF-PATH",
    "GOTO",
    "GODLTA",
    "FROM",
    "RAPID",
    "FEDRAT",
    "CIRCLE",
    "LOADTL",
    "LOAD",
    "TURRET",
    "SPINDL",
    "COOLNT",
    "CYCLE",
    "MULTAX",
    "UNITS",
    "PPRINT",
    "TLDATA",
    "MSYS",
    "PARTNO",
    "MACHIN",
    "PAINT",
    "FINI",
    "DELAY",
    "STOP",
    "OPSTOP",
    "GOHOME",
    "INSERT",
    "CUTTER",
    "AUXFUN",
    "PREFUN",
    "SELECTL",
];

/// Statements that change nothing of what is done here.
const SILENT: [&str; 19] = [
    "PAINT", "MACHIN", "CUTTER", "SELECTL", "INTOL", "OUTTOL", "TOLER", "LINTOL", "REMARK", "CLPRNT", "NOPOST", "CLEARP",
    "DISPLY", "ARCSLP", "MODE", "SET", "HEAD", "PLABEL", "SEQNO",
];

/// Motion that only an APT processor can work out.
const WORKED_OUT: [&str; 13] = [
    "GO", "GOFWD", "GOLFT", "GORGT", "GOBACK", "GOUP", "GODOWN", "TLON", "TLLFT", "TLRGT", "INDIRV", "MOVARC", "COPY",
];

/// An arc whose ends are farther off its circle does not close, mm: NX gives four decimals, and radii of its splines' arcs.
const ARC_FIT: f64 = 0.05;

/// Fastest turn with a surface speed and no limit, rev/min.
const SURFACE_LIMIT: f64 = 3000.0;

impl AptProgram {
    /// Does one statement; true when the machine is asked for the switch of optional stops.
    pub(super) fn act(&mut self, statement: &Statement) -> Result<bool, Fault> {
        let numbers = statement.numbers();
        // A kilometre is more than any machine; what is far beyond is no place, and its arithmetic no number.
        if let Some(far) = numbers.iter().find(|number| number.abs() > 1e9) {
            return fault(
                "number-range",
                format!("{far:e} is no number of a machine"),
                "correct the line",
            );
        }
        match statement.major.as_str() {
            "UNITS" => {
                let inches = statement.words.iter().any(|word| word.to_ascii_uppercase().starts_with("IN"));
                self.run.state.unit = if inches { MM_PER_INCH } else { 1.0 };
            }
            "PARTNO" => {}
            "TOOL PATH" => self.tool_path(statement),
            "END-OF-PATH" => {
                self.run.state.cycle = None;
                self.run.state.circle = None;
            }
            "TLDATA" => self.tool_data(statement, &numbers)?,
            "MSYS" => self.system(&numbers)?,
            "LOADTL" | "TURRET" | "LOAD" => self.load(statement)?,
            "SPINDL" => self.spindle(statement)?,
            "COOLNT" => self.coolant(statement),
            "FEDRAT" => self.feed_rate(statement)?,
            "RAPID" => self.run.state.rapid = true,
            "CIRCLE" => self.run.state.circle = Some(self.circle(statement, &numbers)?),
            "GOTO" => self.go_to(statement, &numbers)?,
            "GODLTA" => {
                let unit = self.run.state.unit;
                let tip = self.tip();
                let to = match numbers[..] {
                    [z] => [tip[0], tip[1], tip[2] + z * unit],
                    [x, y, z] => [tip[0] + x * unit, tip[1] + y * unit, tip[2] + z * unit],
                    _ => {
                        return fault(
                            "number-count",
                            "GODLTA needs a depth, or dx, dy and dz".into(),
                            "correct the line",
                        );
                    }
                };
                self.tool_is_due()?;
                self.travel(to)?;
            }
            "FROM" => {
                let message = "FROM says where the tool stands; it is taken to stand where the machine is";
                self.note(Severity::Remark, "from", message, "");
            }
            "GOHOME" => {
                self.tool_is_due()?;
                self.run.state.gauge = Point::ORIGIN;
                self.say(StepKind::MachineMove(MachineMove {
                    to: [Some(Millimetres(0.0)); 3],
                }));
            }
            "CYCLE" => self.begin_cycle(statement)?,
            "DELAY" | "DWELL" => {
                let time = numbers.first().copied().unwrap_or(0.0);
                let seconds = if statement.has("REV") {
                    let turns = self.run.state.spindle.revolutions(Millimetres::ZERO).0;
                    if turns <= 0.0 {
                        return fault(
                            "delay",
                            "a delay counts revolutions and the spindle stands".into(),
                            "give it in seconds",
                        );
                    }
                    time / turns * 60.0
                } else {
                    time
                };
                if seconds < 0.0 {
                    return fault("delay", format!("a delay of {seconds} s"), "correct the time");
                }
                self.say(StepKind::Dwell(Seconds(seconds)));
            }
            "STOP" => self.say(StepKind::Stop(StopKind::Program)),
            "OPSTOP" => return Ok(true),
            "PPRINT" => self.say(StepKind::Message(statement.rest.clone())),
            "INSERT" | "AUXFUN" | "PREFUN" => self.say(StepKind::NcFunction(RawNcFunction {
                kind: statement.major.to_lowercase(),
                name: statement.major.to_lowercase(),
                text: statement.rest.clone(),
                condition: None,
                properties: BTreeMap::new(),
            })),
            "MULTAX" => {
                if !statement.has("OFF") {
                    return fault(
                        "multax",
                        "the file asks for more than three axes (MULTAX)".into(),
                        "let the CAM system write the path for a fixed tool axis",
                    );
                }
            }
            "CUTCOM" => {
                if !statement.has("OFF") {
                    let message = "cutter compensation (CUTCOM) is left to a control; the path is taken as the tool's centre";
                    let remedy = "check that the CAM system has written the centre of the tool";
                    self.note(Severity::Warning, "cutcom", message, remedy);
                }
            }
            "FINI" | "END" => self.run.at = self.text.len(),
            major if WORKED_OUT.contains(&major) => {
                return fault(
                    "apt-processor",
                    format!("{major} is motion that an APT processor has to work out first"),
                    "write the file with places only (GOTO and CIRCLE)",
                );
            }
            major if SILENT.contains(&major) => {}
            major => {
                let message = format!("the statement {major} is not known here and passed over");
                self.note(
                    Severity::Warning,
                    "unknown-statement",
                    &message,
                    "check that it moves nothing",
                );
            }
        }
        Ok(false)
    }

    // ---- structure and tools

    fn tool_path(&mut self, statement: &Statement) {
        let name = statement.words.first().cloned().unwrap_or_else(|| "tool path".into());
        let tool = statement.words.iter().position(|word| word.eq_ignore_ascii_case("TOOL"));
        let tool = tool.and_then(|at| statement.words.get(at + 1)).cloned().unwrap_or_default();
        let state = &mut self.run.state;
        let open = std::mem::replace(&mut state.open, true);
        state.tool_words = tool;
        state.tool_due = true;
        state.diameter = None;
        state.cycle = None;
        if open {
            self.say(StepKind::End(Level::Workingstep));
        }
        self.say(StepKind::Begin(marker(Level::Workingstep, name)));
    }

    fn tool_data(&mut self, statement: &Statement, _numbers: &[f64]) -> Result<(), Fault> {
        let kind = statement
            .words
            .first()
            .map(|word| word.to_ascii_uppercase())
            .unwrap_or_default();
        if kind.contains("LATHE") || kind.contains("TURN") {
            return fault(
                "turning",
                "paths of a turning tool are not read from cutter-location files".into(),
                "convert the G-code of the lathe",
            );
        }
        let diameter = statement.words.get(1).and_then(|word| super::statement::number(word));
        self.run.state.diameter = diameter.filter(|d| *d > 0.0).map(|d| d * self.run.state.unit);
        Ok(())
    }

    fn load(&mut self, statement: &Statement) -> Result<(), Fault> {
        let numbers: Vec<f64> = statement
            .words
            .iter()
            .filter_map(|word| super::statement::number(word))
            .collect();
        let number = numbers.first().copied().filter(|n| *n >= 0.0 && n.fract() == 0.0 && *n < 1e9);
        let Some(number) = number else {
            let message = format!("{} needs a tool number", statement.major);
            return fault("tool-number", message, "write LOADTL/ and the number");
        };
        self.call(ToolNumber(number as u32));
        Ok(())
    }

    /// A path that names a tool and loads none gets one: the name's number, the next free one the first time.
    pub(super) fn tool_is_due(&mut self) -> Result<(), Fault> {
        if !self.run.state.tool_due {
            return Ok(());
        }
        self.run.state.tool_due = false;
        let name = self.run.state.tool_words.clone();
        if name.is_empty() {
            return Ok(());
        }
        let known = self.run.state.numbers.get(&name).copied();
        let number = known.unwrap_or_else(|| {
            let taken = &self.run.state.numbers;
            (1..)
                .find(|free| !taken.values().any(|used| used == free))
                .unwrap_or(u32::MAX)
        });
        if known.is_none() {
            let message = format!("tool '{name}' has no number (no LOADTL): T{number} is assumed");
            self.note(Severity::Warning, "tool-number", &message, "let the CAM system write LOADTL");
        }
        self.call(ToolNumber(number));
        Ok(())
    }

    fn call(&mut self, number: ToolNumber) {
        let name = self.run.state.tool_words.clone();
        self.run.state.tool_due = false;
        if !name.is_empty() {
            self.run.state.numbers.insert(name.clone(), number.0);
        }
        if self.run.state.tool == Some(number) && self.run.state.tool_name == name {
            return;
        }
        if self.run.state.spindle != SpindleState::Stopped {
            self.turn(SpindleState::Stopped);
        }
        let entry = self.tables.tools.get(&number);
        let (geometry, wear) = entry.map_or((Vector::ZERO, Vector::ZERO), |entry| (entry.geometry.0, entry.wear.0));
        let offset = ToolOffset {
            number: number.0,
            geometry,
            wear,
            assumed: entry.is_none() && number.0 != 0,
        };
        let state = &mut self.run.state;
        (state.tool, state.offset) = (Some(number), offset);
        state.tool_name.clone_from(&name);
        let diameter = state.diameter.map(Millimetres);
        if offset.assumed {
            let message = format!("tool {number} is not in the tool table: its length is assumed to be 0");
            self.note(Severity::Warning, "tool-table", &message, "enter the tool with its length");
        }
        self.say(StepKind::Tool(ToolCall { number, name, diameter }));
        self.say(StepKind::ToolOffset(offset));
    }

    /// The machining system: the first is the set-up, another one lies where it lies in the first.
    fn system(&mut self, numbers: &[f64]) -> Result<(), Fault> {
        let &[x, y, z, ix, iy, iz, jx, jy, jz] = numbers else {
            return fault("number-count", "MSYS needs nine numbers".into(), "correct the line");
        };
        let unit = self.run.state.unit;
        let (i, j) = (Vector::<Setup>::new(ix, iy, iz), Vector::<Setup>::new(jx, jy, jz));
        let origin = Point::<Setup>::new(x * unit, y * unit, z * unit);
        let Some(system) = Transform::<Setup, Setup>::from_axes(origin, i.cross(j), i) else {
            return fault("msys", "the axes of MSYS have no direction".into(), "correct the line");
        };
        let first = *self.run.state.first_system.get_or_insert(system);
        let g54 = self.tables.work_offsets.get("G54").copied();
        let base = g54.unwrap_or(Transform::IDENTITY);
        let frame = if system == first {
            base
        } else {
            base * (first.inverse() * system)
        };
        if frame != self.run.state.frame {
            self.run.state.frame = frame;
            self.say(StepKind::Frame(FrameChange {
                name: "G54".into(),
                machine_from_setup: frame,
                assumed: g54.is_none(),
            }));
        }
        Ok(())
    }

    // ---- what is in force

    fn spindle(&mut self, statement: &Statement) -> Result<(), Fault> {
        if statement.has("OFF") || statement.has("STOP") {
            self.turn(SpindleState::Stopped);
            return Ok(());
        }
        let speeds = ["RPM", "SFM", "SMM", "SURF"];
        let named = speeds
            .into_iter()
            .find_map(|word| Some((word, statement.number_after(word)?)));
        let plain = statement.numbers().first().copied();
        let clockwise = !(statement.has("CCLW") || statement.has("CCW"));
        let limit = ["MAXRPM", "RANGE"].into_iter().find_map(|word| statement.number_after(word));
        let unit = if statement.has("SFM") { 304.8 / 60.0 } else { 1000.0 / 60.0 };
        let surface = named.is_some_and(|(word, _)| word != "RPM") || statement.has("SFM") || statement.has("SMM");
        let mode = match (named.map(|(_, speed)| speed).or(plain), surface) {
            (Some(speed), false) => SpindleMode::Revolutions(Rpm(speed.abs())),
            (Some(speed), true) => SpindleMode::Surface {
                speed: MmPerSec(speed.abs() * unit),
                limit: Rpm(limit.unwrap_or(SURFACE_LIMIT)),
            },
            (None, _) => {
                let last = self.run.state.speed;
                if last == SpindleState::Stopped {
                    return fault(
                        "spindle",
                        "the spindle is turned on without a speed".into(),
                        "write SPINDL/RPM,1000,CLW",
                    );
                }
                self.turn(last);
                return Ok(());
            }
        };
        let state = match clockwise {
            true => SpindleState::Clockwise(mode),
            false => SpindleState::Counterclockwise(mode),
        };
        self.run.state.speed = state;
        self.turn(state);
        Ok(())
    }

    pub(super) fn turn(&mut self, state: SpindleState) {
        if self.run.state.spindle != state {
            self.run.state.spindle = state;
            self.say(StepKind::Spindle(state));
        }
    }

    fn coolant(&mut self, statement: &Statement) {
        let state = match () {
            () if statement.has("OFF") => CoolantState::default(),
            () if statement.has("MIST") => CoolantState {
                mist: true,
                ..CoolantState::default()
            },
            () if statement.has("THRU") || statement.has("THROUGH") => CoolantState {
                through: true,
                ..CoolantState::default()
            },
            () => CoolantState {
                flood: true,
                ..CoolantState::default()
            },
        };
        if state != self.run.state.coolant {
            self.run.state.coolant = state;
            self.say(StepKind::Coolant(state));
        }
    }

    fn feed_rate(&mut self, statement: &Statement) -> Result<(), Fault> {
        let number = statement.words.iter().find_map(|word| super::statement::number(word));
        match number.filter(|feed| *feed > 0.0) {
            Some(number) => self.run.state.feed = Some(self.feed_of(statement, number)),
            None => return fault("feed", "FEDRAT needs a number above 0".into(), "write FEDRAT/MMPM,250"),
        }
        self.run.state.rapid = false;
        Ok(())
    }

    /// A feed with the unit that stands in its statement; the file's own per minute otherwise.
    pub(super) fn feed_of(&self, statement: &Statement, number: f64) -> Feed {
        let unit = self.run.state.unit;
        match () {
            () if statement.has("MMPR") => Feed::PerRevolution(number),
            () if statement.has("IPR") => Feed::PerRevolution(number * MM_PER_INCH),
            () if statement.has("PERREV") => Feed::PerRevolution(number * unit),
            () if statement.has("MMPM") => Feed::PerTime(number / 60.0),
            () if statement.has("IPM") => Feed::PerTime(number * MM_PER_INCH / 60.0),
            () => Feed::PerTime(number * unit / 60.0),
        }
    }

    // ---- motion

    pub(super) fn tip(&self) -> [f64; 3] {
        (self.run.state.frame.inverse() * (self.run.state.gauge - self.run.state.offset.total())).xyz
    }

    fn circle(&self, statement: &Statement, numbers: &[f64]) -> Result<Circle, Fault> {
        let &[x, y, z, i, j, k, radius, ..] = numbers else {
            return fault(
                "number-count",
                "CIRCLE needs centre, axis and radius: seven numbers".into(),
                "correct the line",
            );
        };
        let unit = self.run.state.unit;
        let Some(axis) = Vector::<Setup>::new(i, j, k).unit() else {
            return fault("circle", "the axis of a circle has no direction".into(), "correct the line");
        };
        Ok(Circle {
            centre: [x * unit, y * unit, z * unit],
            axis: axis.xyz,
            radius: radius.abs() * unit,
            turns: statement.number_after("TIMES").unwrap_or(1.0).max(1.0),
        })
    }

    fn go_to(&mut self, statement: &Statement, numbers: &[f64]) -> Result<(), Fault> {
        let (place, axis) = match *numbers {
            [x, y, z] => ([x, y, z], None),
            [x, y, z, i, j, k, ..] => ([x, y, z], Some([i, j, k])),
            _ => {
                return fault(
                    "number-count",
                    format!(
                        "GOTO needs three numbers, or six with a tool axis; it has '{}'",
                        statement.rest
                    ),
                    "correct the line",
                );
            }
        };
        if let Some([i, j, k]) = axis
            && !(k > 0.0 && i.abs() <= 1e-6 * k && j.abs() <= 1e-6 * k)
        {
            return fault(
                "tool-axis",
                format!("the tool axis is tilted to {i}, {j}, {k}: this needs more than three axes"),
                "let the CAM system write the path for a fixed tool axis along Z",
            );
        }
        let to = place.map(|c| c * self.run.state.unit);
        self.tool_is_due()?;
        if self.run.state.cycle.is_some() {
            return self.hole(to);
        }
        match self.run.state.circle.take() {
            Some(circle) => self.arc_to(circle, to),
            None => self.travel(to),
        }
    }

    /// A straight move; `RAPID` holds for one.
    pub(super) fn travel(&mut self, to: [f64; 3]) -> Result<(), Fault> {
        let rapid = std::mem::replace(&mut self.run.state.rapid, false);
        let speed = if rapid { Speed::Rapid } else { self.speed()? };
        self.line(to, speed);
        Ok(())
    }

    pub(super) fn line(&mut self, to: [f64; 3], speed: Speed) {
        let (from, to) = (Point::from_xyz(self.tip()), Point::from_xyz(to));
        self.run.state.gauge = self.run.state.frame * to + self.run.state.offset.total();
        if from.distance(to) > 1e-9 {
            self.say(StepKind::Move(Move {
                path: Path::Line { from, to },
                speed,
                profile: None,
                derived: false,
            }));
        }
    }

    pub(super) fn speed(&self) -> Result<Speed, Fault> {
        match self.run.state.feed {
            Some(feed) => Ok(Speed::Feed(plan_feed(feed))),
            None => fault(
                "no-feed",
                "the tool cuts before any FEDRAT was said".into(),
                "write FEDRAT/ before it, or RAPID",
            ),
        }
    }

    /// Along the circle to a place: clockwise about its axis, as NX has it; the same place is the whole circle.
    fn arc_to(&mut self, circle: Circle, to: [f64; 3]) -> Result<(), Fault> {
        self.run.state.rapid = false;
        let speed = self.speed()?;
        let (from, to) = (Point::<Setup>::from_xyz(self.tip()), Point::<Setup>::from_xyz(to));
        let normal = Vector::<Setup>::from_xyz(circle.axis);
        let centre = Point::<Setup>::from_xyz(circle.centre);
        let centre = centre + normal * (from - centre).dot(normal);
        let rise = (to - from).dot(normal);
        let end = to - normal * rise;
        for (place, which) in [(from, "begins"), (end, "ends")] {
            let off = (place.distance(centre) - circle.radius).abs();
            if off > ARC_FIT {
                return fault(
                    "arc-radius",
                    format!("an arc {which} {off:.4} mm off its circle of radius {:.4} mm", circle.radius),
                    "correct centre, radius or places; 0.05 mm are allowed",
                );
            }
        }
        let whole = from.distance(end) <= 1e-4;
        // Rounded places: the centre moves along the chord so that both ends lie on one circle.
        let middle = match (end - from).unit() {
            Some(along) if !whole => centre + along * (from.toward(end, 0.5) - centre).dot(along),
            _ => centre,
        };
        let (a, b) = (from - middle, end - middle);
        let angle = libm::atan2(normal.dot(b.cross(a)), a.dot(b));
        let once = match whole {
            true => TAU,
            false if angle <= 0.0 => angle + TAU,
            false => angle,
        };
        let sweep = -(once + (circle.turns - 1.0) * TAU);
        self.run.state.gauge = self.run.state.frame * to + self.run.state.offset.total();
        self.say(StepKind::Move(Move {
            path: Path::Arc(Arc {
                from,
                centre: middle,
                normal,
                sweep: Radians(sweep),
                rise,
            }),
            speed,
            profile: None,
            derived: false,
        }));
        Ok(())
    }

    fn begin_cycle(&mut self, statement: &Statement) -> Result<(), Fault> {
        if statement.has("OFF") {
            self.run.state.cycle = None;
        } else if !statement.has("ON") {
            self.run.state.cycle = Some(cycle::Cycle::of(self, statement)?);
        }
        Ok(())
    }

    pub(super) fn unit(&self) -> f64 {
        self.run.state.unit
    }
}

pub(super) fn plan_feed(feed: Feed) -> plan::Feed {
    match feed {
        Feed::PerTime(speed) => plan::Feed::PerTime(MmPerSec(speed)),
        Feed::PerRevolution(length) => plan::Feed::PerRevolution(Millimetres(length)),
    }
}

pub(super) fn fault<T>(code: &'static str, message: String, remedy: &'static str) -> Result<T, Fault> {
    Err(Fault { code, message, remedy })
}
