//! What is read, what is refused and where, and that nothing panics.

use super::*;

#[test]
fn the_built_in_machines_are_what_the_references_say() {
    let mill = MachineFile::simulated(MachineKind::Mill);
    let x = mill.axis(Axis::X).expect("a mill has X");
    assert_eq!(
        (x.v_max, x.a_max, x.j_max),
        (MmPerSec(500.0), MmPerSec2(3000.0), MmPerSec3(50_000.0))
    );
    assert_eq!(
        (mill.name.as_str(), mill.kind, mill.control),
        ("sim-mill", MachineKind::Mill, None)
    );
    let lathe = MachineFile::simulated(MachineKind::Lathe);
    assert_eq!((lathe.kind, lathe.control), (MachineKind::Lathe, Some(Control::FanucLathe)));
    assert!(lathe.axis(Axis::Y).is_none() && lathe.counts_diameters(Axis::X) && !lathe.counts_diameters(Axis::Z));
    for (name, _) in BUILT_IN {
        assert_eq!(MachineFile::find(name).expect("built in").name, *name);
    }
}

#[track_caller]
fn check_refused(change: (&str, &str), expected: &str) {
    let text = BUILT_IN[0].1.replacen(change.0, change.1, 1);
    assert_ne!(text, BUILT_IN[0].1, "{change:?} changes nothing");
    let refused = MachineFile::parse(&text, "m.toml").expect_err(expected).to_string();
    assert!(refused.starts_with(&format!("error: m.toml:{expected}")), "{refused}");
}

#[test]
fn what_cannot_be_is_refused_with_line_and_column() {
    check_refused(
        ("v_max_mm_s = 500.0", "v_max = 500.0"),
        "14:1: unknown field `v_max`, expected one of `travel_min_mm`",
    );
    check_refused(
        ("v_max_mm_s = 500.0", "v_max_mm_s = 0"),
        "14:14: 0 cannot be: a finite number above 0",
    );
    check_refused(("v_max_mm_s = 500.0", "v_max_mm_s = nan"), "14:14: NaN cannot be");
    check_refused(
        ("v_max_mm_s = 500.0", "v_max_mm_s = \"fast\""),
        "14:14: invalid type: string \"fast\", expected f64",
    );
    check_refused(("v_max_mm_s = 500.0", ""), "10:1: missing field `v_max_mm_s`");
    check_refused(
        ("kind = \"mill\"", "kind = \"saw\""),
        "3:8: unknown variant `saw`, expected `mill` or `lathe`",
    );
    check_refused(("kind = \"mill\"", "kind = mill"), "3:8: ");
    check_refused(
        ("travel_max_mm = 600.0", "travel_max_mm = -1000.0"),
        "10:1: axis X: travel_min_mm -1000 must be below",
    );
    check_refused(
        ("travel_max_mm = 600.0", "travel_max_mm = -10.0"),
        "10:1: axis X: travel -1000 to -10 mm does not reach 0",
    );
    check_refused(("[axes.y]", "[axes.w]"), "19:7: unknown field `w`");
    check_refused(
        ("raw_days = 90", "raw_days = 0"),
        "98:12: 0 cannot be: a finite number above 0",
    );
    check_refused(("raw_days = 90", "raw_dais = 90"), "98:1: unknown field `raw_dais`");
    check_refused(
        ("# quota_bytes = 500_000_000_000", "quota_bytes = 1.5"),
        "99:15: invalid type",
    );
    check_refused(
        ("edited_outside = \"warn\"", "edited_outside = \"maybe\""),
        "103:18: unknown variant `maybe`, expected `warn` or `refuse`",
    );
    check_refused(("number = 2", "number = 1"), "55:10: tool 1 is there already");
    check_refused(("name = \"sim-mill\"", "name = \"a/b\""), "2:8: the name \"a/b\"");
    check_refused(
        ("kind = \"mill\"", "kind = \"mill\"\nlate_ticks_allowed = 101"),
        "4:22: late_ticks_allowed is 0 to 100",
    );
    check_refused(
        ("kind = \"mill\"", "kind = \"mill\"\nlate_ticks_made_up = 1001"),
        "4:22: late_ticks_made_up is 0 to 1000",
    );
    check_refused(("[store]", "[link]\nport = 0\n[store]"), "98:8: ");
    check_refused(
        ("driver = \"sim\"", "driver = \"magic\""),
        "4:10: unknown variant `magic`, expected `sim` or `card`",
    );
    check_refused(
        ("driver = \"sim\"", "driver = \"card\""),
        "4:10: driver = \"card\" needs [card]",
    );
    check_refused(
        ("[store]", "[card]\nregisters = \"r\"\n[store]"),
        "97:1: [card] is for driver = \"card\"",
    );
}

#[test]
fn the_registers_of_a_card_are_found_beside_the_machine_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mill.toml");
    let text = BUILT_IN[0].1.replace("driver = \"sim\"", "driver = \"card\"");
    std::fs::write(&path, format!("{text}\n[card]\nregisters = \"mill.registers\"\n")).expect("written");
    let machine = MachineFile::open(&path).expect("a machine");
    assert_eq!(machine.driver, Driver::Card(folder.path().join("mill.registers")));
}

proptest::proptest! {
    /// Whatever a slip of the editor does to a good file: read, or refused with a place; never a panic.
    #[test]
    fn a_damaged_file_is_read_or_refused(at in 0.0..1.0_f64, length in 0usize..40, put in ".{0,6}") {
        let text = BUILT_IN[1].1;
        let from = (at * text.len() as f64) as usize;
        let to = (from + length).min(text.len());
        let damaged = format!("{}{put}{}", &text[..from], &text[to..]);
        if let Err(refused) = MachineFile::parse(&damaged, "m.toml") {
            proptest::prop_assert!(refused.to_string().starts_with("error: m.toml:"), "{refused}");
        }
    }
}
