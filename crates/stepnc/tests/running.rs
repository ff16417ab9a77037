//! What a stream says: steps of small programs, questions, and alarms about what cannot be run.

mod common;
use common::{holds, one_path, program_of, says, steps};
use expect_test::{Expect, expect};
use plan::tables::{Missing, ToolEntry};
use plan::{Answer, Next, ProgramStream, Tables};
use std::sync::Arc;
use stepnc::{PathFrame, Program, StepNcStream, StreamOptions};
use units::{ToolNumber, Transform};

const LINE: &str =
    "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,5.));\n#202=CARTESIAN_POINT('',(10.,0.,5.));\n";

/// A machine that knows tool 1, so that nothing is assumed about it.
fn options() -> StreamOptions {
    let mut tables = Tables::empty();
    tables.tools.insert(ToolNumber(1), ToolEntry::default());
    StreamOptions {
        tables,
        ..StreamOptions::default()
    }
}

#[track_caller]
fn check(program: Program, expected: Expect) {
    expected.assert_eq(&steps(program, options(), 200, |_| Answer::Truth(true)));
}

/// A set-up of workplan #100 with its origin at #301.
fn setup() -> String {
    "#300=PRODUCT_DEFINITION_PROCESS('setup','',#100,'');\n#302=PROCESS_PRODUCT_ASSOCIATION('','',#303,#300);\n\
     #303=PRODUCT_DEFINITION('','',#304,#20);\n#304=PRODUCT_DEFINITION_FORMATION('1','',#305);\n#305=MACHINING_SETUP('VISE','VISE',$,(#21));\n\
     #306=PRODUCT_DEFINITION_SHAPE('orientation','',#303);\n#307=SHAPE_DEFINITION_REPRESENTATION(#306,#308);\n\
     #308=SHAPE_REPRESENTATION('',(#301),#7);\n#301=AXIS2_PLACEMENT_3D('orientation',#309,#310,#311);\n\
     #309=CARTESIAN_POINT('',(100.,50.,0.));\n#310=DIRECTION('',(0.,0.,1.));\n#311=DIRECTION('',(0.,1.,0.));\n"
        .to_string()
}

/// A toolpath orientation of #101: 5 mm along X.
fn orientation() -> String {
    holds(320, 101, "toolpath orientation", 325, 7)
        + "#325=AXIS2_PLACEMENT_3D('',#326,$,$);\n#326=CARTESIAN_POINT('',(5.,0.,0.));\n"
}

#[test]
fn one_path_is_markers_frame_spindle_link_and_moves() {
    check(
        one_path(&format!("{LINE}{}{}", setup(), orientation()), 7),
        expect![[r#"
            1 - begin Program 'main'
            2 #100 begin Workplan 'main'
            3 #101 begin Workingstep 'step'
            4 #102 begin Operation 'op'
            5 #102 tool T1 endmill None
            6 #102 offset 1 assumed false
            7 #110 frame 'VISE' (100.0000, 55.0000, 0.0000) turned
            8 #110 spindle cw 1500 rev/min
            9 #110 line (-55.0000, 100.0000, 0.0000) -> (-55.0000, 100.0000, 5.0000) rapid derived
            10 #110 line (-55.0000, 100.0000, 5.0000) -> (0.0000, 0.0000, 5.0000) rapid derived
            11 #110 begin Toolpath 'path'
            12 #110 line (0.0000, 0.0000, 5.0000) -> (10.0000, 0.0000, 5.0000) 10.000 mm/s
            13 #110 End(Toolpath)
            14 #102 End(Operation)
            15 #101 End(Workingstep)
            16 #100 End(Workplan)
            17 - Spindle(Stopped)
            18 - End(Program)
            end
            remark: own.stpnc:31:1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
        "#]],
    );
}

#[test]
fn the_frame_of_steps_takes_path_points_to_where_set_up_and_orientation_put_them() {
    // A quarter turn at (100, 50): 5 mm of orientation and 10 mm of path along X lie along the machine's Y.
    let program = one_path(&format!("{LINE}{}{}", setup(), orientation()), 7);
    let mut stream = StepNcStream::new(Arc::new(program), options());
    let mut modal = plan::Modal::default();
    while let Next::Step(step) = stream.next(None) {
        modal.follow(&step);
        if let Some(tip) = modal.tip.filter(|tip| tip.xyz == [10.0, 0.0, 5.0]) {
            let frame = modal.frame.as_ref().expect("said before the move").machine_from_setup;
            assert!((frame * tip).distance(units::Point::new(100.0, 65.0, 5.0)) < 1e-9);
            return;
        }
    }
    panic!("the path has no end");
}

#[test]
fn a_work_offset_of_the_machine_goes_before_the_origin_in_the_file() {
    let mut options = options();
    let mut offset = Transform::IDENTITY;
    offset.origin = [1.0, 2.0, 3.0];
    options.tables.work_offsets.insert("VISE".into(), offset);
    let text = steps(one_path(&format!("{LINE}{}", setup()), 7), options, 200, |_| {
        Answer::Truth(true)
    });
    assert!(text.contains("frame 'VISE' (1.0000, 2.0000, 3.0000)\n"), "{text}");
    assert!(text.contains("the work offset 'VISE' of the machine is used"), "{text}");
}

#[test]
fn the_placement_of_the_workpiece_moves_paths_only_when_asked() {
    let placement = "#330=MACHINING_SETUP_WORKPIECE_RELATIONSHIP('','workpiece setup','',#303,#331);\n#331=PRODUCT_DEFINITION('','',#304,#20);\n\
        #332=PRODUCT_DEFINITION_SHAPE('','',#330);\n#333=ITEM_DEFINED_TRANSFORMATION('','',#334,#335);\n#334=AXIS2_PLACEMENT_3D('',#337,$,$);\n\
        #337=CARTESIAN_POINT('',(0.,0.,0.));\n#335=AXIS2_PLACEMENT_3D('',#336,$,$);\n#336=CARTESIAN_POINT('',(7.,0.,0.));\n\
        #338=(REPRESENTATION_RELATIONSHIP('','',#308,#308) REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#333) SHAPE_REPRESENTATION_RELATIONSHIP());\n\
        #339=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#338,#332);\n";
    for (path_frame, frame) in [
        (PathFrame::Setup, "(100.0000, 50.0000, 0.0000)"),
        (PathFrame::Workpiece, "(100.0000, 57.0000, 0.0000)"),
    ] {
        let options = StreamOptions { path_frame, ..options() };
        let text = steps(one_path(&format!("{LINE}{}{placement}", setup()), 7), options, 200, |_| {
            Answer::Truth(true)
        });
        assert!(text.contains(&format!("frame 'VISE' {frame} turned\n")), "{text}");
    }
}

/// A program of functions and decisions: messages say where it came by.
fn decisions() -> Program {
    let message = |id: u64, text: &str| {
        format!(
            "#{id}=MACHINING_NC_FUNCTION('m','display message','','');\n{}",
            says(id + 1, id, "message text", text)
        )
    };
    program_of(&format!(
        "#100=MACHINING_WORKPLAN('main','','','');\n\
         #101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#110,5.);\n#102=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#120,1.);\n\
         #103=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#130,2.5);\n#104=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#140,3.);\n\
         #105=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#190,4.);\n\
         #110=MACHINING_NC_FUNCTION('tell','extended function','','');\n{}\
         #120=MACHINING_PROCESS_EXECUTABLE('count = 2','assignment','','');\n{}{}\
         #130=MACHINING_PROCESS_EXECUTABLE('if','if statement','','');\n{}\
         #138=MACHINING_PROCESS_BRANCH_RELATIONSHIP('true branch','',#130,#160);\n#139=MACHINING_PROCESS_BRANCH_RELATIONSHIP('false branch','',#130,#170);\n\
         #140=MACHINING_PROCESS_EXECUTABLE('while','while statement','','');\n{}\
         #148=MACHINING_PROCESS_BODY_RELATIONSHIP('','',#140,#180);\n\
         #190=MACHINING_NC_FUNCTION('look','optional stop','','');\n{}{}{}\
         #400=EXPRESSION_ITEM_REPRESENTATION_ITEM('count',#401);\n#401=REAL_NUMERIC_VARIABLE();\n\
         #402=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#403);\n#403=REAL_LITERAL(2.);\n\
         #404=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#405);\n#405=COMPARISON_GREATER((#401,#406));\n#406=INT_LITERAL(1);\n\
         #407=(AND_EXPRESSION() EXPRESSION() GENERIC_EXPRESSION() MULTIPLE_ARITY_GENERIC_EXPRESSION((#405,#408)) REPRESENTATION_ITEM('older form'));\n\
         #408=COMPARISON_LESS((#410,#403));\n#409=EXPRESSION_ITEM_REPRESENTATION_ITEM('X.LOAD',#410);\n#410=REAL_NUMERIC_VARIABLE();\n",
        says(111, 110, "description", "trace:1 get_time"),
        holds(121, 120, "lvalue", 400, 8),
        holds(125, 120, "rvalue", 402, 8),
        holds(131, 130, "condition", 404, 8),
        holds(141, 140, "condition", 407, 8),
        message(160, "more than one"),
        message(170, "one"),
        message(180, "again"),
    ))
}

#[test]
fn variables_decide_alone_and_sensors_are_asked_for() {
    let mut turns = 0;
    let text = steps(decisions(), options(), 200, |question| match question {
        plan::Question::Condition(_) => {
            turns += 1;
            Answer::Truth(turns < 3)
        }
        _ => Answer::Truth(false),
    });
    expect![[r#"
        1 - begin Program 'main'
        2 #100 begin Workplan 'main'
        3 #160 Message("more than one")
        ask Condition(Binary(And, Binary(Greater, Number(2.0, None), Number(1.0, None)), Binary(Less, Name("X.LOAD"), Number(2.0, None)))) -> Truth(true)
        4 #180 Message("again")
        ask Condition(Binary(And, Binary(Greater, Number(2.0, None), Number(1.0, None)), Binary(Less, Name("X.LOAD"), Number(2.0, None)))) -> Truth(true)
        5 #180 Message("again")
        ask Condition(Binary(And, Binary(Greater, Number(2.0, None), Number(1.0, None)), Binary(Less, Name("X.LOAD"), Number(2.0, None)))) -> Truth(false)
        ask OptionalStop -> Truth(false)
        6 #110 NcFunction(RawNcFunction { kind: "extended function", name: "tell", text: "trace:1 get_time", condition: None, properties: {} })
        7 #100 End(Workplan)
        8 - End(Program)
        end
        remark: own.stpnc:31:1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
    "#]].assert_eq(&text);
}

#[test]
fn a_machine_that_cannot_answer_is_an_alarm() {
    let text = steps(decisions(), options(), 200, |_| Answer::Unknown);
    expect![[r#"
        1 - begin Program 'main'
        2 #100 begin Workplan 'main'
        3 #160 Message("more than one")
        ask Condition(Binary(And, Binary(Greater, Number(2.0, None), Number(1.0, None)), Binary(Less, Name("X.LOAD"), Number(2.0, None)))) -> Unknown
        error: own.stpnc:55:1: #140: the machine cannot say whether the condition is true; check the names in the condition, or whether this machine has that sensor
        remark: own.stpnc:31:1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
        error: own.stpnc:55:1: #140: the machine cannot say whether the condition is true; check the names in the condition, or whether this machine has that sensor
    "#]].assert_eq(&text);
}

#[test]
fn rewinding_gives_the_same_steps_again() {
    let program = Arc::new(one_path(&format!("{LINE}{}", setup()), 7));
    let mut stream = StepNcStream::new(program, options());
    let all = |stream: &mut StepNcStream| {
        std::iter::from_fn(|| Some(stream.next(None)).filter(|next| *next != Next::End)).collect::<Vec<_>>()
    };
    let first = all(&mut stream);
    stream.rewind();
    assert_eq!(first, all(&mut stream));
    assert!(first.len() > 10);
}

#[track_caller]
fn alarm(program: Program, options: StreamOptions, expected: Expect) {
    let text = steps(program, options, 200, |_| Answer::Truth(true));
    let alarm = text.lines().find(|line| line.starts_with("error")).unwrap_or("no alarm");
    expected.assert_eq(alarm);
}

#[test]
fn alarms_name_the_instance_the_line_and_the_remedy() {
    let text = "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,5.));\n#202=CARTESIAN_POINT('',(10.,0.,5.));\n";
    // No tool: the operation is taken from its users.
    let source = |from: &str, to: &str| {
        let program = one_path(text, 7);
        let bytes = String::from_utf8(program.file().bytes().to_vec()).expect("ASCII");
        assert!(bytes.contains(from), "{from}");
        Program::read("own.stpnc", bytes.replace(from, to).into_bytes()).expect("a Part 21 file")
    };
    alarm(
        source("'endmill',(#102)", "'endmill',()"),
        options(),
        expect![
            "error: own.stpnc:35:1: #102: operation 'op' has no tool; add the operation to the users of a MACHINING_TOOL, or load a tool before"
        ],
    );
    alarm(
        source("ACTION_PROPERTY('feedrate'", "ACTION_PROPERTY('something else'"),
        options(),
        expect![
            "error: own.stpnc:37:1: #110: toolpath 'path' cuts and its technology has no feed; give the technology of the path or of its operation a feed, or mark the path as rapid"
        ],
    );
    alarm(
        source("NUMERIC_MEASURE(600.),#5", "NUMERIC_MEASURE(600.),#36"),
        options(),
        expect![
            "error: own.stpnc:47:1: #125: the unit of 'feed speed' is no feed's; give the feed in length per time or per revolution"
        ],
    );
    alarm(
        source("NUMERIC_MEASURE(600.)", "NUMERIC_MEASURE(0.)"),
        options(),
        expect![
            "error: own.stpnc:37:1: #110: toolpath 'path' cuts with a feed of 0; give its technology a feed, or mark the path as rapid"
        ],
    );
    alarm(
        source("ACTION_PROPERTY('basic curve'", "ACTION_PROPERTY('no curve'"),
        options(),
        expect![
            "error: own.stpnc:37:1: #110: toolpath 'path' (cutter location trajectory) has no curve; export toolpaths as cutter location trajectories with a basic curve"
        ],
    );
    alarm(
        source("POLYLINE('',(#201,#202))", "CONIC('',#201)"),
        options(),
        expect![
            "error: own.stpnc:53:1: #200: a toolpath cannot run along a CONIC; use a polyline, a trimmed curve, a composite curve or a B-spline"
        ],
    );
    alarm(
        source("'cutter location trajectory'", "'cutter contact trajectory'"),
        options(),
        expect![
            "error: own.stpnc:37:1: #110: toolpath 'path' gives contact points and not the tool tip; export cutter location trajectories"
        ],
    );
    alarm(
        source("'cutter location trajectory'", "'feedstop'"),
        options(),
        expect!["error: own.stpnc:37:1: #110: feedstop 'path' has no dwell time; give it one"],
    );
    alarm(
        source("#105=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP", "#105=SOMETHING_ELSE"),
        options(),
        expect![
            "error: own.stpnc:33:1: #101: operation 'op' (FREEFORM_MILLING_OPERATION) has no toolpaths; let the CAM system compute them; none are made up here"
        ],
    );
    alarm(
        source(
            "#103=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#101,1.)",
            "#103=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#100,1.)",
        ),
        options(),
        expect!["error: own.stpnc: the file has no machining program to run; open a STEP-NC file with a project or a workplan"],
    );
    let mut strict = options();
    strict.tables.missing = Missing::Fail;
    alarm(
        one_path(text, 7),
        strict.clone(),
        expect!["error: own.stpnc:31:1: #100: the set-up '' has no origin; enter a work offset of this name"],
    );
    let nameless = source("MACHINING_TOOL('1'", "MACHINING_TOOL('fly cutter'");
    alarm(
        nameless,
        strict.clone(),
        expect![
            "error: own.stpnc:52:1: #130: tool 'fly cutter' (endmill) has no number; give the number in its identifier or as its tool position"
        ],
    );
    strict.tables.tools.clear();
    alarm(
        one_path(&format!("{text}{}", setup()), 7),
        strict,
        expect!["error: own.stpnc:52:1: #130: tool T1 (endmill) is not in the tool table; enter the tool with its length"],
    );
}

#[test]
fn a_gap_of_rounding_between_paths_is_closed_and_a_real_one_is_a_rapid_link() {
    for (start, expected) in [
        ("10.002", "line (10.0000, 0.0000, 5.0000) -> (20.0000"),
        ("10.5", "(10.5000, 0.0000, 5.0000) rapid derived"),
    ] {
        let second = format!(
            "#140=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#141,2.);\n#141=MACHINING_TOOLPATH('next','cutter location trajectory','','');\n\
             #220=POLYLINE('',(#221,#222));\n#221=CARTESIAN_POINT('',({start},0.,5.));\n#222=CARTESIAN_POINT('',(20.,0.,5.));\n{}",
            holds(142, 141, "basic curve", 220, 7)
        );
        let text = steps(one_path(&format!("{LINE}{second}"), 7), options(), 200, |_| {
            Answer::Truth(true)
        });
        assert!(text.contains(expected), "{text}");
        assert_eq!(
            text.matches("rapid derived").count(),
            if start == "10.5" { 2 } else { 1 },
            "{text}"
        );
    }
}

#[test]
fn on_a_lathe_links_leave_along_x_and_surface_speed_keeps_its_limit() {
    let text = String::from_utf8(one_path(LINE, 7).file().bytes().to_vec()).expect("ASCII");
    let text = text
        .replace("FREEFORM_MILLING_OPERATION", "TURNING_TYPE_OPERATION")
        .replace("(#129),#8)", "(#129,#190),#8)")
        .replace(
            "'rotational speed',NUMERIC_MEASURE(-1500.),#6",
            "'surface speed',NUMERIC_MEASURE(60000.),#5",
        )
        .replace(
            "ENDSEC;\nEND-ISO",
            "#190=MEASURE_REPRESENTATION_ITEM('maximum rotational speed',NUMERIC_MEASURE(1800.),#6);\nENDSEC;\nEND-ISO",
        );
    let program = Program::read("own.stpnc", text.into_bytes()).expect("a Part 21 file");
    assert!(program.turns());
    let mut options = options();
    options.tables.position = units::Point::new(50.0, 0.0, 100.0);
    let text = steps(program, options, 200, |_| Answer::Truth(true));
    let lines: Vec<&str> = text
        .lines()
        .filter(|line| line.contains("derived") || line.contains("Spindle(Counter"))
        .collect();
    expect![[r#"
        8 #110 Spindle(Counterclockwise(Surface { speed: MmPerSec(1000.0), limit: Rpm(1800.0) }))
        9 #110 line (50.0000, 0.0000, 100.0000) -> (50.0000, 0.0000, 5.0000) rapid derived
        10 #110 line (50.0000, 0.0000, 5.0000) -> (0.0000, 0.0000, 5.0000) rapid derived"#]]
    .assert_eq(&lines.join("\n"));
}

#[test]
fn a_damaged_file_is_shown_and_not_run() {
    let text = String::from_utf8(one_path(LINE, 7).file().bytes().to_vec()).expect("ASCII");
    let cut = &text[..text.len() - 60];
    let program = Program::read("cut.stpnc", cut.as_bytes().to_vec()).expect("a Part 21 file");
    assert_eq!(stepnc::inspect::inspect(&program).tree.len(), 1);
    alarm(
        program,
        options(),
        expect![
            "error: cut.stpnc:55:6: #202 has no entity name; the file is damaged and parts of it may be missing: it can be inspected, and is not run; export it again"
        ],
    );
}

#[test]
fn a_speed_profile_is_spread_over_all_pieces_of_its_path() {
    let data = "#200=POLYLINE('',(#201,#202,#203));\n#201=CARTESIAN_POINT('',(0.,0.,5.));\n#202=CARTESIAN_POINT('',(10.,0.,5.));\n\
        #203=CARTESIAN_POINT('',(40.,0.,5.));\n#210=ACTION_PROPERTY('speed profile','',#110);\n#211=ACTION_PROPERTY_REPRESENTATION('','',#210,#212);\n\
        #212=MACHINING_TOOLPATH_SPEED_PROFILE_REPRESENTATION('',(#213),#8);\n#213=POLYLINE('',(#214,#215,#216));\n\
        #214=CARTESIAN_POINT('',(1.));\n#215=CARTESIAN_POINT('',(2.));\n#216=CARTESIAN_POINT('',(0.5));\n";
    let text = steps(one_path(data, 7), options(), 200, |_| Answer::Truth(true));
    let moves: Vec<&str> = text
        .lines()
        .filter(|line| line.contains(" x ["))
        .map(|line| line.split(" x ").nth(1).unwrap_or(""))
        .collect();
    expect![[r#"
        [(0.0, 1.0), (1.0, 1.5)]
        [(0.0, 1.5), (0.3333333333333333, 2.0), (1.0, 0.5)]"#]]
    .assert_eq(&moves.join("\n"));
}
