//! Reads a file's instances into the model: the chains of the AIM meet the words of the shop here.
//!
//! Whatever is odd becomes a warning and is left out; whether it hurts shows when the program is run.

use super::*;
use crate::aim::{Links, text};
use crate::unit;
use crate::{date, expression};
use std::collections::BTreeSet;

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
        for row in aim.file.by_keyword("MACHINING_TOOL") {
            match tool(aim, aim.file.id(row)) {
                Ok((tool, faults)) => {
                    for fault in faults {
                        program.note(&mut self.found, Severity::Warning, &fault);
                    }
                    for &user in &tool.users {
                        program.tool_of.insert(user, program.tools.len());
                    }
                    program.tools.push(tool);
                }
                Err(fault) => program.note(&mut self.found, Severity::Warning, &fault),
            }
        }
        let mut executables = BTreeMap::new();
        let mut operations = BTreeMap::new();
        for keyword in [
            WORKPLAN,
            "MACHINING_WORKINGSTEP",
            "MACHINING_PROCESS_EXECUTABLE",
            "MACHINING_NC_FUNCTION",
        ] {
            for row in aim.file.by_keyword(keyword) {
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
        program.executables = executables;
        program.operations = operations;
        program.projects = projects;
        self.check_structure(program);
        for diagnostic in self.found.as_slice() {
            program.diagnostics.add(diagnostic.clone());
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
            let name = [product.argument(1), product.argument(0)]
                .map(text)
                .into_iter()
                .find(|name| !name.is_empty());
            match main {
                Some(main) if executables.contains_key(&main) => projects.push(Project {
                    id: Some(id),
                    name: name.unwrap_or_default().into_owned(),
                    main_workplan: main,
                    is_twin: is_twin(&main),
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
            if projects.is_empty() {
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
        let (name, description) = (
            text(instance.argument(0)).into_owned(),
            text(instance.argument(1)).into_owned(),
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
        let enabled = property_text(aim, &links, "enabled").is_none_or(|value| value != "disabled");
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

/// The placement in a representation: the item named `orientation`, else the first; with its units.
fn placed(program: &Program, representation: u64) -> Result<Option<PathTransform>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let mut placements: Vec<u64> = representation
        .items
        .iter()
        .copied()
        .filter(|&item| curve::is_placement(aim, item))
        .collect();
    placements.sort_by_key(|&item| aim.item_name(item) != "orientation");
    let Some(&item) = placements.first() else { return Ok(None) };
    let units = context(program, &representation)?;
    curve::placement(aim, item, units.millimetres).map(Some)
}

fn context(program: &Program, representation: &crate::aim::Representation) -> Result<ContextUnits, Fault> {
    let id = representation.context.unwrap_or(representation.id);
    match program.contexts.get(&id) {
        Some(units) => units.clone(),
        None => program.aim().context_units(id),
    }
}

fn plane_height(program: &Program, representation: u64) -> Result<Option<Millimetres>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let Some(&plane) = representation.items.iter().find(|&&item| aim.keyword(item) == "PLANE") else {
        return Ok(None);
    };
    let units = context(program, &representation)?;
    let plane = aim.instance(plane)?;
    let Some(position) = plane.argument(1).reference() else {
        return Ok(None);
    };
    let frame = curve::placement(aim, position, units.millimetres)?;
    Ok(Some(Millimetres(frame.origin[2])))
}

fn read_setup(program: &Program, process: u64) -> Result<Option<Setup>, Fault> {
    let aim = program.aim();
    let definition = aim
        .users_by(process, "PROCESS_PRODUCT_ASSOCIATION", 3)
        .find_map(|(_, association)| association.argument(2).reference());
    let Some(definition) = definition else { return Ok(None) };
    let formation = aim.instance(definition)?.argument(2).reference();
    let product = formation.and_then(|formation| aim.instance(formation).ok()?.argument(2).reference());
    let name = product.and_then(|product| aim.instance(product).ok());
    let name = name.map(|product| text(product.argument(0)).into_owned()).unwrap_or_default();

    let mut machine_from_setup = None;
    for (shape, instance) in aim.users_by(definition, "PRODUCT_DEFINITION_SHAPE", 2) {
        if text(instance.argument(0)) != "orientation" {
            continue;
        }
        for (_, link) in aim.users_by(shape, "SHAPE_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference()
                && let Some(frame) = placed(program, representation)?
            {
                machine_from_setup = Some(retarget(&frame));
            }
        }
    }
    let mut security_plane = None;
    for (property, instance) in aim.users_by(definition, "PROPERTY_DEFINITION", 2) {
        if text(instance.argument(0)) != "security plane" {
            continue;
        }
        for (_, link) in aim.users_by(property, "PROPERTY_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference() {
                security_plane = plane_height(program, representation)?.or(security_plane);
            }
        }
    }
    Ok(Some(Setup {
        id: definition,
        name,
        machine_from_setup,
        setup_from_part: workpiece_placement(program, definition),
        security_plane,
    }))
}

/// The same numbers read as a transform into the machine.
fn retarget<T: units::Frame, S: units::Frame>(frame: &Transform<units::Setup, units::Setup>) -> Transform<T, S> {
    let mut out = Transform::IDENTITY;
    out.rotation = frame.rotation;
    out.origin = frame.origin;
    out
}

/// Where the workpiece lies in the set-up: item 1 is a frame in the workpiece, item 2 where that frame is in the set-up.
fn workpiece_placement(program: &Program, setup: u64) -> Option<Transform<units::Setup, Part>> {
    let aim = program.aim();
    let (relation, _) = aim.users_by(setup, "MACHINING_SETUP_WORKPIECE_RELATIONSHIP", 3).next()?;
    let (shape, _) = aim.users_by(relation, "PRODUCT_DEFINITION_SHAPE", 2).next()?;
    let (_, link) = aim.users_by(shape, "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", 1).next()?;
    let relationship = aim.instance(link.argument(0).reference()?).ok()?;
    let transformation = relationship
        .part("REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")?
        .first()?
        .reference()?;
    let shapes = relationship.part("REPRESENTATION_RELATIONSHIP")?;
    let units_of = |n: usize| {
        let representation = aim.representation(shapes.get(n)?.reference()?).ok()?;
        context(program, &representation).ok()
    };
    let (part_units, setup_units) = (units_of(2)?, units_of(3)?);
    let transformation = aim.instance(transformation).ok()?;
    let in_part = curve::placement(aim, transformation.argument(2).reference()?, part_units.millimetres).ok()?;
    let in_setup = curve::placement(aim, transformation.argument(3).reference()?, setup_units.millimetres).ok()?;
    Some(retarget(&(in_setup * in_part.inverse())))
}

fn read_operation(aim: Aim, id: u64) -> Result<Operation, Fault> {
    let instance = aim.instance(id)?;
    let links = aim.links(id);
    Ok(Operation {
        id,
        name: text(instance.argument(0)).into_owned(),
        kind: aim.keyword(id).to_string(),
        variant: text(instance.argument(1)).into_owned(),
        toolpaths: links.in_sequence("MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP"),
        technology: links.related("MACHINING_TECHNOLOGY_RELATIONSHIP"),
        functions: links.related("MACHINING_FUNCTIONS_RELATIONSHIP"),
    })
}

fn technology(aim: Aim, id: u64) -> Technology {
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

fn functions(aim: Aim, id: u64) -> MachineFunctions {
    let links = aim.links(id);
    let says = |property: &str, value: &str| property_text(aim, &links, property).is_some_and(|text| text == value);
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

fn tool(aim: Aim, id: u64) -> Result<(Tool, Vec<Fault>), Fault> {
    let instance = aim.instance(id)?;
    let links = aim.links(id);
    let name = text(instance.argument(0)).into_owned();
    let mut faults = Vec::new();
    let mut tool = Tool {
        id,
        number: number_in(&name).or_else(|| number_in(&property_text(aim, &links, "tool position")?)),
        name,
        kind: text(instance.argument(1)).into_owned(),
        diameter: None,
        length: None,
        teeth: None,
        users: instance.argument(2).references().collect(),
    };
    for (_, representation, _) in links.properties.iter().filter(|property| property.0 == "tool body") {
        for &item in &aim.representation(*representation)?.items {
            let name = aim.item_name(item);
            let outcome = match name.as_str() {
                "effective cutting diameter" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.diameter = Some(Millimetres(mm))),
                "overall assembly length" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.length = Some(Millimetres(mm))),
                "number of effective teeth" => aim
                    .measure_of(item, unit::NUMBER, &name)
                    .map(|teeth| tool.teeth = Some(teeth)),
                _ => Ok(()),
            };
            faults.extend(outcome.err());
        }
    }
    Ok((tool, faults))
}

/// The number in `7`, `T07` or `Tool 7`.
fn number_in(text: &str) -> Option<ToolNumber> {
    let start = text.find(|c: char| c.is_ascii_digit())?;
    let digits: String = text[start..].chars().take_while(char::is_ascii_digit).collect();
    let behind = &text[start + digits.len()..];
    if behind.contains(|c: char| c.is_ascii_digit()) {
        return None; // `12 mm R0.5` is a description
    }
    digits.parse().ok().map(ToolNumber)
}

fn function(aim: Aim, description: &str, links: &Links) -> Function {
    let mut function = Function {
        kind: description.to_string(),
        text: String::new(),
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
            "enabled" | "toolpath orientation" | "security plane" => {}
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

pub(super) fn read_toolpath(program: &Program, id: u64) -> Toolpath {
    let aim = program.aim();
    let mut toolpath = Toolpath {
        id,
        name: String::new(),
        kind: ToolpathKind::Feed,
        description: String::new(),
        trajectory: String::new(),
        technology: None,
        functions: None,
        profile: None,
        dwell: None,
        maximum_deviation: None,
        reversed: false,
        tilted: false,
        twin: None,
        curve: None,
        context: None,
        faults: Vec::new(),
    };
    let instance = match aim.instance(id) {
        Ok(instance) => instance,
        Err(fault) => {
            toolpath.faults.push(fault);
            return toolpath;
        }
    };
    toolpath.name = text(instance.argument(0)).into_owned();
    toolpath.description = text(instance.argument(1)).into_owned();
    let links = aim.links(id);
    toolpath.technology = links.related("MACHINING_TECHNOLOGY_RELATIONSHIP");
    toolpath.functions = links.related("MACHINING_FUNCTIONS_RELATIONSHIP");
    toolpath.twin = twin_facts(aim, &links, true);
    toolpath.trajectory = property_text(aim, &links, "trajectory type").unwrap_or_default();
    toolpath.reversed = property_text(aim, &links, "direction").is_some_and(|direction| direction == "end to beginning");
    let mut read = || -> Result<(), Fault> {
        if let Some(representation) = links.property("basic curve") {
            let representation = aim.representation(representation)?;
            toolpath.curve = representation.items.first().map(|&curve| (representation.id, curve));
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
    toolpath
}

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
            Some("rapid") => Ok(None),
            _ if aim.item_name(item) == "rapid" => Ok(None),
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
    let ratio = aim.measure_of(item, unit::NUMBER, "a speed profile")?;
    if ratio <= 0.0 {
        return Err(fault("a feed multiplier is not above 0"));
    }
    Ok(Some(SpeedProfile {
        points: vec![(0.0, ratio), (1.0, ratio)],
    }))
}
