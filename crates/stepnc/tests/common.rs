//! Shared by the tests: sample files, and programs and streams as text.
#![allow(dead_code, reason = "each test file uses a part of it")]

use plan::{Answer, Feed, Next, Path, ProgramStream, Question, Speed, SpindleMode, SpindleState, StepKind};
use std::fmt::Write;
use std::sync::Arc;
use stepnc::inspect::{Inspection, Node};
use stepnc::{Program, StepNcStream, StreamOptions};

const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/samples/stepnc");

/// A sample file; `None`, and a line that says so, where the samples are not.
#[expect(
    clippy::disallowed_methods,
    reason = "tests read sample files; the crate itself opens nothing"
)]
pub fn sample(name: &str) -> Option<Program> {
    let path = std::path::Path::new(SAMPLES).join(name);
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: no sample file {}", path.display());
        return None;
    };
    Some(Program::read(name.rsplit('/').next().unwrap_or(name), bytes).expect("samples are Part 21 files"))
}

/// What `inspect` says, one line a node or path.
pub fn outline(inspection: &Inspection) -> String {
    let mut out = format!(
        "{} {} {}\n{:?}\n",
        inspection.kind, inspection.schema, inspection.units, inspection.summary
    );
    for node in &inspection.tree {
        outline_node(node, 0, &mut out);
    }
    for problem in &inspection.problems {
        let _ = writeln!(
            out,
            "{:?} {}:{} {} x{}: {}",
            problem.severity, problem.line, problem.column, problem.code, problem.count, problem.message
        );
    }
    out
}

fn outline_node(node: &Node, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    let _ = write!(out, "{indent}#{} {} '{}'", node.id, node.kind, node.name);
    if let Some(project) = &node.project {
        let _ = write!(out, " of project '{project}'");
    }
    if !node.enabled {
        let _ = write!(out, " disabled");
    }
    if node.twin {
        let _ = write!(out, " twin of {:?}", node.twin_of);
    }
    if let Some(tool) = &node.tool {
        let _ = write!(out, " {tool:?}");
    }
    if let Some(function) = &node.function {
        let _ = write!(out, " [{}] {}", function.kind, function.text);
    }
    let _ = writeln!(out);
    for path in &node.toolpaths {
        let number = |n: Option<f64>| n.map_or("-".to_string(), |n| format!("{n:.3}"));
        let _ = writeln!(
            out,
            "{indent}  #{} {} '{}' {} mm, {} mm/s, {} rpm {}",
            path.id,
            path.kind,
            path.name,
            number(path.length_mm),
            number(path.feed_mm_s),
            number(path.spindle_rpm),
            path.spindle_direction.unwrap_or("-")
        );
    }
    for child in &node.children {
        outline_node(child, depth + 1, out);
    }
}

/// The steps of a program, one line each, at most `most`; questions are answered by `answer`.
pub fn steps(program: Program, options: StreamOptions, most: usize, mut answer: impl FnMut(&Question) -> Answer) -> String {
    let mut stream = StepNcStream::new(Arc::new(program), options);
    let mut out = String::new();
    let mut reply = None;
    for _ in 0..most {
        match stream.next(reply.take()) {
            Next::Step(step) => {
                let from = step.origin.entity().map_or("-".to_string(), |id| format!("#{id}"));
                let _ = writeln!(out, "{} {from} {}", step.id.0, describe(&step.kind));
            }
            Next::Ask(question) => {
                let given = answer(&question);
                let _ = writeln!(out, "ask {question:?} -> {given:?}");
                reply = Some(given);
            }
            Next::End => {
                out += "end\n";
                break;
            }
            Next::Alarm(alarm) => {
                let _ = writeln!(out, "{alarm}");
                break;
            }
        }
    }
    for diagnostic in stream.diagnostics() {
        let _ = writeln!(out, "{diagnostic}");
    }
    out
}

fn place<F: units::Frame>(point: units::Point<F>) -> String {
    let clean = |c: f64| if c.abs() < 5e-5 { 0.0 } else { c };
    let [x, y, z] = point.xyz.map(clean);
    format!("({x:.4}, {y:.4}, {z:.4})")
}

pub fn describe(kind: &StepKind) -> String {
    match kind {
        StepKind::Move(go) => {
            let shape = match &go.path {
                Path::Line { .. } => "line".to_string(),
                Path::Arc(arc) => {
                    format!(
                        "arc about {} {:.2} deg rise {:.3}",
                        place(arc.centre),
                        arc.sweep.0.to_degrees(),
                        arc.rise
                    )
                }
                Path::Spline(spline) => format!("spline of degree {} with {} poles", spline.degree, spline.poles.len()),
            };
            let speed = match go.speed {
                Speed::Rapid => "rapid".to_string(),
                Speed::Feed(Feed::PerTime(feed)) => format!("{feed:.3}"),
                Speed::Feed(feed) => format!("{feed:?}"),
            };
            let profile = go
                .profile
                .as_ref()
                .map_or(String::new(), |profile| format!(" x {:?}", profile.points));
            let derived = if go.derived { " derived" } else { "" };
            format!(
                "{shape} {} -> {} {speed}{profile}{derived}",
                place(go.path.start()),
                place(go.path.end())
            )
        }
        StepKind::Begin(marker) => format!("begin {:?} '{}'", marker.level, marker.name),
        StepKind::Frame(frame) => {
            let [x, y, z] = frame.machine_from_setup.origin;
            let turned = if frame.machine_from_setup.is_shift() { "" } else { " turned" };
            let assumed = if frame.assumed { " assumed" } else { "" };
            format!(
                "frame '{}' {}{turned}{assumed}",
                frame.name,
                place(units::Point::<units::Machine>::new(x, y, z))
            )
        }
        StepKind::Tool(tool) => format!("tool {} {} {:?}", tool.number, tool.name, tool.diameter.map(|d| d.0)),
        StepKind::Spindle(SpindleState::Clockwise(SpindleMode::Revolutions(n))) => format!("spindle cw {n:.0}"),
        StepKind::Spindle(SpindleState::Counterclockwise(SpindleMode::Revolutions(n))) => format!("spindle ccw {n:.0}"),
        StepKind::ToolOffset(offset) => format!("offset {} assumed {}", offset.number, offset.assumed),
        StepKind::PathMode(plan::PathMode::Tolerance(tolerance)) => format!("tolerance {:?}", tolerance.map(|t| t.0)),
        other => format!("{other:?}"),
    }
}
