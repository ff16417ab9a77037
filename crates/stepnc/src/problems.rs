//! What a file does against the standard, though it can be read: [`violations`], one diagnostic a kind with its count and first place.
//!
//! Readers are tolerant, so most of this hurts nobody here; another control may be stricter. The kinds are those that real files get
//! wrong. Which instance has to be repaired, and how, stands in each.

use crate::aim::{Aim, Fault, Links, text};
use crate::model::{ExecutableKind, Program, ToolpathKind};
use part21::{Instance, Value};
use plan::{Diagnostic, Diagnostics, Severity};
use std::collections::BTreeMap;

/// The violations of a STEP-NC program (AIM); nothing for other files.
pub fn violations(program: &Program) -> Vec<Diagnostic> {
    if program.is_iso_14649() || program.projects().is_empty() {
        return Vec::new();
    }
    let mut finder = Finder {
        program,
        aim: program.aim(),
        found: Diagnostics::new(),
    };
    finder.instances();
    finder.structure();
    finder.operations();
    finder.twins();
    finder.found.as_slice().to_vec()
}

struct Finder<'p> {
    program: &'p Program,
    aim: Aim<'p>,
    found: Diagnostics,
}

/// The kinds of NC functions.
const FUNCTIONS: [&str; 12] = [
    "display message",
    "optional stop",
    "program stop",
    "set mark",
    "wait for mark",
    "exchange pallet",
    "index pallet",
    "index table",
    "load tool",
    "unload tool",
    "legacy function",
    "extended function",
];

/// The kinds of toolpaths.
const TOOLPATHS: [&str; 8] = [
    "feedstop",
    "axis trajectory",
    "cutter location trajectory",
    "cutter contact trajectory",
    "approach lift path angle",
    "approach lift path tangent",
    "connect security plane",
    "connect direct",
];

impl Finder<'_> {
    fn note(&mut self, severity: Severity, entity: u64, code: &'static str, message: String, remedy: &'static str) {
        let fault = Fault::new(entity, code, message, remedy);
        self.program.note(&mut self.found, severity, &fault);
    }

    /// What shows in single instances.
    fn instances(&mut self) {
        let file = self.aim.file;
        let first_edition = self.program.schema() == "INTEGRATED_CNC_SCHEMA";
        for row in file.rows() {
            let (id, keyword) = (file.id(row), file.keyword(row));
            let Ok(instance) = file.instance(row) else { continue };
            match &instance {
                Instance::Complex(records) => {
                    if !records.is_sorted_by(|a, b| a.keyword <= b.keyword) {
                        let message = "the parts of a complex instance are not in alphabetical order".to_string();
                        self.note(Severity::Warning, id, "complex-order", message, "sort them by name");
                    }
                }
                Instance::Simple(record) => {
                    let missing = mandatory(keyword)
                        .iter()
                        .filter(|n| record.arguments.get(**n) == Some(&Value::Unset))
                        .count();
                    if missing > 0 {
                        let message = format!("{keyword} has $ where the standard asks for a value");
                        self.note(Severity::Warning, id, "missing-attribute", message, "write '' or the value");
                    }
                    if keyword.len() <= 8 && SHORT_NAMES.contains(&keyword) {
                        let message = format!("{keyword} is the short name of an entity");
                        self.note(
                            Severity::Warning,
                            id,
                            "short-name",
                            message,
                            "export with the long names of entities",
                        );
                    }
                }
            }
            let second_edition = matches!(
                keyword,
                "VIA_ARC_POINT" | "VIA_HELIX_POINT" | "MACHINING_TWIN_RELATIONSHIP" | "MACHINING_PROCESS_PROPERTY"
            );
            if first_edition && second_edition {
                let message = format!("{keyword} belongs to edition 2, the header says INTEGRATED_CNC_SCHEMA (edition 1)");
                let remedy = "write MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA into FILE_SCHEMA";
                self.note(Severity::Warning, id, "edition", message, remedy);
            }
            if !first_edition && keyword.split(' ').any(|part| part == "EXPRESSION_REPRESENTATION_ITEM") {
                let message = "an expression is stored as in edition 1, the header says a later one".to_string();
                self.note(
                    Severity::Remark,
                    id,
                    "edition",
                    message,
                    "use EXPRESSION_ITEM_REPRESENTATION_ITEM",
                );
            }
        }
    }

    /// What shows in the tree.
    fn structure(&mut self) {
        let program = self.program;
        let plans: Vec<u64> = program
            .projects()
            .iter()
            .filter(|project| !project.is_twin)
            .map(|p| p.main_workplan)
            .collect();
        if let [_, second, ..] = plans[..] {
            let message = format!("the file has {} plans; the first is run", plans.len());
            self.note(
                Severity::Warning,
                second,
                "several-plans",
                message,
                "choose one, or keep one plan in a file",
            );
        }
        let mut parents: BTreeMap<u64, u32> = BTreeMap::new();
        for &main in &plans {
            let mut found: Vec<(u64, &'static str, String, &'static str)> = Vec::new();
            program.walk(main, &mut |executable, _| {
                for child in executable.children() {
                    *parents.entry(child).or_default() += 1;
                }
                let least = match &executable.kind {
                    ExecutableKind::Selective(_) | ExecutableKind::Parallel(_) | ExecutableKind::NonSequential(_) => 2,
                    _ => 0,
                };
                let children = executable.children().len();
                if children < least {
                    let message = format!(
                        "{} '{}' has {children} parts, at least 2 are due",
                        executable.kind_word(),
                        executable.name
                    );
                    found.push((
                        executable.id,
                        "too-few-parts",
                        message,
                        "put its part into the workplan itself",
                    ));
                }
                if let ExecutableKind::If { then: None, .. } = executable.kind {
                    let message = format!("if statement '{}' has no true branch", executable.name);
                    found.push((
                        executable.id,
                        "no-true-branch",
                        message,
                        "give it one, or turn the condition round",
                    ));
                }
                if let ExecutableKind::Function(function) = &executable.kind {
                    if !FUNCTIONS.contains(&function.kind.as_str()) {
                        let message = format!("'{}' is no kind of NC function", function.kind);
                        found.push((
                            executable.id,
                            "function-kind",
                            message,
                            "use 'extended function' and its text",
                        ));
                    }
                    if function.kind == "display message" && function.text.is_empty() {
                        let message = format!("the message '{}' has no text", executable.name);
                        found.push((executable.id, "message-text", message, "give it the property 'message text'"));
                    }
                }
                if let ExecutableKind::Workingstep { operation, .. } = executable.kind {
                    let paths = operation
                        .and_then(|id| program.operation(id))
                        .map(|operation| operation.toolpaths.len());
                    if paths == Some(0) {
                        let message = format!(
                            "workingstep '{}' is described by its feature only and has no toolpaths",
                            executable.name
                        );
                        found.push((
                            executable.id,
                            "feature-only",
                            message,
                            "let the CAM system compute its toolpaths; none are made up",
                        ));
                    }
                }
            });
            for (id, code, message, remedy) in found {
                self.note(Severity::Warning, id, code, message, remedy);
            }
        }
        for (id, count) in parents {
            let workplan = program
                .executable(id)
                .filter(|found| matches!(found.kind, ExecutableKind::Workplan(_)));
            if let Some(workplan) = workplan.filter(|_| count > 1) {
                let message = format!("workplan '{}' is executed at {count} places", workplan.name);
                self.note(
                    Severity::Remark,
                    id,
                    "shared-workplan",
                    message,
                    "a change of it changes all of them",
                );
            }
        }
    }

    /// Operations, toolpaths, technologies, functions.
    fn operations(&mut self) {
        let program = self.program;
        for row in self.aim.file.by_keyword("MACHINING_TECHNOLOGY") {
            let id = self.aim.file.id(row);
            let Ok(instance) = self.aim.parsed(row) else { continue };
            let links = self.aim.links(id);
            for what in ["feedrate", "spindle"] {
                if text(instance.argument(1)) == "milling" && links.property(what).is_none() {
                    let message = format!("a milling technology has no {what}");
                    let remedy = "give it both, on rapid paths too";
                    self.note(Severity::Warning, id, "technology-incomplete", message, remedy);
                }
                if self.is_zero(&links, what) {
                    let (code, message) = match what {
                        "feedrate" => ("feed-zero", "a technology has a feed of 0"),
                        _ => continue, // a spindle that stands is a spindle of 0
                    };
                    self.note(
                        Severity::Warning,
                        id,
                        code,
                        message.to_string(),
                        "give the feed of the cut beside it",
                    );
                }
            }
        }
        for row in self.aim.file.by_keyword("MACHINING_FUNCTIONS") {
            let id = self.aim.file.id(row);
            let Ok(instance) = self.aim.parsed(row) else { continue };
            let links = self.aim.links(id);
            if text(instance.argument(1)) == "milling" && links.property("coolant type").is_some() {
                let message = "'coolant type' belongs to turning and stands on milling functions".to_string();
                let remedy = "use 'mist' and 'through spindle coolant'";
                self.note(Severity::Warning, id, "coolant-type", message, remedy);
            }
            if links.property("coolant").is_none() {
                let message = "machine functions do not say whether coolant is on".to_string();
                self.note(
                    Severity::Warning,
                    id,
                    "no-coolant",
                    message,
                    "give them the property 'coolant'",
                );
            }
        }
        for row in self.aim.file.by_keyword("MACHINING_TOOLPATH") {
            let id = self.aim.file.id(row);
            let path = program.toolpath(id);
            if !TOOLPATHS.contains(&path.description.as_str()) {
                let message = format!("'{}' is no kind of toolpath", path.description);
                self.note(
                    Severity::Warning,
                    id,
                    "toolpath-kind",
                    message,
                    "use 'cutter location trajectory'",
                );
            }
            let dwell = self.aim.links(id).property("dwell");
            if path.kind == ToolpathKind::Dwell
                && let Some(representation) = dwell
                && self.aim.keyword(representation) == "REPRESENTATION"
            {
                let message = "a dwell stands in a plain REPRESENTATION".to_string();
                let remedy = "use MACHINING_DWELL_TIME_REPRESENTATION named 'dwell time'";
                self.note(Severity::Warning, id, "dwell-representation", message, remedy);
            }
        }
        let mut users: BTreeMap<u64, u32> = BTreeMap::new();
        for tool in program.tools() {
            tool.users.iter().for_each(|user| *users.entry(*user).or_default() += 1);
        }
        let operations: Vec<u64> = program
            .projects()
            .iter()
            .flat_map(|project| self.operations_of(project.main_workplan))
            .collect();
        for id in operations {
            let Some(operation) = program.operation(id) else { continue };
            if operation.kind == "MACHINING_RAPID_MOVEMENT" || operation.kind == "MACHINING_TOUCH_PROBING" {
                continue;
            }
            let count = users.get(&id).copied().unwrap_or(0);
            if count != 1 {
                let message = format!("operation '{}' has {count} tools, one is due", operation.name);
                self.note(
                    Severity::Warning,
                    id,
                    "tool-count",
                    message,
                    "name it among the users of one MACHINING_TOOL",
                );
            }
            if operation.technology.is_none() || operation.functions.is_none() {
                let message = format!("operation '{}' lacks technology or machine functions", operation.name);
                self.note(
                    Severity::Remark,
                    id,
                    "operation-incomplete",
                    message,
                    "give it both, even where its paths have their own",
                );
            }
        }
    }

    fn operations_of(&self, main: u64) -> Vec<u64> {
        let mut found = Vec::new();
        self.program.walk(main, &mut |executable, _| {
            if let ExecutableKind::Workingstep { operation, .. } = executable.kind
                && executable.twin.is_none()
            {
                found.extend(operation);
            }
        });
        found
    }

    fn is_zero(&self, links: &Links, property: &str) -> bool {
        let representation = links.property(property).and_then(|id| self.aim.representation(id).ok());
        let item = representation.and_then(|found| found.items.first().copied());
        item.and_then(|item| self.aim.measure(item).ok())
            .is_some_and(|measure| measure.value == 0.0)
    }

    /// As-executed data that no `twin start` announces, or that lacks it below.
    fn twins(&mut self) {
        let program = self.program;
        let mut found: Vec<(u64, &'static str, String)> = Vec::new();
        for project in program.projects() {
            program.walk(project.main_workplan, &mut |executable, _| {
                let links = self.aim.links(executable.id);
                let facts = ["twin source", "twin exception", "twin worktime"]
                    .iter()
                    .any(|name| links.property(name).is_some());
                if executable.twin.is_none() && facts {
                    let message = format!("'{}' has data of a run and no 'twin start'", executable.name);
                    found.push((executable.id, "twin-without-start", message));
                }
                if executable.twin.is_none() && project.is_twin {
                    let message = format!("'{}' stands in a run and has no 'twin start' of its own", executable.name);
                    found.push((executable.id, "twin-below", message));
                }
            });
        }
        for (id, code, message) in found {
            self.note(Severity::Warning, id, code, message, "date it with the role 'twin start'");
        }
    }
}

/// Short names of entities that every file of geometry would have.
const SHORT_NAMES: [&str; 4] = ["CRTPNT", "DRCTN", "PLYLN", "PRDCT"];

/// The parameters of an entity that may not be left out.
fn mandatory(keyword: &str) -> &'static [usize] {
    match keyword {
        "ACTION_PROPERTY" | "RESOURCE_PROPERTY" | "MACHINING_PROCESS_PROPERTY" => &[0, 1, 2],
        "ACTION_PROPERTY_REPRESENTATION" | "RESOURCE_PROPERTY_REPRESENTATION" => &[0, 1, 2, 3],
        "REPRESENTATION" | "MEASURE_REPRESENTATION_ITEM" | "TRIMMED_CURVE" => &[0, 1, 2],
        "CARTESIAN_POINT" | "DIRECTION" | "POLYLINE" | "DESCRIPTIVE_REPRESENTATION_ITEM" | "COMPOSITE_CURVE" | "CIRCLE" => {
            &[0, 1]
        }
        "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP" | "MACHINING_SETUP_WORKPIECE_RELATIONSHIP" => &[0, 1, 3, 4],
        "PRODUCT" | "MACHINING_PROJECT" | "MACHINING_SETUP" => &[0, 1, 3],
        "MACHINING_TOOL" => &[0, 2, 3],
        _ if keyword.starts_with("MACHINING_") && keyword.ends_with("_SEQUENCE_RELATIONSHIP") => &[0, 2, 3, 4],
        _ if keyword.starts_with("MACHINING_") && keyword.ends_with("_RELATIONSHIP") => &[0, 2, 3],
        _ if keyword.starts_with("MACHINING_") && keyword.ends_with("_REPRESENTATION") => &[0, 1, 2],
        "MACHINING_WORKPLAN"
        | "MACHINING_WORKINGSTEP"
        | "MACHINING_PROCESS_EXECUTABLE"
        | "MACHINING_NC_FUNCTION"
        | "MACHINING_TOOLPATH"
        | "MACHINING_TECHNOLOGY"
        | "MACHINING_FUNCTIONS"
        | "MACHINING_FEATURE_PROCESS" => &[0, 2, 3],
        _ if keyword.ends_with("_OPERATION") => &[0, 2, 3],
        _ => &[],
    }
}
