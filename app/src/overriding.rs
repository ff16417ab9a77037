//! Overrides and holds of a run that has no pad: constant ones from the command line, and a script of them for simulated runs.
//!
//! A script is a text with one line for each moment: the time in seconds of the run, then what is turned or pressed there.
//!
//! ```text
//! # seconds   what
//! 1.5         feed=120 rapid=50
//! 4           hold
//! 6.25        resume
//! 8           feed=100 spindle=90
//! ```

use crate::failure::Failure;
use ledger::Event;
use machine::Overrides;
use serde::Serialize;
use serde_json::Value;
use std::path::Path;
use units::{TICK, Tick};

/// The latest moment of a script, s: a week.
const LATEST: f64 = 604_800.0;

/// Which values an override may have at the command line, percent.
#[derive(Clone, Copy)]
struct Knob {
    name: &'static str,
    lowest: u8,
    highest: u8,
    place: fn(&mut Overrides) -> &mut u8,
}

const KNOBS: [Knob; 3] = [
    Knob {
        name: "feed",
        lowest: 0,
        highest: 200,
        place: |o| &mut o.feed,
    },
    Knob {
        name: "rapid",
        lowest: 0,
        highest: 100,
        place: |o| &mut o.rapid,
    },
    // Slower or faster than that it is another cutting speed than the tool was chosen for.
    Knob {
        name: "spindle",
        lowest: 50,
        highest: 150,
        place: |o| &mut o.spindle,
    },
];

impl Knob {
    fn read(&self, text: &str) -> Result<u8, String> {
        let wanted = text.strip_suffix('%').unwrap_or(text).trim_end();
        let value = wanted
            .parse()
            .ok()
            .filter(|value| (self.lowest..=self.highest).contains(value));
        value.ok_or_else(|| {
            format!(
                "{text} is no {} override: whole percents from {} to {} were expected",
                self.name, self.lowest, self.highest
            )
        })
    }
}

/// What happens to a run from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overriding {
    /// From the beginning on; `None` leaves the machine's own.
    pub constant: Option<Overrides>,
    /// In order of time.
    pub script: Vec<(Tick, Act)>,
}

/// What is turned or pressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Act {
    /// These overrides, from here on.
    Turn(Overrides),
    /// Feed hold.
    Hold,
    /// Cycle start.
    Resume,
}

impl Overriding {
    /// What the command line says: feed, rapid and spindle in percent, and a script.
    ///
    /// # Errors
    /// A value is none, or the script cannot be read.
    pub fn of(
        feed: Option<&str>,
        rapid: Option<&str>,
        spindle: Option<&str>,
        script: Option<&Path>,
    ) -> Result<Overriding, Failure> {
        let mut constant = Overrides::default();
        for (knob, given) in KNOBS.iter().zip([feed, rapid, spindle]) {
            if let Some(text) = given {
                let value = knob.read(text.trim());
                *(knob.place)(&mut constant) =
                    value.map_err(|why| Failure::usage(format_args!("--{}-override {why}", knob.name)))?;
            }
        }
        let is_given = feed.or(rapid).or(spindle).is_some();
        let script = match script {
            None => vec![],
            Some(path) => {
                let name = path.display().to_string();
                let text =
                    std::fs::read_to_string(path).map_err(|e| Failure::unreadable(format_args!("--overrides {name}: {e}")))?;
                read(&text, constant)
                    .map_err(|(line, column, why)| Failure::unreadable(format_args!("{name}:{line}:{column}: {why}")))?
            }
        };
        Ok(Overriding {
            constant: is_given.then_some(constant),
            script,
        })
    }

    /// True when nothing happens.
    pub fn is_nothing(&self) -> bool {
        self.constant.is_none() && self.script.is_empty()
    }
}

/// A script, or line, column and what is wrong there.
fn read(text: &str, from: Overrides) -> Result<Vec<(Tick, Act)>, (usize, usize, String)> {
    let mut acts: Vec<(Tick, Act)> = vec![];
    let mut now = from;
    let mut held: Option<usize> = None;
    for (number, line) in text.lines().enumerate().map(|(k, line)| (k + 1, line)) {
        let line = line.split('#').next().unwrap_or_default();
        let column = |part: &str| 1 + line[..part.as_ptr() as usize - line.as_ptr() as usize].chars().count();
        let mut words = line.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty());
        let Some(first) = words.next() else { continue };
        let wrong = |part: &str, why: String| Err((number, column(part), why));
        let seconds = first.strip_suffix('s').unwrap_or(first).parse::<f64>();
        let Some(seconds) = seconds.ok().filter(|s| (0.0..=LATEST).contains(s)) else {
            let why = format!("{first} is no time: seconds of the run were expected, like: 1.5 feed=120");
            return wrong(first, why);
        };
        let at = Tick((seconds / TICK.0).round() as u64);
        if acts.last().is_some_and(|(before, _)| *before > at) {
            return wrong(
                first,
                format!("{first} s is before the line above: lines go in order of time"),
            );
        }
        let mut turned = None;
        let mut is_empty = true;
        for word in words {
            is_empty = false;
            match word {
                "hold" if held.is_some() => return wrong(word, "it is held already: resume comes first".to_owned()),
                "hold" => {
                    held = Some(number);
                    acts.push((at, Act::Hold));
                }
                "resume" if held.is_none() => return wrong(word, "nothing is held here: hold comes first".to_owned()),
                "resume" => {
                    held = None;
                    acts.push((at, Act::Resume));
                }
                word => {
                    let found = word.split_once('=');
                    let knob = found.and_then(|(name, value)| Some((KNOBS.iter().find(|k| k.name == name)?, value)));
                    let Some((knob, value)) = knob else {
                        let why =
                            format!("{word} is unknown; known are feed=PERCENT, rapid=PERCENT, spindle=PERCENT, hold, resume");
                        return wrong(word, why);
                    };
                    let value = knob.read(value).map_err(|why| (number, column(word), why))?;
                    *(knob.place)(&mut now) = value;
                    turned = Some(now);
                }
            }
        }
        if is_empty {
            return wrong(
                first,
                "nothing happens at this time: feed=PERCENT, rapid=PERCENT, spindle=PERCENT, hold or resume".to_owned(),
            );
        }
        acts.extend(turned.map(|overrides| (at, Act::Turn(overrides))));
    }
    match held {
        Some(line) => Err((
            line,
            1,
            "this hold is never resumed: add a line with a later time and resume".to_owned(),
        )),
        None => Ok(acts),
    }
}

/// Overrides that were in force for a time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InForce {
    /// From this second of the run on.
    pub from_s: f64,
    /// Up to here.
    pub to_s: f64,
    /// Of feeds.
    pub feed_percent: u64,
    /// Of rapids.
    pub rapid_percent: u64,
    /// Of the spindle.
    pub spindle_percent: u64,
}

/// What overrides and holds came to in a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Overridden {
    /// Which overrides were in force when; empty when all were 100 % all the time.
    pub overrides: Vec<InForce>,
    /// Times that the feed was held.
    pub holds: u64,
    /// How long it was, s: from the hold to cycle start.
    pub held_s: f64,
}

impl Overridden {
    /// Reads it out of the events of a run that was over after so many seconds.
    pub fn of(events: &[Event], end_s: f64) -> Overridden {
        let mut told = Overridden::default();
        let start = events.first().map_or(0, |event| event.at_ns);
        let mut present = InForce {
            from_s: 0.0,
            to_s: end_s,
            feed_percent: 100,
            rapid_percent: 100,
            spindle_percent: 100,
        };
        let as_programmed = present.clone();
        let mut held: Option<f64> = None;
        for event in events {
            let now = (event.at_ns - start) as f64 / 1e9;
            match event.kind.as_str() {
                "override" => {
                    let of = |name: &str| event.detail.get(name).and_then(Value::as_u64).unwrap_or(100);
                    let next = InForce {
                        from_s: now,
                        to_s: end_s,
                        feed_percent: of("feed_percent"),
                        rapid_percent: of("rapid_percent"),
                        spindle_percent: of("spindle_percent"),
                    };
                    let mut before = std::mem::replace(&mut present, next);
                    before.to_s = now;
                    if before.to_s > before.from_s {
                        told.overrides.push(before);
                    }
                }
                "hold" if held.is_none() => {
                    held = Some(now);
                    told.holds += 1;
                }
                "cycle-start" | "controlled-stop" | "emergency-stop" | "fault" => {
                    told.held_s += held.take().map_or(0.0, |since| now - since);
                }
                _ => {}
            }
        }
        told.held_s += held.map_or(0.0, |since| (end_s - since).max(0.0));
        told.overrides.push(present);
        let plain = |o: &InForce| {
            (o.feed_percent, o.rapid_percent, o.spindle_percent)
                == (
                    as_programmed.feed_percent,
                    as_programmed.rapid_percent,
                    as_programmed.spindle_percent,
                )
        };
        if told.overrides.iter().all(plain) {
            told.overrides.clear();
        }
        told
    }

    /// In a sentence; `None` when nothing was turned or held.
    pub fn line(&self) -> Option<String> {
        let mut parts: Vec<String> = (self.overrides.iter())
            .map(|o| {
                format!(
                    "feed {} %, rapid {} %, spindle {} % from {:.1} to {:.1} s",
                    o.feed_percent, o.rapid_percent, o.spindle_percent, o.from_s, o.to_s
                )
            })
            .collect();
        if parts.len() > 6 {
            let more = parts.len() - 6;
            parts.truncate(6);
            parts.push(format!("and {more} more"));
        }
        if self.holds > 0 {
            let times = if self.holds == 1 {
                "once".to_owned()
            } else {
                format!("{} times", self.holds)
            };
            parts.push(format!("held {times}, {:.1} s in all", self.held_s));
        }
        (!parts.is_empty()).then(|| format!("overrides: {}", parts.join("; ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn refused(script: &str, place: (usize, usize), says: &str) {
        let (line, column, why) = read(script, Overrides::default()).expect_err(script);
        assert_eq!((line, column), place, "{why}");
        assert!(why.contains(says), "{why}");
    }

    #[test]
    fn a_script_is_lines_of_times_and_acts() {
        let acts = read(
            "# mine\n\n1.5 feed=120, rapid=50 # faster\n4 hold\n6.25s\tresume spindle=90%\n",
            Overrides::default(),
        );
        let turned = |feed, rapid, spindle| Act::Turn(Overrides { feed, rapid, spindle });
        assert_eq!(
            acts.expect("a script"),
            [
                (Tick(1500), turned(120, 50, 100)),
                (Tick(4000), Act::Hold),
                (Tick(6250), Act::Resume),
                (Tick(6250), turned(120, 50, 90)),
            ]
        );
    }

    #[test]
    fn what_is_wrong_in_a_script_is_said_with_its_place() {
        refused("1 feed=201", (1, 3), "0 to 200");
        refused("1 rapid=101", (1, 3), "0 to 100");
        refused("1 spindle=49", (1, 3), "50 to 150");
        refused("1 feed=1e2", (1, 3), "whole percents");
        refused("\n2 hold\n1 resume", (3, 1), "before the line above");
        refused("1 hold", (1, 1), "never resumed");
        refused("1 hold\n2 hold", (2, 3), "held already");
        refused("1 resume", (1, 3), "nothing is held");
        refused("-1 hold", (1, 1), "no time");
        refused("NaN hold", (1, 1), "no time");
        refused("1e99 hold", (1, 1), "no time");
        refused("3", (1, 1), "nothing happens");
        refused("3 ü=1", (1, 3), "unknown");
        refused("feed=3", (1, 1), "no time");
    }
}
