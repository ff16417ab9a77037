//! Typed conditions of functions beside their lines, read and written; assignments to what is the machine's.

mod common;

use common::{holds, one_path, program_of, says, steps};
use plan::expression::Operator;
use plan::{Answer, Expression, Next, ProgramStream, RawNcFunction, StepKind, Tables};
use std::sync::Arc;
use stepnc::write::{WriteOptions, convert};
use stepnc::{Program, StepNcStream, StreamOptions};
use units::Timestamp;

const LINE: &str = "trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_actions=get_time";

/// A function with a typed condition: `trace:ws_time > TIME LIMIT and not hot`, in instances from #400 on.
fn watched(condition: &str) -> String {
    format!(
        "#100=MACHINING_WORKPLAN('main','','','');\n#101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#110,1.);\n\
         #110=MACHINING_NC_FUNCTION('watch','extended function','','');\n{}{}{condition}",
        says(111, 110, "description", LINE),
        holds(120, 110, "condition", 400, 8),
    )
}

const TYPED: &str = "#400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=AND_EXPRESSION((#402,#406));\n\
    #402=COMPARISON_GREATER((#403,#404));\n#403=REAL_NUMERIC_VARIABLE();\n#404=REAL_NUMERIC_VARIABLE();\n\
    #405=EXPRESSION_ITEM_REPRESENTATION_ITEM('trace:ws_time',#403);\n#406=NOT_EXPRESSION(#407);\n#407=BOOLEAN_VARIABLE();\n\
    #408=EXPRESSION_ITEM_REPRESENTATION_ITEM('trace:alarm[3]',#407);\n#409=EXPRESSION_ITEM_REPRESENTATION_ITEM('TIME LIMIT',#404);\n\
    #410=REPRESENTATION_ITEM_RELATIONSHIP('initial value','',#409,#411);\n#411=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#412);\n\
    #412=REAL_LITERAL(5.);\n";

fn functions(program: Program) -> Vec<RawNcFunction> {
    let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
    let mut found = Vec::new();
    loop {
        match stream.next(None) {
            Next::Step(step) => found.extend(match step.kind {
                StepKind::NcFunction(function) => Some(function),
                _ => None,
            }),
            Next::End => return found,
            other => panic!("{other:?}"),
        }
    }
}

fn name(text: &str) -> Box<Expression> {
    Box::new(Expression::Name(text.into()))
}

fn binary(operator: Operator, left: Box<Expression>, right: Box<Expression>) -> Box<Expression> {
    Box::new(Expression::Binary(operator, left, right))
}

#[test]
fn a_function_brings_its_typed_condition_and_the_values_of_its_variables() {
    let found = functions(program_of(&watched(TYPED)));
    let expected = binary(
        Operator::And,
        binary(Operator::Greater, name("trace:ws_time"), name("TIME LIMIT")),
        Box::new(Expression::Not(name("trace:alarm[3]"))),
    );
    assert_eq!(found[0].condition, Some(Ok(*expected)));
    // The line does not name the variable; the typed condition does.
    assert_eq!(found[0].properties.get("variable TIME LIMIT").map(String::as_str), Some("5"));
    assert!(!found[0].properties.contains_key("condition"));
}

#[test]
fn a_typed_condition_that_cannot_be_read_says_why_and_one_that_is_not_there_says_nothing() {
    for (item, why) in [
        (
            "#400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=SIN_FUNCTION(#402);\n#402=REAL_LITERAL(1.);\n",
            "SIN_FUNCTION #401",
        ),
        (
            "#400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=REAL_NUMERIC_VARIABLE();\n#402=COMPARISON_LESS((#403));\n",
            "",
        ),
        (
            "#400=DESCRIPTIVE_REPRESENTATION_ITEM('','ws_time > 3');\n",
            "DESCRIPTIVE_REPRESENTATION_ITEM #400",
        ),
        // It contains itself.
        (
            "#400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=NOT_EXPRESSION(#401);\n",
            "contains itself",
        ),
    ] {
        let found = functions(program_of(&watched(item)));
        match &found[0].condition {
            Some(Err(said)) => assert!(said.contains(why), "{said}"),
            // A nameless variable gets the name that is empty, or none.
            Some(Ok(Expression::Name(name))) => panic!("{item}: a name '{name}'"),
            other => panic!("{item}: {other:?}"),
        }
    }
    let text = watched(TYPED).replace("'condition'", "'something else'");
    assert_eq!(functions(program_of(&text))[0].condition, None);
}

fn written(program: Program) -> Vec<u8> {
    let mut stream = StepNcStream::new(Arc::new(program), StreamOptions::default());
    let options = WriteOptions {
        name: "part".into(),
        made_from: "own.stpnc".into(),
        written: Timestamp(0),
        author: "test".into(),
        writer: "test".into(),
        inches: false,
        turning: false,
        tables: Tables::empty(),
        functions: stepnc::FunctionForm::Mapping,
    };
    convert(&mut stream, &options, &mut |_| Answer::Unknown)
        .expect("it can be written")
        .bytes
}

/// Every operator, a number, a truth, both signs.
const EVERY: &str = "#400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=OR_EXPRESSION((#402,#403,#404,#405));\n\
    #402=XOR_EXPRESSION((#406,#407));\n#403=NOT_EXPRESSION(#408);\n#404=AND_EXPRESSION((#409,#410));\n#405=BOOLEAN_LITERAL(.F.);\n\
    #406=COMPARISON_EQUAL((#420,#430));\n#407=COMPARISON_NOT_EQUAL((#421,#420));\n#408=COMPARISON_LESS((#422,#431));\n\
    #409=COMPARISON_LESS_EQUAL((#423,#420));\n#410=COMPARISON_GREATER_EQUAL((#424,#425));\n#420=REAL_NUMERIC_VARIABLE();\n\
    #421=PLUS_EXPRESSION((#420,#430));\n#422=MINUS_EXPRESSION((#420,#431));\n#423=MULT_EXPRESSION((#430,#420));\n\
    #424=SLASH_EXPRESSION((#420,#431));\n#425=MINUS_FUNCTION(#420);\n#430=REAL_LITERAL(1.5E-3);\n#431=REAL_LITERAL(-80.);\n\
    #440=EXPRESSION_ITEM_REPRESENTATION_ITEM('sensor:X.LOAD',#420);\n";

#[test]
fn what_is_written_is_read_as_the_same_condition() {
    for text in [TYPED, EVERY] {
        let first = functions(program_of(&watched(text)));
        let bytes = written(program_of(&watched(text)));
        let program = Program::read("part.stpnc", bytes).expect("a Part 21 file");
        assert_eq!(program.diagnostics(), []);
        let second = functions(program);
        assert!(matches!(first[0].condition, Some(Ok(_))), "{:?}", first[0].condition);
        assert_eq!((&second[0].text, &second[0].condition), (&first[0].text, &first[0].condition));
    }
}

#[test]
fn an_assignment_to_what_is_the_machine_s_is_refused_before_the_first_step_with_its_place() {
    let assigned = |variable: &str, more: &str| {
        program_of(&format!(
            "#100=MACHINING_WORKPLAN('main','','','');\n#101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#110,1.);\n\
             #110=MACHINING_PROCESS_EXECUTABLE('hot?','if statement','','');\n{}\
             #118=MACHINING_PROCESS_BRANCH_RELATIONSHIP('true branch','',#110,#120);\n\
             #120=MACHINING_PROCESS_EXECUTABLE('set','assignment','','');\n{}{}{more}\
             #400=EXPRESSION_ITEM_REPRESENTATION_ITEM('{variable}',#401);\n#401=REAL_NUMERIC_VARIABLE();\n\
             #402=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#403);\n#403=REAL_LITERAL(2.);\n\
             #404=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#405);\n#405=COMPARISON_GREATER((#406,#403));\n#406=REAL_NUMERIC_VARIABLE();\n\
             #407=EXPRESSION_ITEM_REPRESENTATION_ITEM('S1.TEMPERATURE',#406);\n",
            holds(111, 110, "condition", 404, 8),
            holds(121, 120, "lvalue", 400, 8),
            holds(125, 120, "rvalue", 402, 8),
        ))
    };
    // The machine would say that it is not hot: the branch is not come by, and the program is refused all the same.
    let told = |program| steps(program, StreamOptions::default(), 20, |_| Answer::Truth(false));
    for variable in ["sensor:X.LOAD", "trace:ws_time", "TRACE:mode", "Sensor:nothing"] {
        let program = assigned(variable, "");
        let text = String::from_utf8_lossy(program.file().bytes()).into_owned();
        let place = text.lines().position(|line| line.starts_with("#120=")).expect("it is there") + 1;
        let text = told(program);
        let expected = format!(
            "error: own.stpnc:{place}:1: #120: 'set' writes {variable}, which is the machine's; give a variable of the program"
        );
        assert!(text.starts_with(&expected), "{expected}\n{text}");
    }
    // A variable of the program, and an assignment that is disabled, are nobody else's.
    for (variable, more) in [
        ("LIMIT", String::new()),
        ("sensors", String::new()),
        ("sensor:X.LOAD", says(130, 120, "enabled", "disabled")),
    ] {
        let text = told(assigned(variable, &more));
        assert!(text.contains("end\n") && !text.contains("error"), "{text}");
    }
}

/// What the program does behind a function: `if VARIABLE > 2`, whose initial value is 1.5, as #150; its condition has to be asked for.
fn decides_on(variable: &str) -> String {
    let message = |id: u64, text: &str| {
        let said = says(id + 1, id, "message text", text);
        format!("#{id}=MACHINING_NC_FUNCTION('m','display message','','');\n{said}")
    };
    format!(
        "#106=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#150,2.);\n#150=MACHINING_PROCESS_EXECUTABLE('if','if statement','','');\n\
         #158=MACHINING_PROCESS_BRANCH_RELATIONSHIP('true branch','',#150,#160);\n\
         #159=MACHINING_PROCESS_BRANCH_RELATIONSHIP('false branch','',#150,#170);\n{}{}{}\
         #400=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#401);\n#401=COMPARISON_GREATER((#402,#403));\n#402=REAL_NUMERIC_VARIABLE();\n\
         #403=REAL_LITERAL(2.);\n#404=EXPRESSION_ITEM_REPRESENTATION_ITEM('{variable}',#402);\n\
         #405=REPRESENTATION_ITEM_RELATIONSHIP('initial value','',#404,#406);\n#406=EXPRESSION_ITEM_REPRESENTATION_ITEM('',#407);\n\
         #407=REAL_LITERAL(1.5);\n",
        holds(151, 150, "condition", 400, 8),
        message(160, "above"),
        message(170, "below"),
    )
}

/// An extended function in front of it.
fn behind_a_function(line: &str, variable: &str) -> Program {
    program_of(&format!(
        "#100=MACHINING_WORKPLAN('main','','','');\n#101=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#100,#110,1.);\n\
         #110=MACHINING_NC_FUNCTION('f','extended function','','');\n{}{}",
        says(111, 110, "description", line),
        decides_on(variable),
    ))
}

/// A path in front of it, with conditions along it: each its name and its mode.
fn behind_a_path(conditions: &[(&str, &str)], variable: &str) -> Program {
    let item = |(at, (name, mode)): (usize, &(&str, &str))| {
        let id = 500 + at;
        (
            format!("#{id}"),
            format!("#{id}=DESCRIPTIVE_REPRESENTATION_ITEM('{name}','{mode}');\n"),
        )
    };
    let (ids, items): (Vec<_>, Vec<_>) = conditions.iter().enumerate().map(item).unzip();
    one_path(
        &format!(
            "#200=POLYLINE('',(#201,#202));\n#201=CARTESIAN_POINT('',(0.,0.,5.));\n#202=CARTESIAN_POINT('',(10.,0.,5.));\n\
             #140=MACHINING_FUNCTIONS('','milling','','');\n#141=MACHINING_FUNCTIONS_RELATIONSHIP('','',#110,#140);\n\
             #142=ACTION_PROPERTY('other functions','',#140);\n#143=ACTION_PROPERTY_REPRESENTATION('','',#142,#144);\n\
             #144=REPRESENTATION('',({}),#8);\n{}{}",
            ids.join(","),
            items.concat(),
            decides_on(variable),
        ),
        7,
    )
}

/// The machine is asked for the condition; it has no value, and that is an alarm.
#[track_caller]
fn asks_the_machine(program: Program) {
    let shown = steps(program, StreamOptions::default(), 100, |_| Answer::Unknown);
    assert!(shown.contains("ask Condition"), "{shown}");
    assert!(
        shown.contains("#150: the machine cannot say whether the condition is true"),
        "{shown}"
    );
    assert!(!shown.contains("Message"), "{shown}");
}

#[test]
fn a_condition_on_what_a_function_writes_is_the_machines_whatever_the_variable_is_called() {
    for (line, variable) in [
        ("trace:1 get_tool_tip_temperature its_variable=HEAT", "HEAT"),
        ("trace:1 get_tool_tip_temperature its_variable=\"TIME LIMIT\"", "TIME LIMIT"),
        ("  trace:1 get_time variable = \"A, B\"", "A, B"),
        ("\\X2\\3000\\X0\\trace:1 get_time its_variable=HEAT", "HEAT"),
        (
            "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_actions=\"get_time its_variable=\"\"TIME LIMIT\"\"\"",
            "TIME LIMIT",
        ),
    ] {
        asks_the_machine(behind_a_function(line, variable));
    }
    // Another name is another variable.
    for line in [
        "trace:1 get_time its_variable=\"TIME LIMIT\"",
        "trace:1 get_time its_label=\"its_variable=TIME\"",
    ] {
        let shown = steps(behind_a_function(line, "TIME"), StreamOptions::default(), 100, |_| {
            Answer::Unknown
        });
        assert!(shown.contains("Message(\"below\")") && !shown.contains("ask"), "{shown}");
    }
}

#[test]
fn a_condition_on_what_a_line_along_a_path_writes_is_the_machines() {
    let line = "trace:1 get_feedrate its_variable=SPEED";
    let other = "trace:1 log_event its_kind=a";
    for conditions in [
        vec![(line, "on")],
        vec![("note", line)],
        vec![("note", other), ("note", line)],
        vec![("note", "\\X2\\3000\\X0\\trace:1 get_feedrate its_variable=SPEED")],
    ] {
        asks_the_machine(behind_a_path(&conditions, "SPEED"));
    }
    let shown = steps(
        behind_a_path(&[("note", other)], "SPEED"),
        StreamOptions::default(),
        100,
        |_| Answer::Unknown,
    );
    assert!(shown.contains("Message(\"below\")") && !shown.contains("ask"), "{shown}");
}

#[test]
fn a_line_with_blanks_before_it_has_the_values_of_its_variables_too() {
    for blank in ["", " ", "\\X2\\3000\\X0\\"] {
        let line = format!("{blank}trace:1 log_event its_kind=a its_values=LIMIT");
        let mut stream = StepNcStream::new(Arc::new(behind_a_function(&line, "LIMIT")), StreamOptions::default());
        let function = loop {
            match stream.next(None) {
                Next::Step(step) => match step.kind {
                    StepKind::NcFunction(function) => break function,
                    _ => continue,
                },
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(
            function.properties.get("variable LIMIT").map(String::as_str),
            Some("1.5"),
            "{line}"
        );
    }
}
