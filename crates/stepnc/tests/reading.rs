//! What is read of files as other writers make them: spelled-out supertypes, named data, control structures, turning, and traps.

mod common;
use common::{file_of, holds, one_path, program_of, says, steps};
use expect_test::expect;
use plan::tables::{Missing, ToolEntry};
use plan::{Answer, Question, Tables};
use stepnc::{ExecutableKind, Program, StreamOptions};
use units::{Rpm, ToolNumber};

const LINE: &str =
    "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,5.));\n#202=CARTESIAN_POINT('',(10.,0.,5.));\n";

fn options() -> StreamOptions {
    let mut tables = Tables::empty();
    tables.tools.insert(ToolNumber(1), ToolEntry::default());
    StreamOptions {
        tables,
        ..StreamOptions::default()
    }
}

/// The text of a program with something in it written otherwise.
fn rewritten(program: &Program, changes: &[(&str, &str)]) -> Program {
    let mut text = String::from_utf8(program.file().bytes().to_vec()).expect("ASCII");
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    Program::read("own.stpnc", text.into_bytes()).expect("a Part 21 file")
}

#[test]
fn spelled_out_supertypes_are_the_same_program() {
    let plain = one_path(LINE, 7);
    let spelled = rewritten(
        &plain,
        &[
            (
                "#100=MACHINING_WORKPLAN('main','','','');",
                "#100=(ACTION_METHOD('main','','','') MACHINING_PROCESS_EXECUTABLE() MACHINING_WORKPLAN());",
            ),
            (
                "#101=MACHINING_WORKINGSTEP('step','machining','','');",
                "#101=(MACHINING_WORKINGSTEP() ACTION_METHOD('step','machining','','') MACHINING_PROCESS_EXECUTABLE());",
            ),
            (
                "#102=FREEFORM_MILLING_OPERATION('op','finishing','','');",
                "#102=(ACTION_METHOD('op','finishing','','') FREEFORM_MILLING_OPERATION() MACHINING_OPERATION() MILLING_TYPE_OPERATION());",
            ),
            (
                "#110=MACHINING_TOOLPATH('path','cutter location trajectory','','');",
                "#110=(ACTION_METHOD('path','cutter location trajectory','','') MACHINING_TOOLPATH());",
            ),
            (
                "#130=MACHINING_TOOL('1','endmill',(#102),$);",
                "#130=(ACTION_RESOURCE('1','endmill',(#102),$) MACHINING_TOOL());",
            ),
        ],
    );
    assert_eq!(spelled.operation(102).expect("read").kind, "FREEFORM_MILLING_OPERATION");
    let run = |program| steps(program, options(), 100, |_| Answer::Truth(true));
    assert_eq!(run(plain), run(spelled));
}

#[test]
fn a_tool_has_all_that_the_file_says_of_it() {
    let program = one_path(
        &format!(
            "{LINE}#400=RESOURCE_PROPERTY('tool body','',#130);\n#401=RESOURCE_PROPERTY_REPRESENTATION('','',#400,#402);\n\
             #402=MACHINING_TOOL_BODY_REPRESENTATION('endmill',(#403,#404,#405,#406),#8);\n\
             #403=(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE(0.5),#9) QUALIFIED_REPRESENTATION_ITEM((#410,#411)) REPRESENTATION_ITEM('effective cutting diameter'));\n\
             #410=STANDARD_UNCERTAINTY('upper limit','',0.001);\n#411=STANDARD_UNCERTAINTY('lower limit','',0.002);\n\
             #404=DESCRIPTIVE_REPRESENTATION_ITEM('hand of cut','right');\n\
             #405=(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(COUNT_MEASURE(4.),#412) REPRESENTATION_ITEM('number of effective teeth'));\n\
             #412=CONTEXT_DEPENDENT_UNIT(#30,'tooth');\n\
             #406=(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(118.),#4) PLANE_ANGLE_MEASURE_WITH_UNIT() REPRESENTATION_ITEM('point angle'));\n\
             #420=MACHINING_TOOL_USAGE('place','','','');\n#421=REQUIREMENT_FOR_ACTION_RESOURCE('','',$,(#420),(#130));\n{}\
             #430=ACTION_RESOURCE_RELATIONSHIP('','',#130,#431,$);\n#431=MACHINING_CUTTING_COMPONENT('edge','',(),$);\n\
             #432=RESOURCE_PROPERTY('functional length','',#431);\n#433=RESOURCE_PROPERTY_REPRESENTATION('','',#432,#434);\n#434=REPRESENTATION('',(#435),#8);\n\
             #435=(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE(42.),#1) REPRESENTATION_ITEM('functional length'));\n",
            says(424, 420, "tool position", "17"),
        ),
        7,
    );
    let program = rewritten(&program, &[("MACHINING_TOOL('1'", "MACHINING_TOOL('12.7 mm end mill'")]);
    let tool = &program.tools()[0];
    let said: Vec<String> = tool.values.iter().map(ToString::to_string).collect();
    expect![[r#"
        effective cutting diameter 12.7 mm [12.6492 to 12.7254]
        hand of cut right
        number of effective teeth 4
        point angle 118 deg
        cutting edge 1: functional length 42 mm
        usage: tool position 17"#]]
    .assert_eq(&said.join("\n"));
    assert_eq!(
        (tool.number, tool.teeth, tool.diameter.map(|d| d.0)),
        (Some(ToolNumber(17)), Some(4.0), Some(12.7))
    );
}

#[test]
fn features_operations_fixtures_and_people_are_named_data() {
    let program = one_path(
        &format!(
            "{LINE}#400=MACHINING_FEATURE_RELATIONSHIP('','machining',#101,#401);\n#401=MACHINING_FEATURE_PROCESS('','machining','','');\n\
             #402=PROPERTY_PROCESS('machining','machining',#401,'');\n#403=PROCESS_PROPERTY_ASSOCIATION('','machining',#402,#404);\n\
             #404=(CHARACTERIZED_OBJECT('HOLE 1','') FEATURE_DEFINITION() INSTANCED_FEATURE() ROUND_HOLE() SHAPE_ASPECT('HOLE 1','',#20,.F.));\n\
             #405=SHAPE_DEFINING_RELATIONSHIP('diameter','profile usage',#406,#404);\n#406=CIRCULAR_CLOSED_PROFILE('','',#20,.F.);\n\
             #407=PROPERTY_DEFINITION('','',#406);\n#408=SHAPE_DEFINITION_REPRESENTATION(#407,#409);\n\
             #409=SHAPE_REPRESENTATION_WITH_PARAMETERS('',(#410),#7);\n\
             #410=(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE(8.),#1) REPRESENTATION_ITEM('diameter'));\n\
             {}#423=(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE(2.),#9) REPRESENTATION_ITEM('axial cutting depth'));\n\
             #430=PERSON('17','Miller','Ada',$,$,$);\n#431=ORGANIZATION($,'Works','');\n#432=PERSON_AND_ORGANIZATION(#430,#431);\n\
             #433=PERSON_AND_ORGANIZATION_ROLE('operator');\n#434=APPLIED_PERSON_AND_ORGANIZATION_ASSIGNMENT(#432,#433,(#101,#100));\n\
             #435=APPROVAL_STATUS('approved');\n#436=APPROVAL(#435,'first piece');\n#437=APPLIED_APPROVAL_ASSIGNMENT(#436,(#101));\n\
             #440=MACHINING_USAGE_RELATIONSHIP('','',#101,#441);\n#441=MACHINING_MACHINE_USAGE('M7','five-axis mill','','');\n\
             #450=PRODUCT_DEFINITION_PROCESS('setup','',#100,'');\n#451=PROCESS_PRODUCT_ASSOCIATION('','',#452,#450);\n#452=PRODUCT_DEFINITION('','',#453,#20);\n\
             #453=PRODUCT_DEFINITION_FORMATION('1','',#454);\n#454=MACHINING_SETUP('OP10','',$,(#21));\n\
             #455=PROCESS_PRODUCT_ASSOCIATION('','',#452,#456);\n#456=PRODUCT_DEFINITION_PROCESS('fixture usage','',#457,'');\n\
             #457=MACHINING_FIXTURE_USAGE('vise 3','','','');\n{}#463=AXIS2_PLACEMENT_3D('',#464,$,$);\n#464=CARTESIAN_POINT('',(1.,2.,3.));\n",
            holds(420, 102, "axial cutting depth", 423, 8),
            holds(460, 457, "mount reference", 463, 7),
        ),
        7,
    );
    let step = program.executable(101).expect("read");
    let feature = program.feature(step.features[0]).expect("read");
    assert_eq!(
        (feature.name.as_str(), feature.kinds.as_slice()),
        ("HOLE 1", &["ROUND_HOLE".to_string()][..])
    );
    let words = |values: &[stepnc::NamedValue]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    assert_eq!(words(&feature.values), "diameter: diameter 8 mm");
    assert_eq!(
        words(&program.operation(102).expect("read").values),
        "axial cutting depth 50.8 mm"
    );
    assert_eq!(
        words(&step.values),
        "machine M7, five-axis mill; operator Ada Miller, Works; approval approved, first piece"
    );
    let setup = program.executable(100).expect("read").setup.as_ref().expect("it begins here");
    let fixture = setup.fixture.as_ref().expect("it has one");
    assert_eq!(
        (fixture.name.as_str(), words(&fixture.values).as_str()),
        ("vise 3", "mount reference (1 2 3)")
    );
}

/// A workplan #100 whose children are tied by `SEQUENCE` in the order given, and what they are.
fn plan_of(children: &[u64], data: &str) -> Program {
    let tied: String = children
        .iter()
        .enumerate()
        .map(|(n, child)| {
            format!(
                "#{}=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#{child},{n}.);\n",
                900 + n
            )
        })
        .collect();
    program_of(&format!("#100=MACHINING_WORKPLAN('main','','','');\n{tied}{data}"))
}

fn message(id: u64, text: &str) -> String {
    format!(
        "#{id}=MACHINING_NC_FUNCTION('{text}','display message','','');\n{}",
        says(id + 1, id, "message text", text)
    )
}

#[test]
fn parallel_and_non_sequential_run_in_the_order_of_the_file_and_the_order_is_named() {
    let tie = |id: u64, keyword: &str, parent: u64, child: u64| {
        format!("#{id}=MACHINING_PROCESS_{keyword}_RELATIONSHIP('','',#{parent},#{child});\n")
    };
    let program = plan_of(
        &[110, 120],
        &format!(
            "#110=MACHINING_PROCESS_EXECUTABLE('both','parallel','','');\n#120=MACHINING_PROCESS_EXECUTABLE('any','non-sequential','','');\n{}{}{}{}{}{}{}{}",
            tie(130, "CONCURRENT", 110, 200),
            tie(131, "CONCURRENT", 110, 210),
            tie(132, "BODY", 120, 220),
            tie(133, "BODY", 120, 200),
            message(200, "one"),
            message(210, "two"),
            message(220, "three"),
            says(300, 220, "enabled", "disabled"),
        ),
    );
    let text = steps(program, options(), 100, |_| Answer::Truth(true));
    expect![[r#"
        1 - begin Program 'main'
        2 #100 begin Workplan 'main'
        3 #200 Message("one")
        4 #210 Message("two")
        5 #200 Message("one")
        6 #100 End(Workplan)
        7 - End(Program)
        end
        remark: own.stpnc:31:1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
        remark: own.stpnc:34:1: #110: 'both' asks for several things at the same time: this machine has one channel, and does 'one', then 'two'
        remark: own.stpnc:35:1: #120: 'any' leaves the order open: it is 'one'
    "#]].assert_eq(&text);
}

#[test]
fn an_assignment_asks_the_machine_and_a_while_counts_by_its_variable() {
    let item = |id: u64, inner: u64, name: &str| format!("#{id}=EXPRESSION_ITEM_REPRESENTATION_ITEM('{name}',#{inner});\n");
    let program = plan_of(
        &[110, 120],
        &format!(
            "#110=MACHINING_PROCESS_EXECUTABLE('start','assignment','','');\n{}{}\
             #120=MACHINING_PROCESS_EXECUTABLE('loop','while statement','','');\n{}#124=MACHINING_PROCESS_BODY_RELATIONSHIP('','',#120,#130);\n\
             #130=MACHINING_WORKPLAN('turn','','','');\n#131=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#130,#140,1.);\n\
             #132=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#130,#200,2.);\n#140=MACHINING_PROCESS_EXECUTABLE('next','assignment','','');\n{}{}{}\
             #150=REAL_NUMERIC_VARIABLE();\n#151=REAL_NUMERIC_VARIABLE();\n#152=REAL_LITERAL(1.);\n#153=REAL_LITERAL(3.);\n\
             #154=PLUS_EXPRESSION((#150,#152));\n#155=COMPARISON_LESS((#150,#153));\n{}{}{}{}{}",
            holds(111, 110, "lvalue", 160, 8),
            holds(114, 110, "rvalue", 161, 8),
            holds(121, 120, "condition", 162, 8),
            holds(141, 140, "lvalue", 160, 8),
            holds(144, 140, "rvalue", 163, 8),
            message(200, "turn"),
            item(160, 150, "N"),
            item(161, 151, "COUNTER"),
            item(162, 155, ""),
            item(163, 154, ""),
            "",
        ),
    );
    let text = steps(program, options(), 100, |question| match question {
        Question::Number(name) if name == "COUNTER" => Answer::Number(Some(1.0)),
        _ => Answer::Unknown,
    });
    expect![[r#"
        1 - begin Program 'main'
        2 #100 begin Workplan 'main'
        ask Number("COUNTER") -> Number(Some(1.0))
        3 #130 begin Workplan 'turn'
        4 #200 Message("turn")
        5 #130 End(Workplan)
        6 #130 begin Workplan 'turn'
        7 #200 Message("turn")
        8 #130 End(Workplan)
        9 #100 End(Workplan)
        10 - End(Program)
        end
        remark: own.stpnc:31:1: #100: the file has no machining project of a plan: workplans that nobody executes stand for it
    "#]]
    .assert_eq(&text);
}

#[test]
fn turning_takes_feed_per_revolution_and_surface_speed_with_the_machine_s_limit() {
    let program = rewritten(
        &one_path(
            &format!("{LINE}#190=DERIVED_UNIT_ELEMENT(#36,-1.);\n#191=DERIVED_UNIT((#34,#190));\n"),
            7,
        ),
        &[
            ("FREEFORM_MILLING_OPERATION", "CONTOURING_TURNING_OPERATION"),
            (
                "'feed speed',NUMERIC_MEASURE(600.),#5",
                "'feed per revolution',NUMERIC_MEASURE(0.2),#191",
            ),
            (
                "'rotational speed',NUMERIC_MEASURE(-1500.),#6",
                "'surface speed',NUMERIC_MEASURE(-120000.),#5",
            ),
        ],
    );
    assert!(program.turns());
    let inspection = stepnc::inspect::inspect(&program);
    let path = &inspection.tree[0].children[0].toolpaths[0];
    assert_eq!(
        (path.feed_mm_rev, path.surface_speed_mm_s, path.spindle_rpm),
        (Some(0.2), Some(2000.0), None)
    );
    let mut options = options();
    options.spindle_limit = Rpm(2500.0);
    let text = steps(program, options, 100, |_| Answer::Truth(true));
    assert!(
        text.contains("Surface { speed: MmPerSec(2000.0), limit: Rpm(2500.0) }"),
        "{text}"
    );
    assert!(text.contains("PerRevolution(Millimetres(0.2))"), "{text}");
    assert!(
        text.contains("a surface speed has no maximum rotational speed: 2500 rev/min is assumed"),
        "{text}"
    );
}

#[test]
fn a_tool_without_a_number_gets_one_where_something_may_be_assumed() {
    let program = || {
        rewritten(
            &one_path(LINE, 7),
            &[("MACHINING_TOOL('1'", "MACHINING_TOOL('fly cutter 50'")],
        )
    };
    let text = steps(program(), StreamOptions::default(), 100, |_| Answer::Truth(true));
    assert!(text.contains("tool T1 endmill"), "{text}");
    assert!(
        text.contains("tool 'fly cutter 50' (endmill) has no number: T1 is assumed"),
        "{text}"
    );
    let mut strict = StreamOptions::default();
    strict.tables.missing = Missing::Fail;
    assert!(steps(program(), strict, 100, |_| Answer::Truth(true)).contains("has no number; give the number"));
}

#[test]
fn a_connection_without_a_curve_is_the_link_to_the_next_path() {
    let program = one_path(
        &format!(
            "{LINE}#140=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#141,2.);\n#141=MACHINING_TOOLPATH('over','connect direct','','');\n\
             #142=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#143,3.);\n#143=MACHINING_TOOLPATH('next','cutter location trajectory','','');\n{}\
             #220=POLYLINE('',(#221,#222));\n#221=CARTESIAN_POINT('',(40.,0.,5.));\n#222=CARTESIAN_POINT('',(50.,0.,5.));\n",
            holds(144, 143, "basic curve", 220, 7)
        ),
        7,
    );
    assert_eq!(stepnc::inspect::inspect(&program).summary.rapids, 1);
    let text = steps(program, options(), 100, |_| Answer::Truth(true));
    assert!(
        text.contains("line (10.0000, 0.0000, 5.0000) -> (40.0000, 0.0000, 5.0000) rapid derived"),
        "{text}"
    );
    assert!(text.contains("\nend\n"), "{text}");
}

#[test]
fn a_connection_over_the_security_plane_goes_that_high() {
    let program = one_path(
        &format!(
            "{LINE}#140=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#141,2.);\n#141=MACHINING_TOOLPATH('over','connect security plane','','');\n\
             #142=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#102,#143,3.);\n#143=MACHINING_TOOLPATH('next','cutter location trajectory','','');\n{}{}\
             #220=POLYLINE('',(#221,#222));\n#221=CARTESIAN_POINT('',(40.,0.,5.));\n#222=CARTESIAN_POINT('',(50.,0.,5.));\n\
             #300=PLANE('',#301);\n#301=AXIS2_PLACEMENT_3D('',#302,$,$);\n#302=CARTESIAN_POINT('',(0.,0.,33.));\n",
            holds(144, 143, "basic curve", 220, 7),
            holds(150, 101, "security plane", 300, 7)
        ),
        7,
    );
    let text = steps(program, options(), 100, |_| Answer::Truth(true));
    assert!(
        text.contains("line (10.0000, 0.0000, 33.0000) -> (40.0000, 0.0000, 33.0000) rapid derived"),
        "{text}"
    );
}

#[test]
fn a_workingstep_without_toolpaths_is_named_when_the_file_is_read() {
    let program = rewritten(
        &one_path(LINE, 7),
        &[("#105=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP", "#105=SOMETHING_ELSE")],
    );
    let found: Vec<String> = program.diagnostics().iter().map(ToString::to_string).collect();
    assert!(
        found
            .iter()
            .any(|line| line.contains("1 of 1 workingsteps are described by features")),
        "{found:?}"
    );
    let home = rewritten(
        &one_path(LINE, 7),
        &[
            ("#105=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP", "#105=SOMETHING_ELSE"),
            (
                "FREEFORM_MILLING_OPERATION('op','finishing'",
                "MACHINING_RAPID_MOVEMENT('op','return home'",
            ),
        ],
    );
    let text = steps(home, options(), 100, |_| Answer::Truth(true));
    assert!(text.contains("\nend\n") && text.contains("says not where to"), "{text}");
}

#[test]
fn instructions_among_the_steps_are_passed_over() {
    let program = plan_of(
        &[110, 200, 120],
        &format!(
            "#110=MACHINING_PROCESS_EXECUTABLE('clamp it','setup instructions','','');\n#120=MACHINING_FEATURE_PROCESS('','machining','','');\n{}",
            message(200, "go")
        ),
    );
    assert!(
        !stepnc::inspect::inspect(&program)
            .problems
            .iter()
            .any(|problem| problem.code == "not-executable")
    );
    let text = steps(program, options(), 100, |_| Answer::Truth(true));
    assert!(text.contains("Message(\"go\")") && text.contains("\nend\n"), "{text}");
}

#[test]
fn a_speed_ratio_may_have_no_unit_and_a_curve_a_placement_beside_it() {
    let program = one_path(
        &format!(
            "{LINE}{}#303=MEASURE_REPRESENTATION_ITEM('',RATIO_MEASURE(0.25),$);\n#310=AXIS2_PLACEMENT_3D('',#201,$,$);\n",
            holds(300, 110, "speed profile", 303, 8)
        ),
        7,
    );
    let program = rewritten(
        &program,
        &[("REPRESENTATION('',(#200),#7)", "REPRESENTATION('',(#310,#200),#7)")],
    );
    let text = steps(program, options(), 100, |_| Answer::Truth(true));
    assert!(text.contains("10.000 mm/s x [(0.0, 0.25), (1.0, 0.25)]"), "{text}");
}

#[test]
fn short_entity_names_are_told_apart_from_a_file_without_a_program() {
    let program = program_of("#100=CRTPNT('',(0.,0.,0.));");
    assert_eq!(
        program.diagnostics().iter().map(|d| d.code).collect::<Vec<_>>(),
        ["short-names"]
    );
}

#[test]
fn data_that_refers_to_itself_or_doubles_at_each_step_is_refused_in_no_time() {
    // Each operand twice: 2^60 parts.
    let mut doubling = String::from(
        "#100=MACHINING_WORKPLAN('main','','','');\n#101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#102,1.);\n#102=MACHINING_PROCESS_EXECUTABLE('if','if statement','','');\n",
    );
    doubling += &holds(103, 102, "condition", 300, 8);
    doubling += "#300=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#301);\n";
    for n in 301..360 {
        doubling += &format!("#{n}=AND_EXPRESSION((#{m},#{m}));\n", m = n + 1);
    }
    doubling += "#360=BOOLEAN_LITERAL(.T.);\n";
    let program = program_of(&doubling);
    let ExecutableKind::If { condition, .. } = &program.executable(102).expect("read").kind else {
        panic!("it is an if statement")
    };
    assert!(
        condition.as_ref().is_err_and(|why| why.contains("too many parts")),
        "{condition:?}"
    );
    // Units of units of units, and one of itself.
    let mut units = String::new();
    for n in 400..460 {
        units += &format!(
            "#{n}=DERIVED_UNIT((#{e},#{e},#{e}));\n#{e}=DERIVED_UNIT_ELEMENT(#{m},1.);\n",
            e = n + 100,
            m = n + 1
        );
    }
    units += "#460=CONVERSION_BASED_UNIT('x',#461);\n#461=LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.),#460);\n";
    let text = file_of(&units).replace(
        "GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#4))",
        "GLOBAL_UNIT_ASSIGNED_CONTEXT((#400,#460))",
    );
    let program = Program::read("units.stpnc", text.into_bytes()).expect("a Part 21 file");
    assert!(!stepnc::inspect::inspect(&program).problems.is_empty());
}
