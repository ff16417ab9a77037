//! What the tests of this crate share: opening programs, reading them through, and a short spelling of steps.
#![allow(dead_code, reason = "each test binary uses its part")]

use gcode::profile::by_name;
use gcode::{GcodeProgram, Options};
use plan::{
    Answer, Feed, MemorySource, Missing, Next, NoOtherFiles, Path, PathMode, ProgramStream, Speed, SpindleMode, SpindleState,
    Step, StepKind, Tables, ToolEntry,
};
use std::fmt::Write as _;
use units::{Machine, Millimetres, Point, ToolNumber, Transform, Vector};

pub fn tool(x: f64, z: f64, wear_x: f64, diameter: Option<f64>) -> ToolEntry {
    ToolEntry {
        geometry: plan::tables::Offset(Vector::<Machine>::new(x, 0.0, z)),
        wear: plan::tables::Offset(Vector::new(wear_x, 0.0, 0.0)),
        diameter: diameter.map(Millimetres),
        ..ToolEntry::default()
    }
}

/// A mill at home with three tools and two work offsets.
pub fn mill_tables() -> Tables {
    let mut tables = Tables {
        position: Point::new(0.0, 0.0, 0.0),
        missing: Missing::Fail,
        ..Tables::empty()
    };
    tables.tools.insert(ToolNumber(1), tool(0.0, 100.0, 0.0, None));
    tables.tools.insert(
        ToolNumber(2),
        ToolEntry {
            radius_wear: Millimetres(4.0),
            ..tool(0.0, 80.0, 0.0, Some(8.0))
        },
    );
    tables.tools.insert(ToolNumber(3), tool(0.0, 60.0, 0.0, None));
    tables
        .work_offsets
        .insert("G54".to_owned(), Transform::shift([-300.0, -200.0, -400.0]));
    tables
        .work_offsets
        .insert("G55".to_owned(), Transform::shift([-100.0, -200.0, -400.0]));
    tables
}

/// A lathe at home; X values are radii.
pub fn lathe_tables() -> Tables {
    let mut tables = Tables {
        position: Point::new(0.0, 0.0, 0.0),
        missing: Missing::Fail,
        ..Tables::empty()
    };
    tables.tools.insert(ToolNumber(1), tool(20.0, 30.0, 0.0, None));
    tables.tools.insert(ToolNumber(3), tool(22.0, 33.0, -0.05, None));
    tables
        .work_offsets
        .insert("G54".to_owned(), Transform::shift([-150.0, 0.0, -250.0]));
    tables
}

pub fn open_with(text: &[u8], dialect: &str, tables: Tables, options: Options) -> Result<GcodeProgram, String> {
    GcodeProgram::open(
        Box::new(MemorySource(text.to_vec())),
        "test.nc",
        by_name(dialect).expect("a dialect"),
        Box::new(NoOtherFiles),
        tables,
        options,
    )
    .map_err(|d| d.to_string())
}

/// Everything up to the end or the alarm, which is the second part. Optional stops are answered with yes.
pub fn run(program: &mut dyn ProgramStream) -> (Vec<Step>, Option<plan::Alarm>) {
    let mut steps = Vec::new();
    let mut answer = None;
    loop {
        match program.next(answer.take()) {
            Next::Step(step) => {
                assert_eq!(step.id.0 as usize, steps.len() + 1, "step numbers have no gaps");
                steps.push(step);
            }
            Next::Ask(_) => answer = Some(Answer::Truth(true)),
            Next::End => return (steps, None),
            Next::Alarm(alarm) => return (steps, Some(alarm)),
        }
    }
}

/// One line for each step, then the findings and the alarm.
pub fn listing(text: &str, dialect: &str, tables: Tables, options: Options) -> String {
    let mut out = String::new();
    let mut program = match open_with(text.as_bytes(), dialect, tables, options) {
        Ok(program) => program,
        Err(message) => return format!("{message}\n"),
    };
    let (steps, alarm) = run(&mut program);
    for step in &steps {
        let line = match step.origin.place {
            plan::Place::Text { line, .. } => line.to_string(),
            _ => "-".to_owned(),
        };
        let _ = writeln!(out, "{line} {}", spell(&step.kind));
    }
    for d in program.diagnostics() {
        let _ = writeln!(out, "{d}");
    }
    match alarm {
        Some(alarm) => {
            let _ = writeln!(out, "{alarm}");
        }
        None => {
            program.rewind();
            assert_eq!(run(&mut program).0, steps, "a rewound program gives the same steps");
        }
    }
    out
}

fn n(value: f64) -> String {
    let rounded = (value * 1e4).round() / 1e4;
    (rounded + 0.0).to_string()
}
fn xyz(p: [f64; 3]) -> String {
    format!("{} {} {}", n(p[0]), n(p[1]), n(p[2]))
}

pub fn spell(kind: &StepKind) -> String {
    match kind {
        StepKind::Move(m) => {
            let speed = match m.speed {
                Speed::Rapid => "rapid".to_owned(),
                Speed::Feed(Feed::PerTime(v)) => format!("F{}/min", n(v.mm_per_min())),
                Speed::Feed(Feed::PerRevolution(f)) => format!("F{}/rev", n(f.0)),
                Speed::Feed(Feed::Thread(thread)) => match thread.start {
                    Some(angle) => format!("thread {}/rev from {}deg", n(thread.advance.0), n(angle.0.to_degrees())),
                    None => format!("thread {}/rev on", n(thread.advance.0)),
                },
                Speed::Feed(Feed::WholeMove(t)) => format!("in {} s", n(t.0)),
            };
            match &m.path {
                Path::Line { from, to } => format!("line {} -> {} {speed}", xyz(from.xyz), xyz(to.xyz)),
                Path::Arc(a) => format!(
                    "arc {} -> {} r{} {}deg about {} {speed}",
                    xyz(a.from.xyz),
                    xyz(m.path.end().xyz),
                    n(a.radius()),
                    n(a.sweep.0.to_degrees()),
                    ["X", "Y", "Z"][a.normal.xyz.iter().position(|c| *c == 1.0).expect("an axis")]
                ),
                Path::Spline(_) => "spline".to_owned(),
            }
        }
        StepKind::MachineMove(m) => {
            let axes: Vec<String> = ["X", "Y", "Z"]
                .iter()
                .zip(m.to)
                .filter_map(|(l, t)| t.map(|t| format!("{l}{}", n(t.0))))
                .collect();
            format!("machine {}", axes.join(" "))
        }
        StepKind::Dwell(t) => format!("dwell {} s", n(t.0)),
        StepKind::Tool(t) => format!("tool {} '{}'", t.number.0, t.name),
        StepKind::ToolOffset(o) => format!(
            "tool offset {} geometry {} wear {}{}",
            o.number,
            xyz(o.geometry.xyz),
            xyz(o.wear.xyz),
            if o.assumed { " assumed" } else { "" }
        ),
        StepKind::Spindle(SpindleState::Oriented) => "spindle oriented".to_owned(),
        StepKind::Spindle(SpindleState::Stopped) => "spindle stopped".to_owned(),
        StepKind::Spindle(SpindleState::Clockwise(mode)) => format!("spindle cw {}", spell_mode(mode)),
        StepKind::Spindle(SpindleState::Counterclockwise(mode)) => format!("spindle ccw {}", spell_mode(mode)),
        StepKind::Coolant(c) => {
            let open: Vec<&str> = [(c.flood, "flood"), (c.mist, "mist"), (c.through, "through")]
                .iter()
                .filter_map(|(on, name)| on.then_some(*name))
                .collect();
            format!("coolant {}", if open.is_empty() { "off".to_owned() } else { open.join(" ") })
        }
        StepKind::Frame(f) => format!(
            "frame {} at {}{}",
            f.name,
            xyz(f.machine_from_setup.origin),
            if f.assumed { " assumed" } else { "" }
        ),
        StepKind::PathMode(PathMode::ExactStop) => "path exact stop".to_owned(),
        StepKind::PathMode(PathMode::ExactPath) => "path exact".to_owned(),
        StepKind::PathMode(PathMode::Tolerance(None)) => "path blended".to_owned(),
        StepKind::PathMode(PathMode::Tolerance(Some(t))) => format!("path within {}", n(t.0)),
        StepKind::Begin(m) => format!("begin {:?} '{}'{}", m.level, m.name, if m.derived { " derived" } else { "" }),
        StepKind::End(level) => format!("end {level:?}"),
        StepKind::Message(text) => format!("message '{text}'"),
        StepKind::Stop(kind) => format!("stop {kind:?}"),
        StepKind::Register(r) => format!("register {} {:?} -> {:?}", r.register.name(), r.before.map(n), r.after.map(n)),
        StepKind::NcFunction(f) => format!("function {}", f.name),
    }
}

fn spell_mode(mode: &SpindleMode) -> String {
    match mode {
        SpindleMode::Revolutions(rpm) => format!("{} rpm", n(rpm.0)),
        SpindleMode::Surface { speed, limit } => format!("{} mm/s up to {} rpm", n(speed.0), n(limit.0)),
    }
}

/// A file of the shared samples; `None` with a message when they are absent.
pub fn sample(path: &str) -> Option<Vec<u8>> {
    let full = format!("{}/../../../shared/samples/{path}", env!("CARGO_MANIFEST_DIR"));
    read_or_skip(&full)
}

/// A file, or `None` with a message.
pub fn read_or_skip(full: &str) -> Option<Vec<u8>> {
    #[expect(clippy::disallowed_methods, reason = "a test reads its samples from disk")]
    match std::fs::read(full) {
        Ok(bytes) => Some(bytes),
        Err(why) => {
            println!("skipped: {full}: {why}");
            None
        }
    }
}
