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
mod shared;
mod writer;

use crate::date::Civil;
use crate::model::{Executable, ExecutableKind, Program};
use crate::unit;
use part21::text::{encode, real};
use part21::{EditError, Edits, Saved};
use plan::executed::{AsExecuted, Deviation, ExecutedToolpath, ExecutedWorkingstep, PathKind};
use read::Reader;
use shared::{Shared, geometric_context};
use std::collections::BTreeMap;
use units::{Millimetres, MmPerSec, Point, Seconds, Timestamp};
use writer::Writer;

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

const MEAN_SPEED: &str = "mean path speed";
const DEVIATION_MAX: &str = "maximum path deviation";
const DEVIATION_P95: &str = "path deviation of 95 percent";
const DEVIATION_RMS: &str = "root mean square path deviation";
const DEVIATION_SAMPLES: &str = "path deviation samples";
