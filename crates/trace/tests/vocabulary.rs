//! Laws that every function of the table keeps.

use proptest::prelude::*;
use trace::unit::Dimension;
use trace::{FUNCTIONS, Kind, parse};

#[test]
fn every_example_is_read_as_its_own_function_and_printed_as_it_stands() {
    for definition in FUNCTIONS {
        let function = parse(definition.example).unwrap_or_else(|e| panic!("{}: {e}", definition.name));
        assert_eq!(function.name, definition.name);
        assert_eq!(function.to_string(), definition.example);
    }
}

#[test]
fn names_are_unique_and_keys_are_unique_within_a_function() {
    for (k, definition) in FUNCTIONS.iter().enumerate() {
        for other in &FUNCTIONS[..k] {
            assert_ne!(other.name, definition.name);
        }
        let keys: Vec<&str> = definition.keys().map(|key| key.name).collect();
        for (n, key) in keys.iter().enumerate() {
            assert!(!keys[..n].contains(key), "{} {key}", definition.name);
            assert_eq!(definition.key(key).map(|k| k.name), Some(*key));
            let bare = key.strip_prefix("its_").unwrap_or(key);
            assert_eq!(definition.key(&bare.to_uppercase()).map(|k| k.name), Some(*key));
        }
    }
}

#[test]
fn what_is_missing_is_named_for_every_required_key() {
    for definition in FUNCTIONS {
        if let Some(key) = definition.keys().find(|key| key.required) {
            let error = parse(&format!("trace:1 {}", definition.name)).expect_err("it needs a key");
            assert!(error.message.contains(key.name), "{error}");
        }
    }
}

#[track_caller]
fn check(line: &str, expected: &str) {
    let shown = match parse(line) {
        Ok(function) => function.to_string(),
        Err(error) => error.to_string(),
    };
    assert_eq!(shown, expected);
}

#[test]
fn lines_are_read_in_any_case_and_with_or_without_its() {
    check("trace:1 get_time label=\"x\"", "trace:1 get_time its_label=x");
    check(
        "TRACE:1 GET_TIME ITS_LABEL=\"First Part\"",
        "trace:1 get_time its_label=\"First Part\"",
    );
    check(
        "trace:1 set_authorization_level its_level=3",
        "trace:1 set_edit_access_level its_level=3",
    );
    check(
        "trace:1 start_sensor_recording its_function_id=2 its_sensors=coolant_pressure its_sampling=TIME:20ms",
        "trace:1 start_sensor_recording its_function_id=2 its_sensors=coolant_pressure its_sampling=time:0.02s",
    );
    check(
        "trace:1 get_axis_displacement its_axis=X its_tolerance=0.05 mm frame=WORK",
        "trace:1 get_axis_displacement its_axis=X its_tolerance=0.05mm frame=work",
    );
    check(
        "trace:1 log_event its_kind=a its_values=  v1 , v2",
        "trace:1 log_event its_kind=a its_values=v1,v2",
    );
}

#[test]
fn an_unknown_function_is_kept_as_it_stands() {
    check(
        "trace:1  paint_part colour=red  shade=\"x y\" ",
        "trace:1 paint_part colour=red  shade=\"x y\"",
    );
}

#[test]
fn mistakes_are_told_with_column_and_remedy() {
    check(
        "trace:1 get_time its_lable=x",
        "error: line 1, column 18: get_time has no key 'its_lable'; write its_label",
    );
    check(
        "trace:2 get_time",
        "error: line 1, column 1: 'trace:2' is another version of the grammar than trace:1; write trace:1 and the function's name",
    );
    check(
        "trace:1 set_alarm its_alarm_id=1000 its_text=x",
        "error: line 1, column 32: '1000' is not what its_alarm_id takes; write a whole number 1 to 999",
    );
    check(
        "trace:1 set_alarm its_alarm_id=1 its_text=x its_reaction=hold",
        "error: line 1, column 58: 'hold' is not what its_reaction takes; write one of none, feed_hold, stop_after_operation, stop_now",
    );
    check(
        "trace:1 get_time its_label=\"x",
        "error: line 1, column 28: the text that begins here has no end; close it with a double quote; a quote inside is written twice",
    );
    check(
        "trace:1 stop_sensor_recording",
        "error: line 1, column 30: stop_sensor_recording needs its_function_id; add its_function_id=...",
    );
    check(
        "trace:1 get_time its_label=a its_label=b",
        "error: line 1, column 30: its_label is given twice; give it once",
    );
    check(
        "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"ws_time >\" its_actions=\"get_time\"",
        "error: line 1, column 106: expected a number, a sensor, a predefined value, 'not' or '(', found the end; write a condition \
         like ws_time > 3600 s and X.LOAD >= 80 %",
    );
    check(
        "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_actions=\"get_time its_lable=x\"",
        "error: line 1, column 85: get_time has no key 'its_lable'; write its_label",
    );
    check(
        "trace:1 get_feedrate_points number_of_points=3 tolerance=-1mm",
        "error: line 1, column 58: '-1mm' is not what tolerance takes; write a number from 0, mm",
    );
    check(
        "trace:1 log_coolant_data concentration=800",
        "error: line 1, column 40: '800' is not what concentration takes; write a number from 0 to 100, %",
    );
    check(
        "trace:1 log_coolant_data filled=20.11.2026",
        "error: line 1, column 33: '20.11.2026' is not what filled takes; write a day or time, as 2026-11-20 or 2026-11-20T06:00:00Z",
    );
    check(
        "trace:1",
        "error: line 1, column 8: the function's name is missing; write trace:1, a name as get_time, then key=value",
    );
}

/// A value that a key takes.
fn value(kind: Kind) -> BoxedStrategy<String> {
    let quoted = |text: String| format!("\"{}\"", text.replace('"', "\"\""));
    match kind {
        Kind::Text => "[!-~][ -~äµ]{0,12}".prop_map(quoted).boxed(),
        Kind::Integer(from, to) => (from..=to).prop_map(|n| n.to_string()).boxed(),
        Kind::Number(Dimension::Percent) => (0f64..=100.0).prop_map(|n| format!("{n}%")).boxed(),
        Kind::Number(_) => (0f64..1e6).prop_map(|n| n.to_string()).boxed(),
        Kind::State => prop_oneof!["ON", "off", "TRUE"].boxed(),
        Kind::Word(words) => proptest::sample::select(words).prop_map(str::to_uppercase).boxed(),
        Kind::List => proptest::collection::vec("[A-Za-z._0-9]{1,8}", 1..4)
            .prop_map(|l| l.join(","))
            .boxed(),
        Kind::Condition => prop_oneof![
            Just("\"ws_time > 3600 s and (X.LOAD >= 80 % or not alarm[3])\"".to_owned()),
            Just("\"-(Z.POSITION.ACTUAL - 2 mm) / 3 < 1e-3 xor true\"".to_owned()),
        ]
        .boxed(),
        Kind::Actions => proptest::collection::vec("[!-~][ -~]{0,12}", 1..4)
            .prop_map(|texts| {
                let action = |text: String| format!("log_event its_kind=k its_text=\"{}\"", text.replace('"', "\"\""));
                let lines: Vec<String> = texts
                    .into_iter()
                    .map(|text| format!("\"{}\"", action(text).replace('"', "\"\"")))
                    .collect();
                lines.join(",")
            })
            .boxed(),
        Kind::Sampling => proptest::sample::select(vec![
            "10",
            "time:20ms",
            "distance:0.5mm",
            "count:200",
            "points:#row",
            "points:#row:0.02mm",
        ])
        .prop_map(str::to_owned)
        .boxed(),
        Kind::Reference => "#[a-z0-9]{1,8}".boxed(),
        Kind::Moment => "20[0-9]{2}-0[1-9]-[12][0-8](T[01][0-9]:[0-5][0-9]:[0-5][0-9](Z|[+]01:00))?".boxed(),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_function_with_any_arguments_is_printed_and_read_back_alike(
        (line, _) in proptest::sample::select(FUNCTIONS).prop_flat_map(|definition| {
            let arguments: Vec<_> = definition
                .keys()
                .map(|key| (any::<bool>(), value(key.kind)).prop_map(move |(given, value)| {
                    if given || key.required { format!(" {}={value}", key.name) } else { String::new() }
                }))
                .collect();
            (arguments, Just(definition)).prop_map(|(arguments, definition)| {
                (format!("trace:1 {}{}", definition.name, arguments.concat()), definition)
            })
        })
    ) {
        let function = parse(&line).map_err(|e| TestCaseError::fail(format!("{line}: {e}")))?;
        let printed = function.to_string();
        prop_assert_eq!(parse(&printed).map(|f| f.to_string()), Ok(printed.clone()));
        prop_assert_eq!(&parse(&printed).expect("read back"), &function);
        // And through the comments of G-code.
        let mut text = String::new();
        for comment in trace::comment::write(&function) {
            match trace::comment::read(&comment[1..comment.len() - 1]) {
                trace::comment::Comment::Begins(line) => text = line,
                trace::comment::Comment::GoesOn(more) => text = trace::comment::joined(&text, &more),
                trace::comment::Comment::Other => prop_assert!(false, "{}", comment),
            }
        }
        prop_assert_eq!(parse(&text).map(|f| f.to_string()), Ok(printed), "{}", text);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in "[ -~]{0,60}", start in "trace:1 (start_synchronized_action|get_time|set_alarm) ") {
        let _ = parse(&format!("{start}{text}"));
        let _ = parse(&text);
    }
}
