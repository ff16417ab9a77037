//! The command line of `toolmark size`.

use crate::cli::DisplayUnits;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

/// `toolmark size ...`
#[derive(Debug, Subcommand)]
pub enum SizeCommand {
    /// Load the sizes of a job; the last one loaded for a machine is in force.
    Job(JobArgs),
    /// Enter a measured size: the offset that makes it is corrected once.
    Enter(EnterArgs),
    /// The sizes of the job in force: offset, last size, trend, parts until a limit.
    List,
    /// Who entered what, when and why, and what it changed.
    History(HistoryArgs),
    /// Take an entry back, as long as no part was cut with it.
    Undo(UndoArgs),
    /// A new tool or insert came in: its wear begins at 0, and so does the trend.
    NewTool(NewToolArgs),
    /// Macro programs of the job for a real control, proven by simulation before they are written.
    Generate(GenerateArgs),
    /// A hundred parts on the simulated lathe, with and without sizing: a report with the plot.
    Study(StudyArgs),
}

/// `toolmark size job`
#[derive(Debug, Args)]
pub struct JobArgs {
    /// The job file (TOML), or a STEP-NC file: then a job file is proposed from its dimensions and tolerances.
    pub file: PathBuf,
    /// Where the proposed job file goes [default: standard output].
    #[arg(long, value_name = "JOB.toml")]
    pub out: Option<PathBuf>,
    /// Number of the set-up program of the proposed job.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=7999))]
    pub number: Option<u32>,
}

/// `toolmark size enter`
#[derive(Debug, Args)]
pub struct EnterArgs {
    /// What the gauge shows.
    #[arg(allow_hyphen_values = true)]
    pub value: String,
    /// Which dimension.
    #[arg(long, value_name = "NAME")]
    pub dimension: String,
    /// The unit of VALUE [default: the job's].
    #[arg(long, value_enum)]
    pub unit: Option<DisplayUnits>,
    /// Number of the measured part [default: the one that is due].
    #[arg(long, value_name = "N")]
    pub part: Option<u64>,
    /// What the person saw in the offset, in the unit of VALUE: the entry is refused when it is not that any more.
    #[arg(long, value_name = "OFFSET", allow_hyphen_values = true)]
    pub seen: Option<String>,
    /// What the control shows in the offset, in the unit of VALUE: when that is not what the log says, somebody entered it there, and it
    /// is recorded so.
    #[arg(long, value_name = "OFFSET", allow_hyphen_values = true)]
    pub at_control: Option<String>,
    /// The level with which the entry is made, at most the person's own [default: 5, or the person's own where that is weaker]. Level 3
    /// and better may exceed the largest single step, on purpose: without this a slip of the finger stays within it, whoever enters.
    #[arg(long, value_name = "LEVEL", value_parser = clap::value_parser!(u8).range(1..=10))]
    pub level: Option<u8>,
}

/// `toolmark size history`
#[derive(Debug, Args)]
pub struct HistoryArgs {
    /// Only this dimension.
    #[arg(long, value_name = "NAME")]
    pub dimension: Option<String>,
}

/// `toolmark size undo`
#[derive(Debug, Args)]
pub struct UndoArgs {
    /// Number of the entry, as `size history` shows it.
    pub entry: u64,
    /// The tool has cut since: answer the entry by its opposite, on top of what came after.
    #[arg(long)]
    pub opposite: bool,
}

/// `toolmark size new-tool`
#[derive(Debug, Args)]
pub struct NewToolArgs {
    /// Number of the offset.
    #[arg(long, value_name = "N")]
    pub offset: u32,
}

/// How sizes get to the offsets on a control.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Named variables, and a macro that every T word calls.
    TWord,
    /// Calls before the turret indexes of a program; sizes are typed into a secondary offset.
    G65,
}

/// `toolmark size generate`
#[derive(Debug, Args)]
pub struct GenerateArgs {
    /// The control: fanuc-lathe, fanuc-lathe-base, fanuc-30i-lathe, fanuc-mill, fanuc-mill-a (offset memories A and B),
    /// fanuc-mill-series-15, fanuc-30i-mill, or a profile of your own (TOML).
    #[arg(long, value_name = "PROFILE")]
    pub control: String,
    /// Where the programs and their proof go.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How sizes get to the offsets.
    #[arg(long, value_enum, default_value_t = MethodName::TWord)]
    pub method: MethodName,
    /// The part program: a copy with what it needs is written too.
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
    /// The set-up program is called by another one and ends with M99; else it is run by hand and ends with M30.
    #[arg(long)]
    pub called: bool,
    /// How many entries the proof tries, at least.
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u32).range(10_000..))]
    pub entries: u32,
}

/// `toolmark size study`
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// Where study.html and study.json go.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// How many seeds, from --seed on.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    pub seeds: u32,
    /// How many parts.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    pub parts: u32,
}
