//! A program looked through before it is run: everything that planning it tells, without moving anything.

use crate::progress::Progress;
use machine::{Command, MachineParameters, SpindleCommand};
use motion::{Limits, Output, RemainingTime, Statistics, Trajectory};
use plan::{Alarm, Answer, Diagnostic, ProgramStream, Question, StepKind, Tables};
use std::collections::BTreeMap;
use units::{Millimetres, Seconds, TICK, ToolNumber};

/// What a look through a program gives.
pub struct Survey {
    /// Lowest and highest gauge-point position of each axis, machine frame, mm; `None` when nothing moves.
    pub reach: Option<([f64; 3], [f64; 3])>,
    /// What the planner counted.
    pub statistics: Statistics,
    /// Why the program cannot be run to its end, if so.
    pub alarm: Option<Alarm>,
    /// What the reader found wrong, odd or assumed.
    pub remarks: Vec<Diagnostic>,
    /// Tools called, with the name the program gives them.
    pub tools: BTreeMap<ToolNumber, String>,
    /// Set-ups used, and whether their place was assumed.
    pub frames: Vec<(String, bool)>,
    /// Offsets that were assumed to be zero.
    pub assumed_offsets: Vec<u32>,
    /// Workingsteps begun.
    pub workingsteps: u32,
    /// How long it takes from each place on: motion, dwells, and what tool changes and the spindle take.
    pub remaining: RemainingTime,
}

/// What takes time on a machine beside motion and dwells.
struct Waits<'m> {
    machine: &'m MachineParameters,
    tool: ToolNumber,
    /// Speed that the spindle was told, rev/min.
    spindle: f64,
}

impl Waits<'_> {
    /// The time of a command as a dwell.
    fn of(&mut self, command: &Command) -> Option<Command> {
        let (seconds, step) = match command {
            Command::Tool { tool, step } if *tool != self.tool => {
                self.tool = *tool;
                // A spindle that turned comes back before the program goes on.
                let again = if self.machine.tool_change_stops_spindle {
                    self.time_from_rest(self.spindle)
                } else {
                    0.0
                };
                (self.machine.tool_change.0 + again, *step)
            }
            Command::Spindle { spindle, step } => {
                let next = match spindle {
                    SpindleCommand::Stop => 0.0,
                    SpindleCommand::Clockwise(speed) => speed.0,
                    SpindleCommand::Counterclockwise(speed) => -speed.0,
                };
                let before = std::mem::replace(&mut self.spindle, next);
                let (from, to) = (self.time_from_rest(before), self.time_from_rest(next));
                let through_rest = before * next < 0.0;
                (if through_rest { from + to } else { (to - from).abs() }, *step)
            }
            _ => return None,
        };
        // A cast of a float saturates.
        let cycles = (seconds / TICK.0).round() as u32;
        (cycles > 0).then_some(Command::Dwell { cycles, step })
    }

    /// Time from rest to a speed, s: with all the torque up to where the power ends, with all the power from there.
    fn time_from_rest(&self, speed: f64) -> f64 {
        let spindle = &self.machine.spindle;
        let speed = speed.abs().min(spindle.highest.0) * std::f64::consts::PI / 30.0;
        let corner = (spindle.power / spindle.torque).min(speed);
        let seconds = spindle.inertia * (corner / spindle.torque + (speed * speed - corner * corner) / (2.0 * spindle.power));
        if seconds.is_finite() { seconds } else { 0.0 }
    }
}

/// Looks a program through. Optional stops are passed; a question that only the running machine can answer ends the look with an alarm.
pub fn survey(stream: Box<dyn ProgramStream + '_>, tables: &Tables, limits: Limits) -> Survey {
    survey_on(stream, tables, limits, None)
}

/// The same with what takes time beside the motion on a machine that has this tool in its spindle.
pub fn survey_on(
    stream: Box<dyn ProgramStream + '_>,
    tables: &Tables,
    limits: Limits,
    machine: Option<(&MachineParameters, ToolNumber)>,
) -> Survey {
    let mut progress = Progress::new("planning");
    let mut trajectory = Trajectory::new(stream, tables.position, limits);
    let mut found = Survey {
        reach: None,
        statistics: Statistics::default(),
        alarm: None,
        remarks: vec![],
        tools: BTreeMap::new(),
        frames: vec![],
        assumed_offsets: vec![],
        workingsteps: 0,
        remaining: RemainingTime::default(),
    };
    let mut answer = None;
    let mut waits = machine.map(|(machine, tool)| Waits {
        machine,
        tool,
        spindle: 0.0,
    });
    loop {
        let output = trajectory.next(answer.take());
        found.remaining.add(&output);
        if let (Output::Command(command), Some(waits)) = (&output, &mut waits)
            && let Some(wait) = waits.of(command)
        {
            found.remaining.add(&Output::Command(wait));
        }
        match output {
            Output::Command(machine::Command::SetPoint(point)) => {
                let p = point.position;
                let (low, high) = found.reach.get_or_insert((p, p));
                for k in 0..3 {
                    low[k] = low[k].min(p[k]);
                    high[k] = high[k].max(p[k]);
                }
                progress.at(|| format!("{:.0} s of motion", trajectory.statistics().time.0));
            }
            Output::Command(_) => {}
            Output::Passed(step) => match step.kind {
                StepKind::Tool(tool) => {
                    found.tools.entry(tool.number).or_insert(tool.name);
                }
                StepKind::Frame(frame) if !found.frames.iter().any(|f| f.0 == frame.name) => {
                    found.frames.push((frame.name, frame.assumed));
                }
                StepKind::ToolOffset(offset) if offset.assumed && !found.assumed_offsets.contains(&offset.number) => {
                    found.assumed_offsets.push(offset.number);
                }
                StepKind::Begin(marker) if marker.level == plan::Level::Workingstep => found.workingsteps += 1,
                _ => {}
            },
            Output::Ask(question) => answer = Some(beforehand(&question)),
            Output::End => break,
            Output::Alarm(alarm) => {
                found.alarm = Some(alarm);
                break;
            }
        }
    }
    found.statistics = trajectory.statistics();
    found.remarks = trajectory.stream().diagnostics().to_vec();
    found
}

/// What can be answered without a machine: the optional-stop switch is off. What only the machine knows is assumed by the program.
pub fn beforehand(question: &Question) -> Answer {
    match question {
        Question::OptionalStop => Answer::Truth(false),
        Question::Condition(_) | Question::Number(_) => Answer::NotAsked,
        Question::Skip { .. } => Answer::Unknown,
    }
}

/// How a check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// Nothing to say.
    Ok,
    /// A person should look.
    Warning,
    /// The program must not be run like this.
    Fail,
}

/// One pre-run check, with what decided it.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Check {
    /// What was checked.
    pub name: &'static str,
    /// How it came out.
    pub state: State,
    /// The number or fact that decided.
    pub text: String,
}

/// Errors of functions are known by their codes in the manual's table, T-01 to T-12; what stands behind a code tells kinds of it apart.
pub fn with_code(found: &Diagnostic, text: String) -> String {
    match found.code.get(..4).filter(|code| code.starts_with("T-")) {
        Some(code) => format!("{code}: {text}"),
        None => text,
    }
}

/// All pre-run checks of a program on a machine.
pub fn checks(found: &Survey, travels: [Option<(Millimetres, Millimetres)>; 3], tables: &Tables) -> Vec<Check> {
    let mut all = vec![];
    let mut say = |name, state, text: String| all.push(Check { name, state, text });

    match &found.alarm {
        Some(alarm) => say("program", State::Fail, with_code(&alarm.diagnostic, alarm.to_string())),
        None => {
            let s = &found.statistics;
            say(
                "program",
                State::Ok,
                format!("reads to its end: {} moves, {} workingsteps", s.blocks, found.workingsteps),
            );
        }
    }
    // What stopped the program is said above; its reader may have remarked it too.
    let alarmed = |remark: &&Diagnostic| found.alarm.as_ref().is_some_and(|a| a.diagnostic.message == remark.message);
    for remark in found.remarks.iter().filter(|r| !alarmed(r)) {
        let state = match remark.severity {
            plan::Severity::Remark => State::Ok,
            plan::Severity::Warning => State::Warning,
            plan::Severity::Error => State::Fail,
        };
        say("remark", state, with_code(remark, remark.to_string()));
    }
    match found.reach {
        None => say("travel", State::Warning, "the program moves nothing".to_owned()),
        Some((low, high)) => {
            let mut beyond = vec![];
            let mut inside = vec![];
            for (k, axis) in units::Axis::ALL.into_iter().enumerate() {
                let letter = axis.letter().to_ascii_uppercase();
                let span = format!("{letter} {:.1}..{:.1}", low[k], high[k]);
                match travels[k] {
                    None if high[k] - low[k] > 1e-6 => beyond.push(format!("{span} but the machine has no axis {letter}")),
                    None => {}
                    Some((min, max)) if low[k] < min.0 - 1e-6 || high[k] > max.0 + 1e-6 => {
                        beyond.push(format!("{span} of {:.1}..{:.1}", min.0, max.0));
                    }
                    Some((min, max)) => inside.push(format!("{span} of {:.1}..{:.1}", min.0, max.0)),
                }
            }
            if beyond.is_empty() {
                say("travel", State::Ok, format!("{} mm, machine frame", inside.join("  ")));
            } else {
                let text = format!(
                    "{} mm, machine frame: beyond the machine's travel; move the work offset or use a machine that reaches so far",
                    beyond.join("  ")
                );
                say("travel", State::Fail, text);
            }
        }
    }
    let names: Vec<String> = found
        .tools
        .iter()
        .map(|(n, name)| {
            if name.is_empty() {
                n.to_string()
            } else {
                format!("{n} {name}")
            }
        })
        .collect();
    let missing: Vec<String> = found
        .tools
        .keys()
        .filter(|n| !tables.tools.contains_key(n))
        .map(ToString::to_string)
        .collect();
    if missing.is_empty() && found.assumed_offsets.is_empty() {
        say(
            "tools",
            State::Ok,
            if names.is_empty() {
                "none called".into()
            } else {
                names.join(", ")
            },
        );
    } else {
        let offsets: Vec<String> = found.assumed_offsets.iter().map(ToString::to_string).collect();
        let mut text = format!("{} called", names.join(", "));
        if !missing.is_empty() {
            text += &format!("; not in the tool table: {}", missing.join(", "));
        }
        if !offsets.is_empty() {
            text += &format!("; offset {} assumed to be 0", offsets.join(", "));
        }
        say("tools", State::Warning, text);
    }
    for (name, assumed) in &found.frames {
        let name = if name.is_empty() { "without a name" } else { name };
        if *assumed {
            say(
                "set-up",
                State::Warning,
                format!("{name}: its place in the machine is assumed"),
            );
        } else {
            say("set-up", State::Ok, format!("{name}: place known"));
        }
    }
    say(
        "stock",
        State::Warning,
        "the stock is not known: collisions with it are not checked".to_owned(),
    );
    let Seconds(time) = found.statistics.time;
    say("time", State::Ok, format!("{} planned", minutes(time)));
    all
}

/// Seconds as people read them: `0:07` or `1:02:30`.
pub fn minutes(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    let (h, m, s) = (whole / 3600, whole / 60 % 60, whole % 60);
    if h > 0 {
        format!("{h}:{m:02}:{s:02}")
    } else {
        format!("{m}:{s:02} min")
    }
}
