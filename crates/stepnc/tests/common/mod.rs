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

/// Units, contexts and what every program needs, with identifiers below 100:
/// #1 mm, #2 s, #3 minute, #4 degree, #5 mm/min, #6 rev/min, #7 geometric context in mm and degrees, #8 context without units,
/// #9 inch, #10 geometric context in inches, #11 ratio, #20 product definition context, #21 product context.
const PREAMBLE: &str = "\
#1=(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.));
#2=(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT());
#30=DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.);
#31=TIME_MEASURE_WITH_UNIT(TIME_MEASURE(60.),#2);
#3=(CONVERSION_BASED_UNIT('minute',#31) NAMED_UNIT(#30) TIME_UNIT());
#32=(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.));
#33=PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.017453292519943295),#32);
#4=(CONVERSION_BASED_UNIT('degree',#33) NAMED_UNIT(#30) PLANE_ANGLE_UNIT());
#34=DERIVED_UNIT_ELEMENT(#1,1.);
#35=DERIVED_UNIT_ELEMENT(#3,-1.);
#5=DERIVED_UNIT((#34,#35));
#36=CONTEXT_DEPENDENT_UNIT(#30,'revolution');
#37=DERIVED_UNIT_ELEMENT(#36,1.);
#6=DERIVED_UNIT((#37,#35));
#7=(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#4)) REPRESENTATION_CONTEXT('ID1','3D'));
#8=REPRESENTATION_CONTEXT('','units not necessary');
#38=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#1);
#9=(CONVERSION_BASED_UNIT('zoll',#38) LENGTH_UNIT() NAMED_UNIT(#30));
#10=(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT((#9,#32)) REPRESENTATION_CONTEXT('ID2','3D'));
#11=(NAMED_UNIT(#30) RATIO_UNIT());
#22=APPLICATION_CONTEXT('CNC');
#20=PRODUCT_DEFINITION_CONTEXT('CNC Machining',#22,'manufacturing');
#21=PRODUCT_CONTEXT('CNC Machining',#22,'manufacturing');
";

/// A file of these instances over the preamble.
pub fn file_of(data: &str) -> String {
    format!(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('own','2026-01-01T00:00:00Z',(''),(''),'','','');\n\
         FILE_SCHEMA(('MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA'));\nENDSEC;\nDATA;\n{PREAMBLE}{data}\nENDSEC;\nEND-ISO-10303-21;\n"
    )
}

/// A program of these instances over the preamble.
pub fn program_of(data: &str) -> Program {
    Program::read("own.stpnc", file_of(data).into_bytes()).expect("a Part 21 file")
}

/// A property that says a text: takes four identifiers from `id` on.
pub fn says(id: u64, owner: u64, name: &str, text: &str) -> String {
    format!(
        "#{id}=ACTION_PROPERTY('{name}','',#{owner});\n#{a}=ACTION_PROPERTY_REPRESENTATION('','',#{id},#{b});\n\
         #{b}=REPRESENTATION('',(#{c}),#8);\n#{c}=DESCRIPTIVE_REPRESENTATION_ITEM('','{text}');\n",
        a = id + 1,
        b = id + 2,
        c = id + 3
    )
}

/// A property that holds an item in a context: takes three identifiers from `id` on.
pub fn holds(id: u64, owner: u64, name: &str, item: u64, context: u64) -> String {
    format!(
        "#{id}=ACTION_PROPERTY('{name}','',#{owner});\n#{a}=ACTION_PROPERTY_REPRESENTATION('','',#{id},#{b});\n\
         #{b}=REPRESENTATION('',(#{item}),#{context});\n",
        a = id + 1,
        b = id + 2
    )
}

/// A workplan #100 with workingstep #101, operation #102 (tool 1, 600 mm/min, 1500 rev/min clockwise) and its only toolpath #110 along
/// curve #200 in `context`; `data` holds the curve and whatever else.
pub fn one_path(data: &str, context: u64) -> Program {
    let basic_curve = holds(111, 110, "basic curve", 200, context);
    program_of(&format!(
        "#100=MACHINING_WORKPLAN('main','','','');
#103=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#101,1.);
#101=MACHINING_WORKINGSTEP('step','machining','','');
#104=MACHINING_OPERATION_RELATIONSHIP('','machining',#101,#102);
#102=FREEFORM_MILLING_OPERATION('op','finishing','','');
#105=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#110,1.);
#110=MACHINING_TOOLPATH('path','cutter location trajectory','','');
{basic_curve}
#120=MACHINING_TECHNOLOGY('','milling','','');
#121=MACHINING_TECHNOLOGY_RELATIONSHIP('','',#102,#120);
#122=ACTION_PROPERTY('feedrate','',#120);
#123=ACTION_PROPERTY_REPRESENTATION('','',#122,#124);
#124=MACHINING_FEED_SPEED_REPRESENTATION('feed speed',(#125),#8);
#125=MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE(600.),#5);
#126=ACTION_PROPERTY('spindle','',#120);
#127=ACTION_PROPERTY_REPRESENTATION('','',#126,#128);
#128=MACHINING_SPINDLE_SPEED_REPRESENTATION('spindle speed',(#129),#8);
#129=MEASURE_REPRESENTATION_ITEM('rotational speed',NUMERIC_MEASURE(-1500.),#6);
#130=MACHINING_TOOL('1','endmill',(#102),$);
{data}"
    ))
}
