//! Words that a control would take for something else than was meant: comments that it obeys, digits that it cuts off, numbers that it
//! has not, lengths that come into force by themselves.

mod common;

use common::*;
use post::table::program_of;
use post::{Grade, Options, Posted, by_name, post};

fn posted_lines(control: &str, lines: &[&str]) -> (Posted, String) {
    let mut text = String::new();
    let control = by_name(control).expect("a control");
    let options = Options {
        source: "test".to_owned(),
        ..Options::default()
    };
    let done = post(control, &mut |_| Ok(program_of(lines)), &options, &mut |line| {
        text.push_str(line)
    });
    (done.unwrap_or_else(|e| panic!("{e}")), text)
}

const HEAD: &str = "G21 G90 G54\nT1 M6\nS500 M3\nG0 X5. Y6.\nG43 H1 Z10.\n";

#[test]
fn a_name_that_begins_like_an_active_comment_of_linuxcnc_is_none() {
    // LinuxCNC looks behind the blanks: `( ABORT,x)` ends the program as `(ABORT,x)` does.
    let program = format!("O1(ABORT,LEFT SIDE)\n{HEAD}(MSG,X)\nG1 Z0 F100.\nM30\n");
    let (text, _) = post_gcode(&program, "fanuc-mill", "linuxcnc").unwrap_or_else(|e| panic!("{e}"));
    for line in text.lines().filter(|line| line.starts_with('(')) {
        let inside = line[1..].trim_start().to_ascii_lowercase();
        let obeyed = ["abort,", "debug,", "log", "print,", "probe", "py,", "axis,"];
        assert!(!obeyed.iter().any(|word| inside.starts_with(word)), "{line}\n{text}");
    }
    assert!(text.contains("ABORT,LEFT SIDE"), "{text}");
}

#[test]
fn dates_and_milliseconds_are_printed_with_all_their_digits() {
    for control in ["fanuc", "haas"] {
        let lines = [
            "trace:1 get_time its_label=a its_variable=T",
            "trace:1 log_event its_kind=k its_values=T,U",
        ];
        let (_, text) = posted_lines(control, &lines);
        assert!(text.contains("DATE*#3011[80]*CLOCK*#3012[60]]"), "{text}");
        assert!(text.contains("T*#100[80]*U*#101[53]]"), "{text}");
    }
}

#[test]
fn an_alarm_beyond_200_halts_a_fanuc_by_a_number_that_it_has() {
    let alarm = "trace:1 set_alarm its_alarm_id=901 its_text=\"a text that is longer than any screen of the series\" its_reaction=stop_now";
    let (done, text) = posted_lines("fanuc", &[alarm]);
    assert!(text.contains("\n#3000=200(901 A TEXT THAT IS LONGER)\n"), "{text}");
    assert_eq!((done.functions[0].grade, done.functions[0].verified), (Grade::Native, false));
    let (_, text) = posted_lines("haas", &[alarm]);
    assert!(text.contains("\n#3000=901(A TEXT THAT IS LONGER THAN ANY)\r\n"), "{text}");
}

#[test]
fn a_tool_without_its_length_has_none_on_a_siemens_either() {
    // D1 comes into force with the tool by itself (MD20270).
    let program = "O1\nG21 G90 G54\nT1 M6\nS500 M3\nG0 X5. Y6.\nZ10.\nG1 Z0 F100.\nG43 H1 Z10.\nM30\n";
    let (text, _) = post_gcode(program, "fanuc-mill", "siemens-840d").unwrap_or_else(|e| panic!("{e}"));
    assert!(text.contains("X5 Y6\nD0 Z10\nG1 Z0 F100\nD1\n"), "{text}");
    // With its length behind it, nothing is written for it.
    let (text, _) = post_gcode(&format!("O1\n{HEAD}M30\n"), "fanuc-mill", "siemens-840d").unwrap_or_else(|e| panic!("{e}"));
    assert!(!text.contains("D0"), "{text}");
}

#[test]
fn two_ids_are_never_one_number_of_a_siemens() {
    let start = |id: &str| {
        format!("trace:1 start_synchronized_action its_id={id} its_mode_scope=AUTOMATIC its_actions=\"log_event its_kind=k\"")
    };
    let (one, other) = (start("7"), start("07"));
    let (_, text) = posted_lines("siemens-840d", &[&one, &other]);
    let numbers: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("ID=")?.split(' ').next())
        .collect();
    assert_eq!(numbers, ["7", "200"], "{text}");
}

#[test]
fn markers_parameters_and_timers_of_a_siemens_are_asked_for() {
    let action = "trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"ws_time > 5 s\" its_actions=\"read_sensor_value its_sensor=position its_axes=X,Y,Z\"";
    let (done, _) = posted_lines("siemens-840d", &[action]);
    for wanted in ["$AC_MARKER (MD28256)", "$AC_PARAM (MD28254)", "$AC_TIMER (MD28258)"] {
        assert!(
            done.notices.iter().any(|notice| notice.contains(wanted)),
            "{wanted}: {:?}",
            done.notices
        );
    }
}

#[test]
fn how_to_move_is_said_again_behind_a_tool_change() {
    // The macro behind M6 is the machine builder's, and may leave another motion in force.
    let program = format!("O1\n{HEAD}G1 Z0 F100.\nG0 Z20.\nT2 M6\nS600 M3\nX7. Y8.\nG43 H2 Z10.\nM30\n");
    for control in ["fanuc", "haas", "siemens-840d", "linuxcnc"] {
        let (text, _) = post_gcode(&program, "fanuc-mill", control).unwrap_or_else(|e| panic!("{e}"));
        assert!(text.contains("\nG0 X7"), "{control}\n{text}");
    }
}

#[test]
fn the_tool_goes_to_another_set_up_from_out_of_the_way() {
    // Both sides with one tool: how high the second clamping lies is known at the machine only.
    let one_tool = BRACKET
        .replace("(#341,#428,#660,#720)", "(#341,#428,#587,#720)")
        .replace("'twist drill',(#587)", "'twist drill',(#660)");
    // And where the file says one place for both.
    let one_place = one_tool
        .replace("(-250.,-280.,-300.)", "(-450.,-280.,-300.)")
        .replace("#797=DIRECTION('',(0.,1.,0.))", "#797=DIRECTION('',(1.,0.,0.))");
    assert_ne!(one_tool, one_place);
    for source in [one_tool, one_place] {
        let (text, _) = post_step_nc("bracket.stpnc", source.as_bytes(), "fanuc").unwrap_or_else(|e| panic!("{e}"));
        let (before, behind) = text.split_once("\nG55\n").expect("the second set-up has its own offset");
        let last = &before[before.rfind("(OPERATION").expect("an operation")..];
        assert!(last.contains("G91 G28 Z0.\nG90"), "{last}");
        let mut first = behind
            .lines()
            .filter(|line| line.contains(['X', 'Y', 'Z']) && !line.starts_with('('));
        let (across, down) = (first.next().unwrap_or_default(), first.next().unwrap_or_default());
        assert!(
            across.contains('X') && across.contains('Y') && !across.contains('Z'),
            "{across}"
        );
        assert!(down.contains('Z') && !down.contains('X'), "{down}");
    }
}

#[test]
fn a_moved_origin_is_called_again_on_a_siemens() {
    // $P_UIFR is data; it comes into force with the next G54.
    let program = format!("O1\n{HEAD}G10 L2 P1 X-310. Y-200. Z-400.\nG10 L2 P2 X-100.\nX5. Y6.\nM30\n");
    let (text, _) = post_gcode(&program, "fanuc-mill", "siemens-840d").unwrap_or_else(|e| panic!("{e}"));
    let (_, behind) = text.split_once("$P_UIFR[1,Z,TR]=-400\n").expect("the origin is written");
    let (before_moves, moves) = behind.split_once("X5 Y6").expect("the place is gone to again");
    assert!(before_moves.contains("G54\n") && !moves.contains("G54"), "{text}");
}
