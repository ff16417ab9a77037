//! ISO 14649 files: the objects of the shop are written as they are, one entity each (the ARM), and become the same model as ISO 10303-238.
//!
//! **Units** are those of the standard: mm, degrees, seconds, m/s, revolutions/s. **Frames**: the path of a workingstep is written in
//! the frame of its feature, which is placed in the workpiece, which is placed in the set-up; the path of a rapid movement or of a
//! probing is written in the set-up. The text of the standard leaves it open; the NIST interpreter and its example with explicit
//! toolpaths read it so. Paths without a feature placement stay in the frame of the workpiece.
//!
//! What an attribute is follows from the kind of what it refers to and not from its position, because the editions differ. Operations
//! without toolpaths are the rule in these files: they are shown, and no path is made up for them.

mod technology;
mod toolpath;
mod words;

use crate::aim::{Aim, Fault, text};
use crate::curve;
use crate::expression;
use crate::model::{
    Dwell, Executable, ExecutableKind, Feature, FeedSetting, Function, MachineFunctions, Operation, Program, Project, Setup,
    SpindleSetting, Technology, Tool, Toolpath, ToolpathKind, feature_based,
};
use crate::unit::ContextUnits;
use part21::{Row, Value};
use plan::inspection::NamedValue;
use plan::{CoolantState, Diagnostics, Severity, SpeedProfile};
use std::collections::{BTreeMap, BTreeSet};
use technology::{functions, technology};
pub(crate) use toolpath::read_toolpath;
use units::{Machine, Millimetres, MmPerSec, Part, Rpm, Seconds, Transform};

/// The units that ISO 14649 writes coordinates in.
pub(crate) const UNITS: ContextUnits = ContextUnits {
    millimetres: 1.0,
    radians: Some(std::f64::consts::PI / 180.0),
};

/// Schema names of ISO 14649 files.
const SCHEMAS: [&str; 6] = [
    "MACHINING_SCHEMA",
    "MILLING_SCHEMA",
    "TURNING_SCHEMA",
    "COMBINED_SCHEMA",
    "FEATURES_SCHEMA",
    "INSPECTION_SCHEMA",
];

/// Is this such a file: by its schema, or, when the header says something else, by what it holds?
pub(crate) fn is_arm(file: &part21::File) -> bool {
    let holds = |name: &str| file.by_keyword(name).next().is_some();
    file.schemas().iter().any(|schema| SCHEMAS.contains(&schema.as_str()))
        || (holds("WORKPLAN") && (holds("MACHINING_WORKINGSTEP") || holds("TURNING_WORKINGSTEP")) && !holds("MACHINING_WORKPLAN"))
}

/// What is read of a file.
#[derive(Default)]
pub(crate) struct Arm {
    pub(crate) projects: Vec<Project>,
    pub(crate) executables: BTreeMap<u64, Executable>,
    pub(crate) operations: BTreeMap<u64, Operation>,
    pub(crate) technologies: BTreeMap<u64, Technology>,
    pub(crate) functions: BTreeMap<u64, MachineFunctions>,
    pub(crate) features: BTreeMap<u64, Feature>,
    pub(crate) tools: BTreeMap<u64, Tool>,
    /// Toolpaths that are rapid because what they belong to is.
    pub(crate) rapid_paths: BTreeSet<u64>,
    /// Values of variables before the program.
    pub(crate) variables: BTreeMap<String, f64>,
    pub(crate) found: Diagnostics,
}

type Frame = Transform<units::Setup, units::Setup>;

/// Reads the structure of a file.
pub(crate) fn read(program: &Program) -> Arm {
    let aim = program.aim();
    let mut reader = Reader {
        program,
        aim,
        placements: BTreeMap::new(),
        out: Arm::default(),
    };
    for row in aim.file.by_keyword("WORKPIECE_SETUP") {
        reader.workpiece_setup(row);
    }
    for row in aim.file.rows() {
        let keyword = aim.file.keyword(row);
        let id = aim.file.id(row);
        if keyword.ends_with("_TECHNOLOGY") {
            reader.out.technologies.insert(id, technology(aim, id));
        } else if keyword.ends_with("MACHINE_FUNCTIONS") {
            reader.out.functions.insert(id, functions(aim, id));
        } else if matches!(keyword, "NC_VARIABLE" | "NC_CONSTANT")
            && let Ok(instance) = aim.parsed(row)
            && let Some(value) = instance.argument(1).number()
        {
            reader.out.variables.insert(text(instance.argument(0)).into_owned(), value);
        }
    }
    for row in aim.file.rows() {
        if let Err(fault) = reader.executable(row) {
            program.note(&mut reader.out.found, Severity::Warning, &fault);
        }
    }
    reader.projects();
    if let Some(fault) = feature_based(&reader.out.executables, &reader.out.operations) {
        program.note(&mut reader.out.found, Severity::Warning, &fault);
    }
    reader.out
}

struct Reader<'p> {
    program: &'p Program,
    aim: Aim<'p>,
    /// Where a workpiece lies in its set-up.
    placements: BTreeMap<u64, Frame>,
    out: Arm,
}

impl Reader<'_> {
    fn arguments(&self, id: u64) -> Result<Vec<Value<'static>>, Fault> {
        let instance = self.aim.instance(id)?;
        let records = instance.records();
        Ok(records
            .iter()
            .flat_map(|record| record.arguments.iter().cloned())
            .map(Value::into_owned)
            .collect())
    }

    /// The first thing of a kind that attributes refer to.
    fn of_kind(&self, arguments: &[Value], is: impl Fn(&str) -> bool) -> Option<u64> {
        arguments
            .iter()
            .filter_map(Value::reference)
            .find(|&id| is(self.aim.keyword(id)))
    }

    fn placement_of(&self, arguments: &[Value]) -> Result<Option<Frame>, Fault> {
        let placement = self.of_kind(arguments, |keyword| keyword == "AXIS2_PLACEMENT_3D");
        placement.map(|id| curve::placement(self.aim, id, 1.0)).transpose()
    }

    /// Height of a plane.
    fn plane(&self, arguments: &[Value]) -> Option<Millimetres> {
        let plane = self.of_kind(arguments, |keyword| matches!(keyword, "PLANE" | "ELEMENTARY_SURFACE"))?;
        let position = self.aim.instance(plane).ok()?.argument(1).reference()?;
        curve::placement(self.aim, position, 1.0)
            .ok()
            .map(|frame| Millimetres(frame.origin[2]))
    }

    fn workpiece_setup(&mut self, row: Row) {
        let Ok(arguments) = self.arguments(self.aim.file.id(row)) else {
            return;
        };
        let workpiece = self.of_kind(&arguments, |keyword| keyword == "WORKPIECE");
        match (workpiece, self.placement_of(&arguments)) {
            (Some(workpiece), Ok(Some(placement))) => {
                self.placements.insert(workpiece, placement);
            }
            (_, Err(fault)) => self.program.note(&mut self.out.found, Severity::Warning, &fault),
            _ => {}
        }
    }

    fn executable(&mut self, row: Row) -> Result<(), Fault> {
        let keyword = self.aim.file.keyword(row);
        let id = self.aim.file.id(row);
        let children = |arguments: &[Value], n: usize| -> Vec<u64> {
            arguments.get(n).map(|list| list.references().collect()).unwrap_or_default()
        };
        let arguments = match keyword {
            "WORKPLAN"
            | "SELECTIVE"
            | "PARALLEL"
            | "NON_SEQUENTIAL"
            | "IF_STATEMENT"
            | "WHILE_STATEMENT"
            | "ASSIGNMENT"
            | "DISPLAY_MESSAGE"
            | "LOAD_TOOL"
            | "UNLOAD_TOOL"
            | "PROGRAM_STOP"
            | "OPTIONAL_STOP"
            | "EXCHANGE_PALLET"
            | "INDEX_PALLET"
            | "INDEX_TABLE"
            | "SET_MARK"
            | "WAIT_FOR_MARK"
            | "EXTENDED_NC_FUNCTION" => self.arguments(id)?,
            _ if keyword.ends_with("WORKINGSTEP") || keyword == "RAPID_MOVEMENT" || keyword.ends_with("_PROBING") => {
                self.arguments(id)?
            }
            _ => return Ok(()),
        };
        let mut executable = Executable::new(id, text(arguments.first().unwrap_or(&Value::Unset)).into_owned());
        executable.kind = match keyword {
            "WORKPLAN" => {
                if let Some(setup) = self.of_kind(&arguments, |keyword| keyword == "SETUP") {
                    executable.setup = Some(self.setup(setup)?);
                }
                ExecutableKind::Workplan(children(&arguments, 1))
            }
            "SELECTIVE" => ExecutableKind::Selective(children(&arguments, 1)),
            "PARALLEL" => ExecutableKind::Parallel(children(&arguments, 1)),
            "NON_SEQUENTIAL" => ExecutableKind::NonSequential(children(&arguments, 1)),
            "IF_STATEMENT" => ExecutableKind::If {
                condition: expression::of_value(self.aim, arguments.get(1)),
                then: arguments.get(2).and_then(Value::reference),
                otherwise: arguments.get(3).and_then(Value::reference),
            },
            "WHILE_STATEMENT" => ExecutableKind::While {
                condition: expression::of_value(self.aim, arguments.get(1)),
                body: arguments.get(2).and_then(Value::reference),
            },
            "ASSIGNMENT" => ExecutableKind::Assignment {
                variable: match expression::of_value(self.aim, arguments.get(1)) {
                    Ok(plan::Expression::Name(name)) => name,
                    _ => String::new(),
                },
                value: expression::of_value(self.aim, arguments.get(2)),
            },
            _ if keyword.ends_with("WORKINGSTEP") => self.workingstep(&mut executable, &arguments, keyword)?,
            _ if keyword == "RAPID_MOVEMENT" || keyword.ends_with("_PROBING") => {
                executable.security_plane = self.plane(&arguments);
                self.operation(id, &arguments)?;
                ExecutableKind::Workingstep {
                    operation: Some(id),
                    turning: false,
                }
            }
            _ => ExecutableKind::Function(self.function(id, keyword, &arguments)),
        };
        self.out.executables.insert(id, executable);
        Ok(())
    }

    fn workingstep(&mut self, executable: &mut Executable, arguments: &[Value], keyword: &str) -> Result<ExecutableKind, Fault> {
        executable.security_plane = self.plane(arguments);
        // Operations have a tool or a technology, features a workpiece: whatever else is referred to is neither.
        let mut operation = None;
        let lists = arguments.iter().flat_map(Value::references);
        for id in arguments.iter().filter_map(Value::reference).chain(lists) {
            let kind = self.aim.keyword(id);
            if is_operation(kind) {
                operation = operation.or(Some(id));
            } else if self.is_feature(id) {
                executable.features.push(id);
            }
        }
        // Features stand before the operation, which is the last but the effect; its kind may be one that is not known here.
        if operation.is_none() {
            let mut last = arguments
                .iter()
                .filter_map(Value::reference)
                .filter(|id| !executable.features.contains(id));
            operation = last.next_back().filter(|&id| self.has_operation_links(id));
        }
        if let Some(id) = operation {
            let attributes = self.arguments(id)?;
            self.operation(id, &attributes)?;
        }
        let mut frame: Option<Frame> = None;
        for &id in &executable.features {
            let attributes = self.arguments(id)?;
            let workpiece = self.of_kind(&attributes, |keyword| keyword == "WORKPIECE");
            let placed = self.placement_of(&attributes)?;
            if frame.is_none() {
                let in_setup = workpiece.and_then(|workpiece| self.placements.get(&workpiece).copied());
                frame = match (in_setup, placed) {
                    (Some(setup), Some(feature)) => Some(setup * feature),
                    (one, other) => one.or(other),
                };
            }
            let feature = self.feature(id, &attributes);
            self.out.features.insert(id, feature);
        }
        executable.orientation = frame.filter(|frame| *frame != Frame::IDENTITY);
        Ok(ExecutableKind::Workingstep {
            operation,
            turning: keyword == "TURNING_WORKINGSTEP",
        })
    }

    fn is_feature(&self, id: u64) -> bool {
        let Ok(arguments) = self.arguments(id) else { return false };
        self.of_kind(&arguments, |keyword| keyword == "WORKPIECE").is_some()
            && matches!(arguments.first(), Some(Value::String(_) | Value::Unset))
    }

    fn has_operation_links(&self, id: u64) -> bool {
        let Ok(arguments) = self.arguments(id) else { return false };
        self.of_kind(&arguments, |keyword| {
            keyword == "TOOLPATH_LIST" || keyword.ends_with("_TECHNOLOGY") || keyword.ends_with("_TOOL")
        })
        .is_some()
    }

    fn operation(&mut self, id: u64, arguments: &[Value]) -> Result<(), Fault> {
        if self.out.operations.contains_key(&id) {
            return Ok(());
        }
        let kind = self.aim.keyword(id).to_string();
        let toolpaths: Vec<u64> = match self.of_kind(arguments, |keyword| keyword == "TOOLPATH_LIST") {
            Some(list) => self
                .arguments(list)?
                .first()
                .map(|list| list.references().collect())
                .unwrap_or_default(),
            // Some writers put the paths into the operation itself.
            None => arguments
                .iter()
                .flat_map(Value::references)
                .filter(|&id| is_toolpath(self.aim.keyword(id)))
                .collect(),
        };
        if kind == "RAPID_MOVEMENT" {
            self.out.rapid_paths.extend(toolpaths.iter().copied());
        }
        let name = arguments
            .iter()
            .find_map(|value| value.text())
            .unwrap_or_default()
            .to_string();
        let technology = self.of_kind(arguments, |keyword| keyword.ends_with("_TECHNOLOGY"));
        let functions = self.of_kind(arguments, |keyword| keyword.ends_with("MACHINE_FUNCTIONS"));
        let tool = self.of_kind(arguments, |keyword| {
            keyword.ends_with("_TOOL") || keyword == "TOUCH_PROBE" || keyword == "CUTTING_TOOL"
        });
        if let Some(tool) = tool {
            self.tool(tool, id)?;
        }
        let mut values = Vec::new();
        if kind != "RAPID_MOVEMENT" && !kind.ends_with("_PROBING") {
            let retract = arguments.iter().find_map(|value| match value {
                Value::Real(_) | Value::Integer(_) | Value::Typed(..) => value.number(),
                _ => None,
            });
            let position = arguments.iter().position(|value| value.text().is_some()).unwrap_or(2);
            if let (Some(retract), true) = (
                retract,
                arguments.get(position + 1).is_some_and(|value| value.number().is_some()),
            ) {
                values.push(NamedValue::measure("retract plane", retract, "mm"));
            }
            if let Some(start) = self.of_kind(arguments, |keyword| keyword == "CARTESIAN_POINT") {
                values.extend(self.aim.named_item("cut start point".into(), start, Some(1.0)));
            }
            // Behind the machine functions comes what the kind adds.
            let tail = arguments.get(position + 6..).unwrap_or_default();
            let names = words::OPERATION_TAILS
                .iter()
                .find(|(entity, _)| *entity == kind)
                .map_or(&[][..], |(_, names)| names);
            for (name, value) in names.iter().zip(tail) {
                values.extend(self.named(name, value));
            }
        }
        let operation = Operation {
            id,
            name,
            kind,
            variant: String::new(),
            toolpaths,
            technology,
            functions,
            values,
        };
        self.out.operations.insert(id, operation);
        Ok(())
    }

    fn feature(&self, id: u64, arguments: &[Value]) -> Feature {
        let kind = self.aim.keyword(id);
        let mut values = Vec::new();
        let names = words::FEATURE_TAILS
            .iter()
            .find(|(entity, _)| *entity == kind)
            .map_or(&[][..], |(_, names)| names);
        if let Ok(Some(frame)) = self.placement_of(arguments) {
            let [x, y, z] = frame.origin;
            values.push(NamedValue::new(
                "placement",
                plan::inspection::Quantity::Place { place_mm: [x, y, z] },
            ));
        }
        if let Some(depth) = self.plane(arguments) {
            values.push(NamedValue::measure("depth plane", depth.0, "mm"));
        }
        for (name, value) in names.iter().zip(arguments.get(5..).unwrap_or_default()) {
            values.extend(self.named(name, value));
        }
        Feature {
            id,
            name: arguments.first().map(text).unwrap_or_default().into_owned(),
            kinds: vec![kind.to_string()],
            values,
        }
    }

    /// An attribute for people: a number, a toleranced length, or the kind of what it refers to.
    fn named(&self, name: &str, value: &Value) -> Option<NamedValue> {
        let unit = words::unit_of(name);
        match value {
            Value::Reference(id) => {
                let instance = self.aim.instance(*id).ok()?;
                let Some(length) = instance.part("TOLERANCED_LENGTH_MEASURE") else {
                    return Some(NamedValue::text(name, self.aim.keyword(*id).to_lowercase().replace('_', " ")));
                };
                let size = length.first()?.number()?;
                let mut named = NamedValue::measure(name, size, "mm");
                let range = length
                    .get(1)
                    .and_then(Value::reference)
                    .and_then(|range| self.aim.instance(range).ok());
                if let Some([upper, lower, ..]) = range.as_ref().and_then(|range| range.part("PLUS_MINUS_VALUE")) {
                    // Both are written as sizes of a deviation: +upper, -lower.
                    named.upper_limit = upper.number().map(|upper| size + upper);
                    named.lower_limit = lower.number().map(|lower| size - lower);
                }
                Some(named)
            }
            Value::Enumeration(word) => Some(NamedValue::text(name, boolean_word(word))),
            Value::String(words) => Some(NamedValue::text(name, words.to_string())),
            _ => value.number().map(|number| NamedValue::measure(name, number, unit)),
        }
    }

    fn setup(&self, id: u64) -> Result<Setup, Fault> {
        let arguments = self.arguments(id)?;
        let origin = self.placement_of(&arguments)?;
        let pieces = arguments.iter().flat_map(Value::references).collect::<Vec<_>>();
        let mut in_setup = None;
        for piece in pieces {
            if self.aim.keyword(piece) == "WORKPIECE_SETUP" {
                in_setup = in_setup.or(self.placement_of(&self.arguments(piece)?)?);
            }
        }
        Ok(Setup {
            id,
            name: arguments.first().map(text).unwrap_or_default().into_owned(),
            machine_from_setup: origin.map(|frame| {
                let mut out: Transform<Machine, units::Setup> = Transform::IDENTITY;
                (out.rotation, out.origin) = (frame.rotation, frame.origin);
                out
            }),
            setup_from_part: in_setup.map(|frame| {
                let mut out: Transform<units::Setup, Part> = Transform::IDENTITY;
                (out.rotation, out.origin) = (frame.rotation, frame.origin);
                out
            }),
            security_plane: self.plane(&arguments),
            fixture: None,
        })
    }

    fn tool(&mut self, id: u64, user: u64) -> Result<(), Fault> {
        if let Some(tool) = self.out.tools.get_mut(&id) {
            tool.users.push(user);
            return Ok(());
        }
        let arguments = self.arguments(id)?;
        let name = arguments.first().map(text).unwrap_or_default().into_owned();
        let mut tool = Tool {
            id,
            number: crate::model::number_in(&name),
            name,
            kind: String::new(),
            diameter: None,
            length: None,
            teeth: None,
            users: vec![user],
            values: Vec::new(),
        };
        let body = arguments.get(1).and_then(Value::reference);
        if let Some(body) = body {
            tool.kind = self.aim.keyword(body).to_lowercase().replace('_', " ");
            self.tool_body(&mut tool, &self.arguments(body)?)?;
        }
        if let Some(length) = arguments.get(3).and_then(Value::number) {
            tool.length = Some(Millimetres(length));
            tool.values.push(NamedValue::measure("overall assembly length", length, "mm"));
        }
        for component in arguments.iter().flat_map(Value::references) {
            let Ok(instance) = self.aim.instance(component) else {
                continue;
            };
            let Some(edge) = instance.part("CUTTING_COMPONENT") else {
                continue;
            };
            for (place, name, unit) in [(0, "functional length", "mm"), (3, "expected life", "s")] {
                let number = edge.get(place).and_then(Value::number);
                tool.values
                    .extend(number.map(|number| NamedValue::measure(name, number, unit)));
            }
        }
        self.out.tools.insert(id, tool);
        Ok(())
    }

    fn tool_body(&self, tool: &mut Tool, body: &[Value]) -> Result<(), Fault> {
        if let Some(dimension) = self.of_kind(body, |keyword| keyword.ends_with("_DIMENSION")) {
            for ((name, unit), value) in words::DIMENSION.iter().zip(self.arguments(dimension)?) {
                if let Some(number) = value.number() {
                    if *name == "effective cutting diameter" {
                        tool.diameter = Some(Millimetres(number));
                    }
                    tool.values.push(NamedValue::measure(*name, number, unit));
                }
            }
        }
        for (name, value) in words::BODY.iter().zip(body.iter().skip(1)) {
            if *name == "number of effective teeth" {
                tool.teeth = value.number();
            }
            tool.values.extend(self.named(name, value));
        }
        Ok(())
    }

    fn function(&mut self, id: u64, keyword: &str, arguments: &[Value]) -> Function {
        let mut function = Function {
            kind: match keyword {
                "EXTENDED_NC_FUNCTION" => "extended function".to_string(),
                _ => keyword.to_lowercase().replace('_', " "),
            },
            text: String::new(),
            condition: None,
            properties: BTreeMap::new(),
        };
        match (keyword, arguments.get(1)) {
            ("LOAD_TOOL" | "UNLOAD_TOOL", Some(Value::Reference(tool))) => {
                if let Err(fault) = self.tool(*tool, id) {
                    self.program.note(&mut self.out.found, Severity::Warning, &fault);
                }
            }
            ("INDEX_PALLET" | "INDEX_TABLE", Some(index)) => {
                if let Some(index) = index.number() {
                    let name = if keyword == "INDEX_PALLET" {
                        "pallet index"
                    } else {
                        "table index"
                    };
                    function.properties.insert(name.into(), part21::text::real(index));
                }
            }
            (_, Some(said)) => function.text = text(said).into_owned(),
            (_, None) => {}
        }
        function
    }

    fn projects(&mut self) {
        for row in self.aim.file.by_keyword("PROJECT") {
            let id = self.aim.file.id(row);
            let Ok(arguments) = self.arguments(id) else { continue };
            let main = self.of_kind(&arguments, |keyword| keyword == "WORKPLAN");
            let name = arguments.first().map(text).unwrap_or_default().into_owned();
            match main.filter(|main| self.out.executables.contains_key(main)) {
                Some(main_workplan) => self.out.projects.push(Project {
                    id: Some(id),
                    name,
                    main_workplan,
                    is_twin: false,
                    values: self.project_values(&arguments),
                }),
                None => {
                    let fault = Fault::new(
                        id,
                        "project-without-workplan",
                        "a project has no main workplan",
                        "give it one",
                    );
                    self.program.note(&mut self.out.found, Severity::Warning, &fault);
                }
            }
        }
        if self.out.projects.is_empty() {
            let used: BTreeSet<u64> = self.out.executables.values().flat_map(Executable::children).collect();
            let loose =
                self.out.executables.values().filter(|executable| {
                    matches!(executable.kind, ExecutableKind::Workplan(_)) && !used.contains(&executable.id)
                });
            self.out.projects = loose
                .map(|executable| Project {
                    id: None,
                    name: executable.name.clone(),
                    main_workplan: executable.id,
                    is_twin: false,
                    values: Vec::new(),
                })
                .collect();
            let message = match self.out.projects.is_empty() {
                true => "the file has no project and no workplan",
                false => "the file has no project: workplans that nobody executes stand for it",
            };
            let entity = self.out.projects.first().map_or(0, |project| project.main_workplan);
            let fault = Fault::new(entity, "no-project", message, "");
            self.program.note(&mut self.out.found, Severity::Remark, &fault);
        }
    }

    /// Owner, release and status, and the material of the workpieces.
    fn project_values(&self, arguments: &[Value]) -> Vec<NamedValue> {
        let mut values = Vec::new();
        let lists = arguments.iter().flat_map(Value::references);
        for id in arguments.iter().filter_map(Value::reference).chain(lists) {
            let Ok(attributes) = self.arguments(id) else { continue };
            match self.aim.keyword(id) {
                "PERSON_AND_ADDRESS" => {
                    let person = attributes.first().and_then(Value::reference);
                    let person = person.and_then(|person| self.arguments(person).ok()).unwrap_or_default();
                    let words: Vec<&str> = [2, 1].iter().filter_map(|&n| person.get(n).and_then(Value::text)).collect();
                    values.push(NamedValue::text("owner", words.join(" ")));
                }
                "APPROVAL" => {
                    let status = attributes.first().and_then(Value::reference);
                    let status = status.and_then(|status| self.arguments(status).ok()).unwrap_or_default();
                    let words = status
                        .first()
                        .or(attributes.get(1))
                        .map(text)
                        .unwrap_or_default()
                        .into_owned();
                    values.push(NamedValue::text("approval", words));
                }
                "DATE_AND_TIME" => values.extend(
                    crate::date::read(self.aim, id).map(|release| NamedValue::text("release date", crate::date::words(release))),
                ),
                "WORKPIECE" => {
                    values.push(NamedValue::text(
                        "workpiece",
                        attributes.first().map(text).unwrap_or_default(),
                    ));
                    let material = self.of_kind(&attributes, |keyword| keyword == "MATERIAL");
                    let material = material
                        .and_then(|material| self.arguments(material).ok())
                        .unwrap_or_default();
                    let words: Vec<&str> = material.iter().filter_map(Value::text).collect();
                    if !words.is_empty() {
                        values.push(NamedValue::text("material", words.join(" ")));
                    }
                }
                _ => {}
            }
        }
        values
    }
}

/// Entities of operations in parts 11, 12 and later, by the words they end in.
fn is_operation(keyword: &str) -> bool {
    words::OPERATION_TAILS.iter().any(|(entity, _)| *entity == keyword)
        || [
            "_MILLING",
            "_DRILLING",
            "_OPERATION",
            "_ROUGH",
            "_FINISH",
            "_TURNING",
            "_SINKING",
            "_PROBING",
        ]
        .iter()
        .any(|end| keyword.ends_with(end))
        || matches!(
            keyword,
            "THREADING_ROUGH" | "THREADING_FINISH" | "KNURLING" | "BACK_BORING" | "RAPID_MOVEMENT"
        )
}

fn is_toolpath(keyword: &str) -> bool {
    keyword.ends_with("_TRAJECTORY")
        || keyword == "FEEDSTOP"
        || keyword.starts_with("CONNECT_")
        || keyword.starts_with("AP_LIFT_PATH")
}

fn boolean_word(word: &str) -> String {
    match word {
        "T" => "yes".into(),
        "F" => "no".into(),
        word => word.to_lowercase(),
    }
}
