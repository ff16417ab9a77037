//! `toolmark inspect`: what is in a program.

mod tree;

use super::{Done, print_json};
use crate::cli::{Common, InspectArgs};
use crate::failure::{Exit, Failure};
use crate::planned_time::add_planned_times;
use crate::program::{Kind, Program, named_machine};
use crate::say;
use ::plan::inspection::{Inspection, Node, PathEntry, Problem};
use ::plan::{Severity, Tables};
use serde_json::json;

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
    let mut found = match &program.kind {
        Kind::StepNc(p) => {
            let mut inspection = stepnc::inspect::inspect(p);
            let violations = stepnc::problems::violations(p);
            inspection.problems.extend(violations.iter().map(Into::into));
            inspection
        }
        Kind::Gcode { profile, .. } => {
            let mut stream = program.gcode(&Tables::empty())?;
            gcode::inspect::inspect(&mut stream, profile.name, gcode::GcodeProgram::in_inches)
        }
        Kind::CutterLocation => {
            let mut stream = program.cutter_location(&Tables::empty())?;
            let mut tree = gcode::inspect::inspect(&mut stream, program.dialect().0, apt::AptProgram::in_inches);
            tree.kind = "cutter-location";
            tree
        }
    };
    let mut note = None;
    if !args.problems {
        note = add_planned_times(&program, common, &mut found)?;
    }
    let mut path = None;
    if let Some(wanted) = &args.select {
        let id = match &program.kind {
            Kind::StepNc(p) => stepnc::select::select(p, wanted).map_err(Failure::usage)?.id(),
            Kind::Gcode { .. } | Kind::CutterLocation => by_name(&found.tree, wanted)?,
        };
        let part = find(&found.tree, id);
        let part = part.ok_or_else(|| Failure::usage(format_args!("'{wanted}' is no part of the program's tree")))?;
        match part {
            Part::Node(node) => found.tree = vec![node.clone()],
            Part::Path(entry) => {
                path = Some(entry.clone());
                found.tree.clear();
            }
        }
    }
    let bad = found.problems.iter().any(|problem| problem.severity == Severity::Error);
    match (common.json, args.problems) {
        (true, true) => print_json(&json!({ "problems": found.problems }))?,
        (true, false) => {
            let unprintable = |e| Failure::machine(format_args!("the tree is no JSON: {e}"));
            let mut value = serde_json::to_value(&found).map_err(unprintable)?;
            if let Some(path) = path {
                value["tree"] = json!([path]);
            }
            print_json(&value)?;
        }
        (false, problems_only) => {
            if !problems_only {
                tree::print(&program.name, &found, path.as_ref());
                note.iter().for_each(|note| say(note));
            }
            found.problems.iter().for_each(print_problem);
        }
    }
    Ok(if bad && args.problems { Exit::Negative } else { Exit::Good })
}

/// A part of a tree.
enum Part<'t> {
    Node(&'t Node),
    Path(&'t PathEntry),
}

fn find(nodes: &[Node], id: u64) -> Option<Part<'_>> {
    nodes.iter().find_map(|node| {
        if node.id == id {
            return Some(Part::Node(node));
        }
        let below = || find(&node.children, id);
        let path = || node.toolpaths.iter().find(|path| path.id == id).map(Part::Path);
        let operation = || {
            node.operation
                .as_ref()
                .filter(|operation| operation.id == id)
                .map(|_| Part::Node(node))
        };
        below().or_else(path).or_else(operation)
    })
}

/// The part of a G-code tree that has a name, or `#line`.
fn by_name(tree: &[Node], path: &str) -> Result<u64, Failure> {
    fn named(tree: &[Node], name: &str, into: &mut Vec<u64>) {
        for node in tree {
            if node.name == name {
                into.push(node.id);
            }
            named(&node.children, name, into);
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

fn print_problem(problem: &Problem) {
    let severity = match problem.severity {
        Severity::Remark => "remark",
        Severity::Warning => "warning",
        Severity::Error => "error",
    };
    let place = match problem.line {
        0 => String::new(),
        line => format!("{line}:{}: ", problem.column),
    };
    let times = match problem.count {
        0 | 1 => String::new(),
        times => format!(" ({times} times)"),
    };
    say(&format!("{severity}: {place}{}{times}", problem.message));
}

/// What the tree is printed of.
type Tree = Inspection;
