//! Each thing that real files get wrong is named once, with its count, its place and what to do.

mod common;
use common::{holds, one_path, says};
use expect_test::{Expect, expect};
use stepnc::Program;
use stepnc::problems::violations;

const CURVE: &str =
    "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,0.));\n#202=CARTESIAN_POINT('',(9.,0.,0.));\n";

/// The violations of a sound program with some text replaced and added, one line each.
#[track_caller]
fn check(replace: &[(&str, &str)], added: &str, expected: Expect) {
    let sound = one_path(CURVE, 7);
    let mut text = String::from_utf8(sound.file().bytes().to_vec()).expect("it is ASCII");
    for (from, to) in replace {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text = text.replace("4),$)", "4),#399)").replace("2),$)", "2),#399)");
    let end = text.rfind("ENDSEC;").expect("it has an end");
    text.insert_str(end, &format!("#399=ACTION_RESOURCE_TYPE('milling cutting tool');\n{added}"));
    let program = Program::read("own.stpnc", text.into_bytes()).expect("a Part 21 file");
    let lines: Vec<String> = violations(&program)
        .iter()
        .filter(|found| found.code != "operation-incomplete")
        .map(ToString::to_string)
        .collect();
    expected.assert_eq(&lines.join("\n"));
}

#[test]
fn a_sound_file_has_none() {
    check(&[], "", expect![""]);
}

#[test]
fn attributes_are_missing() {
    check(
        &[
            ("CARTESIAN_POINT(''", "CARTESIAN_POINT($"),
            (
                "('path','cutter location trajectory','','')",
                "('path','cutter location trajectory',$,$)",
            ),
        ],
        "",
        expect![
            "warning: own.stpnc:37:1: #110: MACHINING_TOOLPATH has $ where the standard asks for a value (3 times); write '' or the value"
        ],
    );
}

#[test]
fn technologies_are_not_whole() {
    check(
        &[("ACTION_PROPERTY('feedrate'", "ACTION_PROPERTY('speed'")],
        "",
        expect!["warning: own.stpnc:42:1: #120: a milling technology has no feedrate; give it both, on rapid paths too"],
    );
    check(
        &[("NUMERIC_MEASURE(600.)", "NUMERIC_MEASURE(0.)")],
        "",
        expect!["warning: own.stpnc:42:1: #120: a technology has a feed of 0; give the feed of the cut beside it"],
    );
}

#[test]
fn functions_are_not_those_of_milling() {
    let functions = format!(
        "#300=MACHINING_FUNCTIONS('','milling','','');\n{}{}#309=MACHINING_FUNCTIONS('','milling','','');\n",
        says(301, 300, "coolant", "coolant on"),
        says(305, 300, "coolant type", "flood")
    );
    check(
        &[],
        &functions,
        expect![[r#"
            warning: own.stpnc:58:1: #300: 'coolant type' belongs to turning and stands on milling functions; use 'mist' and 'through spindle coolant'
            warning: own.stpnc:67:1: #309: machine functions do not say whether coolant is on; give them the property 'coolant'"#]],
    );
}

#[test]
fn a_dwell_stands_in_a_plain_representation() {
    let dwell = format!(
        "#300=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#301,2.);\n#301=MACHINING_TOOLPATH('wait','feedstop','','');\n{}\
         #305=(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(TIME_MEASURE(1.),#2) REPRESENTATION_ITEM('dwell') TIME_MEASURE_WITH_UNIT());\n\
         #306=MACHINING_TOOLPATH('odd','cutter path','','');\n",
        holds(302, 301, "dwell", 305, 8)
    );
    check(
        &[],
        &dwell,
        expect![[r#"
            warning: own.stpnc:59:1: #301: a dwell stands in a plain REPRESENTATION; use MACHINING_DWELL_TIME_REPRESENTATION named 'dwell time'
            warning: own.stpnc:64:1: #306: 'cutter path' is no kind of toolpath; use 'cutter location trajectory'"#]],
    );
}

#[test]
fn the_header_says_another_edition() {
    check(
        &[
            ("MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA", "INTEGRATED_CNC_SCHEMA"),
            ("(#201,#202)", "(#201,#300,#202)"),
        ],
        "#300=VIA_ARC_POINT('',(4.,4.,0.));\n",
        expect![
            "warning: own.stpnc:58:1: #300: VIA_ARC_POINT belongs to edition 2, the header says INTEGRATED_CNC_SCHEMA (edition 1); write MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA into FILE_SCHEMA"
        ],
    );
}

#[test]
fn parts_of_complex_instances_are_out_of_order() {
    check(
        &[("(NAMED_UNIT(#30) RATIO_UNIT())", "(RATIO_UNIT() NAMED_UNIT(#30))")],
        "",
        expect!["warning: own.stpnc:27:1: #11: the parts of a complex instance are not in alphabetical order; sort them by name"],
    );
}

#[test]
fn the_tree_has_too_much_or_too_little() {
    let tree = "#300=MACHINING_WORKPLAN('other','','','');\n#301=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#300,#310,1.);\n\
         #302=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#310,2.);\n#310=MACHINING_WORKPLAN('shared','','','');\n\
         #311=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#310,#320,1.);\n#320=MACHINING_PROCESS_EXECUTABLE('one of one','selective','','');\n\
         #321=MACHINING_PROCESS_BRANCH_RELATIONSHIP('','',#320,#330);\n#330=MACHINING_NC_FUNCTION('odd','open the door','','');\n\
         #303=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#340,3.);\n#340=MACHINING_NC_FUNCTION('say','display message','','');\n\
         #304=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#350,4.);\n#350=MACHINING_PROCESS_EXECUTABLE('perhaps','if statement','','');\n";
    check(
        &[],
        tree,
        expect![[r#"
            warning: own.stpnc:58:1: #300: the file has 2 plans; the first is run; choose one, or keep one plan in a file
            warning: own.stpnc:63:1: #320: selective 'one of one' has 1 parts, at least 2 are due (2 times); put its part into the workplan itself
            warning: own.stpnc:65:1: #330: 'open the door' is no kind of NC function (2 times); use 'extended function' and its text
            warning: own.stpnc:67:1: #340: the message 'say' has no text; give it the property 'message text'
            warning: own.stpnc:69:1: #350: if statement 'perhaps' has no true branch; give it one, or turn the condition round
            remark: own.stpnc:61:1: #310: workplan 'shared' is executed at 2 places; a change of it changes all of them"#]],
    );
}

#[test]
fn a_feature_has_no_toolpaths_and_an_operation_no_tool() {
    check(
        &[("#105=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#110,1.);\n", "")],
        "",
        expect![
            "warning: own.stpnc:33:1: #101: workingstep 'step' is described by its feature only and has no toolpaths; let the CAM system compute its toolpaths; none are made up"
        ],
    );
    check(
        &[("'endmill',(#102)", "'endmill',(#104)")],
        "",
        expect![
            "warning: own.stpnc:35:1: #102: operation 'op' has 0 tools, one is due; name it among the users of one MACHINING_TOOL"
        ],
    );
}

#[test]
fn a_run_has_no_start() {
    check(
        &[],
        &says(300, 101, "twin source", "agent"),
        expect![
            "warning: own.stpnc:33:1: #101: 'step' has data of a run and no 'twin start'; date it with the role 'twin start'"
        ],
    );
}

#[test]
fn entities_have_short_names() {
    check(
        &[],
        "#300=CRTPNT('',(0.,0.,0.));\n",
        expect!["warning: own.stpnc:58:1: #300: CRTPNT is the short name of an entity; export with the long names of entities"],
    );
}

#[test]
fn broadcasts_of_the_next_edition_are_named_and_not_passed_over_in_silence() {
    let mut text = String::from_utf8(one_path(CURVE, 7).file().bytes().to_vec()).expect("it is ASCII");
    let end = text.rfind("ENDSEC;").expect("it has an end");
    text.insert_str(
        end,
        "#400=MACHINING_BROADCAST_STRATEGY('loads','time','','');\n#401=MACHINING_BROADCAST_STRATEGY('tool','count','','');\n",
    );
    let program = Program::read("own.stpnc", text.into_bytes()).expect("a Part 21 file");
    let said: Vec<String> = program.diagnostics().iter().map(ToString::to_string).collect();
    let named = said
        .iter()
        .filter(|line| line.contains("a broadcast is of the draft of edition 4") && line.contains("(2 times)"));
    assert_eq!(named.count(), 1, "{said:?}");
}
