//! What is written holds against the EXPRESS long form of edition 3: argument counts, types, selects, enumerations, bounds, references.
//!
//! The long form is not part of this repository: `AP238_EXPRESS=.../ap238e3_aim_lf.exp cargo test -p stepnc --test express`.

mod common;
#[path = "express/schema.rs"]
mod schema;

use plan::expression::Operator;
use plan::{
    Answer, Diagnostic, Expression, FileId, MemorySource, Next, NoOtherFiles, Origin, Place, ProgramStream, Question,
    RawNcFunction, Step, StepKind, Tables,
};
use schema::Schema;
use std::collections::BTreeMap;
use stepnc::Program;
use stepnc::edit::{Insert, ProgramEdits, Target};
use stepnc::select::select;
use stepnc::write::{WriteOptions, convert};
use units::{MmPerSec, StepId, Timestamp};

#[expect(
    clippy::disallowed_methods,
    reason = "a developer's test reads the schema where there is one"
)]
fn long_form() -> Option<Schema> {
    let path = std::env::var_os("AP238_EXPRESS");
    let Some(text) = path.and_then(|path| std::fs::read(path).ok()) else {
        println!("skipped: AP238_EXPRESS does not name the EXPRESS long form of AP238 edition 3 (ap238e3_aim_lf.exp)");
        return None;
    };
    Some(Schema::read(&String::from_utf8_lossy(&text)))
}

#[track_caller]
fn check(schema: &Schema, bytes: Vec<u8>, what: &str) {
    let file = part21::File::read(bytes).expect("a Part 21 file");
    assert_eq!(file.problems(), [], "{what}");
    let found = schema.faults(&file);
    assert!(found.is_empty(), "{what}: {}", found.join("\n"));
}

fn write_options(inches: bool, turning: bool) -> WriteOptions {
    WriteOptions {
        name: "Teil 'ä' / \\ ☃".into(),
        made_from: "part.nc".into(),
        written: Timestamp(0),
        author: "it's me".into(),
        writer: "toolmark".into(),
        inches,
        turning,
        tables: Tables::empty(),
        functions: stepnc::FunctionForm::Mapping,
    }
}

fn converted(text: &str, profile: &str, inches: bool) -> Vec<u8> {
    let profile = gcode::profile::by_name(profile).expect("it is known");
    let source = Box::new(MemorySource(text.as_bytes().to_vec()));
    let options = gcode::Options::default();
    let program = gcode::GcodeProgram::open(source, "part.nc", profile, Box::new(NoOtherFiles), Tables::empty(), options);
    let options = write_options(inches, profile.turning);
    let mut answer = |question: &Question| match question {
        Question::OptionalStop => Answer::Truth(false),
        _ => Answer::Unknown,
    };
    convert(&mut program.expect("it opens"), &options, &mut answer)
        .expect("it can be written")
        .bytes
}

#[test]
fn what_is_converted_holds_against_the_long_form() {
    let Some(schema) = long_form() else { return };
    let corpus = [
        (include_str!("../../../corpus/plate.nc"), "fanuc-mill"),
        (include_str!("../../../corpus/flange.nc"), "fanuc-mill"),
        (include_str!("../../../corpus/shaft.nc"), "fanuc-lathe"),
        (include_str!("../../../corpus/spindle.nc"), "fanuc-lathe"),
    ];
    for (text, profile) in corpus {
        check(&schema, converted(text, profile, false), profile);
        check(&schema, converted(text, profile, true), profile);
    }
    let odd = "G20 G90 G54\nT7 M6 (M8 TAP)\nG43 H3 Z1.\nS500 M3\nM7\nG61\nG1 Z-.5 F9.\nG2 X0 Y0 Z-1. I-.5 J0\nG4 P1000\nM19\nM0\nM1\nG55\nG0 X5.\nG52 X1.\nG0 X3.\nM30\n";
    check(&schema, converted(odd, "fanuc-mill", true), "odd");
}

/// A program of one step.
struct Told(Option<StepKind>);

impl ProgramStream for Told {
    fn next(&mut self, _: Option<Answer>) -> Next {
        match self.0.take() {
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
    fn file_name(&self, _: FileId) -> &str {
        "given"
    }
}

#[test]
fn a_typed_condition_holds_against_the_long_form() {
    let Some(schema) = long_form() else { return };
    let name = |text: &str| Box::new(Expression::Name(text.into()));
    let number = |number: f64| Box::new(Expression::Number(number, None));
    let two = |operator, left, right| Box::new(Expression::Binary(operator, left, right));
    let negated = Box::new(Expression::Negate(name("Y.LOAD")));
    let mut all = Box::new(Expression::Not(name("trace:alarm[3]")));
    for relation in [
        Operator::Equal,
        Operator::NotEqual,
        Operator::Less,
        Operator::LessOrEqual,
        Operator::Greater,
        Operator::GreaterOrEqual,
    ] {
        all = two(Operator::And, all, two(relation, name("X.LOAD"), number(-1.5)));
    }
    for reckoning in [Operator::Add, Operator::Subtract, Operator::Multiply, Operator::Divide] {
        let sum = two(reckoning, name("X.LOAD"), negated.clone());
        all = two(Operator::Or, all, two(Operator::Less, sum, number(3.0)));
    }
    all = two(Operator::Xor, all, Box::new(Expression::Truth(true)));
    let mut stream = Told(Some(StepKind::NcFunction(RawNcFunction {
        kind: RawNcFunction::EXTENDED.into(),
        name: "watch".into(),
        text: "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_actions=get_time".into(),
        condition: Some(Ok(*all)),
        properties: BTreeMap::new(),
    })));
    let file = convert(&mut stream, &write_options(false, false), &mut |_| Answer::Unknown).expect("it can be written");
    check(&schema, file.bytes, "typed");
}

#[test]
fn what_is_edited_holds_against_the_long_form() {
    let Some(schema) = long_form() else { return };
    let bracket = include_bytes!("../../../corpus/bracket.stpnc").to_vec();
    check(&schema, bracket.clone(), "bracket");
    let program = Program::read("bracket.stpnc", bracket).expect("a Part 21 file");
    let at = |path: &str| select(&program, path).expect("it is there");
    let mut edits = ProgramEdits::new(&program);
    edits.enable(at("face top"), false).expect("it can be disabled");
    edits.set_feed(at("round pocket"), MmPerSec(5.0)).expect("it has a feed");
    edits.delete(at("drill holes")).expect("it can be deleted");
    edits
        .insert(Target::Before(at("wave groove").into()), "note", &Insert::Message("☃".into()))
        .expect("it can be inserted");
    check(&schema, edits.save().expect("it can be saved").bytes, "edited");
}

#[test]
fn what_does_not_hold_is_found() {
    let Some(schema) = long_form() else { return };
    let bracket = include_str!("../../../corpus/bracket.stpnc");
    let faults = |from: &str, to: &str| {
        assert!(bracket.contains(from), "{from}");
        let file = part21::File::read(bracket.replacen(from, to, 1).into_bytes()).expect("a Part 21 file");
        schema.faults(&file).len()
    };
    assert_eq!(
        faults(
            "#36=PRODUCT_DEFINITION_FORMATION('1','',#35)",
            "#36=PRODUCT_DEFINITION_FORMATION('1','')"
        ),
        1
    );
    assert_eq!(faults("POLYLINE('',(#66,#67,#68))", "POLYLINE('',(#66))"), 1);
    assert_eq!(faults("POLYLINE('',(#66,#67,#68))", "POLYLINE('',(#66,#67,#36))"), 1);
    assert_eq!(faults("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.MILLY.,.METRE.)"), 1);
    assert_eq!(
        faults("CARTESIAN_POINT('',(-32.,15.,50.))", "CARTESIAN_POINT($,(-32.,15.,50.))"),
        1
    );
}
