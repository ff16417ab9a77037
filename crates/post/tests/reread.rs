//! Programs for controls that we have no interpreter of are read again by the few words of their motion: every cut ends where the
//! source's cut ends.

mod common;

use common::*;
use std::collections::BTreeMap;

/// Ends of cutting moves, in the coordinates of the words.
fn siemens_or_haas(text: &str, turning: bool) -> Vec<[f64; 3]> {
    let mut at = [f64::NAN; 3];
    let mut motion = String::new();
    let mut ends = Vec::new();
    for line in text.lines() {
        let line = line.split(';').next().unwrap_or_default();
        if line.starts_with('(') || line.contains('=') || line.contains("SUPA") || line.contains("G53") || line.contains("G28") {
            continue;
        }
        let mut moved = false;
        for word in line.split_whitespace() {
            let (letter, rest) = word.split_at(1);
            if let ("G", "0" | "1" | "2" | "3" | "33" | "32") = (letter, rest) {
                motion = word.to_owned();
            }
            if let Some(axis) = ["X", "Y", "Z"].iter().position(|axis| *axis == letter)
                && let Ok(value) = rest.parse::<f64>()
            {
                at[axis] = if turning && axis == 0 { value / 2.0 } else { value };
                moved = true;
            }
        }
        if moved && motion != "G0" {
            ends.push(at);
        }
    }
    ends
}

/// The same of Klartext.
fn klartext(text: &str) -> Vec<[f64; 3]> {
    let mut at = [f64::NAN; 3];
    let mut centre = [0.0; 2];
    let mut ends = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        assert_eq!(
            words.next(),
            Some(number.to_string().as_str()),
            "blocks are numbered without gaps: {line}"
        );
        let kind = words.next().unwrap_or_default();
        let words: Vec<&str> = words.collect();
        let value = |letters: &str| words.iter().find_map(|word| word.strip_prefix(letters)?.parse::<f64>().ok());
        match kind {
            "CC" => centre = [value("X").expect("X"), value("Y").expect("Y")],
            "L" if words.contains(&"M91") => at[2] = f64::NAN,
            "L" | "C" => {
                for (k, letter) in ["X", "Y", "Z"].iter().enumerate() {
                    at[k] = value(letter).unwrap_or(at[k]);
                }
                if !words.contains(&"FMAX") {
                    ends.push(at);
                }
            }
            "CP" => {
                let angle = value("IPA").expect("an angle").to_radians();
                let (x, y) = (at[0] - centre[0], at[1] - centre[1]);
                at[0] = centre[0] + x * libm::cos(angle) - y * libm::sin(angle);
                at[1] = centre[1] + x * libm::sin(angle) + y * libm::cos(angle);
                at[2] += value("IZ").expect("a rise");
                ends.push(at);
            }
            _ => {}
        }
    }
    ends
}

/// Every end of a cut of the source is an end of the posted program's, in the same order; more may lie between, where arcs were cut.
#[track_caller]
fn holds(source: &str, dialect: &str, posted: &[[f64; 3]], tolerance: f64) {
    use plan::{Next, ProgramStream, Speed, StepKind};
    let turning = dialect == "fanuc-lathe";
    let mut stream = gcode(source, dialect, machine(turning), BTreeMap::new());
    let mut base = units::Transform::IDENTITY;
    let mut frame = units::Transform::IDENTITY;
    let mut rest = posted.iter();
    let mut count = 0;
    loop {
        match stream.next(None) {
            Next::Step(step) => match step.kind {
                StepKind::Frame(change) => {
                    if !change.name.contains(' ') {
                        base = change.machine_from_setup;
                    }
                    frame = change.machine_from_setup;
                }
                StepKind::Move(go) if go.speed != Speed::Rapid => {
                    let end = (frame * go.path.end()).xyz;
                    let wanted = [0, 1, 2].map(|k| end[k] - base.origin[k]);
                    let near = |found: &&[f64; 3]| {
                        (0..3).all(|k| (turning && k == 1) || found[k].is_nan() || (found[k] - wanted[k]).abs() <= tolerance)
                    };
                    assert!(rest.any(|found| near(&found)), "no cut ends at {wanted:?} (the {count}th)");
                    count += 1;
                }
                _ => {}
            },
            Next::Ask(_) => {}
            Next::End => break,
            Next::Alarm(alarm) => panic!("{alarm}"),
        }
    }
    assert!(count > 5);
}

#[test]
fn cuts_end_where_the_sources_cuts_end() {
    for source in [PLATE, FLANGE] {
        for control in ["siemens-840d", "haas"] {
            let (text, _) = post_gcode(source, "fanuc-mill", control).unwrap_or_else(|e| panic!("{control}: {e}"));
            holds(source, "fanuc-mill", &siemens_or_haas(&text, false), 6e-4);
        }
    }
    for source in [SHAFT, SPINDLE] {
        for control in ["siemens-840d", "haas"] {
            let (text, _) = post_gcode(source, "fanuc-lathe", control).unwrap_or_else(|e| panic!("{control}: {e}"));
            holds(source, "fanuc-lathe", &siemens_or_haas(&text, true), 6e-4);
        }
    }
    let (text, _) = post_gcode(PLATE, "fanuc-mill", "heidenhain").unwrap_or_else(|e| panic!("{e}"));
    holds(PLATE, "fanuc-mill", &klartext(&text), 2e-4);
}

#[test]
fn a_lathe_program_and_a_written_register_are_refused_in_klartext() {
    let error = post_gcode(SHAFT, "fanuc-lathe", "heidenhain").expect_err("it is refused");
    assert!(error.contains("programs that turn"), "{error}");
    let error = post_gcode(FLANGE, "fanuc-mill", "heidenhain").expect_err("it is refused");
    assert!(error.contains("tool 4 radius") && error.contains("test.nc:14"), "{error}");
}

#[test]
fn corpus_programs_are_posted_as_written_down() {
    use expect_test::expect_file;
    for control in post::CONTROLS {
        let (text, _) = post_step_nc("bracket.stpnc", BRACKET.as_bytes(), control.name()).unwrap_or_else(|e| panic!("{e}"));
        expect_file![format!("golden/bracket.{}.txt", control.name())].assert_eq(&text.replace('\r', ""));
    }
    let (text, _) = post_gcode(SPINDLE, "fanuc-lathe", "siemens-840d").unwrap_or_else(|e| panic!("{e}"));
    expect_file!["golden/spindle.siemens-840d.txt"].assert_eq(&text);
}

#[test]
fn a_taper_thread_keeps_its_lead_in_linuxcnc() {
    let program = "O1\nG21 G18 G99 T0101\nG97 S1000 M3\nG0 X20. Z5.\nG32 X24. Z-4. F2.\nG0 X30.\nM30\n";
    let (text, _) = post_gcode(program, "fanuc-lathe", "linuxcnc").expect("it can be posted");
    // The lead of 2 mm is along Z; K is along the path: 2 * sqrt(2^2 + 9^2) / 9.
    assert!(text.contains("G33 X24 Z-4 K2.048788"), "{text}");
}

#[test]
fn a_rigidly_tapped_hole_of_linuxcnc_is_the_one_that_was_meant() {
    let program = "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X5. Y6.\nG43 H1 Z10.\nM29 S500\nG99 G84 X5. Y6. Z-6. R3. F500.\nX20.\nG80\nG0 Z50.\nM5\nM30\n";
    let (text, _) = post_gcode(program, "fanuc-mill", "linuxcnc").expect("it can be posted");
    let wanted = deeds(&mut gcode(program, "fanuc-mill", machine(false), BTreeMap::new()));
    let found = deeds(&mut gcode(&text, "rs274", machine(false), BTreeMap::new()));
    if let Err(difference) = compare(&wanted, &found, 1e-3) {
        panic!("{difference}\n{text}");
    }
}
