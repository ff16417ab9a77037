//! `toolmark inspect`: what is in a program.

use super::{Done, print_json};
use crate::cli::{Common, InspectArgs};
use crate::failure::{Exit, Failure};
use crate::program::{Kind, Program, named_machine};
use crate::say;
use plan::Tables;
use serde_json::Value;

/// Runs the command.
///
/// # Errors
/// The program cannot be read, or `--select` names nothing or too much.
pub fn inspect(args: &InspectArgs, common: &Common) -> Done {
    let program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    let json = |inspection: Result<Value, serde_json::Error>| {
        inspection.map_err(|e| Failure::machine(format_args!("the tree is no JSON: {e}")))
    };
    let mut found = match &program.kind {
        Kind::StepNc(p) => {
            let mut inspection = stepnc::inspect::inspect(p);
            inspection
                .problems
                .extend(stepnc::problems::violations(p).iter().map(Into::into));
            json(serde_json::to_value(inspection))?
        }
        Kind::Gcode { profile, .. } => {
            let mut stream = program.gcode(&Tables::empty())?;
            json(serde_json::to_value(gcode::inspect::inspect(
                &mut stream,
                profile.name,
                gcode::GcodeProgram::in_inches,
            )))?
        }
        Kind::CutterLocation => {
            let mut stream = program.cutter_location(&Tables::empty())?;
            let mut tree = json(serde_json::to_value(gcode::inspect::inspect(
                &mut stream,
                program.dialect().0,
                apt::AptProgram::in_inches,
            )))?;
            tree["kind"] = "cutter-location".into();
            tree
        }
    };
    if let Some(path) = &args.select {
        let id = match &program.kind {
            Kind::StepNc(p) => stepnc::select::select(p, path).map_err(Failure::usage)?.id(),
            Kind::Gcode { .. } | Kind::CutterLocation => by_name(&found["tree"], path)?,
        };
        let part = find(&found["tree"], id).cloned();
        let part = part.ok_or_else(|| Failure::usage(format_args!("'{path}' is no part of the program's tree")))?;
        found["tree"] = Value::Array(vec![part]);
    }
    let bad = found["problems"]
        .as_array()
        .is_some_and(|all| all.iter().any(|p| p["severity"] == "error"));
    if common.json {
        if args.problems {
            print_json(&serde_json::json!({ "problems": found["problems"] }))?;
        } else {
            print_json(&found)?;
        }
    } else {
        if !args.problems {
            print_tree(&program, &found);
        }
        print_problems(&found);
    }
    Ok(if bad && args.problems { Exit::Negative } else { Exit::Good })
}

fn find(tree: &Value, id: u64) -> Option<&Value> {
    tree.as_array()?.iter().find_map(|node| {
        let here = node["id"].as_u64() == Some(id);
        if here {
            Some(node)
        } else {
            find(&node["children"], id).or_else(|| find(&node["toolpaths"], id))
        }
    })
}

/// The part of a G-code tree that has a name, or `#line`.
fn by_name(tree: &Value, path: &str) -> Result<u64, Failure> {
    fn named(tree: &Value, name: &str, into: &mut Vec<u64>) {
        for node in tree.as_array().into_iter().flatten() {
            if node["name"] == name {
                into.extend(node["id"].as_u64());
            }
            named(&node["children"], name, into);
        }
    }
    if let Some(id) = path.strip_prefix('#').and_then(|id| id.parse().ok()) {
        return Ok(id);
    }
    let name = path.rsplit('/').next().unwrap_or(path);
    let mut found = vec![];
    named(tree, name, &mut found);
    match found[..] {
        [id] => Ok(id),
        [] => Err(Failure::usage(format_args!("nothing in the program is called '{path}'"))),
        _ => {
            let candidates: Vec<String> = found.iter().map(|id| format!("#{id}")).collect();
            Err(Failure::usage(format_args!(
                "'{path}' could be any of: {}",
                candidates.join(", ")
            )))
        }
    }
}

fn print_tree(program: &Program, found: &Value) {
    let s = &found["summary"];
    let count = |name: &str| s[name].as_u64().unwrap_or(0);
    say(&format!(
        "{}: {} {}, {}",
        program.name,
        found["kind"].as_str().unwrap_or(""),
        found["schema"].as_str().unwrap_or(""),
        found["units"].as_str().unwrap_or("")
    ));
    let feeds = count("toolpaths").saturating_sub(count("rapids") + count("dwells"));
    say(&format!(
        "{} workingsteps ({} disabled), {} toolpaths = {} rapid + {} feed + {} dwell, {} tools, {} NC functions",
        count("workingsteps_enabled"),
        count("workingsteps_disabled"),
        count("toolpaths"),
        count("rapids"),
        feeds,
        count("dwells"),
        count("tools"),
        count("nc_functions")
    ));
    print_nodes(&found["tree"], 0);
}

fn print_nodes(nodes: &Value, depth: usize) {
    for node in nodes.as_array().into_iter().flatten() {
        let text = |name: &str| node[name].as_str().unwrap_or("").to_owned();
        let indent = "  ".repeat(depth);
        if node.get("kind").is_some() && node.get("type").is_none() {
            print_path(node, &indent);
            continue;
        }
        let mut line = format!("{indent}{} {} #{}", text("type"), text("name"), node["id"]);
        match &node["tool"] {
            Value::Number(n) => line += &format!("  T{n}"),
            Value::String(name) => line += &format!("  tool {name}"),
            _ => {}
        }
        if node["enabled"] == false {
            line += "  (disabled)";
        }
        if node["twin"] == true {
            line += "  (as executed)";
        }
        say(&line);
        print_nodes(&node["children"], depth + 1);
        for path in node["toolpaths"].as_array().into_iter().flatten() {
            print_path(path, &"  ".repeat(depth + 1));
        }
    }
}

fn print_path(path: &Value, indent: &str) {
    let mut line = format!("{indent}{:5} #{}", path["kind"].as_str().unwrap_or(""), path["id"]);
    if let Some(name) = path["name"].as_str().filter(|n| !n.is_empty()) {
        line += &format!(" {name}");
    }
    if let Some(feed) = path["feed_mm_s"].as_f64() {
        line += &format!("  {:.0} mm/min", feed * 60.0);
    }
    match (path["spindle_direction"].as_str(), path["spindle_rpm"].as_f64()) {
        (Some(direction @ ("cw" | "ccw")), Some(rpm)) => line += &format!("  {rpm:.0} rev/min {direction}"),
        (Some(direction @ ("cw" | "ccw")), None) => line += &format!("  {direction}"),
        _ => {}
    }
    if let Some(length) = path["length_mm"].as_f64() {
        line += &format!("  {length:.1} mm");
    }
    say(&line);
}

fn print_problems(found: &Value) {
    for p in found["problems"].as_array().into_iter().flatten() {
        let place = match p["line"].as_u64() {
            Some(line) if line > 0 => format!("{line}:{}: ", p["column"]),
            _ => String::new(),
        };
        let times = if p["count"].as_u64().unwrap_or(1) > 1 {
            format!(" ({} times)", p["count"])
        } else {
            String::new()
        };
        say(&format!(
            "{}: {place}{}{times}",
            p["severity"].as_str().unwrap_or("warning"),
            p["message"].as_str().unwrap_or("")
        ));
    }
}
