//! The controller's own record of what it machines for a side that cannot keep one: one file for each time from `M1` to `M0`.
//!
//! What the program was, nobody told the controller: rows carry no step, and the record is matched to a plan by its places. How near the axes
//! followed, how many lines were waiting and how late the machine was stand in the metadata of the record, and go into the report from there.

use crate::failure::Failure;
use crate::link::driven::{self, Driven, OnLink, Watched};
use crate::{clock, shop};
use machine::{Counters, Report, Sample, State};
use std::path::{Path, PathBuf};
use store::record::{Header, SampleRows};
use store::segment::{self, Offered, Pace, Recorder, Settings};
use units::{StepId, Tick, Timestamp, WorkingstepId};

/// Cycles without work after machining was given up or is over, after which its record is closed.
const QUIET: u64 = 200;

/// Records of one controller.
pub struct Recording {
    folder: PathBuf,
    machine: String,
    address: String,
    simulated: bool,
    number: u32,
    open: Option<Open>,
}

struct Open {
    recorder: Recorder<SampleRows>,
    path: PathBuf,
    segments: PathBuf,
    first: Report,
    last: Tick,
    quiet: u64,
    watched: Watched,
    counters: Counters,
    missed: u64,
}

impl Recording {
    /// Records into a folder, which is made; `address` is where the controller is.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn into(folder: &Path, machine: &str, address: &str, simulated: bool) -> Result<Recording, Failure> {
        std::fs::create_dir_all(folder).map_err(|e| Failure::writing(folder, e))?;
        Ok(Recording {
            folder: folder.to_owned(),
            machine: machine.to_owned(),
            address: address.to_owned(),
            simulated,
            number: 0,
            open: None,
        })
    }

    /// Hears of a cycle, in which so many set-points were waiting; gives a line for a person when a record was closed or cannot be kept.
    pub fn hear(&mut self, report: &Report, machining: bool, depth: u64) -> Option<String> {
        if self.open.is_none() {
            if !machining {
                return None;
            }
            match self.begin(report) {
                Ok(open) => self.open = Some(open),
                Err(failure) => return Some(failure.message),
            }
        }
        let open = self.open.as_mut()?;
        let sample = Sample {
            tick: Tick(report.sample.tick.0 - open.first.sample.tick.0),
            // Numbers of operations are no steps of a plan.
            step: StepId::NONE,
            workingstep: WorkingstepId(0),
            ..report.sample
        };
        open.last = sample.tick;
        if matches!(open.recorder.offer(&sample), Offered::Missed) {
            open.missed += 1;
        }
        open.watched.see(&sample, report.state == State::Running, depth);
        open.counters = report.counters;
        open.quiet = if machining || !(report.idle || report.state.needs_a_person()) {
            0
        } else {
            open.quiet + 1
        };
        if open.quiet < QUIET {
            return None;
        }
        let open = self.open.take()?;
        Some(self.close(open).unwrap_or_else(|failure| failure.message))
    }

    /// Closes what is open.
    pub fn end(&mut self) -> Option<String> {
        let open = self.open.take()?;
        Some(self.close(open).unwrap_or_else(|failure| failure.message))
    }

    fn begin(&mut self, first: &Report) -> Result<Open, Failure> {
        let start: Timestamp = clock::start_time(None)?;
        let path = loop {
            self.number += 1;
            let path = self.folder.join(format!("run-{:04}.parquet", self.number));
            if !path.exists() {
                break path;
            }
        };
        let segments = path.with_extension("recording");
        let header = Header {
            machine: self.machine.clone(),
            simulated: self.simulated,
            start,
            seed: 0,
        };
        let rows = SampleRows::new(start, &path);
        let recorder = Recorder::begin(&segments, rows, header.metadata(), &Settings::new(Pace::Real)).map_err(shop::failure)?;
        Ok(Open {
            recorder,
            path,
            segments,
            first: *first,
            last: Tick(0),
            quiet: 0,
            watched: Watched::default(),
            counters: first.counters,
            missed: 0,
        })
    }

    fn close(&self, open: Open) -> Result<String, Failure> {
        let driven = open.driven(&self.address);
        open.recorder.end().map_err(shop::failure)?;
        let told =
            serde_json::to_string(&driven).map_err(|e| Failure::machine(format_args!("the record's facts are no JSON: {e}")))?;
        let more = [(driven::METADATA_KEY, told)];
        let merged = segment::merge(&open.segments, &open.path, &[], &more).map_err(shop::failure)?;
        segment::discard(&open.segments).map_err(shop::failure)?;
        Ok(format!(
            "{}: {} rows, {:.1} s, {} rows missed\n  {}\n  toolmark rebuild PROGRAM {} --out as-executed.stpnc --report DIR holds it against its plan",
            open.path.display(),
            merged.finished.rows,
            open.last.seconds().0,
            open.missed,
            driven.lines().join("\n  "),
            open.path.display()
        ))
    }
}

impl Open {
    fn driven(&self, address: &str) -> Driven {
        let (now, before) = (&self.counters, &self.first.counters);
        let counters = Counters {
            late_ticks: now.late_ticks.saturating_sub(before.late_ticks),
            late_gaps: now.late_gaps.saturating_sub(before.late_gaps),
            starvations: now.starvations.saturating_sub(before.starvations),
            ..Counters::default()
        };
        let on = OnLink {
            link: "text",
            controller: address.to_owned(),
            // From M1 to M0 one connection has the machine, and what it loses ends the record.
            leases: 1,
            ..OnLink::default()
        };
        self.watched.driven(&counters, on)
    }
}
