//! What is posted for a Fanuc does in our own interpreter what its source does: path, tools, offsets, spindle, feeds, coolant, stops.

mod common;

use common::*;
use std::collections::BTreeMap;

/// Rounded to a thousandth of a millimetre; diameters of a lathe to half of it.
const TOLERANCE: f64 = 1e-3;

#[track_caller]
fn same_as_its_source(text: &str, dialect: &str) {
    let turning = dialect == "fanuc-lathe";
    let (fanuc, _) = post_gcode(text, dialect, "fanuc").unwrap_or_else(|e| panic!("{e}"));
    let target = if turning { "fanuc-lathe" } else { "fanuc-mill" };
    let wanted = deeds(&mut gcode(text, dialect, machine(turning), BTreeMap::new()));
    let found = deeds(&mut gcode(&fanuc, target, machine(turning), BTreeMap::new()));
    if let Err(difference) = compare(&wanted, &found, TOLERANCE) {
        panic!("{difference}\n{fanuc}");
    }
}

#[test]
fn milling_programs_of_the_corpus_do_the_same() {
    same_as_its_source(PLATE, "fanuc-mill");
    same_as_its_source(FLANGE, "fanuc-mill");
}

#[test]
fn turning_programs_of_the_corpus_do_the_same() {
    same_as_its_source(SHAFT, "fanuc-lathe");
    same_as_its_source(SPINDLE, "fanuc-lathe");
}

#[test]
fn tapping_stays_tapping() {
    same_as_its_source(
        "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X5. Y6.\nG43 H1 Z10.\nM29 S500\nG99 G84 X5. Y6. Z-6. R3. F500.\nX20.\nG80\nG0 Z50.\nM5\nM30\n",
        "fanuc-mill",
    );
}

#[test]
fn a_tapped_hole_of_a_lathe_is_the_one_that_was_meant() {
    // R of a lathe counts from where the tool stands: written as a place it would be twice as far.
    same_as_its_source(
        "O1\nG21 G18 G99\nT0101\nG97 S500 M3\nG0 X0. Z5.\nM29 S500\nG84 Z-12. R-2. F1.25\nG80\nG0 Z50.\nM5\nM30\n",
        "fanuc-lathe",
    );
}

#[test]
fn another_tool_is_led_to_the_height_that_the_program_says() {
    // Z10. again, but of a longer tool: without the word it would cross the part as deep as it is longer.
    same_as_its_source(
        "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 G43 H1 X5. Y6. Z10.\nG1 Z0 F100.\nG0 Z10.\nT8 M6\nS500 M3\nG0 G43 H8 X50. Y60. Z10.\nG1 Z-1. F100.\nG0 Z10.\nG43 H7 X70. Z10.\nG49 X80. Z10.\nM30\n",
        "fanuc-mill",
    );
    same_as_its_source(
        "O1\nG21 G18 G98\nT0101\nG97 S500 M3\nG0 X40. Z5.\nG1 X30. F100.\nG0 X40.\nT0100\nT0808\nG0 X40. Z5.\nG1 X30. F100.\nG0 X40.\nM30\n",
        "fanuc-lathe",
    );
}

#[test]
fn a_place_is_gone_to_again_when_the_program_moves_its_origin() {
    let head = "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 G43 H1 X10. Y6. Z10.\n";
    same_as_its_source(
        &format!(
            "{head}G10 L2 P1 X-310. Y-200. Z-400.\nG0 X10. Y8.\nG1 X20. F100.\nG10 L2 P1 X-310. Y-220. Z-400.\nX20. Y8.\nX30.\nM30\n"
        ),
        "fanuc-mill",
    );
    same_as_its_source(
        &format!("{head}G10 L10 P1 R105.\nG0 X20. Z10.\nG43 H1 Z10.\nG10 L11 P1 R0.5\nG1 X20. Z10. F100.\nX30. Z10.\nZ9.\nM30\n"),
        "fanuc-mill",
    );
}

#[test]
fn shifts_rotations_and_inches_are_written_out() {
    same_as_its_source(
        "O2\nG20 G90 G54 T1 M6\nS900 M3\nG0 X1. Y2.\nG43 H1 Z1.\nG52 X0.5 Y0.25\nG1 X0 Y0 F10.\nG68 X0 Y0 R30.\nX1. Y0\nG3 X2. Y1. R1.\nG69\nG52 X0 Y0\nG0 Z2.\nM30\n",
        "fanuc-mill",
    );
}

#[test]
fn arcs_near_a_full_turn_and_tiny_ones_stay_what_they_are() {
    same_as_its_source(
        "O3\nG21 G90 G54 G17 T1 M6\nS900 M3\nG0 X10. Y0\nG43 H1 Z1.\nG1 Z0 F100.\nG3 X10. Y0 I-10. J0\nG3 X9.99999 Y-0.014 I-10. J0\nG1 X10. Y0\nG2 X10.002 Y0.001 R0.02\nG1 X0 Y0\nG3 X0 Y0 Z-3. I5. J0\nG18 G2 X10. Z7. R10.\nG19 G3 Y10. Z-3. R10.\nG17 G0 Z5.\nM30\n",
        "fanuc-mill",
    );
}

#[test]
fn step_nc_of_the_corpus_does_the_same_cutting() {
    check_cutting("bracket.stpnc", BRACKET.as_bytes());
}

#[test]
fn step_nc_samples_do_the_same_cutting() {
    for name in [
        "plate_mm_e3.stpnc",
        "block_inch_nested_e1.stpnc",
        "plate_trace_functions_e3.stpnc",
    ] {
        if let Some(bytes) = sample(&format!("stepnc/ap238/{name}")) {
            check_cutting(name, &bytes);
        }
    }
}

/// Cutting moves with their feeds, tools and spindle, between links that the post makes safer than the planner's.
#[track_caller]
fn check_cutting(name: &str, bytes: &[u8]) {
    let (fanuc, posted) = post_step_nc(name, bytes, "fanuc").unwrap_or_else(|e| panic!("{name}: {e}"));
    let tables = machine(false);
    let wanted = step_nc_deeds(
        name,
        bytes,
        plan::Tables {
            work_offsets: BTreeMap::new(),
            ..tables.clone()
        },
    );
    // Work offsets as the set-ups of the file lie.
    let program = stepnc::Program::read(name, bytes.to_vec()).expect("a Part 21 file");
    let mut tables = tables;
    for (words, meaning) in &posted.work_offsets {
        let mut place = units::Transform::IDENTITY;
        if let Some(plan) = program.plan() {
            program.walk(plan.main_workplan, &mut |executable, _| {
                if let Some(setup) = &executable.setup
                    && setup.name == *meaning
                    && let Some(found) = setup.machine_from_setup
                {
                    place = units::Transform::shift(found.origin);
                }
            });
        }
        tables.work_offsets.insert(words.clone(), place);
    }
    let found = deeds(&mut gcode(&fanuc, "fanuc-mill", tables, BTreeMap::new()));
    let cutting = |all: Vec<Deed>| -> Vec<Deed> {
        let mut kept: Vec<Deed> = Vec::new();
        let mut before = [0.0; 3];
        for deed in all {
            match deed {
                Deed::Go(None, points) => before = points[points.len() - 1],
                Deed::Go(feed, mut points) => {
                    points.insert(0, before);
                    before = points[points.len() - 1];
                    kept.push(Deed::Go(feed, points));
                }
                // Outlets open one after the other.
                Deed::Coolant(..) if matches!(kept.last(), Some(Deed::Coolant(..))) => {
                    kept.pop();
                    kept.push(deed);
                }
                Deed::Tool(_) | Deed::Spindle(_) | Deed::Dwell(_) | Deed::Stop(_) | Deed::Coolant(..) => kept.push(deed),
                _ => {}
            }
        }
        kept
    };
    // Splines are chords within 0.005 mm; ratios of feeds are steps.
    let without_feeds = |all: Vec<Deed>| -> Vec<Deed> {
        all.into_iter()
            .map(|deed| match deed {
                Deed::Go(_, points) => Deed::Go(Some(1.0), points),
                other => other,
            })
            .collect()
    };
    let (wanted, found) = (without_feeds(cutting(wanted)), without_feeds(cutting(found)));
    if let Err(difference) = compare(&wanted, &found, 0.006) {
        panic!("{name}: {difference}\n{fanuc}");
    }
}
