//! Every function on every control, posted and compared; and the manual's table of them.

mod common;

use expect_test::expect_file;
use post::{CONTROLS, Grade};
use trace::FUNCTIONS;

#[test]
fn every_function_is_posted_to_every_control_as_written_down() {
    for control in CONTROLS {
        let mut all = String::new();
        for definition in FUNCTIONS {
            let (row, text) = post::table::posted(definition, *control).unwrap_or_else(|e| panic!("{}: {e}", definition.name));
            let mark = if row.verified { "" } else { " (verify at commissioning)" };
            all += &format!("==== {}: {}{mark}: {}\n", definition.name, row.grade, row.reason);
            // The frame of the program is the same for all; the body begins behind the head.
            let body = text.replace('\r', "");
            let from = body
                .find("WS 1")
                .and_then(|at| body[at..].find('\n').map(|n| at + n + 1))
                .unwrap_or(0);
            all += &body[from..];
        }
        expect_file![format!("golden/{}.txt", control.name())].assert_eq(&all);
    }
}

#[test]
fn nothing_is_native_but_what_the_reference_has_a_row_for() {
    let native = [
        "set_alarm",
        "display_message",
        "start_sensor_recording",
        "stop_sensor_recording",
        "start_synchronized_action",
        "stop_synchronized_action",
    ];
    for control in CONTROLS {
        for definition in FUNCTIONS {
            let (row, _) = post::table::posted(definition, *control).unwrap_or_else(|e| panic!("{}: {e}", definition.name));
            assert!(
                row.grade != Grade::Native || native.contains(&definition.name),
                "{} on {} is native",
                definition.name,
                control.name()
            );
            assert!(
                !row.reason.is_empty(),
                "{} on {} has no reason",
                definition.name,
                control.name()
            );
        }
    }
}

#[test]
fn the_manual_has_the_table_of_the_code() {
    let table = post::table::markdown(CONTROLS).unwrap_or_else(|e| panic!("{e}"));
    let begin = "<!-- generated: functions by control -->\n";
    let path = format!("{}/../../docs/post.md", env!("CARGO_MANIFEST_DIR"));
    #[expect(clippy::disallowed_methods, reason = "a test reads the manual")]
    let manual = std::fs::read_to_string(&path).expect("the manual is there");
    let head = manual.split(begin).next().unwrap_or_default();
    expect_file![path].assert_eq(&format!("{head}{begin}\n{table}"));
}
