//! `toolmark size`: measured size in, offset out.
//!
//! The law, the checks and the meaning of the history are `sizing`'s; what is kept is the store's; here they meet a person.

pub mod args;
mod enter;
mod generate;
mod history;
mod list;
mod propose;
mod study;
mod undo;

use super::{Done, print_json};
use crate::cli::{Common, DisplayUnits};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::{clock, say, shop};
use args::{JobArgs, SizeCommand};
use ledger::{Action, ChangeRequest};
use serde_json::json;
use sizing::history::{Row, What};
use sizing::{Dimension, Job, MachineAxes, Unit};
use std::path::Path;
use store::sizing::{NewSize, SizingJob};
use store::{DataDirectory, MachineFile};
use units::{Axis, Millimetres, Timestamp};

pub use enter::{Entering, enter_size, size_words};
pub use undo::put_in;

/// Runs the command.
///
/// # Errors
/// Wrong usage, unreadable input, a refused entry.
pub fn size(command: &SizeCommand, common: &Common) -> Done {
    match command {
        SizeCommand::Job(args) => job(args, common),
        SizeCommand::Enter(args) => enter::enter(args, common),
        SizeCommand::List => list::list(common),
        SizeCommand::History(args) => history::history(args, common),
        SizeCommand::Undo(args) => undo::undo(args, common),
        SizeCommand::NewTool(args) => undo::new_tool(args, common),
        SizeCommand::Generate(args) => generate::generate(args, common),
        SizeCommand::Study(args) => study::study(args, common),
    }
}

/// `toolmark size job FILE`
fn job(args: &JobArgs, common: &Common) -> Done {
    if let Some(program) = propose::step_file(&args.file)? {
        return propose::propose(&program, args, common);
    }
    if args.out.is_some() || args.number.is_some() {
        return Err(Failure::usage(format_args!(
            "--out and --number are for a job proposed from a STEP-NC file, and {} is none",
            args.file.display()
        )));
    }
    let text = std::fs::read_to_string(&args.file)
        .map_err(|e| Failure::unreadable(format_args!("{}: {e}; a sizing job (TOML) was expected", args.file.display())))?;
    let mut directory = shop::data_directory(common)?;
    let bench = Bench::load(&mut directory, &text, &args.file, common)?;
    if common.json {
        print_json(&json!({
            "job": bench.kept.id,
            "name": bench.job.name,
            "number": bench.job.number,
            "machine": bench.kept.machine,
            "dimensions": bench.job.dimensions.iter().map(list::declared).collect::<Vec<_>>(),
        }))?;
    } else {
        say(&format!(
            "job {} ({}) is in force on {}: {} dimensions",
            bench.job.name,
            bench.job.number,
            bench.kept.machine,
            bench.job.dimensions.len()
        ));
        for dimension in &bench.job.dimensions {
            say(&format!("  {}", list::declared_words(&shown_in(dimension, common))));
        }
    }
    Ok(Exit::Good)
}

/// A job in force, and everything that was entered for it.
pub struct Bench {
    /// As it is kept.
    pub kept: SizingJob,
    /// As it is meant.
    pub job: Job,
    /// Its entries, in order.
    pub history: Vec<Row>,
}

impl Bench {
    /// Puts a job in force.
    ///
    /// # Errors
    /// The job is not readable, there is no such machine, or the disk refuses.
    pub fn load(directory: &mut DataDirectory, text: &str, file: &Path, common: &Common) -> Result<Bench, Failure> {
        let unreadable = |e: Box<plan::Diagnostic>| Failure::unreadable_diagnostic(&e);
        let file = file.display().to_string();
        // Which machine decides whether X counts diameters, and what the job says decides which machine `sim` is: a cutter's radius is
        // a mill's.
        let lathe = MachineAxes {
            name: "sim-lathe".to_owned(),
            counts_diameters: [true, false, false],
        };
        let first = Job::parse(text, &file, &lathe).map_err(unreadable)?;
        let turns = first.dimensions.iter().all(|d| d.column != sizing::Column::CutterRadius);
        let machine = crate::program::machine_for(&common.machine, turns)?;
        let axes = axes_of(&machine);
        let job = Job::parse(text, &file, &axes).map_err(unreadable)?;
        for dimension in &job.dimensions {
            let inside = dimension
                .register
                .strip_prefix(&format!("{}/", machine.name))
                .unwrap_or_default();
            let there = match dimension.column {
                sizing::Column::Wear(axis) => machine.axis(axis).is_some(),
                sizing::Column::CutterRadius => true,
            };
            if store::Register::parse(inside).is_none() || !there {
                return Err(Failure::unreadable(format_args!(
                    "{file}: dimension {:?} needs {}, which {} does not have",
                    dimension.name, dimension.register, machine.name
                )));
            }
        }
        let new = SizingJob {
            id: 0,
            machine: machine.name.clone(),
            diameters: letters(&axes),
            name: job.name.clone(),
            text: text.to_owned(),
        };
        let at = clock::start_time(common.start.as_deref())?;
        let acting = Acting::of(directory, common)?;
        acting.must(Action::DeclareSizes, directory, at)?;
        let kept = directory.load_sizing_job(&new, &acting.name, at).map_err(shop::failure)?;
        Ok(Bench {
            kept,
            job,
            history: Vec::new(),
        })
    }

    /// The job in force.
    ///
    /// # Errors
    /// None was loaded, or the disk refuses.
    pub fn open(directory: &DataDirectory, common: &Common) -> Result<Bench, Failure> {
        let machine = crate::program::named_machine(&common.machine)?.map(|m| m.name);
        let kept = directory
            .sizing_job(machine.as_deref())
            .map_err(shop::failure)?
            .ok_or_else(|| {
                Failure::usage(
                    "no job of sizes is loaded here: toolmark size job FILE, and `toolmark size job --help` for what it holds",
                )
            })?;
        let axes = MachineAxes {
            name: kept.machine.clone(),
            counts_diameters: Axis::ALL.map(|a| kept.diameters.contains(a.letter())),
        };
        let job = Job::parse(&kept.text, &kept.name, &axes).map_err(|e| Failure::unreadable_diagnostic(&e))?;
        let mut bench = Bench {
            kept,
            job,
            history: Vec::new(),
        };
        bench.read_history(directory)?;
        Ok(bench)
    }

    /// Reads the entries again.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn read_history(&mut self, directory: &DataDirectory) -> Result<(), Failure> {
        let events = directory.sizes(self.kept.id).map_err(shop::failure)?;
        self.history = events.iter().filter_map(Row::from_event).collect();
        Ok(())
    }

    /// A dimension by its name.
    ///
    /// # Errors
    /// There is none of that name.
    pub fn dimension(&self, name: &str) -> Result<&Dimension, Failure> {
        self.job.dimension(name).ok_or_else(|| {
            let names: Vec<&str> = self.job.dimensions.iter().map(|d| d.name.as_str()).collect();
            Failure::usage(format_args!(
                "job {} has no dimension {name:?}; it has {}",
                self.job.name,
                names.join(", ")
            ))
        })
    }

    /// Keeps one line of the history with the change that belongs to it; the line as it stands there.
    ///
    /// # Errors
    /// The change is refused, or the disk does; nothing was written then.
    pub fn keep(&mut self, directory: &mut DataDirectory, row: &Row, change: Option<&ChangeRequest>) -> Result<Row, Failure> {
        let new = NewSize {
            job: self.kept.id,
            kind: row.what.event_kind(),
            at: Timestamp(row.at_ns),
            detail: row.detail(),
            change,
        };
        let (event, _) = directory.keep_size(&new, &mut |_| {}).map_err(shop::failure)?;
        let kept = Row::from_event(&event).expect("what was just made of a row is one");
        self.history.push(kept.clone());
        Ok(kept)
    }

    /// The last line of a kind about a dimension.
    pub fn last(&self, dimension: &str, what: What) -> Option<&Row> {
        self.history.iter().rev().find(|r| r.what == what && r.dimension == dimension)
    }
}

/// What a job has to know of a machine.
pub fn axes_of(machine: &MachineFile) -> MachineAxes {
    MachineAxes {
        name: machine.name.clone(),
        counts_diameters: Axis::ALL.map(|a| machine.counts_diameters(a)),
    }
}

fn letters(axes: &MachineAxes) -> String {
    let counts = |a: &Axis| axes.counts_diameters[a.index()];
    Axis::ALL.into_iter().filter(counts).map(Axis::letter).collect()
}

/// A unit of the command line.
pub fn unit_of(name: DisplayUnits) -> Unit {
    match name {
        DisplayUnits::Mm => Unit::Mm,
        DisplayUnits::Inch => Unit::Inch,
    }
}

/// A unit as the command line and JSON call it.
pub fn unit_name(unit: Unit) -> &'static str {
    match unit {
        Unit::Mm => "mm",
        Unit::Inch => "inch",
    }
}

/// A length in a unit, for JSON.
pub fn number_in(unit: Unit, mm: f64) -> f64 {
    sizing::generate::in_unit(unit, Millimetres(mm))
}

/// The same dimension, told in the unit of `--units`.
pub fn shown_in(dimension: &Dimension, common: &Common) -> Dimension {
    Dimension {
        unit: common.units.map_or(dimension.unit, unit_of),
        ..dimension.clone()
    }
}
