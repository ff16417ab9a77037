//! Registers that a program writes, as steps: in the order of execution, each with the line that wrote it.

mod common;

use common::{lathe_tables, mill_tables, open_with, run};
use gcode::profile::by_name;
use gcode::{GcodeProgram, Options};
use plan::{ByteSource, MemorySource, Place, Resolver, Step, StepKind};

/// Moves and writes of a program: `G` with its line, or the register with its line and value.
fn told(steps: &[Step]) -> Vec<String> {
    let line = |step: &Step| match step.origin.place {
        Place::Text { line, .. } => line,
        _ => 0,
    };
    let word = |step: &Step| match &step.kind {
        StepKind::Move(_) => Some(format!("{} move", line(step))),
        StepKind::Register(change) => {
            let value = |v: Option<f64>| v.map_or("vacant".to_owned(), |v| v.to_string());
            let (before, after) = (value(change.before), value(change.after));
            Some(format!("{} {} {before} -> {after}", line(step), change.register.name()))
        }
        _ => None,
    };
    steps.iter().filter_map(word).collect()
}

#[track_caller]
fn check(dialect: &str, text: &str, expected: &[&str]) {
    let tables = if dialect == "fanuc-lathe" {
        lathe_tables()
    } else {
        mill_tables()
    };
    let mut program = open_with(text.as_bytes(), dialect, tables, Options::default()).expect("opens");
    let (steps, alarm) = run(&mut program);
    assert_eq!(alarm, None);
    assert_eq!(told(&steps), expected);
}

#[test]
fn kept_variables_are_told_in_their_order_by_the_line_that_wrote_them_last() {
    check(
        "fanuc-lathe",
        "O1\nG21\n#501=1\n#502=2\n#501=3\nG0 X50.\n#502=#0\nM30",
        &["5 #501 vacant -> 3", "4 #502 vacant -> 2", "6 move", "7 #502 2 -> vacant"],
    );
}

#[test]
fn a_variable_written_behind_a_move_is_told_behind_it_though_the_move_is_held_for_a_corner() {
    check(
        "fanuc-lathe",
        "O1\nG21 G98\nG0 X50. Z0\n#501=1\nG1 Z-10. C1. F100.\n#501=2\nX60.\nM30",
        &["3 move", "4 #501 vacant -> 1", "5 move", "6 #501 1 -> 2", "5 move", "7 move"],
    );
}

#[test]
fn a_variable_written_behind_a_move_is_told_behind_it_though_compensation_holds_the_move() {
    let many: String = (0..150).map(|k| format!("#{}=1\n", 600 + k)).collect();
    let text = format!("O1\nG21 G90 G17 T2 M6\nG0 X0 Y0\n#501=1\nG41 D2 G1 X10. F100.\n#501=2\n{many}Y10.\nX20.\nG40 G1 Y0\nM30");
    let mut program = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
    let (steps, alarm) = run(&mut program);
    assert_eq!(alarm, None);
    let told = told(&steps);
    let place = |what: &str| {
        told.iter()
            .position(|t| t == what)
            .unwrap_or_else(|| panic!("{what}: {told:?}"))
    };
    assert!(place("4 #501 vacant -> 1") < place("5 move"));
    assert!(place("5 move") < place("6 #501 1 -> 2"));
    assert!(place("6 #501 1 -> 2") < place("157 move"));
    // Writes between two moves do not end compensation: the same moves as without them.
    let plain = text.replace(&many, "");
    let mut program = open_with(plain.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("opens");
    let moves = |steps: Vec<Step>| -> Vec<StepKind> {
        let kinds = steps.into_iter().map(|s| s.kind);
        kinds.filter(|k| matches!(k, StepKind::Move(_))).collect()
    };
    assert_eq!(moves(steps), moves(run(&mut program).0));
}

struct Macro(&'static str);
impl Resolver for Macro {
    fn open(&mut self, name: &str) -> Option<Box<dyn ByteSource>> {
        (name == "O9000").then(|| Box::new(MemorySource(self.0.as_bytes().to_vec())) as Box<dyn ByteSource>)
    }
}

#[test]
fn a_program_in_a_file_of_its_own_may_begin_with_a_percent_sign_and_jump() {
    for text in [
        "%\nO9000(SIZE)\nGOTO9\n#501=1\nN9#502=2\nM99\n%\n",
        "made by hand\n%\nGOTO9\n#501=1\nN9#502=2\nM99\n%\n",
        "%\nO1\n#501=7\nM30\nO9000\nGOTO9\n#501=1\nN9#502=2\nM99\n%\n",
    ] {
        let mut program = GcodeProgram::open(
            Box::new(MemorySource(b"O1\nG21\nM98 P9000\nM30".to_vec())),
            "test.nc",
            by_name("fanuc-lathe").expect("a dialect"),
            Box::new(Macro(text)),
            lathe_tables(),
            Options::default(),
        )
        .expect("opens");
        let (steps, alarm) = run(&mut program);
        assert_eq!(alarm, None, "{text}");
        let line = 1 + text[..text.find("N9").expect("there")].matches('\n').count();
        assert_eq!(told(&steps), [format!("{line} #502 vacant -> 2")], "{text}");
    }
}
