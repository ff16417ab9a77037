//! The paths of milling cycles, arcs and compensation held against LinuxCNC's own interpreter, `rs274`, where it is installed (Debian's
//! package linuxcnc-uspace); without it these tests say so and pass.
//!
//! Compared are the end points of all moves, rapid or feed, in their order.

mod common;

use common::{mill_tables, open_with, run};
use gcode::Options;
use plan::{Path, Speed, StepKind, Tables, ToolEntry};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use units::{Millimetres, ToolNumber};

/// Rapid or not, and the end point.
type End = (bool, [f64; 3]);

/// What `rs274` makes of a program; `None` when it is not installed.
fn of_linuxcnc(program: &str) -> Option<Vec<End>> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("program.ngc");
    #[expect(clippy::disallowed_methods, reason = "a test gives a file to another program")]
    std::fs::write(&file, program).expect("it can be written");
    // It keeps its state outside its folder: one at a time.
    static ALONE: Mutex<()> = Mutex::new(());
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let output = match Command::new("rs274").arg("-g").arg(&file).current_dir(folder.path()).output() {
        Ok(output) => output,
        Err(why) => {
            println!("skipped: rs274 of linuxcnc-uspace: {why}");
            return None;
        }
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut ends = Vec::new();
    let mut at = [0.0; 3];
    // Canonical calls name their places in the order X Y Z, arcs in the order of their plane.
    let mut plane = [0, 1, 2];
    for line in text.lines() {
        let Some((call, rest)) = line.split_once('(') else { continue };
        let call = call.split_whitespace().last().unwrap_or_default();
        let numbers: Vec<f64> = rest
            .trim_end_matches(')')
            .split(',')
            .filter_map(|n| n.trim().parse().ok())
            .collect();
        match call {
            "SELECT_PLANE" => {
                plane = match rest {
                    r if r.contains("XZ") => [2, 0, 1],
                    r if r.contains("YZ") => [1, 2, 0],
                    _ => [0, 1, 2],
                };
            }
            "STRAIGHT_TRAVERSE" | "STRAIGHT_FEED" => {
                let to = [numbers[0], numbers[1], numbers[2]];
                if to != at {
                    ends.push((call == "STRAIGHT_TRAVERSE", to));
                }
                at = to;
            }
            "ARC_FEED" => {
                at[plane[0]] = numbers[0];
                at[plane[1]] = numbers[1];
                at[plane[2]] = numbers[5];
                ends.push((false, at));
            }
            _ => {}
        }
    }
    assert!(
        !ends.is_empty(),
        "rs274 made no moves of\n{program}\n{text}\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
    Some(ends)
}

fn of_ours(program: &str) -> Vec<End> {
    let mut tables = Tables::empty();
    tables.tools = mill_tables().tools;
    tables.tools.insert(
        ToolNumber(1),
        ToolEntry {
            radius: Millimetres(4.0),
            ..ToolEntry::default()
        },
    );
    let mut stream = open_with(program.as_bytes(), "rs274", tables, Options::default()).expect("it opens");
    let (steps, alarm) = run(&mut stream);
    assert_eq!(alarm, None);
    steps
        .iter()
        .filter_map(|step| match &step.kind {
            StepKind::Move(m) => {
                let rapid = m.speed == Speed::Rapid;
                assert!(matches!(m.path, Path::Line { .. } | Path::Arc(_)));
                Some((rapid, m.path.end().xyz))
            }
            _ => None,
        })
        .collect()
}

#[track_caller]
fn check(program: &str) {
    // Their tool table is not read without a machine: the diameter is said in the block.
    let Some(theirs) = of_linuxcnc(&program.replace("G41 D1", "G41.1 D8")) else {
        return;
    };
    let ours = of_ours(program);
    let same = ours.len() == theirs.len()
        && ours
            .iter()
            .zip(&theirs)
            .all(|(a, b)| a.0 == b.0 && a.1.iter().zip(b.1).all(|(p, q)| (p - q).abs() < 2e-4));
    assert!(same, "ours {ours:#?}\ntheirs {theirs:#?}");
}

#[test]
fn drilling_cycles_go_where_linuxcnc_goes() {
    for (plane, places) in [("G17", "X5 Y6 Z-5 R2"), ("G18", "X5 Z6 Y-5 R2"), ("G19", "Y5 Z6 X-5 R2")] {
        for level in ["G98", "G99"] {
            for cycle in ["G81", "G82 P0.2", "G83 Q2", "G73 Q3", "G85", "G89 P0.1"] {
                // With G98, rs274 reams out to the initial level; Fanuc's G85 and G89 leave R at rapid.
                if level == "G98" && (cycle == "G85" || cycle.starts_with("G89")) {
                    continue;
                }
                check(&format!(
                    "G21 G90 {plane} G40 G49 G80 G94\nG0 X1 Y1 Z1\nG0 X10 Y10 Z10\nF100\n{level} {cycle} {places}\nG80\nG0 X1 Y1 Z20\nM2\n"
                ));
            }
        }
    }
}

#[test]
fn repeated_incremental_holes_go_where_linuxcnc_goes() {
    check("G21 G90 G17 G94\nG0 X1 Y1 Z10\nF100\nG91 G99 G81 X4 Y5 Z-0.6 R-4.8 L3\nG80\nG90 G0 Z20\nM2\n");
    check("G21 G90 G17 G94\nG0 X1 Y1 Z10\nF100\nG91 G98 G83 X4 Z-6 R-8 Q2.5 L2\nX3 Y1\nG80\nG90 G0 Z20\nM2\n");
}

#[test]
fn arcs_go_where_linuxcnc_goes() {
    check(
        "G21 G90 G17 G94 F100\nG0 X1 Y2 Z3\nG2 X11 Y12 R10\nG3 X1 Y2 R-10\nG2 I5 J0\nG3 X1 Y2 Z-4 I-3 J1 P3\nG18 G2 X11 Z6 I5 K5\nG3 X1 Z-4 R-9\nG19 G3 Y12 Z6 J10 K0\nM2\n",
    );
}

#[test]
fn inner_corners_under_compensation_are_where_linuxcnc_has_them() {
    // Led in along the first wall, where every control begins at the same place; lines, and lines with arcs.
    check("G21 G90 G17 G94 F100\nT1 M6\nG0 X-40 Y0 Z0\nG1 G41 D1 X-20\nX40\nY30\nX-10\nX-20 Y5\nG40 X-30 Y20\nM2\n");
    check(
        "G21 G90 G17 G94 F100\nT1 M6\nG0 X-40 Y0 Z0\nG1 G41 D1 X-20\nX40\nG3 X50 Y10 R10\nG1 Y30\nG3 X40 Y40 R10\nG1 X10\nG2 X0 Y50 R10\nG1 Y60\nG40 X-10 Y70\nM2\n",
    );
}
