//! Every check and every sign of the law.

use super::*;
use crate::Response;
use crate::dimension::tests::published;
use proptest::prelude::*;
use std::collections::BTreeMap;

fn entry(text: &str) -> Entry {
    Entry {
        text: text.into(),
        unit: Unit::Inch,
        who: "Maria".into(),
        level: 5,
        remark: String::new(),
        when: Timestamp(10_000_000_000),
    }
}

fn at(register: f64) -> Present {
    Present {
        register: Some(register),
        ..Present::default()
    }
}

#[test]
fn the_published_example_makes_the_wear_nine_steps_smaller() {
    let correction = enter(&published(), &entry("3.2351"), &at(-0.3048)).expect("good");
    let request = correction.request.expect("a change");
    assert_eq!(correction.change, -0.02286); // -0.0009 in
    assert_eq!((request.to, request.expected), (-0.32766, Some(-0.3048)));
    assert_eq!(request.why, "DIM A measured 3.2351 in, target 3.2342 in");
    assert_eq!(correction.verdict, Verdict::Good);
    assert_eq!(
        correction.effect,
        "wear X, offset 5: -0.0120 in -> -0.0129 in (-0.0009 in): the next diameter will be 0.0009 in smaller, about 3.2342 in"
    );
}

#[track_caller]
fn check_refused(change: impl Fn(&mut Dimension, &mut Entry, &mut Present), expected: &str) -> EntryError {
    let (mut dimension, mut typed, mut present) = (published(), entry("3.2351"), at(0.0));
    enter(&dimension, &typed, &present).expect("good before the change");
    change(&mut dimension, &mut typed, &mut present);
    let refused = enter(&dimension, &typed, &present).expect_err(expected);
    assert!(refused.to_string().contains(expected), "{refused}");
    refused
}

#[test]
fn entries_at_the_ends_of_the_window_and_beyond_are_alarms() {
    for (text, number) in [
        ("3.22", 100),
        ("3.2", 100),
        ("0", 100),
        ("-3.2351", 100),
        ("3.245", 101),
        ("3.2451", 101),
        ("99", 101),
    ] {
        let refused = check_refused(|_, e, _| e.text = text.into(), "DIMENSION ENTERED TOO");
        assert_eq!(refused.alarm().expect("an alarm").0, number, "{text}");
    }
    check_refused(
        |_, e, _| e.text = "3.2".into(),
        "alarm 100 DIMENSION ENTERED TOO SMALL: DIM A 3.2000 in is not above 3.2200 in; measure again",
    );
}

#[test]
fn a_size_in_the_wrong_unit_is_asked_about() {
    check_refused(
        |_, e, _| e.text = "82.17".into(),
        "DIM A 82.1700 in is not below 3.2450 in; did you mean 82.170 mm?",
    );
    let wrong_unit = |_: &mut Dimension, e: &mut Entry, _: &mut Present| e.unit = Unit::Mm;
    check_refused(wrong_unit, "DIM A 3.2351 mm is not above 3.2200 in; did you mean 3.2351 in?");
}

#[test]
fn checks_come_in_the_order_of_the_screen() {
    // Each of these also breaks what comes after it.
    check_refused(
        |d, e, _| {
            d.increment = Millimetres(0.0);
            e.text.clear();
        },
        "finest step",
    );
    check_refused(
        |_, e, p| {
            e.text.clear();
            p.last_entry = Some(e.when);
        },
        "no size was entered",
    );
    check_refused(
        |_, e, p| {
            e.text = "99".into();
            p.last_entry = Some(Timestamp(e.when.0 - 999_999_999));
            p.seen = Some(1.0);
        },
        "less than a second ago",
    );
    check_refused(
        |_, e, p| {
            e.text = "99".into();
            p.seen = Some(1.0);
        },
        "is 0 mm and no longer 1 mm",
    );
    check_refused(
        |d, e, _| {
            e.text = "99".into();
            d.largest_step = Millimetres(1e-6);
        },
        "TOO BIG",
    );
    check_refused(
        |d, _, _| d.largest_step = Millimetres(0.02),
        "would change lathe/tool/5/wear/x_mm by -0.0009 in, more than 0.00079 in in one step",
    );
    check_refused(|_, _, p| p.register = Some(f64::NAN), "holds NaN");
}

#[test]
fn a_level_three_may_make_a_large_step_and_level_zero_is_no_level() {
    let dimension = Dimension {
        largest_step: Millimetres(0.01),
        ..published()
    };
    for (level, allowed) in [(0, false), (1, true), (3, true), (4, false), (10, false)] {
        let found = enter(
            &dimension,
            &Entry {
                level,
                ..entry("3.2351")
            },
            &at(0.0),
        );
        assert_eq!(found.is_ok(), allowed, "level {level}");
    }
    let exactly = Dimension {
        largest_step: Unit::Inch.length(0.0009),
        ..published()
    };
    assert!(enter(&exactly, &entry("3.2351"), &at(0.0)).is_ok());
}

#[test]
fn an_entry_a_second_later_is_a_new_one() {
    let present = Present {
        last_entry: Some(Timestamp(entry("").when.0 - 1_000_000_000)),
        ..at(0.0)
    };
    assert!(enter(&published(), &entry("3.2351"), &present).is_ok());
}

#[test]
fn a_watched_size_is_judged_and_changes_nothing() {
    let watched = Dimension {
        role: Role::Watch,
        ..published()
    };
    let correction = enter(&watched, &entry("3.2440"), &at(0.5)).expect("good");
    assert_eq!(
        (correction.request, correction.after, correction.verdict),
        (None, 0.5, Verdict::TooLarge)
    );
    assert_eq!(correction.effect, "changes nothing: DIM A is only watched");
}

#[test]
fn sizes_that_share_a_register_move_it_by_their_mean_when_all_were_entered() {
    let shared = Dimension {
        role: Role::Mean,
        ..published()
    };
    let others = |asked: &[f64], missing: &[&str]| Present {
        others: Others {
            asked: asked.to_vec(),
            missing: missing.iter().map(|m| (*m).to_owned()).collect(),
        },
        ..at(0.0)
    };
    let waits = enter(&shared, &entry("3.2351"), &others(&[], &["DIM B"])).expect("good");
    assert_eq!((waits.change, waits.request), (0.0, None));
    assert_eq!(
        waits.effect,
        "changes nothing yet: DIM A and DIM B move their register by their mean"
    );
    // DIM A asks for -0.0009 in, DIM B for -0.0003 in.
    let moved = enter(&shared, &entry("3.2351"), &others(&[-0.0003 * 25.4], &[])).expect("good");
    assert_eq!(moved.change, tidy(-0.0006 * 25.4));
}

#[test]
fn half_a_step_goes_away_from_zero_whatever_the_dust_of_its_fractions() {
    let radius = Dimension {
        response: Response::Twice,
        ..published()
    };
    let steps = |text: &str| libm::round(enter(&radius, &entry(text), &at(0.0)).expect("good").change / 0.00254);
    for odd in 1..=41 {
        // Odd tenths of a thousandth: half of each is no whole step.
        let off = f64::from(2 * odd - 1);
        assert_eq!(steps(&format!("{:.4}", 3.2342 - off * 1e-4)), f64::from(odd), "{off} below");
        assert_eq!(steps(&format!("{:.4}", 3.2342 + off * 1e-4)), -f64::from(odd), "{off} above");
    }
}

#[test]
fn a_size_on_target_changes_nothing() {
    let correction = enter(&published(), &entry("3.23424"), &at(0.5)).expect("good");
    assert_eq!((correction.request, correction.change), (None, 0.0));
    assert_eq!(
        correction.effect,
        "changes nothing: 3.23424 in is within half a step of the target 3.2342 in"
    );
}

#[track_caller]
fn check_sign(what: &str, response: Response, measured: &str, change: f64, direction: &str) {
    let mm = Millimetres;
    let dimension = Dimension {
        unit: Unit::Mm,
        nominal: mm(20.0),
        low: mm(19.98),
        high: mm(20.02),
        target: mm(20.0),
        window: (mm(19.0), mm(21.0)),
        largest_step: mm(0.5),
        increment: mm(0.001),
        response,
        ..published()
    };
    let typed = Entry {
        unit: Unit::Mm,
        ..entry(measured)
    };
    let correction = enter(&dimension, &typed, &at(0.0)).expect(what);
    assert_eq!(correction.change, change, "{what}");
    assert!(
        correction.effect.contains(&format!(" {direction}, about ")),
        "{what}: {}",
        correction.effect
    );
}

#[test]
fn every_kind_of_size_moves_its_register_the_right_way() {
    check_sign(
        "outside diameter too large, diameter register",
        Response::Same,
        "20.1",
        -0.1,
        "smaller",
    );
    check_sign(
        "bore too large, diameter register: the tip moves in as well",
        Response::Same,
        "20.1",
        -0.1,
        "smaller",
    );
    check_sign("bore too small, diameter register", Response::Same, "19.9", 0.1, "larger");
    check_sign(
        "outside diameter too large, radius register",
        Response::Twice,
        "20.1",
        -0.05,
        "smaller",
    );
    check_sign("boss too small, cutter radius", Response::Twice, "19.9", 0.05, "larger");
    check_sign(
        "pocket too small, cutter radius",
        Response::OppositeTwice,
        "19.9",
        -0.05,
        "larger",
    );
    check_sign(
        "pocket too large, cutter radius",
        Response::OppositeTwice,
        "20.1",
        0.05,
        "smaller",
    );
    check_sign(
        "reversed X, outside diameter too large",
        Response::Opposite,
        "20.1",
        0.1,
        "smaller",
    );
}

#[test]
fn the_same_correction_cannot_be_applied_twice() {
    let mut registers = BTreeMap::new();
    let mut chain = ledger::Chain::default();
    let request = enter(&published(), &entry("3.2351"), &Present::default())
        .expect("good")
        .request
        .expect("a change");
    ledger::change(&mut registers, &mut chain, &request).expect("once");
    assert!(ledger::change(&mut registers, &mut chain, &request).is_err());
    assert_eq!(registers[&request.path], -0.02286);
}

fn any_response() -> impl Strategy<Value = Response> {
    prop_oneof![
        Just(Response::Times(-1.5)),
        Just(Response::Same),
        Just(Response::Twice),
        Just(Response::Opposite),
        Just(Response::OppositeTwice)
    ]
}

proptest! {
    /// A process whose size follows its register: whatever is measured, one entry brings the next part onto the target, as near as
    /// the steps of the register allow.
    #[test]
    fn one_entry_brings_the_next_part_onto_the_target(
        response in any_response(),
        target in 5.0..300.0_f64,
        off in -0.9..0.9_f64,
        register in -2.0..2.0_f64,
        increment in prop_oneof![Just(0.001), Just(0.0001), Just(0.00254)],
    ) {
        let mm = Millimetres;
        let dimension = Dimension {
            unit: Unit::Mm,
            nominal: mm(target),
            low: mm(target - 0.02),
            high: mm(target + 0.02),
            target: mm(target),
            window: (mm(target - 1.0), mm(target + 1.0)),
            largest_step: mm(1.0),
            increment: mm(increment),
            response,
            ..published()
        };
        let gain = response.size_per_register();
        let made_at_zero = target + off - gain * register;
        let process = |register: f64| made_at_zero + gain * register;
        let typed = Entry { unit: Unit::Mm, ..entry(&process(register).to_string()) };
        let correction = enter(&dimension, &typed, &at(register)).expect("inside the window");
        let next = process(correction.after);
        // Half a step, and the thousandth of a step that counts as dust.
        let finest = increment * gain.abs() * 0.5006 + 1e-8;
        prop_assert!((next - target).abs() <= finest, "{next} for {target}");
        prop_assert!((next - correction.next_part.0).abs() < 1e-8);
        prop_assert_eq!(correction.request.is_none(), correction.change == 0.0);
        // A second entry of the new size has nothing left to do, but for a size on the edge between two steps.
        let again = Entry { unit: Unit::Mm, ..entry(&next.to_string()) };
        let rest = enter(&dimension, &again, &at(correction.after)).expect("inside the window").change;
        prop_assert!(rest.abs() <= increment * 1.001);
    }

    #[test]
    fn no_entry_panics(text in ".{0,12}", register in proptest::option::of(proptest::num::f64::ANY), seen in proptest::option::of(proptest::num::f64::ANY)) {
        let present = Present { register, seen, ..Present::default() };
        if let Ok(correction) = enter(&published(), &entry(&text), &present) {
            prop_assert!(correction.after.is_finite());
        }
    }
}
