//! Canned cycles and compensation: the path of each, worked out by hand from the cycle's definition.
//!
//! A lathe's X is a radius here, as in every step.

mod common;

use common::{lathe_tables, mill_tables, open_with, run, spell};
use expect_test::{Expect, expect};
use gcode::Options;
use plan::{Answer, Next, Place, ProgramStream, Question, Step, StepKind, Tables, ToolEntry};
use units::{Millimetres, Point, ToolNumber};

/// What a program does from line `from` on, one line a step, without the frame; findings and alarm behind.
fn told(program: &str, dialect: &str, tables: Tables, from: u32) -> String {
    let mut stream = open_with(program.as_bytes(), dialect, tables, Options::default()).expect("it opens");
    let (steps, alarm) = run(&mut stream);
    let mut out = String::new();
    let line_of = |step: &Step| match step.origin.place {
        Place::Text { line, .. } => line,
        _ => 0,
    };
    for step in &steps {
        let structure = matches!(step.kind, StepKind::Begin(_) | StepKind::End(_));
        if line_of(step) >= from && !structure {
            out += &format!("{} {}\n", line_of(step), spell(&step.kind));
        }
    }
    for d in stream.diagnostics() {
        out += &format!("{d}\n");
    }
    if let Some(alarm) = alarm {
        out += &format!("{alarm}\n");
    }
    out
}

#[track_caller]
fn lathe(program: &str, from: u32, expected: Expect) {
    expected.assert_eq(&told(program, "fanuc-lathe", lathe_with_nose(0.0, 3), from));
}

#[track_caller]
fn mill(program: &str, from: u32, expected: Expect) {
    expected.assert_eq(&told(program, "fanuc-mill", mill_tables(), from));
}

fn lathe_with_nose(radius: f64, tip_direction: u8) -> Tables {
    let mut tables = lathe_tables();
    tables.tools.insert(
        ToolNumber(1),
        ToolEntry {
            radius: Millimetres(radius),
            tip_direction,
            ..common::tool(20.0, 30.0, 0.0, None)
        },
    );
    tables
}

// ---- turning

#[test]
fn g90_turns_along_z_and_comes_back_to_where_it_began() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.2\nG0 X50. Z2.\nG90 X44. Z-30.\nX40.\nU-14. W-22. R-1.\nG0 X60.\nM30",
        4,
        expect![[r#"
            4 line 25 0 2 -> 22 0 2 rapid
            4 line 22 0 2 -> 22 0 -30 F0.2/rev
            4 line 22 0 -30 -> 25 0 -30 F0.2/rev
            4 line 25 0 -30 -> 25 0 2 rapid
            5 line 25 0 2 -> 20 0 2 rapid
            5 line 20 0 2 -> 20 0 -30 F0.2/rev
            5 line 20 0 -30 -> 25 0 -30 F0.2/rev
            5 line 25 0 -30 -> 25 0 2 rapid
            6 line 25 0 2 -> 17 0 2 rapid
            6 line 17 0 2 -> 18 0 -20 F0.2/rev
            6 line 18 0 -20 -> 25 0 -20 F0.2/rev
            6 line 25 0 -20 -> 25 0 2 rapid
            7 line 25 0 2 -> 30 0 2 rapid
            8 spindle stopped
        "#]],
    );
}

#[test]
fn g94_faces_along_x() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.2\nG0 X50. Z2.\nG94 X10. Z-3. R-2.\nZ-5.\nM30",
        4,
        expect![[r#"
            4 line 25 0 2 -> 25 0 -5 rapid
            4 line 25 0 -5 -> 5 0 -3 F0.2/rev
            4 line 5 0 -3 -> 5 0 2 F0.2/rev
            4 line 5 0 2 -> 25 0 2 rapid
            5 line 25 0 2 -> 25 0 -7 rapid
            5 line 25 0 -7 -> 5 0 -5 F0.2/rev
            5 line 5 0 -5 -> 5 0 2 F0.2/rev
            5 line 5 0 2 -> 25 0 2 rapid
            6 spindle stopped
        "#]],
    );
}

#[test]
fn g92_cuts_a_thread_with_the_lead_as_its_feed() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X30. Z5.\nG92 X28. Z-20. F2.\nX27. R-1.\nM30",
        4,
        expect![[r#"
            4 line 15 0 5 -> 14 0 5 rapid
            4 line 14 0 5 -> 14 0 -20 thread 2/rev from 0deg
            4 line 14 0 -20 -> 15 0 -20 rapid
            4 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 12.5 0 5 rapid
            5 line 12.5 0 5 -> 13.5 0 -20 thread 2.0016/rev from 0deg
            5 line 13.5 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            6 spindle stopped
        "#]],
    );
}

#[test]
fn g32_threads_follow_on_without_waiting_for_the_mark() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X20. Z5.\nG32 Z-20. F1.5 Q180000\nX24. Z-22.\nG0 X30.\nM30",
        4,
        expect![[r#"
            4 line 10 0 5 -> 10 0 -20 thread 1.5/rev from 180deg
            5 line 10 0 -20 -> 12 0 -22 thread 2.1213/rev on
            6 line 12 0 -22 -> 15 0 -22 rapid
            7 spindle stopped
        "#]],
    );
}

#[test]
fn g76_feeds_in_by_the_root_of_the_pass_along_one_flank() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X30. Z5.\nG76 P021060 Q100 R0.05\nG76 X18. Z-20. P1000 Q500 F2.\nM30",
        4,
        expect![[r#"
            5 line 15 0 5 -> 15 0 4.7113 rapid
            5 line 15 0 4.7113 -> 9.5 0 4.7113 rapid
            5 line 9.5 0 4.7113 -> 9.5 0 -18 thread 2/rev from 0deg
            5 line 9.5 0 -18 -> 11.5 0 -20 thread 2.8284/rev on
            5 line 11.5 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 15 0 4.5918 rapid
            5 line 15 0 4.5918 -> 9.2929 0 4.5918 rapid
            5 line 9.2929 0 4.5918 -> 9.2929 0 -18 thread 2/rev from 0deg
            5 line 9.2929 0 -18 -> 11.2929 0 -20 thread 2.8284/rev on
            5 line 11.2929 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 15 0 4.5 rapid
            5 line 15 0 4.5 -> 9.134 0 4.5 rapid
            5 line 9.134 0 4.5 -> 9.134 0 -18 thread 2/rev from 0deg
            5 line 9.134 0 -18 -> 11.134 0 -20 thread 2.8284/rev on
            5 line 11.134 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 15 0 4.4515 rapid
            5 line 15 0 4.4515 -> 9.05 0 4.4515 rapid
            5 line 9.05 0 4.4515 -> 9.05 0 -18 thread 2/rev from 0deg
            5 line 9.05 0 -18 -> 11.05 0 -20 thread 2.8284/rev on
            5 line 11.05 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 15 0 4.4226 rapid
            5 line 15 0 4.4226 -> 9 0 4.4226 rapid
            5 line 9 0 4.4226 -> 9 0 -18 thread 2/rev from 0deg
            5 line 9 0 -18 -> 11 0 -20 thread 2.8284/rev on
            5 line 11 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            5 line 15 0 5 -> 15 0 4.4226 rapid
            5 line 15 0 4.4226 -> 9 0 4.4226 rapid
            5 line 9 0 4.4226 -> 9 0 -18 thread 2/rev from 0deg
            5 line 9 0 -18 -> 11 0 -20 thread 2.8284/rev on
            5 line 11 0 -20 -> 15 0 -20 rapid
            5 line 15 0 -20 -> 15 0 5 rapid
            6 spindle stopped
        "#]],
    );
}

#[test]
fn g76_in_one_block() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X30. Z5.\nG76 X18. Z-20. K1. D700 F2. A0\nM30",
        4,
        expect![[r#"
            4 line 15 0 5 -> 9.3 0 5 rapid
            4 line 9.3 0 5 -> 9.3 0 -20 thread 2/rev from 0deg
            4 line 9.3 0 -20 -> 15 0 -20 rapid
            4 line 15 0 -20 -> 15 0 5 rapid
            4 line 15 0 5 -> 9.0101 0 5 rapid
            4 line 9.0101 0 5 -> 9.0101 0 -20 thread 2/rev from 0deg
            4 line 9.0101 0 -20 -> 15 0 -20 rapid
            4 line 15 0 -20 -> 15 0 5 rapid
            4 line 15 0 5 -> 9 0 5 rapid
            4 line 9 0 5 -> 9 0 -20 thread 2/rev from 0deg
            4 line 9 0 -20 -> 15 0 -20 rapid
            4 line 15 0 -20 -> 15 0 5 rapid
            4 line 15 0 5 -> 9 0 5 rapid
            4 line 9 0 5 -> 9 0 -20 thread 2/rev from 0deg
            4 line 9 0 -20 -> 15 0 -20 rapid
            4 line 15 0 -20 -> 15 0 5 rapid
            5 spindle stopped
        "#]],
    );
}

#[test]
fn g74_pecks_along_z_column_by_column() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X20. Z1.\nG74 R0.5\nG74 X12. Z-9. P3000 Q4000 R0.2\nG0 X0\nG74 Z-5. Q4000\nM30",
        5,
        expect![[r#"
            5 line 10 0 1 -> 10 0 -3 F0.1/rev
            5 line 10 0 -3 -> 10 0 -2.5 rapid
            5 line 10 0 -2.5 -> 10 0 -7 F0.1/rev
            5 line 10 0 -7 -> 10 0 -6.5 rapid
            5 line 10 0 -6.5 -> 10 0 -9 F0.1/rev
            5 line 10 0 -9 -> 10 0 1 rapid
            5 line 10 0 1 -> 7 0 1 rapid
            5 line 7 0 1 -> 7 0 -3 F0.1/rev
            5 line 7 0 -3 -> 7 0 -2.5 rapid
            5 line 7 0 -2.5 -> 7 0 -7 F0.1/rev
            5 line 7 0 -7 -> 7 0 -6.5 rapid
            5 line 7 0 -6.5 -> 7 0 -9 F0.1/rev
            5 line 7 0 -9 -> 7.2 0 -9 F0.1/rev
            5 line 7.2 0 -9 -> 7.2 0 1 rapid
            5 line 7.2 0 1 -> 6 0 1 rapid
            5 line 6 0 1 -> 6 0 -3 F0.1/rev
            5 line 6 0 -3 -> 6 0 -2.5 rapid
            5 line 6 0 -2.5 -> 6 0 -7 F0.1/rev
            5 line 6 0 -7 -> 6 0 -6.5 rapid
            5 line 6 0 -6.5 -> 6 0 -9 F0.1/rev
            5 line 6 0 -9 -> 6.2 0 -9 F0.1/rev
            5 line 6.2 0 -9 -> 6.2 0 1 rapid
            5 line 6.2 0 1 -> 10 0 1 rapid
            6 line 10 0 1 -> 0 0 1 rapid
            7 line 0 0 1 -> 0 0 -3 F0.1/rev
            7 line 0 0 -3 -> 0 0 -2.5 rapid
            7 line 0 0 -2.5 -> 0 0 -5 F0.1/rev
            7 line 0 0 -5 -> 0 0 1 rapid
            8 spindle stopped
        "#]],
    );
}

#[test]
fn g75_pecks_along_x_column_by_column() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X42. Z-10.\nG75 R0.5\nG75 X30. Z-14. P4000 Q2500 F0.05\nM30",
        5,
        expect![[r#"
            5 line 21 0 -10 -> 17 0 -10 F0.05/rev
            5 line 17 0 -10 -> 17.5 0 -10 rapid
            5 line 17.5 0 -10 -> 15 0 -10 F0.05/rev
            5 line 15 0 -10 -> 21 0 -10 rapid
            5 line 21 0 -10 -> 21 0 -12.5 rapid
            5 line 21 0 -12.5 -> 17 0 -12.5 F0.05/rev
            5 line 17 0 -12.5 -> 17.5 0 -12.5 rapid
            5 line 17.5 0 -12.5 -> 15 0 -12.5 F0.05/rev
            5 line 15 0 -12.5 -> 21 0 -12.5 rapid
            5 line 21 0 -12.5 -> 21 0 -14 rapid
            5 line 21 0 -14 -> 17 0 -14 F0.05/rev
            5 line 17 0 -14 -> 17.5 0 -14 rapid
            5 line 17.5 0 -14 -> 15 0 -14 F0.05/rev
            5 line 15 0 -14 -> 21 0 -14 rapid
            5 line 21 0 -14 -> 21 0 -10 rapid
            6 spindle stopped
        "#]],
    );
}

const STEPPED: &str = "N10 G0 X20.\nN20 G1 Z-10. F0.1\nN30 X30. Z-15.\nN40 G2 X36. Z-18. R3.\nN50 G1 X40.\n";

#[test]
fn g71_roughs_level_by_level_and_along_the_contour() {
    lathe(
        &format!(
            "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X40. Z2.\nG71 U4. R1.\nG71 P10 Q50 U0.4 W0.1 F0.25\n{STEPPED}G70 P10 Q50\nM30"
        ),
        4,
        expect![[r#"
            5 line 20 0 2 -> 16 0 2 rapid
            5 line 16 0 2 -> 16 0 -16.9396 F0.25/rev
            5 line 16 0 -16.9396 -> 17 0 -15.9396 F0.25/rev
            5 line 17 0 -15.9396 -> 17 0 2 rapid
            5 line 17 0 2 -> 12 0 2 rapid
            5 line 12 0 2 -> 12 0 -11.7 F0.25/rev
            5 line 12 0 -11.7 -> 13 0 -10.7 F0.25/rev
            5 line 13 0 -10.7 -> 20 0 -10.7 rapid
            5 line 20 0 -10.7 -> 20 0 2 rapid
            5 line 20 0 2 -> 10.2 0 2.1 rapid
            5 line 10.2 0 2.1 -> 10.2 0 -9.9 F0.25/rev
            5 line 10.2 0 -9.9 -> 15.2 0 -14.9 F0.25/rev
            5 arc 15.2 0 -14.9 -> 18.2 0 -17.9 r3 -90deg about Y F0.25/rev
            5 line 18.2 0 -17.9 -> 20.2 0 -17.9 F0.25/rev
            5 line 20.2 0 -17.9 -> 20 0 -17.9 rapid
            5 line 20 0 -17.9 -> 20 0 2 rapid
            11 line 20 0 2 -> 10 0 2 rapid
            11 line 10 0 2 -> 10 0 -10 F0.1/rev
            11 line 10 0 -10 -> 15 0 -15 F0.1/rev
            11 arc 15 0 -15 -> 18 0 -18 r3 -90deg about Y F0.1/rev
            11 line 18 0 -18 -> 20 0 -18 F0.1/rev
            11 line 20 0 -18 -> 20 0 2 rapid
            12 spindle stopped
        "#]],
    );
}

#[test]
fn g71_in_one_block_does_the_same() {
    let head = "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X40. Z2.\n";
    let moves = |program: String| -> Vec<String> {
        told(&program, "fanuc-lathe", lathe_with_nose(0.0, 3), 4)
            .lines()
            .map(|l| l.split_once(' ').expect("a line and a step").1.to_owned())
            .collect()
    };
    let two = moves(format!("{head}G71 U4. R0\nG71 P10 Q50 U0.4 W0.1 F0.25\n{STEPPED}M30"));
    let one = moves(format!("{head}G71 P10 Q50 U0.4 W0.1 D4000 F0.25\n{STEPPED}M30"));
    assert_eq!(two, one);
    assert!(two.len() > 10);
}

#[test]
fn g71_of_type_two_empties_a_pocket_to_its_ground() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X40. Z2.\nG71 U4. R0.5\nG71 P10 Q40 U0 W0 F0.25\nN10 G0 X30. Z0\nN20 G1 X20. Z-10.\nN30 Z-20.\nN40 X40. Z-30.\nM30",
        4,
        expect![[r#"
            5 line 20 0 2 -> 16 0 2 rapid
            5 line 16 0 2 -> 16 0 -26 F0.25/rev
            5 line 16 0 -26 -> 16.5 0 -25.5 F0.25/rev
            5 line 16.5 0 -25.5 -> 16.5 0 -6 rapid
            5 line 16.5 0 -6 -> 12 0 -6 F0.25/rev
            5 line 12 0 -6 -> 12 0 -22 F0.25/rev
            5 line 12 0 -22 -> 12.5 0 -21.5 F0.25/rev
            5 line 12.5 0 -21.5 -> 20 0 -21.5 rapid
            5 line 20 0 -21.5 -> 20 0 2 rapid
            5 line 20 0 2 -> 15 0 0 rapid
            5 line 15 0 0 -> 10 0 -10 F0.25/rev
            5 line 10 0 -10 -> 10 0 -20 F0.25/rev
            5 line 10 0 -20 -> 20 0 -30 F0.25/rev
            5 line 20 0 -30 -> 20 0 2 rapid
            10 spindle stopped
        "#]],
    );
}

#[test]
fn g72_roughs_along_x() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X40. Z1.\nG72 W2. R0.5\nG72 P10 Q30 U0.4 W0.2 F0.25\nN10 G0 Z-5.\nN20 G1 X20. Z-3.\nN30 Z0\nM30",
        4,
        expect![[r#"
            5 line 20 0 1 -> 20 0 -1 rapid
            5 line 20 0 -1 -> 10.2 0 -1 F0.25/rev
            5 line 10.2 0 -1 -> 10.7 0 -0.5 F0.25/rev
            5 line 10.7 0 -0.5 -> 20 0 -0.5 rapid
            5 line 20 0 -0.5 -> 20 0 -3 rapid
            5 line 20 0 -3 -> 11.2 0 -3 F0.25/rev
            5 line 11.2 0 -3 -> 11.7 0 -2.5 F0.25/rev
            5 line 11.7 0 -2.5 -> 11.7 0 1 rapid
            5 line 11.7 0 1 -> 20 0 1 rapid
            5 line 20 0 1 -> 20.2 0 -4.8 rapid
            5 line 20.2 0 -4.8 -> 10.2 0 -2.8 F0.25/rev
            5 line 10.2 0 -2.8 -> 10.2 0 0.2 F0.25/rev
            5 line 10.2 0 0.2 -> 10.2 0 1 rapid
            5 line 10.2 0 1 -> 20 0 1 rapid
            9 spindle stopped
        "#]],
    );
}

#[test]
fn g73_comes_nearer_pass_by_pass() {
    lathe(
        "G21 G18 G99 T0101\nG97 S1000 M3\nG0 X40. Z5.\nG73 U3. W1. R3\nG73 P10 Q30 U0.4 W0.1 F0.25\nN10 G0 X20. Z1.\nN20 G1 Z-10.\nN30 X30. Z-12.\nM30",
        4,
        expect![[r#"
            5 line 20 0 5 -> 23.2 0 6.1 rapid
            5 line 23.2 0 6.1 -> 13.2 0 2.1 rapid
            5 line 13.2 0 2.1 -> 13.2 0 -8.9 F0.25/rev
            5 line 13.2 0 -8.9 -> 18.2 0 -10.9 F0.25/rev
            5 line 18.2 0 -10.9 -> 21.7 0 5.6 rapid
            5 line 21.7 0 5.6 -> 11.7 0 1.6 rapid
            5 line 11.7 0 1.6 -> 11.7 0 -9.4 F0.25/rev
            5 line 11.7 0 -9.4 -> 16.7 0 -11.4 F0.25/rev
            5 line 16.7 0 -11.4 -> 20.2 0 5.1 rapid
            5 line 20.2 0 5.1 -> 10.2 0 1.1 rapid
            5 line 10.2 0 1.1 -> 10.2 0 -9.9 F0.25/rev
            5 line 10.2 0 -9.9 -> 15.2 0 -11.9 F0.25/rev
            5 line 15.2 0 -11.9 -> 20 0 5 rapid
            9 spindle stopped
        "#]],
    );
}

#[test]
fn drilling_on_the_face_and_the_side_of_a_lathe() {
    lathe(
        "G21 G18 G98 T0101\nG97 S1000 M3 F100.\nG0 X0 Z5.\nG83 Z-12. R-3. Q5000 P500\nG80\nM29 S500\nG84 Z-8. R-3. F500.\nG80\nG0 X50. Z-10.\nG89 X30. R-3. P250 F80.\nG80\nM30",
        4,
        expect![[r#"
            4 line 0 0 5 -> 0 0 2 rapid
            4 line 0 0 2 -> 0 0 -3 F100/min
            4 line 0 0 -3 -> 0 0 2 rapid
            4 line 0 0 2 -> 0 0 -2 rapid
            4 line 0 0 -2 -> 0 0 -8 F100/min
            4 line 0 0 -8 -> 0 0 2 rapid
            4 line 0 0 2 -> 0 0 -7 rapid
            4 line 0 0 -7 -> 0 0 -12 F100/min
            4 dwell 0.5 s
            4 line 0 0 -12 -> 0 0 5 rapid
            6 spindle cw 500 rpm
            7 line 0 0 5 -> 0 0 2 rapid
            7 line 0 0 2 -> 0 0 -8 thread 1/rev from 0deg
            7 spindle ccw 500 rpm
            7 line 0 0 -8 -> 0 0 2 thread 1/rev on
            7 spindle cw 500 rpm
            7 line 0 0 2 -> 0 0 5 rapid
            9 line 0 0 5 -> 25 0 -10 rapid
            10 line 25 0 -10 -> 22 0 -10 rapid
            10 line 22 0 -10 -> 15 0 -10 F80/min
            10 dwell 0.25 s
            10 line 15 0 -10 -> 22 0 -10 F160/min
            10 line 22 0 -10 -> 25 0 -10 rapid
            12 spindle stopped
        "#]],
    );
}

// ---- milling

#[test]
fn boring_cycles_orient_and_leave_the_wall() {
    mill(
        "G21 G90 G54 T1 M6\nM3 S1000\nG43 H1 Z50.\nG0 X0 Y0 Z10. F100.\nG99 G76 X10. Z-5. R2. Q0.5 P100\nG98 G87 X20. R-20. Z-10. Q3.\nG88 X30. Z-5. R2.\nG80\nM30",
        5,
        expect![[r#"
            5 line 0 0 10 -> 10 0 10 rapid
            5 line 10 0 10 -> 10 0 2 rapid
            5 line 10 0 2 -> 10 0 -5 F100/min
            5 dwell 0.1 s
            5 spindle oriented
            5 line 10 0 -5 -> 10.5 0 -5 rapid
            5 line 10.5 0 -5 -> 10.5 0 2 rapid
            5 line 10.5 0 2 -> 10 0 2 rapid
            5 spindle cw 1000 rpm
            6 line 10 0 2 -> 20 0 2 rapid
            6 spindle oriented
            6 line 20 0 2 -> 23 0 2 rapid
            6 line 23 0 2 -> 23 0 -20 rapid
            6 line 23 0 -20 -> 20 0 -20 rapid
            6 spindle cw 1000 rpm
            6 line 20 0 -20 -> 20 0 -10 F100/min
            6 dwell 0.1 s
            6 spindle oriented
            6 line 20 0 -10 -> 23 0 -10 rapid
            6 line 23 0 -10 -> 23 0 10 rapid
            6 line 23 0 10 -> 20 0 10 rapid
            6 spindle cw 1000 rpm
            7 line 20 0 10 -> 30 0 10 rapid
            7 line 30 0 10 -> 30 0 2 rapid
            7 line 30 0 2 -> 30 0 -5 F100/min
            7 dwell 0.1 s
            7 spindle stopped
            7 message 'take the tool out of the hole by hand'
            7 stop Program
            7 line 30 0 -5 -> 30 0 10 rapid
            7 spindle cw 1000 rpm
            9 spindle stopped
            remark: test.nc:3:8: a move before any G0 or G1: rapid is assumed; write G0 or G1
        "#]],
    );
}

#[test]
fn drilling_goes_along_the_third_axis_of_any_plane() {
    mill(
        "G21 G90 G54 T1 M6\nM3 S1000 F100.\nG0 X0 Y0 Z0\nG18 G99 G81 X5. Z6. Y-8. R-2.\nG80\nG19 G98 G91 G73 Y1. X-7. R-3. Q4. K2\nG80\nM30",
        4,
        expect![[r#"
            4 line 0 0 0 -> 5 0 6 rapid
            4 line 5 0 6 -> 5 -2 6 rapid
            4 line 5 -2 6 -> 5 -8 6 F100/min
            4 line 5 -8 6 -> 5 -2 6 rapid
            6 line 5 -2 6 -> 5 -1 6 rapid
            6 line 5 -1 6 -> 2 -1 6 rapid
            6 line 2 -1 6 -> -2 -1 6 F100/min
            6 line -2 -1 6 -> -1 -1 6 rapid
            6 line -1 -1 6 -> -5 -1 6 F100/min
            6 line -5 -1 6 -> 5 -1 6 rapid
            6 line 5 -1 6 -> 5 0 6 rapid
            6 line 5 0 6 -> 2 0 6 rapid
            6 line 2 0 6 -> -2 0 6 F100/min
            6 line -2 0 6 -> -1 0 6 rapid
            6 line -1 0 6 -> -5 0 6 F100/min
            6 line -5 0 6 -> 5 0 6 rapid
            8 spindle stopped
        "#]],
    );
}

#[test]
fn a_skip_without_a_probe_goes_to_its_end_and_says_so() {
    let program = "G21 G90 G54 T1 M6\nG0 X0 Y0 Z5.\nG31 Z-5. F50.\nG0 Z9.\nM30";
    let ask = |answer: Answer| {
        let mut stream = open_with(program.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("it opens");
        let (mut reply, mut moves) = (None, Vec::new());
        loop {
            match stream.next(reply.take()) {
                Next::Step(step) => {
                    if let StepKind::Move(m) = step.kind {
                        moves.push(m.path.end().xyz[2]);
                    }
                }
                Next::Ask(question) => {
                    assert!(matches!(question, Question::Skip { to, .. } if to.xyz == [0.0, 0.0, -5.0]));
                    reply = Some(answer);
                }
                Next::End => break,
                Next::Alarm(alarm) => panic!("{alarm}"),
            }
        }
        let codes: Vec<_> = stream.diagnostics().iter().map(|d| d.code).collect();
        (moves, codes)
    };
    assert_eq!(ask(Answer::Unknown), (vec![5.0, -5.0, 9.0], vec!["skip-no-probe"]));
    assert_eq!(ask(Answer::Place(None)), (vec![5.0, -5.0, 9.0], vec!["skip-no-signal"]));
    let touched = Answer::Place(Some(Point::new(0.0, 0.0, -1.25)));
    assert_eq!(ask(touched), (vec![5.0, -1.25, 9.0], vec![]));
}

// ---- corners

#[test]
fn corners_are_rounded_and_chamfered_between_straight_moves() {
    mill(
        "G21 G90 G54 T1 M6\nM3 S1000 F100.\nG0 X0 Y0 Z0\nG1 X20. ,R5.\nY20. ,C3.\nX40.\nM30",
        4,
        expect![[r#"
            4 line 0 0 0 -> 15 0 0 F100/min
            4 arc 15 0 0 -> 20 5 0 r5 90deg about Z F100/min
            5 line 20 5 0 -> 20 17 0 F100/min
            5 line 20 17 0 -> 23 20 0 F100/min
            6 line 23 20 0 -> 40 20 0 F100/min
            7 spindle stopped
        "#]],
    );
}

#[test]
fn a_lathe_writes_corners_without_a_comma_too_and_compensation_follows_them() {
    expect![[r#"
        4 line 15 0 5 -> 10 0 1.2 rapid
        5 line 10 0 1.2 -> 10 0 -8.8 F0.1/rev
        5 arc 10 0 -8.8 -> 11.2 0 -10 r1.2 -90deg about Y F0.1/rev
        6 line 11.2 0 -10 -> 13.5314 0 -10 F0.1/rev
        6 line 13.5314 0 -10 -> 15 0 -11.4686 F0.1/rev
        7 line 15 0 -11.4686 -> 15 0 -20.8 F0.1/rev
        8 line 15 0 -20.8 -> 25 0 5 rapid
        9 spindle stopped
    "#]]
    .assert_eq(&told(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X30. Z5.\nG42 X20. Z2.\nG1 Z-10. R2.\nX30. C1.\nZ-20.\nG40 G0 X50. Z5.\nM30",
        "fanuc-lathe",
        lathe_with_nose(0.8, 3),
        4,
    ));
}

// ---- compensation

#[test]
fn g41_goes_round_a_square_from_outside() {
    // D2 is 4 mm; a square of 20 mm gone round clockwise has its outside to the left.
    mill(
        "G21 G90 G54 T2 M6\nM3 S1000 F100.\nG0 X-20. Y0 Z0\nG41 D2 G1 X0\nY20.\nX20.\nY0\nX0\nG40 X-20.\nM30",
        4,
        expect![[r#"
            4 line -20 0 0 -> -4 0 0 F100/min
            5 line -4 0 0 -> -4 24 0 F100/min
            6 line -4 24 0 -> 24 24 0 F100/min
            7 line 24 24 0 -> 24 -4 0 F100/min
            8 line 24 -4 0 -> 0 -4 0 F100/min
            9 line 0 -4 0 -> -20 0 0 F100/min
            10 spindle stopped
        "#]],
    );
}

#[test]
fn g42_inside_meets_at_the_corners_and_follows_arcs() {
    mill(
        "G21 G90 G54 T2 M6\nM3 S1000 F100.\nG0 X20. Y15. Z5.\nG42 D2 G1 X20. Y0\nZ-1.\nX0 Y0\nY20.\nG2 X10. Y30. R10.\nG1 X40.\nY0\nX20.\nG40 Y15.\nM30",
        4,
        expect![[r#"
            4 line 20 15 5 -> 20 4 5 F100/min
            5 line 20 4 5 -> 20 4 -1 F100/min
            6 line 20 4 -1 -> 4 4 -1 F100/min
            7 line 4 4 -1 -> 4 20 -1 F100/min
            8 arc 4 20 -1 -> 10 26 -1 r6 -90deg about Z F100/min
            9 line 10 26 -1 -> 36 26 -1 F100/min
            10 line 36 26 -1 -> 36 4 -1 F100/min
            11 line 36 4 -1 -> 20 4 -1 F100/min
            12 line 20 4 -1 -> 20 15 -1 F100/min
            13 spindle stopped
        "#]],
    );
}

#[test]
fn a_sharp_outer_corner_is_gone_round_by_two_places() {
    mill(
        "G21 G90 G54 T2 M6\nM3 S1000 F100.\nG0 X-10. Y-10. Z0\nG41 D2 G1 X0 Y0\nX20.\nX0 Y-10.\nG40 X-10. Y-30.\nM30",
        4,
        expect![[r#"
            4 line -10 -10 0 -> 0 4 0 F100/min
            5 line 0 4 0 -> 24 4 0 F100/min
            6 line 24 4 0 -> 25.3666 -1.7889 0 F100/min
            6 line 25.3666 -1.7889 0 -> 1.7889 -13.5777 0 F100/min
            7 line 1.7889 -13.5777 0 -> -10 -30 0 F100/min
            8 spindle stopped
        "#]],
    );
}

#[test]
fn the_nose_of_a_turning_tool_touches_taper_and_fillet() {
    // R 0.8, T 3, G42: the chuck lies to the left.
    expect![[r#"
        3 line 130 0 220 -> 15 0 5 rapid
        4 line 15 0 5 -> 10 0 0.2 rapid
        5 line 10 0 0.2 -> 10 0 -10.4686 F0.1/rev
        6 line 10 0 -10.4686 -> 15 0 -15.4686 F0.1/rev
        7 line 15 0 -15.4686 -> 15 0 -20.8 F0.1/rev
        8 arc 15 0 -20.8 -> 17.2 0 -23 r2.2 -90deg about Y F0.1/rev
        9 line 17.2 0 -23 -> 20.2 0 -23 F0.1/rev
        10 line 20.2 0 -23 -> 25 0 5 rapid
        11 spindle stopped
    "#]].assert_eq(&told(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X30. Z5.\nG42 X20. Z1.\nG1 Z-10.\nX30. Z-15.\nZ-20.\nG2 X36. Z-23. R3.\nG1 X42.\nG40 G0 X50. Z5.\nM30",
        "fanuc-lathe",
        lathe_with_nose(0.8, 3),
        3,
    ));
}

#[test]
fn g70_finishes_beside_the_contour() {
    expect![[r#"
        4 line 25 0 5 -> 10 0 4.2 rapid
        4 line 10 0 4.2 -> 10 0 -10.4686 F0.08/rev
        4 line 10 0 -10.4686 -> 14.7657 0 -15.2343 F0.08/rev
        4 line 14.7657 0 -15.2343 -> 21 0 -15 F0.08/rev
        4 line 21 0 -15 -> 25 0 5 rapid
        5 machine X0 Z0
        6 spindle stopped
    "#]].assert_eq(&told(
        "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X50. Z5.\nG70 P10 Q40\nG28 U0 W0\nM30\nN10 G42 G0 X20.\nN20 G1 Z-10. F0.08\nN30 X30. Z-15.\nN40 G40 X42.",
        "fanuc-lathe",
        lathe_with_nose(0.8, 3),
        4,
    ));
}

#[test]
fn what_cannot_be_is_an_alarm_with_its_number() {
    let lathe_head = "G21 G18 G99 T0101\nG97 S1000 M3 F0.1\nG0 X40. Z2.\n";
    let mill_head = "G21 G90 G54 T2 M6\nM3 S1000 F100.\nG0 X0 Y0 Z0\n";
    let mut all = String::new();
    for (dialect, head, text) in [
        ("fanuc-lathe", lathe_head, "G71 U0 R1."),
        ("fanuc-lathe", lathe_head, "G71 U2. R1.\nG71 P10 U0.4"),
        ("fanuc-lathe", lathe_head, "G71 U2. R1.\nG71 P10 Q20"),
        ("fanuc-lathe", lathe_head, "G71 U2. R1.\nG71 P10 Q20\nN10 G1 Z5.\nN20 X30."),
        (
            "fanuc-lathe",
            lathe_head,
            "G71 U2. R1.\nG71 P10 Q30\nN10 G1 X20.\nN20 Z-5.\nN25 X15. Z-9.\nN30 X42.",
        ),
        (
            "fanuc-lathe",
            lathe_head,
            "G71 U2. R1.\nG71 P10 Q30\nN10 G1 X20.\nN20 Z-5.\nN25 M98 P1\nN30 X42.",
        ),
        ("fanuc-lathe", lathe_head, "G73 U2. W1. R0"),
        ("fanuc-lathe", lathe_head, "G74 Z-5. Q0"),
        ("fanuc-lathe", lathe_head, "G75 X10. Z-5. P1000"),
        ("fanuc-lathe", lathe_head, "G76 P021061 Q100 R0.1"),
        ("fanuc-lathe", lathe_head, "G76 X30. Z-5. P0 Q100 F1."),
        ("fanuc-lathe", lathe_head, "M5\nG92 X30. Z-5. F1."),
        ("fanuc-mill", mill_head, "G83 Z-5. R1. Q0"),
        ("fanuc-mill", mill_head, "G76 Z-5. R1."),
        ("fanuc-mill", mill_head, "G83 Z-900. R1. Q0.0001"),
        ("fanuc-mill", mill_head, "G41 D2 G2 X5. Y5. R5."),
        ("fanuc-mill", mill_head, "G41 D2 G1 X5.\nG1 X50.\nG3 X53. Y3. R3.\nG1 Y9."),
        ("fanuc-mill", mill_head, "G42 D2 G1 X5.\nG1 X50.\nY-3.\nX40.\nY9."),
        ("fanuc-mill", mill_head, "G41 D2 G1 X5.\nG31 X9."),
        ("fanuc-mill", mill_head, "G1 X5. ,R2.\nM8\nY5."),
        ("fanuc-mill", mill_head, "G1 X5. ,R2.\nG2 X9. Y4. R4."),
        ("fanuc-mill", mill_head, "G1 X5. ,C6.\nY9."),
        ("fanuc-mill", mill_head, "G41 D2 G1 X5.\nG18 X9."),
    ] {
        let (tables, program) = match dialect {
            "fanuc-lathe" => (lathe_with_nose(0.0, 3), format!("{head}{text}\nM30")),
            _ => (mill_tables(), format!("{head}{text}\nM30")),
        };
        all += &format!(
            "{}\n  {}\n",
            text.replace('\n', " | "),
            told(&program, dialect, tables, 999).trim_end()
        );
    }
    expect![[r#"
        G71 U0 R1.
          alarm 62: error: test.nc:4:5: the depth of cut of G71 is 0 mm: it must be above 0; write it without sign
        G71 U2. R1. | G71 P10 U0.4
          alarm 61: error: test.nc:5:1: G71 needs P and Q, the first and the last block of its contour; write the sequence numbers: P10 Q20
        G71 U2. R1. | G71 P10 Q20
          alarm 63: error: test.nc:5:1: G71 looks for block N10, which is not in this program; correct P and Q, or number the blocks of the contour
        G71 U2. R1. | G71 P10 Q20 | N10 G1 Z5. | N20 X30.
          alarm 65: error: test.nc:6:1: the first block of the contour of G71 must be a G0 or G1 that names X; begin the contour with the way from the start point to its first point
        G71 U2. R1. | G71 P10 Q30 | N10 G1 X20. | N20 Z-5. | N25 X15. Z-9. | N30 X42.
          alarm 64: error: test.nc:5:1: the contour of G71 turns back along X; name both axes in its first block (type II) for pockets; along the cuts it may never turn back
        G71 U2. R1. | G71 P10 Q30 | N10 G1 X20. | N20 Z-5. | N25 M98 P1 | N30 X42.
          alarm 66: error: test.nc:8:1: a call or the program's end inside a contour; check Q, the last block of the contour
        G73 U2. W1. R0
          alarm 62: error: test.nc:4:13: G73 with no pass at all; correct R
        G74 Z-5. Q0
          alarm 62: error: test.nc:4:1: G74 without Q, the depth of a peck, or with Q0; write the depth of a peck; without a point it counts least increments
        G75 X10. Z-5. P1000
          alarm 62: error: test.nc:4:1: G75 goes across and has no Q, the way from column to column; write it, or leave the other axis out
        G76 P021061 Q100 R0.1
          alarm 62: error: test.nc:4:5: 61 is no angle of a thread tool that G76 knows; write 80, 60, 55, 30, 29 or 0
        G76 X30. Z-5. P0 Q100 F1.
          alarm 62: error: test.nc:4:15: the depth of the thread is 0 mm: it must be above 0; correct it; P and Q without a point count least increments
        M5 | G92 X30. Z-5. F1.
          error: test.nc:5:5: a thread while the spindle stands: the axes would never move; start the spindle with G97 S and M3 or M4 first
        G83 Z-5. R1. Q0
          alarm 45: error: test.nc:4:5: G83 without Q; add Q, the depth of a peck
        G76 Z-5. R1.
          alarm 45: error: test.nc:4:5: G76 without Q; add Q, the way off the wall
        G83 Z-900. R1. Q0.0001
          error: test.nc:4:5: pecks of 0.0001 mm are too many for a hole of 901.000 mm; check Q
        G41 D2 G2 X5. Y5. R5.
          alarm 34: error: test.nc:4:1: cutter compensation is begun with an arc; begin and cancel it with a straight move (G0, G1)
        G41 D2 G1 X5. | G1 X50. | G3 X53. Y3. R3. | G1 Y9.
          alarm 41: error: test.nc:6:1: an arc of radius 3.0000 mm is too small for a tool of radius 4.0000 mm on its inner side; use a smaller tool, or check the radius in the offset table
        G42 D2 G1 X5. | G1 X50. | Y-3. | X40. | Y9.
          alarm 41: error: test.nc:7:1: the offset path of the move before this one would run backwards: the tool is too large for it; use a smaller tool, or check the radius in the offset table
        G41 D2 G1 X5. | G31 X9.
          alarm 36: error: test.nc:5:1: G31 while cutter compensation is in force; cancel it with G40 first
        G1 X5. ,R2. | M8 | Y5.
          alarm 51: error: test.nc:5:1: no straight move follows a corner at once; let the next block be the G1 that the corner leads to
        G1 X5. ,R2. | G2 X9. Y4. R4.
          alarm 52: error: test.nc:5:1: an arc follows a corner; put corners between straight moves only
        G1 X5. ,C6. | Y9.
          alarm 55: error: test.nc:5:1: a move of 5.0000 mm is too short for a corner that takes 6.0000 mm of it; make the corner smaller
        G41 D2 G1 X5. | G18 X9.
          alarm 37: error: test.nc:5:1: the plane changes while cutter compensation is in force; cancel with G40 first
    "#]].assert_eq(&all);
}

// ---- offsets

#[test]
fn g10_writes_a_lathes_offset_and_compensation_follows_it() {
    // Geometry of offset 1: X 50 mm as a diameter, nose 0.8, direction 3; then wear: 0.2 more on the nose.
    let program = "G21 G18 G99\nG10 P10001 X50. Z30. R0.8 Q3\nG10 P1 U0.1 R0.2\nT0101\nG97 S1000 M3 F0.1\nG0 X30. Z5.\nG42 X20. Z2.\nG1 Z-10.\nG40 G0 X50.\nM30";
    let told = told(program, "fanuc-lathe", lathe_tables(), 4);
    let kept: Vec<&str> = told
        .lines()
        .filter(|l| l.contains("geometry") || l.starts_with("8 "))
        .collect();
    assert_eq!(
        kept,
        [
            "4 tool offset 1 geometry 25 0 30 wear 0.05 0 0",
            // The centre of a nose of 1 mm runs at X 22; its tip at X 20, 1 mm short of Z -10 until the nose is square to the end.
            "8 line 10 0 1 -> 10 0 -11 F0.1/rev",
        ]
    );
}

#[test]
fn the_station_may_choose_the_geometry() {
    let offset = |geometry_by_station: bool| {
        let options = Options {
            geometry_by_station,
            ..Options::default()
        };
        let program = b"G21 G18 G99\nT0103\nM30";
        let mut stream = open_with(program, "fanuc-lathe", lathe_tables(), options).expect("it opens");
        let (steps, alarm) = run(&mut stream);
        assert_eq!(alarm, None);
        steps
            .iter()
            .find_map(|s| match s.kind {
                StepKind::ToolOffset(o) => Some((o.geometry.xyz[0], o.wear.xyz[0])),
                _ => None,
            })
            .expect("an offset")
    };
    // Tool 1 has a geometry of X 20, tool 3 of X 22 and a wear of -0.05.
    assert_eq!(offset(false), (22.0, -0.05));
    assert_eq!(offset(true), (20.0, -0.05));
}

#[test]
fn ten_thousand_holes_are_told_one_after_the_other() {
    let program = "G21 G90 G54 T1 M6\nM3 S1000 F100.\nG0 X0 Y0 Z5.\nG91 G99 G81 X0.01 R-4. Z-2. K9999\nM30";
    let mut stream = open_with(program.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("it opens");
    let (steps, alarm) = run(&mut stream);
    assert_eq!(alarm, None);
    let moves = steps.iter().filter(|s| matches!(s.kind, StepKind::Move(_))).count();
    // The way there, then over, down and up for each; the first goes down to R as well.
    assert_eq!(moves, 1 + 9999 * 3 + 1);
}

// ---- threads of RS274

#[track_caller]
fn rs274(program: &str, from: u32, expected: Expect) {
    expected.assert_eq(&told(program, "rs274", mill_tables(), from));
}

#[test]
fn k_of_g33_is_the_way_along_the_path_in_a_revolution_and_a_second_thread_follows_on() {
    rs274(
        "G21 G90 G17\nS500 M3\nG0 X0 Y0 Z2\nG33 Z-10 K1.5\nX2 Z-12 K1.5\nG0 Z5\nM2",
        4,
        expect![[r#"
            4 line 0 0 2 -> 0 0 -10 thread 1.5/rev from 0deg
            5 line 0 0 -10 -> 2 0 -12 thread 1.5/rev on
            6 line 2 0 -12 -> 2 0 5 rapid
            7 spindle stopped
        "#]],
    );
}

#[test]
fn g33_1_goes_in_and_comes_out_with_the_spindle_turned_round() {
    rs274(
        "G20 G90 G17\nS500 M4\nG0 X0 Y0 Z0.1\nG33.1 Z-0.5 K0.05\nX1 Z-0.5 K0.05\nG0 Z0.2\nM2",
        4,
        expect![[r#"
            4 line 0 0 2.54 -> 0 0 -12.7 thread 1.27/rev from 0deg
            4 spindle cw 500 rpm
            4 line 0 0 -12.7 -> 0 0 2.54 thread 1.27/rev on
            4 spindle ccw 500 rpm
            5 line 0 0 2.54 -> 25.4 0 -12.7 thread 1.27/rev from 0deg
            5 spindle cw 500 rpm
            5 line 25.4 0 -12.7 -> 0 0 2.54 thread 1.27/rev on
            5 spindle ccw 500 rpm
            6 line 0 0 2.54 -> 0 0 5.08 rapid
            7 spindle stopped
        "#]],
    );
}

#[test]
fn a_thread_of_rs274_without_lead_way_or_spindle_is_refused() {
    rs274(
        "G21 G90\nS500 M3\nG0 Z2\nG33 Z-10\nM2",
        4,
        expect![[r#"
        error: test.nc:4:5: a thread without K, the way in a revolution; add K, the way in a revolution
    "#]],
    );
    rs274(
        "G21 G90\nS500 M3\nG0 Z2\nG33.1 Z-10 K0\nM2",
        4,
        expect![[r#"
        error: test.nc:4:12: a thread without a lead; write a K above 0
    "#]],
    );
    rs274(
        "G21 G90\nG0 Z2\nG33.1 Z-10 K1\nM2",
        3,
        expect![[r#"
        error: test.nc:3:7: a thread while the spindle stands: the axes would never move; start the spindle with G97 S and M3 or M4 first
    "#]],
    );
    rs274(
        "G21 G90\nS500 M3\nG0 Z2\nG33.1 Z2 K1\nM2",
        4,
        expect![[r#"
        error: test.nc:4:7: G33.1 without a way to go; write the bottom of the hole
    "#]],
    );
}
