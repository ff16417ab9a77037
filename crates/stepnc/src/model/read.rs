//! Reads a file's instances into the model: the chains of the AIM meet the words of the shop here.
//!
//! Whatever is odd becomes a warning and is left out; whether it hurts shows when the program is run.

mod feature;
mod setup;
mod technology;
mod tool;
mod toolpath;

use super::*;
use crate::aim::{Links, text};
use crate::unit;
use crate::{date, expression};
use part21::Instance;
use plan::inspection::Quantity;
use setup::{placed, plane_height, read_setup};
use std::collections::BTreeSet;
use technology::{functions, technology};
use tool::tool;
pub(super) use toolpath::read_toolpath;

/// A frame of paths in the frame around it.
type PathTransform = Transform<units::Setup, units::Setup>;

/// Reads the structure of a file; faults become warnings, because what is never executed hurts nobody.
#[derive(Default)]
pub(super) struct Builder {
    found: Diagnostics,
    /// Executables that somebody executes.
    used: BTreeSet<u64>,
}

const WORKPLAN: &str = "MACHINING_WORKPLAN";
const SEQUENCE: &str = "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP";
const BRANCH: &str = "MACHINING_PROCESS_BRANCH_RELATIONSHIP";
const CONCURRENT: &str = "MACHINING_PROCESS_CONCURRENT_RELATIONSHIP";
const BODY: &str = "MACHINING_PROCESS_BODY_RELATIONSHIP";

/// Every kind of broadcast, in the draft's mapping table (5.1.16).
const BROADCAST: &str = "MACHINING_BROADCAST_STRATEGY";

impl Builder {
    pub(super) fn run(mut self, program: &mut Program) {
        let aim = Aim::new(&program.file);
        for row in aim.file.by_keyword("GLOBAL_UNIT_ASSIGNED_CONTEXT") {
            let id = aim.file.id(row);
            program.contexts.insert(id, aim.context_units(id));
        }
        for row in aim.file.by_keyword("MACHINING_TECHNOLOGY") {
            program
                .technologies
                .insert(aim.file.id(row), technology(aim, aim.file.id(row)));
        }
        for row in aim.file.by_keyword("MACHINING_FUNCTIONS") {
            program.functions.insert(aim.file.id(row), functions(aim, aim.file.id(row)));
        }
        let mut tools = Vec::new();
        for row in aim.file.by_keyword("MACHINING_TOOL") {
            match tool(aim, aim.file.id(row)) {
                Ok((tool, faults)) => {
                    for fault in faults {
                        program.note(&mut self.found, Severity::Warning, &fault);
                    }
                    tools.push(tool);
                }
                Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
            }
        }
        let mut executables = BTreeMap::new();
        let mut operations = BTreeMap::new();
        for keyword in [
            WORKPLAN,
            "MACHINING_WORKINGSTEP",
            "MACHINING_NC_FUNCTION",
            "MACHINING_PROCESS_EXECUTABLE", // the supertype of the others: last
        ] {
            for row in aim.file.by_keyword(keyword) {
                if executables.contains_key(&aim.file.id(row)) {
                    continue;
                }
                match self.executable(program, aim.file.id(row), keyword, &mut operations) {
                    Ok(Some(executable)) => {
                        self.used.extend(executable.children());
                        executables.insert(executable.id, executable);
                    }
                    Ok(None) => {}
                    Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
                }
            }
        }
        let projects = self.projects(program, &executables);
        let wanted: BTreeSet<u64> = executables
            .values()
            .flat_map(|executable| executable.features.iter().copied())
            .collect();
        let features = wanted.into_iter().filter_map(|id| match feature::feature(aim, id) {
            Ok(feature) => Some((id, feature)),
            Err(fault) => {
                program.note(&mut self.found, Severity::Warning, &fault);
                None
            }
        });
        let features = features.collect();
        let initial_values = expression::initial_values(aim);
        let moves = operations
            .values()
            .filter(|operation: &&Operation| operation.is_rapid_movement());
        let rapid_paths = moves.flat_map(|operation| operation.toolpaths.iter().copied()).collect();
        program.rapid_paths = rapid_paths;
        program.initial_values = initial_values;
        program.features = features;
        for tool in tools {
            program.add_tool(tool);
        }
        program.executables = executables;
        program.operations = operations;
        program.projects = projects;
        self.check_structure(program);
        self.name_broadcasts(program);
        for diagnostic in self.found.as_slice() {
            program.diagnostics.add(diagnostic.clone());
        }
    }

    /// Broadcasts come with the draft of edition 4, whose AIM is not published: they are kept, named, and record nothing.
    fn name_broadcasts(&mut self, program: &Program) {
        let aim = program.aim();
        for row in aim.file.by_keyword(BROADCAST) {
            let fault = Fault::new(
                aim.file.id(row),
                "broadcast",
                "a broadcast is of the draft of edition 4: it is kept, and records nothing here",
                "put 'trace:1 start_sensor_recording ...' before the workingstep",
            );
            program.note(&mut self.found, Severity::Warning, &fault);
        }
    }

    fn projects(&mut self, program: &Program, executables: &BTreeMap<u64, Executable>) -> Vec<Project> {
        let aim = program.aim();
        let is_twin = |id: &u64| executables.get(id).is_some_and(|executable| executable.twin.is_some());
        let mut projects = Vec::new();
        for row in aim.file.by_keyword("MACHINING_PROJECT") {
            let id = aim.file.id(row);
            let Ok(product) = aim.parsed(row) else { continue };
            let main = aim
                .users_by(id, "PRODUCT_DEFINITION_FORMATION", 2)
                .flat_map(|(formation, _)| aim.users_by(formation, "PRODUCT_DEFINITION", 2))
                .flat_map(|(definition, _)| aim.users_by(definition, "PROCESS_PRODUCT_ASSOCIATION", 2))
                .filter_map(|(_, association)| association.argument(3).reference())
                .filter_map(|process| aim.instance(process).ok())
                .filter(|process| text(process.argument(0)) == "machining")
                .find_map(|process| process.argument(2).reference());
            let attributes = aim.attributes(&product, "PRODUCT");
            let name = [attributes.get(1), attributes.first()]
                .map(|name| name.map(text).unwrap_or_default())
                .into_iter()
                .find(|name| !name.is_empty());
            match main {
                Some(main) if executables.contains_key(&main) => projects.push(Project {
                    id: Some(id),
                    name: name.unwrap_or_default().into_owned(),
                    main_workplan: main,
                    is_twin: is_twin(&main),
                    values: project_values(aim, id),
                }),
                _ => program.note(
                    &mut self.found,
                    Severity::Warning,
                    &Fault::new(
                        id,
                        "project-without-workplan",
                        "a machining project has no main workplan",
                        "tie it to one by a 'machining' process",
                    ),
                ),
            }
        }
        if !projects.iter().any(|project| !project.is_twin) {
            let loose = |executable: &&Executable| {
                let main = projects.iter().any(|project| project.main_workplan == executable.id);
                matches!(executable.kind, ExecutableKind::Workplan(_))
                    && executable.twin.is_none()
                    && !main
                    && !self.used.contains(&executable.id)
            };
            let found: Vec<Project> = executables
                .values()
                .filter(loose)
                .map(|executable| Project {
                    id: None,
                    name: executable.name.clone(),
                    main_workplan: executable.id,
                    is_twin: false,
                    values: Vec::new(),
                })
                .collect();
            if let Some(first) = found.first() {
                let message = "the file has no machining project of a plan: workplans that nobody executes stand for it";
                program.note(
                    &mut self.found,
                    Severity::Remark,
                    &Fault::new(first.main_workplan, "no-project", message, ""),
                );
            }
            projects.splice(0..0, found);
            if projects.is_empty() && aim.file.by_keyword("CRTPNT").next().is_some() {
                self.found.add(
                    Diagnostic::error(
                        "short-names",
                        "the file is written with short entity names (CRTPNT for CARTESIAN_POINT), which are not read",
                    )
                    .in_file(program.name.clone())
                    .remedy("export it with long entity names; a CAM system has an option for that"),
                );
            } else if projects.is_empty() {
                let message = format!("the file has no machining program in it (schema {})", program.schema);
                self.found.add(
                    Diagnostic::error("no-program", message)
                        .in_file(program.name.clone())
                        .remedy("a STEP-NC file has a machining project or a workplan; a plain STEP model has neither"),
                );
            }
        }
        projects
    }

    fn check_structure(&mut self, program: &Program) {
        if let Some(fault) = feature_based(&program.executables, &program.operations) {
            program.note(&mut self.found, Severity::Warning, &fault);
        }
        for executable in program.executables.values() {
            if matches!(&executable.kind, ExecutableKind::Workplan(children) if children.is_empty()) && executable.twin.is_none()
            {
                let fault = Fault::new(
                    executable.id,
                    "empty-workplan",
                    format!("workplan '{}' is empty", executable.name),
                    "",
                );
                program.note(&mut self.found, Severity::Remark, &fault);
            }
            if let ExecutableKind::Unknown(description) = &executable.kind {
                let message = format!("an executable of the unknown kind '{description}': it is kept and cannot be run");
                let fault = Fault::new(executable.id, "unknown-executable", message, "");
                program.note(&mut self.found, Severity::Warning, &fault);
            }
        }
    }

    fn executable(
        &mut self,
        program: &Program,
        id: u64,
        keyword: &str,
        operations: &mut BTreeMap<u64, Operation>,
    ) -> Result<Option<Executable>, Fault> {
        let aim = program.aim();
        let instance = aim.instance(id)?;
        let attributes = aim.attributes(&instance, "ACTION_METHOD");
        let (name, description) = (
            attributes.first().map(text).unwrap_or_default().into_owned(),
            attributes.get(1).map(text).unwrap_or_default().into_owned(),
        );
        let links = aim.links(id);
        let kind = match (keyword, description.as_str()) {
            (WORKPLAN, _) => ExecutableKind::Workplan(self.children(program, id, &links, SEQUENCE)),
            ("MACHINING_WORKINGSTEP", _) => {
                let operation = links.related("MACHINING_OPERATION_RELATIONSHIP");
                if let Some(operation) = operation
                    && !operations.contains_key(&operation)
                {
                    match read_operation(aim, operation) {
                        Ok(read) => {
                            operations.insert(operation, read);
                        }
                        Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
                    }
                }
                ExecutableKind::Workingstep {
                    operation,
                    turning: description == "turning",
                }
            }
            ("MACHINING_NC_FUNCTION", _) => ExecutableKind::Function(function(aim, &description, &links)),
            (_, "selective") => ExecutableKind::Selective(self.children(program, id, &links, BRANCH)),
            (_, "parallel") => ExecutableKind::Parallel(self.children(program, id, &links, CONCURRENT)),
            (_, "non-sequential") => ExecutableKind::NonSequential(self.children(program, id, &links, BODY)),
            (_, "if statement") => {
                let branch = |name: &str| {
                    let found = links
                        .relations
                        .iter()
                        .find(|relation| relation.keyword == BRANCH && relation.name == name);
                    found.map(|relation| relation.related)
                };
                ExecutableKind::If {
                    condition: expression::of_property(aim, &links, "condition"),
                    then: branch("true branch"),
                    otherwise: branch("false branch"),
                }
            }
            (_, "while statement") => ExecutableKind::While {
                condition: expression::of_property(aim, &links, "condition"),
                body: self.children(program, id, &links, BODY).first().copied(),
            },
            (_, "assignment") => ExecutableKind::Assignment {
                variable: expression::variable_name(aim, &links, "lvalue").unwrap_or_default(),
                value: expression::of_property(aim, &links, "rvalue"),
            },
            (_, "setup instructions") => return Ok(None),
            _ => ExecutableKind::Unknown(description),
        };
        let enabled = property_text(aim, &links, "enabled").is_none_or(|value| !value.eq_ignore_ascii_case("disabled"));
        let mut note = |fault: &Fault| program.note(&mut self.found, Severity::Warning, fault);
        let orientation = match links
            .property("toolpath orientation")
            .map(|property| placed(program, property))
        {
            Some(Ok(orientation)) => orientation,
            Some(Err(fault)) => return Err(fault),
            None => None,
        };
        let mut setup = None;
        for (_, process) in links.processes.iter().filter(|(name, _)| name == "setup") {
            match read_setup(program, *process) {
                Ok(read) => setup = setup.or(read),
                Err(fault) => note(&fault),
            }
        }
        let security_plane = match links
            .property("security plane")
            .map(|property| plane_height(program, property))
        {
            Some(Ok(height)) => height,
            Some(Err(fault)) => {
                note(&fault);
                None
            }
            None => None,
        };
        Ok(Some(Executable {
            id,
            name,
            kind,
            enabled,
            orientation,
            setup,
            security_plane,
            twin: twin_facts(aim, &links, false),
            features: feature::features_of(aim, &links),
            values: values_of(aim, &links, &EXECUTABLE_WORDS),
        }))
    }

    /// The children by the relationship that the standard asks for, or, with a remark, by a relative of it.
    fn children(&mut self, program: &Program, id: u64, links: &Links, keyword: &str) -> Vec<u64> {
        let exact = links.in_sequence(keyword);
        if !exact.is_empty() {
            return exact;
        }
        for relative in [SEQUENCE, BRANCH, CONCURRENT, BODY] {
            let found = links.in_sequence(relative);
            if !found.is_empty() {
                let message = format!("children are tied by {relative} instead of {keyword}");
                program.note(
                    &mut self.found,
                    Severity::Remark,
                    &Fault::new(id, "child-relationship", message, ""),
                );
                return found;
            }
        }
        Vec::new()
    }
}

/// The text of a property's first item.
fn property_text(aim: Aim, links: &Links, name: &str) -> Option<String> {
    let representation = aim.representation(links.property(name)?).ok()?;
    aim.description(*representation.items.first()?)
}

/// The entity of an operation; of a complex instance the one that says most: not its supertypes.
fn operation_kind(keyword: &str) -> String {
    let supertypes = [
        "ACTION_METHOD",
        "CHARACTERIZED_OBJECT",
        "MACHINING_OPERATION",
        "MACHINING_PROCESS_EXECUTABLE",
        "MILLING_TYPE_OPERATION",
        "TURNING_TYPE_OPERATION",
        "DRILLING_TYPE_OPERATION",
    ];
    let leaf = keyword.split(' ').find(|part| !supertypes.contains(part));
    leaf.or_else(|| keyword.split(' ').next_back()).unwrap_or(keyword).to_string()
}

/// Properties of executables that are not shown as named data: they have a place of their own, or belong to the kind.
const EXECUTABLE_WORDS: [&str; 12] = [
    "twin worktime",
    "enabled",
    "condition",
    "lvalue",
    "rvalue",
    "toolpath orientation",
    "security plane",
    "message text",
    "description",
    "function text",
    "twin source",
    "twin exception",
];

/// What hangs on an object and has no place of its own in the model: properties, people, machines, approvals, dates.
fn values_of(aim: Aim, links: &Links, known: &[&str]) -> Vec<NamedValue> {
    let mut values = Vec::new();
    for (name, representation, _) in &links.properties {
        if known.contains(&name.as_str()) {
            continue;
        }
        if let Ok(representation) = aim.representation(*representation) {
            values.extend(aim.named_values(name, &representation));
        }
    }
    for relation in &links.relations {
        let Ok(other) = aim.instance(relation.related) else { continue };
        let attributes = aim.attributes(&other, "ACTION_METHOD");
        let words = |n: usize| attributes.get(n).map(text).unwrap_or_default().into_owned();
        match relation.keyword {
            "MACHINING_USAGE_RELATIONSHIP" => {
                let words: Vec<String> = [words(0), words(1)].into_iter().filter(|word| !word.is_empty()).collect();
                values.push(NamedValue::text("machine", words.join(", ")));
            }
            "MACHINING_STRATEGY_RELATIONSHIP" => {
                let name = if relation.name.is_empty() {
                    "strategy"
                } else {
                    &relation.name
                };
                let kind = aim.keyword(relation.related).to_lowercase().replace('_', " ");
                let said = words(1);
                values.push(NamedValue::text(name, if said.is_empty() { kind } else { said }));
                for (property, representation, _) in aim.links(relation.related).properties {
                    let Ok(representation) = aim.representation(representation) else {
                        continue;
                    };
                    let mut inner = aim.named_values(&property, &representation);
                    inner
                        .iter_mut()
                        .for_each(|value| value.name = format!("{name}: {}", value.name));
                    values.extend(inner);
                }
            }
            _ => {}
        }
    }
    values.extend(links.people.iter().map(|(role, name)| NamedValue::text(role, name)));
    values.extend(links.approvals.iter().map(|status| NamedValue::text("approval", status)));
    for (role, moment) in &links.dates {
        // A twin's own dates have their place.
        if !matches!(role.as_str(), "twin start" | "twin end")
            && let Some(moment) = date::read(aim, *moment)
        {
            values.push(NamedValue::text(role, date::words(moment)));
        }
    }
    values
}

/// Owner, release date and approval of a project hang on its formation; some writers hang them on the product or its definition.
fn project_values(aim: Aim, project: u64) -> Vec<NamedValue> {
    let formations: Vec<u64> = aim
        .users_by(project, "PRODUCT_DEFINITION_FORMATION", 2)
        .map(|(id, _)| id)
        .collect();
    let definitions: Vec<u64> = formations
        .iter()
        .flat_map(|&formation| aim.users_by(formation, "PRODUCT_DEFINITION", 2))
        .map(|(id, _)| id)
        .collect();
    let mut values = Vec::new();
    for owner in [project].into_iter().chain(formations).chain(definitions.iter().copied()) {
        values.extend(values_of(aim, &aim.links(owner), &[]));
    }
    let workpieces = definitions
        .iter()
        .flat_map(|&definition| aim.users_by(definition, "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP", 3))
        .filter_map(|(_, relation)| relation.argument(4).reference());
    values.extend(workpieces.filter_map(|workpiece| Some(NamedValue::text("workpiece", product_name(aim, workpiece)?))));
    values
}

/// The name of the product that a definition is of.
fn product_name(aim: Aim, definition: u64) -> Option<String> {
    let formation = aim.instance(definition).ok()?.argument(2).reference()?;
    let product = aim.instance(formation).ok()?.argument(2).reference()?;
    let product = aim.instance(product).ok()?;
    let attributes = aim.attributes(&product, "PRODUCT");
    let words = [attributes.get(1), attributes.first()].map(|word| word.map(text).unwrap_or_default());
    words
        .into_iter()
        .find(|word| !word.is_empty())
        .map(std::borrow::Cow::into_owned)
}

fn read_operation(aim: Aim, id: u64) -> Result<Operation, Fault> {
    let instance = aim.instance(id)?;
    let attributes = aim.attributes(&instance, "ACTION_METHOD");
    let links = aim.links(id);
    Ok(Operation {
        id,
        name: attributes.first().map(text).unwrap_or_default().into_owned(),
        kind: operation_kind(aim.keyword(id)),
        variant: attributes.get(1).map(text).unwrap_or_default().into_owned(),
        values: values_of(aim, &links, &[]),
        toolpaths: links.in_sequence("MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP"),
        technology: links.related("MACHINING_TECHNOLOGY_RELATIONSHIP"),
        functions: links.related("MACHINING_FUNCTIONS_RELATIONSHIP"),
    })
}

fn function(aim: Aim, description: &str, links: &Links) -> Function {
    let mut function = Function {
        kind: description.to_string(),
        text: String::new(),
        condition: links
            .property("condition")
            .map(|_| expression::of_property(aim, links, "condition")),
        properties: BTreeMap::new(),
    };
    for (name, representation, _) in &links.properties {
        let Ok(representation) = aim.representation(*representation) else {
            continue;
        };
        let Some(&item) = representation.items.first() else { continue };
        let value = aim
            .measure(item)
            .map(|measure| part21::text::real(measure.value))
            .ok()
            .or_else(|| aim.description(item))
            .unwrap_or_default();
        match name.as_str() {
            // The mapping table says 'description', the local rule of the AIM 'function text': files have either.
            "message text" | "description" | "function text" => function.text = aim.description(item).unwrap_or_default(),
            "condition" | "enabled" | "toolpath orientation" | "security plane" => {}
            _ => {
                function.properties.insert(name.clone(), value);
            }
        }
    }
    function
}

/// What makes an executable a twin; `None` without a start, unless `any` fact will do (toolpaths).
fn twin_facts(aim: Aim, links: &Links, any: bool) -> Option<TwinFacts> {
    let moment = |role: &str| {
        let found = links.dates.iter().find(|(name, _)| name == role)?;
        date::read(aim, found.1)
    };
    let start = moment("twin start");
    let is_twin = links.dates.iter().any(|(role, _)| role == "twin start");
    let plan = links.related("MACHINING_TWIN_RELATIONSHIP");
    let linked = any && plan.is_some();
    if !is_twin && !linked {
        return None;
    }
    let worktime = links.property("twin worktime").and_then(|id| aim.representation(id).ok());
    let worktime = worktime.and_then(|found| aim.measure_of(*found.items.first()?, unit::TIME, "twin worktime").ok());
    Some(TwinFacts {
        start,
        end: moment("twin end"),
        plan,
        source: property_text(aim, links, "twin source"),
        worktime: worktime.map(Seconds),
        exception: property_text(aim, links, "twin exception"),
    })
}
