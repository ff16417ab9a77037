//! The controller's own record of what it machines for a side that cannot keep one: one file for each time from `M1` to `M0`.
//!
//! What the program was, nobody told the controller: rows carry no step, and the record is matched to a plan by its places.

use crate::failure::Failure;
use crate::{clock, shop};
use machine::{Report, Sample};
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
    worst: f64,
    late: u64,
    missed: u64,
}

impl Recording {
    /// Records into a folder, which is made.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn into(folder: &Path, machine: &str, simulated: bool) -> Result<Recording, Failure> {
        std::fs::create_dir_all(folder).map_err(|e| Failure::writing(folder, e))?;
        Ok(Recording {
            folder: folder.to_owned(),
            machine: machine.to_owned(),
            simulated,
            number: 0,
            open: None,
        })
    }

    /// Hears of a cycle; gives a line for a person when a record was closed or cannot be kept.
    pub fn hear(&mut self, report: &Report, machining: bool) -> Option<String> {
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
        for k in 0..3 {
            open.worst = open.worst.max((sample.commanded[k] - sample.actual[k]).abs());
        }
        open.late = report.counters.late_ticks - open.first.counters.late_ticks;
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
            worst: 0.0,
            late: 0,
            missed: 0,
        })
    }

    fn close(&self, open: Open) -> Result<String, Failure> {
        open.recorder.end().map_err(shop::failure)?;
        let merged = segment::merge(&open.segments, &open.path, &[], &[]).map_err(shop::failure)?;
        segment::discard(&open.segments).map_err(shop::failure)?;
        Ok(format!(
            "{}: {} rows, {:.1} s; following error at most {:.4} mm, {} late ticks, {} rows missed",
            open.path.display(),
            merged.finished.rows,
            open.last.seconds().0,
            open.worst,
            open.late,
            open.missed
        ))
    }
}
