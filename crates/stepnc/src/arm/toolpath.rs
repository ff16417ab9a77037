//! Toolpaths of ISO 14649: trajectories, dwells, connections.

use super::*;

/// Reads a toolpath into `toolpath`, which has its identifier.
pub(crate) fn read_toolpath(program: &Program, toolpath: &mut Toolpath) {
    let aim = program.aim();
    let instance = match aim.instance(toolpath.id) {
        Ok(instance) => instance,
        Err(fault) => return toolpath.faults.push(fault),
    };
    let keyword = aim.keyword(toolpath.id);
    let arguments: Vec<&Value> = instance.records().iter().flat_map(|record| &record.arguments).collect();
    let argument = |n: usize| arguments.get(n).copied().unwrap_or(&Value::Unset);
    let described = match keyword {
        "CONNECT_SECPLANE" => "connect security plane".to_string(),
        "AP_LIFT_PATH_ANGLE" | "AP_LIFT_PATH_TANGENT" => keyword.replacen("AP_", "APPROACH_", 1).to_lowercase().replace('_', " "),
        _ => keyword.to_lowercase().replace('_', " "),
    };
    toolpath.description = described;
    toolpath.trajectory = argument(1).enumeration().unwrap_or_default().to_lowercase().replace('_', " ");
    match argument(2) {
        Value::Unset | Value::Derived => {}
        speed if names_rapid(speed) => toolpath.kind = ToolpathKind::Rapid,
        Value::Reference(id) => match speed_profile(aim, *id) {
            Ok(None) => toolpath.kind = ToolpathKind::Rapid,
            Ok(profile) => toolpath.profile = profile,
            Err(fault) => toolpath.faults.push(fault),
        },
        speed => match speed.number() {
            Some(ratio) if ratio > 0.0 => toolpath.profile = Some(constant(ratio)),
            _ => toolpath.faults.push(Fault::new(
                toolpath.id,
                "speed-profile",
                "the speed of a toolpath is neither rapid, a ratio nor a curve",
                "use one of them",
            )),
        },
    }
    toolpath.technology = argument(3).reference();
    toolpath.functions = argument(4).reference();
    match keyword {
        "FEEDSTOP" => {
            toolpath.kind = ToolpathKind::Dwell;
            toolpath.dwell = argument(5)
                .number()
                .filter(|time| *time >= 0.0)
                .map(|time| Dwell::Time(Seconds(time)));
        }
        "CUTTER_LOCATION_TRAJECTORY" | "CUTTER_CONTACT_TRAJECTORY" => {
            toolpath.reversed = argument(5).boolean() == Some(false);
            let is_curve = |id: &u64| {
                let keyword = aim.keyword(*id);
                keyword == "POLYLINE" || keyword.contains("CURVE")
            };
            let curve = argument(6).reference();
            let curve = curve.or_else(|| arguments.iter().filter_map(|value| value.reference()).find(is_curve));
            toolpath.curve = curve.map(|curve| (toolpath.id, curve));
            toolpath.tilted = argument(7).reference().is_some_and(|axis| curve::is_tilted(aim, axis));
        }
        _ => {}
    }
    // The path has no name of its own; its curve often has one.
    if let Some((_, curve)) = toolpath.curve {
        toolpath.name = aim.item_name(curve);
    }
}

/// `.RAPID.`, typed or not.
fn names_rapid(value: &Value) -> bool {
    match value {
        Value::Typed(_, inner) => inner.iter().any(names_rapid),
        value => value.enumeration() == Some("RAPID"),
    }
}

fn constant(ratio: f64) -> SpeedProfile {
    SpeedProfile {
        points: vec![(0.0, ratio), (1.0, ratio)],
    }
}

/// A TOOLPATH_SPEED holds a one-dimensional curve; `None` is rapid.
fn speed_profile(aim: Aim, id: u64) -> Result<Option<SpeedProfile>, Fault> {
    let instance = aim.instance(id)?;
    if instance
        .records()
        .iter()
        .flat_map(|record| &record.arguments)
        .any(names_rapid)
    {
        return Ok(None);
    }
    let curve = match instance.part("TOOLPATH_SPEED") {
        Some(arguments) => arguments.iter().find_map(Value::reference),
        None => Some(id),
    };
    let curve = curve.ok_or_else(|| Fault::new(id, "speed-profile", "a speed profile has no curve", "give it one"))?;
    let numbers = curve::numbers_along(aim, curve)?;
    let last = (numbers.len() - 1).max(1) as f64;
    let points = numbers.into_iter().enumerate().map(|(n, factor)| (n as f64 / last, factor));
    Ok(Some(SpeedProfile {
        points: points.collect(),
    }))
}
