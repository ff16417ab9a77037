//! Small programs and the steps they make, written out: the diff of a change here is the documentation of the change.

mod common;

use common::{lathe_tables, listing, mill_tables, open_with, run};
use expect_test::{Expect, expect};
use gcode::Options;
use plan::Tables;
use units::{Point, Transform, Vector};

#[track_caller]
fn mill(program: &str, expected: Expect) {
    expected.assert_eq(&listing(program, "fanuc-mill", mill_tables(), Options::default()));
}

#[track_caller]
fn lathe(program: &str, expected: Expect) {
    expected.assert_eq(&listing(program, "fanuc-lathe", lathe_tables(), Options::default()));
}

#[track_caller]
fn rs274(program: &str, expected: Expect) {
    expected.assert_eq(&listing(program, "rs274", mill_tables(), Options::default()));
}

#[track_caller]
fn bare(program: &str, expected: Expect) {
    expected.assert_eq(&listing(program, "fanuc-mill", Tables::empty(), Options::default()));
}

#[test]
fn a_small_milling_program_from_tool_change_to_end() {
    mill(
        "%\r\nO1001(PLATE)\r\nN1 G21 G17 G40 G49 G80 G90\r\n( 10 MM END MILL )\r\n( POCKET )\r\nN2 T1\r\nN3 G91 G28 Z0 M6\r\nN4 T2 M01\r\nN5 M8\r\nN6 G0 G90 G54 X10. Y5. S3000 M3\r\nN7 G43 H1 Z20.\r\nN8 G1 Z-2. F200.\r\nN9 X30. F400.\r\nN10 G2 X40. Y15. I0 J10.\r\nN11 G3 X40. Y15. Z-4. I5.\r\nN12 G4 P500\r\nN13 G0 Z20. M9\r\nN14 G53 Z0\r\nN15 G55 X0 Y0\r\nN16 M30\r\n%\r\n",
        expect![[r#"
            - begin Program 'O1001 PLATE'
            - frame G54 at -300 -200 -400
            7 machine Z0
            7 begin Workingstep 'T1 10 MM END MILL' derived
            7 tool 1 '10 MM END MILL'
            8 stop Optional
            9 coolant flood
            10 spindle cw 3000 rpm
            10 line 300 200 400 -> 10 5 400 rapid
            11 tool offset 1 geometry 0 0 100 wear 0 0 0
            11 line 10 5 300 -> 10 5 20 rapid
            12 line 10 5 20 -> 10 5 -2 F200/min
            13 line 10 5 -2 -> 30 5 -2 F400/min
            14 arc 30 5 -2 -> 40 15 -2 r10 -270deg about Z F400/min
            15 arc 40 15 -2 -> 40 15 -4 r5 360deg about Z F400/min
            16 dwell 0.5 s
            17 coolant off
            17 line 40 15 -4 -> 40 15 20 rapid
            18 machine Z0
            19 frame G55 at -100 -200 -400
            19 line -160 15 300 -> 0 0 300 rapid
            20 spindle stopped
            20 end Workingstep
            20 end Program
        "#]],
    );
}

#[test]
fn arcs_by_radius_in_all_planes() {
    mill(
        "G21 G90 G54 G0 X0 Y0 Z0 F100.\nG17 G2 X10. Y10. R10.\nG3 X0 Y0 R-10.\nG18 G3 X10. Z10. R10.\nG19 G2 Y10. Z0 R10. X5.\nM30",
        expect![[r#"
            - begin Program 'test.nc'
            - frame G54 at -300 -200 -400
            1 begin Workingstep 'test.nc' derived
            1 line 300 200 400 -> 0 0 0 rapid
            2 arc 0 0 0 -> 10 10 0 r10 -90deg about Z F100/min
            3 arc 10 10 0 -> 0 0 0 r10 270deg about Z F100/min
            4 arc 0 0 0 -> 10 0 10 r10 90deg about Y F100/min
            5 arc 10 0 10 -> 5 10 0 r10 -90deg about X F100/min
            6 end Workingstep
            6 end Program
        "#]],
    );
}

#[test]
fn drilling_cycles_hole_by_hole() {
    mill(
        "G21 G90 G54 T1 M6\nM3 S1000\nG43 H1 Z50.\nG0 X0 Y0 Z10.\nG99 G81 Z-5. R2. F100.\nX10.\nG98 X20.\nG80\nG83 G99 X30. Z-5. R1. Q3.\nG80\nG73 X40. Z-5. R1. Q3.\nG82 X50. P250\nG85 X60. Z-3.\nG86 X65.\nG80\nG91 G81 X10. Y5. Z-4. R-8. K2\nG80 G90\nM29 S500\nG84 G99 X70. Z-6. R3. F500.\nG80\nM30",
        expect![[r#"
            - begin Program 'test.nc'
            - frame G54 at -300 -200 -400
            1 begin Workingstep 'T1' derived
            1 tool 1 ''
            2 spindle cw 1000 rpm
            3 tool offset 1 geometry 0 0 100 wear 0 0 0
            3 line 300 200 300 -> 300 200 50 rapid
            4 line 300 200 50 -> 0 0 10 rapid
            5 line 0 0 10 -> 0 0 2 rapid
            5 line 0 0 2 -> 0 0 -5 F100/min
            5 line 0 0 -5 -> 0 0 2 rapid
            6 line 0 0 2 -> 10 0 2 rapid
            6 line 10 0 2 -> 10 0 -5 F100/min
            6 line 10 0 -5 -> 10 0 2 rapid
            7 line 10 0 2 -> 20 0 2 rapid
            7 line 20 0 2 -> 20 0 -5 F100/min
            7 line 20 0 -5 -> 20 0 10 rapid
            9 line 20 0 10 -> 30 0 10 rapid
            9 line 30 0 10 -> 30 0 1 rapid
            9 line 30 0 1 -> 30 0 -2 F100/min
            9 line 30 0 -2 -> 30 0 1 rapid
            9 line 30 0 1 -> 30 0 -1 rapid
            9 line 30 0 -1 -> 30 0 -5 F100/min
            9 line 30 0 -5 -> 30 0 1 rapid
            11 line 30 0 1 -> 40 0 1 rapid
            11 line 40 0 1 -> 40 0 -2 F100/min
            11 line 40 0 -2 -> 40 0 -1 rapid
            11 line 40 0 -1 -> 40 0 -5 F100/min
            11 line 40 0 -5 -> 40 0 1 rapid
            12 line 40 0 1 -> 50 0 1 rapid
            12 line 50 0 1 -> 50 0 -5 F100/min
            12 dwell 0.25 s
            12 line 50 0 -5 -> 50 0 1 rapid
            13 line 50 0 1 -> 60 0 1 rapid
            13 line 60 0 1 -> 60 0 -3 F100/min
            13 line 60 0 -3 -> 60 0 1 F100/min
            14 line 60 0 1 -> 65 0 1 rapid
            14 line 65 0 1 -> 65 0 -3 F100/min
            14 spindle stopped
            14 line 65 0 -3 -> 65 0 1 rapid
            14 spindle cw 1000 rpm
            16 line 65 0 1 -> 75 5 1 rapid
            16 line 75 5 1 -> 75 5 -7 rapid
            16 line 75 5 -7 -> 75 5 -11 F100/min
            16 line 75 5 -11 -> 75 5 -7 rapid
            16 line 75 5 -7 -> 85 10 -7 rapid
            16 line 85 10 -7 -> 85 10 -11 F100/min
            16 line 85 10 -11 -> 85 10 -7 rapid
            18 spindle cw 500 rpm
            19 line 85 10 -7 -> 70 10 -7 rapid
            19 line 70 10 -7 -> 70 10 3 rapid
            19 line 70 10 3 -> 70 10 -6 thread 1/rev from 0deg
            19 spindle ccw 500 rpm
            19 line 70 10 -6 -> 70 10 3 thread 1/rev on
            19 spindle cw 500 rpm
            21 spindle stopped
            21 end Workingstep
            21 end Program
            remark: test.nc:3:8: a move before any G0 or G1: rapid is assumed; write G0 or G1
        "#]],
    );
}

#[test]
fn offsets_change_the_frame_and_move_nothing() {
    mill(
        "G21 G90 G54 G0 X1. Y2. Z3.\nG10 L2 P1 X-310.\nG91 G10 L2 P1 Z-1.\nG90 G10 L2 P2 X5.\nG52 X10.\nG0 X0\nG52 X0\nG92 X100.\nX101.\nG43 H2\nZ0\nG44 H2\nZ0\nG49\n#5221=-300.\nX0\n#100=#5221+#5242\nG0 Y#100\nM30",
        expect![[r#"
            - begin Program 'test.nc'
            - frame G54 at -300 -200 -400
            1 begin Workingstep 'test.nc' derived
            1 line 300 200 400 -> 1 2 3 rapid
            2 register G54 X Some("-300") -> Some("-310")
            2 frame G54 at -310 -200 -400
            3 register G54 Z Some("-400") -> Some("-401")
            3 frame G54 at -310 -200 -401
            4 register G55 X Some("-100") -> Some("5")
            5 frame G54 G52 at -300 -200 -401
            6 line 1 2 4 -> 0 2 4 rapid
            7 frame G54 at -310 -200 -401
            8 frame G54 G92 at -400 -200 -401
            9 line 100 2 4 -> 101 2 4 rapid
            10 tool offset 2 geometry 0 0 80 wear 0 0 0
            11 line 101 2 -76 -> 101 2 0 rapid
            12 tool offset 2 geometry 0 0 -80 wear 0 0 0
            13 line 101 2 160 -> 101 2 0 rapid
            14 tool offset 0 geometry 0 0 0 wear 0 0 0
            15 register G54 X Some("-310") -> Some("-300")
            15 frame G54 G92 at -390 -200 -401
            16 line 91 2 -80 -> 0 2 -80 rapid
            18 line 0 2 -80 -> 0 -500 -80 rapid
            19 end Workingstep
            19 end Program
            warning: test.nc:15:1: #5221 is used while earlier moves may be under way: controls that read ahead do it too early; put G53, G31 or an M code that stops the read-ahead before it
        "#]],
    );
}

#[test]
fn a_missing_table_entry_is_assumed_and_said() {
    bare(
        "T7 M6\nG0 X1.\nG43 H7 Z5.\nG56 X0\nG41 D7\nM30",
        expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at 0 0 0 assumed
        1 begin Workingstep 'T7' derived
        1 tool 7 ''
        2 line 0 0 0 -> 1 0 0 rapid
        3 tool offset 7 geometry 0 0 0 wear 0 0 0 assumed
        3 line 1 0 0 -> 1 0 5 rapid
        4 frame G56 at 0 0 0 assumed
        4 line 1 0 5 -> 0 0 5 rapid
        6 end Workingstep
        6 end Program
        warning: test.nc:1:4: tool 7 is not in the tables: a tool of that number is assumed; enter it before cutting
        remark: test.nc:2:4: neither G20 nor G21 before the first move: millimetres are assumed; write G21 or G20
        warning: test.nc:2:4: work offset G54 is not in the tables: the machine's zero is assumed (2 times); enter it before cutting
        warning: test.nc:3:5: tool length H7 is not in the tables: length 0 is assumed; enter it before cutting
        warning: test.nc:5:1: tool radius D7 is not in the tables: radius 0 is assumed; enter it before cutting
        remark: test.nc:5:1: cutter compensation with radius 0: the programmed path is the path
    "#]],
    );
}

#[test]
fn a_missing_table_entry_alarms_where_nothing_may_be_assumed() {
    mill(
        "G21\nT7 M6\nM30",
        expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        error: test.nc:2:4: tool 7 is not in the tables; enter it first
    "#]],
    );
    mill(
        "G21 G0 X0\nG43 H9 Z1.\nM30",
        expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        1 begin Workingstep 'test.nc' derived
        1 line 300 200 400 -> 0 200 400 rapid
        error: test.nc:2:5: tool length H9 is not in the tables; enter it first
    "#]],
    );
    mill(
        "G21 G0 X0\nG57 X1.\nM30",
        expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        1 begin Workingstep 'test.nc' derived
        1 line 300 200 400 -> 0 200 400 rapid
        error: test.nc:2:1: work offset G57 is not in the tables; enter it first
    "#]],
    );
}

#[test]
fn a_turning_program_in_diameters() {
    lathe(
        "O20(SHAFT)\n(OD TOOL)\nT0101\nG21 G50 S2500\nG96 S200 M3\nG0 X42. Z2. M8\nG99 G1 Z-30. F0.25\nU2. W-1.\nG0 X50. Z2.\nG2 X60. Z-3. R5.\nG3 X70. Z-8. I0 K-5.\nG97 S800\nG98 G1 X72. F100.\nT0103\nG28 U0 W0\nT0303 (FINISH)\nG4 X1.5\nG4 P250\nG0 X40. Z1.\nT0300\nM5\nM9\nM30",
        expect![[r#"
            - begin Program 'O0020 SHAFT'
            - frame G54 at -150 0 -250
            3 begin Workingstep 'T1 OD TOOL' derived
            3 tool 1 'OD TOOL'
            3 tool offset 1 geometry 20 0 30 wear 0 0 0
            5 spindle cw 3333.3333 mm/s up to 2500 rpm
            6 coolant flood
            6 line 130 0 220 -> 21 0 2 rapid
            7 line 21 0 2 -> 21 0 -30 F0.25/rev
            8 line 21 0 -30 -> 22 0 -31 F0.25/rev
            9 line 22 0 -31 -> 25 0 2 rapid
            10 arc 25 0 2 -> 30 0 -3 r5 -90deg about Y F0.25/rev
            11 arc 30 0 -3 -> 35 0 -8 r5 90deg about Y F0.25/rev
            12 spindle cw 800 rpm
            13 line 35 0 -8 -> 36 0 -8 F100/min
            14 tool offset 3 geometry 22 0 33 wear -0.05 0 0
            15 machine X0 Z0
            16 end Workingstep
            16 begin Workingstep 'T3 FINISH' derived
            16 tool 3 'FINISH'
            17 dwell 1.5 s
            18 dwell 0.25 s
            19 line 128.05 0 217 -> 20 0 1 rapid
            20 tool offset 0 geometry 0 0 0 wear 0 0 0
            21 spindle stopped
            22 coolant off
            23 end Workingstep
            23 end Program
        "#]],
    );
}

#[test]
fn rs274_has_its_own_seconds_tolerance_and_messages() {
    rs274(
        "(MSG, load the blank)\nG21 G90 G64 P0.02\nT1 M6\nG43\nS1000 M3\nG0 X0 Y0 Z5\nG4 P0.5\nG61 G1 X10 F100\nG61.1 X11\nG93 X20 F2\nG94 F100\nG90.1 G2 X0 Y0 I10 J0\nG91.1 G3 X0 Y0 Z-2 I5 P2\nG53 G0 Z0\n#1=5\nG0 X#1 Z#2\nM2",
        expect![[r#"
            - begin Program 'test.nc'
            - frame G54 at -300 -200 -400
            1 message 'load the blank'
            2 path within 0.02
            3 begin Workingstep 'T1' derived
            3 tool 1 ''
            4 tool offset 1 geometry 0 0 100 wear 0 0 0
            5 spindle cw 1000 rpm
            6 line 300 200 300 -> 0 0 5 rapid
            7 dwell 0.5 s
            8 path exact
            8 line 0 0 5 -> 10 0 5 F100/min
            9 path exact stop
            9 line 10 0 5 -> 11 0 5 F100/min
            10 line 11 0 5 -> 20 0 5 in 30 s
            12 arc 20 0 5 -> 0 0 5 r10 -180deg about Z F100/min
            13 arc 0 0 5 -> 0 0 -2 r5 720deg about Z F100/min
            14 machine Z0
            16 line 0 0 300 -> 5 0 0 rapid
            17 spindle stopped
            17 end Workingstep
            17 end Program
        "#]],
    );
}

#[test]
fn variables_in_words_and_stops() {
    mill(
        "#1=1.2345\n#2=#0\nG21 G90 G0 X-#1 Y#2\nG1 Z[#1*2] F[100+#1]\n/G1 X5.\nM0\nM1\n#3006=1(CHECK THE CLAMP)\n#3000=12(WRONG PART)\nM30",
        expect![[r#"
            - begin Program 'test.nc'
            - frame G54 at -300 -200 -400
            3 begin Workingstep 'test.nc' derived
            3 line 300 200 400 -> -1.235 200 400 rapid
            4 line -1.235 200 400 -> -1.235 200 2.469 F101.2345/min
            5 line -1.235 200 2.469 -> 5 200 2.469 F101.2345/min
            6 stop Program
            7 stop Optional
            8 message 'CHECK THE CLAMP'
            8 stop Program
            alarm 3012: error: test.nc:9:1: WRONG PART; the program itself says so
        "#]],
    );
}

#[test]
fn blocks_behind_a_skip_switch_that_is_on_are_left_out_macro_statements_too() {
    let options = Options {
        block_skip: 0b10,
        ..Options::default()
    };
    let program = "G21 G0 X0\n/2 #1=9\n/ X1.\n/2 X2.\nX3. /2 Y5.\nZ#1\nM30";
    expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        1 begin Workingstep 'test.nc' derived
        1 line 300 200 400 -> 0 200 400 rapid
        3 line 0 200 400 -> 1 200 400 rapid
        5 line 1 200 400 -> 3 200 400 rapid
        7 end Workingstep
        7 end Program
    "#]]
    .assert_eq(&listing(program, "fanuc-mill", mill_tables(), options));
}

#[test]
fn a_leader_and_a_byte_order_mark_are_no_part_of_the_program() {
    mill(
        "PROGRAM FOR MACHINE 7, SHIFT 2\n%\nO5\nG21 G0 X0\nM30\n%\nafter the end",
        expect![[r#"
            - begin Program 'O0005'
            - frame G54 at -300 -200 -400
            4 begin Workingstep 'O0005' derived
            4 line 300 200 400 -> 0 200 400 rapid
            5 end Workingstep
            5 end Program
        "#]],
    );
    mill(
        "\u{feff}G21 G0 X0\nM30",
        expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        1 begin Workingstep 'test.nc' derived
        1 line 300 200 400 -> 0 200 400 rapid
        2 end Workingstep
        2 end Program
    "#]],
    );
}

#[test]
fn a_turned_work_offset_is_refused() {
    let mut tables = mill_tables();
    let turned = Transform::from_axes(Point::ORIGIN, Vector::Z, Vector::Y).expect("Z has a direction");
    tables.work_offsets.insert("G55".to_owned(), turned);
    expect![[r#"
        - begin Program 'test.nc'
        - frame G54 at -300 -200 -400
        error: test.nc:2:1: work offset G55 is turned: G-code work offsets are shifts here; enter it as a shift
    "#]]
    .assert_eq(&listing("G21\nG55 X0\nM30", "fanuc-mill", tables, Options::default()));
}

#[test]
fn a_run_can_be_taken_up_in_the_middle() {
    let text = "O1\nG21 G90 T2 M6\nG43 H2 S900 M3 M8\nG0 X1. Y2. Z3.\nM1\nG1 X5. F100.\nX6.\nM30";
    let mut whole = open_with(text.as_bytes(), "fanuc-mill", mill_tables(), Options::default()).expect("it opens");
    let (steps, _) = run(&mut whole);
    let mut modal = plan::Modal::default();
    for step in &steps[..steps.len() - 4] {
        modal.follow(step);
    }
    let next = units::StepId(modal.step.0 + 1);
    let again = plan::restart_at(&mut whole, next, &mut |_| plan::Answer::Truth(true)).expect("it comes that far");
    assert_eq!(again, modal);
    assert_eq!(
        plan::ProgramStream::next(&mut whole, None),
        plan::Next::Step(steps[steps.len() - 4].clone())
    );
}

#[test]
fn a_subprogram_is_run_as_often_as_asked() {
    mill(
        "O1\nG21 G91 G0 X0\nM98 P20 L2\nM98 P30021\nM30\nO20\nG0 X1.\nM99\nO21\nG0 Y1.\nM98 P20\nM99",
        expect![[r#"
            - begin Program 'O0001'
            - frame G54 at -300 -200 -400
            2 begin Workingstep 'O0001' derived
            7 line 300 200 400 -> 301 200 400 rapid
            7 line 301 200 400 -> 302 200 400 rapid
            10 line 302 200 400 -> 302 201 400 rapid
            7 line 302 201 400 -> 303 201 400 rapid
            10 line 303 201 400 -> 303 202 400 rapid
            7 line 303 202 400 -> 304 202 400 rapid
            10 line 304 202 400 -> 304 203 400 rapid
            7 line 304 203 400 -> 305 203 400 rapid
            5 end Workingstep
            5 end Program
        "#]],
    );
    mill(
        "O1\nM98 P99\nM30",
        expect![[r#"
        - begin Program 'O0001'
        - frame G54 at -300 -200 -400
        alarm 78: error: test.nc:2:1: there is no program O0099; put it into this file, or beside it
    "#]],
    );
    mill(
        "O1\nM98 P1\nM30",
        expect![[r#"
        - begin Program 'O0001'
        - frame G54 at -300 -200 -400
        alarm 77: error: test.nc:2:1: subprograms are nested more than 4 deep; call it from a shallower level
    "#]],
    );
    mill(
        "O1\nM98 P2\nM30\nO2\nG21",
        expect![[r#"
        - begin Program 'O0001'
        - frame G54 at -300 -200 -400
        error: test.nc:5:1: the subprogram ends without M99; end it with M99
    "#]],
    );
}

#[test]
fn what_is_wrong_is_said_with_line_column_and_remedy() {
    for (program, expected) in [
        (
            "",
            expect![[r#"
            error: test.nc:1:1: the file is empty; choose another file
        "#]],
        ),
        (
            "\n \n",
            expect![[r#"
            error: test.nc:1:1: there is no program in this file; choose another file
        "#]],
        ),
        (
            "(only a comment)\n%\n",
            expect![[r#"
            error: test.nc:2:1: there is no block in this program; choose another file
        "#]],
        ),
        (
            "G0 X1.\0",
            expect![[r#"
            error: test.nc:1:7: a byte 0: this is no text; choose a program file
        "#]],
        ),
        (
            "G21 G0 X",
            expect![[r#"
            alarm 5: error: test.nc:1:8: there is no number behind X; complete the word or take it out
        "#]],
        ),
        (
            "G21 G0 X Y1.",
            expect![[r#"
            alarm 5: error: test.nc:1:8: there is no number behind X; complete the word or take it out
        "#]],
        ),
        (
            "G21 G0 G1 X1.",
            expect![[r#"
            error: test.nc:1:8: G1 contradicts another code of its group in this block; keep one of them, or make two blocks
        "#]],
        ),
        (
            "G21 G0 X1. X2.",
            expect![[r#"
            error: test.nc:1:12: X stands twice in this block; keep one of them, or make two blocks
        "#]],
        ),
        (
            "G21 G0 B90.",
            expect![[r#"
            alarm 9: error: test.nc:1:8: the fanuc-mill control knows no word B; take it out, or choose another dialect
        "#]],
        ),
        (
            "G21 (no end",
            expect![[r#"
            error: test.nc:1:5: the comment that begins here has no end; put ) at its end, in the same line
        "#]],
        ),
        (
            "G21 G0 X1.) Y",
            expect![[r#"
            alarm 9: error: test.nc:1:11: expected a word or a comment, found ); put ( before the comment; a comment ends at its first )
        "#]],
        ),
        (
            "G123 X1.",
            expect![[r#"
            alarm 10: error: test.nc:1:1: the fanuc-mill control knows no G123; take it out, or choose another dialect
        "#]],
        ),
        (
            "G21 M77",
            expect![[r#"
            error: test.nc:1:5: the fanuc-mill control knows no M77; take it out, or choose another dialect
        "#]],
        ),
        (
            "G21 G1 X1.",
            expect![[r#"
            alarm 11: error: test.nc:1:8: a cutting move without a feed; write F, the feed a minute
        "#]],
        ),
        (
            "G21 G0 X0 Y0 F100.\nG1 X10.\nG2 X20. Y5. I5. J0",
            expect![[r#"
            alarm 20: error: test.nc:3:4: this arc does not close: its radius is 5.0000 mm at the start and 7.0711 mm at the end, 2.0711 mm apart and 0.0100 mm allowed; correct the end point or the centre; the centre counts from the start of the arc, and the plane must be the right one
        "#]],
        ),
        (
            "G20 G0 X0 Y0 F100.\nG1 X1.\nG2 X2. Y.5 I.5 J0",
            expect![[r#"
            alarm 20: error: test.nc:3:4: this arc does not close: its radius is 0.5000 inch at the start and 0.7071 inch at the end, 0.2071 inch apart and 0.0005 inch allowed; correct the end point or the centre; the centre counts from the start of the arc, and the plane must be the right one
        "#]],
        ),
        (
            "G21 G0 X0 Y0 F100.\nG2 X10. R4.",
            expect![[r#"
            alarm 20: error: test.nc:2:4: this arc does not close: its end is 10.0000 mm from its start, more than twice the radius of 4.0000 mm; correct the end point or R
        "#]],
        ),
        (
            "G21 F100. G2 X10.",
            expect![[r#"
            alarm 22: error: test.nc:1:14: an arc without centre and without radius; write I and J, from the start to the centre, or R
        "#]],
        ),
        (
            "G21 F100. G2 X10. I0 J0",
            expect![[r#"
            alarm 22: error: test.nc:1:14: the centre of this arc is its start; correct the words of the centre, or the plane (G17, G18, G19)
        "#]],
        ),
        (
            "G21\nT2 M6\nF100. G41 D2 G2 X305. R10.",
            expect![[r#"
                alarm 34: error: test.nc:3:1: cutter compensation is begun with an arc; begin and cancel it with a straight move (G0, G1)
            "#]],
        ),
        ("G21\n  IF [#1 EQ 0] GOTO 5", expect![""]),
        (
            "G21\nG65 P9000 A1.",
            expect![[r#"
                alarm 78: error: test.nc:2:1: there is no program O9000; put it into this file, or beside it
            "#]],
        ),
        (
            "G21\n#1=5 G0 X1.",
            expect![[r#"
            alarm 127: error: test.nc:2:6: a macro statement and other words in one block; give the macro statement a block of its own
        "#]],
        ),
        (
            "G21\nG0 X1. #1=5",
            expect![[r#"
            alarm 127: error: test.nc:2:8: a macro statement and other words in one block; give the macro statement a block of its own
        "#]],
        ),
        (
            "G21\n#1=5/0",
            expect![[r#"
                alarm 112: error: test.nc:2:5: 5 divided by 0; test the divisor first; a vacant variable counts as 0
            "#]],
        ),
        (
            "G21\n#50=1",
            expect![[r#"
            alarm 115: error: test.nc:2:1: #50 is no variable of this control; use #1-#33, #100-#199 or #500-#999
        "#]],
        ),
        (
            "G21\n#5001=1",
            expect![[r#"
            alarm 116: error: test.nc:2:1: #5001 cannot be written; write to #1-#33, #100-#199 or #500-#999
        "#]],
        ),
        (
            "G21\n#100=#3001",
            expect![[r#"
                error: test.nc:2:1: the machine has no answer to Number("EQUIPMENT_TIMER.POWERED"); set the switch or the sensor, or take the question out of the program
            "#]],
        ),
        (
            "G21\nG0 X[1+[2]",
            expect![[r#"
            alarm 114: error: test.nc:2:11: expected ] for the [ in column 5, found the end of the block; close the bracket
        "#]],
        ),
        (
            "G21\nM98 P5",
            expect![[r#"
            alarm 78: error: test.nc:2:1: there is no program O0005; put it into this file, or beside it
        "#]],
        ),
        (
            "G21\nM6",
            expect![[r#"
            error: test.nc:2:1: M6 without a tool: no T word came before; write T and the tool's number before M6
        "#]],
        ),
        (
            "G21 G0 Z5.\nG83 Z-3. R2. F100.",
            expect![[r#"
            alarm 45: error: test.nc:2:5: G83 without Q; add Q, the depth of a peck
        "#]],
        ),
        (
            "G21 G0 Z5.\nG83 Z-3. R2. Q0.00001 F100.",
            expect![[r#"
            error: test.nc:2:5: pecks of 0.00001 mm are too many for a hole of 5.000 mm; check Q
        "#]],
        ),
        (
            "G21 G0 Z5.\nG81 Z3. R2. F100.",
            expect![[r#"
                error: test.nc:2:5: the bottom of the hole (3.0000 mm) lies above R (2.0000 mm), and G81 goes down from R; correct R or the depth
            "#]],
        ),
        (
            "G21 G91 G53 Z0",
            expect![[r#"
            error: test.nc:1:9: G53 names places in the machine and has no meaning with G91; write G90 before it
        "#]],
        ),
    ] {
        expected.assert_eq(&problems(program, "fanuc-mill"));
    }
    for (program, expected) in [
        (
            "G21 G0 Y1.",
            expect![[r#"
            alarm 9: error: test.nc:1:8: the fanuc-lathe control knows no word Y; take it out, or choose another dialect
        "#]],
        ),
        (
            "G21 T0101\nG71 U2. R1.\nM3 S500 G99\nG71 P10 Q20 F0.2",
            expect![[r#"
            alarm 63: error: test.nc:4:1: G71 looks for block N10, which is not in this program; correct P and Q, or number the blocks of the contour
        "#]],
        ),
        (
            "G21 G0 X1. U2.",
            expect![[r#"
            error: test.nc:1:12: U names an axis that another word of this block names; keep one of them
        "#]],
        ),
        (
            "G21 T0101 G99 G1 X10. F.2",
            expect![[r#"
            error: test.nc:1:18: a feed per revolution while the spindle stands: the axes would never move; start the spindle with M3 or M4 first
        "#]],
        ),
        (
            "G21 T0505",
            expect![[r#"
            error: test.nc:1:5: tool 5 is not in the tables; enter it first
        "#]],
        ),
    ] {
        expected.assert_eq(&problems(program, "fanuc-lathe"));
    }
    for (program, expected) in [
        (
            "o100 sub",
            expect![[r#"
            error: test.nc:1:6: the macro statement SUB is not there yet; leave it out, or write the moves out by the CAM system
        "#]],
        ),
        (
            "#<a>=1",
            expect![[r#"
                error: test.nc:1:2: a named parameter #<...> is not there yet; leave it out, or write the moves out by the CAM system
            "#]],
        ),
        (
            "G21 G38.2 Z-5 F10",
            expect![[r#"
            error: test.nc:1:5: probing (G38) is not there yet; leave it out, or write the moves out by the CAM system
        "#]],
        ),
    ] {
        expected.assert_eq(&problems(program, "rs274"));
    }
}

/// Only what is said about a program, not its steps.
fn problems(program: &str, dialect: &str) -> String {
    let tables = if dialect == "fanuc-lathe" {
        lathe_tables()
    } else {
        mill_tables()
    };
    listing(program, dialect, tables, Options::default())
        .lines()
        .filter(|l| !l.starts_with(|c: char| c == '-' || c.is_ascii_digit()))
        .filter(|l| !l.contains("no-program-end") && !l.contains("without M30"))
        .map(|l| format!("{l}\n"))
        .collect()
}
