//! The job as it grows: each operation becomes a part of a STEP-NC plan, and its steps are those that the plan's own file has.
//!
//! With every operation the plan is written anew ([`stepnc::write`]) and read back, and what is new behind the last workingstep is given to
//! the planner. So the machine executes the very steps, with the very numbers, that anybody reads later from the file: record, rebuild
//! and comparison are those of a run from a file.

use super::protocol::{Coolant, Go, Operation, Turn};
use plan::{
    Answer, CoolantState, Diagnostic, Feed, FileId, FrameChange, Level, Marker, Move, Next, Origin, Path, PathMode, Place,
    ProgramStream, Speed, SpindleMode, SpindleState, Step, StepKind, Tables, ToolCall, ToolEntry, ToolOffset,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use stepnc::write::{WriteOptions, Written};
use stepnc::{StepNcStream, StreamOptions};
use store::MachineFile;
use units::{Axis, Machine, Millimetres, MmPerSec, Point, Radians, Rpm, Seconds, Setup, StepId, ToolNumber, Transform, Vector};

/// Two lengths of one tool that differ by less are the same, mm.
const SAME_LENGTH: f64 = 0.001;
/// The ends of an arc may be this differently far from its centre, mm: programs round their numbers.
const ARC_ROUNDING: f64 = 0.01;
/// An arc that ends as near to its beginning as this is a whole turn, mm.
const WHOLE_TURN: f64 = 1e-6;
/// Moves that an operation has at most.
const MOST_MOVES: usize = 1_000_000;

/// A job whose operations come one at a time.
pub struct LivePlan {
    machine: MachineFile,
    frame: FrameChange,
    /// Offsets of the machine, and lengths that the add-in gave.
    tables: Tables,
    options: WriteOptions,
    /// What all operations so far come to.
    kinds: Vec<StepKind>,
    operations: usize,
    gauge: Point<Machine>,
    offset: ToolOffset,
    tool: Option<u32>,
    /// The steps that were given out.
    given: Vec<Step>,
    written: Option<Written>,
}

impl LivePlan {
    /// A job without operations. All points are in the work offset of that name.
    ///
    /// # Errors
    /// The machine does not know the offset.
    pub fn new(machine: MachineFile, tables: Tables, work_offset: &str, options: WriteOptions) -> Result<LivePlan, String> {
        let known = tables.work_offsets.get(work_offset);
        let Some(machine_from_setup) = known else {
            let names: Vec<&str> = tables.work_offsets.keys().map(String::as_str).collect();
            return Err(format!(
                "the machine has no work offset '{work_offset}'; it has {}",
                names.join(", ")
            ));
        };
        Ok(LivePlan {
            frame: FrameChange {
                name: work_offset.to_owned(),
                machine_from_setup: *machine_from_setup,
                assumed: false,
            },
            machine,
            options,
            kinds: Vec::new(),
            operations: 0,
            gauge: tables.position,
            offset: ToolOffset::NONE,
            tool: None,
            given: Vec::new(),
            written: None,
            tables,
        })
    }

    /// Takes an operation and gives the steps that the machine has to do for it.
    ///
    /// # Errors
    /// It cannot be done, and nothing has changed: what is wrong with which of its moves, and what to do.
    pub fn add(&mut self, operation: &Operation) -> Result<Vec<Step>, String> {
        let before = (self.kinds.len(), self.gauge, self.offset, self.tool, self.tables.clone());
        let added = self.lower(operation).and_then(|()| self.write());
        match added {
            Ok(steps) => {
                self.operations += 1;
                Ok(steps)
            }
            Err(why) => {
                let kinds;
                (kinds, self.gauge, self.offset, self.tool, self.tables) = before;
                self.kinds.truncate(kinds);
                Err(why)
            }
        }
    }

    /// What the machine has to do when no more comes.
    ///
    /// # Errors
    /// The plan cannot be written: nothing was ever added.
    pub fn finish(&mut self) -> Result<Vec<Step>, String> {
        let all = self.read_back()?;
        self.give(all, None)
    }

    /// The plan of all operations so far, a STEP-NC file; `None` before the first.
    pub fn file(&self) -> Option<&Written> {
        self.written.as_ref()
    }

    /// How many operations there are.
    pub fn operations(&self) -> usize {
        self.operations
    }

    /// The machine's offsets, with the lengths of tools that the add-in gave.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// Writes the plan anew and gives what is new in it.
    fn write(&mut self) -> Result<Vec<Step>, String> {
        let mut said = Said::new(self.kinds.clone());
        let options = WriteOptions {
            tables: self.tables.clone(),
            ..self.options.clone()
        };
        let written = stepnc::write::convert(&mut said, &options, &mut |_| Answer::Unknown).map_err(|e| e.to_string())?;
        let before = self.written.replace(written);
        // What closes the program is not said before no more comes.
        let result = self.read_back().and_then(|all| {
            let last = all.iter().rposition(|step| step.kind == StepKind::End(Level::Workingstep));
            let end = last.ok_or("the operation moves nothing")? + 1;
            let new = self.give(all, Some(end))?;
            if new.is_empty() {
                Err("the operation moves nothing".to_owned())
            } else {
                Ok(new)
            }
        });
        if result.is_err() {
            self.written = before;
        }
        result
    }

    /// The steps of the plan, as anybody reads them from its file.
    fn read_back(&self) -> Result<Vec<Step>, String> {
        let written = self.written.as_ref().ok_or("the job has no operation")?;
        let program = stepnc::Program::read("plan.stpnc", written.bytes.clone()).map_err(|e| e.to_string())?;
        let options = StreamOptions {
            tables: self.tables.clone(),
            ..StreamOptions::default()
        };
        let mut stream = StepNcStream::new(Arc::new(program), options);
        let mut steps = Vec::new();
        loop {
            match stream.next(None) {
                Next::Step(step) => steps.push(step),
                Next::End => return Ok(steps),
                Next::Alarm(alarm) => return Err(alarm.to_string()),
                Next::Ask(question) => return Err(format!("the plan asks {question:?}, which no operation does")),
            }
        }
    }

    fn give(&mut self, mut all: Vec<Step>, end: Option<usize>) -> Result<Vec<Step>, String> {
        let same = |pair: (&Step, &Step)| pair.0.id == pair.1.id && same_step(&pair.0.kind, &pair.1.kind);
        if all.len() < self.given.len() || !self.given.iter().zip(&all).all(same) {
            return Err("it would change what was given to the machine before; use a job of its own for it".to_owned());
        }
        all.truncate(end.unwrap_or(all.len()));
        let mut new = all.split_off(self.given.len().min(all.len()));
        for step in &mut new {
            // The instances of what encloses the operations are known when the last one is there.
            if let StepKind::Begin(marker) = &mut step.kind
                && marker.level <= Level::Workplan
            {
                marker.entity = None;
                step.origin.place = Place::Given;
            }
        }
        self.given.extend(new.iter().cloned());
        Ok(new)
    }

    /// Says an operation in steps.
    fn lower(&mut self, operation: &Operation) -> Result<(), String> {
        if operation.name.trim().is_empty() {
            return Err("an operation needs a name".to_owned());
        }
        if operation.moves.is_empty() || operation.moves.len() > MOST_MOVES {
            let count = operation.moves.len();
            return Err(format!("an operation has 1 to {MOST_MOVES} moves, this one {count}"));
        }
        if self.kinds.is_empty() {
            self.kinds.push(StepKind::Frame(self.frame.clone()));
        }
        self.kinds.push(StepKind::Begin(Marker {
            level: Level::Workingstep,
            name: operation.name.clone(),
            entity: None,
            maximum_deviation: None,
            derived: false,
        }));
        self.call_tool(operation)?;
        self.kinds.push(StepKind::Spindle(self.spindle(operation)?));
        let feeds = |go: &Go| matches!(go, Go::Line { .. } | Go::Arc { .. });
        if operation.spindle.is_none()
            && !operation.standing_spindle
            && let Some(index) = operation.moves.iter().position(feeds)
        {
            return Err(format!(
                "move {} is a feed move and the spindle stands: give spindle, or standing_spindle true where that is meant",
                index + 1
            ));
        }
        let Coolant { flood, mist, through } = operation.coolant;
        self.kinds.push(StepKind::Coolant(CoolantState { flood, mist, through }));
        self.kinds.push(StepKind::PathMode(match operation.tolerance_mm {
            None => PathMode::Tolerance(None),
            Some(mm) if mm > 0.0 && mm <= 10.0 => PathMode::Tolerance(Some(Millimetres(mm))),
            Some(mm) => {
                return Err(format!(
                    "a tolerance of {mm} mm cannot be: more than 0 and at most 10 are needed"
                ));
            }
        }));
        for (index, go) in operation.moves.iter().enumerate() {
            let kind = self.go(go).map_err(|why| format!("move {}: {why}", index + 1))?;
            self.kinds.push(kind);
        }
        self.kinds.push(StepKind::End(Level::Workingstep));
        Ok(())
    }

    fn call_tool(&mut self, operation: &Operation) -> Result<(), String> {
        let tool = &operation.tool;
        if tool.number == 0 {
            return Err("tool 0 is the empty spindle; an operation needs a tool".to_owned());
        }
        let number = ToolNumber(tool.number);
        let known = self.tables.tools.get(&number);
        let length = known.map(|entry| entry.geometry.0.xyz[2]);
        match (length, tool.length_mm) {
            (_, Some(given)) if !(0.0..=2000.0).contains(&given) => {
                return Err(format!(
                    "tool {number}: a length of {given} mm cannot be: 0 to 2000 are needed"
                ));
            }
            (Some(known), Some(given)) if (known - given).abs() > SAME_LENGTH => {
                return Err(format!(
                    "tool {} is {known} mm long on this machine, the operation says {given} mm: measure it, and correct one of them",
                    tool.number
                ));
            }
            (None, Some(given)) => {
                let entry = ToolEntry {
                    name: tool.name.clone(),
                    geometry: plan::tables::Offset(Vector::from_xyz([0.0, 0.0, given])),
                    diameter: tool.diameter_mm.map(Millimetres),
                    ..ToolEntry::default()
                };
                self.tables.tools.insert(number, entry);
            }
            (None, None) => {
                return Err(format!("the machine does not know tool {}: give its length_mm", tool.number));
            }
            _ => {}
        }
        if let Some(mm) = tool.diameter_mm
            && !(mm > 0.0 && mm <= 1000.0)
        {
            return Err(format!("tool {number}: a diameter of {mm} mm cannot be"));
        }
        let entry = self.tables.tools.get(&number);
        let offset = ToolOffset {
            number: tool.number,
            geometry: entry.map_or(Vector::ZERO, |e| e.geometry.0),
            wear: entry.map_or(Vector::ZERO, |e| e.wear.0),
            assumed: entry.is_none(),
        };
        if self.tool != Some(tool.number) {
            self.tool = Some(tool.number);
            self.kinds.push(StepKind::Tool(ToolCall {
                number,
                name: tool.name.clone(),
                diameter: tool.diameter_mm.map(Millimetres).or(entry.and_then(|e| e.diameter)),
            }));
            self.offset = offset;
            self.kinds.push(StepKind::ToolOffset(offset));
        }
        Ok(())
    }

    fn spindle(&self, operation: &Operation) -> Result<SpindleState, String> {
        let Some(spindle) = operation.spindle else {
            return Ok(SpindleState::Stopped);
        };
        let highest = self.machine.spindle.max.0;
        if !(spindle.rpm > 0.0 && spindle.rpm <= highest) {
            return Err(format!(
                "a spindle speed of {} rev/min cannot be: more than 0 and at most {highest} are needed",
                spindle.rpm
            ));
        }
        let mode = SpindleMode::Revolutions(Rpm(spindle.rpm));
        Ok(match spindle.direction {
            Turn::Cw => SpindleState::Clockwise(mode),
            Turn::Ccw => SpindleState::Counterclockwise(mode),
        })
    }

    fn go(&mut self, go: &Go) -> Result<StepKind, String> {
        let from = self.tip();
        let (path, speed) = match *go {
            Go::Dwell { time_s } if (0.0..=3600.0).contains(&time_s) => return Ok(StepKind::Dwell(Seconds(time_s))),
            Go::Dwell { time_s } => return Err(format!("a dwell of {time_s} s cannot be: 0 to 3600 are needed")),
            Go::Rapid { to } => (line(from, to), Speed::Rapid),
            Go::Line { to, feed_mm_min } => (line(from, to), Speed::Feed(feed(feed_mm_min)?)),
            Go::Arc {
                to,
                centre,
                normal,
                direction,
                feed_mm_min,
            } => (arc(from, to, centre, normal, direction)?, Speed::Feed(feed(feed_mm_min)?)),
        };
        self.within_travel(&path)?;
        self.gauge = self.frame.machine_from_setup * path.end() + self.offset.total();
        Ok(StepKind::Move(Move {
            path,
            speed,
            profile: None,
            derived: false,
        }))
    }

    fn tip(&self) -> Point<Setup> {
        let setup_from_machine: Transform<Setup, Machine> = self.frame.machine_from_setup.inverse();
        setup_from_machine * (self.gauge - self.offset.total())
    }

    /// Whether the gauge point stays where the axes can go.
    fn within_travel(&self, path: &Path<Setup>) -> Result<(), String> {
        let mut outside = None;
        let path = path.in_frame(&self.frame.machine_from_setup);
        path.flatten(0.01, 10_000, |_, point| {
            let gauge = point + self.offset.total();
            for axis in Axis::ALL {
                let at = gauge.xyz[axis.index()];
                if let Some(file) = self.machine.axis(axis)
                    && !(file.travel_min.0 - 1e-6..=file.travel_max.0 + 1e-6).contains(&at)
                {
                    outside.get_or_insert((axis, at, file.travel_min.0, file.travel_max.0));
                }
            }
        });
        match outside {
            None => Ok(()),
            Some((axis, at, low, high)) => Err(format!(
                "axis {axis} would have to go to {at:.3} mm in the machine, and its travel is {low} to {high} mm: move the work offset or the part"
            )),
        }
    }
}

/// Whether two steps are one. What names an instance of the file may be another instance in a later one.
fn same_step(a: &StepKind, b: &StepKind) -> bool {
    match (a, b) {
        (StepKind::Begin(a), StepKind::Begin(b)) => {
            (a.level, &a.name, a.maximum_deviation) == (b.level, &b.name, b.maximum_deviation)
        }
        (a, b) => a == b,
    }
}

fn feed(mm_min: f64) -> Result<Feed, String> {
    if mm_min > 0.0 && mm_min <= 1e6 {
        return Ok(Feed::PerTime(MmPerSec(mm_min / 60.0)));
    }
    Err(format!(
        "a feed of {mm_min} mm/min cannot be moved at: more than 0 and at most 1000000 are needed"
    ))
}

fn line(from: Point<Setup>, to: [f64; 3]) -> Path<Setup> {
    Path::Line {
        from,
        to: Point::from_xyz(to),
    }
}

fn arc(from: Point<Setup>, to: [f64; 3], centre: [f64; 3], normal: [f64; 3], turn: Turn) -> Result<Path<Setup>, String> {
    let (to, axis_point) = (Point::<Setup>::from_xyz(to), Point::<Setup>::from_xyz(centre));
    let normal = Vector::<Setup>::from_xyz(normal);
    let length = normal.length();
    if !(length > 1e-9 && length.is_finite()) {
        return Err("the normal of an arc needs a length".to_owned());
    }
    let normal = normal * (1.0 / length);
    // The point of the axis in the plane of the start.
    let centre = axis_point + normal * (from - axis_point).dot(normal);
    let rise = (to - from).dot(normal);
    let (out, end) = (from - centre, to - normal * rise - centre);
    if out.length() <= ARC_ROUNDING || (out.length() - end.length()).abs() > ARC_ROUNDING {
        return Err(format!(
            "the arc begins {:.4} mm from its centre and ends {:.4} mm from it: give the centre of both",
            out.length(),
            end.length()
        ));
    }
    let whole = (end - out).length() <= WHOLE_TURN;
    // Counterclockwise from start to end, 0 to a turn.
    let around = normal.cross(out).dot(end).atan2(out.dot(end));
    let whole_turn = 2.0 * std::f64::consts::PI;
    let counterclockwise = if whole { whole_turn } else { around.rem_euclid(whole_turn) };
    let sweep = match turn {
        Turn::Ccw => counterclockwise,
        Turn::Cw if whole => -whole_turn,
        Turn::Cw => counterclockwise - whole_turn,
    };
    Ok(Path::Arc(plan::Arc {
        from,
        centre,
        normal,
        sweep: Radians(sweep),
        rise,
    }))
}

/// Steps that are said already, as the stream that the writer reads.
struct Said {
    kinds: std::vec::IntoIter<StepKind>,
    last: u32,
}

impl Said {
    fn new(kinds: Vec<StepKind>) -> Said {
        Said {
            kinds: kinds.into_iter(),
            last: 0,
        }
    }
}

impl ProgramStream for Said {
    fn next(&mut self, _answer: Option<Answer>) -> Next {
        let Some(kind) = self.kinds.next() else { return Next::End };
        self.last += 1;
        Next::Step(Step {
            id: StepId(self.last),
            origin: Origin {
                file: FileId(0),
                place: Place::Given,
            },
            kind,
        })
    }
    fn rewind(&mut self) {
        unreachable!("the writer reads once, from the beginning")
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "live job"
    }
}

/// What the writer is told of a live job.
pub fn write_options(job: &str, client: &str, who: &str, start: units::Timestamp) -> WriteOptions {
    WriteOptions {
        name: job.to_owned(),
        made_from: format!("operations of {client}, one at a time"),
        written: start,
        author: who.to_owned(),
        writer: "toolmark".to_owned(),
        inches: false,
        turning: false,
        tables: Tables {
            work_offsets: BTreeMap::new(),
            ..Tables::empty()
        },
        functions: stepnc::FunctionForm::default(),
    }
}
