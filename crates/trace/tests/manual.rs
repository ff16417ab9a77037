//! The manual's page of functions, the EXPRESS schema and its mapping table are written from the slice: `UPDATE_EXPECT=1` writes them anew.
#![allow(
    clippy::disallowed_methods,
    reason = "the test reads and writes files of the repository, and asks whether to"
)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use trace::functions::{Block, Key};
use trace::sensor::{PREDEFINED, TYPES};
use trace::{Definition, FUNCTIONS, Kind};

fn docs(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(name)
}

#[track_caller]
fn check(name: &str, expected: &str) {
    let path = docs(name);
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(&path, expected).expect("docs can be written");
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == expected,
        "{} is not what the functions say: run UPDATE_EXPECT=1 cargo test -p trace --test manual",
        path.display()
    );
}

fn blocks() -> [(Block, &'static str); 3] {
    [
        (Block::General, "Time, tool, machine, coolant, operator, alarms, events"),
        (Block::Sensors, "Sensors"),
        (Block::SynchronizedActions, "Synchronized actions"),
    ]
}

const HEAD: &str = "# Functions of a program\n\n\
A traceability function is one line, `trace:1 <function> key=value ...`. In STEP-NC it is the text of an extended NC function, or a\n\
condition along a path (`other functions`); in G-code a comment in a block of its own, `(trace:1 ...)`, going on in `(trace:+ ...)`.\n\
The keys are attribute names; `its_` may be left out, and case does not matter outside quotes. A text with blanks stands in double quotes,\n\
a quote in it is written twice. Numbers may have a unit: `20ms`, `0.5 mm`, `80 %`. In a comment round brackets are written `[ ]`, in\n\
quotes `%28 %29`. An unknown key is an error; an unknown function is kept, shown, and does nothing.\n\n\
A function takes effect in the servo cycle in which the last set-point before it is put out; it never stops the path. `toolmark check` says\n\
what is wrong and what this machine cannot give, `toolmark trace show` what was recorded. Values of recordings are in `functions.parquet`\n\
of the job, everything else in its log. A synchronized action that fires often is told ten times in a second, and the rest counted; what it reads is\n\
recorded each time, and what becomes of an alarm is told each time.\n\n\
*This page is written from the code: `UPDATE_EXPECT=1 cargo test -p trace --test manual`.*\n";

const ALL_MODES: &str = "\n### Where an action in all modes lives, and what ends it\n\n\
An action in `AUTOMATIC` belongs to its program and ends with it. One with `its_mode_scope=ALL` belongs to the machine once it is started:\n\
it is checked in jog too, goes on when program and run are over, through reset and emergency stop, and ends by\n\n\
- its `stop_synchronized_action`, in the program that started it;\n\
- an operator of level 4 or stronger, by hand;\n\
- the end of the machine's power, or of `toolmark controller`.\n\n\
To start a program with such an action takes level 6. On a machine that `toolmark run` simulates it ends with the run, and the log says so;\n\
in a controller it goes on, and the log of the job says that (`goes on`). There it still sets and clears alarms, with their reactions, and its\n\
firings are counted; what it would record is recorded by nobody, because the run that would is over. Its id stays taken: a program that\n\
starts something of that id is refused there (T-02), the same program run again too, until it was ended. A run that is taken up with\n\
`--resume` or `--from` goes on with its own beside it. Every run says at its beginning what earlier ones have left there.\n\n\
```\n\
toolmark trace actions --machine tcp://127.0.0.1:7450\n\
   1  id 1    all modes  since 2026-11-22 14:03:12, fired 1, of plate.nc of jo  WHEN ws_time > 3600 s\n\
toolmark trace end 1 --machine tcp://127.0.0.1:7450 --operator NAME --reason TEXT\n\
```\n\n\
The list has a number for each action, which no other one gets while the controller runs, and shows those in automatic of the program under\n\
way as well. Anybody may look, also while somebody else drives the machine. `trace end` asks the operators of the data directory, which a run keeps\n\
to itself while it works: a refusal\n\
is exit 1 and an event (`refused`), an end is two (`action-end-asked`, `action-ended`), with who, why, and how often it had fired. A run that is under way\n\
records that its action was ended by hand, and does not take it up again. `trace end all` ends every one in all modes.\n";

fn manual() -> String {
    let mut page = HEAD.to_owned();
    for (block, title) in blocks() {
        let _ = write!(page, "\n## {title}\n");
        for function in FUNCTIONS.iter().filter(|f| f.block == block) {
            let _ = write!(page, "\n### `{}`\n\n{}\n", function.name, function.doc);
            if !function.also.is_empty() {
                let _ = writeln!(page, "Also read as {}.", function.also.join(", "));
            }
            let _ = writeln!(page, "Records: {}.", function.record);
            if let Some(measure) = function.measure {
                let unit = match measure.dimension.unit() {
                    "" => "no unit".to_owned(),
                    unit => unit.to_owned(),
                };
                let _ = writeln!(
                    page,
                    "MTConnect type {}, {unit}. Without the sensor: {}.",
                    measure.quantity, measure.without_sensor
                );
            }
            if function.is_action {
                page.push_str("May be an action.\n");
            }
            page.push_str("\n| key | takes | |\n|---|---|---|\n");
            for key in function.keys() {
                let needed = if key.required { "**needed**: " } else { "" };
                let _ = writeln!(
                    page,
                    "| `{}` | {} | {needed}{} |",
                    key.name,
                    key.kind.to_string().replace('|', "\\|"),
                    key.doc
                );
            }
            let _ = write!(page, "\n```\n{}\n```\n", function.example);
        }
    }
    page.push_str(ALL_MODES);
    page.push_str("\n## Names in conditions\n\nSensors are named `component.TYPE`, as `X.LOAD`; the `<x>` of each `get_<x>` is an alias. A variable of a\n\
         STEP-NC program has the value that it has where the action is started; a variable of G-code (`#100`) cannot stand in a condition (T-06).\n\n\
         In STEP-NC the condition may stand beside the line as an expression (property `condition` of the function), alone or saying the same: a\n\
         comparison turned round, another unit, an alias or a prefix make no difference, the order of other operands does. Its numbers are in the\n\
         units of records, an alarm that is active is 1.\n\n");
    page.push_str("| value of every machine | unit | |\n|---|---|---|\n");
    for (name, _, dimension, doc) in PREDEFINED {
        let _ = writeln!(page, "| `{name}` | {} | {doc} |", dimension.symbol());
    }
    page.push_str("| `alarm[n]` | | true while the alarm n, 1 to 999, is active |\n\n| type | unit of records |\n|---|---|\n");
    for (kind, dimension) in TYPES {
        let _ = writeln!(page, "| {kind} | {} |", dimension.unit());
    }
    page.push_str(
        "\n## Sensors of our own controller\n\nEach is worked out in every servo cycle. *Recorded*: a column of every record; *derived*: worked out of \
         what is measured, and\nmarked so wherever it is recorded; all others are recorded by the functions above. Where a machine has no such sensor (a \
         motion card\ngives no loads) the value is missing, never 0.\n\n| sensor | unit | |\n|---|---|---|\n",
    );
    for signal in machine::watch::SIGNALS.iter().filter(|s| !s.name.starts_with("trace:")) {
        let recorded = machine::CHANNELS.iter().any(|channel| channel.name == signal.name);
        let words = [(recorded, "recorded"), (signal.derived, "derived")];
        let words: Vec<&str> = words.into_iter().filter_map(|(is, word)| is.then_some(word)).collect();
        let _ = writeln!(page, "| `{}` | {} | {} |", signal.name, signal.unit, words.join(", "));
    }
    page.push_str(
        "\n## What the conditions cost\n\n`CONTROLLER.WATCH_OPERATIONS` (COUNT) is how many operations the conditions took in a cycle, \
`CONTROLLER.WATCH_TIME`\n(NANOSECOND) how long. Both are recorded and watched like any sensor. In simulated time nobody measures: the time is\n\
unavailable there, because the same seed has to give the same bytes.\n",
    );
    let kinds: Vec<String> = trace::record::CONTROL_EVENTS.iter().map(|kind| format!("`{kind}`")).collect();
    let _ = write!(
        page,
        "\n## Events of the control\n\nWhat `log_nc_events` records, and what `its_kinds` may name:\n{}.\n",
        kinds.join(", ")
    );
    page.push_str(
        "\n## Errors\n\n| code | case | at load | at run time |\n|---|---|---|---|\n\
| T-01 | stop without an active start of its kind | error; a warning where it was started before | event, goes on |\n\
| T-02 | id started while active, as whatever kind of function | error | start ignored, event |\n\
| T-03 | clear of an alarm that is not active | | event |\n\
| T-04 | start without stop in its scope | remark | ended by its scope, reason recorded |\n\
| T-05 | sensor that this machine has not | warning; error with `required=ON` | quality unavailable, one event an outage; `its_variable` has no value, and a program that uses it stops |\n\
| T-06 | what makes no sense: names, units and kinds in a condition, a typed condition that says something else than the line, several values for one variable, geometry that the file has not | error | event |\n\
| T-07 | a variable of the machine is written (`sensor:`, `trace:`), by a function, an action or an assignment | error | not written |\n\
| T-08 | a function that cannot be an action | error | |\n\
| T-09 | more conditions or firings than the cycle takes, more than 100 000 values spread evenly | error | what is only recorded goes first, counted |\n\
| T-10 | cycles lost on their way to a recording | | counted in the recording |\n\
| T-11 | not of the level that is needed | refused | refused |\n\
| T-12 | between two paths of an operation, inside a canned cycle, a contour or a modal call's body | error | |\n",
    );
    page
}

fn type_of(key: &Key) -> String {
    match key.kind {
        Kind::Text if key.name.ends_with("_id") || key.name == "its_id" => "trace_id".to_owned(),
        Kind::Text | Kind::Moment => "text".to_owned(),
        Kind::Integer(..) if key.name == "its_level" => "edit_level".to_owned(),
        Kind::Integer(..) => "INTEGER".to_owned(),
        Kind::Number(_) => "REAL".to_owned(),
        Kind::State => "BOOLEAN".to_owned(),
        Kind::Word(_) => format!("{}_word", key.name.trim_start_matches("its_")),
        Kind::List => "LIST [1:?] OF label".to_owned(),
        Kind::Condition => "text".to_owned(),
        Kind::Actions => "LIST [1:?] OF trace_function".to_owned(),
        Kind::Sampling => "sampling".to_owned(),
        Kind::Reference => "label".to_owned(),
    }
}

/// Words that EXPRESS reserves, and `none`, which says nothing alone.
fn word(of: &str, word: &str) -> String {
    let word = word.to_lowercase();
    if ["from", "none", "all", "work", "function", "reset"].contains(&word.as_str()) {
        format!("{}_{word}", of.trim_start_matches("its_"))
    } else {
        word
    }
}

fn schema() -> String {
    let mut text = "(* Traceability functions of a program, as subtypes of the NC function of ISO 10303-238's ARM.\n   \
Written from the code: UPDATE_EXPECT=1 cargo test -p trace --test manual *)\nSCHEMA traceability_functions_arm;\n\n\
TYPE label = STRING; END_TYPE;\nTYPE text = STRING; END_TYPE;\nTYPE identifier = STRING; END_TYPE;\n\
TYPE trace_id = identifier; END_TYPE;\nTYPE edit_level = INTEGER; WHERE WR1: {1 <= SELF <= 10}; END_TYPE;\n\n\
ENTITY nc_function ABSTRACT SUPERTYPE; its_id : identifier; END_ENTITY;\n\n\
ENTITY sampling ABSTRACT SUPERTYPE OF (ONEOF (by_cycle, by_time, by_distance, by_points, by_count)); END_ENTITY;\n\
ENTITY by_cycle SUBTYPE OF (sampling); factor : INTEGER; WHERE WR1: factor >= 1; END_ENTITY;\n\
ENTITY by_time SUBTYPE OF (sampling); interval_s : REAL; END_ENTITY;\n\
ENTITY by_distance SUBTYPE OF (sampling); step_mm : REAL; END_ENTITY;\n\
ENTITY by_points SUBTYPE OF (sampling); curve : label; tolerance_mm : OPTIONAL REAL; END_ENTITY;\n\
ENTITY by_count SUBTYPE OF (sampling); samples : INTEGER; WHERE WR1: samples >= 1; END_ENTITY;\n\n"
        .to_owned();
    let mut words: Vec<(&str, &[&str])> = Vec::new();
    for key in FUNCTIONS.iter().flat_map(|f| f.keys()) {
        if let Kind::Word(all) = key.kind
            && !words.iter().any(|(name, _)| *name == key.name)
        {
            words.push((key.name, all));
        }
    }
    for (name, all) in words {
        let all: Vec<String> = all.iter().map(|w| word(name, w)).collect();
        let _ = writeln!(
            text,
            "TYPE {}_word = ENUMERATION OF ({}); END_TYPE;",
            name.trim_start_matches("its_"),
            all.join(", ")
        );
    }
    text.push_str(
        "\nENTITY trace_function ABSTRACT SUPERTYPE SUBTYPE OF (nc_function);\n  its_log : OPTIONAL label;\nEND_ENTITY;\n",
    );
    for (name, doc, common) in FAMILIES {
        let _ = write!(
            text,
            "\n(* {doc} *)\nENTITY {name} ABSTRACT SUPERTYPE SUBTYPE OF (trace_function);\n"
        );
        let of_it = FUNCTIONS
            .iter()
            .find(|f| family(f) == Some(name))
            .expect("each has functions");
        attributes(&mut text, of_it.keys().filter(|key| common.contains(&key.name)));
    }
    for function in FUNCTIONS {
        let above = family(function);
        let common = FAMILIES.iter().find(|(name, ..)| Some(*name) == above);
        let _ = write!(
            text,
            "\n(* {} *)\nENTITY {} SUBTYPE OF ({});\n",
            function.doc,
            function.name,
            above.unwrap_or("trace_function")
        );
        let own = |key: &&Key| key.name != "its_log" && common.is_none_or(|(_, _, keys)| !keys.contains(&key.name));
        attributes(&mut text, function.keys().filter(own));
    }
    text.push_str(RECORDS);
    text.push_str("\nEND_SCHEMA;\n");
    text
}

/// Functions of the sensors' table have their attributes in common.
const FAMILIES: [(&str, &str, &[&str]); 2] = [
    (
        "get_measure",
        "A single value: into a variable, or recorded only.",
        &["its_variable", "with_direction", "required"],
    ),
    (
        "get_measure_points",
        "A bounded number of values along what follows.",
        &["its_points", "number_of_points", "tolerance", "with_direction", "required"],
    ),
];

fn family(function: &Definition) -> Option<&'static str> {
    function.measure?;
    Some(if function.name.ends_with("_points") {
        "get_measure_points"
    } else {
        "get_measure"
    })
}

/// Attributes, what they may be, and the end of their entity.
fn attributes<'k>(text: &mut String, keys: impl Iterator<Item = &'k Key>) {
    let mut rules = Vec::new();
    for key in keys {
        let optional = if key.required { "" } else { "OPTIONAL " };
        // The identifier of the NC function is its place in the file; the id that a stop refers to has a name of its own.
        let name = if key.name == "its_id" { "action_id" } else { key.name };
        let _ = writeln!(text, "  {name} : {optional}{};", type_of(key));
        rules.extend(match key.kind {
            Kind::Integer(..) if key.name == "its_level" => None,
            Kind::Integer(from, 2_147_483_647) => Some(format!("{name} >= {from}")),
            Kind::Integer(from, to) => Some(format!("{{{from} <= {name} <= {to}}}")),
            // What a condition is checked for is a frequency, and the other way round.
            Kind::Condition => Some(format!(
                "EXISTS({name}) = (EXISTS(its_frequency) AND (its_frequency <> frequency_none))"
            )),
            _ => None,
        });
    }
    for (k, rule) in rules.iter().enumerate() {
        let head = if k == 0 { "WHERE\n" } else { "" };
        let _ = writeln!(text, "{head}  WR{}: {rule};", k + 1);
    }
    text.push_str("END_ENTITY;\n");
}

/// What records hold; a file of STEP-NC has them as properties, a log as members of its events.
const RECORDS: &str = "
(* A sample of a sensor: one number, or three of a vector. The time is UTC as RFC 3339, the unit MTConnect's word. *)
ENTITY measured_value;
  its_time : label;
  its_cycle : INTEGER;
  its_value : LIST [1:3] OF REAL;
  its_unit : label;
  its_direction : OPTIONAL LIST [3:3] OF REAL;
  quality : label;
END_ENTITY;

(* What is declared of a coolant, the concentration in %; log_coolant_data has the same attributes. *)
ENTITY coolant_data;
  product : OPTIONAL label;
  its_kind : OPTIONAL label;
  concentration : OPTIONAL REAL;
  ph : OPTIONAL REAL;
  batch : OPTIONAL identifier;
  filled : OPTIONAL label;
END_ENTITY;

(* Who is signed in; a person and organization with the role 'operator' in the AIM. *)
ENTITY operator_data;
  name : label;
  organization : OPTIONAL label;
  role : label;
  level : OPTIONAL edit_level;
  shift : OPTIONAL label;
  qualified_until : OPTIONAL label;
  authenticated_by : label;
END_ENTITY;
";

fn mapping() -> String {
    let mut page = "# How the functions stand in a file of ISO 10303-238\n\n\
The schema is `traceability_functions.exp`. It adds no entity to the AIM: a file with a new entity would be refused by every reader there\n\
is. Each function is one `MACHINING_NC_FUNCTION`, its text one line (`functions.md`). The standard contradicts itself about the two names,\n\
so both are read; the first is written, and the second with `--aim-strict` (convert, edit).\n\n\
| ARM | AIM |\n|---|---|\n\
| trace_function (any) | `MACHINING_NC_FUNCTION(name, 'extended function', '', '')` with `ACTION_PROPERTY('description', ...)` and a `DESCRIPTIVE_REPRESENTATION_ITEM('', 'trace:1 ...')` |\n\
| the same, by the AIM's local rule | `'legacy function'` with the property `'function text'` |\n\
| along a path | `MACHINING_FUNCTIONS`, property `'other functions'`: an item whose name or description is the line; or `trace.record` and `trace.sampling` |\n\
| its_variable | the name of an `NC_VARIABLE`; in G-code `#100` |\n\
| by_points, its_points | `#name` of a Part 21 edition 3 anchor, or `#number` of a point set or polyline |\n\
| measured_value of a single value | dated `MACHINING_PROCESS_PROPERTY` on the twin of its workingstep, with unit and quality |\n\
| samples of a recording | `functions.parquet` of the job, by the hash in the log |\n\
| operator_data | `APPLIED_PERSON_AND_ORGANIZATION_ASSIGNMENT` with the role 'operator' on the executed project |\n\
| set_edit_access_level | besides the function `APPLIED_SECURITY_CLASSIFICATION_ASSIGNMENT`, 'edit access level', on each executable that an edit gives the level |\n\
| coolant_data, and all that is no number | in the log only |\n\
| broadcast (draft of edition 4) | `MACHINING_BROADCAST_STRATEGY` is kept and named by a warning, and records nothing: its AIM is not published |\n\n\
| function | attributes, in the order of the schema |\n|---|---|\n"
        .to_owned();
    for function in FUNCTIONS {
        let keys: Vec<&str> = function.keys().map(|key| key.name).collect();
        let _ = writeln!(page, "| {} | {} |", function.name, keys.join(", "));
    }
    page
}

#[test]
fn the_manual_has_a_section_for_every_function() {
    check("functions.md", &manual());
}

#[test]
fn the_schema_has_an_entity_for_every_function() {
    check("traceability_functions.exp", &schema());
}

#[test]
fn the_mapping_table_has_a_row_for_every_function() {
    check("traceability_functions.md", &mapping());
}

#[test]
fn every_entity_of_the_schema_refers_to_what_is_in_it() {
    let text = schema();
    let declared: Vec<String> = text
        .lines()
        .filter_map(|line| line.strip_prefix("ENTITY ").or(line.strip_prefix("TYPE ")))
        .filter_map(|rest| rest.split([' ', ';']).next())
        .map(str::to_owned)
        .collect();
    for line in text
        .lines()
        .filter(|line| line.starts_with("  ") && !line.starts_with("  WR"))
    {
        let kind = line.trim_end_matches(';').rsplit(' ').next().unwrap_or_default();
        let built_in = ["INTEGER", "REAL", "BOOLEAN", "Written"].contains(&kind) || line.contains("Written from");
        assert!(built_in || declared.iter().any(|d| d == kind), "{line}");
    }
    for function in FUNCTIONS {
        assert_eq!(
            declared.iter().filter(|d| **d == function.name).count(),
            1,
            "{}",
            function.name
        );
    }
}
