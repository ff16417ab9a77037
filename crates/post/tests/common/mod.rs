//! What the tests of this crate share: programs posted, and what programs do, step by step.
#![allow(dead_code, reason = "each test binary uses its part")]

use gcode::profile::by_name as profile;
use gcode::{GcodeProgram, Options as GcodeOptions};
use plan::flow::StructuredProgram;
use plan::tables::Offset;
use plan::{
    Answer, Feed, MemorySource, Next, NoOtherFiles, Path, ProgramStream, Speed, SpindleMode, SpindleState, StepKind, Tables,
    ToolEntry,
};
use post::source::{Interpreted, elsewhere, lengths, other_variables};
use post::{Options, Posted};
use std::collections::BTreeMap;
use std::sync::Arc;
use stepnc::{StepNcStream, StreamOptions, StructuredStream};
use units::{Millimetres, ToolNumber, Transform, Vector};

pub const PLATE: &str = include_str!("../../../../corpus/plate.nc");
pub const FLANGE: &str = include_str!("../../../../corpus/flange.nc");
pub const SHAFT: &str = include_str!("../../../../corpus/shaft.nc");
pub const SPINDLE: &str = include_str!("../../../../corpus/spindle.nc");
pub const BRACKET: &str = include_str!("../../../../corpus/bracket.stpnc");

/// A machine with tools 1 to 8; nose radii as the corpus' lathe programs want them.
pub fn machine(turning: bool) -> Tables {
    let mut tables = Tables::empty();
    for number in 1..=8 {
        let across = if turning { 20.0 + f64::from(number) } else { 0.0 };
        tables.tools.insert(
            ToolNumber(number),
            ToolEntry {
                geometry: Offset(Vector::new(across, 0.0, 100.0 + 10.0 * f64::from(number))),
                radius: Millimetres(if turning { 0.4 } else { 0.0 }),
                tip_direction: if turning { 3 } else { 0 },
                ..ToolEntry::default()
            },
        );
    }
    for number in 54..=59 {
        tables.work_offsets.insert(
            format!("G{number}"),
            Transform::shift([-300.0, if turning { 0.0 } else { -200.0 }, -400.0]),
        );
    }
    tables
}

pub fn gcode(text: &str, dialect: &str, tables: Tables, variables: BTreeMap<u32, f64>) -> GcodeProgram {
    GcodeProgram::open(
        Box::new(MemorySource(text.as_bytes().to_vec())),
        "test.nc",
        profile(dialect).expect("a dialect"),
        Box::new(NoOtherFiles),
        tables,
        GcodeOptions {
            variables,
            ..GcodeOptions::default()
        },
    )
    .expect("it opens")
}

/// Posts G-code; the error as text.
pub fn post_gcode(text: &str, dialect: &str, control: &str) -> Result<(String, Posted), String> {
    post_gcode_with(text, dialect, control, false)
}

pub fn post_gcode_with(text: &str, dialect: &str, control: &str, as_interpreted: bool) -> Result<(String, Posted), String> {
    let turning = dialect == "fanuc-lathe";
    let tables = machine(turning);
    let options = Options {
        source: "test.nc".to_owned(),
        turning,
        lengths: lengths(&elsewhere(&tables, 0, turning)),
        ..Options::default()
    };
    posted(control, &options, &mut |pass| {
        let variables = if as_interpreted {
            BTreeMap::new()
        } else {
            other_variables(pass)
        };
        let program = gcode(text, dialect, elsewhere(&tables, pass, turning), variables);
        let decided = |program: &GcodeProgram| program.decided().map(|(line, by)| format!("line {line}: {by}"));
        Box::new(Interpreted::new(program, decided, as_interpreted))
    })
}

/// Posts STEP-NC; the error as text.
pub fn post_step_nc(name: &str, bytes: &[u8], control: &str) -> Result<(String, Posted), String> {
    let program = Arc::new(stepnc::Program::read(name, bytes.to_vec()).expect("a Part 21 file"));
    let mut bases = BTreeMap::new();
    if let Some(plan) = program.plan() {
        program.walk(plan.main_workplan, &mut |executable, _| {
            if let Some(setup) = &executable.setup
                && let Some(place) = setup.machine_from_setup
            {
                bases.entry(setup.name.clone()).or_insert(place);
            }
        });
    }
    let turning = program.turns();
    let options = Options {
        source: name.to_owned(),
        turning,
        bases,
        ..Options::default()
    };
    posted(control, &options, &mut |pass| {
        let tables = Tables {
            work_offsets: BTreeMap::new(),
            ..elsewhere(&machine(turning), pass, turning)
        };
        let options = StreamOptions {
            tables,
            ..StreamOptions::default()
        };
        Box::new(StructuredStream::new(Arc::clone(&program), options))
    })
}

pub fn posted(
    control: &str,
    options: &Options,
    open: &mut dyn FnMut(usize) -> Box<dyn StructuredProgram>,
) -> Result<(String, Posted), String> {
    let control = post::by_name(control).expect("a control");
    let mut text = String::new();
    let done = post::post(control, &mut |pass| Ok(open(pass)), options, &mut |line| text.push_str(line));
    done.map(|posted| (text, posted)).map_err(|found| found.to_string())
}

/// Something that a machine does, with places in the frame of the machine.
#[derive(Clone, Debug, PartialEq)]
pub enum Deed {
    /// Rapid or a feed in mm/min or mm/rev (negative), and points along the way: a tenth apart on arcs.
    Go(Option<f64>, Vec<[f64; 3]>),
    Machine([Option<f64>; 3]),
    Dwell(f64),
    Tool(u32),
    Offset(u32),
    Spindle(String),
    Coolant(bool, bool, bool),
    Stop(bool),
}

/// Everything a program does, with tip points in the machine's frame.
pub fn deeds(stream: &mut dyn ProgramStream) -> Vec<Deed> {
    let mut all: Vec<Deed> = Vec::new();
    let mut frame = Transform::IDENTITY;
    let mut reply = None;
    loop {
        let step = match stream.next(reply.take()) {
            Next::Step(step) => step,
            Next::Ask(plan::Question::OptionalStop) => {
                all.push(Deed::Stop(false));
                reply = Some(Answer::Truth(false));
                continue;
            }
            Next::Ask(_) => {
                reply = Some(Answer::Unknown);
                continue;
            }
            Next::End => return all,
            Next::Alarm(alarm) => panic!("{alarm}"),
        };
        match step.kind {
            StepKind::Frame(change) => frame = change.machine_from_setup,
            StepKind::Move(go) => {
                let feed = match go.speed {
                    Speed::Rapid => None,
                    Speed::Feed(Feed::PerTime(speed)) => Some(speed.mm_per_min()),
                    Speed::Feed(Feed::PerRevolution(advance)) => Some(-advance.0),
                    Speed::Feed(Feed::Thread(thread)) => Some(-1000.0 - thread.advance.0),
                    Speed::Feed(Feed::WholeMove(time)) => Some(go.path.length() / time.0 * 60.0),
                };
                let mut points = Vec::new();
                match &go.path {
                    Path::Line { to, .. } => points.push((frame * *to).xyz),
                    curve => {
                        // Fine enough that the chords between are within 0.0001 mm of an arc of 50 mm.
                        for k in 1..=1600 {
                            points.push((frame * curve.at(f64::from(k) / 1600.0)).xyz);
                        }
                    }
                }
                all.push(Deed::Go(feed, points));
            }
            StepKind::MachineMove(go) => all.push(Deed::Machine(go.to.map(|to| to.map(|to| to.0)))),
            StepKind::Dwell(time) => all.push(Deed::Dwell(time.0)),
            StepKind::Tool(call) => all.push(Deed::Tool(call.number.0)),
            StepKind::ToolOffset(offset) => all.push(Deed::Offset(offset.number)),
            StepKind::Spindle(state) => all.push(Deed::Spindle(spell(state))),
            StepKind::Coolant(c) => all.push(Deed::Coolant(c.flood, c.mist, c.through)),
            StepKind::Stop(kind) => all.push(Deed::Stop(kind == plan::StopKind::Program)),
            _ => {}
        }
    }
}

fn spell(state: SpindleState) -> String {
    let mode = |mode: SpindleMode| match mode {
        SpindleMode::Revolutions(speed) => format!("{} rpm", speed.0.round()),
        SpindleMode::Surface { speed, limit } => format!("{} m/min to {}", (speed.0 * 0.06).round(), limit.0.round()),
    };
    match state {
        SpindleState::Stopped => "stopped".to_owned(),
        SpindleState::Oriented => "oriented".to_owned(),
        SpindleState::Clockwise(m) => format!("cw {}", mode(m)),
        SpindleState::Counterclockwise(m) => format!("ccw {}", mode(m)),
    }
}

/// Feeds with the polyline that is run at each, and everything else between: programs that cut arcs in two do the same.
pub fn runs(deeds: &[Deed]) -> Vec<Deed> {
    let mut all: Vec<Deed> = Vec::new();
    for deed in deeds {
        match (all.last_mut(), deed) {
            (Some(Deed::Go(feed, points)), Deed::Go(next, more)) if same_feed(*feed, *next) => {
                points.extend(more.iter().copied())
            }
            _ => all.push(deed.clone()),
        }
    }
    all
}

pub fn same_feed(a: Option<f64>, b: Option<f64>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => (a - b).abs() <= 1e-3 * a.abs().max(1.0),
        _ => false,
    }
}

/// The largest distance of the points of one polyline from the other.
pub fn apart(points: &[[f64; 3]], line: &[[f64; 3]], start: [f64; 3], tolerance: f64) -> f64 {
    let mut corners = vec![start];
    corners.extend_from_slice(line);
    let mut from = 0;
    let mut worst: f64 = 0.0;
    for point in points {
        // In order: a point is looked for from where the last one was found.
        let (mut best, mut at) = (f64::INFINITY, from);
        for k in from..corners.len().saturating_sub(1).min(from + 1700) {
            let d = from_segment(*point, corners[k], corners[k + 1]);
            if d < best - 1e-9 {
                (best, at) = (d, k);
            }
            // Near enough here: a path that comes by again later is not looked at.
            if d <= tolerance {
                break;
            }
        }
        if corners.len() == 1 {
            best = from_segment(*point, corners[0], corners[0]);
        }
        from = at;
        worst = worst.max(best);
    }
    worst
}

fn from_segment(p: [f64; 3], a: [f64; 3], b: [f64; 3]) -> f64 {
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (ab, ap) = (sub(b, a), sub(p, a));
    let t = if dot(ab, ab) > 0.0 {
        (dot(ap, ab) / dot(ab, ab)).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let d = sub(ap, [ab[0] * t, ab[1] * t, ab[2] * t]);
    dot(d, d).sqrt()
}

/// Holds what two programs do against each other; the first difference as text.
pub fn compare(wanted: &[Deed], found: &[Deed], tolerance: f64) -> Result<(), String> {
    let (wanted, found) = (runs(wanted), runs(found));
    let mut at = [f64::NAN; 3];
    for k in 0..wanted.len().max(found.len()) {
        let (Some(w), Some(f)) = (wanted.get(k), found.get(k)) else {
            return Err(format!(
                "{} runs and {}: {:?} / {:?}",
                wanted.len(),
                found.len(),
                wanted.get(k).map(short),
                found.get(k).map(short)
            ));
        };
        match (w, f) {
            (Deed::Go(a, wp), Deed::Go(b, fp)) => {
                if !same_feed(*a, *b) {
                    return Err(format!("run {k}: feed {a:?} and {b:?} ({} / {})", short(w), short(f)));
                }
                let start = if at[0].is_nan() { wp[0] } else { at };
                let (one, other) = (apart(wp, fp, start, tolerance), apart(fp, wp, start, tolerance));
                let end = from_segment(wp[wp.len() - 1], fp[fp.len() - 1], fp[fp.len() - 1]);
                if one.max(other) > tolerance || end > tolerance {
                    return Err(format!(
                        "run {k}: {one} mm, {other} mm, end {end} mm apart ({} / {})",
                        short(w),
                        short(f)
                    ));
                }
                at = wp[wp.len() - 1];
            }
            (w, f) if w == f => {
                if matches!(w, Deed::Machine(_)) {
                    at = [f64::NAN; 3];
                }
            }
            (w, f) => return Err(format!("run {k}: {} / {}", short(w), short(f))),
        }
    }
    Ok(())
}

fn short(deed: &Deed) -> String {
    match deed {
        Deed::Go(feed, points) => format!(
            "{feed:?} {} points {:?} .. {:?}",
            points.len(),
            points[0],
            points[points.len() - 1]
        ),
        other => format!("{other:?}"),
    }
}

/// What STEP-NC does on the machine of the tests.
pub fn step_nc_deeds(name: &str, bytes: &[u8], tables: Tables) -> Vec<Deed> {
    let program = Arc::new(stepnc::Program::read(name, bytes.to_vec()).expect("a Part 21 file"));
    let options = StreamOptions {
        tables,
        ..StreamOptions::default()
    };
    deeds(&mut StepNcStream::new(program, options))
}

/// A file of the shared samples; `None` with a message when they are absent.
pub fn sample(path: &str) -> Option<Vec<u8>> {
    let full = format!("{}/../../../shared/samples/{path}", env!("CARGO_MANIFEST_DIR"));
    #[expect(clippy::disallowed_methods, reason = "a test reads its samples from disk")]
    match std::fs::read(&full) {
        Ok(bytes) => Some(bytes),
        Err(why) => {
            println!("skipped: {full}: {why}");
            None
        }
    }
}

/// Branches and loops with what differs between their ways: ISO 14649.
pub const FLOW: &str = include_str!("flow.stp.txt");
