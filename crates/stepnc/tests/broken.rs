//! No text makes the reader, the stream or the writer panic, and no program runs for ever without saying something.

mod common;
use common::{file_of, one_path, says};
use plan::{Answer, Next, ProgramStream};
use proptest::prelude::*;
use std::sync::Arc;
use stepnc::inspect::inspect;
use stepnc::twin::{self, TwinOptions};
use stepnc::{Program, StepNcStream, StreamOptions};
use units::Timestamp;

/// Reads, shows, runs and re-reads; nothing is expected but to come back.
fn use_in_every_way(bytes: Vec<u8>) {
    let Ok(program) = Program::read("broken.stpnc", bytes) else {
        return;
    };
    let _ = serde_json::to_string(&inspect(&program)).expect("plain data");
    for found in twin::read(&program, &program) {
        let _ = twin::append(&program, &found.run, &TwinOptions::at(Timestamp(0)));
        let _ = stepnc::write_new(&found.run, &TwinOptions::at(Timestamp(0)));
    }
    let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
    let mut reply = None;
    for _ in 0..200 {
        match stream.next(reply.take()) {
            Next::Step(step) => {
                if let plan::StepKind::Move(go) = &step.kind {
                    assert!(go.path.is_sound(), "{go:?}");
                }
            }
            Next::Ask(_) => reply = Some(Answer::Truth(true)),
            Next::End | Next::Alarm(_) => break,
        }
    }
}

/// A program with a bit of everything, and a twin of itself.
fn everything() -> &'static str {
    static TEXT: std::sync::OnceLock<String> = std::sync::OnceLock::new();
    TEXT.get_or_init(make_everything)
}

fn make_everything() -> String {
    let curve = "#200=COMPOSITE_CURVE('',(#201,#202,#203,#240),.F.);\n#201=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#204);\n\
        #202=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#205);\n#203=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#206);\n\
        #240=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#241);\n#241=TRIMMED_CURVE('',#206,(#217),(#218),.T.,.CARTESIAN.);\n#204=POLYLINE('',(#210,#211));\n\
        #205=TRIMMED_CURVE('',#207,(#211),(#212),.T.,.CARTESIAN.);\n#206=B_SPLINE_CURVE_WITH_KNOTS('',2,(#212,#215,#216,#217),.UNSPECIFIED.,.F.,.F.,(3,1,3),(0.,0.5,1.),.UNSPECIFIED.);\n\
        #207=CIRCLE('',#208,10.);\n#208=AXIS2_PLACEMENT_3D('',#209,$,$);\n#209=CARTESIAN_POINT('',(0.,0.,0.));\n#210=CARTESIAN_POINT('',(20.,0.,0.));\n\
        #211=CARTESIAN_POINT('',(10.,0.,0.));\n#212=CARTESIAN_POINT('',(0.,10.,0.));\n#215=CARTESIAN_POINT('',(0.,20.,1.));\n\
        #216=CARTESIAN_POINT('',(5.,20.,2.));\n#217=CARTESIAN_POINT('',(9.,9.,9.));\n#218=CARTESIAN_POINT('',(0.,10.,0.));\n\
        #220=POLYLINE('',(#210,#221,#211,#222,#223,#211));\n#221=VIA_ARC_POINT('',(15.,5.,0.));\n#222=VIA_HELIX_POINT('',(0.,10.,0.));\n#223=VIA_ARC_POINT('',(-10.,0.,0.));\n\
        #500=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#501,2.);\n#501=MACHINING_PROCESS_EXECUTABLE('w','while statement','','');\n\
        #502=MACHINING_PROCESS_BODY_RELATIONSHIP('','',#501,#101);\n#503=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#504,3.);\n\
        #504=MACHINING_PROCESS_EXECUTABLE('s','selective','','');\n#505=MACHINING_PROCESS_BRANCH_RELATIONSHIP('','',#504,#101);\n\
        #510=ACTION_PROPERTY('condition','',#501);\n#511=ACTION_PROPERTY_REPRESENTATION('','',#510,#512);\n#512=REPRESENTATION('',(#513),#8);\n\
        #513=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#514);\n#514=COMPARISON_LESS((#515,#516));\n#515=REAL_NUMERIC_VARIABLE();\n#516=REAL_LITERAL(1.5);\n\
        #517=EXPRESSION_ITEM_REPRESENTATION_ITEM('X.LOAD',#515);\n";
    let program = one_path(&(curve.to_string() + &says(530, 110, "direction", "end to beginning")), 7);
    let run = plan::executed::AsExecuted {
        name: "run 1".into(),
        source: "test".into(),
        simulated: true,
        start: Timestamp(0),
        end: Timestamp(1_000_000_000),
        worktime: units::Seconds(1.0),
        exception: None,
        plan: Some(100),
        workingsteps: Vec::new(),
    };
    let saved = twin::append(&program, &run, &TwinOptions::at(Timestamp(0))).expect("it fits");
    String::from_utf8(saved.bytes).expect("ASCII")
}

#[test]
fn the_unbroken_program_runs() {
    let program = Program::read("whole.stpnc", everything().as_bytes().to_vec()).expect("a Part 21 file");
    assert!(inspect(&program).summary.toolpaths > 0);
    use_in_every_way(everything().as_bytes().to_vec());
}

#[test]
fn loops_without_an_end_and_trees_without_a_bottom_come_to_an_alarm() {
    for data in [
        "#100=MACHINING_WORKPLAN('a','','','');\n#101=MACHINING_WORKPLAN('b','','','');\n#102=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#101,1.);\n\
         #103=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#101,#101,1.);",
        "#100=MACHINING_WORKPLAN('a','','','');\n#102=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#103,1.);\n\
         #103=MACHINING_PROCESS_EXECUTABLE('for ever','while statement','','');\n#104=MACHINING_PROCESS_BODY_RELATIONSHIP('','',#103,#105);\n\
         #105=MACHINING_WORKPLAN('nothing','','','');\n#106=ACTION_PROPERTY('enabled','',#105);\n#107=ACTION_PROPERTY_REPRESENTATION('','',#106,#108);\n\
         #108=REPRESENTATION('',(#109),#8);\n#109=DESCRIPTIVE_REPRESENTATION_ITEM('','disabled');\n#110=ACTION_PROPERTY('condition','',#103);\n\
         #111=ACTION_PROPERTY_REPRESENTATION('','',#110,#112);\n#112=REPRESENTATION('',(#113),#8);\n#113=BOOLEAN_LITERAL(.T.);",
    ] {
        let program = Program::read("endless.stpnc", file_of(data).into_bytes()).expect("a Part 21 file");
        let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
        let alarm = (0..100).find_map(|_| match stream.next(None) {
            Next::Alarm(alarm) => Some(alarm.to_string()),
            _ => None,
        });
        assert!(alarm.is_some(), "{data}");
    }
}

#[test]
fn workplans_a_hundred_thousand_deep_come_to_an_alarm() {
    let mut data = String::new();
    for n in 0..100_000u64 {
        let (id, next) = (1000 + 2 * n, 1000 + 2 * (n + 1));
        data += &format!(
            "#{id}=MACHINING_WORKPLAN('w','','','');\n#{}=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{id},#{next},1.);\n",
            id + 1
        );
    }
    data += "#201000=MACHINING_WORKPLAN('last','','','');\n";
    let program = Program::read("deep.stpnc", file_of(&data).into_bytes()).expect("a Part 21 file");
    assert!(
        inspect(&program)
            .problems
            .iter()
            .any(|problem| problem.code == "endless-tree")
    );
    let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
    let alarm = (0..10_000).find_map(|_| match stream.next(None) {
        Next::Alarm(alarm) => Some(alarm.to_string()),
        _ => None,
    });
    assert!(alarm.is_some_and(|alarm| alarm.contains("nested more than 1000 deep")));
}

#[test]
fn a_curve_of_curves_that_doubles_at_each_level_or_holds_itself_is_a_fault() {
    let mut doubling = String::from("#200=COMPOSITE_CURVE('',(#300,#300),.F.);\n");
    for n in 0..14u64 {
        let (segment, curve) = (300 + 2 * n, 301 + 2 * n);
        doubling += &format!("#{segment}=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#{curve});\n");
        if n < 13 {
            let next = segment + 2;
            doubling += &format!("#{curve}=COMPOSITE_CURVE('',(#{next},#{next},#{next}),.F.);\n");
        }
    }
    doubling +=
        "#327=POLYLINE('',(#400,#401,#400));\n#400=CARTESIAN_POINT('',(0.,0.,0.));\n#401=CARTESIAN_POINT('',(1.,0.,0.));\n";
    let itself = "#200=COMPOSITE_CURVE('',(#300,#300),.F.);\n#300=COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.,#200);\n";
    for data in [doubling.as_str(), itself] {
        let inspection = inspect(&one_path(data, 7));
        assert!(
            inspection.problems.iter().any(|problem| problem.code == "curve-nesting"),
            "{:?}",
            inspection.problems
        );
    }
}

/// An ISO 14649 file with toolpaths and control structures.
const ARM: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/seeds/stepnc/arm.stp"));

#[test]
fn the_unbroken_arm_file_is_read() {
    let program = Program::read("arm.stp", ARM.as_bytes().to_vec()).expect("a Part 21 file");
    assert!(program.is_iso_14649() && inspect(&program).summary.toolpaths > 0);
    use_in_every_way(ARM.as_bytes().to_vec());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 250, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_mutation_panics(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(b"'#;(),*=$.0123456789-E T".to_vec())), 0..12),
        cut in any::<prop::sample::Index>(),
        truncate in 0..4u8,
    ) {
        let mut bytes = everything().as_bytes().to_vec();
        let data = bytes.windows(5).position(|window| window == b"DATA;").expect("it has data");
        for (place, byte) in changes {
            let place = data + 5 + place.index(bytes.len() - data - 5);
            bytes[place] = byte;
        }
        if truncate == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        use_in_every_way(bytes);
    }

    #[test]
    fn no_mutation_of_an_arm_file_panics(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop::sample::select(b"'#;(),*=$.0123456789-E T".to_vec())), 0..12),
    ) {
        let mut bytes = ARM.as_bytes().to_vec();
        let data = bytes.windows(5).position(|window| window == b"DATA;").expect("it has data");
        for (place, byte) in changes {
            let place = data + 5 + place.index(bytes.len() - data - 5);
            bytes[place] = byte;
        }
        use_in_every_way(bytes);
    }

    #[test]
    fn no_exchange_of_references_panics(
        swaps in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..10),
    ) {
        let text = everything();
        let parts: Vec<&str> = text.split_inclusive(['#', ',', '(', ')']).collect();
        let mut parts: Vec<String> = parts.into_iter().map(str::to_string).collect();
        for (one, other) in swaps {
            let (one, other) = (one.index(parts.len()), other.index(parts.len()));
            if !parts[one].contains(';') && !parts[other].contains(';') {
                parts.swap(one, other);
            }
        }
        use_in_every_way(parts.concat().into_bytes());
    }
}
