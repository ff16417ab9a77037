//! The tree of a program as a person reads it: names first, then what is set, lengths and times in columns.

use super::Tree;
use crate::say;
use ::plan::inspection::{DimensionEntry, FeatureEntry, NamedValue, Node, PathEntry, Quantity, ToolEntry};

/// Prints the whole tree, or the one toolpath that was asked for.
pub fn print(name: &str, found: &Tree, only: Option<&PathEntry>) {
    let s = &found.summary;
    let written = match found.units {
        "none" => String::new(),
        units => format!(", written in {units}"),
    };
    say(&format!("{name}: {} {}{written}", found.kind, found.schema));
    if let Some(path) = only {
        return say(&path_line(path, "", 0));
    }
    let feeds = s.toolpaths.saturating_sub(s.rapids + s.dwells);
    say(&format!(
        "{}{}, {} = {} rapid + {feeds} feed + {} dwell, {}, {}",
        count(s.workingsteps_enabled, "workingstep"),
        match s.workingsteps_disabled {
            0 => String::new(),
            disabled => format!(" (and {disabled} disabled)"),
        },
        count(s.toolpaths, "toolpath"),
        s.rapids,
        s.dwells,
        count(s.tools, "tool"),
        count(s.nc_functions, "NC function"),
    ));
    for node in &found.tree {
        say("");
        print_node(node, "", "", &[]);
    }
    if !found.tools.is_empty() {
        say("\nTools");
        found.tools.iter().for_each(print_tool);
    }
    if !found.dimensions.is_empty() {
        say("\nDimensions and tolerances");
        found.dimensions.iter().for_each(print_dimension);
    }
    say("");
}

fn print_dimension(dimension: &DimensionEntry) {
    let mut line = format!("  {} #{}", dimension.kind, dimension.id);
    let of: Vec<String> = dimension
        .of
        .iter()
        .filter(|name| !name.is_empty())
        .map(|name| format!("'{name}'"))
        .collect();
    if !of.is_empty() {
        line += &format!(" of {}", of.join(" and "));
    }
    line += ":";
    if let Some(nominal) = dimension.nominal_mm {
        line += &format!(" {nominal} mm");
    }
    if let (Some(lower), Some(upper)) = (dimension.lower_mm, dimension.upper_mm) {
        line += &format!(" {lower:+} / {upper:+}");
    }
    if let Some(fit) = &dimension.fit {
        line += &format!(" {fit}");
    }
    if let Some(zone) = dimension.tolerance_mm {
        line += &format!(" within {zone} mm");
    }
    say(line.trim_end_matches(':'));
}

fn count(number: u64, what: &str) -> String {
    match number {
        1 => format!("1 {what}"),
        number => format!("{number} {what}s"),
    }
}

/// A node with its line's `lead` and the lead of what is below it; what is said above already is not said again.
fn print_node(node: &Node, lead: &str, below: &str, above: &[NamedValue]) {
    say(&format!("{lead}{}", node_line(node)));
    let details = details(node, above);
    let items = node.children.len() + node.toolpaths.len();
    let bar = if items > 0 { "│  " } else { "   " };
    for detail in details {
        say(&format!("{below}{bar}{detail}"));
    }
    let widest = node
        .toolpaths
        .iter()
        .map(|path| shown_name(path).chars().count())
        .max()
        .unwrap_or(0)
        .min(40);
    for (n, path) in node.toolpaths.iter().enumerate() {
        let branch = if n + 1 == items { "└─ " } else { "├─ " };
        say(&path_line(path, &format!("{below}{branch}"), widest));
    }
    let known: Vec<NamedValue> = above.iter().chain(&node.values).cloned().collect();
    for (n, child) in node.children.iter().enumerate() {
        let last = node.toolpaths.len() + n + 1 == items;
        let (branch, bar) = if last { ("└─ ", "   ") } else { ("├─ ", "│  ") };
        print_node(child, &format!("{below}{branch}"), &format!("{below}{bar}"), &known);
    }
}

fn node_line(node: &Node) -> String {
    let what = match (&node.function, node.kind.as_str()) {
        (Some(function), _) => function.kind.clone(),
        (None, kind) => kind.to_owned(),
    };
    let mut line = format!("{what} '{}' #{}", node.name, node.id);
    if let Some(function) = node.function.as_ref().filter(|function| !function.text.is_empty()) {
        line += &format!(": {}", function.text);
    }
    if let Some(condition) = &node.condition {
        line += &format!(": {condition}");
    }
    if let Some(tool) = &node.tool {
        line += &format!("  {tool}");
    }
    if let Some(setup) = &node.setup {
        line += &format!("  set-up '{setup}'");
    }
    if let Some(project) = node.project.as_ref().filter(|project| **project != node.name) {
        line += &format!("  of project '{project}'");
    }
    if let Some(time) = node.time_s {
        line += &format!("  {}", duration(time));
    }
    if !node.enabled {
        line += "  (disabled)";
    }
    if node.twin {
        line += "  (as executed)";
    }
    match (&node.twin_of_uri, node.twin_of) {
        (Some(uri), _) => line += &format!(" of {uri}"),
        (None, Some(plan)) => line += &format!(" of #{plan}"),
        (None, None) => {}
    }
    line
}

/// The lines below a node's own: feature, operation, and what else is said of it.
fn details(node: &Node, above: &[NamedValue]) -> Vec<String> {
    let mut lines = Vec::new();
    for feature in &node.features {
        if stands_for_none(feature) {
            continue;
        }
        lines.extend(sentence(
            &format!("feature '{}' #{} {}", feature.name, feature.id, words(&feature.kind)),
            &feature.values,
        ));
    }
    if let Some(operation) = &node.operation {
        let variant = match operation.variant.as_str() {
            "" => String::new(),
            variant => format!(", {variant}"),
        };
        let bare = if node.toolpaths.is_empty() {
            ": no toolpaths, described by its feature only"
        } else {
            ""
        };
        lines.extend(sentence(
            &format!(
                "{} '{}' #{}{variant}{bare}",
                words(&operation.kind),
                operation.name,
                operation.id
            ),
            &operation.values,
        ));
    }
    let news: Vec<NamedValue> = node.values.iter().filter(|value| !above.contains(value)).cloned().collect();
    if !news.is_empty() {
        lines.extend(sentence("", &news));
    }
    lines
}

/// The feature that a workingstep of bare toolpaths has, because it must have one.
fn stands_for_none(feature: &FeatureEntry) -> bool {
    let nothing = |value: &NamedValue| {
        matches!(
            value.value,
            Quantity::Place {
                place_mm: [0.0, 0.0, 0.0]
            }
        )
    };
    feature.kind == "INSTANCED_FEATURE" && feature.values.iter().all(nothing)
}

/// Something and what is said of it, in lines of bearable length.
fn sentence(head: &str, values: &[NamedValue]) -> Vec<String> {
    const WIDTH: usize = 110;
    let mut lines = vec![head.to_owned()];
    for value in values {
        let value = value.to_string();
        let line = lines.last_mut().expect("there is one from the beginning");
        let joint = match line.as_str() {
            "" => "",
            line if line == head => ": ",
            _ => ", ",
        };
        if line.chars().count() + value.chars().count() > WIDTH && !line.is_empty() {
            line.push_str(if line == head { ":" } else { "," });
            lines.push(format!("  {value}"));
        } else {
            line.push_str(&format!("{joint}{value}"));
        }
    }
    lines
}

/// An entity name as words.
fn words(entity: &str) -> String {
    entity.to_lowercase().replace('_', " ")
}

fn shown_name(path: &PathEntry) -> String {
    match path.name.as_str() {
        "" => format!("#{}", path.id),
        name => format!("{name} #{}", path.id),
    }
}

fn path_line(path: &PathEntry, lead: &str, width: usize) -> String {
    let name = shown_name(path);
    let pad = " ".repeat(width.saturating_sub(name.chars().count()));
    let mut line = format!("{lead}{:5}  {name}{pad}", path.kind);
    line += &match (path.kind, path.length_mm) {
        ("dwell", _) => format!("  {:>10}", path.dwell_s.map_or(String::new(), |time| format!("{time} s"))),
        (_, Some(length)) => format!("  {length:>7.1} mm"),
        (_, None) => format!("  {:>10}", ""),
    };
    let time = path.time_s.filter(|_| path.kind != "dwell");
    line += &format!("  {:>8}", time.map_or(String::new(), duration));
    let feed = match (path.feed_mm_rev, path.feed_mm_s) {
        (Some(feed), _) => format!("{feed} mm/rev"),
        (None, Some(feed)) => format!("{:.0} mm/min", feed * 60.0),
        (None, None) => String::new(),
    };
    let direction = path.spindle_direction.unwrap_or_default();
    let spindle = match (path.surface_speed_mm_s, path.spindle_rpm, direction) {
        (Some(surface), _, "cw" | "ccw") => format!("{:.0} m/min {direction}", surface * 0.06),
        (None, Some(rpm), "cw" | "ccw") => format!("{rpm:.0} rev/min {direction}"),
        (None, None, "cw" | "ccw") => direction.to_owned(),
        _ => String::new(),
    };
    line += &format!("  {feed:>11}  {spindle:<15}");
    if !path.trajectory.is_empty() && path.trajectory != "trajectory path" {
        line += &format!("  {}", path.trajectory);
    }
    if let Some(deviation) = path.maximum_deviation_mm {
        line += &format!("  within {deviation} mm");
    }
    line.trim_end().to_owned()
}

fn print_tool(tool: &ToolEntry) {
    let mut head = format!("  {} #{} {}", tool.tool, tool.id, tool.kind);
    if tool.tool.to_string() != format!("T{}", tool.name) && !tool.tool.to_string().contains(&tool.name) {
        head += &format!(" '{}'", tool.name);
    }
    for (n, line) in sentence(&head, &tool.values).into_iter().enumerate() {
        say(&if n == 0 { line } else { format!("    {line}") });
    }
}

/// A time as a machinist says it.
fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 59.95 => format!("{s:.1} s"),
        s if s < 3599.5 => format!("{}:{:02} min", (s / 60.0) as u64, (s % 60.0) as u64),
        s => format!("{}:{:02} h", (s / 3600.0) as u64, (s / 60.0 % 60.0) as u64),
    }
}
