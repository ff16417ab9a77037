//! What is written holds against the EXPRESS long form of edition 3: argument counts, types, selects, enumerations, bounds, references.
//!
//! The long form is not part of this repository: `AP238_EXPRESS=.../ap238e3_aim_lf.exp cargo test -p stepnc --test express`.

mod common;
#[path = "express/schema.rs"]
mod schema;

use plan::{Answer, MemorySource, NoOtherFiles, Question, Tables};
use schema::Schema;
use stepnc::Program;
use stepnc::edit::{Insert, ProgramEdits, Target};
use stepnc::select::select;
use stepnc::write::{WriteOptions, convert};
use units::{MmPerSec, Timestamp};

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

fn converted(text: &str, profile: &str, inches: bool) -> Vec<u8> {
    let profile = gcode::profile::by_name(profile).expect("it is known");
    let source = Box::new(MemorySource(text.as_bytes().to_vec()));
    let tables = Tables::empty();
    let options = gcode::Options::default();
    let program = gcode::GcodeProgram::open(source, "part.nc", profile, Box::new(NoOtherFiles), tables.clone(), options);
    let options = WriteOptions {
        name: "Teil 'ä' / \\ ☃".into(),
        made_from: "part.nc".into(),
        written: Timestamp(0),
        author: "it's me".into(),
        writer: "toolmark".into(),
        inches,
        turning: profile.turning,
        tables,
        functions: stepnc::FunctionForm::Mapping,
    };
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
