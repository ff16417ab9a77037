//! Toolpaths of the AIM without their curves, read when they are asked for.

use super::*;

/// Reads a toolpath into `toolpath`, which has its identifier.
pub(in crate::model) fn read_toolpath(program: &Program, toolpath: &mut Toolpath) {
    let aim = program.aim();
    let id = toolpath.id;
    let instance = match aim.instance(id) {
        Ok(instance) => instance,
        Err(fault) => return toolpath.faults.push(fault),
    };
    let attributes = aim.attributes(&instance, "ACTION_METHOD");
    toolpath.name = attributes.first().map(text).unwrap_or_default().into_owned();
    toolpath.description = attributes.get(1).map(text).unwrap_or_default().into_owned();
    let links = aim.links(id);
    toolpath.technology = links.related("MACHINING_TECHNOLOGY_RELATIONSHIP");
    toolpath.functions = links.related("MACHINING_FUNCTIONS_RELATIONSHIP");
    toolpath.twin = twin_facts(aim, &links, true);
    toolpath.trajectory = property_text(aim, &links, "trajectory type").unwrap_or_default();
    toolpath.reversed =
        property_text(aim, &links, "direction").is_some_and(|direction| direction.eq_ignore_ascii_case("end to beginning"));
    toolpath.values = values_of(aim, &links, &KNOWN);
    let mut read = || -> Result<(), Fault> {
        if let Some(representation) = links.property("basic curve") {
            let representation = aim.representation(representation)?;
            // A placement or a point beside the curve is not it.
            let is_curve = |&&item: &&u64| !curve::is_placement(aim, item) && aim.keyword(item) != "CARTESIAN_POINT";
            let items = &representation.items;
            let curve = items.iter().find(is_curve).or(items.first());
            toolpath.curve = curve.map(|&curve| (representation.id, curve));
            toolpath.context = representation.context;
        }
        if let Some(representation) = links.property("tool axis")
            && let Some(&curve) = aim.representation(representation)?.items.first()
        {
            toolpath.tilted = curve::is_tilted(aim, curve);
        }
        if let Some(representation) = links.property("dwell") {
            toolpath.dwell = dwell(aim, representation)?;
        }
        if let Some(representation) = links.property("speed profile") {
            match speed_profile(aim, representation)? {
                None => toolpath.kind = ToolpathKind::Rapid,
                profile => toolpath.profile = profile,
            }
        }
        if let Some(representation) = links.property("path maximum deviation")
            && let Some(&item) = aim.representation(representation)?.items.first()
        {
            let deviation = aim.measure_of(item, unit::LENGTH, "path maximum deviation")?;
            toolpath.maximum_deviation = Some(Millimetres(deviation.abs()));
        }
        Ok(())
    };
    let outcome = read();
    toolpath.faults.extend(outcome.err());
    if toolpath.description == "feedstop" {
        toolpath.kind = ToolpathKind::Dwell;
    }
}

/// Properties with a place of their own in [`Toolpath`].
const KNOWN: [&str; 12] = [
    "twin worktime",
    "basic curve",
    "tool axis",
    "tool reference direction",
    "surface normal",
    "dwell",
    "speed profile",
    "path maximum deviation",
    "trajectory type",
    "direction",
    "twin source",
    "twin exception",
];

fn dwell(aim: Aim, representation: u64) -> Result<Option<Dwell>, Fault> {
    let representation = aim.representation(representation)?;
    let Some(&item) = representation.items.first() else {
        return Ok(None);
    };
    let measure = aim.measure(item)?;
    let revolutions = representation.name == "dwell revolution" || aim.item_name(item) == "dwell revolution";
    match measure.dimension {
        unit::TIME if measure.value >= 0.0 => Ok(Some(Dwell::Time(Seconds(measure.value)))),
        unit::NUMBER | unit::REVOLUTIONS if revolutions && measure.value >= 0.0 => Ok(Some(Dwell::Revolutions(measure.value))),
        _ => Err(Fault::new(
            item,
            "dwell",
            "a dwell is neither a time nor revolutions",
            "give the dwell as a time",
        )),
    }
}

/// The multiplier along a path; `None` is rapid.
fn speed_profile(aim: Aim, representation: u64) -> Result<Option<SpeedProfile>, Fault> {
    let representation = aim.representation(representation)?;
    let fault = |message: &str| {
        Fault::new(
            representation.id,
            "speed-profile",
            message,
            "use 'rapid', a ratio or a curve of numbers",
        )
    };
    let Some(&item) = representation.items.first() else {
        return Err(fault("a speed profile is empty"));
    };
    if aim.keyword(item) == "DESCRIPTIVE_REPRESENTATION_ITEM" {
        return match aim.description(item).as_deref() {
            Some(speed) if speed.trim().eq_ignore_ascii_case("rapid") => Ok(None),
            _ if aim.item_name(item).eq_ignore_ascii_case("rapid") => Ok(None),
            _ => Err(fault("the only speed that has a name is 'rapid'")),
        };
    }
    if aim.is(item, "BOUNDED_CURVE")
        || aim.keyword(item) == "POLYLINE"
        || aim.keyword(item).ends_with("_CURVE")
        || aim.is(item, "B_SPLINE_CURVE_WITH_KNOTS")
    {
        let numbers = curve::numbers_along(aim, item)?;
        let last = (numbers.len() - 1).max(1) as f64;
        let points = numbers
            .into_iter()
            .enumerate()
            .map(|(n, factor)| (n as f64 / last, factor))
            .collect();
        return Ok(Some(SpeedProfile { points }));
    }
    // A ratio is the same in every unit of ratios, and some write none.
    let bare = || {
        aim.named_item(String::new(), item, None)
            .filter(|value| value.unit() == Some(""))
    };
    let ratio = match aim.measure_of(item, unit::NUMBER, "a speed profile") {
        Ok(ratio) => ratio,
        Err(fault) => bare().and_then(|value| value.number()).ok_or(fault)?,
    };
    if ratio <= 0.0 {
        return Err(fault("a feed multiplier is not above 0"));
    }
    Ok(Some(SpeedProfile {
        points: vec![(0.0, ratio), (1.0, ratio)],
    }))
}
