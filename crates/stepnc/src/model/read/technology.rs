//! Feeds, spindle speeds and machine functions of the AIM.

use super::*;

pub(super) fn technology(aim: Aim, id: u64) -> Technology {
    let links = aim.links(id);
    let mut technology = Technology::default();
    if let Some(representation) = links.property("feedrate") {
        match feed(aim, representation) {
            Ok(feed) => technology.feed = feed,
            Err(fault) => technology.faults.push(fault),
        }
    }
    if let Some(representation) = links.property("spindle") {
        match spindle(aim, representation) {
            Ok(spindle) => technology.spindle = spindle,
            Err(fault) => technology.faults.push(fault),
        }
    }
    technology
}

fn feed(aim: Aim, representation: u64) -> Result<Option<FeedSetting>, Fault> {
    let representation = aim.representation(representation)?;
    let Some(&item) = representation.items.first() else {
        return Ok(None);
    };
    let name = aim.item_name(item);
    let name = if name.is_empty() { representation.name.clone() } else { name };
    let measure = aim.measure(item)?;
    // Older files write every feed as a plain speed: the unit tells, the name only tells teeth from revolutions.
    let feed = match measure.dimension {
        unit::SPEED => FeedSetting::PerTime(MmPerSec(measure.value)),
        unit::PER_REVOLUTION | unit::LENGTH if name == "feed per tooth" => FeedSetting::PerTooth(Millimetres(measure.value)),
        unit::PER_REVOLUTION => FeedSetting::PerRevolution(Millimetres(measure.value)),
        unit::LENGTH if name == "feed per revolution" => FeedSetting::PerRevolution(Millimetres(measure.value)),
        _ => {
            let message = format!("the unit of '{name}' is no feed's");
            return Err(Fault::new(
                item,
                "feed-unit",
                message,
                "give the feed in length per time or per revolution",
            ));
        }
    };
    Ok(Some(feed))
}

fn spindle(aim: Aim, representation: u64) -> Result<Option<SpindleSetting>, Fault> {
    let representation = aim.representation(representation)?;
    let mut surface = None;
    let mut limit = None;
    for &item in &representation.items {
        let name = aim.item_name(item);
        let measure = aim.measure(item)?;
        let per_minute = match measure.dimension {
            [0, -1, 0, 1] | [0, -1, 0, 0] => Some(measure.value * 60.0),
            [0, -1, 1, 0] => Some(measure.value * 60.0 / std::f64::consts::TAU),
            _ => None,
        };
        match (per_minute, measure.dimension) {
            (Some(speed), _) if name == "maximum rotational speed" => limit = Some(Rpm(speed.abs())),
            (Some(0.0), _) => return Ok(Some(SpindleSetting::Stopped)),
            (Some(speed), _) => {
                return Ok(Some(SpindleSetting::Revolutions {
                    speed: Rpm(speed.abs()),
                    clockwise: speed < 0.0,
                }));
            }
            (None, unit::SPEED) => surface = Some(measure.value),
            _ => {
                let message = format!("the unit of '{name}' is no spindle speed's");
                return Err(Fault::new(
                    item,
                    "spindle-unit",
                    message,
                    "give it in revolutions per time, or as a surface speed",
                ));
            }
        }
    }
    Ok(surface.map(|speed| match speed {
        0.0 => SpindleSetting::Stopped,
        _ => SpindleSetting::Surface {
            speed: MmPerSec(speed.abs()),
            limit,
            clockwise: speed < 0.0,
        },
    }))
}

pub(super) fn functions(aim: Aim, id: u64) -> MachineFunctions {
    let links = aim.links(id);
    let says = |property: &str, value: &str| {
        property_text(aim, &links, property).is_some_and(|text| text.trim().eq_ignore_ascii_case(value))
    };
    let on = says("coolant", "coolant on");
    let kind = property_text(aim, &links, "coolant type").unwrap_or_default();
    let mut functions = MachineFunctions {
        coolant: CoolantState {
            flood: on && (kind.is_empty() || kind == "flood"),
            mist: says("mist", "mist on") || (on && kind == "mist"),
            through: says("through spindle coolant", "through spindle coolant on") || (on && kind == "through tool"),
        },
        others: BTreeMap::new(),
    };
    let others = links.property("other functions").and_then(|id| aim.representation(id).ok());
    for item in others.map(|others| others.items).unwrap_or_default() {
        let mode = aim.description(item).unwrap_or_default();
        functions
            .others
            .entry(aim.item_name(item))
            .and_modify(|modes| {
                modes.push(',');
                modes.push_str(&mode);
            })
            .or_insert(mode);
    }
    functions
}
