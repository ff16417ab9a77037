//! What a synchronized action of the 840D compares, and coordinates in frames that a control's variables do not have.

use post::table::program_of;
use post::{CONTROLS, Grade, Options, Posted, by_name, post};

fn posted(control: &str, lines: &[&str]) -> (Posted, String) {
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

#[track_caller]
fn check(condition: &str, expected: Option<&str>) {
    let line = format!(
        "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"{condition}\" its_actions=\"set_alarm its_alarm_id=1 its_text=x\""
    );
    let (done, text) = posted("siemens-840d", &[&line]);
    let grade = done.functions[0].grade;
    match expected {
        Some(expected) => {
            let action = text
                .lines()
                .find(|line| line.starts_with("IDS="))
                .unwrap_or_else(|| panic!("{text}"));
            let found = action.split(" WHEN ").nth(1).and_then(|rest| rest.split(" DO ").next());
            assert_eq!((grade, found), (Grade::Native, Some(expected)));
        }
        None => assert_eq!((grade, text.contains("IDS=")), (Grade::External, false), "{text}"),
    }
}

#[test]
fn a_value_of_the_cycle_is_compared_with_what_the_program_worked_out_before() {
    check("ws_time > 3600 s", Some("$AC_TIMER[1]>3600"));
    check("WS_TIME > TIME_LIMIT", Some("$AC_TIMER[1]>R1"));
    // The value of the cycle stands on the left.
    check("TIME_LIMIT < WS_TIME", Some("$AC_TIMER[1]>R1"));
    check("3600 s < WS_TIME", Some("$AC_TIMER[1]>3600"));
    check("WS_TIME > 2 * TIME_LIMIT", Some("$AC_TIMER[1]>(2*R1)"));
    check(
        "WS_TIME > TIME_LIMIT and X.LOAD >= 80 %",
        Some("($AC_TIMER[1]>R1) AND ($AA_LOAD[X]>=80)"),
    );
    check("not WS_TIME > TIME_LIMIT", Some("NOT ($AC_TIMER[1]>R1)"));
    // Both kinds in one expression, variables alone, and what is read ahead of the motion.
    check("WS_TIME + TIME_LIMIT > 5", None);
    check("FIRST_LIMIT > TIME_LIMIT", None);
    check("tool = 3", None);
}

#[test]
fn coordinates_of_a_frame_are_not_posted_as_those_of_the_axes() {
    for control in CONTROLS {
        let (done, text) = posted(control.name(), &["trace:1 get_interpolated_position its_axis=X frame=work"]);
        assert_eq!(done.functions[0].grade, Grade::External, "{}", control.name());
        assert!(
            done.functions[0].reason.contains("frame work"),
            "{}",
            done.functions[0].reason
        );
        let reads = ["$AA_IM[X]", "#5021", "_abs_x", "ID240"]
            .iter()
            .any(|variable| text.contains(variable));
        assert!(!reads, "{text}");
    }
    let (done, text) = posted("siemens-840d", &["trace:1 get_encoder_position its_axis=X its_encoder=2"]);
    assert!(
        text.contains("$VA_IM2[X]") && done.functions[0].grade == Grade::BlockBoundary,
        "{text}"
    );
}

#[test]
fn a_check_is_looked_at_once_more_before_it_ends() {
    // A program of fewer moves than lie between two checks would look at its condition at the start only.
    let start = |id: &str| {
        format!(
            "trace:1 start_synchronized_action its_id={id} its_mode_scope=AUTOMATIC its_frequency=WHEN its_condition=\"X.LOAD > 80 %\" its_actions=\"log_event its_kind={id}\""
        )
    };
    let (stopped, left) = (start("A"), start("B"));
    let (_, text) = posted("haas", &[&stopped, &left, "trace:1 stop_synchronized_action its_id=A"]);
    assert_eq!(text.matches("DPRNT[EVENT*A*]").count(), 2, "{text}");
    assert_eq!(text.matches("DPRNT[EVENT*B*]").count(), 2, "{text}");
}

#[test]
fn what_an_action_of_the_840d_logs_is_said_to_be_written_at_its_stop() {
    let line = "trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_frequency=EVERY its_condition=\"X.LOAD > 80 %\" its_actions=\"log_event its_kind=k\"";
    let (done, _) = posted("siemens-840d", &[line]);
    assert!(
        done.functions[0].reason.contains("once, at its stop"),
        "{}",
        done.functions[0].reason
    );
}

#[test]
fn what_waits_at_once_does_not_say_that_it_waits_for_the_operation() {
    let line = "trace:1 set_alarm its_alarm_id=1 its_text=x its_reaction=stop_after_operation";
    for control in ["fanuc", "haas", "heidenhain", "linuxcnc"] {
        let (done, _) = posted(control, &[line]);
        assert!(
            done.functions[0].reason.ends_with("not at the operation's end"),
            "{}",
            done.functions[0].reason
        );
    }
}

#[test]
fn checks_are_looked_at_in_the_order_of_their_starts() {
    let start = |id: &str| {
        format!("trace:1 start_synchronized_action its_id={id} its_mode_scope=AUTOMATIC its_actions=\"log_event its_kind={id}\"")
    };
    let (_, text) = posted("haas", &[&start("B"), &start("A")]);
    let events: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("DPRNT[EVENT*")?.get(..1))
        .collect();
    assert_eq!(events, ["B", "A", "B", "A"], "{text}");
}

#[test]
fn a_recording_and_an_action_of_one_id_do_not_take_each_others_place() {
    let record = "trace:1 start_sensor_recording its_function_id=1 its_sensors=LOAD its_axes=X";
    let watch = "trace:1 start_synchronized_action its_id=1 its_mode_scope=AUTOMATIC its_actions=\"log_event its_kind=k\"";
    let (_, text) = posted("haas", &[record, watch, "trace:1 stop_synchronized_action its_id=1"]);
    assert_eq!(text.matches("DPRNT[RECORDING*1*").count(), 2, "{text}");
    assert_eq!(text.matches("DPRNT[EVENT*K*]").count(), 2, "{text}");
    let (_, text) = posted("siemens-840d", &[record, watch]);
    assert!(text.contains("CANCEL(101)") && text.contains("CANCEL(1)"), "{text}");
}
