//! As-executed models in STEP-NC: [`append`] adds a run to the file of its plan, [`write_new`] makes a file of a run without a plan,
//! [`read`] finds the runs of a file again.
//!
//! A twin is an ordinary structure of workplan, workingsteps and toolpaths whose executables carry `twin start` (ISO 10303-238,
//! edition 2 and later). Nothing of the plan is changed, byte for byte. As-machined paths are polylines in the frame and the length unit
//! of the planned toolpath; what a twin leaves out is its plan's. Beyond the text of the standard, toolpaths carry their dates and a
//! MACHINING_TWIN_RELATIONSHIP to their planned toolpath too (both are valid instances), so that no reader has to match by name.
//!
//! Same run, same dates, same bytes: nothing in here asks a clock.

mod read;

use crate::date::Civil;
use crate::model::{Executable, ExecutableKind, Program};
use crate::unit;
use part21::text::{encode, real};
use part21::{EditError, Edits, Saved};
use plan::executed::{AsExecuted, Deviation, ExecutedToolpath, ExecutedWorkingstep, PathKind};
use read::Reader;
use std::collections::BTreeMap;
use units::{Millimetres, MmPerSec, Point, Seconds, Timestamp};

/// Where a twin is put.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// A project of its own: other readers show it beside the plan.
    #[default]
    Project,
    /// A disabled workplan at the end of the plan's main workplan.
    Workplan,
}

/// What the writer cannot know from the run.
#[derive(Clone, Debug, PartialEq)]
pub struct TwinOptions {
    /// The time stamp of the header.
    pub written: Timestamp,
    /// The program that writes, for the header's preprocessor field.
    pub writer: String,
    /// Where the twin goes; [`write_new`] always makes a project.
    pub placement: Placement,
    /// Identifier and description of the machine.
    pub machine: Option<(String, String)>,
    /// Who ran it.
    pub operator: Option<String>,
}

impl TwinOptions {
    /// A project written at a moment, without machine and operator.
    pub fn at(written: Timestamp) -> Self {
        Self {
            written,
            writer: "toolmark".into(),
            placement: Placement::Project,
            machine: None,
            operator: None,
        }
    }
}

/// Why a run cannot be written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The file's text cannot be changed, or the run holds a number that STEP cannot.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The file holds no plan.
    #[error("{0} holds no machining project or workplan to which a run could be added")]
    NoPlan(String),
    /// The run points at something that is not in the file.
    #[error("the run says that '{name}' is a run of #{entity}, which is not in {file}: is this the plan it was made from?")]
    NotInPlan {
        /// The part of the run.
        name: String,
        /// What it points at.
        entity: u64,
        /// The file.
        file: String,
    },
    /// Another file cannot point at the plan.
    #[error(
        "{file} has no anchor for #{entity}, so another file cannot point at it: put the run into the plan's file, or give the plan an ANCHOR section"
    )]
    NoAnchor {
        /// What was run.
        entity: u64,
        /// The plan's file.
        file: String,
    },
    /// A coordinate is infinite or not a number.
    #[error("toolpath '{0}' has a point that is not a finite number")]
    NotFinite(String),
}

/// Adds a run to the file of its plan.
///
/// # Errors
/// When the run does not fit the file, or the file cannot be added to.
pub fn append(program: &Program, run: &AsExecuted, options: &TwinOptions) -> Result<Saved, WriteError> {
    let main = run.plan.or_else(|| program.plan().map(|project| project.main_workplan));
    let main = main.ok_or_else(|| WriteError::NoPlan(program.name().to_string()))?;
    let main = planned(program, &run.name, main)?;
    let mut edits = Edits::new(program.file());
    let moment = encode(&Civil::of(options.written).rfc_3339());
    // A header without these fields is one of those things that readers forgive; the run is worth more.
    let mut notices = Vec::new();
    if edits.set_header("FILE_NAME", 1, &moment).is_err() || edits.set_header("FILE_NAME", 4, &encode(&options.writer)).is_err() {
        notices.push("the header has no FILE_NAME with a time stamp; it stays as it is".to_string());
    }
    if program.schema() == "INTEGRATED_CNC_SCHEMA" {
        notices.push("twins belong to edition 2 and later; the schema name of the first edition is kept as it is".to_string());
    }
    let shared = Shared::of_file(program, main, &mut edits)?;
    let mut writer = Writer {
        sink: &mut edits,
        program: Some(program),
        shared,
        dates: BTreeMap::new(),
        roles: BTreeMap::new(),
        utc: None,
        units: BTreeMap::new(),
        new_file: false,
        anchored: BTreeMap::new(),
        left_out: 0,
        options,
    };
    let twin = writer.run(run, Some(main))?;
    match options.placement {
        Placement::Project => writer.project(&format!("{} {}", writer.shared.name, run.name), twin)?,
        Placement::Workplan => {
            let last = program
                .aim()
                .links(main.id)
                .relations
                .iter()
                .filter_map(|r| r.sequence)
                .fold(0.0, f64::max);
            writer.add(format!(
                "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{},#{twin},{})",
                main.id,
                real(last.floor() + 1.0)
            ))?;
            writer.describe(twin, "enabled", "disabled")?;
        }
    }
    if writer.left_out > 0 {
        notices.push(format!(
            "{} toolpaths of the run have no recorded points and are left out",
            writer.left_out
        ));
    }
    let mut saved = edits.save()?;
    saved.notices.extend(notices);
    Ok(saved)
}

/// Makes a file of a run that has no plan: millimetres, one project, its workingsteps with rapid and feed toolpaths, their tools.
///
/// The feed of a path is the mean of its measured speed; a spindle speed is not in a run, so none is written.
///
/// # Errors
/// When the run holds numbers that STEP cannot.
pub fn write_new(run: &AsExecuted, options: &TwinOptions) -> Result<Vec<u8>, WriteError> {
    write_file(run, options, BTreeMap::new(), "")
}

/// Makes a file of a run beside its plan: it points at the anchors that the plan has (Part 21 edition 3), `uri` is where the plan is.
/// Parts of the plan without an anchor have none to point at, and that is said.
///
/// # Errors
/// When the plan has no anchor for what was run, or the run holds numbers that STEP cannot.
pub fn write_beside(plan: &Program, uri: &str, run: &AsExecuted, options: &TwinOptions) -> Result<Saved, WriteError> {
    let main = run.plan.or_else(|| plan.plan().map(|project| project.main_workplan));
    let main = main.ok_or_else(|| WriteError::NoPlan(plan.name().to_string()))?;
    let mut anchored = BTreeMap::new();
    let mut references = String::new();
    for anchor in plan.file().anchors() {
        let Some(entity) = anchor.value.reference() else { continue };
        let id = anchored.len() as u64 + 1;
        if let std::collections::btree_map::Entry::Vacant(place) = anchored.entry(entity) {
            place.insert(id);
            references.push_str(&format!("#{id}=<{uri}#{}>;\n", anchor.name));
        }
    }
    if !anchored.contains_key(&main) {
        return Err(WriteError::NoAnchor {
            entity: main,
            file: plan.name().to_string(),
        });
    }
    let without = run
        .workingsteps
        .iter()
        .filter_map(|step| step.plan)
        .filter(|id| !anchored.contains_key(id))
        .count();
    let mut notices = Vec::new();
    if without > 0 {
        notices.push(format!(
            "{without} workingsteps of the plan have no anchor: their runs do not point at them"
        ));
    }
    let bytes = write_file(run, options, anchored, &references)?;
    Ok(Saved { bytes, notices })
}

fn write_file(
    run: &AsExecuted,
    options: &TwinOptions,
    anchored: BTreeMap<u64, u64>,
    references: &str,
) -> Result<Vec<u8>, WriteError> {
    let mut sink = NewFile {
        text: String::new(),
        next_id: 10.max(anchored.len() as u64 + 1),
    };
    let shared = Shared::new_file(&mut sink, &run.name)?;
    let beside = !anchored.is_empty();
    let mut writer = Writer {
        sink: &mut sink,
        program: None,
        shared,
        dates: BTreeMap::new(),
        roles: BTreeMap::new(),
        utc: None,
        units: BTreeMap::new(),
        new_file: true,
        anchored,
        left_out: 0,
        options,
    };
    let twin = writer.run(run, None)?;
    writer.project(&run.name, twin)?;
    let (description, level, section) = match beside {
        true => (
            "as-executed run of a plan in another file",
            "4;1",
            format!("REFERENCE;\n{references}ENDSEC;\n"),
        ),
        false => ("as-executed run without a plan", "2;1", String::new()),
    };
    let header = format!(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(({}),'{level}');\nFILE_NAME({},{},(''),(''),{},'','');\n\
         FILE_SCHEMA(('MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA'));\nENDSEC;\n{section}DATA;\n",
        encode(description),
        encode(&run.name),
        encode(&Civil::of(options.written).rfc_3339()),
        encode(&options.writer),
    );
    Ok(format!("{header}{}ENDSEC;\nEND-ISO-10303-21;\n", sink.text).into_bytes())
}

/// A run that a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct TwinRun {
    /// What happened. Times of single points are not in a file: they are spread over the toolpath by length.
    pub run: AsExecuted,
    /// The main workplan of the run.
    pub entity: u64,
    /// Where the plan is, when it is in another file: `plan.stpnc#main`.
    pub external_plan: Option<String>,
}

/// The runs of a file, in its order. `plan` is the program they are runs of: the same one, or the file that their REFERENCE section
/// points at; links that lead there come out as identifiers of `plan`.
pub fn read(program: &Program, plan: &Program) -> Vec<TwinRun> {
    Reader { program, plan }.runs()
}

fn planned<'p>(program: &'p Program, name: &str, entity: u64) -> Result<&'p Executable, WriteError> {
    program.executable(entity).ok_or_else(|| WriteError::NotInPlan {
        name: name.to_string(),
        entity,
        file: program.name().to_string(),
    })
}

/// Takes instances, gives identifiers.
trait Sink {
    fn add(&mut self, body: &str) -> Result<u64, EditError>;
}

impl Sink for Edits<'_> {
    fn add(&mut self, body: &str) -> Result<u64, EditError> {
        self.append(body)
    }
}

struct NewFile {
    text: String,
    next_id: u64,
}

impl Sink for NewFile {
    fn add(&mut self, body: &str) -> Result<u64, EditError> {
        let id = self.next_id;
        self.next_id += 1;
        self.text.push_str(&format!("#{id}={body};\n"));
        Ok(id)
    }
}

/// Instances that everything new refers to.
struct Shared {
    /// Name of the plan's project.
    name: String,
    product_context: u64,
    definition_context: u64,
    no_units: u64,
    millimetre: u64,
    second: u64,
    dimensionless: u64,
    /// A geometric context in millimetres, once it is needed.
    context: Option<u64>,
    workpiece: u64,
    /// The feature process of workingsteps without a planned one.
    feature_process: u64,
    required: u64,
    rapid: u64,
}

impl Shared {
    fn of_file(program: &Program, main: &Executable, sink: &mut dyn Sink) -> Result<Self, WriteError> {
        let aim = program.aim();
        let first = |keyword: &str| aim.file.by_keyword(keyword).next().map(|row| aim.file.id(row));
        let project = program
            .projects()
            .iter()
            .find(|project| project.main_workplan == main.id)
            .or(program.plan());
        let name = project.map_or_else(|| main.name.clone(), |project| project.name.clone());
        let application = match first("APPLICATION_CONTEXT") {
            Some(id) => id,
            None => sink.add("APPLICATION_CONTEXT('Application protocol for the exchange of CNC data')")?,
        };
        let product_context = match first("PRODUCT_CONTEXT") {
            Some(id) => id,
            None => sink.add(&format!("PRODUCT_CONTEXT('CNC Machining',#{application},'manufacturing')"))?,
        };
        let definition_context = match first("PRODUCT_DEFINITION_CONTEXT") {
            Some(id) => id,
            None => sink.add(&format!(
                "PRODUCT_DEFINITION_CONTEXT('CNC Machining',#{application},'manufacturing')"
            ))?,
        };
        let unit_of = |keyword: &str, dimension: unit::Dimension| {
            let mut rows = aim.file.by_keyword(keyword);
            let wanted = unit::Unit { factor: 1.0, dimension };
            rows.find(|&row| aim.unit(aim.file.id(row)) == Ok(wanted))
                .map(|row| aim.file.id(row))
        };
        let millimetre = match unit_of("LENGTH_UNIT", unit::LENGTH) {
            Some(id) => id,
            None => sink.add(MILLIMETRE)?,
        };
        let second = match unit_of("TIME_UNIT", unit::TIME) {
            Some(id) => id,
            None => sink.add(SECOND)?,
        };
        let mut plain_contexts = aim
            .file
            .by_keyword("REPRESENTATION_CONTEXT")
            .filter(|&row| aim.file.keyword(row) == "REPRESENTATION_CONTEXT");
        let no_units = match plain_contexts.next() {
            Some(row) => aim.file.id(row),
            None => sink.add(NO_UNITS)?,
        };
        let in_millimetres =
            |(id, units): &(u64, unit::ContextUnits)| units.millimetres == 1.0 && aim.is(*id, "GEOMETRIC_REPRESENTATION_CONTEXT");
        let context = program.contexts().find(in_millimetres).map(|(id, _)| id);
        let dimensionless = sink.add(DIMENSIONLESS)?;
        let workpiece = aim
            .file
            .by_keyword("MACHINING_PROJECT_WORKPIECE_RELATIONSHIP")
            .find_map(|row| aim.parsed(row).ok()?.argument(4).reference());
        let workpiece = match workpiece {
            Some(id) => id,
            None => make_workpiece(sink, &name, product_context, definition_context)?,
        };
        let feature_process = match first("MACHINING_FEATURE_PROCESS") {
            Some(id) => id,
            None => make_feature(sink, workpiece)?,
        };
        let ids = [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ];
        Self::complete(sink, name, context, ids)
    }

    fn new_file(sink: &mut dyn Sink, name: &str) -> Result<Self, WriteError> {
        let application = sink.add("APPLICATION_CONTEXT('Application protocol for the exchange of CNC data')")?;
        sink.add(&format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','model_based_integrated_manufacturing_schema',2022,#{application})"
        ))?;
        let product_context = sink.add(&format!("PRODUCT_CONTEXT('CNC Machining',#{application},'manufacturing')"))?;
        let definition_context = sink.add(&format!(
            "PRODUCT_DEFINITION_CONTEXT('CNC Machining',#{application},'manufacturing')"
        ))?;
        let millimetre = sink.add(MILLIMETRE)?;
        let second = sink.add(SECOND)?;
        let dimensionless = sink.add(DIMENSIONLESS)?;
        let no_units = sink.add(NO_UNITS)?;
        let workpiece = make_workpiece(sink, name, product_context, definition_context)?;
        let feature_process = make_feature(sink, workpiece)?;
        let ids = [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ];
        Self::complete(sink, name.to_string(), None, ids)
    }

    fn complete(sink: &mut dyn Sink, name: String, context: Option<u64>, ids: [u64; 8]) -> Result<Self, WriteError> {
        let [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ] = ids;
        let required = sink.add("DESCRIPTIVE_REPRESENTATION_ITEM('','required')")?;
        let required = sink.add(&format!("REPRESENTATION('',(#{required}),#{no_units})"))?;
        let rapid = sink.add("DESCRIPTIVE_REPRESENTATION_ITEM('','rapid')")?;
        let rapid = sink.add(&format!(
            "MACHINING_TOOLPATH_SPEED_PROFILE_REPRESENTATION('',(#{rapid}),#{no_units})"
        ))?;
        Ok(Self {
            name,
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            context,
            workpiece,
            feature_process,
            required,
            rapid,
        })
    }
}

const MILLIMETRE: &str = "(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))";
const SECOND: &str = "(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT())";
const NO_UNITS: &str = "REPRESENTATION_CONTEXT('','units not necessary')";
const DIMENSIONLESS: &str = "DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.)";

fn geometric_context(sink: &mut dyn Sink, millimetre: u64) -> Result<u64, EditError> {
    let radian = sink.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")?;
    let steradian = sink.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")?;
    let uncertainty = sink.add(&format!(
        "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),#{millimetre},'DISTANCE_ACCURACY_VALUE','maximum distance between coincident points')"
    ))?;
    sink.add(&format!(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{uncertainty})) \
         GLOBAL_UNIT_ASSIGNED_CONTEXT((#{millimetre},#{radian},#{steradian})) REPRESENTATION_CONTEXT('ID1','3D'))"
    ))
}

fn make_workpiece(sink: &mut dyn Sink, name: &str, product_context: u64, definition_context: u64) -> Result<u64, EditError> {
    let name = encode(name);
    let product = sink.add(&format!("PRODUCT({name},{name},$,(#{product_context}))"))?;
    let formation = sink.add(&format!("PRODUCT_DEFINITION_FORMATION('1','',#{product})"))?;
    sink.add(&format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"))
}

/// The feature of workingsteps that only have toolpaths.
fn make_feature(sink: &mut dyn Sink, workpiece: u64) -> Result<u64, EditError> {
    let shape = sink.add(&format!("PRODUCT_DEFINITION_SHAPE('','',#{workpiece})"))?;
    let feature = sink.add(&format!(
        "INSTANCED_FEATURE('toolpath feature','toolpath','','toolpath',#{shape},.F.)"
    ))?;
    let process = sink.add("MACHINING_FEATURE_PROCESS('','machining','','')")?;
    let property = sink.add(&format!("PROPERTY_PROCESS('machining','machining',#{process},'')"))?;
    sink.add(&format!(
        "PROCESS_PROPERTY_ASSOCIATION('','machining',#{property},#{feature})"
    ))?;
    Ok(process)
}

struct Writer<'w> {
    sink: &'w mut dyn Sink,
    program: Option<&'w Program>,
    shared: Shared,
    /// Moments that are written already, by nanosecond.
    dates: BTreeMap<i64, u64>,
    roles: BTreeMap<&'static str, u64>,
    /// The offset of all times that are written: none.
    utc: Option<u64>,
    /// Units of results that are neither lengths nor times.
    units: BTreeMap<String, u64>,
    new_file: bool,
    /// What other files' parts are called in this one, by their identifiers there.
    anchored: BTreeMap<u64, u64>,
    /// Toolpaths without points.
    left_out: u64,
    options: &'w TwinOptions,
}

/// A workplan of the twin that is being filled.
struct OpenPlan {
    /// The planned workplan, or a name.
    key: (String, Option<u64>),
    id: u64,
    children: u32,
    facts: Span,
}

/// When and how long.
#[derive(Clone, Copy)]
struct Span {
    start: Timestamp,
    end: Timestamp,
    worktime: Seconds,
}

impl Writer<'_> {
    fn add(&mut self, body: impl AsRef<str>) -> Result<u64, EditError> {
        self.sink.add(body.as_ref())
    }

    /// Writes the executables of a run; the answer is its main workplan.
    fn run(&mut self, run: &AsExecuted, main: Option<&Executable>) -> Result<u64, WriteError> {
        let source = match run.simulated && !run.source.contains("SIMULATED") {
            true => format!("SIMULATED: {}", run.source),
            false => run.source.clone(),
        };
        let name = match main {
            Some(main) => format!("{} / {}", main.name, run.name),
            None => run.name.clone(),
        };
        let machine = match &self.options.machine {
            Some((id, description)) => Some(self.add(format!(
                "MACHINING_MACHINE_USAGE({},{},'','')",
                encode(id),
                encode(description)
            ))?),
            None => None,
        };
        let id = self.add(format!("MACHINING_WORKPLAN({},'','','')", encode(&name)))?;
        let whole = Span {
            start: run.start,
            end: run.end,
            worktime: run.worktime,
        };
        // In a file of its own the run says by its number in the other file what it is a run of.
        let whole_plan = main.map(|main| main.id).or(run.plan.filter(|_| !self.anchored.is_empty()));
        let mut open = vec![OpenPlan {
            key: (name, whole_plan),
            id,
            children: 0,
            facts: whole,
        }];
        let mut tools: BTreeMap<u32, Vec<u64>> = BTreeMap::new();
        for workingstep in &run.workingsteps {
            self.arrange(&mut open, workingstep, &source)?;
            let (step, operation) = self.workingstep(workingstep, &source)?;
            if let Some(tool) = workingstep.tool {
                tools.entry(tool.0).or_default().push(operation);
            }
            if let Some(machine) = machine {
                self.add(format!("MACHINING_USAGE_RELATIONSHIP('','',#{step},#{machine})"))?;
            }
            if let Some(around) = open.last_mut() {
                around.children += 1;
                let (plan, place) = (around.id, around.children);
                self.add(format!(
                    "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{step},{place}.)"
                ))?;
            }
        }
        while open.len() > 1 {
            self.close(&mut open, &source)?;
        }
        self.facts(id, whole, whole_plan, &source, run.exception.as_deref())?;
        if let Some(machine) = machine {
            self.add(format!("MACHINING_USAGE_RELATIONSHIP('','',#{id},#{machine})"))?;
        }
        if self.new_file {
            self.tools(&tools)?;
        }
        Ok(id)
    }

    /// Opens and closes workplans so that the innermost is the one around `workingstep`.
    fn arrange(&mut self, open: &mut Vec<OpenPlan>, workingstep: &ExecutedWorkingstep, source: &str) -> Result<(), WriteError> {
        let main = open.first().and_then(|main| main.key.1);
        // The main workplan itself may be named as the outermost, or left out.
        let within = match workingstep.within.split_first() {
            Some((outermost, rest)) if main.is_some() && outermost.1 == main => rest,
            _ => &workingstep.within[..],
        };
        let same = open[1..]
            .iter()
            .zip(within)
            .take_while(|(plan, key)| plan.key == **key)
            .count();
        while open.len() > same + 1 {
            self.close(open, source)?;
        }
        for key in &within[same..] {
            let id = self.add(format!("MACHINING_WORKPLAN({},'','','')", encode(&key.0)))?;
            if let Some(around) = open.last_mut() {
                around.children += 1;
                let (plan, place) = (around.id, around.children);
                self.add(format!(
                    "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{id},{place}.)"
                ))?;
            }
            open.push(OpenPlan {
                key: key.clone(),
                id,
                children: 0,
                facts: Span {
                    start: workingstep.start,
                    end: workingstep.end,
                    worktime: Seconds::ZERO,
                },
            });
        }
        for plan in &mut open[1..] {
            plan.facts.start = plan.facts.start.min(workingstep.start);
            plan.facts.end = plan.facts.end.max(workingstep.end);
            plan.facts.worktime += workingstep.worktime;
        }
        Ok(())
    }

    fn close(&mut self, open: &mut Vec<OpenPlan>, source: &str) -> Result<(), WriteError> {
        if let Some(plan) = open.pop() {
            if let (Some(program), Some(entity)) = (self.program, plan.key.1) {
                planned(program, &plan.key.0, entity)?;
            }
            self.facts(plan.id, plan.facts, plan.key.1, source, None)?;
        }
        Ok(())
    }

    /// Writes one workingstep; the answer is it and its operation.
    fn workingstep(&mut self, step: &ExecutedWorkingstep, source: &str) -> Result<(u64, u64), WriteError> {
        let plan = match (self.program, step.plan) {
            (Some(program), Some(entity)) => Some(planned(program, &step.name, entity)?),
            _ => None,
        };
        let planned_operation = plan.and_then(|plan| match plan.kind {
            ExecutableKind::Workingstep { operation, .. } => self.program?.operation(operation?),
            _ => None,
        });
        // An operation has four texts; others (probing, complex ones) carry more and are not copied.
        let plain = planned_operation.filter(|operation| {
            let count = self.program.and_then(|program| program.aim().instance(operation.id).ok());
            count.is_some_and(|instance| instance.records().len() == 1 && instance.records()[0].arguments.len() == 4)
        });
        let (kind, variant) = plain.map_or(("FREEFORM_MILLING_OPERATION", "finishing"), |operation| {
            (&operation.kind, &operation.variant)
        });
        let name = format!("{} as executed", step.name);
        let mut paths = Vec::new();
        for toolpath in &step.toolpaths {
            paths.extend(self.toolpath(toolpath)?);
        }
        let operation = self.add(format!("{kind}({},{},'','')", encode(&name), encode(variant)))?;
        for (place, path) in paths.iter().enumerate() {
            self.add(format!(
                "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{operation},#{path},{}.)",
                place + 1
            ))?;
        }
        let id = self.add(format!("MACHINING_WORKINGSTEP({},'machining','','')", encode(&name)))?;
        self.add(format!("MACHINING_OPERATION_RELATIONSHIP('','machining',#{id},#{operation})"))?;
        let feature = plan.and_then(|plan| self.program?.aim().links(plan.id).related("MACHINING_FEATURE_RELATIONSHIP"));
        let feature = feature.unwrap_or(self.shared.feature_process);
        self.add(format!("MACHINING_FEATURE_RELATIONSHIP('','machining',#{id},#{feature})"))?;
        let span = Span {
            start: step.start,
            end: step.end,
            worktime: step.worktime,
        };
        self.facts(id, span, step.plan, source, step.exception.as_deref())?;
        if let Some(deviation) = &step.deviation {
            self.deviation(id, deviation, step.end)?;
        }
        if let Some(time) = step.planned {
            self.result(id, "planned time", "derived", time.0, "s", step.end)?;
        }
        if let Some(tool) = step.tool
            && !self.new_file
        {
            let planned_tool = planned_operation.and_then(|operation| self.program?.tool_of(operation.id)?.number);
            if planned_tool != Some(tool) {
                self.result(id, "tool number", "measured", f64::from(tool.0), "tool", step.end)?;
            }
        }
        for result in &step.results {
            self.result(id, &result.name, &result.quality, result.value, &result.unit, result.at)?;
        }
        Ok((id, operation))
    }

    /// Writes one toolpath; `None` when it is no dwell and has no points.
    fn toolpath(&mut self, path: &ExecutedToolpath) -> Result<Option<u64>, WriteError> {
        if path.points.is_empty() && path.kind != PathKind::Dwell {
            self.left_out += 1;
            return Ok(None);
        }
        if path.points.iter().any(|point| !point.position.is_finite()) {
            return Err(WriteError::NotFinite(path.name.clone()));
        }
        let plan = match (self.program, path.plan) {
            (Some(program), Some(id)) if program.file().row(id).is_some() => Some(program.toolpath(id)),
            (Some(program), Some(entity)) => {
                return Err(WriteError::NotInPlan {
                    name: path.name.clone(),
                    entity,
                    file: program.name().to_string(),
                });
            }
            _ => None,
        };
        let units = plan
            .as_ref()
            .and_then(|plan| Some((plan.context?, self.program?.units_of(plan).ok()?)));
        let (context, millimetres) = match units {
            Some((context, units)) => (context, units.millimetres),
            None => (self.millimetre_context()?, 1.0),
        };
        let description = if path.kind == PathKind::Dwell {
            "feedstop"
        } else {
            "cutter location trajectory"
        };
        let mut points = Vec::with_capacity(path.points.len().max(2));
        if path.kind != PathKind::Dwell {
            for point in &path.points {
                points.push(self.point(point.position, millimetres)?);
            }
            if let [only] = path.points.as_slice() {
                points.push(self.point(only.position, millimetres)?); // a polyline has two points
            }
        }
        let id = if points.is_empty() {
            self.add(format!("MACHINING_TOOLPATH({},'{description}','','')", encode(&path.name)))?
        } else {
            let list: Vec<String> = points.iter().map(|point| format!("#{point}")).collect();
            let curve = self.add(format!("POLYLINE('',({}))", list.join(",")))?;
            let id = self.add(format!("MACHINING_TOOLPATH({},'{description}','','')", encode(&path.name)))?;
            let representation = self.add(format!("REPRESENTATION('',(#{curve}),#{context})"))?;
            self.property(id, "basic curve", representation)?;
            id
        };
        let required = self.shared.required;
        self.property(id, "priority", required)?;
        if path.kind == PathKind::Rapid {
            let rapid = self.shared.rapid;
            self.property(id, "speed profile", rapid)?;
        }
        if path.kind == PathKind::Dwell {
            let item = self.time("dwell time", path.end.since(path.start).max(Seconds::ZERO))?;
            let no_units = self.shared.no_units;
            let representation = self.add(format!(
                "MACHINING_DWELL_TIME_REPRESENTATION('dwell time',(#{item}),#{no_units})"
            ))?;
            self.property(id, "dwell", representation)?;
        }
        self.date(id, "twin start", path.start)?;
        self.date(id, "twin end", path.end)?;
        if let Some(plan) = self.link(path.plan) {
            self.add(format!("MACHINING_TWIN_RELATIONSHIP('','',#{id},#{plan})"))?;
        }
        if path.kind == PathKind::Feed && path.speed.0 > 0.0 && path.speed.is_finite() {
            if self.new_file {
                self.technology(id, path.speed)?;
            } else {
                self.result(id, MEAN_SPEED, "derived", path.speed.0, "mm/s", path.end)?;
            }
        }
        if let Some(deviation) = &path.deviation {
            self.deviation(id, deviation, path.end)?;
        }
        Ok(Some(id))
    }

    fn millimetre_context(&mut self) -> Result<u64, EditError> {
        let id = match self.shared.context {
            Some(id) => id,
            None => geometric_context(self.sink, self.shared.millimetre)?,
        };
        self.shared.context = Some(id);
        Ok(id)
    }

    fn point(&mut self, point: Point<units::Setup>, millimetres: f64) -> Result<u64, EditError> {
        // Rounded to a nanometre of the file's unit: recorded positions are no finer, and the text stays readable.
        let number = |c: f64| {
            let c = libm::round(c / millimetres * 1e9) / 1e9;
            real(if c == 0.0 { 0.0 } else { c })
        };
        let [x, y, z] = point.xyz.map(number);
        self.add(format!("CARTESIAN_POINT('',({x},{y},{z}))"))
    }

    fn technology(&mut self, path: u64, speed: MmPerSec) -> Result<(), EditError> {
        let unit = self.context_unit("mm/s")?;
        let technology = self.add("MACHINING_TECHNOLOGY('mean of the measured speed','milling','','')")?;
        let item = self.add(format!(
            "MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE({}),#{unit})",
            real(speed.0)
        ))?;
        let no_units = self.shared.no_units;
        let representation = self.add(format!(
            "MACHINING_FEED_SPEED_REPRESENTATION('feed speed',(#{item}),#{no_units})"
        ))?;
        self.property(technology, "feedrate", representation)?;
        self.add(format!("MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{path},#{technology})"))?;
        Ok(())
    }

    fn tools(&mut self, tools: &BTreeMap<u32, Vec<u64>>) -> Result<(), EditError> {
        for (number, users) in tools {
            let kind = self.add("ACTION_RESOURCE_TYPE('milling cutting tool')")?;
            let users: Vec<String> = users.iter().map(|user| format!("#{user}")).collect();
            self.add(format!(
                "MACHINING_TOOL('{number}','user defined milling tool',({}),#{kind})",
                users.join(",")
            ))?;
        }
        Ok(())
    }

    /// What a planned part is called in the file that is written.
    fn link(&self, plan: Option<u64>) -> Option<u64> {
        if self.new_file {
            return self.anchored.get(&plan?).copied();
        }
        plan
    }

    /// What makes an executable a twin.
    fn facts(&mut self, id: u64, span: Span, plan: Option<u64>, source: &str, exception: Option<&str>) -> Result<(), WriteError> {
        self.date(id, "twin start", span.start)?;
        self.date(id, "twin end", span.end)?;
        if let Some(plan) = self.link(plan) {
            self.add(format!("MACHINING_TWIN_RELATIONSHIP('','',#{id},#{plan})"))?;
        }
        self.describe(id, "twin source", source)?;
        let item = self.time("twin worktime", span.worktime)?;
        let representation = self.representation(item)?;
        self.property(id, "twin worktime", representation)?;
        if let Some(exception) = exception {
            self.describe(id, "twin exception", exception)?;
        }
        Ok(())
    }

    fn project(&mut self, name: &str, main: u64) -> Result<(), WriteError> {
        let (name, product_context, definition_context) =
            (encode(name), self.shared.product_context, self.shared.definition_context);
        let project = self.add(format!("MACHINING_PROJECT({name},{name},$,(#{product_context}))"))?;
        let formation = self.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{project})"))?;
        let definition = self.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"))?;
        let process = self.add(format!("PRODUCT_DEFINITION_PROCESS('machining','',#{main},'')"))?;
        self.add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{definition},#{process})"))?;
        let workpiece = self.shared.workpiece;
        self.add(format!(
            "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP('','workpiece','',#{definition},#{workpiece})"
        ))?;
        if let Some(operator) = &self.options.operator {
            let operator = encode(operator);
            let person = self.add(format!("PERSON({operator},{operator},$,$,$,$)"))?;
            let organization = self.add("ORGANIZATION($,'',$)")?;
            let both = self.add(format!("PERSON_AND_ORGANIZATION(#{person},#{organization})"))?;
            let role = self.add("PERSON_AND_ORGANIZATION_ROLE('operator')")?;
            self.add(format!(
                "APPLIED_PERSON_AND_ORGANIZATION_ASSIGNMENT(#{both},#{role},(#{definition}))"
            ))?;
        }
        Ok(())
    }

    fn property(&mut self, owner: u64, name: &str, representation: u64) -> Result<u64, EditError> {
        let property = self.add(format!("ACTION_PROPERTY('{name}','',#{owner})"))?;
        self.add(format!("ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"))
    }

    fn representation(&mut self, item: u64) -> Result<u64, EditError> {
        let no_units = self.shared.no_units;
        self.add(format!("REPRESENTATION('',(#{item}),#{no_units})"))
    }

    fn describe(&mut self, owner: u64, name: &str, text: &str) -> Result<u64, EditError> {
        let item = self.add(format!("DESCRIPTIVE_REPRESENTATION_ITEM('',{})", encode(text)))?;
        let representation = self.representation(item)?;
        self.property(owner, name, representation)
    }

    fn time(&mut self, name: &str, time: Seconds) -> Result<u64, EditError> {
        let (name, value, unit) = (encode(name), real(time.0), self.shared.second);
        self.add(format!(
            "(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(TIME_MEASURE({value}),#{unit}) REPRESENTATION_ITEM({name}) TIME_MEASURE_WITH_UNIT())"
        ))
    }

    fn length(&mut self, name: &str, length: Millimetres) -> Result<u64, EditError> {
        let (name, value, unit) = (encode(name), real(length.0), self.shared.millimetre);
        self.add(format!(
            "(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE({value}),#{unit}) REPRESENTATION_ITEM({name}))"
        ))
    }

    /// A unit by its name; speeds are derived properly, anything else depends on its context.
    fn context_unit(&mut self, name: &str) -> Result<u64, EditError> {
        if let Some(&id) = self.units.get(name) {
            return Ok(id);
        }
        let id = if name == "mm/s" {
            let (millimetre, second) = (self.shared.millimetre, self.shared.second);
            let above = self.add(format!("DERIVED_UNIT_ELEMENT(#{millimetre},1.)"))?;
            let below = self.add(format!("DERIVED_UNIT_ELEMENT(#{second},-1.)"))?;
            self.add(format!("DERIVED_UNIT((#{above},#{below}))"))?
        } else {
            let dimensionless = self.shared.dimensionless;
            self.add(format!("CONTEXT_DEPENDENT_UNIT(#{dimensionless},{})", encode(name)))?
        };
        self.units.insert(name.to_string(), id);
        Ok(id)
    }

    fn deviation(&mut self, owner: u64, deviation: &Deviation, at: Timestamp) -> Result<(), EditError> {
        self.result(owner, DEVIATION_MAX, "derived", deviation.max.0, "mm", at)?;
        self.result(owner, DEVIATION_P95, "derived", deviation.p95.0, "mm", at)?;
        self.result(owner, DEVIATION_RMS, "derived", deviation.rms.0, "mm", at)?;
        self.result(owner, DEVIATION_SAMPLES, "measured", deviation.samples as f64, "count", at)
    }

    /// A dated process property with a number.
    fn result(&mut self, owner: u64, name: &str, quality: &str, value: f64, unit: &str, at: Timestamp) -> Result<(), EditError> {
        let item = match unit {
            "mm" => self.length(name, Millimetres(value))?,
            "s" => self.time(name, Seconds(value))?,
            _ => {
                let id = self.context_unit(unit)?;
                let measure = if unit == "count" { "COUNT_MEASURE" } else { "NUMERIC_MEASURE" };
                self.add(format!(
                    "MEASURE_REPRESENTATION_ITEM({},{measure}({}),#{id})",
                    encode(name),
                    real(value)
                ))?
            }
        };
        let representation = self.representation(item)?;
        let property = self.add(format!(
            "MACHINING_PROCESS_PROPERTY({},{},#{owner})",
            encode(name),
            encode(quality)
        ))?;
        self.add(format!("ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"))?;
        self.date(property, "property date", at)
    }

    fn date(&mut self, owner: u64, role: &'static str, at: Timestamp) -> Result<(), EditError> {
        let role = match self.roles.get(role) {
            Some(&id) => id,
            None => {
                let id = self.add(format!("DATE_TIME_ROLE('{role}')"))?;
                self.roles.insert(role, id);
                id
            }
        };
        let moment = match self.dates.get(&at.0) {
            Some(&id) => id,
            None => {
                let civil = Civil::of(at);
                let zone = match self.utc {
                    Some(id) => id,
                    None => self.add("COORDINATED_UNIVERSAL_TIME_OFFSET(0,$,.EXACT.)")?,
                };
                self.utc = Some(zone);
                let date = self.add(format!("CALENDAR_DATE({},{},{})", civil.year, civil.day, civil.month))?;
                let time = self.add(format!(
                    "LOCAL_TIME({},{},{},#{zone})",
                    civil.hour,
                    civil.minute,
                    civil.seconds()
                ))?;
                let id = self.add(format!("DATE_AND_TIME(#{date},#{time})"))?;
                self.dates.insert(at.0, id);
                id
            }
        };
        self.add(format!("APPLIED_DATE_AND_TIME_ASSIGNMENT(#{moment},#{role},(#{owner}))"))?;
        Ok(())
    }
}

const MEAN_SPEED: &str = "mean path speed";
const DEVIATION_MAX: &str = "maximum path deviation";
const DEVIATION_P95: &str = "path deviation of 95 percent";
const DEVIATION_RMS: &str = "root mean square path deviation";
const DEVIATION_SAMPLES: &str = "path deviation samples";
