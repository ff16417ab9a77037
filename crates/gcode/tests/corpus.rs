//! The house's own G-code: read without a warning on a machine that has its tools, and short enough to be run in a demo.

mod common;

use common::{lathe_tables, listing, mill_tables, open_with, run, tool};
use expect_test::{Expect, expect};
use gcode::inspect::{Node, inspect};
use gcode::{GcodeProgram, Options, detect};
use plan::{Feed, MemorySource, ProgramStream, Speed, SpindleState, StepKind, Tables};
use units::{Millimetres, ToolNumber};

const PLATE: &str = include_str!("../../../corpus/plate.nc");
const SHAFT: &str = include_str!("../../../corpus/shaft.nc");

/// Cutting time at the programmed feeds, without acceleration, and rapids at 300 mm/s.
fn seconds_of(program: &mut GcodeProgram) -> f64 {
    let mut spindle = SpindleState::Stopped;
    let (steps, alarm) = run(program);
    assert_eq!(alarm, None);
    steps
        .iter()
        .map(|step| match &step.kind {
            StepKind::Spindle(state) => {
                spindle = *state;
                0.0
            }
            StepKind::Move(m) => {
                let radius = Millimetres(m.path.start().xyz[0].abs().min(m.path.end().xyz[0].abs()));
                let speed = match m.speed {
                    Speed::Rapid => 300.0,
                    Speed::Feed(Feed::PerTime(v)) => v.0,
                    Speed::Feed(Feed::PerRevolution(f) | Feed::Thread(plan::Thread { advance: f, .. })) => {
                        f.0 * spindle.revolutions(radius).0 / 60.0
                    }
                    Speed::Feed(Feed::WholeMove(t)) => return t.0,
                };
                m.path.length() / speed
            }
            StepKind::Dwell(t) => t.0,
            _ => 0.0,
        })
        .sum()
}

fn names(nodes: &[Node], depth: usize, out: &mut String) {
    for node in nodes {
        *out += &format!("{}{} '{}' tool {:?}", "  ".repeat(depth), node.kind, node.name, node.tool);
        for path in &node.toolpaths {
            *out += &format!(" {}@{}", path.kind, path.id);
        }
        *out += "\n";
        names(&node.children, depth + 1, out);
    }
}

#[track_caller]
fn check(text: &str, dialect: &str, tables: Tables, expected: Expect) {
    let found = detect(&mut MemorySource(text.as_bytes().to_vec())).expect("memory can be read");
    assert_eq!(found.profile.name, dialect, "{}", found.because);
    let mut program = open_with(text.as_bytes(), dialect, tables, Options::default()).expect("it opens");
    let seconds = seconds_of(&mut program);
    println!("{dialect}: {seconds:.1} s of machining");
    assert!((15.0..50.0).contains(&seconds), "{seconds} s");
    assert_eq!(program.diagnostics(), []);
    let tree = inspect(&mut program, dialect, GcodeProgram::in_inches);
    let mut out = format!("{} {} {:?}\n", tree.schema, tree.units, tree.summary);
    names(&tree.tree, 0, &mut out);
    expected.assert_eq(&out);
}

#[test]
fn the_plate_is_three_workingsteps() {
    check(
        PLATE,
        "fanuc-mill",
        mill_tables(),
        expect![[r#"
            fanuc-mill mm Summary { workingsteps_enabled: 3, workingsteps_disabled: 0, toolpaths: 44, rapids: 24, dwells: 0, tools: 3, nc_functions: 0 }
            program 'O1100 PLATE 60 X 40 X 12' tool None rapid@7
              workingstep 'T1 50 MM FACE MILL' tool Some(Number(1)) rapid@12 feed@15 rapid@16
              workingstep 'T2 10 MM END MILL, 3 FLUTES' tool Some(Number(2)) rapid@22 feed@26 rapid@55
              workingstep 'T3 6.6 MM DRILL' tool Some(Number(3)) rapid@61 feed@63 rapid@63 feed@63 rapid@63 feed@63 rapid@63 feed@63 rapid@63 feed@64 rapid@64 feed@64 rapid@64 feed@64 rapid@64 feed@64 rapid@64 feed@65 rapid@65 feed@65 rapid@65 feed@65 rapid@65 feed@65 rapid@65 feed@66 rapid@66 feed@66 rapid@66 feed@66 rapid@66 feed@66 rapid@66 feed@70 rapid@70 feed@71 rapid@71
        "#]],
    );
}

#[test]
fn the_shaft_is_roughed_and_finished() {
    check(
        SHAFT,
        "fanuc-lathe",
        lathe_tables(),
        expect![[r#"
            fanuc-lathe mm Summary { workingsteps_enabled: 2, workingsteps_disabled: 0, toolpaths: 17, rapids: 10, dwells: 0, tools: 2, nc_functions: 0 }
            program 'O2040 SHAFT D40 F7' tool None rapid@10
              workingstep 'T1 ROUGHING CNMG 12' tool Some(Number(1)) rapid@16 feed@18 rapid@19 feed@22 rapid@24 feed@26 rapid@28 feed@30 rapid@32 feed@34 rapid@36 feed@38 rapid@40
              workingstep 'T3 FINISHING DNMG 11' tool Some(Number(3)) rapid@47 feed@48 rapid@63
        "#]],
    );
}

#[test]
fn the_seat_of_the_shaft_is_turned_where_offset_3_says() {
    let seat = |wear: f64| {
        let mut tables = lathe_tables();
        tables.tools.insert(ToolNumber(3), tool(22.0, 33.0, wear, None));
        let mut program = open_with(SHAFT.as_bytes(), "fanuc-lathe", tables, Options::default()).expect("it opens");
        let (steps, _) = run(&mut program);
        let mut offset = None;
        let mut gauge = None;
        for step in &steps {
            match &step.kind {
                StepKind::ToolOffset(o) => offset = Some(*o),
                StepKind::Move(m) if m.path.end().xyz == [39.962 / 2.0, 0.0, -45.0] => {
                    gauge = offset.map(|o| m.path.end().xyz[0] + o.total().xyz[0]);
                }
                _ => {}
            }
        }
        gauge.expect("the seat is turned")
    };
    assert!(
        (seat(-0.02) - seat(0.0) + 0.02).abs() < 1e-12,
        "wear moves the gauge point by as much"
    );
}

#[test]
fn the_finishing_cut_of_the_shaft_step_by_step() {
    let all = listing(SHAFT, "fanuc-lathe", lathe_tables(), Options::default());
    let finish = all.split("begin Workingstep").nth(2).expect("a second workingstep");
    expect![[r#"
         'T3 FINISHING DNMG 11' derived
        45 tool 3 'FINISHING DNMG 11'
        45 tool offset 3 geometry 22 0 33 wear -0.05 0 0
        46 spindle cw 4666.6667 mm/s up to 3000 rpm
        47 coolant flood
        47 line 128.05 0 217 -> -0.8 0 3 rapid
        48 line -0.8 0 3 -> -0.8 0 0 F0.12/rev
        50 line -0.8 0 0 -> 10.5 0 0 F0.12/rev
        51 line 10.5 0 0 -> 12.5 0 -2 F0.12/rev
        52 line 12.5 0 -2 -> 12.5 0 -14 F0.12/rev
        54 line 12.5 0 -14 -> 16 0 -18 F0.12/rev
        55 line 16 0 -18 -> 16 0 -23 F0.12/rev
        57 arc 16 0 -23 -> 18 0 -25 r2 -90deg about Y F0.12/rev
        58 line 18 0 -25 -> 18.981 0 -25 F0.12/rev
        59 arc 18.981 0 -25 -> 19.981 0 -26 r1 90deg about Y F0.12/rev
        61 line 19.981 0 -26 -> 19.981 0 -45 F0.12/rev
        62 line 19.981 0 -45 -> 23 0 -45 F0.12/rev
        63 coolant off
        63 line 23 0 -45 -> 25 0 5 rapid
        64 machine X0 Z0
        65 tool offset 0 geometry 0 0 0 wear 0 0 0
        66 spindle stopped
        67 end Workingstep
        67 end Program
    "#]]
    .assert_eq(finish);
}
