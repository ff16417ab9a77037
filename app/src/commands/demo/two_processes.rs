//! The chapter of two processes: `toolmark controller`, started as a process of its own, machines the bracket's groove in real time, driven from
//! here over the default link; its record holds the set-points of the run in one process.
//!
//! How late a computer is depends on what else it does: that is counted and shown, and makes no story untrue.

use super::{BRACKET, Chapter, Story};
use crate::execution::{self, Asked, Drives, Order, Work};
use crate::failure::Failure;
use crate::link::address;
use crate::link::driven::Driven;
use crate::link::driving::make_ready;
use crate::link::remote::{Remote, plan_of_its_own};
use crate::program::{Program, machine_for};
use crate::survey::minutes;
use crate::{files, shop};
use cell::Ended;
use machine::StopCause;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};
use stepnc::edit::ProgramEdits;
use stepnc::select::select;
use units::{Point, Seconds};

/// What is machined: the shortest of the bracket's workingsteps.
const MACHINED: &str = "wave groove";
/// What is not.
const LEFT_OUT: [&str; 4] = ["face top", "round pocket", "drill holes", "side slot"];
/// How long a controller may take to say where it listens, and to end: it brings its machine to rest before.
const BEGINNING: Duration = Duration::from_secs(10);
const ENDING: Duration = Duration::from_secs(25);
/// Where time was stretched along the path, a set-point may be this far beside the path of the others: the record's quantum and the cubic
/// between two of them.
const ON_THE_PATH: f64 = 0.002;

impl Story<'_> {
    /// The same part twice: in this process, and by a controller in its own.
    pub(super) fn two_processes(&mut self) -> Result<Chapter, Failure> {
        (self.tell)("");
        (self.tell)("4. Two processes are one machine: the bracket's groove in real time, set-points over TCP");
        let path = self.folder.join("bracket-groove.stpnc");
        files::write(&path, &only_the_groove(BRACKET)?)?;
        let program = Program::open(&path, None, None)?;
        let folder = self.folder.join("groove-by-controller");
        std::fs::create_dir_all(&folder).map_err(|e| Failure::writing(&folder, e))?;
        let controller = match Controller::begin(self.common.seed, &folder.join("controller.log")) {
            Ok(controller) => controller,
            Err(why) => {
                (self.tell)(&format!("   skipped: {why}"));
                return Ok(Chapter {
                    came_true: true,
                    numbers: json!({ "skipped": why }),
                });
            }
        };
        let here = self.run(&program, "groove", vec![], None, self.start + Seconds(3000.0), None)?;
        let there = self.run_behind(&program, &controller, &folder)?;
        let Some(driven) = &there.driven else {
            return Err(Failure::negative("error: the controller's run has no account of its link"));
        };
        (self.tell)(&format!(
            "   toolmark controller, process {}, machined '{MACHINED}' in {} of machine time, driven by this process over {}",
            controller.child.id(),
            minutes(there.outcome.time.0),
            controller.address
        ));
        self.tell_driven(driven);
        let ended = controller.end();
        if let Some(late) = ended.as_ref().and_then(|told| told.get("lateness")) {
            let us = |name: &str| late.get(name).and_then(Value::as_f64).unwrap_or(0.0);
            (self.tell)(&format!(
                "   its cycles began late by p50 {:.0} us, p99 {:.0} us, at most {:.0} us",
                us("p50_us"),
                us("p99_us"),
                us("max_us")
            ));
        }
        let compared = Compared::of(&here.folder.join("record.parquet"), &there.folder.join("record.parquet"))?;
        let kept_away = matches!(&there.outcome.ended, Ended::Stopped(cause) if matches!(cause, StopCause::Late { .. } | StopCause::Starved))
            || matches!(&there.outcome.ended, Ended::Fault(_)) && driven.late_ticks > 0;
        let completed = there.outcome.ended == Ended::Completed;
        (self.tell)(&if completed {
            compared.words()
        } else {
            format!(
                "   it ended early: {}; what came until then: {}",
                there.outcome.ended.text(),
                compared.words().trim()
            )
        });
        Ok(Chapter {
            came_true: here.outcome.ended == Ended::Completed && compared.on_the_path() && (completed || kept_away),
            numbers: json!({
                "ended": there.outcome.ended.word(),
                "machine_time_s": there.outcome.time.0,
                "driven": driven,
                "controller": ended,
                "set_points": compared.there,
                "same_set_points": compared.same,
                "farthest_from_path_mm": compared.farthest,
            }),
        })
    }

    fn tell_driven(&self, driven: &Driven) {
        (self.tell)(&format!(
            "   following error at most {:.4} mm; set-points ahead {}; {}; link: {}",
            driven.worst_following_error(),
            driven.buffer(),
            driven.late(),
            driven.on_the_link()
        ));
    }

    fn run_behind(&mut self, program: &Program, controller: &Controller, folder: &Path) -> Result<execution::Run, Failure> {
        let machine = machine_for("sim-mill", false)?;
        let who = self.who();
        let start = self.start + Seconds(3600.0);
        let at = address::read(&controller.address)?;
        let name = format!("{} of {who}", program.name);
        let plan = plan_of_its_own(&name)?;
        let (remote, found) = Remote::connect(&at, None, &name, plan, &shop::parameters(&machine))?;
        let mut tables = self.directory.tables(&machine).map_err(shop::failure)?;
        tables.position = Point::from_xyz(make_ready(&remote, true)?.sample.commanded);
        let order = Order {
            work: Work::Program(program),
            machine: &machine,
            tables,
            seed: self.common.seed,
            start,
            faults: vec![],
            thinned: None,
            out: Some(folder),
            tolerance: None,
            fast: false,
            who: &who,
            drives: Drives::Behind(&remote, &found),
            stop: None,
            person: json!({ "level": ledger::Level::HIGHEST.number(), "authenticated_by": "none" }),
            found: None,
            asked: Asked::default(),
        };
        execution::run(&order, self.directory, None)
    }
}

/// The bracket with everything but its groove left out; nothing else of it changes.
fn only_the_groove(text: &str) -> Result<Vec<u8>, Failure> {
    let unreadable = |e: &dyn std::fmt::Display| Failure::unreadable(format_args!("bracket.stpnc: {e}"));
    let program = stepnc::Program::read("bracket.stpnc", text.as_bytes().to_vec()).map_err(|e| unreadable(&e))?;
    let mut edits = ProgramEdits::new(&program);
    for name in LEFT_OUT {
        let part = select(&program, name).map_err(|e| unreadable(&e))?;
        edits.enable(part, false).map_err(|e| unreadable(&e))?;
    }
    Ok(edits.save().map_err(|e| unreadable(&e))?.bytes)
}

/// A controller in its own process. It ends with this one, however this one ends: its standard input does.
struct Controller {
    child: Child,
    out: BufReader<ChildStdout>,
    address: String,
}

impl Controller {
    /// Starts one on any free port, and waits until it says where it is.
    fn begin(seed: u64, log: &Path) -> Result<Controller, String> {
        let program = std::env::current_exe().map_err(|e| format!("where this program is is not known: {e}"))?;
        let log_file = std::fs::File::create(log).map_err(|e| format!("{}: {e}", log.display()))?;
        let mut child = Command::new(&program)
            .args([
                "controller",
                "--json",
                "--port",
                "0",
                "--machine",
                "sim-mill",
                "--until-stdin-ends",
            ])
            .args(["--seed", &seed.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(log_file)
            .spawn()
            .map_err(|e| format!("a second process cannot be started here: {e}"))?;
        let Some(out) = child.stdout.take() else {
            return Err("the controller's words cannot be heard".to_owned());
        };
        let (told, first) = mpsc::channel();
        // A read has no end of its own; if none comes, the thread goes when the child does.
        std::thread::spawn(move || {
            let mut out = BufReader::new(out);
            let mut line = String::new();
            let read = out.read_line(&mut line);
            let _ = told.send((out, line, read));
        });
        let said = first.recv_timeout(BEGINNING);
        let address = |line: &str| {
            let told: Value = serde_json::from_str(line).ok()?;
            told.get("address")?.as_str().map(str::to_owned)
        };
        match said {
            Ok((out, line, Ok(_))) if address(&line).is_some() => Ok(Controller {
                address: address(&line).unwrap_or_default(),
                child,
                out,
            }),
            _ => {
                let _ = child.kill();
                let _ = child.wait();
                let why = std::fs::read_to_string(log).unwrap_or_default();
                Err(format!(
                    "the controller does not say where it listens: {}",
                    why.lines().next().unwrap_or("it said nothing")
                ))
            }
        }
    }

    /// Lets it go, and hears what it says at its end.
    fn end(mut self) -> Option<Value> {
        drop(self.child.stdin.take());
        let began = Instant::now();
        while began.elapsed() < ENDING && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(10));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        let mut text = String::new();
        self.out.read_to_string(&mut text).ok()?;
        serde_json::from_str(&text).ok()
    }
}

impl Drop for Controller {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The set-points of two records, standing still left out: how long a machine waits in position is not the plan's.
struct Compared {
    /// How many the second has.
    there: usize,
    /// They are the first one's, bit by bit.
    same: bool,
    /// The farthest of the second from the path of the first, mm.
    farthest: f64,
}

impl Compared {
    fn of(here: &Path, there: &Path) -> Result<Compared, Failure> {
        let (here, there) = (commanded(here)?, commanded(there)?);
        let same = here == there;
        let farthest = if same { 0.0 } else { farthest(&here, &there) };
        Ok(Compared {
            there: there.len(),
            same,
            farthest,
        })
    }

    fn on_the_path(&self) -> bool {
        self.same || self.farthest <= ON_THE_PATH
    }

    fn words(&self) -> String {
        if self.same {
            format!(
                "   {} set-points moved it, the same as in the run in one process, bit by bit",
                self.there
            )
        } else {
            format!(
                "   {} set-points moved it, at most {:.4} mm beside those of the run in one process: where set-points came late, the machine \
                 slowed down on its path",
                self.there, self.farthest
            )
        }
    }
}

/// Where a record's machine was commanded to be, one after another.
fn commanded(record: &Path) -> Result<Vec<[f64; 3]>, Failure> {
    let reader = store::record::Reader::open(record).map_err(shop::failure)?;
    let mut all = Vec::new();
    for row in reader.rows().map_err(shop::failure)? {
        all.extend(row.map_err(shop::failure)?.commanded);
    }
    all.dedup();
    Ok(all)
}

/// How far the farthest of some points is from a path of chords, mm. Both go the same way, so each search begins near the last.
fn farthest(path: &[[f64; 3]], points: &[[f64; 3]]) -> f64 {
    /// Chords before and behind the last one that was nearest: more than a slowed machine gets behind in a cycle.
    const AROUND: usize = 400;
    let mut worst = 0.0f64;
    let mut at = 0usize;
    for point in points {
        let from = at.saturating_sub(AROUND);
        let until = (at + AROUND).min(path.len());
        let mut nearest = f64::INFINITY;
        for k in from..until {
            let next = path.get(k + 1).unwrap_or(&path[k]);
            let distance = from_chord(point, &path[k], next);
            if distance < nearest {
                (nearest, at) = (distance, k);
            }
        }
        worst = worst.max(nearest);
    }
    worst
}

fn from_chord(point: &[f64; 3], a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let chord: [f64; 3] = std::array::from_fn(|k| b[k] - a[k]);
    let out: [f64; 3] = std::array::from_fn(|k| point[k] - a[k]);
    let square: f64 = chord.iter().map(|c| c * c).sum();
    let along: f64 = chord.iter().zip(&out).map(|(c, o)| c * o).sum();
    let share = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
    let beside: f64 = (0..3).map(|k| (out[k] - share * chord[k]).powi(2)).sum();
    beside.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_between_the_set_points_are_on_the_path_and_others_are_not() {
        let path: Vec<[f64; 3]> = (0..2000).map(|k| [f64::from(k) * 0.01, 0.0, 0.0]).collect();
        let slowed: Vec<[f64; 3]> = (0..6000).map(|k| [f64::from(k) * 0.003, 0.0, 0.0]).collect();
        assert!(farthest(&path, &slowed) < 1e-12);
        let mut beside = slowed;
        beside[3000][1] = 0.01;
        assert!((farthest(&path, &beside) - 0.01).abs() < 1e-12);
        assert_eq!(farthest(&[], &[]), 0.0);
        assert_eq!(farthest(&[], &[[0.0; 3]]), f64::INFINITY);
    }

    #[test]
    fn the_groove_alone_is_left_of_the_bracket() {
        let bytes = only_the_groove(BRACKET).expect("edits");
        let program = stepnc::Program::read("bracket.stpnc", bytes).expect("reads");
        for name in LEFT_OUT {
            select(&program, name).expect("it is still there");
        }
        select(&program, MACHINED).expect("the groove");
    }
}
