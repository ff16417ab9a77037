//! Names, numbers and curves that nobody wants to meet: either the program is refused with a reason, or what is written is what the
//! control can read, and does what was meant.

mod common;

use common::*;
use plan::flow::{Part, StructuredProgram};
use plan::*;
use post::{CONTROLS, Options};
use std::collections::BTreeMap;
use units::{Millimetres, MmPerSec, Point, Radians, Rpm, Seconds, Setup, StepId, ToolNumber, Transform, Vector};

/// Steps as a program.
struct Steps(std::vec::IntoIter<StepKind>);

impl StructuredProgram for Steps {
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>> {
        Ok(self.0.next().map(|kind| {
            Part::Step(Step {
                id: StepId(1),
                origin: Origin {
                    file: FileId(0),
                    place: Place::Given,
                },
                kind,
            })
        }))
    }
    fn diagnostics(&self) -> &[Diagnostic] {
        &[]
    }
    fn file_name(&self, _file: FileId) -> &str {
        "steps"
    }
}

fn begin(level: Level, name: &str) -> StepKind {
    StepKind::Begin(Marker {
        level,
        name: name.to_owned(),
        entity: None,
        maximum_deviation: None,
        derived: false,
    })
}

fn feed(path: Path<Setup>) -> StepKind {
    StepKind::Move(Move {
        path,
        speed: Speed::Feed(Feed::PerTime(MmPerSec(10.0))),
        profile: None,
        derived: false,
    })
}

fn line(from: [f64; 3], to: [f64; 3]) -> Path<Setup> {
    Path::Line {
        from: Point::from_xyz(from),
        to: Point::from_xyz(to),
    }
}

/// What every program begins with here: a tool with its length, a turning spindle, a place.
fn start(name: &str) -> Vec<StepKind> {
    vec![
        begin(Level::Program, name),
        StepKind::Frame(FrameChange {
            name: "G54".to_owned(),
            machine_from_setup: Transform::shift([-300.0, -200.0, -400.0]),
            assumed: false,
        }),
        StepKind::Tool(ToolCall {
            number: ToolNumber(1),
            name: name.to_owned(),
            diameter: None,
        }),
        StepKind::ToolOffset(ToolOffset {
            number: 1,
            geometry: Vector::new(0.0, 0.0, 110.0),
            ..ToolOffset::NONE
        }),
        StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(1000.0)))),
        StepKind::Move(Move {
            path: line([300.0, 200.0, 400.0], [1.0, 2.0, 3.0]),
            speed: Speed::Rapid,
            profile: None,
            derived: false,
        }),
    ]
}

fn post_steps(steps: &[StepKind], control: &str) -> Result<String, String> {
    let options = Options {
        source: "Prüfung (α).stpnc".to_owned(),
        ..Options::default()
    };
    posted(control, &options, &mut |_| {
        let own: Vec<StepKind> = steps.to_vec();
        Box::new(Steps(own.into_iter()))
    })
    .map(|(text, _)| text)
}

/// What every control's program has to be.
#[track_caller]
fn is_readable(text: &str, name: &str) {
    let control = post::by_name(name).expect("a control");
    let paper = control.paper();
    assert!(text.is_ascii(), "{text}");
    assert!(text.ends_with(paper.line_end));
    for line in text.split_terminator(paper.line_end) {
        assert!(!line.contains(['\n', '\r']), "{line:?}");
        assert!(line.len() <= paper.longest, "{line}");
        let comment = line.trim_start_matches(|c: char| c.is_ascii_digit() || c == ' ');
        if comment.starts_with('(') {
            let inside = &comment[1..comment.len() - 1];
            assert!(comment.ends_with(')') && !inside.contains(['(', ')', '%']), "{line}");
        } else if !comment.starts_with(';') && !comment.starts_with('*') && line != "%" && !line.starts_with("%_N_") {
            assert!(!line.contains('%'), "{line}");
            // A coordinate has no exponent.
            for word in line.split_whitespace() {
                let number = word[1.min(word.len())..].trim_start_matches(['+', '-']);
                if word.starts_with(['X', 'Y', 'Z', 'F']) && number.starts_with(|c: char| c.is_ascii_digit()) {
                    assert!(!word[1..].contains(['e', 'E', 'i', 'N']), "{line}");
                    if matches!(name, "fanuc" | "haas") && word.starts_with(['X', 'Y', 'Z']) {
                        assert!(word.contains('.'), "{line}");
                    }
                }
            }
        }
    }
}

#[test]
fn names_that_would_end_a_comment_or_a_program_do_not() {
    for name in [
        "Gehäuse Ø80 (links) 100 %",
        "a\nM30\n%",
        ")M3 S9999(",
        "tab\tand\rreturn",
        "日本語の名前",
        "quote \" and ' and ; and ~",
        "[[[((()))]]]",
        "MSG,not a message",
        "trace:1 get_time",
        "#100=5 DPRNT[X]",
        "",
        " ",
        &"long ".repeat(200),
        &"x".repeat(3000),
        "\u{0}\u{7f}\u{200b}",
    ] {
        let mut steps = start(name);
        steps.push(begin(Level::Workplan, name));
        steps.push(begin(Level::Workingstep, name));
        steps.push(StepKind::Message(name.to_owned()));
        steps.push(StepKind::NcFunction(RawNcFunction {
            kind: name.to_owned(),
            name: name.to_owned(),
            text: name.to_owned(),
            condition: None,
            properties: BTreeMap::new(),
        }));
        let quoted = name.replace('"', "\"\"");
        if !name.trim().is_empty() && !quoted.contains(['\n', '\u{0}']) {
            steps.push(StepKind::NcFunction(RawNcFunction {
                kind: "extended function".to_owned(),
                name: String::new(),
                text: format!("trace:1 log_event its_kind=note its_text=\"{quoted}\""),
                condition: None,
                properties: BTreeMap::new(),
            }));
        }
        steps.push(feed(line([1.0, 2.0, 3.0], [4.0, 2.0, 3.0])));
        for control in CONTROLS {
            let text = post_steps(&steps, control.name()).unwrap_or_else(|e| panic!("{name:?} on {}: {e}", control.name()));
            is_readable(&text, control.name());
        }
    }
}

#[test]
fn numbers_that_no_control_reads_are_refused_with_a_reason() {
    let far = |x: f64| feed(line([1.0, 2.0, 3.0], [x, 2.0, 3.0]));
    let at_feed = |feed: Feed| {
        StepKind::Move(Move {
            path: line([1.0, 2.0, 3.0], [4.0, 2.0, 3.0]),
            speed: Speed::Feed(feed),
            profile: None,
            derived: false,
        })
    };
    let turning = |rpm: f64| StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(Rpm(rpm))));
    let frame = |rotation: [[f64; 3]; 3]| {
        let mut machine_from_setup = Transform::shift([0.0; 3]);
        machine_from_setup.rotation = rotation;
        StepKind::Frame(FrameChange {
            name: "side".to_owned(),
            machine_from_setup,
            assumed: false,
        })
    };
    let bad: Vec<(&str, StepKind)> = vec![
        ("infinite", far(f64::INFINITY)),
        ("not a number", far(f64::NAN)),
        ("too far", far(1e7)),
        ("astronomic", far(1e300)),
        ("feed 0", at_feed(Feed::PerTime(MmPerSec(0.0)))),
        ("negative feed", at_feed(Feed::PerTime(MmPerSec(-1.0)))),
        ("feed that rounds to nothing", at_feed(Feed::PerTime(MmPerSec(1e-9)))),
        ("infinite feed", at_feed(Feed::PerTime(MmPerSec(f64::INFINITY)))),
        ("a whole move in no time", at_feed(Feed::WholeMove(Seconds(0.0)))),
        ("spindle that rounds to nothing", turning(1e-6)),
        ("spindle that is no number", turning(f64::NAN)),
        ("endless dwell", StepKind::Dwell(Seconds(f64::INFINITY))),
        ("negative dwell", StepKind::Dwell(Seconds(-1.0))),
        ("tilted frame", frame([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])),
    ];
    for (what, step) in bad {
        for control in CONTROLS {
            let mut steps = start("bad");
            steps.push(step.clone());
            steps.push(feed(line([1.0, 2.0, 3.0], [5.0, 6.0, 7.0])));
            let error = post_steps(&steps, control.name()).expect_err(what);
            assert!(error.contains(control.name()) && error.contains(';'), "{what}: {error}");
        }
    }
}

/// A small generator, so that a run can be repeated: `SEED=n cargo test`.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// Lines and arcs of all sizes and turns, each from the end of the last.
fn scribble(dice: &mut Dice, planes: &[usize], moves: usize) -> Vec<StepKind> {
    let mut steps = start("scribble");
    let mut at = Point::new(1.0, 2.0, 3.0);
    for _ in 0..moves {
        let size = libm::pow(10.0, dice.between(-3.5, 2.0));
        let path = if dice.unit() < 0.4 {
            let to = at
                + Vector::new(
                    dice.between(-size, size),
                    dice.between(-size, size),
                    dice.between(-size, size),
                );
            Path::Line { from: at, to }
        } else {
            let normal = planes[(dice.unit() * planes.len() as f64) as usize % planes.len()];
            let angle = dice.between(0.0, std::f64::consts::TAU);
            let mut out = [0.0; 3];
            out[(normal + 1) % 3] = size * libm::cos(angle);
            out[(normal + 2) % 3] = size * libm::sin(angle);
            let mut axis = [0.0; 3];
            axis[normal] = if dice.unit() < 0.5 { 1.0 } else { -1.0 };
            let turns = match (dice.unit() * 4.0) as u32 {
                0 => std::f64::consts::TAU,
                1 => dice.between(0.0, 0.01),
                2 => dice.between(6.0, 15.0),
                _ => dice.between(0.0, 6.2),
            };
            Path::Arc(Arc {
                from: at,
                centre: at + Vector::from_xyz(out),
                normal: Vector::from_xyz(axis),
                sweep: Radians(if dice.unit() < 0.5 { turns } else { -turns }),
                rise: if dice.unit() < 0.5 { 0.0 } else { dice.between(-size, size) },
            })
        };
        at = path.end();
        steps.push(feed(path));
        if at.xyz.iter().any(|c| c.abs() > 900.0) {
            let back = Path::Line {
                from: at,
                to: Point::new(0.0, 0.0, 0.0),
            };
            at = back.end();
            steps.push(feed(back));
        }
    }
    steps
}

/// What steps do, as [`deeds`] tells it of a stream.
fn meant(steps: &[StepKind]) -> Vec<Deed> {
    struct Told<'s>(std::slice::Iter<'s, StepKind>);
    impl ProgramStream for Told<'_> {
        fn next(&mut self, _answer: Option<Answer>) -> Next {
            match self.0.next().cloned() {
                Some(kind) => Next::Step(Step {
                    id: StepId(1),
                    origin: Origin {
                        file: FileId(0),
                        place: Place::Given,
                    },
                    kind,
                }),
                None => Next::End,
            }
        }
        fn rewind(&mut self) {}
        fn diagnostics(&self) -> &[Diagnostic] {
            &[]
        }
        fn file_name(&self, _file: FileId) -> &str {
            ""
        }
    }
    deeds(&mut Told(steps.iter()))
}

fn cutting(all: Vec<Deed>) -> Vec<Deed> {
    all.into_iter().filter(|deed| matches!(deed, Deed::Go(Some(_), _))).collect()
}

/// Polylines by the number of their move, which stands in the feed.
fn by_move(all: Vec<Deed>) -> BTreeMap<i64, Vec<[f64; 3]>> {
    let mut moves: BTreeMap<i64, Vec<[f64; 3]>> = BTreeMap::new();
    for deed in all {
        if let Deed::Go(Some(feed), points) = deed {
            moves.entry((feed - 600.0).round() as i64).or_default().extend(points);
        }
    }
    moves
}

#[test]
fn any_path_of_lines_and_arcs_is_the_same_path_on_a_fanuc() {
    #[expect(clippy::disallowed_methods, reason = "a run of random programs can be repeated")]
    let seed: u64 = std::env::var("SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(7);
    for round in 0..12 {
        let mut steps = scribble(&mut Dice(seed + round), &[0, 1, 2], 60);
        for (number, step) in steps.iter_mut().enumerate() {
            if let StepKind::Move(go) = step
                && go.speed != Speed::Rapid
            {
                go.speed = Speed::Feed(Feed::PerTime(MmPerSec((600.0 + number as f64) / 60.0)));
            }
        }
        let text = post_steps(&steps, "fanuc").unwrap_or_else(|e| panic!("seed {}: {e}", seed + round));
        is_readable(&text, "fanuc");
        let found = by_move(deeds(&mut gcode(&text, "fanuc-mill", machine(false), BTreeMap::new())));
        let mut at = [-299.0, -198.0, -397.0];
        for (number, wanted) in by_move(meant(&steps)) {
            let length: f64 = std::iter::once(&at)
                .chain(&wanted)
                .zip(&wanted)
                .map(|(a, b)| (0..3).map(|k| (a[k] - b[k]).abs()).sum::<f64>())
                .sum();
            match found.get(&number) {
                // Rounded to 0.001 in each axis, centres too.
                Some(found) => {
                    let apart = apart(&wanted, found, at, 0.0015).max(apart(found, &wanted, at, 0.0015));
                    assert!(
                        apart < 0.0035,
                        "seed {}, move {number}: {apart} mm apart\n{text}",
                        seed + round
                    );
                }
                None => assert!(
                    length < 0.05,
                    "seed {}, move {number} of {length} mm is lost\n{text}",
                    seed + round
                ),
            }
            at = wanted[wanted.len() - 1];
        }
    }
}

#[test]
fn any_path_of_lines_and_arcs_is_readable_on_every_control() {
    for round in 0..4 {
        let steps = scribble(&mut Dice(100 + round), &[0, 1, 2], 80);
        for control in CONTROLS {
            let text = post_steps(&steps, control.name()).unwrap_or_else(|e| panic!("{}: {e}", control.name()));
            is_readable(&text, control.name());
        }
    }
}

#[test]
fn a_spline_stays_within_its_tolerance_and_one_without_end_is_refused() {
    let spline = |scale: f64| {
        Path::Spline(Spline {
            degree: 3,
            poles: [[1.0, 2.0, 3.0], [20.0, 40.0, 0.0], [50.0, -30.0, 2.0], [80.0, 2.0, 3.0]]
                .map(|[x, y, z]| Point::new(x * scale, y * scale, z * scale))
                .to_vec(),
            weights: vec![1.0, 2.0, 0.5, 1.0],
            knots: vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0],
        })
    };
    let mut steps = start("spline");
    steps.push(StepKind::PathMode(PathMode::Tolerance(Some(Millimetres(0.004)))));
    steps.push(feed(spline(1.0)));
    let mut profiled = start("profile");
    profiled.push(StepKind::Move(Move {
        path: spline(1.0),
        speed: Speed::Feed(Feed::PerTime(MmPerSec(10.0))),
        profile: Some(SpeedProfile {
            points: vec![(0.0, 0.2), (0.5, 1.0), (1.0, 0.4)],
        }),
        derived: false,
    }));
    for steps in [steps, profiled] {
        let text = post_steps(&steps, "fanuc").unwrap_or_else(|e| panic!("{e}"));
        let path = |all: Vec<Deed>| -> Vec<Deed> {
            cutting(all)
                .into_iter()
                .map(|deed| match deed {
                    Deed::Go(_, points) => Deed::Go(Some(1.0), points),
                    other => other,
                })
                .collect()
        };
        let found = deeds(&mut gcode(&text, "fanuc-mill", machine(false), BTreeMap::new()));
        if let Err(difference) = compare(&path(meant(&steps)), &path(found), 0.0065) {
            panic!("{difference}");
        }
    }
    let mut poles = Vec::new();
    for k in 0..40_000 {
        poles.push(Point::new(f64::from(k % 100), f64::from(k % 7) * 10.0, 0.0));
    }
    let knots = (0..poles.len() + 4).map(|k| k as f64).collect();
    let endless = Path::Spline(Spline {
        degree: 3,
        poles,
        weights: Vec::new(),
        knots,
    });
    let mut steps = start("endless");
    steps.push(feed(endless));
    let error = post_steps(&steps, "haas").expect_err("it is refused");
    assert!(error.contains("chords"), "{error}");
}
