//! Feeds, spindle speeds and coolant of ISO 14649.

use super::*;

pub(super) fn technology(aim: Aim, id: u64) -> Technology {
    let mut technology = Technology::default();
    let Ok(instance) = aim.instance(id) else { return technology };
    let arguments: Vec<Value> = instance
        .records()
        .iter()
        .flat_map(|record| record.arguments.iter().cloned())
        .collect();
    let number = |n: usize| arguments.get(n).and_then(Value::number);
    // m/s and 1/s, by the measures of the standard.
    let per_time = number(0).map(|feed| FeedSetting::PerTime(MmPerSec(feed * 1000.0)));
    let turns = |speed: f64| match speed {
        0.0 => SpindleSetting::Stopped,
        _ => SpindleSetting::Revolutions {
            speed: Rpm(speed.abs() * 60.0),
            clockwise: speed < 0.0,
        },
    };
    let surface = |speed: f64, limit: Option<f64>| match speed {
        0.0 => SpindleSetting::Stopped,
        _ => SpindleSetting::Surface {
            speed: MmPerSec(speed.abs() * 1000.0),
            limit: limit.map(|limit| Rpm(limit.abs() * 60.0)),
            clockwise: speed < 0.0,
        },
    };
    if aim.keyword(id) == "TURNING_TECHNOLOGY" {
        technology.feed = per_time.or(number(3).map(|length| FeedSetting::PerRevolution(Millimetres(length))));
        let speed = arguments
            .get(2)
            .and_then(Value::reference)
            .and_then(|speed| aim.instance(speed).ok());
        if let Some(speed) = speed {
            technology.spindle = match (speed.part("CONST_SPINDLE_SPEED"), speed.part("CONST_CUTTING_SPEED")) {
                (Some(arguments), _) => arguments.first().and_then(Value::number).map(turns),
                (_, Some(arguments)) => {
                    let limit = arguments.get(1).and_then(Value::number);
                    arguments.first().and_then(Value::number).map(|speed| surface(speed, limit))
                }
                _ => None,
            };
        }
    } else {
        technology.feed = per_time.or(number(4).map(|length| FeedSetting::PerTooth(Millimetres(length))));
        technology.spindle = number(3).map(turns).or(number(2).map(|speed| surface(speed, None)));
    }
    technology
}

pub(super) fn functions(aim: Aim, id: u64) -> MachineFunctions {
    let mut functions = MachineFunctions::default();
    let Ok(instance) = aim.instance(id) else { return functions };
    let arguments: Vec<&Value> = instance.records().iter().flat_map(|record| &record.arguments).collect();
    let on = |n: usize| arguments.get(n).and_then(|value| value.boolean()).unwrap_or(false);
    functions.coolant = if aim.keyword(id) == "TURNING_MACHINE_FUNCTIONS" {
        let kind = arguments.get(1).and_then(|value| value.enumeration()).unwrap_or("FLOOD");
        CoolantState {
            flood: on(0) && kind == "FLOOD",
            mist: on(0) && kind == "MIST",
            through: on(0) && kind == "THROUGH_TOOL",
        }
    } else {
        CoolantState {
            flood: on(0),
            mist: on(2),
            through: on(3),
        }
    };
    functions
}
