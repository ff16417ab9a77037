//! The command line: what can be asked, in the words of the manual.

pub use crate::commands::machine::MachineCommand;
pub use crate::commands::offset::OffsetCommand;
pub use crate::commands::operator::OperatorCommand;
pub use crate::commands::size::args::SizeCommand;
pub use crate::commands::tool::ToolCommand;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// The digital thread of a CNC machine: plan a program, run it, record what happened, and hold the run against the plan.
#[derive(Debug, Parser)]
#[command(name = "toolmark", version, arg_required_else_help = true, max_term_width = 110, after_help = EXIT_CODES)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Settings that every command knows.
    #[command(flatten)]
    pub common: Common,
}

const EXIT_CODES: &str = "\
Exit codes: 0 done and good; 1 done, the verdict is negative (check failed, alarm, out of tolerance); 2 wrong usage;
3 the input cannot be read; 4 machine, network or lock; 70 a fault of ours.
Start here: toolmark demo";

/// Settings that every command knows.
#[derive(Clone, Debug, Args)]
pub struct Common {
    /// Print one JSON object on stdout instead of text.
    #[arg(long, global = true)]
    pub json: bool,
    /// Data directory [default: $TOOLMARK_DATA, else $XDG_DATA_HOME/toolmark, else ~/.local/share/toolmark].
    #[arg(long, global = true, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// The machine: sim (mill, or lathe when the program turns), sim-mill, sim-lathe, a machine file, or tcp://HOST:PORT of a toolmark
    /// controller (run, live, trace actions, trace end). Without it, machine.toml of the data directory where there is one.
    #[arg(long, global = true, value_name = "M", default_value = "sim")]
    pub machine: String,
    /// Seed of everything random in a simulation; the same seed and start give the same bytes.
    #[arg(long, global = true, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Start time of a run, RFC 3339 [default: now].
    #[arg(long, global = true, value_name = "TIME")]
    pub start: Option<String>,
    /// Who stands behind a change: an operator of the data directory [default: the system's user].
    #[arg(long, global = true, value_name = "NAME")]
    pub operator: Option<String>,
    /// Why.
    #[arg(long, global = true, value_name = "TEXT")]
    pub reason: Option<String>,
    /// Units of printed lengths [default: mm; for sizes the job's]; files and JSON stay in mm.
    #[arg(long, global = true, value_enum)]
    pub units: Option<DisplayUnits>,
    /// The control a G-code program is written for [default: found out, with the reason].
    #[arg(long, global = true, value_name = "NAME")]
    pub dialect: Option<String>,
}

/// Units of printed lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum DisplayUnits {
    /// Millimetres.
    #[default]
    Mm,
    /// Inches.
    Inch,
}

/// What can be asked.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// The whole story on the simulated machine: a part is made with a planted fault, the report finds it, a measured size corrects
    /// a tool offset and the next part is better.
    Demo(DemoArgs),
    /// Check, plan and execute a program, record every cycle, rebuild what happened and report the deviation.
    #[command(after_help = RUN_HELP)]
    Run(RunArgs),
    /// Pre-run checks of a program, one line each with the number that decided.
    Check(ProgramArgs),
    /// The tree of a STEP-NC or G-code file; --json gives it whole.
    Inspect(InspectArgs),
    /// Write a G-code program or a cutter-location file (APT, as NX writes it) as a new STEP-NC file, AP238 edition 3.
    #[command(after_help = CONVERT_HELP)]
    Convert(ConvertArgs),
    /// Change single things of a STEP-NC file and leave every other byte of it as it is.
    #[command(after_help = EDIT_HELP)]
    Edit(EditArgs),
    /// Work with macro programs.
    #[command(subcommand)]
    Macro(MacroCommand),
    /// Plan a program's motion and write the set-points, 1 ms apart.
    Plan(PlanArgs),
    /// Write a program for a control: motion, tools, technology, branches and the traceability functions, each function with a grade.
    #[command(after_help = POST_HELP)]
    Post(PostArgs),
    /// Record what an MTConnect agent tells: its buffer first, then live, through cuts and restarts of the agent. Ctrl-C ends it. What
    /// could not be had is a gap with its sequence numbers.
    #[command(after_help = RECORD_HELP)]
    Record(RecordArgs),
    /// Rebuild what happened from a record: cut it into the plan's workingsteps and write an as-executed STEP-NC file.
    #[command(
        override_usage = "toolmark rebuild <PLAN> <RECORD> --out <F.stpnc>\n       toolmark rebuild --no-plan <RECORD> --out <F.stpnc>"
    )]
    Rebuild(RebuildArgs),
    /// Hold an as-executed STEP-NC file against its plan; one file may hold both.
    Compare(CompareArgs),
    /// Look into what was recorded: list jobs, show one, export its samples and events, verify that nothing was changed; list and end the
    /// synchronized actions that live in a controller.
    Trace(TraceArgs),
    /// Copy the whole data directory, or bring a copy up to date: records, programs, reports, events, with a manifest of hashes.
    #[command(after_help = BACKUP_HELP)]
    Backup(BackupArgs),
    /// Bring a backup back into an empty data directory, checked before and after.
    #[command(after_help = RESTORE_HELP)]
    Restore(RestoreArgs),
    /// The machine side of the set-point link, a process of its own: toolmark run --machine tcp://HOST:PORT drives it. Ctrl-C stops the
    /// machine on its path and ends.
    #[command(after_help = CONTROLLER_HELP)]
    Controller(ControllerArgs),
    /// A job from a CAM add-in, one operation at a time over a socket, cut while more is coming; no file passes between.
    #[command(after_help = LIVE_HELP)]
    Live(LiveArgs),
    /// Keep a job's records whatever their age, or release them again; who and why is recorded.
    #[command(override_usage = "toolmark hold <JOB> --reason <TEXT>\n       toolmark hold <JOB> --release --reason <TEXT>")]
    Hold(HoldArgs),
    /// A measured size becomes one offset change: jobs of sizes, entries, history, undo, macro programs for a control.
    #[command(subcommand)]
    Size(SizeCommand),
    /// Who works here, with which level: make, change and list operators. Level 1 is the highest, 10 the lowest.
    #[command(subcommand, after_help = OPERATOR_HELP)]
    Operator(OperatorCommand),
    /// The tools of a machine as they are now, and changes of them.
    #[command(subcommand)]
    Tool(ToolCommand),
    /// The work offsets of a machine as they are now, and changes of them.
    #[command(subcommand)]
    Offset(OffsetCommand),
    /// Make a machine file; show what a machine comes to, value by value.
    #[command(subcommand)]
    Machine(MachineCommand),
}

const CONTROLLER_HELP: &str = "\
One realtime thread wakes up each millisecond. With SCHED_FIFO, locked memory and a processor of its own it is punctual; what the system
refuses of it is said at the start, and how late it was at the end.
On an address that other computers reach, both sides prove who they are: certificate, key and authority in [link] of the machine file.
  toolmark controller --machine mill-3.toml          then, elsewhere: toolmark run part.stpnc --machine tcp://127.0.0.1:7450";

/// `toolmark controller`
#[derive(Debug, Args)]
pub struct ControllerArgs {
    /// Port; 0 is any free one, and the first line says which [default: the machine file's, else 7450].
    #[arg(long, value_name = "N")]
    pub port: Option<u16>,
    /// Address to listen on. Any but this computer's own needs certificates.
    #[arg(long, value_name = "IP", default_value = "127.0.0.1")]
    pub listen: std::net::IpAddr,
    /// What is spoken: the default link, or the published text protocol.
    #[arg(long, value_enum, default_value_t = LinkName::Default)]
    pub link: LinkName,
    /// Text protocol: port of the driving side that the controller's reports go to [default: the machine file's, else 7451].
    #[arg(long, value_name = "N")]
    pub report_port: Option<u16>,
    /// Text protocol: keep a record of each time from M1 to M0 here; toolmark rebuild holds it against its plan.
    #[arg(long, value_name = "DIR")]
    pub record: Option<PathBuf>,
    /// A gamepad as control pad: its device, /dev/input/event...
    #[arg(long, value_name = "DEVICE")]
    pub pad: Option<PathBuf>,
    /// End as with Ctrl-C when standard input ends: with the program that started this one, however that ends.
    #[arg(long)]
    pub until_stdin_ends: bool,
}

/// What is spoken between a planner and a machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum LinkName {
    /// Checked, resumable, with every sample coming back.
    #[default]
    Default,
    /// The published protocol of lines.
    Text,
}

const LIVE_HELP: &str = "\
Each line is one JSON object: connect, operation, start, hold, resume, stop, end; docs/live-job.md tells all of it. Afterwards the job is as
one from a file: plan.stpnc, as-executed.stpnc, report and record.
  toolmark live --machine tcp://127.0.0.1:7450
  echo '{\"connect\":{\"client\":\"me\",\"job\":\"plate\"}}' | nc 127.0.0.1 7460";

/// `toolmark live`
#[derive(Debug, Args)]
pub struct LiveArgs {
    /// Where the add-in connects to, on this computer; port 0 is any free one, and the first line says which.
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:7460")]
    pub listen: std::net::SocketAddr,
    /// Also put the results here [default: the job's folder in the data directory].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Verdict: deviation allowed where an operation gives none, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
    /// The file of a machine behind tcp:// [default: machine.toml of the data directory, else the simulated machine].
    #[arg(long, value_name = "F.toml")]
    pub machine_file: Option<PathBuf>,
    /// With tcp://: where the machine does not know where its axes are, it looks for its references first. It moves: look at it before.
    #[arg(long)]
    pub home: bool,
}
const OPERATOR_HELP: &str = "\
Until the first operator is made, whoever sits here acts as `local`, level 1. From then on a change needs an operator: --operator NAME, or
an operator with the name of the system's user. Who is neither is not signed in: look, STOP and feed hold only. Only levels 1 and 2 give
levels, and never one beyond their own. A lapsed qualification counts as level 10. `toolmark operator rights` shows what each level may.
A refusal is exit 1 and stands in the log; a name that is no operator's is exit 2.
  toolmark operator add Maria --experience '12 years, 5 axes'
  toolmark operator add Jo --level 6 --qualified-until 2027-06-30 --operator Maria --reason 'passed the test'";

/// `toolmark hold`
#[derive(Debug, Args)]
pub struct HoldArgs {
    /// The number of the job, or `last`.
    pub job: String,
    /// Release it.
    #[arg(long)]
    pub release: bool,
}

const BACKUP_HELP: &str = "\
The copy is whole when backup.json is in it, which is written last; killed before, it says so and the same command makes it whole.
Run again, only new and changed files are written. A file that was damaged since keeps its good copy, and that is exit 1.
  toolmark backup /media/disk/mill-3            then look into it: toolmark trace list /media/disk/mill-3";

const RESTORE_HELP: &str = "\
Every file of the backup is checked against its manifest first; when one is missing or changed, nothing is written and it is named.
  toolmark restore /media/disk/mill-3 --data DIR      DIR is empty or not there; nothing is ever written over";

/// `toolmark backup`
#[derive(Debug, Args)]
pub struct BackupArgs {
    /// An empty or new folder, or the backup to bring up to date; best on another disk.
    pub dest: PathBuf,
}

/// `toolmark restore`
#[derive(Debug, Args)]
pub struct RestoreArgs {
    /// The folder that `toolmark backup` wrote.
    pub source: PathBuf,
}

/// `toolmark trace`
#[derive(Debug, Args)]
pub struct TraceArgs {
    /// What to do with what was recorded.
    #[command(subcommand)]
    pub what: TraceCommand,
}

const WHERE: &str = "\
DIR is a data directory or a backup of one [default: --data, $TOOLMARK_DATA ...]. Nothing in it is changed.";

const ACTIONS_HELP: &str = "\
DIR is a data directory or a backup of one [default: --data, $TOOLMARK_DATA ...]. Nothing in it is changed.
An action in AUTOMATIC ends with its program. One in ALL MODES (its_mode_scope=ALL) goes on in the controller when program and run
are over, through reset and emergency stop, until a program stops it, an operator ends it, or the machine's power goes off. On a simulated
machine of `toolmark run` it ends with the run. The list of a controller says since when each lives, how often it has fired, and whose run
started it; somebody else may drive the machine meanwhile.
  toolmark trace actions --machine tcp://127.0.0.1:7450
  toolmark trace end 3 --machine tcp://127.0.0.1:7450 --operator NAME --reason TEXT";

const END_HELP: &str = "\
Who may is decided by the operators of the data directory (level 4 or stronger); a refusal is exit 1, and a refusal and an end are
events of its log. A run that is under way and has started the action records that it was ended by hand. A run works in its data directory
alone: while it does, an end comes from another data directory and its operators, or waits (exit 4).
  toolmark trace actions --machine tcp://127.0.0.1:7450
  toolmark trace end 3 --machine tcp://127.0.0.1:7450 --operator NAME --reason TEXT
  toolmark trace end all --machine tcp://127.0.0.1:7450";

const EXPORT_HELP: &str = "\
By its ending F is
  .csv      one line a sample, the unit in the header, numbers that read back to the same double; events in F.events.csv
  .jsonl    one object a line: the record's head, then samples and events in the order of their time
  .json     the same objects as one array
  .parquet  without a choice of time or channels the record itself, byte for byte; else a record of the part, with its origin's hash
  .mf4      ASAM MDF 4 for measurement programs; events in F.events.csv
DIR is a data directory or a backup of one [default: --data, $TOOLMARK_DATA ...]. Nothing in it is changed.
  toolmark trace export last --out load.csv --channels 'X.LOAD,Z.*' --from 12.5 --to 20";

/// What to do with what was recorded.
#[derive(Debug, Subcommand)]
pub enum TraceCommand {
    /// Jobs and their recordings: program, machine, start, duration, rows, how they ended, verdict, gaps.
    #[command(after_help = WHERE)]
    List {
        /// Data directory or backup.
        dir: Option<PathBuf>,
    },
    /// One job: its recordings, events, gaps, and statistics of each channel, whole and by workingstep.
    #[command(after_help = WHERE)]
    Show {
        /// The number of the job, or `last`.
        job: String,
        /// Data directory or backup.
        dir: Option<PathBuf>,
        /// Also every event; without it the last twenty.
        #[arg(long)]
        events: bool,
    },
    /// The synchronized actions of a job: what they watch, how often they fired, what ended them. With --machine tcp://HOST:PORT those that
    /// live in a controller now.
    #[command(
        after_help = ACTIONS_HELP,
        override_usage = "toolmark trace actions <JOB> [DIR]\n       toolmark trace actions --machine <tcp://HOST:PORT>"
    )]
    Actions {
        /// The number of the job, or `last`.
        job: Option<String>,
        /// Data directory or backup.
        dir: Option<PathBuf>,
        /// The file of a machine behind tcp:// [default: machine.toml of the data directory]; its link table names the certificates.
        #[arg(long, value_name = "F")]
        machine_file: Option<PathBuf>,
    },
    /// End a synchronized action in all modes that lives in a controller, by its number on the list; it takes level 4.
    #[command(after_help = END_HELP)]
    End {
        /// The number in `trace actions --machine`, or `all`.
        #[arg(value_name = "NUMBER|all")]
        which: String,
        /// The file of a machine behind tcp:// [default: machine.toml of the data directory]; its link table names the certificates.
        #[arg(long, value_name = "F")]
        machine_file: Option<PathBuf>,
    },
    /// Write a job's samples and events to a file: CSV, JSON, Parquet or MDF 4.
    #[command(after_help = EXPORT_HELP)]
    Export {
        /// The number of the job, or `last`.
        job: String,
        /// Data directory or backup.
        dir: Option<PathBuf>,
        /// Where to: .csv, .json, .jsonl, .parquet or .mf4.
        #[arg(long, value_name = "F")]
        out: PathBuf,
        /// From this time on: seconds since the job's start, or RFC 3339.
        #[arg(long, value_name = "TIME", allow_negative_numbers = true)]
        from: Option<String>,
        /// Before this time.
        #[arg(long, value_name = "TIME", allow_negative_numbers = true)]
        to: Option<String>,
        /// Only these channels, by name or beginning: X.LOAD,Z.*
        #[arg(long, value_name = "NAMES", value_delimiter = ',')]
        channels: Vec<String>,
    },
    /// Check every row and every file against the log: nothing was changed, or what was, by name. Exit 1 when something was.
    #[command(after_help = WHERE)]
    Verify {
        /// Data directory or backup.
        dir: Option<PathBuf>,
    },
}

/// `toolmark demo`
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Keep the files here instead of in a fresh temporary folder.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `toolmark macro`
#[derive(Debug, Subcommand)]
pub enum MacroCommand {
    /// Interpret a G-code program without a machine: alarm, variables, path, printed lines, names, stops, tool.
    Run(MacroRunArgs),
}

/// `toolmark macro run`
#[derive(Debug, Args)]
pub struct MacroRunArgs {
    /// G-code.
    pub program: PathBuf,
    /// What it is started with, as JSON: {"machine":"lathe","units":"inch","params":{"6001.5":1},"vars":{"2005":0.001}}.
    #[arg(long, value_name = "S.json")]
    pub setup: Option<PathBuf>,
    /// Blocks in a row without a move after which the program counts as endless [default: 100000000].
    #[arg(long, value_name = "N")]
    pub most_blocks: Option<u64>,
}

/// A program.
#[derive(Debug, Args)]
pub struct ProgramArgs {
    /// STEP-NC (.stpnc, .stp, .p21) or G-code.
    pub program: PathBuf,
}

/// `toolmark inspect`
#[derive(Debug, Args)]
pub struct InspectArgs {
    /// STEP-NC (.stpnc, .stp, .p21) or G-code.
    pub program: PathBuf,
    /// Only this part of the tree: `#id`, or names joined by `/`; `[n]` picks the n-th of equals.
    #[arg(long, value_name = "PATH")]
    pub select: Option<String>,
    /// Only what is wrong or odd in the file.
    #[arg(long)]
    pub problems: bool,
}

const CONVERT_HELP: &str = "\
Each tool, and each operation that the program names, becomes a workingstep; arcs stay arcs, cycles are told move by move, a work offset
becomes a set-up, stops and messages become NC functions. The plan of the new file is the plan of the program.
  toolmark convert plate.nc --out plate.stpnc
  toolmark convert block.cls --out block.stpnc --machine mill-3.toml";

/// `toolmark convert`
#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// G-code, or a cutter-location file (.cls, .cl, .apt, .aptsource).
    pub program: PathBuf,
    /// The STEP-NC file to write.
    #[arg(long, value_name = "F.stpnc")]
    pub out: PathBuf,
    /// Name of the project [default: the program's file name].
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Write functions as the AIM's local rules have them, 'legacy function', and not as the mapping table, which toolkits follow.
    #[arg(long)]
    pub aim_strict: bool,
}

const EDIT_HELP: &str = "\
P is #id, or names joined by / that end at the part: 'WS 1 face', 'PLATE MAIN/WS 1 face/face pass 1'. In a name \\/ is a slash; [2]
picks the second of equals. When a path could mean several parts, they are listed and nothing is written (exit 2).
Changes are made in the order in which they are given. No change gives the same bytes; a change and its opposite give them back. A
signed file that is changed loses its signature, and that is said. What others still use stays when a part is deleted.
Each part has an edit access level: of `trace:1 set_edit_access_level` before it, or of its security classification, the stronger one;
else 10. An operator edits parts of that number and higher ones, and gives, lowers or takes away no level stronger than the own one; else
it is T-11, exit 1, and nothing is written. Every edit is an event with both hashes. Where there are operators it needs --reason.
  toolmark edit plate.stpnc --out plate2.stpnc --disable 'WS 4 deburr' --feed 'WS 2 pocket=900'
  toolmark edit plate.stpnc --out plate2.stpnc --insert 'WS 1 face' 'trace:1 get_time' --move 'WS 3 drill=WS 2 pocket'
  toolmark edit plate.stpnc --out plate2.stpnc --insert 'WS 1 face' 'workplan: HOLES' --move 'WS 3 drill=HOLES/'";

/// `toolmark edit`
#[derive(Debug, Args)]
pub struct EditArgs {
    /// The STEP-NC file.
    pub program: PathBuf,
    /// Where the changed file goes.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Let it be executed.
    #[arg(long, value_name = "P")]
    pub enable: Vec<String>,
    /// Let it not be executed, nor anything below it.
    #[arg(long, value_name = "P")]
    pub disable: Vec<String>,
    /// Feed of a toolpath, or of all feed paths of a workingstep (their own multipliers still count), mm/min.
    #[arg(long, value_name = "P=MM_MIN")]
    pub feed: Vec<String>,
    /// Put an NC function before it: the text of an extended function, or `message: TEXT`, `program stop`, `optional stop`; or an empty
    /// workplan, `workplan: NAME`. `P/` is the end of a workplan.
    #[arg(long, value_names = ["P", "TEXT"], num_args = 2)]
    pub insert: Vec<String>,
    /// Take it out, with what only it used.
    #[arg(long, value_name = "P")]
    pub delete: Vec<String>,
    /// Put the first before the second; `P=Q/` puts it at the end of workplan or workingstep Q.
    #[arg(long = "move", value_name = "P=P")]
    pub moves: Vec<String>,
    /// Another name.
    #[arg(long, value_name = "P=NAME")]
    pub rename: Vec<String>,
    /// Write functions as the AIM's local rules have them, 'legacy function', and not as the mapping table, which toolkits follow.
    #[arg(long)]
    pub aim_strict: bool,
}

/// `toolmark plan`
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// STEP-NC or G-code.
    pub program: PathBuf,
    /// Where the set-points go, by ending: .csv or .parquet.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Limits as JSON: {"v_max_mm_s":500,"a_max_mm_s2":3000,"j_max_mm_s3":50000,"tolerance_mm":0.01}, one number or one per axis.
    #[arg(long, value_name = "L.json")]
    pub limits: Option<PathBuf>,
    /// Frame of the written positions.
    #[arg(long, value_enum, default_value_t = FrameName::Setup)]
    pub frame: FrameName,
}

/// A frame of reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FrameName {
    /// What the program is written in.
    Setup,
    /// Home is 0.
    Machine,
}

/// What happens with a program that was edited outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolicyName {
    /// It is said and recorded, and the program runs.
    Warn,
    /// It is said and recorded, and nothing moves.
    Refuse,
}

impl From<PolicyName> for store::machine_file::EditedOutside {
    fn from(name: PolicyName) -> Self {
        match name {
            PolicyName::Warn => Self::Warn,
            PolicyName::Refuse => Self::Refuse,
        }
    }
}

const POST_HELP: &str = "\
Controls: siemens-840d, fanuc, heidenhain, haas, linuxcnc. Grades of functions: native (the control does it by itself), block-boundary
(by statements between blocks), external (a recorder beside the control), refused (with the reason). What no manual was at hand for is
marked: verify at commissioning. Exit 1 when a function is refused; the program is written all the same and says so in its head.
Conditions of STEP-NC are kept. What a macro of G-code would decide at the machine is refused, or taken as it comes without a machine
with --as-interpreted.
  toolmark post plate.stpnc --control siemens-840d --out plate.mpf";

/// `toolmark post`
#[derive(Debug, Args)]
pub struct PostArgs {
    /// STEP-NC, G-code or a cutter-location file.
    pub program: PathBuf,
    /// The control it is written for.
    #[arg(long, value_name = "NAME")]
    pub control: String,
    /// Where to [default: stdout; the table goes to stderr then].
    #[arg(long, value_name = "F")]
    pub out: Option<PathBuf>,
    /// Number of the program, where programs have numbers [default: the one in its name, else 1000].
    #[arg(long, value_name = "N")]
    pub number: Option<u32>,
    /// Splines, and arcs that the control has no words for, become chords within so many mm.
    #[arg(long, value_name = "MM", default_value_t = 0.005)]
    pub chord: f64,
    /// Conditions that a control can only check between blocks are checked every so many moves.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    pub check_every: u32,
    /// Take branches of macros, values of the machine and radius 0 in cutter compensation as they come without a machine.
    #[arg(long)]
    pub as_interpreted: bool,
}

const RUN_HELP: &str = "\
--from takes a workingstep by name ('WS 2 pocket', 'MAIN/WS 2 pocket'), number (2) or instance (#255), or a block of text (N120, line:57);
'...[2]' picks the second of several. It needs level 5. The tool goes away from the part; tool, set-up, offset, spindle, coolant and what
functions had begun come back in that order; then across, straight down to 2 mm above the path, and onto it at 10 mm/s. Look that this way
is free. --resume does the same for a job that was interrupted or stopped, at the step it was on.
--overrides F has a line for each moment: seconds, then feed=PERCENT, rapid=PERCENT, spindle=PERCENT, hold or resume.
  toolmark run plate.nc --from N200
  toolmark run plate.nc --machine tcp://127.0.0.1:7450 --resume last";

/// `toolmark run`
#[derive(Debug, Args)]
pub struct RunArgs {
    /// STEP-NC or G-code.
    pub program: PathBuf,
    /// As fast as the computer can instead of in real time; simulated machines only.
    #[arg(long)]
    pub fast: bool,
    /// Also put the results here [default: the job's folder in the data directory].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Take the program up here instead of at its beginning: a workingstep, a block (N120) or a line (line:57).
    #[arg(long, value_name = "STEP")]
    pub from: Option<String>,
    /// Take up the run of this job, by its number or `last`, at the step it was on when it was interrupted.
    #[arg(long, value_name = "JOB", conflicts_with = "from")]
    pub resume: Option<String>,
    /// With tcp://: where the machine does not know where its axes are, it looks for its references first. It moves: look at it before.
    #[arg(long)]
    pub home: bool,
    /// With tcp://: after a cut the machine may be led straight back to its path at 10 mm/s from so far away, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub approach: Option<f64>,
    /// Feed override for the whole run, 0 to 200 percent.
    #[arg(long, value_name = "PCT", allow_negative_numbers = true)]
    pub feed_override: Option<String>,
    /// Rapid override for the whole run, 0 to 100 percent.
    #[arg(long, value_name = "PCT", allow_negative_numbers = true)]
    pub rapid_override: Option<String>,
    /// Spindle override for the whole run, 50 to 150 percent.
    #[arg(long, value_name = "PCT", allow_negative_numbers = true)]
    pub spindle_override: Option<String>,
    /// Overrides, holds and resumes at moments of the run; simulated machines of this process only.
    #[arg(long, value_name = "F")]
    pub overrides: Option<PathBuf>,
    /// Rebuild from the record thinned as an MTConnect agent would give it: one position every MS milliseconds, times off by up to
    /// JITTER milliseconds.
    #[arg(long, value_name = "MS[,JITTER]")]
    pub as_mtconnect: Option<String>,
    /// Verdict: deviation allowed where the program gives none, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
    /// The file of a machine behind tcp:// [default: machine.toml of the data directory, else the simulated machine].
    #[arg(long, value_name = "F.toml")]
    pub machine_file: Option<PathBuf>,
    /// With tcp://: what is spoken, the default link or the published text protocol.
    #[arg(long, value_enum, default_value_t = LinkName::Default)]
    pub link: LinkName,
    /// Text protocol: port on which the controller's reports are listened for [default: the machine file's, else 7451].
    #[arg(long, value_name = "N")]
    pub report_port: Option<u16>,
    /// A program that was edited outside since its last edit or run here: warn, or refuse it [default: the machine file's, else warn].
    /// Against a machine file that refuses, `warn` takes level 3 and --reason.
    #[arg(long, value_name = "POLICY", value_enum)]
    pub edited_outside: Option<PolicyName>,
    /// Wrong set-up, for practice: the n-th workingstep runs with its work offset shifted by X,Y,Z mm; simulated machines only.
    #[arg(long, value_name = "N:X,Y,Z", conflicts_with_all = ["from", "resume"])]
    pub plant_shift: Option<String>,
}

const RECORD_HELP: &str = "\
Without --out every observation goes into the data directory: a job with files of a million rows below records/<device>/<day>/, each in
the catalogue as soon as it is full. Killed at any moment, the next command that works there keeps what was on disk, and recording the
same agent again goes on where it was, as the next job. While it runs it holds the data directory.
  toolmark record http://mill-3:5000                      then: toolmark trace list, toolmark rebuild --no-plan last --out run.stpnc
  toolmark record http://mill-3:5000 --out run.parquet    one file, without a data directory";

/// `toolmark record`
#[derive(Debug, Args)]
pub struct RecordArgs {
    /// The agent: http://HOST:PORT, with /DEVICE behind it for one device; a whole sample query works too.
    pub url: String,
    /// Where to, by ending: .txt one position a line, .parquet every observation. A .txt that is there already is continued, and so is
    /// a .parquet whose recorder was killed [default: every observation into the data directory].
    #[arg(long, value_name = "F")]
    pub out: Option<PathBuf>,
    /// Rows of one file in the data directory.
    #[arg(long, value_name = "N", default_value_t = 1_000_000, value_parser = clap::value_parser!(u64).range(1..))]
    pub file_rows: u64,
    /// Which data items, as the agent understands it: `//DataItem[@type="PATH_POSITION"]` [default: all].
    #[arg(long, value_name = "XPATH")]
    pub path: Option<String>,
    /// Least time between two answers of the agent, ms [default: 100].
    #[arg(long, value_name = "MS")]
    pub interval: Option<u64>,
    /// Most observations in one answer [default: 5000].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// First sequence number [default: the oldest in the agent's buffer]; where a recording goes on, it goes on where it was.
    #[arg(long, value_name = "SEQ")]
    pub from: Option<u64>,
    /// End after so many seconds [default: Ctrl-C ends it].
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Longest silence of the agent, ms; two of them and the connection counts as cut [default: 10000].
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..))]
    pub heartbeat: Option<u64>,
}

/// `toolmark rebuild`
#[derive(Debug, Args)]
pub struct RebuildArgs {
    /// The plan and the record; with --no-plan the record alone. A record is a file, or a job of the data directory by its number, or
    /// `last`.
    #[arg(required = true, num_args = 1..=2, value_names = ["PLAN", "RECORD"])]
    pub files: Vec<PathBuf>,
    /// There is no plan: tell feed from rapid by the record's own speeds.
    #[arg(long)]
    pub no_plan: bool,
    /// The STEP-NC file to write.
    #[arg(long, value_name = "F.stpnc")]
    pub out: PathBuf,
    /// Name of the as-executed project.
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Where the run goes in the plan's file.
    #[arg(long = "as", value_enum, default_value_t = PlacementName::Project)]
    pub placement: PlacementName,
    /// Verdict: deviation allowed where the program gives none, mm; makes a bad verdict exit 1.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
    /// Also write report.html and report.json here.
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Frame of the record's positions [default: the record's own word, else estimated].
    #[arg(long, value_enum)]
    pub frame: Option<FrameName>,
    /// The device whose positions count, when the record holds several.
    #[arg(long, value_name = "NAME")]
    pub device: Option<String>,
}

/// Where a run goes in the plan's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PlacementName {
    /// A project of its own beside the plan.
    Project,
    /// A disabled workplan at the end of the plan's main workplan.
    Workplan,
    /// A file of its own that points at the anchors of the plan's file (Part 21 edition 3).
    External,
}

/// `toolmark compare`
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The plan.
    pub plan: PathBuf,
    /// The file with the run; the plan's own when it holds both.
    pub as_executed: Option<PathBuf>,
    /// Which run, counted from 1 [default: the last].
    #[arg(long, value_name = "N")]
    pub run: Option<usize>,
    /// Verdict: deviation allowed where the program gives none, mm; makes a bad verdict exit 1.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub tolerance: Option<f64>,
}
