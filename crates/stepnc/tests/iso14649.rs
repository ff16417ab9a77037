//! ISO 14649 files: the NIST example against what its own interpreter and tool tables say, and explicit toolpaths in all their frames.

mod common;
use common::{outline, sample, steps};
use expect_test::expect;
use plan::{Answer, Question};
use std::collections::BTreeSet;
use std::fmt::Write;
use stepnc::inspect::inspect;
use stepnc::{ExecutableKind, FeedSetting, Program, SpindleSetting, StreamOptions};

const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/samples/stepnc/iso14649");

#[expect(
    clippy::disallowed_methods,
    reason = "tests read sample files; the crate itself opens nothing"
)]
fn text_sample(name: &str) -> Option<String> {
    let found = std::fs::read_to_string(std::path::Path::new(SAMPLES).join(name));
    if found.is_err() {
        println!("skipped: no sample file {name} at {SAMPLES}");
    }
    found.ok()
}

/// Tool, revolutions per minute and mm/min of each workingstep, in order, as the interpreter set them last before it cut.
fn settings_of(canonical: &str) -> Vec<(String, BTreeSet<String>, BTreeSet<String>)> {
    let mut found: Vec<(String, BTreeSet<String>, BTreeSet<String>)> = Vec::new();
    for line in canonical.lines() {
        let Some((word, inside)) = line
            .trim()
            .trim_start_matches(|c: char| c.is_ascii_digit())
            .trim()
            .split_once('(')
        else {
            continue;
        };
        let inside = inside.trim_end_matches(')').to_string();
        match (word, found.last_mut()) {
            ("CHANGE_TOOL", _) => found.push((inside, BTreeSet::new(), BTreeSet::new())),
            ("SET_SPINDLE_SPEED", Some(last)) => drop(last.1.insert(inside)),
            ("SET_FEED_RATE", Some(last)) => drop(last.2.insert(inside)),
            _ => {}
        }
    }
    found
}

#[test]
fn the_nist_example_agrees_with_what_its_interpreter_did() {
    let (Some(program), Some(canonical)) = (sample("iso14649/nist_ex1.stp"), text_sample("nist_ex1.can")) else {
        return;
    };
    // The interpreter changes the tool where the next workingstep needs another; the two pockets share one change.
    let interpreted = settings_of(&canonical);
    let mut ours: Vec<String> = Vec::new();
    program.walk(program.projects()[0].main_workplan, &mut |executable, enabled| {
        let ExecutableKind::Workingstep { operation, turning } = &executable.kind else {
            return;
        };
        assert!(enabled && !turning);
        let operation = operation.and_then(|id| program.operation(id)).expect("each has one");
        let tool = program.tool_of(operation.id).expect("each has one");
        let technology = operation
            .technology
            .and_then(|id| program.technology(id))
            .expect("each has one");
        let spindle = match technology.spindle {
            Some(SpindleSetting::Revolutions { speed, clockwise: true }) => speed.0,
            other => panic!("{other:?}"),
        };
        let Some(FeedSetting::PerTime(feed)) = technology.feed else {
            panic!("{technology:?}")
        };
        let place = interpreted
            .iter()
            .rposition(|(name, ..)| *name == tool.name)
            .expect("the interpreter loads it");
        let (first, ..) = interpreted
            .iter()
            .enumerate()
            .find(|(_, (name, ..))| *name == tool.name)
            .expect("the same");
        let said = |n: usize| &interpreted[n];
        let rpm = format!("{spindle:.4}");
        // A drill is slowed down where it enters and leaves; its own speed is none of those that its strategy makes.
        if operation.kind != "DRILLING" {
            assert!(
                said(first).1.contains(&rpm) || said(place).1.contains(&rpm),
                "{rpm}: {interpreted:?}"
            );
        }
        ours.push(format!(
            "{} {} {rpm} rev/min {:.0} mm/min",
            operation.kind,
            tool.name,
            feed.0 * 60.0
        ));
    });
    expect![[r#"
        PLANE_FINISH_MILLING MILL 18MM 720.0000 rev/min 2400 mm/min
        DRILLING SPIRAL_DRILL_20MM 960.0000 rev/min 1800 mm/min
        REAMING REAMER_22MM 1080.0000 rev/min 1800 mm/min
        BOTTOM_AND_SIDE_ROUGH_MILLING MILL 18MM 1200.0000 rev/min 2400 mm/min
        BOTTOM_AND_SIDE_FINISH_MILLING MILL 18MM 1200.0000 rev/min 2400 mm/min"#]]
    .assert_eq(&ours.join("\n"));
    let loaded: Vec<&str> = interpreted.iter().map(|(name, ..)| name.as_str()).collect();
    assert_eq!(loaded, ["MILL 18MM", "SPIRAL_DRILL_20MM", "REAMER_22MM", "MILL 18MM"]);
    // Where the interpreter drilled is where the feature is; how deep it milled is the feature's depth.
    let feature = |id| program.feature(id).expect("it is read");
    let hole = feature(17).values.iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(hole[0], "placement (20 60 0)");
    assert!(canonical.contains("STRAIGHT_FEED(20.0000, 60.0000, -30.0000)") && hole[1] == "depth plane -30 mm");
    assert!(hole[2].starts_with("diameter 22 mm [21.7 to 22.3]"), "{hole:?}");
}

#[test]
fn the_nist_tools_have_the_diameters_of_the_tool_table() {
    let (Some(program), Some(table)) = (sample("iso14649/nist_ex1.stp"), text_sample("iso14649.tool_ex1")) else {
        return;
    };
    let mut seen = 0;
    for tool in program.tools() {
        let line = table
            .lines()
            .find(|line| line.contains(tool.name.as_str()))
            .expect("the table has it");
        let behind = line.rsplit(tool.name.as_str()).next().unwrap_or_default();
        let numbers: Vec<f64> = behind
            .split_whitespace()
            .filter_map(|word| word.trim_matches('\'').parse().ok())
            .collect();
        assert_eq!(tool.diameter.map(|diameter| diameter.0), numbers.get(1).copied(), "{line}");
        seen += 1;
    }
    assert_eq!(seen, 3);
}

#[test]
fn features_without_toolpaths_are_shown_and_refused_when_run() {
    let Some(program) = sample("iso14649/nist_ex1.stp") else {
        return;
    };
    let inspection = inspect(&program);
    assert_eq!(
        (
            inspection.kind,
            inspection.summary.workingsteps_enabled,
            inspection.summary.tools
        ),
        ("iso-14649", 5, 3)
    );
    assert!(
        inspection.problems.iter().any(|problem| problem.code == "feature-based"),
        "{:?}",
        inspection.problems
    );
    let text = steps(program, StreamOptions::default(), 100, |_| Answer::Unknown);
    assert!(text.contains("has no toolpaths; let the CAM system compute them"), "{text}");
}

/// A part at (100, 50) in the set-up with a hole at (20, 60) in the part.
fn explicit(elements: &str, more: &str) -> String {
    format!(
        "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('MACHINING_SCHEMA','MILLING_SCHEMA'));\nENDSEC;\nDATA;\n\
         #1=PROJECT('P',#2,(#4),#90,$,$);\n#2=WORKPLAN('MAIN',({elements}),$,#8,$);\n#4=WORKPIECE('BLOCK',$,0.01,$,$,$,());\n\
         #8=SETUP('VISE',#71,#62,(#9));\n#9=WORKPIECE_SETUP(#4,#74,$,$,());\n#62=PLANE('',#73);\n\
         #71=AXIS2_PLACEMENT_3D('',#72,$,$);\n#72=CARTESIAN_POINT('',(1000.,0.,0.));\n#73=AXIS2_PLACEMENT_3D('',#75,$,$);\n\
         #75=CARTESIAN_POINT('',(0.,0.,30.));\n#74=AXIS2_PLACEMENT_3D('',#76,$,$);\n#76=CARTESIAN_POINT('',(100.,50.,0.));\n\
         #90=PERSON_AND_ADDRESS(#91,$);\n#91=PERSON('1','Miller','Ada',$,$,$);\n\
         #10=MACHINING_WORKINGSTEP('WS',#62,#17,#20,$);\n#17=ROUND_HOLE('H',#4,(#20),#81,#62,$,$,$);\n\
         #81=AXIS2_PLACEMENT_3D('',#82,$,$);\n#82=CARTESIAN_POINT('',(20.,60.,0.));\n\
         #20=DRILLING(#30,$,'DRILL',10.,$,#44,#45,#41,$,5.,$,$,$,$);\n#44=MILLING_CUTTING_TOOL('T3',#47,(),90.,$,$);\n\
         #47=TWIST_DRILL(#48,2,.RIGHT.,.F.,$);\n#48=MILLING_TOOL_DIMENSION(5.,$,$,$,$,$,$);\n\
         #45=MILLING_TECHNOLOGY(0.01,.TCP.,$,-10.,$,.F.,.F.,.F.,$);\n#41=MILLING_MACHINE_FUNCTIONS(.T.,$,$,.F.,$,(),.T.,$,$,());\n\
         #30=TOOLPATH_LIST((#31,#33,#36,#37));\n#31=CUTTER_LOCATION_TRAJECTORY(.T.,.APPROACH.,.RAPID.,$,$,$,#32,$,$);\n\
         #32=POLYLINE('in',(#50,#51));\n#50=CARTESIAN_POINT('',(0.,0.,10.));\n#51=CARTESIAN_POINT('',(0.,0.,1.));\n\
         #33=CUTTER_LOCATION_TRAJECTORY(.T.,.CONTACT.,POSITIVE_RATIO_MEASURE(0.5),$,$,.F.,#34,$,$);\n\
         #34=POLYLINE('cut',(#52,#51));\n#52=CARTESIAN_POINT('',(0.,0.,-5.));\n\
         #36=FEEDSTOP(.T.,.CONTACT.,$,$,$,0.25);\n#37=CONNECT_DIRECT(.T.,.CONNECT.,$,$,$);\n{more}\nENDSEC;\nEND-ISO-10303-21;\n"
    )
}

fn read(text: &str) -> Program {
    Program::read("own.stp", text.as_bytes().to_vec()).expect("a Part 21 file")
}

#[test]
fn explicit_toolpaths_run_in_the_frame_of_their_feature_and_rapid_movements_in_the_set_up() {
    let program = read(&explicit(
        "#10,#11",
        "#11=RAPID_MOVEMENT('home',#62,#60,$);\n#60=TOOLPATH_LIST((#61));\n#61=CUTTER_LOCATION_TRAJECTORY(.T.,.CONNECT.,$,$,$,$,#63,$,$);\n\
         #63=POLYLINE('up',(#64,#65));\n#64=CARTESIAN_POINT('',(120.,110.,-5.));\n#65=CARTESIAN_POINT('',(120.,110.,80.));",
    ));
    expect![[r#"
        iso-14649 MACHINING_SCHEMA mm
        Summary { workingsteps_enabled: 2, workingsteps_disabled: 0, toolpaths: 5, rapids: 3, dwells: 1, tools: 1, nc_functions: 0 }
        #2 workplan 'MAIN' of project 'P'
          #10 workingstep 'WS' Number(3)
            #31 rapid 'in' 9.000 mm, - mm/s, 600.000 rpm cw
            #33 feed 'cut' 6.000 mm, 5.000 mm/s, 600.000 rpm cw
            #36 dwell '' 0.000 mm, - mm/s, 600.000 rpm cw
            #37 rapid '' - mm, - mm/s, 600.000 rpm cw
          #11 workingstep 'home'
            #61 rapid 'up' 85.000 mm, - mm/s, - rpm -
    "#]]
    .assert_eq(&outline(&inspect(&program)));
    assert_eq!(program.projects()[0].values[0].to_string(), "owner Ada Miller");
    let text = steps(program, StreamOptions::default(), 100, |_| Answer::Truth(true));
    expect![[r#"
        1 #1 begin Program 'P'
        2 #2 begin Workplan 'MAIN'
        3 #10 begin Workingstep 'WS'
        4 #20 begin Operation 'DRILL'
        5 #20 tool T3 twist drill Some(5.0)
        6 #20 offset 3 assumed true
        7 #31 frame 'VISE' (1120.0000, 110.0000, 0.0000)
        8 #31 spindle cw 600 rev/min
        9 #31 Coolant(CoolantState { flood: true, mist: false, through: false })
        10 #31 line (-1120.0000, -110.0000, 0.0000) -> (-1120.0000, -110.0000, 10.0000) rapid derived
        11 #31 line (-1120.0000, -110.0000, 10.0000) -> (0.0000, 0.0000, 10.0000) rapid derived
        12 #31 begin Toolpath 'in'
        13 #31 line (0.0000, 0.0000, 10.0000) -> (0.0000, 0.0000, 1.0000) rapid
        14 #31 End(Toolpath)
        15 #33 begin Toolpath 'cut'
        16 #33 line (0.0000, 0.0000, 1.0000) -> (0.0000, 0.0000, -5.0000) 10.000 mm/s x [(0.0, 0.5), (1.0, 0.5)]
        17 #33 End(Toolpath)
        18 #36 begin Toolpath ''
        19 #36 Dwell(Seconds(0.25))
        20 #36 End(Toolpath)
        21 #20 End(Operation)
        22 #10 End(Workingstep)
        23 #11 begin Workingstep 'home'
        24 #11 begin Operation 'home'
        25 #61 frame 'VISE' (1000.0000, 0.0000, 0.0000)
        26 #61 begin Toolpath 'up'
        27 #61 line (120.0000, 110.0000, -5.0000) -> (120.0000, 110.0000, 80.0000) rapid
        28 #61 End(Toolpath)
        29 #11 End(Operation)
        30 #11 End(Workingstep)
        31 #2 End(Workplan)
        32 - Spindle(Stopped)
        33 - Coolant(CoolantState { flood: false, mist: false, through: false })
        34 - End(Program)
        end
        warning: own.stp:25:1: #44: tool T3 is not in the tool table: its length is assumed to be 0; enter the tool with its length
    "#]].assert_eq(&text);
}

#[test]
fn control_structures_ask_for_what_only_the_machine_knows() {
    let program = read(&explicit(
        "#101,#102,#104,#106",
        "#101=ASSIGNMENT('set',#110,#111);\n#110=NC_VARIABLE('LIMIT',1.5);\n#111=NC_CONSTANT('TWO',2.);\n\
         #102=IF_STATEMENT('hot?',#103,#120,#121);\n#103=COMPARISON_GREATER(#112,#110);\n#112=NC_VARIABLE('S1.TEMPERATURE',$);\n\
         #120=DISPLAY_MESSAGE('hot','too hot');\n#121=DISPLAY_MESSAGE('cold','fine');\n\
         #104=WHILE_STATEMENT('count',#105,#130);\n#105=COMPARISON_LESS(#113,#111);\n#113=NC_VARIABLE('N',0.);\n\
         #130=ASSIGNMENT('up',#113,#114);\n#114=NC_CONSTANT('THREE',3.);\n\
         #106=SELECTIVE('one of',(#140,#141));\n#140=PROGRAM_STOP('stop');\n#141=OPTIONAL_STOP('maybe');",
    ));
    let text = steps(program, StreamOptions::default(), 100, |question| match question {
        Question::Condition(_) => Answer::Truth(true),
        _ => Answer::Unknown,
    });
    let mut shown = String::new();
    for line in text.lines().filter(|line| !line.contains("remark")) {
        let _ = writeln!(shown, "{line}");
    }
    expect![[r#"
        1 #1 begin Program 'P'
        2 #2 begin Workplan 'MAIN'
        ask Condition(Binary(Greater, Name("S1.TEMPERATURE"), Number(2.0, None))) -> Truth(true)
        3 #120 Message("too hot")
        4 #140 Stop(Program)
        5 #2 End(Workplan)
        6 - End(Program)
        end
    "#]]
    .assert_eq(&shown);
}

#[test]
fn what_a_function_writes_is_the_machines_until_the_program_assigns_it_again() {
    let program = read(&explicit(
        "#101,#102,#103,#102",
        "#101=EXTENDED_NC_FUNCTION('read','trace:1 get_spindle_speed its_variable=SPEED');\n\
         #102=IF_STATEMENT('fast?',#104,#120,#121);\n#104=COMPARISON_GREATER(#110,#111);\n#110=NC_VARIABLE('SPEED',1.5);\n\
         #111=NC_CONSTANT('TWO',2.);\n#103=ASSIGNMENT('set',#110,#112);\n#112=NC_CONSTANT('ONE',1.);\n\
         #120=DISPLAY_MESSAGE('fast','fast');\n#121=DISPLAY_MESSAGE('slow','slow');",
    ));
    let text = steps(program, StreamOptions::default(), 100, |question| match question {
        Question::Condition(_) => Answer::Truth(true),
        _ => Answer::Unknown,
    });
    let shown: Vec<&str> = text
        .lines()
        .filter(|line| line.contains("ask") || line.contains("Message"))
        .collect();
    expect![[r#"
        ask Condition(Binary(Greater, Name("SPEED"), Number(2.0, None))) -> Truth(true)
        4 #120 Message("fast")
        5 #121 Message("slow")"#]]
    .assert_eq(&shown.join("\n"));
}
